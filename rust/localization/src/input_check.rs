//! What a tracking system gets wrong, by name: found in one pose, in a stream, or in a few seconds of movement.

use crate::{BodySample, Nanos, RawBodyPose, pivot::fit_pivot, tracking::raw_pose};
use proact_types::{Pose, Vector};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Poses of one stamp that differ by more than this are of two bodies, in the device's unit and rad.
const SAME_POSE_TOLERANCE: f64 = 1e-6;
/// Bodies at most: a fault that makes up names does not fill the memory.
const MAX_BODIES: usize = 1024;
/// Turned by less than this in all, rad, nothing can be said about the hand of the axes.
const MIN_ROTATION_RAD: f64 = 0.35;
/// Mirrored axes fit a movement about a pivot this many times better than those that are not, or nothing is said.
const MIN_MIRROR_RESIDUAL_RATIO: f64 = 4.0;

/// Why what a tracking system says is refused.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PoseFault {
    /// NaN or infinity.
    #[error(
        "body {body:?}: a coordinate is not finite; expected seven finite numbers. Check that the system tracks the body"
    )]
    NotFinite {
        /// Whose.
        body: String,
    },
    /// A quaternion of zeros, or of another length than 1.
    #[error(
        "body {body:?}: a quaternion of length {norm:.3}, expected 1. Zeros are what some systems send for a body they \
         do not see: turn that off, or let the source mark it as not tracked"
    )]
    InvalidQuaternion {
        /// Whose.
        body: String,
        /// Length of the quaternion.
        norm: f64,
    },
    /// Further than anything in a laboratory.
    #[error(
        "body {body:?}: {distance_m:.0} m from the origin, expected at most 1000 m. Check the declared unit of length"
    )]
    TooFar {
        /// Whose.
        body: String,
        /// m.
        distance_m: f64,
    },
    /// A stamp before the one before.
    #[error(
        "body {body:?}: its time went back by {back_secs:.3} s, expected stamps that rise. The device's clock was set or \
         its recording started again: calibrate anew"
    )]
    TimeWentBack {
        /// Whose.
        body: String,
        /// s.
        back_secs: f64,
    },
    /// The same name with another number than before.
    #[error(
        "body {body:?}: its number was {was} and is {is} now. It was defined anew in the tracking software, perhaps with \
         another pivot: restart the source and calibrate anew"
    )]
    IdChanged {
        /// Whose.
        body: String,
        /// Before.
        was: i32,
        /// Now.
        is: i32,
    },
    /// Two poses of one stamp under one name.
    #[error(
        "body {body:?}: two bodies have this name, {distance:.3} units apart at one time. Rename one of them in the tracking \
         software"
    )]
    TwoBodiesOneName {
        /// Whose.
        body: String,
        /// In the device's unit.
        distance: f64,
    },
    /// Numbers a thousand times too large.
    #[error(
        "body {body:?}: {got:.0} m above the floor, expected {low} to {high} m; in millimetres it would be \
         {corrected_m:.2} m. Declare meters_per_unit = 0.001"
    )]
    Millimeters {
        /// Whose.
        body: String,
        /// As declared, m.
        got: f64,
        /// If it is millimetres, m.
        corrected_m: f64,
        /// Lowest expected, m.
        low: f64,
        /// Highest expected, m.
        high: f64,
    },
    /// Height is on another axis.
    #[error(
        "body {body:?}: z = {z:.2} m and y = {y:.2} m, expected z of {low} to {high} m above the floor. y is up: declare \
         up = \"y\""
    )]
    YUp {
        /// Whose.
        body: String,
        /// m.
        y: f64,
        /// m.
        z: f64,
        /// Lowest expected, m.
        low: f64,
        /// Highest expected, m.
        high: f64,
    },
    /// Not where a body of a person can be.
    #[error(
        "body {body:?}: {got:.2} m above the floor, expected {low} to {high} m. Set the ground plane of the tracking \
         system, or the expected height"
    )]
    Height {
        /// Whose.
        body: String,
        /// m.
        got: f64,
        /// Lowest expected, m.
        low: f64,
        /// Highest expected, m.
        high: f64,
    },
    /// A left-handed frame, or one axis with the wrong sign.
    #[error(
        "body {body:?}: places and turns do not belong together: with {axis} mirrored they fit {times:.0} times better. \
         Switch the tracking software to right-handed axes, or undo the change of sign in the program between"
    )]
    Mirrored {
        /// Whose.
        body: String,
        /// `x`, `y` or `z`.
        axis: char,
        /// How many times smaller the residual is with that axis mirrored.
        times: f64,
    },
}

impl PoseFault {
    /// A short key for pages and records.
    pub fn name(&self) -> &'static str {
        match self {
            Self::NotFinite { .. } => "not_finite",
            Self::InvalidQuaternion { .. } => "no_rotation",
            Self::TooFar { .. } => "far",
            Self::TimeWentBack { .. } => "time_back",
            Self::IdChanged { .. } => "id_changed",
            Self::TwoBodiesOneName { .. } => "two_bodies_one_name",
            Self::Millimeters { .. } => "millimetres",
            Self::YUp { .. } => "y_up",
            Self::Height { .. } => "height",
            Self::Mirrored { .. } => "mirrored",
        }
    }
}

/// Looks at every pose of one source as it comes.
#[derive(Clone, Debug, Default)]
pub struct PoseStreamCheck {
    bodies: BTreeMap<String, LastPose>,
}

#[derive(Clone, Debug)]
struct LastPose {
    stamp: Nanos,
    id: Option<i32>,
    pose: Pose,
}

impl PoseStreamCheck {
    /// A check that has seen nothing.
    pub fn new() -> Self {
        Self::default()
    }

    /// The next pose, in the order of arrival. A pose that is refused changes nothing; one that the system marks as not
    /// tracked passes, whatever its numbers are. The same pose of the same stamp once more passes too.
    ///
    /// # Errors
    /// [`PoseFault`]: not a pose, time that goes back, another number under a known name, two bodies of one name.
    pub fn check(&mut self, raw: &RawBodyPose) -> Result<(), PoseFault> {
        if !raw.tracked {
            return Ok(());
        }
        let pose = raw_pose(raw)?;
        let body = || raw.body.clone();
        if let Some(seen) = self.bodies.get(&raw.body) {
            let distance = (seen.pose.translation.vector - pose.translation.vector).norm();
            let differs = distance > SAME_POSE_TOLERANCE
                || seen.pose.rotation.angle_to(&pose.rotation) > SAME_POSE_TOLERANCE;
            if raw.stamp == seen.stamp && (differs || raw.id != seen.id) {
                return Err(PoseFault::TwoBodiesOneName { body: body(), distance });
            }
            if raw.stamp < seen.stamp {
                let back_secs = (seen.stamp - raw.stamp) as f64 * 1e-9;
                return Err(PoseFault::TimeWentBack { body: body(), back_secs });
            }
            if let (Some(was), Some(is)) = (seen.id, raw.id)
                && was != is
            {
                return Err(PoseFault::IdChanged { body: body(), was, is });
            }
        } else if self.bodies.len() >= MAX_BODIES {
            // Beyond what any laboratory has; the caller drops what nobody asked for.
            return Ok(());
        }
        self.bodies.insert(body(), LastPose { stamp: raw.stamp, id: raw.id, pose });
        Ok(())
    }

    /// Forgets a body: its source was started again and its time may begin anew.
    pub fn forget(&mut self, body: &str) {
        self.bodies.remove(body);
    }
}

/// Where a body is expected, as the laboratory declares it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ExpectedHeight {
    /// Lowest and highest above the floor, m.
    pub height_m: [f64; 2],
}

impl Default for ExpectedHeight {
    /// A shoulder or a head of somebody who sits or stands.
    fn default() -> Self {
        Self { height_m: [0.5, 2.2] }
    }
}

/// Judges unit and vertical axis from the median of some seconds of one body. Nothing is said of an empty window.
///
/// # Errors
/// [`PoseFault::Millimeters`], [`PoseFault::YUp`], [`PoseFault::Height`].
pub fn check_height(samples: &[BodySample], expected: &ExpectedHeight) -> Result<(), PoseFault> {
    let Some(first) = samples.iter().find(|sample| sample.tracked) else { return Ok(()) };
    let median = |axis: usize| {
        let tracked = samples.iter().filter(|sample| sample.tracked);
        let mut values: Vec<f64> = tracked.map(|sample| sample.pose.translation.vector[axis]).collect();
        values.sort_by(f64::total_cmp);
        values[values.len() / 2]
    };
    let [low, high] = expected.height_m;
    let within = |value: f64| (low..=high).contains(&value);
    let (y, z) = (median(1), median(2));
    let body = first.body.clone();
    if within(z) {
        return Ok(());
    }
    // Millimetres first: with both faults y is a thousand times too large as well.
    check_millimeters(&body, [z, y], expected)?;
    if within(y) {
        return Err(PoseFault::YUp { body, y, z, low, high });
    }
    Err(PoseFault::Height { body, got: z, low, high })
}

/// Judges the unit of a single pose.
///
/// # Errors
/// [`PoseFault::Millimeters`].
pub(crate) fn check_length_unit(sample: &BodySample, expected: &ExpectedHeight) -> Result<(), PoseFault> {
    let position = sample.pose.translation.vector;
    check_millimeters(&sample.body, [position.z, position.y], expected)
}

/// Refuses the first height that is one of a person if it is millimetres.
fn check_millimeters(body: &str, heights: [f64; 2], expected: &ExpectedHeight) -> Result<(), PoseFault> {
    let [low, high] = expected.height_m;
    match heights.into_iter().find(|got| (low..=high).contains(&(got / 1000.0))) {
        Some(got) => {
            Err(PoseFault::Millimeters { body: body.to_owned(), got, corrected_m: got / 1000.0, low, high })
        }
        None => Ok(()),
    }
}

/// Judges whether places and turns of one body are of one right-handed frame, from a movement about some pivot: a head that
/// nods, turns and tilts, a forearm about the elbow. `Ok(false)` says that it moved too little to tell.
///
/// A body that turns about a pivot keeps `place + turn * lever` at one point. With one axis of the places mirrored that holds
/// for no lever, and mirroring it back restores it. A frame that is mirrored in places and turns alike is a movement as good
/// as any and cannot be told from one stream; the calibration finds it against the headset's.
///
/// # Errors
/// [`PoseFault::Mirrored`].
pub fn check_handedness(samples: &[BodySample]) -> Result<bool, PoseFault> {
    let poses: Vec<Pose> = samples.iter().filter(|sample| sample.tracked).map(|sample| sample.pose).collect();
    let residual = |mirror: Vector| {
        let mirrored: Vec<Pose> = poses
            .iter()
            .map(|pose| {
                Pose::from_parts(pose.translation.vector.component_mul(&mirror).into(), pose.rotation)
            })
            .collect();
        fit_pivot(&mirrored).map(|fit| fit.residual_m)
    };
    let (Some(first), Some(as_sent)) = (poses.first(), residual(Vector::repeat(1.0))) else {
        return Ok(false);
    };
    let turned = poses.iter().map(|pose| first.rotation.angle_to(&pose.rotation)).fold(0.0, f64::max);
    if turned < MIN_ROTATION_RAD {
        return Ok(false);
    }
    for (axis, name) in ['x', 'y', 'z'].into_iter().enumerate() {
        let mut mirror = Vector::repeat(1.0);
        mirror[axis] = -1.0;
        let Some(mirrored) = residual(mirror) else { continue };
        let times = as_sent / mirrored.max(1e-9);
        if times > MIN_MIRROR_RESIDUAL_RATIO {
            return Err(PoseFault::Mirrored { body: samples[0].body.clone(), axis: name, times });
        }
    }
    Ok(true)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::UnitQuaternion;

    fn raw(stamp: Nanos, x: f64, id: i32) -> RawBodyPose {
        RawBodyPose {
            body: "pad".into(),
            id: Some(id),
            stamp,
            arrival: stamp,
            position: [x, 0.0, 1.4],
            quaternion: [0.0, 0.0, 0.0, 1.0],
            tracked: true,
        }
    }

    fn sample(pose: Pose) -> BodySample {
        BodySample { body: "head".into(), id: None, stamp: 0, arrival: 0, pose, tracked: true }
    }

    #[test]
    fn a_clean_stream_passes_and_a_repeated_packet_too() {
        let mut check = PoseStreamCheck::new();
        for stamp in [1, 2, 2, 3] {
            check.check(&raw(stamp, stamp as f64, 7)).unwrap();
        }
        let lost = RawBodyPose { quaternion: [0.0; 4], tracked: false, ..raw(4, 0.0, 7) };
        check.check(&lost).unwrap();
    }

    #[test]
    fn each_fault_of_a_stream_is_named_and_what_was_good_goes_on() {
        let mut check = PoseStreamCheck::new();
        check.check(&raw(1_000_000_000, 0.0, 7)).unwrap();
        let zero = RawBodyPose { quaternion: [0.0; 4], ..raw(2_000_000_000, 0.0, 7) };
        let nan = RawBodyPose { position: [f64::NAN; 3], ..raw(2_000_000_000, 0.0, 7) };
        for (bad, name) in [
            (zero, "no_rotation"),
            (nan, "not_finite"),
            (raw(500_000_000, 0.0, 7), "time_back"),
            (raw(1_000_000_000, 0.4, 7), "two_bodies_one_name"),
            (raw(1_000_000_000, 0.0, 8), "two_bodies_one_name"),
            (raw(2_000_000_000, 0.0, 8), "id_changed"),
        ] {
            let fault = check.check(&bad).unwrap_err();
            assert_eq!(fault.name(), name);
            assert!(fault.to_string().contains("\"pad\""), "{fault}");
        }
        check.check(&raw(2_000_000_000, 0.1, 7)).unwrap();
        check.forget("pad");
        check.check(&raw(0, 0.1, 9)).unwrap();
    }

    #[test]
    fn millimetres_and_y_up_are_told_from_a_wrong_ground_plane() {
        let name = |x: f64, y: f64, z: f64| {
            let window = vec![sample(Pose::translation(x, y, z)); 5];
            check_height(&window, &ExpectedHeight::default()).err().map(|fault| fault.name())
        };
        assert_eq!(name(0.3, -0.2, 1.4), None);
        assert_eq!(name(300.0, -200.0, 1400.0), Some("millimetres"));
        assert_eq!(name(300.0, 1400.0, 200.0), Some("millimetres"));
        assert_eq!(name(0.3, 1.4, 0.2), Some("y_up"));
        assert_eq!(name(0.3, 0.1, 3.1), Some("height"));
        assert!(check_height(&[], &ExpectedHeight::default()).is_ok());
    }

    fn nodding(mirror: Vector, noise: f64) -> Vec<BodySample> {
        let (pivot, lever) = (Vector::new(0.1, -0.3, 1.2), Vector::new(0.06, 0.02, 0.18));
        (0..200)
            .map(|k| {
                let t = f64::from(k) * 0.05;
                let turn = UnitQuaternion::from_euler_angles(
                    0.2 * t.sin(),
                    0.4 * (1.3 * t).sin(),
                    0.5 * (0.7 * t).cos(),
                );
                let tremble = Vector::new((17.0 * t).sin(), (23.0 * t).sin(), (29.0 * t).sin()) * noise;
                let position = pivot + turn * lever + tremble;
                sample(Pose::from_parts(position.component_mul(&mirror).into(), turn))
            })
            .collect()
    }

    #[test]
    fn a_mirrored_axis_is_found_in_a_nodding_head_and_named() {
        assert_eq!(check_handedness(&nodding(Vector::repeat(1.0), 0.005)), Ok(true));
        for (axis, name) in ['x', 'y', 'z'].into_iter().enumerate() {
            let mut mirror = Vector::repeat(1.0);
            mirror[axis] = -1.0;
            let fault = check_handedness(&nodding(mirror, 0.005)).unwrap_err();
            assert!(matches!(fault, PoseFault::Mirrored { axis, .. } if axis == name), "{fault}");
        }
        let still = vec![sample(Pose::translation(0.0, 0.0, 1.4)); 50];
        assert_eq!(check_handedness(&still), Ok(false));
    }
}
