//! A grid of 64 electrodes at 4 kHz through the path of a live trial: a source on a thread of its own, the queue, the pipeline.

use crate::{BenchFigure, bridge::cpu_of_all_threads, quantile};
use proact_app::LiveArmband;
use proact_devices::{
    AmplifierLayout, Pacing, PlaybackSource, SampleSource, SyntheticEmg, SyntheticModel, random_stream,
};
use proact_emg::{EmgConfig, EmgModel, EmgPipeline};
use proact_types::{ChannelValues, Command, EmgSample, SimTime};
use std::{
    error::Error,
    hint::black_box,
    time::{Duration, Instant},
};

const CHANNELS: usize = 64;
const RATE_HZ: f64 = 4000.0;
/// Samples that such amplifiers send at once.
const PACKET_SAMPLES: usize = 64;
/// Recorded of each gesture: more windows than the 256 features.
const TRAIN_SECS: f64 = 15.0;
/// Seconds that are played in real time.
const LIVE_SECS: f64 = 10.0;

/// What came of the stream.
struct LiveResult {
    /// From the samples that complete a window to its decision, milliseconds.
    decision_ms: Vec<f64>,
    /// Processor time of all threads, percent of one core.
    cpu_percent: f64,
    /// Samples that came, and that were sent.
    samples: [usize; 2],
}

/// The figures of the grid.
///
/// # Errors
/// Data that no classifier can be trained on: it should not be.
pub(super) fn figures() -> Result<Vec<BenchFigure>, Box<dyn Error>> {
    let model = model()?;
    let live = live(&model)?;
    let [came, sent] = live.samples;
    let note = format!(
        "goal: under 2; source, queue and pipeline, 256 features of 64 channels every 50 ms; {came} of {sent} samples came"
    );
    let mut figures = vec![BenchFigure::without_peer(
        "64 channels at 4 kHz live, share of a core",
        live.cpu_percent,
        "%",
        &note,
    )];
    for (name, share) in [("median", 0.5), ("99 %", 0.99), ("worst", 1.0)] {
        let note = if share == 1.0 { "the machine's interruptions included" } else { "" };
        let name = format!("64 channels at 4 kHz, samples to decision, {name}");
        figures.push(BenchFigure::without_peer(&name, quantile(&live.decision_ms, share), "ms", note));
    }
    Ok(figures)
}

/// Samples of somebody who makes `gesture` under a grid around the arm, as the double of an amplifier has them.
fn simulate_gesture(gesture: Command, seconds: f64, seed: u64) -> Result<Vec<ChannelValues>, Box<dyn Error>> {
    let mut layout = AmplifierLayout::find("otb").ok_or("the layout of a grid is gone")?;
    layout.channels.retain(|channel| channel.kind == "EMG");
    let figures = SyntheticModel::shipped()?;
    let around = figures.channels();
    let mut person =
        SyntheticEmg::new(&figures, RATE_HZ, around, 1.0, random_stream(seed, "emg/bench/grid"))?;
    let mut grid = layout.simulated_samples(Box::new(move || person.next(gesture)), seed);
    Ok((0..(seconds * RATE_HZ) as usize).map(|_| grid()).collect())
}

/// The same with counters from `first`.
fn with_counters(first: u64, take: Vec<ChannelValues>) -> impl Iterator<Item = EmgSample> {
    (first..).zip(take).map(|(counter, channels)| EmgSample { counter, channels })
}

fn model() -> Result<EmgModel, Box<dyn Error>> {
    let mut takes: Vec<(Command, Vec<EmgSample>)> = Vec::new();
    for (gesture, seed) in Command::ALL.into_iter().zip(1..) {
        takes.push((gesture, with_counters(0, simulate_gesture(gesture, TRAIN_SECS, seed)?).collect()));
    }
    let slices: Vec<(Command, &[EmgSample])> = takes.iter().map(|(g, take)| (*g, take.as_slice())).collect();
    let config = EmgConfig { rate_hz: RATE_HZ, channels: CHANNELS, ..EmgConfig::default() };
    Ok(EmgModel::train(&config, &[0.0; CHANNELS], &slices)?)
}

fn live(model: &EmgModel) -> Result<LiveResult, Box<dyn Error>> {
    let mut samples: Vec<EmgSample> = Vec::new();
    for (gesture, seed) in Command::ALL.into_iter().zip(11..) {
        let held = simulate_gesture(gesture, LIVE_SECS / Command::ALL.len() as f64, seed)?;
        samples.extend(with_counters(samples.len() as u64, held));
    }
    let sent = samples.len();
    let source = PlaybackSource::new("grid", samples, RATE_HZ, PACKET_SAMPLES, Pacing::RealTime)?;
    let mut pipeline = EmgPipeline::new(&model.config, model.classifier.clone())?;
    let source: Box<dyn SampleSource> = Box::new(source);
    let armband = LiveArmband::start(source, model.clone());
    let (begin, before) = (Instant::now(), cpu_of_all_threads()?);
    let (mut decisions, mut came) = (Vec::new(), 0);
    while begin.elapsed().as_secs_f64() < LIVE_SECS {
        let samples = armband.wait_for_samples(Duration::from_millis(20));
        let arrived = Instant::now();
        came += samples.len();
        let now = SimTime(begin.elapsed().as_millis() as u64);
        if black_box(pipeline.step(now, &samples)).is_some_and(|output| !output.stale) {
            decisions.push(arrived.elapsed().as_secs_f64() * 1e3);
        }
    }
    let load = 100.0 * (cpu_of_all_threads()? - before) / begin.elapsed().as_secs_f64();
    if decisions.is_empty() {
        return Err("no decision came of the grid".into());
    }
    Ok(LiveResult { decision_ms: decisions, cpu_percent: load, samples: [came, sent] })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_model_of_the_grid_tells_its_gestures_apart() {
        let model = model().expect("windows enough");
        assert_eq!(model.classifier.feature_count(), 256);
        let mut pipeline = EmgPipeline::new(&model.config, model.classifier.clone()).expect("they fit");
        let mut right = 0;
        for sample in
            with_counters(0, simulate_gesture(Command::HandClose, 2.0, 21).expect("shipped figures"))
        {
            let output = pipeline.step(SimTime(sample.counter / 4), std::slice::from_ref(&sample));
            right += usize::from(output.is_some_and(|output| output.window_class == Command::HandClose));
        }
        assert!(right >= 35, "{right} of 39 windows");
    }
}
