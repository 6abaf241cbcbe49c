//! `proact` in a folder, and what it answers.

use serde_json::Value;
use std::{
    collections::BTreeMap,
    path::Path,
    process::{Command, Output},
};

/// Runs `proact` with `words` in `dir`.
pub fn proact(dir: &Path, words: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_proact")).args(words).current_dir(dir).output().unwrap()
}

/// What it prints; it must succeed.
#[track_caller]
pub fn answer(dir: &Path, words: &[&str]) -> String {
    let output = proact(dir, words);
    assert!(output.status.success(), "{words:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

/// The same as JSON.
#[track_caller]
pub fn json(dir: &Path, words: &[&str]) -> Value {
    serde_json::from_str(&answer(dir, words)).unwrap()
}

/// What it says on standard error; it must fail.
#[track_caller]
pub fn refusal(dir: &Path, words: &[&str]) -> String {
    let output = proact(dir, words);
    assert!(!output.status.success(), "{words:?} is refused: {}", String::from_utf8_lossy(&output.stdout));
    String::from_utf8(output.stderr).unwrap()
}

/// Rows of the table `name` in a folder, as the columns by name.
#[track_caller]
pub fn table(dir: &Path, name: &str) -> Vec<BTreeMap<String, String>> {
    let mut reader = csv::Reader::from_path(dir.join(format!("{name}.csv"))).unwrap();
    reader.deserialize().map(|row| row.unwrap()).collect()
}
