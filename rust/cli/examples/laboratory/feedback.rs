//! A feedback device: here a file with a line for each cue, which a person could read. A motor's driver would go in the
//! place of the file.

use proact_devices::{DeviceError, FeedbackSink, SinkScheme};
use proact_types::FeedbackCue;
use std::{fs::File, io::Write};

/// How it is named on the command line, and opened.
pub const LOG: SinkScheme = SinkScheme {
    scheme: "log:",
    address: "PATH",
    help: "our own: a line for each cue",
    open: |path| {
        let file = File::create(path).map_err(|error| unusable(path, &error))?;
        Ok(Box::new(Log { file, path: path.to_owned() }))
    },
};

struct Log {
    file: File,
    path: String,
}

fn unusable(path: &str, error: &std::io::Error) -> DeviceError {
    DeviceError::Sink { sink: format!("log:{path}"), reason: error.to_string() }
}

impl FeedbackSink for Log {
    // It runs in a thread of its own: it may wait as long as its device does.
    fn begin(&mut self, cue: &FeedbackCue) -> Result<(), DeviceError> {
        let felt = cue.vibration.map_or(0.0, |vibration| vibration.strength);
        let digit = cue.digit.as_ref().map_or("all", |digit| digit.link.as_str());
        writeln!(self.file, "{} ms: {:?}, {digit}, strength {felt:.2}", cue.time.0, cue.cue)
            .map_err(|error| unusable(&self.path, &error))
    }
}
