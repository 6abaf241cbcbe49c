//! What a practised person knows of the arm: where the hand goes when a joint turns, and how the joints would have
//! to stand for the hand to be somewhere. A model in the head, apart from the kinematics that drive the arm.

use nalgebra::{DMatrix, DVector, Translation3, Unit, UnitQuaternion};
use proact_types::{ArmModel, JointVector, Point, Pose, Vector};
use std::sync::Arc;

/// Steps of the search for joint angles.
const STEPS: usize = 200;
/// Damping of a step, metres: the search stays calm where the arm is stretched.
const DAMPING: f64 = 0.05;
/// One radian of the hand's tilt counts as this many metres.
const TILT_WEIGHT: f64 = 0.15;
/// Largest change of a joint in one step, rad.
const STEP_MAX: f64 = 0.2;

/// Where the hand should be: the grasp centre at a point, and an axis of the hand upright. The yaw about it is
/// free.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct HandGoal {
    /// Point of the hand that is brought to `target`, in the tip's frame.
    pub(crate) point: Point,
    /// Axis of the hand that is brought upright, in the tip's frame, unit length.
    pub(crate) axis: Vector,
    /// Where the point should be, in `base_link`.
    pub(crate) target: Point,
    /// What upright is, in `base_link`, unit length.
    pub(crate) up: Vector,
}

/// The arm as its user knows it.
#[derive(Clone, Debug)]
pub(crate) struct ArmSense {
    model: Arc<ArmModel>,
}

impl ArmSense {
    pub(crate) fn new(model: Arc<ArmModel>) -> Self {
        Self { model }
    }

    /// `base_from_tip` at the arm angles `q`.
    pub(crate) fn forward(&self, q: &[f64]) -> Pose {
        // From the tip up to the base: joint `link - 1` moves `link`.
        let mut pose = Pose::identity();
        let mut link = self.model.tip;
        while link > 0 {
            let joint = &self.model.joints[link - 1];
            let angle = self.model.arm.iter().position(|&j| j == link - 1).map_or(0.0, |k| q[k]);
            let turn = UnitQuaternion::from_axis_angle(&Unit::new_normalize(joint.axis), angle);
            pose = joint.origin * Pose::from_parts(Translation3::identity(), turn) * pose;
            link = joint.parent;
        }
        pose
    }

    /// What is left to the goal at `q`: metres of the point along base axes, then tilt, weighted, about them.
    fn error(&self, q: &[f64], goal: &HandGoal) -> DVector<f64> {
        let pose = self.forward(q);
        let off = goal.target - pose * goal.point;
        let tilt = (pose.rotation * goal.axis).cross(&goal.up) * TILT_WEIGHT;
        DVector::from_iterator(6, off.iter().chain(tilt.iter()).copied())
    }

    /// Arm angles near `from` that bring the hand to the goal, and how far off they leave it, metres (tilt
    /// included at its weight).
    pub(crate) fn inverse(&self, from: &[f64], goal: &HandGoal) -> (JointVector, f64) {
        let limits: Vec<_> = self.model.arm.iter().map(|&j| self.model.joints[j].limits).collect();
        let mut q: JointVector = from.iter().copied().collect();
        let mut best = (q.clone(), self.error(&q, goal).norm());
        for _ in 0..STEPS {
            let error = self.error(&q, goal);
            let mut jacobian = DMatrix::zeros(6, q.len());
            for k in 0..q.len() {
                let mut ahead = q.clone();
                ahead[k] += 1e-6;
                jacobian.set_column(k, &((&error - self.error(&ahead, goal)) / 1e-6));
            }
            let square = &jacobian * jacobian.transpose() + DMatrix::identity(6, 6) * (DAMPING * DAMPING);
            let Some(solved) = square.cholesky().map(|c| c.solve(&error)) else { break };
            let step = jacobian.transpose() * solved;
            for (k, limits) in limits.iter().enumerate() {
                q[k] = (q[k] + step[k].clamp(-STEP_MAX, STEP_MAX)).clamp(limits.lower, limits.upper);
            }
            let left = self.error(&q, goal).norm();
            if left < best.1 {
                best = (q.clone(), left);
            }
        }
        best
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proact_types::{Joint, JointKind, JointLimits, Link};

    /// Three joints about z, y, y with links of 0.3 m along x.
    fn arm() -> ArmSense {
        let link =
            |k: usize| Link { name: format!("l{k}"), inertial: None, collisions: vec![], visuals: vec![] };
        let joint = |k: usize, axis: Vector| Joint {
            name: format!("j{k}"),
            kind: JointKind::Revolute,
            parent: k,
            child: k + 1,
            origin: Pose::translation(if k == 0 { 0.0 } else { 0.3 }, 0.0, 0.0),
            axis,
            limits: JointLimits { lower: -2.0, upper: 2.0, velocity: 1.0, effort: 1.0 },
            damping: 0.0,
            friction: 0.0,
        };
        ArmSense::new(Arc::new(ArmModel {
            name: "arm".into(),
            links: (0..4).map(link).collect(),
            joints: vec![joint(0, Vector::z()), joint(1, Vector::y()), joint(2, Vector::y())],
            arm: vec![0, 1, 2],
            hand: vec![],
            tip: 3,
            poses: vec![],
            allowed_collisions: vec![],
            grasp_centre: Vector::zeros(),
        }))
    }

    #[test]
    fn the_hand_is_where_trigonometry_says() {
        let pose = arm().forward(&[std::f64::consts::FRAC_PI_2, 0.0, 0.5]);
        assert!((pose.translation.vector - Vector::new(0.0, 0.6, 0.0)).norm() < 1e-12, "{pose}");
    }

    #[test]
    fn angles_are_found_that_bring_hand_and_axis_to_the_goal_and_what_is_out_of_reach_is_told() {
        let arm = arm();
        let wanted = arm.forward(&[0.4, -0.5, 0.9]);
        let goal = HandGoal {
            point: Point::new(0.1, 0.0, 0.0),
            axis: Vector::z(),
            target: wanted * Point::new(0.1, 0.0, 0.0),
            up: wanted.rotation * Vector::z(),
        };
        let (q, left) = arm.inverse(&[0.0, 0.1, 0.1], &goal);
        assert!(left < 1e-3, "{left} m left at {q:?}");
        let far = HandGoal { target: Point::new(3.0, 0.0, 0.0), ..goal };
        assert!(arm.inverse(&[0.0, 0.1, 0.1], &far).1 > 1.0);
    }
}
