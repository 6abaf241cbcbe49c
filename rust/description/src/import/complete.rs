//! What a description lacks, made whole: one tree with one base, mass where something moves, limits for every joint.

use super::{
    fit,
    meshes::TriangleMesh,
    mount,
    parts::{PartKind, PlacedGeometry, RobotParts, note_joint, note_link},
};
use crate::{
    finding::{Findings, Severity, join_names, link_location},
    size_limits::{MAX_EFFORT, MAX_VELOCITY_RAD_PER_S, MIN_EFFORT, MIN_MASS_KG, MIN_VELOCITY_RAD_PER_S},
};
use nalgebra::Matrix3;
use proact_arm::{Inertial, VisualGeometry};
use proact_types::{Pose, Shape, Vector};
use std::{collections::BTreeMap, f64::consts::PI};

/// Where a file gives none: of the order of aluminium castings with motors and air in them, kg/m^3.
const DENSITY_KG_PER_M3: f64 = 1000.0;
/// Mass of a part without mass and shape, kg, and its radius, metres.
const TOKEN_MASS_KG: f64 = 0.01;
const TOKEN_RADIUS_M: f64 = 0.01;
/// Speed of a joint that the file does not limit, rad/s and m/s.
const VELOCITY_RAD_PER_S: f64 = 1.0;
const VELOCITY_M_PER_S: f64 = 0.1;
/// Smallest effort limit that is filled in, N m and N.
const LEAST_FILLED_IN_EFFORT: f64 = 1.0;
const LEAST_FILLED_IN_FORCE_N: f64 = 20.0;
/// Factor between the largest static torque and an effort limit that is filled in.
const EFFORT_FACTOR: f64 = 3.0;
const GRAVITY_M_PER_S2: f64 = 9.81;
/// A revolute joint without limits gets these, rad.
const RANGE_RAD: [f64; 2] = [-PI, PI];
/// ... and a prismatic one these, metres.
const RANGE_M: [f64; 2] = [-1.0, 1.0];
/// Limits from here on stand for none: more turns than degrees are written for, more metres than an arm has.
const NO_LIMIT_RAD: f64 = 1000.0;
const NO_LIMIT_M: f64 = 10.0;
/// A link's size from here on, metres, is one in millimetres.
const GIANT_M: f64 = 10.0;
/// An angle from here on, rad, is one in degrees.
const DEGREES_FROM_RAD: f64 = 13.0;

/// Leaves the part that hangs on `base`; without it, on the root that carries most joints.
pub(crate) fn choose_base(parts: &mut RobotParts, base: Option<&str>, findings: &mut Findings) {
    let carriers = parts.carriers();
    let moving = |root: usize, parts: &RobotParts| {
        parts
            .below(root)
            .iter()
            .filter(|&&link| carriers[link].is_some_and(|joint| parts.joints[joint].kind.moves()))
            .count()
    };
    let roots: Vec<usize> = (0..parts.links.len()).filter(|&link| carriers[link].is_none()).collect();
    let root = match base {
        Some(name) => parts.link(name),
        None => roots.iter().copied().rev().max_by_key(|&root| moving(root, parts)),
    };
    let Some(root) = root else {
        if parts.links.is_empty() {
            let remedy = "Give the file that has the links and joints, such as the one that xacro makes.";
            findings.error("URDF", "it describes nothing", "no <link>", "the links of an arm", remedy);
            return;
        }
        let known = join_names(parts.links.iter().map(|link| link.name.as_str()));
        let got = base.map_or("none: every link hangs on another".to_owned(), |name| format!("\"{name}\""));
        findings.error(
            "URDF",
            "there is no such base",
            got,
            known,
            "Name the link at the arm's base with --base.",
        );
        return;
    };
    if base.is_none() && roots.len() > 1 {
        let others =
            roots.iter().filter(|&&other| other != root).map(|&other| parts.links[other].name.as_str());
        let got = join_names(others);
        findings.add(
            Severity::Note,
            "URDF",
            "there are several trees",
            got,
            format!("one, on \"{}\"", parts.links[root].name),
            "The others are left out; --base chooses another.",
        );
    }
    // A link that hangs on two joints closes a loop, which no tree has: the first joint of the file stays.
    let mut carried = vec![false; parts.links.len()];
    let mut cut = Vec::new();
    let names: Vec<String> = parts.links.iter().map(|link| link.name.clone()).collect();
    parts.joints.retain(|joint| {
        let again = std::mem::replace(&mut carried[joint.child], true) || joint.child == root;
        if again {
            cut.push((joint.name.clone(), names[joint.child].clone()));
        }
        !again
    });
    for (joint, child) in cut {
        note_joint(
            findings,
            &joint,
            "it closes a loop",
            &format!("\"{child}\" hangs on another joint too"),
            "a tree",
            "This joint is left out.",
        );
    }
    let kept = parts.below(root);
    parts.retain_links(&kept);
}

/// Leaves the chain to `tip` and what hangs on it moving; every other joint is held at zero, or at the nearest of its limits.
pub(crate) fn hold_beside_chain(parts: &mut RobotParts, tip: &str, findings: &mut Findings) {
    let Some(tip_index) = parts.link(tip) else {
        let known = join_names(parts.links.iter().map(|link| link.name.as_str()));
        findings.error(
            "URDF",
            "there is no such tip",
            format!("\"{tip}\""),
            known,
            "Name the link at the arm's end with --tip.",
        );
        return;
    };
    let carriers = parts.carriers();
    // A row of joints beyond the tip is no hand.
    let mut free =
        if mount::branches_below(parts, tip_index) { parts.below(tip_index) } else { vec![tip_index] };
    let mut link = tip_index;
    while let Some(joint) = carriers[link] {
        free.push(link);
        link = parts.joints[joint].parent;
    }
    let names: Vec<String> = parts
        .joints
        .iter()
        .filter(|j| j.kind.moves() && !free.contains(&j.child))
        .map(|j| j.name.clone())
        .collect();
    for name in names {
        let held = hold(parts, &name);
        note_joint(
            findings,
            &name,
            "the joint is not of the chosen arm",
            "it moves",
            "a joint of the arm or hand",
            &format!("It is held at {held}."),
        );
    }
}

/// Fixes a joint at zero, or at its nearest limit; where that is.
pub(crate) fn hold(parts: &mut RobotParts, name: &str) -> f64 {
    let Some(joint) = parts.joints.iter_mut().find(|joint| joint.name == name) else { return 0.0 };
    let [low, high] = joint.range.filter(|[low, high]| low <= high).unwrap_or([0.0, 0.0]);
    let at = 0.0_f64.clamp(low, high);
    let motion = match joint.kind {
        PartKind::Prismatic => Pose::translation(joint.axis.x * at, joint.axis.y * at, joint.axis.z * at),
        _ => Pose::rotation(joint.axis * at),
    };
    joint.origin *= motion;
    (joint.kind, joint.mimic, joint.range) = (PartKind::Fixed, None, None);
    at
}

/// Follows chains of `<mimic>` to the joint that moves by itself. A joint that follows one that stands is held; a loop is cut.
pub(crate) fn resolve_mimics(parts: &mut RobotParts, findings: &mut Findings) {
    for index in 0..parts.joints.len() {
        let Some(mut mimic) = parts.joints[index].mimic.clone() else { continue };
        let name = parts.joints[index].name.clone();
        let (mut steps, mut in_circle) = (0, false);
        let resolved = loop {
            let Some(master) = parts.joints.iter().find(|joint| joint.name == mimic.master) else {
                break None;
            };
            steps += 1;
            in_circle = steps > parts.joints.len() || master.name == name;
            if in_circle || !(mimic.multiplier.is_finite() && mimic.multiplier != 0.0) {
                break None;
            }
            match &master.mimic {
                Some(next) => {
                    // q = m (m' q' + o') + o
                    (mimic.multiplier, mimic.offset) =
                        (mimic.multiplier * next.multiplier, mimic.multiplier * next.offset + mimic.offset);
                    mimic.master.clone_from(&next.master);
                }
                None => break master.kind.moves().then_some(mimic),
            }
        };
        if resolved.is_none() {
            let got =
                parts.joints[index].mimic.as_ref().map(|mimic| mimic.master.clone()).unwrap_or_default();
            let factor = parts.joints[index].mimic.as_ref().map_or(1.0, |mimic| mimic.multiplier);
            let (problem, got, expected) = if factor == 0.0 {
                ("it follows another joint by nothing", format!("multiplier 0 of {got}"), "a multiplier")
            } else if in_circle {
                ("joints follow each other in a circle", got, "a joint that moves by itself")
            } else {
                ("the joint that it follows does not move", got, "a joint that moves")
            };
            note_joint(findings, &name, problem, &got, expected, "It moves by itself.");
        } else if steps > 1 {
            let got = format!(
                "it follows joint \"{}\" by {steps} steps",
                resolved.as_ref().map_or("", |m| m.master.as_str())
            );
            note_joint(
                findings,
                &name,
                "a coupling of a coupling",
                &got,
                "one step",
                "The factors are multiplied.",
            );
        }
        parts.joints[index].mimic = resolved;
    }
}

/// Gives joints that follow others the range in which these take them: they move no other way. A joint of the arm
/// without range is held.
pub(crate) fn complete_followers(parts: &mut RobotParts, findings: &mut Findings) {
    let carriers = parts.carriers();
    let arm: Vec<usize> =
        std::iter::successors(carriers[mount::palm(parts)], |&joint| carriers[parts.joints[joint].parent])
            .collect();
    for index in 0..parts.joints.len() {
        let joint = &parts.joints[index];
        let name = joint.name.clone();
        // A finger may have one for its place among the others; a planner has no use for it.
        let cannot_move = joint.kind != PartKind::Continuous && joint.range.is_some_and(|[a, b]| a == b);
        if joint.kind.moves() && cannot_move && arm.contains(&index) {
            let held = hold(parts, &name);
            let done = format!("It is held at {held}.");
            note_joint(findings, &name, "the joint cannot move", "lower = upper", "lower below upper", &done);
            parts
                .joints
                .iter_mut()
                .filter(|joint| joint.mimic.as_ref().is_some_and(|m| m.master == name))
                .for_each(|joint| joint.mimic = None);
            continue;
        }
        let Some(mimic) = &joint.mimic else { continue };
        let master =
            parts.joints.iter().find(|joint| joint.name == mimic.master).and_then(|joint| joint.range);
        let (Some(master), Some([low, high])) = (master, joint.range) else { continue };
        let mut ends = master.map(|end| mimic.multiplier * end + mimic.offset);
        ends.sort_by(f64::total_cmp);
        if ends[0] < low - 1e-9 || ends[1] > high + 1e-9 {
            let got = format!("lower {low}, upper {high}");
            let expected = format!("{:.4} to {:.4}, where \"{}\" takes it", ends[0], ends[1], mimic.master);
            note_joint(
                findings,
                &name,
                "the joint follows another beyond its limits",
                &got,
                &expected,
                "Its limits are widened.",
            );
            parts.joints[index].range = Some([low.min(ends[0]), high.max(ends[1])]);
        }
    }
}

/// Links that are drawn and have no shape for contacts get the drawn shapes.
pub(crate) fn complete_collisions(parts: &mut RobotParts, findings: &mut Findings) {
    for link in &mut parts.links {
        if !link.collisions.is_empty() || link.visuals.is_empty() {
            continue;
        }
        link.collisions = link
            .visuals
            .iter()
            .map(|visual| PlacedGeometry { pose: visual.pose, geometry: visual.geometry.clone() })
            .collect();
        note_link(
            findings,
            &link.name,
            "the link has no shape for contacts",
            "no usable <collision>",
            "a shape",
            "It gets the shapes that are drawn.",
        );
    }
}

/// Joints of the arm follow no other: each that does moves by itself, and so does a joint of the hand that follows one of the arm.
pub(crate) fn uncouple_arm(parts: &mut RobotParts, tip: usize, findings: &mut Findings) {
    let carriers = parts.carriers();
    let chain: Vec<usize> =
        std::iter::successors(carriers[tip], |&joint| carriers[parts.joints[joint].parent]).collect();
    let of_arm: Vec<String> = chain.iter().map(|&joint| parts.joints[joint].name.clone()).collect();
    for (index, joint) in parts.joints.iter_mut().enumerate() {
        let Some(mimic) = &joint.mimic else { continue };
        if chain.contains(&index) || of_arm.contains(&mimic.master) {
            let got = format!("it follows joint \"{}\"", mimic.master);
            let done = "It moves by itself.";
            note_joint(
                findings,
                &joint.name,
                "joints of the arm are coupled",
                &got,
                "joints of the hand",
                done,
            );
            joint.mimic = None;
        }
    }
}

/// Notes lengths in millimetres and angles in degrees, which are refused.
pub(crate) fn find_wrong_units(parts: &RobotParts, findings: &mut Findings) {
    let far = |joint: &&super::parts::PartJoint| joint.origin.translation.vector.norm() > GIANT_M;
    if let Some(joint) = parts.joints.iter().find(far) {
        let got = format!(
            "joint \"{}\" {:.0} m from the one before",
            joint.name,
            joint.origin.translation.vector.norm()
        );
        findings.error(
            "URDF",
            "lengths look like millimetres",
            got,
            format!("at most {GIANT_M} m"),
            "Write lengths in metres.",
        );
    }
    let wide = |joint: &&super::parts::PartJoint| {
        joint.kind == PartKind::Revolute
            && joint.range.is_some_and(|range| {
                range.iter().any(|angle| (DEGREES_FROM_RAD..NO_LIMIT_RAD).contains(&angle.abs()))
            })
    };
    if let Some(joint) = parts.joints.iter().find(wide) {
        let range = joint.range.unwrap_or_default();
        let got = format!("joint \"{}\" from {} to {}", joint.name, range[0], range[1]);
        findings.error(
            "URDF",
            "angles look like degrees",
            got,
            format!("at most {DEGREES_FROM_RAD} rad"),
            "Write angles in radians, or make the joint continuous.",
        );
    }
}

/// Gives every joint limits.
pub(crate) fn complete_limits(parts: &mut RobotParts, findings: &mut Findings) {
    let torques = static_torques(parts);
    for (joint, torque) in parts.joints.iter_mut().zip(torques) {
        if !joint.kind.moves() {
            continue;
        }
        let slides = joint.kind == PartKind::Prismatic;
        // As some exporters write a joint whose limits were not filled in.
        let is_blank = |value: Option<f64>| value.is_none_or(|value| value == 0.0);
        if joint.range == Some([0.0, 0.0]) && is_blank(joint.velocity) && is_blank(joint.effort) {
            joint.range = None;
        }
        let (unit, effort_unit) = if slides { ("m", "N") } else { ("rad", "N m") };
        let no_limit = if slides { NO_LIMIT_M } else { NO_LIMIT_RAD };
        if let Some(range) = joint.range.filter(|range| range.iter().any(|end| end.abs() >= no_limit)) {
            let done = if slides {
                joint.range = Some(RANGE_M);
                "It gets a metre each way."
            } else {
                (joint.range, joint.kind) = (None, PartKind::Continuous);
                "It turns for ever."
            };
            let got = format!("lower {}, upper {}", range[0], range[1]);
            note_joint(findings, &joint.name, "the limits limit nothing", &got, unit, done);
        }
        if let Some([low, high]) = joint.range.filter(|[low, high]| low > high) {
            joint.range = Some([high, low]);
            note_joint(
                findings,
                &joint.name,
                "the limits are reversed",
                &format!("lower {low}, upper {high}"),
                "lower at most upper",
                "They are swapped.",
            );
        }
        if joint.range.is_none() && joint.kind != PartKind::Continuous {
            let (range, done) = if slides {
                (RANGE_M, "It gets a metre each way.")
            } else {
                (RANGE_RAD, "It gets half a turn each way.")
            };
            joint.range = Some(range);
            let expected = format!("lower and upper, {unit}");
            note_joint(
                findings,
                &joint.name,
                "the joint has no limits",
                "no <limit>, or zeros alone",
                &expected,
                done,
            );
        }
        if joint.velocity.is_none_or(|v| !(MIN_VELOCITY_RAD_PER_S..=MAX_VELOCITY_RAD_PER_S).contains(&v)) {
            let speed = if slides { VELOCITY_M_PER_S } else { VELOCITY_RAD_PER_S };
            joint.velocity = Some(speed);
            note_joint(
                findings,
                &joint.name,
                "the speed is not limited",
                "no velocity above 0",
                &format!("{unit}/s"),
                &format!("It gets {speed} {unit}/s."),
            );
        }
        if joint.effort.is_none_or(|e| !(MIN_EFFORT..=MAX_EFFORT).contains(&e)) {
            let least = if slides { LEAST_FILLED_IN_FORCE_N } else { LEAST_FILLED_IN_EFFORT };
            let effort = (EFFORT_FACTOR * torque).max(least);
            // Two digits: the number is an estimate.
            let scale = 10f64.powf(effort.log10().floor() - 1.0);
            let effort = (effort / scale).ceil() * scale;
            joint.effort = Some(effort);
            let done = format!(
                "It gets {effort:.3}, {EFFORT_FACTOR} times what its masses could put on it at their longest reach."
            );
            note_joint(
                findings,
                &joint.name,
                "the effort is not limited",
                "no effort above 0",
                effort_unit,
                &done,
            );
        }
    }
}

/// An upper bound of what gravity can put on each joint, N m: each mass at its longest reach from the joint. Of what slides, N:
/// the weight of all that it carries.
fn static_torques(parts: &RobotParts) -> Vec<f64> {
    let mut torques = vec![0.0; parts.joints.len()];
    let carriers = parts.carriers();
    for (link, part) in parts.links.iter().enumerate() {
        let Some(inertial) = part.inertial else { continue };
        let mut reach = inertial.pose.translation.vector.norm();
        let mut at = link;
        while let Some(joint) = carriers[at] {
            let lever = if parts.joints[joint].kind == PartKind::Prismatic { 1.0 } else { reach };
            torques[joint] += inertial.mass * GRAVITY_M_PER_S2 * lever;
            reach += parts.joints[joint].origin.translation.vector.norm();
            at = parts.joints[joint].parent;
        }
    }
    torques
}

/// Gives mass to every part that moves: by the file's mass, by shape and density, or a token.
pub(crate) fn complete_masses(
    parts: &mut RobotParts,
    meshes: &BTreeMap<String, Result<TriangleMesh, String>>,
    findings: &mut Findings,
) {
    for index in 0..parts.links.len() {
        let link = &parts.links[index];
        let Some(mass) = link.mass_kg.filter(|_| link.inertial.is_none()) else { continue };
        let (inertial, by) = body_of_link(parts, index, meshes, Some(mass.max(MIN_MASS_KG)));
        let name = parts.links[index].name.clone();
        note_link(
            findings,
            &name,
            "the inertia is missing or not that of a body",
            &format!("mass {mass} kg"),
            "a tensor with moments above 0",
            &format!("It is computed from {by}."),
        );
        parts.links[index].inertial = Some(inertial);
    }
    for joint in (0..parts.joints.len()).filter(|&joint| parts.joints[joint].kind.moves()).collect::<Vec<_>>()
    {
        let child = parts.joints[joint].child;
        if parts.links[child].inertial.is_some() {
            continue;
        }
        let name = parts.links[child].name.clone();
        let body = rigid_body(parts, child);
        let masses: Vec<(Pose, Inertial)> =
            body.iter().filter_map(|(link, pose)| Some((*pose, parts.links[*link].inertial?))).collect();
        if masses.is_empty() {
            let (inertial, by) = body_of_link(parts, child, meshes, None);
            let done = format!("It gets {:.3} kg, from {by}.", inertial.mass);
            note_link(
                findings,
                &name,
                "the link moves but has no mass",
                "no usable <inertial>",
                "mass and inertia",
                &done,
            );
            parts.links[child].inertial = Some(inertial);
        } else {
            for (link, _) in &body {
                parts.links[*link].inertial = None;
            }
            parts.links[child].inertial = Some(sum(&masses));
            note_link(
                findings,
                &name,
                "the link is a frame that others are fixed to",
                "no mass",
                "mass on the link that moves",
                "It gets their masses.",
            );
        }
    }
}

/// The links that are fixed to `link`, itself first, each with `link_from_other`.
pub(crate) fn rigid_body(parts: &RobotParts, link: usize) -> Vec<(usize, Pose)> {
    let mut body = vec![(link, Pose::identity())];
    let mut next = 0;
    while let Some(&(at, pose)) = body.get(next) {
        next += 1;
        let fixed = parts.joints.iter().filter(|joint| joint.parent == at && !joint.kind.moves());
        body.extend(fixed.map(|joint| (joint.child, pose * joint.origin)));
    }
    body
}

/// One body of several, each with `link_from_part`.
fn sum(masses: &[(Pose, Inertial)]) -> Inertial {
    let mass: f64 = masses.iter().map(|(_, part)| part.mass).sum();
    let center = |pose: &Pose, part: &Inertial| (pose * part.pose).translation.vector;
    let mean = masses.iter().map(|(pose, part)| center(pose, part) * part.mass).sum::<Vector>() / mass;
    let tensor: Matrix3<f64> = masses
        .iter()
        .map(|(pose, part)| {
            let turn = (pose * part.pose).rotation.to_rotation_matrix();
            let [ixx, ixy, ixz, iyy, iyz, izz] = part.inertia;
            let own = Matrix3::new(ixx, ixy, ixz, ixy, iyy, iyz, ixz, iyz, izz);
            let away = center(pose, part) - mean;
            let steiner = Matrix3::identity() * away.norm_squared() - away * away.transpose();
            turn.matrix() * own * turn.matrix().transpose() + steiner * part.mass
        })
        .sum();
    Inertial { mass, pose: Pose::translation(mean.x, mean.y, mean.z), inertia: upper(&tensor) }
}

fn upper(tensor: &Matrix3<f64>) -> [f64; 6] {
    [tensor[(0, 0)], tensor[(0, 1)], tensor[(0, 2)], tensor[(1, 1)], tensor[(1, 2)], tensor[(2, 2)]]
}

/// Mass properties of a link by its shapes, with a given mass or by density, and from what.
fn body_of_link(
    parts: &RobotParts,
    link: usize,
    meshes: &BTreeMap<String, Result<TriangleMesh, String>>,
    mass: Option<f64>,
) -> (Inertial, &'static str) {
    let part = &parts.links[link];
    let visuals = part.visuals.iter().map(|visual| (visual.pose, &visual.geometry));
    let collisions = part.collisions.iter().map(|shape| (shape.pose, &shape.geometry));
    let shapes: Vec<(Pose, &VisualGeometry)> =
        if part.collisions.is_empty() { visuals.collect() } else { collisions.collect() };
    let solids: Vec<(Pose, Inertial)> = shapes
        .iter()
        .flat_map(|(pose, geometry)| match geometry {
            VisualGeometry::Shape(shape) => vec![(*pose, solid(shape))],
            VisualGeometry::Mesh { file, scale } => meshes
                .get(file)
                .and_then(|mesh| fit::enclose(mesh.as_ref().ok()?, *scale))
                .map(|fit| fit.shapes.iter().map(|(own, shape)| (pose * own, solid(shape))).collect())
                .unwrap_or_default(),
        })
        .filter(|(_, solid)| solid.mass > 0.0)
        .collect();
    let (body, from) = match solids.is_empty() {
        false => (sum(&solids), "its shapes"),
        true => {
            let moment = 0.4 * TOKEN_MASS_KG * TOKEN_RADIUS_M * TOKEN_RADIUS_M;
            let inertia = [moment, 0.0, 0.0, moment, 0.0, moment];
            (Inertial { mass: TOKEN_MASS_KG, pose: Pose::identity(), inertia }, "nothing: it has no shape")
        }
    };
    let mass = mass.unwrap_or(body.mass).max(MIN_MASS_KG);
    let factor = mass / body.mass;
    (Inertial { mass, inertia: body.inertia.map(|moment| moment * factor), ..body }, from)
}

/// A primitive of even density.
fn solid(shape: &Shape) -> Inertial {
    let mass = DENSITY_KG_PER_M3 * fit::volume(shape);
    let [x, y, z] = match *shape {
        Shape::Box { size: [a, b, c] } => [b * b + c * c, a * a + c * c, a * a + b * b].map(|sum| sum / 12.0),
        Shape::Sphere { radius } => [0.4 * radius * radius; 3],
        Shape::Cylinder { radius, length } => {
            let across = (3.0 * radius * radius + length * length) / 12.0;
            [across, across, radius * radius / 2.0]
        }
        // As the cylinder around it, shortened to its volume.
        Shape::Capsule { radius, length } => {
            let length = length + 4.0 / 3.0 * radius;
            let across = (3.0 * radius * radius + length * length) / 12.0;
            [across, across, radius * radius / 2.0]
        }
    };
    Inertial { mass, pose: Pose::identity(), inertia: [mass * x, 0.0, 0.0, mass * y, 0.0, mass * z] }
}

/// Names the links whose meshes could not be used.
pub(crate) fn note_missing_meshes(
    parts: &RobotParts,
    meshes: &BTreeMap<String, Result<TriangleMesh, String>>,
    findings: &mut Findings,
) {
    let mut said = Vec::new();
    for link in &parts.links {
        let of = |geometry: &VisualGeometry| match geometry {
            VisualGeometry::Mesh { file, .. } => Some(file.clone()),
            VisualGeometry::Shape(_) => None,
        };
        let collisions = link.collisions.iter().filter_map(|shape| of(&shape.geometry));
        let visuals = link.visuals.iter().filter_map(|visual| of(&visual.geometry));
        for file in collisions.chain(visuals) {
            if let Some(Err(reason)) = meshes.get(&file)
                && !said.contains(&file)
            {
                findings.warning(
                    link_location(&link.name),
                    "a mesh cannot be used",
                    format!("\"{file}\": {reason}"),
                    "a file .stl, .obj or .dae of the description",
                    "Put it there, or name the folder of its package with --package-path.",
                );
                said.push(file);
            }
        }
    }
}
