use crate::{
    WriteError,
    write_target::{WriteTarget, folder_of, open_stream},
};
use nix::unistd::{AccessFlags, access};
use std::{
    fs::{File, Permissions},
    io::{self, Read, Seek, SeekFrom, Write},
    os::unix::fs::{MetadataExt, OpenOptionsExt, PermissionsExt, fchown},
    path::{Path, PathBuf},
};
use tempfile::NamedTempFile;

/// Temporary files are known by these, whatever the file is called.
pub(crate) const PREFIX: &str = ".proact-";
pub(crate) const SUFFIX: &str = ".partial";

/// A file that is being written. [`OutputFile::finish`] puts it in its place. Dropped earlier, it leaves nothing behind, and an
/// existing file is unchanged.
#[derive(Debug)]
pub struct OutputFile {
    /// For error messages.
    path: PathBuf,
    pending: PendingOutput,
}

#[derive(Debug)]
enum PendingOutput {
    /// Beside the regular file whose place it takes.
    TempFile { file: NamedTempFile, target: PathBuf, earlier: ExistingFilePolicy },
    /// Without a name, until all of it goes through a pipe or device.
    SpooledStream { file: File, target: PathBuf },
}

/// What becomes of a regular file that is there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum ExistingFilePolicy {
    Replace,
    Keep,
}

impl OutputFile {
    /// Begins the file `path`, in place of one that is there.
    ///
    /// # Errors
    /// [`WriteError::Io`]: a folder that is not there or cannot be written, a file that may not be written, one whose owner
    /// cannot be kept.
    pub fn create(path: &Path) -> Result<Self, WriteError> {
        Self::begin(path, ExistingFilePolicy::Replace)
    }

    /// Begins the file `path`. A regular file that is there stays; a pipe or device is written to.
    ///
    /// # Errors
    /// As [`OutputFile::create`], and [`WriteError::Exists`].
    pub fn create_new(path: &Path) -> Result<Self, WriteError> {
        Self::begin(path, ExistingFilePolicy::Keep)
    }

    fn begin(path: &Path, earlier: ExistingFilePolicy) -> Result<Self, WriteError> {
        let failed = WriteError::at(path);
        let growing = match WriteTarget::of(path).map_err(&failed)? {
            WriteTarget::Regular(_, Some(_)) if earlier == ExistingFilePolicy::Keep => {
                return Err(WriteError::Exists { path: path.to_owned() });
            }
            WriteTarget::Regular(target, found) => {
                let file = create_temp_sibling(&target, found.as_ref()).map_err(&failed)?;
                PendingOutput::TempFile { file, target, earlier }
            }
            WriteTarget::Stream(target) => {
                access(&target, AccessFlags::W_OK).map_err(|errno| failed(errno.into()))?;
                PendingOutput::SpooledStream { file: tempfile::tempfile().map_err(&failed)?, target }
            }
        };
        Ok(Self { path: path.to_owned(), pending: growing })
    }

    /// Gives the file its place, once it is on the disk.
    ///
    /// # Errors
    /// [`WriteError`]; what was there before is there then.
    pub fn finish(self) -> Result<(), WriteError> {
        let Self { path, pending: growing } = self;
        let placed = match growing {
            PendingOutput::TempFile { file, target, earlier } => persist(file, &target, earlier),
            PendingOutput::SpooledStream { file, target } => copy_to_stream(file, &target),
        };
        placed.map_err(|error| match error.kind() {
            io::ErrorKind::AlreadyExists => WriteError::Exists { path: path.clone() },
            _ => WriteError::at(&path)(error),
        })
    }

    fn file(&self) -> &File {
        match &self.pending {
            PendingOutput::TempFile { file, .. } => file.as_file(),
            PendingOutput::SpooledStream { file, .. } => file,
        }
    }
}

/// A new file that goes when it is dropped.
pub(crate) fn create_temp_file_in(folder: &Path, mode: u32) -> io::Result<NamedTempFile> {
    tempfile::Builder::new()
        .prefix(PREFIX)
        .suffix(SUFFIX)
        .make_in(folder, |path| File::options().read(true).write(true).create_new(true).mode(mode).open(path))
}

/// An empty file beside `target`, with the owner and the mode of what is `found` there.
fn create_temp_sibling(target: &Path, found: Option<&std::fs::Metadata>) -> io::Result<NamedTempFile> {
    let Some(found) = found else {
        // The system takes the user's mask off this.
        return create_temp_file_in(folder_of(target), 0o666);
    };
    // Renaming asks for no permission on the file itself.
    File::options().write(true).open(target)?;
    let file = create_temp_file_in(folder_of(target), 0o600)?;
    let own = file.as_file().metadata()?;
    if (own.uid(), own.gid()) != (found.uid(), found.gid()) {
        fchown(file.as_file(), Some(found.uid()), Some(found.gid())).map_err(|error| {
            let (uid, gid) = (found.uid(), found.gid());
            let kept = format!(
                "it belongs to user {uid} and group {gid}, who cannot be kept ({error}); name another file"
            );
            io::Error::new(error.kind(), kept)
        })?;
    }
    file.as_file().set_permissions(Permissions::from_mode(found.mode() & 0o7777))?;
    Ok(file)
}

fn persist(file: NamedTempFile, target: &Path, earlier: ExistingFilePolicy) -> io::Result<()> {
    file.as_file().sync_all()?;
    match earlier {
        ExistingFilePolicy::Replace => file.persist(target),
        ExistingFilePolicy::Keep => file.persist_noclobber(target),
    }
    .map_err(|error| error.error)?;
    // The name is on the disk only when the folder is.
    File::open(folder_of(target))?.sync_all()
}

fn copy_to_stream(mut file: File, target: &Path) -> io::Result<()> {
    file.rewind()?;
    let mut out = open_stream(target)?;
    io::copy(&mut file, &mut out)?;
    out.flush()
}

/// An error names the file, so that a caller behind a compressor or a table can report it unchanged.
impl Write for OutputFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.file()
            .write(bytes)
            .map_err(|error| io::Error::new(error.kind(), WriteError::at(&self.path)(error)))
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file().flush()
    }
}

/// What was written can be read again before it takes its place.
impl Read for OutputFile {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        self.file().read(bytes)
    }
}

impl Seek for OutputFile {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.file().seek(to)
    }
}

/// Writes the whole file `path`, in place of one that is there.
///
/// # Errors
/// [`WriteError::Io`]; what was there before is there then.
pub fn write_atomically(path: &Path, bytes: impl AsRef<[u8]>) -> Result<(), WriteError> {
    let file = OutputFile::create(path)?;
    file.file().write_all(bytes.as_ref()).map_err(WriteError::at(path))?;
    file.finish()
}

/// Refuses a place to which [`write_atomically`] cannot write. Nothing is left there, and no pipe is opened.
///
/// # Errors
/// As [`OutputFile::create`].
pub fn check_output(path: &Path) -> Result<(), WriteError> {
    OutputFile::create(path).map(drop)
}

/// Opens the new file `path` for a live recording, which must survive the end of the program: it is written in place, not
/// atomically. A pipe or device is opened as it is.
///
/// # Errors
/// What the system refuses, [`io::ErrorKind::AlreadyExists`] for a regular file that is there.
pub fn create_in_place(path: &Path) -> io::Result<File> {
    match WriteTarget::of(path)? {
        WriteTarget::Regular(target, _) => File::create_new(target),
        WriteTarget::Stream(target) => open_stream(&target),
    }
}

/// Whether `path` leads to a regular file or to nothing yet: other files may stand beside it.
pub fn is_regular_or_missing(path: &Path) -> bool {
    matches!(WriteTarget::of(path), Ok(WriteTarget::Regular(..)))
}
