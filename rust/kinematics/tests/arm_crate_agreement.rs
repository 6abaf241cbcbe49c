//! The mathematics of `proact-arm` beside KDL, for both arms of this repository, and for one with joints that slide.

use nalgebra::DMatrix;
use proact_arm::{ArmModel, Chain, ChainPoses, JointKind};
use proact_kinematics::{ArmKinematics, Kinematics};
use proact_types::{JointVector, Point, Pose};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

const STATES: usize = 500;
/// Rounding over a dozen joints of an arm of less than a metre, metres and entries of rotations.
const TOLERANCE: f64 = 1e-12;

/// Angles of all moving joints within the limits.
fn configuration(model: &ArmModel, random: &mut ChaCha8Rng) -> JointVector {
    model
        .moving()
        .map(|joint| {
            let limits = &model.joints[joint].limits;
            random.random_range(limits.lower..=limits.upper)
        })
        .collect()
}

/// Largest difference between the entries of two poses as matrices.
fn pose_difference(ours: &Pose, theirs: &Pose) -> f64 {
    (ours.to_homogeneous() - theirs.to_homogeneous()).amax()
}

/// The right arm with a joint of the arm and one of the hand that slide.
fn sliding_arm() -> ArmModel {
    let mut model = proact_description::mpl_right_arm();
    for joint in [model.arm[2], model.hand[5]] {
        let joint = &mut model.joints[joint];
        joint.kind = JointKind::Prismatic;
        (joint.limits.lower, joint.limits.upper) = (-0.2, 0.3);
    }
    model
}

/// `check` for these arms, with random positions of all their joints.
fn for_each_state(mut check: impl FnMut(&ArmModel, &mut Kinematics, &[f64])) {
    let mut random = ChaCha8Rng::seed_from_u64(11);
    let shipped = [proact_description::mpl_right_arm(), proact_description::mpl_left_arm()];
    for model in shipped.into_iter().chain([sliding_arm()]) {
        let mut kinematics = Kinematics::new(&model).expect("the arm is usable");
        for _ in 0..STATES {
            let q = configuration(&model, &mut random);
            check(&model, &mut kinematics, &q);
        }
    }
}

#[test]
fn the_pose_of_the_tip_is_that_of_kdl() {
    for_each_state(|model, kinematics, q| {
        let q = &q[..model.arm_count()];
        let difference =
            pose_difference(&Chain::new(model).forward(q), &kinematics.forward(q).expect("finite angles"));
        assert!(difference < TOLERANCE, "{difference} at {q:?}");
    });
}

#[test]
fn the_jacobian_of_the_tip_is_that_of_kdl() {
    for_each_state(|model, kinematics, q| {
        let (chain, mut poses) = (Chain::new(model), ChainPoses::default());
        let q = &q[..model.arm_count()];
        chain.link_poses_into(q, &mut poses);
        let columns = chain.jacobian(&poses, &Point::from(poses.tip.translation.vector));
        let ours = DMatrix::from_fn(6, q.len(), |row, k| columns[k][row]);
        let difference = (ours - kinematics.jacobian(q).expect("finite angles")).amax();
        assert!(difference < TOLERANCE, "{difference} at {q:?}");
    });
}

#[test]
fn each_link_of_arm_and_hand_is_where_kdl_puts_it() {
    for_each_state(|model, kinematics, q| {
        let theirs = kinematics.link_poses(q).expect("finite angles");
        for ((ours, theirs), link) in model.link_poses(q).iter().zip(&theirs).zip(&model.links) {
            let difference = pose_difference(ours, theirs);
            assert!(difference < TOLERANCE, "{difference} at {}, angles {q:?}", link.name);
        }
    });
}

#[test]
fn the_links_of_the_chain_are_those_of_the_tree() {
    for_each_state(|model, _, q| {
        let (chain, mut poses) = (Chain::new(model), ChainPoses::default());
        chain.link_poses_into(q, &mut poses);
        let links = model.link_poses(q);
        for (&joint, pose) in model.arm.iter().zip(&poses.links) {
            let difference = pose_difference(pose, &links[model.joints[joint].child]);
            assert!(difference < TOLERANCE, "{difference} at {q:?}");
        }
    });
}
