//! Grids of electrodes: 64 channels at 4 kHz go the way of an armband's 8.

use proact_emg::{
    Classifier, EmgConfig, EmgError, EmgPipeline, QualityConfig, QualityMonitor,
    extract_features_with_amplitudes,
};
use proact_types::{Command, EmgSample, MAX_EMG_CHANNELS, SimTime};

const CHANNELS: usize = 64;

fn config() -> EmgConfig {
    EmgConfig { rate_hz: 4000.0, channels: CHANNELS, ..EmgConfig::default() }
}

/// Noise without a memory, -1 to 1: SplitMix64 of sample and channel.
fn noise(counter: u64, channel: usize) -> f64 {
    let mut z = (counter * CHANNELS as u64 + channel as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    (z ^ (z >> 31)) as f64 / u64::MAX as f64 * 2.0 - 1.0
}

/// Each gesture is loud under another part of the grid.
fn sample(counter: u64, gesture: Command) -> EmgSample {
    let value = |channel: usize| {
        let near = channel / 13 == gesture.index();
        100.0 + noise(counter, channel) * if near { 40.0 } else { 3.0 }
    };
    EmgSample { counter, channels: (0..CHANNELS).map(value).collect() }
}

fn pipeline() -> EmgPipeline {
    let (config, mut windows, mut labels, mut amplitudes) = (config(), Vec::new(), Vec::new(), Vec::new());
    for gesture in Command::ALL {
        // Others than are recognised below, and more windows than features.
        let samples = (1_000_000..1_024_000).map(|k| {
            let mut sample = sample(k, gesture);
            sample.channels.iter_mut().for_each(|value| *value -= 100.0);
            sample
        });
        let samples: Vec<EmgSample> = samples.collect();
        let (features, sums) = extract_features_with_amplitudes(&config, &samples).expect("good samples");
        assert_eq!(features[0].len(), 4 * CHANNELS);
        windows.extend(features);
        amplitudes.extend(sums);
        labels.resize(windows.len(), gesture);
    }
    let classifier =
        Classifier::train_with_amplitudes(&config, &windows, &labels, &amplitudes).expect("good data");
    let pipeline = EmgPipeline::new(&config, classifier).expect("they fit");
    pipeline.with_dc_offset(&[100.0; CHANNELS]).expect("one a channel")
}

#[test]
fn a_grid_at_four_kilohertz_is_recognised_also_over_a_short_gap() {
    let mut pipeline = pipeline();
    let mut monitor = QualityMonitor::new(QualityConfig::default(), 4000.0, CHANNELS, &[]);
    let (mut right, mut windows) = (0, 0);
    for tick in 0..5000_u64 {
        let gesture = Command::ALL[(tick / 1000) as usize];
        // Four samples a millisecond; one packet of 16 is lost in each second.
        let lost = (500..504).contains(&(tick % 1000));
        let samples: Vec<EmgSample> = (4 * tick..4 * tick + 4).map(|k| sample(k, gesture)).collect();
        let samples = if lost { &[][..] } else { &samples[..] };
        for sample in samples {
            monitor.push(SimTime(tick), sample);
        }
        let Some(output) = pipeline.step(SimTime(tick), samples) else { continue };
        // Windows that hold two gestures are of neither.
        if tick % 1000 >= 100 {
            windows += 1;
            right += u32::from(output.window_class == gesture);
        }
    }
    assert_eq!((right, windows), (windows, 5 * 18));
    assert_eq!((pipeline.counts().gaps, pipeline.counts().rejected_windows), (5, 0));
    assert_eq!((monitor.channels().len(), monitor.stream().gaps), (CHANNELS, 5));
}

#[test]
fn more_channels_than_any_amplifier_has_are_refused() {
    let max_config = EmgConfig { channels: MAX_EMG_CHANNELS, ..EmgConfig::default() };
    assert_eq!(max_config.check(), Ok(()));
    let beyond = EmgConfig { channels: MAX_EMG_CHANNELS + 1, ..EmgConfig::default() };
    let error: EmgError = beyond.check().expect_err("no stream has so many");
    assert!(error.to_string().contains("513 channels, expected 1 to 512"), "{error}");
}
