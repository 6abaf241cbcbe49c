use crate::{DeviceError, Recordings, train};
use proact_emg::{DriveScore, EmgConfig, RecognitionMetrics};
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
    let classifier = train(recordings, train_reps, config)?;
    let classes = classifier.gestures().to_vec();
    let mut confusion = vec![vec![0; classes.len()]; classes.len()];
    let mut seen = Vec::new();
    let driven = classifier.degrees_of_freedom();
    let mut drives = vec![Vec::new(); driven.len()];
    for &rep in test_reps {
        // Nobody records the co-contraction of two sites.
        for (row, &gesture) in classes.iter().enumerate().filter(|(_, gesture)| config.learns(**gesture)) {
            for window in recordings.find(gesture, rep)?.windows(config)? {
                let prediction = classifier.predict(&window)?;
                let place = prediction.place;
                for ((pairs, drive), value) in drives.iter_mut().zip(driven).zip(&prediction.drives) {
                    pairs.push((drive.target(gesture), *value));
                }
                confusion[row][place] += 1;
                seen.push((row, place));
            }
        }
    }
    let drives = driven.iter().zip(&drives).map(|(drive, pairs)| DriveScore::of(*drive, pairs)).collect();
    let windows = confusion.iter().flatten().sum();
    let correct = (0..classes.len()).map(|k| confusion[k][k]).sum();
    let metrics = RecognitionMetrics::of(&seen, classifier.place(config.rest).ok());
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
