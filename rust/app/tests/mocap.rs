//! A shoulder that motion capture sees, from a server's socket to the arm and its record.
#![allow(clippy::disallowed_methods, clippy::unwrap_used)] // A test.

use proact_app::{
    Arm, Calibrations, MocapAxes, Recorder, ReplayOptions, TrackedShoulder, replay_trial, trial,
};
use proact_devices::motion_capture::{CAPTURE_SCHEMES, OpenedCapture, vrpn::VrpnServer};
use proact_localization::RawBodyPose;
use proact_testbed::{RunningTrial, Setup, TrialConfig, TrialStep};
use proact_types::{Command, EventKind, InputSource, PlantState, StopCause, Vector};
use std::time::{Duration, Instant};

/// Sockets of one machine answer within milliseconds; a loaded one may take its time.
const TIMEOUT: Duration = Duration::from_secs(20);
/// A shoulder is seen at 100 Hz.
const PERIOD: Duration = Duration::from_millis(10);
/// What holds for every source that commands motion, ms.
const STOPS_WITHIN_MS: u64 = 250;

/// A VRPN server on a real socket, and the shoulder that follows a body of it.
struct VrpnLab {
    server: VrpnServer,
    shoulder: TrackedShoulder,
    /// Of the next pose.
    number: i64,
}

impl VrpnLab {
    fn new(axes: &str) -> Self {
        let server = VrpnServer::bind("127.0.0.1:0", &["pad", "pad"]).unwrap();
        let name = format!("vrpn:{}/pad", server.address().unwrap()).parse().unwrap();
        let opened = OpenedCapture::open(&CAPTURE_SCHEMES, &name).unwrap();
        let axes = if axes.is_empty() { MocapAxes::default() } else { axes.parse().unwrap() };
        Self { server, shoulder: TrackedShoulder::new(opened, axes, Calibrations::default()), number: 0 }
    }

    /// The next pose of a shoulder that breathes, before somebody spoils it.
    fn pose(&mut self) -> RawBodyPose {
        self.number += 1;
        RawBodyPose {
            body: "pad".to_owned(),
            id: Some(0),
            stamp: self.number * 10_000_000,
            arrival: 0,
            position: [2.0, 1.0, 1.4 + 0.004 * (self.number as f64 * 0.02).sin()],
            quaternion: [0.0, 0.0, 0.6, 0.8],
            tracked: true,
        }
    }

    /// Sends what `spoil` makes of poses, in real time, until `done`; false if it never is.
    fn until(
        &mut self,
        running_trial: &mut RunningTrial,
        spoil: impl Fn(RawBodyPose) -> Vec<RawBodyPose>,
        done: impl Fn(bool, &TrackedShoulder) -> bool,
    ) -> bool {
        let start = Instant::now();
        while start.elapsed() < TIMEOUT {
            let pose = self.pose();
            self.server.send(&spoil(pose));
            std::thread::sleep(PERIOD);
            let driven = self.shoulder.apply_to(running_trial).unwrap();
            if done(driven, &self.shoulder) {
                return true;
            }
        }
        false
    }

    fn fault(&self) -> String {
        self.shoulder.report().fault_name.unwrap_or_default()
    }
}

fn running_trial() -> RunningTrial {
    trial::live_trial(TrialConfig::new("A", 1, Setup::named("still").unwrap())).unwrap().trial
}

fn as_sent(pose: RawBodyPose) -> Vec<RawBodyPose> {
    vec![pose]
}

/// A trial and its record.
struct Recorded {
    trial: RunningTrial,
    recorder: Recorder,
    /// Tracked poses that went into it.
    poses: usize,
}

impl Recorded {
    /// Ticks one by one, each with what `before` does; events with their ticks.
    fn ticks(&mut self, count: u64, mut before: impl FnMut(&mut RunningTrial, u64)) -> Vec<(u64, EventKind)> {
        let mut events = Vec::new();
        for tick in 0..count {
            before(&mut self.trial, tick);
            let step = self.tick(false);
            events.extend(step.output.events.iter().map(|event| (tick, event.kind.clone())));
        }
        events
    }

    fn tick(&mut self, last: bool) -> TrialStep {
        let step = self.trial.step(last).unwrap();
        self.recorder.write(&step, self.trial.testbed().plant().state()).unwrap();
        self.poses += usize::from(step.input.shoulder.is_some());
        step
    }

    fn state(&self) -> &PlantState {
        self.trial.testbed().plant().state()
    }
}

#[test]
fn a_tracked_shoulder_carries_the_arm_stops_it_when_silent_and_replays_bit_for_bit() {
    let config = TrialConfig::new("A", 1, Setup::named("still").unwrap());
    let arm = Arm::load(TrialConfig::DEFAULT_ARM).unwrap();
    let assembly = trial::live_trial(config).unwrap();
    let (mut running_trial, plans) = (assembly.trial, assembly.plans);
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path().join("trial");
    let config = running_trial.testbed().config().clone();
    let recorder = Recorder::create(&dir, &config, &arm, assembly.classifier.as_ref())
        .unwrap()
        .with_plans(plans)
        .unwrap();
    let home = running_trial.testbed().plant().state().world_from_base;
    let mut lab = VrpnLab::new("heading_deg=90");
    assert!(lab.until(&mut running_trial, as_sent, |driven, _| driven), "{:?}", lab.shoulder.report());
    let mut recorded = Recorded { trial: running_trial, recorder, poses: 0 };

    // Leans by 60 mm along the y axis of the system, which is where the person looks.
    recorded.trial.person_stage_mut().set_command(Command::WristFlexion);
    let VrpnLab { server, shoulder, number } = &mut lab;
    let mut lean = |running_trial: &mut RunningTrial, tick: u64| {
        if !tick.is_multiple_of(10) {
            return;
        }
        // Stamps and arrivals are of one pace, as the filter takes them to be.
        std::thread::sleep(PERIOD);
        *number += 1;
        let displacement = 0.06 * (tick.min(600) as f64 / 600.0);
        let position = [2.0, 1.0 + displacement, 1.4 + 0.001 * (*number % 3) as f64];
        let (id, quaternion) = (Some(0), [0.0, 0.0, 0.6, 0.8]);
        let stamp = *number * 10_000_000;
        server.send(&[RawBodyPose {
            body: "pad".into(),
            id,
            stamp,
            arrival: 0,
            position,
            quaternion,
            tracked: true,
        }]);
        let start = Instant::now();
        while !shoulder.apply_to(running_trial).unwrap() {
            assert!(start.elapsed() < TIMEOUT, "{:?}", shoulder.report());
        }
    };
    let events = recorded.ticks(1500, &mut lean);
    let leant = recorded.state().world_from_base.translation.vector - home.translation.vector;
    assert!((leant - Vector::new(0.06, 0.0, 0.0)).norm() < 0.005, "{leant}");
    assert!(!events.iter().any(|(_, kind)| matches!(kind, EventKind::Stopped { .. })), "{events:?}");

    // The cameras are covered.
    let before = recorded.state().position.clone();
    let mut quiet = |running_trial: &mut RunningTrial, _| {
        shoulder.apply_to(running_trial).unwrap();
    };
    let events = recorded.ticks(500, &mut quiet);
    let stop = events.iter().find_map(|(tick, kind)| match kind {
        EventKind::Stopped { source: InputSource::ShoulderTracker, cause, .. } => Some((*tick, *cause)),
        _ => None,
    });
    let (tick, cause) = stop.expect("a silent tracker stops the arm");
    assert!(tick <= STOPS_WITHIN_MS && cause == StopCause::Silent, "{tick} ms, {cause:?}");
    let stood = recorded.state().position.clone();
    recorded.ticks(200, |_, _| ());
    let creep = stood.iter().zip(&recorded.state().position).map(|(a, b)| (a - b).abs());
    assert!(creep.fold(0.0, f64::max) < 0.01, "the arm stands");
    assert_ne!(before, stood);

    // It is seen again, 40 mm further: the arm is carried there without a kick.
    recorded.trial.person_stage_mut().set_command(Command::NoMotion);
    let mut last = recorded.state().world_from_base.translation.vector;
    let mut fastest = 0.0_f64;
    let mut back = |running_trial: &mut RunningTrial, tick: u64| {
        if tick.is_multiple_of(10) {
            std::thread::sleep(PERIOD);
            *number += 1;
            let position = [2.0, 1.1, 1.4 + 0.001 * (*number % 3) as f64];
            let pose = RawBodyPose {
                body: "pad".into(),
                id: Some(0),
                stamp: *number * 10_000_000,
                arrival: 0,
                position,
                quaternion: [0.0, 0.0, 0.6, 0.8],
                tracked: true,
            };
            server.send(&[pose]);
            let start = Instant::now();
            while !shoulder.apply_to(running_trial).unwrap() {
                assert!(start.elapsed() < TIMEOUT, "{:?}", shoulder.report());
            }
        }
        let now = running_trial.testbed().plant().state().world_from_base.translation.vector;
        fastest = fastest.max((now - last).norm() * 1000.0);
        last = now;
    };
    let events = recorded.ticks(1000, &mut back);
    assert!(events.iter().any(|(_, kind)| *kind == EventKind::Rearmed), "{events:?}");
    assert!(fastest <= config.motion.shoulder_m_per_s + 1e-6, "{fastest} m/s");
    let leant = recorded.state().world_from_base.translation.vector - home.translation.vector;
    assert!((leant - Vector::new(0.1, 0.0, 0.0)).norm() < 0.005, "{leant}");

    recorded.tick(true);
    assert!(recorded.poses > 200, "{}", recorded.poses);
    recorded.recorder.finish(&recorded.trial.result()).unwrap();
    assert!(replay_trial(&dir, ReplayOptions::default()).unwrap().agrees);
}

#[test]
fn what_a_system_gets_wrong_is_named_and_nothing_of_it_moves_the_arm() {
    let still = |position: fn([f64; 3]) -> [f64; 3]| {
        move |pose: RawBodyPose| vec![RawBodyPose { position: position(pose.position), ..pose }]
    };
    // From the first pose on.
    for (name, spoil) in [
        ("millimetres", &still(|p| p.map(|x| x * 1000.0)) as &dyn Fn(RawBodyPose) -> Vec<RawBodyPose>),
        ("y_up", &still(|[x, y, z]| [x, z, -y])),
        ("not_finite", &still(|[x, y, _]| [x, y, f64::NAN])),
        ("no_rotation", &|pose| vec![RawBodyPose { quaternion: [0.0; 4], ..pose }]),
        ("two_bodies_one_name", &|pose| {
            let other = RawBodyPose { id: Some(1), position: [0.0, 0.0, 1.0], ..pose.clone() };
            vec![pose, other]
        }),
        // Turns about a pivot while y has the wrong sign.
        ("mirrored", &|pose| {
            let t = pose.stamp as f64 * 1e-9;
            let turn = nalgebra::UnitQuaternion::from_euler_angles(
                0.3 * (2.0 * t).sin(),
                0.5 * (2.7 * t).sin(),
                0.6 * (1.7 * t).cos(),
            );
            let brace_position = Vector::new(0.1, -0.3, 1.2) + turn * Vector::new(0.06, 0.02, 0.18);
            let c = turn.coords;
            vec![RawBodyPose {
                position: [brace_position.x, -brace_position.y, brace_position.z],
                quaternion: [c[0], c[1], c[2], c[3]],
                ..pose
            }]
        }),
    ] {
        let (mut lab, mut running_trial) = (VrpnLab::new(""), running_trial());
        let seen = lab.until(&mut running_trial, spoil, |_, shoulder| {
            shoulder.report().fault_name.as_deref() == Some(name)
        });
        assert!(seen, "{name}: {:?}", lab.shoulder.report());
        // For a while nothing of it gets through.
        for _ in 0..60 {
            let pose = lab.pose();
            lab.server.send(&spoil(pose));
            std::thread::sleep(PERIOD);
            assert!(!lab.shoulder.apply_to(&mut running_trial).unwrap(), "{name}");
        }
        assert!(lab.shoulder.report().fault.is_some(), "{name}");
    }
    // With the laboratory's word on its unit and axes the same poses are in order.
    for (axes, spoil) in [
        (
            "meters_per_unit=0.001",
            &still(|p| p.map(|x| x * 1000.0)) as &dyn Fn(RawBodyPose) -> Vec<RawBodyPose>,
        ),
        ("up=y", &still(|[x, y, z]| [x, z, -y])),
    ] {
        let (mut lab, mut running_trial) = (VrpnLab::new(axes), running_trial());
        assert!(
            lab.until(&mut running_trial, spoil, |driven, _| driven),
            "{axes}: {:?}",
            lab.shoulder.report()
        );
    }
    for wrong in ["up=w", "meters_per_unit=0", "meters_per_unit=nan", "heading_deg=1000", "y", ""] {
        assert!(wrong.parse::<MocapAxes>().unwrap_err().to_string().contains("up=x|y|z"), "{wrong}");
    }
}

#[test]
fn a_stream_that_turns_bad_is_refused_and_taken_again_when_it_is_put_right() {
    let (mut lab, mut running_trial) = (VrpnLab::new(""), running_trial());
    assert!(lab.until(&mut running_trial, as_sent, |driven, _| driven));
    // Time goes back: nothing more until the source is started again.
    lab.number -= 20;
    assert!(lab.until(&mut running_trial, as_sent, |driven, shoulder| {
        assert!(!driven);
        shoulder.report().fault_name.as_deref() == Some("time_back")
    }));
    lab.server.disconnect();
    lab.number = 0;
    assert!(lab.until(&mut running_trial, as_sent, |driven, _| driven), "{:?}", lab.shoulder.report());
    // The name goes to another device.
    let renumbered = |pose| vec![RawBodyPose { id: Some(1), ..pose }];
    assert!(lab.until(&mut running_trial, renumbered, |_, shoulder| {
        shoulder.report().fault_name.as_deref() == Some("id_changed")
    }));
    assert!(lab.shoulder.report().fault.unwrap().contains("restart the source"));
    // Back to the old one: good again after a while.
    assert!(lab.until(&mut running_trial, as_sent, |driven, _| driven), "{}", lab.fault());
    // A server that is gone.
    lab.server.disconnect();
    let start = Instant::now();
    while lab.fault() != "waiting" {
        assert!(start.elapsed() < TIMEOUT && !lab.shoulder.apply_to(&mut running_trial).unwrap());
    }
}
