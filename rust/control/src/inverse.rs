//! From a displacement of the hand to one of the joints.

use crate::{DampedProfile, JointSubset, MoorePenroseProfile};
use nalgebra::{DMatrix, Vector3, Vector6};
use proact_arm::{JacobianColumns, JointLimits, damped_step};
use proact_types::JointVector;

/// As far as a joint is looked ahead when a motion is judged by whether it leads into a singularity, seconds.
const LOOK_AHEAD_SECS: f64 = 0.02;
/// Keeps the normal equations solvable when fewer than six joints are free.
const MIN_DAMPING: f64 = 1e-12;

/// Why the arm does not move. Shown to the participant.
pub(crate) const NEAR_SINGULAR: &str = "the arm is almost stretched out: move another way";
pub(crate) const AT_LIMITS: &str = "the joint limits leave no way in this direction";
pub(crate) const NOT_FOLLOWING: &str = "the arm does not follow: something is in its way";
pub(crate) const NOT_FINITE: &str = "the joint angles are not known";

/// Ratio of the largest to the smallest singular value of `jacobian` whose linear rows are divided by `length`.
/// With fewer than six joints, of those that there are. Infinite at a singularity.
pub(crate) fn condition_number(jacobian: &DMatrix<f64>, joints: usize, length: f64) -> (f64, f64) {
    let rows = scale_linear_rows(jacobian, length);
    let mut eigen: Vec<f64> = (&rows * rows.transpose()).symmetric_eigenvalues().iter().copied().collect();
    eigen.sort_by(|a, b| b.total_cmp(a));
    let (largest, smallest) = match (eigen.first(), eigen.get(joints.clamp(1, 6) - 1)) {
        (Some(a), Some(b)) => (a.max(0.0).sqrt(), b.max(0.0).sqrt()),
        _ => (0.0, 0.0),
    };
    (largest / smallest, smallest)
}

fn scale_linear_rows(jacobian: &DMatrix<f64>, length: f64) -> DMatrix<f64> {
    let mut rows = jacobian.clone();
    rows.rows_mut(0, 3).scale_mut(1.0 / length);
    rows
}

/// The Jacobian at other angles, or why there is none.
pub(crate) type JacobianFn<'a> = dyn FnMut(&[f64]) -> Result<DMatrix<f64>, String> + 'a;

/// Damped least squares that leaves joints at their limits alone.
pub(crate) struct DampedInverse<'a> {
    pub profile: &'a DampedProfile,
    pub limits: &'a [JointLimits],
    pub subset: &'a JointSubset,
}

impl DampedInverse<'_> {
    /// Joint speeds for `twist` (linear, then angular, base axes) at the angles `commanded`, or why there are none.
    /// `jacobian_at` gives the Jacobian at other angles. `horizon` is the time in which limits must hold, s.
    pub(crate) fn solve(
        &self,
        twist: &Vector6<f64>,
        commanded: &[f64],
        measured: &[f64],
        horizon: f64,
        jacobian_at: &mut JacobianFn<'_>,
    ) -> Result<JointVector, String> {
        let profile = self.profile;
        // Fewer than six joints cannot keep all of the hand's pose: they see to the part that is asked for.
        let driven = self.subset.driven().len();
        let part = (driven < 6).then_some(if twist.fixed_rows::<3>(0).norm() > 0.0 { 3 } else { 0 });
        let joints = if part.is_some() { driven.min(3) } else { driven };
        let masked = |jacobian: DMatrix<f64>| {
            let mut jacobian = self.zero_undriven_columns(jacobian);
            if let Some(first) = part {
                jacobian.rows_mut(first, 3).fill(0.0);
            }
            jacobian
        };
        let jacobian = masked(jacobian_at(commanded)?);
        if !measured.iter().all(|angle| angle.is_finite()) {
            return Err(NOT_FINITE.to_owned());
        }
        let (now, smallest) = condition_number(&jacobian, joints, profile.characteristic_length_m);

        // Damping sets in smoothly under a smallest singular value (Nakamura and Hanafusa, 1986).
        let weak = (1.0 - smallest / profile.singular_value_threshold).max(0.0);
        let damping = (profile.max_damping * weak).powi(2);
        let mut speeds = self.solve_within_limits(&jacobian, twist, damping, commanded, horizon)?;

        // No joint faster than it may: all slow down together, which keeps the direction.
        let over = speeds
            .iter()
            .zip(self.limits)
            .fold(1.0_f64, |over, (speed, limits)| over.max(speed.abs() / limits.velocity));
        speeds.iter_mut().for_each(|speed| *speed /= over);

        if !speeds.iter().all(|speed| speed.is_finite()) {
            return Err(NOT_FINITE.to_owned());
        }
        let deviation = |((speed, commanded), measured): ((&f64, &f64), &f64)| {
            let drift = commanded - measured;
            drift.abs() > profile.tracking_error_limit_rad && drift * speed > 0.0
        };
        if speeds.iter().zip(commanded).zip(measured).any(deviation) {
            return Err(NOT_FOLLOWING.to_owned());
        }

        // Part of an arm is always near a singularity: damping and alignment alone bound it.
        if part.is_some() {
            return Ok(speeds);
        }

        // Into a singularity slower and slower, away from it as asked.
        let ahead: JointVector =
            commanded.iter().zip(&speeds).map(|(q, speed)| q + speed * LOOK_AHEAD_SECS).collect();
        let (then, _) =
            condition_number(&masked(jacobian_at(&ahead)?), joints, profile.characteristic_length_m);
        // Written so that an infinite condition number counts as worse.
        let improves = then < now;
        if !improves {
            let speed_limits =
                (profile.condition_limit - now) / (profile.condition_limit - profile.condition_slowdown);
            let share = speed_limits.clamp(0.0, 1.0);
            if share == 0.0 || share.is_nan() {
                return Err(NEAR_SINGULAR.to_owned());
            }
            speeds.iter_mut().for_each(|speed| *speed *= share);
        }
        Ok(speeds)
    }

    /// Columns of joints that are not driven become zero.
    fn zero_undriven_columns(&self, mut jacobian: DMatrix<f64>) -> DMatrix<f64> {
        for joint in (0..jacobian.ncols()).filter(|&joint| !self.subset.contains(joint)) {
            jacobian.column_mut(joint).fill(0.0);
        }
        jacobian
    }

    /// Solves, freezes the joints that would leave their limits, and solves again without them.
    fn solve_within_limits(
        &self,
        jacobian: &DMatrix<f64>,
        twist: &Vector6<f64>,
        damping: f64,
        commanded: &[f64],
        horizon: f64,
    ) -> Result<JointVector, String> {
        let rows = scale_linear_rows(jacobian, self.profile.characteristic_length_m);
        let mut columns: JacobianColumns =
            rows.column_iter().map(|column| column.fixed_rows::<6>(0).into_owned()).collect();
        let mut weighted_twist = *twist;
        weighted_twist.fixed_rows_mut::<3>(0).unscale_mut(self.profile.characteristic_length_m);
        loop {
            let speeds = damped_step(&columns, &weighted_twist, damping.max(MIN_DAMPING));
            let Some(speeds) = speeds.filter(|speeds| speeds.iter().all(|speed| speed.is_finite())) else {
                return Err(NEAR_SINGULAR.to_owned());
            };
            let mut leaves = false;
            for (joint, speed) in speeds.iter().enumerate() {
                let next = commanded[joint] + *speed * horizon;
                let limits = &self.limits[joint];
                if (next > limits.upper && *speed > 0.0) || (next < limits.lower && *speed < 0.0) {
                    columns[joint].fill(0.0);
                    leaves = true;
                }
            }
            if !leaves {
                return self
                    .is_aligned(jacobian, twist, &speeds)
                    .then_some(speeds)
                    .ok_or(AT_LIMITS.to_owned());
            }
        }
    }

    /// True if the part that is asked for, translation or rotation, goes roughly where it should. A rotation that
    /// carries the hand away is none; a translation may tilt the hand.
    fn is_aligned(&self, jacobian: &DMatrix<f64>, twist: &Vector6<f64>, speeds: &[f64]) -> bool {
        let (linear, angular) = (twist.fixed_rows::<3>(0).norm(), twist.fixed_rows::<3>(3).norm());
        let first = if linear > 0.0 { 0 } else { 3 };
        let requested: Vector3<f64> = twist.fixed_rows::<3>(first).into();
        let row = |row: usize| speeds.iter().enumerate().map(|(joint, s)| jacobian[(row, joint)] * s).sum();
        let got = Vector3::new(row(first), row(first + 1), row(first + 2));
        let carried = match first {
            3 => Vector3::new(row(0), row(1), row(2)).norm() / self.profile.characteristic_length_m,
            _ => 0.0,
        };
        let cosine = got.dot(&requested) / (got.norm().hypot(carried) * requested.norm());
        // A crawl is no motion either.
        linear + angular > 0.0
            && cosine >= self.profile.min_alignment_cosine
            && got.norm() > 0.1 * requested.norm()
    }
}

/// The original's inverse: `Some` joint displacement for `twist`, `None` where its elbow rule forbids it. Column `k`
/// of `jacobian` is that of joint `driven[k]`.
pub(crate) fn moore_penrose(
    profile: &MoorePenroseProfile,
    jacobian: &DMatrix<f64>,
    driven: &[usize],
    twist: &Vector6<f64>,
) -> Result<Option<JointVector>, String> {
    if !jacobian.iter().all(|value| value.is_finite()) {
        return Err(NOT_FINITE.to_owned());
    }
    let svd = jacobian.clone().svd(true, true);
    let (Some(u), Some(v_t)) = (&svd.u, &svd.v_t) else { return Err(NEAR_SINGULAR.to_owned()) };
    let mut coordinates = u.transpose() * twist;
    for (value, sigma) in coordinates.iter_mut().zip(svd.singular_values.iter()) {
        *value /= sigma;
    }
    let step = v_t.transpose() * coordinates;
    if !step.iter().all(|value| value.is_finite()) {
        return Err(NEAR_SINGULAR.to_owned());
    }
    let condition = svd.singular_values.max() / svd.singular_values.min();
    let elbow = driven.iter().position(|&joint| joint == profile.elbow_index);
    let extends = elbow.is_some_and(|elbow| step[elbow] < 0.0);
    let forbidden = condition > profile.condition_limit && extends;
    Ok((!forbidden).then(|| step.iter().copied().collect()))
}
