//! Bodies of a file of poses, checked, for calibrations.

use crate::MocapAxes;
use proact_devices::{DeviceError, motion_capture::read_poses};
use proact_localization::{
    BodySample, ExpectedHeight, PoseFault, PoseStreamCheck, RawBodyPose, TimedPose, TrackingAxes,
    check_handedness, check_height,
};
use std::path::{Path, PathBuf};

/// Why a recording is not used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RecordedBodyError {
    /// The file.
    #[error(transparent)]
    File(#[from] DeviceError),
    /// The poses.
    #[error("{}: {fault}", path.display())]
    InvalidPoses {
        /// Which file.
        path: PathBuf,
        /// What is wrong with them.
        fault: PoseFault,
    },
    /// No such body.
    #[error("{}: no body {got:?}; there are {known}", path.display())]
    NoBody {
        /// Which file.
        path: PathBuf,
        /// As named.
        got: String,
        /// Those of the file.
        known: String,
    },
}

/// A file of poses.
#[derive(Debug)]
pub struct RecordedBodies {
    path: PathBuf,
    poses: Vec<RawBodyPose>,
}

impl RecordedBodies {
    /// Reads the file at `path`: `body,id,stamp_ns,x,y,z,qx,qy,qz,qw,tracked`.
    ///
    /// # Errors
    /// As [`read_poses`].
    pub fn open(path: &Path) -> Result<Self, RecordedBodyError> {
        Ok(Self { path: path.to_owned(), poses: read_poses(path)? })
    }

    /// The poses of `body` in metres with z up, those that are tracked.
    ///
    /// # Errors
    /// No such body, or one of the faults that a live stream is refused for; with `of_person`, a height that no shoulder or head has
    /// as well.
    pub fn body(
        &self,
        body: &str,
        axes: &MocapAxes,
        of_person: bool,
    ) -> Result<Vec<BodySample>, RecordedBodyError> {
        let refused = |fault| RecordedBodyError::InvalidPoses { path: self.path.clone(), fault };
        let declared = TrackingAxes {
            up: axes.up.unwrap_or_default(),
            meters_per_unit: axes.meters_per_unit.unwrap_or(1.0),
        };
        let mut check = PoseStreamCheck::new();
        let mut samples = Vec::new();
        for raw in self.poses.iter().filter(|raw| raw.body == body && raw.tracked) {
            check.check(raw).map_err(refused)?;
            samples.push(declared.convert(raw).map_err(refused)?);
        }
        if samples.is_empty() {
            let mut known: Vec<&str> = self.poses.iter().map(|raw| raw.body.as_str()).collect();
            known.sort_unstable();
            known.dedup();
            let (path, got, known) = (self.path.clone(), body.to_owned(), known.join(", "));
            return Err(RecordedBodyError::NoBody { path, got, known });
        }
        if of_person {
            check_height(&samples, &ExpectedHeight::default()).map_err(refused)?;
            check_handedness(&samples).map_err(refused)?;
        }
        Ok(samples)
    }
}

/// With stamps in seconds.
pub fn recorded_poses(samples: &[BodySample]) -> Vec<TimedPose> {
    let secs = |sample: &BodySample| TimedPose { stamp_secs: sample.stamp as f64 * 1e-9, pose: sample.pose };
    samples.iter().map(secs).collect()
}
