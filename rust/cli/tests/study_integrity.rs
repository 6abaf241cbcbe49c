//! What does not belong to a study, or says what nobody knows, is refused by name instead of left out of its tables.
#![allow(clippy::disallowed_methods)] // A test of files and processes.
#![allow(clippy::unwrap_used)]

use std::{
    fs,
    path::Path,
    process::{Command, Output},
};

/// Two conditions of one method, so that nothing but its place tells one record from the other.
const PLAN: &str = r#"
name = "short"
participants = 1
[trial]
limit_secs = 0.3
[[conditions]]
name = "first"
trial = { method = "A" }
[[conditions]]
name = "second"
trial = { method = "A" }
[order]
by = "williams"
[arrangements]
by = "balanced"
[[sessions]]
name = "1"
trials = 2
"#;
const ONE: &str = "trials/participant1-modefirst-trial1";

fn proact(dir: &Path, words: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_proact")).args(words).current_dir(dir).output().unwrap()
}

fn refusal(dir: &Path, words: &[&str]) -> String {
    let output = proact(dir, words);
    assert!(!output.status.success(), "{words:?} is refused: {}", String::from_utf8_lossy(&output.stdout));
    String::from_utf8(output.stderr).unwrap()
}

/// A simulated study in `dir/study`.
fn study(dir: &Path) {
    fs::create_dir(dir.join("study")).unwrap();
    fs::write(dir.join("study/plan.toml"), PLAN).unwrap();
    let run = proact(dir, &["study", "run", "study", "--simulated", "--json"]);
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
}

const TABLES: [&[&str]; 2] = [&["study", "export", "study"], &["analyze", "study", "--out", "report"]];

fn exchange(one: &Path, other: &Path) {
    let aside = one.with_extension("aside");
    fs::rename(one, &aside).unwrap();
    fs::rename(other, one).unwrap();
    fs::rename(&aside, other).unwrap();
}

/// Writes hashes of the files of a record that was edited, as whoever edits one could.
fn seal(dir: &Path) {
    let mut names: Vec<String> = fs::read_dir(dir)
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .filter(|name| name != "SHA256SUMS")
        .collect();
    names.sort();
    let sums = Command::new("sha256sum").args(&names).current_dir(dir).output().unwrap();
    assert!(sums.status.success());
    fs::write(dir.join("SHA256SUMS"), sums.stdout).unwrap();
}

// Catches two exchanged folders, which came out as wrong tables without a word.
#[test]
fn a_record_in_the_folder_of_another_trial_is_refused_by_name() {
    let place = tempfile::tempdir().unwrap();
    let dir = place.path();
    study(dir);
    let whole = proact(dir, TABLES[0]);
    assert!(whole.status.success(), "{}", String::from_utf8_lossy(&whole.stderr));
    let others = ["trials/participant1-modefirst-trial2", "trials/participant1-modesecond-trial1"];
    for other in others {
        let folders = [ONE, other].map(|name| dir.join("study").join(name));
        exchange(&folders[0], &folders[1]);
        for words in [TABLES[0], TABLES[1], &["study", "archive", "study", "--out", "study.zip"]] {
            let error = refusal(dir, words);
            assert!(error.contains("participant1-mode"), "{error}");
            assert!(error.contains("is not that of its place in the study"), "{error}");
        }
        assert!(!dir.join("study.zip").exists());
        exchange(&folders[0], &folders[1]);
    }
    // The same trial of another study of this plan: place and seed agree, the digest does not.
    let folder = dir.join("study").join(ONE);
    let config = folder.join("digests.log");
    let result = fs::read_to_string(folder.join("result.json")).unwrap();
    let digest =
        serde_json::from_str::<serde_json::Value>(&result).unwrap()["digest"].as_str().unwrap().to_owned();
    let mut journal = rusqlite::Connection::open(dir.join("study/study.sqlite")).unwrap();
    let transaction = journal.transaction().unwrap();
    let changed = transaction
        .execute("UPDATE journal SET event = replace(event, ?1, ?2)", [&digest, &"0".repeat(64)])
        .unwrap();
    transaction.commit().unwrap();
    assert!(changed > 0 && config.is_file(), "the journal has the digest");
    let error = refusal(dir, TABLES[0]);
    assert!(error.contains(&digest) && error.contains(ONE), "{error}");
}

// Catches a result whose key was renamed: its column came out empty.
#[test]
fn a_result_with_a_renamed_key_or_outcome_is_refused_with_its_name() {
    let place = tempfile::tempdir().unwrap();
    let dir = place.path();
    study(dir);
    let folder = dir.join("study").join(ONE);
    let file = folder.join("result.json");
    let original = fs::read_to_string(&file).unwrap();
    let renamed = [
        ("\"outcomes\"", "\"fates\""),
        ("\"outcome\"", "\"fate\""),
        ("\"pick_s\"", "\"pick_secs\""),
        ("\"not_attempted\"", "\"not_tried\""),
        ("\"score\"", "\"points\""),
        ("\"unsolved_ticks\"", "\"unsolved\""),
    ];
    for (k, (from, to)) in renamed.into_iter().enumerate() {
        assert!(original.contains(from), "{from}");
        fs::write(&file, original.replacen(from, to, 1)).unwrap();
        // With hashes made again, and without.
        if k % 2 == 0 {
            seal(&folder);
        }
        for words in TABLES {
            let error = refusal(dir, words);
            let named = error.contains(from.trim_matches('"')) || error.contains(to.trim_matches('"'));
            assert!(named && error.contains("result.json"), "{from}: {error}");
        }
        let alone = folder.display().to_string();
        assert!(refusal(dir, &["analyze", &alone, "--out", "alone"]).contains("result.json"), "{from}");
    }
}

#[test]
fn tables_with_an_unknown_column_outcome_or_number_are_refused_with_its_name() {
    let place = tempfile::tempdir().unwrap();
    let dir = place.path();
    study(dir);
    assert!(proact(dir, TABLES[0]).status.success());
    let tables = dir.join("study/tables");
    for (table, from, to) in [
        ("trials", "score_name", "score_title"),
        ("blocks", "not_attempted", "not_tried"),
        ("trials", ",0,blocks on target", ",none,blocks on target"),
    ] {
        let file = tables.join(format!("{table}.csv"));
        let original = fs::read_to_string(&file).unwrap();
        assert!(original.contains(from), "{from} in {original}");
        fs::write(&file, original.replacen(from, to, 1)).unwrap();
        let error = refusal(dir, &["analyze", "study/tables", "--out", "report"]);
        let name = to.split(',').nth(1).unwrap_or(to);
        assert!(error.contains(name) && error.contains(table), "{error}");
        fs::write(&file, original).unwrap();
    }
}
