//! ROS 1 bags, format 2.0: the file, the messages, and the trial as topics.
//!
//! The writer is our own. Of the published crates, `rosbag` (0.6) only reads; the tests use it as one of two
//! independent readers, Debian's python3-rosbag being the other. `apex-io` (0.4) writes, but is a pose-graph
//! library whose bags are a by-product, and neither its messages nor its compression are needed here.

pub mod message;
pub mod messages;
pub mod trial_bag;
mod writer;

pub use trial_bag::{BAG_EPOCH_SECS, TrialBag};
pub use writer::BagWriter;
