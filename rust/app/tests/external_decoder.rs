//! A classifier, and a regressor, in another process: the example of the documentation, processes that fail, and the replay.
#![allow(clippy::unwrap_used, clippy::disallowed_methods)] // A test of files and processes.

mod common;

use common::{config, generator, moved, recordings, replays, slices};
use proact_app::{Arm, Recorder, trial};
use proact_control::MethodRegistry;
use proact_devices::{SyntheticEmg, read_process_file, train_process};
use proact_emg::{ClassifierKind, DecoderProcessConfig, DecoderProcessInput, EmgConfig, EmgModel};
use proact_testbed::ports;
use proact_types::{Command, EmgSample, EventKind, SimTime, Stop, StopCause};
use std::path::Path;

const EXAMPLE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/decoders");
/// Answers whatever is asked of the windows with the body of `answer(asked)`, and learns nothing.
const FRAME: &str = "import json, sys, time, math\n\
    for line in sys.stdin:\n    asked = json.loads(line)\n    answer = {'window': asked['window']}\n    \
    if asked['window']:\n        BODY\n    print(json.dumps(answer), flush=True)\n";

/// A model of synthetic EMG whose windows `process` decodes.
fn model(classifier: ClassifierKind, process: DecoderProcessConfig) -> EmgModel {
    let recordings = recordings(3000);
    let slices = slices(&recordings);
    let config = EmgConfig { classifier, process: Some(process), ..EmgConfig::default() };
    let stand_in = EmgModel::train(&config.without_process(), &[0.0; 8], &slices).unwrap();
    train_process(&config, stand_in, &slices).unwrap()
}

fn python(body: &str) -> DecoderProcessConfig {
    DecoderProcessConfig {
        command: vec!["python3".to_owned(), "-c".to_owned(), FRAME.replace("BODY", body)],
        input: DecoderProcessInput::Samples,
        deadline_ms: 1000,
        gestures: Vec::new(),
    }
}

/// Relaxed for half a second, then the wrist for as long as the trial lasts.
struct Armband(SyntheticEmg);

impl ports::EmgSource for Armband {
    fn sample_at(&mut self, now: SimTime, _intended: Command) -> Vec<EmgSample> {
        let gesture = if now.0 < 500 { Command::NoMotion } else { Command::WristExtension };
        [EmgSample { counter: now.0, channels: self.0.next(gesture) }].into_iter().collect()
    }
}

struct TrialLog {
    /// What was asked of the joints after each tick, rad.
    targets: Vec<Vec<f64>>,
    stops: Vec<Stop>,
    kinds: Vec<EventKind>,
}

impl TrialLog {
    fn moved(&self, from: usize, to: usize) -> f64 {
        moved(&self.targets, from, to)
    }
}

/// A live trial of `ticks` with method A, recorded in `dir`.
fn run(model: &EmgModel, ticks: u64, at_once: bool, dir: &Path) -> TrialLog {
    let worn = trial::TrainedArmband { trained: model, samples: Box::new(Armband(generator(2))) };
    let config = config(at_once);
    let arm = Arm::from_config(&config).unwrap();
    let trial::Assembly { mut trial, classifier, arm, .. } =
        trial::live_trial_with_armband(&MethodRegistry::standard(), &arm, config, Some(worn)).unwrap();
    let used = trial.testbed().config().clone();
    let mut recorder = Recorder::create(dir, &used, &arm, classifier.as_ref()).unwrap();
    let mut ran = TrialLog { targets: Vec::new(), stops: Vec::new(), kinds: Vec::new() };
    for tick in 1..=ticks {
        let step = trial.step(tick == ticks).unwrap();
        recorder.write(&step, trial.testbed().plant().state()).unwrap();
        ran.targets.push(trial.testbed().targets().to_vec());
        ran.stops.extend(trial.testbed().stop().cloned());
        ran.kinds.extend(step.output.events.into_iter().map(|event| event.kind));
    }
    recorder.finish(&trial.result()).unwrap();
    ran
}

#[test]
fn the_documented_example_in_python_moves_the_arm_and_its_trial_replays_when_it_is_gone() {
    let temp_dir = tempfile::tempdir().unwrap();
    for name in ["nearest_centroid.py", "nearest_centroid.toml"] {
        std::fs::copy(Path::new(EXAMPLE).join(name), temp_dir.path().join(name)).unwrap();
    }
    let process = read_process_file(&temp_dir.path().join("nearest_centroid.toml")).unwrap();
    // A machine under load is not what is tested.
    let process = DecoderProcessConfig { deadline_ms: 1000, ..process };
    let model = model(ClassifierKind::Process, process);
    let json = model.to_json().unwrap();
    assert_eq!(EmgModel::from_json(&json).unwrap(), model, "the file holds all of it");
    assert!(json.contains("centroids"), "what it learnt is kept with the model");
    let dir = temp_dir.path().join("trial");
    let ran = run(&model, 2500, false, &dir);
    assert!(ran.moved(0, 499) == 0.0 && ran.moved(800, 2400) > 0.1, "{} rad", ran.moved(800, 2400));
    std::fs::remove_file(temp_dir.path().join("nearest_centroid.py")).unwrap();
    replays(&dir);
}

#[test]
fn whatever_a_process_does_wrong_the_arm_stops_the_reason_is_on_record_and_the_trial_goes_on() {
    let wrist = Command::WristExtension.index();
    let good = format!(
        "p = [0.0] * 5; p[{wrist}] = 1.0; p = [0, 0, 1.0, 0, 0] if asked['time'] < 500 else p; answer['posterior'] = p"
    );
    // From 1.5 s on it does one thing wrong.
    let then = |wrong: &str| format!("{good}\n        if asked['time'] > 1500:\n            {wrong}");
    let cases = [
        ("raise ValueError('no weights')", "has ended (exit status: 1)"),
        ("sys.exit(0)", "has ended (exit status: 0)"),
        ("answer['posterior'] = [math.nan] * 5", "it answered"),
        ("answer['posterior'] = [1.0]", "posterior has 1 values, expected 5"),
        ("answer['posterior'] = [1.0] * 5", "posterior sums to 5, expected 1"),
        ("answer = {'window': asked['window'], 'drives': [1.0, 0.0]}", "without a posterior"),
        ("answer = {'window': asked['window'], 'error': 'no memory'}", "it says \"no memory\""),
        ("answer['window'] += 1", "expected"),
        ("answer = 'hello'", "it answered"),
    ];
    assert_eq!(Command::NoMotion.index(), 2, "what the good answers say");
    for (wrong, expected) in cases {
        let temp_dir = tempfile::tempdir().unwrap();
        let dir = temp_dir.path().join("trial");
        let ran = run(&model(ClassifierKind::Process, python(&then(wrong))), 2200, false, &dir);
        assert!(ran.moved(700, 1500) > 0.05, "{wrong}: it moved while all was well");
        assert_eq!(ran.moved(1800, 2199), 0.0, "{wrong}: the arm holds");
        let stop = ran.stops.last().unwrap();
        assert_eq!(stop.cause, StopCause::UnusableOutput, "{wrong}: {stop:?}");
        assert!(stop.reason.contains(expected), "{wrong}: {}", stop.reason);
        let warnings = ran
            .kinds
            .iter()
            .filter(|k| matches!(k, EventKind::Stopped { reason, .. } if reason.contains(expected)));
        assert_eq!(warnings.count(), 1, "{wrong}: {:?}", ran.kinds);
        replays(&dir);
    }
}

#[test]
fn a_process_that_is_late_loses_windows_and_stops_the_arm_when_it_stays_late() {
    let wrist = Command::WristExtension.index();
    let late = format!(
        "time.sleep(0.3 if 800 < asked['time'] < 860 or asked['time'] > 1500 else 0); p = [0.0] * 5; \
         p[2 if asked['time'] < 500 else {wrist}] = 1.0; answer['posterior'] = p"
    );
    let temp_dir = tempfile::tempdir().unwrap();
    let dir = temp_dir.path().join("trial");
    let process = DecoderProcessConfig { deadline_ms: 200, ..python(&late) };
    let ran = run(&model(ClassifierKind::Process, process), 2200, false, &dir);
    // The answer that came too late for its own window is not taken for that of the next.
    assert!(ran.moved(900, 1450) > 0.05 && ran.moved(1900, 2199) == 0.0);
    let stop = ran.stops.last().unwrap();
    assert!(
        stop.cause == StopCause::UnusableOutput && stop.reason.contains("not answered within 200 ms"),
        "{stop:?}"
    );
    replays(&dir);
}

#[test]
fn a_regressor_in_another_process_moves_the_arm_in_proportion_and_not_after_it_has_ended() {
    let body = "level = sum(abs(x) for row in asked['samples'] for x in row) / len(asked['samples'])\n        \
        answer['drives'] = [0.0 if asked['time'] < 500 else min(1.0, 0.5 + level / 1e6), 0.0]\n        \
        if asked['time'] > 1500: sys.exit(4)";
    let temp_dir = tempfile::tempdir().unwrap();
    let dir = temp_dir.path().join("trial");
    let ran = run(&model(ClassifierKind::ProcessRegressor, python(body)), 2200, true, &dir);
    assert!(ran.moved(700, 1450) > 0.05 && ran.moved(1800, 2199) == 0.0, "{}", ran.moved(1800, 2199));
    assert!(ran.stops.last().unwrap().reason.contains("exit status: 4"));
    replays(&dir);
}

#[test]
fn a_program_that_does_not_begin_is_refused_before_the_trial_with_its_name() {
    let refused = |command: &[&str]| {
        let process =
            DecoderProcessConfig { command: command.iter().map(|&w| w.to_owned()).collect(), ..python("") };
        let config =
            EmgConfig { classifier: ClassifierKind::Process, process: Some(process), ..EmgConfig::default() };
        let good = model(ClassifierKind::Process, python("pass"));
        let stand_in = EmgModel { config: config.without_process(), ..good };
        train_process(&config, stand_in, &[]).unwrap_err().to_string()
    };
    assert!(refused(&["proact-no-such-program"]).contains("proact-no-such-program"));
    assert!(refused(&["true"]).contains("has ended (exit status: 0)"));
    assert!(refused(&["echo", "hello"]).contains("it answered \"hello\""));
    assert!(refused(&["echo", "{\"window\": 0, \"error\": \"no torch\"}"]).contains("it says \"no torch\""));
}
