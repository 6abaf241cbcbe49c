//! The live path asks for no memory. The only test of its program: allocations of others would be counted too.

mod common;

use common::{CHANNELS, config, signal};
use proact_emg::{
    Classifier, EmgConfig, EmgPipeline, Feature, FeatureSet, QualityConfig, QualityMonitor,
    extract_features_with_amplitudes,
};
use proact_types::{Command, SimTime};
use stats_alloc::{INSTRUMENTED_SYSTEM, Region, StatsAlloc};
use std::{alloc::System, num::NonZeroU32};

#[global_allocator]
static ALLOCATOR: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

#[test]
fn a_live_step_does_not_allocate_even_with_every_feature_and_option() {
    let config = EmgConfig {
        features: FeatureSet::new(Feature::all()).expect("some"),
        filters: vec![
            "highpass:5:2".parse().expect("written right"),
            "notch:50".parse().expect("written right"),
        ],
        rejection_threshold: Some(0.5),
        majority_vote_windows: NonZeroU32::new(5),
        ..config()
    };
    let (mut windows, mut labels, mut amplitudes) = (Vec::new(), Vec::new(), Vec::new());
    for gesture in Command::ALL {
        let (features, sums) =
            extract_features_with_amplitudes(&config, &signal(gesture, 400, 0.0)).expect("good samples");
        windows.extend(features);
        amplitudes.extend(sums);
        labels.resize(windows.len(), gesture);
    }
    let classifier =
        Classifier::train_with_amplitudes(&config, &windows, &labels, &amplitudes).expect("good data");
    let pipeline = EmgPipeline::new(&config, classifier).expect("they fit");
    let mut pipeline = pipeline.with_dc_offset(&[1.0; CHANNELS]).expect("one a channel");
    let mut monitor = QualityMonitor::new(QualityConfig::default(), 200.0, CHANNELS, &[]);
    let samples = signal(Command::HandOpen, 2000, 0.2);
    let mut outputs = 0;
    // The test harness may allocate in its own thread meanwhile, so the quietest of several rounds counts.
    let quietest = samples
        .chunks_exact(100)
        .map(|round| {
            let region = Region::new(ALLOCATOR);
            for sample in round {
                let output = pipeline.step(SimTime(sample.counter * 5), std::slice::from_ref(sample));
                monitor.push(SimTime(sample.counter * 5), sample);
                outputs += u32::from(output.is_some());
            }
            region.change().allocations
        })
        .min();
    assert_eq!(quietest, Some(0));
    assert_eq!(outputs, 199);
}
