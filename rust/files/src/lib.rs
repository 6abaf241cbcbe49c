//! The one writer of output files. It replaces a regular file atomically, follows symbolic links, and writes through pipes and
//! devices.
//!
//! | the path leads to | what happens |
//! |---|---|
//! | nothing, or a regular file | a temporary file beside it grows, is synchronized to the disk, and takes its name; owner and mode of an earlier file stay |
//! | a symbolic link | the same where it leads, also if nothing is there yet; the link stays |
//! | a pipe, a device, `/dev/stdout` | the bytes are written through it once all of them are known; the node stays |
//! | a folder, a link without an end | an error |
//!
//! A command that works for long before it writes calls [`check_output`], [`check_folder`] or [`check_output_dir_claim`] first, so that
//! a path that cannot be written is refused before the work. This crate reads no clock and no configuration.
//!
//! ```
//! # let folder = tempfile::tempdir()?;
//! let path = folder.path().join("model.json");
//! proact_files::check_output(&path)?;
//! proact_files::write_atomically(&path, "{}")?;
//! assert_eq!(std::fs::read_to_string(&path)?, "{}");
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod atomic_file;
mod folder;
mod write_target;

pub use atomic_file::{OutputFile, check_output, create_in_place, is_regular_or_missing, write_atomically};
pub use folder::{check_folder, check_output_dir_claim, claim_output_dir, make_folder, resolve_links};

use std::{
    io,
    path::{Path, PathBuf},
};

/// Why a place cannot be written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum WriteError {
    /// The operating system refused.
    #[error("cannot write {}: {source}", path.display())]
    Io {
        /// The path that the user gave.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// This command replaces no existing file.
    #[error("{} exists and is left alone; name another file", path.display())]
    Exists {
        /// The file.
        path: PathBuf,
    },
    /// The folder is in use for something else.
    #[error("{} is not empty, and is no earlier {holds}; name a new folder with --out", path.display())]
    DirInUse {
        /// The folder.
        path: PathBuf,
        /// What it was to hold.
        holds: String,
    },
}

impl WriteError {
    fn at(path: &Path) -> impl Fn(io::Error) -> Self {
        move |source| WriteError::Io { path: path.to_owned(), source }
    }
}

impl From<WriteError> for String {
    fn from(error: WriteError) -> String {
        error.to_string()
    }
}

/// For errors that name the path themselves.
impl From<WriteError> for io::Error {
    fn from(error: WriteError) -> io::Error {
        match error {
            WriteError::Io { source, .. } => source,
            WriteError::Exists { .. } | WriteError::DirInUse { .. } => {
                io::Error::new(io::ErrorKind::AlreadyExists, error)
            }
        }
    }
}
