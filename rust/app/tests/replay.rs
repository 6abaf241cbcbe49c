//! Determinism and replay on the real stack: KDL, OMPL, ODE, the classifier and the simulated participant.
//!
//! Trials here are cut short at 15 simulated seconds: long enough to select, plan, grasp and lift a block.
#![allow(clippy::disallowed_methods)] // A test of files and processes.

use proact_app::{Recorder, ReplayOptions, replay_trial, trial};
use proact_devices::EmgOrigin;
use proact_recording::{InputRecord, RECORD_FORMAT, TrialRecord, TrialWriter, read_result};
use proact_testbed::{Setup, SpanDigest, TrialConfig};
use proact_types::{SimTime, TickInput};
use std::{
    error::Error,
    fs,
    path::{Path, PathBuf},
};

fn replan() -> ReplayOptions {
    ReplayOptions { replan: true, ..ReplayOptions::default() }
}

const LIMIT_SECS: f64 = 15.0;

type Outcome<T = ()> = Result<T, Box<dyn Error>>;

fn config(seed: u64) -> Outcome<TrialConfig> {
    let config = TrialConfig::new("D", seed, Setup::named("seated")?);
    Ok(TrialConfig { limit_secs: LIMIT_SECS, ..config })
}

/// Runs a trial to its end without recording; its digest.
fn digest(seed: u64) -> Outcome<String> {
    let mut trial = trial::simulated_trial(config(seed)?, &EmgOrigin::Synthetic)?.trial;
    while !trial.step(false)?.output.finished {}
    Ok(trial.testbed().digest())
}

/// Records a trial into `dir`.
fn record(seed: u64, dir: &Path) -> Outcome {
    record_of(config(seed)?, dir)
}

/// Records the trial of `config` into `dir`.
fn record_of(config: TrialConfig, dir: &Path) -> Outcome {
    let trial::Assembly { mut trial, classifier, arm, plans, .. } =
        trial::simulated_trial(config, &EmgOrigin::Synthetic)?;
    let config = trial.testbed().config().clone();
    let mut recorder = Recorder::create(dir, &config, &arm, classifier.as_ref())?.with_plans(plans)?;
    loop {
        let step = trial.step(false)?;
        recorder.write(&step, trial.testbed().plant().state())?;
        if step.output.finished {
            recorder.finish(&trial.result())?;
            return Ok(());
        }
    }
}

/// A copy of the trial in `from` whose inputs went through `change`.
fn altered(from: &Path, to: &Path, mut change: impl FnMut(SimTime, &mut TickInput)) -> Outcome {
    let original = TrialRecord::open(from)?;
    let mut writer = TrialWriter::create(to, original.header())?;
    let mut inputs = original.inputs()?.peekable();
    for span in original.digests::<SpanDigest>()? {
        while let Some(record) = inputs.next_if(|r| r.as_ref().is_ok_and(|r| r.tick < span.tick)) {
            let InputRecord { tick, mut input, .. } = record?;
            change(tick, &mut input);
            writer.write_input(tick, &input)?;
        }
        let mut last = TickInput::default();
        if let Some(record) = inputs.next_if(|r| r.as_ref().is_ok_and(|r| r.tick == span.tick)) {
            last = record?.input;
            change(span.tick, &mut last);
        }
        writer.write_input(span.tick, &last)?;
        writer.write_digest(&span)?;
    }
    writer.finish(original.end(), &read_result::<serde_json::Value>(from)?)?;
    Ok(())
}

#[test]
fn the_same_seed_gives_the_same_digest_alone_and_beside_another_trial_and_another_seed_another() -> Outcome {
    let alone = digest(1)?;
    let beside = |seed| std::thread::spawn(move || digest(seed).map_err(|e| e.to_string()));
    let (first, second) = (beside(1), beside(2));
    let join = |thread: std::thread::JoinHandle<Result<String, String>>| {
        thread.join().map_err(|_| "a trial panicked")?.map_err(Box::<dyn Error>::from)
    };
    let (first, second) = (join(first)?, join(second)?);
    assert_eq!(first, alone, "the neighbour must not be felt");
    assert_ne!(second, alone);
    Ok(())
}

#[test]
fn a_recorded_trial_replays_to_the_same_digest() -> Outcome {
    let temp_dir = tempfile::tempdir()?;
    let dir = temp_dir.path().join("trial");
    record(3, &dir)?;
    let replayed = replay_trial(&dir, ReplayOptions::default())?;
    assert!(replayed.agrees && replayed.finished, "{replayed:?}");
    assert_eq!(replayed.spans, (LIMIT_SECS * 10.0) as usize);
    assert_eq!(replayed.digest, replayed.recorded);
    Ok(())
}

#[test]
fn a_trial_in_the_engine_ode_is_recorded_as_such_and_replays_in_it() -> Outcome {
    let temp_dir = tempfile::tempdir()?;
    let dir = temp_dir.path().join("trial");
    record_of(config(3)?.with_overrides(&["physics.engine=ode"])?, &dir)?;
    assert!(fs::read_to_string(dir.join("config.toml"))?.contains("engine = \"ode\""));
    let replayed = replay_trial(&dir, ReplayOptions::default())?;
    assert!(replayed.agrees && replayed.finished, "{replayed:?}");
    let other = temp_dir.path().join("other");
    record(3, &other)?;
    assert_ne!(
        replay_trial(&other, ReplayOptions::default())?.digest,
        replayed.digest,
        "the other engine moves otherwise"
    );
    Ok(())
}

#[test]
fn planning_again_gives_the_recorded_plans_and_notices_a_changed_one() -> Outcome {
    let temp_dir = tempfile::tempdir()?;
    let dir = temp_dir.path().join("trial");
    record(3, &dir)?;
    let again = replay_trial(&dir, replan())?;
    assert!(again.agrees, "{again:?}");
    let plans = again.replan_result.ok_or("it was asked for")?;
    assert!(plans.equal > 0 && plans.different.is_empty(), "{plans:?}");
    // What each took stands beside the record.
    let log = fs::read_to_string(dir.join("plans.jsonl"))?;
    assert!(log.lines().count() >= plans.equal, "{log}");
    let mut kept = 0;
    for line in log.lines() {
        let effort: serde_json::Value = serde_json::from_str(line)?;
        assert!(effort["wall_secs"].as_f64().is_some_and(|secs| secs > 0.0), "{effort}");
        assert_eq!(effort["timed_out"], false, "a batch is bounded by iterations: {effort}");
        // What was not found keeps none.
        kept += usize::from(effort["clearance"].as_f64().is_some_and(|meters| meters >= 0.0));
    }
    assert!(kept >= plans.equal, "each plan says what room it keeps: {log}");

    let changed = temp_dir.path().join("changed");
    let mut first = None;
    altered(&dir, &changed, |_, input| {
        if let (None, Some(plan)) = (first, &mut input.plan)
            && let Some(point) = plan.trajectory.points.get_mut(1)
        {
            point.q[0] = point.q[0].next_up();
            first = Some(plan.id);
        }
    })?;
    let different = replay_trial(&changed, replan())?.replan_result.ok_or("it was asked for")?.different;
    assert_eq!(different.first().copied(), first, "{different:?}");
    Ok(())
}

#[test]
fn a_changed_input_is_reported_with_its_span_and_its_stage() -> Outcome {
    let temp_dir = tempfile::tempdir()?;
    let dir = temp_dir.path().join("trial");
    record(3, &dir)?;

    // One EMG count at 2.345 s, by the smallest amount that a number can change.
    let changed = temp_dir.path().join("emg");
    let mut touched = false;
    altered(&dir, &changed, |tick, input| {
        if tick.0 >= 2345
            && !touched
            && let Some(sample) = input.emg.first_mut()
        {
            sample.channels[0] = sample.channels[0].next_up();
            touched = true;
        }
    })?;
    let divergence = replay_trial(&changed, ReplayOptions::default())?
        .divergence
        .ok_or("a changed input must be noticed")?;
    assert_eq!((divergence.from, divergence.to), (SimTime(2301), SimTime(2400)));
    assert_eq!(divergence.fields.first().map(String::as_str), Some("input.emg"));

    // A plan that arrives bent: found by the plan itself and by everything that follows from it.
    let changed = temp_dir.path().join("plan");
    let mut planned_at = None;
    altered(&dir, &changed, |tick, input| {
        if planned_at.is_none()
            && let Some(plan) = &mut input.plan
            && let Some(point) = plan.trajectory.points.last_mut()
        {
            point.q[3] += 0.01;
            planned_at = Some(tick);
        }
    })?;
    let planned_at = planned_at.ok_or("the trial has a plan")?;
    let divergence = replay_trial(&changed, ReplayOptions::default())?
        .divergence
        .ok_or("a changed plan must be noticed")?;
    assert!(
        (divergence.from..=divergence.to).contains(&planned_at),
        "{divergence:?}, plan at {planned_at:?}"
    );
    assert!(divergence.fields.contains(&"input.plan".to_owned()), "{divergence:?}");
    Ok(())
}

#[test]
fn a_damaged_log_another_format_and_a_lost_classifier_are_each_told() -> Outcome {
    let temp_dir = tempfile::tempdir()?;
    let dir = temp_dir.path().join("trial");
    record(3, &dir)?;
    let log: PathBuf = dir.join("inputs.log");
    let intact = fs::read(&log)?;

    let offset = intact.len() / 2;
    let mut damaged = intact.clone();
    damaged[offset] ^= 0x10;
    fs::write(&log, &damaged)?;
    let error =
        replay_trial(&dir, ReplayOptions::default()).expect_err("a damaged log must not pass").to_string();
    let reported: usize = error
        .split(|c: char| !c.is_ascii_digit())
        .filter_map(|word| word.parse().ok())
        .find(|&at: &usize| at <= offset && offset - at < 10_000)
        .ok_or_else(|| format!("no offset near {offset} in: {error}"))?;
    assert!(reported <= offset, "{error}");

    // A record of an earlier format says which program replays it.
    let mut earlier = intact.clone();
    earlier[8..12].copy_from_slice(&2_u32.to_le_bytes());
    fs::write(&log, &earlier)?;
    let error =
        replay_trial(&dir, ReplayOptions::default()).expect_err("another format must not pass").to_string();
    let here = format!("replays format {RECORD_FORMAT}");
    for part in ["record of format 2", &here, "proact 0.1.0 at commit"] {
        assert!(error.contains(part), "{error}");
    }

    fs::write(&log, &intact)?;
    fs::remove_file(dir.join("classifier.json"))?;
    let error = replay_trial(&dir, ReplayOptions::default())
        .expect_err("without its classifier a trial cannot be recomputed");
    assert!(error.to_string().contains("classifier.json"), "{error}");
    Ok(())
}
