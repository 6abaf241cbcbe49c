//! The one tick that wires the stages, the digest that makes trials comparable, and the loops that run a trial
//! with a simulated participant or from a log.
//!
//! Pure: time comes in ticks, physics and plans come through [`ports`]. `docs/` and `ARCHITECTURE.md` show the way
//! of one sample through it.

mod config;
mod config_error;
mod digest;
pub mod doubles;
mod feedback;
mod grasp;
mod grasp_failure;
mod grasp_original;
mod grasp_selector;
mod impairment;
mod motion;
mod physics;
mod pinned;
mod planner;
mod plans;
pub mod ports;
mod recorder_tap;
mod running_trial;
pub mod stages;
mod tick;
mod trial_faults;

pub use config::{Setup, TrialConfig};
pub use config_error::ConfigError;
pub use digest::{Digest, DigestField, Divergence, FieldDigest, SPAN_TICKS, SpanDigest, first_divergence};
pub use feedback::{CueEvent, FeedbackMapping};
pub use grasp::{GraspAction, GraspDetector};
pub use grasp_original::OriginalGraspRule;
pub use grasp_selector::{GraspSelector, NearObject};
pub use impairment::{ImpairedLink, LinkImpairment};
pub use motion::{ArmMotion, HandMotion, MotionConfig};
pub use physics::{
    GraspRuleName, JointControl, MassSet, OpposingGrasp, OriginalGrasp, PhysicsConfig, PhysicsEngine,
};
pub use pinned::PinnedContent;
pub use planner::{PlannerName, PlannerOptions, SearchLimits};
pub use plans::plan_request;
pub use running_trial::{LoggedPlans, RunningTrial, TrialEnd, TrialResult, TrialStep, replay};
pub use stages::{GazeFilter, PersonParts};
pub use tick::{Testbed, TestbedError, TestbedParts, TickOutput};
pub use trial_faults::{ResultFault, ResultFaultKind};
