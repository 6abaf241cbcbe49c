//! A reader in a thread of its own, and what it hands over.

use super::{CaptureLink, HostClock, MotionCapture};
use crate::DeviceError;
use proact_localization::RawBodyPose;
use std::{
    collections::VecDeque,
    sync::{
        Arc, Mutex, MutexGuard, PoisonError,
        atomic::{AtomicBool, Ordering},
    },
    thread::JoinHandle,
};

/// Poses that may wait for whoever takes them; of more the oldest go. Four seconds of eight bodies at 120 Hz.
const MOST_WAITING: usize = 4096;

/// What reader and taker share.
struct Shared {
    poses: VecDeque<RawBodyPose>,
    link: CaptureLink,
    malformed: u64,
}

/// The reader's end.
#[derive(Clone)]
pub struct Inflow {
    shared: Arc<Mutex<Shared>>,
    stop: Arc<AtomicBool>,
    /// What arrivals are stamped with.
    pub clock: HostClock,
}

impl Inflow {
    fn lock(&self) -> MutexGuard<'_, Shared> {
        // Each change is whole before anything can panic.
        self.shared.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Hands a pose over.
    pub fn push(&self, pose: RawBodyPose) {
        let mut shared = self.lock();
        if shared.poses.len() >= MOST_WAITING {
            shared.poses.pop_front();
        }
        shared.poses.push_back(pose);
        shared.link = CaptureLink::Connected;
    }

    /// How the source stands with its system now.
    pub fn link(&self, link: CaptureLink) {
        self.lock().link = link;
    }

    /// The system is not there.
    pub fn wait(&self, reason: impl Into<String>) {
        self.link(CaptureLink::Waiting { reason: reason.into() });
    }

    /// A message that could not be read.
    pub fn malformed(&self) {
        self.lock().malformed += 1;
    }

    /// Whether nobody takes poses any more.
    pub fn is_over(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }
}

/// The taker's end: a source whose reader runs in a thread, which ends with it.
pub struct ThreadedCapture {
    name: String,
    inflow: Inflow,
    thread: Option<JoinHandle<()>>,
}

impl ThreadedCapture {
    /// Starts `read`, which must end soon after [`Inflow::is_over`].
    pub fn start(
        name: String,
        clock: HostClock,
        waiting_for: String,
        read: impl FnOnce(Inflow) + Send + 'static,
    ) -> Self {
        let link = CaptureLink::Waiting { reason: waiting_for };
        let shared = Arc::new(Mutex::new(Shared { poses: VecDeque::new(), link, malformed: 0 }));
        let inflow = Inflow { shared, stop: Arc::new(AtomicBool::new(false)), clock };
        let readers = inflow.clone();
        Self { name, inflow, thread: Some(std::thread::spawn(move || read(readers))) }
    }
}

impl MotionCapture for ThreadedCapture {
    fn name(&self) -> &str {
        &self.name
    }

    fn take(&mut self, poses: &mut Vec<RawBodyPose>) -> Result<CaptureLink, DeviceError> {
        if self.thread.as_ref().is_some_and(JoinHandle::is_finished) {
            let reason = "its reader has ended".to_owned();
            return Err(DeviceError::Capture { name: self.name.clone(), reason });
        }
        let mut shared = self.inflow.lock();
        poses.extend(shared.poses.drain(..));
        Ok(shared.link.clone())
    }

    fn malformed(&self) -> u64 {
        self.inflow.lock().malformed
    }
}

impl Drop for ThreadedCapture {
    fn drop(&mut self) {
        self.inflow.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            // A panic of the thread has been told by itself.
            let _ = thread.join();
        }
    }
}
