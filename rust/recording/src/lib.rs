//! Trials on disk, written and read back.
//!
//! A trial directory holds
//!
//! | file | content |
//! |---|---|
//! | `config.toml` | the whole configuration |
//! | such as `classifier.json`, `arm.urdf` | what else the trial began with |
//! | `inputs.log` | format of the record, seed, versions, source commit, place in a study, and all that entered from outside, tick by tick: with the configuration it *is* the trial |
//! | `digests.log` | the digest chain, one entry per span of ticks, with the number of inputs and events that it covers |
//! | `events.jsonl` | what happened, one JSON object a line |
//! | `trial.bag` | the same trial as a ROS 1 bag |
//! | `result.json` | the result |
//! | `SHA256SUMS` | a hash of each file, written last: without it the trial was interrupted |
//!
//! A record has one format number ([`RECORD_FORMAT`]) for all its files. A record of another format is refused with the
//! program that replays it.
//!
//! The [`journal`] of a study is one SQLite file beside its trials.
//!
//! This crate writes and reads files. It has no clock, no threads and no randomness: equal trials give equal
//! files, byte for byte.
//!
//! ```
//! use proact_recording::{InputLog, TrialHeader, TrialWriter, read_result};
//! use proact_types::{Command, SimTime, TickInput};
//! # let place = tempfile::tempdir()?;
//! # let dir = place.path().join("trial");
//! let header = TrialHeader { config_toml: "method = \"D\"\n".into(), seed: 7, ..Default::default() };
//! let mut trial = TrialWriter::create(&dir, &header)?;
//! let keys = TickInput { command: Some(Command::WristFlexion), ..Default::default() };
//! trial.write_input(SimTime(1), &keys)?;
//! trial.write_input(SimTime(2), &TickInput::default())?;
//! trial.write_digest(&serde_json::json!({"tick": 2, "hash": "9f86d081"}))?;
//! trial.finish(SimTime(2), &serde_json::json!({"on_target": 4}))?;
//!
//! let record = InputLog::open(&dir)?.next().expect("one tick had input")?;
//! assert_eq!((record.tick, record.input), (SimTime(1), keys));
//! assert_eq!(read_result::<serde_json::Value>(&dir)?["on_target"], 4);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
// Files are this crate's purpose.
#![allow(clippy::disallowed_methods)]
#![cfg_attr(test, allow(clippy::unwrap_used))]

pub mod bag;
mod checked_lines;
mod error;
mod file_lock;
mod files;
mod format;
mod input_log;
pub mod journal;
mod manifest;
mod trial;
mod trial_writer;
pub mod xdf;

pub use bag::TrialBag;
pub use error::RecordingError;
pub use file_lock::FileLock;
pub use format::RECORD_FORMAT;
pub use input_log::{InputLog, InputRecord, LogEnd};
pub use manifest::{HASH_MISMATCH_TEXT, sha256, sha256_of_bytes, verify_manifest, write_manifest};
pub use trial::{TrialRecord, check_lines, read_result};
pub use trial_writer::{FLUSH_TICKS, StudyTrialId, TrialHeader, TrialWriter};

/// Source commit of a program that was built without one, or of a record from before commits were written.
pub const UNKNOWN_COMMIT: &str = "unknown";

/// Name of the configuration in a trial directory.
pub const CONFIG_FILE: &str = "config.toml";
/// Name of the input log.
pub const INPUTS_FILE: &str = "inputs.log";
/// Name of the digest chain.
pub const DIGESTS_FILE: &str = "digests.log";
/// Name of the events.
pub const EVENTS_FILE: &str = "events.jsonl";
/// Name of the bag.
pub const BAG_FILE: &str = "trial.bag";
/// Name of the result.
pub const RESULT_FILE: &str = "result.json";
/// Name of the manifest.
pub const MANIFEST_FILE: &str = "SHA256SUMS";
