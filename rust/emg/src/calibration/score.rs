use crate::classifier::distinct;
use crate::moments::ClassMoments;
use crate::{Classifier, EmgConfig, EmgError, FeatureVector, extract_features_with_amplitudes};
use proact_types::{DegreeOfFreedom, EmgSample, Gesture};
use serde::{Deserialize, Serialize};

/// What is known of one repetition.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
pub struct RepetitionScore {
    /// What the person was asked for.
    pub gesture: Gesture,
    /// Number of the repetition of this gesture, from 0.
    pub repetition: usize,
    /// Windows in it.
    pub windows: usize,
    /// Share of its windows that a classifier trained on the other repetitions recognises.
    #[serde(rename = "recognised")]
    pub recognized_share: f64,
    /// How far its mean lies from that of the other repetitions of the gesture, in standard deviations within the
    /// gestures, root mean square over features.
    pub distance: f64,
    /// It differs so much from the others that it should be looked at, and better be recorded again. With two
    /// repetitions both are marked: nothing tells which of them is the odd one.
    pub outlier: bool,
}

/// How well a regressor drives one degree of freedom in repetitions that it was not trained on. The target of a window is 1
/// or -1 by its gesture, else 0; the drive is taken before the dead band.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
pub struct DriveScore {
    /// The degree of freedom.
    pub drive: DegreeOfFreedom,
    /// Coefficient of determination over all windows, at most 1: 0 is what the mean of the targets would reach.
    pub r2: f64,
    /// Mean absolute error.
    pub mean_absolute_error: f64,
}

impl DriveScore {
    /// Of the target and the drive of each window.
    pub fn from_windows(drive: DegreeOfFreedom, windows: &[(f64, f64)]) -> DriveScore {
        let count = windows.len().max(1) as f64;
        let mean = windows.iter().map(|(target, _)| target).sum::<f64>() / count;
        let spread: f64 = windows.iter().map(|(target, _)| (target - mean).powi(2)).sum();
        let left: f64 = windows.iter().map(|(target, drive)| (target - drive).powi(2)).sum();
        let off: f64 = windows.iter().map(|(target, drive)| (target - drive).abs()).sum();
        let r2 = if spread > 0.0 { 1.0 - left / spread } else { 0.0 };
        DriveScore { drive, r2, mean_absolute_error: off / count }
    }
}

/// How well the repetitions fit each other: each was recognised by a classifier trained on the others.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
pub struct CalibrationReport {
    /// Complete rounds: the fewest repetitions of any gesture.
    pub rounds: usize,
    /// Share of all windows that were recognised, 0 to 1. It is that of single windows, before the decision rule.
    pub accuracy: f64,
    /// Windows tested.
    pub windows: usize,
    /// The gesture of each row and column.
    pub classes: Vec<Gesture>,
    /// `[true class][recognised class]`, numbers of windows.
    pub confusion: Vec<Vec<usize>>,
    /// Share of the windows of each class that were recognised.
    pub recall: Vec<f64>,
    /// By gesture, then repetition.
    pub repetitions: Vec<RepetitionScore>,
    /// Each degree of freedom of a regressor; none of a classifier. Classes are then what is driven most.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    #[cfg_attr(feature = "ts", ts(optional, as = "Option<Vec<DriveScore>>"))]
    pub drives: Vec<DriveScore>,
    /// Accuracy without the inertial measurement unit that is used; none where none is.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "ts", ts(optional))]
    pub accuracy_without_imu: Option<f64>,
    /// What was asked for is reached.
    pub good_enough: bool,
}

impl CalibrationReport {
    /// The repetitions that differ from the others.
    pub fn outliers(&self) -> impl Iterator<Item = &RepetitionScore> {
        self.repetitions.iter().filter(|r| r.outlier)
    }
}

/// Above this distance a repetition is an outlier. On LibEMG's test recordings the repetitions of a band that stayed in
/// place lie below 0.9, those of a turned band at 2 to 9, rest aside, which looks alike at every position.
const OUTLIER_DISTANCE: f64 = 2.0;
/// Below this share recognised a repetition is an outlier.
const OUTLIER_RECOGNIZED_SHARE: f64 = 0.5;

/// Features of one repetition.
struct RepetitionWindows {
    gesture: Gesture,
    repetition: usize,
    vectors: Vec<FeatureVector>,
    amplitudes: Vec<f64>,
}

/// Leaves out one repetition after the other: trains on all others, tests on that one. `repetitions` are centred
/// samples, each of one gesture; those of one gesture count from 0 in their order, and repetition k of all gestures
/// is left out together. Deterministic.
///
/// # Errors
/// Fewer than two repetitions of a gesture, or what [`crate::extract_features`] and [`Classifier::train`] refuse.
pub fn cross_validate<G: Copy + Into<Gesture>>(
    config: &EmgConfig,
    repetitions: &[(G, Vec<EmgSample>)],
) -> Result<CalibrationReport, EmgError> {
    let learnt = || repetitions.iter().filter(|(gesture, _)| config.trains_on((*gesture).into()));
    let classes = distinct(learnt().map(|(gesture, _)| (*gesture).into()));
    let mut counts = vec![0; classes.len()];
    let mut all = Vec::with_capacity(repetitions.len());
    for (gesture, samples) in learnt() {
        let gesture: Gesture = (*gesture).into();
        let (vectors, amplitudes) = extract_features_with_amplitudes(config, samples)?;
        let Ok(class) = classes.binary_search(&gesture) else { continue };
        let repetition = counts[class];
        counts[class] += 1;
        all.push(RepetitionWindows { gesture, repetition, vectors, amplitudes });
    }
    if let Some((gesture, got)) = classes.iter().zip(&counts).find(|(_, count)| **count < 2) {
        return Err(EmgError::TooFewRepetitions { gesture: *gesture, got: *got });
    }
    let mut confusion = vec![vec![0; classes.len()]; classes.len()];
    let mut scores = Vec::with_capacity(all.len());
    let driven: &[DegreeOfFreedom] =
        if config.classifier.is_regression() { &config.regression.drives } else { &[] };
    let mut drives = vec![Vec::new(); driven.len()];
    for left_out in 0..counts.iter().copied().max().unwrap_or(0) {
        let (tested, trained): (Vec<&RepetitionWindows>, Vec<&RepetitionWindows>) =
            all.iter().partition(|w| w.repetition == left_out);
        let (classifier, moments) = train(config, &classes, &trained)?;
        for RepetitionWindows { gesture, repetition, vectors, .. } in tested {
            let Some(row) = classes.iter().position(|g| g == gesture) else { continue };
            let mut correct_count = 0;
            for vector in vectors {
                let prediction = classifier.predict(vector)?;
                let class = prediction.class;
                correct_count += usize::from(class == *gesture);
                for ((windows, drive), value) in drives.iter_mut().zip(driven).zip(&prediction.drives) {
                    windows.push((drive.target(*gesture), *value));
                }
                if let Some(column) = classes.iter().position(|g| *g == class) {
                    confusion[row][column] += 1;
                }
            }
            let windows = vectors.len();
            let recognized_share = correct_count as f64 / windows.max(1) as f64;
            let distance = moments.distance(row, &mean(vectors));
            let outlier = distance > OUTLIER_DISTANCE || recognized_share < OUTLIER_RECOGNIZED_SHARE;
            let (gesture, repetition) = (*gesture, *repetition);
            scores.push(RepetitionScore {
                gesture,
                repetition,
                windows,
                recognized_share,
                distance,
                outlier,
            });
        }
    }
    scores.sort_by_key(|s| (s.gesture, s.repetition));
    let windows: usize = confusion.iter().flatten().sum();
    let correct: usize = (0..classes.len()).map(|k| confusion[k][k]).sum();
    let share = |part: usize, whole: usize| part as f64 / whole.max(1) as f64;
    Ok(CalibrationReport {
        rounds: counts.into_iter().min().unwrap_or(0),
        accuracy: share(correct, windows),
        windows,
        recall: (0..classes.len()).map(|k| share(confusion[k][k], confusion[k].iter().sum())).collect(),
        classes,
        confusion,
        repetitions: scores,
        drives: driven
            .iter()
            .zip(&drives)
            .map(|(drive, windows)| DriveScore::from_windows(*drive, windows))
            .collect(),
        accuracy_without_imu: None,
        good_enough: false,
    })
}

fn train(
    config: &EmgConfig,
    classes: &[Gesture],
    trained: &[&RepetitionWindows],
) -> Result<(Classifier, ClassMoments), EmgError> {
    let (mut vectors, mut labels, mut amplitudes) = (Vec::new(), Vec::new(), Vec::new());
    for windows in trained {
        vectors.extend(windows.vectors.iter().cloned());
        amplitudes.extend(&windows.amplitudes);
        labels.resize(vectors.len(), windows.gesture);
    }
    let classifier = Classifier::train_with_amplitudes(config, &vectors, &labels, &amplitudes)?;
    let class = |gesture: &Gesture| classes.iter().position(|g| g == gesture);
    let numbers: Vec<usize> = labels.iter().filter_map(class).collect();
    Ok((classifier, ClassMoments::of(&vectors, &numbers, classes.len())))
}

fn mean(vectors: &[FeatureVector]) -> Vec<f64> {
    let mut sum = vec![0.0; vectors.first().map_or(0, |v| v.len())];
    for vector in vectors {
        sum.iter_mut().zip(vector.iter()).for_each(|(s, v)| *s += v);
    }
    sum.iter_mut().for_each(|s| *s /= vectors.len().max(1) as f64);
    sum
}
