use crate::ports::ArmKinematics;
use proact_types::{
    BlockId, EventKind, Gesture, HandView, JointVector, ModeView, PlanGoal, PlanReply, PlanStatus,
    PlannerView, Point, Pose, SimTime, Stop, Target, TargetView, Trajectory,
};
use serde::{Deserialize, Serialize};

/// What a method sees at one control step.
#[derive(Clone, Debug)]
pub struct ControlInput<'a> {
    /// Gesture in force.
    pub gesture: Gesture,
    /// The gesture that the EMG stage published in this tick; none between its messages.
    pub message: Option<Gesture>,
    /// Angles of the arm joints as measured, rad.
    pub measured: &'a [f64],
    /// Angles of the arm joints as asked of the position control, rad.
    pub commanded: &'a [f64],
    /// Block with the highest posterior; none when no block is in question.
    pub highlight: Option<BlockId>,
    /// Centres of the blocks in `world`, `BlockId::ALL` order.
    pub blocks: &'a [Point; 4],
    /// Posterior over blocks, for the display; empty without inference.
    pub posterior: &'a [f64],
    /// Where the gaze would put a block down, on the table top, in `world`.
    pub place: Point,
    /// The hand, from its joints and from contact.
    pub hand: HandView,
    /// `world_from_base`.
    pub world_from_base: Pose,
    /// A plan that takes effect now.
    pub plan: Option<&'a PlanReply>,
    /// What the trajectory controller does.
    pub motion: MotionState,
    /// Where blocks should go; a place may snap to them.
    pub targets: &'a [Target],
    /// Angles of the person's own limb in the arm's joints, rad, for joints that the prosthesis does not have; none
    /// where the whole arm is lost or nothing tracks it.
    pub limb: Option<&'a [f64]>,
    /// The arm must stand still, and why.
    pub stop: Option<&'a Stop>,
    /// Milliseconds since the last decision on the EMG; none when gestures come from elsewhere.
    pub emg_age_ms: Option<u64>,
    /// Milliseconds since the last valid gaze measurement; none when gaze is not used.
    pub gaze_age_ms: Option<u64>,
    /// Milliseconds since the last tracked pose of the shoulder; none when nothing is tracked.
    pub tracking_age_ms: Option<u64>,
}

/// What the trajectory controller does.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MotionState {
    /// It holds the arm where it is.
    Holding,
    /// It follows a trajectory; from 0 to 1.
    Following(f64),
    /// It has come to the end of a trajectory and holds.
    Finished,
}

/// What a method asks for. `None` everywhere leaves all as it is.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ControlOutput {
    /// For the arm.
    pub motion: Option<MotionCommand>,
    /// For the hand.
    pub hand: Option<HandCommand>,
    /// For the planner.
    pub plan: Option<PlanCommand>,
    /// What happened.
    pub events: Vec<EventKind>,
}

/// A command for the arm.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MotionCommand {
    /// Stop and hold, from this tick on.
    Hold,
    /// Follow from the start.
    Follow(Trajectory),
    /// Move the arm joints at these speeds, rad/s, until the next command. A method that moves says so at every
    /// control step: after two steps without, the arm holds.
    Velocity(JointVector),
    /// Go to these arm angles, rad, each joint at its highest speed, and hold there.
    Goto(JointVector),
}

/// A command for the hand.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum HandCommand {
    /// Go to the pose `open`.
    Open,
    /// Go to the pose `closed`; a block in between stops the fingers.
    Close,
}

/// A command for the planner.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PlanCommand {
    /// Make a plan. The testbed adds the state of the world.
    Request(PlanGoal),
    /// Give up the plan in the making.
    Cancel,
}

/// How a refusal is shown.
pub(crate) fn refused(reason: &str) -> PlannerView {
    PlannerView::Failed { status: PlanStatus::Invalid, reason: reason.to_owned() }
}

/// A control method: a pure state machine that runs at 100 Hz and at each tick with a new gesture or plan.
///
/// Deterministic: the same inputs at the same times give the same outputs.
pub trait ControlMethod: Send {
    /// Name shown to the participant and written to the record, such as `D`.
    fn name(&self) -> &str;

    /// Advances to `now`. `kinematics` is that of the arm, base to tip.
    fn step(
        &mut self,
        now: SimTime,
        input: &ControlInput<'_>,
        kinematics: &mut dyn ArmKinematics,
    ) -> ControlOutput;

    /// What the movement gestures move, for methods that cycle through joints or axes.
    fn mode(&self) -> Option<ModeView> {
        None
    }

    /// The selection marker after the last step.
    fn target(&self) -> TargetView;

    /// The planner's state after the last step.
    fn planner(&self) -> PlannerView;
}

impl<M: ControlMethod + ?Sized> ControlMethod for Box<M> {
    fn name(&self) -> &str {
        (**self).name()
    }

    fn step(
        &mut self,
        now: SimTime,
        input: &ControlInput<'_>,
        kinematics: &mut dyn ArmKinematics,
    ) -> ControlOutput {
        (**self).step(now, input, kinematics)
    }

    fn mode(&self) -> Option<ModeView> {
        (**self).mode()
    }

    fn target(&self) -> TargetView {
        (**self).target()
    }

    fn planner(&self) -> PlannerView {
        (**self).planner()
    }
}
