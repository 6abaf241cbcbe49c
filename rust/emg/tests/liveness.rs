//! Signals that no living arm gives, each found in time, and none found where people were recorded.
// The recordings are read from files.
#![allow(clippy::disallowed_methods)]

mod data;

use data::shared;
use proact_emg::{Liveness, LivenessConfig, SignalFault, noise_floors};
use proact_types::{ChannelValues, EmgSample, SimTime};
use std::path::Path;

const CHANNELS: usize = 8;
/// A packet of the armband at 1 kHz: what is wrong is noticed when a packet comes.
const PACKET: u64 = 16;
/// From the first bad or missing sample to the verdict, ms. What is left of the 250 is for the link and the arm.
const MOST_MS: u64 = 210;

/// Codes about 128 with a spread of some counts, a different one for each sample and channel.
fn living(counter: u64, channel: usize) -> f64 {
    // SplitMix64; the sum of four uniform numbers is as good as a Gaussian one here.
    let mut sum = 0.0;
    for draw in 0..4 {
        let mut z = (counter * CHANNELS as u64 + channel as u64) * 4 + draw;
        z = (z ^ (z >> 30).wrapping_add(0x9e37_79b9_7f4a_7c15)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        sum += ((z ^ (z >> 31)) % 9) as f64 - 4.0;
    }
    128.0 + sum
}

fn sample(counter: u64, value: impl Fn(usize) -> f64) -> EmgSample {
    EmgSample { counter, channels: (0..CHANNELS).map(value).collect() }
}

fn config() -> LivenessConfig {
    LivenessConfig { rails: Some([0.0, 255.0]), ..LivenessConfig::default() }
}

/// A second of life, then what `spoilt` makes of the samples from tick 1000 on: the packet that comes at a tick, oldest
/// sample first. The tick of the first verdict after that, counted from tick 1000, and the verdict.
fn death(
    config: &LivenessConfig,
    mut spoilt: impl FnMut(u64) -> Vec<EmgSample>,
) -> Option<(u64, SignalFault)> {
    let mut liveness = Liveness::new(config, 1000.0, CHANNELS).expect("sound settings");
    for tick in 0..3000 {
        liveness.begin_tick(SimTime(tick));
        let samples = if tick < 1000 {
            let due = (tick + 1).is_multiple_of(PACKET);
            let first = (tick + 1).saturating_sub(PACKET);
            if due { (first..=tick).map(|k| sample(k, |c| living(k, c))).collect() } else { Vec::new() }
        } else {
            spoilt(tick)
        };
        for sample in samples {
            liveness.push(&sample);
        }
        if let Some(fault) = liveness.fault() {
            assert!(tick >= 1000, "{fault} at {tick}, and the stream was alive");
            return Some((tick - 1000, fault));
        }
    }
    None
}

/// The packet due at `tick`, of samples made by `value` from counter and channel.
fn packet(tick: u64, value: impl Fn(u64, usize) -> f64) -> Vec<EmgSample> {
    if !(tick + 1).is_multiple_of(PACKET) {
        return Vec::new();
    }
    (tick + 1 - PACKET..=tick).map(|k| sample(k, |c| value(k, c))).collect()
}

fn check(found: Option<(u64, SignalFault)>, expected: impl Fn(&SignalFault) -> bool) {
    let (after, fault) = found.expect("nothing was found");
    assert!(after <= MOST_MS, "{fault} after {after} ms");
    assert!(expected(&fault), "{fault}");
}

#[test]
fn a_converter_that_repeats_a_code_a_packet_or_zeros_is_frozen() {
    let frozen = |fault: &SignalFault| *fault == SignalFault::Frozen;
    check(death(&config(), |t| packet(t, |k, c| living(k.min(1000), c))), frozen);
    check(death(&config(), |t| packet(t, |k, c| living(if k < 1000 { k } else { 984 + k % 16 }, c))), frozen);
    check(death(&config(), |t| packet(t, |k, c| if k < 1000 { living(k, c) } else { 0.0 })), |fault| {
        matches!(fault, SignalFault::Frozen | SignalFault::Railed(1))
    });
    // A longer loop takes as long as it is.
    check(
        death(&config(), |t| packet(t, |k, c| living(if k < 1000 { k } else { 900 + k % 100 }, c))),
        frozen,
    );
}

#[test]
fn one_channel_that_stands_still_or_hits_the_rails_is_enough() {
    let third = |of: fn(u64) -> f64| {
        death(&config(), move |t| packet(t, |k, c| if k >= 1000 && c == 2 { of(k) } else { living(k, c) }))
    };
    check(third(|_| 128.0), |fault| *fault == SignalFault::Flat(3));
    check(third(|k| if living(k, 2) > 128.0 { 255.0 } else { 0.0 }), |fault| {
        *fault == SignalFault::Railed(3)
    });
    let unknown = LivenessConfig { rails: None, ..config() };
    let square = |t| {
        packet(t, |k, c| match living(k, 2) > 128.0 {
            _ if k < 1000 || c != 2 => living(k, c),
            true => 255.0,
            false => 0.0,
        })
    };
    assert_eq!(death(&unknown, square), None, "without rails these are strong muscles");
}

#[test]
fn a_channel_that_was_flat_in_the_training_is_not_judged() {
    let training: Vec<EmgSample> =
        (0..1000).map(|k| sample(k, |c| if c == 2 { 128.0 } else { living(k, c) })).collect();
    let floors = noise_floors(&config(), 1000.0, CHANNELS, [training.as_slice()]);
    assert!(floors[2] == 0.0 && floors.iter().filter(|floor| **floor > 1.0).count() == 7, "{floors:?}");
    let known = LivenessConfig { noise_floors: floors, ..config() };
    let third_flat = |t| packet(t, |k, c| if c == 2 && k >= 1000 { 128.0 } else { living(k, c) });
    assert_eq!(death(&known, third_flat), None);
}

#[test]
fn a_channel_without_the_roughness_of_muscle_is_dead_if_the_training_is_known() {
    let training: Vec<EmgSample> = (0..1000).map(|k| sample(k, |c| living(k, c))).collect();
    let floors = noise_floors(&config(), 1000.0, CHANNELS, [training.as_slice()]);
    let known = LivenessConfig { noise_floors: floors, ..config() };
    // Slow waves of an electrode that hangs in the air, each channel another one.
    let wave = |k: u64, c: usize| 128.0 + 60.0 * (k as f64 * 0.01 * (1.0 + c as f64 * 0.1)).sin();
    let waves = |t| packet(t, |k, c| if k < 1000 { living(k, c) } else { wave(k, c) });
    check(death(&known, waves), |fault| matches!(fault, SignalFault::Noiseless(_)));
    assert_eq!(death(&config(), waves), None, "without the training nobody can tell");
}

#[test]
fn lost_samples_and_samples_that_are_no_numbers_stop_the_stream() {
    let lossy = |fault: &SignalFault| matches!(fault, SignalFault::Lossy(_));
    let half = |t: u64| if ((t + 1) / PACKET).is_multiple_of(2) { packet(t, living) } else { Vec::new() };
    check(death(&config(), half), lossy);
    let nan = |t| packet(t, |k, c| if k >= 1000 { f64::NAN } else { living(k, c) });
    check(death(&config(), nan), lossy);
    let few = |t| {
        let mut samples = packet(t, living);
        samples.iter_mut().for_each(|s| s.channels.truncate(4));
        samples
    };
    check(death(&config(), few), lossy);
    // Three packets in a row are a gap that the windows stand by themselves.
    let gap = |t: u64| if (1100..1148).contains(&t) { Vec::new() } else { packet(t, living) };
    assert_eq!(death(&config(), gap), None);
}

#[test]
fn half_and_twice_the_rate_are_found_and_a_radio_that_hesitates_is_not() {
    let at_rate = |hz: u64| {
        let mut sent = 1000;
        death(&config(), move |t| {
            let due = 1000 + (t + 1 - 1000) * hz / 1000;
            let whole = sent + (due - sent) / PACKET * PACKET;
            let samples = (sent..whole).map(|k| sample(k, |c| living(k, c))).collect();
            sent = whole;
            samples
        })
    };
    let wrong = |fault: &SignalFault| matches!(fault, SignalFault::WrongRate(_));
    check(at_rate(500), wrong);
    check(at_rate(2000), wrong);
    check(at_rate(200), wrong);
    assert_eq!(at_rate(950), None);
    // Nothing for 90 ms, then all at once.
    let mut waiting = Vec::new();
    let hesitates = |t: u64| {
        waiting.extend(packet(t, living));
        if (1100..1190).contains(&t) { Vec::new() } else { std::mem::take(&mut waiting) }
    };
    assert_eq!(death(&config(), hesitates), None);
}

#[test]
fn the_stream_is_alive_again_with_the_first_sample_that_lives_and_silence_is_a_new_start() {
    let mut liveness = Liveness::new(&config(), 1000.0, CHANNELS).expect("sound settings");
    let mut feed = |from: u64, to: u64, value: &dyn Fn(u64, usize) -> f64| {
        for tick in from..to {
            liveness.begin_tick(SimTime(tick));
            liveness.push(&sample(tick, |c| value(tick, c)));
        }
        liveness.fault()
    };
    assert_eq!(feed(0, 500, &living), None);
    assert_eq!(feed(500, 700, &|_, _| 128.0), Some(SignalFault::Frozen));
    assert_eq!(feed(700, 701, &living), None);
    assert_eq!(feed(701, 1000, &living), None);
    // A second without anything, the counter goes on: what is gone was lost in the silence.
    assert_eq!(feed(2000, 2300, &living), None);
}

#[test]
fn settings_that_cannot_work_are_refused() {
    let refused = |change: fn(&mut LivenessConfig)| {
        let mut config = LivenessConfig::default();
        change(&mut config);
        config.check(CHANNELS).expect_err("must be refused").to_string()
    };
    assert!(refused(|c| c.frozen_ms = 20_000).contains("frozen_ms"));
    assert!(refused(|c| c.max_lost_share = 1.5).contains("max_lost_share"));
    assert!(refused(|c| c.min_noise_share = f64::NAN).contains("min_noise_share"));
    assert!(refused(|c| c.rate_ratio_limits = [0.5, 0.9]).contains("rate_ratio_limits"));
    assert!(refused(|c| c.rails = Some([255.0, 0.0])).contains("rails"));
    assert!(refused(|c| c.noise_floors = vec![1.0]).contains("noise_floors"));
    let off = LivenessConfig {
        frozen_ms: 0,
        flat_ms: 0,
        railed_ms: 0,
        noise_window_ms: 0,
        loss_window_ms: 0,
        ..LivenessConfig::default()
    };
    assert_eq!(death(&off, |t| packet(t, |_, _| 0.0)), None, "zero is off");
}

/// One sample a line, numbers with commas between; a ninth column is a label.
fn read(path: &Path) -> Vec<EmgSample> {
    let text = std::fs::read_to_string(path).expect("it is there");
    let numbers = |line: &str| -> ChannelValues {
        line.split(',').take(CHANNELS).map(|v| v.trim().parse().expect("a number")).collect()
    };
    text.lines().zip(0..).map(|(line, counter)| EmgSample { counter, channels: numbers(line) }).collect()
}

/// No false stop: five people in three sessions each and one in four, by the noise of another recording of the same
/// person, with the rails of the armband's eight bits.
#[test]
fn no_recording_of_a_person_is_taken_for_dead() {
    let Some(dir) = shared() else { return };
    let libemg =
        |rep: u32, class: u32| read(&dir.join(format!("libemg_tests_myo/R_{rep}_C_{class}_EMG.csv")));
    let training = (0..2).flat_map(|rep| (0..5).map(move |class| (rep, class)));
    let floors_of: Vec<Vec<EmgSample>> = training.map(|(rep, class)| libemg(rep, class)).collect();
    let rate_hz = 200.0;
    let rails = Some([-128.0, 127.0]);
    let base = LivenessConfig { rails, ..LivenessConfig::default() };
    let floors = |samples: &[Vec<EmgSample>]| {
        noise_floors(&base, rate_hz, CHANNELS, samples.iter().map(Vec::as_slice))
    };
    let mut checked_count = 0;
    let mut check_stream = |name: &str, floors: &[f64], samples: &[EmgSample]| {
        let config = LivenessConfig { noise_floors: floors.to_vec(), ..base.clone() };
        let mut liveness = Liveness::new(&config, rate_hz, CHANNELS).expect("sound settings");
        for sample in samples {
            liveness.begin_tick(SimTime(sample.counter * 5));
            let alive = liveness.push(sample);
            assert!(alive, "{name}, sample {}: {:?}", sample.counter, liveness.fault());
            checked_count += 1;
        }
    };
    let known = floors(&floors_of);
    for rep in 0..4 {
        for class in 0..5 {
            check_stream(&format!("R_{rep}_C_{class}"), &known, &libemg(rep, class));
        }
    }
    for person in ["12345", "21547", "45612", "54321", "78945"] {
        let session = |number: u32| -> Vec<Vec<EmgSample>> {
            let file = |label| read(&dir.join(format!("myo_readings/{person}-{number}/{label}.txt")));
            [0, 1, 2, 7].map(file).into()
        };
        let known = floors(&session(1));
        for number in 1..=3 {
            for (samples, label) in session(number).iter().zip([0, 1, 2, 7]) {
                check_stream(&format!("{person}-{number}/{label}"), &known, samples);
            }
        }
    }
    assert!(checked_count > 700_000, "{checked_count} samples");
}
