//! Whole trials on doubles: the simulated participant brings blocks across, and a replay finds the same digest, or the
//! first thing that differs.

mod common;

use common::{Outcome, Run, config, replayed};
use proact_participants::SelectingParticipant;
use proact_testbed::{
    PersonParts, RunningTrial, Testbed, TrialConfig,
    doubles::{self, ScriptedGaze},
    first_divergence,
};
use proact_types::{Command, EventKind, SimTime};

const LIMIT_SECS: f64 = 40.0;

fn running_trial(config: TrialConfig) -> Outcome<RunningTrial> {
    let parts = doubles::testbed_parts(&config);
    let testbed = Testbed::new(config, parts)?;
    let config = testbed.config();
    let (body, task) = (config.setup.body, testbed.task());
    let participant =
        SelectingParticipant::new(Default::default(), body, task.scene(), task.briefing(), config.seed);
    let gaze = Box::new(ScriptedGaze::default());
    let person = PersonParts { participant: Some(Box::new(participant)), emg: None, gaze: Some(gaze) };
    Ok(RunningTrial::new(testbed, person))
}

fn trial(config: TrialConfig) -> Outcome<(RunningTrial, Run)> {
    let mut running_trial = running_trial(config)?;
    let run = Run::of(&mut running_trial, u64::MAX)?;
    Ok((running_trial, run))
}

// Catches a chain of stages that is broken anywhere between gaze and task: no highlight, no lock, a plan that is not
// followed, a grasp that is not noticed, a block that does not come along or is not judged.
#[test]
fn with_gaze_and_plans_a_simulated_participant_brings_blocks_to_their_targets() -> Outcome {
    for method in ["C", "D"] {
        let (trial, run) = trial(config(method, LIMIT_SECS))?;
        let result = trial.result();
        assert!(result.score >= 2.0, "method {method}: {:?}", result.result);
        assert_eq!(
            result.legacy_fields["on_target"], result.result["on_target"],
            "as it was called before other tasks"
        );
        assert_eq!(result.legacy_fields["outcomes"].as_array().map(Vec::len), Some(4));
        let landed = run.times(|kind| matches!(kind, EventKind::ObjectOnTarget { .. })).len();
        assert_eq!(landed as f64, result.score, "method {method}");
        let locked = run.times(|kind| matches!(kind, EventKind::Locked { object: Some(_) }));
        let arrived = run.times(|kind| matches!(kind, EventKind::MotionFinished));
        assert!(locked.len() >= 2 && arrived.len() >= 4, "method {method}: {:?}", run.events);
        // What was taken is let go of later, and nothing in between.
        let grasps = run.times(|kind| matches!(kind, EventKind::GraspMade { .. }));
        let releases = run.times(|kind| matches!(kind, EventKind::GraspEnded { .. }));
        assert!(grasps.iter().zip(&releases).all(|(taken, released)| taken < released), "method {method}");
    }
    Ok(())
}

// Catches state that a trial carries outside its configuration and inputs.
#[test]
fn a_replay_on_fresh_doubles_has_the_same_digest_and_another_seed_another() -> Outcome {
    let config = config("D", 15.0);
    let (_, run) = trial(config.clone())?;
    assert_eq!(run.spans.len(), 150);
    assert_eq!(first_divergence(&run.spans, &replayed(&config, &run.inputs)?), None);
    let (_, other) = trial(TrialConfig { seed: 2, ..config })?;
    assert!(first_divergence(&run.spans, &other.spans).is_some());
    Ok(())
}

// Catches an input that is not hashed, or is hashed under another name or in another span.
#[test]
fn the_first_input_that_differs_is_named_with_its_span() -> Outcome {
    let config = config("D", 15.0);
    let (_, run) = trial(config.clone())?;

    let expect = |change: &dyn Fn(&mut proact_types::TickInput) -> bool, from: u64, field: &str| -> Outcome {
        let mut inputs = run.inputs.clone();
        let touched = inputs
            .iter_mut()
            .filter(|(time, _)| time.0 >= from)
            .find_map(|(time, input)| change(input).then_some(*time));
        let tick = touched.ok_or(format!("nothing to change for {field}"))?;
        let found = first_divergence(&run.spans, &replayed(&config, &inputs)?).ok_or("goes unnoticed")?;
        assert!((found.from..=found.to).contains(&tick), "{field} at {tick:?}: {found:?}");
        assert_eq!(found.fields.first().map(String::as_str), Some(field), "{found:?}");
        Ok(())
    };
    let gaze = |input: &mut proact_types::TickInput| match &mut input.gaze {
        Some(gaze) => {
            gaze.direction.y = gaze.direction.y.next_up();
            true
        }
        None => false,
    };
    expect(&gaze, 2345, "input.gaze")?;
    let command = |input: &mut proact_types::TickInput| match &mut input.command {
        Some(command) if *command != Command::NoMotion => {
            *command = Command::NoMotion;
            true
        }
        _ => false,
    };
    expect(&command, 1, "input.gesture")?;
    let shoulder = |input: &mut proact_types::TickInput| match &mut input.shoulder {
        Some(pose) => {
            pose.translation.x += 1e-9;
            true
        }
        None => false,
    };
    expect(&shoulder, 5000, "input.shoulder")?;
    let plan = |input: &mut proact_types::TickInput| {
        let Some(point) = input.plan.as_mut().and_then(|plan| plan.trajectory.points.last_mut()) else {
            return false;
        };
        point.q[3] += 1e-9;
        true
    };
    expect(&plan, 1, "input.plan")
}

// Catches a digest that leaves the configuration out, and a replay that ends early unnoticed.
#[test]
fn another_configuration_and_a_shorter_trial_are_told_apart() -> Outcome {
    let config = config("D", 15.0);
    let (_, run) = trial(config.clone())?;
    let found = |config: &TrialConfig, inputs: &[_]| -> Outcome<_> {
        Ok(first_divergence(&run.spans, &replayed(config, inputs)?).ok_or("goes unnoticed")?)
    };
    let relabelled = TrialConfig { gesture_source: "buttons".to_owned(), ..config.clone() };
    assert_eq!(found(&relabelled, &run.inputs)?.fields, ["configuration"]);
    let mut narrower = config.clone();
    narrower.intent.gaze_sigma *= 0.5;
    assert_eq!(found(&narrower, &run.inputs)?.fields.first().map(String::as_str), Some("intent.posterior"));
    let short = found(&config, &run.inputs[..14_000])?;
    assert_eq!((short.from, short.fields), (SimTime(14_001), vec!["length".to_owned()]));
    Ok(())
}
