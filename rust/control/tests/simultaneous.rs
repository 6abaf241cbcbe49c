//! A regressor's drives move joints, axes and the hand at the same time.

mod common;

use common::{Rig, START_RAD, model};
use proact_control::{ControlError, HandCommand, JogProfile, MotionCommand, Profile, Simultaneous, build};
use proact_types::{Command::HandOpen, InputSource, ObjectId, PlannerView, SimTime, Stop, StopCause};

/// The default profile in which `drives` move what is named.
fn profile(drives: &[(&str, &str)]) -> Profile {
    let mut profile = Profile::named("default").expect("embedded");
    let JogProfile::Time { simultaneous, .. } = &mut profile.jog else { panic!("by time") };
    *simultaneous = Some(Simultaneous {
        hand_on_threshold: 0.5,
        hand_off_threshold: 0.3,
        drives: drives
            .iter()
            .map(|(drive, moves)| (drive.parse().expect("two gestures"), (*moves).to_owned()))
            .collect(),
    });
    profile
}

/// In the order of the profile: the hand, joint 6, and joint 2 by other gestures.
const JOINTS: [(&str, &str); 3] =
    [("hand_open/hand_close", "hand"), ("wrist_extension/wrist_flexion", "wristz"), ("zig/zag", "elbow")];

fn rig(method: &str, drives: &[(&str, &str)]) -> Rig {
    Rig::with(build(method, &profile(drives), &model()).expect("a profile that fits"))
}

fn speeds(rig: &Rig) -> Vec<f64> {
    match rig.command() {
        MotionCommand::Velocity(speeds) => speeds.to_vec(),
        other => panic!("speeds were expected, not {other:?}"),
    }
}

#[test]
fn joints_move_at_the_same_time_at_their_share_of_the_speed() {
    let mut rig = rig("A", &JOINTS);
    rig.drives = vec![0.0, 0.5, -0.25];
    rig.run(100);
    let got = speeds(&rig);
    let moving: Vec<usize> = (0..7).filter(|k| got[*k] != 0.0).collect();
    assert_eq!(moving, [2, 6], "{got:?}");
    assert!((got[6].abs() - 0.2).abs() < 1e-12 && (got[2].abs() - 0.1).abs() < 1e-12, "{got:?}");
    let name = rig.shown.mode.clone().expect("A shows what moves").name;
    assert!(name.contains(" + "), "{name}");
    rig.gesture = HandOpen;
    rig.drives = vec![0.0; 3];
    let stopped = rig.run(20);
    let motions: Vec<_> = stopped.iter().filter_map(|output| output.motion.clone()).collect();
    assert_eq!(motions, [MotionCommand::Hold], "once, and gestures do nothing");
    rig.drives = vec![0.0, f64::NAN, 0.0];
    assert!(rig.run(20).iter().all(|output| output.motion.is_none()));
    rig.drives.clear();
    assert!(rig.run(20).iter().all(|output| output.motion.is_none()));
}

#[test]
fn a_joint_at_its_limit_stands_and_the_other_goes_on() {
    let mut rig = rig("A", &JOINTS);
    rig.drives = vec![0.0, 1.0, 0.1];
    rig.run(15_000);
    let limits = common::limits();
    let at_limit =
        |angle: f64| [limits[6].lower, limits[6].upper].iter().any(|limit| (angle - limit).abs() < 1e-9);
    assert!(at_limit(rig.q[6]), "{:?}", rig.q);
    let before = rig.q[2];
    rig.run(100);
    assert!((rig.q[2] - before).abs() > 0.003 && at_limit(rig.q[6]), "{:?}", rig.q);
    let PlannerView::Failed { reason, .. } = rig.shown.planner.clone() else {
        panic!("a refusal was expected")
    };
    assert!(reason.contains("at its limit"), "{reason}");
}

#[test]
fn the_hand_acts_over_a_threshold_and_waits_until_it_was_below_another() {
    let mut rig = rig("A", &JOINTS);
    let mut command = |drive: f64| {
        rig.drives = vec![drive, 0.0, 0.0];
        let commands: Vec<HandCommand> = rig.run(50).iter().filter_map(|output| output.hand).collect();
        commands
    };
    assert_eq!(command(-0.4), []);
    assert_eq!(command(-0.6), [HandCommand::Close]);
    assert_eq!(command(-0.4), [], "not below the lower threshold yet");
    assert_eq!(command(0.9), [], "not even the other way");
    assert_eq!(command(0.2), []);
    assert_eq!(command(0.5), [HandCommand::Open]);
}

#[test]
fn opening_a_hand_that_holds_is_asked_for_twice_where_the_profile_says_so() {
    let mut profile = profile(&JOINTS);
    let JogProfile::Time { confirm_open_ms, .. } = &mut profile.jog else { panic!("by time") };
    *confirm_open_ms = 1000;
    let mut rig = Rig::with(build("A", &profile, &model()).expect("a profile that fits"));
    rig.drives = vec![-1.0, 0.0, 0.0];
    rig.run(50);
    rig.hand.held_object = Some(ObjectId(0));
    let mut opens = |drive: f64| {
        rig.drives = vec![drive, 0.0, 0.0];
        rig.run(50).iter().any(|output| output.hand == Some(HandCommand::Open))
    };
    assert!(!opens(0.0) && !opens(1.0) && !opens(0.0) && opens(1.0));
}

#[test]
fn the_hand_moves_along_and_about_axes_at_the_same_time() {
    let mut rig = rig("B", &[("a/b", "x"), ("c/d", "z"), ("e/f", "rz")]);
    let tip = |rig: &mut Rig| {
        let q = rig.q.clone();
        proact_control::ports::ArmKinematics::forward(&mut rig.kinematics, &q).expect("angles of the arm")
    };
    let before = tip(&mut rig);
    rig.drives = vec![0.5, -0.5, 0.0];
    rig.run(500);
    let moved = tip(&mut rig).translation.vector - before.translation.vector;
    assert!(
        (moved.x - 0.02).abs() < 2e-3 && (moved.z + 0.02).abs() < 2e-3 && moved.y.abs() < 2e-3,
        "{moved}"
    );
}

#[test]
fn a_stop_holds_the_arm_whatever_is_driven() {
    let mut rig = rig("A", &JOINTS);
    rig.drives = vec![-1.0, 1.0, 1.0];
    rig.run(10);
    let reason = "the armband is silent".to_owned();
    rig.stop =
        Some(Stop { source: InputSource::Armband, cause: StopCause::Silent, since: SimTime(0), reason });
    let outputs = rig.run(100);
    assert!(outputs.iter().filter_map(|o| o.motion.as_ref()).all(|m| *m == MotionCommand::Hold));
    assert!(outputs.iter().all(|output| output.hand.is_none()));
    let held = rig.q.clone();
    rig.run(100);
    assert_eq!((rig.q.clone(), rig.q[0]), (held, START_RAD[0]));
}

#[test]
fn what_cannot_be_driven_is_refused_with_what_there_is() {
    let refusal = |method: &str, drives: &[(&str, &str)]| {
        build(method, &profile(drives), &model()).map(|_| ()).expect_err("must be refused").to_string()
    };
    let text = refusal("A", &[("a/b", "elbw")]);
    assert!(text.contains("joint \"elbw\" is unknown") && text.contains("elbow"), "{text}");
    let text = refusal("B", &[("a/b", "elbow")]);
    assert!(text.contains("axis \"elbow\" is unknown; expected one of x, y, z, rx, ry, rz, hand"), "{text}");
    let text = refusal("A", &[("a/b", "hand"), ("c/d", "hand")]);
    assert!(text.contains("\"c/d\" moves hand, which another moves already"), "{text}");
    assert!(refusal("C", &JOINTS).contains("leave profile.jog.simultaneous out"));
    assert!(refusal("A", &[]).contains("= 0, expected 1 to 8"));

    let number = |at: f64, below: f64| {
        let mut profile = profile(&JOINTS);
        let JogProfile::Time { simultaneous: Some(s), .. } = &mut profile.jog else { panic!("it was set") };
        (s.hand_on_threshold, s.hand_off_threshold) = (at, below);
        profile.check()
    };
    for (at, below) in [(0.0, 0.0), (1.1, 0.3), (0.5, 0.5), (0.5, -0.1), (f64::NAN, 0.1), (0.5, f64::NAN)] {
        assert!(matches!(number(at, below), Err(ControlError::Value { .. })), "{at} {below}");
    }
    let text = profile(&JOINTS).to_toml().expect("it can be written");
    assert_eq!(Profile::from_toml(&text), Ok(profile(&JOINTS)));
}
