//! An arm in the size of its wearer.

use crate::{ArmModel, CollisionShape, Visual, VisualGeometry};
use proact_types::{Pose, Shape, Vector};

/// Lengths of segments as shares of the stature: Drillis and Contini 1966, as Winter prints them (Biomechanics and Motor Control
/// of Human Movement, fig. 4.1): shoulder to elbow, elbow to wrist. The two figures are recalled and not looked up.
pub const UPPER_ARM_RATIO: f64 = 0.186;
/// See [`UPPER_ARM_RATIO`].
pub const FOREARM_RATIO: f64 = 0.146;

/// Statures that people have, metres.
const STATURE_RANGE_M: std::ops::RangeInclusive<f64> = 1.0..=2.4;
/// Position of the elbow among the joints of an arm of seven.
const ELBOW_INDEX: usize = 3;
const JOINT_COUNT: usize = 7;
/// A limb is straight along an axis of its links if it is off by less than this, rad.
const MAX_BEND_RAD: f64 = 0.2;

/// Why an arm cannot be given the size of a person.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum StatureScalingError {
    /// No stature.
    #[error("stature is {got} m, expected 1.0 to 2.4")]
    Stature {
        /// What was given.
        got: f64,
    },
    /// An arm that nobody wears, or that is built in another way.
    #[error(
        "{0}; expected an arm of seven joints that is worn, straight at angle zero along an axis of its links"
    )]
    UnsupportedArm(String),
}

/// Lengths before and after, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SegmentLengths {
    /// Shoulder to elbow.
    pub upper_arm_m: f64,
    /// Elbow to wrist.
    pub forearm_m: f64,
}

/// `model` with upper arm and forearm as long as those of a person of `stature` metres: all that lies along the limb between
/// shoulder and wrist is stretched in that direction. Gives the lengths before, too.
///
/// The hand is a device and keeps its size; masses, tensors and limits stay, centres of mass move with their links.
///
/// # Errors
/// [`StatureScalingError`].
pub fn scale_to_stature(
    model: &ArmModel,
    stature: f64,
) -> Result<(ArmModel, [SegmentLengths; 2]), StatureScalingError> {
    if !STATURE_RANGE_M.contains(&stature) {
        return Err(StatureScalingError::Stature { got: stature });
    }
    if model.arm.len() != JOINT_COUNT {
        return Err(StatureScalingError::UnsupportedArm(format!("the arm has {} joints", model.arm.len())));
    }
    if model.settings.fixed_base.is_some() {
        return Err(StatureScalingError::UnsupportedArm("the arm stands by itself".to_owned()));
    }
    let before = segment_lengths(model)?;
    let after = SegmentLengths { upper_arm_m: UPPER_ARM_RATIO * stature, forearm_m: FOREARM_RATIO * stature };
    let mut sized = model.clone();
    let along = limb_axis(model)?;
    for (position, joint) in model.arm[..JOINT_COUNT - 1].iter().enumerate() {
        let factor = if position < ELBOW_INDEX {
            after.upper_arm_m / before.upper_arm_m
        } else {
            after.forearm_m / before.forearm_m
        };
        stretch(&mut sized, model.joints[*joint].child, along, factor);
    }
    Ok((sized, [before, after]))
}

/// Where a joint's link is at angle zero, in the base.
fn rest_pose(model: &ArmModel, position: usize) -> Pose {
    model.link_poses(&[])[model.joints[model.arm[position]].child]
}

/// The axis of the links along which the limb lies, 0 to 2.
fn limb_axis(model: &ArmModel) -> Result<usize, StatureScalingError> {
    let (elbow, wrist) = (rest_pose(model, ELBOW_INDEX), rest_pose(model, JOINT_COUNT - 1));
    let limb = elbow.rotation.inverse() * (wrist.translation.vector - elbow.translation.vector);
    let axis = limb.iamax();
    let mut unit = Vector::zeros();
    unit[axis] = limb[axis].signum();
    let parallel = (0..JOINT_COUNT - 1)
        .all(|position| rest_pose(model, position).rotation.angle_to(&elbow.rotation) < MAX_BEND_RAD);
    if limb.norm() < 1e-6 || limb.angle(&unit) > MAX_BEND_RAD || !parallel {
        return Err(StatureScalingError::UnsupportedArm("the arm is bent at angle zero".to_owned()));
    }
    Ok(axis)
}

/// Lengths along the limb.
fn segment_lengths(model: &ArmModel) -> Result<SegmentLengths, StatureScalingError> {
    let axis = limb_axis(model)?;
    let of = |from: usize, to: usize| {
        let joints = &model.arm[from + 1..=to];
        joints.iter().map(|joint| model.joints[*joint].origin.translation.vector[axis]).sum::<f64>().abs()
    };
    let found =
        SegmentLengths { upper_arm_m: of(0, ELBOW_INDEX), forearm_m: of(ELBOW_INDEX, JOINT_COUNT - 1) };
    if found.upper_arm_m < 0.05 || found.forearm_m < 0.05 {
        let SegmentLengths { upper_arm_m: upper_arm, forearm_m: forearm } = found;
        return Err(StatureScalingError::UnsupportedArm(format!(
            "upper arm and forearm are {upper_arm:.3} and {forearm:.3} m long"
        )));
    }
    Ok(found)
}

/// Stretches all that hangs on a link along one of its axes: the next joint, shapes, centre of mass.
fn stretch(model: &mut ArmModel, link: usize, axis: usize, factor: f64) {
    let moved = |pose: &mut Pose| pose.translation.vector[axis] *= factor;
    for joint in model.joints.iter_mut().filter(|joint| joint.parent == link) {
        moved(&mut joint.origin);
    }
    let link = &mut model.links[link];
    if let Some(inertial) = &mut link.inertial {
        moved(&mut inertial.pose);
    }
    for CollisionShape { pose, shape } in &mut link.collisions {
        moved(pose);
        *shape = stretch_shape(*shape, pose, axis, factor);
    }
    for Visual { pose, geometry, .. } in &mut link.visuals {
        moved(pose);
        match geometry {
            VisualGeometry::Shape(shape) => *shape = stretch_shape(*shape, pose, axis, factor),
            VisualGeometry::Mesh { scale, .. } => scale[shape_axis(pose, axis)] *= factor,
        }
    }
}

/// The axis of a shape in `pose` that lies nearest to an axis of its link.
fn shape_axis(pose: &Pose, axis: usize) -> usize {
    let mut unit = Vector::zeros();
    unit[axis] = 1.0;
    (pose.rotation.inverse() * unit).iamax()
}

/// A shape along the axis becomes longer; a ball, and what lies across it, keeps its size.
fn stretch_shape(shape: Shape, pose: &Pose, axis: usize, factor: f64) -> Shape {
    let own = shape_axis(pose, axis);
    match shape {
        Shape::Box { mut size } => {
            size[own] *= factor;
            Shape::Box { size }
        }
        Shape::Cylinder { radius, length } if own == 2 => Shape::Cylinder { radius, length: length * factor },
        Shape::Capsule { radius, length } if own == 2 => Shape::Capsule { radius, length: length * factor },
        other => other,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::doubles::three_joint_arm;

    #[test]
    fn a_stature_that_nobody_has_and_an_arm_of_three_joints_are_refused() {
        let refused =
            |stature| scale_to_stature(&three_joint_arm(), stature).expect_err("refused").to_string();
        assert_eq!(refused(0.3), "stature is 0.3 m, expected 1.0 to 2.4");
        assert!(refused(f64::NAN).contains("NaN"));
        assert!(refused(1.7).starts_with("the arm has 3 joints; expected an arm of seven joints"));
    }

    #[test]
    fn a_tube_along_the_limb_becomes_longer_and_one_across_it_does_not() {
        let upright = Shape::Cylinder { radius: 0.02, length: 0.1 };
        let along = Pose::rotation(Vector::x() * std::f64::consts::FRAC_PI_2);
        assert_eq!(
            stretch_shape(upright, &along, 1, 1.5),
            Shape::Cylinder { radius: 0.02, length: 0.1 * 1.5 }
        );
        assert_eq!(stretch_shape(upright, &Pose::identity(), 1, 1.5), upright);
        let block = Shape::Box { size: [0.1, 0.2, 0.3] };
        assert_eq!(stretch_shape(block, &Pose::identity(), 1, 2.0), Shape::Box { size: [0.1, 0.4, 0.3] });
    }
}
