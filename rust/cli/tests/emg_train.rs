//! Calibration and pass tests end to end: simulated people, the simulated armband, recordings.
#![allow(clippy::unwrap_used, clippy::disallowed_methods)] // A test of programs starts programs.

mod common;

use common::{Running, proact};
use serde_json::Value;
use std::{
    io::{BufRead, BufReader},
    path::Path,
    process::{Output, Stdio},
};

/// The one object on standard output, and whether the command succeeded.
fn result(words: &[&str]) -> (Value, Output) {
    let output = proact(words).output().unwrap();
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    let object = serde_json::from_str(&text).unwrap_or_else(|e| panic!("{text:?}: {e}\n{}", error(&output)));
    (object, output)
}

fn error(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

fn refused(words: &[&str]) -> String {
    let output = proact(words).output().unwrap();
    assert!(!output.status.success() && output.stdout.is_empty(), "{:?}", output);
    error(&output)
}

/// A model of the generator, trained flat out, with its recordings.
fn trained(dir: &Path) -> (String, String) {
    let at = |name: &str| dir.join(name).to_str().unwrap().to_owned();
    let (model, recordings) = (at("model.json"), at("recordings"));
    let (object, output) =
        result(&["train", "--source", "synthetic", "--flat-out", "--out", &model, "--save", &recordings]);
    assert!(output.status.success(), "{}", error(&output));
    assert_eq!(
        (&object["good_enough"], &object["rounds"], &object["refused"]),
        (&true.into(), &2.into(), &0.into())
    );
    (model, recordings)
}

#[test]
fn the_simulated_person_follows_the_prompts_over_the_armbands_protocol() {
    let mut child =
        proact(&["simulate", "--port", "0", "--seconds", "90"]).stdout(Stdio::piped()).spawn().unwrap();
    let mut line = String::new();
    BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
    let _running = Running(child);
    let opened: Value = serde_json::from_str(&line).unwrap();
    let source = format!("gforce-sim://{}", opened["address"].as_str().unwrap());
    let dir = tempfile::tempdir().unwrap();
    let model = dir.path().join("model.json");
    let model = model.to_str().unwrap();
    let (object, output) =
        result(&["train", "--source", &source, "--out", model, "--secs", "0.6", "--prepare", "0.6"]);
    assert!(output.status.success(), "{}", error(&output));
    assert!(object["accuracy"].as_f64().unwrap() > 0.9, "{object}");
    // Raw codes: the zero level was found at rest.
    let centring: Vec<f64> =
        object["centring"].as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect();
    assert!(centring.len() == 8 && centring.iter().all(|level| (level - 128.0).abs() <= 1.0), "{centring:?}");
    // The model knows raw codes, so it refuses a stream that is centred already, and says why.
    let error = refused(&["test", "--model", model, "--source", "synthetic", "--flat-out"]);
    assert!(error.contains("rests at") && error.contains("centring differs"), "{error}");
}

#[test]
fn a_trained_model_passes_the_tests_and_a_cursor_reaches_its_targets() {
    let dir = tempfile::tempdir().unwrap();
    let (model, recordings) = trained(dir.path());
    let words = [
        "test",
        "--model",
        &model,
        "--source",
        "synthetic",
        "--flat-out",
        "--tests",
        "sequence,trial,cursor",
    ];
    let (object, output) = result(&words);
    assert!(output.status.success(), "{}", error(&output));
    assert_eq!(object["sequence"]["in_a_row"], 3);
    assert!(object["trial"]["accuracy"].as_f64().unwrap() > 0.9, "{}", object["trial"]);
    let cursor = &object["cursor"];
    let number = |name: &str| cursor[name].as_f64().unwrap();
    assert_eq!(cursor["movements"].as_array().unwrap().len(), 27);
    assert!(number("completion_rate") > 0.7 && number("path_efficiency") > 0.5, "{cursor}");
    assert!(number("throughput_bits_per_s") > number("throughput_with_dwell_bits_per_s"));

    // Off unless asked for; then the longer trial teaches the model, and the old file stays as it is.
    assert_eq!(object.get("adaptation"), None);
    let (before, adapted) = (std::fs::read_to_string(&model).unwrap(), dir.path().join("adapted.json"));
    let words =
        ["test", "--model", &model, "--source", "synthetic", "--flat-out", "--tests", "trial", "--adapt"];
    let words = [&words[..], &[adapted.to_str().unwrap()]].concat();
    let (object, output) = result(&words);
    assert!(output.status.success(), "{}", error(&output));
    let adaptation = &object["adaptation"];
    assert!(adaptation["windows"].as_u64() > Some(100), "{adaptation}");
    assert!((0.001..1.0).contains(&adaptation["drift"].as_f64().unwrap()), "{adaptation}");
    assert_eq!(std::fs::read_to_string(&model).unwrap(), before);
    let learnt = proact_emg::EmgModel::from_json(&std::fs::read_to_string(&adapted).unwrap()).unwrap();
    assert_ne!(learnt.classifier, proact_emg::EmgModel::from_json(&before).unwrap().classifier);
    assert!(refused(&words).contains("is there already"));

    // What was saved is what LibEMG writes, and trains the same model again.
    let again = dir.path().join("again.json");
    let source = format!("file:{recordings}");
    let (from_files, output) = result(&["train", "--source", &source, "--out", again.to_str().unwrap()]);
    assert!(output.status.success(), "{}", error(&output));
    assert_eq!(from_files["accuracy"], object_of(&model, &dir)["accuracy"]);
    assert_eq!(std::fs::read_to_string(&again).unwrap(), std::fs::read_to_string(&model).unwrap());
}

/// Trains again as [`trained`], for its report.
fn object_of(model: &str, dir: &tempfile::TempDir) -> Value {
    let copy = dir.path().join("copy.json");
    let (object, _) =
        result(&["train", "--source", "synthetic", "--flat-out", "--out", copy.to_str().unwrap()]);
    assert_eq!(std::fs::read_to_string(&copy).unwrap(), std::fs::read_to_string(model).unwrap());
    object
}

#[test]
fn a_person_whose_gestures_are_others_fails_and_the_model_is_still_written() {
    let dir = tempfile::tempdir().unwrap();
    let (model, recordings) = trained(dir.path());
    // The files of two gestures change places: the person opens the hand when asked to close it.
    let file = |rep: u32, class: u32| Path::new(&recordings).join(format!("R_{rep}_C_{class}.csv"));
    for rep in 0..2 {
        let keep = dir.path().join("keep");
        std::fs::rename(file(rep, 0), &keep).unwrap();
        std::fs::rename(file(rep, 1), file(rep, 0)).unwrap();
        std::fs::rename(&keep, file(rep, 1)).unwrap();
    }
    let person = format!("person:{recordings}");
    let (object, output) = result(&[
        "test",
        "--model",
        &model,
        "--source",
        &person,
        "--rep",
        "1",
        "--flat-out",
        "--attempts",
        "4",
    ]);
    assert!(
        !output.status.success() && error(&output).contains("not passed: sequence, trial"),
        "{}",
        error(&output)
    );
    assert_eq!(object["passed"], false);
    assert_eq!(object["sequence"]["mistakes"].as_array().unwrap().len(), 4);
    assert!(object["trial"]["accuracy"].as_f64().unwrap() < 0.75, "{}", object["trial"]);

    // One repetition changed back makes the rounds disagree.
    let keep = dir.path().join("keep");
    std::fs::rename(file(0, 0), &keep).unwrap();
    std::fs::rename(file(0, 1), file(0, 0)).unwrap();
    std::fs::rename(&keep, file(0, 1)).unwrap();
    let out = dir.path().join("poor.json");
    let source = format!("file:{recordings}");
    let (object, output) = result(&["train", "--source", &source, "--out", out.to_str().unwrap()]);
    assert!(!output.status.success() && error(&output).contains("not good enough"), "{}", error(&output));
    assert_eq!(object["good_enough"], false);
    let outliers = object["repetitions"].as_array().unwrap().iter().filter(|r| r["outlier"] == true);
    assert_eq!(outliers.count(), 4, "{object}");
    assert!(out.exists(), "nothing that somebody held gestures for is lost");
}

#[test]
fn a_dead_channel_is_never_trained_on() {
    let dir = tempfile::tempdir().unwrap();
    let (_, recordings) = trained(dir.path());
    for entry in std::fs::read_dir(&recordings).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_some_and(|e| e == "csv") {
            let text = std::fs::read_to_string(&path).unwrap();
            let dead = |line: &str| format!("3,{}\n", line.split_once(',').unwrap().1);
            std::fs::write(&path, text.lines().map(dead).collect::<String>()).unwrap();
        }
    }
    let (out, person) = (dir.path().join("dead.json"), format!("person:{recordings}"));
    let error = refused(&[
        "train",
        "--source",
        &person,
        "--rep",
        "0",
        "--flat-out",
        "--patience",
        "0.1",
        "--out",
        out.to_str().unwrap(),
        "--secs",
        "1",
        "--prepare",
        "1",
    ]);
    assert!(error.contains("channel 0 is red (flat: a dead channel)"), "{error}");
    assert!(!out.exists());
}

#[test]
fn a_turned_band_is_found_before_training_and_the_earlier_model_can_be_rolled_to_it() {
    let dir = tempfile::tempdir().unwrap();
    let (model, recordings) = trained(dir.path());
    let out = dir.path().join("turned.json");
    let out = out.to_str().unwrap();
    let source = format!("file:{recordings}");
    let (object, output) = result(&["train", "--source", &source, "--check", &model, "--out", out]);
    assert!(output.status.success(), "{}", error(&output));
    assert_eq!(object["band"]["proposal"], "keep");
    for entry in std::fs::read_dir(&recordings).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_some_and(|e| e == "csv") {
            let text = std::fs::read_to_string(&path).unwrap();
            let turned = |line: &str| {
                let mut values: Vec<&str> = line.split(',').collect();
                values.rotate_right(3);
                values.join(",") + "\n"
            };
            std::fs::write(&path, text.lines().map(turned).collect::<String>()).unwrap();
        }
    }
    let error_text = refused(&["train", "--source", &source, "--check", &model, "--out", out, "--replace"]);
    assert!(error_text.contains("turned by 3 channels"), "{error_text}");
    let (object, output) = result(&[
        "train",
        "--source",
        &source,
        "--check",
        &model,
        "--out",
        out,
        "--replace",
        "--accept-roll",
    ]);
    assert!(output.status.success(), "{}", error(&output));
    assert_eq!(object["band"]["proposal"]["roll"], 3);
    let person = format!("person:{recordings}");
    let (object, output) = result(&["test", "--model", out, "--source", &person, "--rep", "1", "--flat-out"]);
    assert!(output.status.success() && object["passed"] == true, "{}", error(&output));
    let (_, output) = result(&["test", "--model", &model, "--source", &person, "--rep", "1", "--flat-out"]);
    assert!(!output.status.success(), "the model as it was does not know the turned band");
}

#[test]
fn what_cannot_be_trained_on_is_refused_before_anybody_holds_a_gesture() {
    let dir = tempfile::tempdir().unwrap();
    let taken = dir.path().join("taken.json");
    std::fs::write(&taken, "{}").unwrap();
    let taken = taken.to_str().unwrap();
    assert!(refused(&["train", "--source", "synthetic", "--out", taken]).contains("--replace"));
    let out = dir.path().join("m.json");
    let out = out.to_str().unwrap();
    let full = dir.path().to_str().unwrap();
    assert!(refused(&["train", "--source", "synthetic", "--out", out, "--save", full]).contains("not empty"));
    assert!(refused(&["train", "--source", "keys", "--out", out]).contains("keys are no person"));
    assert!(refused(&["train", "--source", "libemg-udp:0", "--out", out]).contains("classes, not samples"));
    assert!(
        refused(&["train", "--source", &format!("file:{taken}"), "--out", out]).contains("name a folder")
    );
    assert!(refused(&["train", "--source", "synthetic", "--out", out, "--target", "2"]).contains("0 to 1"));
    assert!(
        refused(&["train", "--source", "synthetic", "--out", out, "--patience", "NaN"])
            .contains("--patience")
    );
    assert!(refused(&["test", "--source", "synthetic", "--model", taken]).contains("taken.json"));
    assert!(
        refused(&["test", "--source", "synthetic", "--model", "/nowhere.json"]).contains("proact emg train")
    );
    assert_eq!(std::fs::read_to_string(taken).unwrap(), "{}");
}
