//! A classifier in another process on the command line: trained, judged, and used on a stream.
#![allow(clippy::unwrap_used, clippy::disallowed_methods)] // A test of programs starts programs.

mod common;

use common::{event, proact, stream};
use serde_json::Value;
use std::path::Path;

const EXAMPLE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/decoders/nearest_centroid.toml");

fn at(dir: &Path, name: &str) -> String {
    dir.join(name).to_str().unwrap().to_owned()
}

fn answered(words: &[&str]) -> Value {
    let output = proact(words).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

fn refused(words: &[&str]) -> String {
    let output = proact(words).output().unwrap();
    assert!(!output.status.success());
    String::from_utf8_lossy(&output.stderr).into_owned()
}

#[test]
fn the_documented_example_is_trained_judged_by_itself_and_recognises_a_stream() {
    let dir = tempfile::tempdir().unwrap();
    let (model, recordings) = (at(dir.path(), "model.json"), at(dir.path(), "recordings"));
    let process = ["--classifier", "process", "--decoder-process", EXAMPLE];
    let train = ["train", "--source", "synthetic", "--no-realtime", "--out", &model, "--save", &recordings];
    let trained = answered(&[&train[..], &process].concat());
    let own = trained["process"]["accuracy"].as_f64().unwrap();
    assert!(own > 0.8 && own != trained["accuracy"].as_f64().unwrap(), "{own} of its own");
    let evaluate = ["evaluate", "--data", &recordings, "--train-repetitions", "0", "--test-repetitions", "1"];
    let evaluation = answered(&[&evaluate[..], &process].concat());
    assert!(evaluation["accuracy"].as_f64().unwrap() > 0.8, "{evaluation}");
    let source = format!("file:{recordings}");
    let lines =
        stream(&["--source", &source, "--source-repetition", "1", "--no-realtime", "--model", &model]);
    let seen: std::collections::BTreeSet<&str> = lines.iter().filter_map(|l| l["gesture"].as_str()).collect();
    assert!(seen.len() >= 4, "{seen:?}");
    assert!(event(&lines, "stale").is_empty(), "each window has an answer");
    // One round cannot be judged: the model is written, and the command says so.
    let one = at(dir.path(), "one.json");
    let train = ["train", "--source", &source, "--repetitions", "0", "--out", &one];
    let error = refused(&[&train[..], &process].concat());
    assert!(error.contains("not judged") && Path::new(&one).exists(), "{error}");
}

#[test]
fn what_a_process_lacks_is_said_before_anybody_holds_a_gesture() {
    let dir = tempfile::tempdir().unwrap();
    let out = at(dir.path(), "model.json");
    let train = |words: &[&str]| {
        refused(&[&["train", "--source", "synthetic", "--no-realtime", "--out", &out], words].concat())
    };
    assert!(train(&["--classifier", "process"]).contains("expected the program's command"));
    assert!(train(&["--decoder-process", EXAMPLE]).contains("emg.classifier is lda"));
    let bad = at(dir.path(), "bad.toml");
    std::fs::write(&bad, "command = [\"python3\"]\ninput = \"music\"\n").unwrap();
    let error = train(&["--classifier", "process", "--decoder-process", &bad]);
    assert!(error.contains("bad.toml") && error.contains("line 2") && error.contains("music"), "{error}");
    std::fs::write(&bad, "command = [\"python3\", \"-c\", \"pass\"]\n").unwrap();
    let error = train(&["--classifier", "process", "--decoder-process", &bad]);
    assert!(error.contains("does not start") && error.contains("has ended"), "{error}");
    assert!(!Path::new(&out).exists(), "no model of a process that does not answer");
    // It begins well, and does not learn; it learns, and answers with one value too few.
    let program = at(dir.path(), "program.py");
    std::fs::write(&bad, "command = [\"python3\", \"./program.py\"]\n").unwrap();
    for (learns, why) in [("raise ValueError", "has ended"), ("pass", "posterior")] {
        let text = format!(
            "import json, sys\nfor line in sys.stdin:\n    asked = json.loads(line)\n    if 'fit' in asked:\n        {learns}\n    \
             answer = {{'window': asked['window']}}\n    if asked['window'] > 0:\n        answer['posterior'] = [1.0]\n    \
             print(json.dumps(answer), flush=True)\n"
        );
        std::fs::write(&program, text).unwrap();
        let error = train(&["--classifier", "process", "--decoder-process", &bad]);
        assert!(error.contains(why) && error.contains("tried before anything was recorded"), "{error}");
        assert!(!Path::new(&format!("{out}.recordings")).exists(), "no repetition was asked for");
    }
}
