//! What a tracking system says of one body, before and after it is in metres with z up.

use crate::{ExpectedHeight, Nanos, PoseFault, input_check::check_length_unit};
use nalgebra::{Matrix3, Quaternion, Rotation3, Translation3, UnitQuaternion};
use proact_types::{Pose, Vector};
use serde::{Deserialize, Serialize};

/// A quaternion may be off unit length by this much; a stream of single precision is off by 1e-7. Beyond, it is no rotation.
const NORM_TOLERANCE: f64 = 0.01;
/// Nothing in a laboratory is further than this from its origin, m.
const MAX_POSITION_M: f64 = 1000.0;

/// The pose of a body as it came, in the units and axes of who sent it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RawBodyPose {
    /// Name of the rigid body.
    pub body: String,
    /// Its number, where the protocol has one.
    pub id: Option<i32>,
    /// When it was measured, on the device's clock, ns.
    pub stamp: Nanos,
    /// When it arrived, on this machine's clock, ns.
    pub arrival: Nanos,
    /// Origin, in the device's unit.
    pub position: [f64; 3],
    /// Attitude, x, y, z, w.
    pub quaternion: [f64; 4],
    /// False where the system says that it does not see the body; the pose is then its last, or nothing.
    pub tracked: bool,
}

/// The pose of a body in the frame `tracking`: metres, z up, right-handed.
#[derive(Clone, Debug, PartialEq)]
pub struct BodySample {
    /// Name of the rigid body.
    pub body: String,
    /// Its number, where the protocol has one.
    pub id: Option<i32>,
    /// When it was measured, on the device's clock, ns.
    pub stamp: Nanos,
    /// When it arrived, on this machine's clock, ns.
    pub arrival: Nanos,
    /// `tracking_from_body`.
    pub pose: Pose,
    /// False where the system says that it does not see the body.
    pub tracked: bool,
}

/// Which axis of a device's frame points up.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum UpAxis {
    /// x is up: y becomes x, z becomes y.
    X,
    /// y is up, as Motive sends it: x stays, z becomes -y.
    Y,
    /// z is up: nothing is turned.
    #[default]
    Z,
}

/// Axes and unit of a tracking system, as the laboratory declares them.
///
/// ```
/// use proact_localization::{RawBodyPose, TrackingAxes, UpAxis};
/// let motive = TrackingAxes { up: UpAxis::Y, meters_per_unit: 1.0 };
/// let raw = RawBodyPose {
///     body: "Shoulderpad".into(), id: None, stamp: 0, arrival: 0,
///     position: [0.2, 1.4, -0.3], quaternion: [0.0, 0.0, 0.0, 1.0], tracked: true,
/// };
/// let place = motive.convert(&raw)?.pose.translation.vector;
/// assert!((place - nalgebra::vector![0.2, 0.3, 1.4]).norm() < 1e-12);
/// # Ok::<(), proact_localization::PoseFault>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TrackingAxes {
    /// Which axis points up.
    pub up: UpAxis,
    /// Length of the device's unit, m: 0.001 where it sends millimetres.
    #[serde(rename = "metres_per_unit")]
    pub meters_per_unit: f64,
}

impl Default for TrackingAxes {
    fn default() -> Self {
        Self { up: UpAxis::Z, meters_per_unit: 1.0 }
    }
}

impl TrackingAxes {
    /// The sample in metres with z up. Frame and body are turned alike: a body whose axes are the device's keeps that, so
    /// "no rotation" stays no rotation.
    ///
    /// # Errors
    /// [`PoseFault`] for numbers that are not finite, a quaternion that is no rotation, a place beyond a kilometre, which is
    /// named as millimetres where it would be that of a person in these.
    pub fn convert(&self, raw: &RawBodyPose) -> Result<BodySample, PoseFault> {
        let device = raw_pose(raw)?;
        let turn = self.tracking_from_device();
        let position = turn * device.translation.vector * self.meters_per_unit;
        if position.norm() > MAX_POSITION_M {
            // Millimetres for metres is what this most often is: the unit is named before the distance.
            let sample = Self::sample(raw, Pose::from_parts(position.into(), device.rotation));
            check_length_unit(&sample, &ExpectedHeight::default())?;
            return Err(PoseFault::TooFar { body: raw.body.clone(), distance_m: position.norm() });
        }
        let rotation = turn * device.rotation * turn.inverse();
        Ok(Self::sample(raw, Pose::from_parts(position.into(), rotation)))
    }

    fn sample(raw: &RawBodyPose, pose: Pose) -> BodySample {
        BodySample {
            body: raw.body.clone(),
            id: raw.id,
            stamp: raw.stamp,
            arrival: raw.arrival,
            pose,
            tracked: raw.tracked,
        }
    }

    /// `tracking_from_device`.
    pub fn tracking_from_device(&self) -> UnitQuaternion<f64> {
        let rows = match self.up {
            UpAxis::X => Matrix3::new(0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0),
            UpAxis::Y => Matrix3::new(1.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 1.0, 0.0),
            UpAxis::Z => return UnitQuaternion::identity(),
        };
        UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rows))
    }
}

/// The pose in the device's own unit and axes.
pub(crate) fn raw_pose(raw: &RawBodyPose) -> Result<Pose, PoseFault> {
    let body = || raw.body.clone();
    if !raw.position.iter().chain(&raw.quaternion).all(|value| value.is_finite()) {
        return Err(PoseFault::NotFinite { body: body() });
    }
    let [x, y, z, w] = raw.quaternion;
    let rotation = Quaternion::new(w, x, y, z);
    let norm = rotation.norm();
    if (norm - 1.0).abs() > NORM_TOLERANCE {
        return Err(PoseFault::InvalidQuaternion { body: body(), norm });
    }
    let translation = Translation3::from(Vector::from(raw.position));
    Ok(Pose::from_parts(translation, UnitQuaternion::new_normalize(rotation)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    pub(crate) fn raw(position: [f64; 3], quaternion: [f64; 4]) -> RawBodyPose {
        RawBodyPose {
            body: "pad".into(),
            id: None,
            stamp: 0,
            arrival: 0,
            position,
            quaternion,
            tracked: true,
        }
    }

    proptest! {
        #[test]
        fn turning_the_axes_keeps_angles_and_lengths(
            position in prop::array::uniform3(-5.0..5.0_f64),
            axis in prop::array::uniform3(-1.0..1.0_f64),
            up in prop_oneof![Just(UpAxis::X), Just(UpAxis::Y), Just(UpAxis::Z)],
        ) {
            let turn = UnitQuaternion::from_scaled_axis(Vector::from(axis));
            let c = turn.coords;
            let axes = TrackingAxes { up, meters_per_unit: 1.0 };
            let sample = axes.convert(&raw(position, [c[0], c[1], c[2], c[3]])).unwrap();
            prop_assert!((sample.pose.translation.vector.norm() - Vector::from(position).norm()).abs() < 1e-9);
            prop_assert!((sample.pose.rotation.angle() - turn.angle()).abs() < 1e-7);
            let height = match up { UpAxis::X => position[0], UpAxis::Y => position[1], UpAxis::Z => position[2] };
            prop_assert!((sample.pose.translation.z - height).abs() < 1e-12);
        }
    }

    #[test]
    fn a_pose_that_is_none_is_refused_with_its_body() {
        let axes = TrackingAxes::default();
        let refused =
            |position, quaternion| axes.convert(&raw(position, quaternion)).unwrap_err().to_string();
        let still = [0.0, 0.0, 0.0, 1.0];
        assert!(refused([f64::NAN, 0.0, 0.0], still).contains("pad"));
        assert!(refused([0.0; 3], [0.0; 4]).contains("length 0.000, expected 1"));
        assert!(refused([0.0; 3], [0.0, 0.0, 0.0, 2.0]).contains("length 2.000"));
        assert!(refused([0.0, 9400.0, 0.0], still).contains("9400 m from the origin"));
        let millimeters = |position| axes.convert(&raw(position, still)).unwrap_err().name();
        assert_eq!(millimeters([300.0, 200.0, 1400.0]), "millimetres");
        assert_eq!(millimeters([0.0, 1400.0, 0.0]), "millimetres", "y is up, too");
        assert_eq!(millimeters([3000.0, 0.0, 0.0]), "far");
        let milli = TrackingAxes { meters_per_unit: 0.001, ..axes };
        let translation = milli.convert(&raw([0.0, 1400.0, 0.0], still)).unwrap().pose.translation;
        assert!((translation.y - 1.4).abs() < 1e-12);
    }
}
