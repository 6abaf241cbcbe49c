//! The left arm is the right arm in the mirror.
#![allow(clippy::unwrap_used)]

use nalgebra::{Matrix4, Vector3, Vector4};
use proact_arm::{Side, VisualGeometry};
use proact_description::{
    MPL_LEFT_ARM_SRDF, MPL_LEFT_ARM_URDF, MPL_RIGHT_ARM_SRDF, MPL_RIGHT_ARM_URDF, mirror, mpl_left_arm,
    mpl_right_arm, parse,
};
use proptest::prelude::*;

/// Sums of a few dozen products of numbers below one.
const TOLERANCE: f64 = 1e-14;

fn reflection() -> Matrix4<f64> {
    Matrix4::from_diagonal(&Vector4::new(1.0, -1.0, 1.0, 1.0))
}

proptest! {
    #[test]
    fn forward_kinematics_of_the_mirror_is_the_mirror_of_forward_kinematics(
        shares in prop::collection::vec(0.0..=1.0, 27)
    ) {
        let (right, left) = (mpl_right_arm(), mpl_left_arm());
        let angles: Vec<f64> = right
            .moving()
            .zip(&shares)
            .map(|(j, share)| {
                let limits = right.joints[j].limits;
                limits.lower + share * (limits.upper - limits.lower)
            })
            .collect();
        for (r, l) in right.link_poses(&angles).iter().zip(left.link_poses(&angles)) {
            let expected = reflection() * r.to_homogeneous() * reflection();
            prop_assert!((expected - l.to_homogeneous()).amax() < TOLERANCE);
        }
    }
}

#[test]
fn the_committed_left_arm_is_what_the_program_makes() {
    let (urdf, srdf) = proact_description::left_arm_texts().unwrap();
    let how = "cargo run --release -p proact-description --example make_left_arm";
    assert!(urdf == MPL_LEFT_ARM_URDF, "mpl_left/arm.urdf differs: {how}");
    assert!(srdf == MPL_LEFT_ARM_SRDF, "mpl_left/arm.srdf differs: {how}");
}

#[test]
fn mass_limits_and_poses_stay_while_inertia_shapes_and_grasp_centre_are_mirrored() {
    let (right, left) = (mpl_right_arm(), mpl_left_arm());
    assert_eq!((right.side, left.side), (Side::Right, Side::Left));
    assert_eq!(left.settings.joints, right.settings.joints);
    assert_eq!(left.settings.levels, right.settings.levels);
    assert_eq!(left.settings.controllers, right.settings.controllers);
    assert_eq!(left.links[left.tip].name, "mpl_left_arm__wristz_link");
    assert!(left.links.iter().skip(1).all(|l| l.name.starts_with("mpl_left_arm__")));
    assert_eq!(left.poses, right.poses);
    assert_eq!(left.allowed_collisions, right.allowed_collisions);
    assert_eq!(left.grasps.len(), right.grasps.len());
    let mirrored = |v: Vector3<f64>| Vector3::new(v.x, -v.y, v.z);
    for (left, right) in left.grasps.iter().zip(&right.grasps) {
        assert_eq!(left.center, mirrored(right.center));
        let [low, high] = right.roll_range_rad;
        assert_eq!((left.roll_rad, left.roll_range_rad), (-right.roll_rad, [-high, -low]));
        assert_eq!(left.withdrawal_direction, mirrored(right.withdrawal_direction));
        assert_eq!(left.closing_direction, right.closing_direction.map(mirrored));
        assert_eq!((&left.open_pose, left.width_range_m), (&right.open_pose, right.width_range_m));
    }
    for (l, r) in left.joints.iter().zip(&right.joints) {
        assert_eq!(l.limits, r.limits);
    }
    let flip = nalgebra::Matrix3::from_diagonal(&nalgebra::Vector3::new(1.0, -1.0, 1.0));
    for (l, r) in left.links.iter().zip(&right.links) {
        assert_eq!(l.collisions.len(), r.collisions.len());
        for (a, b) in l.collisions.iter().zip(&r.collisions) {
            assert_eq!(a.shape, b.shape);
            let expected = reflection() * b.pose.to_homogeneous() * reflection();
            assert!((expected - a.pose.to_homogeneous()).amax() < TOLERANCE, "{}", l.name);
        }
        let (Some(a), Some(b)) = (l.inertial, r.inertial) else { continue };
        let tensor =
            |[xx, xy, xz, yy, yz, zz]: [f64; 6]| nalgebra::Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz);
        assert_eq!(a.mass, b.mass);
        assert_eq!(tensor(a.inertia), flip * tensor(b.inertia) * flip, "{}", l.name);
    }
    let scales = left.links.iter().flat_map(|l| &l.visuals).map(|v| match &v.geometry {
        VisualGeometry::Mesh { scale, .. } => *scale,
        VisualGeometry::Shape(_) => [1.0, -1.0, 1.0],
    });
    assert!(scales.into_iter().all(|[x, y, z]| x > 0.0 && y < 0.0 && z > 0.0));
}

#[test]
fn mirroring_twice_gives_the_same_arm() {
    let twice = mirror(&mirror(MPL_RIGHT_ARM_URDF).unwrap()).unwrap();
    let read = |urdf: &str| parse(urdf, MPL_RIGHT_ARM_SRDF).unwrap();
    assert_eq!(read(&twice), read(MPL_RIGHT_ARM_URDF));
}

#[test]
fn text_that_cannot_be_mirrored_is_refused_with_its_line() {
    let error =
        mirror("<robot>\n<joint name='a'>\n<origin xyz='0 one 0'/></joint></robot>").unwrap_err().to_string();
    assert!(error.contains("<origin> at line 3") && error.contains("0 one 0"), "{error}");
    assert!(mirror("<robot").unwrap_err().to_string().contains("not well-formed"));
}
