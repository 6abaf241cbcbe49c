use crate::filter::FilterBank;
use crate::{
    ClassifierKind, DecoderProcessConfig, EmgError, EmgFilter, FeatureLayout, FeatureSet, ImuConfig,
    LivenessConfig, RegressionConfig, TwoSiteConfig,
};
use proact_types::{EmgSample, Gesture, MAX_EMG_CHANNELS};
use serde::{Deserialize, Serialize};
use std::{num::NonZeroU32, ops::RangeInclusive};

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
        const MAX_SAMPLES: f64 = 600_000.0;
        let samples = match self {
            WindowLength::Millis(millis) => (millis * rate_hz / 1000.0).round(),
            WindowLength::Samples(samples) => f64::from(samples),
        };
        if (1.0..=MAX_SAMPLES).contains(&samples) {
            Ok(samples as usize)
        } else {
            Err(EmgError::Length { length: self, rate_hz, samples })
        }
    }
}

/// How the pooled covariance is normalised. scikit-learn changed this in 1.9; no class of a tested recording
/// depends on it, probabilities move by about 0.001.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum CovarianceNormalization {
    /// Divided by the number of windows, as scikit-learn 1.9 and later.
    #[default]
    Windows,
    /// Divided by windows less classes, as scikit-learn up to 1.8.
    WindowsLessClasses,
}

/// How probable each class is before its window is seen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Priors {
    /// By the number of training windows, as LibEMG: recordings of unequal length shift decisions.
    #[default]
    Counts,
    /// All the same.
    Equal,
}

/// When a decision goes out as a message. The gesture in force is the same either way.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PublishRule {
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
    /// Filters of the stream, in their order, after the zero level is taken off and before windows are cut; what watches the
    /// stream for faults sees it unfiltered. Default none, as the original program.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub filters: Vec<EmgFilter>,
    /// Length of a window. Default 100 ms (same source: 100 samples at 1 kHz).
    pub window: WindowLength,
    /// Step from one window to the next. Default 50 ms (same source).
    pub increment: WindowLength,
    /// Features. Default HTD (same source).
    pub features: FeatureSet,
    /// How windows are told apart. Default LDA (same source).
    #[serde(skip_serializing_if = "ClassifierKind::is_lda")]
    pub classifier: ClassifierKind,
    /// Normalisation of the covariance. Default: scikit-learn 1.9.
    pub covariance_normalization: CovarianceNormalization,
    /// Priors of the classes. Default: by their windows, as LibEMG.
    pub priors: Priors,
    /// Products of slopes from which on a slope sign change counts, in squared units of the stream. Default 0
    /// (LibEMG).
    pub ssc_threshold: f64,
    /// Differences above which WAMP counts, in the stream's unit. Default 0.002 (LibEMG), made for volts: with counts
    /// of the device every change counts.
    pub wamp_threshold: f64,
    /// Windows whose confidence is not above this are rejected: they have no class. Default off; LibEMG's value is
    /// [`DEFAULT_REJECTION_THRESHOLD`].
    pub rejection_threshold: Option<f64>,
    /// The most frequent of so many newest classes, fewer at the start, goes to the rule; rejected windows vote too,
    /// and of equals the first by name wins, rejected before all. Default off; LibEMG's
    /// value is [`DEFAULT_MAJORITY_VOTE_WINDOWS`], the largest possible [`MAX_MAJORITY_VOTE_WINDOWS`].
    pub majority_vote_windows: Option<NonZeroU32>,
    /// When messages go out. Default: hold, as the original program.
    pub publish_rule: PublishRule,
    /// Equal classes in a row that change the gesture in force. Default 3 (same source).
    pub consecutive_decisions: NonZeroU32,
    /// The original program's start: while fewer than `consecutive_decisions` classes have been seen, it is enough that
    /// those seen are equal, so the very first window acts. Default false: a start needs a full run too.
    pub act_on_first_window: bool,
    /// Silence after which the stream counts as stale and the arm stops, milliseconds. Default 200: four
    /// increments (no source has a number).
    pub stale_timeout_ms: u64,
    /// What else makes the stream stale: samples that no living arm gives.
    pub liveness: LivenessConfig,
    /// Gaps that are bridged.
    pub gap_interpolation: GapInterpolationConfig,
    /// The gesture of a relaxed hand: it stops the arm, and after a silence only it lets gestures through again. Default
    /// `no_motion`.
    #[serde(skip_serializing_if = "is_no_motion")]
    pub rest: Gesture,
    /// Degrees of freedom of a regressor.
    #[serde(skip_serializing_if = "RegressionConfig::is_default")]
    pub regression: RegressionConfig,
    /// Direct control by two sites.
    #[serde(skip_serializing_if = "TwoSiteConfig::is_default")]
    pub two_site: TwoSiteConfig,
    /// The program that decodes, with the classifiers `process` and `process_regressor`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub process: Option<DecoderProcessConfig>,
    /// Channels of an inertial measurement unit beside those of the electrodes.
    #[serde(skip_serializing_if = "ImuConfig::is_default")]
    pub imu: ImuConfig,
}

/// How short gaps in a live stream are bridged: lost samples are put on a straight line between their neighbours, and are
/// known as such. A window with such samples never begins a motion; it confirms one that is in force, or stops it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct GapInterpolationConfig {
    /// Longest gap that is bridged, ms; 0 bridges none. Default 40: two packets of 16 ms, as the armband sends them.
    pub max_gap_ms: u64,
    /// Share of the samples of a window that may be bridged, at most; the window is spoilt if it is more. Default 0.35:
    /// two packets in 100 ms.
    pub max_interpolated_share: f64,
}

impl Default for GapInterpolationConfig {
    fn default() -> Self {
        GapInterpolationConfig { max_gap_ms: 40, max_interpolated_share: 0.35 }
    }
}

fn is_no_motion(rest: &Gesture) -> bool {
    *rest == Gesture::default()
}

impl Default for EmgConfig {
    fn default() -> Self {
        EmgConfig {
            rate_hz: 1000.0,
            channels: 8,
            filters: Vec::new(),
            window: WindowLength::Millis(100.0),
            increment: WindowLength::Millis(50.0),
            features: FeatureSet::HTD,
            classifier: ClassifierKind::Lda,
            covariance_normalization: CovarianceNormalization::Windows,
            priors: Priors::Counts,
            ssc_threshold: 0.0,
            wamp_threshold: 0.002,
            rejection_threshold: None,
            majority_vote_windows: None,
            publish_rule: PublishRule::Hold,
            consecutive_decisions: NonZeroU32::MIN.saturating_add(2),
            act_on_first_window: false,
            stale_timeout_ms: 200,
            liveness: LivenessConfig::default(),
            gap_interpolation: GapInterpolationConfig::default(),
            rest: Gesture::default(),
            regression: RegressionConfig::default(),
            two_site: TwoSiteConfig::default(),
            process: None,
            imu: ImuConfig::default(),
        }
    }
}

/// Sample rates that a stream can have, Hz: far below and above any EMG.
pub const RATES_HZ: RangeInclusive<f64> = 1.0..=1e6;

/// LibEMG's threshold of rejection.
pub const DEFAULT_REJECTION_THRESHOLD: f64 = 0.9;
/// LibEMG's number of votes.
pub const DEFAULT_MAJORITY_VOTE_WINDOWS: u32 = 5;
/// Most votes that are remembered.
pub const MAX_MAJORITY_VOTE_WINDOWS: u32 = 64;

impl EmgConfig {
    /// Samples in a window.
    ///
    /// # Errors
    /// [`EmgError`] if the window has no usable length.
    pub fn window_samples(&self) -> Result<usize, EmgError> {
        match self.window.samples(self.rate_hz)? {
            short if short < self.features.min_window_samples() => {
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

    /// Whether recordings of `gesture` are trained on: two sites take those of their pair and of rest alone.
    pub fn trains_on(&self, gesture: Gesture) -> bool {
        self.classifier != ClassifierKind::TwoSite
            || gesture == self.rest
            || self.two_site.gestures().contains(&gesture)
    }

    /// Time from one window to the next, milliseconds.
    pub(crate) fn increment_millis(&self) -> Result<f64, EmgError> {
        Ok(1000.0 * self.increment_samples()? as f64 / self.rate_hz)
    }

    /// Where the values of the features stand in the vector of a window.
    pub fn layout(&self) -> FeatureLayout {
        self.features.layout(self.channels, self.rate_hz).with_imu(self.imu.features.len())
    }

    /// [`FeatureLayout::column_names`], with the names of the channels whose means follow, as `MEAN_acceleration_x`.
    pub fn column_names(&self) -> Vec<String> {
        let layout = self.layout();
        let means = self.imu.features.iter().map(|name| format!("MEAN_{name}"));
        layout.column_names().into_iter().take(layout.emg_count()).chain(means).collect()
    }

    /// The sample without what follows the electrodes. One that is of another length than the stream's stays as it is, for whoever
    /// takes it to refuse.
    pub fn electrode_sample(&self, sample: &EmgSample) -> EmgSample {
        let mut sample = sample.clone();
        if sample.channels.len() == self.sample_channels() {
            sample.channels.truncate(self.channels);
        }
        sample
    }

    /// Channels of a sample: those of the electrodes, then those of the inertial measurement unit.
    pub fn sample_channels(&self) -> usize {
        self.channels + self.imu.channels.len()
    }

    fn check_process(&self) -> Result<(), EmgError> {
        let refused = |reason: String| Err(EmgError::Process { reason });
        match &self.process {
            Some(_) if !self.classifier.is_process() => refused(format!(
                "it is set, but emg.classifier is {}, which needs none: expected process or process_regressor",
                self.classifier
            )),
            Some(process) => process.check(),
            None if self.classifier.is_process() => refused(format!(
                "emg.classifier is {}, expected the program's command (--decoder-process FILE, docs/emg.md)",
                self.classifier
            )),
            None => Ok(()),
        }
    }

    /// Checks every value.
    ///
    /// # Errors
    /// The first [`EmgError`] found.
    pub fn check(&self) -> Result<(), EmgError> {
        if !RATES_HZ.contains(&self.rate_hz) {
            return Err(EmgError::Rate { rate_hz: self.rate_hz });
        }
        if !(1..=MAX_EMG_CHANNELS).contains(&self.channels) {
            return Err(EmgError::ChannelCount { got: self.channels });
        }
        self.imu.check(self.channels)?;
        FilterBank::new(&self.filters, self.rate_hz, self.channels)?;
        self.window_samples()?;
        if let Some(feature) = self.layout().first_empty_feature() {
            let needs = if feature.depends_on_rate() {
                "its lowest band ends at 92 Hz, so it needs a rate above 184 Hz"
            } else {
                "it compares channels, so it needs two"
            };
            let (channels, rate_hz) = (self.channels, self.rate_hz);
            return Err(EmgError::EmptyFeature { feature: feature.name(), channels, rate_hz, needs });
        }
        let refused = |name, value, expected| Err(EmgError::OutOfRange { name, value, expected });
        if !self.ssc_threshold.is_finite() {
            return refused("ssc_threshold", self.ssc_threshold, "a finite number");
        }
        if !self.wamp_threshold.is_finite() {
            return refused("wamp_threshold", self.wamp_threshold, "a finite number");
        }
        if let Some(rejection) = self.rejection_threshold.filter(|r| !(0.0..1.0).contains(r)) {
            return refused("rejection_threshold", rejection, "at least 0 and less than 1");
        }
        if let Some(majority) = self.majority_vote_windows.filter(|m| m.get() > MAX_MAJORITY_VOTE_WINDOWS) {
            return refused("majority_vote_windows", f64::from(majority.get()), "1 to 64 votes");
        }
        if self.gap_interpolation.max_gap_ms > 1000 {
            return refused(
                "gap_interpolation.max_gap_ms",
                self.gap_interpolation.max_gap_ms as f64,
                "at most 1000, or 0 for none",
            );
        }
        // With more than half of a window made up it says nothing.
        if !(0.0..=0.5).contains(&self.gap_interpolation.max_interpolated_share) {
            return refused(
                "gap_interpolation.max_interpolated_share",
                self.gap_interpolation.max_interpolated_share,
                "0 to 0.5",
            );
        }
        self.liveness.check(self.channels)?;
        if self.classifier.is_regression() {
            self.regression.check(self.rest)?;
        }
        if self.classifier == ClassifierKind::TwoSite {
            self.two_site.check(self)?;
        }
        self.check_process()?;
        if self.rejection_threshold.is_some() && !self.classifier.has_posterior() {
            return Err(EmgError::RejectionWithoutPosterior { kind: self.classifier });
        }
        let increment_millis = self.increment_millis()?;
        // With a shorter age than the time between two windows the stream would always be stale.
        if (self.stale_timeout_ms as f64) < increment_millis {
            return Err(EmgError::StaleTimeout { stale_timeout_ms: self.stale_timeout_ms, increment_millis });
        }
        Ok(())
    }
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
        assert!(refused(|c| c.channels = 513).contains("513 channels"));
        assert!(refused(|c| c.window = WindowLength::Millis(f64::NAN)).contains("NaN"));
        assert!(refused(|c| c.window = WindowLength::Samples(2)).contains("at least 3"));
        assert!(refused(|c| c.increment = WindowLength::Samples(0)).contains("at least 1"));
        assert!(
            refused(|c| c.rejection_threshold = Some(1.0))
                .contains("rejection_threshold is 1, expected at least 0")
        );
        assert!(refused(|c| c.rejection_threshold = Some(f64::NAN)).contains("NaN"));
        assert!(refused(|c| c.majority_vote_windows = NonZeroU32::new(65)).contains("65"));
        assert!(refused(|c| c.wamp_threshold = f64::NAN).contains("wamp_threshold"));
        assert!(
            refused(|c| {
                c.window = WindowLength::Samples(5);
                c.features = "TDAR".parse().expect("known");
            })
            .contains("6 with AR4")
        );
        assert!(
            refused(|c| c.gap_interpolation.max_gap_ms = 1001)
                .contains("gap_interpolation.max_gap_ms is 1001, expected at most")
        );
        assert!(
            refused(|c| c.gap_interpolation.max_interpolated_share = 0.6)
                .contains("gap_interpolation.max_interpolated_share is 0.6, expected 0 to 0.5")
        );
        assert!(refused(|c| c.stale_timeout_ms = 49).contains("every 50 ms"));
    }

    #[test]
    fn toml_gives_the_defaults_and_refuses_unknown_keys() {
        assert_eq!(toml::from_str::<EmgConfig>(""), Ok(EmgConfig::default()));
        let config: EmgConfig =
            toml::from_str("window = { samples = 20 }\npublish_rule = \"strict\"\nfeatures = \"HTD\"")
                .expect("valid settings");
        assert_eq!((config.window, config.publish_rule), (WindowLength::Samples(20), PublishRule::Strict));
        let config: EmgConfig =
            toml::from_str("features = \"MAV,AR\"\nrejection_threshold = 0.9\nmajority_vote_windows = 5")
                .expect("valid settings");
        assert_eq!(
            (config.features.to_string().as_str(), config.rejection_threshold),
            ("MAV,AR4", Some(0.9))
        );
        let error = toml::from_str::<EmgConfig>("features = \"MAVS\"").expect_err("misspelt").to_string();
        assert!(error.contains("\"MAVS\" is no EMG feature"), "{error}");
        let error = toml::from_str::<EmgConfig>("windw = 3").expect_err("misspelt").to_string();
        assert!(error.contains("windw"), "{error}");
    }
}
