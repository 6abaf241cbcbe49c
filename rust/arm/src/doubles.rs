//! An arm for tests that fits in the head.

use crate::{ArmModel, Joint, JointKind, JointLimits, Link};
use proact_types::{Pose, Vector};

/// Three joints about z, y, y, each link 0.3 m along x; no hand.
pub fn three_joint_arm() -> ArmModel {
    let link = |k: usize| Link { name: format!("l{k}"), inertial: None, collisions: vec![], visuals: vec![] };
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
    ArmModel {
        name: "arm".into(),
        links: (0..4).map(link).collect(),
        joints: vec![joint(0, Vector::z()), joint(1, Vector::y()), joint(2, Vector::y())],
        arm: vec![0, 1, 2],
        hand: vec![],
        tip: 3,
        poses: vec![],
        allowed_collisions: vec![],
        ..Default::default()
    }
}

/// Angles of [`three_joint_arm`] within its limits.
#[cfg(test)]
pub(crate) const ANGLE_RANGES: [std::ops::Range<f64>; 3] = [-2.0..2.0, -2.0..2.0, -2.0..2.0];
