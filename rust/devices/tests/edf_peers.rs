//! Other programs open our EDF+ recordings and find every sample where it belongs, and what is lost.
#![allow(clippy::unwrap_used)]
#![allow(clippy::disallowed_methods)] // It starts another program.

use proact_devices::{EmgPacket, EmgRecorder, SourceInfo};
use proact_types::EmgSample;
use serde_json::Value;
use std::{
    path::{Path, PathBuf},
    process::Command,
};

/// Python with pyedflib and MNE, or none with a message.
fn peers() -> Option<PathBuf> {
    let checkout = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../build/peers");
    let python = std::env::var_os("PROACT_PEERS").map_or(checkout, PathBuf::from).join("bin/python3");
    let has = Command::new(&python).args(["-c", "import mne, pyedflib"]).output();
    if !has.is_ok_and(|output| output.status.success()) {
        println!("skipped: pyedflib and MNE not found; ./proact peers gets them");
        return None;
    }
    Some(python)
}

fn code(counter: u64, channel: u64) -> f64 {
    ((counter * 7 + channel * 31) % 256) as f64
}

#[test]
fn pyedflib_and_mne_find_every_sample_in_its_place_in_volts_and_the_gaps() {
    let Some(python) = peers() else { return };
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("stream.edf");
    let scale = 2.5 / 1200.0 / 127.0;
    let info = SourceInfo {
        name: "armband".to_owned(),
        rate_hz: 1000.0,
        channels: 8,
        packet_samples: 16,
        zero_code: 128.0,
        rails: Some((0.0, 255.0)),
        loss_is_counted: true,
        volts_per_code: Some(scale),
        imu: Vec::new(),
    };
    // Two packets are lost, then 50 samples within packets, then one in two for a while.
    let first = 1005;
    let is_lost = |k: u64| {
        (512..544).contains(&k) || (1000..1050).contains(&k) || ((2000..2040).contains(&k) && k % 2 == 1)
    };
    let mut recorder = EmgRecorder::create(&path, &info).unwrap();
    for counter in (0..3003).filter(|k| !is_lost(*k)) {
        let channels = (0..8).map(|c| code(counter, c)).collect();
        let sample = EmgSample { counter: first + counter, channels };
        recorder.packet(&EmgPacket { samples: vec![sample], ..EmgPacket::default() }).unwrap();
    }
    recorder.finish().unwrap();

    let program = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/side_by_side/emg/edf_peer.py");
    let output = Command::new(&python).arg(program).arg(&path).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let read: Value = serde_json::from_slice(&output.stdout).unwrap();
    let kept = (0..3003).filter(|k| !is_lost(*k)).count();
    for (peer, read) in [("pyedflib", &read["pyedflib"]), ("MNE", &read["mne"])] {
        assert_eq!(read["rate_hz"], 1000.0, "{peer}");
        assert_eq!(read["channels"].as_array().unwrap().len(), 8, "{peer}");
        let values: Vec<f64> =
            read["microvolts"].as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect();
        assert!(values.len() >= 3003, "{peer}: {}", values.len());
        for (k, value) in (0..).zip(&values) {
            let expected = if k < 3003 && !is_lost(k) { code(k, 0) - 128.0 } else { -32_768.0 - 128.0 };
            // The header has eight characters for the end of the range: a tenth of a code.
            assert!(
                (value - expected * scale * 1e6).abs() < 0.1 * scale * 1e6,
                "{peer}: sample {k} is {value}"
            );
        }
        let notes = read["annotations"].as_array().unwrap();
        let lost: f64 = notes
            .iter()
            .filter(|n| n[2].as_str().unwrap().starts_with("BAD"))
            .map(|n| n[1].as_f64().unwrap())
            .sum();
        let missing = (values.len() - kept) as f64 / 1000.0;
        assert!((lost - missing).abs() < 1e-6, "{peer}: {lost} s are marked, {missing} s are missing");
        let has = |onset: f64, secs: f64| {
            notes.iter().any(|n| n[0] == onset && (n[1].as_f64().unwrap() - secs).abs() < 1e-9)
        };
        assert!(has(0.512, 0.032) && has(1.0, 0.05) && has(2.001, 0.001), "{peer}: {notes:?}");
    }
    assert!(read["pyedflib"]["units"].as_array().unwrap().iter().all(|unit| unit == "uV"));
    assert!(
        read["mne"]["types"].as_array().unwrap().iter().all(|kind| kind == "emg"),
        "{}",
        read["mne"]["types"]
    );
    // MNE leaves the marked samples out by itself.
    assert_eq!(read["mne"]["kept"].as_u64().unwrap() as usize, kept);
}
