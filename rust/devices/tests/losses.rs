//! Packets that a radio loses: gestures come through, and no motion that nobody made.
#![allow(clippy::unwrap_used)]

use proact_devices::{EmgOrigin, EmgSetup, prepare, stream};
use proact_emg::{BridgeConfig, EmgConfig, EmgPipeline};
use proact_types::{EmgSample, Gesture, SimTime};
use rand::RngExt;
use std::path::PathBuf;

/// How long a gesture is asked for, and how long it may take to come, ms.
const HELD_MS: u64 = 2000;
const SETTLING_MS: u64 = 500;
const GESTURES: u64 = 150;

/// Shares of the time after settling.
#[derive(Debug)]
struct Shares {
    /// The gesture in force was the one asked for.
    right: f64,
    /// It was a motion, and another.
    wrong_motion: f64,
}

/// Gestures in a random order, of which packets of `packet_ms` are lost independently with probability `loss`.
fn drive(setup: &EmgSetup, bridge: BridgeConfig, loss: f64, packet_ms: u64, seed: u64) -> Shares {
    let (mut feed, mut order, mut radio) =
        (setup.feed.clone(), stream(seed, "test/gestures"), stream(seed, "test/radio"));
    let config = EmgConfig { bridge, ..setup.config.clone() };
    let mut pipeline = EmgPipeline::new(&config, setup.classifier.clone()).unwrap();
    let mut packet: Vec<EmgSample> = Vec::new();
    let (mut in_force, mut right, mut wrong) = (config.rest, 0, 0);
    let mut asked = Gesture::NoMotion;
    for tick in 0..GESTURES * HELD_MS {
        if tick % HELD_MS == 0 {
            // A relaxed hand in between, as people do; it also lets gestures through again.
            asked = if asked == Gesture::NoMotion {
                Gesture::ALL[order.random_range(0..Gesture::ALL.len())]
            } else {
                Gesture::NoMotion
            };
        }
        packet.extend(feed.sample_at(SimTime(tick), feed.gesture_for(asked)));
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
            right += u64::from(in_force == asked);
            wrong += u64::from(in_force != asked && in_force != config.rest);
        }
    }
    let share = |count: u64| count as f64 / (GESTURES * (HELD_MS - SETTLING_MS)) as f64;
    Shares { right: share(right), wrong_motion: share(wrong) }
}

/// Before gaps were bridged a hundredth of lost packets cost an eighth of the time.
fn come_through(setup: &EmgSetup, packet_ms: u64) {
    for seed in 0..3 {
        let at = |loss| drive(setup, BridgeConfig::default(), loss, packet_ms, seed);
        let (none, one, five) = (at(0.0), at(0.01), at(0.05));
        let bare = BridgeConfig { longest_ms: 0, ..BridgeConfig::default() };
        let before = [0.005, 0.01, 0.05].map(|loss| drive(setup, bare, loss, packet_ms, seed).right);
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
    come_through(&prepare(&EmgOrigin::Synthetic, 1).unwrap(), 16);
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
    come_through(&prepare(&EmgOrigin::recording(dir), 1).unwrap(), 15);
}

/// Four packets in a row are no short gap: the arm stops, and only a relaxed hand lets gestures through again.
#[test]
fn a_radio_that_is_gone_stops_the_arm_as_before() {
    let setup = prepare(&EmgOrigin::Synthetic, 1).unwrap();
    for bridge in [BridgeConfig::default(), BridgeConfig { longest_ms: 0, ..BridgeConfig::default() }] {
        let config = EmgConfig { bridge, ..setup.config.clone() };
        let mut pipeline = EmgPipeline::new(&config, setup.classifier.clone()).unwrap();
        let mut feed = setup.feed.clone();
        let (mut stopped, mut in_force) = (None, config.rest);
        for tick in 0..3000 {
            let samples = feed.sample_at(SimTime(tick), feed.gesture_for(Gesture::HandClose));
            // Alive for a second; then silent but for one sample in ten.
            let arrived = if tick < 1000 || tick % 10 == 0 { samples.as_slice() } else { &[] };
            if let Some(output) = pipeline.step(SimTime(tick), arrived) {
                in_force = output.gesture;
                if output.stale {
                    stopped.get_or_insert(tick);
                }
            }
            assert!(tick != 990 || in_force == Gesture::HandClose, "{in_force}");
        }
        let stopped = stopped.unwrap();
        assert!((1000..=1210).contains(&stopped), "{stopped}");
        assert!(in_force == config.rest && pipeline.is_disarmed());
    }
}
