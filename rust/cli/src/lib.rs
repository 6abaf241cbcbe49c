//! The `proact` command: arguments, texts and exit codes.
// They panic where the output is closed or full.
#![deny(clippy::print_stdout, clippy::print_stderr)]
#![allow(clippy::disallowed_methods)] // The command has the clock, the threads and the files that stages lack.
#![cfg_attr(test, allow(clippy::unwrap_used))]

mod access_args;
mod analyze;
mod announce;
mod batch_args;
mod command;
mod compare;
mod consent;
mod demo;
mod doctor;
mod emg;
mod export;
mod interrupt;
mod localize;
mod method_files;
mod model;
mod model_size;
mod node;
mod participants;
mod progress;
mod reference;
mod renames;
mod replay;
mod replay_page;
mod rosbridge_args;
mod serve;
mod served_page;
mod shell;
mod simulate;
mod study;
mod trial_args;
mod update_digests;
mod user_device_args;

pub use command::{run, run_with_commit};
