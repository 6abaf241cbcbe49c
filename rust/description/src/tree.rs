//! From urdfdom's links and joints to an ordered tree, each part judged on the way.

use crate::{
    bridge::ffi::{
        JointKind as RawJointKind, RawJoint, RawLink, RawPose, RawRobot, RawShape, ShapeKind as RawShapeKind,
    },
    finding::{Findings, join_names, joint_location as joint_place, link_location as link_place},
    size_limits::{
        MAX_ANGLE_RAD, MAX_CHAIN_DEPTH, MAX_EFFORT, MAX_INERTIA_KG_M2, MAX_LENGTH_M, MAX_MASS_KG,
        MAX_VELOCITY_RAD_PER_S, MIN_EFFORT, MIN_LENGTH_M, MIN_MASS_KG, MIN_MOMENT_SHARE,
        MIN_VELOCITY_RAD_PER_S, check_at_most,
    },
};
use nalgebra::{Matrix3, Quaternion, Translation3, UnitQuaternion};
use proact_arm::{
    CollisionShape, Inertial, Joint, JointKind, JointLimits, Link, Mimic, Visual, VisualGeometry,
};
use proact_types::{Pose, Shape, Vector};
use std::collections::BTreeMap;

/// Below this length, metres or none, an axis has no direction.
const MIN_AXIS_NORM: f64 = 1e-9;
/// Share by which principal moments may break the triangle inequality: files round to about five digits.
const TRIANGLE_TOLERANCE: f64 = 1e-3;
/// Efforts from here on, N m, are placeholders: no prosthesis or lab arm reaches them.
const PLACEHOLDER_EFFORT: f64 = 5000.0;

/// Links, parent before child, and joints by child: joint `k` moves link `k + 1`.
pub(crate) struct LinkTree {
    pub(crate) links: Vec<Link>,
    pub(crate) joints: Vec<Joint>,
    pub(crate) mimics: Vec<Mimic>,
}

/// Orders the parts depth first, siblings by the joint's name, and judges each of them.
pub(crate) fn build(raw: &RawRobot, findings: &mut Findings) -> LinkTree {
    let mut children: BTreeMap<&str, Vec<&RawJoint>> = BTreeMap::new();
    let mut parents: BTreeMap<&str, Vec<&RawJoint>> = BTreeMap::new();
    for joint in &raw.joints {
        children.entry(&joint.parent).or_default().push(joint);
        parents.entry(&joint.child).or_default().push(joint);
    }
    for (child, joints) in parents.iter().filter(|(_, joints)| joints.len() > 1) {
        findings.error(
            link_place(child),
            "the link hangs on several joints, so the links form a loop",
            join_names(joints.iter().map(|j| j.name.as_str())),
            "one joint per link",
            "Cut the loop: remove all but one of these joints.",
        );
    }

    let by_name: BTreeMap<&str, &RawLink> = raw.links.iter().map(|l| (l.name.as_str(), l)).collect();
    let mut tree = LinkTree { links: Vec::new(), joints: Vec::new(), mimics: Vec::new() };
    let mut reached: BTreeMap<&str, usize> = BTreeMap::new();
    let mut todo: Vec<(Option<&RawJoint>, &str)> = vec![(None, &raw.root)];
    while let Some((joint, name)) = todo.pop() {
        let Some(raw_link) = by_name.get(name) else { continue };
        if reached.contains_key(name) {
            continue;
        }
        let index = tree.links.len();
        reached.insert(name, index);
        tree.links.push(link(raw_link, findings));
        if let Some(raw_joint) = joint {
            let parent = reached.get(raw_joint.parent.as_str()).copied().unwrap_or_default();
            tree.joints.push(self::joint(raw_joint, parent, index, findings));
        }
        // A stack: the first sibling goes in last.
        todo.extend(children.get(name).into_iter().flatten().rev().map(|j| (Some(*j), j.child.as_str())));
    }
    for lost in raw.links.iter().filter(|l| !reached.contains_key(l.name.as_str())) {
        findings.error(
            link_place(&lost.name),
            "the link does not hang on the base, so its joints form a loop",
            format!("no way from \"{}\"", raw.root),
            "a chain of joints from the base",
            "Cut the loop at one joint and hang its child on the rest of the tree.",
        );
    }
    tree.mimics = mimics(raw, &tree.joints, findings);
    check_depth(&tree, findings);
    warn_massless_links(&tree, findings);
    tree
}

/// A chain of more joints than any arm has.
fn check_depth(tree: &LinkTree, findings: &mut Findings) {
    let mut depths = vec![0_usize; tree.links.len()];
    for joint in &tree.joints {
        // Parents stand before their children.
        depths[joint.child] = depths[joint.parent] + 1;
    }
    if let Some(link) = depths.iter().position(|depth| *depth > MAX_CHAIN_DEPTH) {
        findings.error(
            link_place(&tree.links[link].name),
            "too many joints lie between it and the base",
            depths[link],
            format!("at most {MAX_CHAIN_DEPTH}"),
            "Leave out links that are fixed to another one.",
        );
    }
}

/// A moving part without mass cannot be simulated; kinematics does without.
fn warn_massless_links(tree: &LinkTree, findings: &mut Findings) {
    for joint in tree.joints.iter().filter(|j| j.kind.moves()) {
        // The rigid body that the joint moves: its link and all that is fixed to it. Parents come first.
        let mut body = vec![joint.child];
        for fixed in tree.joints.iter().filter(|j| j.kind == JointKind::Fixed) {
            if body.contains(&fixed.parent) {
                body.push(fixed.child);
            }
        }
        if body.iter().all(|&l| tree.links[l].inertial.is_none()) {
            findings.warning(
                link_place(&tree.links[joint.child].name),
                "the link moves but has no mass, so it cannot be simulated",
                "no <inertial>",
                "<inertial> with mass and inertia",
                "Add mass properties, or use the arm for kinematics only.",
            );
        }
    }
}

fn pose(raw: &RawPose, location: &str, findings: &mut Findings) -> Pose {
    let [x, y, z] = raw.position;
    let [qx, qy, qz, qw] = raw.quaternion;
    let quaternion = Quaternion::new(qw, qx, qy, qz);
    let numbers = raw.position.iter().chain(&raw.quaternion);
    if numbers.clone().any(|v| !v.is_finite()) || quaternion.norm() < MIN_AXIS_NORM {
        findings.error(
            location,
            "an origin is not usable",
            format!("position {:?}, quaternion {:?}", raw.position, raw.quaternion),
            "finite numbers",
            "Correct the origin.",
        );
        return Pose::identity();
    }
    for value in raw.position {
        check_at_most(MAX_LENGTH_M, "m", "a coordinate of an origin", value, location, findings);
    }
    Pose::from_parts(Translation3::new(x, y, z), UnitQuaternion::from_quaternion(quaternion))
}

fn link(raw: &RawLink, findings: &mut Findings) -> Link {
    let location = link_place(&raw.name);
    let inertial = raw.has_inertial.then(|| inertial(raw, &location, findings));
    let mut collisions = Vec::new();
    for collision in &raw.collisions {
        let pose = pose(&collision.pose, &location, findings);
        match primitive(&collision.shape, &location, findings) {
            Some(shape) => collisions.push(CollisionShape { pose, shape }),
            None => findings.error(
                &location,
                "a mesh cannot be used for collision",
                format!("\"{}\"", collision.shape.file),
                "box, cylinder or sphere",
                "Replace the mesh by a few primitives that enclose it.",
            ),
        }
    }
    let mut visuals = Vec::new();
    for visual in &raw.visuals {
        let pose = pose(&visual.pose, &location, findings);
        let geometry = match primitive(&visual.shape, &location, findings) {
            Some(shape) => VisualGeometry::Shape(shape),
            None => VisualGeometry::Mesh { file: visual.shape.file.clone(), scale: visual.shape.size },
        };
        visuals.push(Visual { pose, geometry, color: visual.color });
    }
    if inertial.is_some() && collisions.is_empty() {
        findings.warning(
            &location,
            "the link has mass but no collision shape, so nothing will notice when it hits something",
            "no usable <collision>",
            "at least one primitive",
            "Add a box, cylinder or sphere that encloses the link.",
        );
    }
    Link { name: raw.name.clone(), inertial, collisions, visuals }
}

fn inertial(raw: &RawLink, location: &str, findings: &mut Findings) -> Inertial {
    let pose = pose(&raw.inertial_pose, location, findings);
    if !(raw.mass.is_finite() && raw.mass > 0.0) {
        findings.error(
            location,
            "the mass is not above zero",
            format!("{} kg", raw.mass),
            "a finite number above zero, kg",
            "Weigh the part, or remove its <inertial> if the link is only a frame.",
        );
    }
    check_at_most(MAX_MASS_KG, "kg", "the mass", raw.mass, location, findings);
    if raw.mass > 0.0 && raw.mass < MIN_MASS_KG {
        let (got, expected) = (format!("{:e} kg", raw.mass), format!("at least {MIN_MASS_KG:e} kg"));
        let remedy = "Remove its <inertial> if the link is only a frame.";
        findings.error(location, "the mass is too small to be simulated", got, expected, remedy);
    }
    for value in raw.inertia {
        check_at_most(MAX_INERTIA_KG_M2, "kg m^2", "a moment of inertia", value, location, findings);
    }
    let [ixx, ixy, ixz, iyy, iyz, izz] = raw.inertia;
    let tensor = Matrix3::new(ixx, ixy, ixz, ixy, iyy, iyz, ixz, iyz, izz);
    if raw.inertia.iter().all(|v| v.is_finite()) {
        let mut moments: [f64; 3] = tensor.symmetric_eigenvalues().into();
        moments.sort_by(f64::total_cmp);
        let [min, middle, max] = moments;
        if min <= MIN_MOMENT_SHARE * max {
            findings.error(
                location,
                "the inertia is not that of a body",
                format!("principal moments {min:.3e}, {middle:.3e}, {max:.3e} kg m^2"),
                "all three above zero",
                "Compute the inertia about the centre of mass again; check signs and units.",
            );
        } else if min + middle < max * (1.0 - TRIANGLE_TOLERANCE) {
            // An engine can integrate this, and exporters write it often, so it is no error.
            findings.warning(
                location,
                "no body has this inertia: one principal moment exceeds the sum of the others",
                format!("{min:.3e} + {middle:.3e} < {max:.3e} kg m^2"),
                "each at most the sum of the other two",
                "Compute the inertia about the centre of mass again.",
            );
        }
    } else {
        let got = format!("{:?}", raw.inertia);
        findings.error(
            location,
            "the inertia is not finite",
            got,
            "six finite numbers",
            "Correct the inertia.",
        );
    }
    Inertial { mass: raw.mass, pose, inertia: raw.inertia }
}

/// The primitive that `raw` stands for; none for a mesh.
fn primitive(raw: &RawShape, location: &str, findings: &mut Findings) -> Option<Shape> {
    let [a, b, c] = raw.size;
    let (shape, kind, lengths) = match raw.kind {
        RawShapeKind::Box => (Shape::Box { size: raw.size }, "box", vec![a, b, c]),
        RawShapeKind::Cylinder => (Shape::Cylinder { radius: a, length: b }, "cylinder", vec![a, b]),
        RawShapeKind::Sphere => (Shape::Sphere { radius: a }, "sphere", vec![a]),
        _ => return None,
    };
    if lengths.iter().any(|v| !(v.is_finite() && *v > 0.0)) {
        findings.error(
            location,
            format!("a {kind} has no size"),
            format!("{lengths:?} m"),
            "finite lengths above zero",
            "Correct the shape, or remove it.",
        );
    }
    for &length in &lengths {
        check_at_most(MAX_LENGTH_M, "m", &format!("a size of a {kind}"), length, location, findings);
        if length > 0.0 && length < MIN_LENGTH_M {
            let (got, expected) = (format!("{length:e} m"), format!("at least {MIN_LENGTH_M:e} m"));
            let remedy = "Check the unit: metres.";
            findings.error(
                location,
                format!("a {kind} is too small to touch anything"),
                got,
                expected,
                remedy,
            );
        }
    }
    Some(shape)
}

/// As URDF spells it.
fn urdf_name(kind: RawJointKind) -> &'static str {
    match kind {
        RawJointKind::Fixed => "fixed",
        RawJointKind::Revolute => "revolute",
        RawJointKind::Continuous => "continuous",
        RawJointKind::Prismatic => "prismatic",
        RawJointKind::Planar => "planar",
        RawJointKind::Floating => "floating",
        _ => "unknown",
    }
}

fn joint(raw: &RawJoint, parent: usize, child: usize, findings: &mut Findings) -> Joint {
    let location = joint_place(&raw.name);
    let kind = match raw.kind {
        RawJointKind::Fixed => JointKind::Fixed,
        RawJointKind::Revolute => JointKind::Revolute,
        RawJointKind::Continuous => JointKind::Continuous,
        RawJointKind::Prismatic => JointKind::Prismatic,
        other => {
            findings.error(
                &location,
                "the type is not supported",
                urdf_name(other),
                "revolute, continuous, prismatic or fixed",
                "Make it fixed, or model the part with several joints.",
            );
            JointKind::Fixed
        }
    };
    let moves = kind.moves();
    Joint {
        name: raw.name.clone(),
        kind,
        parent,
        child,
        origin: pose(&raw.origin, &location, findings),
        axis: if moves { axis(raw, &location, findings) } else { Vector::x() },
        limits: if moves { limits(raw, kind, &location, findings) } else { JointLimits::default() },
        damping: checked_dissipation(raw.damping, "damping", &location, findings),
        friction: checked_dissipation(raw.friction, "friction", &location, findings),
    }
}

fn axis(raw: &RawJoint, location: &str, findings: &mut Findings) -> Vector {
    let axis = Vector::from(raw.axis);
    // Written so that NaN, for which every comparison is false, is refused too.
    if !(axis.norm() > MIN_AXIS_NORM && axis.norm().is_finite()) {
        findings.error(
            location,
            "the axis has no direction",
            format!("{:?}", raw.axis),
            "three finite numbers that are not all zero",
            "Give the direction about or along which the joint moves.",
        );
        return Vector::x();
    }
    axis.normalize()
}

/// The joints that follow others, with their masters.
fn mimics(raw: &RawRobot, joints: &[Joint], findings: &mut Findings) -> Vec<Mimic> {
    let mut mimics = Vec::new();
    for follower in raw.joints.iter().filter(|joint| !joint.mimic_joint.is_empty()) {
        let location = joint_place(&follower.name);
        let index = |name: &str| joints.iter().position(|joint| joint.name == name && joint.kind.moves());
        let follows =
            |name: &str| raw.joints.iter().any(|joint| joint.name == name && !joint.mimic_joint.is_empty());
        let [multiplier, offset] = follower.mimic;
        let master = index(&follower.mimic_joint).filter(|_| !follows(&follower.mimic_joint));
        let (Some(joint), Some(master)) = (index(&follower.name), master) else {
            findings.error(
                location,
                "the joint that it follows is none",
                format!("<mimic joint=\"{}\">", follower.mimic_joint),
                "a joint that moves and follows no other",
                "Name the joint that leads, or remove <mimic>.",
            );
            continue;
        };
        if !(multiplier.is_finite() && offset.is_finite() && multiplier != 0.0) {
            let (got, remedy) = (format!("multiplier {multiplier}, offset {offset}"), "Correct <mimic>.");
            findings.error(
                location,
                "the coupling is not usable",
                got,
                "finite numbers, the multiplier not zero",
                remedy,
            );
            continue;
        }
        check_at_most(MAX_ANGLE_RAD, "", "the multiplier of <mimic>", multiplier, &location, findings);
        check_at_most(MAX_ANGLE_RAD, "rad", "the offset of <mimic>", offset, &location, findings);
        mimics.push(Mimic { joint, master, multiplier, offset });
    }
    mimics
}

fn limits(raw: &RawJoint, kind: JointKind, location: &str, findings: &mut Findings) -> JointLimits {
    let [mut lower, mut upper, velocity, effort] = raw.limits;
    let (unit, effort_unit) = (kind.unit(), kind.effort_unit());
    let speed_unit = format!("{unit}/s");
    if kind == JointKind::Continuous {
        (lower, upper) = (-1.0, 1.0);
    }
    if !raw.has_limits || raw.limits.iter().any(|v| !v.is_finite()) {
        findings.error(
            location,
            "the limits are not usable",
            format!("lower {lower}, upper {upper}, velocity {velocity}, effort {effort}"),
            "four finite numbers",
            "Give <limit lower upper velocity effort>; velocity and effort alone for a continuous joint.",
        );
    } else if lower > upper {
        findings.error(
            location,
            "the limits are reversed",
            format!("lower {lower}, upper {upper} {unit}"),
            "lower at most upper",
            "Swap them.",
        );
    } else if lower == upper {
        findings.warning(
            location,
            "the joint cannot move",
            format!("lower = upper = {lower} {unit}"),
            "lower below upper",
            "Make the joint fixed unless its place in joint vectors is wanted.",
        );
    }
    // What slides is held to the lengths of an arm.
    let farthest = if kind == JointKind::Prismatic { MAX_LENGTH_M } else { MAX_ANGLE_RAD };
    check_at_most(farthest, unit, "the lower limit", lower, location, findings);
    check_at_most(farthest, unit, "the upper limit", upper, location, findings);
    check_at_most(MAX_VELOCITY_RAD_PER_S, &speed_unit, "the velocity limit", velocity, location, findings);
    check_at_most(MAX_EFFORT, effort_unit, "the effort limit", effort, location, findings);
    let (least_velocity, least_effort) = (MIN_VELOCITY_RAD_PER_S, MIN_EFFORT);
    for (name, value, least, unit) in
        [("velocity", velocity, least_velocity, &*speed_unit), ("effort", effort, least_effort, effort_unit)]
    {
        let (problem, got) = (format!("the {name} limit is not above zero"), format!("{value} {unit}"));
        let remedy = format!("Give the highest {name} of the joint.");
        if value < 0.0 {
            findings.error(location, problem, got, "a number above zero", remedy);
        } else if value == 0.0 {
            findings.warning(location, problem, got, "a number above zero", remedy);
        } else if value < least {
            let problem = format!("the {name} limit is too small");
            findings.error(location, problem, got, format!("at least {least} {unit}"), remedy);
        }
    }
    if effort >= PLACEHOLDER_EFFORT {
        findings.warning(
            location,
            "the effort limit limits nothing",
            format!("{effort} {effort_unit}"),
            format!("below {PLACEHOLDER_EFFORT} {effort_unit}"),
            "Give what the motor can do, or three times the largest static torque.",
        );
    }
    if kind == JointKind::Continuous {
        (lower, upper) = (-JointLimits::CONTINUOUS_RANGE_RAD, JointLimits::CONTINUOUS_RANGE_RAD);
    }
    JointLimits { lower, upper, velocity, effort }
}

fn checked_dissipation(value: f64, name: &str, location: &str, findings: &mut Findings) -> f64 {
    if !(value.is_finite() && value >= 0.0) {
        let expected = "a finite number, zero or above";
        findings.error(location, format!("the {name} is not usable"), value, expected, "Correct <dynamics>.");
    }
    check_at_most(MAX_EFFORT, "in SI units", &format!("the {name}"), value, location, findings);
    value
}
