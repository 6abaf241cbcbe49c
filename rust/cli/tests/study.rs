//! `proact study` at the command line.
#![allow(clippy::disallowed_methods)] // A test of files and processes.
#![allow(clippy::unwrap_used)]

use serde_json::Value;
use std::{
    fs,
    path::Path,
    process::{Command, Output},
};

fn proact(dir: &Path, words: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_proact")).args(words).current_dir(dir).output().unwrap()
}

fn answer(dir: &Path, words: &[&str]) -> String {
    let output = proact(dir, words);
    assert!(output.status.success(), "{words:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

fn refusal(dir: &Path, words: &[&str]) -> String {
    let output = proact(dir, words);
    assert!(!output.status.success() && output.stdout.is_empty(), "{words:?} is refused");
    let error = String::from_utf8(output.stderr).unwrap();
    assert_eq!(error.trim_end().lines().count(), 1, "one sentence: {error}");
    error
}

#[test]
fn a_new_study_is_called_as_its_folder_and_its_check_names_every_imbalance() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    for like in ["study1", "study2", "empty", "minivie", "vie", "armsym", "holopham", "virtual-bbt"] {
        let name = format!("my-{like}");
        answer(dir, &["study", "new", &name, "--template", like]);
        let report: Value = serde_json::from_str(&answer(dir, &["study", "check", &name, "--json"])).unwrap();
        assert_eq!(report["name"], name.as_str());
        let minutes = report["minutes_per_session"].as_object().unwrap();
        assert!(
            minutes.values().all(|minutes| (10.0..=120.0).contains(&minutes.as_f64().unwrap())),
            "{minutes:?}"
        );
        let text = answer(dir, &["study", "check", &name]);
        for imbalance in report["imbalances"].as_array().unwrap() {
            let (a, b) = (imbalance["factor_a"].as_str().unwrap(), imbalance["factor_b"].as_str().unwrap());
            assert!(imbalance["size"].as_u64().unwrap() > imbalance["possible"].as_u64().unwrap());
            assert!(text.contains(&format!("{a} by {b}")), "{a} by {b} is not in\n{text}");
        }
        // The schedule is a table with a row for each trial, whose arrangement has commas in it.
        let table = answer(dir, &["study", "check", &name, "--schedule"]);
        let mut rows = csv::Reader::from_reader(table.as_bytes());
        assert_eq!(rows.headers().unwrap().iter().next_back(), Some("seed"));
        assert_eq!(rows.records().map(Result::unwrap).count() as u64, report["trials"].as_u64().unwrap());
    }
    let error = refusal(dir, &["study", "new", "my-empty"]);
    assert!(error.contains("my-empty exists already"), "{error}");
    let error = refusal(dir, &["study", "new", "a plan"]);
    assert!(error.contains("name is \"a plan\", expected 1 to 64 letters"), "{error}");
    assert!(!dir.join("a plan").exists());
}

#[test]
fn conditions_of_armsym_become_a_plan_and_what_is_none_is_refused_by_its_file() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let condition = |mode: u32| {
        format!(
            r#"{{"Display_name":"Mode {mode}","controlmode":{mode},"trialswithquestionnaire":[2],"trialswithpause":[1],
            "numberoftrials":3,"triallength":60}}"#
        )
    };
    fs::write(dir.join("imitate.json"), condition(1)).unwrap();
    fs::write(dir.join("go_to.json"), condition(2)).unwrap();
    fs::write(dir.join("own.json"), condition(7)).unwrap();
    let words = ["study", "new", "mine", "--from-armsym", "imitate.json", "go_to.json"];
    let plan: Value = serde_json::from_str(&answer(dir, &[&words[..], &["--json"]].concat())).unwrap();
    assert_eq!(plan["left_out"], serde_json::json!([]));
    let report: Value = serde_json::from_str(&answer(dir, &["study", "check", "mine", "--json"])).unwrap();
    assert_eq!(report["conditions"], serde_json::json!(["imitate", "go_to"]));
    assert_eq!(report["trials"], 6 * 2 * 3);
    let error = refusal(dir, &["study", "new", "other", "--from-armsym", "own.json"]);
    assert!(error.contains("own.json: controlmode is 7, expected 0, 1 or 2"), "{error}");
    let error = refusal(dir, &["study", "new", "other", "--from-armsym", "nowhere.json"]);
    assert!(error.contains("nowhere.json"), "{error}");
    let error = refusal(dir, &["study", "new", "other", "--from-armsym", "mine/plan.toml"]);
    assert!(error.contains("the condition is unreadable"), "{error}");
    assert!(!dir.join("other").exists());
}

#[test]
fn a_plan_whose_trials_cannot_be_run_is_refused_by_file_and_condition() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    answer(dir, &["study", "new", "mine"]);
    let file = dir.join("mine/plan.toml");
    let plan = fs::read_to_string(&file).unwrap();
    let d = "trial = { method = \"D\" }";
    for (from, to, expected) in [
        (d, "trial = { method = \"Z\" }", "condition D: "),
        (d, "trial = { method = \"D\", arm = \"no_arm\" }", "condition D: "),
        (d, "trial = { method = \"D\", set = [\"profile.levle=shoulder\"] }", "condition D: "),
        (d, "trial = { method = \"D\", task = \"bbt\" }", "arrangements is given, expected nothing"),
        ("participants = 4", "participants = \"four\"", "participants"),
        (
            "{ do = \"demonstrate\", minutes = 5 }",
            "{ do = \"form\", form = \"mine\", minutes = 5 }",
            "asks for form \"mine\"",
        ),
    ] {
        fs::write(&file, plan.replace(from, to)).unwrap();
        let error = proact(dir, &["study", "check", "mine"]);
        assert!(!error.status.success());
        let error = String::from_utf8(error.stderr).unwrap();
        let file = if to.contains("form") { "mine/forms/mine.toml" } else { "mine/plan.toml" };
        assert!(error.contains(file) && error.contains(expected), "{to}: {error}");
        assert!(!error.contains("panicked"), "{error}");
    }
    // Another task without arrangements is fine where none are asked for.
    let other = plan.replace("modified_bbt", "bbt").replace("[arrangements]", "[ignored]");
    fs::write(
        &file,
        other.split("[ignored]").next().unwrap().to_owned() + "[[sessions]]\nname = \"1\"\ntrials = 1\n",
    )
    .unwrap();
    answer(dir, &["study", "check", "mine"]);
    let error = refusal(dir, &["study", "check", "nowhere"]);
    assert!(error.contains("nowhere"), "{error}");
}

/// The paper's table of success.
const EXPECTED: &str = "min_score = 0\nmax_score = 4\nscore_step = 1\n[conditions]\nA = { mean = 2.21, sd = 1.50 }\nB = { mean = 1.96, sd = 1.60 }\n\
                        C = { mean = 3.29, sd = 0.95 }\nD = { mean = 3.67, sd = 0.56 }\n";

#[test]
fn the_papers_eight_people_hardly_ever_tell_its_c_and_d_apart() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    answer(dir, &["study", "new", "replication", "--template", "study1"]);
    fs::write(dir.join("expected.toml"), EXPECTED).unwrap();
    let words = [
        "study",
        "power",
        "replication",
        "--effect",
        "expected.toml",
        "--participants",
        "8,24",
        "--runs",
        "500",
        "--json",
    ];
    let text = answer(dir, &words);
    assert_eq!(text, answer(dir, &words), "the same seed, the same power");
    let found: Value = serde_json::from_str(&text).unwrap();
    let share = |size: usize, a: &str, b: &str| {
        let pairs = found["power"][size]["pairs"].as_array().unwrap();
        let pair = pairs.iter().find(|pair| pair[0] == a && pair[1] == b).unwrap();
        pair[2]["share"].as_f64().unwrap()
    };
    assert_eq!(found["power"][0]["people"], 8);
    // Corrected for six pairs, all eight people must differ in one direction.
    assert!((0.3..0.6).contains(&share(0, "A", "D")) && share(0, "C", "D") < 0.1, "{found}");
    assert!(share(1, "A", "D") > 0.95 && share(1, "C", "D") > 0.6, "{found}");
    assert!(found["power"][0]["any"]["share"].as_f64().unwrap() > 0.95, "{found}");
    let figure =
        ["study", "power", "replication", "--effect", "expected.toml", "--runs", "50", "--figure", "curve"];
    let table = answer(dir, &figure);
    assert!(table.contains("A and D") && table.contains("C and D"), "{table}");
    assert!(fs::read(dir.join("curve.png")).unwrap().starts_with(b"\x89PNG"));
    assert!(fs::read_to_string(dir.join("curve.svg")).unwrap().contains("A and D"));
}

#[test]
fn a_power_that_cannot_be_had_is_refused_in_one_sentence() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    answer(dir, &["study", "new", "pilot", "--template", "empty"]);
    fs::write(dir.join("none.toml"), "[conditions]\nA = { mean = 1, sd = 1 }\n").unwrap();
    fs::write(dir.join("odd.toml"), "spread = 1\n[conditions]\n").unwrap();
    for (words, expected) in [
        (&["study", "power", "pilot", "--effect", "none.toml"][..], "nothing is said of condition"),
        (&["study", "power", "pilot", "--effect", "missing.toml"], "missing.toml"),
    ] {
        let error = refusal(dir, words);
        assert!(error.contains(expected), "{words:?}: {error}");
    }
    let output = proact(dir, &["study", "power", "pilot", "--pilot", "pilot"]);
    assert!(
        !output.status.success() && String::from_utf8_lossy(&output.stderr).contains("no finished trial")
    );
    let output = proact(dir, &["study", "power", "pilot", "--effect", "odd.toml"]);
    assert!(!output.status.success() && String::from_utf8_lossy(&output.stderr).contains("spread"));
}
