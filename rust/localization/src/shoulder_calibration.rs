//! The shoulder under a brace: where the arm's base sits in the brace's body, and where the box stands for it.

use crate::{
    BodySample, BoxPlacement, PivotFit, PlacementError, PlacementProfile, SeatedPerson, TimedPose, fit_pivot,
    fit_sphere, pair_streams, place_box,
};
use nalgebra::{Point3, UnitQuaternion};
use proact_types::{Point, Pose, Vector};
use serde::{Deserialize, Serialize};

/// A shoulder's centre that is further than this from the brace's origin, m, is none.
const MAX_CENTER_DISTANCE_M: f64 = 0.25;
/// What is left of the circles at most, m: shoulders are no ball joints, skin moves.
const MAX_RESIDUAL_M: f64 = 0.015;

/// What is not measured, but said.
#[derive(Clone, Debug, PartialEq)]
pub struct ShoulderOptions {
    /// The arm is worn on the left.
    pub left_arm: bool,
    /// Where the person looks, counter-clockwise from the x axis of `tracking` seen from above, rad.
    pub heading_rad: f64,
    /// From the shoulder to the sagittal plane, m.
    pub half_width_m: f64,
    /// How table and box are placed.
    pub profile: PlacementProfile,
    /// How far the knees reach ahead of the shoulder, m; needed where the legs decide.
    pub legs_ahead_m: Option<f64>,
    /// Corrections by hand: box ahead, left, up, m.
    pub correction_m: [f64; 3],
}

/// What a calibration of the shoulder is good for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ShoulderVerdict {
    /// Go on.
    Good,
    /// No circles were recorded: the arm hangs on the origin of the brace's body.
    NoCircles,
    /// The circles were about one axis: where the centre lies along it is not known.
    MoveMore,
    /// They fit no joint.
    Noisy,
}

impl std::fmt::Display for ShoulderVerdict {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Good => "good",
            Self::NoCircles => {
                "good, without a functional centre: the arm hangs on the origin of the brace's body"
            }
            Self::MoveMore => {
                "move more: lift the arm ahead and to the side too; circles about one axis do not tell the centre"
            }
            Self::Noisy => "too noisy: fasten brace and arm markers, circle slowly with a stretched arm, and repeat",
        })
    }
}

/// A calibration, as it is saved.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ShoulderCalibration {
    /// Name of the brace's body.
    pub body: String,
    /// What it is good for.
    pub verdict: ShoulderVerdict,
    /// The arm is worn on the left.
    pub left_arm: bool,
    /// How much the shoulder moved while it was measured, standard deviation, m.
    pub moved_m: f64,
    /// Samples that it rests on.
    pub samples: usize,
    /// Where the arm's base sits in the brace's body.
    pub body_from_shoulder: Pose,
    /// Where table and box stand.
    pub placement: BoxPlacement,
    /// The functional centre in the brace's body, from circles of the arm.
    pub center: Option<PivotFit>,
    /// Corrections of the box by key since: ahead, left, up, m.
    #[serde(default)]
    #[serde(rename = "correction")]
    pub correction_m: [f64; 3],
}

impl ShoulderCalibration {
    /// Moves box and table by `step` (ahead, left, up, m).
    ///
    /// # Errors
    /// [`PlacementError::Correction`] where all corrections together would not be small; nothing is changed then.
    pub fn apply_correction(&mut self, step: [f64; 3]) -> Result<(), PlacementError> {
        let sum = [0, 1, 2].map(|k| self.correction_m[k] + step[k]);
        self.placement.shift(step, sum)?;
        self.correction_m = sum;
        Ok(())
    }
}

/// Calibrates from a person who sits upright (`rest`, of the brace) and, where they were recorded, circles of the upper arm
/// (`circles`: brace and arm). The base of the arm looks ahead and stands upright at rest. Circles that do not tell the centre leave
/// the base at the origin of the brace's body.
///
/// # Errors
/// [`PlacementError`], as [`place_box`].
pub fn calibrate_shoulder(
    rest: &[BodySample],
    circles: Option<(&[TimedPose], &[TimedPose])>,
    options: &ShoulderOptions,
) -> Result<ShoulderCalibration, PlacementError> {
    let tracked: Vec<&BodySample> = rest.iter().filter(|sample| sample.tracked).collect();
    let Some(first) = tracked.first() else { return Err(PlacementError::Samples { got: 0 }) };
    let (position, rotation) = mean(&tracked);
    let moved = tracked.iter().map(|sample| (sample.pose.translation.vector - position).norm_squared());
    let moved_m = (moved.sum::<f64>() / tracked.len() as f64).sqrt();

    let (center, verdict) = match circles {
        None => (None, ShoulderVerdict::NoCircles),
        Some((brace, arm)) => match center_in_brace(brace, arm) {
            None => (None, ShoulderVerdict::MoveMore),
            Some(fit) if !fit.is_well_conditioned => (Some(fit), ShoulderVerdict::MoveMore),
            Some(fit)
                if fit.residual_m > MAX_RESIDUAL_M || fit.center.coords.norm() > MAX_CENTER_DISTANCE_M =>
            {
                (Some(fit), ShoulderVerdict::Noisy)
            }
            Some(fit) => (Some(fit), ShoulderVerdict::Good),
        },
    };
    let in_brace =
        center.filter(|_| verdict == ShoulderVerdict::Good).map_or(Vector::zeros(), |fit| fit.center.coords);
    let ahead = UnitQuaternion::from_axis_angle(&Vector::z_axis(), options.heading_rad);
    let body_from_shoulder = Pose::from_parts(in_brace.into(), rotation.inverse() * ahead);

    let shoulder = Pose::from_parts(position.into(), rotation) * body_from_shoulder;
    let to_plane = if options.left_arm { -options.half_width_m } else { options.half_width_m };
    let midline = Point::from(shoulder.translation.vector + ahead * Vector::y() * to_plane);
    let person = SeatedPerson {
        midline,
        ahead: ahead * Vector::x(),
        legs_ahead_m: options.legs_ahead_m,
        correction_m: options.correction_m,
    };
    let placement = place_box(rest, &body_from_shoulder, &person, &options.profile)?;
    Ok(ShoulderCalibration {
        body: first.body.clone(),
        verdict,
        left_arm: options.left_arm,
        moved_m,
        samples: tracked.len(),
        body_from_shoulder,
        placement,
        center,
        correction_m: options.correction_m,
    })
}

fn mean(samples: &[&BodySample]) -> (Vector, UnitQuaternion<f64>) {
    let count = samples.len() as f64;
    let position = samples.iter().map(|sample| sample.pose.translation.vector).sum::<Vector>() / count;
    let first = samples[0].pose.rotation;
    // Of turns about the first: small, as a person who sits still has them.
    let turn =
        samples.iter().map(|sample| (sample.pose.rotation * first.inverse()).scaled_axis()).sum::<Vector>();
    (position, UnitQuaternion::from_scaled_axis(turn / count) * first)
}

/// The centre that the arm turns about, seen from the brace: by attitudes where the arm's body has any, else by a sphere through
/// its places.
fn center_in_brace(brace: &[TimedPose], arm: &[TimedPose]) -> Option<PivotFit> {
    let pairs = pair_streams(arm, brace, 0.0);
    let seen: Vec<Pose> = pairs.iter().map(|pair| pair.markers.inverse() * pair.head).collect();
    let turned = seen.iter().any(|pose| seen[0].rotation.angle_to(&pose.rotation) > 0.05);
    if turned {
        return fit_pivot(&seen);
    }
    let points: Vec<Point> = seen.iter().map(|pose| Point3::from(pose.translation.vector)).collect();
    fit_sphere(&points)
}

#[cfg(test)]
mod tests {
    use super::*;

    const CENTER: Vector = Vector::new(0.02, -0.03, -0.06);

    fn options(left_arm: bool) -> ShoulderOptions {
        ShoulderOptions {
            left_arm,
            heading_rad: 0.7,
            half_width_m: 0.18,
            profile: PlacementProfile::from_name("study_2").unwrap(),
            legs_ahead_m: None,
            correction_m: [0.0; 3],
        }
    }

    /// The brace sits askew, as people put it on.
    fn brace() -> Pose {
        Pose::from_parts(Vector::new(1.0, 2.0, 1.4).into(), UnitQuaternion::from_euler_angles(0.2, -0.3, 1.0))
    }

    fn rest() -> Vec<BodySample> {
        let sample = |k: i64| BodySample {
            body: "pad".into(),
            id: None,
            stamp: k,
            arrival: k,
            pose: brace() * Pose::rotation(Vector::x() * 1e-3 * (k % 3 - 1) as f64),
            tracked: true,
        };
        (0..30).map(sample).collect()
    }

    /// Brace that sways, and arm; `turns` says whether the arm's body has attitudes, `axes` about how many it circles.
    fn circles(turns: bool, axes: usize) -> (Vec<TimedPose>, Vec<TimedPose>) {
        (0..400)
            .map(|k| {
                let t = f64::from(k) * 0.02;
                let sway = brace() * Pose::translation(0.01 * t.sin(), 0.0, 0.0);
                let side = if axes > 1 { 0.6 * (1.7 * t).cos() } else { 0.0 };
                let turn = UnitQuaternion::from_euler_angles(0.7 * t.sin(), side, 0.0);
                let position = CENTER + turn * Vector::new(0.0, 0.0, -0.2);
                let seen = if turns { turn } else { UnitQuaternion::identity() };
                let arm = sway * Pose::from_parts(position.into(), seen);
                // One marker has no attitude of its own: that of the brace.
                (TimedPose { stamp_secs: t, pose: sway }, TimedPose { stamp_secs: t, pose: arm })
            })
            .unzip()
    }

    #[test]
    fn the_base_sits_at_the_centre_of_the_arms_circles_upright_and_ahead_on_either_side() {
        for (left_arm, left) in [(false, -1.0), (true, 1.0)] {
            for turns in [true, false] {
                let (pad, arm) = circles(turns, 2);
                let found = calibrate_shoulder(&rest(), Some((&pad, &arm)), &options(left_arm)).unwrap();
                assert_eq!(found.verdict, ShoulderVerdict::Good, "{found:?}");
                assert!((found.body_from_shoulder.translation.vector - CENTER).norm() < 1e-3, "{found:?}");
                let is = found.placement.world_from_tracking * brace() * found.body_from_shoulder;
                assert!(
                    (is.translation.vector - Vector::new(-0.6, left * 0.18, 1.445)).norm() < 1e-3,
                    "{is}"
                );
                assert!(is.rotation.angle() < 2e-3, "{is}");
            }
        }
    }

    #[test]
    fn a_box_that_is_moved_by_key_is_where_one_is_that_was_placed_so_and_goes_no_further_than_ten_centimetres()
     {
        let mut found = calibrate_shoulder(&rest(), None, &options(false)).unwrap();
        for step in [[0.02, 0.0, 0.0], [0.0, -0.01, 0.0], [0.0, 0.0, 0.03]] {
            found.apply_correction(step).unwrap();
        }
        let shoulder_options = ShoulderOptions { correction_m: [0.02, -0.01, 0.03], ..options(false) };
        let placed = calibrate_shoulder(&rest(), None, &shoulder_options).unwrap();
        let off = found.placement.world_from_tracking.inverse() * placed.placement.world_from_tracking;
        assert!(off.translation.vector.norm() < 1e-9 && off.rotation.angle() < 1e-9, "{off}");
        let shoulders = [&found, &placed].map(|found| found.placement.world_from_shoulder.translation.vector);
        assert!((shoulders[0] - shoulders[1]).norm() < 1e-9, "{shoulders:?}");
        assert!((found.placement.box_ahead_m - placed.placement.box_ahead_m).abs() < 1e-12);
        let before = found.clone();
        let error = found.apply_correction([0.09, 0.0, 0.0]).unwrap_err().to_string();
        assert!(error.contains("0.11 m") && found == before, "{error}");
    }

    #[test]
    fn circles_about_one_axis_ask_for_more_and_without_any_the_brace_is_the_shoulder() {
        let (pad, arm) = circles(true, 1);
        let found = calibrate_shoulder(&rest(), Some((&pad, &arm)), &options(false)).unwrap();
        assert_eq!(found.verdict, ShoulderVerdict::MoveMore);
        assert_eq!(found.body_from_shoulder.translation.vector, Vector::zeros());
        let found = calibrate_shoulder(&rest(), None, &options(false)).unwrap();
        assert_eq!((found.verdict, found.center), (ShoulderVerdict::NoCircles, None));
        let error = calibrate_shoulder(&[], None, &options(false)).unwrap_err();
        assert_eq!(error, PlacementError::Samples { got: 0 });
    }
}
