//! Which part of a robot is the arm that is imported, and what makes it whole: a gripper where an arm has no hand, an arm where
//! there is a hand alone.

use super::{
    complete::{hold, hold_beside_chain, rigid_body},
    meshes::TriangleMesh,
    parts::{PartJoint, PartKind, PartLink, PartMimic, PlacedGeometry, RobotParts, note_joint, note_link},
    urdf,
};
use crate::{
    finding::{Findings, Severity, join_names, link_location},
    folder::ArmFolder,
};
use nalgebra::{Point3, Rotation3, Translation3, UnitQuaternion};
use proact_arm::{Inertial, Visual, VisualGeometry};
use proact_types::{MAX_JOINTS, Pose, Shape, Vector};
use std::collections::BTreeMap;

/// Meshes by their addresses, or why one cannot be used.
type Meshes = BTreeMap<String, Result<TriangleMesh, String>>;

/// A chain with fewer joints is no arm.
const MIN_ARM_JOINTS: usize = 3;
/// A chain of more joints from the root on begins at the last branching instead.
const MAX_ARM_JOINTS: usize = 8;
/// From here on a chain without a hand is taken for an arm of a robot that has several chains.
const MIN_BARE_ARM_JOINTS: usize = 5;
/// No hand reaches farther from where it is mounted, metres: what branches and is larger is a body.
const MAX_HAND_M: f64 = 0.45;
/// ... or with its wrist and forearm from its root.
const MAX_HAND_WITH_WRIST_M: f64 = 0.52;
/// Parts of a body that are no arm.
const NO_ARM: [&str; 11] =
    ["leg", "foot", "ankle", "toe", "hip", "knee", "wheel", "head", "neck", "camera", "caster"];
/// What is nearer tells no direction, metres.
const MIN_HINT_M: f64 = 0.005;
/// Number of corners of a mesh that tell where it ends.
const MAX_MESH_CORNERS: usize = 400;

/// A chain of a robot that may be the arm to import.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ArmChoice {
    /// Link at its base.
    pub base: String,
    /// Link at which it ends.
    pub tip: String,
    /// Joints that move between the two.
    pub joints: usize,
    /// Fingers lead on from its end.
    pub has_hand: bool,
}

/// The arms of a robot that is more than one arm, the one that an import takes first; none of a robot that is one arm.
pub(crate) fn arm_choices(parts: &RobotParts) -> Vec<ArmChoice> {
    let choice = |arm: ArmChain| ArmChoice {
        base: parts.links[arm.base].name.clone(),
        tip: parts.links[arm.tip].name.clone(),
        joints: arm.joints,
        has_hand: arm.has_hand,
    };
    arm_chains(parts).into_iter().map(choice).collect()
}

/// The chains of [`arm_choices`]: first those with a hand, of them those with most joints, and of these the right one.
fn arm_chains(parts: &RobotParts) -> Vec<ArmChain> {
    let tree = BodyTree::of(parts);
    if is_one_arm(parts, &tree) {
        return Vec::new();
    }
    let mut chains = tree.arms(parts);
    chains.reverse();
    chains.sort_by_key(|arm| std::cmp::Reverse(arm.rank()));
    chains
}

fn is_one_arm(parts: &RobotParts, tree: &BodyTree) -> bool {
    let first = tree.first_branching();
    let is_hand = tree.leading_on(first).is_empty() || reach(parts, first) <= MAX_HAND_M;
    is_hand && tree.moving() <= MAX_JOINTS
}

/// The chain that is the arm: all else is held.
pub(crate) fn choose_arm(parts: &mut RobotParts, findings: &mut Findings) {
    let tree = BodyTree::of(parts);
    if is_one_arm(parts, &tree) {
        return;
    }
    let chains = arm_chains(parts);
    let Some(best) = chains.first() else {
        choose_hand(parts, &tree, findings);
        return;
    };
    let words =
        |arm: &ArmChain| format!("--base {} --tip {}", parts.links[arm.base].name, parts.links[arm.tip].name);
    let others: Vec<String> = chains.iter().filter(|arm| arm.tip != best.tip).take(3).map(words).collect();
    let done = match others.as_slice() {
        [] => "All joints beside it are held.".to_owned(),
        others => format!("The others are held. Another one: {}", others.join(", or ")),
    };
    findings.add(
        Severity::Warning,
        "URDF",
        "it has more than one chain that moves",
        format!("{} joints", tree.moving()),
        format!("one arm: {}", words(best)),
        done,
    );
    let tip = parts.links[best.tip].name.clone();
    let kept = parts.below(best.base);
    parts.retain_links(&kept);
    hold_beside_chain(parts, &tip, findings);
}

/// Of several hands without an arm, the right one, else the first; it comes with its wrist.
fn choose_hand(parts: &mut RobotParts, tree: &BodyTree, findings: &mut Findings) {
    let palms = tree.joints.iter().map(|[_, child]| *child);
    let hands: Vec<usize> = palms
        .filter(|&body| tree.leading_on(body).len() > 1 && reach(parts, body) <= MAX_HAND_M)
        .map(|palm| {
            let above = std::iter::successors(Some(palm), |&body| tree.carrier(body));
            let is_wrist = |body: &usize| {
                (*body == palm || tree.leading_on(*body).len() == 1)
                    && reach(parts, *body) <= MAX_HAND_WITH_WRIST_M
            };
            above.take_while(is_wrist).last().unwrap_or(palm)
        })
        .collect();
    let right = |body: &&usize| is_right(&parts.links[**body].name.to_lowercase());
    let Some(&chosen) = hands.iter().find(right).or(hands.first()) else { return };
    findings.add(
        Severity::Warning,
        "URDF",
        "it has more than one hand",
        join_names(hands.iter().map(|&hand| parts.links[hand].name.as_str())),
        "one hand",
        format!(
            "The one on {} is taken. Name the link of another one with --base.",
            link_location(&parts.links[chosen].name)
        ),
    );
    let kept = parts.below(chosen);
    parts.retain_links(&kept);
}

/// Holds joints of a hand that has more than a model takes: the last ones of its digits.
pub(crate) fn hold_surplus(parts: &mut RobotParts, findings: &mut Findings) {
    let tree = BodyTree::of(parts);
    let surplus = tree.moving().saturating_sub(MAX_JOINTS);
    let palm = tree.first_branching();
    if surplus == 0 || tree.depth(palm) < MIN_ARM_JOINTS || reach(parts, palm) > MAX_HAND_M {
        return;
    }
    let of_hand = parts.below(palm);
    let mut joints: Vec<(usize, String)> = parts
        .joints
        .iter()
        .filter(|joint| joint.kind.moves() && joint.child != palm && of_hand.contains(&joint.child))
        .map(|joint| (tree.depth(joint.child), joint.name.clone()))
        .collect();
    joints.sort_by_key(|(depth, _)| std::cmp::Reverse(*depth));
    joints.truncate(surplus);
    if joints.is_empty() {
        return;
    }
    for (_, name) in &joints {
        hold(parts, name);
    }
    findings.add(
        Severity::Warning,
        "URDF",
        "the number of moving joints is not supported",
        tree.moving(),
        format!("at most {MAX_JOINTS}"),
        format!("Held are {}.", join_names(joints.iter().map(|(_, name)| name.as_str()))),
    );
}

/// Gives an arm without a hand a gripper, and a hand without an arm an arm.
pub(crate) fn make_whole(
    mut parts: RobotParts,
    tip: Option<&str>,
    with_gripper: bool,
    meshes: &Meshes,
    findings: &mut Findings,
) -> Option<RobotParts> {
    let tree = BodyTree::of(&parts);
    let palm =
        tip.and_then(|tip| parts.link(tip)).map_or_else(|| tree.first_branching(), |tip| tree.body_of(tip));
    let (arm_joints, branches) = (tree.depth(palm), tree.leading_on(palm).len());
    let is_arm = arm_joints >= MIN_ARM_JOINTS
        || arm_joints > 0 && (branches == 0 || extent(&parts, 0, meshes) > MAX_HAND_WITH_WRIST_M);
    if is_arm {
        if branches == 0 && with_gripper {
            let tip = tip.and_then(|tip| parts.link(tip)).unwrap_or_else(|| last_link(&parts, palm));
            add_gripper(&mut parts, tip, palm, meshes, findings);
        }
        return Some(parts);
    }
    let size = extent(&parts, palm, meshes);
    // What turns for ever is a wheel.
    let fingers =
        parts.joints.iter().filter(|joint| joint.kind.moves() && joint.kind != PartKind::Continuous).count();
    if branches == 0 || fingers == 0 || size > MAX_HAND_M || tree.moving() > MAX_JOINTS {
        let expected = format!("an arm, or a hand of at most {MAX_HAND_M} m");
        if tree.moving() == 0 {
            let remedy = "Suction grippers and tools hold no block here: give the file of an arm, or of a hand with fingers.";
            findings.error("URDF", "no joint moves", "fixed joints alone", expected, remedy);
            return None;
        }
        let problem = "it is neither an arm nor a hand";
        let got = format!(
            "{} joints that move, in {branches} chains from link \"{}\", {size:.2} m in size",
            tree.moving(),
            parts.links[palm].name
        );
        findings.error("URDF", problem, got, expected, "Give the file of an arm, or of a hand.");
        return None;
    }
    mount_hand(parts, palm, meshes, findings)
}

/// The rigid bodies of a robot: each stands for its first link.
struct BodyTree {
    /// The body of each link.
    bodies: Vec<usize>,
    /// Joints that move, as the body that each is on and the one that it moves.
    joints: Vec<[usize; 2]>,
}

/// A chain that may be an arm.
struct ArmChain {
    base: usize,
    tip: usize,
    joints: usize,
    has_hand: bool,
    is_right: bool,
    is_no_arm: bool,
}

impl ArmChain {
    fn rank(&self) -> (bool, bool, usize, bool) {
        (!self.is_no_arm, self.has_hand, self.joints.min(7), self.is_right)
    }
}

impl BodyTree {
    fn of(parts: &RobotParts) -> Self {
        let carriers = parts.carriers();
        let body_of = |mut link: usize| {
            while let Some(joint) =
                carriers[link].map(|joint| &parts.joints[joint]).filter(|joint| !joint.kind.moves())
            {
                link = joint.parent;
            }
            link
        };
        let moving = parts.joints.iter().filter(|joint| joint.kind.moves());
        Self {
            bodies: (0..parts.links.len()).map(body_of).collect(),
            joints: moving.map(|joint| [body_of(joint.parent), joint.child]).collect(),
        }
    }

    fn body_of(&self, link: usize) -> usize {
        self.bodies[link]
    }

    fn moving(&self) -> usize {
        self.joints.len()
    }

    fn leading_on(&self, body: usize) -> Vec<usize> {
        self.joints.iter().filter(|[on, _]| *on == body).map(|[_, child]| *child).collect()
    }

    fn carrier(&self, body: usize) -> Option<usize> {
        self.joints.iter().find(|[_, child]| *child == body).map(|[on, _]| *on)
    }

    /// Joints between a body and the root.
    fn depth(&self, body: usize) -> usize {
        std::iter::successors(self.carrier(body), |&body| self.carrier(body)).count()
    }

    /// The first body from which not one joint leads on.
    fn first_branching(&self) -> usize {
        let mut body = self.bodies.first().copied().unwrap_or_default();
        while let [only] = self.leading_on(body).as_slice() {
            body = *only;
        }
        body
    }

    /// Chains from the last branching above them to a hand, or to an end that is no finger.
    fn arms(&self, parts: &RobotParts) -> Vec<ArmChain> {
        let root = self.bodies.first().copied().unwrap_or_default();
        let mut bodies = vec![root];
        bodies.extend(self.joints.iter().map(|[_, child]| *child));
        let mut found = Vec::new();
        for &tip in bodies.iter().filter(|&&body| self.leading_on(body).len() != 1) {
            let has_hand = !self.leading_on(tip).is_empty();
            if has_hand && reach(parts, tip) > MAX_HAND_M {
                continue;
            }
            let (mut joints, mut base) = (self.depth(tip), root);
            if joints > MAX_ARM_JOINTS {
                (joints, base) = (0, tip);
                while let Some(on) = self.carrier(base) {
                    (joints, base) = (joints + 1, on);
                    if self.leading_on(base).len() > 1 && reach(parts, base) > MAX_HAND_M {
                        break;
                    }
                }
            }
            // A finger hangs on a hand that is a candidate by itself.
            let is_finger = std::iter::successors(self.carrier(tip), |&body| self.carrier(body))
                .any(|above| self.leading_on(above).len() > 1 && reach(parts, above) <= MAX_HAND_M);
            let least = if has_hand { MIN_ARM_JOINTS } else { MIN_BARE_ARM_JOINTS };
            if joints < least || is_finger {
                continue;
            }
            let names: Vec<String> = std::iter::successors(Some(tip), |&body| self.carrier(body))
                .take(joints)
                .map(|body| parts.links[body].name.to_lowercase())
                .collect();
            let has_word = |name: &String| NO_ARM.iter().any(|word| name.contains(word));
            found.push(ArmChain {
                base,
                tip,
                joints,
                has_hand,
                is_right: names.iter().any(|name| is_right(name)),
                is_no_arm: names.iter().any(has_word),
            });
        }
        found
    }
}

fn is_right(name: &str) -> bool {
    name.contains("right") || name.starts_with("r_") || name.ends_with("_r") || name.contains("_r_")
}

/// How far the joints below a link are from it at position zero, metres.
fn reach(parts: &RobotParts, link: usize) -> f64 {
    poses_below(parts, link).iter().map(|(_, pose)| pose.translation.vector.norm()).fold(0.0, f64::max)
}

/// Links below `link`, itself first, with `link_from_other` at position zero.
fn poses_below(parts: &RobotParts, link: usize) -> Vec<(usize, Pose)> {
    let mut found = vec![(link, Pose::identity())];
    let mut next = 0;
    while let Some(&(at, pose)) = found.get(next) {
        next += 1;
        let children = parts.joints.iter().filter(|joint| joint.parent == at);
        found.extend(children.map(|joint| (joint.child, pose * joint.origin)));
    }
    found
}

/// Farthest point of what hangs on `link` from it, metres.
fn extent(parts: &RobotParts, link: usize, meshes: &Meshes) -> f64 {
    let below = poses_below(parts, link);
    let points = below.iter().flat_map(|(link, pose)| corners(parts, *link, pose, meshes));
    points.map(|point| point.coords.norm()).fold(reach(parts, link), f64::max)
}

/// Whether joints beyond a link lead on from somewhere side by side, as fingers do.
pub(crate) fn branches_below(parts: &RobotParts, link: usize) -> bool {
    let tree = BodyTree::of(parts);
    let below = parts.below(link);
    below.iter().any(|&link| tree.body_of(link) == link && tree.leading_on(link).len() > 1)
        || tree.leading_on(tree.body_of(link)).len() > 1
}

/// Whether a joint moves on the way to the palm.
pub(crate) fn arm_moves(parts: &RobotParts) -> bool {
    let tree = BodyTree::of(parts);
    tree.depth(tree.first_branching()) > 0
}

/// The rigid body from which the fingers lead on.
pub(crate) fn palm(parts: &RobotParts) -> usize {
    BodyTree::of(parts).first_branching()
}

/// Where the shapes of a link end, in the frame of `pose`.
fn corners(parts: &RobotParts, link: usize, pose: &Pose, meshes: &Meshes) -> Vec<Point3<f64>> {
    let part = &parts.links[link];
    let drawn = part.visuals.iter().map(|visual| (visual.pose, &visual.geometry));
    let solid = part.collisions.iter().map(|shape| (shape.pose, &shape.geometry));
    let shapes: Vec<(Pose, &VisualGeometry)> =
        if part.collisions.is_empty() { drawn.collect() } else { solid.collect() };
    let mut found = Vec::new();
    for (own, geometry) in shapes {
        let placed = pose * own;
        match geometry {
            VisualGeometry::Shape(shape) => {
                let [x, y, z] = half_size(shape);
                for k in 0..8 {
                    let sign = |bit: usize| if k >> bit & 1 == 0 { 1.0 } else { -1.0 };
                    found.push(placed * Point3::new(x * sign(0), y * sign(1), z * sign(2)));
                }
            }
            VisualGeometry::Mesh { file, scale } => {
                let Some(Ok(mesh)) = meshes.get(file) else { continue };
                let step = mesh.points.len().div_ceil(MAX_MESH_CORNERS).max(1);
                let scale = Vector::from(*scale);
                found.extend(
                    mesh.points
                        .iter()
                        .step_by(step)
                        .map(|p| placed * Point3::from(p.coords.component_mul(&scale))),
                );
            }
        }
    }
    found
}

fn half_size(shape: &Shape) -> [f64; 3] {
    match *shape {
        Shape::Box { size } => size.map(|side| 0.5 * side),
        Shape::Sphere { radius } => [radius; 3],
        Shape::Cylinder { radius, length } => [radius, radius, 0.5 * length],
        Shape::Capsule { radius, length } => [radius, radius, 0.5 * length + radius],
    }
}

/// The last of a row of links that are fixed to `body`.
fn last_link(parts: &RobotParts, body: usize) -> usize {
    let mut last = body;
    while let [only] = parts.joints.iter().filter(|j| j.parent == last).collect::<Vec<_>>().as_slice() {
        last = only.child;
    }
    last
}

/// `body_from_flange`: where a hand is mounted at the end of an arm, z away from it.
fn flange(parts: &RobotParts, body: usize, tip: usize, meshes: &Meshes) -> Pose {
    let Some(joint) = parts.joints.iter().find(|joint| joint.child == body && joint.kind.moves()) else {
        return Pose::identity();
    };
    let fixed = rigid_body(parts, body);
    let mut points: Vec<Point3<f64>> =
        fixed.iter().flat_map(|(link, pose)| corners(parts, *link, pose, meshes)).collect();
    let of_tip = fixed.iter().find(|(link, _)| *link == tip).map_or(Pose::identity(), |(_, pose)| *pose);
    points.extend(fixed.iter().map(|(_, pose)| Point3::from(pose.translation.vector)));
    let count = points.len().max(1) as f64;
    let mean = points.iter().map(|p| p.coords).sum::<Vector>() / count;
    // Where the tip is, how the last joint is reached, and what the last link looks like tell which way is out. A mesh alone may lie
    // behind a frame at the face of the flange.
    let back = joint.origin.inverse().translation.vector;
    let hints = [of_tip.translation.vector, -back, mean]
        .map(|way| if way.norm() > MIN_HINT_M { way } else { Vector::zeros() });
    let rolls = joint.kind != PartKind::Prismatic
        && hints.iter().any(|way| way.norm() > 0.0 && way.dot(&joint.axis).abs() > 0.7 * way.norm());
    let along = hints.iter().map(|way| way.dot(&joint.axis)).find(|along| along.abs() > MIN_HINT_M);
    let way = match along.filter(|_| rolls) {
        Some(along) => joint.axis * along.signum(),
        None => {
            let across = [hints[0], hints[2], hints[1]];
            across.into_iter().find(|way| way.norm() > 0.0).unwrap_or(joint.axis).normalize()
        }
    };
    let end = points.iter().map(|p| p.coords.dot(&way)).fold(0.0, f64::max);
    let middle = if rolls {
        Vector::zeros()
    } else {
        of_tip.translation.vector - way * of_tip.translation.vector.dot(&way)
    };
    Pose::from_parts(Translation3::from(middle + way * end), turned_onto(&way))
}

/// The rotation that takes z to `way`.
fn turned_onto(way: &Vector) -> UnitQuaternion<f64> {
    UnitQuaternion::rotation_between(&Vector::z(), way)
        .unwrap_or_else(|| UnitQuaternion::from_axis_angle(&Vector::x_axis(), std::f64::consts::PI))
}

/// A parallel gripper of our own: a palm and two fingers that slide apart by 90 mm.
fn add_gripper(parts: &mut RobotParts, tip: usize, body: usize, meshes: &Meshes, findings: &mut Findings) {
    const PALM_M: [f64; 3] = [0.12, 0.05, 0.04];
    const FINGER_M: [f64; 3] = [0.012, 0.022, 0.07];
    const STROKE_M: f64 = 0.045;
    let at = flange(parts, body, tip, meshes);
    // Names that the file does not have.
    let links = parts.links.iter().map(|link| &*link.name);
    let own: Vec<&str> = links.chain(parts.joints.iter().map(|joint| &*joint.name)).collect();
    let mut prefix = "gripper".to_owned();
    while own.iter().any(|name| name.starts_with(&format!("{prefix}_"))) {
        prefix.push('_');
    }
    let part = |name: &str, size: [f64; 3], mass: f64, center: Vector| {
        let pose = Pose::translation(center.x, center.y, center.z);
        let [a, b, c] = size.map(|side| side * side * mass / 12.0);
        let geometry = VisualGeometry::Shape(Shape::Box { size });
        PartLink {
            name: name.to_owned(),
            inertial: Some(Inertial { mass, pose, inertia: [b + c, 0.0, 0.0, a + c, 0.0, a + b] }),
            mass_kg: Some(mass),
            collisions: vec![PlacedGeometry { pose, geometry: geometry.clone() }],
            visuals: vec![Visual { pose, geometry, color: [0.35, 0.38, 0.42, 1.0] }],
        }
    };
    let first = parts.links.len();
    let half = |size: [f64; 3]| Vector::new(0.0, 0.0, 0.5 * size[2]);
    parts.links.push(part(&format!("{prefix}_palm"), PALM_M, 0.35, half(PALM_M)));
    let fixed = PartJoint::fixed(format!("{prefix}_mount"), body, first, at);
    parts.joints.push(fixed.clone());
    for (index, (side, sign)) in [("left", 1.0), ("right", -1.0)].into_iter().enumerate() {
        let own = Vector::x() * (sign * 0.5 * FINGER_M[0]) + half(FINGER_M);
        parts.links.push(part(&format!("{prefix}_{side}_finger"), FINGER_M, 0.05, own));
        parts.joints.push(PartJoint {
            name: format!("{prefix}_{side}"),
            kind: PartKind::Prismatic,
            parent: first,
            child: first + 1 + index,
            origin: Pose::translation(0.0, 0.0, PALM_M[2]),
            axis: Vector::x() * sign,
            range: Some([0.0, STROKE_M]),
            velocity: Some(0.15),
            effort: Some(40.0),
            damping: 1.0,
            mimic: (index > 0).then(|| PartMimic {
                master: format!("{prefix}_left"),
                multiplier: 1.0,
                offset: 0.0,
            }),
            ..fixed.clone()
        });
    }
    let name = parts.links[tip].name.clone();
    note_link(
        findings,
        &name,
        "the arm has no hand",
        "no joint moves beyond it",
        "fingers",
        &format!(
            "A gripper of ours with two fingers, {:.0} mm apart when open, is mounted there; --no-gripper leaves it out.",
            2e3 * STROKE_M
        ),
    );
}

/// Puts a hand on an arm that ships with the program. Joints between the hand's root and its palm are held.
fn mount_hand(
    mut hand: RobotParts,
    palm: usize,
    meshes: &Meshes,
    findings: &mut Findings,
) -> Option<RobotParts> {
    let carriers = hand.carriers();
    let above: Vec<String> =
        std::iter::successors(carriers[palm], |&joint| carriers[hand.joints[joint].parent])
            .filter(|&joint| hand.joints[joint].kind.moves())
            .map(|joint| hand.joints[joint].name.clone())
            .collect();
    for name in above {
        let held = hold(&mut hand, &name);
        let done = format!("It is held at {held}.");
        note_joint(
            findings,
            &name,
            "the joint is before the palm of a hand without an arm",
            "it moves",
            "an arm",
            &done,
        );
    }
    // One that stands by itself: no one wears it.
    let (shipped, model) = ArmFolder::shipped_names().into_iter().find_map(|name| {
        let folder = ArmFolder::shipped(&name)?;
        let model = folder.model().ok().filter(|model| model.settings.fixed_base.is_some())?;
        Some((folder, model))
    })?;
    let carrier = shipped.name.clone();
    let mut arm = urdf::read(&shipped.urdf, &mut Findings::default())?;
    // The arm without its own hand: all up to the tip.
    let tip = arm.link(&model.links[model.tip].name)?;
    let beyond: Vec<usize> = arm
        .joints
        .iter()
        .filter(|joint| joint.parent == tip)
        .flat_map(|joint| arm.below(joint.child))
        .collect();
    let kept: Vec<usize> = arm.below(0).into_iter().filter(|link| !beyond.contains(link)).collect();
    arm.retain_links(&kept);
    let tip = arm.link(&model.links[model.tip].name)?;
    let body = BodyTree::of(&arm).body_of(tip);
    let at = flange(&arm, body, tip, &Meshes::new());

    // Fingers point away from the arm, and the hand's rear is on the flange.
    let poses = poses_below(&hand, 0);
    let fingers: Vec<Vector> = BodyTree::of(&hand)
        .joints
        .iter()
        .filter_map(|[_, child]| poses.iter().find(|(link, _)| link == child))
        .map(|(_, pose)| pose.translation.vector)
        .collect();
    let ends: Vec<Vector> =
        poses.iter().flat_map(|(link, pose)| corners(&hand, *link, pose, meshes)).map(|p| p.coords).collect();
    let mean = |points: &[Vector]| points.iter().sum::<Vector>() / points.len().max(1) as f64;
    let way =
        [mean(&fingers), mean(&ends), Vector::z()].into_iter().find(|way| way.norm() > 0.01)?.normalize();
    let rear = ends.iter().map(|p| p.dot(&way)).fold(0.0, f64::min);
    let mounted = at
        * Pose::from_parts(Translation3::identity(), turned_onto(&way).inverse())
        * Pose::from(Translation3::from(-way * rear));

    let taken = |name: &str, arm: &RobotParts| {
        arm.links.iter().any(|link| link.name == name) || arm.joints.iter().any(|joint| joint.name == name)
    };
    for link in &mut arm.links {
        if hand.link(&link.name).is_some() || hand.joints.iter().any(|joint| joint.name == link.name) {
            link.name = format!("{carrier}_{}", link.name);
        }
        // Drawn by its shapes: its meshes are not those of the hand's file.
        link.visuals.retain(|visual| matches!(visual.geometry, VisualGeometry::Shape(_)));
    }
    for joint in &mut arm.joints {
        if hand.joints.iter().any(|other| other.name == joint.name) {
            joint.name = format!("{carrier}_{}", joint.name);
        }
    }
    let offset = arm.links.len();
    let mut name = "mounted_hand".to_owned();
    while taken(&name, &hand) || taken(&name, &arm) {
        name.push('_');
    }
    let (fingers_moving, hand_name) = (BodyTree::of(&hand).moving(), hand.name.clone());
    arm.links.extend(hand.links);
    arm.joints.push(PartJoint::fixed(name, body, offset, mounted));
    arm.joints.extend(hand.joints.into_iter().map(|joint| PartJoint {
        parent: joint.parent + offset,
        child: joint.child + offset,
        ..joint
    }));
    arm.name = format!("{carrier}_with_{hand_name}");
    findings.add(
        Severity::Note,
        "URDF",
        "it is a hand without an arm",
        format!("{fingers_moving} joints of fingers"),
        "an arm that ends in a hand",
        format!("It is mounted on the arm {carrier} that ships with the program. Import a URDF of your arm with the hand in it for another."),
    );
    Some(arm)
}

/// The rotation whose x is `closing`, and whose z is opposite to `approach`; both of any length, across each other.
pub(crate) fn grasp_rotation(closing: &Vector, approach: &Vector) -> UnitQuaternion<f64> {
    let z = -approach.normalize();
    let x = (closing - z * closing.dot(&z)).normalize();
    UnitQuaternion::from_rotation_matrix(&Rotation3::from_basis_unchecked(&[x, z.cross(&x), z]))
}
