//! Written files are handed to the disk once a second, beside the trial: a tick never waits for the disk.

use std::{
    fs::File,
    io,
    sync::{
        Arc, Mutex, PoisonError,
        mpsc::{self, RecvTimeoutError, Sender},
    },
    thread::JoinHandle,
    time::Duration,
};

/// From one time to the next: what a loss of power can cost.
const SYNC_PERIOD: Duration = Duration::from_secs(1);

/// Hands files to the disk until it is stopped or dropped.
pub(crate) struct DiskSync {
    thread: Option<(Sender<()>, JoinHandle<()>)>,
    failed: Arc<Mutex<Option<io::Error>>>,
}

impl DiskSync {
    pub(crate) fn start(files: Vec<File>) -> Self {
        let failed = Arc::new(Mutex::new(None));
        let shared_error = Arc::clone(&failed);
        let (stop, stopped) = mpsc::channel();
        let thread = std::thread::spawn(move || {
            while stopped.recv_timeout(SYNC_PERIOD) == Err(RecvTimeoutError::Timeout) {
                if let Err(error) = files.iter().try_for_each(File::sync_data) {
                    *shared_error.lock().unwrap_or_else(PoisonError::into_inner) = Some(error);
                    return;
                }
            }
        });
        Self { thread: Some((stop, thread)), failed }
    }

    /// What went wrong since the last time, which the system tells once.
    pub(crate) fn check(&self) -> io::Result<()> {
        // The thread holds the lock for an instant, and then for the last time.
        match self.failed.try_lock() {
            Ok(mut failed) => failed.take().map_or(Ok(()), Err),
            Err(_) => Ok(()),
        }
    }

    /// Ends the thread. Whoever closes the files hands them to the disk a last time.
    pub(crate) fn stop(&mut self) {
        if let Some((stop, thread)) = self.thread.take() {
            drop(stop);
            // It cannot panic: it does nothing but wait and call the system.
            let _ = thread.join();
        }
    }
}

impl Drop for DiskSync {
    fn drop(&mut self) {
        self.stop();
    }
}
