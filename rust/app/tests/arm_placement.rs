//! Arms of our own in the form in which makers publish theirs: imported, placed, and driven by a simulated person.

#![allow(missing_docs)]
#![allow(clippy::unwrap_used)]

use proact_app::{allow_lasting_contacts, place_arm};
use proact_arm::{JointKind, OPEN_POSE};
use proact_description::{ImportOptions, ImportedArm, check, import, to_srdf, to_urdf};
use std::fmt::Write;

/// A link that is a box of `length` along z, with the joint that carries it.
fn part(text: &mut String, index: usize, length: f64, joint: &str) {
    let middle = length / 2.0;
    let _ = write!(
        text,
        "<link name=\"link{index}\"><inertial><origin xyz=\"0 0 {middle}\"/><mass value=\"1.5\"/>\
         <inertia ixx=\"0.01\" ixy=\"0\" ixz=\"0\" iyy=\"0.01\" iyz=\"0\" izz=\"0.005\"/></inertial>\
         <collision><origin xyz=\"0 0 {middle}\"/><geometry><box size=\"0.07 0.07 {length}\"/></geometry></collision></link>\n{joint}\n"
    );
}

/// A bare arm: six joints that turn, on a column that lifts it if `has_lift`.
fn bare_arm(has_lift: bool) -> String {
    let mut text = "<robot name=\"bench\">\n<link name=\"base\"><collision><geometry><box size=\"0.1 0.1 0.04\"/></geometry>\
                    </collision></link>\n"
        .to_owned();
    let lengths = [0.15, 0.4, 0.36, 0.1, 0.1, 0.06];
    let axes = ["0 0 1", "0 1 0", "0 1 0", "0 1 0", "0 0 1", "0 1 0"];
    let mut parent = "base".to_owned();
    if has_lift {
        text += "<link name=\"column\"><inertial><mass value=\"3\"/><inertia ixx=\"0.02\" ixy=\"0\" ixz=\"0\" iyy=\"0.02\" iyz=\"0\" izz=\"0.02\"/>\
                 </inertial></link><joint name=\"lift\" type=\"prismatic\"><parent link=\"base\"/><child link=\"column\"/><axis xyz=\"0 0 1\"/>\
                 <limit lower=\"0\" upper=\"0.3\" velocity=\"0.2\" effort=\"500\"/></joint>\n";
        parent = "column".to_owned();
    }
    let mut before = 0.04;
    for (index, (length, axis)) in lengths.into_iter().zip(axes).enumerate() {
        let joint = format!(
            "<joint name=\"joint{index}\" type=\"revolute\"><origin xyz=\"0 0 {before}\"/><parent link=\"{parent}\"/>\
             <child link=\"link{index}\"/><axis xyz=\"{axis}\"/><limit lower=\"-3\" upper=\"3\" velocity=\"2\" effort=\"150\"/></joint>"
        );
        part(&mut text, index, length, &joint);
        (parent, before) = (format!("link{index}"), length);
    }
    text + "</robot>"
}

fn imported(text: &str) -> ImportedArm {
    let mut arm = import(text, &ImportOptions::default()).unwrap();
    allow_lasting_contacts(&mut arm.model).unwrap();
    arm
}

#[test]
fn a_bare_arm_gets_a_gripper_and_a_place_from_which_blocks_are_moved() {
    for has_lift in [false, true] {
        let mut arm = imported(&bare_arm(has_lift));
        let kinds: Vec<JointKind> = arm.model.arm.iter().map(|&joint| arm.model.joints[joint].kind).collect();
        assert_eq!((kinds.len(), kinds[0] == JointKind::Prismatic), (6 + usize::from(has_lift), has_lift));
        assert_eq!(arm.model.pose("hand", OPEN_POSE).unwrap(), [0.045, 0.045], "two fingers that slide");
        assert!(arm.found.iter().any(|said| said.contains("pinches a block of 50 mm")), "{:?}", arm.found);

        let again = place_arm(&mut arm.model.clone(), 12).unwrap().unwrap();
        let place = place_arm(&mut arm.model, 12).unwrap().unwrap();
        assert_eq!(place, again, "equal arms stand in equal places");
        assert!(place.reached == 1.0 && place.blocks_moved >= Some(3), "{place:?}");
        // What is written is what was tried.
        let report = check(&to_urdf(&arm.model), Some(&to_srdf(&arm.model)));
        assert!(report.usable, "{report}");
        let base = arm.model.settings.fixed_base.unwrap().xyz;
        assert_eq!((base, arm.model.pose("arm", "start").unwrap()), (place.base, &*place.start));
        // An arm that stands by itself stays where it is.
        assert_eq!(place_arm(&mut arm.model, 12).unwrap(), None);
    }
}
