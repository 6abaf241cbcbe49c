//! From a minute of free head movement: where the marker body sits on the headset, and where the headset's world is in the
//! room.
//!
//! Letters: `H` the headset's world, `E` the headset, `T` tracking, `K` the marker body on the headset. At each time
//! `H_from_E * X = Y * T_from_K` with `X = E_from_K` and `Y = H_from_T`: the robot-world form `A X = Y B`. Over two times it
//! is `A X = X B`.

use crate::{
    hand_eye_fit::{HandEyeFit, refine},
    observability::{HeadAxis, Observability},
};
use nalgebra::{Matrix3, SVD, UnitQuaternion};
use proact_types::{Pose, Vector};
use serde::{Deserialize, Serialize};

/// A pose with its time, s, on whichever clock its device has.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TimedPose {
    /// s.
    pub stamp_secs: f64,
    /// In the world of its device.
    pub pose: Pose,
}

/// Both poses of one moment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PosePair {
    /// On the headset's clock, s.
    pub stamp_secs: f64,
    /// `headset_world_from_head`.
    pub head: Pose,
    /// `tracking_from_markers`.
    pub markers: Pose,
}

/// What a calibration may assume.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct HeadsetCalibrationOptions {
    /// Pairs in a second that are used; the rest adds little but time.
    pub pairs_hz: f64,
    /// Markers and headset turn on one clock to within this, s: it is searched that far.
    pub clock_search_secs: f64,
    /// A calibration whose place is less sure than this, m (one standard deviation), asks for more motion.
    #[serde(rename = "sure_m")]
    pub max_position_sd_m: f64,
    /// The same for its attitude, degrees.
    #[serde(rename = "sure_deg")]
    pub max_rotation_sd_deg: f64,
    /// Residuals above this, m, are those of markers that moved, or of a disturbed system.
    #[serde(rename = "residual_m")]
    pub max_residual_m: f64,
    /// The same for turns, degrees.
    #[serde(rename = "residual_deg")]
    pub max_residual_deg: f64,
}

impl Default for HeadsetCalibrationOptions {
    fn default() -> Self {
        Self {
            pairs_hz: 20.0,
            clock_search_secs: 0.2,
            max_position_sd_m: 0.001,
            max_rotation_sd_deg: 0.1,
            max_residual_m: 0.008,
            max_residual_deg: 1.0,
        }
    }
}

/// What a calibration is good for.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "verdict", rename_all = "snake_case")]
pub enum HeadsetCalibrationVerdict {
    /// Go on.
    Good,
    /// The head has not turned enough about this axis.
    MoveMore {
        /// About which.
        axis: HeadAxis,
    },
    /// The marker body sat elsewhere on the headset before than after.
    MarkersSlipped {
        /// About when, s on the headset's clock.
        at_secs: f64,
    },
    /// What is left is too much for either.
    Noisy,
}

impl std::fmt::Display for HeadsetCalibrationVerdict {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Good => write!(f, "good"),
            Self::MoveMore { axis } => write!(f, "move more: {axis}"),
            Self::MarkersSlipped { at_secs } => write!(
                f,
                "the markers slipped on the headset at {at_secs:.0} s: fasten them and repeat the calibration"
            ),
            Self::Noisy => {
                write!(
                    f,
                    "too noisy: look for markers that are hidden or reflect, and repeat the calibration"
                )
            }
        }
    }
}

/// Why there is no calibration.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum HeadsetCalibrationError {
    /// Too little in common.
    #[error(
        "{got} pairs of headset and markers at the same time, expected at least {required}; record both for a minute, and check \
         that their times are of one clock to within {search_secs} s"
    )]
    TooFewPairs {
        /// How many there are.
        got: usize,
        /// How many are needed.
        required: usize,
        /// s.
        search_secs: f64,
    },
    /// The head did not turn.
    #[error(
        "the head turned by {got_deg:.1} degrees at most, expected at least {required_deg:.0}; nod, turn and tilt the head slowly \
         for a minute"
    )]
    TooLittleRotation {
        /// degrees.
        got_deg: f64,
        /// degrees.
        required_deg: f64,
    },
    /// Another unit of length.
    #[error(
        "a length of the markers is {scale:.4} of the headset's, expected 1; declare meters_per_unit = {unit} for the \
         tracking system"
    )]
    Scale {
        /// Markers over headset.
        scale: f64,
        /// What to declare.
        unit: f64,
    },
    /// One of the two frames is left-handed.
    #[error(
        "headset and markers agree {times:.0} times better with one of them mirrored: one sends left-handed axes. Switch the \
         tracking software, or the program that sends the headset's pose, to right-handed axes"
    )]
    Mirrored {
        /// How many times smaller the residual is.
        times: f64,
    },
    /// No numbers.
    #[error("a pose is not finite, or times do not rise")]
    NotFinite,
}

/// A calibration, as it is saved.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct HeadsetCalibration {
    /// `X`: where the marker body sits on the headset.
    pub head_from_markers: Pose,
    /// `Y` at the end of the recording: the headset's world in the room.
    pub headset_world_from_tracking: Pose,
    /// Drift of the headset's world over the recording: m/s in the headset's world, as a fit of constant speed says.
    pub drift_m_per_s: Vector,
    /// What is added to a stamp of the markers to be on the headset's clock, s.
    pub clock_offset_secs: f64,
    /// The end of the recording, s on the headset's clock.
    pub end_secs: f64,
    /// Middle of the head's places in `tracking`, m: corrections of drift turn about it.
    #[serde(rename = "head_place")]
    pub head_position: Vector,
    /// Root mean square of the places that count, m.
    pub residual_m: f64,
    /// The same of the turns, degrees.
    pub residual_deg: f64,
    /// Pairs used.
    pub pairs: usize,
    /// Of these, how many count for nearly nothing.
    pub rejected: usize,
    /// How well it is known.
    pub observability: Observability,
    /// What it is good for.
    #[serde(flatten)]
    pub verdict: HeadsetCalibrationVerdict,
}

const MIN_PAIRS: usize = 60;
const MIN_ROTATION_DEG: f64 = 10.0;
/// Between two times whose relative motion is used, the head turned by this much at least, rad.
const MIN_RELATIVE_ROTATION_RAD: f64 = 0.15;
/// A gap between two poses that is interpolated at most, s.
const MAX_GAP_SECS: f64 = 0.06;
/// Units of length that are taken for metres by mistake, m: mm, cm, inch, foot, and metres where the headset sends mm or cm.
const UNITS_M: [f64; 6] = [0.001, 0.01, 0.0254, 0.3048, 1000.0, 100.0];
/// Share by which a length may differ from that of a unit.
const SCALE_TOLERANCE: f64 = 0.1;
const MIN_MIRROR_RESIDUAL_RATIO: f64 = 3.0;
/// Of the search for the clocks' offset, s.
const GRID_SECS: f64 = 0.005;
/// Most times that pairs are made anew.
const CLOCK_ROUNDS: usize = 4;

/// Pairs each pose of the headset with that of the markers at its time, by interpolation; none across a gap of more than
/// 60 ms. `offset_secs` is added to the stamps of the markers. Both are in the order of their stamps.
pub fn pair_streams(head: &[TimedPose], markers: &[TimedPose], offset_secs: f64) -> Vec<PosePair> {
    let mut pairs = Vec::new();
    let mut next = 0;
    for at in head {
        while next < markers.len() && markers[next].stamp_secs + offset_secs < at.stamp_secs {
            next += 1;
        }
        let (Some(before), Some(after)) = (next.checked_sub(1).map(|k| &markers[k]), markers.get(next))
        else {
            continue;
        };
        let gap = after.stamp_secs - before.stamp_secs;
        if gap > MAX_GAP_SECS {
            continue;
        }
        let share = (at.stamp_secs - before.stamp_secs - offset_secs) / gap;
        if let Some(pose) = before.pose.try_lerp_slerp(&after.pose, share, 1e-9) {
            pairs.push(PosePair { stamp_secs: at.stamp_secs, head: at.pose, markers: pose });
        }
    }
    pairs
}

/// Calibrates from two streams of the same minute.
///
/// Starts with the rotation of `A X = X B` by Park & Martin 1994 ("Robot sensor calibration: solving AX = XB on the Euclidean
/// group", IEEE Trans Robot Autom 10:717) over relative motions whose angles agree (the screw congruence of Chen 1991), then
/// its translation by linear least squares; closes `Y` over all pairs; and refines X, Y, a drift of constant speed and the
/// offset of the clocks together by Gauss-Newton with Tukey's weights. Of closed forms Shah 2013 ("Solving the
/// robot-world/hand-eye calibration problem using the Kronecker product", J Mech Robot 5:031007) would do as well for the
/// start; what is refined does not depend on it. Deterministic: nothing is drawn.
///
/// # Errors
/// [`HeadsetCalibrationError`]: too few pairs, a still head, another unit, mirrored axes, numbers that are none.
pub fn calibrate_headset(
    head: &[TimedPose],
    markers: &[TimedPose],
    options: &HeadsetCalibrationOptions,
) -> Result<HeadsetCalibration, HeadsetCalibrationError> {
    for stream in [head, markers] {
        let finite = |timed: &TimedPose| {
            timed.stamp_secs.is_finite() && timed.pose.to_homogeneous().iter().all(|v| v.is_finite())
        };
        if !stream.iter().all(finite) || stream.windows(2).any(|two| two[1].stamp_secs < two[0].stamp_secs) {
            return Err(HeadsetCalibrationError::NotFinite);
        }
    }
    let mut offset = clock_offset(head, markers, options.clock_search_secs);
    let (mut pairs, mut fit) = fit_with_clock_offset(head, markers, offset, options)?;
    // The refinement takes the markers' motion around a pair for even, which it is for some milliseconds: where the search was
    // off by more, pairs are made anew.
    for _ in 0..CLOCK_ROUNDS {
        let better = offset + fit.offset_secs;
        if fit.offset_secs.abs() <= GRID_SECS || better.abs() > options.clock_search_secs {
            break;
        }
        offset = better;
        (pairs, fit) = fit_with_clock_offset(head, markers, offset, options)?;
    }
    check_mirrored(&pairs, &fit)?;
    let observability = Observability::from_fit(&pairs, &fit);
    let verdict = assess_calibration(&pairs, &fit, &observability, options);
    let middle =
        pairs.iter().map(|pair| pair.markers.translation.vector).sum::<Vector>() / pairs.len() as f64;
    Ok(HeadsetCalibration {
        head_from_markers: fit.x,
        headset_world_from_tracking: fit.y,
        drift_m_per_s: fit.drift,
        clock_offset_secs: offset + fit.offset_secs,
        end_secs: fit.end_secs,
        head_position: middle,
        residual_m: fit.residual_m,
        residual_deg: fit.residual_rad.to_degrees(),
        pairs: pairs.len(),
        rejected: fit.weights.iter().filter(|weight| **weight < 0.1).count(),
        observability,
        verdict,
    })
}

/// The fit to the pairs that this offset of the clocks makes.
fn fit_with_clock_offset(
    head: &[TimedPose],
    markers: &[TimedPose],
    offset: f64,
    options: &HeadsetCalibrationOptions,
) -> Result<(Vec<PosePair>, HandEyeFit), HeadsetCalibrationError> {
    let all = pair_streams(head, markers, offset);
    if all.len() < MIN_PAIRS {
        let search_secs = options.clock_search_secs;
        return Err(HeadsetCalibrationError::TooFewPairs {
            got: all.len(),
            required: MIN_PAIRS,
            search_secs,
        });
    }
    let turned =
        all.iter().map(|pair| all[0].head.rotation.angle_to(&pair.head.rotation)).fold(0.0, f64::max);
    if turned.to_degrees() < MIN_ROTATION_DEG {
        return Err(HeadsetCalibrationError::TooLittleRotation {
            got_deg: turned.to_degrees(),
            required_deg: MIN_ROTATION_DEG,
        });
    }
    let pairs = downsample_pairs(&all, options.pairs_hz);
    let (x, scale) = initial_estimate(&pairs)?;
    // Of data that do not belong together any scale may come out: only that of a unit somebody uses is taken for one.
    let unit = UNITS_M.into_iter().find(|unit| (scale * unit - 1.0).abs() < SCALE_TOLERANCE);
    if let Some(unit) = unit {
        return Err(HeadsetCalibrationError::Scale { scale, unit });
    }
    let fit = refine(&pairs, x);
    Ok((pairs, fit))
}

/// The original's calibration: `Y` from one sample of each, with `X` known (`shoulder_localization/fix_world`).
pub fn calibrate_headset_from_one_pair(head_from_markers: &Pose, head: &Pose, markers: &Pose) -> Pose {
    head * head_from_markers * markers.inverse()
}

/// Evenly in time, at most so many a second.
fn downsample_pairs(pairs: &[PosePair], hz: f64) -> Vec<PosePair> {
    let mut due = f64::NEG_INFINITY;
    let mut kept = Vec::new();
    for pair in pairs {
        if pair.stamp_secs >= due {
            kept.push(*pair);
            due = pair.stamp_secs + 1.0 / hz - 1e-6;
        }
    }
    kept
}

/// What to add to the markers' stamps: where the angular speeds of both agree best, over a grid. The refinement finds the rest.
fn clock_offset(head: &[TimedPose], markers: &[TimedPose], search_secs: f64) -> f64 {
    // Over 40 ms: the noise of a single difference would drown the motion.
    let speeds = |stream: &[TimedPose]| -> Vec<(f64, f64)> {
        let mut later = 0;
        let mut speeds = Vec::new();
        for first in stream {
            while later < stream.len() && stream[later].stamp_secs < first.stamp_secs + 0.04 {
                later += 1;
            }
            let Some(second) = stream.get(later) else { break };
            let secs = second.stamp_secs - first.stamp_secs;
            if secs < MAX_GAP_SECS + 0.04 {
                let middle = 0.5 * (first.stamp_secs + second.stamp_secs);
                speeds.push((middle, first.pose.rotation.angle_to(&second.pose.rotation) / secs));
            }
        }
        speeds
    };
    let (of_head, of_markers) = (speeds(head), speeds(markers));
    let steps = (search_secs / GRID_SECS).round() as i64;
    let score = |offset: f64| {
        let (mut next, mut sum, mut count) = (0, 0.0, 0_usize);
        for (time, speed) in &of_head {
            while next < of_markers.len() && of_markers[next].0 + offset < *time {
                next += 1;
            }
            let (Some(before), Some(after)) =
                (next.checked_sub(1).map(|k| of_markers[k]), of_markers.get(next))
            else {
                continue;
            };
            let share = (time - before.0 - offset) / (after.0 - before.0).max(1e-9);
            sum += (speed - before.1 - share * (after.1 - before.1)).powi(2).min(0.25);
            count += 1;
        }
        if count < MIN_PAIRS { f64::INFINITY } else { sum / count as f64 }
    };
    let offsets = (-steps..=steps).map(|k| k as f64 * GRID_SECS);
    let best = offsets.map(|offset| (score(offset), offset)).min_by(|a, b| a.0.total_cmp(&b.0));
    best.filter(|(score, _)| score.is_finite()).map_or(0.0, |(_, offset)| offset)
}

/// X, and the length of the markers' unit over the headset's.
fn initial_estimate(pairs: &[PosePair]) -> Result<(Pose, f64), HeadsetCalibrationError> {
    let relatives = relative_motions(pairs);
    let still = || {
        let turned = relatives.iter().map(|(a, _)| a.rotation.angle()).fold(0.0, f64::max);
        HeadsetCalibrationError::TooLittleRotation {
            got_deg: turned.to_degrees(),
            required_deg: MIN_ROTATION_DEG,
        }
    };
    // Rotation: alpha = R_X beta for the rotation vectors of both.
    let mut product = Matrix3::zeros();
    for (a, b) in &relatives {
        product += a.rotation.scaled_axis() * b.rotation.scaled_axis().transpose();
    }
    let svd = SVD::new(product, true, true);
    let (Some(u), Some(v_t)) = (svd.u, svd.v_t) else { return Err(still()) };
    let mut sign = Matrix3::identity();
    sign[(2, 2)] = (u * v_t).determinant().signum();
    let rotation = UnitQuaternion::from_matrix(&(u * sign * v_t));
    // Translation and unit: (R_A - I) t_X = s R_X t_B - t_A, four unknowns, Huber's weights against outliers.
    let mut weights = vec![1.0; relatives.len()];
    let mut solved = nalgebra::Vector4::zeros();
    for _ in 0..8 {
        let (mut normal, mut right) = (nalgebra::Matrix4::zeros(), nalgebra::Vector4::zeros());
        for ((a, b), weight) in relatives.iter().zip(&weights) {
            let mut rows = nalgebra::SMatrix::<f64, 3, 4>::zeros();
            rows.fixed_view_mut::<3, 3>(0, 0)
                .copy_from(&(a.rotation.to_rotation_matrix().matrix() - Matrix3::identity()));
            rows.set_column(3, &-(rotation * b.translation.vector));
            normal += rows.transpose() * rows * *weight;
            right -= rows.transpose() * a.translation.vector * *weight;
        }
        solved = normal.svd(true, true).solve(&right, 1e-12).map_err(|_| still())?;
        let mut left: Vec<f64> = Vec::new();
        for (a, b) in &relatives {
            let t = solved.fixed_rows::<3>(0).into_owned();
            let off = a.rotation * t - t + a.translation.vector - rotation * b.translation.vector * solved[3];
            left.push(off.norm());
        }
        let mut sorted = left.clone();
        sorted.sort_by(f64::total_cmp);
        let limit = 2.0 * sorted.get(sorted.len() / 2).copied().unwrap_or(0.0).max(1e-9);
        weights = left.iter().map(|left| if *left <= limit { 1.0 } else { limit / left }).collect();
    }
    let position = solved.fixed_rows::<3>(0).into_owned();
    // The equation gives headset over markers.
    Ok((Pose::from_parts(position.into(), rotation), 1.0 / solved[3].abs().max(1e-9)))
}

/// Relative motions of head and markers between two moments some seconds apart, whose angles are large and agree.
fn relative_motions(pairs: &[PosePair]) -> Vec<(Pose, Pose)> {
    let mut found = Vec::new();
    for rows_apart in [7, 17, 41] {
        for k in 0..pairs.len().saturating_sub(rows_apart) {
            let (one, other) = (&pairs[k], &pairs[k + rows_apart]);
            let a = one.head.inverse() * other.head;
            let b = one.markers.inverse() * other.markers;
            let (alpha, beta) = (a.rotation.angle(), b.rotation.angle());
            // Chen 1991: a rotation and its conjugate have the same angle.
            if alpha > MIN_RELATIVE_ROTATION_RAD && (alpha - beta).abs() < 0.02 + 0.05 * alpha {
                found.push((a, b));
            }
        }
    }
    found
}

/// Compares with one of the streams reflected, which turns a left-handed one back.
fn check_mirrored(pairs: &[PosePair], fit: &HandEyeFit) -> Result<(), HeadsetCalibrationError> {
    // Reflecting z once covers every reflection: the others differ by a rotation, which X and Y take up.
    let reflect = |pose: &Pose| {
        let (t, q) = (pose.translation.vector, pose.rotation.coords);
        let turned = nalgebra::Quaternion::new(q[3], -q[0], -q[1], q[2]);
        Pose::from_parts(Vector::new(t.x, t.y, -t.z).into(), UnitQuaternion::new_normalize(turned))
    };
    let other: Vec<PosePair> =
        pairs.iter().map(|pair| PosePair { markers: reflect(&pair.markers), ..*pair }).collect();
    let Ok((x, _)) = initial_estimate(&other) else { return Ok(()) };
    let mirrored = refine(&other, x);
    let size = |fit: &HandEyeFit| fit.median_m + fit.median_rad * 0.2;
    let times = size(fit) / size(&mirrored).max(1e-9);
    if times > MIN_MIRROR_RESIDUAL_RATIO { Err(HeadsetCalibrationError::Mirrored { times }) } else { Ok(()) }
}

fn assess_calibration(
    pairs: &[PosePair],
    fit: &HandEyeFit,
    known: &Observability,
    options: &HeadsetCalibrationOptions,
) -> HeadsetCalibrationVerdict {
    if let Some(at_secs) = find_marker_slip(pairs, fit, options) {
        return HeadsetCalibrationVerdict::MarkersSlipped { at_secs };
    }
    if let Some(axis) = known.axis_to_excite(options) {
        return HeadsetCalibrationVerdict::MoveMore { axis };
    }
    // Clocks that no round brought together: what was found rests on a motion that is not even.
    if fit.offset_secs.abs() > GRID_SECS {
        return HeadsetCalibrationVerdict::Noisy;
    }
    if fit.residual_m > options.max_residual_m || fit.residual_rad.to_degrees() > options.max_residual_deg {
        return HeadsetCalibrationVerdict::Noisy;
    }
    HeadsetCalibrationVerdict::Good
}

/// Parts of the recording in which a slip is looked for.
const SLIP_SEGMENTS: usize = 12;

/// About when the markers slipped: the time that splits the recording into two that fit well with two X that differ by more
/// than a residual may be, better than they fit together.
fn find_marker_slip(
    pairs: &[PosePair],
    fit: &HandEyeFit,
    options: &HeadsetCalibrationOptions,
) -> Option<f64> {
    // A short piece fits anything: from a sixth on.
    let cuts = (2..=SLIP_SEGMENTS - 2).map(|k| k * pairs.len() / SLIP_SEGMENTS);
    let cost = |fits: &[(&HandEyeFit, usize)]| {
        let whole: usize = fits.iter().map(|(_, count)| count).sum();
        let sum: f64 = fits.iter().map(|(fit, count)| fit.cost * *count as f64).sum();
        sum / whole as f64
    };
    let together = cost(&[(fit, pairs.len())]);
    let mut best: Option<(f64, f64)> = None;
    for cut in cuts {
        let (early, late) = pairs.split_at(cut);
        let (before, after) = (refine(early, fit.x), refine(late, fit.x));
        let displacement = (before.x.translation.vector - after.x.translation.vector).norm();
        let turn = before.x.rotation.angle_to(&after.x.rotation).to_degrees();
        let separate_cost = cost(&[(&before, early.len()), (&after, late.len())]);
        let slipped = displacement > 0.5 * options.max_residual_m || turn > 0.5 * options.max_residual_deg;
        if slipped
            && separate_cost < 0.8 * together
            && best.is_none_or(|(min_cost, _)| separate_cost < min_cost)
        {
            best = Some((separate_cost, late[0].stamp_secs));
        }
    }
    best.map(|(_, at)| at)
}
