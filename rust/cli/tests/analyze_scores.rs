//! What `analyze` reports of a record, of its bag alone, of a bag that breaks off, and of numbers that cannot be.
#![allow(clippy::disallowed_methods)] // A test of files and processes.
#![allow(clippy::unwrap_used)]

use serde_json::Value;
use std::{collections::BTreeMap, fs, path::Path, process::Command};

type Row = BTreeMap<String, String>;

#[track_caller]
fn proact(words: &[&str]) -> Vec<u8> {
    let output = Command::new(env!("CARGO_BIN_EXE_proact")).args(words).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    output.stdout
}

fn analyze(dir: &Path, out: &Path) -> Value {
    let words = ["analyze", dir.to_str().unwrap(), "--out", out.to_str().unwrap(), "--json"];
    serde_json::from_slice(&proact(&words)).unwrap()
}

fn rows(out: &Path, table: &str) -> Vec<Row> {
    let mut reader = csv::Reader::from_path(out.join(format!("{table}.csv"))).unwrap();
    reader.deserialize().map(|row| row.unwrap()).collect()
}

fn number(row: &Row, column: &str) -> f64 {
    row[column].parse().unwrap_or_else(|_| panic!("{column}: {row:?}"))
}

/// Caught: from its bag the first pick had a shoulder sum of 1.898 m, a peak speed of 30.5 m/s and 29 movement units, and a cut bag
/// had the score 0.
#[test]
fn a_record_and_its_bag_have_the_motion_that_happened_and_a_cut_bag_is_marked_in_every_table() {
    let temp_dir = tempfile::tempdir().unwrap();
    let trial = temp_dir.path().join("trial");
    let demo = ["demo", "--headless", "--method", "C", "--seed", "3", "--out", trial.to_str().unwrap()];
    proact(&demo);
    let bags = temp_dir.path().join("bags");
    fs::create_dir(&bags).unwrap();
    fs::copy(trial.join("trial.bag"), bags.join("participant1-mode3-trial1.bag")).unwrap();
    for (dir, flaw) in [(&trial, ""), (&bags, "bag_only")] {
        let out = temp_dir.path().join(format!("report{flaw}"));
        let answer = analyze(dir, &out);
        assert_eq!(answer["faults"], serde_json::json!([]), "{answer}");
        let pick = &rows(&out.join("data"), "phases")[0];
        assert_eq!(pick["flaw"], flaw);
        assert!((number(pick, "shoulder_sum10_m") - 0.323).abs() < 0.002, "{pick:?}");
        assert!((number(pick, "hand_path_m") - 1.042).abs() < 0.005, "{pick:?}");
        assert!((1.0..=5.0).contains(&number(pick, "movement_units")), "{pick:?}");
        assert!(number(pick, "peak_speed_m_per_s") < 1.5, "{pick:?}");
    }

    let cut = temp_dir.path().join("cut");
    fs::create_dir(&cut).unwrap();
    let bytes = fs::read(trial.join("trial.bag")).unwrap();
    fs::write(cut.join("x.bag"), &bytes[..bytes.len() * 3 / 5]).unwrap();
    let out = temp_dir.path().join("of_cut");
    let answer = analyze(&cut, &out);
    assert!(answer["notes"].to_string().contains("cut off at byte"), "{answer}");
    for table in ["trials", "blocks", "measures", "objects", "phases"] {
        let rows = rows(&out.join("data"), table);
        assert!(!rows.is_empty(), "{table}");
        assert!(rows.iter().all(|row| row["flaw"] == "cut,bag_only"), "{table}: {rows:?}");
    }
    assert!(rows(&out.join("data"), "faults").iter().all(|row| row["flaw"] == "cut,bag_only"));
    let trial = &rows(&out.join("data"), "trials")[0];
    assert_eq!(
        (trial["score"].as_str(), trial["mark"].as_str()),
        ("", "*"),
        "no score of a trial whose end is missing"
    );
    assert!(rows(&out.join("data"), "blocks").iter().all(|row| row["outcome"].is_empty()));
    assert_eq!(rows(&out.join("tables"), "trials")[0]["mark"], "* cut,bag_only");
    let page = fs::read_to_string(out.join("report.html")).unwrap();
    let captions = page.matches("Records with a flaw, see data/trials.csv").count();
    assert!(captions >= 3, "in the caption of every table: {captions}");
}

#[test]
fn a_value_that_no_arm_or_person_can_produce_is_a_fault_of_the_report_with_record_phase_value_and_limit() {
    let temp_dir = tempfile::tempdir().unwrap();
    let dir = temp_dir.path().join("tables");
    fs::create_dir(&dir).unwrap();
    let key = "participant,id,session,condition,trial";
    fs::write(
        dir.join("trials.csv"),
        format!("{key},score,record\n1,,1,C,1,4,trials/one\n1,,1,D,1,4,trials/two\n"),
    )
    .unwrap();
    let phases = format!(
        "{key},phase,block,time,seconds,peak_speed_m_per_s,shoulder_range_mm\n1,,1,C,1,pick,red 1,1,9.1,30.5,309\n\
         1,,1,D,1,pick,red 1,1,9.1,0.7,309\n"
    );
    fs::write(dir.join("phases.csv"), phases).unwrap();
    let out = temp_dir.path().join("report");
    let answer = analyze(&dir, &out);
    let faults = answer["faults"].as_array().unwrap();
    assert_eq!(faults.len(), 1, "{answer}");
    let fault = |key: &str| &faults[0][key];
    assert_eq!(
        (fault("record"), fault("phase")),
        (&Value::from("trials/one"), &Value::from("pick of red 1, time 1"))
    );
    assert_eq!(
        (fault("quantity"), fault("value"), fault("limit")),
        (&"peak_speed_m_per_s".into(), &30.5.into(), &6.0.into())
    );
    let note = answer["notes"][0].as_str().unwrap();
    for expected_text in ["Fault of this report", "trials/one", "pick of red 1", "30.500 m/s", "6 m/s"] {
        assert!(note.contains(expected_text), "{expected_text}: {note}");
    }
    assert!(fs::read_to_string(out.join("report.html")).unwrap().contains("Fault of this report"));
}
