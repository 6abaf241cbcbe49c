use crate::MANIFEST_FILE;
use proact_types::SimTime;
use std::{io, path::Path, path::PathBuf};

/// Why a recording could not be written or read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RecordingError {
    /// The operating system refused.
    #[error("cannot {action} {}: {source}", path.display())]
    Io {
        /// Such as `create the trial directory`.
        action: &'static str,
        /// The file or directory.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// Nothing is ever overwritten.
    #[error(
        "the output directory {} is not empty; expected a new or an empty one: choose another name or remove it",
        dir.display()
    )]
    OutputExists {
        /// The directory asked for.
        dir: PathBuf,
    },
    /// The directory lacks what every trial has.
    #[error("{} is not a trial directory: it has no {missing}", dir.display())]
    NotATrial {
        /// The directory.
        dir: PathBuf,
        /// The file that is not there.
        missing: &'static str,
    },
    /// The trial was broken off: its process ended before the result was written.
    #[error(
        "the trial in {} is interrupted: it has inputs but no result.json, so its process ended before the trial did",
        dir.display()
    )]
    Unfinished {
        /// The directory.
        dir: PathBuf,
    },
    /// The record was not closed: its process ended before the hashes were written, or they were removed.
    #[error("the record in {} is not closed: {MANIFEST_FILE} is missing, so that nothing tells whether it is as it was recorded", dir.display())]
    MissingManifest {
        /// The directory.
        dir: PathBuf,
    },
    /// Files are not those that were recorded.
    #[error(
        "the trial in {} is not as it was recorded: {files}; expected what was written, so take it from a copy",
        dir.display()
    )]
    Changed {
        /// The directory.
        dir: PathBuf,
        /// Which files, and how they differ.
        files: String,
    },
    /// Bytes are not those that were written.
    #[error("{} is damaged at byte {offset}: {reason}", file.display())]
    Damaged {
        /// The file.
        file: PathBuf,
        /// Byte offset of the damaged record from the start of the file.
        offset: u64,
        /// What does not fit.
        reason: String,
    },
    /// A line of JSON has a key, a kind or a value that this program does not know, or lacks a key.
    #[error(
        "{}, line {line}: {reason}; take the file from a copy, or read it with the program that wrote it",
        file.display()
    )]
    UnknownKey {
        /// The file.
        file: PathBuf,
        /// Its line, from 1.
        line: usize,
        /// Which key or value, and what is expected.
        reason: String,
    },
    /// The file ends before its end mark. All records before that are good.
    #[error(
        "{} is truncated at byte {offset}: {records} records before it are good, the end of the trial is missing",
        file.display()
    )]
    Truncated {
        /// The file.
        file: PathBuf,
        /// Byte offset at which the first incomplete record starts.
        offset: u64,
        /// Number of good records.
        records: u64,
    },
    /// A file that is no ROS bag, or a damaged one.
    #[error("{} cannot be read as a ROS bag: {reason}; expected one of format 2.0: try `rosbag info`", file.display())]
    Bag {
        /// The file.
        file: PathBuf,
        /// What the reader says.
        reason: String,
    },
    /// A record of another format than this program's.
    #[error(
        "{} is a record of format {got}, this proact ({}) replays format {expected}: {replayed_by}",
        dir.display(),
        env!("CARGO_PKG_VERSION")
    )]
    WrongFormat {
        /// The trial directory.
        dir: PathBuf,
        /// Format found.
        got: u32,
        /// Format of this program.
        expected: u32,
        /// Which program replays it, as a sentence.
        replayed_by: String,
    },
    /// Ticks are written once each, in ascending order.
    #[error("input of tick {} comes after tick {}; expected a later one", got.0, last.0)]
    OutOfOrder {
        /// Tick handed in.
        got: SimTime,
        /// Tick written last.
        last: SimTime,
    },
    /// A vector has another length than its names.
    #[error("{what}: got {got} values, expected {expected}")]
    WrongLength {
        /// What was handed in.
        what: &'static str,
        /// Values handed in.
        got: usize,
        /// Values expected.
        expected: usize,
    },
    /// A value is NaN or infinite.
    #[error("{what} has the value {value} at {} s, expected finite numbers", time.as_secs())]
    NotFinite {
        /// What was handed in.
        what: &'static str,
        /// The first such value.
        value: f64,
        /// When.
        time: SimTime,
    },
    /// A topic carries one type of message.
    #[error("topic {topic} carries {expected}, got a message of type {got}")]
    WrongType {
        /// The topic.
        topic: String,
        /// Type handed in.
        got: &'static str,
        /// Type of the messages before.
        expected: String,
    },
    /// A value cannot be written in its format.
    #[error("cannot encode {what}: {reason}")]
    Encode {
        /// Such as `the result`.
        what: &'static str,
        /// Why.
        reason: String,
    },
}

impl RecordingError {
    /// For `map_err`: an I/O error with what was being done to which file.
    pub(crate) fn io(action: &'static str, path: &Path) -> impl FnOnce(io::Error) -> Self {
        let path = path.to_owned();
        move |source| RecordingError::Io { action, path, source }
    }

    /// For what is not the expected value in `line`, from 1, of a file of JSON: its keys where the text is JSON, else the byte `offset`.
    pub(crate) fn json(file: &Path, line: usize, offset: u64, error: &serde_json::Error) -> Self {
        let text = error.to_string();
        let location = format!(" at line {} column {}", error.line(), error.column());
        let reason = text
            .strip_suffix(location.as_str())
            .unwrap_or(&text)
            .replace("unknown field `", "unknown key `")
            .replace("unknown variant `", "unknown value `")
            .replace("missing field `", "missing key `");
        let file = file.to_owned();
        match error.is_data() {
            true => RecordingError::UnknownKey { file, line, reason },
            false => RecordingError::Damaged { file, offset, reason },
        }
    }

    /// For `map_err`: a serialisation error.
    pub(crate) fn encode<E: std::fmt::Display>(what: &'static str) -> impl FnOnce(E) -> Self {
        move |error| RecordingError::Encode { what, reason: error.to_string() }
    }
}
