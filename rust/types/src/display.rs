use crate::{
    Command, ContactView, Event, FeedbackCue, GazeSample, Gesture, JointVector, ObjectId, PlanStatus, Point,
    Pose, SimTime, Stop, TaskGoal,
};
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
    /// `world_from_object` of all objects of the scene.
    #[cfg_attr(feature = "ts", ts(as = "Vec<crate::typescript::Pose>"))]
    pub objects: Vec<Pose>,
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
    #[serde(rename = "goal")]
    pub plan_goal: Option<JointVector>,
    /// What the next movement gesture moves, for methods that cycle through joints or axes.
    #[serde(default)]
    pub mode: Option<ModeView>,
    /// Why the arm must stand still; none while it need not.
    #[serde(default)]
    pub stop: Option<Stop>,
    /// Command in force, from the gesture that was recognised.
    #[serde(rename = "gesture")]
    pub command: Command,
    /// The gesture in force by its own name, as the EMG model calls it; that of the command for keys.
    #[serde(default)]
    #[serde(rename = "recognised")]
    pub recognized_gesture: Gesture,
    /// Probability of the recognised class, 0 to 1; one for keys.
    pub confidence: f64,
    /// How hard the recognised gesture is made, 0 to 1; one for keys.
    #[serde(default)]
    pub effort: f64,
    /// Where the EMG comes from: `recording`, `synthetic`, `keys`.
    pub emg_source: String,
    /// Seconds until the time limit.
    pub time_left_secs: f64,
    /// The object that the task asks for next.
    #[serde(rename = "next")]
    pub next_object: Option<ObjectId>,
    /// Where that goes, or what the hand or the joints are asked for; none where the task asks for one thing all the time.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[serde(rename = "asked")]
    pub task_goal: Option<TaskGoal>,
    /// What the task counts, so far.
    pub score: u32,
    /// True when the trial is over.
    pub finished: bool,
    /// Events since the frame before: the log.
    pub events: Vec<Event>,
    /// Links that touch blocks.
    #[serde(default)]
    pub contacts: Vec<ContactView>,
    /// What was to be heard and felt since the frame before.
    #[serde(default)]
    pub feedback: Vec<FeedbackCue>,
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
    /// Closed, or stopped by an object.
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
    /// The object in it.
    #[serde(rename = "holds")]
    pub held_object: Option<ObjectId>,
}

/// The selection marker.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
pub struct TargetView {
    /// The highlighted object, while the hand is empty.
    pub object: Option<ObjectId>,
    /// The place marker on the table top.
    #[cfg_attr(feature = "ts", ts(as = "Option<[f64; 3]>"))]
    pub place: Option<Point>,
    /// The selection of the current phase (object, or place while an object is held) is locked.
    pub locked: bool,
    /// Posterior over the objects of the scene; empty for methods without inference.
    pub posterior: Vec<f64>,
}

/// What the movement gestures move.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
#[serde(rename_all = "snake_case")]
pub enum ControlledDof {
    /// The joint at this place of the arm, from 0 at the base; the place behind the last is the hand, which opens and closes.
    Joint(u8),
    /// The hand along an axis of the base: 0 x, 1 y, 2 z.
    Translation(u8),
    /// The hand about such an axis.
    Rotation(u8),
}

/// The joint or axis that WE and WF move, in methods A and B.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
pub struct ModeView {
    /// What is moved.
    #[serde(rename = "moves")]
    pub controlled_dof: ControlledDof,
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
        for (index, state) in HandState::ALL.into_iter().enumerate() {
            assert_eq!(state as usize, index, "{state:?}");
        }
    }
}
