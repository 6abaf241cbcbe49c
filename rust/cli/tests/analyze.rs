//! Reports on what was recorded: the paper's printed numbers, real trials, and what is broken or missing.
#![allow(clippy::disallowed_methods)] // A test of files and processes.
#![allow(clippy::unwrap_used)]

use serde_json::Value;
use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
    process::{Command, Output},
    sync::OnceLock,
};

fn proact(words: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_proact")).args(words).output().unwrap()
}

#[track_caller]
fn analyze(dir: &Path, out: &Path) -> Value {
    let output = proact(&["analyze", dir.to_str().unwrap(), "--out", out.to_str().unwrap(), "--json"]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

fn lines(path: &Path) -> Vec<String> {
    fs::read_to_string(path)
        .unwrap_or_else(|e| panic!("{}: {e}", path.display()))
        .lines()
        .map(str::to_owned)
        .collect()
}

/// Rows of a table by the names of its columns.
fn rows(path: &Path) -> Vec<BTreeMap<String, String>> {
    let mut reader = csv::Reader::from_path(path).unwrap();
    reader.deserialize().map(|row| row.unwrap()).collect()
}

/// How often 0, 1, 2, 3 and 4 blocks came across in the 24 trials of a method: numbers with the means, deviations, ends and medians that the
/// paper prints.
const BLOCKS: [(&str, [usize; 5]); 4] =
    [("A", [3, 8, 1, 5, 7]), ("B", [6, 5, 4, 2, 7]), ("C", [0, 1, 5, 4, 14]), ("D", [0, 0, 1, 6, 17])];
/// The paper's sequences, with its asterisks.
const SEQUENCES: [[&str; 4]; 8] = [
    ["A", "C*", "B", "D"],
    ["C", "B", "D*", "A"],
    ["A", "D", "B", "C"],
    ["D", "B", "C", "A"],
    ["B", "D", "A", "C"],
    ["D", "A", "C", "B"],
    ["B", "C", "A", "D"],
    ["C", "A", "D*", "B*"],
];
/// The paper's rankings of ease, agency and speed, and the choice for one last trial.
const RANKINGS: [[&str; 4]; 8] = [
    ["D,C,A,B", "D,A,C,B", "D,A,C,B", "D"],
    ["C,D,B,A", "C,D,B,A", "C,D,B,A", "C"],
    ["D,C,A,B", "D,C,A,B", "D,C,A,B", "D"],
    ["D,C,B,A", "D,C,B,A", "D,C,B,A", "D"],
    ["D,C,B,A", "D,C,B,A", "C,D,B,A", "D"],
    ["D=C,A,B", "D=C,A,B", "D=C,A,B", "D"],
    ["C,D,B,A", "C,B,D,A", "D,C,B,A", "B"],
    ["D,C,A,B", "D,C,A,B", "D,C,A,B", "D"],
];

fn paper(dir: &Path) {
    fs::create_dir(dir).unwrap();
    let mut trials = "participant,session,condition,trial,position,mark,score,score_name\n".to_owned();
    for (method, counts) in BLOCKS {
        let scores: Vec<usize> = counts.iter().enumerate().flat_map(|(score, n)| vec![score; *n]).collect();
        for (k, score) in scores.iter().enumerate() {
            let person = k % 8;
            let position =
                SEQUENCES[person].iter().position(|name| name.trim_end_matches('*') == method).unwrap();
            let mark = if SEQUENCES[person][position].ends_with('*') { "*" } else { "" };
            let (person, position, trial) = (person + 1, position + 1, k / 8 + 1);
            trials += &format!("{person},1,{method},{trial},{position},{mark},{score},blocks on target\n");
        }
    }
    fs::write(dir.join("trials.csv"), trials).unwrap();
    let mut answers = "participant,session,condition,form,item,answer\n".to_owned();
    for (person, answers_of_person) in (1..).zip(RANKINGS) {
        for (item, answer) in ["ease", "agency", "speed"].into_iter().zip(answers_of_person) {
            answers += &format!("{person},1,,ranking,{item},\"{answer}\"\n");
        }
        answers += &format!("{person},1,,last_trial,choice,{}\n", answers_of_person[3]);
    }
    fs::write(dir.join("answers.csv"), answers).unwrap();
    let deviations =
        "participant,session,condition,deviation,reason\n1,1,C,split_over_days,technical issue\n";
    fs::write(dir.join("deviations.csv"), deviations).unwrap();
}

#[test]
fn the_papers_tables_give_the_papers_printed_numbers() {
    let temp_dir = tempfile::tempdir().unwrap();
    let (dir, out) = (temp_dir.path().join("paper"), temp_dir.path().join("report"));
    paper(&dir);
    let answer = analyze(&dir, &out);
    assert_eq!(
        lines(&out.join("tables/success.csv")),
        [
            "Method,mean,sd,min,max,median,n,flaw",
            "A,2.21,1.50,0.00,4.00,2.50,24,",
            "B,1.96,1.60,0.00,4.00,2.00,24,",
            "C,3.29,0.95,1.00,4.00,4.00,24,",
            "D,3.67,0.56,2.00,4.00,4.00,24,",
        ]
    );
    // Three trials each: of A 0, 1 and 3 blocks, of D 2, 4 and 4.
    let people = lines(&out.join("tables/by_participant.csv"));
    assert_eq!(people[0], "Measure,participant,A,B,C,D,flaw");
    assert_eq!(people[1], "\"Score, mean of the trials\",P1,1.33,1.33,2.67,3.33,");
    let sequence = lines(&out.join("tables/sequence.csv"));
    for (person, conditions_of_person) in SEQUENCES.iter().enumerate() {
        assert_eq!(sequence[person + 1], format!("P{},{},", person + 1, conditions_of_person.join(",")));
    }
    let rankings = lines(&out.join("tables/rankings.csv"));
    assert_eq!(rankings[0], "P,ease,agency,speed,choice,flaw");
    for (person, answers_of_person) in RANKINGS.iter().enumerate() {
        let words = answers_of_person.map(|answer| answer.replace('=', " = ").replace(',', " > "));
        assert_eq!(rankings[person + 1], format!("P{},{},", person + 1, words.join(",")));
    }
    let page = fs::read_to_string(out.join("report.html")).unwrap();
    for text in ["2.21", "0.56", "C*", "D = C &gt; A &gt; B", "technical issue", "<svg", "is missing"] {
        assert!(page.contains(text), "{text} is on the page");
    }
    for other in ["http://", "https://", "<script"] {
        let rest = page.replace("http://www.w3.org/2000/svg", "");
        assert!(!rest.contains(other), "the page needs nothing else: {other}");
    }
    // Eight people, four methods: the test by hand on the means of people is in the crate; here it is there at all.
    let statistics: Value =
        serde_json::from_str(&fs::read_to_string(out.join("statistics.json")).unwrap()).unwrap();
    assert_eq!(statistics[0]["friedman"]["n"], 8);
    assert_eq!(statistics[0]["pairs"].as_array().unwrap().len(), 6);
    let figures = answer["figures"].as_object().unwrap();
    for name in figures.keys() {
        assert!(page.contains(&format!("id=\"figure-{name}\"")), "{name} is on the page");
    }
    for name in ["success", "over_trials", "learning", "rankings"] {
        let svg = PathBuf::from(figures[name].as_str().unwrap());
        assert!(fs::read(svg.with_extension("png")).unwrap().starts_with(b"\x89PNG"), "{name}");
    }
}

/// Two real trials, of methods A and D.
fn recorded() -> &'static Path {
    static PLACE: OnceLock<tempfile::TempDir> = OnceLock::new();
    let temp_dir = PLACE.get_or_init(|| {
        let temp_dir = tempfile::tempdir().unwrap();
        for method in ["A", "D"] {
            let out = temp_dir.path().join(method);
            let output = proact(&[
                "demo",
                "--headless",
                "--method",
                method,
                "--seed",
                "1",
                "--out",
                out.to_str().unwrap(),
            ]);
            assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        }
        temp_dir
    });
    temp_dir.path()
}

/// A number of a row, to a thousandth.
fn seconds(row: &BTreeMap<String, String>, column: &str) -> Option<f64> {
    row[column].parse().ok().map(|value: f64| (value * 1e3).round() / 1e3)
}

#[test]
fn a_recorded_trial_is_scored_as_its_task_scored_it() {
    let temp_dir = tempfile::tempdir().unwrap();
    let out = temp_dir.path().join("report");
    let answer = analyze(recorded(), &out);
    let notes = answer["notes"].as_array().unwrap();
    assert!(notes.iter().all(|note| note.as_str().unwrap().starts_with("No mixed models")), "{answer}");
    let (blocks, objects) = (rows(&out.join("data/blocks.csv")), rows(&out.join("data/objects.csv")));
    assert_eq!((blocks.len(), objects.len()), (8, 8));
    for block in &blocks {
        let same = |row: &&BTreeMap<String, String>| {
            ["condition", "block"].iter().all(|key| row[*key] == block[*key])
        };
        let object = objects.iter().find(same).unwrap();
        // The task and the scoring find these apart from each other.
        if block["outcome"] == "on_target" {
            assert_eq!(object["crossed"], "1", "{object:?}");
            assert_eq!(seconds(block, "pick_s"), seconds(object, "pick_s"), "{block:?} {object:?}");
            let min_distance_mm: f64 = object["least_distance_mm"].parse().unwrap();
            assert!(min_distance_mm <= seconds(block, "error_mm").unwrap() + 1.0, "{block:?} {object:?}");
        }
        if object["grasps"] == "1" && block["outcome"] == "on_target" {
            assert_eq!(seconds(block, "place_s"), seconds(object, "place_s"), "{block:?} {object:?}");
        }
    }
    let phases = rows(&out.join("data/phases.csv"));
    for phase in &phases {
        // The simulated person leans, looks at what it takes, and drives the arm.
        assert_eq!(phase["with_method"], "1");
        let shares = ["object", "other_objects", "target", "hand", "arm", "elsewhere"]
            .map(|name| seconds(phase, &format!("gaze_{name}")).unwrap());
        let sum: f64 = shares.iter().sum();
        assert!(sum > 0.5 && sum <= 1.0 + 1e-9, "{phase:?}");
        let target_share = if phase["phase"] == "pick" { shares[0] } else { shares[2] };
        // Least of three seeds of A and D: 0.28, where the arm comes between the eyes and the block for a third of the time.
        assert!(target_share > 0.2 && target_share + shares[3] + shares[4] > 0.5, "{phase:?}");
        assert!(seconds(phase, "base_share").is_some_and(|share| (-0.5..1.5).contains(&share)), "{phase:?}");
    }
    let measures = rows(&out.join("data/measures.csv"));
    for row in &measures {
        let rate = seconds(row, "decisions_per_s").unwrap();
        assert!((19.0..=21.0).contains(&rate), "20 decisions a second: {row:?}");
        assert!(
            seconds(row, "gesture_to_motion_ms").is_some_and(|ms| (10.0..500.0).contains(&ms)),
            "{row:?}"
        );
    }
}

#[test]
fn a_bag_alone_is_scored_like_the_record_that_it_is_of() {
    let temp_dir = tempfile::tempdir().unwrap();
    let bags = temp_dir.path().join("bags");
    fs::create_dir(&bags).unwrap();
    fs::copy(recorded().join("D/trial.bag"), bags.join("participant3-mode4-trial2.bag")).unwrap();
    let (of_bag, of_record) = (temp_dir.path().join("b"), temp_dir.path().join("r"));
    let answer = analyze(&bags, &of_bag);
    assert!(answer["notes"][0].as_str().unwrap().contains("does not tell"), "{answer}");
    analyze(&recorded().join("D"), &of_record);
    let trial = &rows(&of_bag.join("data/trials.csv"))[0];
    let key = ["participant", "condition", "trial", "score"].map(|name| trial[name].as_str());
    assert_eq!(key, ["3", "D", "2", "4"]);
    let [found, expected] = [&of_bag, &of_record].map(|out| rows(&out.join("data/objects.csv")));
    assert_eq!(found.len(), 4);
    for (found, expected) in found.iter().zip(&expected) {
        for column in ["pick_s", "place_s"] {
            let [found, expected] = [found, expected].map(|row| seconds(row, column).unwrap());
            assert!((found - expected).abs() < 0.05, "{column}: {found} {expected}");
        }
    }
    let measures = &rows(&of_bag.join("data/measures.csv"))[0];
    assert_eq!(measures["plan_failures"], "", "what a bag does not tell is missing and not zero");
    assert_eq!(measures["wrong_objects"], "0");
}

/// Whether R with lme4 and ordinal is there.
fn r_is_there() -> bool {
    let probe = Command::new("Rscript").args(["-e", "library(lme4); library(ordinal)"]).output();
    let there = probe.is_ok_and(|output| output.status.success());
    if !there {
        println!("skipped: R with lme4 and ordinal not found; ./proact test statistics installs them");
    }
    there
}

#[test]
fn r_fits_the_models_of_the_papers_tables() {
    if !r_is_there() {
        return;
    }
    let temp_dir = tempfile::tempdir().unwrap();
    let (dir, out) = (temp_dir.path().join("paper"), temp_dir.path().join("report"));
    paper(&dir);
    let answer = analyze(&dir, &out);
    assert!(!answer["notes"].to_string().contains("No mixed models"), "{answer}");
    let models = rows(&out.join("data").join("../tables/mixed_models.csv"));
    let of = |model: &str, term: &str| {
        let row = models.iter().find(|row| row["model"] == model && row["term"] == term);
        row.unwrap_or_else(|| panic!("{model} {term}: {models:?}"))["estimate"].parse::<f64>().unwrap()
    };
    // In a balanced design the linear model's effects are the differences of the means: 88 - 53 and 79 - 53 blocks in 24 trials.
    assert!((of("linear", "D") - 35.0 / 24.0).abs() < 1e-3);
    assert!((of("linear", "C") - 26.0 / 24.0).abs() < 1e-3);
    assert!(of("cumulative logit", "D") > of("cumulative logit", "B"));
    let page = fs::read_to_string(out.join("report.html")).unwrap();
    assert!(page.contains("Mixed and ordinal models") && out.join("mixed_models.R").is_file());
}

fn copy(from: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    for entry in fs::read_dir(from).unwrap() {
        let entry = entry.unwrap();
        fs::copy(entry.path(), to.join(entry.file_name())).unwrap();
    }
}

#[test]
fn what_is_broken_is_named_and_the_rest_is_reported() {
    let temp_dir = tempfile::tempdir().unwrap();
    let trials = temp_dir.path().join("trials");
    copy(&recorded().join("D"), &trials.join("good"));
    // Killed before its end.
    copy(&recorded().join("D"), &trials.join("interrupted"));
    for file in ["SHA256SUMS", "result.json"] {
        fs::remove_file(trials.join("interrupted").join(file)).unwrap();
    }
    // Damaged on the disk, though it was finished.
    copy(&recorded().join("D"), &trials.join("damaged"));
    let log = trials.join("damaged/inputs.log");
    let mut bytes = fs::read(&log).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 0x55;
    fs::write(&log, bytes).unwrap();
    fs::write(trials.join("nothing.bag"), "this is no bag").unwrap();
    let out = temp_dir.path().join("report");
    let answer = analyze(&trials, &out);
    let notes: Vec<&str> =
        answer["notes"].as_array().unwrap().iter().map(|note| note.as_str().unwrap()).collect();
    for name in ["interrupted", "damaged", "nothing.bag"] {
        assert!(notes.iter().any(|note| note.contains(name)), "{name}: {notes:?}");
    }
    assert_eq!(rows(&out.join("data/trials.csv")).len(), 1);
    // One participant and one method: no statistics, and no word of any.
    assert!(!out.join("tables/friedman.csv").exists() && !out.join("tables/pairs.csv").exists());
    let page = fs::read_to_string(out.join("report.html")).unwrap();
    assert!(page.contains("What is missing or left out") && page.contains("interrupted"), "{page}");
    // The same again takes the folder as its own, without what an earlier report had; another's it does not.
    let stale = out.join("tables/friedman.csv");
    fs::write(&stale, "of another time").unwrap();
    analyze(&trials, &out);
    assert!(!stale.exists());
    let output = proact(&["analyze", trials.to_str().unwrap(), "--out", temp_dir.path().to_str().unwrap()]);
    assert!(!output.status.success());
    assert!(String::from_utf8_lossy(&output.stderr).contains("no earlier report"));
}

#[test]
fn nothing_to_analyse_is_said_with_what_was_expected() {
    let temp_dir = tempfile::tempdir().unwrap();
    for (dir, expected) in
        [(temp_dir.path().to_owned(), "holds nothing to analyse"), (temp_dir.path().join("none"), "none")]
    {
        let output = proact(&["analyze", dir.to_str().unwrap()]);
        assert!(!output.status.success());
        let error = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(error.contains(expected), "{error}");
    }
    fs::write(temp_dir.path().join("trials.csv"), "a,b\n1,2\n").unwrap();
    let output = proact(&["analyze", temp_dir.path().to_str().unwrap()]);
    let error = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(error.contains("none of its columns is known, expected participant"), "{error}");
}

#[test]
fn all_ties_and_a_missing_value_are_said() {
    let temp_dir = tempfile::tempdir().unwrap();
    let dir = temp_dir.path().join("ties");
    fs::create_dir(&dir).unwrap();
    let mut trials = "participant,condition,trial,score\n".to_owned();
    for person in 1..=5 {
        for method in ["A", "B", "C"] {
            if (person, method) != (5, "C") {
                trials += &format!("{person},{method},1,4\n");
            }
        }
    }
    fs::write(dir.join("trials.csv"), trials).unwrap();
    let out = temp_dir.path().join("report");
    analyze(&dir, &out);
    let page = fs::read_to_string(out.join("report.html")).unwrap();
    for text in ["1 of 5 people lack a value", "A and B: nobody differs", "No Friedman test"] {
        assert!(page.contains(text), "{text}");
    }
    assert_eq!(lines(&out.join("tables/success.csv"))[3], "C,4.00,0.00,4.00,4.00,4.00,4,");
}

fn replay_with_overrides(trial: &str, values: &str) -> Output {
    proact(&["replay", recorded().join(trial).to_str().unwrap(), "--override", values, "--json"])
}

#[track_caller]
fn counterfactual(trial: &str, values: &str) -> Value {
    let output = replay_with_overrides(trial, values);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

#[test]
fn the_recorded_values_make_the_recorded_trial_and_others_are_marked_from_where_they_show() {
    let same = counterfactual("D", "intent.gaze_sigma=0.03,emg.consecutive_decisions=3");
    assert_eq!(same["seen_from_s"], Value::Null, "{same}");
    assert_eq!(
        (&same["score"], &same["same_gesture"]),
        (&serde_json::json!([4, 4]), &serde_json::json!(1.0))
    );
    let slower = counterfactual("D", "emg.consecutive_decisions=5");
    assert!(slower["seen_from_s"].as_f64().unwrap() < slower["seconds"].as_f64().unwrap());
    assert!(slower["seen_first"].as_array().unwrap().contains(&serde_json::json!("gesture")), "{slower}");
    let share = slower["same_gesture"].as_f64().unwrap();
    assert!((0.5..0.999).contains(&share), "two decisions later, 100 ms for each change: {slower}");
    assert_eq!(slower, counterfactual("D", "emg.consecutive_decisions=5"), "the same each time");
    let blind = counterfactual("D", "intent_model=prior_only");
    assert!(blind["seen_from_s"].is_number(), "{blind}");
}

#[test]
fn what_is_no_counterfactual_is_refused_with_the_reason() {
    for (values, expected) in [
        ("method=A", "cannot be changed afterwards"),
        ("physics.engine=ode", "cannot be changed afterwards"),
        ("intent.gaze_sigma=none", "intent"),
        ("intent.smear=1", "smear"),
    ] {
        let output = replay_with_overrides("D", values);
        let error = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(!output.status.success() && error.contains(expected), "{values}: {error}");
    }
}
