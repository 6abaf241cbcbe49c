//! What files of labs lack, one description for each kind: all of them become arms, and what was filled in is said.
#![allow(clippy::unwrap_used, clippy::disallowed_methods)]

use proact_arm::{JointKind, VisualGeometry};
use proact_description::{DescriptionError, ImportOptions, ImportedArm, MeshFolders, TriangleMesh, import};
use proact_types::{Shape, Vector};
use std::{fmt::Write as _, fs, path::Path};

const MASS: &str = "<inertial><mass value=\"1\"/><inertia ixx=\"0.01\" ixy=\"0\" ixz=\"0\" iyy=\"0.01\" iyz=\"0\" izz=\"0.01\"/></inertial>";
const BOX: &str = "<collision><geometry><box size=\"0.04 0.04 0.1\"/></geometry></collision>";

fn link(name: &str, content: &str) -> String {
    format!("<link name=\"{name}\">{content}</link>\n")
}

fn joint(name: &str, kind: &str, [parent, child]: [&str; 2], content: &str) -> String {
    format!(
        "<joint name=\"{name}\" type=\"{kind}\"><origin xyz=\"0 0 0.2\"/><parent link=\"{parent}\"/><child link=\"{child}\"/>\
         <axis xyz=\"0 1 0\"/>{content}</joint>\n"
    )
}

const LIMIT: &str = "<limit lower=\"-2\" upper=\"2\" effort=\"20\" velocity=\"2\"/>";

/// An arm of two joints with a hand of two fingers, and `more`.
fn arm(more: &str) -> String {
    let solid = format!("{MASS}{BOX}");
    let mut text = "<robot name=\"two\">\n".to_owned();
    for name in ["base", "upper", "palm"] {
        text += &link(name, &solid);
    }
    for name in ["left", "right"] {
        text += &link(
            name,
            &format!("{MASS}{}", BOX.replace("<geometry>", "<origin xyz=\"0 0 0.05\"/><geometry>")),
        );
    }
    text += &joint("shoulder", "revolute", ["base", "upper"], LIMIT);
    text += &joint("wrist", "revolute", ["upper", "palm"], LIMIT);
    for (name, child, y) in [("finger_left", "left", 0.05), ("finger_right", "right", -0.05)] {
        let _ = writeln!(
            text,
            "<joint name=\"{name}\" type=\"revolute\"><origin xyz=\"0 {y} 0.05\"/><parent link=\"palm\"/><child link=\"{child}\"/>\
             <axis xyz=\"1 0 0\"/><limit lower=\"-0.8\" upper=\"0.8\" effort=\"5\" velocity=\"2\"/></joint>"
        );
    }
    text + more + "</robot>"
}

fn imported(text: &str) -> ImportedArm {
    import(text, &ImportOptions::default()).unwrap_or_else(|error| panic!("{error}\n{text}"))
}

#[track_caller]
fn said(arm: &ImportedArm, place: &str, words: &str) {
    let found = |f: &&proact_description::Finding| f.location.contains(place) && f.problem.contains(words);
    assert!(arm.report.findings.iter().any(|f| found(&f)), "{words:?} of {place} is not in {}", arm.report);
}

fn names(arm: &ImportedArm, joints: &[usize]) -> Vec<String> {
    joints.iter().map(|&joint| arm.model.joints[joint].name.clone()).collect()
}

fn mass(arm: &ImportedArm) -> f64 {
    arm.model.links.iter().filter_map(|link| link.inertial).map(|inertial| inertial.mass).sum()
}

#[test]
fn an_arm_that_lacks_nothing_gets_poses_alone() {
    let arm = imported(&arm(""));
    assert!(arm.report.findings.is_empty(), "{}", arm.report);
    assert_eq!(names(&arm, &arm.model.arm), ["shoulder", "wrist"]);
    assert_eq!(names(&arm, &arm.model.hand), ["finger_left", "finger_right"]);
    let tip = &arm.model.joints[arm.model.tip - 1];
    assert_eq!(arm.model.links[tip.child].name, "grasp_frame");
    assert_eq!(arm.model.links[tip.parent].name, "palm");
    // The fingers point along z of the palm and close along y; up is against the fingers.
    let [x, z] = [Vector::x(), Vector::z()].map(|axis| tip.origin.rotation * axis);
    assert!((z + Vector::z()).norm() < 1e-9 && x.y.abs() > 1.0 - 1e-9, "{tip:?}");
    let pose = |name: &str| arm.model.pose("hand", name).unwrap().to_vec();
    // Turned about x, the left finger's end goes to the right for positive angles.
    assert_eq!((pose("open"), pose("closed")), (vec![-0.8, 0.8], vec![0.8, -0.8]));
    assert_eq!(arm.model.pose("arm", "start").unwrap(), [0.0, 0.0]);
}

#[test]
fn a_finger_whose_shape_is_on_its_joint_closes_and_one_that_turns_about_itself_does_not() {
    let on_axis = imported(&arm("").replace("<origin xyz=\"0 0 0.05\"/><geometry>", "<geometry>"));
    assert_ne!(on_axis.model.pose("hand", "open").unwrap(), on_axis.model.pose("hand", "closed").unwrap());

    let twisted =
        imported(&arm("").replace(
            "<axis xyz=\"1 0 0\"/><limit lower=\"-0.8\"",
            "<axis xyz=\"0 0 1\"/><limit lower=\"-0.8\"",
        ));
    assert_eq!(twisted.model.pose("hand", "open").unwrap(), twisted.model.pose("hand", "closed").unwrap());
    assert!(twisted.found.iter().any(|said| said.contains("no joint of the hand")), "{:?}", twisted.found);
    assert!(!twisted.found.iter().any(|said| said.contains("where its joints")), "{:?}", twisted.found);
}

#[test]
fn frames_beside_the_arm_are_no_branches_and_need_no_mass() {
    let frames = link("tool0", "")
        + &link(
            "camera",
            "<inertial><mass value=\"0\"/><inertia ixx=\"0\" ixy=\"0\" ixz=\"0\" iyy=\"0\" iyz=\"0\" izz=\"0\"/></inertial>",
        )
        + &joint("to_tool", "fixed", ["upper", "tool0"], "")
        + &joint("to_camera", "fixed", ["base", "camera"], "");
    let arm = imported(&arm(&frames));
    assert_eq!(names(&arm, &arm.model.arm), ["shoulder", "wrist"]);
    said(&arm, "camera", "frame");
    assert_eq!(mass(&arm), 5.0);
}

#[test]
fn a_frame_that_moves_gets_the_mass_of_what_is_fixed_to_it() {
    let text = arm("").replace(
        &link("upper", &format!("{MASS}{BOX}")),
        &(link("upper", "") + &link("upper_body", &format!("{MASS}{BOX}"))),
    );
    let text =
        text.replace("</robot>", &(joint("to_body", "fixed", ["upper", "upper_body"], "") + "</robot>"));
    let arm = imported(&text);
    said(&arm, "upper", "frame that others are fixed to");
    let inertial = arm.model.links[arm.model.link("upper").unwrap()].inertial.unwrap();
    assert_eq!((inertial.mass, inertial.pose.translation.vector.z), (1.0, 0.2));
    assert_eq!(mass(&arm), 5.0);
}

#[test]
fn mass_and_inertia_that_are_missing_are_computed_from_shapes() {
    // By density: 0.04 x 0.04 x 0.1 m at 1000 kg/m^3.
    let arm_without =
        imported(&arm("").replace(&link("upper", &format!("{MASS}{BOX}")), &link("upper", BOX)));
    said(&arm_without, "upper", "no mass");
    let of = |arm: &ImportedArm| arm.model.links[arm.model.link("upper").unwrap()].inertial.unwrap();
    let inertial = of(&arm_without);
    let across = 0.16 / 12.0 * (0.04_f64.powi(2) + 0.1_f64.powi(2));
    assert!(
        (inertial.mass - 0.16).abs() < 1e-12 && (inertial.inertia[0] - across).abs() < 1e-12,
        "{inertial:?}"
    );
    // By the mass that is given.
    let flat = MASS.replace("ixx=\"0.01\"", "ixx=\"0\"");
    let arm = imported(
        &arm("").replace(&link("upper", &format!("{MASS}{BOX}")), &link("upper", &format!("{flat}{BOX}"))),
    );
    said(&arm, "upper", "inertia is missing or not that of a body");
    assert!((of(&arm).inertia[0] - across / 0.16).abs() < 1e-12);
}

#[test]
fn limits_that_are_missing_zero_or_reversed_are_filled_in() {
    for (limit, words) in [
        ("", "no limits"),
        ("<limit lower=\"-2\" upper=\"2\" effort=\"0\" velocity=\"2\"/>", "effort is not limited"),
        ("<limit lower=\"-2\" upper=\"2\" effort=\"20\" velocity=\"0\"/>", "speed is not limited"),
        ("<limit lower=\"2\" upper=\"-2\" effort=\"20\" velocity=\"2\"/>", "reversed"),
    ] {
        let whole = joint("shoulder", "revolute", ["base", "upper"], LIMIT);
        let arm =
            imported(&arm("").replace(&whole, &joint("shoulder", "revolute", ["base", "upper"], limit)));
        said(&arm, "shoulder", words);
        let limits = arm.model.joints[arm.model.joint("shoulder").unwrap()].limits;
        assert!(limits.lower < limits.upper && limits.velocity > 0.0 && limits.effort > 0.0, "{limits:?}");
    }
    // 3 kg and 1 kg beyond the shoulder, at 0.2 m from joint to joint: no less than what holds them level.
    let text = arm("").replace(" effort=\"20\"", "");
    let limits = imported(&text).model.joints[0].limits;
    assert!(limits.effort > 9.81 * (0.2 + 2.0 * 0.2), "{limits:?}");
}

#[test]
fn couplings_of_couplings_become_one() {
    let follower = "<joint name=\"finger_right\" type=\"revolute\">";
    let chain = arm("")
        .replace(follower, &format!("{follower}<mimic joint=\"middle\" multiplier=\"2\" offset=\"0.1\"/>"))
        .replace(
            "</robot>",
            &(link("m", &format!("{MASS}{BOX}"))
                + &joint(
                    "middle",
                    "revolute",
                    ["palm", "m"],
                    &format!("<mimic joint=\"finger_left\" multiplier=\"-0.5\" offset=\"0.2\"/>{LIMIT}"),
                )
                + "</robot>"),
        );
    let arm = imported(&chain);
    said(&arm, "finger_right", "coupling of a coupling");
    let [right, left] = ["finger_right", "finger_left"].map(|name| arm.model.joint(name).unwrap());
    let mimic = arm.model.mimics.iter().find(|mimic| mimic.joint == right).unwrap();
    assert_eq!((mimic.master, mimic.multiplier), (left, -1.0));
    assert!((mimic.offset - 0.5).abs() < 1e-12, "{mimic:?}");
    // A loop, and a joint that stands.
    let looped = chain.replace("joint=\"finger_left\"", "joint=\"finger_right\"");
    said(&imported(&looped), "finger_right", "in a circle");
    let still = chain.replace("multiplier=\"2\"", "multiplier=\"0\"");
    said(&imported(&still), "finger_right", "by nothing");
    let unreadable = chain.replace("multiplier=\"2\"", "multiplier=\"0,5\"");
    let error = import(&unreadable, &ImportOptions::default()).unwrap_err().to_string();
    assert!(error.contains("finger_right") && error.contains("0,5"), "{error}");
}

#[test]
fn another_tree_a_loop_and_other_joints_are_left_out_or_held() {
    let floor =
        link("floor", BOX) + &link("lamp", BOX) + &joint("lamp_mount", "fixed", ["floor", "lamp"], "");
    said(&imported(&arm(&floor)), "URDF", "several trees");
    let looped = imported(&arm(&joint("rod", "revolute", ["left", "right"], LIMIT)));
    said(&looped, "rod", "closes a loop");
    assert_eq!(looped.model.joints.len(), 5, "those of the arm, and the frame of the grasp");

    let second = link("head", &format!("{MASS}{BOX}"))
        + &joint(
            "neck",
            "revolute",
            ["base", "head"],
            "<limit lower=\"0.3\" upper=\"1\" effort=\"1\" velocity=\"1\"/>",
        );
    let options = ImportOptions { base: Some("base"), tip: Some("palm"), ..ImportOptions::default() };
    let arm_with_head = import(&arm(&second), &options).unwrap();
    said(&arm_with_head, "neck", "not of the chosen arm");
    assert_eq!(names(&arm_with_head, &arm_with_head.model.arm), ["shoulder", "wrist"]);
    let neck = &arm_with_head.model.joints[arm_with_head.model.joint("neck").unwrap()];
    assert!(neck.kind == JointKind::Fixed && (neck.origin.rotation.angle() - 0.3).abs() < 1e-12, "{neck:?}");
    for (base, tip) in [("nowhere", "palm"), ("base", "nowhere")] {
        let options = ImportOptions { base: Some(base), tip: Some(tip), ..ImportOptions::default() };
        let error = import(&arm(""), &options).unwrap_err().to_string();
        assert!(error.contains("\"nowhere\"") && error.contains("palm"), "{error}");
    }
}

#[test]
fn two_arms_are_asked_for_by_name_and_a_hand_alone_is_refused() {
    let solid = format!("{MASS}{BOX}");
    let mut text = "<robot name=\"two arms\">".to_owned() + &link("torso", &solid);
    for side in ["left", "right"] {
        let mut parent = "torso".to_owned();
        for joint_name in ["shoulder", "elbow", "wrist"] {
            let child = format!("{side}_{joint_name}_link");
            text += &(link(&child, &solid)
                + &joint(&format!("{side}_{joint_name}"), "revolute", [&parent, &child], LIMIT));
            parent = child;
        }
        for finger in ["a", "b"] {
            let child = format!("{side}_{finger}");
            text += &(link(&child, &solid)
                + &joint(&format!("{child}_joint"), "revolute", [&parent, &child], LIMIT));
        }
    }
    text += "</robot>";
    // Without further words the right one is taken, and the other is named.
    let arm = imported(&text);
    assert_eq!(names(&arm, &arm.model.arm), ["right_shoulder", "right_elbow", "right_wrist"]);
    let said =
        arm.report.findings.iter().find(|finding| finding.problem.contains("more than one chain")).unwrap();
    assert!(said.remedy.contains("--base torso --tip left_wrist_link"), "{said}");
    let options =
        ImportOptions { base: Some("torso"), tip: Some("right_wrist_link"), ..ImportOptions::default() };
    let arm = import(&text, &options).unwrap();
    assert_eq!(names(&arm, &arm.model.arm), ["right_shoulder", "right_elbow", "right_wrist"]);
    assert_eq!(names(&arm, &arm.model.hand), ["right_a_joint", "right_b_joint"]);

    let hand = imported(&arm_alone(&["palm", "left", "right"]));
    assert!(hand.report.findings.iter().any(|finding| finding.problem.contains("a hand without an arm")));
    assert_eq!(
        (hand.model.arm.len(), hand.model.hand.len()),
        (7, 2),
        "it is mounted on an arm of seven joints"
    );
}

/// The links that are named, with the joints between them.
/// A hand of three digits of `phalanges` links each on the link `palm` of `side`.
fn digits(side: &str, phalanges: usize) -> String {
    let solid = format!("{MASS}{}", BOX.replace("0.04 0.04 0.1", "0.01 0.01 0.01"));
    let mut text = link(&format!("{side}_palm"), &solid);
    for digit in 0..3 {
        let mut parent = format!("{side}_palm");
        for phalanx in 0..phalanges {
            let child = format!("{side}_{digit}_{phalanx}");
            text += &link(&child, &solid);
            let _ = writeln!(
                text,
                "<joint name=\"{child}_joint\" type=\"revolute\"><origin xyz=\"0 {} 0.01\"/><parent link=\"{parent}\"/>\
                 <child link=\"{child}\"/><axis xyz=\"1 0 0\"/>{LIMIT}</joint>",
                if phalanx == 0 { 0.02 * (f64::from(digit) - 1.0) } else { 0.0 }
            );
            parent = child;
        }
    }
    text
}

#[test]
fn one_of_two_hands_is_taken() {
    let mount = |side: &str, y: &str| {
        format!(
            "<joint name=\"{side}_mount\" type=\"revolute\"><origin xyz=\"0 {y} 0\"/><parent link=\"stand\"/>\
             <child link=\"{side}_palm\"/><axis xyz=\"0 0 1\"/>{LIMIT}</joint>"
        )
    };
    let text = format!(
        "<robot name=\"pair\">{}{}{}{}{}</robot>",
        link("stand", MASS),
        digits("left", 2),
        digits("right", 2),
        mount("left", "0.6"),
        mount("right", "-0.6")
    );
    let arm = imported(&text);
    said(&arm, "URDF", "more than one hand");
    assert_eq!(arm.model.hand.len(), 6);
    assert!(names(&arm, &arm.model.hand).iter().all(|name| name.starts_with("right_")));
}

#[test]
fn of_a_hand_with_more_joints_than_a_model_takes_the_last_ones_are_held() {
    let mut text = format!("<robot name=\"many\">{}{}", link("base", MASS), digits("big", 13));
    let mut parent = "base".to_owned();
    for number in 1..=3 {
        let name = format!("l{number}");
        text += &link(&name, &format!("{MASS}{BOX}"));
        text += &joint(&format!("j{number}"), "revolute", [&parent, &name], LIMIT);
        parent = name;
    }
    text += &format!(
        "<joint name=\"mount\" type=\"fixed\"><parent link=\"{parent}\"/><child link=\"big_palm\"/></joint></robot>"
    );
    let arm = imported(&text);
    said(&arm, "URDF", "number of moving joints");
    assert_eq!((arm.model.arm.len(), arm.model.hand.len()), (3, 37));
    assert!(names(&arm, &arm.model.hand).contains(&"big_1_11_joint".to_owned()));
}

#[test]
fn limits_of_zeros_alone_are_none_and_lines_are_those_of_the_file() {
    let zeros = "<limit lower=\"0\" upper=\"0\" effort=\"0\" velocity=\"0\"/>";
    let text = arm("").replacen(LIMIT, zeros, 1);
    let line = 1 + text.lines().position(|line| line.contains("\"shoulder\"")).unwrap();
    let arm = imported(&text);
    said(&arm, "shoulder", "has no limits");
    assert_eq!(names(&arm, &arm.model.arm), ["shoulder", "wrist"]);
    let finding = arm.report.findings.iter().find(|f| f.problem.contains("has no limits")).unwrap();
    assert_eq!(finding.line, Some(u32::try_from(line).unwrap()));
    let shown = arm.report.of_file(Path::new("lab/arm.urdf")).to_string();
    assert!(shown.contains(&format!("(lab/arm.urdf:{line})")), "{shown}");
}

#[test]
fn an_arm_with_links_of_the_grippers_names_gets_a_gripper_with_others() {
    let solid = format!("{MASS}{BOX}");
    let mut text = format!("<robot name=\"bare\">\n{}", link("base", &solid));
    let mut parent = "base";
    for name in ["upper", "fore", "gripper_palm"] {
        text += &link(name, &solid);
        text += &joint(&format!("{name}_left"), "revolute", [parent, name], LIMIT);
        parent = name;
    }
    text += "</robot>";
    let arm = imported(&text);
    assert!(arm.model.link("gripper__palm").is_ok() && arm.model.hand.len() == 2, "{}", arm.report);
    let lines = u32::try_from(text.lines().count()).unwrap();
    assert!(arm.report.findings.iter().all(|f| f.line.is_none_or(|line| line <= lines)), "{}", arm.report);
}

#[test]
fn the_folder_above_counts_only_with_meshes_of_its_own() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("urdf/arm.urdf");
    fs::create_dir_all(file.parent().unwrap()).unwrap();
    write_stl(&folder.path().join("finger.stl"), &box_mesh([0.02, 0.02, 0.1]));
    let read = || MeshFolders::of(&file, []).read("../finger.stl");
    assert!(read().is_err());
    fs::create_dir(folder.path().join("meshes")).unwrap();
    assert!(read().is_ok());
}

#[test]
fn limits_that_are_no_numbers_are_refused_and_infinite_ones_are_none() {
    let with = |limit: &str| arm("").replacen(LIMIT, limit, 1);
    for text in ["nan", "2\u{b0}", "1,5", ""] {
        let text = with(&format!("<limit lower=\"{text}\" upper=\"2\" effort=\"20\" velocity=\"2\"/>"));
        let error = import(&text, &ImportOptions::default()).unwrap_err().to_string();
        assert!(error.contains("shoulder") && error.contains("a limit is not usable"), "{error}");
    }
    let unlimited = imported(&with("<limit lower=\"-inf\" upper=\"inf\" effort=\"20\" velocity=\"2\"/>"));
    said(&unlimited, "shoulder", "limit nothing");
    let joint = unlimited.model.arm[0];
    assert_eq!(unlimited.model.joints[joint].kind, JointKind::Continuous);
    let empty = import("<robot name=\"e\"/>", &ImportOptions::default()).unwrap_err().to_string();
    assert!(empty.contains("it describes nothing"), "{empty}");
}

fn arm_alone(links: &[&str]) -> String {
    let text = arm("");
    let kept = |line: &&str| {
        let name = |key: &str| line.split(key).nth(1).and_then(|rest| rest.split('"').next());
        match line.starts_with("<link") {
            true => name("name=\"").is_some_and(|name| links.contains(&name)),
            false => {
                !line.starts_with("<joint")
                    || name("parent link=\"").is_some_and(|name| links.contains(&name))
            }
        }
    };
    text.lines().filter(kept).collect::<Vec<_>>().join("\n")
}

#[test]
fn millimetres_degrees_and_xacro_are_named() {
    for (from, to, words) in [
        ("xyz=\"0 0 0.2\"", "xyz=\"0 0 200\"", "millimetres"),
        ("lower=\"-2\" upper=\"2\"", "lower=\"-120\" upper=\"120\"", "degrees"),
        (
            "<robot name=\"two\">",
            "<robot name=\"two\" xmlns:xacro=\"http://ros.org/wiki/xacro\"><xacro:arm/>",
            "xacro",
        ),
    ] {
        let error =
            import(&arm("").replacen(from, to, 1), &ImportOptions::default()).unwrap_err().to_string();
        assert!(error.contains(words), "{words}: {error}");
    }
}

/// The corners of a box, and its twelve triangles.
fn box_mesh([a, b, c]: [f64; 3]) -> (Vec<[f64; 3]>, Vec<[usize; 3]>) {
    let corner = |k: usize| {
        [a, b, c]
            .map(|side| side / 2.0)
            .into_iter()
            .enumerate()
            .map(move |(axis, half)| if k >> axis & 1 == 1 { half } else { -half })
    };
    let points = (0..8).map(|k| <[f64; 3]>::try_from(corner(k).collect::<Vec<_>>()).unwrap()).collect();
    let faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    (points, faces.iter().flat_map(|[p, q, r, s]| [[*p, *q, *r], [*p, *r, *s]]).collect())
}

fn write_stl(path: &Path, (points, triangles): &(Vec<[f64; 3]>, Vec<[usize; 3]>)) {
    let mut bytes = vec![0; 80];
    bytes.extend((triangles.len() as u32).to_le_bytes());
    for triangle in triangles {
        bytes.extend([0.0_f32; 3].iter().flat_map(|v| v.to_le_bytes()));
        bytes.extend(
            triangle.iter().flat_map(|corner| points[*corner]).flat_map(|v| (v as f32).to_le_bytes()),
        );
        bytes.extend([0, 0]);
    }
    fs::write(path, bytes).unwrap();
}

fn write_obj(path: &Path, (points, triangles): &(Vec<[f64; 3]>, Vec<[usize; 3]>)) {
    let mut text = "mtllib nowhere.mtl\n".to_owned();
    points.iter().for_each(|[x, y, z]| writeln!(text, "v {x} {y} {z}").unwrap());
    triangles.iter().for_each(|[a, b, c]| writeln!(text, "f {} {} {}", a + 1, b + 1, c + 1).unwrap());
    fs::write(path, text).unwrap();
}

/// In centimetres, moved by its node.
fn write_collada(path: &Path, (points, triangles): &(Vec<[f64; 3]>, Vec<[usize; 3]>)) {
    let numbers: Vec<String> = points.iter().flatten().map(|v| (100.0 * v).to_string()).collect();
    let corners: Vec<String> = triangles.iter().flatten().map(usize::to_string).collect();
    fs::write(path, format!(
        "<COLLADA xmlns=\"http://www.collada.org/2005/11/COLLADASchema\" version=\"1.4.1\"><asset><unit meter=\"0.01\" name=\"centimeter\"/><up_axis>Z_UP</up_axis></asset>\
         <library_geometries><geometry id=\"g\"><mesh><source id=\"p\"><float_array id=\"a\" count=\"24\">{}</float_array>\
         <technique_common><accessor source=\"#a\" count=\"8\" stride=\"3\"><param name=\"X\" type=\"float\"/><param name=\"Y\" type=\"float\"/>\
         <param name=\"Z\" type=\"float\"/></accessor></technique_common></source><vertices id=\"v\"><input semantic=\"POSITION\" source=\"#p\"/></vertices>\
         <triangles count=\"12\"><input semantic=\"VERTEX\" source=\"#v\" offset=\"0\"/><p>{}</p></triangles></mesh></geometry></library_geometries>\
         <library_visual_scenes><visual_scene id=\"s\"><node id=\"n\"><matrix>1 0 0 0 0 1 0 0 0 0 1 5 0 0 0 1</matrix>\
         <instance_geometry url=\"#g\"/></node></visual_scene></library_visual_scenes><scene><instance_visual_scene url=\"#s\"/></scene></COLLADA>",
        numbers.join(" "), corners.join(" "))).unwrap();
}

fn with_mesh(address: &str, scale: &str) -> String {
    let mesh = format!("<geometry><mesh filename=\"{address}\" {scale}/></geometry>");
    let content =
        format!("{MASS}<collision><origin xyz=\"0 0 0.1\"/>{mesh}</collision><visual>{mesh}</visual>");
    arm("").replace(&link("upper", &format!("{MASS}{BOX}")), &link("upper", &content))
}

fn import_in(folder: &Path, text: &str) -> Result<ImportedArm, DescriptionError> {
    let meshes = MeshFolders::of(&folder.join("arm.urdf"), []);
    import(text, &ImportOptions { meshes: Some(&meshes), ..ImportOptions::default() })
}

#[test]
fn meshes_of_three_formats_become_the_box_that_they_are() {
    let folder = tempfile::tempdir().unwrap();
    let mesh = box_mesh([0.06, 0.04, 0.2]);
    write_stl(&folder.path().join("part.stl"), &mesh);
    write_obj(&folder.path().join("part.obj"), &mesh);
    write_collada(&folder.path().join("part.dae"), &mesh);
    for (file, scale, side, z) in [
        ("part.stl", "", 0.06, 0.1),
        ("part.obj", "", 0.06, 0.1),
        ("part.dae", "", 0.06, 0.15),
        ("part.stl", "scale=\"0.5 0.5 0.5\"", 0.03, 0.1),
    ] {
        let arm = import_in(folder.path(), &with_mesh(file, scale)).unwrap();
        let upper = &arm.model.links[arm.model.link("upper").unwrap()];
        let [shape] = upper.collisions.as_slice() else { panic!("{file}: {:?}", upper.collisions) };
        let Shape::Box { size } = shape.shape else { panic!("{file}: {shape:?}") };
        assert!(
            (size[0] - side).abs() < 1e-6 && (shape.pose.translation.vector.z - z).abs() < 1e-6,
            "{file}: {shape:?}"
        );
        let [fit] = arm.fits.as_slice() else { panic!("{:?}", arm.fits) };
        assert!(fit.excess().abs() < 1e-5, "{fit:?}");
        assert!(matches!(upper.visuals[0].geometry, VisualGeometry::Mesh { .. }), "display keeps the mesh");
    }
}

#[test]
fn every_corner_is_enclosed_and_a_hollow_shape_is_cut() {
    let folder = tempfile::tempdir().unwrap();
    // A fork: two prongs on a bar, between which a block has room.
    let place = |(points, triangles): (Vec<[f64; 3]>, Vec<[usize; 3]>), at: [f64; 3]| {
        (
            points.into_iter().map(|p| [p[0] + at[0], p[1] + at[1], p[2] + at[2]]).collect::<Vec<_>>(),
            triangles,
        )
    };
    let parts = [
        place(box_mesh([0.02, 0.12, 0.02]), [0.0, 0.0, 0.0]),
        place(box_mesh([0.02, 0.02, 0.1]), [0.0, 0.05, 0.06]),
        place(box_mesh([0.02, 0.02, 0.1]), [0.0, -0.05, 0.06]),
    ];
    let (mut points, mut triangles) = (Vec::new(), Vec::new());
    for (more, faces) in &parts {
        triangles.extend(faces.iter().map(|face| face.map(|corner| corner + points.len())));
        points.extend(more);
    }
    write_stl(&folder.path().join("fork.stl"), &(points.clone(), triangles));
    let arm = import_in(folder.path(), &with_mesh("fork.stl", "")).unwrap();
    let upper = &arm.model.links[arm.model.link("upper").unwrap()];
    let inside = |point: &[f64; 3]| {
        upper.collisions.iter().any(|shape| {
            let local = shape.pose.inverse_transform_point(&[point[0], point[1], point[2] + 0.1].into());
            match shape.shape {
                Shape::Box { size } => local.iter().zip(size).all(|(v, side)| v.abs() <= side / 2.0 + 1e-6),
                Shape::Sphere { radius } => local.coords.norm() <= radius + 1e-6,
                Shape::Cylinder { radius, length } => {
                    local.x.hypot(local.y) <= radius + 1e-6 && local.z.abs() <= length / 2.0 + 1e-6
                }
                Shape::Capsule { .. } => false,
            }
        })
    };
    assert!(points.iter().all(inside), "{:?}", upper.collisions);
    // 50 mm between the prongs stay free.
    assert!(
        !inside(&[0.0, 0.0, 0.06]) && !inside(&[0.0, 0.025, 0.08]) && !inside(&[0.0, -0.025, 0.08]),
        "{:?}",
        upper.collisions
    );
    assert!(arm.fits[0].shapes > 1 && arm.fits[0].excess() < 0.3, "{:?}", arm.fits);
}

#[test]
fn no_file_is_read_but_meshes_of_the_description() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path().join("package/urdf");
    fs::create_dir_all(&folder).unwrap();
    fs::create_dir_all(place.path().join("package/meshes")).unwrap();
    fs::write(place.path().join("package/package.xml"), "<package/>").unwrap();
    write_stl(&place.path().join("package/meshes/part.stl"), &box_mesh([0.1; 3]));
    write_stl(&place.path().join("secret.stl"), &box_mesh([0.1; 3]));
    fs::write(folder.join("text.stl"), "root:x:0:0:root:/root:/bin/bash\n").unwrap();
    for address in
        ["package://package/meshes/part.stl", "../meshes/part.stl", "model://package/meshes/part.stl"]
    {
        let arm = import_in(&folder, &with_mesh(address, "")).unwrap();
        assert_eq!(arm.fits.len(), 1, "{address}: {}", arm.report);
    }
    for address in [
        "/etc/passwd",
        "file:///etc/passwd",
        "../../secret.stl",
        "package://package/../secret.stl",
        "/dev/zero",
        "text.stl",
    ] {
        let arm = import_in(&folder, &with_mesh(address, "")).unwrap();
        assert!(arm.fits.is_empty(), "{address}");
        said(&arm, "upper", "mesh cannot be used");
        let meshes = MeshFolders::of(&folder.join("arm.urdf"), []);
        assert!(
            meshes.read(address).is_err()
                || TriangleMesh::parse(&meshes.read(address).unwrap().0, Path::new("x.stl")).is_err()
        );
    }
}
