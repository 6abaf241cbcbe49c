//! Reading the files of a record. Only regular ones, and with a bound: what a link leads to may never end.

use proact_types::read_bytes;
use std::{
    fs::File,
    io::{Error, ErrorKind, Result},
    path::Path,
};

/// Most bytes of a log of lines: a day of digests and events is half of it.
pub(crate) const MAX_LOG_BYTES: usize = 512 << 20;

/// Opens a regular file.
pub(crate) fn open(path: &Path) -> Result<File> {
    // A pipe would wait for somebody to write, before its kind could be asked for.
    if std::fs::metadata(path)?.is_file() {
        return File::open(path);
    }
    Err(Error::new(ErrorKind::InvalidInput, "it is no regular file, expected one"))
}

/// All bytes of a regular file, at most `max_bytes`.
pub(crate) fn read(path: &Path, max_bytes: usize) -> Result<Vec<u8>> {
    read_bytes(open(path)?, max_bytes)
}
