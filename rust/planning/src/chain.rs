//! The arm's chain as plain matrices: pose of the tip and Jacobian in one pass, without a call into a library.
//!
//! Searching for arm angles asks for both some ten thousand times a plan. KDL stays the judge: at construction the
//! two are compared, and what is found here is checked against it before it becomes part of a plan.

use crate::PlanningError;
use nalgebra::{Matrix3, Rotation3, Unit, Vector6};
use proact_arm::{ArmModel, JointKind};
use proact_control::ports::ArmKinematics;
use proact_types::{Pose, Vector};

/// One arm joint: what lies before it, and its axis.
struct Joint {
    rotation: Matrix3<f64>,
    translation: Vector,
    axis: Unit<Vector>,
}

/// The chain from the base to the tip.
pub(crate) struct Chain {
    joints: Vec<Joint>,
    tip_rotation: Matrix3<f64>,
    tip_translation: Vector,
    /// Of the last question: axis and origin of each joint, base frame.
    axes: Vec<(Vector, Vector)>,
}

/// Largest difference from the kinematics library that is rounding, metres and rad.
pub(crate) const AGREEMENT: f64 = 1e-9;

impl Chain {
    /// The chain of `model`, whose kinematics are `kinematics`.
    ///
    /// # Errors
    /// [`PlanningError::Kinematics`] if the two are not of the same arm.
    pub fn new(model: &ArmModel, kinematics: &mut dyn ArmKinematics) -> Result<Self, PlanningError> {
        let mut joints = Vec::new();
        let mut fixed = Pose::identity();
        let mut way: Vec<usize> = Vec::new();
        let mut link = model.tip;
        while link > 0 {
            // Joint k moves link k + 1.
            way.push(link - 1);
            link = model.joints[link - 1].parent;
        }
        for &index in way.iter().rev() {
            let joint = &model.joints[index];
            fixed *= joint.origin;
            if joint.kind == JointKind::Revolute {
                joints.push(Joint {
                    rotation: fixed.rotation.to_rotation_matrix().into_inner(),
                    translation: fixed.translation.vector,
                    axis: Unit::new_normalize(joint.axis),
                });
                fixed = Pose::identity();
            }
        }
        let axes = vec![(Vector::zeros(), Vector::zeros()); joints.len()];
        let mut chain = Self {
            joints,
            tip_rotation: fixed.rotation.to_rotation_matrix().into_inner(),
            tip_translation: fixed.translation.vector,
            axes,
        };
        for share in [0.0, 0.3, 1.0] {
            let q: Vec<f64> = model
                .arm
                .iter()
                .map(|&j| &model.joints[j].limits)
                .map(|l| l.lower + share * (l.upper - l.lower))
                .collect();
            if chain.joints.len() != q.len() || !chain.agrees(kinematics, &q)? {
                return Err(PlanningError::Kinematics("they are of another arm than the model".to_owned()));
            }
        }
        Ok(chain)
    }

    /// Rotation and position of the tip in the base frame at `q`, one angle a joint.
    pub fn forward(&mut self, q: &[f64]) -> (Matrix3<f64>, Vector) {
        let mut rotation = Matrix3::identity();
        let mut position = Vector::zeros();
        for (k, joint) in self.joints.iter().enumerate() {
            position += rotation * joint.translation;
            rotation *= joint.rotation;
            self.axes[k] = (rotation * joint.axis.into_inner(), position);
            rotation *= Rotation3::from_axis_angle(&joint.axis, q[k]).into_inner();
        }
        (rotation * self.tip_rotation, position + rotation * self.tip_translation)
    }

    /// Twist of the point at `position`, moved by the tip, per unit of speed of joint `k`: linear first, base frame.
    /// For the angles of the last [`Chain::forward`].
    pub fn column(&self, k: usize, position: &Vector) -> Vector6<f64> {
        let (axis, origin) = &self.axes[k];
        let linear = axis.cross(&(position - origin));
        Vector6::new(linear.x, linear.y, linear.z, axis.x, axis.y, axis.z)
    }

    /// True if the library puts the tip at the same place.
    pub fn agrees(&mut self, kinematics: &mut dyn ArmKinematics, q: &[f64]) -> Result<bool, PlanningError> {
        let theirs = kinematics.forward(q)?;
        let (rotation, position) = self.forward(q);
        let turned = (theirs.rotation.to_rotation_matrix().into_inner() - rotation).norm();
        Ok((theirs.translation.vector - position).norm() < AGREEMENT && turned < AGREEMENT)
    }
}
