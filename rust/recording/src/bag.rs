//! ROS 1 bags, format 2.0: the file, the messages, and the trial as topics. What is in a message is
//! [`proact_messages`]'s matter: a bag carries definitions, and is written and read by them.
//!
//! The writer is our own. Of the published crates, `rosbag` (0.6) only reads; it is our reader, and for the tests of
//! the writer one of two independent ones, Debian's python3-rosbag being the other. `apex-io` (0.4) writes, but is a pose-graph
//! library whose bags are a by-product, and neither its messages nor its compression are needed here.

pub mod messages;
mod reader;
pub mod trial_bag;
mod writer;

pub use messages::Message;
pub use proact_messages::{Duration, Time};
pub use reader::{BagMessage, read_bag};
pub use trial_bag::{BAG_EPOCH_SECS, TrialBag};
pub use writer::BagWriter;
