//! Old names on the command line of the program: the same answer, a line on standard error.
#![allow(clippy::unwrap_used, clippy::disallowed_methods)] // A test of programs starts programs.

mod common;

use common::{plain, proact};

/// Standard output and standard error of a command that succeeds.
fn outputs(words: &[&str]) -> (String, String) {
    let output = proact(words).output().unwrap();
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
    let (out, err) = (text(output.stdout), text(output.stderr));
    assert!(output.status.success(), "{err}");
    (out, err)
}

#[test]
fn old_names_change_no_answer_and_are_told_once_on_standard_error() {
    let dir = tempfile::tempdir().unwrap();
    let path = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
    let (model, recordings) = (path("model.json"), path("recordings"));
    let train = ["train", "--source", "synthetic", "--out", &model, "--save", &recordings];
    let (_, warned) = outputs(&[&train[..], &["--flat-out", "--rounds", "3", "--least-rounds=3"]].concat());
    for warning in [
        "--flat-out is now --no-realtime",
        "--rounds is now --max-rounds",
        "--least-rounds is now --min-rounds",
    ] {
        assert_eq!(warned.lines().filter(|line| *line == warning).count(), 1, "{warned}");
    }
    let evaluate = |words: [&str; 4]| outputs(&[&["evaluate", "--data", &recordings][..], &words].concat());
    let (answer, silent) = evaluate(["--train-repetitions", "0,1", "--test-repetitions", "2"]);
    let (same, warned) = evaluate(["--train-reps", "0,1", "--test-reps", "2"]);
    assert_eq!(answer, same);
    let warnings = "--train-reps is now --train-repetitions\n--test-reps is now --test-repetitions\n";
    assert_eq!(warned, format!("{warnings}{silent}"));
    assert!(!silent.contains("is now"), "{silent}");
    let words = ["test", "--model", &model, "--source", "synthetic", "--flat-out", "--no-realtime"];
    let both = plain(&words).output().unwrap();
    let error = String::from_utf8(both.stderr).unwrap();
    assert!(
        !both.status.success() && error.contains("'--no-realtime' cannot be used multiple times"),
        "{error}"
    );
}
