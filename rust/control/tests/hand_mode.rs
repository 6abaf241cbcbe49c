//! The hand as one of the modes of method A, for two muscles that give no gesture for HC.

mod common;

use common::{Rig, model};
use proact_control::{HandCommand, JogProfile, MotionCommand, Profile, build};
use proact_types::Command::{HandOpen, NoMotion, WristExtension, WristFlexion};
use proact_types::{ControlledDof, ObjectId};

fn rig(change: impl FnOnce(&mut Profile)) -> Rig {
    let mut profile = Profile::named("default").expect("embedded");
    profile.joint_jog.cycle = vec!["elbow".to_owned(), "hand".to_owned()];
    change(&mut profile);
    let mut rig = Rig::with(build("A", &profile, &model()).expect("a profile that fits"));
    rig.run(10);
    rig
}

fn hands(rig: &mut Rig, command: proact_types::Command, ms: u64) -> Vec<HandCommand> {
    rig.make(command, ms).iter().filter_map(|output| output.hand).collect()
}

#[test]
fn the_wrists_two_gestures_open_and_close_the_hand_in_its_mode() {
    let mut rig = rig(|_| {});
    assert!(hands(&mut rig, WristFlexion, 200).is_empty(), "the elbow moves");
    rig.make(NoMotion, 100);
    rig.make(HandOpen, 100);
    rig.make(NoMotion, 100);
    let mode = rig.shown.mode.clone().expect("A has modes");
    assert_eq!((mode.name.as_str(), mode.controlled_dof), ("hand", ControlledDof::Joint(7)));
    assert_eq!(mode.directions, ["open", "close"]);
    let before = rig.q.clone();
    assert_eq!(hands(&mut rig, WristFlexion, 300), [HandCommand::Close], "once while it lasts");
    assert_eq!(hands(&mut rig, WristExtension, 300), [HandCommand::Open]);
    assert!(hands(&mut rig, NoMotion, 100).is_empty());
    assert_eq!(hands(&mut rig, WristExtension, 100), [HandCommand::Open]);
    assert!(rig.q == before && *rig.command() == MotionCommand::Hold, "the arm stands");
    rig.make(NoMotion, 100);
    rig.make(HandOpen, 100);
    rig.make(WristExtension, 300);
    assert!(rig.q != before, "the elbow again");
}

#[test]
fn its_direction_and_a_second_question_are_those_of_the_profile() {
    let entry = "[{ joint = \"hand\", name = \"grip\", we = \"close\", wf = \"open\", we_sign = -1 }]";
    let mut rig = rig(|profile| {
        let table: toml::Table = format!("joints = {entry}").parse().expect("TOML");
        profile.joint_jog.joints = table["joints"].clone().try_into().expect("entries of joints");
        let JogProfile::Time { confirm_open_ms, .. } = &mut profile.jog else { panic!("by time") };
        *confirm_open_ms = 1000;
    });
    rig.make(HandOpen, 100);
    rig.make(NoMotion, 100);
    assert_eq!(hands(&mut rig, WristExtension, 100), [HandCommand::Close]);
    rig.hand.held_object = Some(ObjectId(0));
    assert!(hands(&mut rig, WristFlexion, 100).is_empty(), "asked for once");
    rig.make(NoMotion, 100);
    assert_eq!(hands(&mut rig, WristFlexion, 100), [HandCommand::Open]);
}
