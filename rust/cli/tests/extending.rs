//! The worked examples of docs/extending.md, built and run: a method in Rust and one in Python, an armband, a feedback
//! device.
#![allow(clippy::unwrap_used, clippy::disallowed_methods)] // A test of programs starts programs.

use serde_json::Value;
use std::{
    fs,
    io::Write,
    net::TcpListener,
    path::{Path, PathBuf},
    process::{Command, Output},
    thread,
    time::Duration,
};

const METHOD_FILE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/methods/follow_gaze.toml");

/// The example program, which cargo builds with the tests.
fn laboratory() -> PathBuf {
    let test = std::env::current_exe().unwrap();
    let program = test.parent().and_then(Path::parent).unwrap().join("examples/laboratory");
    assert!(
        program.is_file(),
        "build it first: cargo build -p proact-cli --example laboratory, in the test's profile"
    );
    program
}

fn run(program: &Path, words: &[&str]) -> Output {
    Command::new(program).args(words).output().unwrap()
}

fn stderr_text(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// What the program says on standard output, if it succeeds.
fn stdout_text(program: &Path, words: &[&str]) -> String {
    let output = run(program, words);
    assert!(output.status.success(), "{words:?}: {}", stderr_text(&output));
    String::from_utf8(output.stdout).unwrap()
}

const SHORT: [&str; 6] = ["demo", "--headless", "--json", "--setup", "still", "--set=limit_secs=20.0"];

#[test]
fn a_method_in_rust_is_chosen_by_its_name_and_its_trial_is_recorded_and_replayed() {
    let (program, temp_dir) = (laboratory(), tempfile::tempdir().unwrap());
    let dir = temp_dir.path().join("trial");
    let out = dir.to_str().unwrap();
    let result = stdout_text(&program, &[&SHORT[..], &["--method", "follow_gaze", "--out", out]].concat());
    let result: Value = serde_json::from_str(&result).unwrap();
    assert_eq!(result["method"], "follow_gaze");
    assert!(stdout_text(&program, &["replay", out]).starts_with("agrees: "));
    // The program that ships does not know it, and says what it knows.
    let refused = run(env!("CARGO_BIN_EXE_proact").as_ref(), &["replay", out]);
    let reason = "method \"follow_gaze\" is unknown; expected one of A, B, C, D";
    assert!(!refused.status.success() && stderr_text(&refused).contains(reason), "{}", stderr_text(&refused));
    let help = stdout_text(&program, &["demo", "--help"]);
    assert!(help.contains("follow_gaze: Towards what you look at") && help.contains("log:PATH"), "{help}");
    let listed = stdout_text(&program, &["doctor", "--json"]);
    assert!(
        listed.contains("A, B, C, D, vmpl, synergy, imitate, follow_gaze")
            && listed.contains("textband://HOST:PORT"),
        "{listed}"
    );
}

#[test]
fn a_method_in_python_is_chosen_by_its_file_and_its_trial_replays_without_it() {
    let (program, temp_dir) = (Path::new(env!("CARGO_BIN_EXE_proact")), tempfile::tempdir().unwrap());
    let dir = temp_dir.path().join("trial");
    let out = dir.to_str().unwrap();
    let result = stdout_text(program, &[&SHORT[..], &["--method", METHOD_FILE, "--out", out]].concat());
    let result: Value = serde_json::from_str(&result).unwrap();
    assert_eq!(result["method"], "follow_gaze");
    assert!(stdout_text(program, &["replay", out]).starts_with("agrees: "));
    let config = fs::read_to_string(dir.join("config.toml")).unwrap();
    assert!(config.contains("title = \"Towards what you look at\""), "{config}");
    let help = stdout_text(program, &["serve", "--method", METHOD_FILE, "--help"]);
    assert!(help.contains("follow_gaze: Towards what you look at"), "{help}");
    let refused = run(program, &["demo", "--method", METHOD_FILE, "--headless", "--set", "gaze=false"]);
    assert!(stderr_text(&refused).contains("method \"follow_gaze\" needs gaze"), "{}", stderr_text(&refused));
}

#[test]
fn a_feedback_device_gets_events_and_forces_beside_the_driver_of_motors() {
    let (program, temp_dir) = (laboratory(), tempfile::tempdir().unwrap());
    let file = |name: &str| temp_dir.path().join(name).display().to_string();
    let (log, motors) = (file("cues.txt"), file("motors.txt"));
    fs::write(&motors, "").unwrap();
    let (to_log, to_motors) = (format!("log:{log}"), format!("vibration:{motors}"));
    let mappings = "feedback=[{ from = \"event\", event = \"contact_made\", vibration = { strength = 1.0, ms = 150 } }, \
                    { from = \"pressure\", full_n = 5.0 }]";
    let words = ["demo", "--headless", "--json", "--no-record", "--seed", "1", "--set=limit_secs=60.0"];
    let sinks = ["--feedback", &to_log, "--feedback", &to_motors, "--set", mappings];
    stdout_text(&program, &[&words[..], &sinks].concat());
    let cues = fs::read_to_string(&log).unwrap();
    assert!(cues.contains("ContactMade, all, strength 1.00"), "{cues}");
    let pressed: Vec<&str> = cues.lines().filter(|line| line.contains("Pressure")).collect();
    assert!(pressed.iter().any(|line| !line.ends_with("strength 0.00")), "{cues}");
    assert!(!pressed.iter().any(|line| line.contains("all")), "each is of a digit");
    let lines = fs::read_to_string(&motors).unwrap();
    assert!(lines.lines().any(|line| line == "V * 255 150"), "{lines}");
    assert!(lines.lines().all(|line| line.parse::<proact_devices::VibrationLine>().is_ok()), "{lines}");
}

#[test]
fn an_armband_is_opened_by_its_scheme() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let source = format!("textband://{}", listener.local_addr().unwrap());
    thread::spawn(move || {
        let (mut link, _) = listener.accept().unwrap();
        for k in 0..2000_i64 {
            // All channels change: a flat one is taken for dead.
            let value = |channel: i64| ((k * (channel + 3) * 7919) % 61 - 30).to_string();
            let values: Vec<String> = (0..8).map(value).collect();
            let line = if k == 100 { "noise\n".to_owned() } else { values.join(",") + "\n" };
            link.write_all(line.as_bytes()).unwrap();
            // At the rate of the armband: a stream that is much faster is taken for a wrong one.
            if k % 20 == 0 {
                thread::sleep(Duration::from_millis(20));
            }
        }
    });
    let text = stdout_text(&laboratory(), &["emg", "--json", "stream", "--source", &source]);
    let lines: Vec<Value> = text.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert_eq!(lines[0]["event"], "open");
    assert!(lines[0]["source"].as_str().unwrap().starts_with("text band at 127.0.0.1:"), "{}", lines[0]);
    let decisions = lines.iter().filter(|line| line.get("event").is_none()).count();
    assert!(decisions >= 5, "two seconds of samples, in windows: {text}");
    let refused = run(&laboratory(), &["emg", "stream", "--source", "textband"]);
    assert!(
        stderr_text(&refused).contains("expected one of gforce-sim://HOST:PORT"),
        "{}",
        stderr_text(&refused)
    );
}
