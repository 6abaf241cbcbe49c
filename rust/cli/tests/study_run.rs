//! A study with simulated participants, from its plan to its tables.
#![allow(clippy::disallowed_methods)] // A test of files and processes.
#![allow(clippy::unwrap_used)]

mod common;

use common::in_folder::{answer, json, table};
use serde_json::Value;
use std::{
    fs,
    path::Path,
    process::{Command, Stdio},
};

/// Trials of 3 s, in which nobody gets anywhere: what is tested is what is kept of them.
const PLAN: &str = r#"
name = "short"
participants = 3
[trial]
limit_secs = 3
[[conditions]]
name = "A"
trial = { method = "A" }
[[conditions]]
name = "shared control"
trial = { method = "D" }
[order]
by = "williams"
[arrangements]
by = "balanced"
[[sessions]]
name = "1"
trials = 1
begin = [{ do = "form", form = "participant", minutes = 1 }, { do = "say", text = "welcome", minutes = 1 }]
after_condition = [{ do = "form", form = "pros_tlx", minutes = 1 }, { do = "form", form = "own", minutes = 1 }]
end = [{ do = "form", form = "ranking", minutes = 1 }]
[texts]
welcome = "Hello."
"#;

/// A questionnaire of a lab's own, in two languages.
const OWN_FORM: &str = r#"
name = "own"
title = { en = "Our own", de = "Unser eigener" }
source = "ours"
licence = "ours"
confirmed = true
[[items]]
kind = "scale"
key = "trust"
text = { en = "How far do you trust the arm?", de = "Wie sehr vertrauen Sie dem Arm?" }
low = { en = "not at all", de = "gar nicht" }
high = { en = "fully", de = "ganz" }
least = 1
most = 5
step = 1
"#;

/// A refusal, which is one sentence.
fn refusal(dir: &Path, words: &[&str]) -> String {
    let error = common::in_folder::refusal(dir, words);
    assert_eq!(error.trim_end().lines().count(), 1, "one sentence: {error}");
    error
}

fn study(dir: &Path, name: &str) {
    answer(dir, &["study", "new", name]);
    fs::write(dir.join(name).join("plan.toml"), PLAN).unwrap();
    fs::create_dir(dir.join(name).join("forms")).unwrap();
    fs::write(dir.join(name).join("forms/own.toml"), OWN_FORM).unwrap();
}

/// The total score of each file of ArmSym's below a folder.
fn armsym_scores(folder: &Path) -> Vec<String> {
    let below = |folder: &Path| fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let (mut scores, mut moved) = (Vec::new(), false);
    for trial in below(folder).flat_map(|subject| below(&subject).collect::<Vec<_>>()) {
        let text = fs::read_to_string(trial.join("trialdata.json")).unwrap();
        let data: Value = serde_json::from_str(&text).unwrap();
        let [times, messages, values] =
            ["Times", "Message", "Val_message"].map(|key| data[key].as_array().unwrap().clone());
        assert!(times.len() == messages.len() && times.len() == values.len(), "{text}");
        assert_eq!((&messages[0], &times[0]), (&"TrialStarted".into(), &0.0.into()));
        let total = messages.iter().position(|message| message == "Total_Score").unwrap();
        let joints = fs::read_to_string(trial.join("Joint_Data.csv")).unwrap();
        let rows: Vec<Vec<&str>> = joints.lines().map(|row| row.split('\t').collect()).collect();
        assert_eq!(rows[0][..3], ["Idx", "Time", "th1"]);
        assert_eq!((rows[0].len(), rows[0][8], rows[0][16]), (17, "th7", "z_baserobot_in_space"));
        let end = times.last().unwrap().as_f64().unwrap();
        assert!((rows.len() as f64 - 2.0 - 90.0 * end).abs() <= 1.0, "{} rows in {end} s", rows.len());
        let numbers = |row: &[&str]| row.iter().map(|cell| cell.parse().unwrap()).collect::<Vec<f64>>();
        assert!(rows[1..].iter().all(|row| numbers(row).len() == 17));
        moved |= rows[1][2..9] != rows[rows.len() - 1][2..9];
        scores.push(values[total].as_f64().unwrap().to_string());
    }
    assert!(moved, "in no trial has a joint moved");
    scores
}

#[test]
fn a_simulated_study_has_the_rows_of_its_plan_and_the_digests_of_its_trials_whatever_runs_beside_them() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    study(dir, "one");
    assert_eq!(json(dir, &["study", "next", "one", "--json"])["participant"], 1);
    let done = json(dir, &["study", "run", "one", "--simulated", "--jobs", "1", "--json"]);
    assert_eq!((done["finished"].as_bool(), &done["trials"]), (Some(true), &serde_json::json!([6, 6])));
    assert_eq!(json(dir, &["study", "next", "one", "--json"]), Value::Null);
    let status = json(dir, &["study", "status", "one", "--json"]);
    assert_eq!((&status["finished"], &status["simulated"]), (&Value::Bool(true), &Value::Bool(true)));

    let tables = dir.join("one/tables");
    let trials = table(&tables, "trials");
    let keys: Vec<_> =
        trials.iter().map(|row| (&row["participant"], &row["condition"], &row["trial"])).collect();
    let all: std::collections::BTreeSet<_> = keys.iter().collect();
    assert_eq!((keys.len(), all.len()), (6, 6), "{keys:?}");
    assert!(trials.iter().all(|row| row["simulated"] == "1" && row["end_reason"] == "task"));
    assert_eq!(table(&tables, "participants").len(), 3);
    assert_eq!(table(&tables, "sessions").len(), 3);
    assert_eq!(table(&tables, "blocks").len(), 24, "four blocks a trial");
    assert_eq!(table(&tables, "gaze").len(), 12, "two phases a trial");
    assert_eq!(table(&tables, "compensation").len(), 6);
    assert_eq!(table(&tables, "emg_quality").len(), 48, "eight channels a trial");
    // Of each person: consent and facts once, the load of each condition with its pairs, our own, the ranking.
    let answers = table(&tables, "answers");
    let of = |form: &str| answers.iter().filter(|row| row["form"] == form).count();
    assert_eq!((of("pros_tlx"), of("own"), of("ranking")), (3 * 2 * (8 + 28), 6, 9));
    assert!(answers.iter().all(|row| row["simulated"] == "1" && !row["answer"].is_empty()));
    let scores = table(&tables, "scores");
    assert_eq!(scores.len(), 12, "a raw and a weighted load of each condition");
    assert!(scores.iter().all(|row| row["value"].parse::<f64>().is_ok()));
    let questions = table(&tables, "questions");
    assert!(
        questions
            .iter()
            .any(|row| row["item"] == "trust" && row["answers"] == "1 (not at all) to 5 (fully) by 1")
    );

    // The codebook has every column of every table.
    let codebook = table(&tables, "codebook");
    for file in fs::read_dir(&tables).unwrap() {
        let name = file.unwrap().file_name().into_string().unwrap();
        let Some(name) = name.strip_suffix(".csv").filter(|name| !["codebook", "questions"].contains(name))
        else {
            continue;
        };
        let header = fs::read_to_string(tables.join(format!("{name}.csv"))).unwrap();
        for column in header.lines().next().unwrap().split(',') {
            let entry = codebook.iter().find(|row| row["table"] == name && row["column"] == column);
            let entry = entry.unwrap_or_else(|| panic!("the codebook has no {name}.{column}"));
            assert!(!entry["meaning"].is_empty() && !entry["source"].is_empty(), "{name}.{column}");
        }
    }

    // Scripts for older exports get the names that those had, and the analysis reads both.
    answer(dir, &["study", "export", "one", "--legacy-names", "--out", "legacy"]);
    let legacy = dir.join("legacy");
    let renames = fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/renames.md")).unwrap();
    let renamed: Vec<_> = codebook.iter().filter(|row| !row["formerly"].is_empty()).collect();
    assert!(renamed.len() >= 5, "{renamed:?}");
    for row in renamed {
        let [name, old, new] = ["table", "formerly", "column"].map(|key| row[key].as_str());
        let header = |dir: &Path| -> Vec<String> {
            let text = fs::read_to_string(dir.join(format!("{name}.csv"))).unwrap();
            text.lines().next().unwrap().split(',').map(str::to_owned).collect()
        };
        assert!(
            header(&tables).iter().any(|column| column == new)
                && !header(&legacy).iter().any(|column| column == new)
        );
        let position = |dir: &Path, column: &str| header(dir).iter().position(|other| other == column);
        assert_eq!(position(&legacy, old), position(&tables, new), "{name}.{old}");
        assert!(renames.contains(&format!("| `{old}` | `{new}` |")), "docs/renames.md lacks {name}.{old}");
    }
    for tables in ["one/tables", "legacy"] {
        let analysis = json(dir, &["analyze", tables, "--json"]);
        for (name, file) in analysis["tables"].as_object().unwrap() {
            let [one, other] = [tables, "one/tables"].map(|tables| {
                let file = file.as_str().unwrap().split_once("/analysis/").unwrap().1;
                fs::read_to_string(dir.join(tables).join("analysis").join(file)).unwrap()
            });
            assert_eq!(one, other, "{name} of {tables}");
        }
    }

    // What was done has the names of the records' events, and may have those of ArmSym.
    let actions: std::collections::BTreeSet<String> =
        table(&tables, "actions").into_iter().map(|mut row| row.remove("action").unwrap()).collect();
    assert!(actions.contains("gesture_changed") && actions.contains("plan_finished"), "{actions:?}");
    assert!(!actions.contains(""), "{actions:?}");
    answer(dir, &["study", "export", "one", "--extra-format", "armsym", "--out", "events"]);
    let scored: Vec<&str> = trials.iter().map(|row| row["score"].as_str()).collect();
    let exported_scores = armsym_scores(&dir.join("events/armsym"));
    assert_eq!(exported_scores.len(), scored.len());
    assert!(
        exported_scores.iter().all(|score| scored.contains(&score.as_str())),
        "{exported_scores:?} of {scored:?}"
    );
    answer(dir, &["study", "export", "one", "--out", "events"]);
    assert!(!dir.join("events/armsym").exists(), "what was not asked for this time is gone");

    // Another time, two at once: the same trials; and so `simulate` has them.
    study(dir, "two");
    answer(dir, &["study", "run", "two", "--simulated", "--jobs", "2", "--json"]);
    let digests = |tables: &Path| -> Vec<String> {
        table(tables, "trials").into_iter().map(|mut row| row.remove("digest").unwrap()).collect()
    };
    let recorded = digests(&tables);
    assert_eq!(recorded, digests(&dir.join("two/tables")));
    let batch = json(dir, &["simulate", "one/plan.toml", "--json", "--jobs", "2"]);
    let batched: Vec<&str> =
        batch["digests"].as_array().unwrap().iter().map(|d| d.as_str().unwrap()).collect();
    // In the tables trials stand in the order of the plan too.
    assert_eq!(batched, recorded);
    for condition in ["A", "shared control"] {
        let figures = &batch["methods"][condition];
        for key in ["mean", "sd", "min", "max", "median"] {
            assert!(figures[key].is_number(), "{condition}.{key}: {figures}");
        }
        assert_eq!(figures["trials"], 3);
    }
    assert!(batch["seeds"].is_array() && batch["wall_seconds"].is_number());
}

#[test]
fn a_study_with_simulated_persons_is_the_batch_of_the_same_persons_and_takes_no_others() {
    let temp_dir = tempfile::tempdir().unwrap();
    let dir = temp_dir.path();
    let digests = |name: &str| -> Vec<String> {
        let rows = table(&dir.join(name).join("tables"), "trials");
        rows.into_iter().map(|mut row| row.remove("digest").unwrap()).collect()
    };
    let plan = PLAN.replace("participants = 3", "participants = 2").replace("trials = 1", "trials = 2");
    let limited = plan.replace("limit_secs = 3", "limit_secs = 3\ninstruction = \"limit_body\"");
    for (name, plan) in [("free", &plan), ("limited", &limited)] {
        study(dir, name);
        fs::write(dir.join(name).join("plan.toml"), plan).unwrap();
        answer(dir, &["study", "run", name, "--simulated", "--participant-kind", "person", "--json"]);
        // What a person has done before and was told is the same in both, or the second trials would differ.
        let file = format!("{name}/plan.toml");
        let batch = json(dir, &["simulate", &file, "--participant-kind", "person", "--json"]);
        assert_eq!(batch["digests"], serde_json::json!(digests(name)));
    }
    let body_share = |name: &str| {
        let config = dir.join(name).join("trials/participant1-modeA-trial2");
        let text = fs::read_to_string(config.join("config.toml")).unwrap();
        let config: toml::Table = text.parse().unwrap();
        config["participant"]["person"]["trunk_share"].as_float().unwrap()
    };
    assert!(body_share("limited") < 0.5 * body_share("free"), "told to keep the body still");
    let error = refusal(dir, &["study", "run", "free", "--simulated"]);
    assert!(error.contains("has simulated (person) participants"), "{error}");
    let error = refusal(dir, &["simulate", "--methods", "A", "--sweep", "instruction=still", "--json"]);
    assert!(error.contains("free or limit_body"), "{error}");
}

#[test]
fn what_a_study_cannot_take_is_refused_in_one_sentence() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    study(dir, "one");
    assert_eq!(json(dir, &["study", "status", "one", "--json"])["trials"], serde_json::json!([0, 6]));
    let plan = dir.join("one/plan.toml");
    fs::write(&plan, PLAN.replace("participants = 3", "participants = 1")).unwrap();
    answer(dir, &["study", "run", "one", "--simulated", "--json"]);
    let error = refusal(dir, &["study", "run", "one", "--no-browser", "--port", "0"]);
    assert!(error.contains("has simulated participants"), "{error}");
    let refused = |changed: String, words: &str| {
        fs::write(&plan, changed).unwrap();
        let error = refusal(dir, &["study", "run", "one", "--simulated"]);
        assert!(error.contains(words), "{error}");
    };
    refused(PLAN.replace("method = \"D\"", "method = \"C\""), "trials of shared control were run");
    refused(PLAN.replace("limit_secs = 3", "limit_secs = 4"), "trials of A were run");
    refused(PLAN.replace("trials = 1", "trials = 2"), "was done and is another one now");
    // More participants are no change of what was done.
    fs::write(&plan, PLAN).unwrap();
    let done = json(dir, &["study", "status", "one", "--json"]);
    assert_eq!(done["trials"], serde_json::json!([2, 6]), "{done}");
    // Nothing that is there is overwritten.
    fs::create_dir(dir.join("elsewhere")).unwrap();
    fs::write(dir.join("elsewhere/precious.txt"), "mine").unwrap();
    let error = refusal(dir, &["study", "export", "one", "--out", "elsewhere"]);
    assert!(error.contains("is no earlier export"), "{error}");
    assert!(dir.join("elsewhere/precious.txt").exists());
    // An export that was killed is made again, and what somebody put beside it stays.
    let tables = dir.join("one/tables");
    fs::remove_file(tables.join("SHA256SUMS")).unwrap();
    fs::write(tables.join("my_figure.svg"), "mine").unwrap();
    answer(dir, &["study", "export", "one"]);
    assert!(tables.join("SHA256SUMS").exists() && tables.join("my_figure.svg").exists());
    // One that was killed in its very first file left half of it and nothing else.
    fs::remove_dir_all(&tables).unwrap();
    fs::create_dir(&tables).unwrap();
    fs::write(tables.join(".proact-1.partial"), "half").unwrap();
    answer(dir, &["study", "export", "one"]);
    assert!(tables.join("SHA256SUMS").exists());
    answer(dir, &["study", "archive", "one", "--out", "one.zip"]);
    let error = refusal(dir, &["study", "archive", "one", "--out", "one.zip"]);
    assert!(error.contains("exists"), "{error}");
    let error = refusal(dir, &["study", "run", "nowhere", "--simulated"]);
    assert!(error.contains("nowhere") && error.contains("proact study new"), "{error}");
    let error = refusal(dir, &["simulate", "--methods", "Z"]);
    assert!(error.contains("Z"), "{error}");
}

#[test]
fn a_report_on_a_study_that_was_broken_off_says_how_far_it_got() {
    let temp_dir = tempfile::tempdir().unwrap();
    study(temp_dir.path(), "half");
    let plan = PLAN.replace("participants = 3", "participants = 40");
    fs::write(temp_dir.path().join("half/plan.toml"), plan).unwrap();
    let mut run = Command::new(env!("CARGO_BIN_EXE_proact"))
        .args(["study", "run", "half", "--simulated", "--jobs", "1"])
        .current_dir(temp_dir.path())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let trial_count = || fs::read_dir(temp_dir.path().join("half/trials")).map_or(0, Iterator::count);
    while trial_count() < 3 && run.try_wait().unwrap().is_none() {
        std::thread::yield_now();
    }
    assert!(Command::new("sh").args(["-c", &format!("kill -INT {}", run.id())]).status().unwrap().success());
    assert!(!run.wait().unwrap().success(), "it was broken off");
    let report = json(temp_dir.path(), &["analyze", "half", "--json"]);
    let notes = report["notes"].to_string();
    assert!(notes.contains("not finished") && notes.contains("of 80 planned trials"), "{notes}");
    let trials = fs::read_to_string(temp_dir.path().join("half/analysis/tables/trials.csv")).unwrap();
    let counted = trials.lines().count() - 1;
    assert!(
        (1..80).contains(&counted) && notes.contains(&format!(": {counted} of 80")),
        "{counted}: {notes}"
    );
}

#[test]
fn a_report_names_the_questionnaires_that_lack_answers_and_scores_none_of_them() {
    let temp_dir = tempfile::tempdir().unwrap();
    let plan = PLAN.replace("form = \"pros_tlx\"", "form = \"sus\"");
    study(temp_dir.path(), "unasked");
    fs::write(temp_dir.path().join("unasked/plan.toml"), plan).unwrap();
    answer(temp_dir.path(), &["study", "run", "unasked", "--simulated", "--json"]);
    // As if the second person had got up and left one form empty, and half of another.
    let journal = rusqlite::Connection::open(temp_dir.path().join("unasked/study.sqlite")).unwrap();
    let left_out =
        "DELETE FROM journal WHERE kind = 'answered' AND json_extract(event, '$.spot.participant') = 2 AND
        json_extract(event, '$.form') = ?1 AND json_extract(event, '$.item') LIKE ?2";
    assert_eq!(journal.execute(left_out, ["sus", "%"]).unwrap(), 20);
    assert_eq!(journal.execute(left_out, ["own", "trust"]).unwrap(), 2);
    // And as if the third had been led past one.
    let skipped = "UPDATE journal SET event = json_set(event, '$.outcome', 'skipped') WHERE kind = 'step_ended' AND json_extract(event, '$.spot') =
        (SELECT json_extract(event, '$.spot') FROM journal WHERE kind = 'answered' AND json_extract(event, '$.spot.participant') = 3 AND
        json_extract(event, '$.form') = 'sus' LIMIT 1)";
    assert_eq!(journal.execute(skipped, []).unwrap(), 1);
    journal.close().unwrap();
    let report = json(temp_dir.path(), &["analyze", "unasked", "--json"]);
    let notes = report["notes"].to_string();
    for gap in [
        "P2: sus lacks 10 of 10 answers about shared control, 10 of 10 answers about A",
        "P2: own lacks 1 of 1 answers about shared control, 1 of 1 answers about A",
    ] {
        assert!(notes.contains(gap), "{gap}: {notes}");
    }
    assert!(notes.contains("P3: sus lacks all answers, skipped, about"), "{notes}");
    assert!(!notes.contains("P1: sus") && !notes.contains("P3: own"), "{notes}");
    let scores = fs::read_to_string(temp_dir.path().join("unasked/analysis/data/scores.csv")).unwrap();
    let of = |who: &str| {
        scores.lines().filter(|line| line.starts_with(who)).map(str::to_owned).collect::<Vec<_>>()
    };
    let empty: Vec<String> = of("2,");
    assert!(empty.len() == 2 && empty.iter().all(|line| line.contains(",sus,,")), "{empty:?}");
    // The tables alone tell it too, as far as there are scores.
    answer(temp_dir.path(), &["study", "export", "unasked"]);
    let report = json(temp_dir.path(), &["analyze", "unasked/tables", "--json"]);
    assert!(report["notes"].to_string().contains("P2: sus about A lacks sus_1, sus_2,"), "{report}");
    assert!(of("1,").iter().all(|line| !line.contains(",sus,,")), "{scores}");
}
