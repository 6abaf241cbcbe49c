use crate::{BlockId, Event, GazeSample, Gesture, JointVector, PlanStatus, Point, Pose, SimTime, Stop};
use serde::{Deserialize, Serialize};

/// One consistent instant, as drawn: the page, the headset and the simulated participant all see this and
/// nothing else.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
pub struct DisplayFrame {
    /// The instant.
    pub time: SimTime,
    /// Name of the control method, such as `D`.
    pub method: String,
    /// Moving joints of the arm model, in its order, rad.
    pub joints: JointVector,
    /// `world_from_base`.
    #[cfg_attr(feature = "ts", ts(as = "crate::typescript::Pose"))]
    pub world_from_base: Pose,
    /// `world_from_tip`.
    #[cfg_attr(feature = "ts", ts(as = "crate::typescript::Pose"))]
    pub world_from_tip: Pose,
    /// `world_from_head`: x ahead, y left, z up; the eye is its origin.
    #[cfg_attr(feature = "ts", ts(as = "crate::typescript::Pose"))]
    pub world_from_head: Pose,
    /// `world_from_block` in [`BlockId::ALL`] order.
    #[cfg_attr(feature = "ts", ts(as = "Vec<crate::typescript::Pose>"))]
    pub blocks: Vec<Pose>,
    /// The hand.
    pub hand: HandView,
    /// Gaze as measured.
    pub gaze: Option<GazeSample>,
    /// Selection marker.
    pub target: TargetView,
    /// The planner and the motion.
    pub planner: PlannerView,
    /// Arm joints at the end of the plan that is followed, rad; none while no plan is followed.
    #[serde(default)]
    pub goal: Option<JointVector>,
    /// What the next movement gesture moves, for methods that cycle through joints or axes.
    #[serde(default)]
    pub mode: Option<ModeView>,
    /// Why the arm must stand still; none while it need not.
    #[serde(default)]
    pub stop: Option<Stop>,
    /// Gesture in force, as recognised.
    pub gesture: Gesture,
    /// Probability of the recognised class, 0 to 1; one for keys.
    pub confidence: f64,
    /// How hard the recognised gesture is made, 0 to 1; one for keys.
    #[serde(default)]
    pub effort: f64,
    /// Where the EMG comes from: `recording`, `synthetic`, `keys`.
    pub emg_source: String,
    /// Seconds until the time limit.
    pub time_left_secs: f64,
    /// The block that the prescribed order asks for next.
    pub next_block: Option<BlockId>,
    /// Blocks on target so far.
    pub on_target: u32,
    /// True when the trial is over.
    pub finished: bool,
    /// Events since the frame before: sounds and log.
    pub events: Vec<Event>,
}

/// The hand's state, from its joints.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
#[serde(rename_all = "snake_case")]
pub enum HandState {
    /// Wide.
    #[default]
    Open,
    /// On its way to closed.
    Closing,
    /// Closed, or stopped by a block.
    Closed,
    /// On its way to open.
    Opening,
}

impl HandState {
    /// All of them, in the order of their numbers.
    pub const ALL: [HandState; 4] =
        [HandState::Open, HandState::Closing, HandState::Closed, HandState::Opening];
}

/// What is seen of the hand.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
pub struct HandView {
    /// Open, closed, or between.
    pub state: HandState,
    /// The block in it.
    pub holds: Option<BlockId>,
}

/// The selection marker.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
pub struct TargetView {
    /// The highlighted block, while the hand is empty.
    pub block: Option<BlockId>,
    /// The place marker on the table top.
    #[cfg_attr(feature = "ts", ts(as = "Option<[f64; 3]>"))]
    pub place: Option<Point>,
    /// The selection of the current phase (block, or place while a block is held) is locked.
    pub locked: bool,
    /// Posterior over blocks in [`BlockId::ALL`] order; empty for methods without inference.
    pub posterior: Vec<f64>,
}

/// The joint or axis that WE and WF move, in methods A and B.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
pub struct ModeView {
    /// The number published on `/mode`: 0 to 6 are joints, 7 to 9 translations, 10 to 12 rotations about x, y, z.
    pub number: u8,
    /// As shown, such as `elbow flexion`.
    pub name: String,
    /// What WE does, such as `flexion`, and what WF does.
    pub directions: [String; 2],
    /// 1 if WE turns the joint or moves the axis in its positive direction, -1 if in the other.
    #[serde(default)]
    pub we_sign: i8,
    /// Seconds until a held HO moves on; none when it is not held.
    pub next_in_secs: Option<f64>,
}

/// Planner status as shown.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
#[serde(tag = "state", rename_all = "snake_case")]
pub enum PlannerView {
    /// Nothing to do.
    Idle,
    /// Working on a request.
    Planning,
    /// The arm follows a plan.
    Executing {
        /// From 0 to 1.
        progress: f64,
        /// The plan ends at a point on the way.
        intermediate: bool,
    },
    /// The end of the plan was reached.
    Arrived {
        /// The plan ended at a point on the way.
        intermediate: bool,
    },
    /// No plan.
    Failed {
        /// Why.
        status: PlanStatus,
        /// One sentence.
        reason: String,
    },
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn states_of_the_hand_stand_at_their_numbers() {
        for (place, state) in HandState::ALL.into_iter().enumerate() {
            assert_eq!(state as usize, place, "{state:?}");
        }
    }
}
