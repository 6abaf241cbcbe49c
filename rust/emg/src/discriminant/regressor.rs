use super::TrainingSet;
use crate::lda::singular_values;
use crate::{EmgError, RegressionConfig};
use nalgebra::{DMatrix, DVector};
use proact_types::{DegreeOfFreedom, Drives, Gesture, MAX_DRIVES};
use serde::{Deserialize, Serialize};

/// Singular values below this share of the largest, of standardised features, count as zero: constant and duplicated
/// features then get no weight, or share it.
const TOLERANCE: f64 = 1e-10;

/// Linear regression from features to degrees of freedom, by least squares with or without a penalty on the squared
/// coefficients: scikit-learn's `Ridge` and `LinearRegression` after `StandardScaler`.
///
/// Its targets are discrete, as LibEMG's are for recordings of gestures: 1 and -1 for windows of the two gestures of a
/// degree of freedom, 0 for all others.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Regressor {
    drives: Vec<DegreeOfFreedom>,
    /// Class of the positive and of the negative gesture of each drive.
    #[serde(rename = "places")]
    class_indices: Vec<[usize; 2]>,
    /// Class of the relaxed hand.
    rest: usize,
    dead_band: f64,
    /// Of each feature in the training.
    means: Vec<f64>,
    #[serde(rename = "spreads")]
    sds: Vec<f64>,
    /// `[drives][features]`, of standardised features.
    coefficients: Vec<Vec<f64>>,
    /// `[drives]`.
    intercepts: Vec<f64>,
}

/// One score a class, from `drives` between -1 and 1 whose positive and negative classes are `class_pairs`.
pub(super) fn drive_scores(
    drives: &Drives,
    class_pairs: &[[usize; 2]],
    rest: usize,
    dead_band: f64,
    out: &mut [f64],
) {
    for (&value, [positive, negative]) in drives.iter().zip(class_pairs) {
        let towards = |sign: f64| if value * sign < 0.0 { 0.0 } else { value * sign };
        (out[*positive], out[*negative]) = (towards(1.0), towards(-1.0));
    }
    out[rest] = dead_band;
    // Drives within the dead band say nothing, and none of them comes before rest.
    out.iter_mut().filter(|score| **score <= dead_band).for_each(|score| *score = 0.0);
    if out.iter().all(|score| *score == 0.0) {
        out[rest] = 1.0;
    }
}

impl Regressor {
    /// Fits to the windows of `set`, with the penalty `alpha`; 0 is none.
    ///
    /// # Errors
    /// A gesture of a degree of freedom without windows, windows of a gesture of none, no rest, nothing that varies.
    pub(crate) fn fit(
        set: &TrainingSet<'_>,
        config: &RegressionConfig,
        rest: Gesture,
        alpha: f64,
    ) -> Result<Regressor, EmgError> {
        let known = set.gestures;
        let class_index = |gesture: Gesture, drive: DegreeOfFreedom| {
            let missing = || EmgError::NoDriveGesture {
                gesture: gesture.to_string(),
                drive: drive.to_string(),
                known: known.to_vec(),
            };
            known.iter().position(|name| *name == gesture).ok_or_else(missing)
        };
        let pair = |drive: &DegreeOfFreedom| {
            Ok([class_index(drive.positive(), *drive)?, class_index(drive.negative(), *drive)?])
        };
        let class_pairs: Vec<[usize; 2]> = config.drives.iter().map(pair).collect::<Result<_, EmgError>>()?;
        let rest_index = known.iter().position(|name| *name == rest);
        let rest_index = rest_index.ok_or_else(|| EmgError::NoRest { rest, known: known.to_vec() })?;
        let idle = (0..known.len())
            .find(|k| *k != rest_index && !class_pairs.iter().flatten().any(|class_index| class_index == k));
        if let Some(idle) = idle {
            return Err(EmgError::UnpairedGesture { gesture: known[idle], drives: config.drives.clone() });
        }

        let (means, spreads) = set.mean_and_sd();
        // Finite values whose squares overflow.
        if let Some(index) = spreads.iter().position(|spread| !spread.is_finite()) {
            return Err(EmgError::NotFinite { window: 0, index, value: spreads[index] });
        }
        let windows = set.samples.nrows();
        let standardized =
            DMatrix::from_fn(windows, means.len(), |i, j| (set.samples[(i, j)] - means[j]) / spreads[j]);
        let (singular, v_t) = singular_values(standardized.clone())?;
        let largest = singular.iter().copied().fold(0.0, f64::max);
        if largest.is_nan() || largest <= 0.0 {
            return Err(EmgError::NoVariance);
        }
        // Windows along the directions of the features, so that the squares of the singular values need no inverse alone.
        let along = standardized * v_t.transpose();
        let fit = |drive: &DegreeOfFreedom| {
            let targets = DVector::from_iterator(
                windows,
                set.labels.iter().map(|class| known.get(*class).map_or(0.0, |name| drive.target(*name))),
            );
            let intercept = targets.mean();
            let projected = along.tr_mul(&targets.add_scalar(-intercept));
            let scaled = DVector::from_fn(projected.len(), |k, _| {
                let kept = singular[k] > TOLERANCE * largest;
                if kept { projected[k] / (singular[k] * singular[k] + alpha) } else { 0.0 }
            });
            let coefficients = v_t.tr_mul(&scaled);
            (coefficients.iter().copied().collect::<Vec<f64>>(), intercept)
        };
        let (coefficients, intercepts) = config.drives.iter().map(fit).unzip();
        let regressor = Regressor {
            drives: config.drives.clone(),
            class_indices: class_pairs,
            rest: rest_index,
            dead_band: config.dead_band,
            means,
            sds: spreads,
            coefficients,
            intercepts,
        };
        if regressor.is_sound() { Ok(regressor) } else { Err(EmgError::NoConvergence) }
    }

    pub(crate) fn drives(&self) -> &[DegreeOfFreedom] {
        &self.drives
    }

    pub(crate) fn set_dead_band(&mut self, dead_band: f64) {
        self.dead_band = dead_band;
    }

    /// Both gestures of each degree of freedom, and rest.
    pub(crate) fn classes(&self) -> usize {
        2 * self.drives.len() + 1
    }

    pub(crate) fn features(&self) -> usize {
        self.means.len()
    }

    /// Whether all lengths fit, every value is finite, and every class is what it is once.
    pub(crate) fn is_sound(&self) -> bool {
        let (drives, features) = (self.drives.len(), self.features());
        let mut classes: Vec<usize> = self.class_indices.iter().flatten().copied().collect();
        classes.push(self.rest);
        classes.sort_unstable();
        (1..=MAX_DRIVES).contains(&drives)
            && features > 0
            && classes == (0..self.classes()).collect::<Vec<_>>()
            && self.sds.len() == features
            && self.coefficients.len() == drives
            && self.intercepts.len() == drives
            && self.coefficients.iter().all(|row| row.len() == features)
            && (0.0..1.0).contains(&self.dead_band)
            && self.sds.iter().all(|v| v.is_finite() && *v > 0.0)
            && self.means.iter().chain(&self.intercepts).all(|v| v.is_finite())
            && self.coefficients.iter().flatten().all(|v| v.is_finite())
    }

    /// Whether the classes are those of `gestures`: a file may have been edited.
    pub(crate) fn matches_gestures(&self, gestures: &[Gesture]) -> bool {
        let at = |index: usize| gestures.get(index).copied();
        self.drives.iter().zip(&self.class_indices).all(|(drive, [positive, negative])| {
            at(*positive) == Some(drive.positive()) && at(*negative) == Some(drive.negative())
        })
    }

    pub(crate) fn map_features(&self, order: &dyn Fn(&[f64]) -> Vec<f64>) -> Regressor {
        Regressor {
            means: order(&self.means),
            sds: order(&self.sds),
            coefficients: self.coefficients.iter().map(|row| order(row)).collect(),
            ..self.clone()
        }
    }

    /// Each drive before the dead band, -1 to 1; NaN where the sum overflows.
    pub(crate) fn predict(&self, features: &[f64]) -> Drives {
        let drive = |(row, intercept): (&Vec<f64>, &f64)| {
            let terms = features.iter().zip(row).zip(self.means.iter().zip(&self.sds));
            let sum: f64 = terms.map(|((x, weight), (mean, spread))| weight * (x - mean) / spread).sum();
            let value = sum + intercept;
            if value.is_finite() { value.clamp(-1.0, 1.0) } else { f64::NAN }
        };
        self.coefficients.iter().zip(&self.intercepts).map(drive).collect()
    }

    /// One score a class: how far the drive of its gesture is out, and the dead band for rest. The largest is what the hand
    /// does most.
    pub(crate) fn scores(&self, features: &[f64], out: &mut [f64]) {
        drive_scores(&self.predict(features), &self.class_indices, self.rest, self.dead_band, out);
    }

    /// Shares of the scores: they say how the drives compare, not how probable a gesture is.
    pub(crate) fn posterior(scores: &mut [f64]) {
        let sum: f64 = scores.iter().sum();
        scores.iter_mut().for_each(|score| *score /= sum);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::DriveScore;
    use proact_types::Command;

    /// What scikit-learn 1.9.1 makes of windows of the five gestures, from `tests/make_regression_vectors.py`.
    #[derive(Deserialize)]
    struct Reference {
        train: Vec<Vec<f64>>,
        labels: Vec<usize>,
        test: Vec<Vec<f64>>,
        truth: Vec<usize>,
        models: Vec<Answers>,
    }

    #[derive(Deserialize)]
    struct Answers {
        alpha: f64,
        drives: Vec<Vec<f64>>,
        r2: Vec<f64>,
        mae: Vec<f64>,
    }

    impl Reference {
        fn read() -> Reference {
            serde_json::from_str(include_str!("../../tests/regression_vectors.json"))
                .expect("the vectors are JSON")
        }

        fn fit(&self, config: &RegressionConfig, alpha: f64) -> Result<Regressor, EmgError> {
            let values = self.train.iter().flatten().copied();
            let samples = DMatrix::from_row_iterator(self.train.len(), self.train[0].len(), values);
            let gestures = Command::ALL.map(Gesture::from);
            let set =
                TrainingSet { samples: &samples, labels: &self.labels, classes: 5, gestures: &gestures };
            Regressor::fit(&set, config, Gesture::default(), alpha)
        }
    }

    #[test]
    fn drives_and_their_scores_are_those_of_scikit_learn() {
        let reference = Reference::read();
        let config = RegressionConfig::default();
        for Answers { alpha, drives, r2, mae } in &reference.models {
            let regressor = reference.fit(&config, *alpha).expect("good data");
            let ours: Vec<Drives> = reference.test.iter().map(|window| regressor.predict(window)).collect();
            let pairs = ours.iter().flatten().zip(drives.iter().flatten());
            let worst = pairs.map(|(a, b)| (a - b.clamp(-1.0, 1.0)).abs()).fold(0.0, f64::max);
            println!("alpha {alpha}: drives differ by {worst:.1e}");
            assert!(worst < 1e-12, "alpha {alpha}: {worst}");
            for (k, drive) in config.drives.iter().enumerate() {
                let target = |class: &usize| drive.target(Command::ALL[*class].into());
                let windows: Vec<(f64, f64)> =
                    reference.truth.iter().map(target).zip(ours.iter().map(|drives| drives[k])).collect();
                let score = DriveScore::from_windows(*drive, &windows);
                assert!(
                    (score.r2 - r2[k]).abs() < 1e-12 && (score.mean_absolute_error - mae[k]).abs() < 1e-12
                );
            }
        }
    }

    #[test]
    fn a_regressor_keeps_its_answers_through_a_file_and_says_which_gesture_is_driven_most() {
        let reference = Reference::read();
        let regressor = reference.fit(&RegressionConfig::default(), 1.0).expect("good data");
        let json = serde_json::to_string(&regressor).expect("it can be written");
        let read: Regressor = serde_json::from_str(&json).expect("it was just written");
        assert_eq!(read, regressor);
        assert!(read.matches_gestures(&Command::ALL.map(Gesture::from)));
        for window in &reference.test {
            let (drives, mut scores) = (regressor.predict(window), [0.0; 5]);
            regressor.scores(window, &mut scores);
            let relaxed = drives.iter().all(|drive| drive.abs() <= 0.3);
            assert_eq!(scores[Command::NoMotion.index()] == 1.0, relaxed, "{drives:?} {scores:?}");
            Regressor::posterior(&mut scores);
            assert!((scores.iter().sum::<f64>() - 1.0).abs() < 1e-12);
        }
        let turned = |values: &[f64]| {
            let mut values = values.to_vec();
            values.rotate_left(3);
            values
        };
        let (moved, window) = (regressor.map_features(&turned), &reference.test[0]);
        let off = moved.predict(&turned(window))[0] - regressor.predict(window)[0];
        assert!(off.abs() < 1e-12);
        assert!(regressor.predict(&[f64::INFINITY; 8])[0].is_nan(), "an overflow is no full drive");
    }

    #[test]
    fn recordings_that_no_degree_of_freedom_can_be_learnt_from_are_refused_with_what_to_do() {
        let mut reference = Reference::read();
        let wrist =
            RegressionConfig { drives: vec![DegreeOfFreedom::wrist()], ..RegressionConfig::default() };
        let error = |reference: &Reference, config: &RegressionConfig| {
            reference.fit(config, 0.0).expect_err("must be refused").to_string()
        };
        let text = error(&reference, &wrist);
        assert!(text.contains("hand_close, which drives none") && text.contains("--drives"), "{text}");
        let pinch: DegreeOfFreedom = "pinch/hand_open".parse().expect("two gestures");
        let text = error(&reference, &RegressionConfig { drives: vec![pinch], ..wrist });
        assert!(text.contains("no pinch, which the degree of freedom pinch/hand_open needs"), "{text}");
        reference.train.iter_mut().for_each(|row| row.fill(3.0));
        assert_eq!(error(&reference, &RegressionConfig::default()), EmgError::NoVariance.to_string());
        reference.train[0][0] = f64::MAX;
        reference.train[1][0] = f64::MIN;
        let text = error(&reference, &RegressionConfig::default());
        assert!(text.contains("feature 0") && text.contains("is inf"), "{text}");

        let refused = |change: fn(&mut RegressionConfig)| {
            let mut config = RegressionConfig::default();
            change(&mut config);
            config.check(Gesture::default()).expect_err("must be refused").to_string()
        };
        assert!(refused(|c| c.ridge_alpha = -1.0).contains("regression.ridge_alpha is -1"));
        assert!(refused(|c| c.ridge_alpha = f64::NAN).contains("NaN"));
        assert!(refused(|c| c.dead_band = 1.0).contains("regression.dead_band is 1"));
        assert!(refused(|c| c.smoothing_time_constant_ms = -1.0).contains("0 to 10000"));
        assert!(refused(|c| c.drives.clear()).contains("is 0, expected 1 to 8"));
        assert!(refused(|c| c.drives.push(DegreeOfFreedom::hand())).contains("another's already"));
        assert!(
            refused(|c| c.drives[0] = "no_motion/fist".parse().expect("two")).contains("the rest gesture")
        );
    }
}
