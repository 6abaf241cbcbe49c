//! ROS 1: nodes under the original's names, over the testbed and its stages.
//!
//! Two halves. The modules below are plain state machines (action goals, trajectories, controllers, the simulator,
//! frames) that know no ROS, build everywhere and are tested without a master. Behind the feature `rosrust` stand
//! the nodes: thin loops that turn messages into calls and back. They need message definitions when they are
//! compiled; `docs/ros1.md` says which, and how they are found.
//!
//! Physics, planner and kinematics come in through the testbed's ports; the command `proact node` puts them
//! together. The nodes read the real clock and have threads (rosrust's callbacks), but one loop owns each stage and
//! does everything in whole ticks.
//!
//! ```
//! use proact_ros::action::{GoalAdmission, GoalId, GoalList};
//! use proact_types::SimTime;
//! let mut goals = GoalList::default();
//! let first = GoalId { id: "client-1".into(), stamp_ns: 7 };
//! assert_eq!(goals.admit(first, SimTime(0)), GoalAdmission::Begin { preempted: None });
//! ```
// Nodes live by the real clock and read their environment.
// They panic where the output is closed or full.
#![deny(clippy::print_stdout, clippy::print_stderr)]
#![allow(clippy::disallowed_methods)]
#![cfg_attr(test, allow(clippy::unwrap_used))]

pub mod action;
pub mod clock;
pub mod compat;
pub mod controllers;
pub mod frames;
pub mod gaze_pairs;
pub mod gaze_topic_monitor;
pub mod gazebo;
pub mod heartbeat;
pub mod joy;
pub mod tf_body;
pub mod trajectory;

#[cfg(feature = "rosrust")]
pub mod messages;
#[cfg(feature = "rosrust")]
pub mod node;
#[cfg(feature = "rosrust")]
mod publishing;
