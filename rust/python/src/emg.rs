//! EMG for classifiers in Python: what they are trained on, and the model in which they stand.

use crate::trial_keywords::{emg_origin, fault_policy, value_error};
use numpy::{PyArray2, ToPyArray, ndarray::Array2};
use proact_devices::{
    EmgOrigin, Recordings, SyntheticEmg, SyntheticModel, accepted_fault_texts, default_config, random_stream,
};
use proact_emg::{
    ClassifierKind, DecoderProcessConfig, DecoderProcessInput, EmgConfig, EmgModel, extract_features,
};
use proact_types::{Command, EmgSample, Gesture};
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
type LabeledRecordings = Vec<(Gesture, Vec<EmgSample>)>;

/// What a trial trains on.
struct TrainingRecordings {
    /// Settings for the stream.
    config: EmgConfig,
    recordings: LabeledRecordings,
    /// Findings that make an accuracy wrong and were accepted, one sentence each.
    accepted_faults: Vec<String>,
}

/// The repetitions of `origin` on which a trial with `seed` trains.
fn read_training(origin: &EmgOrigin, seed: u64) -> Result<TrainingRecordings, Box<dyn Error>> {
    let config = default_config(origin)?;
    let mut accepted_faults = Vec::new();
    let recordings = match origin {
        EmgOrigin::Synthetic => {
            let model = SyntheticModel::shipped()?;
            let random = random_stream(seed, TRAINING_STREAM);
            let mut generator = SyntheticEmg::new(&model, config.rate_hz, config.channels, 1.0, random)?;
            let samples = (SYNTHETIC_SECS * config.rate_hz).round() as u64;
            let mut take = |gesture: Command| -> Vec<EmgSample> {
                (0..samples).map(|counter| EmgSample { counter, channels: generator.next(gesture) }).collect()
            };
            let each = (0..SYNTHETIC_REPETITIONS).flat_map(|_| Command::ALL);
            each.map(|gesture| (Gesture::from(gesture), take(gesture))).collect()
        }
        EmgOrigin::Recording { dir, rate_hz, train_reps, faults, .. } => {
            let recordings = Recordings::open(dir, *rate_hz)?;
            accepted_faults = accepted_fault_texts(&recordings.check_faults(train_reps, *faults)?);
            let trained = recordings.items.iter().filter(|item| train_reps.contains(&item.repetition));
            trained.map(|item| (item.gesture, item.numbered_samples().collect())).collect()
        }
    };
    Ok(TrainingRecordings { config, recordings, accepted_faults })
}

/// Features of all windows, shape (windows, f), and the gesture of each.
#[pyfunction]
#[pyo3(signature = (emg, seed, *, accept_faults=false))]
pub(crate) fn training_windows(
    py: Python<'_>,
    emg: String,
    seed: u64,
    accept_faults: bool,
) -> PyResult<(Bound<'_, PyArray2<f64>>, Vec<String>)> {
    let origin = emg_origin(emg, fault_policy(accept_faults));
    let (rows, labels) = labeled_features(&origin, seed).map_err(value_error)?;
    let width = rows.first().map_or(0, Vec::len);
    let features = Array2::from_shape_vec((rows.len(), width), rows.concat()).map_err(value_error)?;
    Ok((features.to_pyarray(py), labels))
}

/// Features of windows, and the gesture of each.
type LabeledFeatures = (Vec<Vec<f64>>, Vec<String>);

fn labeled_features(origin: &EmgOrigin, seed: u64) -> Result<LabeledFeatures, Box<dyn Error>> {
    let TrainingRecordings { config, recordings, .. } = read_training(origin, seed)?;
    let (mut rows, mut labels) = (Vec::new(), Vec::new());
    for (gesture, samples) in &recordings {
        rows.extend(extract_features(&config, samples)?.into_iter().map(|features| features.to_vec()));
        labels.resize(rows.len(), gesture.to_string());
    }
    Ok((rows, labels))
}

/// The model of a trial whose windows a classifier in Python decodes, JSON text. Its gestures are in ascending order.
#[pyfunction]
#[pyo3(signature = (emg, seed, *, accept_faults=false))]
pub(crate) fn external_model(emg: String, seed: u64, accept_faults: bool) -> PyResult<String> {
    let made = || -> Result<String, Box<dyn Error>> {
        let origin = emg_origin(emg, fault_policy(accept_faults));
        let TrainingRecordings { config, mut recordings, accepted_faults } = read_training(&origin, seed)?;
        recordings.sort_by_key(|(gesture, _)| gesture.to_string());
        let slices: Vec<(Gesture, &[EmgSample])> =
            recordings.iter().map(|(gesture, samples)| (*gesture, samples.as_slice())).collect();
        let stand_in = EmgModel::train(&config, &vec![0.0; config.channels], &slices)?;
        let process = DecoderProcessConfig {
            command: vec![PYTHON_COMMAND.to_owned()],
            input: DecoderProcessInput::Features,
            deadline_ms: 1000,
            gestures: Vec::new(),
        };
        let outside = EmgConfig {
            classifier: ClassifierKind::Process,
            process: Some(process),
            ..stand_in.config.clone()
        };
        let model = stand_in.decoded_by_process(&outside, "null")?;
        Ok(EmgModel { accepted_faults, ..model }.to_json()?)
    };
    made().map_err(value_error)
}
