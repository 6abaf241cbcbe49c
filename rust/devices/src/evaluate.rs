use crate::{DeviceError, ProcessDecoder, Recordings, decoder_process, train};
use proact_emg::{Classifier, DriveScore, EmgConfig, Prediction, RecognitionMetrics, WindowInput};
use proact_types::GestureName;
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
    pub classes: Vec<GestureName>,
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
        return Err(DeviceError::Overlap { both });
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
    reps.retain(|rep| gestures.iter().filter(|gesture| config.learns(**gesture)).all(|g| has(*g, *rep)));
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
        let mut decoder = Decoder::train(recordings, train_reps, config)?;
        if classes.is_empty() {
            classes = decoder.classifier.gestures().to_vec();
            driven = decoder.classifier.degrees_of_freedom().to_vec();
            confusion = vec![vec![0; classes.len()]; classes.len()];
            drives = vec![Vec::new(); driven.len()];
        }
        for &rep in test_reps {
            // Nobody records the co-contraction of two sites.
            for (row, &gesture) in classes.iter().enumerate().filter(|(_, gesture)| config.learns(**gesture))
            {
                for window in recordings.find(gesture, rep)?.inputs(config)? {
                    let prediction = decoder.predict(&window)?;
                    let place = prediction.place;
                    for ((pairs, drive), value) in drives.iter_mut().zip(&driven).zip(&prediction.drives) {
                        pairs.push((drive.target(gesture), *value));
                    }
                    confusion[row][place] += 1;
                    seen.push((row, place));
                }
            }
        }
    }
    let drives = driven.iter().zip(&drives).map(|(drive, pairs)| DriveScore::of(*drive, pairs)).collect();
    let windows = confusion.iter().flatten().sum();
    let correct = (0..classes.len()).map(|k| confusion[k][k]).sum();
    let metrics = RecognitionMetrics::of(&seen, classes.binary_search(&config.rest).ok());
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
struct Decoder {
    classifier: Classifier,
    process: Option<ProcessDecoder>,
    asked: u64,
}

impl Decoder {
    fn train(recordings: &Recordings, reps: &[u32], config: &EmgConfig) -> Result<Decoder, DeviceError> {
        let classifier = train(recordings, reps, &config.stand_in())?;
        if !config.classifier.is_process() {
            return Ok(Decoder { classifier, process: None, asked: 0 });
        }
        let mut windows = Vec::new();
        for &rep in reps {
            for gesture in recordings.gestures() {
                windows.push((gesture, recordings.find(gesture, rep)?.inputs(config)?));
            }
        }
        let state = decoder_process::fit(config, classifier.gestures(), &windows)?;
        let classifier = classifier.decoded_by_process(config, &state)?;
        let process = ProcessDecoder::start(config, &classifier, true)?;
        Ok(Decoder { classifier, process, asked: 0 })
    }

    fn predict(&mut self, window: &WindowInput) -> Result<Prediction, DeviceError> {
        self.asked += 1;
        match &mut self.process {
            Some(process) => process.predict(&self.classifier, self.asked, window),
            None => Ok(self.classifier.predict(&window.features)?),
        }
    }
}
