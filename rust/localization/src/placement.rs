//! Where table and box stand for this person: below the measured shoulder, ahead of it, on the sagittal plane.

use crate::BodySample;
use nalgebra::UnitQuaternion;
use proact_types::{Point, Pose, Vector};
use serde::{Deserialize, Serialize};

/// Height of the table's top in `world`, m, and half the depth of the box, m (the original's world; see the task's scene).
const TABLE_TOP_M: f64 = 1.015;
/// Corrections by key go no further than this, m: beyond, the posture was wrong.
const MAX_CORRECTION_M: f64 = 0.1;
/// A shoulder that moves more than this, standard deviation in m, is not held still.
const MAX_MOTION_SD_M: f64 = 0.01;
/// Samples that a measurement takes at least.
const MIN_SAMPLES: usize = 20;

/// Size of the shoulder brace.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum BraceSize {
    /// `Shoulderpad`.
    #[default]
    Medium,
    /// `ShoulderpadL`.
    Large,
}

impl BraceSize {
    /// The rigid body's name in the original's tracking software: that of the brace which is worn, in every use.
    pub fn body_name(self) -> &'static str {
        match self {
            Self::Medium => "Shoulderpad",
            Self::Large => "ShoulderpadL",
        }
    }
}

/// How table and box are placed. Metres.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlacementProfile {
    /// As chosen.
    pub name: String,
    /// From the shoulder down to the table's top.
    pub table_below_shoulder_m: f64,
    /// From the shoulder ahead to the box's centre; none where the legs decide.
    pub box_ahead_m: Option<f64>,
    /// The nearest that the box's centre may be to the front of the legs.
    pub box_clear_of_legs_m: f64,
    /// How far the partition is to the left of the sagittal plane.
    pub partition_left_m: f64,
}

impl PlacementProfile {
    /// `study_1`: as near as the legs allow; `study_2`: 0.60 m ahead (both from the paper, "Anthropometric adjustment");
    /// `original`: what the original's code comes to, 0.507 m ahead, 0.431 m below, the partition 38 mm off (its side is that
    /// of the board and assumed to be left).
    pub fn from_name(name: &str) -> Option<Self> {
        let (below, ahead, left) = match name {
            "study_1" => (0.43, None, 0.0),
            "study_2" => (0.43, Some(0.6), 0.0),
            "original" => (0.431, Some(0.507), 0.038),
            _ => return None,
        };
        Some(Self {
            name: name.to_owned(),
            table_below_shoulder_m: below,
            box_ahead_m: ahead,
            // Half the depth of the box, assumed 0.15 m, and a hand's breadth.
            box_clear_of_legs_m: 0.23,
            partition_left_m: left,
        })
    }
}

/// What was measured of the person, in `tracking`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SeatedPerson {
    /// A point of the sagittal plane: the middle between both shoulders, or the reference board.
    pub midline: Point,
    /// Ahead, level; of any length.
    pub ahead: Vector,
    /// How far the knees reach ahead of the shoulder, m; needed where no distance is given.
    pub legs_ahead_m: Option<f64>,
    /// Corrections by key: ahead, left, up, m.
    pub correction_m: [f64; 3],
}

/// Where the box stands.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct BoxPlacement {
    /// `world` stands below the box's centre.
    pub world_from_tracking: Pose,
    /// `world_from_shoulder` as measured, upright.
    pub world_from_shoulder: Pose,
    /// By which profile.
    pub profile: PlacementProfile,
    /// From the shoulder ahead to the box's centre, m.
    pub box_ahead_m: f64,
}

impl BoxPlacement {
    /// Moves box and table by `step` (ahead, left, up, m); `sum` is all that they were moved by then.
    ///
    /// # Errors
    /// [`PlacementError::Correction`] for a sum that is not small.
    pub(crate) fn shift(&mut self, step: [f64; 3], sum: [f64; 3]) -> Result<(), PlacementError> {
        check_correction(&sum)?;
        // `world` goes with the box, so all else goes the other way.
        let back = Pose::translation(-step[0], -step[1], -step[2]);
        self.world_from_tracking = back * self.world_from_tracking;
        self.world_from_shoulder = back * self.world_from_shoulder;
        self.box_ahead_m += step[0];
        Ok(())
    }
}

fn check_correction(correction: &[f64; 3]) -> Result<(), PlacementError> {
    let largest = correction.iter().fold(0.0_f64, |max, v| max.max(v.abs()));
    if largest > MAX_CORRECTION_M || correction.iter().any(|v| v.is_nan()) {
        return Err(PlacementError::Correction { got: largest });
    }
    Ok(())
}

/// Why nothing is placed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PlacementError {
    /// Too few samples.
    #[error(
        "{got} tracked samples of the shoulder, expected at least {MIN_SAMPLES}; hold still for a second in view of the cameras"
    )]
    Samples {
        /// How many.
        got: usize,
    },
    /// The person moved.
    #[error(
        "the shoulder moved by {got_mm:.0} mm while it was measured, expected at most 10; sit upright, hold still and repeat"
    )]
    ShoulderMoved {
        /// Standard deviation, mm.
        got_mm: f64,
    },
    /// The brace is tilted against the vertical.
    #[error(
        "the brace leans by {got_deg:.0} degrees, expected at most {max_tilt_deg:.0}; sit upright, or put the brace straight"
    )]
    BraceTilted {
        /// degrees.
        got_deg: f64,
        /// degrees.
        max_tilt_deg: f64,
    },
    /// No direction.
    #[error("ahead is {got:?}, expected a direction that is not vertical")]
    InvalidForward {
        /// As given.
        got: [f64; 3],
    },
    /// Nothing says how near the box may be.
    #[error(
        "profile {profile:?} places the box as near as the legs allow; measure how far the knees reach ahead of the shoulder"
    )]
    MissingLegDistance {
        /// Its name.
        profile: String,
    },
    /// More than a small correction.
    #[error("a correction of {got:.2} m, expected at most {MAX_CORRECTION_M} m; measure the shoulder anew")]
    Correction {
        /// m.
        got: f64,
    },
}

/// An upright brace leans by at most this, degrees.
const MAX_TILT_DEG: f64 = 15.0;

/// Places table and box for a person who sits upright. `samples`: about a second of the brace; `body_from_base` takes the arm's
/// base to the brace's body, and with a functional centre ([`crate::fit_pivot`]) its place is that centre in the body.
///
/// # Errors
/// [`PlacementError`]: posture, too few samples, a direction that is none, a correction that is not small.
pub fn place_box(
    samples: &[BodySample],
    body_from_base: &Pose,
    person: &SeatedPerson,
    profile: &PlacementProfile,
) -> Result<BoxPlacement, PlacementError> {
    let shoulders: Vec<Pose> =
        samples.iter().filter(|sample| sample.tracked).map(|sample| sample.pose * body_from_base).collect();
    let count = shoulders.len();
    if count < MIN_SAMPLES {
        return Err(PlacementError::Samples { got: count });
    }
    let position = shoulders.iter().map(|pose| pose.translation.vector).sum::<Vector>() / count as f64;
    let spread =
        shoulders.iter().map(|pose| (pose.translation.vector - position).norm_squared()).sum::<f64>();
    let moved = (spread / count as f64).sqrt();
    if moved > MAX_MOTION_SD_M {
        return Err(PlacementError::ShoulderMoved { got_mm: moved * 1000.0 });
    }
    let rotation = UnitQuaternion::new_normalize(nalgebra::Quaternion::from(
        shoulders
            .iter()
            .map(|pose| {
                let c = pose.rotation.coords;
                if c.dot(&shoulders[0].rotation.coords) < 0.0 { -c } else { c }
            })
            .sum::<nalgebra::Vector4<f64>>(),
    ));
    let lean = (rotation * Vector::z()).angle(&Vector::z()).to_degrees();
    if lean > MAX_TILT_DEG {
        return Err(PlacementError::BraceTilted { got_deg: lean, max_tilt_deg: MAX_TILT_DEG });
    }
    let ahead = Vector::new(person.ahead.x, person.ahead.y, 0.0);
    let level = ahead.norm() > 0.1 * person.ahead.norm();
    if !level {
        return Err(PlacementError::InvalidForward { got: person.ahead.into() });
    }
    check_correction(&person.correction_m)?;
    let ahead_m = match (profile.box_ahead_m, person.legs_ahead_m) {
        (Some(meters), _) => meters,
        (None, Some(legs)) => legs + profile.box_clear_of_legs_m,
        (None, None) => return Err(PlacementError::MissingLegDistance { profile: profile.name.clone() }),
    };
    let ahead = ahead.normalize();
    let left = Vector::z().cross(&ahead);
    let [further, to_left, up] = person.correction_m;
    // The box's centre: ahead of the shoulder, sideways on the sagittal plane.
    let on_plane = (person.midline.coords - position).dot(&left) + profile.partition_left_m + to_left;
    let center = position + ahead * (ahead_m + further) + left * on_plane;
    let floor = position.z - profile.table_below_shoulder_m + up - TABLE_TOP_M;
    let turn = UnitQuaternion::from_axis_angle(&Vector::z_axis(), ahead.y.atan2(ahead.x));
    let tracking_from_world = Pose::from_parts(Vector::new(center.x, center.y, floor).into(), turn);
    let world_from_tracking = tracking_from_world.inverse();
    Ok(BoxPlacement {
        world_from_tracking,
        world_from_shoulder: world_from_tracking * Pose::from_parts(position.into(), rotation),
        profile: profile.clone(),
        box_ahead_m: ahead_m + further,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn samples(pose: Pose) -> Vec<BodySample> {
        let sample =
            |k: i64| BodySample { body: "pad".into(), id: None, stamp: k, arrival: k, pose, tracked: true };
        (0..30).map(sample).collect()
    }

    fn seated(yaw: f64, side: f64) -> (Vec<BodySample>, SeatedPerson) {
        let turn = UnitQuaternion::from_axis_angle(&Vector::z_axis(), yaw);
        let midline = Point::new(1.0, 2.0, 1.3);
        let shoulder = midline.coords + turn * Vector::new(0.0, side * 0.18, 0.0);
        let person =
            SeatedPerson { midline, ahead: turn * Vector::x(), legs_ahead_m: None, correction_m: [0.0; 3] };
        (samples(Pose::from_parts(shoulder.into(), turn)), person)
    }

    proptest! {
        #[test]
        fn the_second_study_is_the_seated_set_up_wherever_the_person_faces(yaw in -3.1..3.1_f64, right in any::<bool>()) {
            let side = if right { -1.0 } else { 1.0 };
            let (samples, person) = seated(yaw, side);
            let profile = PlacementProfile::from_name("study_2").unwrap();
            let placed = place_box(&samples, &Pose::identity(), &person, &profile).unwrap();
            let is = placed.world_from_shoulder;
            prop_assert!((is.translation.vector - Vector::new(-0.6, side * 0.18, 1.445)).norm() < 1e-9, "{is}");
            prop_assert!(is.rotation.angle() < 1e-6);
        }
    }

    #[test]
    fn each_profile_has_its_distances_and_the_legs_decide_where_none_is_given() {
        let (samples, mut person) = seated(0.3, -1.0);
        let mut add_finding = |name: &str, legs| {
            person.legs_ahead_m = legs;
            place_box(&samples, &Pose::identity(), &person, &PlacementProfile::from_name(name).unwrap())
        };
        let original = add_finding("original", None).unwrap().world_from_shoulder.translation.vector;
        assert!((original - Vector::new(-0.507, -0.218, 1.446)).norm() < 1e-9, "{original}");
        assert_eq!(
            add_finding("study_1", None).unwrap_err(),
            PlacementError::MissingLegDistance { profile: "study_1".into() }
        );
        assert!((add_finding("study_1", Some(0.2)).unwrap().box_ahead_m - 0.43).abs() < 1e-12);
        assert_eq!(PlacementProfile::from_name("study_3"), None);
        assert_eq!(BraceSize::Large.body_name(), "ShoulderpadL");
    }

    #[test]
    fn a_bad_posture_and_large_corrections_are_refused_with_what_to_do() {
        let profile = PlacementProfile::from_name("study_2").unwrap();
        let (good, person) = seated(0.0, -1.0);
        let shoulder_position = |samples: &[BodySample], person: &SeatedPerson| {
            place_box(samples, &Pose::identity(), person, &profile).unwrap_err().to_string()
        };
        let leaning = samples(Pose::rotation(Vector::y() * 0.4) * good[0].pose);
        assert!(shoulder_position(&leaning, &person).contains("sit upright"));
        let mut moving = good.clone();
        for (k, sample) in moving.iter_mut().enumerate() {
            sample.pose.translation.x += 0.005 * k as f64;
        }
        assert!(shoulder_position(&moving, &person).contains("hold still"));
        assert!(shoulder_position(&good[..5], &person).contains("expected at least 20"));
        let up = SeatedPerson { ahead: Vector::z(), ..person };
        assert!(shoulder_position(&good, &up).contains("not vertical"));
        for correction in [[0.2, 0.0, 0.0], [f64::NAN, 0.0, 0.0]] {
            assert!(
                shoulder_position(&good, &SeatedPerson { correction_m: correction, ..person })
                    .contains("measure the shoulder anew")
            );
        }
    }
}
