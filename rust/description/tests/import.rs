//! A lab's own arm becomes a checked description.
#![allow(clippy::unwrap_used, clippy::disallowed_methods)]

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use proact_arm::{ArmModel, JointKind};
use proact_description::{ImportOptions, Severity, check, import, mpl_right_arm, parse, to_srdf, to_urdf};
use std::path::PathBuf;

/// The SDF file rounds poses to six digits.
const SDF_ROUNDING: f64 = 2e-6;

fn shared(path: &str) -> Option<String> {
    let folder = std::env::var_os("PROACT_SHARED").map_or_else(
        || PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared")),
        PathBuf::from,
    );
    let text = std::fs::read_to_string(folder.join(path)).ok();
    if text.is_none() {
        println!("skipped: ../shared not found");
    }
    text
}

fn at_zero(model: &ArmModel) -> Vec<Isometry3<f64>> {
    let mut base_from = vec![Isometry3::identity()];
    for joint in &model.joints {
        base_from.push(base_from[joint.parent] * joint.origin);
    }
    base_from
}

#[test]
fn the_gazebo_arm_keeps_every_link_where_the_sdf_file_puts_it() {
    let Some(text) = shared("data/gazebo_mpl_right_arm/model.sdf") else { return };
    let imported = import(&text, &ImportOptions::default()).unwrap();
    assert!(imported.report.usable, "{}", imported.report);
    let model = &imported.model;
    let facts: serde_json::Value = serde_json::from_str(&shared("data/mpl_right_arm.json").unwrap()).unwrap();
    let links = facts["sdf"]["links"].as_array().unwrap();
    assert_eq!(model.links.len(), links.len() + 2, "all links, the base and the frame of the grasp");
    let three = |v: &serde_json::Value| -> [f64; 3] { std::array::from_fn(|k| v[k].as_f64().unwrap()) };
    let poses = at_zero(model);
    let mut mass = 0.0;
    for fact in links {
        let index = model.link(fact["name"].as_str().unwrap()).unwrap();
        let [roll, pitch, yaw] = three(&fact["pose"]["rpy"]);
        let expected = Isometry3::from_parts(
            Translation3::from(Vector3::from(three(&fact["pose"]["xyz"]))),
            UnitQuaternion::from_euler_angles(roll, pitch, yaw),
        );
        let off = expected.inverse() * poses[index];
        assert!(
            off.translation.vector.norm() < 1e-12 && off.rotation.angle() < 1e-7,
            "{}: {off}",
            fact["name"]
        );
        assert_eq!(model.links[index].collisions.len(), fact["collisions"].as_array().unwrap().len());
        mass += model.links[index].inertial.unwrap().mass;
    }
    // The stored sum has seven digits.
    assert!((mass - facts["checks"]["sdf_total_mass_kg"].as_f64().unwrap()).abs() < 1e-7);
    for fact in facts["sdf"]["joints"].as_array().unwrap() {
        let joint = &model.joints[model.joint(fact["name"].as_str().unwrap()).unwrap()];
        assert_eq!(joint.kind, JointKind::Revolute);
        assert_eq!(joint.damping, fact["dynamics"]["damping"].as_f64().unwrap());
        assert_eq!(joint.limits.lower, fact["limit"]["lower"].as_f64().unwrap());
        assert_eq!(joint.limits.upper, fact["limit"]["upper"].as_f64().unwrap());
        // The file gives axes in the model's frame, six digits.
        let axis = poses[joint.child].rotation * joint.axis;
        assert!((axis - Vector3::from(three(&fact["axis"]))).norm() < SDF_ROUNDING, "{}", joint.name);
    }
}

/// Both descend from one model, so below the shoulder they must agree but for rounding to five digits.
#[test]
fn the_gazebo_arm_has_the_axes_and_offsets_of_ours() {
    let Some(text) = shared("data/gazebo_mpl_right_arm/model.sdf") else { return };
    let (theirs, ours) = (import(&text, &ImportOptions::default()).unwrap().model, mpl_right_arm());
    let names = |model: &ArmModel| -> Vec<String> {
        model.moving().map(|j| model.joints[j].name.replace("mpl_right_arm__", "")).collect()
    };
    assert_eq!(names(&theirs), names(&ours)[1..], "the original added the shoulder joint");
    for j in theirs.moving().skip(1) {
        let a = &theirs.joints[j];
        let b = &ours.joints[ours.joint(&format!("mpl_right_arm__{}", a.name)).unwrap()];
        assert!((a.axis - b.axis).norm() < 2e-5, "{}: {} against {}", a.name, a.axis, b.axis);
        assert!((a.origin.translation.vector - b.origin.translation.vector).norm() < 3e-5, "{}", a.name);
        assert!(a.origin.rotation.angle_to(&b.origin.rotation) < 5e-5, "{}", a.name);
    }
}

#[test]
fn checking_an_sdf_file_as_urdf_points_to_import() {
    for text in ["<!-- c --><?xml version='1.0'?><sdf version='1.5'/>", "<sdf version='1.5'/>"] {
        let report = check(text, None);
        assert!(!report.usable && report.to_string().contains("proact model import"), "{report}");
    }
}

#[test]
fn what_an_import_leaves_out_or_doubts_is_said() {
    let Some(text) = shared("data/gazebo_mpl_right_arm/model.sdf") else { return };
    let report = import(&text, &ImportOptions::default()).unwrap().report;
    for words in [
        "sensors are left out",
        "contact parameters are left out",
        "effort limit limits nothing",
        "before the XML declaration",
    ] {
        assert!(report.findings.iter().any(|f| f.problem.contains(words)), "{words} is not in {report}");
    }
    assert!(
        report
            .findings
            .iter()
            .any(|f| f.location == "joint \"middle0\"" && f.problem.contains("cannot move"))
    );
}

/// A two-link arm whose joint stands away from its child's origin and is turned: the case that shared data lack.
fn offset_joint(axis_frame: &str) -> String {
    format!(
        "<sdf version='1.5'><model name='two'><link name='a'><pose>1 0 0 0 0 0</pose></link>\
         <link name='b'><pose>1 2 0 0 0 1.5707963267948966</pose>\
         <inertial><pose>0.1 0 0 0 0 0</pose><mass>1</mass><inertia><ixx>1</ixx><ixy>0</ixy><ixz>0</ixz>\
         <iyy>1</iyy><iyz>0</iyz><izz>1</izz></inertia></inertial>\
         <collision name='c'><geometry><box><size>1 1 1</size></box></geometry></collision></link>\
         <joint name='j' type='revolute'><parent>a</parent><child>b</child><pose>0.5 0 0 0 0 1.5707963267948966</pose>\
         <axis><xyz>1 0 0</xyz>{axis_frame}<limit><lower>-1</lower><upper>1</upper><effort>2</effort>\
         <velocity>3</velocity></limit></axis></joint></model></sdf>"
    )
}

#[test]
fn a_joint_away_from_its_childs_origin_moves_the_frame_and_not_the_body() {
    let model = import(&offset_joint(""), &ImportOptions::default()).unwrap().model;
    let poses = at_zero(&model);
    let joint = &model.joints[model.joint("j").unwrap()];
    // b stands at (1, 2) turned by 90 degrees, the joint 0.5 along its x: (1, 2.5).
    let frame = poses[joint.child];
    assert!((frame.translation.vector - Vector3::new(1.0, 2.5, 0.0)).norm() < 1e-12);
    let link = &model.links[joint.child];
    let center = frame * nalgebra::Point3::from(link.inertial.unwrap().pose.translation.vector);
    assert!((nalgebra::Point3::new(1.0, 2.1, 0.0) - center).norm() < 1e-12, "{center}");
    let shape = frame * link.collisions[0].pose;
    assert!((shape.translation.vector - Vector3::new(1.0, 2.0, 0.0)).norm() < 1e-12);
    // In the joint's frame, x points along -x of the model: two quarter turns.
    assert!((frame.rotation * joint.axis - -Vector3::x()).norm() < 1e-12);

    let model = import(
        &offset_joint("<use_parent_model_frame>1</use_parent_model_frame>"),
        &ImportOptions::default(),
    )
    .unwrap()
    .model;
    let joint = &model.joints[model.joint("j").unwrap()];
    assert!((at_zero(&model)[joint.child].rotation * joint.axis - Vector3::x()).norm() < 1e-12);
}

#[test]
fn an_sdf_file_that_cannot_be_converted_is_refused_by_name() {
    let good = offset_joint("");
    for (from, to, words) in [
        ("type='revolute'", "type='ball'", "joint \"j\": the type is not supported: got ball"),
        ("<parent>a</parent>", "<parent>shoulder</parent>", "\"shoulder\", expected a, b"),
        ("<mass>1</mass>", "<mass>heavy</mass>", "link \"b\": <mass> is not usable: got heavy"),
        ("<mass>1</mass>", "<mass>0</mass>", "mass is not above zero"),
        ("<xyz>1 0 0</xyz>", "<xyz>0 0 0</xyz>", "the axis has no direction"),
        ("1 2 0 0 0 1.57", "1 2 nan 0 0 1.57", "a pose is not usable"),
        ("<box><size>1 1 1</size></box>", "<plane/>", "a shape is not supported: got plane"),
        ("version='1.5'", "", "one model and its version"),
        ("<link name='a'>", "<link name='stray'/><link name='a'>", "not one tree"),
    ] {
        let bad = good.replacen(from, to, 1);
        assert_ne!(bad, good, "{from}");
        let error = import(&bad, &ImportOptions::default()).expect_err(to).to_string();
        assert!(error.contains(words), "{words:?} is not in: {error}");
    }
    assert!(import("", &ImportOptions::default()).is_err());
}

#[test]
fn a_written_arm_is_read_back_as_it_was() {
    let model = mpl_right_arm();
    let again = parse(&to_urdf(&model), &to_srdf(&model)).unwrap();
    assert_eq!((&again.links.len(), &again.arm, &again.hand), (&model.links.len(), &model.arm, &model.hand));
    assert_eq!((&again.poses, &again.allowed_collisions), (&model.poses, &model.allowed_collisions));
    assert_eq!(again.grasps, model.grasps);
    for (a, b) in again.joints.iter().zip(&model.joints) {
        assert_eq!((&a.name, a.limits, a.axis), (&b.name, b.limits, b.axis));
        assert!(
            a.origin.rotation.angle_to(&b.origin.rotation) < 1e-7
                && a.origin.translation == b.origin.translation
        );
        let off = (a.origin.inverse() * b.origin).to_homogeneous() - nalgebra::Matrix4::identity();
        assert!(off.amax() < 1e-13, "{}: {}", a.name, off.amax());
    }
    for (a, b) in again.links.iter().zip(&model.links) {
        for (c, d) in a.collisions.iter().zip(&b.collisions) {
            let off = (c.pose.inverse() * d.pose).to_homogeneous() - nalgebra::Matrix4::identity();
            assert!(c.shape == d.shape && off.amax() < 1e-13, "{}: {}", a.name, off.amax());
        }
        assert_eq!(a.visuals.len(), b.visuals.len());
    }
}

#[test]
fn our_own_arm_has_nothing_to_be_said_against_it_but_the_still_joint() {
    let report = check(proact_description::MPL_RIGHT_ARM_URDF, Some(proact_description::MPL_RIGHT_ARM_SRDF));
    assert!(report.usable);
    assert_eq!(report.count(Severity::Error) + report.count(Severity::Note), 0, "{report}");
    let locations: Vec<&str> = report.findings.iter().map(|f| f.location.as_str()).collect();
    assert_eq!(locations, ["joint \"mpl_right_arm__middle0\""], "{report}");
    let summary = report.summary.unwrap();
    assert!((summary.mass_kg - 0.5287783).abs() < 1e-7);
}

#[test]
fn every_number_of_our_arm_is_the_sources_but_for_the_noted_corrections() {
    let Some(text) = shared("data/mpl_right_arm.json") else { return };
    let facts: serde_json::Value = serde_json::from_str(&text).unwrap();
    let model = mpl_right_arm();
    let near = |a: f64, b: &serde_json::Value| {
        let b = b.as_f64().unwrap();
        // Right angles were written with four or two decimals.
        assert!(
            (a - b).abs() < 1e-9
                || (a.abs() - std::f64::consts::FRAC_PI_2).abs() < 1e-6 && (a - b).abs() < 1e-3
        );
    };
    for fact in facts["urdf"]["joints"].as_array().unwrap() {
        let joint = &model.joints[model.joint(fact["name"].as_str().unwrap()).unwrap()];
        assert_eq!(model.links[joint.parent].name, fact["parent"].as_str().unwrap());
        assert_eq!(model.links[joint.child].name, fact["child"].as_str().unwrap());
        let (roll, pitch, yaw) = joint.origin.rotation.euler_angles();
        for (k, angle) in [roll, pitch, yaw].into_iter().enumerate() {
            near(angle, &fact["origin"]["rpy"][k]);
            near(joint.origin.translation.vector[k], &fact["origin"]["xyz"][k]);
        }
        if joint.kind == JointKind::Revolute {
            (0..3).for_each(|k| near(joint.axis[k], &fact["axis"][k]));
            near(joint.limits.lower, &fact["limit"]["lower"]);
            near(joint.limits.upper, &fact["limit"]["upper"]);
        }
    }
    for fact in facts["urdf"]["links"].as_array().unwrap() {
        let link = &model.links[model.link(fact["name"].as_str().unwrap()).unwrap()];
        assert_eq!(link.collisions.len(), fact["collisions"].as_array().unwrap().len());
        let Some(inertial) = link.inertial else { continue };
        near(inertial.mass, &fact["inertial"]["mass"]);
        (0..3).for_each(|k| near(inertial.pose.translation.vector[k], &fact["inertial"]["com"]["xyz"][k]));
        for (k, key) in ["ixx", "ixy", "ixz", "iyy", "iyz", "izz"].into_iter().enumerate() {
            let source = fact["inertial"]["inertia"][key].as_f64().unwrap();
            assert!((inertial.inertia[k] - source).abs() < 1e-14, "{} {key}", link.name);
        }
    }
}

#[test]
fn an_arm_that_cannot_be_written_down_is_not_imported() {
    let nameless = include_str!("../../../tests/fuzz/corpus/sdf/joint_without_a_name.sdf");
    let error = import(nameless, &ImportOptions::default()).expect_err("its joint has no name").to_string();
    assert!(error.contains("the attribute name is missing"), "{error}");
}
