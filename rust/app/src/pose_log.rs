//! Poses of all bodies on one clock, in a file that calibrations are made from.

use proact_devices::motion_capture::{write_pose, write_pose_header};
use proact_files::write_atomically;
use proact_localization::{ClockOffset, Nanos, RawBodyPose};
use proact_types::Pose;
use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

/// Name under which the head of a headset is recorded.
pub const HEAD_BODY: &str = "head";
/// Poses that are kept: ten minutes of eight bodies at 120 Hz. Later ones are left out.
const MAX_POSES: usize = 600_000;

/// What was seen, with stamps on this machine's clock: a device's stamp plus its least delay, so that streams of several devices
/// can be compared.
#[derive(Debug)]
pub struct PoseLog {
    path: PathBuf,
    clocks: BTreeMap<String, ClockOffset>,
    poses: Vec<RawBodyPose>,
    last_head: Option<Pose>,
}

impl PoseLog {
    /// A log that goes to `path`.
    pub fn new(path: &Path) -> Self {
        Self { path: path.to_owned(), clocks: BTreeMap::new(), poses: Vec::new(), last_head: None }
    }

    /// How many poses there are.
    pub fn len(&self) -> usize {
        self.poses.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.poses.is_empty()
    }

    /// A pose as it came.
    pub fn push_pose(&mut self, raw: &RawBodyPose) {
        let clock = self.clocks.entry(raw.body.clone()).or_default();
        let secs = clock.update(raw.stamp, raw.arrival);
        self.append(RawBodyPose { stamp: (secs * 1e9).round() as Nanos, ..raw.clone() });
    }

    /// The head as a headset tracks it at `now`; the same pose once more is left out.
    pub fn push_head(&mut self, now: Nanos, world_from_head: &Pose) {
        if self.last_head.replace(*world_from_head) == Some(*world_from_head) {
            return;
        }
        let (position, turn) = (world_from_head.translation.vector, world_from_head.rotation.coords);
        self.append(RawBodyPose {
            body: HEAD_BODY.to_owned(),
            id: None,
            stamp: now,
            arrival: now,
            position: position.into(),
            quaternion: turn.into(),
            tracked: true,
        });
    }

    fn append(&mut self, pose: RawBodyPose) {
        if self.poses.len() < MAX_POSES {
            self.poses.push(pose);
        }
    }

    /// Writes all that there is, in the order of the stamps.
    ///
    /// # Errors
    /// What the disk refuses, with the file's name.
    pub fn write(&mut self) -> Result<(), String> {
        if self.poses.is_empty() {
            return Ok(());
        }
        self.poses.sort_by_key(|pose| pose.stamp);
        let mut text = String::new();
        write_pose_header(&mut text);
        self.poses.iter().for_each(|pose| write_pose(&mut text, pose));
        Ok(write_atomically(&self.path, &text)?)
    }
}
