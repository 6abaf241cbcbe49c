//! What does not belong to a study, or says what nobody knows, is refused by name instead of left out of its tables.
#![allow(clippy::disallowed_methods)] // A test of files and processes.
#![allow(clippy::unwrap_used)]

mod common;

use common::in_folder::{answer, json, proact, refusal, table};
use std::{fs, path::Path, process::Command};

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

/// A simulated study in `dir/study`.
fn study(dir: &Path) {
    fs::create_dir(dir.join("study")).unwrap();
    fs::write(dir.join("study/plan.toml"), PLAN).unwrap();
    answer(dir, &["study", "run", "study", "--simulated", "--json"]);
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
    let temp_dir = tempfile::tempdir().unwrap();
    let dir = temp_dir.path();
    study(dir);
    answer(dir, TABLES[0]);
    let others = ["trials/participant1-modefirst-trial2", "trials/participant1-modesecond-trial1"];
    for other in others {
        let folders = [ONE, other].map(|name| dir.join("study").join(name));
        exchange(&folders[0], &folders[1]);
        for words in [TABLES[0], TABLES[1], &["study", "archive", "study", "--out", "study.zip"]] {
            let error = refusal(dir, words);
            assert!(error.contains("participant1-mode"), "{error}");
            assert!(error.contains("is not that of its place in the study"), "{error}");
            // What differs, and nothing else.
            let (what, others) = match other.ends_with("trial2") {
                true => ("its trial is ", ["its participant", "its session", "its condition"]),
                false => ("its condition is \"", ["its participant", "its session", "its trial"]),
            };
            assert!(error.contains(what), "{error}");
            assert!(others.iter().all(|other| !error.contains(other)), "{error}");
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
    let temp_dir = tempfile::tempdir().unwrap();
    let dir = temp_dir.path();
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
    let temp_dir = tempfile::tempdir().unwrap();
    let dir = temp_dir.path();
    study(dir);
    assert!(proact(dir, TABLES[0]).status.success());
    let tables = dir.join("study/tables");
    // Catches an edited export that was analysed though the hashes beside it said so.
    edit(&tables.join("trials.csv"), ",0,blocks on target", ",4,blocks on target");
    let error = refusal(dir, &["analyze", "study/tables", "--out", "report"]);
    assert!(error.contains("trials.csv has changed since the export"), "{error}");
    edit(&tables.join("trials.csv"), ",4,blocks on target", ",0,blocks on target");
    fs::remove_file(tables.join("SHA256SUMS")).unwrap();
    for (table, from, to) in [
        ("trials", ",task,1,", ",bogus,1,"),
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

/// Replaces `from` by `to` in a file.
#[track_caller]
fn edit(file: &Path, from: &str, to: &str) {
    let text = fs::read_to_string(file).unwrap();
    assert!(text.contains(from), "{from} in {text}");
    fs::write(file, text.replacen(from, to, 1)).unwrap();
}

// Catches an event that was renamed, with which the trial was left out of every table and the exit code was 0, and plans whose keys
// nobody looked at.
#[test]
fn an_unknown_key_or_kind_in_any_file_of_a_record_is_refused_with_file_and_key() {
    let temp_dir = tempfile::tempdir().unwrap();
    let dir = temp_dir.path();
    study(dir);
    let folder = dir.join("study").join(ONE);
    let plan = r#"{"request":1,"status":"ok","clearance":null,"iterations":1,"state_checks":1,"wall_secs":0.1,"cpu_secs":0.1,"timed_out":false}"#;
    fs::write(folder.join("plans.jsonl"), format!("{plan}\n")).unwrap();
    fs::write(folder.join("trunk.csv"), "time_s,x,y,z,qx,qy,qz,qw\n").unwrap();
    seal(&folder);
    answer(dir, TABLES[0]);
    for (name, from, to) in [
        ("events.jsonl", "trial_finished", "trial_over"),
        ("events.jsonl", "\"time\"", "\"tyme\""),
        ("plans.jsonl", "state_checks", "states"),
        ("plans.jsonl", "\"ok\"", "\"fine\""),
        ("result.json", "\"not_attempted\"", "\"not_tried\""),
        ("trunk.csv", "time_s", "seconds"),
    ] {
        let file = folder.join(name);
        let original = fs::read(&file).unwrap();
        edit(&file, from, to);
        // With hashes of before, and made again. A file that is only measured is read once the hashes agree.
        for sealed in [false, true] {
            if sealed {
                seal(&folder);
            } else if name == "trunk.csv" {
                continue;
            }
            let alone: &[&str] = &["analyze", &format!("study/{ONE}"), "--out", "alone"];
            for words in [TABLES[0], TABLES[1], alone] {
                let error = refusal(dir, words);
                let named = [from, to].iter().any(|key| error.contains(key.trim_matches('"')));
                assert!(named && error.contains(&format!("{name}, line ")), "{from}: {error}");
                assert!(!error.contains("damaged at byte"), "{error}");
                assert_eq!(error.matches(ONE).count(), 1, "the path once: {error}");
            }
        }
        fs::write(&file, original).unwrap();
        seal(&folder);
    }
    answer(dir, TABLES[1]);
}

// Catches the score of 0 that a trial got which was broken off, and records that were marked in some tables only.
#[test]
fn a_trial_that_was_broken_off_has_no_score_and_is_marked_in_every_table_that_it_is_in() {
    let temp_dir = tempfile::tempdir().unwrap();
    let dir = temp_dir.path();
    study(dir);
    let folder = dir.join("study").join(ONE);
    edit(&folder.join("result.json"), r#""ended": "task""#, r#""ended": "abort""#);
    seal(&folder);
    answer(dir, &["study", "export", "study", "--raw", "--out", "tables"]);
    answer(dir, TABLES[1]);
    let flaw_of_one = |row: &std::collections::BTreeMap<String, String>| {
        let is_one = row["condition"] == "first" && row["trial"] == "1";
        (is_one, row["flaw"].clone())
    };
    for (folder, names) in [
        ("tables", ["trials", "blocks", "attempts", "gaze", "compensation", "raw_gaze"].as_slice()),
        ("report/data", &["trials", "blocks", "attempts", "gaze", "measures"]),
    ] {
        for name in names {
            let rows = table(&dir.join(folder), name);
            assert!(!rows.is_empty() || *name == "raw_gaze", "{name}");
            for row in &rows {
                let (is_one, flaw) = flaw_of_one(row);
                assert_eq!(flaw, if is_one { "interrupted" } else { "" }, "{folder}/{name}: {row:?}");
            }
        }
        for row in table(&dir.join(folder), "trials") {
            assert_eq!(row["score"].is_empty(), flaw_of_one(&row).0, "{row:?}");
        }
        for row in table(&dir.join(folder), "blocks") {
            assert_eq!(row["outcome"].is_empty(), flaw_of_one(&row).0, "{row:?}");
            assert!(!row["block"].is_empty());
        }
    }
    // Each table of the report that the trial is in, and the number of scores that a mean is of.
    for file in fs::read_dir(dir.join("report/tables")).unwrap().map(|entry| entry.unwrap().path()) {
        let name = file.file_stem().unwrap().to_str().unwrap().to_owned();
        if file.extension().is_some_and(|ending| ending == "csv") {
            let rows = table(&dir.join("report/tables"), &name);
            let marked = rows.iter().any(|row| row["flaw"] == "interrupted");
            assert!(rows.is_empty() || marked, "{name}: {rows:?}");
        }
    }
    let success = table(&dir.join("report/tables"), "success");
    let of = |method: &str| success.iter().find(|row| row["Method"] == method).unwrap();
    assert_eq!((of("first")["n"].as_str(), of("first")["flaw"].as_str()), ("1", "interrupted"));
    assert_eq!((of("second")["n"].as_str(), of("second")["flaw"].as_str()), ("2", ""));

    // Outside a study too.
    answer(dir, &["analyze", &format!("study/{ONE}"), "--out", "alone"]);
    let alone = &table(&dir.join("alone/data"), "trials")[0];
    assert_eq!((alone["score"].as_str(), alone["flaw"].as_str()), ("", "interrupted"));
}

// Catches a result that was edited, with its hashes made again: it was believed.
#[test]
fn a_result_that_is_not_that_of_the_recomputed_trial_is_marked_and_its_key_named() {
    let temp_dir = tempfile::tempdir().unwrap();
    let dir = temp_dir.path();
    study(dir);
    let folder = dir.join("study").join(ONE);
    let file = folder.join("result.json");
    let original = fs::read_to_string(&file).unwrap();
    for (from, to, expected_text) in [
        (r#""score": 0.0"#, r#""score": 4.0"#, "result.json has score = 4.0, the recomputed trial has 0.0"),
        (
            r#""outcome": "not_attempted""#,
            r#""outcome": "on_target""#,
            "outcomes.1.outcome = \\\"on_target\\\"",
        ),
        (r#""ended": "task""#, r#""ended": "failed""#, "ended = \\\"failed\\\""),
    ] {
        edit(&file, from, to);
        seal(&folder);
        let report = json(dir, &["analyze", "study", "--out", "report", "--json"]);
        assert!(report["notes"].to_string().contains(expected_text), "{from}: {report}");
        // Nothing of the false result is in a table: it came out as four blocks of four, beside a mark.
        json(dir, &["study", "export", "study", "--json"]);
        for data in [dir.join("report/data"), dir.join("study/tables")] {
            let trials = table(&data, "trials");
            let diverged: Vec<_> = trials.iter().filter(|row| row["flaw"] == "diverged").collect();
            assert_eq!(diverged.len(), 1);
            assert!(["score", "seconds"].iter().all(|column| diverged[0][*column].is_empty()));
            let blocks = table(&data, "blocks");
            assert!(
                blocks.iter().filter(|row| row["flaw"] == "diverged").all(|row| row["outcome"].is_empty())
            );
        }
        fs::write(&file, &original).unwrap();
        seal(&folder);
    }
    let report = json(dir, &["analyze", "study", "--out", "report", "--json"]);
    assert!(!report["notes"].to_string().contains("recomputed"), "{report}");
}

// Catches a record that a note called not scored, and that was in the tables of trials all the same.
#[test]
fn a_record_that_cannot_be_scored_is_in_no_table() {
    let temp_dir = tempfile::tempdir().unwrap();
    let dir = temp_dir.path();
    study(dir);
    let folder = dir.join("study").join(ONE);
    let file = folder.join("result.json");
    let [original, sums] = [&file, &folder.join("SHA256SUMS")].map(|file| fs::read_to_string(file).unwrap());
    json(dir, &["analyze", "study", "--out", "report", "--json"]);
    let all = table(&dir.join("report/data"), "trials").len();
    let shorter = |text: &str| {
        let (before, after) = text.split_once(r#""sim_seconds": "#).unwrap();
        format!("{before}\"sim_seconds\": 0.5{}", &after[after.find(',').unwrap()..])
    };
    fs::write(&file, shorter(&original)).unwrap();
    seal(&folder);
    let refused = ["ended at 500 ms", "is not closed: SHA256SUMS is missing"];
    for (index, expected_text) in refused.into_iter().enumerate() {
        let report = json(dir, &["analyze", "study", "--out", "report", "--json"]);
        assert!(report["notes"].to_string().contains(expected_text), "{report}");
        assert_eq!(table(&dir.join("report/data"), "trials").len() + 1, all);
        for name in ["trials", "blocks", "measures"] {
            let rows = table(&dir.join("report/data"), name);
            assert!(rows.iter().all(|row| row["flaw"].is_empty()), "{name}");
        }
        assert!(refusal(dir, &["study", "export", "study"]).contains(expected_text));
        fs::write(&file, &original).unwrap();
        fs::write(folder.join("SHA256SUMS"), &sums).unwrap();
        if index == 0 {
            fs::remove_file(folder.join("SHA256SUMS")).unwrap();
        }
    }
    fs::remove_file(folder.join("SHA256SUMS")).unwrap();
    let error = refusal(dir, &["study", "archive", "study", "--out", "study.zip"]);
    assert!(error.contains("is not closed"), "{error}");
}

// Catches an archive that said nothing about records that could not be read.
#[test]
fn an_archive_names_records_that_are_missing_damaged_or_misplaced_and_is_made_of_them_on_request_alone() {
    let temp_dir = tempfile::tempdir().unwrap();
    let dir = temp_dir.path();
    study(dir);
    let [one, two, three] = ["modefirst-trial1", "modefirst-trial2", "modesecond-trial1"]
        .map(|name| dir.join("study/trials").join(format!("participant1-{name}")));
    fs::rename(&one, dir.join("aside")).unwrap();
    exchange(&two, &three);
    // Damaged as well, which does not matter of a record in the wrong folder.
    fs::write(two.join("result.json"), "{}").unwrap();
    let four = dir.join("study/trials/participant1-modesecond-trial2");
    fs::write(four.join("events.jsonl"), "").unwrap();
    let archive = ["study", "archive", "study", "--out", "study.zip"];
    let error = refusal(dir, &archive);
    for expected_text in [
        "participant1-modefirst-trial1: the record is missing",
        "participant1-modefirst-trial2: the record is not that of its place in the study: its condition is \"second\"",
        "participant1-modesecond-trial1: the record is not that of its place",
        "participant1-modesecond-trial2 is not as it was recorded",
        "--accept-damaged",
    ] {
        assert!(error.contains(expected_text), "{expected_text}: {error}");
    }
    assert!(!dir.join("study.zip").exists());
    let made = json(dir, &[archive.as_slice(), &["--accept-damaged", "--json"]].concat());
    assert_eq!(made["faulty_records"].as_array().unwrap().len(), 4, "{made}");
    assert!(dir.join("study.zip").exists());
}

// Catches a second run of a finished study, which computed every trial again for the same tables.
#[test]
fn a_rehearsal_that_is_finished_already_leaves_its_tables_alone() {
    use std::os::unix::fs::MetadataExt;
    let temp_dir = tempfile::tempdir().unwrap();
    let dir = temp_dir.path();
    study(dir);
    let run = ["study", "run", "study", "--simulated", "--json"];
    let file = dir.join("study/tables/trials.csv");
    let identity = || fs::metadata(&file).unwrap().ino();
    let before = identity();
    let events = table(&dir.join("study/tables"), "events").len();
    let again = json(dir, &run);
    assert_eq!(identity(), before, "the file was not written again");
    assert_eq!((again["finished"].as_bool(), again["rows"]["trials"].as_u64()), (Some(true), Some(4)));
    // Tables that are not those that were written are made again, and so are those of another plan.
    edit(&file, "first", "worst");
    json(dir, &run);
    assert!(fs::read_to_string(&file).unwrap().contains("first"));
    assert_eq!(
        table(&dir.join("study/tables"), "events").len(),
        events,
        "no run, for there was nothing to run"
    );
    edit(&dir.join("study/plan.toml"), "participants = 1", "participants = 1 # as before");
    json(dir, &run);
    assert!(table(&dir.join("study/tables"), "events").len() > events);
}
