use crate::{ArmModel, JointKind, JointLimits};
use arrayvec::ArrayVec;
use nalgebra::{Translation3, Unit, UnitQuaternion, Vector6};
use proact_types::{MAX_JOINTS, Point, Pose, Vector};

/// One column for each joint: the twist of a point by a unit of the joint's speed, linear first, base frame; or what a
/// task counts of it. Lives on the stack.
pub type JacobianColumns = ArrayVec<Vector6<f64>, MAX_JOINTS>;

/// The arm group from the base to the tip. Immutable; where it is at some angles goes into a [`ChainPoses`].
///
/// Joints that do not belong to the arm group keep the angle zero. Nothing here allocates after construction.
#[derive(Clone, Debug)]
pub struct Chain {
    hinges: Vec<Hinge>,
    /// `hinge_from_tip`, behind the last hinge.
    tip: Pose,
    limits: Vec<JointLimits>,
}

/// A moving joint with all that is fixed before it.
#[derive(Clone, Copy, Debug)]
struct Hinge {
    /// From the hinge before, at position zero.
    origin: Pose,
    axis: Unit<Vector>,
    /// It moves along its axis, and not about it.
    slides: bool,
}

impl Hinge {
    /// Where the link behind the hinge is, for the link before it at `pose`.
    fn child_pose(&self, pose: Pose, position: f64) -> Pose {
        if self.slides {
            return pose * self.origin * Translation3::from(self.axis.into_inner() * position);
        }
        pose * self.origin * UnitQuaternion::from_axis_angle(&self.axis, position)
    }
}

/// Where the links of a [`Chain`] are, base frame.
#[derive(Clone, Debug, Default)]
pub struct ChainPoses {
    /// Of the link behind each joint, in the order of the chain.
    pub links: ArrayVec<Pose, MAX_JOINTS>,
    /// Of the tip.
    pub tip: Pose,
}

impl Chain {
    /// The arm group of `model`.
    pub fn new(model: &ArmModel) -> Self {
        let mut path = Vec::new();
        let mut link = model.tip;
        while link > 0 {
            // Joint k moves link k + 1.
            path.push(link - 1);
            link = model.joints[link - 1].parent;
        }
        let (mut hinges, mut limits, mut fixed) = (Vec::new(), Vec::new(), Pose::identity());
        for &index in path.iter().rev() {
            let joint = &model.joints[index];
            fixed *= joint.origin;
            if joint.kind.moves() && model.arm.contains(&index) {
                let slides = joint.kind == JointKind::Prismatic;
                hinges.push(Hinge { origin: fixed, axis: Unit::new_normalize(joint.axis), slides });
                limits.push(joint.limits);
                fixed = Pose::identity();
            }
        }
        Self { hinges, tip: fixed, limits }
    }

    /// Number of joints.
    pub fn joint_count(&self) -> usize {
        self.hinges.len()
    }

    /// Limits of the joints, base to tip.
    pub fn limits(&self) -> &[JointLimits] {
        &self.limits
    }

    /// Forward kinematics: writes where the links are at the positions `q` of the arm, rad or m, base to tip. Further angles, such as
    /// those of the hand, are ignored.
    ///
    /// # Panics
    /// If `q` has fewer angles than [`Chain::joint_count`].
    pub fn link_poses_into(&self, q: &[f64], poses: &mut ChainPoses) {
        assert!(q.len() >= self.hinges.len(), "an angle for each joint of the chain");
        let mut pose = Pose::identity();
        poses.links.clear();
        for (hinge, angle) in self.hinges.iter().zip(q) {
            pose = hinge.child_pose(pose, *angle);
            poses.links.push(pose);
        }
        poses.tip = pose * self.tip;
    }

    /// `base_from_tip` at the angles `q`, as [`Chain::place`].
    ///
    /// # Panics
    /// As [`Chain::place`].
    pub fn forward(&self, q: &[f64]) -> Pose {
        assert!(q.len() >= self.hinges.len(), "an angle for each joint of the chain");
        let chain = self.hinges.iter().zip(q);
        chain.fold(Pose::identity(), |pose, (hinge, angle)| hinge.child_pose(pose, *angle)) * self.tip
    }

    /// Column of the geometric Jacobian: the twist of the point that is at `point` and moves with the tip, per unit of
    /// speed of joint `joint`; linear first, base frame. `poses` is where the links are.
    ///
    /// # Panics
    /// If the chain has no such joint.
    pub fn jacobian_column(&self, poses: &ChainPoses, joint: usize, point: &Point) -> Vector6<f64> {
        let link = &poses.links[joint];
        let axis = link.rotation * self.hinges[joint].axis.into_inner();
        if self.hinges[joint].slides {
            return Vector6::new(axis.x, axis.y, axis.z, 0.0, 0.0, 0.0);
        }
        let linear = axis.cross(&(point.coords - link.translation.vector));
        Vector6::new(linear.x, linear.y, linear.z, axis.x, axis.y, axis.z)
    }

    /// The geometric Jacobian at `point`, column by column as [`Chain::jacobian_column`].
    pub fn jacobian(&self, poses: &ChainPoses, point: &Point) -> JacobianColumns {
        (0..self.hinges.len()).map(|joint| self.jacobian_column(poses, joint, point)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::doubles::{ANGLE_RANGES, three_joint_arm};
    use proptest::prelude::*;

    #[test]
    fn the_hand_is_where_trigonometry_says() {
        let chain = Chain::new(&three_joint_arm());
        let tip = chain.forward(&[std::f64::consts::FRAC_PI_2, 0.0, 0.5]);
        assert!((tip.translation.vector - Vector::new(0.0, 0.6, 0.0)).norm() < 1e-12, "{tip}");
    }

    proptest! {
        // Catches a Jacobian with swapped rows, a wrong sign, or a lever to the wrong point.
        #[test]
        fn the_jacobian_is_the_derivative_of_a_point_of_the_hand(q in ANGLE_RANGES, k in 0_usize..3) {
            const H: f64 = 1e-6;
            let chain = Chain::new(&three_joint_arm());
            let in_tip = Point::new(0.1, -0.02, 0.05);
            let mut poses = ChainPoses::default();
            chain.link_poses_into(&q, &mut poses);
            let column = chain.jacobian(&poses, &(poses.tip * in_tip))[k];
            let at = |h: f64| {
                let mut q = q;
                q[k] += h;
                chain.forward(&q)
            };
            let (before, after) = (at(-H), at(H));
            let linear = (after * in_tip - before * in_tip) / (2.0 * H);
            let angular = (after.rotation * before.rotation.inverse()).scaled_axis() / (2.0 * H);
            prop_assert!((column.fixed_rows::<3>(0) - linear).norm() < 1e-8);
            prop_assert!((column.fixed_rows::<3>(3) - angular).norm() < 1e-8);
        }

        #[test]
        fn chain_and_tree_put_every_link_at_the_same_place(q in ANGLE_RANGES) {
            let model = three_joint_arm();
            let chain = Chain::new(&model);
            let mut poses = ChainPoses::default();
            chain.link_poses_into(&q, &mut poses);
            let links = model.link_poses(&q);
            for (&joint, pose) in model.arm.iter().zip(&poses.links) {
                let off = links[model.joints[joint].child].inv_mul(pose);
                prop_assert!(off.translation.vector.norm() < 1e-15 && off.rotation.angle() < 1e-15);
            }
            prop_assert_eq!(poses.tip, chain.forward(&q));
            let off = links[model.tip].inv_mul(&poses.tip);
            prop_assert!(off.translation.vector.norm() < 1e-15 && off.rotation.angle() < 1e-15);
        }
    }
}
