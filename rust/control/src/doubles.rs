//! Doubles of the ports, for tests without a native library: an arm to test with and its kinematics in closed form.
//!
//! What they compute is exact for a serial chain, but slower than KDL's and without its
//! care near singularities: tests of control and testbed use them, trials do not.

use crate::ports::{ArmKinematics, IkOutcome, KinematicsError};
use nalgebra::{DMatrix, UnitQuaternion, Vector3, Vector6};
use proact_arm::{
    ArmModel, Chain, ChainPoses, JacobianColumns, Joint, JointKind, JointLimits, Link, NamedPose,
    damped_step_within_limits,
};
use proact_types::{JointVector, Point, Pose, Vector, joints};

/// Where the arm of [`test_arm`] starts a trial, as in the original, rad.
pub const START_RAD: [f64; 7] = [1.029, -0.161, 0.1291, 1.029, 1.57, 0.0174, 0.1006];

/// The seven arm joints of the MPL: name, origin, yaw of the origin, axis, lower and upper limit (Apache-2.0, from
/// the description of the Johns Hopkins APL arm).
type ArmJointRow = (&'static str, [f64; 3], f64, [f64; 3], f64, f64);
const ARM: [ArmJointRow; 7] = [
    ("shoulder", [0.0, 0.0, 0.0], 0.0, [0.0, 0.0, 1.0], -1.4, 1.53),
    ("humerus", [0.00164, -1e-5, 0.12058], -0.01153, [1.0, 0.0, 0.0], -1.35, 0.345),
    ("elbow", [-0.00164, -0.15006, 0.01389], 0.0, [0.0, 1.0, 0.0], -0.697, 1.57),
    ("forearm", [0.01, -0.14441, -0.01534], 0.0, [0.0, 0.0, 1.0], 0.044, 2.61),
    ("wristy", [3e-5, -0.18543, 0.016], 0.0, [0.0, 1.0, 0.0], -1.57, 1.57),
    ("wristx", [-3e-5, -0.04764, 0.00203], 0.0, [0.0, 0.0, -1.0], -0.261, 0.785),
    ("wristz", [0.00018, -0.03, -0.00209], 0.0, [1.0, 0.0, 0.0], -1.04, 1.04),
];

/// How its joints are shown and driven.
const SETTINGS: &str = include_str!("../../../ros1_ws/src/proact_description/arms/mpl_right/arm.toml");

/// The fingers of [`test_hand`]: name, origin at the tip, and the axis about which each closes.
const FINGERS: [(&str, [f64; 3], [f64; 3]); 2] =
    [("thumb", [-0.03, -0.06, -0.03], [0.0, 1.0, 0.0]), ("finger", [0.03, -0.06, -0.03], [0.0, -1.0, 0.0])];
/// Angle of a closed finger, rad; an open one is at zero.
const FINGER_CLOSED_RAD: f64 = 1.2;

/// The seven arm joints of the MPL without its hand: shapes, masses and poses are left out.
pub fn test_arm() -> ArmModel {
    let turned = UnitQuaternion::from_euler_angles(std::f64::consts::FRAC_PI_2, 0.0, 0.0);
    let mut base = joint("base", 0, 1, Pose::from_parts(Default::default(), turned), Vector::x());
    (base.kind, base.limits) = (JointKind::Fixed, JointLimits::default());
    let mut model = ArmModel {
        name: "mpl_right_arm".to_owned(),
        links: vec![link("base_link"), link("forequarter")],
        joints: vec![base],
        arm: (1..=ARM.len()).collect(),
        hand: Vec::new(),
        tip: ARM.len() + 1,
        poses: Vec::new(),
        allowed_collisions: Vec::new(),
        settings: toml::from_str(SETTINGS).expect("the arm's settings are tested where they are read"),
        ..Default::default()
    };
    for (k, (name, xyz, yaw, axis, lower, upper)) in ARM.into_iter().enumerate() {
        model.links.push(link(name));
        let turned = UnitQuaternion::from_euler_angles(0.0, 0.0, yaw);
        let origin = Pose::from_parts(Vector3::from(xyz).into(), turned);
        let mut joint = joint(&format!("mpl_right_arm__{name}"), k + 1, k + 2, origin, axis.into());
        joint.limits = JointLimits { lower, upper, velocity: 0.5, effort: 10.0 };
        model.joints.push(joint);
    }
    model
}

/// [`test_arm`] with a hand of two fingers, the poses `start`, `open` and `closed`, and a place for what is grasped:
/// enough for a whole trial.
pub fn test_hand() -> ArmModel {
    let mut model = test_arm();
    model.name = "arm_with_two_fingers".to_owned();
    for (name, xyz, axis) in FINGERS {
        model.links.push(link(name));
        model.hand.push(model.joints.len());
        let origin = Pose::translation(xyz[0], xyz[1], xyz[2]);
        let mut joint = joint(name, model.tip, model.links.len() - 1, origin, axis.into());
        joint.limits = JointLimits { lower: 0.0, upper: FINGER_CLOSED_RAD, velocity: 2.0, effort: 1.0 };
        model.joints.push(joint);
    }
    let pose = |group: &str, name: &str, angles: &[f64]| NamedPose {
        name: name.to_owned(),
        group: group.to_owned(),
        angles: angles.to_vec(),
    };
    model.poses = vec![
        pose("arm", "start", &START_RAD),
        pose("hand", "open", &[0.0; 2]),
        pose("hand", "closed", &[FINGER_CLOSED_RAD; 2]),
    ];
    // As in the MPL's description.
    model.grasps =
        vec![proact_arm::Grasp { center: Vector::new(0.0145, -0.0825, -0.091), ..Default::default() }];
    model
}

fn link(name: &str) -> Link {
    Link { name: name.to_owned(), inertial: None, collisions: Vec::new(), visuals: Vec::new() }
}

fn joint(name: &str, parent: usize, child: usize, origin: Pose, axis: Vector) -> Joint {
    let limits = JointLimits::default();
    let (kind, damping, friction) = (JointKind::Revolute, 0.0, 0.0);
    Joint { name: name.to_owned(), kind, parent, child, origin, axis, limits, damping, friction }
}

/// Steps of the inverse before it gives up.
const MAX_IK_STEPS: usize = 400;
/// Damping of the inverse, the square of 0.02 in the units of its rows (m and rad).
const DAMPING: f64 = 4e-4;
/// Furthest that a joint turns in one step of the inverse, rad.
const MAX_STEP_RAD: f64 = 0.2;
/// A solution is this near, m and rad.
const TOLERANCE: f64 = 1e-6;

/// Kinematics of an arm, with nothing behind it but [`Chain`].
///
/// Deterministic: the inverse searches from its seed alone, by damped least squares within the joint limits.
#[derive(Clone, Debug)]
pub struct SerialKinematics {
    chain: Chain,
}

impl SerialKinematics {
    /// Kinematics of the arm group of `model`.
    pub fn new(model: &ArmModel) -> Self {
        Self { chain: Chain::new(model) }
    }

    /// Angles within the joint limits at which the point `in_tip` of the tip's frame is at `in_base`, whatever the
    /// attitude of the hand, searched from `seed`.
    ///
    /// # Errors
    /// Wrong length or a value that is not finite.
    pub fn reach(
        &mut self,
        in_tip: &Point,
        in_base: &Point,
        seed: &[f64],
    ) -> Result<IkOutcome, KinematicsError> {
        self.search(seed, |chain, poses| {
            let point = poses.tip * in_tip;
            let mut columns = chain.jacobian(poses, &point);
            columns.iter_mut().for_each(|column| column.fixed_rows_mut::<3>(3).fill(0.0));
            (twist_rows(&(in_base - point), &Vector::zeros()), columns)
        })
    }

    /// Follows the error that `task` gives for the poses of the chain, with the columns that belong to it.
    fn search(
        &mut self,
        seed: &[f64],
        task: impl Fn(&Chain, &ChainPoses) -> (Vector6<f64>, JacobianColumns),
    ) -> Result<IkOutcome, KinematicsError> {
        self.check(seed)?;
        let mut q = joints(seed);
        let mut poses = ChainPoses::default();
        for _ in 0..MAX_IK_STEPS {
            self.chain.link_poses_into(&q, &mut poses);
            let (error, mut columns) = task(&self.chain, &poses);
            if error.norm() < TOLERANCE {
                return Ok(IkOutcome::Solved(q));
            }
            damped_step_within_limits(
                &mut q,
                self.chain.limits(),
                &mut columns,
                &error,
                DAMPING,
                MAX_STEP_RAD,
            );
        }
        Ok(IkOutcome::NotFound)
    }

    fn check(&self, q: &[f64]) -> Result<(), KinematicsError> {
        let expected = self.chain.joint_count();
        if q.len() != expected {
            return Err(KinematicsError::WrongJointCount { got: q.len(), expected });
        }
        match q.iter().position(|value| !value.is_finite()) {
            Some(index) => Err(KinematicsError::NotFinite { what: "joint angle", index, value: q[index] }),
            None => Ok(()),
        }
    }
}

fn twist_rows(linear: &Vector, angular: &Vector) -> Vector6<f64> {
    Vector6::from_iterator(linear.iter().chain(angular).copied())
}

impl ArmKinematics for SerialKinematics {
    fn joint_count(&self) -> usize {
        self.chain.joint_count()
    }

    fn forward(&mut self, q: &[f64]) -> Result<Pose, KinematicsError> {
        self.check(q)?;
        Ok(self.chain.forward(q))
    }

    fn jacobian(&mut self, q: &[f64]) -> Result<DMatrix<f64>, KinematicsError> {
        self.check(q)?;
        let mut poses = ChainPoses::default();
        self.chain.link_poses_into(q, &mut poses);
        let tip = Point::from(poses.tip.translation.vector);
        let columns = self.chain.jacobian(&poses, &tip);
        Ok(DMatrix::from_fn(6, columns.len(), |row, k| columns[k][row]))
    }

    fn inverse(&mut self, base_from_tip: &Pose, seed: &[f64]) -> Result<IkOutcome, KinematicsError> {
        let target: JointVector = base_from_tip.to_homogeneous().as_slice()[..16].iter().copied().collect();
        if let Some(index) = target.iter().position(|value| !value.is_finite()) {
            let value = target[index];
            return Err(KinematicsError::NotFinite { what: "entry of the pose", index, value });
        }
        self.search(seed, |chain, poses| {
            let tip = Point::from(poses.tip.translation.vector);
            let linear = base_from_tip.translation.vector - tip.coords;
            let angular = (base_from_tip.rotation * poses.tip.rotation.inverse()).scaled_axis();
            (twist_rows(&linear, &angular), chain.jacobian(poses, &tip))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn within_limits() -> impl Strategy<Value = Vec<f64>> {
        // Some way off the limits, where the search is not cut short.
        ARM.map(|(.., lower, upper)| 0.9 * lower + 0.1 * upper..0.1 * lower + 0.9 * upper).to_vec()
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        // Catches an inverse that leaves the limits, or that calls itself solved elsewhere.
        #[test]
        fn the_inverse_leads_back_within_the_limits(q in within_limits(), turn in -0.2_f64..0.2) {
            let mut arm = SerialKinematics::new(&test_hand());
            let target = arm.forward(&q).expect("finite angles");
            let seed: Vec<f64> = q.iter().map(|angle| angle + turn).collect();
            if let IkOutcome::Solved(found) = arm.inverse(&target, &seed).expect("finite numbers") {
                let there = arm.forward(&found).expect("finite angles");
                prop_assert!((there.translation.vector - target.translation.vector).norm() < 2e-6);
                prop_assert!(there.rotation.angle_to(&target.rotation) < 2e-6);
                let inside = |(angle, row): (&f64, &ArmJointRow)| (row.4..=row.5).contains(angle);
                prop_assert!(found.iter().zip(&ARM).all(inside), "{found:?}");
            }
        }
    }

    #[test]
    fn a_point_out_of_reach_is_not_found_and_nonsense_is_refused() {
        let mut arm = SerialKinematics::new(&test_hand());
        let mut reach =
            |x: f64| arm.reach(&Point::new(0.0, -0.08, 0.0), &Point::new(x, -0.3, -0.3), &START_RAD);
        assert!(matches!(reach(0.1), Ok(IkOutcome::Solved(_))));
        assert_eq!(reach(5.0), Ok(IkOutcome::NotFound));
        assert!(matches!(arm.forward(&START_RAD[..6]), Err(KinematicsError::WrongJointCount { .. })));
        let refused = arm.inverse(&Pose::translation(f64::NAN, 0.0, 0.0), &START_RAD);
        assert!(matches!(refused, Err(KinematicsError::NotFinite { .. })), "{refused:?}");
    }
}
