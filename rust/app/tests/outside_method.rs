//! A control method in another process: the example of the documentation, processes that fail, and the replay.
#![allow(clippy::disallowed_methods)] // A test of files and processes.

use proact_app::{Recorder, ReplayOptions, replay_trial, trial};
use proact_control::MethodProgram;
use proact_testbed::{Session, Setup, TrialConfig};
use proact_types::{DisplayFrame, GazeSample, Gesture, PlannerView, Point};
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
fn run(config: TrialConfig, dir: Option<&Path>) -> Outcome<(Vec<DisplayFrame>, Session)> {
    let trial::Assembly { mut session, arm, classifier, .. } = trial::live(config)?;
    let used = session.testbed().config().clone();
    let recorder = |dir| Recorder::create(dir, &used, &arm, classifier.as_ref());
    let mut recorder = dir.map(recorder).transpose()?;
    let mut frames = Vec::new();
    session.person().act(Gesture::WristExtension);
    loop {
        let (block, origin) = (session.testbed().plant().state().objects[0].pose, session.head().translation);
        let direction = block.translation.vector - origin.vector;
        session.person().point(GazeSample { origin: Point::from(origin.vector), direction, valid: true });
        let step = session.step(false)?;
        if let Some(recorder) = &mut recorder {
            recorder.write(&step, session.testbed().plant().state())?;
        }
        frames.extend(step.frame.map(|frame| *frame));
        if step.output.finished {
            break;
        }
    }
    if let Some(recorder) = recorder {
        recorder.finish(&session.result())?;
    }
    Ok((frames, session))
}

/// How far the hand is from the point over the first block where the example stops, metres.
fn away(frame: &DisplayFrame) -> f64 {
    let tip = frame.world_from_tip.translation.vector - frame.objects[0].translation.vector;
    (tip - proact_types::Vector::new(0.0, 0.0, 0.15)).norm()
}

#[test]
fn the_documented_example_in_python_carries_the_hand_to_the_block_and_its_trial_replays_without_it() -> Outcome
{
    let place = tempfile::tempdir()?;
    let dir = place.path().join("trial");
    let (frames, session) = run(config(&["python3", EXAMPLE], 1000)?, Some(&dir))?;
    let (first, last) = (frames.first().ok_or("frames")?, frames.last().ok_or("frames")?);
    assert!(away(last) < away(first) - 0.2, "{} m, then {} m", away(first), away(last));
    assert_eq!((last.method.as_str(), session.result().method.as_str()), ("outside", "outside"));
    assert!(last.mode.is_none(), "the built-in method has no say beside it");
    drop(session);
    let replayed = replay_trial(&dir, ReplayOptions::default())?;
    assert!(replayed.agrees, "{:?}", replayed.divergence);
    Ok(())
}

#[test]
fn when_the_process_ends_the_arm_stops_the_reason_is_shown_and_the_trial_goes_on_and_replays() -> Outcome {
    let place = tempfile::tempdir()?;
    let dir = place.path().join("trial");
    let dies = format!(
        "import sys, itertools; sys.stdin = itertools.islice(sys.stdin, 150); exec(open({EXAMPLE:?}).read()); sys.exit(3)"
    );
    let (frames, session) = run(config(&["python3", "-c", &dies], 1000)?, Some(&dir))?;
    let last = frames.last().ok_or("frames")?;
    let PlannerView::Failed { reason, .. } = &last.planner else { panic!("{:?}", last.planner) };
    assert!(reason.contains("has ended (exit status: 3)"), "{reason}");
    assert!(session.testbed().plant().state().velocity.iter().all(|speed| speed.abs() < 1e-2));
    assert_eq!(last.time.0, 4000, "the trial went on to its limit");
    assert!(frames.iter().any(|frame| away(frame) < away(&frames[0]) - 0.05), "it moved before");
    drop(session);
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
        let (frames, session) = run(short, None)?;
        let shown = frames.iter().filter_map(|frame| match &frame.planner {
            PlannerView::Failed { reason, .. } => Some(reason.as_str()),
            _ => None,
        });
        assert!(shown.clone().any(|reason| reason.contains(expected)), "{:?}", shown.collect::<Vec<_>>());
        let model = session.testbed().model();
        let start = model.pose("arm", "start")?;
        let moved =
            frames.iter().flat_map(|frame| frame.joints.iter().zip(start)).map(|(q, s)| (q - s).abs());
        assert!(moved.fold(0.0, f64::max) < 0.02, "the arm holds");
    }
    let error = trial::live(config(&["proact-no-such-program"], 5)?).err().ok_or("it does not exist")?;
    assert!(error.to_string().contains("proact-no-such-program"), "{error}");
    let error = config(&[], 5)?.check().expect_err("no program").to_string();
    assert!(error.contains("method_process.command"), "{error}");
    Ok(())
}
