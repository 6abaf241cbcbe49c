//! The driver finds what it is there for: each kind of fault is planted, and must be told with the input that shows it.
#![allow(clippy::disallowed_methods, clippy::unwrap_used)] // A test of processes and files.

use std::{
    fs,
    process::{Command, Output},
};

fn fuzz(words: &[&str], dir: &std::path::Path) -> Output {
    Command::new(env!("CARGO_BIN_EXE_proact-fuzz")).args(words).current_dir(dir).output().unwrap()
}

/// Runs a planted fault, which must be found as `kind`; then its input again.
fn found(target: &str, kind: &str) {
    let temp_dir = tempfile::tempdir().unwrap();
    let output = fuzz(&[target, "--seconds", "1"], temp_dir.path());
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(!output.status.success(), "{target} is found: {text}");
    assert!(text.contains(&format!("FOUND {target}")) && text.contains(kind), "{text}");
    let again = text.lines().find_map(|line| line.trim().strip_prefix("again: proact-fuzz ")).unwrap();
    let words: Vec<&str> = again.split(' ').collect();
    assert!(temp_dir.path().join(words[2]).is_file(), "{again}");
    assert!(!fuzz(&words, temp_dir.path()).status.success(), "{again}");
}

#[test]
fn a_planted_panic_is_found() {
    found("planted_panic", "planted.rs");
}

#[test]
fn a_planted_panic_of_another_thread_is_found() {
    found("planted_thread", "planted.rs");
}

#[test]
fn a_planted_stack_overflow_is_found() {
    found("planted_stack", "overflow");
}

#[test]
fn a_planted_hang_is_found() {
    found("planted_hang", "no end within 0.5 s");
}

#[test]
fn a_planted_allocation_without_bound_is_found() {
    found("planted_memory", "allocation of more than there is");
}

#[test]
fn a_target_without_a_fault_passes_and_one_without_a_corpus_is_refused() {
    let temp_dir = tempfile::tempdir().unwrap();
    let refused = fuzz(&["udp_libemg"], temp_dir.path());
    assert!(!refused.status.success());
    assert!(String::from_utf8_lossy(&refused.stderr).contains("--corpus"));
    let folder = temp_dir.path().join("tests/fuzz/corpus/udp_libemg");
    fs::create_dir_all(&folder).unwrap();
    fs::write(folder.join("class.txt"), "2 0.75\n").unwrap();
    let passed = fuzz(&["udp_libemg", "--seconds", "0.2"], temp_dir.path());
    assert!(passed.status.success(), "{}", String::from_utf8_lossy(&passed.stdout));
    assert!(!fuzz(&["no_such_target"], temp_dir.path()).status.success());
}
