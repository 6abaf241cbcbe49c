//! Methods, intent models and decoders in another process that fail, as demo, simulate and compare report them.
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
    let temp_dir = tempfile::tempdir().unwrap();
    let broken = method(temp_dir.path(), "broken", "echo nonsense");
    let idle = method(temp_dir.path(), "idle", r#"t=${line#*\"time\":}; echo "{\"time\":${t%%,*}}""#);
    let missing = method(temp_dir.path(), "missing", "true").replace("missing.toml", "gone.toml");
    let text = fs::read_to_string(temp_dir.path().join("missing.toml")).unwrap();
    fs::write(&missing, text.replace("\"sh\"", "\"proact-no-such-program\"")).unwrap();
    for (file, ended, reason) in [
        (&broken, "failed", "answered \"nonsense\""),
        (&idle, "task", "commanded neither the arm nor the hand nor the planner"),
        (&missing, "failed", "proact-no-such-program"),
    ] {
        let output = proact(
            temp_dir.path(),
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
    let temp_dir = tempfile::tempdir().unwrap();
    let broken = method(temp_dir.path(), "broken", "exit 3");
    let methods = format!("A,{broken}");
    let output = proact(
        temp_dir.path(),
        &[
            "simulate",
            "--methods",
            &methods,
            "--seeds",
            "2",
            "--time-limit",
            "0.5",
            "--out",
            "batch",
            "--json",
        ],
    );
    let (batch, error) = texts(&output);
    let (good, bad) = (&batch["methods"]["A"], &batch["methods"]["broken"]);
    assert_eq!((good["trials"].as_u64(), good.get("failed")), (Some(2), None), "{batch}");
    assert_eq!((bad["trials"].as_u64(), bad["failed"].as_u64(), bad.get("mean")), (Some(0), Some(2), None));
    assert!(bad["failure"].as_str().unwrap().contains("exit status: 3"), "{batch}");
    assert!(error.contains("broken: 2 of 2 trials failed"), "{error}");
    assert_eq!(output.status.code(), Some(1), "all trials of a method failed");
    let read = |name: &str| fs::read_to_string(temp_dir.path().join("batch").join(name)).unwrap();
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
        temp_dir.path(),
        &[
            "compare",
            "A",
            "C",
            &broken,
            "--participants",
            "2",
            "--time-limit",
            "0.5",
            "--out",
            "board",
            "--json",
        ],
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

/// The shell program of an intent model that answers each line with the shell command `answer`.
fn intent_model(dir: &Path, name: &str, answer: &str) -> String {
    let path = dir.join(format!("{name}.sh"));
    fs::write(&path, format!("while read line; do {answer}; done\n")).unwrap();
    path.display().to_string()
}

/// A model that never said anything left a trial without a word, and with the exit code 0.
#[test]
fn an_intent_model_that_answers_wrongly_exits_or_never_says_anything_is_told_by_each_command() {
    let temp_dir = tempfile::tempdir().unwrap();
    let cases = [
        ("broken", "echo nonsense", "failed", "answered \"nonsense\""),
        ("gone", "exit 3", "failed", "exit status: 3"),
        ("mute", ":", "failed", "has missed 1 answers in a row"),
        (
            "idle",
            r#"t=${line#*\"time\":}; echo "{\"time\":${t%%,*}}""#,
            "task",
            "intent model gave no posterior",
        ),
    ];
    for (name, answer, ended, reason) in cases {
        let program = intent_model(temp_dir.path(), name, answer);
        let command = format!("sh {program}");
        let demo =
            ["demo", "--headless", "--no-record", "--json", "--method", "D", "--set", "limit_secs=0.5"];
        let words = ["--set", "missed_answers_limit=1", "--intent-command", &command];
        let output = proact(temp_dir.path(), &[&demo[..], &words].concat());
        let (result, error) = texts(&output);
        assert_eq!(
            (output.status.code(), result["ended"].as_str()),
            (Some(1), Some(ended)),
            "{name}: {error}"
        );
        assert!(error.contains(reason), "{name}: {error}");
        // Each answer is waited for, for ten seconds.
        if name == "mute" {
            continue;
        }
        let set = format!("intent_process.command=['sh', '{program}']");
        let own = ["--time-limit", "0.5", "--set", &set, "--json", "--out", name];
        let output =
            proact(temp_dir.path(), &[&["simulate", "--methods", "D", "--seeds", "1"][..], &own].concat());
        let (batch, error) = texts(&output);
        assert!(error.contains(reason), "{name}: {error}");
        let trials = batch["methods"]["D"]["trials"].as_u64();
        assert_eq!(trials, Some(u64::from(ended == "task")), "{name}: {batch}");
        let board = format!("{name}-board");
        let words = [
            "compare",
            "C",
            "D",
            "--participants",
            "2",
            "--time-limit",
            "0.5",
            "--set",
            &set,
            "--json",
            "--out",
            &board,
        ];
        let (board, error) = texts(&proact(temp_dir.path(), &words));
        assert!(error.contains(reason), "{name}: {error}");
        assert_eq!(board["failed"].as_array().unwrap().is_empty(), ended == "task", "{name}: {board}");
    }
}

/// A decoder is learnt with while it is well, and fails in the trial.
#[test]
fn a_decoder_that_answers_wrongly_exits_or_is_always_too_late_ends_a_demo_with_an_error() {
    let temp_dir = tempfile::tempdir().unwrap();
    let program = "import json, os, sys\nplace = os.path.dirname(os.path.abspath(__file__))\n\
        wrong = open(os.path.join(place, 'wrong')).read()\n\
        for line in sys.stdin:\n    window = json.loads(line)['window']\n    answer = {'window': window}\n    \
        if window:\n        if wrong == 'gone':\n            sys.exit(3)\n        if wrong == 'mute':\n            continue\n        \
        answer['posterior'] = [1.0] if wrong == 'short' else [0, 0, 1.0, 0, 0]\n    print(json.dumps(answer), flush=True)\n";
    let write = |name: &str, text: &str| fs::write(temp_dir.path().join(name), text).unwrap();
    write("program.py", program);
    write("process.toml", "command = [\"python3\", \"./program.py\"]\n");
    write("wrong", "nothing");
    let train = [
        "emg",
        "train",
        "--source",
        "synthetic",
        "--no-realtime",
        "--classifier",
        "process",
        "--decoder-process",
        "process.toml",
    ];
    proact(temp_dir.path(), &[&train[..], &["--out", "model.json"]].concat());
    assert!(temp_dir.path().join("model.json").exists());
    let demo = ["demo", "--headless", "--no-record", "--json", "--method", "A", "--set", "limit_secs=1"];
    let words = ["--set", "missed_answers_limit=1", "--emg-model", "model.json"];
    let run = || proact(temp_dir.path(), &[&demo[..], &words].concat());
    let (well, error) = texts(&run());
    assert!(well["ended"] == "task" && error.is_empty(), "{error}");
    for (wrong, reason) in [
        ("short", "posterior has 1 values, expected 5"),
        ("gone", "exit status: 3"),
        ("mute", "has missed 1 answers in a row"),
    ] {
        write("wrong", wrong);
        let output = run();
        let (result, error) = texts(&output);
        assert_eq!(
            (output.status.code(), result["ended"].as_str()),
            (Some(1), Some("failed")),
            "{wrong}: {error}"
        );
        assert!(
            error.contains(reason) && error.contains("gave no decision in time in the whole trial"),
            "{wrong}: {error}"
        );
    }
}
