//! What can be told from the text alone: where it is malformed, what it refers to in vain, and what urdfdom
//! would fill in or skip without a word.

use crate::finding::{
    Finding, Findings, Severity, join_names, joint_location as joint_place, link_location as link_place,
};
use crate::size_limits::{MAX_LINKS, MAX_SHAPES};
use crate::xml;
use roxmltree::Node;
use std::{collections::BTreeSet, f64::consts::FRAC_PI_2};

/// How near to pi/2, rad, an angle must be to look like a rounded pi/2; 1.57 is 8e-4 away.
const ROUNDED_ANGLE_RAD: f64 = 1e-3;
/// Nearer than this, rad, the rounding does not matter.
const EXACT_ANGLE_RAD: f64 = 1e-5;

const ROBOT_PARTS: &[&str] = &["link", "joint", "material", "transmission", "gazebo", "sensor"];
const LINK_PARTS: &[&str] = &["inertial", "visual", "collision", "verbose", "self_collision_checking"];
const JOINT_PARTS: &[&str] =
    &["origin", "parent", "child", "axis", "limit", "dynamics", "mimic", "calibration", "safety_controller"];

/// Looks at the text of a URDF file. False if it is no use to hand it on.
pub(crate) fn check_urdf(text: &str, findings: &mut Findings) -> bool {
    let remedy = if text.contains("<sdf") {
        "This looks like SDF: turn it into URDF with `proact model import`."
    } else {
        "Correct the file at that place."
    };
    let Some(document) = xml::parse_document(text, "URDF", "one robot element", remedy, findings) else {
        return false;
    };
    let robot = document.root_element();
    if robot.tag_name().name() != "robot" {
        let got = format!("<{}>", robot.tag_name().name());
        let remedy = match robot.tag_name().name() {
            "sdf" | "gazebo" => "This is SDF: turn it into URDF with `proact model import`.",
            _ => "Give a URDF file.",
        };
        findings.error("URDF", "the outermost element is wrong", got, "<robot>", remedy);
        return false;
    }
    if let Some(tag) =
        document.descendants().find(|n| n.tag_name().namespace().is_some_and(|s| s.contains("xacro")))
    {
        findings.error(
            "URDF",
            "the file still has xacro macros in it",
            format!("<xacro:{}>", tag.tag_name().name()),
            "plain URDF",
            "Expand it first: xacro FILE > expanded.urdf",
        );
        return false;
    }
    if has_too_many_parts(robot, "URDF", findings) {
        return false;
    }
    check_references(robot, findings);
    for node in robot.children().filter(Node::is_element) {
        check_element(node, findings);
    }
    note_rounded_angles(robot, findings);
    true
}

/// Whether `robot`, or SDF's `model`, has more parts than any arm: what follows looks at them in pairs.
pub(crate) fn has_too_many_parts(robot: Node<'_, '_>, file: &str, findings: &mut Findings) -> bool {
    let shape = |node: &Node<'_, '_>| node.has_tag_name("collision") || node.has_tag_name("visual");
    let counts = [
        ("links", robot.children().filter(|node| node.has_tag_name("link")).count(), MAX_LINKS),
        ("joints", robot.children().filter(|node| node.has_tag_name("joint")).count(), MAX_LINKS),
        ("shapes", robot.descendants().filter(shape).count(), MAX_SHAPES),
    ];
    let Some((what, count, max)) = counts.into_iter().find(|(_, count, max)| count > max) else {
        return false;
    };
    let remedy = "Give the arm alone, without the room that it stands in.";
    findings.error(file, format!("there are too many {what}"), count, format!("at most {max}"), remedy);
    true
}

/// Names that are given twice, and joints between links that do not exist.
fn check_references(robot: Node<'_, '_>, findings: &mut Findings) {
    let named = |tag: &'static str| {
        robot.children().filter(move |n| n.has_tag_name(tag)).filter_map(|n| n.attribute("name"))
    };
    for (tag, location_of) in [("link", link_place as fn(&str) -> String), ("joint", joint_place)] {
        let mut seen = BTreeSet::new();
        for name in named(tag) {
            if !seen.insert(name) {
                let remedy = "Rename one of them.";
                findings.error(location_of(name), "the name is given twice", name, "unique names", remedy);
            }
        }
    }
    let links: BTreeSet<&str> = named("link").collect();
    for joint in robot.children().filter(|n| n.has_tag_name("joint")) {
        let location = joint_place(joint.attribute("name").unwrap_or_default());
        for role in ["parent", "child"] {
            let end = joint.children().find(|n| n.has_tag_name(role)).and_then(|n| n.attribute("link"));
            match end {
                Some(name) if links.contains(name) => {}
                Some(name) => findings.error(
                    &location,
                    format!("its {role} link does not exist"),
                    format!("\"{name}\""),
                    format!("one of {}", join_names(links.iter().copied())),
                    format!("Correct the name, or add <link name=\"{name}\"/>."),
                ),
                None => findings.error(
                    &location,
                    format!("its {role} link is not named"),
                    "nothing",
                    format!("<{role} link=\"..\"/>"),
                    "Add the element.",
                ),
            }
        }
    }
}

fn check_element(node: Node<'_, '_>, findings: &mut Findings) {
    let name = node.attribute("name").unwrap_or_default();
    let (location, known) = match node.tag_name().name() {
        "link" => (link_place(name), LINK_PARTS),
        "joint" => (joint_place(name), JOINT_PARTS),
        other => {
            warn_unknown_element("robot", other, ROBOT_PARTS, findings);
            return;
        }
    };
    for child in node.children().filter(Node::is_element) {
        warn_unknown_element(&location, child.tag_name().name(), known, findings);
    }
    let moving = matches!(node.attribute("type"), Some("revolute" | "continuous" | "prismatic"));
    if moving && !node.children().any(|n| n.has_tag_name("axis")) {
        findings.warning(
            &location,
            "no axis is given, so URDF's default applies",
            "nothing, read as 1 0 0",
            "<axis xyz=\"..\"/>",
            "Write the axis down.",
        );
    }
}

fn warn_unknown_element(location: &str, tag: &str, known: &[&str], findings: &mut Findings) {
    if !known.contains(&tag) {
        let expected = join_names(known.iter().copied());
        let remedy = "Correct the spelling, or remove the element.";
        findings.warning(location, "an element has no meaning in URDF and is skipped", tag, expected, remedy);
    }
}

/// 1.57 written for pi/2 turns a whole arm by 0.8 mrad.
fn note_rounded_angles(robot: Node<'_, '_>, findings: &mut Findings) {
    for origin in robot.descendants().filter(|n| n.has_tag_name("origin")) {
        let Some(rpy) = origin.attribute("rpy").and_then(crate::srdf::vector) else { continue };
        for angle in rpy {
            let off = (angle.abs() - FRAC_PI_2).abs();
            if off > EXACT_ANGLE_RAD && off < ROUNDED_ANGLE_RAD {
                let owner = origin.ancestors().find(|n| n.has_tag_name("link") || n.has_tag_name("joint"));
                let name = owner.and_then(|n| n.attribute("name")).unwrap_or_default();
                let is_joint = owner.is_some_and(|n| n.has_tag_name("joint"));
                findings.add(
                    Severity::Note,
                    if is_joint { joint_place(name) } else { link_place(name) },
                    "an angle looks like a rounded pi/2",
                    format!("{angle} rad"),
                    format!("{} rad", FRAC_PI_2.copysign(angle)),
                    "Write all digits if a right angle is meant.",
                );
            }
        }
    }
}

/// Fills in the lines of links and joints that findings are about.
pub(crate) fn add_line_numbers(text: &str, findings: &mut [Finding]) {
    let Some(document) = xml::parse_document(text, "", "", "", &mut Findings::default()) else { return };
    for finding in findings.iter_mut().filter(|f| f.line.is_none() && f.location == "URDF") {
        finding.line = Some(xml::line_of(document.root_element()));
    }
    for node in document.root_element().children().filter(Node::is_element) {
        let Some(name) = node.attribute("name") else { continue };
        let location = match node.tag_name().name() {
            "link" => link_place(name),
            "joint" => joint_place(name),
            _ => continue,
        };
        for finding in findings.iter_mut().filter(|f| f.line.is_none() && f.location == location) {
            // Counts the lines before it: only where somebody asks.
            finding.line = Some(xml::line_of(node));
        }
    }
}
