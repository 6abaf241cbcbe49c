//! What a practised person knows of the arm: where the hand goes when a joint turns, and which few joints would
//! have to turn for the hand to be somewhere. A model in the head, apart from the kinematics that drive the arm.

mod turn_sequences;

use arrayvec::ArrayVec;
use nalgebra::{UnitQuaternion, Vector6};
use proact_arm::{ArmModel, Chain, ChainPoses, damped_step, upright_axis};
use proact_types::{JointVector, Point, Pose, Shape, Vector};
use std::sync::Arc;

pub(crate) use turn_sequences::{JointTurn, TurnConstraints, apply_turns, back_is_shorter};

/// Position of the elbow among the arm joints: what hangs on it is minded.
const ELBOW: usize = 3;
/// Places of forearm and wrist that are minded, at most.
const MAX_COLLISION_SPHERES: usize = 16;
/// Steps of the search for joint angles.
const STEPS: usize = 40;
/// Damping of a step, metres: the search stays calm where the arm is stretched.
const DAMPING: f64 = 0.03;
/// One radian of the hand's tilt counts as this many metres: first the place, then the attitude.
const TILT_WEIGHT_M_PER_RAD: f64 = 0.03;
/// Largest change of a joint in one step, rad.
const STEP_MAX: f64 = 0.2;
/// The search ends when a step is shorter than this, rad.
const STEP_MIN: f64 = 1e-4;

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
    /// A metre too high counts as this many.
    pub(crate) excess_height_weight: f64,
    /// How far off the point may be, metres.
    pub(crate) point_tolerance_m: f64,
    /// How far off upright the axis may be, rad.
    pub(crate) tilt_tolerance_rad: f64,
    /// Where the yaw is not free: `base_from_tip`'s rotation.
    pub(crate) orientation: Option<UnitQuaternion<f64>>,
}

impl HandGoal {
    /// What `base_from_tip` leaves: metres of the point, and rad of tilt, or of all attitude.
    pub(crate) fn error(&self, base_from_tip: &Pose) -> (f64, f64) {
        let tilt = match &self.orientation {
            Some(wanted) => base_from_tip.rotation.angle_to(wanted),
            None => (base_from_tip.rotation * self.axis).angle(&self.up),
        };
        let off = self.target - base_from_tip * self.point;
        // Too high by as much is less of a fault than too far to the side.
        let high = -off.dot(&self.up);
        let aside = off + self.up * high;
        (aside.norm().hypot(if high > 0.0 { high * self.excess_height_weight } else { high }), tilt)
    }

    /// True if nothing is left to do.
    pub(crate) fn is_reached(&self, base_from_tip: &Pose) -> bool {
        let (off, tilt) = self.error(base_from_tip);
        off <= self.point_tolerance_m && tilt <= self.tilt_tolerance_rad
    }
}

/// The arm as its user knows it.
#[derive(Clone, Debug)]
pub(crate) struct InternalArmModel {
    model: Arc<ArmModel>,
    chain: Chain,
    forearm_spheres: Vec<ArmCollisionSphere>,
}

/// A place in the arm, and how thick the arm is there.
#[derive(Clone, Copy, Debug)]
struct ArmCollisionSphere {
    /// Position of the joint that carries it.
    joint: usize,
    /// In the frame of the link behind that joint.
    center: Point,
    /// Metres.
    radius: f64,
}

/// How the arm stands: where its hand and its thick places are, in `base_link`.
#[derive(Clone, Debug)]
pub(crate) struct ArmPosture {
    /// `base_from_tip`.
    pub(crate) tip: Pose,
    /// Places in forearm and wrist, and how thick the arm is there, metres.
    pub(crate) forearm_spheres: ArrayVec<(Point, f64), MAX_COLLISION_SPHERES>,
}

impl InternalArmModel {
    pub(crate) fn new(model: Arc<ArmModel>) -> Self {
        let (chain, forearm) = (Chain::new(&model), collision_spheres(&model));
        Self { model, chain, forearm_spheres: forearm }
    }

    /// Joints of the arm.
    pub(crate) fn joint_count(&self) -> usize {
        self.chain.joint_count()
    }

    /// Where the middle of a grasped object of `width` is, metres, in the tip's frame.
    pub(crate) fn grasp_center(&self, width: f64) -> Point {
        Point::from(self.model.grasp_for(width).center)
    }

    /// The same for the widest objects.
    pub(crate) fn widest_grasp_center(&self) -> Point {
        Point::from(self.model.widest_grasp().center)
    }

    /// The axis of the tip's frame that is up when the fingers close around a standing object of `width`, metres; unit
    /// length.
    pub(crate) fn grasp_axis(&self, width: f64) -> Vector {
        upright_axis(self.model.grasp_for(width).roll_rad, 0.0)
    }

    /// How many joints the arm has.
    pub(crate) fn joints(&self) -> usize {
        self.model.arm_count()
    }

    /// How the arm stands at the angles `q`.
    pub(crate) fn posture(&self, q: &[f64]) -> ArmPosture {
        let mut poses = ChainPoses::default();
        self.chain.link_poses_into(q, &mut poses);
        let sphere_at = |bulge: &ArmCollisionSphere| (poses.links[bulge.joint] * bulge.center, bulge.radius);
        ArmPosture { tip: poses.tip, forearm_spheres: self.forearm_spheres.iter().map(sphere_at).collect() }
    }

    /// Where bones, joints and tips of the fingers are in the tip's frame at the angles `moving` of all joints.
    pub(crate) fn finger_points(&self, moving: &[f64]) -> Vec<Point> {
        self.model.finger_points(moving)
    }

    /// `base_from_tip` at the arm angles `q`.
    pub(crate) fn forward(&self, q: &[f64]) -> Pose {
        self.chain.forward(q)
    }

    /// Arm angles near `from` that bring the hand toward the goal by turning the joints of the set `moved` alone.
    pub(crate) fn inverse(&self, from: &[f64], goal: &HandGoal, moved: u32) -> JointVector {
        let mut q: JointVector = from.iter().copied().collect();
        let mut poses = ChainPoses::default();
        for _ in 0..STEPS {
            self.chain.link_poses_into(&q, &mut poses);
            let point = poses.tip * goal.point;
            let axis = poses.tip.rotation * goal.axis;
            let off = goal.target - point;
            let tilt = match &goal.orientation {
                Some(wanted) => (wanted * poses.tip.rotation.inverse()).scaled_axis(),
                None => axis.cross(&goal.up),
            } * TILT_WEIGHT_M_PER_RAD;
            let error = Vector6::from_iterator(off.iter().chain(tilt.iter()).copied());
            let mut columns = self.chain.jacobian(&poses, &point);
            for (k, column) in columns.iter_mut().enumerate() {
                if moved >> k & 1 == 0 {
                    column.fill(0.0);
                    continue;
                }
                let about: Vector = column.fixed_rows::<3>(3).into();
                let leans = match goal.orientation {
                    Some(_) => about,
                    None => goal.up.cross(&about.cross(&axis)),
                } * TILT_WEIGHT_M_PER_RAD;
                column.fixed_rows_mut::<3>(3).copy_from(&leans);
            }
            let Some(step) = damped_step(&columns, &error, DAMPING * DAMPING) else { break };
            let mut max_reach = 0.0_f64;
            for (k, limits) in self.chain.limits().iter().enumerate() {
                let next = (q[k] + step[k].clamp(-STEP_MAX, STEP_MAX)).clamp(limits.lower, limits.upper);
                max_reach = max_reach.max((next - q[k]).abs());
                q[k] = next;
            }
            if max_reach < STEP_MIN {
                break;
            }
        }
        q
    }
}

/// Ends and middle of each tube of forearm and wrist: what hangs on the elbow or behind it, before the hand.
fn collision_spheres(model: &ArmModel) -> Vec<ArmCollisionSphere> {
    let last = model.arm.len().saturating_sub(1);
    let of_joint = |k: usize| {
        let link = &model.links[model.joints[model.arm[k]].child];
        link.collisions.iter().flat_map(move |part| {
            let (radius, half) = match part.shape {
                Shape::Cylinder { radius, length } | Shape::Capsule { radius, length } => {
                    (radius, length / 2.0)
                }
                Shape::Sphere { radius } => (radius, 0.0),
                _ => return vec![],
            };
            let position =
                |z: f64| ArmCollisionSphere { joint: k, center: part.pose * Point::new(0.0, 0.0, z), radius };
            if half > radius {
                vec![position(-half), position(0.0), position(half)]
            } else {
                vec![position(0.0)]
            }
        })
    };
    (ELBOW.min(last)..last).flat_map(of_joint).take(MAX_COLLISION_SPHERES).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proact_arm::{CollisionShape, Joint, Link, doubles::three_joint_arm};

    pub(super) fn arm() -> InternalArmModel {
        InternalArmModel::new(Arc::new(three_joint_arm()))
    }

    #[test]
    fn forearm_and_wrist_are_where_the_joints_take_them_and_the_hand_is_not_among_them() {
        let mut model = three_joint_arm();
        let tube = |length: f64| CollisionShape {
            pose: Pose::rotation(Vector::y() * std::f64::consts::FRAC_PI_2)
                * Pose::translation(0.0, 0.0, 0.1),
            shape: Shape::Cylinder { radius: 0.03, length },
        };
        let link = model.links[3].clone();
        for k in 3..5 {
            model.joints.push(Joint {
                name: format!("j{k}"),
                parent: k,
                child: k + 1,
                ..model.joints[2].clone()
            });
            model.links.push(Link { name: format!("l{}", k + 1), ..link.clone() });
            model.arm.push(k);
        }
        model.tip = 5;
        // On the elbow, which is the fourth joint, and on the hand, which is the fifth.
        model.links[4].collisions = vec![tube(0.1), tube(0.02)];
        model.links[5].collisions = vec![tube(0.1)];
        let quarter = std::f64::consts::FRAC_PI_2;
        let stance = InternalArmModel::new(Arc::new(model)).posture(&[quarter, 0.0, 0.0, quarter, 0.3]);
        // A quarter turn to y, out by three links, and a quarter turn down at the elbow.
        let expected = [-0.05, -0.1, -0.15, -0.1].map(|z| (Point::new(0.0, 0.9, z), 0.03));
        assert_eq!(stance.forearm_spheres.len(), expected.len(), "{:?}", stance.forearm_spheres);
        for ((at, radius), (point, thick)) in stance.forearm_spheres.iter().zip(&expected) {
            assert!((at - point).norm() < 1e-12 && radius == thick, "{at}, expected {point}");
        }
    }

    pub(super) fn goal(arm: &InternalArmModel) -> HandGoal {
        let wanted = arm.forward(&[0.4, -0.5, 0.9]);
        HandGoal {
            point: Point::new(0.1, 0.0, 0.0),
            axis: Vector::z(),
            target: wanted * Point::new(0.1, 0.0, 0.0),
            up: wanted.rotation * Vector::z(),
            excess_height_weight: 1.0,
            point_tolerance_m: 0.01,
            tilt_tolerance_rad: 0.1,
            orientation: None,
        }
    }

    #[test]
    fn angles_are_found_that_bring_hand_and_axis_to_the_goal_and_what_is_out_of_reach_is_told() {
        let arm = arm();
        let near = goal(&arm);
        let q = arm.inverse(&[0.0, 0.1, 0.1], &near, 0b111);
        assert!(near.is_reached(&arm.forward(&q)), "{:?} left at {q:?}", near.error(&arm.forward(&q)));
        let wanted = arm.forward(&[0.4, -0.5, 0.9]).rotation;
        let whole = HandGoal { orientation: Some(wanted), ..near };
        let q = arm.inverse(&[0.0, 0.1, 0.1], &whole, 0b111);
        assert!(whole.is_reached(&arm.forward(&q)), "{:?} left at {q:?}", whole.error(&arm.forward(&q)));
        let far = HandGoal { target: Point::new(3.0, 0.0, 0.0), ..near };
        assert!(far.error(&arm.forward(&arm.inverse(&[0.0, 0.1, 0.1], &far, 0b111))).0 > 1.0);
    }
}
