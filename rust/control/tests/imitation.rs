//! The method `imitate`: the arm goes where the person's own limb goes.

mod common;

use common::{Rig, START_RAD, model};
use proact_control::ports::NoProcess;
use proact_control::{HandCommand, Imitation, JointSubset, Profile};
use proact_types::{Command, MethodStyle};

fn rig() -> Rig {
    let profile = Profile::named("default").expect("an embedded profile");
    Rig::with(Imitation::entry().build(&profile, &model(), NoProcess).expect("it fits the arm"))
}

#[test]
fn every_joint_follows_the_limb_no_faster_than_it_may_and_stands_where_nobody_tracks_it() {
    let mut rig = rig();
    rig.run(200);
    assert_eq!(rig.q[..], START_RAD, "no limb was seen yet");
    assert!(rig.refusal().contains("not tracked"));
    let mut limb = START_RAD.to_vec();
    // Away from the limits, at one of which a joint starts.
    limb.iter_mut().for_each(|angle| *angle += if *angle > 1.5 { -0.2 } else { 0.2 });
    rig.limb = Some(limb.clone());
    rig.run(20);
    let model = model();
    for (joint, (now, before)) in rig.q.iter().zip(&START_RAD).enumerate() {
        let max_step = model.joints[model.arm[joint]].limits.velocity * 0.02 + 1e-9;
        let moved = (now - before).abs();
        assert!(moved > 0.0 && moved <= max_step, "joint {joint}: {before} to {now}");
    }
    rig.run(3000);
    let off = rig.q.iter().zip(&limb).fold(0.0_f64, |max_step, (q, to)| max_step.max((q - to).abs()));
    assert!(off < 1e-6, "{off} rad from the limb");
    rig.limb = None;
    let before = rig.q.to_vec();
    rig.run(500);
    assert_eq!(rig.q.to_vec(), before);
}

#[test]
fn gestures_work_the_hand_once_each_and_move_no_joint() {
    let mut rig = rig();
    rig.limb = Some(START_RAD.to_vec());
    for (command, expected) in [
        (Command::WristExtension, None),
        (Command::HandClose, Some(HandCommand::Close)),
        (Command::NoMotion, None),
        (Command::HandOpen, Some(HandCommand::Open)),
    ] {
        let hand_commands: Vec<HandCommand> =
            rig.make(command, 300).into_iter().filter_map(|output| output.hand).collect();
        assert_eq!(hand_commands, Vec::from_iter(expected), "{command:?}");
    }
    assert_eq!(rig.q[..], START_RAD);
}

#[test]
fn a_level_of_limb_loss_is_refused() {
    let mut profile = Profile::named("default").expect("an embedded profile");
    profile.level = "below_elbow".to_owned();
    let error = JointSubset::for_style(MethodStyle::Imitating, &profile, &model())
        .expect_err("it has joints of its own");
    assert!(error.to_string().contains("leave profile.level out"), "{error}");
}
