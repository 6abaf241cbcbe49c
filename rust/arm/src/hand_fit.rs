//! Joint angles of the arm from where the person's own hand went.

use crate::{ArmModel, Chain, ChainPoses, damped_step_within_limits};
use nalgebra::{UnitQuaternion, Vector6};
use proact_types::{JointVector, Pose, Vector, joints};

/// Steps of one fit at most, and from which gap on it has arrived, metres and weighted radians: below the noise of any tracker.
const MAX_STEPS: usize = 20;
const CONVERGED_ERROR: f64 = 1e-6;
/// A radian of the hand's attitude counts as this many metres: first the place, then the attitude.
const METERS_PER_RADIAN: f64 = 0.1;
/// Square of the damping of a step, metres squared, and its longest, rad.
const DAMPING: f64 = 1e-5;
const MAX_STEP_RAD: f64 = 0.2;

/// The joints that bring the arm's hand where the person's own hand went since the start, by inverse kinematics: nearest in the
/// sense of least squares, within the joints' limits, from the angles before on. So the elbow moves no more than it has to, and out
/// of reach the arm is stretched toward the hand ([`HandFit::position_error_m`]).
#[derive(Clone, Debug)]
pub struct HandFit {
    chain: Chain,
    /// `base_from_tip` at the start.
    start: Pose,
    angles: JointVector,
    error: Vector6<f64>,
}

impl HandFit {
    /// The person's hand is where the arm's is at `angles`, base to tip, rad.
    ///
    /// # Panics
    /// If there are fewer angles than arm joints.
    pub fn new(model: &ArmModel, angles: &[f64]) -> Self {
        let chain = Chain::new(model);
        let angles = joints(&angles[..chain.joint_count()]);
        Self { start: chain.forward(&angles), chain, angles, error: Vector6::zeros() }
    }

    /// The angles for a hand that went by `displacement`, metres, and turned by `turn` since the start, both in the axes of the base.
    pub fn update(&mut self, displacement: &Vector, turn: &UnitQuaternion<f64>) -> &[f64] {
        let mut poses = ChainPoses::default();
        for _ in 0..MAX_STEPS {
            self.chain.link_poses_into(&self.angles, &mut poses);
            let off = self.start.translation.vector + displacement - poses.tip.translation.vector;
            let turned = (turn * self.start.rotation * poses.tip.rotation.inverse()).scaled_axis();
            self.error = Vector6::from_iterator(off.iter().chain(&(turned * METERS_PER_RADIAN)).copied());
            if self.error.norm() < CONVERGED_ERROR {
                break;
            }
            let mut columns = self.chain.jacobian(&poses, &poses.tip.translation.vector.into());
            columns.iter_mut().for_each(|column| column.fixed_rows_mut::<3>(3).scale_mut(METERS_PER_RADIAN));
            let limits = self.chain.limits();
            damped_step_within_limits(
                &mut self.angles,
                limits,
                &mut columns,
                &self.error,
                DAMPING,
                MAX_STEP_RAD,
            );
        }
        &self.angles
    }

    /// The angles that were found last, base to tip, rad.
    pub fn angles(&self) -> &[f64] {
        &self.angles
    }

    /// How far the arm's hand stays from where the person's went, metres.
    pub fn position_error_m(&self) -> f64 {
        self.error.fixed_rows::<3>(0).norm()
    }

    /// How far it stays turned from the person's, rad.
    pub fn rotation_error_rad(&self) -> f64 {
        self.error.fixed_rows::<3>(3).norm() / METERS_PER_RADIAN
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::doubles::three_joint_arm;
    use proptest::prelude::*;

    proptest! {
        // Catches a displacement in the tip's axes, a turn on the wrong side, a Jacobian of another point.
        #[test]
        fn the_hand_goes_where_the_persons_went(
            start in prop::array::uniform3(-0.3..0.3_f64),
            moved in prop::array::uniform3(-0.3..0.3_f64),
        ) {
            let model = three_joint_arm();
            let chain = Chain::new(&model);
            let to: Vec<f64> = start.iter().zip(&moved).map(|(a, b)| a + b).collect();
            let (from, there) = (chain.forward(&start), chain.forward(&to));
            let way = there.translation.vector - from.translation.vector;
            let turn = there.rotation * from.rotation.inverse();
            let mut fit = HandFit::new(&model, &start);
            let found = chain.forward(fit.update(&way, &turn));
            prop_assert!((found.translation.vector - there.translation.vector).norm() < 1e-4, "{found}");
            prop_assert!(found.rotation.angle_to(&there.rotation) < 1e-3, "{found}");
            prop_assert!(fit.position_error_m() < 1e-4 && fit.rotation_error_rad() < 1e-3);
        }
    }

    #[test]
    fn out_of_reach_the_arm_is_stretched_toward_the_hand_and_comes_back() {
        let model = three_joint_arm();
        let chain = Chain::new(&model);
        let start = [0.1, 0.4, -0.6];
        let mut fit = HandFit::new(&model, &start);
        let far = fit.update(&Vector::new(5.0, 0.0, 0.0), &UnitQuaternion::identity()).to_vec();
        assert!(
            far.iter().all(|angle| angle.is_finite()) && fit.position_error_m() > 3.0,
            "{far:?}, {} m",
            fit.position_error_m()
        );
        assert!(chain.forward(&far).translation.x > chain.forward(&start).translation.x, "toward it");
        let back = fit.update(&Vector::zeros(), &UnitQuaternion::identity()).to_vec();
        let gap = chain.forward(&back).translation.vector - chain.forward(&start).translation.vector;
        assert!(gap.norm() < 1e-3, "{back:?}");
    }
}
