//! An intent model in another process: the example of the documentation, processes that fail, the replay and the scores.
#![allow(clippy::unwrap_used, clippy::disallowed_methods)] // A test of files and processes.

mod common;

use common::replays;
use proact_app::{
    Arm, Recorder, counterfactual, intent_scores,
    trial::{self, Assembly, CustomParts, simulate_with},
};
use proact_control::MethodRegistry;
use proact_devices::EmgOrigin;
use proact_intent::IntentProgram;
use proact_participants::Participant;
use proact_testbed::{Setup, TrialConfig};
use proact_types::{
    Command, DisplayFrame, EventKind, ExternalAnswer, GazeSample, InputSource, Intention, Point, StopCause,
    TrunkPosture, Vector,
};
use std::path::Path;

const EXAMPLE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/intent_models/leaky_dwell.py");
/// Means the second block; `BODY` may do something else.
const FRAME: &str = "import json, sys, time, math\n\
    for line in sys.stdin:\n    look = json.loads(line)\n    \
    answer = {'time': look['time'], 'posterior': [0, 1, 0, 0]}\n    BODY\n    print(json.dumps(answer), flush=True)\n";

fn config(method: &str, command: &[&str], deadline_ms: u64) -> TrialConfig {
    let command = command.iter().map(|&word| word.to_owned()).collect();
    let config = TrialConfig::new(method, 1, Setup::named("still").unwrap());
    let program = IntentProgram { deadline_ms, ..IntentProgram::new(command) };
    TrialConfig { limit_secs: 3.0, intent_process: Some(program), ..config }
}

/// What a trial showed and what happened.
struct Ran {
    frames: Vec<DisplayFrame>,
    kinds: Vec<EventKind>,
}

impl Ran {
    /// How far the joint that moved most turned between two times, rad.
    fn moved(&self, from: u64, to: u64) -> f64 {
        let at = |time: u64| self.frames.iter().find(|frame| frame.time.0 >= time).unwrap();
        let (before, after) = (at(from), at(to));
        before.joints.iter().zip(&after.joints).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
    }

    fn shown(&self, from: u64, to: u64) -> impl Iterator<Item = &DisplayFrame> {
        self.frames.iter().filter(move |frame| (from..to).contains(&frame.time.0))
    }
}

/// Looks at the third block, and holds WE from half a second on.
struct Holds;

impl Participant for Holds {
    fn step(&mut self, frame: &DisplayFrame) -> Intention {
        let line = frame.objects[2].translation.vector - frame.world_from_head.translation.vector;
        Intention {
            gesture: if frame.time.0 < 500 { Command::NoMotion } else { Command::WristExtension },
            gaze_direction: line.normalize(),
            eyes_open: true,
            trunk: TrunkPosture::default(),
            limb: None,
        }
    }
}

/// A trial of that person, recorded in `dir`; each answer is waited for.
fn run(config: TrialConfig, dir: &Path) -> Ran {
    let arm = Arm::from_config(&config).unwrap();
    let own = CustomParts { participant: Some(Box::new(Holds)), ..CustomParts::default() };
    finish(simulate_with(&MethodRegistry::standard(), &arm, config, None, 0.5, own).unwrap(), dir)
}

/// A trial to its end, recorded in `dir`.
fn finish(trial: Assembly, dir: &Path) -> Ran {
    let Assembly { trial: mut running_trial, arm, classifier, .. } = trial;
    let used = running_trial.testbed().config().clone();
    let mut recorder = Recorder::create(dir, &used, &arm, classifier.as_ref()).unwrap();
    let mut ran = Ran { frames: Vec::new(), kinds: Vec::new() };
    loop {
        let step = running_trial.step(false).unwrap();
        recorder.write(&step, running_trial.testbed().plant().state()).unwrap();
        ran.frames.extend(step.frame.map(|frame| *frame));
        ran.kinds.extend(step.output.events.into_iter().map(|event| event.kind));
        if step.output.finished {
            break;
        }
    }
    recorder.finish(&running_trial.result()).unwrap();
    ran
}

#[test]
fn the_documented_example_carries_a_trial_that_replays_without_it_and_is_scored_beside_the_others() {
    let temp_dir = tempfile::tempdir().unwrap();
    let dir = temp_dir.path().join("trial");
    let config = TrialConfig { limit_secs: 300.0, ..config("D", &["python3", EXAMPLE], 1000) };
    let ran = finish(trial::simulated_trial(config, &EmgOrigin::Synthetic).unwrap(), &dir);
    assert_eq!(ran.frames.last().unwrap().score, 4);
    replays(&dir);
    let methods = MethodRegistry::standard();
    let report = intent_scores::score_intent_models(&methods, &dir, None, |_, _, _| {}).unwrap();
    assert_eq!((report.picks, report.models.len()), (4, 6));
    let last = report.models.last().unwrap();
    assert_eq!(last.model, intent_scores::EXTERNAL_MODEL);
    assert!(last.score.accuracy > 0.8 && last.score.never_correct == 0, "{last:?}");
    // Another model on the same record is one of the program's own; what this one would have said else is nowhere.
    let values = |text: &str| vec![text.to_owned()];
    let other = counterfactual(&methods, &dir, &values("intent_model=prior_only"), false).unwrap();
    assert!(other.display_differs_from_secs.is_some(), "{other:?}");
    let refused =
        counterfactual(&methods, &dir, &values("intent.highlight_hysteresis=2.0"), false).unwrap_err();
    assert!(refused.to_string().contains("another program"), "{refused}");
}

#[test]
fn what_the_process_says_is_highlighted_and_whatever_it_does_wrong_stops_the_arm_with_the_reason() {
    // From 1.5 s on it does one thing wrong.
    let cases = [
        ("raise ValueError('no weights')", "has ended (exit status: 1)"),
        ("answer['posterior'] = [math.nan] * 4", "it answered"),
        ("answer['posterior'] = [1.0]", "posterior has 1 values, expected 4"),
        ("answer['posterior'] = [1.0, -1.0, 0, 0]", "posterior 1 is -1"),
        ("answer['time'] += 1", "it answered the gaze of"),
        ("answer = 'hello'", "it answered"),
    ];
    for (wrong, expected) in cases {
        let temp_dir = tempfile::tempdir().unwrap();
        let dir = temp_dir.path().join("trial");
        let script = FRAME.replace("BODY", &format!("if look['time'] > 1500:\n        {wrong}"));
        let ran = run(config("C", &["python3", "-c", &script], 200), &dir);
        let highlighted = |frame: &DisplayFrame| frame.target.object.map(|object| object.index());
        assert!(ran.shown(200, 500).all(|frame| highlighted(frame) == Some(1)), "{wrong}: as it says");
        let stop = |frame: &DisplayFrame| frame.stop.clone();
        assert!(ran.shown(100, 1500).all(|frame| stop(frame).is_none()), "{wrong}");
        for frame in ran.shown(1800, 3000) {
            let stop = stop(frame).unwrap();
            assert_eq!(
                (stop.source, stop.cause),
                (InputSource::EyeTracker, StopCause::UnusableOutput),
                "{wrong}"
            );
            assert!(stop.reason.contains(expected), "{wrong}: {}", stop.reason);
            assert_eq!(highlighted(frame), None, "{wrong}");
        }
        assert!(ran.moved(700, 1500) > 0.05, "{wrong}: it moves while all is well");
        assert!(ran.moved(1800, 2950) < 0.002, "{wrong}: {}", ran.moved(1800, 2950));
        let is_expected_stop = |kind: &&EventKind| matches!(kind, EventKind::Stopped { reason, .. } if reason.contains(expected));
        assert_eq!(ran.kinds.iter().filter(is_expected_stop).count(), 1, "{wrong}: {:?}", ran.kinds);
        replays(&dir);
    }
}

#[test]
fn a_process_that_is_late_stops_the_arm_of_somebody_who_drives() {
    let script = FRAME.replace("BODY", "if look['time'] > 600: time.sleep(3)");
    let config = config("C", &["python3", "-c", &script], 1000);
    let Assembly { mut trial, .. } = trial::live_trial(TrialConfig { limit_secs: 1.2, ..config }).unwrap();
    let (mut answers, mut stopped) = (0, None);
    while stopped.is_none() && trial.testbed().now().0 < 1200 {
        let now = trial.testbed().now().0;
        if now.is_multiple_of(50) {
            let origin = Point::from(trial.head_pose().translation.vector);
            let direction = Vector::new(1.0, 1e-5 * now as f64, -0.5);
            trial.person_stage_mut().set_pointer_gaze(GazeSample { origin, direction, valid: true });
        }
        let step = trial.step(false).unwrap();
        answers += usize::from(matches!(step.output.intent, Some(ExternalAnswer::Line(_))));
        stopped = trial.testbed().stop().cloned();
    }
    let stop = stopped.unwrap();
    assert!(stop.since.0 > 600 && stop.reason.contains("has not answered within 1000 ms"), "{stop:?}");
    assert!(answers > 5 && trial.testbed().posterior().iter().all(|p| *p == 0.0), "{answers}");
}

#[test]
fn a_method_without_gaze_goes_on_without_what_it_does_not_ask() {
    let temp_dir = tempfile::tempdir().unwrap();
    let dir = temp_dir.path().join("trial");
    let ran = run(config("A", &["python3", "-c", "import sys; sys.exit(3)"], 100), &dir);
    assert!(ran.moved(700, 1500) > 0.05 && ran.frames.iter().all(|frame| frame.stop.is_none()));
    replays(&dir);
}

#[test]
fn a_program_that_does_not_start_is_refused_before_the_trial_with_its_name() {
    let error = trial::live_trial(config("D", &["proact-no-such-program"], 5)).err().unwrap().to_string();
    assert!(error.contains("intent model") && error.contains("proact-no-such-program"), "{error}");
    let error = config("D", &[], 5).check().unwrap_err().to_string();
    assert!(error.contains("intent_process.command"), "{error}");
}
