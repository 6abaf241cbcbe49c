use crate::imu::{ImuFault, ImuMonitor};
use crate::moments::ClassMoments;
use crate::{
    Classifier, ClassifierKind, EmgConfig, EmgError, EmgFilter, ImuChannel, LivenessConfig,
    extract_features_with_amplitudes, noise_floors,
};
use proact_types::{
    EmgSample, Gesture,
    renamed_keys::{ConfigFile, rename_keys},
};
use serde::{Deserialize, Serialize};

/// Format of model files that this version writes and reads.
pub const MODEL_FORMAT: u32 = 1;

/// Share by which the stream's rate may differ from the model's: devices differ by less, and features change little.
const RATE_TOLERANCE: f64 = 0.02;

/// What a channel looked like in calibration, after centring, in the stream's unit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ChannelStatistics {
    /// Median at rest.
    pub rest_median: f64,
    /// Standard deviation at rest.
    pub rest_sd: f64,
    /// Largest standard deviation over any recording of any gesture.
    #[serde(rename = "largest_sd")]
    pub max_sd: f64,
    /// As in [`LivenessConfig::noise_floors`]; none in models of older versions.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub noise_floor: Option<f64>,
}

/// The stream that a model is to be used on, before centring.
#[derive(Clone, Debug, PartialEq)]
pub struct StreamFormat {
    /// Samples a second.
    pub rate_hz: f64,
    /// Number of channels.
    pub channels: usize,
    /// Median of each channel at rest, if it has been measured.
    pub rest_medians: Option<Vec<f64>>,
    /// Channels of an inertial measurement unit that follow those of the electrodes.
    pub imu: Vec<ImuChannel>,
}

/// A trained classifier with everything needed to use it again: the contents of a model file.
///
/// As JSON it is readable and complete; reading checks every length and value, so that a model that was read is one
/// that can be used.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct EmgModel {
    /// [`MODEL_FORMAT`].
    pub format: u32,
    /// Version of the program that trained it.
    pub program: String,
    /// Rate, channels, window, features and rules of the training.
    pub config: EmgConfig,
    /// Zero level of each channel, to be subtracted from raw codes; zeros for a stream that is centred already.
    #[serde(rename = "centring")]
    pub dc_offset: Vec<f64>,
    /// Per channel.
    pub channels: Vec<ChannelStatistics>,
    /// Classes, discriminant and effort scale.
    pub classifier: Classifier,
    /// For adaptation.
    pub moments: ClassMoments,
    /// Faults of the recordings that were accepted when it was trained, one sentence each.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub accepted_faults: Vec<String>,
}

impl EmgModel {
    /// Trains on recordings, each of one gesture, before centring. Windows never span two recordings.
    ///
    /// # Errors
    /// What [`extract_features_with_amplitudes`] and [`Classifier::train`] refuse, or another number of zero levels than channels.
    pub fn train<G: Copy + Into<Gesture>>(
        config: &EmgConfig,
        dc_offset: &[f64],
        recordings: &[(G, &[EmgSample])],
    ) -> Result<EmgModel, EmgError> {
        if dc_offset.len() != config.channels || !dc_offset.iter().all(|v| v.is_finite()) {
            return Err(EmgError::ModelFile {
                reason: format!(
                    "got {} zero levels, expected {} finite numbers",
                    dc_offset.len(),
                    config.channels
                ),
            });
        }
        let (mut windows, mut labels, mut amplitudes) = (Vec::new(), Vec::new(), Vec::new());
        let mut channels = vec![ChannelStatistics::default(); config.channels];
        let mut rest = vec![Vec::new(); config.channels];
        for (gesture, samples) in recordings.iter().filter(|(gesture, _)| config.trains_on((*gesture).into()))
        {
            let gesture: Gesture = (*gesture).into();
            check_imu(config, gesture, samples)?;
            let centered: Vec<EmgSample> = samples.iter().map(|s| subtract_dc_offset(s, dc_offset)).collect();
            let (vectors, sums) = extract_features_with_amplitudes(config, &centered)?;
            windows.extend(vectors);
            amplitudes.extend(sums);
            labels.resize(windows.len(), gesture);
            for (c, statistics) in channels.iter_mut().enumerate() {
                let values: Vec<f64> = centered.iter().map(|s| s.channels[c]).collect();
                statistics.max_sd = statistics.max_sd.max(mean_and_sd(&values).1);
                if gesture == config.rest {
                    rest[c].extend(values);
                }
            }
        }
        for (statistics, values) in channels.iter_mut().zip(rest) {
            statistics.rest_sd = mean_and_sd(&values).1;
            statistics.rest_median = median(values).unwrap_or(0.0);
        }
        let floors = noise_floors(
            &config.liveness,
            config.rate_hz,
            config.channels,
            recordings.iter().map(|(_, samples)| *samples),
        );
        for (statistics, floor) in channels.iter_mut().zip(floors) {
            statistics.noise_floor = Some(floor);
        }
        let classifier = Classifier::train_with_amplitudes(config, &windows, &labels, &amplitudes)?;
        let classes: Vec<usize> =
            labels.iter().map(|gesture| classifier.class_index(*gesture)).collect::<Result<_, _>>()?;
        Ok(EmgModel {
            format: MODEL_FORMAT,
            program: env!("CARGO_PKG_VERSION").to_owned(),
            config: config.clone(),
            dc_offset: dc_offset.to_vec(),
            channels,
            moments: ClassMoments::of(&windows, &classes, classifier.gestures().len()),
            classifier,
            accepted_faults: Vec::new(),
        })
    }

    /// What makes a stream stale that this model is used on: the rules of its settings, with what the training tells
    /// about the channels. `rails` are the converter's, if they are known.
    pub fn liveness(&self, rails: Option<[f64; 2]>) -> LivenessConfig {
        let floors: Option<Vec<f64>> = self.channels.iter().map(|channel| channel.noise_floor).collect();
        LivenessConfig { rails, noise_floors: floors.unwrap_or_default(), ..self.config.liveness.clone() }
    }

    /// Whether the model may be used with these settings. How decisions are made of classes may differ from its training;
    /// what the classifier was trained with may not.
    ///
    /// # Errors
    /// [`EmgError::TrainingMismatch`] naming the first setting that would need another training.
    pub fn check_settings(&self, requested: &EmgConfig) -> Result<(), EmgError> {
        let of = |config: &EmgConfig| {
            [
                ("emg.rate_hz", config.rate_hz.to_string()),
                ("emg.channels", config.channels.to_string()),
                ("emg.window", format!("{:?}", config.window)),
                ("emg.increment", format!("{:?}", config.increment)),
                (
                    "emg.filters",
                    config.filters.iter().map(EmgFilter::to_string).collect::<Vec<_>>().join(","),
                ),
                ("emg.features", format!("{:?}", config.features)),
                ("emg.classifier", config.classifier.to_string()),
                ("emg.covariance_normalization", format!("{:?}", config.covariance_normalization)),
                ("emg.priors", format!("{:?}", config.priors)),
                ("emg.ssc_threshold", config.ssc_threshold.to_string()),
                ("emg.wamp_threshold", config.wamp_threshold.to_string()),
                ("emg.rest", config.rest.to_string()),
                ("emg.regression.drives", format!("{:?}", config.regression.drives)),
                (
                    "emg.two_site",
                    format!(
                        "{} {:?} {}",
                        config.two_site.pair, config.two_site.channels, config.two_site.switch_gesture
                    ),
                ),
                ("emg.regression.ridge_alpha", config.regression.ridge_alpha.to_string()),
                ("emg.process", format!("{:?}", config.process)),
                ("emg.imu", imu_text(config)),
            ]
        };
        match of(requested)
            .into_iter()
            .zip(of(&self.config))
            .find(|(requested, trained)| requested != trained)
        {
            Some(((key, requested), (_, trained))) => {
                Err(EmgError::TrainingMismatch { key, requested, trained })
            }
            None => Ok(()),
        }
    }

    /// The sample less the zero levels. A sample with another number of channels keeps it, for the window to refuse.
    pub fn subtract_dc_offset(&self, sample: &EmgSample) -> EmgSample {
        subtract_dc_offset(sample, &self.dc_offset)
    }

    /// Whether the model may be used on a stream.
    ///
    /// # Errors
    /// [`EmgError::StreamMismatch`] with every reason: another number of channels, a rate that differs by more than 2 %, or
    /// a channel that rests further from its zero level than in training.
    pub fn check_stream_format(&self, stream: &StreamFormat) -> Result<(), EmgError> {
        let mut reasons = Vec::new();
        if stream.channels != self.config.channels {
            reasons.push(format!(
                "the model has {} channels, the stream {}",
                self.config.channels, stream.channels
            ));
        }
        if stream.imu != self.config.imu.channels {
            reasons.push(format!(
                "the model was trained on a stream with {}, this one has {}",
                unit_text(&self.config.imu.channels),
                unit_text(&stream.imu)
            ));
        }
        let rate = self.config.rate_hz;
        // Also true for a rate that is no number.
        let off = (stream.rate_hz / rate - 1.0).abs();
        if off.is_nan() || off > RATE_TOLERANCE {
            reasons.push(format!("the model was trained at {rate} Hz, the stream has {} Hz", stream.rate_hz));
        }
        if let Some(medians) = stream.rest_medians.as_ref().filter(|_| reasons.is_empty()) {
            if medians.len() != stream.channels {
                reasons.push(format!("got {} rest medians, expected {}", medians.len(), stream.channels));
            }
            for (c, median) in medians.iter().enumerate().take(self.dc_offset.len()) {
                let statistics = &self.channels[c];
                let level = self.dc_offset[c] + statistics.rest_median;
                // Ten counts of an 8-bit converter are less than any offset left in, and more than any drift.
                let limit = (5.0 * statistics.rest_sd).max(10.0);
                let off = (median - level).abs();
                if off.is_nan() || off > limit {
                    reasons.push(format!(
                        "channel {c} rests at {median}, the model expects {level} (zero level {}): the centring differs",
                        self.dc_offset[c]
                    ));
                }
            }
        }
        if reasons.is_empty() {
            Ok(())
        } else {
            Err(EmgError::StreamMismatch { reasons: reasons.join("; ") })
        }
    }

    /// The same model for a band that sits `shift` channels further: it reads channel `(c + shift) mod channels` of the
    /// stream as its channel c, as [`crate::check_rotation`] proposes.
    ///
    /// # Errors
    /// [`EmgError::ModelFile`] for a model that was put together wrongly, [`EmgError::Imu`] for one that needs an inertial
    /// measurement unit: it sits on the band and has turned with it.
    pub fn with_channel_shift(&self, shift: usize) -> Result<EmgModel, EmgError> {
        self.check()?;
        if !self.config.imu.features.is_empty() {
            let reason =
                "it has turned with the band, and the model needs it: turn the band back, or calibrate anew";
            return Err(EmgError::Imu { reason: reason.to_owned() });
        }
        let channels = self.config.channels;
        let shift = shift % channels;
        let layout = self.config.layout();
        // `FeatureLayout::roll` takes a vector of the stream to the model; coefficients and means go the other way.
        let back = |values: &[f64]| {
            let mut out = vec![0.0; values.len()];
            layout.roll(values, (channels - shift) % channels, &mut out);
            out
        };
        let mut model = self.clone();
        model.dc_offset.rotate_right(shift);
        model.channels.rotate_right(shift);
        model.classifier = self.classifier.map_features(&back)?;
        model.moments = self.moments.map_features(&back);
        Ok(model)
    }

    /// The contents of a model file.
    ///
    /// # Errors
    /// [`EmgError::ModelFile`] for a model that was put together wrongly.
    pub fn to_json(&self) -> Result<String, EmgError> {
        self.check()?;
        serde_json::to_string_pretty(self).map_err(|e| EmgError::ModelFile { reason: e.to_string() })
    }

    /// Reads the contents of a model file.
    ///
    /// # Errors
    /// [`EmgError::ModelFile`] for another format, a missing or unknown key, or lengths and values that do not fit.
    pub fn from_json(json: &str) -> Result<EmgModel, EmgError> {
        #[derive(Deserialize)]
        struct Format {
            format: u32,
        }
        let reason = |e: serde_json::Error| EmgError::ModelFile { reason: e.to_string() };
        // The format first: another one would give a message about some key.
        check_format(serde_json::from_str::<Format>(json).map_err(reason)?.format)?;
        let model: EmgModel = match with_present_keys(json)? {
            Some(renamed) => serde_json::from_value(renamed),
            None => serde_json::from_str(json),
        }
        .map_err(reason)?;
        model.check()?;
        Ok(model)
    }

    fn check(&self) -> Result<(), EmgError> {
        check_format(self.format)?;
        self.config.check()?;
        let channels = self.config.channels;
        let features = self.config.layout().count();
        let classes = self.classifier.gestures().len();
        // A co-contraction has no windows.
        let min_windows = if self.config.classifier == ClassifierKind::TwoSite { 0.0 } else { 1.0 };
        let statistics = self.channels.iter().flat_map(|c| [c.rest_median, c.rest_sd, c.max_sd]);
        let wrong = if !self.classifier.is_sound()
            || self.classifier.channels() != channels
            || self.classifier.features() != self.config.features
            || self.classifier.kind() != self.config.classifier
            || self.classifier.feature_count() != features
        {
            "the classifier does not fit the features and channels"
        } else if self.dc_offset.len() != channels || !self.dc_offset.iter().all(|v| v.is_finite()) {
            "there must be one zero level a channel"
        } else if self.channels.len() != channels || !statistics.into_iter().all(f64::is_finite) {
            "there must be statistics for each channel"
        } else if !self.moments.is_sound(classes, features, min_windows) {
            "the moments do not fit the classes and features"
        } else {
            return Ok(());
        };
        Err(EmgError::ModelFile { reason: wrong.to_owned() })
    }
}

/// How the model takes an inertial measurement unit.
fn imu_text(config: &EmgConfig) -> String {
    let channels = unit_text(&config.imu.channels);
    if config.imu.features.is_empty() {
        channels
    } else {
        format!("{channels}, used: {}", config.imu.features.join(" "))
    }
}

fn unit_text(channels: &[ImuChannel]) -> String {
    if channels.is_empty() {
        return "no inertial measurement unit".to_owned();
    }
    let named: Vec<String> = channels.iter().map(|c| format!("{} ({})", c.name, c.unit)).collect();
    format!("an inertial measurement unit of {}", named.join(", "))
}

/// Whether all sensors of an inertial measurement unit that are features said something in a recording.
pub(crate) fn check_imu(config: &EmgConfig, gesture: Gesture, samples: &[EmgSample]) -> Result<(), EmgError> {
    let of_unit = |sample: &'_ EmgSample| sample.channels.len() == config.sample_channels();
    if config.imu.features.is_empty() || !samples.iter().all(of_unit) {
        // Samples of another length are refused by what cuts windows.
        return Ok(());
    }
    let values = samples.iter().map(|sample| &sample.channels[config.channels..]);
    let (number, what) = match ImuMonitor::recording_fault(&config.imu, values) {
        None => return Ok(()),
        Some(ImuFault::Silent(number)) => (number, "has values that are no numbers"),
        Some(ImuFault::Frozen(number)) => (number, "does not change"),
    };
    let name = config.imu.channels.get(number - 1).map_or("", |channel| channel.name.as_str());
    let reason = format!(
        "{name} {what} in a recording of {gesture}, expected a living sensor: look at it and record again, or train without it"
    );
    Err(EmgError::Imu { reason })
}

/// A model file of which the settings have keys by names that they had before, with the present ones; none if there are no such.
fn with_present_keys(json: &str) -> Result<Option<serde_json::Value>, EmgError> {
    let Ok(mut model) = serde_json::from_str::<serde_json::Value>(json) else { return Ok(None) };
    let Some(config) = model.get_mut("config") else { return Ok(None) };
    let used = rename_keys(config, ConfigFile::Trial, "emg")
        .map_err(|error| EmgError::ModelFile { reason: error.to_string() })?;
    Ok(Some(model).filter(|_| !used.is_empty()))
}

fn check_format(format: u32) -> Result<(), EmgError> {
    if format == MODEL_FORMAT {
        return Ok(());
    }
    Err(EmgError::ModelFile { reason: format!("format {format}, this version reads format {MODEL_FORMAT}") })
}

pub(crate) fn subtract_dc_offset(sample: &EmgSample, dc_offset: &[f64]) -> EmgSample {
    let mut sample = sample.clone();
    sample.channels.iter_mut().zip(dc_offset).for_each(|(value, zero)| *value -= zero);
    sample
}

/// The upper median; none of nothing.
pub(crate) fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_unstable_by(f64::total_cmp);
    values.get(values.len() / 2).copied()
}

fn mean_and_sd(values: &[f64]) -> (f64, f64) {
    let count = values.len().max(1) as f64;
    let mean = values.iter().sum::<f64>() / count;
    (mean, (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / count).sqrt())
}
