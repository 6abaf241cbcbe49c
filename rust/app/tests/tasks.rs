//! Every task with every method: it runs to a result, its record opens and replays, also where the task is a lab's own.
#![allow(clippy::disallowed_methods, clippy::unwrap_used)] // A test of files.

use proact_app::{Arm, Recorder, ReplayOptions, replay_trial, trial};
use proact_control::MethodRegistry;
use proact_devices::EmgOrigin;
use proact_tasks::{SHIPPED, TaskChoice};
use proact_testbed::{Setup, TrialConfig, TrialResult};
use std::{fs, path::Path};

const EXAMPLE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/tasks/three_cubes.toml");

/// Records a trial of `task` and gives its result.
fn record(task: TaskChoice, method: &str, limit_secs: f64, dir: &Path) -> TrialResult {
    let config = TrialConfig::new(method, 1, Setup::named("still").unwrap());
    let mut config = config.with_task(task).unwrap();
    config.limit_secs = limit_secs;
    let arm = Arm::of(&config).unwrap();
    let assembled =
        trial::simulated_with(&MethodRegistry::standard(), &arm, config, &EmgOrigin::Synthetic, None)
            .unwrap();
    let trial::Assembly { mut session, classifier, arm, .. } = assembled;
    let used = session.testbed().config().clone();
    let mut recorder = Recorder::create(dir, &used, &arm, classifier.as_ref()).unwrap();
    loop {
        let step = session.step(false).unwrap();
        recorder.write(&step, session.testbed().plant().state()).unwrap();
        if step.output.finished {
            break;
        }
    }
    let result = session.result();
    recorder.finish(&result).unwrap();
    result
}

#[test]
fn every_task_runs_with_every_method_and_replays() {
    let place = tempfile::tempdir().unwrap();
    for (task, _) in SHIPPED {
        for method in ["A", "B", "C", "D"] {
            let dir = place.path().join(format!("{task}_{method}"));
            // Beyond the practice of the box-and-blocks test.
            let result = record(TaskChoice::named(task, 1).unwrap(), method, 17.0, &dir);
            assert_eq!((result.task.as_str(), result.sim_seconds), (task, 17.0));
            assert!(
                !result.score_name.is_empty() && !result.arm_hash.is_empty() && !result.result.is_empty()
            );
            assert_eq!(result.beside.contains_key("arrangement"), task == "modified_bbt", "{task}");
            let replayed = replay_trial(&dir, ReplayOptions::default()).unwrap();
            assert!(replayed.agrees, "{task}, {method}: {replayed:?}");
        }
    }
}

#[test]
fn a_labs_own_task_is_in_its_record_and_another_text_of_its_name_is_refused() {
    let place = tempfile::tempdir().unwrap();
    let dir = place.path().join("trial");
    let text = fs::read_to_string(EXAMPLE).unwrap();
    let result = record(TaskChoice::from_text(text.clone()).unwrap(), "D", 45.0, &dir);
    assert!(result.score >= 1.0, "a cube of 5 cm is brought across within 45 s: {result:?}");
    assert_eq!(result.result["objects"], 3);
    assert!(replay_trial(&dir, ReplayOptions::default()).unwrap().agrees);

    let config = fs::read_to_string(dir.join("config.toml")).unwrap();
    let mut config = TrialConfig::from_toml(&config).unwrap();
    config.task.text = Some(text.replace("mass = 0.08", "mass = 0.09"));
    let arm = Arm::of(&config).unwrap();
    let error = trial::replayed(&MethodRegistry::standard(), &arm, config, None).err().unwrap().to_string();
    assert!(error.contains("task \"three_cubes\" is another one here"), "{error}");
}
