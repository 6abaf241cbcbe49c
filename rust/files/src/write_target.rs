//! Where a path leads.

use nix::errno::Errno;
use std::{
    fs::{self, File, Metadata},
    io::{self, Error, ErrorKind, Write},
    os::fd::AsFd,
    path::{Path, PathBuf},
};

/// Most links on the way to a file, as in the kernel.
const MAX_LINKS: usize = 40;

/// Where writing to a path ends up, behind all links.
#[derive(Debug)]
pub(crate) enum WriteTarget {
    /// A regular file, if there is one yet.
    Regular(PathBuf, Option<Metadata>),
    /// A pipe, a device, or something that is open already, as `/dev/stdout`: it is written to, never replaced.
    Stream(PathBuf),
}

impl WriteTarget {
    /// Follows `path`.
    ///
    /// # Errors
    /// A folder, links in a circle, a way that cannot be walked.
    pub(crate) fn of(path: &Path) -> io::Result<Self> {
        let (path, found) = follow(path)?;
        match found {
            LinkTarget::Missing => Ok(WriteTarget::Regular(path, None)),
            LinkTarget::Node(metadata) if metadata.is_file() => {
                Ok(WriteTarget::Regular(path, Some(metadata)))
            }
            LinkTarget::Node(metadata) if metadata.is_dir() => {
                Err(Error::new(ErrorKind::IsADirectory, "it is a folder, expected a file"))
            }
            LinkTarget::Node(_) | LinkTarget::Open => Ok(WriteTarget::Stream(path)),
        }
    }
}

/// What stands at the end of all links.
#[derive(Debug)]
pub(crate) enum LinkTarget {
    Missing,
    Node(Metadata),
    /// A file that a process has open, by its link in `/proc`, which leads to no path.
    Open,
}

/// Follows all links, also to where nothing is yet.
pub(crate) fn follow(path: &Path) -> io::Result<(PathBuf, LinkTarget)> {
    let mut path = path.to_owned();
    for _ in 0..=MAX_LINKS {
        let metadata = match fs::symlink_metadata(&path) {
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok((path, LinkTarget::Missing)),
            other => other?,
        };
        if !metadata.is_symlink() {
            return Ok((path, LinkTarget::Node(metadata)));
        }
        let folder = folder_of(&path);
        if fs::canonicalize(folder)?.starts_with("/proc") {
            return Ok((path, LinkTarget::Open));
        }
        path = folder.join(fs::read_link(&path)?);
    }
    Err(Errno::ELOOP.into())
}

/// The folder that `path` is in.
pub(crate) fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Opens a [`WriteTarget::Stream`] for writing. A pipe waits until somebody reads it.
pub(crate) fn open_stream(path: &Path) -> io::Result<File> {
    let own = fs::canonicalize("/proc/self/fd").ok();
    if own.is_some() && fs::canonicalize(folder_of(path)).ok() == own {
        // Opened by its link, a file behind standard output would be written from its start again.
        match path.file_name().and_then(|name| name.to_str()) {
            Some("1") => {
                io::stdout().flush()?;
                return Ok(File::from(io::stdout().as_fd().try_clone_to_owned()?));
            }
            Some("2") => return Ok(File::from(io::stderr().as_fd().try_clone_to_owned()?)),
            _ => {}
        }
    }
    File::options().append(true).open(path)
}
