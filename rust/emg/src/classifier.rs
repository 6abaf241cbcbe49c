use crate::discriminant::{Discriminant, ExternalDiscriminant, MuscleSites, Regressor, TrainingSet};
use crate::two_site::{CocontractionDetector, SiteDecision};
use crate::{ClassifierKind, EmgConfig, EmgError, FeatureLayout, FeatureSet, Lda, MuscleSite};
use arrayvec::ArrayVec;
use nalgebra::DMatrix;
use proact_types::{DegreeOfFreedom, Drives, Gesture, MAX_EMG_CHANNELS, MAX_GESTURES, SimTime};
use serde::{Deserialize, Serialize};

/// Probability of each gesture of a classifier, in the order of [`Classifier::gestures`].
pub type ClassPosterior = ArrayVec<f64, MAX_GESTURES>;

/// Range of the summed MAV of one gesture over which the effort runs from 0 to 1.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct EffortScale {
    /// Sum of MAV over channels at effort zero, in the stream's unit.
    pub low: f64,
    /// Sum at effort one.
    pub high: f64,
}

/// What the classifier says about one window.
#[derive(Clone, Debug, PartialEq)]
pub struct Prediction {
    /// The most probable gesture, the first of equals.
    pub class: Gesture,
    /// Its place in [`Classifier::gestures`].
    pub class_index: usize,
    /// Probability of each gesture, in the order of [`Classifier::gestures`]. Of a regressor the shares of the drives: they
    /// say how these compare, not how probable a gesture is.
    pub posterior: ClassPosterior,
    /// Drive of each of [`Classifier::degrees_of_freedom`] before the dead band, -1 to 1; empty of a classifier.
    pub drives: Drives,
}

impl Prediction {
    /// Probability of the most probable gesture.
    pub fn confidence(&self) -> f64 {
        self.posterior[self.class_index]
    }
}

/// A discriminant over gestures, with the effort scale of each gesture.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Classifier {
    features: FeatureSet,
    channels: usize,
    /// Of the stream; models of older versions have no feature that depends on it.
    #[serde(default = "default_rate_hz")]
    rate_hz: f64,
    /// Means of channels of an inertial measurement unit behind the features of the EMG.
    #[serde(default, skip_serializing_if = "is_zero")]
    imu: usize,
    #[serde(flatten)]
    discriminant: Discriminant,
    /// The gesture of each class of the discriminant, in alphabetical order, as LibEMG's.
    gestures: Vec<Gesture>,
    /// Per class of the discriminant; empty if amplitudes were not known.
    efforts: Vec<EffortScale>,
}

impl Classifier {
    /// Trains on feature vectors, `[windows][features]`, with the gesture of each window. The effort scale comes from
    /// MAV; with a set that lacks it use [`Classifier::train_with_amplitudes`], else efforts are zero.
    ///
    /// # Errors
    /// Lengths that do not fit the settings, values that are not finite, fewer than two gestures or more than
    /// [`MAX_GESTURES`].
    pub fn train<F: AsRef<[f64]>, G: Copy + Into<Gesture>>(
        config: &EmgConfig,
        windows: &[F],
        labels: &[G],
    ) -> Result<Classifier, EmgError> {
        let amplitude = |w: &F| {
            let layout = config.layout();
            (w.as_ref().len() == layout.count()).then(|| layout.amplitude(w.as_ref())).flatten()
        };
        let amplitudes: Option<Vec<f64>> = windows.iter().map(amplitude).collect();
        Self::fit(config, windows, labels, amplitudes.as_deref())
    }

    /// [`Classifier::train`] with [`crate::WindowView::amplitude`] of each window, for any set of features.
    ///
    /// # Errors
    /// As [`Classifier::train`], and if there are not as many amplitudes as windows.
    pub fn train_with_amplitudes<F: AsRef<[f64]>, G: Copy + Into<Gesture>>(
        config: &EmgConfig,
        windows: &[F],
        labels: &[G],
        amplitudes: &[f64],
    ) -> Result<Classifier, EmgError> {
        if amplitudes.len() != windows.len() {
            return Err(EmgError::LabelCount { windows: windows.len(), labels: amplitudes.len() });
        }
        Self::fit(config, windows, labels, Some(amplitudes))
    }

    fn fit<F: AsRef<[f64]>, G: Copy + Into<Gesture>>(
        config: &EmgConfig,
        windows: &[F],
        labels: &[G],
        amplitudes: Option<&[f64]>,
    ) -> Result<Classifier, EmgError> {
        config.check()?;
        if windows.len() != labels.len() {
            return Err(EmgError::LabelCount { windows: windows.len(), labels: labels.len() });
        }
        let expected = config.layout().count();
        if let Some(window) = windows.iter().find(|w| w.as_ref().len() != expected) {
            return Err(EmgError::FeatureCount { got: window.as_ref().len(), expected });
        }
        let labels: Vec<Gesture> = labels.iter().map(|label| (*label).into()).collect();
        let kept: Vec<usize> = (0..labels.len()).filter(|k| config.trains_on(labels[*k])).collect();
        let labels: Vec<Gesture> = kept.iter().map(|k| labels[*k]).collect();
        let windows: Vec<&F> = kept.iter().map(|k| &windows[*k]).collect();
        // A co-contraction is not recorded, and the thresholds of two sites say themselves what effort is.
        let two_site = config.classifier == ClassifierKind::TwoSite;
        let switch = two_site.then_some(config.two_site.switch_gesture);
        let amplitudes = amplitudes.filter(|_| !two_site);
        let gestures = distinct(labels.iter().copied().chain(switch));
        if gestures.len() > MAX_GESTURES {
            return Err(EmgError::TooManyClasses { got: gestures.len() });
        }
        let classes: Vec<usize> =
            labels.iter().filter_map(|label| gestures.binary_search(label).ok()).collect();
        let samples = DMatrix::from_row_iterator(
            windows.len(),
            expected,
            windows.iter().flat_map(|w| (*w).as_ref().iter().copied()),
        );
        let set =
            TrainingSet { samples: &samples, labels: &classes, classes: gestures.len(), gestures: &gestures };
        let discriminant = Discriminant::fit(config, &set)?;

        // LibEMG's velocity control: the middle of each gesture's range of summed MAV.
        let scale = |amplitudes: &[f64], class: usize| {
            let sums = || {
                let of_class = amplitudes.iter().zip(&classes).filter(move |(_, c)| **c == class);
                of_class.map(|(amplitude, _)| *amplitude)
            };
            let (min, max) = (sums().fold(f64::INFINITY, f64::min), sums().fold(0.0, f64::max));
            EffortScale { low: min + 0.1 * (max - min), high: min + 0.7 * (max - min) }
        };
        Ok(Classifier {
            features: config.features,
            channels: config.channels,
            rate_hz: config.rate_hz,
            imu: config.imu.features.len(),
            discriminant,
            efforts: amplitudes
                .map(|a| (0..gestures.len()).map(|class| scale(a, class)).collect())
                .unwrap_or_default(),
            gestures,
        })
    }

    /// Channels of the stream that it was trained on.
    pub fn channels(&self) -> usize {
        self.channels
    }

    /// The features that it was trained on.
    pub fn features(&self) -> FeatureSet {
        self.features
    }

    /// Where the values stand in the vectors that it takes.
    pub fn layout(&self) -> FeatureLayout {
        self.features.layout(self.channels, self.rate_hz).with_imu(self.imu)
    }

    /// The effort scale of each of [`Classifier::gestures`]; empty if amplitudes were not known.
    pub fn efforts(&self) -> &[EffortScale] {
        &self.efforts
    }

    /// The same classifier with another discriminant over the same features and classes.
    pub(crate) fn with_lda(&self, lda: Lda) -> Classifier {
        let of = &self.discriminant;
        debug_assert_eq!((lda.classes(), lda.features()), (of.classes(), of.features()));
        Classifier { discriminant: Discriminant::Lda(lda), ..self.clone() }
    }

    /// The same classifier for features in another order, which `order` gives a vector.
    pub(crate) fn map_features(&self, order: &dyn Fn(&[f64]) -> Vec<f64>) -> Result<Classifier, EmgError> {
        Ok(Classifier { discriminant: self.discriminant.map_features(order)?, ..self.clone() })
    }

    /// Whether all lengths fit and every value is finite, as after reading a file.
    pub(crate) fn is_sound(&self) -> bool {
        let classes = self.gestures.len();
        let finite = self.efforts.iter().all(|e| e.low.is_finite() && e.high.is_finite());
        self.discriminant.is_sound()
            && (1..=MAX_EMG_CHANNELS).contains(&self.channels)
            && self.rate_hz.is_finite()
            && self.imu <= MAX_EMG_CHANNELS
            && self.discriminant.features() == self.layout().count()
            && self.discriminant.classes() == classes
            && classes <= MAX_GESTURES
            && self.gestures.windows(2).all(|pair| pair[0] < pair[1])
            && (self.efforts.is_empty() || self.efforts.len() == classes)
            && finite
            && self
                .discriminant
                .regressor()
                .is_none_or(|regressor| regressor.matches_gestures(&self.gestures))
            && self.discriminant.sites().is_none_or(|sites| sites.matches_gestures(&self.gestures))
            && self.discriminant.external().is_none_or(|outside| outside.matches_gestures(&self.gestures))
    }

    /// The gestures that it tells apart, in alphabetical order.
    pub fn gestures(&self) -> &[Gesture] {
        &self.gestures
    }

    /// What tells the gestures apart.
    pub fn kind(&self) -> ClassifierKind {
        self.discriminant.kind()
    }

    /// The degrees of freedom that a regressor drives, in the order of [`Prediction::drives`]; none of a classifier.
    pub fn degrees_of_freedom(&self) -> &[DegreeOfFreedom] {
        let outside = self.discriminant.external().map_or(&[][..], ExternalDiscriminant::drives);
        self.discriminant.regressor().map_or(outside, Regressor::drives)
    }

    /// The two muscle sites of direct control; none of another kind.
    pub fn sites(&self) -> Option<&[MuscleSite; 2]> {
        self.discriminant.sites().map(MuscleSites::sites)
    }

    /// What two sites ask for in a window that ended at `now`: the class, and how hard, 0 to 1. None of another kind.
    pub(crate) fn two_site_command(
        &self,
        switch: &mut CocontractionDetector,
        now: SimTime,
        features: &[f64],
    ) -> Option<(Gesture, f64)> {
        let sites = self.discriminant.sites()?;
        let levels = sites.levels(features);
        Some(match switch.step(now, levels) {
            SiteDecision::Rest => (self.gestures[sites.rest()], 0.0),
            SiteDecision::Switch => (self.gestures[sites.switch()], 0.0),
            SiteDecision::Site(site) => {
                (self.gestures[sites.class_index_of(site)], levels[site].clamp(0.0, 1.0))
            }
        })
    }

    /// The same with another [`crate::RegressionConfig::dead_band`]; a classifier has none.
    pub(crate) fn with_dead_band(mut self, dead_band: f64) -> Classifier {
        if let Some(regressor) = self.discriminant.regressor_mut() {
            regressor.set_dead_band(dead_band);
        }
        if let Discriminant::Process(outside) = &mut self.discriminant {
            outside.set_dead_band(dead_band);
        }
        self
    }

    /// Values in the vectors that it takes.
    pub fn feature_count(&self) -> usize {
        self.discriminant.features()
    }

    /// The linear discriminant itself, whose class `k` is `gestures()[k]`; none of another kind.
    pub fn lda(&self) -> Option<&Lda> {
        if let Discriminant::Lda(lda) = &self.discriminant { Some(lda) } else { None }
    }

    /// Classifies one feature vector. Does not allocate.
    ///
    /// # Errors
    /// Wrong length, or values so large (or not finite) that no probability comes out.
    pub fn predict(&self, features: &[f64]) -> Result<Prediction, EmgError> {
        let expected = self.discriminant.features();
        if features.len() != expected {
            return Err(EmgError::FeatureCount { got: features.len(), expected });
        }
        if self.discriminant.external().is_some() {
            return Err(EmgError::NeedsProcess { what: "classify" });
        }
        let mut values: ClassPosterior = self.gestures.iter().map(|_| 0.0).collect();
        self.discriminant.scores(features, &mut values);
        if !values.iter().all(|v| v.is_finite()) {
            let index = features.iter().position(|v| !v.is_finite()).unwrap_or(0);
            return Err(EmgError::NotFinite { window: 0, index, value: features[index] });
        }
        let best = (1..values.len()).fold(0, |best, k| if values[k] > values[best] { k } else { best });
        self.discriminant.posterior(&mut values);
        let drives = self.discriminant.drives(features);
        Ok(Prediction { class: self.gestures[best], class_index: best, posterior: values, drives })
    }

    /// The same classifier whose windows the process of `config` decodes; `state` is what it learnt, JSON text.
    ///
    /// # Errors
    /// Settings without a process, gestures that are not those that it knows.
    pub fn decoded_by_process(&self, config: &EmgConfig, state: &str) -> Result<Classifier, EmgError> {
        config.check()?;
        let known = config.process.as_ref().filter(|_| config.classifier.is_process());
        let known = known.ok_or(EmgError::NeedsProcess { what: "train" })?;
        let trained = distinct(known.gestures.iter().copied());
        if !trained.is_empty() && trained != self.gestures {
            let names = |of: &[Gesture]| of.iter().map(Gesture::as_str).collect::<Vec<_>>().join(", ");
            let (trained, own) = (names(&trained), names(&self.gestures));
            let reason =
                format!("it knows {trained}, and the recordings are of {own}: expected the same gestures");
            return Err(EmgError::Process { reason });
        }
        let outside = ExternalDiscriminant::new(config, &self.gestures, self.feature_count(), state)?;
        Ok(Classifier { discriminant: Discriminant::Process(outside), ..self.clone() })
    }

    /// The first line to the process that decodes; none if it is no process.
    ///
    /// # Errors
    /// Settings that cannot work.
    pub fn start_request(&self, config: &EmgConfig) -> Option<Result<String, EmgError>> {
        let outside = self.discriminant.external()?;
        Some(crate::decoder_process::start_request(config, &self.gestures, outside.drives(), outside.state()))
    }

    /// What the process says in `line` of window number `window`.
    ///
    /// # Errors
    /// What is wrong with the line, for a person.
    pub fn parse_response(&self, window: u64, line: &str) -> Result<Prediction, String> {
        let outside = self.discriminant.external().ok_or("no process decodes")?;
        let (scores, drives) = outside.parse_response(window, line)?;
        let class_index =
            (1..scores.len()).fold(0, |best, k| if scores[k] > scores[best] { k } else { best });
        Ok(Prediction {
            class: self.gestures[class_index],
            class_index,
            posterior: scores.into_iter().collect(),
            drives,
        })
    }

    /// How hard `gesture` is performed, 0 to 1: the summed MAV of the window between the gesture's limits, which
    /// lie at 10 % and 70 % of the range seen in training (LibEMG's velocity control, not rounded). The features must
    /// have MAV.
    ///
    /// # Errors
    /// If the gesture was not trained, the feature vector has another length, or there is no MAV in it.
    pub fn effort(&self, gesture: impl Into<Gesture>, features: &[f64]) -> Result<f64, EmgError> {
        let expected = self.discriminant.features();
        if features.len() != expected {
            return Err(EmgError::FeatureCount { got: features.len(), expected });
        }
        let amplitude = self.layout().amplitude(features);
        self.effort_of(gesture.into(), amplitude.ok_or_else(|| self.no_scale())?)
    }

    /// [`Classifier::effort`] of a window whose [`crate::WindowView::amplitude`] is known.
    ///
    /// # Errors
    /// If the gesture was not trained, or amplitudes were not known at training.
    pub fn effort_of(&self, gesture: Gesture, amplitude: f64) -> Result<f64, EmgError> {
        let class = self.class_index(gesture)?;
        let EffortScale { low, high } = *self.efforts.get(class).ok_or_else(|| self.no_scale())?;
        // All training windows alike: any contraction that strong is full effort.
        let effort =
            if high > low { (amplitude - low) / (high - low) } else { f64::from(u8::from(amplitude >= low)) };
        Ok(effort.clamp(0.0, 1.0))
    }

    /// Place of `gesture` in [`Classifier::gestures`].
    ///
    /// # Errors
    /// [`EmgError::NotTrained`].
    pub fn class_index(&self, gesture: Gesture) -> Result<usize, EmgError> {
        self.gestures.binary_search(&gesture).map_err(|_| EmgError::NotTrained(gesture))
    }

    fn no_scale(&self) -> EmgError {
        EmgError::NoEffortScale { features: self.features.to_string() }
    }
}

fn is_zero(count: &usize) -> bool {
    *count == 0
}

fn default_rate_hz() -> f64 {
    EmgConfig::default().rate_hz
}

/// Each of `gestures` once, in alphabetical order.
pub(crate) fn distinct(gestures: impl Iterator<Item = Gesture>) -> Vec<Gesture> {
    gestures.collect::<std::collections::BTreeSet<_>>().into_iter().collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proact_types::Command;

    fn config() -> EmgConfig {
        EmgConfig { channels: 1, ..EmgConfig::default() }
    }

    /// Two gestures that differ in the first feature.
    fn data() -> (Vec<[f64; 4]>, Vec<Command>) {
        let window = |k: usize, base: f64| {
            let wave = (k as f64 * 2.3).sin();
            [base + wave, 5.0 + (k % 3) as f64, 7.0 + (k % 4) as f64, 4.0 * base + (k as f64 * 0.9).cos()]
        };
        let windows = (0..40).map(|k| window(k, if k < 20 { 30.0 } else { 3.0 })).collect();
        let labels =
            (0..40).map(|k| if k < 20 { Command::WristFlexion } else { Command::NoMotion }).collect();
        (windows, labels)
    }

    #[test]
    fn the_posterior_is_over_the_gestures_that_were_trained() {
        let (windows, labels) = data();
        let classifier = Classifier::train(&config(), &windows, &labels).expect("good data");
        assert_eq!(classifier.gestures(), [Command::NoMotion, Command::WristFlexion]);
        let prediction = classifier.predict(&windows[0]).expect("good window");
        assert_eq!(prediction.class, Command::WristFlexion);
        assert_eq!(prediction.posterior.len(), 2);
        assert!(prediction.posterior[1] > prediction.posterior[0]);
        assert!((prediction.posterior.iter().sum::<f64>() - 1.0).abs() < 1e-15);
        let effort = |k: usize| classifier.effort(Command::WristFlexion, &windows[k]).expect("trained");
        assert!((0..20).any(|k| effort(k) == 0.0) && (0..20).any(|k| effort(k) == 1.0));
    }

    #[test]
    fn bad_training_data_and_bad_windows_are_refused_with_both_numbers() {
        let (mut windows, labels) = data();
        let error = |w: &[[f64; 4]], l: &[Command]| {
            Classifier::train(&config(), w, l).expect_err("must be refused").to_string()
        };
        assert_eq!(error(&windows, &labels[1..]), "got 39 labels for 40 windows, expected one each");
        assert!(error(&windows[..5], &labels[..5]).contains("1 different gestures"));
        assert!(error(&[], &[]).contains("0 different gestures"));
        assert!(error(&windows[19..21], &labels[19..21]).contains("at least 3 are needed"));
        assert!(error(&[[1.0; 4]; 40], &labels).contains("constant"));
        assert_eq!(
            Classifier::train(&config(), &[[1.0; 3]; 40], &labels).expect_err("three features"),
            EmgError::FeatureCount { got: 3, expected: 4 }
        );
        let classifier = Classifier::train(&config(), &windows, &labels).expect("good data");
        assert_eq!(classifier.predict(&[1.0]), Err(EmgError::FeatureCount { got: 1, expected: 4 }));
        assert!(classifier.predict(&[f64::NAN, 0.0, 0.0, 0.0]).is_err());
        assert!(classifier.predict(&[f64::MAX, -f64::MAX, f64::MAX, f64::MAX]).is_err());
        assert!(classifier.effort(Command::HandOpen, &windows[0]).is_err());
        windows[7][2] = f64::INFINITY;
        assert_eq!(error(&windows, &labels), "feature 2 of window 7 is inf, expected a finite number");
    }
}
