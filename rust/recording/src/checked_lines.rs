//! Text files of one JSON value a line: `events.jsonl` plain, `digests.log` with a checksum before each value.
//!
//! A damaged digest must not pass for a trial that diverged, hence the checksum: eight hexadecimal digits of
//! the CRC-32 of the JSON text, a blank, the JSON text.

use crate::{
    RecordingError,
    files::{self, MAX_LOG_BYTES},
};
use serde::{Serialize, de::DeserializeOwned};
use std::{
    fs::File,
    io::{BufWriter, Write},
    path::{Path, PathBuf},
};

/// Appends JSON values to a file, one a line.
#[derive(Debug)]
pub(crate) struct LineWriter {
    file: BufWriter<File>,
    path: PathBuf,
    has_checksums: bool,
    lines: u64,
}

impl LineWriter {
    pub(crate) fn new(file: File, path: &Path, checked: bool) -> Self {
        LineWriter { file: BufWriter::new(file), path: path.to_owned(), has_checksums: checked, lines: 0 }
    }

    pub(crate) fn write<T: Serialize>(&mut self, value: &T) -> Result<(), RecordingError> {
        let json = serde_json::to_string(value).map_err(RecordingError::encode("a line of a log"))?;
        let written = if self.has_checksums {
            writeln!(self.file, "{:08x} {json}", crc32fast::hash(json.as_bytes()))
        } else {
            writeln!(self.file, "{json}")
        };
        written.map_err(RecordingError::io("write to", &self.path))?;
        self.lines += 1;
        Ok(())
    }

    /// Lines written so far.
    pub(crate) fn lines(&self) -> u64 {
        self.lines
    }

    pub(crate) fn file(&self) -> Result<File, RecordingError> {
        self.file.get_ref().try_clone().map_err(RecordingError::io("open once more", &self.path))
    }

    pub(crate) fn flush(&mut self) -> Result<(), RecordingError> {
        self.file.flush().map_err(RecordingError::io("write to", &self.path))
    }

    pub(crate) fn finish(mut self) -> Result<(), RecordingError> {
        self.flush()?;
        self.file.get_ref().sync_all().map_err(RecordingError::io("write to", &self.path))
    }
}

/// The good lines at the start of a file.
pub(crate) struct ValidLines<T> {
    pub values: Vec<T>,
    /// Byte at which each starts.
    pub offsets: Vec<u64>,
    /// Why it goes no further; none at the end of the file.
    pub error: Option<RecordingError>,
}

impl<T> ValidLines<T> {
    /// The first `count` of them.
    pub(crate) fn take_first(mut self, count: usize) -> Result<Vec<T>, RecordingError> {
        match self.error {
            Some(error) if self.values.len() < count => Err(error),
            _ => {
                self.values.truncate(count);
                Ok(self.values)
            }
        }
    }
}

/// Reads such a file whole. These files are small: a five-minute trial has 3,000 digests.
pub(crate) fn read_lines<T: DeserializeOwned>(
    path: &Path,
    checked: bool,
) -> Result<ValidLines<T>, RecordingError> {
    let bytes = files::read(path, MAX_LOG_BYTES).map_err(RecordingError::io("read", path))?;
    let mut lines = ValidLines { values: Vec::new(), offsets: Vec::new(), error: None };
    let mut offset = 0;
    for line in bytes.split_inclusive(|b| *b == b'\n') {
        let Some((b'\n', text)) = line.split_last() else {
            let records = lines.values.len() as u64;
            lines.error = Some(RecordingError::Truncated { file: path.to_owned(), offset, records });
            break;
        };
        match parse(text, checked) {
            Ok(value) => lines.values.push(value),
            Err(fault) => {
                let line = lines.values.len() + 1;
                lines.error = Some(match fault {
                    LineReadError::Checksum(reason) => {
                        RecordingError::Damaged { file: path.to_owned(), offset, reason }
                    }
                    LineReadError::Json(error) => RecordingError::json(path, line, offset, &error),
                });
                break;
            }
        }
        lines.offsets.push(offset);
        offset += line.len() as u64;
    }
    Ok(lines)
}

/// Why a line cannot be read.
enum LineReadError {
    Checksum(String),
    Json(serde_json::Error),
}

fn parse<T: DeserializeOwned>(text: &[u8], checked: bool) -> Result<T, LineReadError> {
    let json = if checked { check(text).map_err(LineReadError::Checksum)? } else { text };
    serde_json::from_slice(json).map_err(LineReadError::Json)
}

/// The JSON text behind a matching checksum.
fn check(text: &[u8]) -> Result<&[u8], String> {
    let (sum, json) = text.split_at_checked(9).ok_or("the line is too short for a checksum")?;
    let expected = format!("{:08x} ", crc32fast::hash(json));
    if sum != expected.as_bytes() {
        return Err(format!(
            "its checksum is {}, the line says {}",
            expected.trim_end(),
            String::from_utf8_lossy(sum).trim_end()
        ));
    }
    Ok(json)
}
