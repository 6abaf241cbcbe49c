use crate::DeviceError;
use proact_types::{ChannelValues, LineRead, MAX_EMG_CHANNELS, read_line};
use std::{
    fs::File,
    io::{BufReader, Error, ErrorKind},
    path::Path,
};

/// Longest row of a file, bytes; 64 channels with all digits take a fortieth.
const MAX_ROW_BYTES: usize = 64 << 10;
/// Most rows of a file: a quarter of an hour at 4 kHz, five hours at 200 Hz.
const MAX_ROWS: usize = 4_000_000;
/// What some programs write before the first character of a text.
const BYTE_ORDER_MARK: char = '\u{feff}';

/// What stands in a file of samples.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SampleFile {
    /// `[samples][channels]`.
    pub samples: Vec<ChannelValues>,
    /// What was odd about the file and was read all the same, one sentence each.
    pub notes: Vec<String>,
}

/// Reads one file of samples: a row a sample, a column a channel, commas between, no header. A byte-order mark, commas at
/// the ends of all rows and a last row that is cut off are noted and left out.
///
/// # Errors
/// A file that cannot be read, is empty, or has anything but finite numbers in rows of one length.
pub fn read_samples(path: &Path) -> Result<SampleFile, DeviceError> {
    read_rows(path, None)
}

/// Rows of numbers separated by commas, all of one length. `expected` columns, or those of the first row.
pub(crate) fn read_rows(path: &Path, expected: Option<usize>) -> Result<SampleFile, DeviceError> {
    let failed = |source| DeviceError::Read { path: path.to_owned(), source };
    let mut source = BufReader::new(File::open(path).map_err(failed)?);
    let mut columns = expected;
    let mut file = SampleFile::default();
    let note = |what: String| format!("{}: {what}", path.display());
    let mut line = Vec::new();
    // Whether rows end with a comma; not known before the first.
    let mut comma = None;
    for row in 1.. {
        match read_line(&mut source, MAX_ROW_BYTES, &mut line).map_err(failed)? {
            LineRead::End => break,
            LineRead::Complete if file.samples.len() == MAX_ROWS => {
                return Err(too_large(path, format!("it has more than {MAX_ROWS} rows")));
            }
            LineRead::Complete => {}
            LineRead::TooLong => {
                return Err(too_large(path, format!("row {row} has more than {MAX_ROW_BYTES} bytes")));
            }
        }
        let text = std::str::from_utf8(&line).map_err(|_| {
            failed(Error::new(
                ErrorKind::InvalidData,
                format!("row {row} is not UTF-8 text, expected numbers"),
            ))
        })?;
        let mut text = text.trim();
        if let Some(rest) = text.strip_prefix(BYTE_ORDER_MARK).filter(|_| row == 1) {
            file.notes.push(note("it begins with a byte-order mark, which is left out".to_owned()));
            text = rest.trim();
        }
        if text.is_empty() {
            continue;
        }
        let ends = text.ends_with(',');
        if *comma.get_or_insert(ends) && ends {
            if file.samples.is_empty() {
                file.notes.push(note("its rows end with a comma, which is left out".to_owned()));
            }
            text = text[..text.len() - 1].trim_end();
        }
        match parse_row(path, row, text, &mut columns) {
            Ok(values) => file.samples.push(values),
            // A program that was ended wrote no line end, and maybe not the whole row.
            Err(error) if !line.ends_with(b"\n") && !file.samples.is_empty() => {
                file.notes.push(note(format!("the last row is cut off and left out ({error})")));
                break;
            }
            Err(error) => return Err(error),
        }
    }
    if file.samples.is_empty() {
        return Err(DeviceError::EmptyFile { path: path.to_owned() });
    }
    Ok(file)
}

/// The numbers of a row, as many as `columns`, which are those of the first row unless they are known.
fn parse_row(
    path: &Path,
    row: usize,
    text: &str,
    columns: &mut Option<usize>,
) -> Result<ChannelValues, DeviceError> {
    let got = text.split(',').count();
    let wanted = *columns.get_or_insert(got);
    if got != wanted || got > MAX_EMG_CHANNELS {
        let max_text = || format!("at most {MAX_EMG_CHANNELS}");
        let expected = if got > MAX_EMG_CHANNELS { max_text() } else { wanted.to_string() };
        return Err(DeviceError::Columns { path: path.to_owned(), row, got, expected });
    }
    let mut values = ChannelValues::new();
    for (text, column) in text.split(',').zip(1..) {
        let text = text.trim();
        match text.parse::<f64>() {
            Ok(value) if value.is_finite() => values.push(value),
            _ => {
                let (path, text) = (path.to_owned(), text.to_owned());
                return Err(DeviceError::NotANumber { path, row, column, text });
            }
        }
    }
    Ok(values)
}

fn too_large(path: &Path, reason: String) -> DeviceError {
    let reason = format!("{reason}, expected at most that: one row of numbers a sample");
    DeviceError::Read { path: path.to_owned(), source: Error::new(ErrorKind::FileTooLarge, reason) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_other_programs_add_is_noted_and_left_out() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("R_0_C_0.csv");
        let read = |text: &str| {
            std::fs::write(&path, text).unwrap();
            read_samples(&path).map_err(|error| error.to_string())
        };
        let plain = read("1,2\n3,4\n").unwrap();
        assert_eq!((plain.samples.len(), plain.notes.len()), (2, 0));
        assert_eq!(read("1,2\n3,4"), Ok(plain.clone()), "no line end at the end is common");
        for (text, noted) in [
            ("\u{feff}1,2\n3,4\n", "begins with a byte-order mark"),
            ("1,2,\r\n3,4,\r\n", "rows end with a comma"),
            ("1,2\n3,4\n5", "the last row is cut off and left out"),
            ("1,2\n3,4\n5,-", "the last row is cut off and left out"),
        ] {
            let file = read(text).unwrap();
            assert_eq!(file.samples, plain.samples, "{text:?}");
            assert!(matches!(&file.notes[..], [note] if note.contains(noted)), "{:?}", file.notes);
        }
        assert!(read("1,2\n3\n").unwrap_err().contains("row 2: 1 columns, expected 2"), "whole, and short");
        assert!(
            read("1,2\n3,4,\n").unwrap_err().contains("row 2: 3 columns, expected 2"),
            "a comma in one row"
        );
        assert!(read("1,\u{feff}2\n").unwrap_err().contains("column 2"));
    }
}
