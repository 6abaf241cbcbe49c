//! Descriptions that cannot be used are refused with what was wrong, what was there, and what to do.
#![allow(clippy::unwrap_used, clippy::disallowed_methods)]

use proact_description::{
    DescriptionError, ImportOptions, MPL_RIGHT_ARM_SRDF, MPL_RIGHT_ARM_URDF, check, import, load, mirror,
    parse, parse_urdf,
};
use std::path::Path;

const INERTIAL: &str =
    "<inertial><mass value='1'/><inertia ixx='1' ixy='0' ixz='0' iyy='1' iyz='0' izz='1'/></inertial>";
const COLLISION: &str = "<collision><geometry><sphere radius='0.1'/></geometry></collision>";
const ENDS: &str = "<parent link='base'/><child link='hand'/>";
const AXIS: &str = "<axis xyz='0 0 1'/>";
const LIMIT: &str = "<limit lower='-1' upper='1' velocity='1' effort='1'/>";

/// An arm of one joint, `elbow`, and one moving link, `hand`.
fn arm(link: &str, joint_type: &str, joint: &str) -> String {
    format!(
        "<robot name='arm'><link name='base'/><link name='hand'>{link}</link>\
         <joint name='elbow' type='{joint_type}'>{joint}</joint></robot>"
    )
}

fn with_link(link: &str) -> String {
    arm(link, "revolute", &format!("{ENDS}{AXIS}{LIMIT}"))
}

fn with_joint(joint: &str) -> String {
    arm(&format!("{INERTIAL}{COLLISION}"), "revolute", joint)
}

/// The refusal of `urdf`; it must hold every one of `words`.
fn refused(urdf: &str, words: &[&str]) {
    let error = parse_urdf(urdf).expect_err(urdf).to_string();
    for word in words {
        assert!(error.contains(word), "{word:?} is not in: {error}");
    }
}

#[test]
fn the_arm_that_the_bad_ones_are_made_of_is_good() {
    let model = parse_urdf(&with_joint(&format!("{ENDS}{AXIS}{LIMIT}"))).unwrap();
    assert_eq!((model.arm.len(), model.hand.len(), model.tip), (1, 0, 1));
}

#[test]
fn malformed_text_is_refused_with_the_place() {
    refused("", &["not well-formed XML"]);
    refused("<robot name='x'>\n<link name=></robot>", &["not well-formed XML", "2:12"]);
    refused("<sdf version='1.5'/>", &["<sdf>", "proact model import"]);
    refused("<urdf/>", &["outermost element", "<urdf>", "<robot>"]);
    refused(
        "<robot name='x' xmlns:xacro='http://ros.org/wiki/xacro'><xacro:macro/></robot>",
        &["xacro", "Expand"],
    );
    refused("<robot name='x'/>", &["urdfdom refuses"]);
}

#[test]
fn a_joint_to_a_missing_link_is_refused_by_name_with_the_line() {
    let bad = with_joint(&format!("<parent link='base'/><child link='wrist'/>{AXIS}{LIMIT}"));
    refused(&bad, &["joint \"elbow\" (line 1)", "child link does not exist", "\"wrist\"", "base, hand"]);
    refused(&with_joint(&format!("<child link='hand'/>{AXIS}{LIMIT}")), &["parent link is not named"]);
    // The whole arm with one link taken out: the "missing joint" and "missing link".
    let cut = MPL_RIGHT_ARM_URDF
        .replace("<child link=\"mpl_right_arm__elbow_link\"/>", "<child link=\"nowhere\"/>");
    refused(&cut, &["joint \"mpl_right_arm__elbow\"", "nowhere"]);
}

#[test]
fn a_missing_joint_is_named_by_the_group_that_needs_it() {
    let cut = MPL_RIGHT_ARM_URDF.replace("<joint name=\"mpl_right_arm__elbow\"", "<joint name=\"other\"");
    let error = parse(&cut, MPL_RIGHT_ARM_SRDF).unwrap_err().to_string();
    assert!(error.contains("group \"mpl_arm\": a joint does not exist: got mpl_right_arm__elbow"), "{error}");
    let report = proact_description::check(&cut, Some(MPL_RIGHT_ARM_SRDF));
    let named = report.findings.iter().any(|finding| finding.location.contains("joint \"other\""));
    assert!(named, "a moving joint without a group is named too: {report}");
}

#[test]
fn masses_that_no_body_has_are_refused() {
    for (mass, shown) in [("0", "0 kg"), ("-0.5", "-0.5 kg")] {
        let link =
            format!("{}{COLLISION}", INERTIAL.replace("mass value='1'", &format!("mass value='{mass}'")));
        refused(
            &with_link(&link),
            &["link \"hand\" (line 1)", "mass is not above zero", shown, "above zero, kg"],
        );
    }
    for mass in ["nan", "inf", "1e999", "heavy", ""] {
        let link = INERTIAL.replace("mass value='1'", &format!("mass value='{mass}'"));
        refused(&with_link(&link), &["hand"]);
    }
}

#[test]
fn inertias_that_no_body_has_are_refused_or_doubted() {
    refused(
        &with_link(&INERTIAL.replace("ixx='1'", "ixx='0'")),
        &["link \"hand\"", "inertia is not that of a body"],
    );
    refused(&with_link(&INERTIAL.replace("ixy='0'", "ixy='2'")), &["principal moments -1.000e0"]);
    // The triangle inequality is often broken by exporters, and engines bear it: a warning.
    let flat = with_link(&format!("{}{COLLISION}", INERTIAL.replace("izz='1'", "izz='3'")));
    assert!(parse_urdf(&flat).is_ok());
    let report = proact_description::check(&flat, None);
    assert!(report.findings.iter().any(|f| f.problem.contains("exceeds the sum")), "{report}");
}

#[test]
fn joints_that_cannot_be_driven_are_refused() {
    for kind in ["planar", "floating"] {
        let bad = arm(INERTIAL, kind, &format!("{ENDS}{AXIS}{LIMIT}"));
        refused(
            &bad,
            &["joint \"elbow\"", "type is not supported", kind, "revolute, continuous, prismatic or fixed"],
        );
    }
    refused(&arm(INERTIAL, "hinge", &format!("{ENDS}{AXIS}{LIMIT}")), &["urdfdom refuses", "elbow"]);
    refused(&with_joint(&format!("{ENDS}{AXIS}")), &["urdfdom refuses", "elbow"]);
    refused(
        &with_joint(&format!("{ENDS}<axis xyz='0 0 0'/>{LIMIT}")),
        &["axis has no direction", "[0.0, 0.0, 0.0]"],
    );
    let reversed = LIMIT.replace("'-1'", "'1.5'");
    refused(
        &with_joint(&format!("{ENDS}{AXIS}{reversed}")),
        &["limits are reversed", "lower 1.5, upper 1 rad"],
    );
    let negative = LIMIT.replace("effort='1'", "effort='-1'");
    refused(&with_joint(&format!("{ENDS}{AXIS}{negative}")), &["effort limit is not above zero", "-1 N m"]);
    let damped = format!("{ENDS}{AXIS}{LIMIT}<dynamics damping='-1'/>");
    refused(&with_joint(&damped), &["damping is not usable", "-1"]);
    let coupled = format!("{ENDS}{AXIS}{LIMIT}<mimic joint='elbow'/>");
    refused(&with_joint(&coupled), &["joint \"elbow\"", "the joint that it follows is none"]);
    let still = arm(INERTIAL, "fixed", ENDS);
    refused(&still, &["number of moving joints", "got 0", "1 to 40"]);
}

#[test]
fn shapes_that_cannot_collide_are_refused() {
    let mesh = "<collision><geometry><mesh filename='a.stl'/></geometry></collision>";
    refused(&with_link(mesh), &["a mesh cannot be used for collision", "a.stl", "box, cylinder or sphere"]);
    refused(&with_link(&COLLISION.replace("0.1", "0")), &["sphere has no size", "[0.0] m"]);
    refused(&with_link(&COLLISION.replace("0.1", "-2")), &["sphere has no size"]);
    let cone = "<collision><geometry><cone/></geometry></collision>";
    refused(&with_link(cone), &["urdfdom refuses"]);
}

#[test]
fn loops_are_refused() {
    let second = "<joint name='again' type='fixed'><parent link='base'/><child link='hand'/></joint></robot>";
    let bad = with_joint(&format!("{ENDS}{AXIS}{LIMIT}")).replace("</robot>", second);
    refused(&bad, &["link \"hand\"", "hangs on several joints", "again, elbow"]);
    // Two links that hang on each other, apart from the rest.
    let ring = "<link name='a'/><link name='b'/>\
                <joint name='ab' type='fixed'><parent link='a'/><child link='b'/></joint>\
                <joint name='ba' type='fixed'><parent link='b'/><child link='a'/></joint></robot>";
    let bad = with_joint(&format!("{ENDS}{AXIS}{LIMIT}")).replace("</robot>", ring);
    refused(&bad, &["link \"a\"", "does not hang on the base"]);
    // No link without a parent.
    let closed = "<joint name='back' type='fixed'><parent link='hand'/><child link='base'/></joint></robot>";
    refused(
        &with_joint(&format!("{ENDS}{AXIS}{LIMIT}")).replace("</robot>", closed),
        &["urdfdom refuses", "root"],
    );
}

#[test]
fn names_given_twice_are_refused() {
    let bad = with_joint(&format!("{ENDS}{AXIS}{LIMIT}")).replace("</robot>", "<link name='hand'/></robot>");
    refused(&bad, &["link \"hand\"", "given twice"]);
}

#[test]
fn every_error_is_listed_not_only_the_first() {
    let bad = with_link(&INERTIAL.replace("value='1'", "value='0'")).replace("lower='-1'", "lower='2'");
    let Err(DescriptionError::Invalid { findings }) = parse_urdf(&bad) else { panic!("it must be refused") };
    let errors = findings.iter().filter(|f| f.severity == proact_description::Severity::Error).count();
    assert_eq!(errors, 2, "{findings:?}");
}

/// The right arm with one thing of its SRDF changed.
fn refused_srdf(from: &str, to: &str, words: &[&str]) {
    let changed = MPL_RIGHT_ARM_SRDF.replacen(from, to, 1);
    assert_ne!(changed, MPL_RIGHT_ARM_SRDF, "{from} is not in the file");
    let error = parse(MPL_RIGHT_ARM_URDF, &changed).expect_err(to).to_string();
    for word in words {
        assert!(error.contains(word), "{word:?} is not in: {error}");
    }
}

#[test]
fn semantics_that_do_not_fit_the_arm_are_refused() {
    refused_srdf(
        "<joint name=\"mpl_right_arm__humerus\"/>",
        "<joint name=\"biceps\"/>",
        &["biceps", "mpl_arm"],
    );
    refused_srdf(" value=\"1.029\"", " value=\"nan\"", &["pose \"start\"", "\"nan\"", "finite"]);
    refused_srdf(
        "parent_group=\"mpl_arm\"",
        "parent_group=\"leg\"",
        &["end effector", "leg", "mpl_arm, mpl_hand"],
    );
    refused_srdf("parent_link=\"mpl_right_arm__wristz_link\"", "parent_link=\"palm\"", &["palm"]);
    refused_srdf("parent_link=\"mpl_right_arm__wristz_link\"", "", &["parent_link is missing"]);
    refused_srdf("xyz=\"0.0145 -0.0825 -0.091\"", "xyz=\"0.0145 -0.0825\"", &["xyz is not a point"]);
    refused_srdf(
        "<grasp_centre link=\"mpl_right_arm__wristz_link\"",
        "<grasp_centre link=\"base_link\"",
        &["tip"],
    );
    refused_srdf("roll=\"0.4468042885105484\"", "roll=\"2\"", &["roll is out of its range", "2"]);
    refused_srdf("lean=\"0.2617993877991494\"", "lean=\"wide\"", &["lean cannot be read", "wide"]);
    refused_srdf("opening=\"0.07\"", "", &["opening is missing"]);
    refused_srdf(
        "<group name=\"mpl_arm\">",
        "<group name=\"mpl_arm\"><link name=\"x\"/>",
        &["a link does not exist", "x"],
    );
    refused_srdf(
        "<group name=\"mpl_arm\">",
        "<group name=\"mpl_arm\"><group name=\"mpl_arm\"/>",
        &["a group is in itself"],
    );
    assert!(parse(MPL_RIGHT_ARM_URDF, "<robot").unwrap_err().to_string().contains("SRDF"));
    assert!(parse(MPL_RIGHT_ARM_URDF, "").is_err());
}

/// As the assistants of other programs write it: links in groups, groups in groups, poses of both and of some joints, a second end
/// effector, no parent_group, a joint in no group.
#[test]
fn an_srdf_file_as_others_write_it_is_read_in_full() {
    let hand_joints: String = {
        let start = MPL_RIGHT_ARM_SRDF.find("<group name=\"mpl_hand\">").unwrap();
        let end = start + MPL_RIGHT_ARM_SRDF[start..].find("</group>").unwrap();
        MPL_RIGHT_ARM_SRDF[start..end].to_owned()
    };
    let ours = parse(MPL_RIGHT_ARM_URDF, MPL_RIGHT_ARM_SRDF).unwrap();
    let links: String = ours
        .hand
        .iter()
        .map(|&joint| format!("<link name=\"{}\"/>", ours.links[ours.joints[joint].child].name))
        .collect();
    let srdf = MPL_RIGHT_ARM_SRDF
        .replace(&hand_joints, &format!("<group name=\"mpl_hand\">{links}"))
        .replace(" parent_group=\"mpl_arm\"", "")
        .replace(
            "</robot>",
            "<group name=\"all\"><group name=\"mpl_arm\"/><group name=\"mpl_hand\"/></group>\
             <group_state name=\"ready\" group=\"all\"><joint name=\"mpl_right_arm__elbow\" value=\"1\"/></group_state>\
             <end_effector name=\"tool\" group=\"all\" parent_link=\"base_link\"/>\
             <virtual_joint name=\"v\" type=\"fixed\" parent_frame=\"world\" child_link=\"base_link\"/></robot>",
        );
    let model = parse(MPL_RIGHT_ARM_URDF, &srdf).unwrap();
    assert_eq!((&model.arm, &model.hand, model.tip), (&ours.arm, &ours.hand, ours.tip));
    let elbow =
        model.arm.iter().position(|&joint| model.joints[joint].name == "mpl_right_arm__elbow").unwrap();
    let ready = model.pose("arm", "ready").unwrap();
    for (place, (angle, &joint)) in ready.iter().zip(&model.arm).enumerate() {
        let limits = model.joints[joint].limits;
        let rest = 0.0_f64.clamp(limits.lower, limits.upper);
        assert_eq!(*angle, if place == elbow { 1.0 } else { rest }, "{}", model.joints[joint].name);
    }
    let report = proact_description::check(MPL_RIGHT_ARM_URDF, Some(&srdf));
    for words in ["more than one end effector", "an angle is missing"] {
        assert!(report.findings.iter().any(|finding| finding.problem.contains(words)), "{words}: {report}");
    }

    let held = srdf.replace("<joint name=\"mpl_right_arm__humerus\"/>", "");
    let model = parse(MPL_RIGHT_ARM_URDF, &held).unwrap();
    assert_eq!(model.arm.len(), 6, "a joint in no group is held");
}

#[test]
fn a_group_may_be_given_as_a_chain() {
    let start = MPL_RIGHT_ARM_SRDF.find("    <joint name=\"mpl_right_arm__shoulder\"/>").unwrap();
    let end = MPL_RIGHT_ARM_SRDF.find("  </group>").unwrap();
    let mut srdf = MPL_RIGHT_ARM_SRDF.to_owned();
    srdf.replace_range(
        start..end,
        "<chain base_link=\"base_link\" tip_link=\"mpl_right_arm__wristz_link\"/>",
    );
    assert_eq!(
        parse(MPL_RIGHT_ARM_URDF, &srdf).unwrap(),
        parse(MPL_RIGHT_ARM_URDF, MPL_RIGHT_ARM_SRDF).unwrap()
    );
}

#[test]
fn without_semantics_the_arm_ends_where_the_fingers_begin() {
    let (guessed, model) = (parse_urdf(MPL_RIGHT_ARM_URDF).unwrap(), proact_description::mpl_right_arm());
    assert_eq!((guessed.arm, guessed.hand, guessed.tip), (model.arm, model.hand, model.tip));
}

#[test]
fn a_file_that_cannot_be_read_is_named() {
    let error = load(Path::new("no/such/arm.urdf"), None).unwrap_err().to_string();
    assert!(error.contains("no/such/arm.urdf"), "{error}");
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("binary.urdf");
    std::fs::write(&path, [0xff, 0xfe, 0x00]).unwrap();
    assert!(load(&path, None).unwrap_err().to_string().contains("binary.urdf"));
}

#[test]
fn a_part_of_the_arm_can_be_chosen_and_a_wrong_choice_is_refused() {
    let model = proact_description::mpl_right_arm();
    let (base, tip) = ("mpl_right_arm__elbow_link", "mpl_right_arm__wristz_link");
    let part = proact_description::select_chain(&model, base, tip).unwrap();
    let names: Vec<&str> = part.arm.iter().map(|&j| part.joints[j].name.as_str()).collect();
    assert_eq!(names.len(), 4);
    assert_eq!(
        (names[0], part.hand.len(), part.links[0].name.as_str()),
        ("mpl_right_arm__forearm", 20, base)
    );
    assert!(part.joints.iter().enumerate().all(|(k, j)| j.child == k + 1 && j.parent <= k));
    let finger = proact_description::select_chain(&model, "base_link", "mpl_right_arm__ring3_link").unwrap();
    assert_eq!(
        (finger.arm.len(), finger.hand.len(), finger.links[finger.tip].name.as_str()),
        (11, 0, "mpl_right_arm__ring3_link")
    );
    let whole = proact_description::select_chain(&model, "base_link", tip).unwrap();
    assert_eq!(whole, model);
    let error = proact_description::select_chain(&model, tip, base).unwrap_err().to_string();
    assert!(error.contains("does not hang on"), "{error}");
    let error = proact_description::select_chain(&model, "pelvis", tip).unwrap_err().to_string();
    assert!(error.contains("pelvis") && error.contains("base_link"), "{error}");
}

#[test]
fn what_is_larger_or_smaller_than_any_arm_is_refused_with_the_bound() {
    let at = |coordinate: &str| format!("{ENDS}<origin xyz='{coordinate} 0 0'/>{AXIS}{LIMIT}");
    for coordinate in ["1e20", "4e9", "-10.1"] {
        refused(
            &with_joint(&at(coordinate)),
            &["joint \"elbow\" (line 1)", "coordinate of an origin", "at most 10 m"],
        );
    }
    assert!(parse_urdf(&with_joint(&at("9.9"))).is_ok());
    let weight = |kg: &str| with_link(&format!("{}{COLLISION}", INERTIAL.replace("mass value='1'", kg)));
    refused(&weight("mass value='1e308'"), &["link \"hand\"", "the mass is larger", "at most 5000 kg"]);
    refused(&weight("mass value='1e-300'"), &["too small to be simulated", "at least 1e-9 kg"]);
    let spread = INERTIAL.replace("ixx='1'", "ixx='1e9'").replace("iyy='1'", "iyy='1e9'");
    refused(&with_link(&format!("{spread}{COLLISION}")), &["moment of inertia", "at most 100000 kg m^2"]);
    let ball = |m: &str| with_link(&format!("{INERTIAL}{}", COLLISION.replace("0.1", m)));
    refused(&ball("11"), &["a size of a sphere", "at most 10 m"]);
    refused(&ball("1e-9"), &["a sphere is too small", "at least 1e-6 m"]);
    let limit = |from: &str, to: &str| with_joint(&format!("{ENDS}{AXIS}{}", LIMIT.replace(from, to)));
    refused(&limit("upper='1'", "upper='1e9'"), &["the upper limit", "at most 100 rad"]);
    refused(&limit("velocity='1'", "velocity='1e9'"), &["the velocity limit", "at most 1000 rad/s"]);
    refused(&limit("effort='1'", "effort='1e9'"), &["the effort limit", "at most 1000000 N m"]);
    refused(&limit("velocity='1'", "velocity='1e-320'"), &["the velocity limit", "at least 0.001 rad/s"]);
    refused(&limit("effort='1'", "effort='1e-9'"), &["the effort limit", "at least 0.000001 N m"]);
}

#[test]
fn chains_and_trees_that_are_too_long_are_refused_before_anything_recurses_through_them() {
    let chain = |count: usize| {
        let links: String = (0..count).map(|k| format!("<link name='l{k}'/>")).collect();
        let joint = |k: usize| {
            format!("<joint name='j{k}' type='fixed'><parent link='l{k}'/><child link='l{}'/></joint>", k + 1)
        };
        let joints: String = (0..count - 1).map(joint).collect();
        format!("<robot name='chain'>{links}{joints}</robot>")
    };
    refused(&chain(50_000), &["there are too many links", "got 50000", "at most 200"]);
    refused(&chain(150), &["too many joints lie between it and the base", "got 101", "at most 100"]);
    refused(&" ".repeat(9 << 20), &["the text is too long", "at most 8388608 bytes"]);
    let joints = "<joint name='j' type='fixed'><parent link='a'/><child link='b'/></joint>".repeat(10_000);
    refused(
        &format!("<robot name='r'>{joints}</robot>"),
        &["there are too many joints", "got 10000", "at most 200"],
    );
    let shapes = COLLISION.repeat(3000);
    refused(&with_link(&shapes), &["there are too many shapes", "at most 2000"]);
}

#[test]
fn elements_in_elements_and_attributes_without_end_are_refused_before_a_parser_descends() {
    let deep = format!("<robot name='r'>{}{}</robot>", "<x>".repeat(100_000), "</x>".repeat(100_000));
    refused(&deep, &["elements stand too deep in each other", "got 100001", "at most 64"]);
    assert!(parse(MPL_RIGHT_ARM_URDF, &deep).is_err(), "an SRDF as well");
    assert!(import(&deep.replace("robot", "sdf"), &ImportOptions::default()).is_err(), "and an SDF");
    assert!(mirror(&deep).is_err());
    let attributes: String = (0..100_000).map(|k| format!(" a{k}=''")).collect();
    let wide = format!("<robot name='r'{attributes}/>");
    refused(&wide, &["an element has too many attributes", "at most 100"]);
}

#[test]
fn a_thousandfold_mistake_is_said_some_hundred_times_and_still_is_an_error() {
    let skipped = "<x/>\n".repeat(100_000);
    let warnings = check(&arm(&skipped, "revolute", &format!("{ENDS}{AXIS}")), None);
    assert_eq!(warnings.findings.len(), 501, "the error that follows the warnings is kept");
    assert!(!warnings.usable);
    let srdf = format!("<robot name='r'>{}</robot>", "<disable_collisions/>\n".repeat(100_000));
    assert_eq!(check(MPL_RIGHT_ARM_URDF, Some(&srdf)).findings.len(), 500);
}
