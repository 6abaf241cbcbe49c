//! Records of trials that were broken off, and of finished ones whose files do not belong together, before replay and
//! analysis.
#![allow(clippy::disallowed_methods)] // A test of files.

use proact_app::{Recorder, ReplayOptions, ReplayResult, intent_scores, replay_trial, trial};
use proact_control::MethodRegistry;
use proact_devices::EmgOrigin;
use proact_recording::{DIGESTS_FILE, EVENTS_FILE, INPUTS_FILE, RESULT_FILE, TrialRecord, write_manifest};
use proact_testbed::{SPAN_TICKS, Setup, TrialConfig};
use std::{
    collections::BTreeMap,
    error::Error,
    fs,
    path::{Path, PathBuf},
};

/// Ticks of the trials here: the first pick falls into them.
const TICKS: u64 = 8250;

type Outcome<T = ()> = Result<T, Box<dyn Error>>;

/// Records the first `ticks` of a trial into `dir`; `close` brings it to an end, otherwise its process is killed.
fn record(seed: u64, dir: &Path, ticks: u64, close: bool) -> Outcome {
    let config = TrialConfig::new("D", seed, Setup::named("seated")?);
    let trial::Assembly { mut trial, classifier, arm, plans, .. } =
        trial::simulated_trial(config, &EmgOrigin::Synthetic)?;
    let config = trial.testbed().config().clone();
    let mut recorder = Recorder::create(dir, &config, &arm, classifier.as_ref())?.with_plans(plans)?;
    for tick in 1..=ticks {
        let step = trial.step(close && tick == ticks)?;
        recorder.write(&step, trial.testbed().plant().state())?;
    }
    match close {
        true => drop(recorder.finish(&trial.result())?),
        // A process that is killed runs no destructor: what is in memory is gone.
        false => std::mem::forget(recorder),
    }
    Ok(())
}

fn replay(dir: &Path) -> Outcome<ReplayResult> {
    replay_trial(dir, ReplayOptions::default())
}

fn copy(from: &Path, to: PathBuf) -> Outcome<PathBuf> {
    fs::create_dir(&to)?;
    for file in fs::read_dir(from)? {
        let file = file?;
        fs::copy(file.path(), to.join(file.file_name()))?;
    }
    Ok(to)
}

#[test]
fn a_killed_trial_is_replayed_and_analyzed_up_to_its_last_digest() -> Outcome {
    let temp_dir = tempfile::tempdir()?;
    let dir = temp_dir.path().join("trial");
    record(1, &dir, TICKS, false)?;
    let replayed = replay(&dir)?;
    assert!(replayed.agrees && !replayed.finished, "{replayed:?}");
    assert_eq!(replayed.spans as u64, TICKS / SPAN_TICKS);
    assert_eq!(replayed.seconds, (TICKS - TICKS % SPAN_TICKS) as f64 * 1e-3);
    let report = intent_scores::score_intent_models(&MethodRegistry::standard(), &dir, None, |_, _, _| {})?;
    assert_eq!((report.picks, report.skipped.len()), (1, 0), "{report}");
    assert_eq!(report.trials[0].interrupted_at_secs, Some(replayed.seconds));
    assert!(report.to_string().contains("interrupted"), "{report}");

    // Killed before anything was picked, and before anything happened.
    let early = copy(&dir, temp_dir.path().join("early"))?;
    let digests = fs::read_to_string(early.join(DIGESTS_FILE))?;
    fs::write(early.join(DIGESTS_FILE), digests.split_inclusive('\n').take(3).collect::<String>())?;
    assert_eq!(replay(&early)?.seconds, 0.3);
    assert_eq!(
        intent_scores::score_intent_models(&MethodRegistry::standard(), &early, None, |_, _, _| {})?.picks,
        0
    );
    fs::write(early.join(DIGESTS_FILE), "")?;
    for length in [fs::metadata(early.join(INPUTS_FILE))?.len(), 30] {
        fs::File::options().write(true).open(early.join(INPUTS_FILE))?.set_len(length)?;
        let replayed = replay(&early)?;
        assert!(replayed.agrees && !replayed.finished && replayed.seconds == 0.0, "{replayed:?}");
        let report =
            intent_scores::score_intent_models(&MethodRegistry::standard(), &early, None, |_, _, _| {})?;
        assert_eq!((report.never_started.len(), report.skipped.len()), (1, 0), "{report}");
    }
    Ok(())
}

/// A thousand cuts of each log. What is read depends on how many spans are whole, so each such number is replayed once.
#[test]
fn a_killed_trial_whose_logs_are_cut_anywhere_replays_to_its_end() -> Outcome {
    let temp_dir = tempfile::tempdir()?;
    let dir = temp_dir.path().join("trial");
    record(1, &dir, 3050, false)?;
    let whole = TrialRecord::open(&dir)?;
    let events = whole.events()?;
    let mut ends: BTreeMap<u64, PathBuf> = BTreeMap::new();
    for name in [INPUTS_FILE, DIGESTS_FILE, EVENTS_FILE] {
        let path = dir.join(name);
        let good = fs::read(&path)?;
        // The head of the inputs tells what the trial is; all else grows.
        let head = if name == INPUTS_FILE { 1500 } else { 0 };
        for k in 0..1000 {
            fs::write(&path, &good[..head + (good.len() - head) * k / 1000])?;
            let cut = TrialRecord::open(&dir).map_err(|e| format!("{name}, cut {k}: {e}"))?;
            let expected: Vec<_> = events.iter().filter(|e| e.time <= cut.end()).cloned().collect();
            assert_eq!(cut.events()?, expected, "{name}, cut {k}: every event that a digest counts is there");
            if !ends.contains_key(&cut.end().0) && ends.len() < 25 && k % 40 == 0 {
                ends.insert(cut.end().0, copy(&dir, temp_dir.path().join(cut.end().0.to_string()))?);
            }
        }
        fs::write(&path, good)?;
    }
    assert!(ends.len() > 20, "{}", ends.len());
    for (end, dir) in ends {
        let replayed = replay(&dir)?;
        assert!(replayed.agrees && !replayed.finished, "{end}: {replayed:?}");
        assert_eq!(replayed.seconds, end as f64 * 1e-3);
    }
    Ok(())
}

#[test]
fn a_result_of_another_trial_is_refused_by_replay_and_analysis_alike() -> Outcome {
    let temp_dir = tempfile::tempdir()?;
    let (one, other) = (temp_dir.path().join("one"), temp_dir.path().join("other"));
    record(1, &one, TICKS, true)?;
    record(2, &other, TICKS, true)?;
    assert!(replay(&one)?.finished && replay(&one)?.agrees);

    let mixed = copy(&one, temp_dir.path().join("mixed"))?;
    fs::copy(other.join(RESULT_FILE), mixed.join(RESULT_FILE))?;
    for (sealed, part) in [(false, "result.json has changed"), (true, "the logs beside it end at 8250 ms")] {
        if sealed {
            write_manifest(&mixed)?;
        }
        let error = replay(&mixed).expect_err("a result of another trial").to_string();
        assert!(error.contains(part), "{error}");
        let error =
            intent_scores::score_intent_models(&MethodRegistry::standard(), &mixed, None, |_, _, _| {})
                .expect_err("nothing else is there");
        assert!(error.to_string().contains(part), "{error}");
    }

    // What passed before there was a manifest: the head of the digests alone.
    let short = copy(&one, temp_dir.path().join("short"))?;
    let digests = fs::read_to_string(short.join(DIGESTS_FILE))?;
    fs::write(short.join(DIGESTS_FILE), digests.split_inclusive('\n').take(30).collect::<String>())?;
    let error = replay(&short).expect_err("30 of 83 digests").to_string();
    assert!(error.contains("is not as it was recorded"), "{error}");
    Ok(())
}
