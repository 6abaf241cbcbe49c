//! Standard output and standard error, either of which may be closed, full or a terminal that is gone; lines of input as they come.

use proact_types::{LineRead, read_line, to_json};
use serde::Serialize;
use std::{
    fmt::Display,
    io::{self, BufRead, Write},
    sync::mpsc::{Receiver, channel},
};

/// Longest line that is looked at, bytes.
const MAX_LINE_BYTES: usize = 1 << 20;

/// Writes an answer to standard output, with a line's end.
///
/// # Errors
/// Whatever the answer was to go to is closed or full.
pub fn print_result(text: impl Display) -> io::Result<()> {
    let write = || {
        let mut out = io::stdout().lock();
        writeln!(out, "{text}")?;
        out.flush()
    };
    write().map_err(|error| io::Error::new(error.kind(), format!("cannot write to standard output: {error}")))
}

/// Writes an answer for machines to standard output: JSON in one line, without negative zeros.
///
/// # Errors
/// As [`answer`].
pub fn print_result_json(value: &impl Serialize) -> io::Result<()> {
    print_result(to_json(value)?)
}

/// Tells whoever watches standard error. What cannot be told is lost: a terminal that is closed ends no trial.
pub fn print_status(text: impl Display) {
    let _ = writeln!(io::stderr().lock(), "{text}");
}

/// Lines as they come, read in a thread of their own, which ends with them or when nobody takes them. The channel closes after the
/// last one. What is longer than any sensible line is cut.
pub fn read_lines(mut from: impl BufRead + Send + 'static) -> Receiver<String> {
    let (sender, lines) = channel();
    std::thread::spawn(move || {
        let mut line = Vec::new();
        while read_line(&mut from, MAX_LINE_BYTES, &mut line).is_ok_and(|read| read != LineRead::End) {
            if sender.send(String::from_utf8_lossy(&line).trim_end().to_owned()).is_err() {
                return;
            }
        }
    });
    lines
}
