//! Files that were damaged, or never were recordings: an error that names the file, or samples that can be used. Never a
//! panic, never a value that is no number.
#![allow(clippy::unwrap_used, clippy::disallowed_methods)] // Tests write files.

use proact_devices::{
    EmgPacket, EmgRecorder, Recordings, SourceInfo, read_process_file, read_recorded, read_samples,
};
use proact_types::EmgSample;
use proptest::prelude::*;

fn info() -> SourceInfo {
    SourceInfo {
        name: "test".to_owned(),
        rate_hz: 200.0,
        channels: 2,
        packet_samples: 4,
        zero_code: 128.0,
        rails: Some((0.0, 255.0)),
        loss_is_counted: true,
        volts_per_code: None,
        imu: Vec::new(),
    }
}

/// The bytes of a recording of 40 samples.
fn recorded(ending: &str) -> Vec<u8> {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join(format!("r.{ending}"));
    let mut recorder = EmgRecorder::create(&path, &info()).unwrap();
    for packet in 0..10_u64 {
        let sample =
            |k: u64| EmgSample { counter: k, channels: [k as f64, 255.0 - k as f64].into_iter().collect() };
        let samples: Vec<EmgSample> = (4 * packet..4 * packet + 4).map(sample).collect();
        recorder.packet(&EmgPacket { samples, ..EmgPacket::default() }).unwrap();
    }
    recorder.finish().unwrap();
    std::fs::read(&path).unwrap()
}

fn finite<'a>(rows: impl IntoIterator<Item = &'a [f64]>) -> bool {
    rows.into_iter().flatten().all(|v| v.is_finite())
}

/// The file of the documented program that decodes.
const PROCESS: &str = include_str!("../../../docs/decoders/nearest_centroid.toml");

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, cases: 200, ..ProptestConfig::default() })]

    // A file of another kind that tells how EMG is decoded: refused with its name, or a command that can be started.
    #[test]
    fn a_damaged_file_of_a_program_that_decodes_is_refused_with_its_name_or_can_be_used(
        damage in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..8),
    ) {
        let mut bytes = PROCESS.as_bytes().to_vec();
        for (index, value) in &damage {
            let length = bytes.len();
            bytes[index.index(length)] = *value;
        }
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("decoder.toml");
        std::fs::write(&path, &bytes).unwrap();
        match read_process_file(&path) {
            Ok(config) => prop_assert!(
                config.command.first().is_some_and(|program| !program.is_empty())
                    && (1..=1000).contains(&config.deadline_ms)
            ),
            Err(error) => {
                let said = error.to_string();
                prop_assert!(said.contains("decoder.toml"), "{said}");
                let readable = String::from_utf8(bytes).is_ok();
                let named = said.contains("line ") || said.contains("deadline_ms") || said.contains("command");
                prop_assert!(!readable || named, "{said}");
            }
        }
    }
}

proptest! {
    // Each case writes files to the disk.
    #![proptest_config(ProptestConfig { failure_persistence: None, cases: 64, ..ProptestConfig::default() })]

    #[test]
    fn any_text_in_a_folder_of_recordings_is_read_or_refused(
        table in "[0-9a-zA-Z.,+\\- \n]{0,120}",
        metadata in prop_oneof![Just(String::new()), "[\\[\\]{}\":,0-9a-z_.]{0,60}", Just("{\"rate_hz\": 1e999}".to_owned())],
    ) {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("R_0_C_0.csv");
        std::fs::write(&path, &table).unwrap();
        if !metadata.is_empty() {
            std::fs::write(dir.path().join("metadata.json"), &metadata).unwrap();
        }
        match read_samples(&path) {
            Ok(file) => prop_assert!(finite(file.samples.iter().map(|s| s.as_slice()))),
            Err(error) => prop_assert!(error.to_string().contains("R_0_C_0.csv")),
        }
        match Recordings::open(dir.path(), None) {
            Ok(read) => {
                prop_assert!(read.rate_hz.is_finite() && read.rate_hz > 0.0);
                prop_assert!(finite(read.items.iter().flat_map(|r| r.samples.iter().map(|s| s.as_slice()))));
            }
            Err(error) => prop_assert!(error.to_string().contains(&*dir.path().to_string_lossy())),
        }
    }

    #[test]
    fn a_recording_with_damaged_bytes_is_read_or_refused(
        damage in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..4),
        cut in prop::option::of(any::<prop::sample::Index>()),
    ) {
        for ending in ["csv", "edf"] {
            let mut bytes = recorded(ending);
            for (index, value) in &damage {
                let length = bytes.len();
                bytes[index.index(length)] = *value;
            }
            if let Some(cut) = cut {
                bytes.truncate(cut.index(bytes.len()));
            }
            let dir = tempfile::tempdir().unwrap();
            let path = dir.path().join(format!("damaged.{ending}"));
            std::fs::write(&path, &bytes).unwrap();
            match read_recorded(&path) {
                Ok(read) => {
                    prop_assert!(read.rate_hz.is_finite() && read.rate_hz > 0.0);
                    prop_assert!(read.samples.windows(2).all(|w| w[0].counter < w[1].counter));
                    prop_assert!(finite(read.samples.iter().map(|s| s.channels.as_slice())));
                }
                Err(error) => prop_assert!(error.to_string().contains("damaged."), "{}", error),
            }
        }
    }
}
