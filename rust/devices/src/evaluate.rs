use crate::{DeviceError, ExternalDecoderProcess, Recordings, external_decoder, train_classifier};
use proact_emg::{Classifier, DecoderInput, DriveScore, EmgConfig, Prediction, RecognitionMetrics};
use proact_types::Gesture;
use serde::Serialize;

/// How well a classifier recognises repetitions that it was not trained on, window by window, with no decision
/// rule.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Evaluation {
    /// Share of windows recognised, 0 to 1.
    pub accuracy: f64,
    /// Windows tested.
    pub windows: usize,
    /// Windows recognised.
    pub correct: usize,
    /// `[true class][recognised class]`, numbers of windows.
    pub confusion: Vec<Vec<usize>>,
    /// LibEMG's offline metrics.
    pub metrics: RecognitionMetrics,
    /// The gesture of each row and column.
    pub classes: Vec<Gesture>,
    /// Each degree of freedom of a regressor; none of a classifier. Classes are then what is driven most.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub drives: Vec<DriveScore>,
}

/// Trains on some repetitions of all gestures in `recordings` and tests on others.
///
/// # Errors
/// A repetition that is missing, too short, or both trained and tested on, no repetitions, or data that no classifier can be trained on.
pub fn evaluate(
    recordings: &Recordings,
    train_reps: &[u32],
    test_reps: &[u32],
    config: &EmgConfig,
) -> Result<Evaluation, DeviceError> {
    if test_reps.is_empty() {
        return Err(DeviceError::NoRepetitions { purpose: "test on" });
    }
    let both: Vec<u32> = test_reps.iter().copied().filter(|rep| train_reps.contains(rep)).collect();
    if !both.is_empty() {
        return Err(DeviceError::TrainTestOverlap { repetitions: both });
    }
    evaluate_folds(recordings, &[(train_reps.to_vec(), test_reps.to_vec())], config)
}

/// Trains on all repetitions but one of all gestures in `recordings` and tests on that one, for each that every gesture has.
///
/// # Errors
/// Fewer than two such repetitions, or what [`evaluate`] refuses.
pub fn leave_one_out(recordings: &Recordings, config: &EmgConfig) -> Result<Evaluation, DeviceError> {
    let gestures = recordings.gestures();
    let has = |gesture, rep| recordings.find(gesture, rep).is_ok();
    let mut reps: Vec<u32> = recordings.items.iter().map(|recording| recording.repetition).collect();
    reps.sort_unstable();
    reps.dedup();
    reps.retain(|rep| gestures.iter().filter(|gesture| config.trains_on(**gesture)).all(|g| has(*g, *rep)));
    if reps.len() < 2 {
        return Err(DeviceError::NoRepetitions {
            purpose: "leave out: two or more of each gesture are needed, to test",
        });
    }
    let others = |left_out: u32| reps.iter().copied().filter(|rep| *rep != left_out).collect();
    let folds: Vec<_> = reps.iter().map(|rep| (others(*rep), vec![*rep])).collect();
    evaluate_folds(recordings, &folds, config)
}

/// Trains on the first repetitions of each fold, tests on its second, and counts all tested windows together.
fn evaluate_folds(
    recordings: &Recordings,
    folds: &[(Vec<u32>, Vec<u32>)],
    config: &EmgConfig,
) -> Result<Evaluation, DeviceError> {
    let mut classes = Vec::new();
    let (mut driven, mut drives) = (Vec::new(), Vec::new());
    let (mut confusion, mut seen) = (Vec::new(), Vec::new());
    for (train_reps, test_reps) in folds {
        let mut decoder = FoldDecoder::train(recordings, train_reps, config)?;
        if classes.is_empty() {
            classes = decoder.classifier.gestures().to_vec();
            driven = decoder.classifier.degrees_of_freedom().to_vec();
            confusion = vec![vec![0; classes.len()]; classes.len()];
            drives = vec![Vec::new(); driven.len()];
        }
        for &rep in test_reps {
            // Nobody records the co-contraction of two sites.
            for (row, &gesture) in
                classes.iter().enumerate().filter(|(_, gesture)| config.trains_on(**gesture))
            {
                for window in recordings.find(gesture, rep)?.window_inputs(config)? {
                    let prediction = decoder.predict(&window)?;
                    let class_index = prediction.class_index;
                    for ((pairs, drive), value) in drives.iter_mut().zip(&driven).zip(&prediction.drives) {
                        pairs.push((drive.target(gesture), *value));
                    }
                    confusion[row][class_index] += 1;
                    seen.push((row, class_index));
                }
            }
        }
    }
    let drives =
        driven.iter().zip(&drives).map(|(drive, pairs)| DriveScore::from_windows(*drive, pairs)).collect();
    let windows = confusion.iter().flatten().sum();
    let correct = (0..classes.len()).map(|k| confusion[k][k]).sum();
    let metrics = RecognitionMetrics::from_windows(&seen, classes.binary_search(&config.rest).ok());
    Ok(Evaluation {
        accuracy: correct as f64 / windows as f64,
        windows,
        correct,
        confusion,
        metrics,
        classes,
        drives,
    })
}

/// A trained classifier, with its process if it is one.
struct FoldDecoder {
    classifier: Classifier,
    process: Option<ExternalDecoderProcess>,
    window_count: u64,
}

impl FoldDecoder {
    fn train(recordings: &Recordings, reps: &[u32], config: &EmgConfig) -> Result<FoldDecoder, DeviceError> {
        let classifier = train_classifier(recordings, reps, &config.without_process())?;
        if !config.classifier.is_process() {
            return Ok(FoldDecoder { classifier, process: None, window_count: 0 });
        }
        let mut windows = Vec::new();
        for &rep in reps {
            for gesture in recordings.gestures() {
                windows.push((gesture, recordings.find(gesture, rep)?.window_inputs(config)?));
            }
        }
        let state = external_decoder::fit(config, classifier.gestures(), &windows)?;
        let classifier = classifier.decoded_by_process(config, &state)?;
        let process = ExternalDecoderProcess::start(config, &classifier, true)?;
        Ok(FoldDecoder { classifier, process, window_count: 0 })
    }

    fn predict(&mut self, window: &DecoderInput) -> Result<Prediction, DeviceError> {
        self.window_count += 1;
        match &mut self.process {
            Some(process) => process.predict(&self.classifier, self.window_count, window),
            None => Ok(self.classifier.predict(&window.features)?),
        }
    }
}
