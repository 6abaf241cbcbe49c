//! A control method in another process: the example of the documentation, processes that fail, and the replay.
#![allow(clippy::disallowed_methods)] // A test of files and processes.

use proact_app::{
    Arm, Recorder, ReplayOptions, replay_trial,
    trial::{self, CustomParts},
};
use proact_control::{MethodProgram, MethodRegistry, ports::MethodProcess};
use proact_devices::EmgOrigin;
use proact_testbed::{ResultFaultKind, RunningTrial, Setup, TrialConfig, TrialEnd};
use proact_types::{
    Command, DisplayFrame, EventKind, GazeSample, InputSource, MethodAnswer, PlannerView, Point, SimTime,
    StopCause,
};
use std::{error::Error, path::Path};

type Outcome<T = ()> = Result<T, Box<dyn Error>>;

const EXAMPLE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/methods/follow_gaze.py");

/// A trial of at most four seconds whose method is `command`.
fn config(command: &[&str], deadline_ms: u64) -> Outcome<TrialConfig> {
    let command = command.iter().map(|&word| word.to_owned()).collect();
    let config = TrialConfig::new("C", 1, Setup::named("still")?);
    let process = MethodProgram { deadline_ms, ..MethodProgram::new(command) };
    Ok(TrialConfig { limit_secs: 4.0, method_process: Some(process), ..config })
}

/// Looks at the first block and holds WE until the trial is over; what was shown, and the session.
fn run(config: TrialConfig, dir: Option<&Path>) -> Outcome<(Vec<DisplayFrame>, RunningTrial)> {
    let trial::Assembly { mut trial, arm, classifier, .. } = trial::live_trial(config)?;
    let used = trial.testbed().config().clone();
    let recorder = |dir| Recorder::create(dir, &used, &arm, classifier.as_ref());
    let mut recorder = dir.map(recorder).transpose()?;
    let mut frames = Vec::new();
    trial.person_stage_mut().set_command(Command::WristExtension);
    loop {
        let (block, origin) =
            (trial.testbed().plant().state().objects[0].pose, trial.head_pose().translation);
        let direction = block.translation.vector - origin.vector;
        trial.person_stage_mut().set_pointer_gaze(GazeSample {
            origin: Point::from(origin.vector),
            direction,
            valid: true,
        });
        let step = trial.step(false)?;
        if let Some(recorder) = &mut recorder {
            recorder.write(&step, trial.testbed().plant().state())?;
        }
        frames.extend(step.frame.map(|frame| *frame));
        if step.output.finished {
            break;
        }
    }
    if let Some(recorder) = recorder {
        recorder.finish(&trial.result())?;
    }
    Ok((frames, trial))
}

/// How far the hand is from the point over the first block where the example stops, metres.
fn distance_to_goal(frame: &DisplayFrame) -> f64 {
    let tip = frame.world_from_tip.translation.vector - frame.objects[0].translation.vector;
    (tip - proact_types::Vector::new(0.0, 0.0, 0.15)).norm()
}

#[test]
fn the_documented_example_in_python_carries_the_hand_to_the_block_and_its_trial_replays_without_it() -> Outcome
{
    let temp_dir = tempfile::tempdir()?;
    let dir = temp_dir.path().join("trial");
    let (frames, trial) = run(config(&["python3", EXAMPLE], 1000)?, Some(&dir))?;
    let (first, last) = (frames.first().ok_or("frames")?, frames.last().ok_or("frames")?);
    assert!(
        distance_to_goal(last) < distance_to_goal(first) - 0.2,
        "{} m, then {} m",
        distance_to_goal(first),
        distance_to_goal(last)
    );
    assert_eq!((last.method.as_str(), trial.result().method.as_str()), ("outside", "outside"));
    assert!(last.mode.is_none(), "the built-in method has no say beside it");
    drop(trial);
    let replayed = replay_trial(&dir, ReplayOptions::default())?;
    assert!(replayed.agrees, "{:?}", replayed.divergence);
    Ok(())
}

#[test]
fn when_the_process_ends_the_arm_stops_the_reason_is_shown_and_the_trial_goes_on_and_replays() -> Outcome {
    let temp_dir = tempfile::tempdir()?;
    let dir = temp_dir.path().join("trial");
    let dies = format!(
        "import sys, itertools; sys.stdin = itertools.islice(sys.stdin, 150); exec(open({EXAMPLE:?}).read()); sys.exit(3)"
    );
    let (frames, trial) = run(config(&["python3", "-c", &dies], 1000)?, Some(&dir))?;
    let last = frames.last().ok_or("frames")?;
    let PlannerView::Failed { reason, .. } = &last.planner else { panic!("{:?}", last.planner) };
    assert!(reason.contains("has ended (exit status: 3)"), "{reason}");
    assert!(trial.testbed().plant().state().velocity.iter().all(|speed| speed.abs() < 1e-2));
    assert_eq!(last.time.0, 4000, "the trial went on to its limit");
    assert!(
        frames.iter().any(|frame| distance_to_goal(frame) < distance_to_goal(&frames[0]) - 0.05),
        "it moved before"
    );
    drop(trial);
    assert!(replay_trial(&dir, ReplayOptions::default())?.agrees);
    Ok(())
}

#[test]
fn a_process_that_is_late_floods_or_does_not_exist_is_told_apart() -> Outcome {
    for (command, expected) in [
        (vec!["sh", "-c", "cat >/dev/null"], "has not answered within 1 ms"),
        (vec!["yes"], "answered \"y\""),
        (vec!["sh", "-c", "exec >&-; cat >/dev/null"], "has closed its output"),
    ] {
        let short = TrialConfig { limit_secs: 0.3, ..config(&command, 1)? };
        let (frames, trial) = run(short, None)?;
        let shown = frames.iter().filter_map(|frame| match &frame.planner {
            PlannerView::Failed { reason, .. } => Some(reason.as_str()),
            _ => None,
        });
        assert!(shown.clone().any(|reason| reason.contains(expected)), "{:?}", shown.collect::<Vec<_>>());
        let model = trial.testbed().model();
        let start = model.pose("arm", "start")?;
        let moved =
            frames.iter().flat_map(|frame| frame.joints.iter().zip(start)).map(|(q, s)| (q - s).abs());
        assert!(moved.fold(0.0, f64::max) < 0.02, "the arm holds");
    }
    let error =
        trial::live_trial(config(&["proact-no-such-program"], 5)?).err().ok_or("it does not exist")?;
    assert!(error.to_string().contains("proact-no-such-program"), "{error}");
    let error = config(&[], 5)?.check().expect_err("no program").to_string();
    assert!(error.contains("method_process.command"), "{error}");
    Ok(())
}

/// Turns the elbow until 0.5 s, then does `wrong` with each line.
fn goes_wrong(wrong: &str) -> String {
    format!(
        "import json, sys\nfor line in sys.stdin:\n    t = json.loads(line)['time']\n    \
         answer = '{{\"time\": %d, \"motion\": {{\"velocity\": [0,0,0,0.4,0,0,0]}}}}' % t\n    \
         if t >= 500:\n        {wrong}\n    print(answer, flush=True)\n"
    )
}

/// When and why a method stopped the arm.
fn method_stops(frames: &[DisplayFrame]) -> Vec<(u64, StopCause, String)> {
    let stop = |event: &proact_types::Event| match &event.kind {
        EventKind::Stopped { source: InputSource::Method, cause, reason } => {
            Some((event.time.0, *cause, reason.clone()))
        }
        _ => None,
    };
    frames.iter().flat_map(|frame| &frame.events).filter_map(stop).collect()
}

/// It only held the arm: no event, no fault in the tables, and a score of zero.
#[test]
fn a_method_that_goes_wrong_stops_the_arm_with_an_event_and_its_trial_fails_live_and_in_the_replay() -> Outcome
{
    for (wrong, expected) in [
        (
            "answer = '{\"time\": %d, \"motion\": {\"velocity\": [0.4, 0.4]}}' % t",
            "got 2 values, the arm has 7 joints",
        ),
        (
            "answer = '{\"time\": %d, \"mode\": {\"moves\": {\"joint\": 40}, \"name\": \"x\", \"directions\": [\"a\", \"b\"]}}' % t",
            "mode: got joint 40",
        ),
        ("answer = '{\"time\": %d, \"motion\": {\"teleport\": [0]}}' % t", "unknown variant `teleport`"),
        ("answer = '{\"time\": %d, \"motion\": {\"velocity\": [NaN,0,0,0,0,0,0]}}' % t", "expected value"),
        ("answer = 'what?'", "answered \"what?\""),
        ("sys.exit(4)", "has ended (exit status: 4)"),
    ] {
        let temp_dir = tempfile::tempdir()?;
        let dir = temp_dir.path().join("trial");
        let short = TrialConfig { limit_secs: 1.2, ..config(&["python3", "-c", &goes_wrong(wrong)], 1000)? };
        let (frames, trial) = run(short, Some(&dir))?;
        let stops = method_stops(&frames);
        let [(at, StopCause::UnusableOutput, reason)] = stops.as_slice() else {
            panic!("{wrong}: {stops:?}")
        };
        assert_eq!(*at, 500, "in the tick of the first bad answer");
        assert!(reason.starts_with("the method failed: ") && reason.contains(expected), "{reason}");
        let last = frames.last().ok_or("frames")?;
        assert_eq!(
            last.stop.as_ref().map(|stop| stop.source),
            Some(InputSource::Method),
            "the page shows it"
        );
        assert!(trial.testbed().plant().state().velocity.iter().all(|speed| speed.abs() < 1e-2));
        let result = trial.result();
        assert_eq!((result.ended, result.counted_score()), (TrialEnd::Failed, None), "{wrong}");
        assert!(result.failure().is_some_and(|failure| failure.contains(expected)), "{:?}", result.failure());
        drop(trial);
        let replayed = replay_trial(&dir, ReplayOptions::default())?;
        assert!(replayed.agrees, "{wrong}: {:?}", replayed.divergence);
    }
    Ok(())
}

#[test]
fn a_live_method_that_never_answers_stops_the_arm_in_200_ms_and_ends_the_trial_at_the_limit() -> Outcome {
    let temp_dir = tempfile::tempdir()?;
    let dir = temp_dir.path().join("trial");
    let silent = config(&["sh", "-c", "cat >/dev/null"], 1)?;
    let (frames, trial) = run(TrialConfig { missed_answers_limit: Some(50), ..silent }, Some(&dir))?;
    // The first step is that of tick 1, in which the gesture begins.
    let stops = method_stops(&frames);
    assert!(matches!(stops.as_slice(), [(210, StopCause::Silent, _)]), "{stops:?}");
    let last = frames.last().ok_or("frames")?;
    assert_eq!((last.time.0, last.finished), (490, true), "50 steps");
    let result = trial.result();
    let failure = result.failure().ok_or("it failed")?;
    assert!(
        failure.contains("has missed 50 answers in a row") && failure.contains("within 1 ms"),
        "{failure}"
    );
    drop(trial);
    assert!(replay_trial(&dir, ReplayOptions::default())?.agrees);
    Ok(())
}

/// Answers nothing, at once.
struct NeverAnswers;

impl MethodProcess for NeverAnswers {
    fn ask(&mut self, _now: SimTime, _line: &str) -> MethodAnswer {
        MethodAnswer::TimedOut("the process has not answered within 10000 ms".to_owned())
    }
}

/// A simulated trial of `config` to its end.
fn simulate(config: TrialConfig, method: Option<Box<dyn MethodProcess>>) -> Outcome<RunningTrial> {
    let (arm, methods) = (Arm::from_config(&config)?, MethodRegistry::standard());
    let emg = Some(trial::EmgInput { origin: &EmgOrigin::Synthetic, trained: None });
    let own = CustomParts { method, ..CustomParts::default() };
    let mut trial = trial::simulate_with(&methods, &arm, config, emg, 0.0, own)?.trial;
    while !trial.step(false)?.output.finished {}
    Ok(trial)
}

/// A trial of 3 s waited 10 s for each of its steps.
#[test]
fn a_batch_trial_ends_after_three_answers_that_were_waited_for_in_vain() -> Outcome {
    let trial = simulate(config(&["never-started"], 5)?, Some(Box::new(NeverAnswers)))?;
    assert_eq!(trial.testbed().now(), SimTime(30));
    assert_eq!(trial.result().ended, TrialEnd::Failed);
    Ok(())
}

/// Late in two of three steps, and never three times in a row.
struct OftenLate(u64);

impl MethodProcess for OftenLate {
    fn ask(&mut self, now: SimTime, _line: &str) -> MethodAnswer {
        self.0 += 1;
        match self.0 % 3 {
            0 => MethodAnswer::Line(format!("{{\"time\": {}}}", now.0)),
            _ => MethodAnswer::TimedOut("the process has not answered within 10000 ms".to_owned()),
        }
    }
}

/// It was waited for 10 s in two of three steps, to the end of the trial: 44 minutes for these 4 s.
#[test]
fn a_batch_trial_ends_after_twenty_answers_that_were_missed_now_and_then_or_as_many_as_its_configuration_says()
-> Outcome {
    let late = || -> Outcome<_> { Ok((config(&["never-started"], 5)?, Box::new(OftenLate(0)))) };
    let (often, method) = late()?;
    let trial = simulate(often, Some(method))?;
    let result = trial.result();
    assert_eq!((result.ended, trial.testbed().now() < SimTime(500)), (TrialEnd::Failed, true));
    let failure = result.failure().ok_or("it failed")?;
    assert!(failure.contains("the method has missed 20 answers in this trial"), "{failure}");
    let (often, method) = late()?;
    let trial =
        simulate(TrialConfig { missed_answers_in_trial_limit: Some(100_000), ..often }, Some(method))?;
    assert_eq!(trial.testbed().now(), SimTime(4000));
    Ok(())
}

#[test]
fn a_simulated_trial_whose_method_does_not_exist_runs_and_fails_with_its_name() -> Outcome {
    let short = TrialConfig { limit_secs: 0.5, ..config(&["proact-no-such-program"], 5)? };
    let result = simulate(short, None)?.result();
    assert!(result.failure().is_some_and(|failure| failure.contains("proact-no-such-program")), "{result:?}");
    let kinds: Vec<ResultFaultKind> = result.trial_faults.iter().map(|fault| fault.kind).collect();
    assert_eq!(kinds, [ResultFaultKind::ExternalPart, ResultFaultKind::NeverActed]);
    Ok(())
}

#[test]
fn a_method_that_is_back_goes_on_after_a_relaxed_hand_and_its_trial_counts() -> Outcome {
    let once = goes_wrong("answer = 'what?' if t < 520 else answer");
    let trial::Assembly { mut trial, .. } = trial::live_trial(config(&["python3", "-c", &once], 1000)?)?;
    let mut kinds = Vec::new();
    let mut turned = Vec::new();
    for tick in 1..=1500 {
        trial.person_stage_mut().set_command(if (1000..1100).contains(&tick) {
            Command::NoMotion
        } else {
            Command::WristExtension
        });
        kinds.extend(trial.step(false)?.output.events.into_iter().map(|event| (tick, event.kind)));
        turned.push(trial.testbed().targets()[3]);
    }
    let rearmed = kinds.iter().find(|(_, kind)| *kind == EventKind::Rearmed).map(|(tick, _)| *tick);
    assert_eq!(rearmed, Some(1000), "{kinds:?}");
    assert!((turned[990] - turned[600]).abs() < 1e-9, "a gesture that is held does not start it again");
    assert!(turned[1499] > turned[1000] + 0.1, "a relaxed hand does");
    assert!(trial.result().trial_faults.is_empty());
    Ok(())
}
