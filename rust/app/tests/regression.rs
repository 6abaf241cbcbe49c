//! A regressor, and two sites, in trials: the arm moves in proportion, stands while the armband is not to be trusted, and the
//! record replays.
#![allow(clippy::unwrap_used, clippy::disallowed_methods)] // A test of files and processes.

mod common;

use common::{config, generator, moved, recordings, slices};
use proact_app::{Arm, Recorder, ReplayOptions, replay_trial, trial};
use proact_control::{JogProfile, MethodRegistry, Simultaneous};
use proact_devices::{EmgOrigin, SyntheticEmg};
use proact_emg::{ClassifierKind, EmgConfig, EmgModel};
use proact_testbed::{Setup, TrialConfig, ports};
use proact_types::{Command, DegreeOfFreedom, EmgSample, EventKind, SimTime};

const TICKS: u64 = 4500;

fn model(classifier: ClassifierKind) -> EmgModel {
    let config = EmgConfig { classifier, ..EmgConfig::default() };
    EmgModel::train(&config, &[0.0; 8], &slices(&recordings(6000))).unwrap()
}

/// The wrist from 0.5 s on until the link is lost at 1.5 s, and still when it is back at 2 s; relaxed from 2.5 s, the wrist again
/// from 3.5 s.
struct Armband(SyntheticEmg);

impl ports::EmgSource for Armband {
    fn sample_at(&mut self, now: SimTime, _intended: Command) -> Vec<EmgSample> {
        let gesture = match now.0 {
            500..2500 | 3500.. => Command::WristExtension,
            _ => Command::NoMotion,
        };
        let channels = self.0.next(gesture);
        let lost = (1500..2000).contains(&now.0);
        (!lost).then_some(EmgSample { counter: now.0, channels }).into_iter().collect()
    }
}

fn start(config: TrialConfig, model: &EmgModel) -> Result<trial::Assembly, String> {
    let worn = trial::TrainedArmband { trained: model, samples: Box::new(Armband(generator(2))) };
    let arm = Arm::from_config(&config).unwrap();
    trial::live_trial_with_armband(&MethodRegistry::standard(), &arm, config, Some(worn))
        .map_err(|e| e.to_string())
}

#[test]
fn a_regressor_moves_the_arm_but_not_through_a_lost_link_and_the_record_replays() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path().join("trial");
    let trial::Assembly { mut trial, classifier, arm, .. } =
        start(config(true), &model(ClassifierKind::Ridge)).unwrap();
    let used = trial.testbed().config().clone();
    let mut recorder = Recorder::create(&dir, &used, &arm, classifier.as_ref()).unwrap();
    let mut targets = Vec::new();
    let mut rearmed = Vec::new();
    for tick in 1..=TICKS {
        let step = trial.step(tick == TICKS).unwrap();
        recorder.write(&step, trial.testbed().plant().state()).unwrap();
        targets.push(trial.testbed().targets().to_vec());
        rearmed.extend(
            step.output.events.iter().filter(|e| matches!(e.kind, EventKind::Rearmed)).map(|e| e.time.0),
        );
    }
    recorder.finish(&trial.result()).unwrap();
    let moved = |from, to| moved(&targets, from, to);
    assert!(moved(600, 1500) > 0.1, "{} rad in 0.9 s", moved(600, 1500));
    assert!(moved(1750, 3500) == 0.0, "{} rad while the link was lost or not trusted", moved(1750, 3500));
    assert!(rearmed.len() == 1 && (2500..3200).contains(&rearmed[0]), "{rearmed:?}");
    assert!(moved(3600, 4490) > 0.1, "{} rad in 0.9 s", moved(3600, 4490));
    let replay = replay_trial(&dir, ReplayOptions::default()).unwrap();
    assert!(replay.agrees, "{replay:?}");
}

#[test]
fn a_model_and_a_profile_that_do_not_go_together_are_refused_with_what_to_set() {
    let refused = |at_once, kind| start(config(at_once), &model(kind)).map(|_| ()).unwrap_err();
    let text = refused(false, ClassifierKind::Linear);
    assert!(
        text.contains("\"wrist_extension/wrist_flexion\"") && text.contains("set jog.simultaneous.drives"),
        "{text}"
    );
    let text = refused(true, ClassifierKind::Lda);
    assert!(text.contains("the EMG model (lda) tells gestures apart"), "{text}");
    let mut other = config(true);
    let JogProfile::Time { simultaneous: Some(s), .. } = &mut other.profile.jog else { panic!("it is set") };
    s.drives.remove(&DegreeOfFreedom::hand());
    let text = start(other, &model(ClassifierKind::Linear)).map(|_| ()).unwrap_err();
    assert!(text.contains("expected the same"), "{text}");
}

/// It makes HO to come to another axis, which lifts the hand here: that the arm moves is all that is to be had of it.
#[test]
fn the_simulated_person_moves_the_arm_by_a_regressor_trained_on_the_spot() {
    let mut config = TrialConfig::new("B", 1, Setup::named("seated").unwrap());
    let JogProfile::Time { simultaneous, .. } = &mut config.profile.jog else { panic!("by time") };
    let drives =
        [(DegreeOfFreedom::wrist(), "x".to_owned()), (DegreeOfFreedom::hand(), "z".to_owned())].into();
    *simultaneous = Some(Simultaneous { hand_on_threshold: 0.5, hand_off_threshold: 0.3, drives });
    config.emg = Some(EmgConfig { classifier: ClassifierKind::Ridge, ..EmgConfig::default() });
    config.participant = Some(Default::default());
    let mut trial = trial::simulated_trial(config, &EmgOrigin::Synthetic).unwrap().trial;
    let start = trial.testbed().targets().to_vec();
    let mut furthest = 0.0_f64;
    for tick in 1..=10_000 {
        trial.step(tick == 10_000).unwrap();
        let arm = trial.testbed().targets().iter().zip(&start).take(7);
        furthest = furthest.max(arm.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max));
    }
    println!("{furthest:.3} rad of a joint in 10 s");
    assert!(furthest > 0.1, "{furthest} rad");
}

#[test]
fn two_sites_move_the_arm_of_a_trial() {
    let trial::Assembly { mut trial, .. } = start(config(false), &model(ClassifierKind::TwoSite)).unwrap();
    let start = trial.testbed().targets().to_vec();
    let mut gestures = Vec::new();
    for tick in 1..=1500 {
        let step = trial.step(tick == 1500).unwrap();
        gestures.extend(step.output.emg.map(|output| output.gesture));
    }
    gestures.dedup();
    assert_eq!(gestures, [Command::NoMotion, Command::WristExtension]);
    assert!(trial.testbed().targets().iter().zip(&start).any(|(a, b)| (a - b).abs() > 0.1));
}

/// Which modes there are, and that the hand is one, is all that the person is told: nothing gives HC.
#[test]
fn the_simulated_person_brings_a_block_by_two_sites_and_the_record_replays() {
    const LIMIT_MILLIS: u64 = 60_000;
    let mut config = TrialConfig::new("A", 1, Setup::named("seated").unwrap());
    config.profile.level = "below_elbow".to_owned();
    config.profile.joint_jog.cycle = ["wristy", "wristx", "wristz", "hand"].map(str::to_owned).to_vec();
    config.emg = Some(EmgConfig { classifier: ClassifierKind::TwoSite, ..EmgConfig::default() });
    let assembled = trial::simulated_trial(config, &EmgOrigin::Synthetic).unwrap();
    let trial::Assembly { mut trial, classifier, arm, plans, .. } = assembled;
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path().join("trial");
    let used = trial.testbed().config().clone();
    let recorder = Recorder::create(&dir, &used, &arm, classifier.as_ref()).unwrap();
    let mut recorder = recorder.with_plans(plans).unwrap();
    let (mut brought, mut gestures) = (0, std::collections::BTreeSet::new());
    for tick in 1..=LIMIT_MILLIS {
        let step = trial.step(tick == LIMIT_MILLIS).unwrap();
        recorder.write(&step, trial.testbed().plant().state()).unwrap();
        for event in &step.output.events {
            match event.kind {
                EventKind::ObjectOnTarget { .. } => brought += 1,
                EventKind::GestureChanged { gesture } => drop(gestures.insert(gesture.to_string())),
                _ => {}
            }
        }
    }
    recorder.finish(&trial.result()).unwrap();
    let gestures: Vec<&str> = gestures.iter().map(String::as_str).collect();
    assert_eq!(gestures, ["hand_open", "no_motion", "wrist_extension", "wrist_flexion"]);
    assert!(brought >= 1, "{brought} blocks in a minute");
    let replay = replay_trial(&dir, ReplayOptions::default()).unwrap();
    assert!(replay.agrees, "{replay:?}");
}
