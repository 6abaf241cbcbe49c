//! Motion capture behind one trait: VRPN, NatNet, the lab streaming layer and files, with doubles for tests.
//!
//! A source hands out the poses of all bodies as the system sent them, in its unit and axes. Whether they can be used is
//! decided by [`proact_localization`]. Readers run in threads of their own, so that the arrival of a pose is stamped when it
//! comes, not when somebody looks.

mod controller;
mod doubles;
pub mod natnet;
mod playback;
mod pose_queue;
mod schemes;
pub mod vrpn;

pub use controller::{ControllerCapture, LEFT_CONTROLLER, RIGHT_CONTROLLER};
pub use doubles::{CaptureFault, FaultyCapture, ScriptedCapture};
pub use playback::{PosePlayback, read_poses, write_pose, write_pose_header};
pub use pose_queue::{PoseQueue, ThreadedCapture};
pub use schemes::{CAPTURE_SCHEMES, CaptureScheme, OpenCapture, OpenedCapture, SplitName, body_name, split};

use crate::DeviceError;
use proact_localization::{Nanos, RawBodyPose};
use std::time::Instant;

/// This machine's clock, from when it was started: what arrivals are stamped with. Sources that are compared share one.
#[derive(Clone, Copy, Debug)]
pub struct HostClock(Instant);

impl HostClock {
    /// Zero is now.
    pub fn start() -> Self {
        Self(Instant::now())
    }

    /// Since the start, ns.
    pub fn now(&self) -> Nanos {
        i64::try_from(self.0.elapsed().as_nanos()).unwrap_or(i64::MAX)
    }
}

/// How a source stands with the system behind it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum CaptureStatus {
    /// Not there, or not any more; the source keeps trying.
    Waiting {
        /// What is missing, and what to do about it.
        reason: String,
    },
    /// The system is there. Whether it sees a body, its poses tell.
    Connected,
    /// A recording is over.
    Ended,
}

/// A motion capture system.
pub trait MotionCapture: Send {
    /// For display, such as `VRPN 192.168.1.5:3883`.
    fn name(&self) -> &str;

    /// Appends the poses that came since the last call, of all bodies, in the order of arrival. Never waits.
    ///
    /// # Errors
    /// Only what cannot be mended by waiting. A system that is gone is a [`CaptureStatus`].
    fn drain_poses(&mut self, poses: &mut Vec<RawBodyPose>) -> Result<CaptureStatus, DeviceError>;

    /// A pose that comes another way, such as by the page, at [`RawBodyPose::arrival`]. Sources with a way of their own leave it out.
    fn push_pose(&mut self, _pose: RawBodyPose) {}

    /// Messages so far that could not be read, and were left out.
    fn malformed(&self) -> u64 {
        0
    }
}
