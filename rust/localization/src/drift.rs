//! The headset's world drifts in the room: corrected while the head is seen.

use crate::HeadsetCalibration;
use nalgebra::UnitQuaternion;
use proact_types::{Pose, Vector};
use serde::{Deserialize, Serialize};

/// What a pair said of the calibration.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum DriftState {
    /// It was taken in.
    Corrected,
    /// It was passed over: too far off, for a moment.
    Ignored,
    /// It has been too far off for long: the markers slipped on the headset, or the headset lost its place in the room and found
    /// another. Calibrate anew.
    Lost,
}

/// Time constant of the correction, s: a drift of 1 cm a minute leaves 0.5 mm.
const TIME_CONSTANT_SECS: f64 = 3.0;
/// In the first moments each pair counts as much as all before.
const FIRST_PAIRS: f64 = 30.0;
/// Off by more than this, m, a pair is passed over,
const OUTLIER_M: f64 = 0.02;
/// or by this, rad.
const OUTLIER_RAD: f64 = 0.05;
/// So long, s.
const LOST_SECS: f64 = 2.0;

/// Follows `headset_world_from_tracking` from pairs of one moment. Deterministic.
///
/// Kept are the attitude and the image of the place where the head is: far from it a small turn is a long way, and the arm
/// is near it.
#[derive(Clone, Debug)]
pub struct DriftCorrection {
    head_from_markers: Pose,
    rotation: UnitQuaternion<f64>,
    /// In `tracking`.
    anchor_in_tracking: Vector,
    /// The same in the headset's world.
    anchor_in_headset_world: Vector,
    last_secs: Option<f64>,
    pair_count: f64,
    outlier_since_secs: Option<f64>,
}

impl DriftCorrection {
    /// Begins with what was calibrated.
    pub fn new(calibration: &HeadsetCalibration) -> Self {
        let y = calibration.headset_world_from_tracking;
        Self {
            head_from_markers: calibration.head_from_markers,
            rotation: y.rotation,
            anchor_in_tracking: calibration.head_position,
            anchor_in_headset_world: (y * nalgebra::Point3::from(calibration.head_position)).coords,
            last_secs: None,
            pair_count: 0.0,
            outlier_since_secs: None,
        }
    }

    /// Both poses of one moment, `headset_world_from_head` and `tracking_from_markers`, at `stamp_secs` on the headset's clock.
    /// One that is not finite, or not later than the one before, is passed over.
    pub fn update(&mut self, stamp_secs: f64, head: &Pose, markers: &Pose) -> DriftState {
        let measured = head * self.head_from_markers * markers.inverse();
        let secs = self.last_secs.map_or(0.0, |last| stamp_secs - last);
        let finite = stamp_secs.is_finite() && measured.to_homogeneous().iter().all(|v| v.is_finite());
        if !finite || (self.last_secs.is_some() && secs <= 0.0) {
            return DriftState::Ignored;
        }
        self.last_secs = Some(stamp_secs);
        // The kept place goes with the head, along the present correction.
        self.anchor_in_headset_world +=
            self.rotation * (markers.translation.vector - self.anchor_in_tracking);
        self.anchor_in_tracking = markers.translation.vector;
        let off = (measured * nalgebra::Point3::from(self.anchor_in_tracking)).coords
            - self.anchor_in_headset_world;
        let turn = (measured.rotation * self.rotation.inverse()).scaled_axis();
        if off.norm() > OUTLIER_M || turn.norm() > OUTLIER_RAD {
            let since = *self.outlier_since_secs.get_or_insert(stamp_secs);
            return if stamp_secs - since > LOST_SECS { DriftState::Lost } else { DriftState::Ignored };
        }
        self.outlier_since_secs = None;
        self.pair_count += 1.0;
        let share =
            (1.0 - (-secs.min(1.0) / TIME_CONSTANT_SECS).exp()).max(1.0 / (self.pair_count + FIRST_PAIRS));
        self.anchor_in_headset_world += off * share;
        self.rotation = UnitQuaternion::from_scaled_axis(turn * share) * self.rotation;
        DriftState::Corrected
    }

    /// `headset_world_from_tracking` now.
    pub fn headset_world_from_tracking(&self) -> Pose {
        Pose::from_parts(
            (self.anchor_in_headset_world - self.rotation * self.anchor_in_tracking).into(),
            self.rotation,
        )
    }
}
