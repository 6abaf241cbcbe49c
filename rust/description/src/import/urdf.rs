//! Reads URDF as labs have it: what urdfdom would refuse or leave out is kept for the import to complete.

use super::parts::{
    PartJoint, PartKind, PartLink, PartMimic, PlacedGeometry, RobotParts, note_joint, note_link,
};
use crate::{
    finding::{Findings, Severity, joint_location, link_location},
    lint,
    size_limits::{MIN_MASS_KG, MIN_MOMENT_SHARE},
    srdf::{number, vector},
    xml,
};
use nalgebra::{Matrix3, Translation3, UnitQuaternion};
use proact_arm::{Inertial, Visual, VisualGeometry};
use proact_types::{Pose, Shape, Vector};
use roxmltree::Node;
use std::collections::BTreeMap;

/// Color of what has none.
const GRAY: [f64; 4] = [0.6, 0.6, 0.6, 1.0];
/// Share by which principal moments may break the triangle inequality.
const TRIANGLE_TOLERANCE: f64 = 1e-3;

/// Reads the text of a URDF file; what no description can be made of becomes an error.
pub(crate) fn read(text: &str, findings: &mut Findings) -> Option<RobotParts> {
    let remedy = "Correct the file at that place.";
    let document = xml::parse_document(text, "URDF", "one robot element", remedy, findings)?;
    let robot = document.root_element();
    if robot.tag_name().name() != "robot" {
        let got = format!("<{}>", robot.tag_name().name());
        findings.error("URDF", "the outermost element is wrong", got, "<robot>", "Give a URDF or SDF file.");
        return None;
    }
    if let Some(tag) =
        robot.descendants().find(|n| n.tag_name().namespace().is_some_and(|s| s.contains("xacro")))
    {
        findings.error(
            "URDF",
            "the file has xacro macros in it",
            format!("<xacro:{}> on line {}", tag.tag_name().name(), xml::line_of(tag)),
            "plain URDF",
            "Expand it: xacro FILE > arm.urdf (Debian package ros-xacro, or pip install xacro), then import arm.urdf.",
        );
        return None;
    }
    if lint::has_too_many_parts(robot, "URDF", findings) {
        return None;
    }
    let mut parts =
        RobotParts { name: robot.attribute("name").unwrap_or("arm").to_owned(), ..RobotParts::default() };
    let materials: BTreeMap<&str, [f64; 4]> = children(robot, "material")
        .filter_map(|node| Some((node.attribute("name")?, color(node)?)))
        .collect();
    for node in children(robot, "link") {
        let name = node.attribute("name").unwrap_or_default();
        if name.is_empty() || parts.link(name).is_some() {
            let got = if name.is_empty() { "no name" } else { name };
            findings.error(
                link_location(name),
                "links need names of their own",
                got,
                "unique names",
                "Rename it.",
            );
            continue;
        }
        parts.links.push(read_link(node, name, &materials, findings));
    }
    add_missing_root(robot, &mut parts, findings);
    for node in children(robot, "joint") {
        let read = read_joint(node, &parts, findings);
        parts.joints.extend(read);
    }
    note_ignored(robot, findings);
    (!findings.has_error()).then_some(parts)
}

/// A part of a robot, as macros write one, may hang on a link of what it is mounted on. That link becomes a frame, if it is the
/// one root then; else a name is wrong.
fn add_missing_root(robot: Node<'_, '_>, parts: &mut RobotParts, findings: &mut Findings) {
    let ends = |role: &str| -> Vec<&str> {
        children(robot, "joint").filter_map(|joint| child(joint, role)?.attribute("link")).collect()
    };
    let (parents, moved) = (ends("parent"), ends("child"));
    let mut missing: Vec<&str> = parents.into_iter().filter(|name| parts.link(name).is_none()).collect();
    missing.dedup();
    let [name] = missing.as_slice() else { return };
    if name.is_empty() || moved.contains(name) || parts.links.iter().any(|link| !moved.contains(&&*link.name))
    {
        return;
    }
    parts.links.push(PartLink {
        name: (*name).to_owned(),
        inertial: None,
        mass_kg: None,
        collisions: Vec::new(),
        visuals: Vec::new(),
    });
    note_link(
        findings,
        name,
        "the link is not in the file",
        "a parent of its joints",
        "a <link>",
        "It is the frame on which the rest stands.",
    );
}

/// Names the elements that have no meaning here, once each with their number.
fn note_ignored(robot: Node<'_, '_>, findings: &mut Findings) {
    let mut counts: BTreeMap<&str, usize> = BTreeMap::new();
    for node in robot.children().filter(Node::is_element) {
        let tag = node.tag_name().name();
        if !["link", "joint", "material"].contains(&tag) {
            *counts.entry(tag).or_default() += 1;
        }
    }
    for (tag, count) in counts {
        let done = "It is left out.";
        findings.add(
            Severity::Note,
            "URDF",
            "elements have no meaning here",
            format!("{count} <{tag}>"),
            "links and joints",
            done,
        );
    }
}

fn read_link(
    node: Node<'_, '_>,
    name: &str,
    materials: &BTreeMap<&str, [f64; 4]>,
    findings: &mut Findings,
) -> PartLink {
    let (inertial, mass_kg) = read_inertial(node, name, findings);
    let mut link =
        PartLink { name: name.to_owned(), inertial, mass_kg, collisions: Vec::new(), visuals: Vec::new() };
    for node in children(node, "collision") {
        if let Some(geometry) = read_geometry(node, name, findings) {
            link.collisions
                .push(PlacedGeometry { pose: origin(node, &link_location(name), findings), geometry });
        }
    }
    for node in children(node, "visual") {
        let Some(geometry) = read_geometry(node, name, findings) else { continue };
        let material = child(node, "material");
        let named =
            material.and_then(|node| node.attribute("name")).and_then(|name| materials.get(name).copied());
        link.visuals.push(Visual {
            pose: origin(node, &link_location(name), findings),
            geometry,
            color: material.and_then(color).or(named).unwrap_or(GRAY),
        });
    }
    link
}

/// The mass properties that a body can have, or else the mass alone.
fn read_inertial(node: Node<'_, '_>, name: &str, findings: &mut Findings) -> (Option<Inertial>, Option<f64>) {
    let Some(inertial) = child(node, "inertial") else { return (None, None) };
    let mass = child(inertial, "mass").and_then(|node| node.attribute("value"));
    let Some(mass_kg) = mass.and_then(number).filter(|mass| *mass >= MIN_MASS_KG) else {
        let got = format!("mass {}", mass.unwrap_or("missing"));
        let is_zero = mass.and_then(number) == Some(0.0);
        let problem = if is_zero { "the link is a frame" } else { "the mass is not that of a body" };
        note_link(
            findings,
            name,
            problem,
            &got,
            "at least 1e-9 kg for a body",
            "It gets no mass of its own.",
        );
        return (None, None);
    };
    let values = child(inertial, "inertia");
    let value = |key: &str| values.and_then(|node| node.attribute(key)).map(number);
    // URDF has no default, but many files leave products of inertia out.
    let moment = |key: &str| value(key).flatten();
    let product = |key: &str| value(key).unwrap_or(Some(0.0));
    let read = || {
        let [ixx, iyy, izz] = [moment("ixx")?, moment("iyy")?, moment("izz")?];
        let [ixy, ixz, iyz] = [product("ixy")?, product("ixz")?, product("iyz")?];
        let tensor = Matrix3::new(ixx, ixy, ixz, ixy, iyy, iyz, ixz, iyz, izz);
        let mut moments: [f64; 3] = tensor.symmetric_eigenvalues().into();
        moments.sort_by(f64::total_cmp);
        // One that breaks the inequality by a little more is kept, with a warning of the check.
        (moments[0] > MIN_MOMENT_SHARE * moments[2]
            && (moments[0] + moments[1]) * 2.0 > moments[2] * (1.0 - TRIANGLE_TOLERANCE))
            .then_some([ixx, ixy, ixz, iyy, iyz, izz])
    };
    match read() {
        Some(inertia) => {
            let pose = origin(inertial, &link_location(name), findings);
            (Some(Inertial { mass: mass_kg, pose, inertia }), Some(mass_kg))
        }
        None => (None, Some(mass_kg)),
    }
}

fn read_geometry(node: Node<'_, '_>, name: &str, findings: &mut Findings) -> Option<VisualGeometry> {
    let shape = child(node, "geometry").and_then(|node| node.children().find(Node::is_element));
    let numbers = |node: Node<'_, '_>, key: &str| node.attribute(key).and_then(number).filter(|v| *v > 0.0);
    let read = || {
        let node = shape?;
        Some(match node.tag_name().name() {
            "box" => {
                let size =
                    node.attribute("size").and_then(vector).filter(|size| size.iter().all(|v| *v > 0.0))?;
                VisualGeometry::Shape(Shape::Box { size })
            }
            "sphere" => VisualGeometry::Shape(Shape::Sphere { radius: numbers(node, "radius")? }),
            "cylinder" => VisualGeometry::Shape(Shape::Cylinder {
                radius: numbers(node, "radius")?,
                length: numbers(node, "length")?,
            }),
            "capsule" => VisualGeometry::Shape(Shape::Capsule {
                radius: numbers(node, "radius")?,
                length: numbers(node, "length")?,
            }),
            "mesh" => VisualGeometry::Mesh {
                file: node.attribute("filename").filter(|file| !file.trim().is_empty())?.trim().to_owned(),
                scale: match node.attribute("scale") {
                    Some(scale) => vector(scale).or_else(|| number(scale).map(|scale| [scale; 3]))?,
                    None => [1.0; 3],
                },
            },
            _ => return None,
        })
    };
    let geometry = read();
    if geometry.is_none() {
        let got = shape.map_or("no shape".to_owned(), |node| {
            format!("<{}> on line {}", node.tag_name().name(), xml::line_of(node))
        });
        let expected = "box, cylinder, sphere, capsule or mesh, with sizes above 0 m";
        note_link(findings, name, "a shape cannot be used", &got, expected, "It is left out.");
    }
    geometry
}

fn read_joint(node: Node<'_, '_>, parts: &RobotParts, findings: &mut Findings) -> Option<PartJoint> {
    let name = node.attribute("name").unwrap_or_default();
    let location = joint_location(name);
    if name.is_empty() || parts.joints.iter().any(|joint| joint.name == name) {
        let got = if name.is_empty() { "no name" } else { name };
        findings.error(location, "joints need names of their own", got, "unique names", "Rename it.");
        return None;
    }
    let end = |role: &str, findings: &mut Findings| {
        let wanted = child(node, role).and_then(|node| node.attribute("link")).unwrap_or_default();
        let found = parts.link(wanted);
        if found.is_none() {
            let problem = format!("its {role} link does not exist");
            findings.error(
                &location,
                problem,
                format!("\"{wanted}\""),
                "the name of a link",
                "Correct the name.",
            );
        }
        found
    };
    let (parent, child_link) = (end("parent", findings), end("child", findings));
    let (parent, child_link) = (parent?, child_link?);
    let kind = match node.attribute("type").unwrap_or_default() {
        "revolute" => PartKind::Revolute,
        "continuous" => PartKind::Continuous,
        "prismatic" => PartKind::Prismatic,
        "fixed" => PartKind::Fixed,
        other => {
            note_joint(
                findings,
                name,
                "the joint is made fixed",
                other,
                "revolute, continuous, prismatic or fixed",
                "What it carries stands where it is at zero.",
            );
            PartKind::Fixed
        }
    };
    let axis = child(node, "axis").and_then(|node| node.attribute("xyz")).map(vector);
    let axis = match axis {
        // URDF's default.
        None => Vector::x(),
        Some(axis) => axis.map(Vector::from).filter(|axis| axis.norm() > 1e-9).unwrap_or_else(|| {
            if kind.moves() {
                findings.error(
                    &location,
                    "the axis has no direction",
                    child(node, "axis")
                        .and_then(|node| node.attribute("xyz"))
                        .map_or_else(String::new, |xyz| format!("xyz=\"{xyz}\"")),
                    "three numbers that are not all zero",
                    "Give the direction about or along which the joint moves.",
                );
            }
            Vector::x()
        }),
    };
    let limit = child(node, "limit");
    let value =
        |node: Option<Node<'_, '_>>, key: &str| node.and_then(|node| node.attribute(key)).and_then(number);
    let range = match kind {
        PartKind::Continuous | PartKind::Fixed => None,
        _ => limit.map(|limit| ["lower", "upper"].map(|key| limit_end(limit, key, &location, findings))),
    };
    let dynamics = child(node, "dynamics");
    let mimic = child(node, "mimic").and_then(|node| {
        Some(PartMimic {
            master: node.attribute("joint")?.to_owned(),
            multiplier: factor(node, "multiplier", 1.0, &location, findings),
            offset: factor(node, "offset", 0.0, &location, findings),
        })
    });
    for (node, key) in [(limit, "velocity"), (limit, "effort"), (dynamics, "damping"), (dynamics, "friction")]
    {
        let Some(text) = node.and_then(|node| node.attribute(key)) else { continue };
        if text.trim().parse::<f64>().is_err() {
            let got = format!("{key}=\"{text}\"");
            note_joint(findings, name, "a number cannot be read", &got, "a number", "It counts as left out.");
        }
    }
    Some(PartJoint {
        name: name.to_owned(),
        kind,
        parent,
        child: child_link,
        origin: origin(node, &location, findings),
        axis: axis.normalize(),
        range,
        velocity: value(limit, "velocity").filter(|v| *v > 0.0),
        effort: value(limit, "effort").filter(|v| *v > 0.0),
        damping: value(dynamics, "damping").filter(|v| *v >= 0.0).unwrap_or(0.0),
        friction: value(dynamics, "friction").filter(|v| *v >= 0.0).unwrap_or(0.0),
        mimic: mimic.filter(|_| kind.moves()),
    })
}

/// A number of a coupling, or what stands for one that is left out.
fn factor(node: Node<'_, '_>, key: &str, default: f64, location: &str, findings: &mut Findings) -> f64 {
    let Some(text) = node.attribute(key) else { return default };
    number(text).unwrap_or_else(|| {
        let got = format!("<mimic {key}=\"{text}\"> on line {}", xml::line_of(node));
        findings.error(location, "a number of its coupling is not usable", got, "a number", "Correct it.");
        default
    })
}

/// An end of a joint's range: zero without the attribute, as URDF says.
fn limit_end(limit: Node<'_, '_>, key: &str, location: &str, findings: &mut Findings) -> f64 {
    let Some(text) = limit.attribute(key) else { return 0.0 };
    match text.trim().parse::<f64>() {
        // Far beyond what limits anything.
        Ok(end) if end.is_infinite() => f64::MAX.copysign(end),
        Ok(end) if !end.is_nan() => end,
        _ => {
            let got = format!("{key}=\"{text}\" on line {}", xml::line_of(limit));
            findings.error(location, "a limit is not usable", got, "a number, rad or m", "Correct it.");
            0.0
        }
    }
}

fn origin(node: Node<'_, '_>, location: &str, findings: &mut Findings) -> Pose {
    let Some(origin) = child(node, "origin") else { return Pose::identity() };
    let mut read = |key: &str| {
        let Some(text) = origin.attribute(key) else { return [0.0; 3] };
        vector(text).unwrap_or_else(|| {
            let got = format!("{key}=\"{text}\" on line {}", xml::line_of(origin));
            findings.error(location, "an origin is not usable", got, "three finite numbers", "Correct it.");
            [0.0; 3]
        })
    };
    let ([x, y, z], [roll, pitch, yaw]) = (read("xyz"), read("rpy"));
    Pose::from_parts(Translation3::new(x, y, z), UnitQuaternion::from_euler_angles(roll, pitch, yaw))
}

fn color(node: Node<'_, '_>) -> Option<[f64; 4]> {
    let text = child(node, "color")?.attribute("rgba")?;
    let numbers: Option<Vec<f64>> = text.split_whitespace().map(number).collect();
    numbers?.try_into().ok()
}

fn children<'a, 'i>(node: Node<'a, 'i>, tag: &'static str) -> impl Iterator<Item = Node<'a, 'i>> {
    node.children().filter(move |n| n.has_tag_name(tag))
}

fn child<'a, 'i>(node: Node<'a, 'i>, tag: &str) -> Option<Node<'a, 'i>> {
    node.children().find(|n| n.has_tag_name(tag))
}
