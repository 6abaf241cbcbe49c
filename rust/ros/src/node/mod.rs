//! Nodes on a ROS graph: rosrust's callbacks hand jobs to one loop that owns the stage.

mod actions;
mod at_once;
mod convert;
mod emg;
mod faults;
mod graph;
mod intent;
mod master;
mod meter;
mod method;
mod outlets;
mod participant;
mod plan_request;
pub mod relay;
mod sim;
mod stage;
mod testbed;

pub use emg::run_emg;
pub use faults::Faults;
pub use graph::{Graph, NodeError};
pub use intent::{IntentView, run_intent};
pub use meter::{Measured, run_meter};
pub use method::{MethodParts, MethodView, run_method};
pub use participant::{Person, run_participant};
pub use sim::run_sim;
pub use testbed::run_testbed;

/// Seconds on the graph's clock at the start of a trial. ROS time must be above zero to count as set, and tools
/// subtract durations from it (tf buffers 10 s), so it starts well above.
pub const EPOCH_SECS: u32 = 1000;

/// What a node that stands still after a restart of the master says.
const PAUSED_AFTER_RESTART: &str = "the master was restarted: paused until /gazebo/unpause_physics is called";
