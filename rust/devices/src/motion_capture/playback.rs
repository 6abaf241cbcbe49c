//! Poses in a file: `body,id,stamp_ns,x,y,z,qx,qy,qz,qw,tracked`, one a line, as they were sent.

use super::{CaptureStatus, HostClock, MotionCapture};
use crate::DeviceError;
use proact_localization::RawBodyPose;
use std::{
    collections::VecDeque,
    fmt::Write,
    path::{Path, PathBuf},
};

/// The first line.
const CSV_HEADER: &str = "body,id,stamp_ns,x,y,z,qx,qy,qz,qw,tracked";

/// Appends the first line of a file.
pub fn write_pose_header(out: &mut String) {
    let _ = writeln!(out, "{CSV_HEADER}");
}

/// Appends the line of a pose. Commas and line ends in names become underscores.
pub fn write_pose(out: &mut String, pose: &RawBodyPose) {
    let body = pose.body.replace([',', '\n', '\r'], "_");
    let id = pose.id.map_or(String::new(), |id| id.to_string());
    // A String takes everything.
    let _ = write!(out, "{body},{id},{}", pose.stamp);
    for number in pose.position.iter().chain(&pose.quaternion) {
        let _ = write!(out, ",{number}");
    }
    let _ = writeln!(out, ",{}", u8::from(pose.tracked));
}

/// Reads a file of poses; they arrive at their stamps, counted from the first.
///
/// # Errors
/// [`DeviceError::Recorded`] for a line that is none, or a stamp before the one above.
pub fn read_poses(path: &Path) -> Result<Vec<RawBodyPose>, DeviceError> {
    let unread = |reason: String| DeviceError::InvalidRecording { path: PathBuf::from(path), reason };
    let text = std::fs::read_to_string(path).map_err(|error| unread(error.to_string()))?;
    let mut lines = text.lines();
    if lines.next() != Some(CSV_HEADER) {
        return Err(unread(format!("row 1: expected {CSV_HEADER}")));
    }
    let mut poses: Vec<RawBodyPose> = Vec::new();
    for (row, line) in lines.enumerate() {
        let mut pose = read_pose(line).map_err(|reason| unread(format!("row {}: {reason}", row + 2)))?;
        let (first, before) = match (poses.first(), poses.last()) {
            (Some(first), Some(last)) => (first.stamp, last.stamp),
            _ => (pose.stamp, pose.stamp),
        };
        if pose.stamp < before {
            return Err(unread(format!(
                "row {}: stamp {} after {before}, expected stamps that rise",
                row + 2,
                pose.stamp
            )));
        }
        pose.arrival = pose.stamp.saturating_sub(first);
        poses.push(pose);
    }
    if poses.is_empty() {
        return Err(unread("no poses".to_owned()));
    }
    Ok(poses)
}

fn read_pose(line: &str) -> Result<RawBodyPose, String> {
    let cells: Vec<&str> = line.split(',').collect();
    let [body, id, stamp, numbers @ .., tracked] = &cells[..] else {
        return Err(format!("{} columns, expected 11", cells.len()));
    };
    let numbers: &[&str; 7] =
        numbers.try_into().map_err(|_| format!("{} columns, expected 11", cells.len()))?;
    let mut values = [0.0; 7];
    for (value, text) in values.iter_mut().zip(numbers) {
        *value = text.parse().map_err(|_| format!("{text:?}, expected a number"))?;
    }
    let [x, y, z, qx, qy, qz, qw] = values;
    let id = match *id {
        "" => None,
        text => Some(text.parse().map_err(|_| format!("id {text:?}, expected a whole number or nothing"))?),
    };
    let tracked = match *tracked {
        "1" => true,
        "0" => false,
        other => return Err(format!("tracked {other:?}, expected 0 or 1")),
    };
    let stamp = stamp.parse().map_err(|_| format!("stamp {stamp:?}, expected whole ns"))?;
    let body = (*body).to_owned();
    Ok(RawBodyPose {
        body,
        id,
        stamp,
        arrival: 0,
        position: [x, y, z],
        quaternion: [qx, qy, qz, qw],
        tracked,
    })
}

/// A file played as if live, from its opening on.
#[derive(Debug)]
pub struct PosePlayback {
    name: String,
    poses: VecDeque<RawBodyPose>,
    clock: HostClock,
    start_ns: i64,
}

impl PosePlayback {
    /// Plays the file at `path`.
    ///
    /// # Errors
    /// As [`read_poses`].
    pub fn open(path: &Path, clock: HostClock) -> Result<Self, DeviceError> {
        let poses = read_poses(path)?.into();
        Ok(Self { name: path.display().to_string(), poses, clock, start_ns: clock.now() })
    }
}

impl MotionCapture for PosePlayback {
    fn name(&self) -> &str {
        &self.name
    }

    fn drain_poses(&mut self, poses: &mut Vec<RawBodyPose>) -> Result<CaptureStatus, DeviceError> {
        let now = self.clock.now() - self.start_ns;
        let due = self.poses.iter().take_while(|pose| pose.arrival <= now).count();
        for pose in self.poses.drain(..due) {
            let arrival = self.start_ns + pose.arrival;
            poses.push(RawBodyPose { arrival, ..pose });
        }
        Ok(if self.poses.is_empty() && poses.is_empty() {
            CaptureStatus::Ended
        } else {
            CaptureStatus::Connected
        })
    }
}
