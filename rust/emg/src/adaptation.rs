use crate::moments::ClassMoments;
use crate::{Classifier, EmgError, EmgModel};
use proact_types::Gesture;
use serde::{Deserialize, Serialize};

/// How a classifier follows its user.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct AdaptationConfig {
    /// Windows a class for which its past counts at most: fewer follow faster. Default 200, ten seconds at 20 windows
    /// a second.
    #[serde(rename = "memory")]
    pub memory_windows: u32,
    /// A confirmed window is used only if the classifier gives its gesture more than this probability. Default 0.9.
    #[serde(rename = "confidence")]
    pub min_confidence: f64,
}

impl Default for AdaptationConfig {
    fn default() -> Self {
        AdaptationConfig { memory_windows: 200, min_confidence: 0.9 }
    }
}

/// Updates class means and pooled covariance with windows whose gesture was confirmed, and makes the discriminant anew
/// in closed form. Off unless a program creates one. Deterministic; each update allocates and takes some tenths of a
/// millisecond, so it belongs outside the control tick; [`crate::EmgPipeline::set_classifier`] takes the result.
///
/// The effort scale stays that of the calibration. Known weakness: wrong confirmations teach wrong classes, hence
/// the drift figure, [`Adaptation::freeze`] and [`Adaptation::roll_back`].
#[derive(Clone, Debug)]
pub struct Adaptation {
    config: AdaptationConfig,
    calibrated: EmgModel,
    moments: ClassMoments,
    classifier: Classifier,
    frozen: bool,
    used: u64,
}

impl Adaptation {
    /// Begins with the classifier of a model.
    ///
    /// # Errors
    /// A confidence outside 0 to 1, or a classifier other than LDA.
    pub fn new(config: AdaptationConfig, model: &EmgModel) -> Result<Adaptation, EmgError> {
        if !(0.0..1.0).contains(&config.min_confidence) {
            return Err(EmgError::OutOfRange {
                name: "adaptation confidence",
                value: config.min_confidence,
                expected: "at least 0 and less than 1",
            });
        }
        if !model.classifier.kind().is_lda() {
            return Err(EmgError::AdaptsLdaOnly { kind: model.classifier.kind() });
        }
        Ok(Adaptation {
            config,
            calibrated: model.clone(),
            moments: model.moments.clone(),
            classifier: model.classifier.clone(),
            frozen: false,
            used: 0,
        })
    }

    /// Offers a window that is known to belong to `gesture`: prompted, or confirmed by what the person did next. True
    /// if the classifier changed; false if frozen, or if the classifier contradicts or doubts the gesture.
    ///
    /// # Errors
    /// Wrong number of features, values that are not finite, or a gesture that was not trained; nothing changes then.
    pub fn confirm(&mut self, gesture: impl Into<Gesture>, features: &[f64]) -> Result<bool, EmgError> {
        let prediction = self.classifier.predict(features)?;
        let class = self.classifier.class_index(gesture.into())?;
        let doubted = prediction.posterior[class] <= self.config.min_confidence;
        if self.frozen || prediction.class_index != class || doubted {
            return Ok(false);
        }
        let mut moments = self.moments.clone();
        moments.add(class, features, f64::from(self.config.memory_windows));
        // Priors stay those of the calibration: the gestures that a task asks for more often are not more probable.
        let settings = &self.calibrated.config;
        let lda = ClassMoments { counts: self.calibrated.moments.counts.clone(), ..moments.clone() }
            .lda(settings.covariance_normalization, settings.priors)?;
        self.classifier = self.classifier.with_lda(lda);
        self.moments = moments;
        self.used += 1;
        Ok(true)
    }

    /// The classifier now.
    pub fn classifier(&self) -> &Classifier {
        &self.classifier
    }

    /// The calibrated model with the classifier now.
    pub fn model(&self) -> EmgModel {
        EmgModel {
            classifier: self.classifier.clone(),
            moments: self.moments.clone(),
            ..self.calibrated.clone()
        }
    }

    /// Windows used since the start or the last roll-back.
    pub fn used(&self) -> u64 {
        self.used
    }

    /// Stops or resumes changes.
    pub fn freeze(&mut self, frozen: bool) {
        self.frozen = frozen;
    }

    /// Back to the calibrated classifier.
    pub fn roll_back(&mut self) {
        self.moments = self.calibrated.moments.clone();
        self.classifier = self.calibrated.classifier.clone();
        self.used = 0;
    }

    /// How far the class means have moved since calibration: the largest over classes, in standard deviations within
    /// the classes, root mean square over features.
    pub fn drift(&self) -> f64 {
        let means = self.moments.means.iter().enumerate();
        let moved = means.map(|(k, mean)| self.calibrated.moments.distance(k, mean));
        moved.fold(0.0, f64::max)
    }
}
