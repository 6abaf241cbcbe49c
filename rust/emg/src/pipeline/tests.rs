use super::*;
use crate::extract_features;
use proact_types::Command;

fn config() -> EmgConfig {
    EmgConfig { channels: 2, rate_hz: 200.0, ..EmgConfig::default() }
}

fn sample(counter: u64, amplitude: f64) -> EmgSample {
    let k = counter as f64;
    EmgSample { counter, channels: [amplitude * (k * 1.7).sin(), (k * 2.9).cos()].into_iter().collect() }
}

fn pipeline() -> EmgPipeline {
    let config = config();
    let mut windows = Vec::new();
    let mut labels = Vec::new();
    for (gesture, amplitude) in [(Command::NoMotion, 1.0), (Command::HandClose, 20.0)] {
        let samples: Vec<EmgSample> = (0..400).map(|k| sample(k, amplitude)).collect();
        windows.extend(extract_features(&config, &samples).expect("good samples"));
        labels.resize(windows.len(), gesture);
    }
    let classifier = Classifier::train(&config, &windows, &labels).expect("good data");
    EmgPipeline::new(&config, classifier).expect("they fit")
}

/// Runs `ticks` ticks from `from`; samples every 5 ms unless `lost`.
fn run(
    pipeline: &mut EmgPipeline,
    from: u64,
    ticks: u64,
    amplitude: f64,
    lost: bool,
) -> Vec<(u64, EmgOutput)> {
    (from..from + ticks)
        .filter_map(|t| {
            let sample = (t % 5 == 0 && !lost).then(|| sample(t / 5, amplitude));
            pipeline.step(SimTime(t), sample.as_slice()).map(|out| (t, out))
        })
        .collect()
}

#[test]
fn a_decision_belongs_to_the_tick_of_the_last_sample_of_its_window() {
    let times: Vec<u64> = run(&mut pipeline(), 0, 250, 1.0, false).iter().map(|(t, _)| *t).collect();
    assert_eq!(times, [95, 145, 195, 245]);
}

/// Mains a hundred times as strong as the muscle: nothing without the filter, nothing wrong with it; and live windows are those
/// of the training.
#[test]
fn a_filter_takes_the_mains_out_of_training_and_stream_alike() {
    let hum = |k: u64| 2000.0 * (2.0 * std::f64::consts::PI * 50.0 * k as f64 / 200.0).sin();
    let spoilt = |k: u64, amplitude: f64| {
        let mut sample = sample(k, amplitude);
        sample.channels.iter_mut().for_each(|v| *v += hum(k));
        sample
    };
    let recording = |amplitude: f64| (0..400).map(|k| spoilt(k, amplitude)).collect::<Vec<_>>();
    let right = |filters: Vec<crate::EmgFilter>| {
        let config = EmgConfig { filters, ..config() };
        let (mut windows, mut labels) = (Vec::new(), Vec::new());
        for (gesture, amplitude) in [(Command::NoMotion, 1.0), (Command::HandClose, 20.0)] {
            windows.extend(extract_features(&config, &recording(amplitude)).expect("good samples"));
            labels.resize(windows.len(), gesture);
        }
        let classifier = Classifier::train(&config, &windows, &labels).expect("good data");
        let mut pipeline = EmgPipeline::new(&config, classifier).expect("they fit");
        let mut live = Vec::new();
        for sample in recording(1.0) {
            let output = pipeline.step(SimTime(5 * sample.counter), std::slice::from_ref(&sample));
            live.extend(output.map(|_| pipeline.features().to_vec()));
        }
        assert_eq!(live, windows[..live.len()], "live windows are those of the training");
        // The notch needs some tenths of a second to settle.
        live.last().map_or(f64::NAN, |window| window[0])
    };
    assert!(right(Vec::new()) > 1000.0);
    assert!(right(vec!["notch:50".parse().expect("written right")]) < 20.0);
}

#[test]
fn a_drop_out_stops_the_arm_and_only_a_relaxed_hand_rearms_it() {
    let mut pipeline = pipeline();
    let before = run(&mut pipeline, 0, 400, 20.0, false);
    assert!(before.last().is_some_and(|(_, out)| out.gesture == Command::HandClose));

    assert!(!pipeline.events().is_eventful());
    let mut silenced = pipeline.clone();
    run(&mut silenced, 400, 197, 20.0, true);
    assert!(silenced.events().stale, "the last of these steps makes it stale");

    let silent = run(&mut pipeline, 400, 600, 20.0, true);
    assert_eq!(silent.len(), 1, "{silent:?}");
    let (at, out) = &silent[0];
    assert_eq!((*at, out.stale, out.gesture), (395 + 201, true, Command::NoMotion.into()));

    let held_through = run(&mut pipeline, 1000, 500, 20.0, false);
    assert!(held_through.iter().all(|(_, out)| out.gesture == Command::NoMotion), "{held_through:?}");
    assert_eq!(held_through.last().map(|(_, out)| out.window_class), Some(Command::HandClose.into()));
    assert_eq!(pipeline.counts().gaps, 1);
    assert!(!pipeline.events().is_eventful());

    run(&mut pipeline, 1500, 400, 1.0, false);
    let mut gapped = pipeline.clone();
    gapped.step(SimTime(1950), &[sample(390, 1.0)]);
    assert_eq!((gapped.events().counts.gaps, gapped.events().counts.rejected_windows), (1, 1));
    let rearmed = run(&mut pipeline, 1900, 400, 20.0, false);
    assert_eq!(rearmed.last().map(|(_, out)| out.gesture), Some(Command::HandClose.into()));
}

#[test]
fn samples_that_overflow_the_sums_reject_the_window() {
    let mut pipeline = pipeline();
    let outputs = run(&mut pipeline, 0, 400, f64::MAX, false);
    assert!(outputs.iter().all(|(_, out)| out.stale), "{outputs:?}");
    assert_eq!((pipeline.counts().windows, pipeline.counts().rejected_windows), (0, 7));
}

#[test]
fn raw_codes_less_their_zero_level_give_the_decisions_of_centred_samples() {
    let (mut centered, raw) = (pipeline(), pipeline());
    let levels = [128.0, -40.0];
    let mut raw = raw.with_dc_offset(&levels).expect("one a channel");
    for t in 0..1000 {
        let sample = sample(t, if t < 500 { 1.0 } else { 20.0 });
        // Whole numbers, so that the shift loses no digits.
        let whole: Vec<f64> = sample.channels.iter().map(|v| v.round()).collect();
        let shifted = whole.iter().zip(levels).map(|(v, level)| v + level);
        let at = SimTime(5 * t);
        let ours = raw.step(at, &[EmgSample { counter: t, channels: shifted.collect() }]);
        let theirs =
            centered.step(at, &[EmgSample { counter: t, channels: whole.iter().copied().collect() }]);
        assert_eq!(ours, theirs);
    }
    let wrong = pipeline().with_dc_offset(&[1.0]).map(|_| ()).expect_err("two channels");
    assert_eq!(wrong, EmgError::DcOffsetCount { got: 1, expected: 2 });
    assert!(pipeline().with_dc_offset(&[f64::NAN, 0.0]).is_err());
}

#[test]
fn a_classifier_of_another_band_is_refused() {
    let classifier = pipeline().classifier;
    let error = EmgPipeline::new(&EmgConfig::default(), classifier).expect_err("8 channels");
    assert_eq!(error, EmgError::ClassifierChannels { trained: 2, stream: 8 });
}
