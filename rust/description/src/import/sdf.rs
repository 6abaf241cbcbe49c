//! Reading the arm of an SDF file, the format of Gazebo.
//!
//! URDF and SDF place things differently. In SDF, a link's pose is in the model's frame and a joint's pose in its
//! child link's frame; in URDF, a joint's pose is in its parent link and its child's frame is the joint's frame. An
//! axis is in the model's frame if `use_parent_model_frame` says so, and before SDF 1.5 always; otherwise it is in
//! the joint's frame.

use super::parts::{PartJoint, PartKind, PartLink, PlacedGeometry, RobotParts};
use crate::{
    finding::{Findings, Severity, join_names, joint_location as joint_place, link_location as link_place},
    lint,
    srdf::{number, vector},
    xml,
};
use nalgebra::{Translation3, UnitQuaternion};
use proact_arm::{Inertial, Visual, VisualGeometry};
use proact_types::{Pose, Shape, Vector};
use roxmltree::Node;

/// SDF's way of saying that a joint has no limit, rad.
const UNLIMITED: f64 = 1e16;
/// Drawn where the file only names a material of Gazebo's own.
const GRAY: [f64; 4] = [0.6, 0.6, 0.6, 1.0];

/// A link with the place of its frame: after conversion, that of the joint which moves it.
struct SdfLink {
    link: PartLink,
    model_from_sdf_link: Pose,
    model_from_link: Pose,
}

/// Reads the first model of an SDF text; what cannot be converted becomes a finding.
pub(crate) fn read(text: &str, findings: &mut Findings) -> Option<RobotParts> {
    let remedy = "Correct the file at that place.";
    let document = xml::parse_document(text, "SDF", "one sdf element", remedy, findings)?;
    let sdf = document.root_element();
    let version = sdf.attribute("version").and_then(number);
    let models: Vec<Node<'_, '_>> = sdf.descendants().filter(|n| n.has_tag_name("model")).collect();
    let ([model], Some(version)) = (models.as_slice(), version) else {
        findings.error(
            "SDF",
            "the file must hold one model and its version",
            format!("{} models, version {}", models.len(), sdf.attribute("version").unwrap_or("not given")),
            "<sdf version=\"1.5\"> with one <model>",
            "Put the arm into a file of its own; nested models are not supported.",
        );
        return None;
    };
    if lint::has_too_many_parts(*model, "SDF", findings) {
        return None;
    }
    note_ignored_elements(*model, findings);

    let name = model.attribute("name").unwrap_or("arm").to_owned();
    let mut placed: Vec<SdfLink> = children(*model, "link").map(|node| read_link(node, findings)).collect();
    let mut joints = Vec::new();
    for node in children(*model, "joint") {
        joints.extend(read_joint(node, version, &mut placed, findings));
    }
    if findings.has_error() {
        return None;
    }
    Some(assemble(name, placed, joints, findings))
}

/// Puts the base in front, and origins into the parents' frames.
fn assemble(
    name: String,
    placed: Vec<SdfLink>,
    mut joints: Vec<PartJoint>,
    findings: &mut Findings,
) -> RobotParts {
    let roots: Vec<usize> = (0..placed.len()).filter(|&l| joints.iter().all(|j| j.child != l)).collect();
    if roots.len() != 1 {
        findings.error(
            format!("model \"{name}\""),
            "the links are not one tree",
            join_names(roots.iter().map(|&l| placed[l].link.name.as_str())),
            "one link that hangs on no other",
            "Connect the parts by joints, or split the model.",
        );
    }
    for joint in &mut joints {
        joint.origin = placed[joint.parent].model_from_link.inverse() * placed[joint.child].model_from_link;
    }

    // The model's frame becomes the base, so that positions stay what the SDF file says.
    let mut base = "base_link".to_owned();
    while placed.iter().any(|p| p.link.name == base) {
        base.insert_str(0, "model_");
    }
    let base =
        PartLink { name: base, inertial: None, mass_kg: None, collisions: Vec::new(), visuals: Vec::new() };
    for joint in &mut joints {
        joint.parent += 1;
        joint.child += 1;
    }
    let mount_name = "base_mount".to_owned();
    joints.extend(roots.first().map(|&root| PartJoint {
        name: mount_name,
        kind: PartKind::Fixed,
        parent: 0,
        child: root + 1,
        origin: placed[root].model_from_link,
        axis: Vector::x(),
        range: None,
        velocity: None,
        effort: None,
        damping: 0.0,
        friction: 0.0,
        mimic: None,
    }));
    let links = std::iter::once(base).chain(placed.into_iter().map(|p| p.link)).collect();
    RobotParts { name, links, joints }
}

fn note_ignored_elements(model: Node<'_, '_>, findings: &mut Findings) {
    for (tag, what) in [
        ("sensor", "sensors"),
        ("plugin", "plugins"),
        ("surface", "contact parameters"),
        ("script", "Gazebo's own materials, drawn grey"),
    ] {
        let count = model.descendants().filter(|n| n.has_tag_name(tag)).count();
        if count > 0 {
            findings.add(
                Severity::Note,
                "SDF",
                format!("{what} are left out"),
                format!("{count} <{tag}>"),
                "what URDF can say",
                "Set them where they are used, if they matter.",
            );
        }
    }
    if model.children().any(|n| n.has_tag_name("include")) {
        let remedy = "Replace the include by what it includes.";
        findings.error("SDF", "included models are not supported", "<include>", "links and joints", remedy);
    }
}

fn read_link(node: Node<'_, '_>, findings: &mut Findings) -> SdfLink {
    let name = node.attribute("name").unwrap_or_default().to_owned();
    let location = link_place(&name);
    let inertial = child(node, "inertial").map(|inertial| {
        let entry = |key: &str, findings: &mut Findings| match child(inertial, "inertia") {
            Some(inertia) => number_in(inertia, key, None, &location, findings),
            None => number_in(inertial, "inertia", None, &location, findings),
        };
        Inertial {
            mass: number_in(inertial, "mass", None, &location, findings),
            pose: pose(inertial, &location, findings),
            inertia: ["ixx", "ixy", "ixz", "iyy", "iyz", "izz"].map(|key| entry(key, findings)),
        }
    });
    let mut collisions = Vec::new();
    for collision in children(node, "collision") {
        let pose = pose(collision, &location, findings);
        if let Some(geometry) = geometry(collision, &location, findings) {
            collisions.push(PlacedGeometry { pose, geometry });
        }
    }
    let mut visuals = Vec::new();
    for visual in children(node, "visual") {
        let pose = pose(visual, &location, findings);
        if let Some(geometry) = geometry(visual, &location, findings) {
            visuals.push(Visual { pose, geometry, color: color(visual) });
        }
    }
    let model_from_link = pose(node, &location, findings);
    let mass_kg = inertial.map(|inertial: Inertial| inertial.mass);
    let link = PartLink { name, inertial, mass_kg, collisions, visuals };
    SdfLink { link, model_from_sdf_link: model_from_link, model_from_link }
}

fn read_joint(
    node: Node<'_, '_>,
    version: f64,
    placed: &mut [SdfLink],
    findings: &mut Findings,
) -> Option<PartJoint> {
    let name = node.attribute("name").unwrap_or_default().to_owned();
    let location = joint_place(&name);
    let kind = match node.attribute("type") {
        Some("fixed") => PartKind::Fixed,
        Some("revolute") => PartKind::Revolute,
        Some("continuous") => PartKind::Continuous,
        Some("prismatic") => PartKind::Prismatic,
        other => {
            let remedy = "Make it fixed, or model the part with the other kinds.";
            let expected = "revolute, continuous, prismatic or fixed";
            findings.error(
                &location,
                "the type is not supported",
                other.unwrap_or("nothing"),
                expected,
                remedy,
            );
            return None;
        }
    };
    // A joint to the world says that the base does not move by itself, which is so here anyway.
    if text(node, "parent") == Some("world") && kind == PartKind::Fixed {
        return None;
    }
    let end = |role: &str, findings: &mut Findings| {
        let wanted = text(node, role).unwrap_or_default();
        let found = placed.iter().position(|p| p.link.name == wanted);
        if found.is_none() {
            let expected = join_names(placed.iter().map(|p| p.link.name.as_str()));
            let problem = format!("its {role} link does not exist");
            findings.error(&location, problem, format!("\"{wanted}\""), expected, "Correct the name.");
        }
        found
    };
    let (parent, child_link) = (end("parent", findings), end("child", findings));
    let (parent, child_link) = (parent?, child_link?);

    // The child's frame moves to the joint; what is fixed to the child stays where it is.
    let link_from_joint = pose(node, &location, findings);
    let moved = &mut placed[child_link];
    moved.model_from_link = moved.model_from_sdf_link * link_from_joint;
    let joint_from_link = link_from_joint.inverse();
    moved.link.collisions.iter_mut().for_each(|c| c.pose = joint_from_link * c.pose);
    moved.link.visuals.iter_mut().for_each(|v| v.pose = joint_from_link * v.pose);
    if let Some(inertial) = &mut moved.link.inertial {
        inertial.pose = joint_from_link * inertial.pose;
    }
    let model_from_joint = moved.model_from_link.rotation;

    let mut joint = PartJoint {
        name,
        kind,
        parent,
        child: child_link,
        origin: Pose::identity(),
        axis: Vector::x(),
        range: None,
        velocity: None,
        effort: None,
        damping: 0.0,
        friction: 0.0,
        mimic: None,
    };
    if kind == PartKind::Fixed {
        return Some(joint);
    }
    let Some(axis) = child(node, "axis") else {
        findings.error(&location, "a revolute joint needs an axis", "nothing", "<axis>", "Add the axis.");
        return None;
    };
    let direction = text(axis, "xyz").and_then(vector).map(Vector::from).filter(|v| v.norm() > 1e-9);
    let Some(direction) = direction else {
        let got = text(axis, "xyz").unwrap_or("nothing");
        let remedy = "Give the direction about which the joint turns.";
        findings.error(&location, "the axis has no direction", got, "three numbers, not all zero", remedy);
        return None;
    };
    let in_model = version < 1.5 || matches!(text(axis, "use_parent_model_frame"), Some("1" | "true"));
    joint.axis = if in_model { model_from_joint.inverse() * direction } else { direction }.normalize();
    if let Some(limit) = child(axis, "limit") {
        let lower = number_in(limit, "lower", Some(-UNLIMITED), &location, findings);
        let upper = number_in(limit, "upper", Some(UNLIMITED), &location, findings);
        joint.range = (lower > -UNLIMITED && upper < UNLIMITED).then_some([lower, upper]);
        // SDF writes -1 for "no limit".
        joint.velocity =
            Some(number_in(limit, "velocity", Some(0.0), &location, findings)).filter(|v| *v > 0.0);
        joint.effort = Some(number_in(limit, "effort", Some(0.0), &location, findings)).filter(|e| *e > 0.0);
    }
    // SDF has no other word for a joint that turns for ever.
    if kind == PartKind::Revolute && joint.range.is_none() {
        joint.kind = PartKind::Continuous;
    }
    if let Some(dynamics) = child(axis, "dynamics") {
        joint.damping = number_in(dynamics, "damping", Some(0.0), &location, findings);
        joint.friction = number_in(dynamics, "friction", Some(0.0), &location, findings);
    }
    Some(joint)
}

fn geometry(node: Node<'_, '_>, location: &str, findings: &mut Findings) -> Option<VisualGeometry> {
    let shape = child(node, "geometry").and_then(|g| g.children().find(Node::is_element));
    let Some(shape) = shape else {
        let remedy = "Give one shape, or remove the element.";
        findings.error(
            location,
            "a shape is missing",
            "no <geometry>",
            "box, cylinder, sphere or mesh",
            remedy,
        );
        return None;
    };
    let mut vector_of = |key: &str, default: Option<[f64; 3]>| {
        let found = text(shape, key);
        let read = found.map_or(default, vector);
        if read.is_none() {
            let got = found.unwrap_or("nothing");
            findings.error(
                location,
                format!("{key} is not usable"),
                got,
                "three finite numbers",
                "Correct it.",
            );
        }
        read
    };
    Some(match shape.tag_name().name() {
        "box" => VisualGeometry::Shape(Shape::Box { size: vector_of("size", None)? }),
        "mesh" => VisualGeometry::Mesh {
            scale: vector_of("scale", Some([1.0; 3]))?,
            file: text(shape, "uri").unwrap_or_default().to_owned(),
        },
        "sphere" => VisualGeometry::Shape(Shape::Sphere {
            radius: number_in(shape, "radius", None, location, findings),
        }),
        "cylinder" => VisualGeometry::Shape(Shape::Cylinder {
            radius: number_in(shape, "radius", None, location, findings),
            length: number_in(shape, "length", None, location, findings),
        }),
        other => {
            let remedy = "Replace it by primitives.";
            findings.error(
                location,
                "a shape is not supported",
                other,
                "box, cylinder, sphere or mesh",
                remedy,
            );
            return None;
        }
    })
}

fn color(visual: Node<'_, '_>) -> [f64; 4] {
    let numbers = child(visual, "material")
        .and_then(|m| text(m, "diffuse").or_else(|| text(m, "ambient")))
        .map(|words| words.split_whitespace().filter_map(number).collect::<Vec<f64>>());
    numbers.and_then(|n| n.try_into().ok()).unwrap_or(GRAY)
}

fn children<'a, 'i>(node: Node<'a, 'i>, tag: &'static str) -> impl Iterator<Item = Node<'a, 'i>> {
    node.children().filter(move |n| n.has_tag_name(tag))
}

fn child<'a, 'i>(node: Node<'a, 'i>, tag: &str) -> Option<Node<'a, 'i>> {
    node.children().find(|n| n.has_tag_name(tag))
}

fn text<'a>(node: Node<'a, '_>, tag: &str) -> Option<&'a str> {
    child(node, tag).and_then(|n| n.text()).map(str::trim)
}

/// The number in child `tag`, or `default` if there is no such child; anything else is an error.
fn number_in(
    node: Node<'_, '_>,
    tag: &str,
    default: Option<f64>,
    location: &str,
    findings: &mut Findings,
) -> f64 {
    let found = text(node, tag);
    match (found.map(number), default) {
        (Some(Some(number)), _) => number,
        (None, Some(default)) => default,
        _ => {
            let got = found.unwrap_or("nothing");
            findings.error(location, format!("<{tag}> is not usable"), got, "a finite number", "Correct it.");
            0.0
        }
    }
}

/// x y z roll pitch yaw; the identity if it is not given.
fn pose(node: Node<'_, '_>, location: &str, findings: &mut Findings) -> Pose {
    let Some(words) = text(node, "pose") else { return Pose::identity() };
    let numbers: Option<Vec<f64>> = words.split_whitespace().map(number).collect();
    match numbers.as_deref() {
        Some(&[x, y, z, roll, pitch, yaw]) => {
            Pose::from_parts(Translation3::new(x, y, z), UnitQuaternion::from_euler_angles(roll, pitch, yaw))
        }
        _ => {
            findings.error(location, "a pose is not usable", words, "x y z roll pitch yaw", "Correct it.");
            Pose::identity()
        }
    }
}
