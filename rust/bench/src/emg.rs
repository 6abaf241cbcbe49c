mod feature_groups;
mod grid;

use crate::{BenchFigure, BenchReport, python_peer, quantile};
use proact_devices::{
    EmgOrigin, EmgPacket, SampleSource, SourceEvent, SyntheticEmg, SyntheticModel,
    gforce::{GForce, GForceOptions, GForceSimulator, GForceSimulatorOptions, TcpConnector, serve},
    prepare_emg, random_stream,
};
use proact_emg::{Classifier, EmgConfig, EmgPipeline, FeatureExtractor, SlidingWindow, extract_features};
use proact_types::{Command, EmgSample, SimTime};
use serde_json::Value;
use std::{
    error::Error,
    hint::black_box,
    net::TcpListener,
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    time::{Duration, Instant},
};

/// Windows of LibEMG's figure for fitting: 22 people's worth of one of them (reference measurement).
const FIT_WINDOWS: usize = 1919;
/// Fits measured.
const FIT_COUNT: usize = 20;
/// Seconds of synthetic EMG at 1 kHz.
const STREAM_SECS: u64 = 100;
/// Seconds over the simulator's link.
const LINK_SECS: f64 = 6.0;
const PEER: &str = "LibEMG";

/// Window to class, fitting, the live share of a core, and the jitter of decisions over the simulator's link; LibEMG
/// beside it if a virtual environment of peers has it.
///
/// # Errors
/// Data that no classifier can be trained on, or a link that fails: neither should be.
pub(crate) fn emg() -> Result<BenchReport, Box<dyn Error>> {
    let mut setup = prepare_emg(&EmgOrigin::Synthetic, 1)?;
    let held = |tick: u64| Command::ALL[(tick / 2000 % 5) as usize];
    let samples: Vec<EmgSample> =
        (0..1000 * STREAM_SECS).flat_map(|t| setup.feed.sample_at(SimTime(t), held(t))).collect();
    let peer = LibEmgPeer::measure();
    let mut figures = Vec::new();

    let times = window_to_class(&setup.config, &setup.classifier, &samples)?;
    for (name, share) in [("median", 0.5), ("99 %", 0.99), ("worst", 1.0)] {
        let goal = if share == 0.5 { "goal: at most 10; features and class of 8 x 100" } else { "" };
        let note = if share == 1.0 { "the machine's interruptions included" } else { goal };
        let figure = BenchFigure::without_peer(
            &format!("window to class, {name}"),
            quantile(&times, share),
            "us",
            note,
        );
        figures.push(peer.with_peer(figure, |p| quantile(&p.window_us, share)));
    }

    let times = fits(&samples, held)?;
    let note = "goal: under 5; 1,919 windows of 32 features";
    let figure = BenchFigure::without_peer("LDA fit, median", quantile(&times, 0.5), "ms", note);
    figures.push(peer.with_peer(figure, |p| p.fit_ms));

    let mut pipeline = EmgPipeline::new(&setup.config, setup.classifier.clone())?;
    let begin = Instant::now();
    for sample in &samples {
        black_box(pipeline.step(SimTime(sample.counter), std::slice::from_ref(sample)));
    }
    let share = 100.0 * begin.elapsed().as_secs_f64() / (samples.len() as f64 / 1000.0);
    figures.push(BenchFigure::without_peer("live at 1 kHz, share of a core", share, "%", "goal: under 1"));

    figures.extend(feature_groups::figures(&peer)?);
    figures.extend(grid::figures()?);

    let link = link_jitter(&setup.config, &setup.classifier)?;
    let note = "from the arrival of the packet that completes the window";
    figures.push(BenchFigure::without_peer(
        "packet to decision, median",
        quantile(&link.compute_ms, 0.5),
        "ms",
        note,
    ));
    figures.push(BenchFigure::without_peer(
        "packet to decision, 99 %",
        quantile(&link.compute_ms, 0.99),
        "ms",
        "",
    ));
    let note = "goal: under one packet, 16; against the device's clock, simulator on loopback";
    figures.push(BenchFigure::without_peer("decision jitter, standard deviation", link.jitter(), "ms", note));
    figures.push(BenchFigure::without_peer("decision jitter, worst", link.worst(), "ms", ""));
    let note = "mean time that a window's last sample waits for its packet to be full";
    figures.push(BenchFigure::without_peer("wait for the packet", link.wait_ms, "ms", note));
    if let (Some(why), Some(first)) = (&peer.unavailable_reason, figures.first_mut()) {
        first.note += &format!("; {why}");
    }
    Ok(BenchReport::new("emg", figures))
}

/// Microseconds of each window of the stream.
fn window_to_class(
    config: &EmgConfig,
    classifier: &Classifier,
    samples: &[EmgSample],
) -> Result<Vec<f64>, Box<dyn Error>> {
    let mut window = SlidingWindow::new(config)?;
    let mut extractor = FeatureExtractor::new(config)?;
    let mut times = Vec::new();
    for sample in samples {
        if let Some(view) = window.push(sample) {
            let begin = Instant::now();
            let features = extractor.compute(&view);
            black_box(classifier.predict(features)?);
            times.push(begin.elapsed().as_secs_f64() * 1e6);
        }
    }
    Ok(times)
}

/// Milliseconds of each fit.
fn fits(samples: &[EmgSample], held: impl Fn(u64) -> Command) -> Result<Vec<f64>, Box<dyn Error>> {
    let config = EmgConfig::default();
    let mut windows = extract_features(&config, samples)?;
    windows.truncate(FIT_WINDOWS);
    let labels: Vec<Command> = (0..windows.len() as u64).map(|k| held(k * 50 + 50)).collect();
    let mut times = Vec::new();
    for _ in 0..FIT_COUNT {
        let begin = Instant::now();
        black_box(Classifier::train(&config, &windows, &labels)?);
        times.push(begin.elapsed().as_secs_f64() * 1e3);
    }
    Ok(times)
}

/// Decisions over the link, milliseconds.
struct DecisionTiming {
    /// From the arrival of a packet to the decision.
    compute_ms: Vec<f64>,
    /// Arrival of each decision less the device's time of the end of its packet.
    delay_ms: Vec<f64>,
    wait_ms: f64,
}

impl DecisionTiming {
    fn mean(&self) -> f64 {
        self.delay_ms.iter().sum::<f64>() / self.delay_ms.len() as f64
    }

    fn jitter(&self) -> f64 {
        let mean = self.mean();
        (self.delay_ms.iter().map(|d| (d - mean).powi(2)).sum::<f64>() / self.delay_ms.len() as f64).sqrt()
    }

    fn worst(&self) -> f64 {
        let mean = self.mean();
        self.delay_ms.iter().map(|d| (d - mean).abs()).fold(0.0, f64::max)
    }
}

/// Runs driver and pipeline against the simulator on a thread of its own.
fn link_jitter(config: &EmgConfig, classifier: &Classifier) -> Result<DecisionTiming, Box<dyn Error>> {
    let model = SyntheticModel::shipped()?;
    let mut generator = SyntheticEmg::new(&model, 1000.0, 8, 1.0, random_stream(1, "emg/bench"))?;
    let codes = Box::new(move || generator.next(Command::HandClose));
    let mut simulator = GForceSimulator::new(GForceSimulatorOptions::flawless(1000, 8), codes)?;
    let listener = TcpListener::bind(("127.0.0.1", 0))?;
    let address = listener.local_addr()?.to_string();
    let stop = Arc::new(AtomicBool::new(false));
    let server = {
        let stop = stop.clone();
        std::thread::spawn(move || serve(&listener, &mut simulator, &stop, |_| {}))
    };
    let measured = decisions(&address, config, classifier);
    stop.store(true, Ordering::Relaxed);
    server.join().map_err(|_| "the simulator panicked")??;
    measured
}

fn decisions(
    address: &str,
    config: &EmgConfig,
    classifier: &Classifier,
) -> Result<DecisionTiming, Box<dyn Error>> {
    let mut source = GForce::open(Box::new(TcpConnector::new(address)), GForceOptions::default())?;
    let zero = source.info().zero_code;
    let mut pipeline = EmgPipeline::new(config, classifier.clone())?;
    let mut packet = EmgPacket::default();
    let (mut compute, mut delays, mut waits) = (Vec::new(), Vec::new(), Vec::new());
    let begin = Instant::now();
    while begin.elapsed().as_secs_f64() < LINK_SECS {
        if source.poll(Duration::from_millis(100), &mut packet)? != SourceEvent::Packet {
            continue;
        }
        let arrived = Instant::now();
        for sample in &mut packet.samples {
            sample.channels.iter_mut().for_each(|value| *value -= zero);
            let now = SimTime(packet.received.as_millis() as u64);
            if black_box(pipeline.step(now, std::slice::from_ref(sample))).is_some() {
                compute.push(arrived.elapsed().as_secs_f64() * 1e3);
                delays.push((begin.elapsed().as_secs_f64() - packet.device_secs) * 1e3);
                waits.push(packet.device_secs * 1e3 - (sample.counter + 1) as f64);
            }
        }
    }
    if delays.is_empty() {
        return Err("no decision came over the link".into());
    }
    let wait = waits.iter().sum::<f64>() / waits.len() as f64;
    Ok(DecisionTiming { compute_ms: compute, delay_ms: delays, wait_ms: wait })
}

/// LibEMG's figures, from the same run.
struct LibEmgPeer {
    measured: Option<LibEmgFigures>,
    unavailable_reason: Option<String>,
}

struct LibEmgFigures {
    /// Microseconds of each window.
    window_us: Vec<f64>,
    /// Milliseconds, median.
    fit_ms: f64,
}

/// Times LibEMG's own calls on random windows of the same size; prints one JSON object.
const PEER_PROGRAM: &str = r#"
import json, time
import numpy as np
from libemg.feature_extractor import FeatureExtractor
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis

rng = np.random.default_rng(1)
extractor = FeatureExtractor()
flat = lambda windows: np.hstack(list(extractor.extract_feature_group("HTD", windows).values()))
labels = np.arange(1919) % 5
training = flat(rng.normal(size=(1919, 8, 100)) * (1 + labels)[:, None, None])
fits = []
for _ in range(20):
    begin = time.perf_counter()
    model = LinearDiscriminantAnalysis().fit(training, labels)
    fits.append((time.perf_counter() - begin) * 1e3)
windows = []
for _ in range(2000):
    window = rng.normal(size=(1, 8, 100))
    begin = time.perf_counter()
    model.predict_proba(flat(window)).argmax()
    windows.append((time.perf_counter() - begin) * 1e6)
print(json.dumps({"windows": windows, "fit": float(np.median(fits))}))
"#;

impl LibEmgPeer {
    fn measure() -> LibEmgPeer {
        match LibEmgPeer::run() {
            Ok(figures) => LibEmgPeer { measured: Some(figures), unavailable_reason: None },
            Err(why) => LibEmgPeer { measured: None, unavailable_reason: Some(why) },
        }
    }

    fn run() -> Result<LibEmgFigures, String> {
        let object = python_peer::run_peer("libemg", PEER_PROGRAM, &[])?;
        let figures = || {
            let windows: Vec<f64> =
                object["windows"].as_array()?.iter().map(Value::as_f64).collect::<Option<_>>()?;
            Some(LibEmgFigures { window_us: windows, fit_ms: object["fit"].as_f64()? })
        };
        figures()
            .filter(|found| !found.window_us.is_empty())
            .ok_or_else(|| format!("LibEMG could not be measured: got {object}"))
    }

    fn with_peer(&self, figure: BenchFigure, value: impl FnOnce(&LibEmgFigures) -> f64) -> BenchFigure {
        match &self.measured {
            Some(figures) => {
                BenchFigure { peer: Some(PEER.to_owned()), peer_value: Some(value(figures)), ..figure }
            }
            None => figure,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn jitter_is_about_the_mean_delay() {
        let link = DecisionTiming { compute_ms: vec![], delay_ms: vec![2.0, 4.0, 6.0], wait_ms: 0.0 };
        assert_eq!((link.mean(), link.worst()), (4.0, 2.0));
        assert!((link.jitter() - (8.0_f64 / 3.0).sqrt()).abs() < 1e-12);
    }

    #[test]
    fn without_a_peer_the_figures_stand_alone_and_say_why() {
        let peer = LibEmgPeer { measured: None, unavailable_reason: Some("LibEMG not installed".to_owned()) };
        let figure = peer
            .with_peer(BenchFigure::without_peer("x", 1.0, "us", ""), |_| unreachable!("there is no peer"));
        assert_eq!((figure.peer, figure.peer_value), (None, None));
        let peer = LibEmgPeer {
            measured: Some(LibEmgFigures { window_us: vec![3.0], fit_ms: 5.0 }),
            unavailable_reason: None,
        };
        let figure = peer.with_peer(BenchFigure::without_peer("x", 1.0, "us", ""), |p| p.fit_ms);
        assert_eq!((figure.peer.as_deref(), figure.peer_value), (Some("LibEMG"), Some(5.0)));
    }
}
