//! Reading with a bound. A file or a line that does not end is refused before it fills the memory.
//!
//! Pure: these functions take any source of bytes; whoever may open files hands them in.

use std::io::{self, BufRead, Error, ErrorKind, Read};

/// Most bytes of a text that people write: a configuration, a description, a model, a line of JSON.
pub const MAX_TEXT_BYTES: usize = 16 << 20;
/// Most bytes of a recording that is read as a whole: an hour of 64 channels at 4 kHz, two bytes a value.
pub const MAX_RECORDING_BYTES: usize = 2 << 30;

/// All bytes of `source`.
///
/// # Errors
/// [`ErrorKind::FileTooLarge`] if there are more than `max_bytes`, otherwise as the source.
pub fn read_bytes(source: impl Read, max_bytes: usize) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    source.take(max_bytes as u64 + 1).read_to_end(&mut bytes)?;
    if bytes.len() > max_bytes {
        return Err(Error::new(
            ErrorKind::FileTooLarge,
            format!(
                "it has more than {max_bytes} bytes, expected at most that: give another file, or a part of it"
            ),
        ));
    }
    Ok(bytes)
}

/// All text of `source`.
///
/// # Errors
/// As [`read_bytes`]; [`ErrorKind::InvalidData`] for what is not UTF-8.
pub fn read_text(source: impl Read, max_bytes: usize) -> io::Result<String> {
    String::from_utf8(read_bytes(source, max_bytes)?).map_err(|error| {
        let at = error.utf8_error().valid_up_to();
        Error::new(ErrorKind::InvalidData, format!("byte {at} is not UTF-8 text, expected a text file"))
    })
}

/// What [`read_line`] met.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LineRead {
    /// The source has ended.
    End,
    /// A whole line, or what stands after the last line break.
    Complete,
    /// A line of more bytes than allowed. The rest of it has not been read: a file is refused, and of a stream it is passed
    /// over with [`BufRead::skip_until`].
    TooLong,
}

/// The next line of `source` into `line`, with its line break; never more than `max_bytes` bytes are kept.
///
/// # Errors
/// As the source.
pub fn read_line(source: &mut impl BufRead, max_bytes: usize, line: &mut Vec<u8>) -> io::Result<LineRead> {
    line.clear();
    if source.take(max_bytes as u64).read_until(b'\n', line)? == 0 {
        return Ok(LineRead::End);
    }
    if line.len() < max_bytes || line.ends_with(b"\n") {
        return Ok(LineRead::Complete);
    }
    Ok(LineRead::TooLong)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_source_that_never_ends_is_refused_with_the_bound() {
        let error = read_bytes(io::repeat(0), 1000).expect_err("it never ends");
        assert_eq!(error.kind(), ErrorKind::FileTooLarge);
        assert!(error.to_string().contains("more than 1000 bytes"), "{error}");
        assert_eq!(read_bytes(&[7; 1000][..], 1000).expect("just fits").len(), 1000);
    }

    #[test]
    fn text_that_is_not_utf8_is_named_by_its_byte() {
        let error = read_text(&b"ab\xff"[..], 10).expect_err("not text");
        assert!(error.to_string().starts_with("byte 2 is not UTF-8"), "{error}");
        assert_eq!(read_text(&b"ab"[..], 10).expect("text"), "ab");
    }

    #[test]
    fn a_line_that_is_too_long_is_kept_to_its_bound_and_can_be_passed_over() -> io::Result<()> {
        let mut source = io::BufReader::with_capacity(3, &b"short\nfar too long a line\nlast"[..]);
        let mut line = Vec::new();
        assert_eq!(read_line(&mut source, 8, &mut line)?, LineRead::Complete);
        assert_eq!(line, b"short\n");
        assert_eq!(read_line(&mut source, 8, &mut line)?, LineRead::TooLong);
        assert_eq!(line, b"far too ");
        source.skip_until(b'\n')?;
        assert_eq!(read_line(&mut source, 8, &mut line)?, LineRead::Complete);
        assert_eq!(line, b"last");
        assert_eq!(read_line(&mut source, 8, &mut line)?, LineRead::End);
        // Such a line of a file that never ends is told at once.
        assert_eq!(read_line(&mut io::BufReader::new(io::repeat(0)), 8, &mut line)?, LineRead::TooLong);
        Ok(())
    }
}
