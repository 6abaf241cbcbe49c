//! Lab streaming layer, with the feature `lsl`: streams of other programs in, ours out.
//!
//! Its streams have time stamps and no sample counters; [`LslSource`] makes one of the other, [`LslOutlet`] the other of
//! the one. liblsl comes with the crate `lsl` and is built from source.

mod numbering;
mod outlet;
mod source;

pub use outlet::LslOutlet;
pub use source::LslSource;

use crate::DeviceError;

/// The type by which EMG streams are found.
const EMG_TYPE: &str = "EMG";

fn failed(stream: &str, reason: impl ToString) -> DeviceError {
    DeviceError::Lsl { stream: stream.to_owned(), reason: reason.to_string() }
}

/// Names go into the queries that find streams.
fn check_name(name: &str) -> Result<(), DeviceError> {
    if name.is_empty() || name.contains(['\'', '"']) || name.chars().any(char::is_control) {
        return Err(failed(name, "a name is not empty and has no quotation marks"));
    }
    Ok(())
}
