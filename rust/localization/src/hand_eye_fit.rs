//! Gauss-Newton over X, Y, drift and clock offset together.

use crate::PosePair;
use nalgebra::{SMatrix, SVector, UnitQuaternion};
use proact_types::{Pose, Vector};

/// X (6), Y (6), drift of the headset's world (3), clock (1).
const UNKNOWNS: usize = 16;
type Step = SVector<f64, UNKNOWNS>;
type NormalMatrix = SMatrix<f64, UNKNOWNS, UNKNOWNS>;
type Residual = SVector<f64, 6>;

const MAX_ITERATIONS: usize = 25;
/// Tukey's constant for 95 % efficiency, in standard deviations; those from the median of a norm of three Gaussians.
const TUKEY: f64 = 4.685;
const MEDIAN_OF_NORM: f64 = 1.538;

/// A drift beyond this is none: the prior's standard deviation, m/s (5 cm a minute).
const DRIFT_SIGMA_M_PER_S: f64 = 0.05 / 60.0;

/// The outcome.
#[derive(Clone, Debug)]
pub(crate) struct HandEyeFit {
    /// `head_from_markers`.
    pub x: Pose,
    /// `headset_world_from_tracking` at `end_secs`.
    pub y: Pose,
    /// m/s, of the headset's world.
    pub drift: Vector,
    /// On top of the offset that the pairs were made with, s.
    pub offset_secs: f64,
    pub end_secs: f64,
    /// Root mean squares under the weights.
    pub residual_m: f64,
    pub residual_rad: f64,
    pub median_m: f64,
    pub median_rad: f64,
    /// Mean of Tukey's loss, in units that do not depend on the fit's own noise.
    pub cost: f64,
    pub weights: Vec<f64>,
    /// Inverse of the normal matrix, scaled by the noise: the variance of X, Y, drift and clock.
    pub covariance: Option<NormalMatrix>,
}

struct Unknowns {
    x: Pose,
    /// About the middle of the markers' places, so that turn and place of Y do not mix.
    y: Pose,
    drift: Vector,
    offset: f64,
}

impl Unknowns {
    fn apply_step(&self, step: &Step) -> Self {
        let turn = |pose: &Pose, at: usize| {
            let position = pose.translation.vector + step.fixed_rows::<3>(at + 3);
            let by = UnitQuaternion::from_scaled_axis(step.fixed_rows::<3>(at).into_owned());
            Pose::from_parts(position.into(), by * pose.rotation)
        };
        Self {
            x: turn(&self.x, 0),
            y: turn(&self.y, 6),
            drift: self.drift + step.fixed_rows::<3>(12),
            offset: self.offset + step[15],
        }
    }

    /// Turn (3, rad) and place (3, m) of what is left of one pair.
    fn residual(&self, moment: &CenteredPair) -> Residual {
        let moved = -self.offset;
        let markers = Pose::from_parts(
            (moment.markers.translation.vector + moment.marker_velocity * moved).into(),
            UnitQuaternion::from_scaled_axis(moment.marker_angular_velocity * moved)
                * moment.markers.rotation,
        );
        let left = moment.head * self.x;
        let right = self.y * markers;
        let turn = (left.rotation * right.rotation.inverse()).scaled_axis();
        let offset = left.translation.vector - right.translation.vector - self.drift * moment.secs_from_end;
        let mut all = Residual::zeros();
        all.fixed_rows_mut::<3>(0).copy_from(&turn);
        all.fixed_rows_mut::<3>(3).copy_from(&offset);
        all
    }
}

/// One pair, with the markers about the middle of their places.
struct CenteredPair {
    head: Pose,
    markers: Pose,
    /// Of the markers, m/s and rad/s.
    marker_velocity: Vector,
    marker_angular_velocity: Vector,
    /// s, negative before the end.
    secs_from_end: f64,
}

/// Refines from a first X.
pub(crate) fn refine(pairs: &[PosePair], x: Pose) -> HandEyeFit {
    let end_secs = pairs.last().map_or(0.0, |pair| pair.stamp_secs);
    let middle =
        pairs.iter().map(|pair| pair.markers.translation.vector).sum::<Vector>() / pairs.len() as f64;
    let shift = Pose::from_parts((-middle).into(), UnitQuaternion::identity());
    let moments: Vec<CenteredPair> = (0..pairs.len())
        .map(|k| {
            let (before, after) = (&pairs[k.saturating_sub(1)], &pairs[(k + 1).min(pairs.len() - 1)]);
            let secs = (after.stamp_secs - before.stamp_secs).max(1e-3);
            let near = if secs < 0.5 { 1.0 } else { 0.0 };
            let turn = after.markers.rotation * before.markers.rotation.inverse();
            CenteredPair {
                head: pairs[k].head,
                markers: shift * pairs[k].markers,
                marker_velocity: (after.markers.translation.vector - before.markers.translation.vector)
                    * (near / secs),
                marker_angular_velocity: turn.scaled_axis() * (near / secs),
                secs_from_end: pairs[k].stamp_secs - end_secs,
            }
        })
        .collect();
    let mut at = Unknowns { x, y: first_y(&moments, &x), drift: Vector::zeros(), offset: 0.0 };
    let mut weights = vec![1.0; moments.len()];
    let mut scales = (1.0, 1.0);
    let mut covariance = None;
    for round in 0..MAX_ITERATIONS {
        let left: Vec<Residual> = moments.iter().map(|moment| at.residual(moment)).collect();
        // The noise is taken from what is left; in the first rounds everything counts.
        scales = noise(&left);
        let norms = left.iter().map(|left| normalized_residual(left, scales));
        let tukey = |norm: f64| {
            let share = norm / (if round < 5 { 3.0 * TUKEY } else { TUKEY });
            if share < 1.0 { (1.0 - share * share).powi(2) } else { 0.0 }
        };
        weights = norms.map(tukey).collect();
        let mut normal = NormalMatrix::zeros();
        let mut right = Step::zeros();
        for ((moment, left), weight) in moments.iter().zip(&left).zip(&weights) {
            if *weight == 0.0 {
                continue;
            }
            let rows = jacobian(&at, moment, left);
            let mut weighted = rows;
            for k in 0..6 {
                let scale = if k < 3 { scales.0 } else { scales.1 };
                weighted.row_mut(k).scale_mut(weight / (scale * scale));
            }
            normal += weighted.transpose() * rows;
            right -= weighted.transpose() * left;
        }
        // A head that hardly moves leaves drift and clock open: they are small.
        for k in 0..3 {
            let prior = 1.0 / (DRIFT_SIGMA_M_PER_S * DRIFT_SIGMA_M_PER_S);
            normal[(12 + k, 12 + k)] += prior;
            right[12 + k] -= prior * at.drift[k];
        }
        let prior = 1.0 / (0.02_f64 * 0.02);
        normal[(15, 15)] += prior;
        right[15] -= prior * at.offset;
        let damped = normal + NormalMatrix::from_diagonal(&normal.diagonal().map(|d| d * 1e-9 + 1e-9));
        let Some(solver) = damped.cholesky() else { break };
        let step = solver.solve(&right);
        covariance = Some(solver.inverse());
        at = at.apply_step(&step);
        if round > 8 && step.norm() < 1e-10 {
            break;
        }
    }
    let left: Vec<Residual> = moments.iter().map(|moment| at.residual(moment)).collect();
    let rms = |from: usize| {
        let squares = left.iter().zip(&weights).map(|(l, w)| w * l.fixed_rows::<3>(from).norm_squared());
        (squares.sum::<f64>() / weights.iter().sum::<f64>().max(1e-9)).sqrt()
    };
    let medians = (scales.0 * MEDIAN_OF_NORM, scales.1 * MEDIAN_OF_NORM);
    // 0.3 degrees and 2 mm: what tracking and headsets are good for, and far from both slips and perfection.
    let loss = |l: &Residual| (normalized_residual(l, (0.005, 0.002)) / 6.0).powi(2).min(1.0);
    HandEyeFit {
        x: at.x,
        y: at.y * shift,
        drift: at.drift,
        offset_secs: at.offset,
        end_secs,
        residual_m: rms(3),
        residual_rad: rms(0),
        median_m: medians.1,
        median_rad: medians.0,
        cost: left.iter().map(loss).sum::<f64>() / left.len().max(1) as f64,
        weights,
        covariance,
    }
}

/// Y of the given X: the mean over all pairs (of attitudes, the eigenvector of Markley et al. 2007, "Averaging quaternions", J
/// Guid Control Dyn 30:1193), places by their median.
fn first_y(moments: &[CenteredPair], x: &Pose) -> Pose {
    let all: Vec<Pose> = moments.iter().map(|m| m.head * x * m.markers.inverse()).collect();
    let mut sum = nalgebra::Matrix4::zeros();
    for pose in &all {
        sum += pose.rotation.coords * pose.rotation.coords.transpose();
    }
    let eigen = sum.symmetric_eigen();
    let rotation = UnitQuaternion::new_normalize(nalgebra::Quaternion::from(
        eigen.eigenvectors.column(eigen.eigenvalues.imax()).into_owned(),
    ));
    let median = |axis: usize| {
        let position_of = |m: &CenteredPair| {
            let from_markers = m.head * x;
            (from_markers.translation.vector - rotation * m.markers.translation.vector)[axis]
        };
        let mut values: Vec<f64> = moments.iter().map(position_of).collect();
        values.sort_by(f64::total_cmp);
        values.get(values.len() / 2).copied().unwrap_or(0.0)
    };
    Pose::from_parts(Vector::new(median(0), median(1), median(2)).into(), rotation)
}

/// Standard deviations of turn, rad, and place, m, in each coordinate, from the medians.
fn noise(left: &[Residual]) -> (f64, f64) {
    let median = |from: usize, min_count: f64| {
        let mut norms: Vec<f64> = left.iter().map(|l| l.fixed_rows::<3>(from).norm()).collect();
        norms.sort_by(f64::total_cmp);
        (norms.get(norms.len() / 2).copied().unwrap_or(0.0) / MEDIAN_OF_NORM).max(min_count)
    };
    (median(0, 1e-6), median(3, 1e-6))
}

/// In standard deviations of one coordinate: the larger of turn and place.
fn normalized_residual(left: &Residual, scales: (f64, f64)) -> f64 {
    (left.fixed_rows::<3>(0).norm() / scales.0).max(left.fixed_rows::<3>(3).norm() / scales.1)
}

fn jacobian(at: &Unknowns, moment: &CenteredPair, left: &Residual) -> SMatrix<f64, 6, UNKNOWNS> {
    const DELTA: f64 = 1e-6;
    let mut rows = SMatrix::<f64, 6, UNKNOWNS>::zeros();
    for k in 0..UNKNOWNS {
        let mut step = Step::zeros();
        step[k] = DELTA;
        rows.set_column(k, &((at.apply_step(&step).residual(moment) - left) / DELTA));
    }
    rows
}
