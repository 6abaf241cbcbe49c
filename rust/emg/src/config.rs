use proact_types::{Gesture, MAX_EMG_CHANNELS};
use serde::{Deserialize, Serialize};
use std::num::NonZeroU32;

/// A length of the EMG stream.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum WindowLength {
    /// Milliseconds; becomes samples by the stream's rate, rounded to the nearest.
    Millis(f64),
    /// Samples, whatever the rate: for comparison with LibEMG, which counts in samples.
    Samples(u32),
}

impl WindowLength {
    /// The length in samples at `rate_hz`.
    ///
    /// # Errors
    /// [`EmgError::Length`] if it is less than one sample, not finite, or longer than ten minutes at 1 kHz.
    pub fn samples(self, rate_hz: f64) -> Result<usize, EmgError> {
        // Beyond any use; the bound keeps buffers small enough to allocate.
        const LONGEST: f64 = 600_000.0;
        let samples = match self {
            WindowLength::Millis(millis) => (millis * rate_hz / 1000.0).round(),
            WindowLength::Samples(samples) => f64::from(samples),
        };
        if (1.0..=LONGEST).contains(&samples) {
            Ok(samples as usize)
        } else {
            Err(EmgError::Length { length: self, rate_hz, samples })
        }
    }
}

/// Which features are computed from a window.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum FeatureGroup {
    /// Hudgins' time-domain set, in LibEMG's order: mean absolute value, zero crossings, slope sign changes,
    /// waveform length; feature-major.
    #[default]
    #[serde(rename = "HTD")]
    Htd,
}

/// How the pooled covariance is normalised. scikit-learn changed this in 1.9; no class of a tested recording
/// depends on it, probabilities move by about 0.001.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LdaNormalisation {
    /// Divided by the number of windows, as scikit-learn 1.9 and later.
    #[default]
    Windows,
    /// Divided by windows less classes, as scikit-learn up to 1.8.
    WindowsLessClasses,
}

/// When a decision goes out as a message. The gesture in force is the same either way.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RuleKind {
    /// With every decision, carrying the gesture in force: what the original program does.
    #[default]
    Hold,
    /// Only with a decision that completes or continues a run of equal classes: the wording of the paper.
    Strict,
}

/// Settings of the EMG stage.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct EmgConfig {
    /// Samples per second of the stream. Default 1000: gForce Pro+ as ProACT sets it (arXiv:2407.05025).
    pub rate_hz: f64,
    /// Channels of the stream. Default 8 (same source).
    pub channels: usize,
    /// Length of a window. Default 100 ms (same source: 100 samples at 1 kHz).
    pub window: WindowLength,
    /// Step from one window to the next. Default 50 ms (same source).
    pub increment: WindowLength,
    /// Features. Default HTD (same source).
    pub features: FeatureGroup,
    /// Normalisation of the covariance. Default: scikit-learn 1.9.
    pub normalisation: LdaNormalisation,
    /// When messages go out. Default: hold, as the original program.
    pub rule: RuleKind,
    /// Equal classes in a row that change the gesture in force. Default 3 (same source).
    pub required: NonZeroU32,
    /// The original program's start: while fewer than `required` classes have been seen, it is enough that
    /// those seen are equal, so the very first window acts. Default false: a start needs a full run too.
    pub first_output_acts: bool,
    /// Silence after which the stream counts as stale and the arm stops, milliseconds. Default 200: four
    /// increments (no source has a number).
    pub max_age_millis: u64,
}

impl Default for EmgConfig {
    fn default() -> Self {
        EmgConfig {
            rate_hz: 1000.0,
            channels: 8,
            window: WindowLength::Millis(100.0),
            increment: WindowLength::Millis(50.0),
            features: FeatureGroup::Htd,
            normalisation: LdaNormalisation::Windows,
            rule: RuleKind::Hold,
            required: NonZeroU32::MIN.saturating_add(2),
            first_output_acts: false,
            max_age_millis: 200,
        }
    }
}

/// Shortest window: slope sign changes look at three samples.
const SHORTEST_WINDOW: usize = 3;

impl EmgConfig {
    /// Samples in a window.
    ///
    /// # Errors
    /// [`EmgError`] if the window has no usable length.
    pub fn window_samples(&self) -> Result<usize, EmgError> {
        match self.window.samples(self.rate_hz)? {
            short if short < SHORTEST_WINDOW => {
                Err(EmgError::Length { length: self.window, rate_hz: self.rate_hz, samples: short as f64 })
            }
            samples => Ok(samples),
        }
    }

    /// Samples from the start of a window to the start of the next.
    ///
    /// # Errors
    /// [`EmgError`] if the increment has no usable length.
    pub fn increment_samples(&self) -> Result<usize, EmgError> {
        self.increment.samples(self.rate_hz)
    }

    /// Checks every value.
    ///
    /// # Errors
    /// The first [`EmgError`] found.
    pub fn check(&self) -> Result<(), EmgError> {
        if !(self.rate_hz.is_finite() && self.rate_hz > 0.0) {
            return Err(EmgError::Rate { rate_hz: self.rate_hz });
        }
        if !(1..=MAX_EMG_CHANNELS).contains(&self.channels) {
            return Err(EmgError::ChannelCount { got: self.channels });
        }
        self.window_samples()?;
        let increment_millis = 1000.0 * self.increment_samples()? as f64 / self.rate_hz;
        // With a shorter age than the time between two windows the stream would always be stale.
        if (self.max_age_millis as f64) < increment_millis {
            return Err(EmgError::Age { max_age_millis: self.max_age_millis, increment_millis });
        }
        Ok(())
    }
}

/// What can be wrong with settings, training data or features.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum EmgError {
    /// No usable sample rate.
    #[error("EMG rate is {rate_hz} Hz, expected a finite number above zero")]
    Rate {
        /// As given.
        rate_hz: f64,
    },
    /// No usable number of channels.
    #[error("EMG stream has {got} channels, expected 1 to {MAX_EMG_CHANNELS}")]
    ChannelCount {
        /// As given.
        got: usize,
    },
    /// A window or an increment of no usable length.
    #[error(
        "{length:?} is {samples} samples at {rate_hz} Hz; a window needs at least {SHORTEST_WINDOW}, an \
         increment at least 1, neither may exceed 600000"
    )]
    Length {
        /// As given.
        length: WindowLength,
        /// Rate of the stream.
        rate_hz: f64,
        /// In samples.
        samples: f64,
    },
    /// Windows come too rarely for the allowed age.
    #[error(
        "the stream would count as stale after {max_age_millis} ms, but windows come only every \
         {increment_millis} ms; raise max_age_millis or shorten the increment"
    )]
    Age {
        /// As given.
        max_age_millis: u64,
        /// Time between two windows.
        increment_millis: f64,
    },
    /// As many labels as windows are needed.
    #[error("got {labels} labels for {windows} windows, expected one each")]
    LabelCount {
        /// Windows handed in.
        windows: usize,
        /// Labels handed in.
        labels: usize,
    },
    /// A feature vector of another length.
    #[error("got {got} features, expected {expected}")]
    FeatureCount {
        /// Values handed in.
        got: usize,
        /// Values expected.
        expected: usize,
    },
    /// A feature, or what was computed from it, is NaN or infinite.
    #[error("feature {index} of window {window} is {value}, expected a finite number")]
    NotFinite {
        /// Index of the window; zero when there is only one.
        window: usize,
        /// Index in the feature vector.
        index: usize,
        /// Its value.
        value: f64,
    },
    /// A classifier needs at least two gestures to tell apart.
    #[error("training data has {got} different gestures, a classifier needs at least 2")]
    TooFewClasses {
        /// Different gestures.
        got: usize,
    },
    /// The covariance within the classes cannot be estimated.
    #[error("training data has {windows} windows of {classes} gestures, at least {} are needed", classes + 1)]
    TooFewWindows {
        /// Windows handed in.
        windows: usize,
        /// Different gestures.
        classes: usize,
    },
    /// A class number beyond the number of classes, or a class without windows.
    #[error("class {class} of {classes} classes has {windows} windows, expected at least one")]
    EmptyClass {
        /// The class.
        class: usize,
        /// Number of classes.
        classes: usize,
        /// Windows with this label.
        windows: usize,
    },
    /// Nothing varies within any class, as from a dead device.
    #[error("no feature varies within any gesture: the recording is constant")]
    NoVariance,
    /// The singular value decomposition did not converge.
    #[error("the singular value decomposition of the training data did not converge")]
    NoConvergence,
    /// The classifier was trained for another stream.
    #[error("the classifier was trained on {trained} channels, the stream has {stream}")]
    ClassifierChannels {
        /// Channels at training.
        trained: usize,
        /// Channels of the stream.
        stream: usize,
    },
    /// A sample of a recording cannot be used.
    #[error("sample {counter} is unusable: {channels} channels, expected {expected} finite numbers")]
    BadSample {
        /// The sample's counter.
        counter: u64,
        /// Its number of channels.
        channels: usize,
        /// Channels of the stream.
        expected: usize,
    },
    /// A gesture that the classifier was not trained on.
    #[error("the classifier was not trained on {0}")]
    NotTrained(Gesture),
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn milliseconds_become_samples_by_the_rate() {
        let at = |rate_hz| EmgConfig { rate_hz, ..EmgConfig::default() };
        let lengths = |c: EmgConfig| (c.window_samples(), c.increment_samples());
        assert_eq!(lengths(at(200.0)), (Ok(20), Ok(10)));
        assert_eq!(lengths(at(1000.0)), (Ok(100), Ok(50)));
        assert_eq!(WindowLength::Samples(20).samples(1000.0), Ok(20));
    }

    #[test]
    fn settings_that_cannot_work_are_refused() {
        let refused = |change: fn(&mut EmgConfig)| {
            let mut config = EmgConfig::default();
            change(&mut config);
            config.check().expect_err("must be refused").to_string()
        };
        assert!(refused(|c| c.rate_hz = f64::NAN).contains("NaN Hz"));
        assert!(refused(|c| c.rate_hz = 0.0).contains("0 Hz"));
        assert!(refused(|c| c.channels = 0).contains("0 channels"));
        assert!(refused(|c| c.channels = 17).contains("17 channels"));
        assert!(refused(|c| c.window = WindowLength::Millis(f64::NAN)).contains("NaN"));
        assert!(refused(|c| c.window = WindowLength::Samples(2)).contains("at least 3"));
        assert!(refused(|c| c.increment = WindowLength::Samples(0)).contains("at least 1"));
        assert!(refused(|c| c.max_age_millis = 49).contains("every 50 ms"));
    }

    #[test]
    fn toml_gives_the_defaults_and_refuses_unknown_keys() {
        assert_eq!(toml::from_str::<EmgConfig>(""), Ok(EmgConfig::default()));
        let config: EmgConfig =
            toml::from_str("window = { samples = 20 }\nrule = \"strict\"\nfeatures = \"HTD\"")
                .expect("valid settings");
        assert_eq!((config.window, config.rule), (WindowLength::Samples(20), RuleKind::Strict));
        let error = toml::from_str::<EmgConfig>("windw = 3").expect_err("misspelt").to_string();
        assert!(error.contains("windw"), "{error}");
    }
}
