//! Control methods: from gestures, gaze and task state to commands for the arm.
//!
//! Pure: no clock, no files, no threads, no C++. What a method needs from a library it asks for: kinematics
//! through [`ports`], plans by a [`PlanCommand`] whose answer comes back in a later [`ControlInput`].

mod blend;
mod build;
mod command_limiter;
mod dead_man;
pub mod doubles;
mod end_effector_jog;
mod error;
mod external_method;
mod gaze_assisted;
mod gaze_toggled;
mod hand;
mod imitation;
mod inverse;
mod jog;
mod jog_profile;
mod joint_jog;
mod method;
pub mod ports;
mod profile;
mod reach_assistant;
mod registry;
mod simultaneous;
mod source_watchdog;
mod subset;
mod synergy;

pub use blend::Blend;
pub use build::build;
pub use command_limiter::CommandLimiter;
pub use dead_man::DeadManSwitch;
pub use end_effector_jog::EndEffectorJog;
pub use error::ControlError;
pub use external_method::{ExternalMethod, MethodRequest, MethodResponse};
pub use gaze_assisted::GazeAssisted;
pub use gaze_toggled::GazeToggled;
pub use hand::HandStateEstimator;
pub use imitation::Imitation;
pub use jog_profile::{JogProfile, JogSteps, ProportionalSpeed, VelocityRamp};
pub use joint_jog::JointJog;
pub use method::{
    ControlInput, ControlMethod, ControlOutput, FingerCommand, HandCommand, JointStates, MethodDisplay,
    MethodFault, MotionCommand, MotionState, PlanCommand,
};
pub use profile::{
    Axis, AxisEntry, AxisMotion, BlendProfile, DampedProfile, DeadManProfile, EndEffectorJogProfile,
    GazeAssistedProfile, InverseProfile, JointJogProfile, LimiterProfile, LockOnceProfile,
    MoorePenroseProfile, Profile, ToggleLocksProfile,
};
pub use reach_assistant::ReachAssistant;
pub use registry::{EXTERNAL_METHOD_NAME, MethodEntry, MethodFactory, MethodProgram, MethodRegistry};
pub use simultaneous::Simultaneous;
pub use source_watchdog::{SourceWatchdog, UsedSources};
pub use subset::{JointSubset, LimbFollower};
pub use synergy::{Synergy, SynergyProfile, SynergyRule};

/// Methods run at 100 Hz; what they look ahead is one such step, seconds.
pub const STEP_SECS: f64 = 0.01;
