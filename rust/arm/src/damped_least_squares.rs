use crate::{JacobianColumns, JointLimits};
use nalgebra::{Matrix6, Vector6};
use proact_types::JointVector;

/// Damped least squares: the change of the joint angles that makes `|J dq - error|^2 + damping |dq|^2` smallest, with
/// J given by its columns. None if `damping` is too small for a task that the joints cannot meet.
///
/// Rows of zeros in all columns leave a part of the task out, a column of zeros leaves a joint where it is. `damping`
/// is the square of the usual lambda, in units of the rows (Nakamura and Hanafusa 1986; Wampler 1986).
pub fn damped_step(columns: &[Vector6<f64>], error: &Vector6<f64>, damping: f64) -> Option<JointVector> {
    let mut normal = Matrix6::identity() * damping;
    for column in columns {
        normal.ger(1.0, column, column, 1.0);
    }
    let forces = normal.cholesky()?.solve(error);
    Some(columns.iter().map(|column| column.dot(&forces)).collect())
}

/// Moves `q` by a [`damped_step`] within `limits`, scaled down as a whole where a joint would go further than `max_step`,
/// rad. Joints at a limit that the step would leave stay there, and the rest is solved again; their columns are zero
/// afterwards. `q` stays as it is where there is no step.
pub fn damped_step_within_limits(
    q: &mut [f64],
    limits: &[JointLimits],
    columns: &mut JacobianColumns,
    error: &Vector6<f64>,
    damping: f64,
    max_step: f64,
) {
    // Each round but the last freezes a joint.
    for _ in 0..q.len() {
        let Some(mut step) = damped_step(columns, error, damping) else { return };
        let furthest = step.iter().fold(0.0_f64, |max, angle| max.max(angle.abs()));
        if furthest > max_step {
            step.iter_mut().for_each(|angle| *angle *= max_step / furthest);
        }
        let leaves = |k: &usize| {
            (q[*k] >= limits[*k].upper && step[*k] > 0.0) || (q[*k] <= limits[*k].lower && step[*k] < 0.0)
        };
        match (0..q.len()).find(leaves) {
            Some(blocked) => columns[blocked].fill(0.0),
            None => {
                for (angle, (change, limits)) in q.iter_mut().zip(step.iter().zip(limits)) {
                    *angle = (*angle + change).clamp(limits.lower, limits.upper);
                }
                return;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::doubles::{ANGLE_RANGES, three_joint_arm};
    use crate::{Chain, ChainPoses};
    use proact_types::Point;
    use proptest::prelude::*;

    /// Of a point ahead of the last joint.
    fn columns_at(q: &[f64; 3]) -> JacobianColumns {
        let (chain, mut poses) = (Chain::new(&three_joint_arm()), ChainPoses::default());
        chain.link_poses_into(q, &mut poses);
        chain.jacobian(&poses, &(poses.tip * Point::new(0.3, 0.0, 0.0)))
    }

    proptest! {
        // Catches normal equations with a wrong sign, a damping that is squared twice, a transposed Jacobian.
        #[test]
        fn no_other_step_is_cheaper(q in ANGLE_RANGES, error in prop::array::uniform6(-0.3_f64..0.3), damping in 1e-4_f64..0.1) {
            let (columns, error) = (columns_at(&q), Vector6::from(error));
            let step = damped_step(&columns, &error, damping).expect("it is damped");
            let cost = |step: &[f64]| {
                let moved: Vector6<f64> = columns.iter().zip(step).map(|(column, dq)| column * *dq).sum();
                (moved - error).norm_squared() + damping * step.iter().map(|dq| dq * dq).sum::<f64>()
            };
            for k in 0..step.len() {
                for change in [-1e-3, 1e-3] {
                    let mut other = step.clone();
                    other[k] += change;
                    prop_assert!(cost(&other) > cost(&step));
                }
            }
        }

        #[test]
        fn a_step_keeps_to_the_limits_and_to_its_length(q in ANGLE_RANGES, error in prop::array::uniform6(-2.0_f64..2.0)) {
            let limits = JointLimits { lower: -1.0, upper: 1.0, velocity: 1.0, effort: 1.0 };
            let within = q.map(|angle| angle.clamp(-1.0, 1.0));
            let mut moved = within;
            let mut columns = columns_at(&within);
            damped_step_within_limits(&mut moved, &[limits; 3], &mut columns, &Vector6::from(error), 1e-3, 0.2);
            for (before, after) in within.iter().zip(&moved) {
                prop_assert!((-1.0..=1.0).contains(after) && (after - before).abs() <= 0.2 + 1e-15);
            }
        }
    }

    #[test]
    fn a_joint_at_its_limit_stays_there_and_the_others_do_its_part() {
        let limits = |upper: f64| JointLimits { lower: -2.0, upper, velocity: 1.0, effort: 1.0 };
        let limits = [limits(2.0), limits(2.0), limits(0.5)];
        // The point should go down, for which the last joint would turn further than it may.
        let error = Vector6::new(0.0, 0.0, -0.05, 0.0, 0.0, 0.0);
        let (mut q, mut columns) = ([0.0, 0.3, 0.5], columns_at(&[0.0, 0.3, 0.5]));
        // Its height alone counts.
        columns.iter_mut().for_each(|column| *column = Vector6::new(0.0, 0.0, column.z, 0.0, 0.0, 0.0));
        let free = damped_step(&columns, &error, 1e-3).expect("it is damped");
        assert!(free[2] > 0.0, "the case is not the one meant");
        damped_step_within_limits(&mut q, &limits, &mut columns, &error, 1e-3, 0.2);
        assert!(q[2] == 0.5 && q[1] > 0.3, "{q:?}");
    }

    #[test]
    fn a_task_that_no_joint_meets_and_nothing_damps_has_no_step() {
        let still = [Vector6::zeros(); 2];
        assert_eq!(damped_step(&still, &Vector6::repeat(1.0), 0.0), None);
    }
}
