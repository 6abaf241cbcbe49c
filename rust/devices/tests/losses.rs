//! Packets that a radio loses: gestures come through, and no motion that nobody made.
#![allow(clippy::unwrap_used)]

use proact_devices::{EmgOrigin, EmgSetup, prepare_emg, random_stream};
use proact_emg::{EmgConfig, EmgPipeline, GapInterpolationConfig};
use proact_types::{Command, EmgSample, SimTime};
use rand::RngExt;
use std::path::PathBuf;

/// How long a gesture is asked for, and how long it may take to come, ms.
const HELD_MS: u64 = 2000;
const SETTLING_MS: u64 = 500;
const GESTURES: u64 = 150;

/// Shares of the time after settling.
#[derive(Debug)]
struct RecognitionShares {
    /// The gesture in force was the one asked for.
    right: f64,
    /// It was a motion, and another.
    wrong_motion: f64,
}

/// Gestures in a random order, of which packets of `packet_ms` are lost independently with probability `loss`.
fn run_with_losses(
    setup: &EmgSetup,
    bridge: GapInterpolationConfig,
    loss: f64,
    packet_ms: u64,
    seed: u64,
) -> RecognitionShares {
    let (mut feed, mut order, mut radio) =
        (setup.feed.clone(), random_stream(seed, "test/gestures"), random_stream(seed, "test/radio"));
    let config = EmgConfig { gap_interpolation: bridge, ..setup.config.clone() };
    let mut pipeline = EmgPipeline::new(&config, setup.classifier.clone()).unwrap();
    let mut packet: Vec<EmgSample> = Vec::new();
    let (mut in_force, mut right, mut wrong) = (config.rest, 0, 0);
    let mut intended = Command::NoMotion;
    for tick in 0..GESTURES * HELD_MS {
        if tick % HELD_MS == 0 {
            // A relaxed hand in between, as people do; it also lets gestures through again.
            intended = if intended == Command::NoMotion {
                Command::ALL[order.random_range(0..Command::ALL.len())]
            } else {
                Command::NoMotion
            };
        }
        packet.extend(feed.sample_at(SimTime(tick), feed.gesture_for(intended)));
        let due = (tick + 1) % packet_ms == 0;
        let lost = due && radio.random_bool(loss);
        let arrived = if due && !lost { packet.as_slice() } else { &[] };
        if let Some(output) = pipeline.step(SimTime(tick), arrived) {
            in_force = output.gesture;
        }
        if due {
            packet.clear();
        }
        if tick % HELD_MS >= SETTLING_MS {
            right += u64::from(in_force == intended);
            wrong += u64::from(in_force != intended && in_force != config.rest);
        }
    }
    let share = |count: u64| count as f64 / (GESTURES * (HELD_MS - SETTLING_MS)) as f64;
    RecognitionShares { right: share(right), wrong_motion: share(wrong) }
}

/// Before gaps were bridged a hundredth of lost packets cost an eighth of the time.
fn check_loss_tolerance(setup: &EmgSetup, packet_ms: u64) {
    for seed in 0..3 {
        let at = |loss| run_with_losses(setup, GapInterpolationConfig::default(), loss, packet_ms, seed);
        let (none, one, five) = (at(0.0), at(0.01), at(0.05));
        let bare = GapInterpolationConfig { max_gap_ms: 0, ..GapInterpolationConfig::default() };
        let before =
            [0.005, 0.01, 0.05].map(|loss| run_with_losses(setup, bare, loss, packet_ms, seed).right);
        println!(
            "{} seed {seed}: without loss {none:?}, 1 % {one:?}, 5 % {five:?}; unbridged {before:?}",
            setup.label
        );
        assert!(one.right >= 0.95 && five.right >= 0.8, "{one:?} {five:?}");
        assert!(one.wrong_motion <= none.wrong_motion, "1 %: {one:?}, without loss {none:?}");
        assert!(five.wrong_motion <= none.wrong_motion, "5 %: {five:?}, without loss {none:?}");
        assert!(before[2] < five.right, "{before:?}");
    }
}

#[test]
fn gestures_come_through_lost_packets_of_an_armband_and_no_motion_is_made_up() {
    check_loss_tolerance(&prepare_emg(&EmgOrigin::Synthetic, 1).unwrap(), 16);
}

#[test]
fn gestures_of_a_person_come_through_lost_packets() {
    let beside = || PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../../shared");
    let dir = std::env::var_os("PROACT_SHARED")
        .map_or_else(beside, PathBuf::from)
        .join("data/emg/libemg_tests_myo");
    if !dir.is_dir() {
        println!("skipped: ../shared not found");
        return;
    }
    check_loss_tolerance(&prepare_emg(&EmgOrigin::recording(dir), 1).unwrap(), 15);
}

/// Four packets in a row are no short gap: the arm stops, and only a relaxed hand lets gestures through again.
#[test]
fn a_radio_that_is_gone_stops_the_arm_as_before() {
    let setup = prepare_emg(&EmgOrigin::Synthetic, 1).unwrap();
    for bridge in [
        GapInterpolationConfig::default(),
        GapInterpolationConfig { max_gap_ms: 0, ..GapInterpolationConfig::default() },
    ] {
        let config = EmgConfig { gap_interpolation: bridge, ..setup.config.clone() };
        let mut pipeline = EmgPipeline::new(&config, setup.classifier.clone()).unwrap();
        let mut feed = setup.feed.clone();
        let (mut stopped, mut in_force) = (None, config.rest);
        for tick in 0..3000 {
            let samples = feed.sample_at(SimTime(tick), feed.gesture_for(Command::HandClose));
            // Alive for a second; then silent but for one sample in ten.
            let arrived = if tick < 1000 || tick % 10 == 0 { samples.as_slice() } else { &[] };
            if let Some(output) = pipeline.step(SimTime(tick), arrived) {
                in_force = output.gesture;
                if output.stale {
                    stopped.get_or_insert(tick);
                }
            }
            assert!(tick != 990 || in_force == Command::HandClose, "{in_force}");
        }
        let stopped = stopped.unwrap();
        assert!((1000..=1210).contains(&stopped), "{stopped}");
        assert!(in_force == config.rest && pipeline.is_disarmed());
    }
}
