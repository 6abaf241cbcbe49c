//! Log lines of a node: on the terminal and on `/rosout`.
//!
//! rosrust writes the terminal's line. Its own publisher of `/rosout` would let one stopped subscriber of `/rosout` take the log
//! from all others.

use crate::publishing::{self, Publisher};
use rosrust::{error::Result, msg::rosgraph_msgs::Log};
use std::sync::OnceLock;

pub(super) const TOPIC: &str = "/rosout";
/// As rosrust's own publisher has it.
const QUEUE: usize = 100;

static PUBLISHER: OnceLock<Publisher<Log>> = OnceLock::new();

/// Sets the publisher up.
///
/// # Errors
/// Those of [`Publisher::new`].
pub(super) fn open() -> Result<()> {
    let publisher = Publisher::new(TOPIC, QUEUE, false)?;
    // A process has one node.
    let _ = PUBLISHER.set(publisher);
    Ok(())
}

/// Logs a warning. Before [`open_connections`], rosrust's own publisher has it.
#[track_caller]
pub(super) fn warn(text: &str) {
    let location = std::panic::Location::caller();
    rosrust::log(Log::WARN, text.to_owned(), location.file(), location.line());
    let Some(publisher) = PUBLISHER.get() else { return };
    // It can be encoded.
    let _ = publisher.send(Log {
        level: Log::WARN,
        name: rosrust::name(),
        msg: text.to_owned(),
        file: location.file().to_owned(),
        line: location.line(),
        topics: publishing::topics(),
        ..Log::default()
    });
}
