//! Recordings are judged by every command that trains on them, tests with them or feeds them.
// The program is started.
#![allow(clippy::disallowed_methods, clippy::unwrap_used)]

use serde_json::Value;
use std::{
    fs,
    path::{Path, PathBuf},
    process::{Command, Output},
};

fn proact(words: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_proact")).args(words).output().unwrap()
}

fn shared() -> Option<PathBuf> {
    let beside = || PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../../shared");
    let shared = std::env::var_os("PROACT_SHARED").map_or_else(beside, PathBuf::from);
    if !shared.join("data/repros/emg").is_dir() {
        println!("skipped: ../shared not found");
        return None;
    }
    Some(shared.join("data"))
}

/// Every command on the recordings in `dir` at 200 Hz.
fn commands(dir: &Path, out: &Path) -> Vec<Vec<String>> {
    let (dir, model) = (dir.display().to_string(), out.join("model.json").display().to_string());
    let source = format!("file:{dir}");
    let words = |text: &str| text.split(' ').map(str::to_owned).collect::<Vec<_>>();
    vec![
        words(&format!("emg evaluate --json --emg-rate 200 --data {dir}")),
        words(&format!("emg features --json --emg-rate 200 --data {dir}")),
        words(&format!("emg select --json --emg-rate 200 --max-features 1 --features MAV,ZC --data {dir}")),
        words(&format!(
            "emg train --json --emg-rate 200 --max-rounds 3 --replace --source {source} --out {model}"
        )),
        words(&format!("demo --json --headless --no-record --time-limit 1 --emg-rate 200 --emg {dir}")),
    ]
}

fn object(output: &Output) -> Value {
    let text = String::from_utf8_lossy(&output.stdout);
    serde_json::from_str(text.trim()).unwrap_or_else(|error| panic!("{error}: {output:?}"))
}

/// Noise with time stamps gave 57 %, a copied repetition 100 %, without a word.
#[test]
fn each_command_refuses_recordings_that_make_an_accuracy_wrong_and_records_what_is_accepted() {
    let Some(data) = shared() else { return };
    let out = tempfile::tempdir().unwrap();
    for (name, kind, expected_text) in [
        ("stamped_noise", "time_stamps", "channel 0 only rises"),
        ("copied_repetition", "shared", "600 samples in common with repetition 0"),
    ] {
        for command in commands(&data.join("repros/emg").join(name), out.path()) {
            let words: Vec<&str> = command.iter().map(String::as_str).collect();
            let refused = proact(&words);
            let error = String::from_utf8_lossy(&refused.stderr).into_owned();
            assert!(!refused.status.success(), "{words:?}: {refused:?}");
            assert!(error.contains(expected_text) && error.contains("--accept-faults"), "{words:?}: {error}");
            assert!(error.contains("_C_0.csv"), "{words:?}: {error}");
            assert_eq!(object(&refused)["findings"][0]["fault"], kind, "{words:?}");
            assert!(!out.path().join("model.json").exists());

            let accepted = proact(&[&words[..], &["--accept-faults"]].concat());
            let answer = object(&accepted);
            assert_eq!(answer["findings"][0]["fault"], kind, "{words:?}");
            let recorded = answer["accepted_faults"][0].as_str().unwrap_or_default();
            assert!(recorded.contains(expected_text), "{words:?}: {answer}");
            let model = out.path().join("model.json");
            if words[1] == "train" {
                assert!(fs::read_to_string(&model).unwrap().contains(expected_text));
                fs::remove_file(&model).unwrap();
            }
        }
    }
}

#[test]
fn good_recordings_are_used_without_a_word() {
    let Some(data) = shared() else { return };
    let dir = data.join("emg/libemg_tests_myo");
    let output = proact(&["emg", "evaluate", "--json", "--data", dir.to_str().unwrap()]);
    let (answer, error) = (object(&output), String::from_utf8_lossy(&output.stderr).into_owned());
    assert_eq!(
        (&answer["findings"], &answer["accepted_faults"]),
        (&Value::Array(vec![]), &Value::Array(vec![]))
    );
    assert!(output.status.success() && error.is_empty(), "{error}");
}

/// A record that was made with accepted faults says so.
#[test]
fn a_trial_keeps_what_was_accepted_in_its_configuration() {
    let Some(data) = shared() else { return };
    let out = tempfile::tempdir().unwrap();
    let (dir, trial) = (data.join("repros/emg/stamped_noise"), out.path().join("trial"));
    let words = ["demo", "--headless", "--time-limit", "1", "--emg-rate", "200", "--accept-faults", "--emg"];
    let output = proact(&[&words[..], &[dir.to_str().unwrap(), "--out", trial.to_str().unwrap()]].concat());
    let config =
        fs::read_to_string(trial.join("config.toml")).unwrap_or_else(|error| panic!("{error}: {output:?}"));
    assert!(config.contains("emg_accepted_faults") && config.contains("channel 0 only rises"), "{config}");
}

/// A real repetition that was copied into the test data at another speed, backwards and with noise was tested as a new one.
#[test]
fn an_altered_copy_of_a_real_repetition_is_refused_with_both_names() {
    let Some(data) = shared() else { return };
    let out = tempfile::tempdir().unwrap();
    for entry in fs::read_dir(data.join("emg/libemg_tests_myo")).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        if name.starts_with("R_") && !name.starts_with("R_3") {
            fs::copy(&path, out.path().join(name)).unwrap();
        }
    }
    let text = fs::read_to_string(out.path().join("R_0_C_4_EMG.csv")).unwrap();
    let rows: Vec<Vec<f64>> =
        text.lines().map(|line| line.split(',').map(|cell| cell.trim().parse().unwrap()).collect()).collect();
    let row = |k: usize| -> String {
        let source_row = (rows.len() - 1) as f64 - 1.03 * k as f64;
        let (before, share) = (&rows[source_row as usize], source_row.fract());
        let after = &rows[(source_row as usize + 1).min(rows.len() - 1)];
        let noise = |c: usize| ((7 * k + 13 * c) % 5) as f64 - 2.0;
        let cells = (0..8)
            .map(|c| (0.8 * (before[c] + share * (after[c] - before[c])) + noise(c)).round().to_string());
        cells.collect::<Vec<_>>().join(",")
    };
    let copy: Vec<String> = (0..(rows.len() as f64 / 1.03) as usize).map(row).collect();
    fs::write(out.path().join("R_2_C_4_EMG.csv"), copy.join("\n") + "\n").unwrap();
    let output = proact(&["emg", "evaluate", "--json", "--data", out.path().to_str().unwrap()]);
    let answer = object(&output);
    assert!(!output.status.success(), "{answer}");
    let finding = &answer["findings"][0];
    assert_eq!(
        (&finding["fault"], &finding["backwards"]),
        (&"altered_copy".into(), &true.into()),
        "{answer}"
    );
    assert_eq!(finding["files"], serde_json::json!(["R_0_C_4_EMG.csv", "R_2_C_4_EMG.csv"]));
}
