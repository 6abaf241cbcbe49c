//! Control methods: from gestures, gaze and task state to commands for the arm.
//!
//! Pure: no clock, no files, no threads, no C++. What a method needs from a library it asks for: kinematics
//! through [`ports`], plans by a [`PlanCommand`] whose answer comes back in a later [`ControlInput`].

mod blend;
mod build;
mod dead_man;
pub mod doubles;
mod end_effector_jog;
mod error;
mod gaze_assisted;
mod gaze_toggled;
mod guide;
mod hand;
mod imitation;
mod inverse;
mod jog;
mod jog_profile;
mod joint_jog;
mod limited;
mod method;
mod pipe;
pub mod ports;
mod profile;
mod registry;
mod simultaneous;
mod subset;
mod synergy;
mod watch;

pub use blend::Blend;
pub use build::build;
pub use dead_man::DeadMan;
pub use end_effector_jog::EndEffectorJog;
pub use error::ControlError;
pub use gaze_assisted::GazeAssisted;
pub use gaze_toggled::GazeToggled;
pub use guide::Guide;
pub use hand::HandTracker;
pub use imitation::Imitation;
pub use jog_profile::{JogProfile, JogSteps, ProportionalSpeed, VelocityRamp};
pub use joint_jog::JointJog;
pub use limited::Limited;
pub use method::{
    ControlInput, ControlMethod, ControlOutput, FingerCommand, HandCommand, JointStates, MethodFault,
    MotionCommand, MotionState, PlanCommand, Shown,
};
pub use pipe::{InputLine, OutputLine, PipeMethod};
pub use profile::{
    Axis, AxisEntry, AxisMotion, BlendProfile, DampedProfile, DeadManProfile, EndEffectorJogProfile,
    GazeAssistedProfile, InverseProfile, JointJogProfile, LimiterProfile, LockOnceProfile,
    MoorePenroseProfile, Profile, ToggleLocksProfile,
};
pub use registry::{MakeMethod, MethodEntry, MethodProgram, MethodRegistry, OUTSIDE};
pub use simultaneous::Simultaneous;
pub use subset::{FollowsLimb, JointSubset};
pub use synergy::{Synergy, SynergyProfile, SynergyRule};
pub use watch::{SourceWatch, UsedSources};

/// Methods run at 100 Hz; what they look ahead is one such step, seconds.
pub const STEP_SECS: f64 = 0.01;
