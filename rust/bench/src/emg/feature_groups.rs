//! Groups of features, and the way from files to classes, beside LibEMG's own calls on the same files.

use super::LibEmgPeer;
use crate::{BenchFigure, python_peer, quantile, thread_cpu_secs};
use proact_devices::{Recording, Recordings, SyntheticEmg, SyntheticModel, random_stream};
use proact_emg::{
    Classifier, EmgConfig, FeatureExtractor, FeatureSet, SlidingWindow, WindowView, extract_features,
};
use proact_types::{Command, EmgSample};
use serde_json::Value;
use std::{error::Error, fmt::Write as _, hint::black_box, path::Path};

/// Channels, samples a second, and seconds of each recording.
const CHANNELS: usize = 8;
const RATE_HZ: f64 = 1000.0;
const SECONDS: usize = 4;
/// Recordings of each of five gestures.
const REPETITIONS: usize = 4;
/// Times that each is measured at least, and for how long at least, seconds of ours.
const ROUNDS: usize = 5;
const MIN_MEASURE_SECS: f64 = 0.5;
/// LibEMG's groups that are ours, too: of what `COMB` names there one feature is missing.
const GROUPS: [&str; 11] =
    ["HTD", "TDAR", "LS4", "LS9", "TDPSD", "HJORTH", "ITD", "TSTD", "DFTR", "COMB", "MSWT"];

/// Prints one JSON object: microseconds of processor time a window for each group, and milliseconds from files to classes.
const PEER_PROGRAM: &str = r#"
import json, sys, time, warnings
import numpy as np
from libemg.data_handler import OfflineDataHandler, RegexFilter
from libemg.feature_extractor import FeatureExtractor
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis

warnings.simplefilter("ignore")
folder, rounds, groups = sys.argv[1], int(sys.argv[2]), sys.argv[3].split(",")
extractor = FeatureExtractor()
def read():
    handler = OfflineDataHandler()
    filters = [RegexFilter("_C_", ".csv", [str(k) for k in range(5)], "classes"),
               RegexFilter("R_", "_C_", [str(k) for k in range(4)], "reps")]
    handler.get_data(folder, filters, delimiter=",")
    return handler
def whole():
    windows, metadata = read().parse_windows(100, 50)
    features = np.hstack(list(extractor.extract_feature_group("HTD", windows).values()))
    model = LinearDiscriminantAnalysis().fit(features, metadata["classes"])
    return model.predict_proba(features)
def timed(run):
    times = []
    for _ in range(rounds):
        begin = time.process_time()
        run()
        times.append(time.process_time() - begin)
    return float(np.median(times))
handler = read()
windows, _ = handler.parse_windows(100, 50)
figures = {"cut": 1e6 * timed(lambda: handler.parse_windows(100, 50)) / len(windows), "whole": 1e3 * timed(whole)}
for group in groups:
    figures[group] = 1e6 * timed(lambda: extractor.extract_feature_group(group, windows)) / len(windows)
print(json.dumps(figures))
"#;

/// Measures ours, and the peer's where it is there.
pub(super) fn figures(peer: &LibEmgPeer) -> Result<Vec<BenchFigure>, Box<dyn Error>> {
    let folder = tempfile::tempdir()?;
    write_files(folder.path())?;
    let words: [&str; 3] = [&folder.path().to_string_lossy(), &ROUNDS.to_string(), &GROUPS.join(",")];
    // Without the peer the figures stand alone and say why, once for all stages of the bench.
    let (peer_sums, why) = match peer.unavailable_reason {
        Some(_) => (None, String::new()),
        None => match python_peer::run_peer("libemg", PEER_PROGRAM, &words) {
            Ok(peer_sums) => (Some(peer_sums), String::new()),
            Err(why) => (None, format!("; {why}")),
        },
    };
    let recordings = Recordings::read(folder.path(), RATE_HZ)?;
    let samples: Vec<Vec<EmgSample>> = recordings.items.iter().map(to_samples).collect();
    let mut figures = Vec::new();
    let whole = median_cpu_secs(|| classify_files(folder.path()))?;
    let note = format!("files read, windows, HTD, LDA fitted, classes; goal: 5 times LibEMG's speed{why}");
    let name = "files to classes, HTD and LDA";
    figures.push(with_peer_sum(
        BenchFigure::without_peer(name, 1e3 * whole, "ms", &note),
        peer_sums.as_ref(),
        &["whole"],
    ));
    let mut windows = 0;
    let secs = median_cpu_secs(|| {
        windows = count_windows(&samples)?;
        Ok(())
    })?;
    let cut = 1e6 * secs / windows as f64;
    figures.push(with_peer_sum(
        BenchFigure::without_peer("windows cut, a window", cut, "us", ""),
        peer_sums.as_ref(),
        &["cut"],
    ));
    let mut cutters = vec![SlidingWindow::new(&EmgConfig::default())?; windows as usize];
    let views = all_windows(&samples, &mut cutters)?;
    for name in GROUPS {
        let config = EmgConfig { features: name.parse::<FeatureSet>()?, ..EmgConfig::default() };
        let secs = median_cpu_secs(|| {
            for items in &samples {
                black_box(extract_features(&config, items)?);
            }
            Ok(())
        })?;
        let goal = if name == "HTD" { 5 } else { 20 };
        let note = format!("cut and computed, 8 x 100 samples; goal: {goal} times LibEMG's speed");
        let value = 1e6 * secs / views.len() as f64;
        let figure = BenchFigure::without_peer(&format!("samples to {name}, a window"), value, "us", &note);
        figures.push(with_peer_sum(figure, peer_sums.as_ref(), &["cut", name]));
        let mut extractor = FeatureExtractor::new(&config)?;
        let secs = median_cpu_secs(|| {
            for view in &views {
                black_box(extractor.compute(view));
            }
            Ok(())
        })?;
        let value = 1e6 * secs / views.len() as f64;
        let note = format!("{} windows that were cut before", views.len());
        let figure = BenchFigure::without_peer(&format!("{name} alone, a window"), value, "us", &note);
        figures.push(with_peer_sum(figure, peer_sums.as_ref(), &[name]));
    }
    Ok(figures)
}

/// Beside the sum of what the peer told of `keys`.
fn with_peer_sum(figure: BenchFigure, peer_sums: Option<&Value>, keys: &[&str]) -> BenchFigure {
    match peer_sums.and_then(|peer_sums| keys.iter().map(|key| peer_sums[*key].as_f64()).sum::<Option<f64>>())
    {
        Some(value) => figure.with_peer(super::PEER, value),
        None => figure,
    }
}

fn to_samples(item: &Recording) -> Vec<EmgSample> {
    let rows = item.samples.iter().cloned().enumerate();
    rows.map(|(row, channels)| EmgSample { counter: row as u64, channels }).collect()
}

/// Cuts windows and does nothing with them.
fn count_windows(recordings: &[Vec<EmgSample>]) -> Result<u64, Box<dyn Error>> {
    let mut windows = 0;
    for items in recordings {
        let mut window = SlidingWindow::new(&EmgConfig::default())?;
        for sample in items {
            black_box(window.push(sample));
        }
        windows += window.counts().windows;
    }
    Ok(windows)
}

/// Every window of the recordings, each in a cutter of its own.
fn all_windows<'a>(
    recordings: &[Vec<EmgSample>],
    cutters: &'a mut [SlidingWindow],
) -> Result<Vec<WindowView<'a>>, Box<dyn Error>> {
    let config = EmgConfig::default();
    let (length, increment) = (config.window_samples()?, config.increment_samples()?);
    let pieces = recordings.iter().flat_map(|items| items.windows(length).step_by(increment));
    let last_view = |(cutter, samples): (&'a mut SlidingWindow, &[EmgSample])| {
        let (last, before) = samples.split_last()?;
        before.iter().for_each(|sample| {
            cutter.push(sample);
        });
        cutter.push(last)
    };
    Ok(cutters.iter_mut().zip(pieces).filter_map(last_view).collect())
}

/// From files to the class of each window.
fn classify_files(folder: &Path) -> Result<(), Box<dyn Error>> {
    let config = EmgConfig::default();
    let recordings = Recordings::read(folder, RATE_HZ)?;
    let (mut windows, mut labels) = (Vec::new(), Vec::new());
    for item in &recordings.items {
        let found = extract_features(&config, &to_samples(item))?;
        labels.extend(std::iter::repeat_n(item.gesture, found.len()));
        windows.extend(found);
    }
    let classifier = Classifier::train(&config, &windows, &labels)?;
    for window in &windows {
        black_box(classifier.predict(window)?);
    }
    Ok(())
}

/// Median of what it takes on a core, seconds: of five times, or of as many as half a second has where it is short.
fn median_cpu_secs(mut run: impl FnMut() -> Result<(), Box<dyn Error>>) -> Result<f64, Box<dyn Error>> {
    let (mut times, mut spent) = (Vec::new(), 0.0);
    while times.len() < ROUNDS || spent < MIN_MEASURE_SECS {
        let begin = thread_cpu_secs();
        run()?;
        let secs = thread_cpu_secs() - begin;
        times.push(secs);
        spent += secs;
    }
    Ok(quantile(&times, 0.5))
}

/// Recordings as LibEMG names them.
fn write_files(folder: &Path) -> Result<(), Box<dyn Error>> {
    let model = SyntheticModel::shipped()?;
    for repetition in 0..REPETITIONS {
        for (class, gesture) in Command::ALL.into_iter().enumerate() {
            let seed = random_stream((10 * repetition + class) as u64, "emg/groups");
            let mut generator = SyntheticEmg::new(&model, RATE_HZ, CHANNELS, 1.0, seed)?;
            let mut text = String::new();
            for _ in 0..SECONDS * RATE_HZ as usize {
                let sample = generator.next(gesture);
                let row: Vec<String> = sample.iter().map(f64::to_string).collect();
                writeln!(text, "{}", row.join(","))?;
            }
            std::fs::write(folder.join(format!("R_{repetition}_C_{class}.csv")), text)?;
        }
    }
    Ok(())
}
