//! The method `imitate`: the arm goes where the person's own limb goes.

mod common;

use common::{Rig, START, model};
use proact_control::ports::NoProcess;
use proact_control::{HandCommand, Imitation, JointSubset, Profile};
use proact_types::{Gesture, MethodStyle};

fn rig() -> Rig {
    let profile = Profile::named("default").expect("an embedded profile");
    Rig::with(Imitation::entry().build(&profile, &model(), NoProcess).expect("it fits the arm"))
}

#[test]
fn every_joint_follows_the_limb_no_faster_than_it_may_and_stands_where_nobody_tracks_it() {
    let mut rig = rig();
    rig.run(200);
    assert_eq!(rig.q[..], START, "no limb was seen yet");
    assert!(rig.refusal().contains("not tracked"));
    let mut limb = START.to_vec();
    // Away from the limits, at one of which a joint starts.
    limb.iter_mut().for_each(|angle| *angle += if *angle > 1.5 { -0.2 } else { 0.2 });
    rig.limb = Some(limb.clone());
    rig.run(20);
    let model = model();
    for (joint, (now, before)) in rig.q.iter().zip(&START).enumerate() {
        let most = model.joints[model.arm[joint]].limits.velocity * 0.02 + 1e-9;
        let moved = (now - before).abs();
        assert!(moved > 0.0 && moved <= most, "joint {joint}: {before} to {now}");
    }
    rig.run(3000);
    let off = rig.q.iter().zip(&limb).fold(0.0_f64, |most, (q, to)| most.max((q - to).abs()));
    assert!(off < 1e-6, "{off} rad from the limb");
    rig.limb = None;
    let before = rig.q.to_vec();
    rig.run(500);
    assert_eq!(rig.q.to_vec(), before);
}

#[test]
fn gestures_work_the_hand_once_each_and_move_no_joint() {
    let mut rig = rig();
    rig.limb = Some(START.to_vec());
    for (gesture, expected) in [
        (Gesture::WristExtension, None),
        (Gesture::HandClose, Some(HandCommand::Close)),
        (Gesture::NoMotion, None),
        (Gesture::HandOpen, Some(HandCommand::Open)),
    ] {
        let told: Vec<HandCommand> =
            rig.make(gesture, 300).into_iter().filter_map(|output| output.hand).collect();
        assert_eq!(told, Vec::from_iter(expected), "{gesture:?}");
    }
    assert_eq!(rig.q[..], START);
}

#[test]
fn a_level_of_limb_loss_is_refused() {
    let mut profile = Profile::named("default").expect("an embedded profile");
    profile.level = "below_elbow".to_owned();
    let error =
        JointSubset::of(MethodStyle::Imitating, &profile, &model()).expect_err("it has joints of its own");
    assert!(error.to_string().contains("leave profile.level out"), "{error}");
}
