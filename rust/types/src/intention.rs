use crate::{Command, JointVector, Vector};
use serde::{Deserialize, Serialize};

/// What a participant does with the body from one moment to the next. It is all a simulated one may output.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Intention {
    /// The gesture that the hand makes.
    pub gesture: Command,
    /// Where the eye points, in `world`: a unit vector from the eye.
    pub gaze_direction: Vector,
    /// False during blinks.
    pub eyes_open: bool,
    /// Where the trunk is asked to go; the body model moves it there within its speed.
    pub trunk: TrunkPosture,
    /// Where the person's own limb is asked to go, in the joints of the arm, rad; none where the whole arm is lost.
    pub limb: Option<JointVector>,
}

/// Posture of the trunk about the hip pivot, radians; all zero is upright.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TrunkPosture {
    /// Lean forward (positive) about the left-right axis.
    pub forward: f64,
    /// Lean sideways to the right (positive).
    pub lateral: f64,
    /// Turn to the left (positive) about the trunk's long axis.
    pub axial: f64,
}
