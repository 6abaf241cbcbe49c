//! Bad input at the command line: one clear line on standard error, a failing exit code, nothing half-written.
#![allow(clippy::disallowed_methods)] // A test of files and processes.

use std::{
    fs,
    net::TcpListener,
    path::Path,
    process::{Command, Output},
};

fn proact(dir: &Path, words: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_proact"))
        .args(words)
        .current_dir(dir)
        .output()
        .expect("the binary starts")
}

/// Runs the command, which must fail without a panic and leave the folder as it was; its standard error.
fn refused(dir: &Path, words: &[&str]) -> String {
    let before = listing(dir);
    let output = proact(dir, words);
    let error = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(!output.status.success(), "{words:?} must fail");
    assert!(!error.contains("panicked"), "{error}");
    assert!(output.stdout.is_empty(), "{words:?} printed a result");
    assert_eq!(listing(dir), before, "{words:?} left something behind");
    error
}

fn listing(dir: &Path) -> Vec<String> {
    let mut names: Vec<String> = Vec::new();
    let mut open = vec![dir.to_owned()];
    while let Some(folder) = open.pop() {
        for entry in fs::read_dir(folder).expect("a folder").map(|e| e.expect("an entry").path()) {
            names.push(entry.display().to_string());
            if entry.is_dir() {
                open.push(entry);
            }
        }
    }
    names.sort();
    names
}

fn place() -> tempfile::TempDir {
    tempfile::tempdir().expect("a temporary folder")
}

fn assert_names(error: &str, words: &[&str]) {
    for word in words {
        assert!(error.contains(word), "{word:?} is missing in: {error}");
    }
}

#[test]
fn unknown_method_set_up_and_arrangement_are_refused_with_what_there_is() {
    let place = place();
    let demo = |option, value| refused(place.path(), &["demo", "--headless", option, value]);
    assert_names(&demo("--method", "X"), &["'X'", "A, B, C, D"]);
    assert_names(&demo("--setup", "standing"), &["\"standing\"", "seated", "still"]);
    assert_names(&demo("--arrangement", "FL,FL,NM,NL"), &["two blocks", "FL"]);
    assert_names(&demo("--seed", "minus"), &["minus"]);
}

#[test]
fn an_emg_folder_that_is_missing_empty_or_lacks_a_gesture_is_refused_with_the_list() {
    let place = place();
    let demo = |dir: &str| refused(place.path(), &["demo", "--headless", "--emg", dir]);
    assert_names(&demo("nowhere"), &["nowhere"]);
    fs::create_dir(place.path().join("empty")).expect("a folder");
    assert_names(&demo("empty"), &["empty"]);

    let lacking = place.path().join("lacking");
    fs::create_dir(&lacking).expect("a folder");
    for repetition in 0..3 {
        for class in [0, 2, 3, 4] {
            write_recording(&lacking.join(format!("R_{repetition}_C_{class}.csv")), |row, c| {
                format!("{}", (row * (c + 3)) % 17)
            });
        }
    }
    assert_names(&demo("lacking"), &["hand_open", "--emg-fill synthetic"]);
}

#[test]
fn a_recording_with_a_column_missing_or_text_in_a_number_is_refused_with_file_and_row() {
    let place = place();
    let folder = place.path().join("emg");
    fs::create_dir(&folder).expect("a folder");
    for repetition in 0..3 {
        for class in 0..5 {
            write_recording(&folder.join(format!("R_{repetition}_C_{class}.csv")), |row, c| {
                format!("{}", (row * (c + 3)) % 17)
            });
        }
    }
    let file = folder.join("R_1_C_3.csv");
    let good = fs::read_to_string(&file).expect("written above");
    let demo = || refused(place.path(), &["demo", "--headless", "--emg", "emg"]);

    fs::write(&file, good.replacen("\n", ",5\n", 1)).expect("writes");
    assert_names(&demo(), &["R_1_C_3.csv", "9", "8"]);
    let mut lines: Vec<&str> = good.lines().collect();
    lines[4] = "1,2,three,4,5,6,7,8";
    fs::write(&file, lines.join("\n")).expect("writes");
    assert_names(&demo(), &["R_1_C_3.csv", "5", "three"]);
}

fn write_recording(file: &Path, value: impl Fn(usize, usize) -> String) {
    let row = |row| (0..8).map(|c| value(row, c)).collect::<Vec<_>>().join(",") + "\n";
    fs::write(file, (0..200).map(row).collect::<String>()).expect("writes");
}

#[test]
fn an_output_that_cannot_be_written_or_exists_is_refused_before_anything_runs() {
    let place = place();
    fs::write(place.path().join("file"), "not a folder").expect("writes");
    assert_names(&refused(place.path(), &["demo", "--headless", "--out", "file/trial"]), &["file/trial"]);
    fs::create_dir(place.path().join("full")).expect("a folder");
    fs::write(place.path().join("full/precious"), "keep").expect("writes");
    assert_names(&refused(place.path(), &["demo", "--headless", "--out", "full"]), &["full"]);
}

#[test]
fn a_port_that_is_taken_is_named() {
    let place = place();
    let taken = TcpListener::bind("127.0.0.1:0").expect("a free port");
    let port = taken.local_addr().expect("bound").port().to_string();
    let error =
        refused(place.path(), &["serve", "--no-browser", "--no-record", "--exact-port", "--port", &port]);
    assert_names(&error, &[&port]);
}

#[test]
fn a_configuration_with_an_unknown_key_or_a_broken_value_is_refused_by_name() {
    let place = place();
    assert_names(&refused(place.path(), &["run", "missing.toml", "--headless"]), &["missing.toml"]);
    fs::write(place.path().join("bad.toml"), "method = \"D\"\ncolour = 3\n").expect("writes");
    assert_names(&refused(place.path(), &["run", "bad.toml", "--headless"]), &["bad.toml", "colour"]);
}

#[test]
fn a_directory_that_is_no_trial_is_refused_by_replay() {
    let place = place();
    fs::create_dir(place.path().join("empty")).expect("a folder");
    assert_names(&refused(place.path(), &["replay", "empty"]), &["empty"]);
    assert_names(&refused(place.path(), &["replay", "nowhere"]), &["nowhere"]);
}

#[test]
fn a_bad_description_is_explained_and_the_check_fails() {
    let place = place();
    let urdf = "<robot name=\"r\"><link name=\"a\"/><link name=\"b\"/>\
        <joint name=\"j\" type=\"revolute\"><parent link=\"a\"/><child link=\"c\"/></joint></robot>";
    fs::write(place.path().join("bad.urdf"), urdf).expect("writes");
    let output = proact(place.path(), &["model", "check", "bad.urdf"]);
    let text =
        String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr);
    assert!(!output.status.success() && !text.contains("panicked"), "{text}");
    assert_names(&text, &["\"j\"", "\"c\""]);
}

#[test]
fn a_configuration_that_names_a_program_does_not_start_it_unasked() {
    let place = place();
    let planted = place.path().join("planted");
    let made = proact(place.path(), &["demo", "--headless", "--set", "limit_secs=0.1", "--out", "made"]);
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    let text = fs::read_to_string(place.path().join("made/config.toml")).expect("a configuration");
    for section in ["method_process", "intent_process"] {
        let command = format!("\n[{section}]\ncommand = [\"touch\", {:?}]\n", planted.display().to_string());
        fs::write(place.path().join("shared.toml"), text.clone() + &command).expect("writes");
        let error = refused(place.path(), &["run", "shared.toml", "--headless"]);
        let words = format!("{section}.command");
        assert_names(&error, &["shared.toml", "\"touch\"", "planted", &words, "--allow-command"]);
        assert!(!planted.exists(), "{section}");
        // With the option it is started, and then refused for what it says, which is nothing.
        proact(place.path(), &["run", "shared.toml", "--headless", "--no-record", "--allow-command"]);
        assert!(planted.exists(), "{section}");
        fs::remove_file(&planted).expect("it is there");
    }
}

#[test]
fn files_and_lines_without_end_are_refused_with_their_bound() {
    let place = place();
    let endless = |words: &[&str]| assert_names(&refused(place.path(), words), &["more than", "bytes"]);
    endless(&["run", "/dev/zero", "--headless"]);
    endless(&["demo", "--headless", "--emg-model", "/dev/zero"]);
    endless(&["model", "check", "/dev/zero"]);
    endless(&["model", "check", "/dev/zero", "--srdf", "/dev/zero"]);
    endless(&["model", "import", "/dev/zero", "--out", "x"]);
    endless(&["query", "--urdf", "/dev/zero"]);
    endless(&["analyze", ".", "--intent", "--options", "/dev/zero"]);
    endless(&["emg", "features", "--csv", "/dev/zero"]);
    let recordings = place.path().join("recordings");
    fs::create_dir(&recordings).expect("a folder");
    std::os::unix::fs::symlink("/dev/zero", recordings.join("R_0_C_0.csv")).expect("a link");
    endless(&["emg", "evaluate", "--data", "recordings"]);
}

#[test]
fn a_bad_name_of_a_new_participant_is_refused_before_the_page_starts() {
    // The page started and waited for a person.
    let place = place();
    assert!(proact(place.path(), &["study", "new", "pilot"]).status.success());
    for name in ["..", "/abs", "", "two words", &"x".repeat(5000)] {
        let words = ["study", "run", "pilot", "--participant", name, "--new", "--no-browser"];
        let error = refused(place.path(), &words);
        assert_names(&error, &["expected a pseudonym of 1 to 32 letters, digits, - and _"]);
        assert!(error.len() < 200, "{error}");
    }
}

#[test]
fn seconds_beyond_any_clock_are_refused_with_their_range() {
    // Both panicked.
    let place = place();
    let train = ["emg", "train", "--source", "synthetic", "--out", "model.json", "--patience", "1e300"];
    assert_names(&refused(place.path(), &train), &["--patience is 1e300", "0.001 to 1000000"]);
    let simulate = ["emg", "simulate", "--seconds", "1e300"];
    assert_names(&refused(place.path(), &simulate), &["--seconds is 1e300", "0.001 to 1000000000"]);
}
