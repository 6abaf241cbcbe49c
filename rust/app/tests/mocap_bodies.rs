//! Bodies beside the shoulder: the person's own limb, the trunk, and a headset's controller on the brace.
#![allow(clippy::disallowed_methods, clippy::unwrap_used)] // A test.

use nalgebra::UnitQuaternion;
use proact_app::{Calibrations, LimbBodies, MocapAxes, TrackedShoulder, read_trunk, trial};
use proact_arm::{Chain, ChainPoses, Side};
use proact_bridge::ControllerPose;
use proact_devices::motion_capture::{CAPTURE_SCHEMES, OpenedCapture, vrpn::VrpnServer};
use proact_localization::RawBodyPose;
use proact_testbed::{RunningTrial, Setup, TrialConfig};
use proact_types::{EventKind, InputSource, StopCause};
use std::time::{Duration, Instant};

/// Sockets of one machine answer within milliseconds; a loaded one may take its time.
const TIMEOUT: Duration = Duration::from_secs(20);
const PERIOD: Duration = Duration::from_millis(10);

fn running_trial(values: &[&str]) -> RunningTrial {
    let config = TrialConfig::new("A", 1, Setup::named("still").unwrap());
    trial::live_trial(config.with_overrides(values).unwrap()).unwrap().trial
}

fn pose(body: &str, number: i64, position: [f64; 3], turn: &UnitQuaternion<f64>) -> RawBodyPose {
    let c = turn.coords;
    RawBodyPose {
        body: body.to_owned(),
        id: None,
        stamp: number * 10_000_000,
        arrival: 0,
        position,
        quaternion: [c[0], c[1], c[2], c[3]],
        tracked: true,
    }
}

#[test]
fn the_elbow_follows_the_persons_own_and_a_forearm_that_is_not_seen_stops_the_arm() {
    let names = ["pad", "upper", "fore", "sternum"];
    let mut server = VrpnServer::bind("127.0.0.1:0", &names).unwrap();
    let name = format!("vrpn:{}/pad", server.address().unwrap()).parse().unwrap();
    let opened = OpenedCapture::open(&CAPTURE_SCHEMES, &name).unwrap();
    let bodies: LimbBodies = "upper, fore".parse().unwrap();
    let mut shoulder = TrackedShoulder::new(opened, MocapAxes::default(), Calibrations::default())
        .with_limb(Some(bodies))
        .with_trunk(Some("sternum".to_owned()));
    let mut trial = running_trial(&["profile.level=below_elbow"]);
    let model = trial.testbed().model().clone();
    let start = trial.testbed().plant().state().position[..model.arm_count()].to_vec();
    // How the segments turn when the elbow does: upper arm and forearm are what the third and the fourth joint move.
    const ELBOW: usize = 3;
    let chain = Chain::new(&model);
    let links = |elbow: f64| {
        let mut q = start.clone();
        q[ELBOW] += elbow;
        let mut poses = ChainPoses::default();
        chain.link_poses_into(&q, &mut poses);
        [2, 3].map(|k: usize| poses.links[k].rotation)
    };
    // Markers sit askew on each segment.
    let askew = UnitQuaternion::from_euler_angles(0.4, -1.0, 2.0);
    let mut number = 0;
    let mut send = |elbow: f64, all: bool| {
        number += 1;
        let t = number as f64 * 0.01;
        let breath = UnitQuaternion::from_euler_angles(0.0, 0.002 * t.sin(), 0.0);
        // Nobody holds an arm quite still.
        let [upper, fore] = links(elbow + 1e-4 * (20.0 * t).sin()).map(|link| link * askew);
        let mut poses = vec![
            pose("pad", number, [2.0, 1.0, 1.4 + 0.002 * t.sin()], &breath),
            pose("upper", number, [2.0, 1.0, 1.2], &upper),
            pose(
                "sternum",
                number,
                [2.1, 1.2, 1.3],
                &UnitQuaternion::from_euler_angles(0.0, 0.1 * elbow, 0.0),
            ),
        ];
        if all {
            poses.push(pose("fore", number, [2.2, 1.0, 1.1], &fore));
        }
        server.send(&poses);
        std::thread::sleep(PERIOD);
    };

    let started = Instant::now();
    while shoulder.report().limb.is_none_or(|line| !line.contains("followed")) {
        assert!(started.elapsed() < TIMEOUT, "{:?}", shoulder.report());
        send(0.0, true);
        shoulder.apply_to(&mut trial).unwrap();
    }
    let mut events = Vec::new();
    let mut run =
        |ticks: u64, elbow: f64, all: bool, shoulder: &mut TrackedShoulder, trial: &mut RunningTrial| {
            for tick in 0..ticks {
                if tick.is_multiple_of(10) {
                    send(if all { elbow * (tick as f64 / 1500.0).min(1.0) } else { elbow }, all);
                    shoulder.apply_to(trial).unwrap();
                }
                let output = trial.step(false).unwrap().output;
                events.extend(output.events.iter().map(|event| (tick, event.kind.clone())));
            }
        };
    run(2500, 0.3, true, &mut shoulder, &mut trial);
    let elbow = trial.testbed().plant().state().position[ELBOW];
    assert!((elbow - start[ELBOW] - 0.3).abs() < 0.03, "{} to {elbow} rad", start[ELBOW]);
    let line = shoulder.report().limb.unwrap();
    assert!(line.starts_with("upper and fore followed, within "), "{line}");

    run(1000, 0.3, false, &mut shoulder, &mut trial);
    let stop = events.iter().find_map(|(tick, kind)| match kind {
        EventKind::Stopped { source: InputSource::LimbTracker, cause, .. } => Some((*tick, *cause)),
        _ => None,
    });
    let (tick, cause) = stop.expect("a limb that is not seen stops the arm");
    assert!(cause == StopCause::Silent && tick <= 600, "{tick} ms, {cause:?}");
    assert!(shoulder.report().limb.unwrap().contains("\"fore\" is not seen"), "{:?}", shoulder.report().limb);

    // The trunk moved nothing, and is kept.
    let dir = tempfile::tempdir().unwrap();
    shoulder.save_trunk(dir.path()).unwrap();
    let trunk = read_trunk(dir.path()).unwrap();
    let turned =
        trunk.iter().map(|(_, pose)| trunk[0].1.rotation.angle_to(&pose.rotation)).fold(0.0, f64::max);
    assert!(trunk.len() > 100 && (turned - 0.03).abs() < 0.002, "{} poses, {turned} rad", trunk.len());
    assert!(trunk.windows(2).all(|two| two[0].0 <= two[1].0), "in order of time");
}

#[test]
fn the_arm_goes_where_the_persons_own_hand_goes() {
    let mut server = VrpnServer::bind("127.0.0.1:0", &["pad", "hand"]).unwrap();
    let name = format!("vrpn:{}/pad", server.address().unwrap()).parse().unwrap();
    let opened = OpenedCapture::open(&CAPTURE_SCHEMES, &name).unwrap();
    let mut shoulder = TrackedShoulder::new(opened, MocapAxes::default(), Calibrations::default())
        .with_limb(Some(LimbBodies::Hand("hand".to_owned())));
    let config = TrialConfig::new("imitate", 1, Setup::named("still").unwrap());
    let methods = proact_app::Registry::standard().methods;
    let arm = proact_app::Arm::from_config(&config).unwrap();
    let mut trial = trial::live_trial_with_armband(&methods, &arm, config, None).unwrap().trial;
    let tip = |trial: &RunningTrial| {
        let testbed = trial.testbed();
        let state = testbed.plant().state();
        testbed.model().link_poses(&state.position)[testbed.model().tip]
    };
    let mut number = 0;
    let mut send = |displacement: f64| {
        number += 1;
        let t = number as f64 * 0.01;
        let sway = 1e-4 * (20.0 * t).sin();
        let (still, turned) = (UnitQuaternion::identity(), UnitQuaternion::from_euler_angles(0.3, 0.0, 0.0));
        let hand = pose("hand", number, [2.3 + sway, 0.8 + displacement, 1.2], &turned);
        server.send(&[pose("pad", number, [2.0, 1.0, 1.4 + 0.002 * t.sin()], &still), hand]);
        std::thread::sleep(PERIOD);
    };
    let started = Instant::now();
    while shoulder.report().limb.is_none_or(|line| !line.contains("followed")) {
        assert!(started.elapsed() < TIMEOUT, "{:?}", shoulder.report());
        send(0.0);
        shoulder.apply_to(&mut trial).unwrap();
    }
    let start = tip(&trial);
    for tick in 0..3000_u64 {
        if tick.is_multiple_of(10) {
            send(0.08 * (tick as f64 / 2000.0).min(1.0));
            shoulder.apply_to(&mut trial).unwrap();
        }
        trial.step(false).unwrap();
    }
    let (end, line) = (tip(&trial), shoulder.report().limb.unwrap());
    let displacement = end.translation.vector - start.translation.vector;
    assert!((displacement - nalgebra::Vector3::new(0.0, 0.08, 0.0)).norm() < 0.012, "{displacement}, {line}");
    assert!(end.rotation.angle_to(&start.rotation) < 0.06, "the hand did not turn");
    assert!(line.starts_with("hand followed, within "), "{line}");
}

#[test]
fn a_limb_that_names_no_bodies_is_refused() {
    for wrong in ["", ",", "upper,", "upper,upper", "a,b,c"] {
        assert!(wrong.parse::<LimbBodies>().unwrap_err().to_string().contains("upper arm"), "{wrong:?}");
    }
}

#[test]
fn a_controller_on_the_brace_is_the_shoulder_and_one_that_is_guessed_at_or_turned_to_nothing_is_not() {
    let name = "headset:right_controller".parse().unwrap();
    let opened = OpenedCapture::open(&CAPTURE_SCHEMES, &name).unwrap();
    let mut shoulder = TrackedShoulder::new(opened, MocapAxes::default(), Calibrations::default());
    let mut trial = running_trial(&[]);
    let start = Instant::now();
    let controller_pose = |position: [f64; 3], quaternion: [f64; 4], tracked: bool| {
        std::thread::sleep(PERIOD);
        let time_ms = start.elapsed().as_secs_f64() * 1e3;
        let breath = 1e-3 * (time_ms / 200.0).sin();
        let position = [position[0], position[1], position[2] + breath];
        ControllerPose { hand: Side::Right, time_ms, position, quaternion, tracked }
    };
    assert!(!shoulder.apply_to(&mut trial).unwrap());
    assert_eq!(shoulder.report().fault_name.as_deref(), Some("waiting"));
    let upright = [0.0, 0.0, 0.0, 1.0];
    let mut until = |position, quaternion, tracked, name: Option<&str>, shoulder: &mut TrackedShoulder| {
        let started = Instant::now();
        loop {
            shoulder.inject_controller(&controller_pose(position, quaternion, tracked));
            let driven = shoulder.apply_to(&mut trial).unwrap();
            let report = shoulder.report();
            if report.fault_name.as_deref() == name && driven == name.is_none() {
                return report;
            }
            assert!(started.elapsed() < TIMEOUT, "{name:?}: {report:?}");
        }
    };
    let before = until([0.2, -0.2, 1.4], upright, true, None, &mut shoulder).world_from_shoulder.unwrap();
    until([0.2, -0.2, 1.4], upright, false, Some("occluded"), &mut shoulder);
    until([0.2, -0.2, 1.4], [0.0; 4], true, Some("no_rotation"), &mut shoulder);
    until([200.0, -200.0, 1400.0], upright, true, Some("millimetres"), &mut shoulder);
    let after = until([0.25, -0.2, 1.4], upright, true, None, &mut shoulder).world_from_shoulder.unwrap();
    let displacement = after.translation.vector - before.translation.vector;
    assert!((displacement.x - 0.05).abs() < 5e-3 && displacement.y.abs() < 5e-3, "{displacement}");
    // The other hand's is another body.
    let other = ControllerPose { hand: Side::Left, ..controller_pose([0.0, 0.0, 1.0], upright, true) };
    shoulder.inject_controller(&other);
    shoulder.poll_between_trials();
    assert_eq!(shoulder.report().bodies, ["left_controller", "right_controller"]);
}
