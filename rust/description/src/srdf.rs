//! Reading SRDF: groups, named poses, the pairs of links that may touch, and the grasp centre.
//!
//! Debian has no SRDF parser, so the few elements that matter here are read directly. `end_effector` says which
//! group is the hand, which the arm, and at which link the arm ends. `grasp_centre` and `grasp` are ProACT's
//! own elements; there is a `grasp` for each range of widths of objects.

use crate::{finding::Findings, xml};
use proact_arm::Grasp;
use proact_types::Vector;
use roxmltree::Node;

/// What an SRDF file says, not yet compared with the URDF.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct SrdfModel {
    pub(crate) groups: Vec<Group>,
    pub(crate) end_effectors: Vec<EndEffector>,
    pub(crate) states: Vec<GroupState>,
    pub(crate) allowed: Vec<(String, String)>,
    pub(crate) grasp_center: Option<(String, [f64; 3])>,
    /// As written: where no centre is given, it is that of `grasp_centre`.
    pub(crate) grasps: Vec<SrdfGrasp>,
}

/// A grasp, whose parts may stand elsewhere.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct SrdfGrasp {
    pub(crate) grasp: Grasp,
    pub(crate) has_center: bool,
    pub(crate) location: String,
}

#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Group {
    pub(crate) name: String,
    pub(crate) members: Vec<GroupMember>,
}

/// How a group names its joints.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum GroupMember {
    Joint(String),
    Chain {
        base: String,
        tip: String,
    },
    /// The joint that moves it.
    Link(String),
    /// All of another group.
    Group(String),
}

#[derive(Clone, Debug, PartialEq)]
pub(crate) struct EndEffector {
    pub(crate) hand: String,
    pub(crate) arm: Option<String>,
    pub(crate) tip: String,
}

#[derive(Clone, Debug, PartialEq)]
pub(crate) struct GroupState {
    pub(crate) name: String,
    pub(crate) group: String,
    pub(crate) values: Vec<(String, f64)>,
}

/// Reads SRDF text; what cannot be understood becomes an error finding.
pub(crate) fn read(text: &str, findings: &mut Findings) -> SrdfModel {
    let mut out = SrdfModel::default();
    let remedy = "Correct the SRDF file at that place.";
    let Some(document) = xml::parse_document(text, "SRDF", "one robot element", remedy, findings) else {
        return out;
    };
    let robot = document.root_element();
    if robot.tag_name().name() != "robot" {
        let got = format!("<{}>", robot.tag_name().name());
        findings.error(
            "SRDF",
            "the outermost element is wrong",
            got,
            "<robot>",
            "Give the robot's SRDF file.",
        );
        return out;
    }
    for node in robot.children().filter(Node::is_element) {
        if findings.is_full() {
            break;
        }
        match node.tag_name().name() {
            "group" => read_group(node, findings, &mut out),
            "end_effector" => read_end_effector(node, findings, &mut out),
            "group_state" => read_state(node, findings, &mut out),
            "disable_collisions" => {
                if let (Some(a), Some(b)) =
                    (required_attribute(node, "link1", findings), required_attribute(node, "link2", findings))
                {
                    out.allowed.push((a, b));
                }
            }
            "grasp_centre" => {
                if let (Some(link), Some(xyz)) =
                    (required_attribute(node, "link", findings), required_attribute(node, "xyz", findings))
                {
                    match vector(&xyz) {
                        Some(center) => out.grasp_center = Some((link, center)),
                        None => findings.error(
                            element_location(node),
                            "xyz is not a point",
                            format!("\"{xyz}\""),
                            "three finite numbers, metres",
                            "Write the three coordinates with spaces between.",
                        ),
                    }
                }
            }
            "grasp" => out.grasps.extend(read_grasp(node, findings)),
            // virtual_joint, passive_joint, link_sphere_approximation: of no meaning here.
            _ => {}
        }
    }
    out
}

fn read_group(node: Node<'_, '_>, findings: &mut Findings, out: &mut SrdfModel) {
    let Some(name) = required_attribute(node, "name", findings) else { return };
    let mut members = Vec::new();
    for member in node.children().filter(Node::is_element) {
        match member.tag_name().name() {
            "joint" => members.extend(required_attribute(member, "name", findings).map(GroupMember::Joint)),
            "link" => members.extend(required_attribute(member, "name", findings).map(GroupMember::Link)),
            "group" => members.extend(required_attribute(member, "name", findings).map(GroupMember::Group)),
            "chain" => {
                let base = required_attribute(member, "base_link", findings);
                let tip = required_attribute(member, "tip_link", findings);
                members.extend(base.zip(tip).map(|(base, tip)| GroupMember::Chain { base, tip }));
            }
            other => findings.warning(
                format!("group \"{name}\""),
                "a member has no meaning here",
                format!("<{other}>"),
                "<joint>, <link>, <chain> or <group>",
                "It is left out.",
            ),
        }
    }
    out.groups.push(Group { name, members });
}

fn read_end_effector(node: Node<'_, '_>, findings: &mut Findings, out: &mut SrdfModel) {
    let (hand, tip) =
        (required_attribute(node, "group", findings), required_attribute(node, "parent_link", findings));
    let arm = node.attribute("parent_group").map(str::to_owned);
    if let (Some(hand), Some(tip)) = (hand, tip) {
        if let Some(first) = out.end_effectors.first() {
            findings.warning(
                element_location(node),
                "there is more than one end effector",
                format!("group \"{hand}\""),
                "one: the hand",
                format!("The first is taken, group \"{}\".", first.hand),
            );
        }
        out.end_effectors.push(EndEffector { hand, arm, tip });
    }
}

fn read_state(node: Node<'_, '_>, findings: &mut Findings, out: &mut SrdfModel) {
    let (Some(name), Some(group)) =
        (required_attribute(node, "name", findings), required_attribute(node, "group", findings))
    else {
        return;
    };
    let mut values = Vec::new();
    for joint in node.children().filter(|n| n.has_tag_name("joint")) {
        let (Some(joint_name), Some(text)) =
            (required_attribute(joint, "name", findings), required_attribute(joint, "value", findings))
        else {
            continue;
        };
        match number(&text) {
            Some(angle) => values.push((joint_name, angle)),
            None => findings.error(
                format!("pose \"{name}\" of group \"{group}\""),
                format!("the angle of joint \"{joint_name}\" is not usable"),
                format!("\"{text}\""),
                "one finite number, radians",
                "Write the angle as a number.",
            ),
        }
    }
    out.states.push(GroupState { name, group, values });
}

fn read_grasp(node: Node<'_, '_>, findings: &mut Findings) -> Option<SrdfGrasp> {
    let mut numbers = |key: &str, count: usize| {
        let text = required_attribute(node, key, findings)?;
        let numbers: Option<Vec<f64>> = text.split_whitespace().map(number).collect();
        let numbers = numbers.filter(|numbers| numbers.len() == count);
        if numbers.is_none() {
            findings.error(
                element_location(node),
                format!("{key} cannot be read"),
                format!("\"{text}\""),
                format!("{count} finite numbers, radians or metres"),
                "Write the numbers with spaces between.",
            );
        }
        numbers
    };
    let (roll, range) = (numbers("roll", 1)?, numbers("roll_range", 2)?);
    let (lean, opening) = (numbers("lean", 1)?, numbers("opening", 1)?);
    let withdrawal = Vector::from_row_slice(&numbers("withdrawal", 3)?);
    // What a hand with one grasp need not say.
    let mut grasp = Grasp::default();
    let has_center = node.has_attribute("centre");
    if has_center {
        grasp.center = Vector::from_row_slice(&numbers("centre", 3)?);
    }
    if node.has_attribute("widths") {
        let widths = numbers("widths", 2)?;
        grasp.width_range_m = [widths[0], widths[1]];
    }
    if node.has_attribute("closing") {
        grasp.closing_direction = Some(Vector::from_row_slice(&numbers("closing", 3)?));
    }
    for (key, pose) in [("open", &mut grasp.open_pose), ("closed", &mut grasp.closed_pose)] {
        if let Some(name) = node.attribute(key) {
            *pose = name.to_owned().into();
        }
    }
    let grasp = Grasp {
        roll_rad: roll[0],
        roll_range_rad: [range[0], range[1]],
        max_lean_rad: lean[0],
        capture_radius_m: opening[0],
        withdrawal_direction: withdrawal,
        ..grasp
    };
    let mut demand = |is_valid: bool, what: &str, got: f64, expected: &str| {
        if !is_valid {
            findings.error(element_location(node), what, got.to_string(), expected, "Correct the number.");
        }
    };
    demand(
        range[0] <= roll[0] && roll[0] <= range[1],
        "roll is out of its range",
        roll[0],
        "an angle within roll_range",
    );
    demand(grasp.max_lean_rad >= 0.0, "lean is negative", grasp.max_lean_rad, "the largest lean, rad");
    demand(grasp.capture_radius_m > 0.0, "opening is not positive", grasp.capture_radius_m, "metres");
    demand(withdrawal.norm() > 0.0, "withdrawal has no direction", withdrawal.norm(), "a vector");
    let [narrow, wide] = grasp.width_range_m;
    demand(
        narrow >= 0.0 && narrow < wide,
        "widths do not ascend from zero",
        narrow,
        "smallest and largest, metres",
    );
    let closing = grasp.closing_direction.map_or(1.0, |closing| closing.norm());
    demand(closing > 0.0, "closing has no direction", closing, "a vector, or no such attribute");
    Some(SrdfGrasp { grasp, has_center, location: element_location(node) })
}

/// The attribute called `key`; its lack is an error finding.
fn required_attribute(node: Node<'_, '_>, key: &str, findings: &mut Findings) -> Option<String> {
    let value = node.attribute(key).filter(|v| !v.trim().is_empty()).map(str::to_owned);
    if value.is_none() {
        findings.error(
            element_location(node),
            format!("the attribute {key} is missing"),
            "nothing",
            format!("{key}=\"..\""),
            "Add the attribute.",
        );
    }
    value
}

fn element_location(node: Node<'_, '_>) -> String {
    format!("SRDF <{}> at line {}", node.tag_name().name(), xml::line_of(node))
}

/// A finite number, or nothing.
pub(crate) fn number(text: &str) -> Option<f64> {
    text.trim().parse().ok().filter(|x: &f64| x.is_finite())
}

/// Three finite numbers with white space between, or nothing.
pub(crate) fn vector(text: &str) -> Option<[f64; 3]> {
    let numbers: Option<Vec<f64>> = text.split_whitespace().map(number).collect();
    numbers?.try_into().ok()
}
