//! Methods in another process that fail, as demo, simulate and compare report them.
#![allow(clippy::disallowed_methods, clippy::unwrap_used)] // A test of files and processes.

use serde_json::Value;
use std::{
    fs,
    path::Path,
    process::{Command, Output},
};

/// A method file in `dir` whose program answers every step with the shell command `answer`.
fn method(dir: &Path, name: &str, answer: &str) -> String {
    let program = format!("while read line; do {answer}; done");
    let file = format!(
        "name = \"{name}\"\ntitle = \"{name}\"\nstyle = \"jogging\"\ncommand = [\"sh\", \"-c\", {program:?}]\n"
    );
    let path = dir.join(format!("{name}.toml"));
    fs::write(&path, file).unwrap();
    path.display().to_string()
}

fn proact(dir: &Path, words: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_proact")).args(words).current_dir(dir).output().unwrap()
}

fn texts(output: &Output) -> (Value, String) {
    let error = String::from_utf8_lossy(&output.stderr).into_owned();
    let json = serde_json::from_slice(&output.stdout).unwrap_or_else(|e| panic!("{e}: {error}"));
    (json, error)
}

/// It exited with 0 and a score of 0, and standard error was empty.
#[test]
fn a_demo_whose_method_fails_or_never_acts_exits_with_an_error_and_says_why() {
    let place = tempfile::tempdir().unwrap();
    let broken = method(place.path(), "broken", "echo nonsense");
    let idle = method(place.path(), "idle", r#"t=${line#*\"time\":}; echo "{\"time\":${t%%,*}}""#);
    let missing = method(place.path(), "missing", "true").replace("missing.toml", "gone.toml");
    let text = fs::read_to_string(place.path().join("missing.toml")).unwrap();
    fs::write(&missing, text.replace("\"sh\"", "\"proact-no-such-program\"")).unwrap();
    for (file, ended, reason) in [
        (&broken, "failed", "answered \"nonsense\""),
        (&idle, "task", "commanded neither the arm nor the hand nor the planner"),
        (&missing, "failed", "proact-no-such-program"),
    ] {
        let output = proact(
            place.path(),
            &["demo", "--headless", "--no-record", "--json", "--set", "limit_secs=0.5", "--method", file],
        );
        let (result, error) = texts(&output);
        assert_eq!(
            (output.status.code(), result["ended"].as_str()),
            (Some(1), Some(ended)),
            "{file}: {error}"
        );
        assert!(error.contains(reason), "{file}: {error}");
        assert!(result["trial_faults"].to_string().contains(&reason.replace('"', "\\\"")), "{result}");
    }
}

/// They listed it with the score 0.
#[test]
fn simulate_and_compare_list_a_method_that_fails_as_failed_and_not_with_a_score() {
    let place = tempfile::tempdir().unwrap();
    let broken = method(place.path(), "broken", "exit 3");
    let methods = format!("A,{broken}");
    let output = proact(
        place.path(),
        &["simulate", "--methods", &methods, "--seeds", "2", "--limit", "0.5", "--out", "batch", "--json"],
    );
    let (batch, error) = texts(&output);
    let (good, bad) = (&batch["methods"]["A"], &batch["methods"]["broken"]);
    assert_eq!((good["trials"].as_u64(), good.get("failed")), (Some(2), None), "{batch}");
    assert_eq!((bad["trials"].as_u64(), bad["failed"].as_u64(), bad.get("mean")), (Some(0), Some(2), None));
    assert!(bad["failure"].as_str().unwrap().contains("exit status: 3"), "{batch}");
    assert!(error.contains("broken: 2 of 2 trials failed"), "{error}");
    assert_eq!(output.status.code(), Some(1), "all trials of a method failed");
    let read = |name: &str| fs::read_to_string(place.path().join("batch").join(name)).unwrap();
    let faults: Vec<String> =
        read("faults.csv").lines().filter(|row| row.contains("broken")).map(str::to_owned).collect();
    assert_eq!(
        faults.iter().filter(|row| row.contains("stopped") && row.contains("exit status: 3")).count(),
        2
    );
    assert!(!read("blocks.csv").contains("broken") && !read("measures.csv").contains("broken"));
    for line in read("trials.jsonl").lines().filter(|line| line.contains("\"broken\"")) {
        let line: Value = serde_json::from_str(line).unwrap();
        assert_eq!((&line["score"], line["ended"].as_str()), (&Value::Null, Some("failed")), "{line}");
    }

    let output = proact(
        place.path(),
        &["compare", "A", "C", &broken, "--participants", "2", "--limit", "0.5", "--out", "board", "--json"],
    );
    let (board, error) = texts(&output);
    let leaders: Vec<&str> =
        board["leaders"].as_array().unwrap().iter().map(|own| own["method"].as_str().unwrap()).collect();
    assert!(leaders.len() == 2 && !leaders.contains(&"broken"), "{leaders:?}");
    assert_eq!(
        (board["failed"][0]["method"].as_str(), board["failed"][0]["trials"].as_u64()),
        (Some("broken"), Some(2))
    );
    assert!(error.contains("broken: 2 of 2 trials failed"), "{error}");
}
