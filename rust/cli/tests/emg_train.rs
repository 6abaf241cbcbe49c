//! Calibration and pass tests end to end: simulated people, the simulated armband, recordings.
#![allow(clippy::unwrap_used, clippy::disallowed_methods)] // A test of programs starts programs.

mod common;

use common::{Running, plain, proact};
use serde_json::Value;
use std::{
    io::{BufRead, BufReader},
    path::{Path, PathBuf},
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
    let answered = String::from_utf8_lossy(&output.stdout);
    assert!(!output.status.success(), "{output:?}");
    assert!(answered.is_empty() || answered.contains("\"findings\":["), "{output:?}");
    error(&output)
}

/// A model of the generator, trained flat out, with its recordings.
fn trained(dir: &Path) -> (String, String) {
    let at = |name: &str| dir.join(name).to_str().unwrap().to_owned();
    let (model, recordings) = (at("model.json"), at("recordings"));
    let (object, output) =
        result(&["train", "--source", "synthetic", "--no-realtime", "--out", &model, "--save", &recordings]);
    assert!(output.status.success(), "{}", error(&output));
    assert_eq!(
        (&object["good_enough"], &object["rounds"], &object["refused"]),
        (&true.into(), &2.into(), &0.into())
    );
    for name in ["confusion", "feature_space"] {
        let svg = std::fs::read_to_string(object["plots"][name].as_str().unwrap()).unwrap();
        assert_eq!(object["plots"][name], at(&format!("model.{name}.svg")));
        assert!(svg.starts_with("<svg ") && svg.contains("hand_close") && svg.contains("<desc>"), "{name}");
    }
    (model, recordings)
}

/// An armband over its protocol for a minute and a half, and its name as a source.
fn simulator() -> (Running, String) {
    let mut child =
        proact(&["simulate", "--port", "0", "--seconds", "90"]).stdout(Stdio::piped()).spawn().unwrap();
    let mut line = String::new();
    BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
    let opened: Value = serde_json::from_str(&line).unwrap();
    (Running(child), format!("gforce-sim://{}", opened["address"].as_str().unwrap()))
}

#[test]
fn the_simulated_person_follows_the_prompts_over_the_armbands_protocol() {
    let (_running, source) = simulator();
    let dir = tempfile::tempdir().unwrap();
    let model = dir.path().join("model.json");
    let model = model.to_str().unwrap();
    let (object, output) = result(&[
        "train",
        "--source",
        &source,
        "--out",
        model,
        "--repetition-seconds",
        "0.6",
        "--prepare-seconds",
        "0.6",
    ]);
    assert!(output.status.success(), "{}", error(&output));
    assert!(object["accuracy"].as_f64().unwrap() > 0.9, "{object}");
    // Raw codes: the zero level was found at rest.
    let dc_offset: Vec<f64> =
        object["centring"].as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect();
    assert!(
        dc_offset.len() == 8 && dc_offset.iter().all(|level| (level - 128.0).abs() <= 1.0),
        "{dc_offset:?}"
    );
    // The model knows raw codes, so it refuses a stream that is centred already, and says why.
    let error = refused(&["test", "--model", model, "--source", "synthetic", "--no-realtime"]);
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
        "--no-realtime",
        "--tests",
        "sequence,trial,motion,tac1,tac3,cursor",
    ];
    let (object, output) = result(&words);
    assert!(output.status.success(), "{}", error(&output));
    assert_eq!(object["sequence"]["in_a_row"], 3);
    assert!(object["trial"]["accuracy"].as_f64().unwrap() > 0.9, "{}", object["trial"]);
    let motion = &object["motion"];
    assert_eq!(motion["attempts"].as_array().unwrap().len(), 12, "four gestures, three times each");
    assert!(motion["completion_rate"].as_f64().unwrap() > 0.8, "{motion}");
    // The simulated person thinks of one joint at a time: of two together it brings half the targets home.
    for (name, targets, min_rate) in [("tac1", 4, 0.75), ("tac3", 2, 0.5)] {
        let report = &object[name];
        assert_eq!(report["trials"].as_array().unwrap().len(), targets, "{report}");
        assert!(report["completion_rate"].as_f64().unwrap() >= min_rate, "{report}");
    }
    let cursor = &object["cursor"];
    let number = |name: &str| cursor[name].as_f64().unwrap();
    assert_eq!(cursor["movements"].as_array().unwrap().len(), 27);
    assert!(number("completion_rate") > 0.7 && number("path_efficiency") > 0.5, "{cursor}");
    assert!(number("throughput_bits_per_s") > number("throughput_with_dwell_bits_per_s"));

    // Off unless asked for; then the longer trial teaches the model, and the old file stays as it is.
    assert_eq!(object.get("adaptation"), None);
    let (before, adapted) = (std::fs::read_to_string(&model).unwrap(), dir.path().join("adapted.json"));
    let words =
        ["test", "--model", &model, "--source", "synthetic", "--no-realtime", "--tests", "trial", "--adapt"];
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
        result(&["train", "--source", "synthetic", "--no-realtime", "--out", copy.to_str().unwrap()]);
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
        "--source-repetition",
        "1",
        "--no-realtime",
        "--max-sequences",
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
        "--source-repetition",
        "0",
        "--no-realtime",
        "--timeout",
        "0.1",
        "--out",
        out.to_str().unwrap(),
        "--repetition-seconds",
        "1",
        "--prepare-seconds",
        "1",
    ]);
    assert!(error.contains("channel 0 is red (flat: a dead channel)"), "{error}");
    assert!(!out.exists());
}

/// Files were trained on unseen: a dead channel of 0.9 accuracy, time stamps as a ninth muscle, one repetition three times.
#[test]
fn recordings_are_checked_like_a_live_band_and_judged_for_reading() {
    let dir = tempfile::tempdir().unwrap();
    let (_, recordings) = trained(dir.path());
    let good = Path::new(&recordings);
    let file = |folder: &Path, rep: u32, class: u32| folder.join(format!("R_{rep}_C_{class}.csv"));
    let (out, source) = (dir.path().join("m.json"), |folder: &Path| format!("file:{}", folder.display()));
    let spoilt = |name: &str, change: &dyn Fn(&Path)| {
        let folder = dir.path().join(name);
        std::fs::create_dir(&folder).unwrap();
        for entry in std::fs::read_dir(good).unwrap() {
            let path = entry.unwrap().path();
            std::fs::copy(&path, folder.join(path.file_name().unwrap())).unwrap();
        }
        change(&folder);
        folder
    };
    let each_row = |folder: &Path, change: &dyn Fn(usize, &str) -> String| {
        for (rep, class) in (0..2).flat_map(|rep| (0..5).map(move |class| (rep, class))) {
            let text = std::fs::read_to_string(file(folder, rep, class)).unwrap();
            let rows: String = text.lines().enumerate().map(|(k, row)| change(k, row) + "\n").collect();
            std::fs::write(file(folder, rep, class), rows).unwrap();
        }
    };
    let refusal =
        |folder: &Path| refused(&["train", "--source", &source(folder), "--out", out.to_str().unwrap()]);
    let first = |row: &str, value: String| format!("{value},{}", row.split_once(',').unwrap().1);
    let dead = spoilt("dead", &|f| each_row(f, &|_, row| first(row, "3".to_owned())));
    let why = refusal(&dead);
    assert!(why.contains("channel 0 is red (flat: a dead channel) in 10 of 10 recordings"), "{why}");
    assert!(!out.exists());
    let stamps =
        spoilt("stamps", &|f| each_row(f, &|k, row| first(row, format!("{}", 17.5 + 0.001 * k as f64))));
    let why = refusal(&stamps);
    assert!(why.contains("channel 0 only rises: a column of time stamps"), "{why}");
    let hum = |k: usize| 4000.0 * (0.1 * std::f64::consts::PI * k as f64).sin();
    let humming =
        spoilt("hum", &|f| each_row(f, &|k, row| first(row, format!("{}", hum(k) + (k % 3) as f64))));
    let why = refusal(&humming);
    assert!(why.contains("channel 0 is red (mains hum)"), "{why}");
    let copied = spoilt("copied", &|f| {
        std::fs::copy(file(f, 0, 1), file(f, 1, 1)).unwrap();
    });
    let why = refusal(&copied);
    assert!(
        why.contains("repetition 1 of hand_open has 3000 of its 3000 samples in common with repetition 0"),
        "{why}"
    );
    let incomplete =
        spoilt("lacking", &|f| (0..2).for_each(|rep| std::fs::remove_file(file(f, rep, 1)).unwrap()));
    let words = ["train", "--source", &source(&incomplete), "--out", out.to_str().unwrap()];
    let output = proact(&words).output().unwrap();
    assert!(error(&output).contains("no recording of hand_open"), "{}", error(&output));
    std::fs::remove_file(&out).unwrap();

    // Who knows what they do trains all the same, and good recordings end with what they are worth.
    let words = ["train", "--source", &source(&dead), "--accept-faults", "--out", out.to_str().unwrap()];
    let (object, output) = result(&words);
    assert!(output.status.success(), "{}", error(&output));
    assert_eq!(object["faults"][0]["finding"], "flat");
    std::fs::remove_file(&out).unwrap();
    let words = ["train", "--source", &source(good), "--out", out.to_str().unwrap()];
    let output = plain(&words).output().unwrap();
    let text = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{}", error(&output));
    assert!(text.contains("% of windows recognised, leaving one repetition out: good enough"), "{text}");
    assert!(["hand_close", "no_motion", "the model is in"].iter().all(|word| text.contains(word)), "{text}");
}

#[test]
fn a_turned_band_is_found_before_training_and_the_earlier_model_can_be_rolled_to_it() {
    let dir = tempfile::tempdir().unwrap();
    let (model, recordings) = trained(dir.path());
    let out = dir.path().join("turned.json");
    let out = out.to_str().unwrap();
    let source = format!("file:{recordings}");
    let (object, output) = result(&["train", "--source", &source, "--band-check", &model, "--out", out]);
    assert!(output.status.success(), "{}", error(&output));
    assert_eq!(object["band"]["proposal"], "keep");
    let change = |files: &dyn Fn(&str) -> bool, row: &dyn Fn(&mut Vec<&str>)| {
        for entry in std::fs::read_dir(&recordings).unwrap() {
            let path = entry.unwrap().path();
            let name = path.file_name().unwrap().to_str().unwrap();
            if name.ends_with(".csv") && files(name) {
                let text = std::fs::read_to_string(&path).unwrap();
                let changed = |line: &str| {
                    let mut values: Vec<&str> = line.split(',').collect();
                    row(&mut values);
                    values.join(",") + "\n"
                };
                std::fs::write(&path, text.lines().map(changed).collect::<String>()).unwrap();
            }
        }
    };
    let check = ["train", "--source", &source, "--band-check", &model, "--out", out, "--replace"];
    let accepted = [&check[..], &["--accept-rotation"]].concat();
    // Two electrodes that changed places are no turn, and no roll mends them.
    change(&|_| true, &|row| row.swap(1, 4));
    let error_text = refused(&accepted);
    assert!(error_text.contains("channels 1 and 4 have changed places"), "{error_text}");
    change(&|_| true, &|row| row.swap(1, 4));
    // What two gestures propose must be better on the others.
    let wrist = |name: &str| ["R_1_C_3.csv", "R_1_C_4.csv"].contains(&name);
    change(&wrist, &|row| row.rotate_right(3));
    let error_text = refused(&accepted);
    assert!(
        error_text.contains("not accepted") && error_text.contains("turned by 3 channels"),
        "{error_text}"
    );
    change(&wrist, &|row| row.rotate_left(3));
    change(&|_| true, &|row| row.rotate_right(3));
    let error_text = refused(&check);
    assert!(error_text.contains("turned by 3 channels"), "{error_text}");
    let (object, output) = result(&accepted);
    assert!(output.status.success(), "{}", error(&output));
    assert_eq!(object["band"]["proposal"]["roll"], 3);
    let person = format!("person:{recordings}");
    let live = [
        "train",
        "--source",
        &person,
        "--source-repetition",
        "1",
        "--no-realtime",
        "--repetition-seconds",
        "1",
        "--prepare-seconds",
        "1",
    ];
    let live =
        [&live[..], &["--band-check", &model, "--out", out, "--replace", "--accept-rotation"]].concat();
    let (object, output) = result(&live);
    assert!(output.status.success() && object["band"]["proposal"]["roll"] == 3, "{}", error(&output));
    let (object, output) =
        result(&["test", "--model", out, "--source", &person, "--source-repetition", "1", "--no-realtime"]);
    assert!(output.status.success() && object["passed"] == true, "{}", error(&output));
    let (_, output) = result(&[
        "test",
        "--model",
        &model,
        "--source",
        &person,
        "--source-repetition",
        "1",
        "--no-realtime",
    ]);
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
    assert!(
        refused(&["train", "--source", "synthetic", "--out", out, "--target-accuracy", "2"])
            .contains("0 to 1")
    );
    assert!(
        refused(&["train", "--source", "synthetic", "--out", out, "--timeout", "NaN"]).contains("--timeout")
    );
    assert!(refused(&["test", "--source", "synthetic", "--model", taken]).contains("taken.json"));
    assert!(
        refused(&["test", "--source", "synthetic", "--model", "/nowhere.json"]).contains("proact emg train")
    );
    assert_eq!(std::fs::read_to_string(taken).unwrap(), "{}");
}

/// Until then a person who had held forty gestures began anew after a power cut.
#[test]
fn a_calibration_that_was_killed_goes_on_with_the_repetition_at_which_it_stopped() {
    let (running, source) = simulator();
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("model.json");
    let words = |more: &[&'static str]| {
        let usual = [
            "train",
            "--source",
            &source,
            "--out",
            out.to_str().unwrap(),
            "--repetition-seconds",
            "0.6",
            "--prepare-seconds",
            "0.6",
            // How good the windows are is another test's question: a busy machine would ask for a third round.
            "--target-accuracy",
            "0",
        ];
        usual.iter().map(|w| (*w).to_owned()).chain(more.iter().map(|w| (*w).to_owned())).collect::<Vec<_>>()
    };
    let with = |words: &[String]| proact(&words.iter().map(String::as_str).collect::<Vec<_>>());
    let folder = dir.path().join("model.json.recordings");
    let kept = || -> Vec<(std::path::PathBuf, String)> {
        let Ok(entries) = std::fs::read_dir(&folder) else { return Vec::new() };
        let paths = entries.map(|entry| entry.unwrap().path());
        let mut kept: Vec<_> = paths
            .filter(|path| path.extension().is_some_and(|e| e == "csv"))
            .map(|path| (path.clone(), std::fs::read_to_string(path).unwrap()))
            .collect();
        kept.sort();
        kept
    };
    let mut child = Running(with(&words(&[])).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap());
    let begin = std::time::Instant::now();
    while kept().len() < 7 {
        assert!(begin.elapsed().as_secs() < 60, "{} repetitions after a minute", kept().len());
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    // As kill -9 does.
    child.0.kill().unwrap();
    child.0.wait().unwrap();
    let before = kept();
    assert!((7..10).contains(&before.len()), "{before:?}");

    let output = with(&words(&[])).output().unwrap();
    assert!(!output.status.success() && error(&output).contains("by --resume "), "{}", error(&output));
    let mut resume = words(&[]);
    resume.extend(["--resume".to_owned(), folder.to_str().unwrap().to_owned()]);
    let (object, output) = result(&resume.iter().map(String::as_str).collect::<Vec<_>>());
    assert!(output.status.success(), "{}", error(&output));
    assert_eq!(object["rounds"], 2, "{object}");
    let after = kept();
    assert_eq!(after.len(), 10);
    assert!(before.iter().all(|file| after.contains(file)), "what was kept is not recorded again");
    drop(running);
}

/// Strong people drive a converter of eight bits to its ends, and a second of one recording may hum. None of the public sets
/// is refused for that; whether a model is good enough to be used is judged afterwards, by its windows.
#[test]
fn real_recordings_of_people_are_trained_on() {
    let beside = || PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../../shared");
    let data = std::env::var_os("PROACT_SHARED").map_or_else(beside, PathBuf::from).join("data/emg");
    if !data.is_dir() {
        println!("skipped: ../shared not found");
        return;
    }
    let dir = tempfile::tempdir().unwrap();
    // Each was refused for what a few of its recordings have. The first is of somebody new to it: 79.5 % of its windows.
    for (set, good_enough) in
        [("libemg_tests_myo", false), ("myo_readings/21547-1", true), ("myo_readings/45612-1", true)]
    {
        let source = format!("file:{}", data.join(set).display());
        let out = dir.path().join("model.json");
        let output = proact(&["train", "--source", &source, "--out", out.to_str().unwrap(), "--replace"])
            .output()
            .unwrap();
        let message = error(&output);
        assert_eq!(output.status.success(), good_enough, "{set}: {message}");
        assert_eq!(message.contains("not good enough"), !good_enough, "{set}: {message}");
        std::fs::remove_file(&out).unwrap_or_else(|e| panic!("{set} left no model: {e}; {message}"));
    }
}
