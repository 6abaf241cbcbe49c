use crate::{
    WriteError,
    atomic_file::{PREFIX, SUFFIX, create_temp_file_in},
    write_target::{LinkTarget, folder_of, follow},
};
use std::{
    fs, io,
    path::{Path, PathBuf},
};

/// Makes the folder `path`, and those above it, where links lead, and refuses one in which no file can be made.
///
/// # Errors
/// [`WriteError::Io`].
pub fn make_folder(path: &Path) -> Result<(), WriteError> {
    let make = || {
        let (target, _) = follow(path)?;
        fs::create_dir_all(&target)?;
        check_writable(&target)
    };
    make().map_err(WriteError::at(path))
}

/// Refuses a folder that [`make_folder`] could not make, or in which no file could be made. Nothing is left there.
///
/// # Errors
/// [`WriteError::Io`].
pub fn check_folder(path: &Path) -> Result<(), WriteError> {
    let check = || {
        let (mut target, mut found) = follow(path)?;
        // What is not there yet is made in the nearest folder that is.
        while matches!(found, LinkTarget::Missing) {
            let above: PathBuf = folder_of(&target).to_owned();
            if above == target {
                break;
            }
            (target, found) = follow(&above)?;
        }
        match target.is_dir() {
            true => check_writable(&target),
            false => {
                let what = format!("{} is no folder, expected one", target.display());
                Err(io::Error::new(io::ErrorKind::NotADirectory, what))
            }
        }
    };
    check().map_err(WriteError::at(path))
}

/// Where `path` leads, behind all links.
///
/// # Errors
/// [`WriteError::Io`]: links in a circle.
pub fn resolve_links(path: &Path) -> Result<PathBuf, WriteError> {
    follow(path).map(|(target, _)| target).map_err(WriteError::at(path))
}

fn check_writable(folder: &Path) -> io::Result<()> {
    create_temp_file_in(folder, 0o600).map(drop)
}

/// Refuses a folder that [`claim_output_dir`] would not take. Nothing is left there.
///
/// # Errors
/// As [`claim_output_dir`].
pub fn check_output_dir_claim(path: &Path, first: &str, contents: &str) -> Result<(), WriteError> {
    let failed = WriteError::at(path);
    let (target, _) = follow(path).map_err(&failed)?;
    if !target.is_dir() {
        return check_folder(path);
    }
    let mut only_partial = true;
    for entry in fs::read_dir(&target).map_err(&failed)? {
        let name = entry.map_err(&failed)?.file_name();
        let name = name.to_string_lossy();
        only_partial &= name.starts_with(PREFIX) && name.ends_with(SUFFIX);
    }
    // A program that was killed in its first file leaves a temporary one alone.
    match only_partial || target.join(first).is_file() {
        true => check_folder(path),
        false => Err(WriteError::DirInUse { path: path.to_owned(), holds: contents.to_owned() }),
    }
}

/// Makes a folder for our files, or takes one that we wrote before, known by the file that is always written first.
///
/// # Errors
/// [`WriteError::DirInUse`] for a folder that has something in it and not that file; [`WriteError::Io`].
pub fn claim_output_dir(path: &Path, first: &str, contents: &str) -> Result<(), WriteError> {
    check_output_dir_claim(path, first, contents)?;
    make_folder(path)
}
