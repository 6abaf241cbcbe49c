//! The monitor finds faults that are planted in a signal, and none where there is none.

use proact_emg::{ChannelFault, ChannelStatistics, ChannelStatus, QualityConfig, QualityMonitor};
use proact_types::{EmgSample, SimTime};
use proptest::prelude::*;
use std::f64::consts::TAU;

const CHANNELS: usize = 4;
/// The channel with the planted fault.
const BAD: usize = 2;
const CALIBRATION: [ChannelStatistics; CHANNELS] =
    [ChannelStatistics { rest_median: 0.0, rest_sd: 2.0, max_sd: 20.0, noise_floor: None }; CHANNELS];

/// Uniform noise of standard deviation one, from a counter.
fn noise(seed: u64, k: u64) -> f64 {
    let mut z = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15).wrapping_add(k.wrapping_mul(0xd1b5_4a32_d192_ed03));
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((z ^ (z >> 31)) as f64 / u64::MAX as f64 - 0.5) * 12_f64.sqrt()
}

/// Three seconds of noise as of a contraction, rounded to counts, changed by `fault(k, seconds, value)` on one channel.
fn watch(rate: f64, seed: u64, fault: impl Fn(u64, f64, f64) -> f64) -> QualityMonitor {
    let config = QualityConfig { rails: Some([-128.0, 127.0]), ..QualityConfig::default() };
    let mut monitor = QualityMonitor::new(config, rate, CHANNELS, &CALIBRATION);
    for k in 0..=(3.0 * rate) as u64 {
        let mut channels: Vec<f64> = (0..CHANNELS as u64).map(|c| 10.0 * noise(seed * 16 + c, k)).collect();
        channels[BAD] = fault(k, k as f64 / rate, channels[BAD]);
        let channels = channels.into_iter().map(|v| v.round().clamp(-128.0, 127.0)).collect();
        monitor.push(SimTime((k as f64 * 1000.0 / rate) as u64), &EmgSample { counter: k, channels });
    }
    monitor
}

fn assert_found(monitor: &QualityMonitor, fault: Option<ChannelFault>, light: ChannelStatus) {
    for (c, quality) in monitor.channels().iter().enumerate() {
        let expected = if c == BAD { (light, fault) } else { (ChannelStatus::Green, None) };
        assert_eq!((quality.status, quality.fault), expected, "channel {c}: {quality:?}");
    }
    assert_eq!(monitor.stream().status, ChannelStatus::Green, "{:?}", monitor.stream());
    assert_eq!(monitor.status(), light);
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, cases: 64, ..ProptestConfig::default() })]

    #[test]
    fn planted_faults_are_found_on_their_channel_and_on_no_other(
        seed in any::<u32>(),
        rate in prop_oneof![Just(200.0), Just(500.0), Just(1000.0)],
        offset in -60.0..60.0_f64,
        strength in 30.0..60.0_f64,
        hum in prop_oneof![Just(50.0), Just(60.0)],
    ) {
        let seed = u64::from(seed);
        assert_found(&watch(rate, seed, |_, _, v| v), None, ChannelStatus::Green);
        assert_found(&watch(rate, seed, |_, _, _| offset), Some(ChannelFault::Flat), ChannelStatus::Red);
        let drift = if offset < 0.0 { offset - 20.0 } else { offset + 20.0 };
        assert_found(&watch(rate, seed, |_, _, v| v + drift), Some(ChannelFault::Drift), ChannelStatus::Red);
        let sine = |t: f64| strength * (TAU * hum * t).sin();
        let monitor = watch(rate, seed, |_, t, v| 0.5 * v + sine(t));
        prop_assert_eq!(monitor.channels()[BAD].mains_hz, hum);
        assert_found(&monitor, Some(ChannelFault::Mains), ChannelStatus::Red);
        assert_found(
            &watch(rate, seed, |k, _, v| if k % 3 == 0 { 127.0 } else { v - 60.0 }),
            Some(ChannelFault::Railed),
            ChannelStatus::Red,
        );
        let lifted = |_, t: f64, v: f64| if t > 2.5 { 6.0 * v } else { v };
        assert_found(&watch(rate, seed, lifted), Some(ChannelFault::LiftOff), ChannelStatus::Amber);
    }

    #[test]
    fn no_stream_however_broken_makes_the_monitor_panic(
        counters in prop::collection::vec(prop_oneof![0..400_u64, any::<u64>()], 0..400),
        values in prop::collection::vec(prop_oneof![Just(f64::NAN), Just(f64::INFINITY), any::<f64>()], 1..6),
    ) {
        let mut monitor = QualityMonitor::new(QualityConfig::default(), 20.0, 2, &[]);
        for (tick, counter) in counters.iter().enumerate() {
            let channels = values.iter().cycle().skip(tick).take(1 + tick % 3).copied().collect();
            monitor.push(SimTime(tick as u64), &EmgSample { counter: *counter, channels });
        }
        prop_assert_eq!(monitor.channels().len(), 2);
    }
}

#[test]
fn lost_samples_and_a_wrong_rate_show_on_the_stream() {
    let run = |rate: f64, keep: fn(u64) -> bool| {
        let mut monitor = QualityMonitor::new(QualityConfig::default(), 1000.0, 1, &[]);
        for k in (0..5000).filter(|k| keep(*k)) {
            let channels = [10.0 * noise(1, k)].into_iter().collect();
            monitor.push(SimTime((k as f64 * 1000.0 / rate) as u64), &EmgSample { counter: k, channels });
        }
        *monitor.stream()
    };
    let good = run(1000.0, |_| true);
    assert_eq!((good.status, good.gaps), (ChannelStatus::Green, 0));
    assert!(good.rate_hz.is_some_and(|rate| (rate - 1000.0).abs() < 2.0), "{good:?}");
    let packet = run(1000.0, |k| !(4500..4516).contains(&k));
    assert_eq!((packet.status, packet.gaps), (ChannelStatus::Amber, 1), "{packet:?}");
    let broken = run(1000.0, |k| k % 10 != 0);
    assert_eq!(broken.status, ChannelStatus::Red, "{broken:?}");
    assert!((broken.lost_share - 0.1).abs() < 0.01 && broken.gaps > 400, "{broken:?}");
    let slow = run(650.0, |_| true);
    assert_eq!(slow.status, ChannelStatus::Red, "{slow:?}");
    assert!(slow.rate_hz.is_some_and(|rate| (rate - 650.0).abs() < 5.0), "{slow:?}");
}

/// The light was red for five seconds after a driver had handed out at once what it had kept, and amber for a clean stream:
/// one second of packets of 16 ms knows its rate to 1.6 %.
#[test]
fn a_burst_at_the_start_or_after_a_silence_is_no_rate_and_a_clean_stream_is_green_throughout() {
    let run = |kept_back: u64, silence: std::ops::Range<u64>| {
        let mut monitor = QualityMonitor::new(QualityConfig::default(), 1000.0, 1, &[]);
        let mut worst = ChannelStatus::Green;
        for packet in 0..900_u64 {
            // Sixteen samples come when the last is due; what is due before a packet is let through waits for it.
            let due = 16 * (packet + 1);
            let now = if silence.contains(&due) { silence.end } else { due.max(kept_back) };
            for k in 16 * packet..due {
                let channels = [10.0 * noise(1, k)].into_iter().collect();
                monitor.push(SimTime(now), &EmgSample { counter: k, channels });
                worst = worst.max(monitor.status());
            }
        }
        let rate = monitor.stream().rate_hz.expect("known after 14 s");
        assert!((rate - 1000.0).abs() < 10.0, "{rate}");
        worst
    };
    assert_eq!(run(0, 0..0), ChannelStatus::Green);
    assert_eq!(run(3000, 0..0), ChannelStatus::Green, "a burst at the start");
    assert_eq!(run(0, 5000..5900), ChannelStatus::Green, "a burst after a silence");
}

#[test]
fn before_the_first_verdict_everything_is_green_and_nothing_is_claimed() {
    let monitor = QualityMonitor::new(QualityConfig::default(), 1000.0, 3, &[]);
    assert_eq!(
        (monitor.status(), monitor.stream().rate_hz, monitor.channels()[0].drift),
        (ChannelStatus::Green, None, None)
    );
}
