//! 64 channels at 4 kHz through files: recordings of a training, and streams that were kept.
#![allow(clippy::unwrap_used, clippy::disallowed_methods)] // Tests read and write files.

use proact_devices::{
    EmgPacket, EmgRecorder, Pacing, PlaybackSource, Recording, RecordingFolder, Recordings, SampleSource,
    SourceEvent, SourceInfo, read_recorded,
};
use proact_types::{Command, EmgSample, Gesture};
use std::time::Duration;

const CHANNELS: usize = 64;
const RATE_HZ: f64 = 4000.0;

fn samples(count: u64, seed: u64) -> Vec<EmgSample> {
    let value = |k: u64, c: u64| (((k + seed) * 7919 + c * 104_729) % 60_001) as f64 - 30_000.0;
    let channels = CHANNELS as u64;
    (0..count)
        .map(|k| EmgSample { counter: k, channels: (0..channels).map(|c| value(k, c)).collect() })
        .collect()
}

#[test]
fn a_stream_of_a_grid_is_kept_in_both_formats_and_played_again() {
    let dir = tempfile::tempdir().unwrap();
    let info = SourceInfo {
        name: "grid".to_owned(),
        rate_hz: RATE_HZ,
        channels: CHANNELS,
        packet_samples: 64,
        zero_code: 0.0,
        rails: None,
        loss_is_counted: true,
        volts_per_code: None,
        imu: Vec::new(),
    };
    let all = samples(640, 0);
    for ending in ["csv", "edf"] {
        let path = dir.path().join(format!("grid.{ending}"));
        let mut recorder = EmgRecorder::create(&path, &info).unwrap();
        for chunk in all.chunks(64) {
            let packet = EmgPacket { samples: chunk.to_vec(), ..EmgPacket::default() };
            recorder.packet(&packet).unwrap();
        }
        recorder.finish().unwrap();
        let read = read_recorded(&path).unwrap();
        assert_eq!((read.rate_hz, &read.samples), (RATE_HZ, &all), "{ending}");
        let mut source =
            PlaybackSource::new("grid", read.samples, RATE_HZ, 64, Pacing::AsFastAsPossible).unwrap();
        assert_eq!(source.info().channels, CHANNELS);
        let (mut packet, mut played) = (EmgPacket::default(), Vec::new());
        while source.poll(Duration::from_secs(1), &mut packet).unwrap() != SourceEvent::Ended {
            played.append(&mut packet.samples);
        }
        assert_eq!(played, all, "{ending}");
    }
}

#[test]
fn a_training_with_a_grid_is_written_and_read_again() {
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path().join("recordings");
    let gestures = Command::ALL.map(Gesture::from);
    let written =
        RecordingFolder::create(&folder, RATE_HZ, &gestures, Command::NoMotion.into(), &[]).unwrap();
    for (gesture, seed) in Command::ALL.into_iter().zip(0..) {
        written.write_recording(&Recording::bridge_gaps(0, gesture.into(), &samples(100, seed))).unwrap();
    }
    let read = Recordings::open(&folder, None).unwrap();
    assert_eq!((read.rate_hz, read.channels, read.items.len()), (RATE_HZ, CHANNELS, 5));
    let item = read.items.iter().find(|item| item.gesture == Command::HandOpen).unwrap();
    let seed = Command::ALL.iter().position(|gesture| *gesture == Command::HandOpen).unwrap() as u64;
    assert!(item.numbered_samples().eq(samples(100, seed)));
}
