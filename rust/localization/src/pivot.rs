//! The point that a moving body turns about.

use nalgebra::{DMatrix, DVector, Matrix3, Point3, SMatrix, SVector};
use proact_types::{Point, Pose, Vector};
use serde::{Deserialize, Serialize};

/// Fewer poses than this fix no pivot.
const MIN_POSES: usize = 10;
/// The smallest singular value of the system over its largest: below, the turns are about one axis only, and the place along
/// it is not known.
const MIN_CONDITION: f64 = 0.02;
/// Rounds of the weights that take outliers out.
const REWEIGHTING_ITERATIONS: usize = 10;

/// A pivot, and how well it is known.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PivotFit {
    /// In the frame that the poses are in, m.
    pub center: Point,
    /// In the body, m. For points without attitude, all zero.
    pub in_body: Vector,
    /// Distance of the body's origin, or of the points, from the pivot, m.
    pub radius_m: f64,
    /// Root mean square of what is left, of the poses that count, m.
    pub residual_m: f64,
    /// Smallest over largest singular value: 0 about one axis, larger is better known.
    pub condition: f64,
    /// Whether it moved about more than one axis: below 0.02 the place along that axis is not known.
    #[serde(rename = "known")]
    pub is_well_conditioned: bool,
}

/// Fits the pivot of a body with attitude: the one point of the body that stays at one place, by linear least squares of
/// `place + turn * in_body = center` (pivot calibration; the symmetrical form for two bodies is Ehrig et al. 2006, "A survey
/// of formal methods for determining the centre of rotation of ball joints", J Biomech 39:2798), with Huber's weights
/// against outliers. None of fewer than ten poses or poses that do not turn.
pub fn fit_pivot(poses: &[Pose]) -> Option<PivotFit> {
    if poses.len() < MIN_POSES {
        return None;
    }
    let mut weights = vec![1.0; poses.len()];
    let mut solution = SVector::<f64, 6>::zeros();
    let mut condition = 0.0;
    // Numbers near zero keep their digits.
    let middle = poses.iter().map(|pose| pose.translation.vector).sum::<Vector>() / poses.len() as f64;
    let mut left: Vec<f64> = Vec::new();
    for _ in 0..REWEIGHTING_ITERATIONS {
        let mut normal = SMatrix::<f64, 6, 6>::zeros();
        let mut right = SVector::<f64, 6>::zeros();
        for (pose, weight) in poses.iter().zip(&weights) {
            let mut rows = SMatrix::<f64, 3, 6>::zeros();
            rows.fixed_view_mut::<3, 3>(0, 0).copy_from(pose.rotation.to_rotation_matrix().matrix());
            rows.fixed_view_mut::<3, 3>(0, 3).copy_from(&-Matrix3::identity());
            let position = pose.translation.vector - middle;
            normal += rows.transpose() * rows * *weight;
            right -= rows.transpose() * position * *weight;
        }
        let decomposed = normal.symmetric_eigen();
        let largest = decomposed.eigenvalues.max();
        condition = (decomposed.eigenvalues.min().max(0.0) / largest).sqrt();
        // The direction that nothing is known of gets the shortest solution.
        solution = normal.pseudo_inverse(largest * 1e-9).ok()? * right;
        let (in_body, center) = halves(&solution);
        left = poses
            .iter()
            .map(|pose| (pose.translation.vector - middle + pose.rotation * in_body - center).norm())
            .collect();
        reweigh(&mut weights, &left);
    }
    let (in_body, center) = halves(&solution);
    let turned = poses.iter().any(|pose| poses[0].rotation.angle_to(&pose.rotation) > 0.05);
    turned.then(|| PivotFit {
        center: Point3::from(center + middle),
        in_body,
        radius_m: in_body.norm(),
        residual_m: weighted_rms(&weights, &left),
        condition,
        is_well_conditioned: condition >= MIN_CONDITION,
    })
}

/// Fits a sphere to points, such as a single marker's, by linear least squares of
/// `2 center . p + (r^2 - |center|^2) = |p|^2` with Huber's weights (Gamage & Lasenby 2002, "New least squares solutions for
/// estimating the average centre of rotation and the axis of rotation", J Biomech 35:87, discuss its bias: it grows with
/// noise over range). None of fewer than ten points, or points in a plane.
pub fn fit_sphere(points: &[Point]) -> Option<PivotFit> {
    if points.len() < MIN_POSES {
        return None;
    }
    let middle = points.iter().map(|point| point.coords).sum::<Vector>() / points.len() as f64;
    let mut weights = vec![1.0; points.len()];
    let mut found = None;
    for _ in 0..REWEIGHTING_ITERATIONS {
        let mut rows = DMatrix::zeros(points.len(), 4);
        let mut right = DVector::zeros(points.len());
        for (k, (point, weight)) in points.iter().zip(&weights).enumerate() {
            let (p, root) = (point.coords - middle, f64::sqrt(*weight));
            rows.set_row(k, &(nalgebra::RowVector4::new(2.0 * p.x, 2.0 * p.y, 2.0 * p.z, 1.0) * root));
            right[k] = p.norm_squared() * root;
        }
        // Of the points alone: how round the piece of the sphere is that they cover.
        let spread = points
            .iter()
            .map(|point| (point.coords - middle) * (point.coords - middle).transpose())
            .sum::<Matrix3<f64>>();
        let values = spread.symmetric_eigenvalues();
        let condition = (values.min().max(0.0) / values.max()).sqrt();
        let solved = rows.svd(true, true).solve(&right, 1e-9).ok()?;
        let center = Vector::new(solved[0], solved[1], solved[2]);
        let radius_m = (solved[3] + center.norm_squared()).max(0.0).sqrt();
        let left: Vec<f64> =
            points.iter().map(|point| ((point.coords - middle - center).norm() - radius_m).abs()).collect();
        reweigh(&mut weights, &left);
        found = Some(PivotFit {
            center: Point3::from(center + middle),
            in_body: Vector::zeros(),
            radius_m,
            residual_m: weighted_rms(&weights, &left),
            condition,
            is_well_conditioned: condition >= MIN_CONDITION,
        });
    }
    found
}

fn halves(solution: &SVector<f64, 6>) -> (Vector, Vector) {
    (solution.fixed_rows::<3>(0).into_owned(), solution.fixed_rows::<3>(3).into_owned())
}

/// Huber's weights at 1.345 standard deviations, those from the median.
fn reweigh(weights: &mut [f64], left: &[f64]) {
    let mut sorted = left.to_vec();
    sorted.sort_by(f64::total_cmp);
    let limit = 1.345 * (sorted[sorted.len() / 2] / 0.6745).max(1e-9);
    for (weight, left) in weights.iter_mut().zip(left) {
        *weight = if *left <= limit { 1.0 } else { limit / left };
    }
}

fn weighted_rms(weights: &[f64], left: &[f64]) -> f64 {
    let sum: f64 = weights.iter().zip(left).map(|(weight, left)| weight * left * left).sum();
    (sum / weights.iter().sum::<f64>()).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::UnitQuaternion;
    use proptest::prelude::*;

    fn arm_circles(center: Vector, in_body: Vector, bad: usize) -> Vec<Pose> {
        (0..300)
            .map(|k| {
                let t = f64::from(k) * 0.03;
                let turn = UnitQuaternion::from_euler_angles(
                    0.5 * t.sin(),
                    0.4 * (1.7 * t).cos(),
                    0.3 * (0.6 * t).sin(),
                );
                let noise = Vector::new((31.0 * t).sin(), (37.0 * t).sin(), (41.0 * t).cos()) * 3e-4;
                let jump = if (k as usize) < bad { Vector::new(0.1, 0.0, 0.0) } else { Vector::zeros() };
                Pose::from_parts((center - turn * in_body + noise + jump).into(), turn)
            })
            .collect()
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(50))]
        #[test]
        fn the_centre_of_arm_circles_is_found_to_a_millimetre_whatever_it_is(
            center in prop::array::uniform3(-2.0..2.0_f64),
            in_body in prop::array::uniform3(-0.3..0.3_f64),
        ) {
            let (center, in_body) = (Vector::from(center), Vector::from(in_body));
            let fit = fit_pivot(&arm_circles(center, in_body, 0)).unwrap();
            prop_assert!((fit.center.coords - center).norm() < 1e-3 && fit.is_well_conditioned, "{fit:?}");
            prop_assert!((fit.in_body - in_body).norm() < 1e-3);
        }

        #[test]
        fn a_sphere_is_found_from_points_alone(center in prop::array::uniform3(-2.0..2.0_f64), radius in 0.1..0.4_f64) {
            let center = Vector::from(center);
            let poses = arm_circles(center, Vector::new(0.0, 0.0, radius), 0);
            let points: Vec<Point> = poses.iter().map(|pose| Point::from(pose.translation.vector)).collect();
            let fit = fit_sphere(&points).unwrap();
            prop_assert!((fit.center.coords - center).norm() < 3e-3 && (fit.radius_m - radius).abs() < 3e-3, "{fit:?}");
        }
    }

    #[test]
    fn a_tenth_of_jumps_moves_the_centre_by_less_than_a_centimetre() {
        let center = Vector::new(0.1, -0.3, 1.4);
        let fit = fit_pivot(&arm_circles(center, Vector::new(0.0, 0.05, 0.2), 30)).unwrap();
        assert!((fit.center.coords - center).norm() < 0.01, "{fit:?}");
    }

    #[test]
    fn turning_about_one_axis_is_said_not_to_fix_the_centre() {
        let in_body = Vector::new(0.2, 0.0, 0.0);
        let poses: Vec<Pose> = (0..100)
            .map(|k| {
                let turn = UnitQuaternion::from_euler_angles(0.0, 0.0, 0.01 * f64::from(k));
                Pose::from_parts((-(turn * in_body)).into(), turn)
            })
            .collect();
        assert!(!fit_pivot(&poses).unwrap().is_well_conditioned);
        let points: Vec<Point> = poses.iter().map(|pose| Point::from(pose.translation.vector)).collect();
        assert!(!fit_sphere(&points).unwrap().is_well_conditioned);
        assert_eq!(fit_pivot(&vec![Pose::identity(); 50]), None);
        assert_eq!(fit_pivot(&poses[..5]), None);
    }
}
