//! Doubles for tests of what follows a source.

use super::{CaptureStatus, MotionCapture};
use crate::{DeviceError, random_stream};
use proact_localization::RawBodyPose;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use std::collections::VecDeque;

/// A source that does what the test says, a step a call, without any clock. Ends with the script.
#[derive(Clone, Debug)]
pub struct ScriptedCapture {
    script: VecDeque<(CaptureStatus, Vec<RawBodyPose>)>,
}

impl ScriptedCapture {
    /// Plays `script`: at each call how the source stands, and what it hands out.
    pub fn new(script: impl IntoIterator<Item = (CaptureStatus, Vec<RawBodyPose>)>) -> Self {
        Self { script: script.into_iter().collect() }
    }
}

impl MotionCapture for ScriptedCapture {
    fn name(&self) -> &str {
        "script"
    }

    fn drain_poses(&mut self, poses: &mut Vec<RawBodyPose>) -> Result<CaptureStatus, DeviceError> {
        let Some((link, step)) = self.script.pop_front() else { return Ok(CaptureStatus::Ended) };
        poses.extend(step);
        Ok(link)
    }
}

/// What a [`FaultyCapture`] does to the poses of another source.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum CaptureFault {
    /// A pose vanishes with this probability.
    Drop(f64),
    /// A pose is marked as not tracked, with a quaternion of zeros, with this probability.
    Occlude(f64),
    /// A quaternion is all zeros while the pose is marked as tracked, with this probability.
    ZeroQuaternion(f64),
    /// A coordinate is not a number, with this probability.
    NotANumber(f64),
    /// From this pose on every pose is the one before, under new stamps.
    Freeze {
        /// Number of the first such pose, from 0.
        from: u64,
    },
    /// From this pose on stamps are earlier by so many ns.
    ClockStepBack {
        /// Number of the first such pose, from 0.
        from: u64,
        /// ns.
        step_ns: i64,
    },
    /// From this pose on bodies have another number.
    ChangedId {
        /// Number of the first such pose, from 0.
        from: u64,
    },
    /// Places are in another unit.
    Scale(f64),
    /// An axis has the wrong sign.
    Mirror {
        /// Which, from 0.
        axis: usize,
    },
    /// y is up.
    YUp,
}

/// Another source with faults. Choices are drawn from the stream `mocap/faults` of the seed.
pub struct FaultyCapture<C> {
    inner: C,
    faults: Vec<CaptureFault>,
    rng: ChaCha8Rng,
    pose_count: u64,
    frozen: Option<RawBodyPose>,
}

impl<C: MotionCapture> FaultyCapture<C> {
    /// `inner` with `faults`, applied in their order.
    pub fn new(inner: C, faults: &[CaptureFault], seed: u64) -> Self {
        Self {
            inner,
            faults: faults.to_vec(),
            rng: random_stream(seed, "mocap/faults"),
            pose_count: 0,
            frozen: None,
        }
    }

    /// The pose as it comes out; none if it is lost.
    fn apply_faults(&mut self, mut pose: RawBodyPose) -> Option<RawBodyPose> {
        let number = self.pose_count;
        self.pose_count += 1;
        for fault in self.faults.clone() {
            match fault {
                CaptureFault::Drop(share) if self.rng.random_bool(share) => return None,
                CaptureFault::Occlude(share) if self.rng.random_bool(share) => {
                    (pose.tracked, pose.quaternion) = (false, [0.0; 4]);
                }
                CaptureFault::ZeroQuaternion(share) if self.rng.random_bool(share) => {
                    pose.quaternion = [0.0; 4]
                }
                CaptureFault::NotANumber(share) if self.rng.random_bool(share) => pose.position[1] = f64::NAN,
                CaptureFault::Freeze { from } if number >= from => {
                    let held = self.frozen.get_or_insert_with(|| pose.clone());
                    (pose.position, pose.quaternion) = (held.position, held.quaternion);
                }
                CaptureFault::ClockStepBack { from, step_ns: by } if number >= from => pose.stamp -= by,
                CaptureFault::ChangedId { from } if number >= from => pose.id = pose.id.map(|id| id + 100),
                CaptureFault::Scale(factor) => pose.position = pose.position.map(|value| value * factor),
                CaptureFault::Mirror { axis } => pose.position[axis] = -pose.position[axis],
                CaptureFault::YUp => {
                    let ([x, y, z], [qx, qy, qz, qw]) = (pose.position, pose.quaternion);
                    (pose.position, pose.quaternion) = ([x, z, -y], [qx, qz, -qy, qw]);
                }
                _ => {}
            }
        }
        Some(pose)
    }
}

impl<C: MotionCapture> MotionCapture for FaultyCapture<C> {
    fn name(&self) -> &str {
        self.inner.name()
    }

    fn drain_poses(&mut self, poses: &mut Vec<RawBodyPose>) -> Result<CaptureStatus, DeviceError> {
        let mut fresh = Vec::new();
        let link = self.inner.drain_poses(&mut fresh)?;
        poses.extend(fresh.into_iter().filter_map(|pose| self.apply_faults(pose)));
        Ok(link)
    }

    fn malformed(&self) -> u64 {
        self.inner.malformed()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pose(stamp: i64) -> RawBodyPose {
        RawBodyPose {
            body: "shoulder".to_owned(),
            id: Some(1),
            stamp,
            arrival: stamp,
            position: [0.1 * stamp as f64, 0.2, 0.3],
            quaternion: [0.0, 0.0, 0.0, 1.0],
            tracked: true,
        }
    }

    /// What comes of five poses, one a call.
    fn spoilt(faults: &[CaptureFault]) -> Vec<RawBodyPose> {
        let script = (0..5).map(|stamp| (CaptureStatus::Connected, vec![pose(stamp)]));
        let mut source = FaultyCapture::new(ScriptedCapture::new(script), faults, 1);
        let mut poses = Vec::new();
        while source.drain_poses(&mut poses).unwrap() != CaptureStatus::Ended {}
        poses
    }

    #[test]
    fn a_script_is_played_to_its_end_and_each_fault_shows_from_where_it_begins() {
        let whole: Vec<i64> = spoilt(&[]).iter().map(|pose| pose.stamp).collect();
        assert_eq!(whole, [0, 1, 2, 3, 4]);
        assert!(spoilt(&[CaptureFault::Drop(1.0)]).is_empty());
        let frozen = spoilt(&[CaptureFault::Freeze { from: 2 }]);
        assert_eq!((frozen[1].position, frozen[4].position), (pose(1).position, pose(2).position));
        assert_eq!(frozen[4].stamp, 4, "its stamps go on");
        let back = spoilt(&[CaptureFault::ClockStepBack { from: 3, step_ns: 3 }]);
        assert_eq!(back.iter().map(|pose| pose.stamp).collect::<Vec<_>>(), [0, 1, 2, 0, 1]);
        assert_eq!(spoilt(&[CaptureFault::ChangedId { from: 4 }])[4].id, Some(101));
        assert_eq!(spoilt(&[CaptureFault::Scale(1e3)])[1].position, [100.0, 200.0, 300.0]);
        assert_eq!(spoilt(&[CaptureFault::Mirror { axis: 1 }])[0].position[1], -0.2);
        assert!(spoilt(&[CaptureFault::NotANumber(1.0)])[0].position[1].is_nan());
        assert!(!spoilt(&[CaptureFault::Occlude(1.0)])[0].tracked);
    }
}
