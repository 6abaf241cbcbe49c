//! How long the EMG stage takes, on synthetic EMG at 1000 Hz and 8 channels, windows of 100 samples:
//!
//! ```text
//! cargo run --release -p proact-devices --example window_to_class
//! ```
// It measures with the real clock.
#![allow(clippy::disallowed_methods)]

use proact_devices::{EmgOrigin, prepare_emg};
use proact_emg::{Classifier, EmgConfig, EmgPipeline, FeatureExtractor, SlidingWindow, extract_features};
use proact_types::{Command, EmgSample, SimTime};
use std::{error::Error, hint::black_box, time::Instant};

fn main() -> Result<(), Box<dyn Error>> {
    let mut setup = prepare_emg(&EmgOrigin::Synthetic, 1)?;
    let intended = |tick: u64| Command::ALL[(tick / 2000 % 5) as usize];
    let samples: Vec<EmgSample> =
        (0..200_000).flat_map(|t| setup.feed.sample_at(SimTime(t), intended(t))).collect();

    // From a complete window to its class: features, discriminant, posterior.
    let mut window = SlidingWindow::new(&setup.config)?;
    let mut extractor = FeatureExtractor::new(&setup.config)?;
    let mut times = Vec::new();
    for sample in &samples {
        if let Some(view) = window.push(sample) {
            let start = Instant::now();
            let features = extractor.compute(&view);
            black_box(setup.classifier.predict(features)?);
            times.push(start.elapsed().as_secs_f64() * 1e6);
        }
    }
    report("window to class", &mut times);

    // The whole live stage: share of one core.
    let mut pipeline = EmgPipeline::new(&setup.config, setup.classifier.clone())?;
    let start = Instant::now();
    for sample in &samples {
        black_box(pipeline.step(SimTime(sample.counter), std::slice::from_ref(sample)));
    }
    let share = start.elapsed().as_secs_f64() / (samples.len() as f64 / 1000.0);
    println!("live at 1 kHz: {:.4} % of one core", share * 100.0);

    // Training on about as many windows as LibEMG's figure was measured with.
    let config = EmgConfig::default();
    let mut windows = extract_features(&config, &samples[..96_050])?;
    windows.truncate(1919);
    let labels: Vec<Command> = (0..windows.len() as u64).map(|k| intended(k * 50 + 50)).collect();
    let mut times: Vec<f64> = (0..20)
        .map(|_| {
            let start = Instant::now();
            black_box(Classifier::train(&config, &windows, &labels))
                .map(|_| start.elapsed().as_secs_f64() * 1e6)
        })
        .collect::<Result<_, _>>()?;
    report(&format!("training on {} windows of 32 features", windows.len()), &mut times);
    Ok(())
}

fn report(what: &str, micros: &mut [f64]) {
    micros.sort_by(f64::total_cmp);
    let at = |share: f64| micros[((micros.len() - 1) as f64 * share) as usize];
    println!("{what}: median {:.2} us, 99 % {:.2} us, most {:.2} us", at(0.5), at(0.99), at(1.0));
}
