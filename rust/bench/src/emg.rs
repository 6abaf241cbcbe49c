mod grid;
mod groups;

use crate::{BenchFigure, BenchReport, python_peer, quantile};
use proact_devices::{
    EmgOrigin, EmgPacket, SampleSource, SourceEvent, SyntheticEmg, SyntheticModel,
    gforce::{GForce, GForceOptions, Simulator, SimulatorOptions, TcpConnector, serve},
    prepare, stream,
};
use proact_emg::{Classifier, EmgConfig, EmgPipeline, FeatureExtractor, SlidingWindow, extract};
use proact_types::{EmgSample, Gesture, SimTime};
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
const FITS: usize = 20;
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
    let mut setup = prepare(&EmgOrigin::Synthetic, 1)?;
    let held = |tick: u64| Gesture::ALL[(tick / 2000 % 5) as usize];
    let samples: Vec<EmgSample> =
        (0..1000 * STREAM_SECS).flat_map(|t| setup.feed.sample_at(SimTime(t), held(t))).collect();
    let peer = Peer::measure();
    let mut figures = Vec::new();

    let times = window_to_class(&setup.config, &setup.classifier, &samples)?;
    for (name, share) in [("median", 0.5), ("99 %", 0.99), ("worst", 1.0)] {
        let goal = if share == 0.5 { "goal: at most 10; features and class of 8 x 100" } else { "" };
        let note = if share == 1.0 { "the machine's interruptions included" } else { goal };
        let figure =
            BenchFigure::alone(&format!("window to class, {name}"), quantile(&times, share), "us", note);
        figures.push(peer.beside(figure, |p| quantile(&p.windows, share)));
    }

    let times = fits(&samples, held)?;
    let note = "goal: under 5; 1,919 windows of 32 features";
    let figure = BenchFigure::alone("LDA fit, median", quantile(&times, 0.5), "ms", note);
    figures.push(peer.beside(figure, |p| p.fit));

    let mut pipeline = EmgPipeline::new(&setup.config, setup.classifier.clone())?;
    let begin = Instant::now();
    for sample in &samples {
        black_box(pipeline.step(SimTime(sample.counter), std::slice::from_ref(sample)));
    }
    let share = 100.0 * begin.elapsed().as_secs_f64() / (samples.len() as f64 / 1000.0);
    figures.push(BenchFigure::alone("live at 1 kHz, share of a core", share, "%", "goal: under 1"));

    figures.extend(groups::figures(&peer)?);
    figures.extend(grid::figures()?);

    let link = link_jitter(&setup.config, &setup.classifier)?;
    let note = "from the arrival of the packet that completes the window";
    figures.push(BenchFigure::alone("packet to decision, median", quantile(&link.compute, 0.5), "ms", note));
    figures.push(BenchFigure::alone("packet to decision, 99 %", quantile(&link.compute, 0.99), "ms", ""));
    let note = "goal: under one packet, 16; against the device's clock, simulator on loopback";
    figures.push(BenchFigure::alone("decision jitter, standard deviation", link.jitter(), "ms", note));
    figures.push(BenchFigure::alone("decision jitter, worst", link.worst(), "ms", ""));
    let note = "mean time that a window's last sample waits for its packet to be full";
    figures.push(BenchFigure::alone("wait for the packet", link.wait, "ms", note));
    if let (Some(why), Some(first)) = (&peer.absent, figures.first_mut()) {
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
fn fits(samples: &[EmgSample], held: impl Fn(u64) -> Gesture) -> Result<Vec<f64>, Box<dyn Error>> {
    let config = EmgConfig::default();
    let mut windows = extract(&config, samples)?;
    windows.truncate(FIT_WINDOWS);
    let labels: Vec<Gesture> = (0..windows.len() as u64).map(|k| held(k * 50 + 50)).collect();
    let mut times = Vec::new();
    for _ in 0..FITS {
        let begin = Instant::now();
        black_box(Classifier::train(&config, &windows, &labels)?);
        times.push(begin.elapsed().as_secs_f64() * 1e3);
    }
    Ok(times)
}

/// Decisions over the link, milliseconds.
struct Link {
    /// From the arrival of a packet to the decision.
    compute: Vec<f64>,
    /// Arrival of each decision less the device's time of the end of its packet.
    delays: Vec<f64>,
    wait: f64,
}

impl Link {
    fn mean(&self) -> f64 {
        self.delays.iter().sum::<f64>() / self.delays.len() as f64
    }

    fn jitter(&self) -> f64 {
        let mean = self.mean();
        (self.delays.iter().map(|d| (d - mean).powi(2)).sum::<f64>() / self.delays.len() as f64).sqrt()
    }

    fn worst(&self) -> f64 {
        let mean = self.mean();
        self.delays.iter().map(|d| (d - mean).abs()).fold(0.0, f64::max)
    }
}

/// Runs driver and pipeline against the simulator on a thread of its own.
fn link_jitter(config: &EmgConfig, classifier: &Classifier) -> Result<Link, Box<dyn Error>> {
    let model = SyntheticModel::shipped()?;
    let mut generator = SyntheticEmg::new(&model, 1000.0, 8, 1.0, stream(1, "emg/bench"))?;
    let codes = Box::new(move || generator.next(Gesture::HandClose));
    let mut simulator = Simulator::new(SimulatorOptions::flawless(1000, 8), codes)?;
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

fn decisions(address: &str, config: &EmgConfig, classifier: &Classifier) -> Result<Link, Box<dyn Error>> {
    let mut source = GForce::open(Box::new(TcpConnector::new(address)), GForceOptions::default())?;
    let zero = source.info().zero;
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
    Ok(Link { compute, delays, wait })
}

/// LibEMG's figures, from the same run.
struct Peer {
    measured: Option<PeerFigures>,
    absent: Option<String>,
}

struct PeerFigures {
    /// Microseconds of each window.
    windows: Vec<f64>,
    /// Milliseconds, median.
    fit: f64,
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

impl Peer {
    fn measure() -> Peer {
        match Peer::run() {
            Ok(figures) => Peer { measured: Some(figures), absent: None },
            Err(why) => Peer { measured: None, absent: Some(why) },
        }
    }

    fn run() -> Result<PeerFigures, String> {
        let object = python_peer::answer("libemg", PEER_PROGRAM, &[])?;
        let figures = || {
            let windows: Vec<f64> =
                object["windows"].as_array()?.iter().map(Value::as_f64).collect::<Option<_>>()?;
            Some(PeerFigures { windows, fit: object["fit"].as_f64()? })
        };
        figures()
            .filter(|found| !found.windows.is_empty())
            .ok_or_else(|| format!("LibEMG could not be measured: got {object}"))
    }

    fn beside(&self, figure: BenchFigure, value: impl FnOnce(&PeerFigures) -> f64) -> BenchFigure {
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
        let link = Link { compute: vec![], delays: vec![2.0, 4.0, 6.0], wait: 0.0 };
        assert_eq!((link.mean(), link.worst()), (4.0, 2.0));
        assert!((link.jitter() - (8.0_f64 / 3.0).sqrt()).abs() < 1e-12);
    }

    #[test]
    fn without_a_peer_the_figures_stand_alone_and_say_why() {
        let peer = Peer { measured: None, absent: Some("LibEMG not installed".to_owned()) };
        let figure =
            peer.beside(BenchFigure::alone("x", 1.0, "us", ""), |_| unreachable!("there is no peer"));
        assert_eq!((figure.peer, figure.peer_value), (None, None));
        let peer = Peer { measured: Some(PeerFigures { windows: vec![3.0], fit: 5.0 }), absent: None };
        let figure = peer.beside(BenchFigure::alone("x", 1.0, "us", ""), |p| p.fit);
        assert_eq!((figure.peer.as_deref(), figure.peer_value), (Some("LibEMG"), Some(5.0)));
    }
}
