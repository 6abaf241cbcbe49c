use std::{
    fs::{File, TryLockError},
    io,
    ops::{Deref, DerefMut},
};

/// A file to which this program alone writes, until this is dropped or the program ends, however it does. Others may read.
#[derive(Debug)]
pub struct FileLock(File);

impl FileLock {
    /// Locks `file`, waiting for whoever has it.
    ///
    /// # Errors
    /// As the system.
    pub fn acquire(file: File) -> io::Result<Self> {
        file.lock()?;
        Ok(Self(file))
    }

    /// Locks `file` if nobody has it.
    ///
    /// # Errors
    /// [`TryLockError::WouldBlock`] if somebody has; else as the system.
    pub fn try_acquire(file: File) -> Result<Self, TryLockError> {
        file.try_lock()?;
        Ok(Self(file))
    }
}

impl Drop for FileLock {
    /// Closing is not enough: a child has the same open file from its start until its program runs.
    fn drop(&mut self) {
        let _ = self.0.unlock();
    }
}

impl Deref for FileLock {
    type Target = File;

    fn deref(&self) -> &File {
        &self.0
    }
}

impl DerefMut for FileLock {
    fn deref_mut(&mut self) -> &mut File {
        &mut self.0
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, clippy::disallowed_methods)]
mod tests {
    use super::*;

    // Catches a lock that outlives its owner in a child that is just being started.
    #[test]
    fn a_lock_ends_with_its_owner_though_a_child_has_the_file_still() {
        let temp_dir = tempfile::tempdir().unwrap();
        let path = temp_dir.path().join("lock");
        let lock = FileLock::try_acquire(File::create(&path).unwrap()).unwrap();
        let of_a_child = lock.try_clone().unwrap();
        let other = || FileLock::try_acquire(File::open(&path).unwrap());
        assert!(matches!(other(), Err(TryLockError::WouldBlock)));
        drop(lock);
        assert!(other().is_ok());
        drop(of_a_child);
    }
}
