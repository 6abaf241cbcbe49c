//! The `proact` command: arguments, texts and exit codes.
// They panic where the output is closed or full.
#![deny(clippy::print_stdout, clippy::print_stderr)]
#![allow(clippy::disallowed_methods)] // The command has the clock, the threads and the files that stages lack.
#![cfg_attr(test, allow(clippy::unwrap_used))]

mod access_args;
mod analyze;
mod announce;
mod batch_args;
mod bless;
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
mod person_args;
mod progress;
mod reference;
mod replay;
mod replay_page;
mod rosbridge_args;
mod serve;
mod served_page;
mod shell;
mod simulate;
mod study;
mod trial_args;

pub use command::{run, run_built_from};
