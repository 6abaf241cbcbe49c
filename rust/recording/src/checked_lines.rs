//! Text files of one JSON value a line: `events.jsonl` plain, `digests.log` with a checksum before each value.
//!
//! A damaged digest must not pass for a trial that diverged, hence the checksum: eight hexadecimal digits of
//! the CRC-32 of the JSON text, a blank, the JSON text.

use crate::RecordingError;
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
    checked: bool,
}

impl LineWriter {
    pub(crate) fn new(file: File, path: &Path, checked: bool) -> Self {
        LineWriter { file: BufWriter::new(file), path: path.to_owned(), checked }
    }

    pub(crate) fn write<T: Serialize>(&mut self, value: &T) -> Result<(), RecordingError> {
        let json = serde_json::to_string(value).map_err(RecordingError::encode("a line of a log"))?;
        let written = if self.checked {
            writeln!(self.file, "{:08x} {json}", crc32fast::hash(json.as_bytes()))
        } else {
            writeln!(self.file, "{json}")
        };
        written.map_err(RecordingError::io("write to", &self.path))
    }

    pub(crate) fn flush(&mut self) -> Result<(), RecordingError> {
        self.file.flush().map_err(RecordingError::io("write to", &self.path))
    }

    pub(crate) fn finish(mut self) -> Result<(), RecordingError> {
        self.flush()?;
        self.file.get_ref().sync_all().map_err(RecordingError::io("write to", &self.path))
    }
}

/// Reads such a file whole. These files are small: a five-minute trial has 3,000 digests.
pub(crate) fn read_lines<T: DeserializeOwned>(path: &Path, checked: bool) -> Result<Vec<T>, RecordingError> {
    let bytes = std::fs::read(path).map_err(RecordingError::io("read", path))?;
    let mut values = Vec::new();
    let mut offset = 0;
    for line in bytes.split_inclusive(|b| *b == b'\n') {
        let at = offset as u64;
        offset += line.len();
        let Some((b'\n', text)) = line.split_last() else {
            return Err(RecordingError::Truncated {
                file: path.to_owned(),
                offset: at,
                records: values.len() as u64,
            });
        };
        let value = parse(text, checked).map_err(|reason| RecordingError::Damaged {
            file: path.to_owned(),
            offset: at,
            reason,
        })?;
        values.push(value);
    }
    Ok(values)
}

fn parse<T: DeserializeOwned>(text: &[u8], checked: bool) -> Result<T, String> {
    let json = if checked { check(text)? } else { text };
    serde_json::from_slice(json).map_err(|e| e.to_string())
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
