//! Nodes on a ROS graph: rosrust's callbacks hand jobs to one loop that owns the stage.

mod arm_actions;
mod at_once;
mod convert;
mod digest;
mod emg;
mod faults;
mod gaze_topics;
mod graph;
mod intent;
mod judge;
mod master;
mod meter;
mod method;
mod outlets;
mod participant;
mod plan_request;
mod pose_source;
pub mod relay;
mod sim;
mod stage;
mod task;
mod testbed;
mod wire;

pub use emg::{WaitForSamples, run_emg};
pub use faults::Faults;
pub use graph::{NodeError, RosGraph};
pub use intent::{IntentParts, run_intent};
pub use meter::{Measured, run_meter};
pub use method::{MethodParts, run_method};
pub use participant::{ParticipantParts, run_participant};
pub use pose_source::{TakesPoses, follow_pose_topic, follow_tf};
pub use sim::{PlantFactory, SimParts, run_sim};
pub use task::{TaskParts, run_task};
pub use testbed::run_testbed;
pub use wire::{Counts, MethodShown};

/// Seconds on the graph's clock at the start of a trial. ROS time must be above zero to count as set, and tools
/// subtract durations from it (tf buffers 10 s), so it starts well above.
pub const EPOCH_SECS: u32 = 1000;

/// What a node that stands still after a restart of the master says.
const PAUSED_AFTER_RESTART: &str = "the master was restarted: paused until /gazebo/unpause_physics is called";

/// True if an event says that an object was taken or let go.
fn is_grasp(kind: &proact_types::EventKind) -> bool {
    use proact_types::EventKind::{ObjectAttached, ObjectReleased};
    matches!(kind, ObjectAttached { .. } | ObjectReleased { .. })
}
