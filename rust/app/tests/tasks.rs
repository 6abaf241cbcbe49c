//! Every task with every method: it runs to a result, its record opens and replays, also where the task is a lab's own.
#![allow(clippy::disallowed_methods, clippy::unwrap_used)] // A test of files.

use proact_app::{
    Arm, Recorder, ReplayOptions, analysis::collect_analysis_data, replay_trial, settle_heap, trial,
};
use proact_control::MethodRegistry;
use proact_devices::EmgOrigin;
use proact_tasks::{BUILT_IN_TASKS, TaskSpec};
use proact_testbed::{Setup, TrialConfig, TrialResult};
use proact_types::EventKind;
use std::{fs, path::Path};

const EXAMPLE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/tasks/three_cubes.toml");

/// Records a trial of `task` and gives its result.
fn record(task: TaskSpec, method: &str, limit_secs: f64, dir: &Path) -> TrialResult {
    let config = TrialConfig::new(method, 1, Setup::named("still").unwrap());
    let mut config = config.with_task(task).unwrap();
    config.limit_secs = limit_secs;
    let arm = Arm::from_config(&config).unwrap();
    settle_heap(&mut config, arm.model()).unwrap();
    let assembled = trial::simulated_trial_with_model(
        &MethodRegistry::standard(),
        &arm,
        config,
        &EmgOrigin::Synthetic,
        None,
    )
    .unwrap();
    let trial::Assembly { mut trial, classifier, arm, .. } = assembled;
    let used = trial.testbed().config().clone();
    let mut recorder = Recorder::create(dir, &used, &arm, classifier.as_ref()).unwrap();
    loop {
        let step = trial.step(false).unwrap();
        recorder.write(&step, trial.testbed().plant().state()).unwrap();
        if step.output.finished {
            break;
        }
    }
    let result = trial.result();
    recorder.finish(&result).unwrap();
    result
}

#[test]
fn every_task_runs_with_every_method_and_replays() {
    let temp_dir = tempfile::tempdir().unwrap();
    for (task, _) in BUILT_IN_TASKS {
        for method in ["A", "B", "C", "D"] {
            let dir = temp_dir.path().join(format!("{task}_{method}"));
            // Beyond the practice of the box-and-blocks test.
            let result = record(TaskSpec::named(task, 1).unwrap(), method, 17.0, &dir);
            assert_eq!((result.task.as_str(), result.sim_seconds), (task, 17.0));
            assert!(
                !result.score_name.is_empty() && !result.arm_hash.is_empty() && !result.result.is_empty()
            );
            assert_eq!(result.legacy_fields.contains_key("arrangement"), task == "modified_bbt", "{task}");
            let replayed = replay_trial(&dir, ReplayOptions::default()).unwrap();
            assert!(replayed.agrees, "{task}, {method}: {replayed:?}");
        }
    }
}

#[test]
fn a_labs_own_task_is_in_its_record_and_another_text_of_its_name_is_refused() {
    let temp_dir = tempfile::tempdir().unwrap();
    let dir = temp_dir.path().join("trial");
    let text = fs::read_to_string(EXAMPLE).unwrap();
    let result = record(TaskSpec::from_text(text.clone()).unwrap(), "D", 45.0, &dir);
    assert!(result.score >= 1.0, "a cube of 5 cm is brought across within 45 s: {result:?}");
    assert_eq!(result.result["objects"], 3);
    assert!(replay_trial(&dir, ReplayOptions::default()).unwrap().agrees);

    let config = fs::read_to_string(dir.join("config.toml")).unwrap();
    let mut config = TrialConfig::from_toml(&config).unwrap();
    config.task.text = Some(text.replace("mass = 0.08", "mass = 0.09"));
    let arm = Arm::from_config(&config).unwrap();
    let error =
        trial::replay_testbed(&MethodRegistry::standard(), &arm, config, None).err().unwrap().to_string();
    assert!(error.contains("task \"three_cubes\" is another one here"), "{error}");
}

/// Task, method, limit of the trial, what its score must be, and what `proact analyze` must say of it: column, least and most.
type Done = (&'static str, &'static str, f64, f64, &'static [(&'static str, f64, f64)]);

const DONE: [Done; 6] = [
    ("pasta_box", "D", 120.0, 3.0, &[("moves_done", 3.0, 3.0), ("task_s", 20.0, 120.0), ("drops", 0.0, 0.0)]),
    ("cup_transfer", "D", 160.0, 4.0, &[("moves_done", 4.0, 4.0), ("wrong_objects", 0.0, 0.0)]),
    ("clothespins", "D", 100.0, 4.0, &[("moves_done", 4.0, 4.0), ("on_floor", 0.0, 0.0)]),
    ("frame_transfer", "D", 240.0, 6.0, &[("moves_done", 6.0, 6.0), ("shoulder_path_m", 0.0, 2.0)]),
    (
        "target_achievement",
        "A",
        200.0,
        8.0,
        &[("completion_rate", 1.0, 1.0), ("completion_s", 2.0, 20.0), ("goal_path_efficiency", 0.5, 1.0)],
    ),
    (
        "reaching",
        "B",
        200.0,
        14.0,
        &[
            ("throughput_bits_per_s", 0.2, 0.8),
            ("effective_throughput_bits_per_s", 0.2, 1.2),
            ("completion_rate", 1.0, 1.0),
        ],
    ),
];

#[test]
fn simulated_people_do_the_tasks_and_their_records_replay_and_are_analysed() {
    let temp_dir = tempfile::tempdir().unwrap();
    for (task, method, limit_secs, score, _) in DONE {
        let dir = temp_dir.path().join(task);
        let result = record(TaskSpec::named(task, 1).unwrap(), method, limit_secs, &dir);
        assert_eq!(result.score, score, "{task}: {result:?}");
        let replayed = replay_trial(&dir, ReplayOptions::default()).unwrap();
        assert!(replayed.agrees, "{task}: {replayed:?}");
    }
    let collected =
        collect_analysis_data(&MethodRegistry::standard(), temp_dir.path(), 2, &|_, _| ()).unwrap();
    assert_eq!(collected.notes, Vec::<String>::new());
    let (trials, measures) = (collected.table("trials").unwrap(), collected.table("measures").unwrap());
    let mut seen = 0;
    for (trial, row) in trials.rows.iter().zip(&measures.rows) {
        let name = trials.text(trial, "task");
        let (task, .., expected) = DONE.iter().find(|(task, ..)| *task == name).unwrap();
        for (column, min, max) in *expected {
            let got = measures.number(row, column).unwrap_or_else(|| panic!("{task} has no {column}"));
            assert!((*min..=*max).contains(&got), "{task}: {column} is {got}, expected {min} to {max}");
        }
        seen += 1;
    }
    assert_eq!(seen, DONE.len());
    // The measures of each movement, as the transfers of a box have them in the literature.
    let phases = collected.table("phases").unwrap();
    let of_box: Vec<_> = phases.rows.iter().filter(|row| phases.text(row, "block") == "pasta_box").collect();
    assert_eq!(of_box.len(), 6, "three transfers: a reach and a transport each");
    for row in of_box {
        for column in [
            "seconds",
            "hand_path_m",
            "peak_speed_m_per_s",
            "peak_time",
            "peak_deceleration_time",
            "peak_aperture_mm",
            "peak_aperture_time",
            "movement_units",
        ] {
            assert!(phases.number(row, column).is_some(), "{column}");
        }
    }
}

/// The heap of a trial's seed: the same each time, another one for another seed, within its compartment, and at rest in the trial.
#[test]
fn a_heap_falls_as_the_seed_says_and_lies_still_when_the_trial_begins() {
    let fallen = |seed: u64| {
        let task = TaskSpec::named("bbt_heap", seed).unwrap();
        let config = TrialConfig::new("D", seed, Setup::named("still").unwrap());
        let mut config = config.with_task(task).unwrap();
        config.task.heap = Some(proact_tasks::HeapSpec { count: Some(40), ..Default::default() });
        let arm = Arm::from_config(&config).unwrap();
        settle_heap(&mut config, arm.model()).unwrap();
        config
    };
    let (config, again, other) = (fallen(1), fallen(1), fallen(2));
    (3..8).for_each(|seed| drop(fallen(seed)));
    let lies = |config: &TrialConfig| config.task.heap.clone().unwrap().resting_poses;
    assert_eq!(lies(&config), lies(&again));
    assert_ne!(lies(&config), lies(&other));
    // As it stands in the record.
    let read = TrialConfig::from_toml(&config.to_toml().unwrap()).unwrap();
    assert_eq!(lies(&read), lies(&config));
    let scene = config.build_task(Arm::from_config(&config).unwrap().model()).unwrap().scene().clone();
    assert_eq!(scene.objects.len(), 40);
    let mut trial = trial::simulated_trial(config, &EmgOrigin::Synthetic).unwrap().trial;
    for _ in 0..2000 {
        trial.step(false).unwrap();
    }
    for (object, body) in scene.objects.iter().zip(&trial.testbed().plant().state().objects) {
        let moved = (object.pose.translation.vector - body.pose.translation.vector).norm();
        assert!(moved < 1e-3, "{} moved by {moved} m", object.name);
        let at = body.pose.translation.vector;
        assert!(at.y < 0.0 && at.y > -0.27 && at.x.abs() < 0.13 && at.z > 1.02 && at.z < 1.12, "{at}");
    }
}

/// A cube that lies across where few are left is put above the heap by the rules, and falls onto it.
#[test]
fn objects_that_are_refilled_fall_in_the_physics_and_the_trial_replays() {
    let temp_dir = tempfile::tempdir().unwrap();
    let text = include_str!("../../tasks/data/bbt_heap.toml")
        .replace("name = \"bbt_heap\"\n", "name = \"two\"\nrefill_below = 2\n")
        .replace("count = 150", "count = 2\nlies = [[0.0, -0.1, 1.0275, 0.0, 0.0, 0.0, 1.0], [0.0, 0.03, 1.0275, 0.0, 0.0, 0.0, 1.0]]");
    let task = TaskSpec::from_text(text).unwrap();
    let config = TrialConfig::new("A", 1, Setup::named("still").unwrap()).with_task(task.clone()).unwrap();
    let mut trial = trial::simulated_trial(config, &EmgOrigin::Synthetic).unwrap().trial;
    let at = |trial: &proact_testbed::RunningTrial| {
        trial.testbed().plant().state().objects[1].pose.translation.vector
    };
    let first = trial.step(false).unwrap();
    assert!(first.output.events.iter().any(|event| event.kind == EventKind::ObjectsRefilled { count: 1 }));
    let above = at(&trial);
    assert!(above.y < 0.0 && above.z > 1.06, "{above}");
    for _ in 0..1500 {
        trial.step(false).unwrap();
    }
    let fallen = at(&trial);
    assert!(fallen.y < 0.0 && fallen.z > 1.015 && fallen.z < above.z - 0.01, "from {above} to {fallen}");
    let dir = temp_dir.path().join("trial");
    record(task, "A", 17.0, &dir);
    assert!(replay_trial(&dir, ReplayOptions::default()).unwrap().agrees);
}
