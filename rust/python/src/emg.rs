//! EMG for classifiers in Python: what they are trained on, and the model in which they stand.

use crate::choice::{emg_origin, refused};
use numpy::{PyArray2, ToPyArray, ndarray::Array2};
use proact_devices::{EmgOrigin, Recordings, SyntheticEmg, SyntheticModel, default_config, stream};
use proact_emg::{ClassifierKind, EmgConfig, EmgModel, ProcessConfig, ProcessInput, extract};
use proact_types::{EmgSample, Gesture, GestureName};
use pyo3::prelude::*;
use std::error::Error;

/// What stands for the program of a classifier in Python. A replay takes its answers from the log.
const PYTHON_COMMAND: &str = "proact:python";
/// Length of a synthetic repetition and how many there are, as in a trial that trains its own model.
const SYNTHETIC_SECS: f64 = 3.0;
const SYNTHETIC_REPETITIONS: usize = 2;
/// Stream of random numbers for it: not that of the feed.
const TRAINING_STREAM: &str = "emg/synthetic/train";

/// Recordings to train on, one gesture each.
type Labelled = Vec<(GestureName, Vec<EmgSample>)>;

/// The repetitions of `origin` on which a trial with `seed` trains, with the settings for their stream.
fn training(origin: &EmgOrigin, seed: u64) -> Result<(EmgConfig, Labelled), Box<dyn Error>> {
    let config = default_config(origin)?;
    let recordings = match origin {
        EmgOrigin::Synthetic => {
            let model = SyntheticModel::shipped()?;
            let random = stream(seed, TRAINING_STREAM);
            let mut generator = SyntheticEmg::new(&model, config.rate_hz, config.channels, 1.0, random)?;
            let samples = (SYNTHETIC_SECS * config.rate_hz).round() as u64;
            let mut take = |gesture: Gesture| -> Vec<EmgSample> {
                (0..samples).map(|counter| EmgSample { counter, channels: generator.next(gesture) }).collect()
            };
            let each = (0..SYNTHETIC_REPETITIONS).flat_map(|_| Gesture::ALL);
            each.map(|gesture| (GestureName::from(gesture), take(gesture))).collect()
        }
        EmgOrigin::Recording { dir, rate_hz, train_reps, faults, .. } => {
            let recordings = Recordings::open(dir, *rate_hz)?;
            recordings.judge(train_reps, *faults)?;
            let trained = recordings.items.iter().filter(|item| train_reps.contains(&item.repetition));
            trained.map(|item| (item.gesture, item.numbered().collect())).collect()
        }
    };
    Ok((config, recordings))
}

/// Features of all windows, shape (windows, f), and the gesture of each.
#[pyfunction]
pub(crate) fn training_windows(
    py: Python<'_>,
    emg: String,
    seed: u64,
) -> PyResult<(Bound<'_, PyArray2<f64>>, Vec<String>)> {
    let (rows, labels) = windows(&emg_origin(emg), seed).map_err(refused)?;
    let width = rows.first().map_or(0, Vec::len);
    let features = Array2::from_shape_vec((rows.len(), width), rows.concat()).map_err(refused)?;
    Ok((features.to_pyarray(py), labels))
}

/// Features of windows, and the gesture of each.
type Windows = (Vec<Vec<f64>>, Vec<String>);

fn windows(origin: &EmgOrigin, seed: u64) -> Result<Windows, Box<dyn Error>> {
    let (config, recordings) = training(origin, seed)?;
    let (mut rows, mut labels) = (Vec::new(), Vec::new());
    for (gesture, samples) in &recordings {
        rows.extend(extract(&config, samples)?.into_iter().map(|features| features.to_vec()));
        labels.resize(rows.len(), gesture.to_string());
    }
    Ok((rows, labels))
}

/// The model of a trial whose windows a classifier in Python decodes, JSON text. Its gestures are in ascending order.
#[pyfunction]
pub(crate) fn outside_model(emg: String, seed: u64) -> PyResult<String> {
    let made = || -> Result<String, Box<dyn Error>> {
        let (config, mut recordings) = training(&emg_origin(emg), seed)?;
        recordings.sort_by_key(|(gesture, _)| gesture.to_string());
        let slices: Vec<(GestureName, &[EmgSample])> =
            recordings.iter().map(|(gesture, samples)| (*gesture, samples.as_slice())).collect();
        let stand_in = EmgModel::train(&config, &vec![0.0; config.channels], &slices)?;
        let process = ProcessConfig {
            command: vec![PYTHON_COMMAND.to_owned()],
            input: ProcessInput::Features,
            deadline_ms: 1000,
            gestures: Vec::new(),
        };
        let outside = EmgConfig {
            classifier: ClassifierKind::Process,
            process: Some(process),
            ..stand_in.config.clone()
        };
        Ok(stand_in.decoded_by_process(&outside, "null")?.to_json()?)
    };
    made().map_err(refused)
}
