//! Nodes on a ROS graph: rosrust's callbacks hand jobs to one loop that owns the stage.

mod actions;
mod convert;
mod faults;
mod graph;
mod master;
mod outlets;
mod sim;
mod testbed;

pub use faults::Faults;
pub use graph::{Graph, NodeError};
pub use sim::run_sim;
pub use testbed::run_testbed;

/// Seconds on the graph's clock at the start of a trial. ROS time must be above zero to count as set, and tools
/// subtract durations from it (tf buffers 10 s), so it starts well above.
pub const EPOCH_SECS: u32 = 1000;
