//! Files that are there whole or not at all.

use std::{
    fs::File,
    io::{self, BufWriter, Write},
    path::{Path, PathBuf},
};

/// Makes a folder for our files, or takes one that we wrote before, known by the file that is always written first.
///
/// # Errors
/// A folder that has something in it and not that file, even half of it; what the disk refuses.
pub(crate) fn claim_folder(folder: &Path, first: &str, holds: &str) -> Result<(), String> {
    let failed = |error: io::Error| format!("{}: {error}", folder.display());
    std::fs::create_dir_all(folder).map_err(failed)?;
    let empty = std::fs::read_dir(folder).map_err(failed)?.next().is_none();
    let first = folder.join(first);
    // Half of it is what we leave if we are killed in it.
    if empty || first.is_file() || beside(&first).is_file() {
        return Ok(());
    }
    Err(format!("{} is not empty, and is no earlier {holds}; name a new folder with --out", folder.display()))
}

/// Where a file grows until it is whole.
fn beside(path: &Path) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(".partial");
    name.into()
}

/// Writes a file whole or not at all: beside it first, then renamed.
///
/// # Errors
/// What the disk refuses, with the file's name.
pub fn write_whole(path: &Path, text: &str) -> Result<(), String> {
    let beside = beside(path);
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
