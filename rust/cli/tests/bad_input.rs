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
    let temp_dir = place();
    let demo = |option, value| refused(temp_dir.path(), &["demo", "--headless", option, value]);
    assert_names(&demo("--method", "X"), &["'X'", "A, B, C, D"]);
    assert_names(&demo("--setup", "standing"), &["\"standing\"", "seated", "still"]);
    assert_names(&demo("--arrangement", "FL,FL,NM,NL"), &["two blocks", "FL"]);
    assert_names(&demo("--seed", "minus"), &["minus"]);
}

#[test]
fn an_emg_folder_that_is_missing_empty_or_lacks_a_gesture_is_refused_with_the_list() {
    let temp_dir = place();
    let demo = |dir: &str| refused(temp_dir.path(), &["demo", "--headless", "--emg", dir]);
    assert_names(&demo("nowhere"), &["nowhere"]);
    fs::create_dir(temp_dir.path().join("empty")).expect("a folder");
    assert_names(&demo("empty"), &["empty"]);

    let incomplete = temp_dir.path().join("lacking");
    fs::create_dir(&incomplete).expect("a folder");
    for repetition in 0..3 {
        for class in [0, 2, 3, 4] {
            write_recording(&incomplete.join(format!("R_{repetition}_C_{class}.csv")), |row, c| {
                format!("{}", (row * (c + 3)) % 17)
            });
        }
    }
    assert_names(&demo("lacking"), &["hand_open", "--fill-missing synthetic"]);
}

#[test]
fn a_recording_with_a_column_missing_or_text_in_a_number_is_refused_with_file_and_row() {
    let temp_dir = place();
    let folder = temp_dir.path().join("emg");
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
    let demo = || refused(temp_dir.path(), &["demo", "--headless", "--emg", "emg"]);

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
    let temp_dir = place();
    fs::write(temp_dir.path().join("file"), "not a folder").expect("writes");
    assert_names(&refused(temp_dir.path(), &["demo", "--headless", "--out", "file/trial"]), &["file/trial"]);
    fs::create_dir(temp_dir.path().join("full")).expect("a folder");
    fs::write(temp_dir.path().join("full/precious"), "keep").expect("writes");
    assert_names(&refused(temp_dir.path(), &["demo", "--headless", "--out", "full"]), &["full"]);
}

#[test]
fn a_port_that_is_taken_is_named() {
    let temp_dir = place();
    let taken = TcpListener::bind("127.0.0.1:0").expect("a free port");
    let port = taken.local_addr().expect("bound").port().to_string();
    let error =
        refused(temp_dir.path(), &["serve", "--no-browser", "--no-record", "--exact-port", "--port", &port]);
    assert_names(&error, &[&port]);
}

#[test]
fn a_configuration_with_an_unknown_key_or_a_broken_value_is_refused_by_name() {
    let temp_dir = place();
    assert_names(&refused(temp_dir.path(), &["run", "missing.toml", "--headless"]), &["missing.toml"]);
    fs::write(temp_dir.path().join("bad.toml"), "method = \"D\"\ncolour = 3\n").expect("writes");
    assert_names(&refused(temp_dir.path(), &["run", "bad.toml", "--headless"]), &["bad.toml", "colour"]);
}

#[test]
fn a_directory_that_is_no_trial_is_refused_by_replay() {
    let temp_dir = place();
    fs::create_dir(temp_dir.path().join("empty")).expect("a folder");
    assert_names(&refused(temp_dir.path(), &["replay", "empty"]), &["empty"]);
    assert_names(&refused(temp_dir.path(), &["replay", "nowhere"]), &["nowhere"]);
}

#[test]
fn a_bad_description_is_explained_and_the_check_fails() {
    let temp_dir = place();
    let urdf = "<robot name=\"r\"><link name=\"a\"/><link name=\"b\"/>\
        <joint name=\"j\" type=\"revolute\"><parent link=\"a\"/><child link=\"c\"/></joint></robot>";
    fs::write(temp_dir.path().join("bad.urdf"), urdf).expect("writes");
    let output = proact(temp_dir.path(), &["model", "check", "bad.urdf"]);
    let text =
        String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr);
    assert!(!output.status.success() && !text.contains("panicked"), "{text}");
    assert_names(&text, &["\"j\"", "\"c\""]);
}

#[test]
fn a_configuration_that_names_a_program_does_not_start_it_unasked() {
    let temp_dir = place();
    let planted = temp_dir.path().join("planted");
    let made = proact(temp_dir.path(), &["demo", "--headless", "--set", "limit_secs=0.1", "--out", "made"]);
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    let text = fs::read_to_string(temp_dir.path().join("made/config.toml")).expect("a configuration");
    for section in ["method_process", "intent_process"] {
        let command = format!("\n[{section}]\ncommand = [\"touch\", {:?}]\n", planted.display().to_string());
        fs::write(temp_dir.path().join("shared.toml"), text.clone() + &command).expect("writes");
        let error = refused(temp_dir.path(), &["run", "shared.toml", "--headless"]);
        let words = format!("{section}.command");
        assert_names(&error, &["shared.toml", "\"touch\"", "planted", &words, "--allow-command"]);
        assert!(!planted.exists(), "{section}");
        // With the option it is started, and then refused for what it says, which is nothing.
        proact(temp_dir.path(), &["run", "shared.toml", "--headless", "--no-record", "--allow-command"]);
        assert!(planted.exists(), "{section}");
        fs::remove_file(&planted).expect("it is there");
    }
}

#[test]
fn an_old_key_is_read_with_one_warning_and_refused_beside_the_new_one() {
    let place = place();
    let warned = |words: &[&str]| {
        let output = proact(place.path(), words);
        let error = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.success(), "{words:?}: {error}");
        error.matches("warning: planner.max_velocity is now planner.max_velocity_rad_per_s").count()
    };
    let demo = ["demo", "--headless", "--set", "limit_secs=0.1"];
    let old = ["--set", "planner.max_velocity=0.4"];
    assert_eq!(
        warned(&[&demo[..], &old, &["--set", "planner.max_velocity=0.3", "--out", "made"]].concat()),
        1
    );
    let text = fs::read_to_string(place.path().join("made/config.toml")).expect("a configuration");
    assert!(text.contains("\nmax_velocity_rad_per_s = 0.3\n"), "{text}");
    fs::write(place.path().join("old.toml"), text.replace("max_velocity_rad_per_s", "max_velocity"))
        .expect("writes");
    assert_eq!(warned(&["run", "old.toml", "--headless", "--no-record"]), 1);
    assert_eq!(warned(&["run", "made/config.toml", "--headless", "--no-record"]), 0);
    assert_eq!(warned(&["replay", "made"]), 0);
    let both = ["--set", "planner.max_velocity_rad_per_s=0.4"];
    let error = refused(place.path(), &[&demo[..], &old, &both].concat());
    assert_names(&error, &["planner.max_velocity is the old name of planner.max_velocity_rad_per_s", "both"]);
}

#[test]
fn files_and_lines_without_end_are_refused_with_their_bound() {
    let temp_dir = place();
    let assert_too_large =
        |words: &[&str]| assert_names(&refused(temp_dir.path(), words), &["more than", "bytes"]);
    assert_too_large(&["run", "/dev/zero", "--headless"]);
    assert_too_large(&["demo", "--headless", "--emg-model", "/dev/zero"]);
    assert_too_large(&["model", "check", "/dev/zero"]);
    assert_too_large(&["model", "check", "/dev/zero", "--srdf", "/dev/zero"]);
    assert_too_large(&["model", "import", "/dev/zero", "--out", "x"]);
    assert_too_large(&["query", "--urdf", "/dev/zero"]);
    assert_too_large(&["analyze", ".", "--intent", "--intent-options", "/dev/zero"]);
    assert_too_large(&["emg", "features", "--csv", "/dev/zero"]);
    let recordings = temp_dir.path().join("recordings");
    fs::create_dir(&recordings).expect("a folder");
    std::os::unix::fs::symlink("/dev/zero", recordings.join("R_0_C_0.csv")).expect("a link");
    assert_too_large(&["emg", "evaluate", "--data", "recordings"]);
}

#[test]
fn a_bad_name_of_a_new_participant_is_refused_before_the_page_starts() {
    // The page started and waited for a person.
    let temp_dir = place();
    assert!(proact(temp_dir.path(), &["study", "new", "pilot"]).status.success());
    for name in ["..", "/abs", "", "two words", &"x".repeat(5000)] {
        let words = ["study", "run", "pilot", "--participant", name, "--enroll", "--no-browser"];
        let error = refused(temp_dir.path(), &words);
        assert_names(&error, &["expected a pseudonym of 1 to 32 letters, digits, - and _"]);
        assert!(error.len() < 200, "{error}");
    }
}

#[test]
fn seconds_beyond_any_clock_are_refused_with_their_range() {
    // Both panicked.
    let temp_dir = place();
    let train = ["emg", "train", "--source", "synthetic", "--out", "model.json", "--timeout", "1e300"];
    assert_names(&refused(temp_dir.path(), &train), &["--timeout is 1e300", "0.001 to 1000000"]);
    let simulate = ["emg", "simulate", "--seconds", "1e300"];
    assert_names(&refused(temp_dir.path(), &simulate), &["--seconds is 1e300", "0.001 to 1000000000"]);
}
