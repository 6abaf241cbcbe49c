//! A reader in a thread of its own, and what it hands over.

use super::{CaptureStatus, HostClock, MotionCapture};
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
const MAX_QUEUED_POSES: usize = 4096;

/// What reader and taker share.
struct PoseQueueState {
    poses: VecDeque<RawBodyPose>,
    link: CaptureStatus,
    malformed: u64,
}

/// The reader's end.
#[derive(Clone)]
pub struct PoseQueue {
    state: Arc<Mutex<PoseQueueState>>,
    stop: Arc<AtomicBool>,
    /// What arrivals are stamped with.
    pub clock: HostClock,
}

impl PoseQueue {
    fn lock(&self) -> MutexGuard<'_, PoseQueueState> {
        // Each change is whole before anything can panic.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Hands a pose over.
    pub fn push(&self, pose: RawBodyPose) {
        let mut shared = self.lock();
        if shared.poses.len() >= MAX_QUEUED_POSES {
            shared.poses.pop_front();
        }
        shared.poses.push_back(pose);
        shared.link = CaptureStatus::Connected;
    }

    /// How the source stands with its system now.
    pub fn set_status(&self, link: CaptureStatus) {
        self.lock().link = link;
    }

    /// The system is not there.
    pub fn set_waiting(&self, reason: impl Into<String>) {
        self.set_status(CaptureStatus::Waiting { reason: reason.into() });
    }

    /// A message that could not be read.
    pub fn count_malformed(&self) {
        self.lock().malformed += 1;
    }

    /// Whether nobody takes poses any more.
    pub fn is_closed(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }
}

/// The taker's end: a source whose reader runs in a thread, which ends with it.
pub struct ThreadedCapture {
    name: String,
    queue: PoseQueue,
    thread: Option<JoinHandle<()>>,
}

impl ThreadedCapture {
    /// Starts `read`, which must end soon after [`PoseQueue::is_closed`].
    pub fn start(
        name: String,
        clock: HostClock,
        waiting_for: String,
        read: impl FnOnce(PoseQueue) + Send + 'static,
    ) -> Self {
        let link = CaptureStatus::Waiting { reason: waiting_for };
        let shared = Arc::new(Mutex::new(PoseQueueState { poses: VecDeque::new(), link, malformed: 0 }));
        let inflow = PoseQueue { state: shared, stop: Arc::new(AtomicBool::new(false)), clock };
        let readers = inflow.clone();
        Self { name, queue: inflow, thread: Some(std::thread::spawn(move || read(readers))) }
    }
}

impl MotionCapture for ThreadedCapture {
    fn name(&self) -> &str {
        &self.name
    }

    fn drain_poses(&mut self, poses: &mut Vec<RawBodyPose>) -> Result<CaptureStatus, DeviceError> {
        if self.thread.as_ref().is_some_and(JoinHandle::is_finished) {
            let reason = "its reader has ended".to_owned();
            return Err(DeviceError::Capture { name: self.name.clone(), reason });
        }
        let mut shared = self.queue.lock();
        poses.extend(shared.poses.drain(..));
        Ok(shared.link.clone())
    }

    fn malformed(&self) -> u64 {
        self.queue.lock().malformed
    }
}

impl Drop for ThreadedCapture {
    fn drop(&mut self) {
        self.queue.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            // A panic of the thread has been told by itself.
            let _ = thread.join();
        }
    }
}
