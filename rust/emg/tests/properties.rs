//! What must hold for any signal.

mod common;

use common::{CHANNELS, config, signal};
use proact_emg::{
    Classifier, ClassifierKind, DecoderProcessConfig, EmgConfig, EmgModel, EmgPipeline, extract_features,
};
use proact_types::{Command, EmgSample, SimTime};
use proptest::prelude::*;

fn training(mix: f64) -> (Vec<Vec<f64>>, Vec<Command>) {
    let (mut windows, mut labels) = (Vec::new(), Vec::new());
    for gesture in Command::ALL {
        let features = extract_features(&config(), &signal(gesture, 400, mix)).expect("good samples");
        windows.extend(features.iter().map(|f| f.to_vec()));
        labels.resize(windows.len(), gesture);
    }
    (windows, labels)
}

proptest! {
    // Failures are told on the terminal, with the input; files beside the tests would be noise.
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn the_posterior_sums_to_one_and_its_largest_entry_is_the_class(
        mix in 0.0..1.0_f64,
        window in prop::collection::vec(-1e3..1e3_f64, 4 * CHANNELS),
    ) {
        let (windows, labels) = training(mix);
        let classifier = Classifier::train(&config(), &windows, &labels).expect("good data");
        let prediction = classifier.predict(&window).expect("finite window");
        prop_assert!((prediction.posterior.iter().sum::<f64>() - 1.0).abs() < 1e-12);
        let largest = prediction.posterior.iter().copied().fold(0.0, f64::max);
        prop_assert_eq!(prediction.confidence(), largest);
    }

    #[test]
    fn scaling_and_shifting_features_does_not_change_classes(
        mix in 0.0..1.0_f64,
        scales in prop::collection::vec(0.01..100.0_f64, 4 * CHANNELS),
        shifts in prop::collection::vec(-100.0..100.0_f64, 4 * CHANNELS),
    ) {
        let (windows, labels) = training(mix);
        let changed: Vec<Vec<f64>> = windows
            .iter()
            .map(|w| w.iter().zip(&scales).zip(&shifts).map(|((v, scale), shift)| v * scale + shift).collect())
            .collect();
        let plain = Classifier::train(&config(), &windows, &labels).expect("good data");
        let other = Classifier::train(&config(), &changed, &labels).expect("good data");
        for (a, b) in windows.iter().zip(&changed) {
            let (a, b) = (plain.predict(a).expect("finite"), other.predict(b).expect("finite"));
            // Rounding may decide between classes that are equally probable.
            let runner_up = a.posterior.iter().enumerate().filter(|(k, _)| *k != a.class_index);
            let margin = a.confidence() - runner_up.map(|(_, p)| *p).fold(0.0, f64::max);
            prop_assert!(a.class == b.class || margin < 1e-6, "{a:?} {b:?}");
        }
    }

    #[test]
    fn no_stream_however_broken_makes_the_pipeline_panic_or_act_at_once(
        counters in prop::collection::vec(prop_oneof![0..200_u64, any::<u64>()], 0..200),
        bad in prop::collection::vec(prop_oneof![Just(f64::NAN), Just(f64::INFINITY), -1e300..1e300_f64], 1..6),
    ) {
        let (windows, labels) = training(0.0);
        let classifier = Classifier::train(&config(), &windows, &labels).expect("good data");
        let mut pipeline = EmgPipeline::new(&config(), classifier).expect("they fit");
        for (tick, counter) in counters.iter().enumerate() {
            let channels = bad.iter().cycle().skip(tick % bad.len()).take(2 + tick % 3).copied().collect();
            let sample = EmgSample { counter: *counter, channels };
            if let Some(output) = pipeline.step(SimTime(tick as u64 * 5), &[sample]) {
                prop_assert!(output.confidence.is_finite() && (0.0..=1.0).contains(&output.effort));
            }
        }
    }

    #[test]
    fn a_damaged_model_file_is_refused_or_still_gives_numbers(
        damage in prop::collection::vec((any::<prop::sample::Index>(), "[0-9a-z\\[\\]{},.:\"-]"), 1..5),
        window in prop::collection::vec(-1e3..1e3_f64, 4 * CHANNELS),
        kind in prop::sample::select(&ClassifierKind::ALL[..]),
    ) {
        let process = kind.is_process().then(|| {
            DecoderProcessConfig::from_toml("command = [\"net\"]\ninput = \"samples\"").expect("a command is enough")
        });
        let config = EmgConfig { classifier: kind, process, ..config() };
        // The quadratic one needs more windows than features.
        let length = if kind == ClassifierKind::Qda { 10 * (4 * CHANNELS as u64 + 20) } else { 100 };
        let recordings: Vec<(Command, Vec<EmgSample>)> =
            Command::ALL.into_iter().map(|g| (g, signal(g, length, 0.0))).collect();
        let slices: Vec<(Command, &[EmgSample])> = recordings.iter().map(|(g, s)| (*g, s.as_slice())).collect();
        let model = EmgModel::train(&config.without_process(), &[0.0; CHANNELS], &slices).expect("good data");
        let model = match kind.is_process() {
            true => model.decoded_by_process(&config, "{\"weights\":[1.5,-2.0]}").expect("the same gestures"),
            false => model,
        };
        let json = model.to_json().expect("sound");
        let mut text = json.clone();
        for (index, letter) in &damage {
            let at = index.index(text.len());
            // The file is plain ASCII, and so is the damage.
            text.replace_range(at..=at, letter);
        }
        if let Ok(model) = EmgModel::from_json(&text) {
            if model.config.channels == CHANNELS
                && let Ok(prediction) = model.classifier.predict(&window)
            {
                prop_assert!((prediction.posterior.iter().sum::<f64>() - 1.0).abs() < 1e-9);
            }
            // Every stage that a model goes into stands it.
            if let Ok(mut pipeline) = EmgPipeline::new(&model.config, model.classifier.clone()) {
                pipeline.step(SimTime(0), &recordings[0].1);
            }
        }
    }
}
