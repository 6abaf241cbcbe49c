use crate::ports::ArmKinematics;
use proact_types::{
    Command, Gesture, HandView, JointVector, MethodEvent, ModeView, ObjectId, PlanGoal, PlanReply,
    PlanStatus, PlannerView, Point, Pose, SimTime, Stop, Target, TargetView, Trajectory,
};
use serde::{Deserialize, Serialize};

/// What a method sees at one control step.
#[derive(Clone, Debug)]
pub struct ControlInput<'a> {
    /// Command in force.
    pub command: Command,
    /// The gesture that gives it, as the EMG model calls it; that of the command's name for keys.
    pub recognized_gesture: Gesture,
    /// How hard the gesture is made, 0 to 1; one for keys.
    pub effort: f64,
    /// Drive of each degree of freedom of [`Simultaneous::drives`](crate::Simultaneous), in their order, -1 to 1; empty
    /// without that setting, all zero while the EMG is not to be trusted.
    pub drives: &'a [f64],
    /// The gesture that the EMG stage published in this tick; none between its messages.
    pub published_command: Option<Command>,
    /// Angles of the arm joints as measured, rad.
    pub measured: &'a [f64],
    /// Angles of the arm joints as asked of the position control, rad.
    pub commanded: &'a [f64],
    /// Object with the highest posterior; none when none is in question.
    pub highlight: Option<ObjectId>,
    /// Centres of the objects in `world`, in the order of the scene.
    pub objects: &'a [Point],
    /// Posterior over objects, for the display; empty without inference.
    pub posterior: &'a [f64],
    /// Where the gaze would put an object down, on the table top, in `world`.
    pub place_point: Point,
    /// The hand, from its joints and from contact.
    pub hand: HandView,
    /// `world_from_base`.
    pub world_from_base: Pose,
    /// A plan that takes effect now.
    pub plan: Option<&'a PlanReply>,
    /// What the trajectory controller does.
    pub motion: MotionState,
    /// What the joints and digits feel.
    pub joint_states: &'a JointStates,
    /// Where objects should go; a place may snap to them.
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

/// What the joints and digits feel.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct JointStates {
    /// Measured angles of arm, then hand joints, rad.
    pub position: JointVector,
    /// Their speeds, rad/s.
    pub velocity: JointVector,
    /// Their motors' torques, N m.
    pub effort: JointVector,
    /// The force of each digit on what it touches, N, digits in the order of their first links.
    pub digit_forces: JointVector,
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
    /// For single fingers, in the place of a pose of the hand; `hand` then only says whether they open or close, which decides
    /// when an object is taken and let go.
    pub fingers: Option<FingerCommand>,
    /// For the planner.
    pub plan: Option<PlanCommand>,
    /// What happened to the method.
    pub events: Vec<MethodEvent>,
    /// What is to be seen of it until the next step.
    #[serde(rename = "shown")]
    pub display: MethodDisplay,
    /// Why a method in another process gave nothing in this step; none of a method in Rust.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fault: Option<MethodFault>,
}

/// Why a method in another process gave nothing in a step.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MethodFault {
    /// It has not answered in time. The arm holds in this step, and stops if that goes on.
    #[serde(rename = "missed")]
    TimedOut(String),
    /// It has ended, or its answer cannot be used. The arm stops.
    Failed(String),
}

/// What is to be seen of a method. It moves nothing.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct MethodDisplay {
    /// What the movement gestures move, for methods that cycle through joints or axes.
    pub mode: Option<ModeView>,
    /// The selection marker.
    pub target: TargetView,
    /// What the planner does, or why nothing moves.
    pub planner: PlannerView,
}

impl Default for MethodDisplay {
    fn default() -> Self {
        Self { mode: None, target: TargetView::default(), planner: PlannerView::Idle }
    }
}

/// A command for the arm.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MotionCommand {
    /// Stop and hold, from this tick on. A joint that something keeps from its target is held where it is after 50 ms, so
    /// that it presses no more. Speeds of zero of a method in Rust, said again at each control step, go on pressing; those of a method in
    /// another process, and its goals at the measured angles, are a hold.
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

/// A command for single fingers. It stands until another one, or one for the hand as a whole, comes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FingerCommand {
    /// Stay where they are asked to be.
    Hold,
    /// Go to these angles of the hand joints, rad, each at the hand's speed at most. On a block that is held, fingers that close
    /// stay where they took it.
    Goto(JointVector),
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
pub(crate) fn refusal_view(reason: &str) -> PlannerView {
    PlannerView::Failed { status: PlanStatus::Invalid, reason: reason.to_owned() }
}

/// A control method: a pure state machine that runs at 100 Hz and at each tick with a new gesture or plan.
///
/// Deterministic: the same inputs at the same times give the same outputs.
pub trait ControlMethod: Send {
    /// Advances to `now`. `kinematics` is that of the arm, base to tip. Whoever wraps a method changes what it gave.
    fn step(
        &mut self,
        now: SimTime,
        input: &ControlInput<'_>,
        kinematics: &mut dyn ArmKinematics,
    ) -> ControlOutput;
}

impl<M: ControlMethod + ?Sized> ControlMethod for Box<M> {
    fn step(
        &mut self,
        now: SimTime,
        input: &ControlInput<'_>,
        kinematics: &mut dyn ArmKinematics,
    ) -> ControlOutput {
        (**self).step(now, input, kinematics)
    }
}
