//! The simulated armband feeds the recogniser over the gForce protocol: two processes and a socket between them.
#![allow(clippy::unwrap_used, clippy::disallowed_methods)] // A test of programs starts programs.

mod common;

use common::{Running, event, proact, stream};
use serde_json::Value;
use std::{
    io::{BufRead, BufReader},
    path::{Path, PathBuf},
    process::Stdio,
};

/// Starts a simulator on a free port; the address that it prints.
fn simulator(words: &[&str]) -> (Running, String) {
    let mut command = proact(&[&["simulate", "--port", "0", "--seconds", "60"], words].concat());
    let mut child = command.stdout(Stdio::piped()).spawn().unwrap();
    let mut line = String::new();
    BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
    let opened: Value = serde_json::from_str(&line).unwrap_or_else(|e| panic!("{line:?}: {e}"));
    (Running(child), opened["address"].as_str().unwrap().to_owned())
}

/// What the simulator holds, with the time at which each ends.
const SCRIPT: &str = "no_motion:1,hand_close:1,no_motion:1,wrist_extension:1,no_motion:1,wrist_flexion:1";
const HELD: [(&str, f64); 6] = [
    ("no_motion", 1.0),
    ("hand_close", 2.0),
    ("no_motion", 3.0),
    ("wrist_extension", 4.0),
    ("no_motion", 5.0),
    ("wrist_flexion", 6.0),
];
/// A window that begins before a change holds two gestures, and has no right class.
const WINDOW_SECS: f64 = 0.1;

/// Share of decisions whose newest window is of the gesture held, and the number of decisions.
/// Decisions on windows within the last second of a held gesture, with that gesture.
fn settled(lines: &[Value], rate_hz: f64) -> Vec<(&Value, &'static str)> {
    let decisions = lines.iter().filter(|l| l.get("event").is_none() && l["stale"] == false);
    let gesture = |line: &&Value| {
        let end = (line["sample"].as_f64().unwrap() + 1.0) / rate_hz % 6.0;
        let begin = end - WINDOW_SECS;
        let held = HELD.iter().find(|(_, until)| begin < *until);
        held.filter(|(_, until)| begin >= until - 1.0 && end <= *until).map(|(gesture, _)| *gesture)
    };
    decisions.filter_map(|line| Some((line, gesture(&line)?))).collect()
}

fn score(lines: &[Value], rate_hz: f64) -> (f64, usize) {
    let settled = settled(lines, rate_hz);
    let right = settled.iter().filter(|(line, gesture)| line["window_class"] == *gesture).count();
    (right as f64 / settled.len() as f64, settled.len())
}

#[test]
fn the_simulator_feeds_the_recogniser_and_its_classes_are_right() {
    let (_running, address) = simulator(&["--gesture-sequence", SCRIPT]);
    let dir = tempfile::tempdir().unwrap();
    let record = dir.path().join("stream.edf");
    let source = format!("gforce-sim://{address}");
    let lines = stream(&["--source", &source, "--seconds", "6.3", "--record", record.to_str().unwrap()]);
    let open = event(&lines, "open")[0];
    assert_eq!((&open["rate_hz"], &open["channels"]), (&1000.0.into(), &8.into()));
    let (share, decisions) = score(&lines, 1000.0);
    assert!(decisions > 80 && share > 0.95, "{share} of {decisions}");
    // Windows end where the device's counter says, whatever the clock did.
    let ends: Vec<u64> = lines.iter().filter_map(|l| l["sample"].as_u64()).collect();
    assert!(ends.iter().zip(0..).all(|(end, k)| *end == 99 + 50 * k), "{ends:?}");
    let end = event(&lines, "end")[0];
    assert_eq!(end["link"]["lost_samples"], 0);
    let recorded = proact_devices::read_recorded(&record).unwrap();
    assert_eq!(Some(recorded.samples.len() as u64), end["recorded_samples"].as_u64());
    assert_eq!(recorded.rate_hz, 1000.0);

    // What was recorded, played flat out, is recognised as it was live.
    let file = format!("file:{}", record.display());
    let again = stream(&["--source", &file, "--adc-zero", "128", "--no-realtime"]);
    let classes = |lines: &[Value]| -> Vec<(u64, String)> {
        let decisions = lines.iter().filter(|l| l["sample"].is_u64());
        decisions.map(|l| (l["sample"].as_u64().unwrap(), l["window_class"].to_string())).collect()
    };
    assert_eq!(classes(&again), classes(&lines));
}

#[test]
fn a_poor_radio_leaves_gaps_and_no_wrong_classes() {
    let faults = [
        "--loss-rate",
        "0.01",
        "--duplicate-rate",
        "0.02",
        "--reorder-rate",
        "0.01",
        "--truncation-rate",
        "0.005",
        "--jitter-ms",
        "8",
    ];
    // Every packet is three fragments.
    let (_running, address) = simulator(
        &[&["--gesture-sequence", SCRIPT, "--notification-bytes", "60", "--seed", "3"], &faults[..]].concat(),
    );
    let lines = stream(&["--source", &format!("gforce-sim://{address}"), "--seconds", "6"]);
    let end = event(&lines, "end")[0];
    assert!(end["link"]["lost_samples"].as_u64() > Some(0), "{end}");
    assert!(!event(&lines, "gap").is_empty());
    assert!(end["stream"]["rejected_windows"].as_u64() > Some(0), "{end}");
    // With this seed the first packet comes through, so that the counters are the simulator's.
    // A window over a bridged gap may be of another class, which no motion follows from.
    let (share, decisions) = score(&lines, 1000.0);
    assert!(decisions > 20 && share > 0.9, "{share} of {decisions}");
    for (line, held) in settled(&lines, 1000.0) {
        assert!(line["gesture"] == held || line["gesture"] == "no_motion", "{held} was held: {line}");
    }
}

#[test]
fn an_armband_that_goes_away_stops_the_arm_at_once() {
    let (running, address) = simulator(&["--gesture-sequence", "hand_close:9"]);
    let mut child = proact(&["stream", "--source", &format!("gforce-sim://{address}"), "--seconds", "4"]);
    let mut child = Running(child.stdout(Stdio::piped()).spawn().unwrap());
    let mut lines = BufReader::new(child.0.stdout.take().unwrap()).lines().map(|l| {
        let line = l.unwrap();
        serde_json::from_str::<Value>(&line).unwrap()
    });
    let closed = lines.by_ref().find(|l| l["gesture"] == "hand_close");
    assert!(closed.is_some(), "it never closed");
    drop(running);
    let rest: Vec<Value> = lines.collect();
    let lost = rest.iter().position(|l| l["event"] == "lost").expect("the loss is reported");
    let stale = rest[lost..].iter().find(|l| l["stale"] == true).expect("the stream becomes stale");
    assert_eq!(stale["gesture"], "no_motion");
    let waited = stale["t_s"].as_f64().unwrap() - rest[lost]["t_s"].as_f64().unwrap();
    // 200 ms after the last window, which is up to 50 ms before the loss; the rest is the load of the machine.
    assert!((0.1..1.0).contains(&waited), "{waited} s");
    assert!(rest[lost..].iter().all(|l| l["gesture"].is_null() || l["gesture"] == "no_motion"));
}

#[test]
fn real_recordings_replayed_through_the_armband_are_recognised() {
    let shared = std::env::var_os("PROACT_SHARED")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared"), PathBuf::from);
    let data = shared.join("data/emg/libemg_tests_myo");
    if !data.is_dir() {
        println!("skipped: ../shared not found");
        return;
    }
    let data = data.to_str().unwrap();
    let (_running, address) = simulator(&["--data", data, "--gesture-sequence", SCRIPT]);
    let source = format!("gforce-sim://{address}");
    let lines = stream(&["--source", &source, "--data", data, "--seconds", "6.5"]);
    assert_eq!(event(&lines, "open")[0]["rate_hz"], 200.0);
    let (share, decisions) = score(&lines, 200.0);
    assert!(decisions > 80 && share > 0.95, "{share} of {decisions}");
}

#[test]
fn a_source_that_cannot_be_is_refused_with_what_there_is() {
    let refused = |words: &[&str]| {
        let output = proact(&[&["stream"], words].concat()).output().unwrap();
        assert!(!output.status.success() && output.stdout.is_empty());
        String::from_utf8(output.stderr).unwrap()
    };
    assert!(refused(&["--source", "usb"]).contains("expected one of gforce-sim://HOST:PORT"));
    assert!(refused(&["--source", "gforce-sim://127.0.0.1:1"]).contains("nothing answers at 127.0.0.1:1"));
    assert!(refused(&["--source", "file:/nowhere"]).contains("cannot read /nowhere"));
    if !cfg!(feature = "ble") {
        assert!(refused(&["--source", "ble"]).contains("--features ble"));
    }
}

/// A model of synthetic EMG at `rate_hz`, raw codes about `zero`.
fn write_model(path: &Path, rate_hz: f64, zero: f64) {
    use proact_devices::{SyntheticEmg, SyntheticModel};
    use proact_emg::{EmgConfig, EmgModel};
    use proact_types::{Command, EmgSample};
    let rng = proact_devices::random_stream(9, "test");
    let shipped = SyntheticModel::shipped().unwrap();
    let mut emg = SyntheticEmg::new(&shipped, rate_hz, 8, 1.0, rng).unwrap();
    let mut record = |gesture| -> Vec<EmgSample> {
        let mut raw = || emg.next(gesture).iter().map(|v| (v + zero).round()).collect();
        (0..(6.0 * rate_hz) as u64).map(|counter| EmgSample { counter, channels: raw() }).collect()
    };
    let recordings = Command::ALL.map(|gesture| (gesture, record(gesture)));
    let slices: Vec<(Command, &[EmgSample])> = recordings.iter().map(|(g, s)| (*g, s.as_slice())).collect();
    let config = EmgConfig { rate_hz, ..EmgConfig::default() };
    let model = EmgModel::train(&config, &[zero; 8], &slices).unwrap();
    std::fs::write(path, model.to_json().unwrap()).unwrap();
}

#[test]
fn a_model_file_is_used_with_its_zero_level_and_one_of_another_band_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let (fits, other) = (dir.path().join("fits.json"), dir.path().join("other.json"));
    write_model(&fits, 1000.0, 128.0);
    write_model(&other, 200.0, 128.0);
    let (_running, address) = simulator(&["--gesture-sequence", SCRIPT]);
    let source = format!("gforce-sim://{address}");
    let lines = stream(&["--source", &source, "--model", fits.to_str().unwrap(), "--seconds", "2"]);
    let (share, decisions) = score(&lines, 1000.0);
    assert!(decisions > 20 && share > 0.95, "{share} of {decisions}");
    let output =
        proact(&["stream", "--source", &source, "--model", other.to_str().unwrap()]).output().unwrap();
    let error = String::from_utf8(output.stderr).unwrap();
    assert!(
        !output.status.success() && error.contains("trained at 200 Hz, the stream has 1000 Hz"),
        "{error}"
    );
}

#[test]
fn a_simulated_myo_feeds_the_recogniser_too() {
    let (_running, address) = simulator(&["--myo", "--gesture-sequence", SCRIPT]);
    let lines = stream(&["--source", &format!("myo-sim://{address}"), "--seconds", "7"]);
    let open = event(&lines, "open")[0];
    assert_eq!((&open["rate_hz"], &open["channels"]), (&200.0.into(), &8.into()));
    let (share, decisions) = score(&lines, 200.0);
    assert!(share > 0.95 && decisions > 60, "{share} of {decisions}");
    assert_eq!(event(&lines, "end")[0]["link"]["lost_samples"], 0);
}

/// A stream a hundred times as loud as the training, and one with held channels, were decoded without a word.
#[test]
fn a_stream_that_is_not_as_its_training_is_told_once_a_second_at_most() {
    let dir = tempfile::tempdir().unwrap();
    let model = dir.path().join("model.json");
    write_model(&model, 1000.0, 0.0);
    let shipped = proact_devices::SyntheticModel::shipped().unwrap();
    let played = |name: &str, gain: f64, held: u64| {
        let folder = dir.path().join(name);
        std::fs::create_dir(&folder).unwrap();
        let mut emg = proact_devices::SyntheticEmg::new(
            &shipped,
            1000.0,
            8,
            1.0,
            proact_devices::random_stream(5, "test"),
        )
        .unwrap();
        let mut row: Vec<f64> = vec![0.0; 8];
        let rows = (0..12_000_u64).map(|k| {
            let new = emg.next(proact_types::Command::HandClose);
            for channel in 0..8 {
                if channel > 3 || k % held == 0 {
                    row[channel] = (gain * new[channel]).round();
                }
            }
            row.iter().map(f64::to_string).collect::<Vec<_>>().join(",")
        });
        let text = rows.collect::<Vec<_>>().join("\n") + "\n";
        std::fs::write(folder.join("R_0_C_0.csv"), text).unwrap();
        let source = format!("file:{}", folder.display());
        let words = [
            "--source",
            &source,
            "--source-repetition",
            "0",
            "--emg-rate",
            "1000",
            "--no-realtime",
            "--accept-faults",
            "--model",
            model.to_str().unwrap(),
        ];
        stream(&words)
    };
    let findings_of = |lines: &[Value]| -> Vec<(f64, Vec<String>)> {
        let kinds = |line: &Value| {
            line["findings"]
                .as_array()
                .unwrap()
                .iter()
                .map(|f| f["fault"].as_str().unwrap().to_owned())
                .collect()
        };
        event(lines, "findings").iter().map(|line| (line["t_s"].as_f64().unwrap(), kinds(line))).collect()
    };
    assert_eq!(findings_of(&played("same", 1.0, 1)), []);
    for (name, gain, held, kind) in [
        ("louder", 100.0, 1, "other_range"),
        ("quieter", 0.002, 1, "other_range"),
        ("held", 1.0, 3, "held_channels"),
    ] {
        let findings = findings_of(&played(name, gain, held));
        assert!(findings.len() == 1 && findings[0].1 == [kind], "{name}: {findings:?}");
    }
}
