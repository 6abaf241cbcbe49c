//! Lab streaming layer, with the feature `lsl`: streams of other programs in, ours out.
//!
//! Its streams have time stamps and no sample counters; [`LslSource`] makes one of the other, [`LslOutlet`] the other of
//! the one. liblsl comes with the crate `lsl` and is built from source.

mod capture;
mod gaze;
mod markers;
mod numbering;
mod outlet;
mod reader;
mod source;

pub use capture::LslCapture;
pub use gaze::LslGaze;
pub use markers::LslMarkers;
pub use outlet::LslOutlet;
pub use source::LslSource;

use crate::DeviceError;
use lsl::{StreamInfo, StreamInlet};

/// The type by which EMG streams are found.
const EMG_TYPE: &str = "EMG";
/// How long all streams of a name have to answer, so that a second one is noticed.
const RESOLVE_ALL_SECS: f64 = 1.0;
/// How long the first one has, after that.
const RESOLVE_FIRST_SECS: f64 = 4.0;
/// How long the stream has to open.
const OPEN_TIMEOUT_SECS: f64 = 5.0;
/// Seconds of samples that liblsl keeps for a reader that is late.
const BUFFER_SECS: i32 = 5;

fn lsl_error(stream: &str, reason: impl ToString) -> DeviceError {
    DeviceError::Lsl { stream: stream.to_owned(), reason: reason.to_string() }
}

/// Names go into the queries that find streams.
fn check_name(name: &str) -> Result<(), DeviceError> {
    if name.is_empty() || name.contains(['\'', '"']) || name.chars().any(char::is_control) {
        return Err(lsl_error(name, "a name is not empty and has no quotation marks"));
    }
    Ok(())
}

/// The only stream whose `property` is `label`.
fn resolve_stream(property: &str, label: &str) -> Result<StreamInfo, DeviceError> {
    let resolve = |min_count, secs| {
        lsl::resolve_byprop(property, label, min_count, secs).map_err(|error| lsl_error(label, error))
    };
    let mut found = resolve(2, RESOLVE_ALL_SECS)?;
    if found.is_empty() {
        found = resolve(1, RESOLVE_FIRST_SECS)?;
    }
    if found.len() > 1 {
        let name = |s: &StreamInfo| format!("{:?} on {}", s.stream_name(), s.hostname());
        let names: Vec<String> = found.iter().map(name).collect();
        let names = names.join(", ");
        return Err(lsl_error(
            label,
            format!("several streams of this {property}, expected one: {names}; name one"),
        ));
    }
    found.pop().ok_or_else(|| {
        let secs = RESOLVE_ALL_SECS + RESOLVE_FIRST_SECS;
        lsl_error(
            label,
            format!(
                "no stream of this {property} answered within {secs} s; is its program running, and does a \
                 firewall let UDP 16571 and TCP 16572 to 16604 through?"
            ),
        )
    })
}

fn subscribe(stream: &StreamInfo, label: &str) -> Result<StreamInlet, DeviceError> {
    let inlet = StreamInlet::new(stream, BUFFER_SECS, 0, true).map_err(|error| lsl_error(label, error))?;
    inlet
        .open_stream(OPEN_TIMEOUT_SECS)
        .map_err(|error| lsl_error(label, format!("cannot be opened: {error}")))?;
    Ok(inlet)
}
