//! ROS 1 bags, format 2.0: the file, the messages, and the trial as topics. What is in a message is
//! [`proact_messages`]'s matter: a bag carries definitions, and is written and read by them.
//!
//! Writer and reader are our own. Of the published crates, `rosbag` (0.6) reads only, and panics on a bag that is cut
//! off, as that of every killed recorder is; it is one of two independent readers in the writer's tests, Debian's
//! python3-rosbag being the other. `apex-io` (0.4) writes, but is a pose-graph library whose bags are a by-product.

pub mod messages;
mod reader;
mod records;
mod state_messages;
pub mod trial_bag;
mod writer;

pub use messages::RosMessage;
pub use proact_messages::{Duration, Time};
pub use reader::{BagEnd, BagMessage, read_bag, read_bag_by_time};
pub use trial_bag::{BAG_EPOCH_SECS, TrialBag};
pub use writer::BagWriter;
