//! A trained model in trials: raw codes of an armband, gaps and silences on the record, replay.
#![allow(clippy::unwrap_used, clippy::disallowed_methods)] // A test of files and processes.

use proact_app::{Arm, Recorder, ReplayOptions, replay_trial, trial};
use proact_control::MethodRegistry;
use proact_devices::{EmgOrigin, SyntheticEmg, SyntheticModel, random_stream};
use proact_emg::{EmgConfig, EmgModel};
use proact_testbed::{Setup, TrialConfig, ports};
use proact_types::{Command, EmgSample, EventKind, InputSource, SimTime, StopCause, TickInput};

const ZERO: f64 = 128.0;
const TICKS: u64 = 3500;

fn generator(seed: u64) -> SyntheticEmg {
    SyntheticEmg::new(&SyntheticModel::shipped().unwrap(), 1000.0, 8, 1.0, random_stream(seed, "test"))
        .unwrap()
}

/// Trained on codes about `zero`.
fn model(zero: f64) -> EmgModel {
    let mut emg = generator(1);
    let mut take = |gesture| -> Vec<EmgSample> {
        let mut codes = || emg.next(gesture).iter().map(|v| (v + zero).round()).collect();
        (0..6000).map(|counter| EmgSample { counter, channels: codes() }).collect()
    };
    let recordings = Command::ALL.map(|gesture| (gesture, take(gesture)));
    let slices: Vec<(Command, &[EmgSample])> = recordings.iter().map(|(g, s)| (*g, s.as_slice())).collect();
    EmgModel::train(&EmgConfig::default(), &[zero; 8], &slices).unwrap()
}

/// Raw codes: a closed hand until the link is lost at 1.5 s, still closed when it is back at 2 s, relaxed from 2.5 s.
struct Armband(SyntheticEmg);

impl ports::EmgSource for Armband {
    fn sample_at(&mut self, now: SimTime, _intended: Command) -> Vec<EmgSample> {
        let gesture = match now.0 {
            500..2500 => Command::HandClose,
            _ => Command::NoMotion,
        };
        let channels = self.0.next(gesture).iter().map(|v| (v + ZERO).round()).collect();
        let lost = (1500..2000).contains(&now.0);
        (!lost).then_some(EmgSample { counter: now.0, channels }).into_iter().collect()
    }
}

fn arm() -> Arm {
    Arm::from_config(&config()).unwrap()
}

fn config() -> TrialConfig {
    TrialConfig::new("D", 1, Setup::named("still").unwrap())
}

#[test]
fn an_armbands_gaps_and_silences_are_on_the_record_and_the_trial_replays_from_raw_codes() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path().join("trial");
    let armband = Box::new(Armband(generator(2)));
    let model = model(ZERO);
    let worn = trial::TrainedArmband { trained: &model, samples: armband };
    let trial::Assembly { mut trial, classifier, arm, .. } =
        trial::live_trial_with_armband(&MethodRegistry::standard(), &arm(), config(), Some(worn)).unwrap();
    let used = trial.testbed().config().clone();
    let mut recorder = Recorder::create(&dir, &used, &arm, classifier.as_ref()).unwrap();
    let mut trial_events = Vec::new();
    for tick in 1..=TICKS {
        let step = trial.step(tick == TICKS).unwrap();
        recorder.write(&step, trial.testbed().plant().state()).unwrap();
        trial_events.extend(step.output.events);
    }
    recorder.finish(&trial.result()).unwrap();

    let at = |wanted: fn(&EventKind) -> bool| -> Vec<u64> {
        trial_events.iter().filter(|e| wanted(&e.kind)).map(|e| e.time.0).collect()
    };
    let closed = at(|k| matches!(k, EventKind::GestureChanged { gesture: Command::HandClose }));
    assert!(
        closed.len() == 1 && (500..1000).contains(&closed[0]),
        "a closed hand must not come back: {trial_events:?}"
    );
    let stale = at(|k| {
        matches!(k, EventKind::Stopped { source: InputSource::Armband, cause: StopCause::Silent, .. })
    });
    assert!(stale.len() == 1 && (1650..1760).contains(&stale[0]), "{trial_events:?}");
    let gaps = at(|k| matches!(k, EventKind::EmgGap { gaps: 1, .. }));
    assert_eq!(gaps, [2000]);
    let rearmed = at(|k| *k == EventKind::Rearmed);
    assert!(rearmed.len() == 1 && rearmed[0] > 2600, "{trial_events:?}");

    let events = std::fs::read_to_string(dir.join("config.toml")).unwrap();
    assert!(events.contains("emg_dc_offset"), "{events}");
    let replayed = replay_trial(&dir, ReplayOptions::default()).unwrap();
    assert!(replayed.agrees, "{replayed:?}");
}

#[test]
fn a_model_that_fits_drives_a_simulated_trial_and_one_of_raw_codes_is_refused() {
    let fits = model(0.0);
    let mut trial = trial::simulated_trial_with_model(
        &MethodRegistry::standard(),
        &arm(),
        config(),
        &EmgOrigin::Synthetic,
        Some(&fits),
    )
    .unwrap()
    .trial;
    let mut changes = 0;
    for _ in 0..8000 {
        let step = trial.step(false).unwrap();
        changes +=
            step.output.events.iter().filter(|e| matches!(e.kind, EventKind::GestureChanged { .. })).count();
    }
    assert!(changes >= 2, "the participant's gestures are recognised");
    let refused = trial::simulated_trial_with_model(
        &MethodRegistry::standard(),
        &arm(),
        config(),
        &EmgOrigin::Synthetic,
        Some(&model(ZERO)),
    );
    let error = refused.map(|_| ()).unwrap_err().to_string();
    assert!(error.contains("does not fit") && error.contains("rests at"), "{error}");
}

#[test]
fn a_trained_model_takes_settings_of_the_decision_and_refuses_those_of_its_training() {
    let fits = model(0.0);
    let start = |change: &dyn Fn(&mut EmgConfig)| {
        let mut config = config();
        let mut emg_config = EmgConfig { liveness: fits.liveness(None), ..fits.config.clone() };
        change(&mut emg_config);
        config.emg = Some(emg_config);
        trial::simulated_trial_with_model(
            &MethodRegistry::standard(),
            &arm(),
            config,
            &EmgOrigin::Synthetic,
            Some(&fits),
        )
    };
    let slower = start(&|emg| emg.consecutive_decisions = 12.try_into().unwrap()).unwrap();
    assert_eq!(slower.trial.testbed().config().emg.as_ref().unwrap().consecutive_decisions.get(), 12);
    let refused = start(&|emg| emg.features = "LS4".parse().unwrap()).map(|_| ()).unwrap_err().to_string();
    assert!(refused.contains("emg.features is ") && refused.contains("trained with"), "{refused}");
}

#[test]
fn an_armband_that_is_not_used_may_be_silent_or_die_and_one_that_is_used_stops_the_arm() {
    // The armband sends until this time, ms; a key is pressed at 0.1 s.
    for (name, dies_ms, keys) in [
        ("never sends", 0, true),
        ("dies", 1000, true),
        ("lives", 4000, true),
        ("is used and dies", 1000, false),
    ] {
        let (mut testbed, mut feed) =
            trial::live_testbed(config(), &EmgOrigin::Synthetic, |plant| plant).unwrap();
        let mut stops = Vec::new();
        for time in 1..4000 {
            let input = TickInput {
                emg: if time < dies_ms {
                    ports::EmgSource::sample_at(&mut feed, SimTime(time), Command::NoMotion)
                } else {
                    vec![]
                },
                command: (keys && time == 100).then_some(Command::WristExtension),
                ..TickInput::default()
            };
            let events = testbed.tick(&input, false).unwrap().events;
            stops.extend(events.into_iter().filter_map(|event| match event.kind {
                EventKind::Stopped { source: InputSource::Armband, cause, .. } => Some((event.time.0, cause)),
                _ => None,
            }));
        }
        if keys {
            assert_eq!(stops, [], "{name}");
            assert!(testbed.stop().is_none_or(|stop| stop.source != InputSource::Armband), "{name}");
        } else {
            assert!(matches!(stops[..], [(1100..1400, StopCause::Silent)]), "{name}: {stops:?}");
            assert!(testbed.stop().is_some_and(|stop| stop.source == InputSource::Armband), "{name}");
        }
    }
}
