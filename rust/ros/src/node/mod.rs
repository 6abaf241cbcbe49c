//! Nodes on a ROS graph: rosrust's callbacks hand jobs to one loop that owns the stage.

mod arm_actions;
mod control_interface;
mod convert;
mod digest;
mod emg;
mod gaze_topics;
mod graph;
mod intent;
mod latency_meter;
mod master;
mod method;
mod node_diagnostics;
mod participant;
mod plan_request;
mod pose_source;
mod publishers;
mod reconnect;
pub mod relay;
mod rosout;
mod sim;
mod stage;
mod task;
mod task_outputs;
mod tcp_nodelay;
mod testbed;
mod type_mismatch;
mod wire;

pub use emg::{WaitForSamples, run_emg};
pub use graph::{NodeError, RosGraph};
pub use intent::{IntentParts, run_intent};
pub use latency_meter::{NodeLatencies, run_meter};
pub use method::{MethodParts, run_method};
pub use node_diagnostics::NodeDiagnostics;
pub use participant::{ParticipantParts, run_participant};
pub use pose_source::{PoseSink, follow_pose_topic, follow_tf};
pub use sim::{PlantFactory, SimParts, run_sim};
pub use task::{TaskParts, run_task};
pub use testbed::run_testbed;
pub use wire::{ExpectedCounts, MethodStatus};

/// Seconds on the graph's clock at the start of a trial. ROS time must be above zero to count as set, and tools
/// subtract durations from it (tf buffers 10 s), so it starts well above.
pub const EPOCH_SECS: u32 = 1000;

/// What a node that stands still after a restart of the master says.
const PAUSED_AFTER_RESTART: &str = "the master was restarted: paused until /gazebo/unpause_physics is called";

/// True if an event says that an object was taken or let go.
fn is_grasp_event(kind: &proact_types::EventKind) -> bool {
    use proact_types::EventKind::{ObjectAttached, ObjectReleased};
    matches!(kind, ObjectAttached { .. } | ObjectReleased { .. })
}
