//! Arms as folders: those that ship, and what a folder may say.
#![allow(clippy::disallowed_methods, clippy::unwrap_used)] // A test of files.

use proact_arm::{ArmModel, FOREARM_RATIO, JointKind, JointLimits, Side, scale_to_stature};
use proact_description::{ArmFolder, check, parse, to_srdf, to_urdf};
use proptest::prelude::*;
use std::{fs, path::Path};

const ARMS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../ros1_ws/src/proact_description/arms");

/// A copy of a shipped arm's folder, with `change` made to one of its files.
fn changed(arm: &str, file: &str, change: impl Fn(&str) -> String) -> tempfile::TempDir {
    let copy = tempfile::tempdir().unwrap();
    for name in ["arm.urdf", "arm.srdf", "arm.toml"] {
        let text = fs::read_to_string(Path::new(ARMS).join(arm).join(name)).unwrap();
        fs::write(copy.path().join(name), if name == file { change(&text) } else { text }).unwrap();
    }
    copy
}

fn replaced(arm: &str, file: &str, from: &str, to: &str) -> tempfile::TempDir {
    changed(arm, file, |text| {
        assert!(text.contains(from), "{from}");
        text.replace(from, to)
    })
}

#[test]
fn every_shipped_folder_is_an_arm_that_a_trial_can_use_and_has_the_hash_of_its_files() {
    let names = ArmFolder::shipped_names();
    assert_eq!(names, ["mpl_left", "mpl_right", "wam"]);
    for name in names {
        let (built_in, on_disk) =
            (ArmFolder::shipped(&name).unwrap(), ArmFolder::read(&Path::new(ARMS).join(&name)));
        let on_disk = on_disk.unwrap();
        assert_eq!(built_in.hash(), on_disk.hash(), "{name}");
        let model = on_disk.model().unwrap();
        assert_eq!(model.side == Side::Left, name == "mpl_left");
        for (group, pose) in [("arm", "start"), ("hand", "open"), ("hand", "closed")] {
            model.pose(group, pose).unwrap();
        }
        let report = check(&on_disk.urdf, on_disk.srdf.as_deref());
        assert!(report.usable, "{report}");
    }
    assert_eq!(ArmFolder::shipped("mpl_right_arm").unwrap().name, "mpl_right");
    assert!(ArmFolder::shipped("arm").is_none());
}

#[test]
fn the_hash_is_of_the_content_and_not_of_the_names_of_files() {
    let same = changed("wam", "none", str::to_owned);
    fs::rename(same.path().join("arm.urdf"), same.path().join("other.urdf")).unwrap();
    let hash = |path: &Path| ArmFolder::read(path).unwrap().hash();
    let shipped = hash(&Path::new(ARMS).join("wam"));
    assert_eq!(hash(same.path()), shipped);
    for (file, from, to) in
        [("arm.urdf", "3.8749", "3.875"), ("arm.srdf", "0.26", "0.27"), ("arm.toml", "base rotation", "turn")]
    {
        assert_ne!(hash(replaced("wam", file, from, to).path()), shipped, "{file}");
    }
}

#[test]
fn settings_that_do_not_fit_the_arm_are_refused_in_one_sentence() {
    let refusal = |from: &str, to: &str| {
        let error = ArmFolder::read(replaced("wam", "arm.toml", from, to).path()).unwrap_err().to_string();
        assert!(!error.contains('\n') && error.contains("arm.toml: "), "{error}");
        error
    };
    let error = refusal("\"wrist_yaw\", \"wrist_pitch\", \"palm_yaw\"]\n\n", "\"knee\"]\n\n");
    assert!(error.contains("joint \"knee\" is not in the arm; expected one of base_yaw, "), "{error}");
    assert!(refusal("we_sign = 1", "we_sign = 2").contains("is 2, expected 1 or -1"));
    assert!(refusal("side = \"right\"", "side = \"middle\"").contains("line 3: unknown variant"));
    assert!(refusal("title", "tilte").contains("line 2: unknown field"));
    assert!(refusal("p = 900.0", "p = -1.0").contains("a gain of joint \"base_yaw\" is -1"));
    assert!(refusal("\"hand_f1_outer_link\"", "\"tail\"").contains("link \"tail\" is not in the arm"));
    assert!(refusal("[-0.45", "[nan").contains("stand.xyz is [NaN"));
}

#[test]
fn followers_are_where_their_masters_take_them_in_every_pose_and_survive_the_text() {
    let model = ArmFolder::shipped("wam").unwrap().model().unwrap();
    assert_eq!(model.mimics.len(), 4);
    let closed = model.pose("hand", "closed").unwrap();
    let hand_index = |name: &str| model.hand.iter().position(|&j| model.joints[j].name == name).unwrap();
    for finger in 1..=3 {
        let (inner, outer) = (
            closed[hand_index(&format!("hand_f{finger}_inner"))],
            closed[hand_index(&format!("hand_f{finger}_outer"))],
        );
        assert!((outer - 0.344262 * inner).abs() < 1e-12 && inner > 1.0, "{inner} {outer}");
    }
    let (mut position, mut velocity) = (closed.to_vec(), vec![0.0; closed.len()]);
    position[hand_index("hand_f1_spread")] = 0.3;
    velocity[hand_index("hand_f2_inner")] = 2.0;
    model.couplings().apply(&mut position, &mut velocity);
    assert_eq!(position[hand_index("hand_f2_spread")], 0.3);
    assert!((velocity[hand_index("hand_f2_outer")] - 2.0 * 0.344262).abs() < 1e-12);

    let again = parse(&to_urdf(&model), &to_srdf(&model)).unwrap();
    assert_eq!((again.mimics, again.poses), (model.mimics, model.poses));
}

#[test]
fn couplings_that_lead_nowhere_or_into_the_arm_are_refused() {
    let refusal = |to: &str| {
        let folder =
            replaced("wam", "arm.urdf", "<mimic joint=\"hand_f1_spread\"", &format!("<mimic joint=\"{to}\""));
        ArmFolder::read(folder.path()).unwrap_err().to_string()
    };
    for to in ["knee", "hand_mount", "hand_f2_outer", "hand_f2_spread"] {
        assert!(refusal(to).contains("the joint that it follows is none"), "{}", refusal(to));
    }
    assert!(refusal("base_yaw").contains("a joint of the arm cannot be coupled"), "{}", refusal("base_yaw"));
}

#[test]
fn a_continuous_joint_turns_for_ever_and_stays_one_in_the_text() {
    let folder = replaced(
        "wam",
        "arm.urdf",
        "name=\"palm_yaw\" type=\"revolute\"",
        "name=\"palm_yaw\" type=\"continuous\"",
    );
    let model = ArmFolder::read(folder.path()).unwrap().model().unwrap();
    let joint = &model.joints[model.arm[6]];
    assert_eq!(
        (joint.kind, joint.limits.upper, joint.limits.velocity),
        (JointKind::Continuous, JointLimits::CONTINUOUS_RANGE_RAD, 1.0)
    );
    let again = parse(&to_urdf(&model), &to_srdf(&model)).unwrap();
    let again = &again.joints[again.arm[6]];
    assert_eq!((again.kind, again.limits), (joint.kind, joint.limits));
}

/// The tool plate by the table of Denavit and Hartenberg in libbarrett's `config/wam7w.conf`: alpha, a, d.
fn tool_flange(q: &[f64]) -> nalgebra::Isometry3<f64> {
    use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
    const H: f64 = std::f64::consts::FRAC_PI_2;
    const TABLE: [[f64; 3]; 7] = [
        [-H, 0.0, 0.0],
        [H, 0.0, 0.0],
        [-H, 0.045, 0.55],
        [H, -0.045, 0.0],
        [-H, 0.0, 0.3],
        [H, 0.0, 0.0],
        [0.0, 0.0, 0.06],
    ];
    let mut pose = Isometry3::translation(0.0, 0.0, 0.346);
    for ([alpha, a, d], theta) in TABLE.into_iter().zip(q) {
        let turn = |axis: Vector3<f64>, angle: f64| UnitQuaternion::from_scaled_axis(axis * angle);
        pose = pose * turn(Vector3::z(), *theta) * Translation3::new(a, 0.0, d) * turn(Vector3::x(), alpha);
    }
    pose
}

proptest! {
    // The URDF was written from other numbers than this table.
    #[test]
    fn the_wam_is_where_its_makers_table_puts_it(q in prop::collection::vec(-3.0..3.0, 7)) {
        let model = ArmFolder::shipped("wam").unwrap().model().unwrap();
        let palm = model.link_poses(&q)[model.tip];
        let half = nalgebra::UnitQuaternion::from_scaled_axis(nalgebra::Vector3::x() * std::f64::consts::PI);
        let off = (tool_flange(&q) * half).inv_mul(&palm);
        prop_assert!(off.translation.vector.norm() < 1e-9 && off.rotation.angle() < 1e-7, "{off}");
    }
}

#[test]
fn an_arm_takes_the_segments_of_its_wearer_and_survives_being_written() {
    for (name, side) in [("mpl_right", 1.0), ("mpl_left", -1.0)] {
        let folder = ArmFolder::shipped(name).unwrap();
        let model = folder.model().unwrap();
        let (sized, [before, after]) = scale_to_stature(&model, 1.8).unwrap();
        // 0.186 and 0.146 of 1.8 m.
        assert!((after.upper_arm_m - 0.3348).abs() < 1e-12 && (after.forearm_m - 0.2628).abs() < 1e-12);
        // Elbow and wrist of the straight arm hang lower by as much as the segments are longer, and nowhere else.
        let at = |model: &ArmModel, joint: usize| model.link_poses(&[])[model.joints[model.arm[joint]].child];
        for (joint, longer) in [
            (3, after.upper_arm_m - before.upper_arm_m),
            (6, after.upper_arm_m + after.forearm_m - before.upper_arm_m - before.forearm_m),
        ] {
            let moved = at(&sized, joint).translation.vector - at(&model, joint).translation.vector;
            assert!((moved.z + longer).abs() < 1e-4, "{name}, joint {joint}: {moved}, expected {longer}");
            assert!(moved.xy().norm() < 0.005, "{name}: {moved}");
        }
        assert_eq!(sized.side.sign(), side);
        // The hand, and what the arm weighs, are the same.
        let fingers =
            |model: &ArmModel| model.joints.iter().skip(8).map(|joint| joint.origin).collect::<Vec<_>>();
        assert_eq!(fingers(&sized), fingers(&model));
        let mass =
            |model: &ArmModel| model.links.iter().filter_map(|l| l.inertial).map(|i| i.mass).sum::<f64>();
        assert_eq!(mass(&sized), mass(&model));
        let mut written = ArmFolder { urdf: to_urdf(&sized), ..folder.clone() }.model().unwrap();
        written.settings.clone_from(&sized.settings);
        let difference = (at(&written, 6).inverse() * at(&sized, 6)).translation.vector.norm();
        assert!(difference < 1e-6, "{difference}");
        // A person of the arm's own proportions would have it as it is.
        let own = scale_to_stature(&model, before.forearm_m / FOREARM_RATIO).unwrap().1[1];
        assert!((own.forearm_m - before.forearm_m).abs() < 1e-12);
    }
    let wam = ArmFolder::shipped("wam").unwrap().model().unwrap();
    assert!(scale_to_stature(&wam, 1.8).unwrap_err().to_string().starts_with("the arm stands by itself"));
}
