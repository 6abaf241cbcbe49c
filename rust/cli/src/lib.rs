//! The `proact` command, as a library so that tests can run trials in their own process.
//!
//! This is the one place that knows every part: it chooses the libraries, opens files and pages, and keeps real
//! time. What a trial *is* lives in `proact-testbed`.
#![allow(clippy::disallowed_methods)] // The command has the clock, the threads and the files that stages lack.
#![cfg_attr(test, allow(clippy::unwrap_used))]

pub mod analyze;
pub mod bench;
mod bench_bridge;
mod bench_chain;
pub mod bench_dynamics;
mod bench_emg;
mod bench_planning;
#[cfg(feature = "ros")]
mod bench_ros;
pub mod bench_safety;
mod bench_start;
mod command;
mod demo;
pub mod digests;
mod doctor;
mod emg;
mod experimenter;
mod limb;
mod method_process;
mod model;
mod node;
mod pace;
mod person;
pub mod query;
mod record;
mod replay;
mod replay_bag;
mod replay_page;
#[cfg(feature = "ros")]
mod ros_bus;
mod rosbridge;
mod serve;
pub mod trial;
mod trial_args;

pub use command::main;
pub use record::{Recorder, RecorderError};
pub use replay::{Replayed, replay_trial};
