//! Standard output and standard error, either of which may be closed, full or a terminal that is gone.

use std::{
    fmt::Display,
    io::{self, Write},
};

/// Writes an answer to standard output, with a line's end.
///
/// # Errors
/// Whatever the answer was to go to is closed or full.
pub fn answer(text: impl Display) -> io::Result<()> {
    let write = || {
        let mut out = io::stdout().lock();
        writeln!(out, "{text}")?;
        out.flush()
    };
    write().map_err(|error| io::Error::new(error.kind(), format!("cannot write to standard output: {error}")))
}

/// Tells whoever watches standard error. What cannot be told is lost: a terminal that is closed ends no trial.
pub fn tell(text: impl Display) {
    let _ = writeln!(io::stderr().lock(), "{text}");
}
