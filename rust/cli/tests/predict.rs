//! `proact participants predict` by chosen seeds.
#![allow(clippy::disallowed_methods, clippy::unwrap_used)] // A test of files and processes.

use serde_json::Value;
use std::{fs, path::Path, process::Command};

/// Two people by seed 5 without physics, in the folder `out`.
fn predict(dir: &Path, seeds: &str) -> Result<Value, String> {
    let words =
        ["--participants", "2", "--full-physics", "0", "--out", "out", "--json", "--master-seeds", seeds];
    let mut command = Command::new(env!("CARGO_BIN_EXE_proact"));
    let output = command.args(["participants", "predict"]).args(words).current_dir(dir).output().unwrap();
    let error = String::from_utf8_lossy(&output.stderr).into_owned();
    if output.status.success() { Ok(serde_json::from_slice(&output.stdout).unwrap()) } else { Err(error) }
}

#[test]
fn a_prediction_by_a_chosen_seed_is_that_of_its_study_and_is_not_run_again() {
    let temp_dir = tempfile::tempdir().unwrap();
    let found = predict(temp_dir.path(), "5").unwrap();
    assert_eq!(found["predictions"][0]["seeds"], serde_json::json!([5]), "{found}");
    // What counts is what was run: a changed study is another prediction.
    let path = temp_dir.path().join("out/study-5-2-kinematic.json");
    let mut study: Value = serde_json::from_str(&fs::read_to_string(&path).unwrap()).unwrap();
    let trials = study["trials"].as_array_mut().unwrap();
    assert_eq!(trials.len(), 24, "two people, four methods, three trials");
    for trial in trials.iter_mut().filter(|trial| trial[1] == "D") {
        trial[3] = serde_json::json!(0.0);
    }
    fs::write(&path, study.to_string()).unwrap();
    let changed = predict(temp_dir.path(), "5").unwrap();
    assert_ne!(changed["predictions"], found["predictions"]);
    let error = predict(temp_dir.path(), "five").unwrap_err();
    assert!(error.contains("five") && error.contains("--master-seeds"), "{error}");
}
