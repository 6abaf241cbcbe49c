//! Files that are there whole or not at all.

use std::{
    fs::File,
    io::{self, BufWriter, Write},
    path::Path,
};

/// Writes a file whole or not at all: beside it first, then renamed.
///
/// # Errors
/// What the disk refuses, with the file's name.
pub fn write_whole(path: &Path, text: &str) -> Result<(), String> {
    let mut beside = path.as_os_str().to_owned();
    beside.push(".partial");
    let write = || -> io::Result<()> {
        let mut file = BufWriter::new(File::create(&beside)?);
        file.write_all(text.as_bytes())?;
        file.into_inner()?.sync_all()?;
        std::fs::rename(&beside, path)
    };
    write().map_err(|error| {
        // Nothing to tell if there is no partial file to remove.
        let _ = std::fs::remove_file(&beside);
        format!("cannot write {}: {error}", path.display())
    })
}
