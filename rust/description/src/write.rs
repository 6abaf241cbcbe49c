//! Writing a model as URDF and SRDF text.

use nalgebra::UnitQuaternion;
use proact_arm::{ArmModel, Grasp, Joint, JointKind, Link, Mimic, VisualGeometry};
use proact_types::{Pose, Shape};
use std::fmt::Write;

/// Decimals of angles and directions: finer than a double holds near pi, coarse enough to hide the last bits
/// that a conversion leaves.
const DECIMALS: usize = 14;

/// URDF text of `model`. Reading it back gives the same model up to rounding in the last digits of rotations.
pub fn to_urdf(model: &ArmModel) -> String {
    urdf(&model.name, &model.links, &model.joints, &model.mimics)
}

/// URDF text of links and joints whose `parent` and `child` index into `links`.
pub(crate) fn urdf(name: &str, links: &[Link], joints: &[Joint], mimics: &[Mimic]) -> String {
    let mut out = format!("<?xml version=\"1.0\"?>\n<robot name=\"{}\">\n", escape_xml(name));
    for link in links {
        write_link(&mut out, link);
    }
    for (index, joint) in joints.iter().enumerate() {
        let mimic = mimics.iter().find(|mimic| mimic.joint == index);
        write_joint(&mut out, joint, links, mimic.map(|mimic| (&*joints[mimic.master].name, mimic)));
    }
    out.push_str("</robot>\n");
    out
}

/// SRDF text of `model`: groups `arm` and `hand`, poses, pairs that may touch, and grasps.
pub fn to_srdf(model: &ArmModel) -> String {
    let mut out = format!("<?xml version=\"1.0\"?>\n<robot name=\"{}\">\n", escape_xml(&model.name));
    let tip = escape_xml(&model.links[model.tip].name);
    for (group, joints) in [("arm", &model.arm), ("hand", &model.hand)] {
        if joints.is_empty() {
            continue;
        }
        write_line(&mut out, format_args!("  <group name=\"{group}\">"));
        for &j in joints {
            write_line(&mut out, format_args!("    <joint name=\"{}\"/>", escape_xml(&model.joints[j].name)));
        }
        write_line(&mut out, format_args!("  </group>"));
    }
    if !model.hand.is_empty() {
        let effector = "<end_effector name=\"hand\" group=\"hand\" parent_group=\"arm\"";
        write_line(&mut out, format_args!("  {effector} parent_link=\"{tip}\"/>"));
    }
    for grasp in &model.grasps {
        write_line(&mut out, format_args!("  {}", grasp_element(grasp)));
    }
    for pose in &model.poses {
        write_line(
            &mut out,
            format_args!("  <group_state name=\"{}\" group=\"{}\">", escape_xml(&pose.name), pose.group),
        );
        let joints = if pose.group == "hand" { &model.hand } else { &model.arm };
        for (&j, angle) in joints.iter().zip(&pose.angles) {
            let name = escape_xml(&model.joints[j].name);
            write_line(&mut out, format_args!("    <joint name=\"{name}\" value=\"{angle}\"/>"));
        }
        write_line(&mut out, format_args!("  </group_state>"));
    }
    for &(a, b) in &model.allowed_collisions {
        let (a, b) = (escape_xml(&model.links[a].name), escape_xml(&model.links[b].name));
        write_line(
            &mut out,
            format_args!("  <disable_collisions link1=\"{a}\" link2=\"{b}\" reason=\"User\"/>"),
        );
    }
    out.push_str("</robot>\n");
    out
}

/// A grasp as an SRDF element.
pub(crate) fn grasp_element(grasp: &Grasp) -> String {
    let Grasp {
        width_range_m: widths,
        center,
        open_pose,
        closed_pose,
        roll_rad: roll,
        max_lean_rad: lean,
        capture_radius_m: opening,
        ..
    } = grasp;
    let (widths, center, range) =
        (join_numbers(widths), join_numbers(center.as_slice()), join_numbers(&grasp.roll_range_rad));
    let (open, closed) = (escape_xml(open_pose), escape_xml(closed_pose));
    let closing = grasp
        .closing_direction
        .map(|closing| format!("closing=\"{}\" ", join_numbers(closing.as_slice())))
        .unwrap_or_default();
    let withdrawal = join_numbers(grasp.withdrawal_direction.as_slice());
    format!(
        "<grasp widths=\"{widths}\" centre=\"{center}\" open=\"{open}\" closed=\"{closed}\" {closing}\
         roll=\"{roll}\" roll_range=\"{range}\" lean=\"{lean}\" opening=\"{opening}\" withdrawal=\"{withdrawal}\"/>"
    )
}

fn write_line(out: &mut String, text: std::fmt::Arguments<'_>) {
    writeln!(out, "{text}").expect("writing to a string cannot fail");
}

fn write_link(out: &mut String, link: &Link) {
    if link.inertial.is_none() && link.collisions.is_empty() && link.visuals.is_empty() {
        write_line(out, format_args!("  <link name=\"{}\"/>", escape_xml(&link.name)));
        return;
    }
    write_line(out, format_args!("  <link name=\"{}\">", escape_xml(&link.name)));
    if let Some(inertial) = &link.inertial {
        let [ixx, ixy, ixz, iyy, iyz, izz] = inertial.inertia;
        write_line(out, format_args!("    <inertial>"));
        write_line(out, format_args!("      {}", origin(&inertial.pose)));
        write_line(out, format_args!("      <mass value=\"{}\"/>", inertial.mass));
        write_line(
            out,
            format_args!(
                "      <inertia ixx=\"{ixx}\" ixy=\"{ixy}\" ixz=\"{ixz}\" iyy=\"{iyy}\" iyz=\"{iyz}\" izz=\"{izz}\"/>"
            ),
        );
        write_line(out, format_args!("    </inertial>"));
    }
    for visual in &link.visuals {
        let geometry = match &visual.geometry {
            VisualGeometry::Shape(shape) => primitive(shape),
            VisualGeometry::Mesh { file, scale } => {
                format!("<mesh filename=\"{}\" scale=\"{}\"/>", escape_xml(file), join_numbers(scale))
            }
        };
        write_line(out, format_args!("    <visual>"));
        write_line(out, format_args!("      {}", origin(&visual.pose)));
        write_line(out, format_args!("      <geometry>{geometry}</geometry>"));
        // urdfdom keeps colours in single precision; these are all the digits that were ever there.
        let color = join_numbers(&visual.color.map(|c| (c * 1e6).round() / 1e6));
        // A material is shared by its name, so the name is its colour.
        let name = color.replace(' ', "_");
        write_line(
            out,
            format_args!("      <material name=\"rgba_{name}\"><color rgba=\"{color}\"/></material>"),
        );
        write_line(out, format_args!("    </visual>"));
    }
    for collision in &link.collisions {
        write_line(out, format_args!("    <collision>"));
        write_line(out, format_args!("      {}", origin(&collision.pose)));
        write_line(out, format_args!("      <geometry>{}</geometry>", primitive(&collision.shape)));
        write_line(out, format_args!("    </collision>"));
    }
    write_line(out, format_args!("  </link>"));
}

fn write_joint(out: &mut String, joint: &Joint, links: &[Link], mimic: Option<(&str, &Mimic)>) {
    let kind = match joint.kind {
        JointKind::Fixed => "fixed",
        JointKind::Revolute => "revolute",
        JointKind::Continuous => "continuous",
        JointKind::Prismatic => "prismatic",
    };
    write_line(out, format_args!("  <joint name=\"{}\" type=\"{kind}\">", escape_xml(&joint.name)));
    write_line(out, format_args!("    {}", origin(&joint.origin)));
    write_line(out, format_args!("    <parent link=\"{}\"/>", escape_xml(&links[joint.parent].name)));
    write_line(out, format_args!("    <child link=\"{}\"/>", escape_xml(&links[joint.child].name)));
    if joint.kind.moves() {
        let l = joint.limits;
        write_line(out, format_args!("    <axis xyz=\"{}\"/>", join_rounded(joint.axis.as_slice())));
        write_line(
            out,
            format_args!(
                "    <limit lower=\"{}\" upper=\"{}\" velocity=\"{}\" effort=\"{}\"/>",
                l.lower, l.upper, l.velocity, l.effort
            ),
        );
        write_line(
            out,
            format_args!("    <dynamics damping=\"{}\" friction=\"{}\"/>", joint.damping, joint.friction),
        );
        if let Some((master, Mimic { multiplier, offset, .. })) = mimic {
            let master = escape_xml(master);
            write_line(
                out,
                format_args!(
                    "    <mimic joint=\"{master}\" multiplier=\"{multiplier}\" offset=\"{offset}\"/>"
                ),
            );
        }
    }
    write_line(out, format_args!("  </joint>"));
}

fn primitive(shape: &Shape) -> String {
    match shape {
        Shape::Box { size } => format!("<box size=\"{}\"/>", join_numbers(size)),
        Shape::Sphere { radius } => format!("<sphere radius=\"{radius}\"/>"),
        Shape::Cylinder { radius, length } => format!("<cylinder radius=\"{radius}\" length=\"{length}\"/>"),
        // URDF has no capsule; the cylinder around it is the nearest primitive that encloses it.
        Shape::Capsule { radius, length } => {
            format!("<cylinder radius=\"{radius}\" length=\"{}\"/>", length + 2.0 * radius)
        }
    }
}

fn origin(pose: &Pose) -> String {
    let xyz = join_numbers(pose.translation.vector.as_slice());
    format!("<origin xyz=\"{xyz}\" rpy=\"{}\"/>", join_rounded(&roll_pitch_yaw(&pose.rotation)))
}

/// Fixed-axis roll, pitch and yaw, rad. Near a pitch of pi/2, where roll and yaw turn about one axis, roll is zero.
fn roll_pitch_yaw(rotation: &UnitQuaternion<f64>) -> [f64; 3] {
    let m = rotation.to_rotation_matrix();
    // The arc sine of an element near one would lose half of the digits; this does not.
    let across = m[(0, 0)].hypot(m[(1, 0)]);
    let pitch = (-m[(2, 0)]).atan2(across);
    if across > 1e-9 {
        [m[(2, 1)].atan2(m[(2, 2)]), pitch, m[(1, 0)].atan2(m[(0, 0)])]
    } else {
        [0.0, pitch, (-m[(0, 1)]).atan2(m[(1, 1)])]
    }
}

fn join_numbers(numbers: &[f64]) -> String {
    // Adding zero turns -0 into 0.
    numbers.iter().map(|n| (n + 0.0).to_string()).collect::<Vec<_>>().join(" ")
}

fn join_rounded(numbers: &[f64]) -> String {
    let scale = 10f64.powi(DECIMALS as i32);
    join_numbers(&numbers.iter().map(|n| (n * scale).round() / scale).collect::<Vec<_>>())
}

fn escape_xml(text: &str) -> String {
    // Line ends and tabs in an attribute would be read as spaces.
    let text = text.replace('&', "&amp;").replace('<', "&lt;").replace('"', "&quot;");
    text.replace('\n', "&#10;").replace('\r', "&#13;").replace('\t', "&#9;")
}
