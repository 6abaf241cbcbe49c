use crate::EmgError;
use proact_types::MAX_EMG_CHANNELS;
use serde::{Deserialize, Serialize};

/// Most bytes of the name or the unit of a channel.
const MAX_NAME_BYTES: usize = 64;
/// Values that are no numbers for so long: the sensor is silent, ms. Samples without them are unusable, so it is told before the
/// share of lost samples ([`crate::LivenessConfig::max_lost_share`]) stops the stream by a reason that says less.
const SILENT_MS: f64 = 50.0;

/// One channel of an inertial measurement unit that is worn with the electrodes, such as an axis of its accelerometer.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ImuChannel {
    /// Such as `acceleration_x`. Each once.
    pub name: String,
    /// Such as `g`, `deg/s`, or `1` for a component of a unit quaternion. Channels of one unit are taken for one sensor.
    pub unit: String,
}

impl ImuChannel {
    /// A channel of this name and unit.
    pub fn new(name: impl Into<String>, unit: impl Into<String>) -> ImuChannel {
        ImuChannel { name: name.into(), unit: unit.into() }
    }

    /// `orientation_w` .. `_z` (unit quaternion), `acceleration_x` .. `_z` (g) and `angular_velocity_x` .. `_z` (deg/s), in this
    /// order: what an armband's unit has, in the frame of the unit.
    pub fn armband_channels() -> Vec<ImuChannel> {
        let axes = |name: &'static str, axes: &'static str, unit: &'static str| {
            axes.chars().map(move |axis| ImuChannel::new(format!("{name}_{axis}"), unit))
        };
        axes("orientation", "wxyz", "1")
            .chain(axes("acceleration", "xyz", "g"))
            .chain(axes("angular_velocity", "xyz", "deg/s"))
            .collect()
    }
}

/// Channels of an inertial measurement unit that a stream has beside those of its electrodes.
///
/// They follow the electrodes in each sample, and are none to filters, lights, effort and the features of EMG. The mean over the
/// window of those that are named under `features` is appended to the features of the EMG, so that a classifier can tell
/// what the position of the limb does to the EMG: Fougner et al., IEEE Trans. Neural Syst. Rehabil. Eng. 19(6), 2011, 644-651.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ImuConfig {
    /// All that the stream has, in the order of the samples.
    pub channels: Vec<ImuChannel>,
    /// Names of those whose mean is a feature. Default none: they are recorded only.
    pub features: Vec<String>,
    /// The stream is stale when no channel of a sensor that is a feature changes for so long, ms. Default 1000; 0 is off. No
    /// source has a number: a worn sensor sends 50 samples a second or more, whose noise is above its resolution.
    pub frozen_ms: u64,
}

impl Default for ImuConfig {
    fn default() -> Self {
        ImuConfig { channels: Vec::new(), features: Vec::new(), frozen_ms: 1000 }
    }
}

impl ImuConfig {
    /// Those of a stream, recorded only.
    pub fn record_only(channels: Vec<ImuChannel>) -> ImuConfig {
        ImuConfig { channels, ..ImuConfig::default() }
    }

    /// The same, where each channel is a feature whose name is one of `words` or begins with one and `_`: `acceleration` for its
    /// three axes. `all` names all of them.
    ///
    /// # Errors
    /// [`EmgError::Imu`] for a word that names none, with those that there are.
    pub fn with_features<S: AsRef<str>>(mut self, words: &[S]) -> Result<ImuConfig, EmgError> {
        let named = |word: &str, name: &str| {
            word == "all"
                || name.strip_prefix(word).is_some_and(|rest| rest.is_empty() || rest.starts_with('_'))
        };
        for word in words {
            let word = word.as_ref();
            if !self.channels.iter().any(|channel| named(word, &channel.name)) {
                let known: Vec<&str> = self.channels.iter().map(|channel| channel.name.as_str()).collect();
                let known = if known.is_empty() { "none".to_owned() } else { known.join(", ") };
                let reason = format!("there is no channel {word:?}; the stream has {known}");
                return Err(EmgError::Imu { reason });
            }
        }
        let is_requested = |name: &str| words.iter().any(|word| named(word.as_ref(), name));
        self.features =
            self.channels.iter().map(|c| c.name.clone()).filter(|name| is_requested(name)).collect();
        Ok(self)
    }

    /// The same without features: what judges how much they are worth.
    pub fn without_features(&self) -> ImuConfig {
        ImuConfig { features: Vec::new(), ..self.clone() }
    }

    /// Nothing is said of an inertial measurement unit.
    pub(crate) fn is_default(&self) -> bool {
        *self == ImuConfig::default()
    }

    /// Places of the channels that are features, among those of the unit.
    pub(crate) fn feature_indices(&self) -> Vec<usize> {
        let channel_index = |name: &String| self.channels.iter().position(|channel| channel.name == *name);
        self.features.iter().filter_map(channel_index).collect()
    }

    /// Checks every value; the stream has `electrodes` channels of EMG.
    pub(crate) fn check(&self, electrodes: usize) -> Result<(), EmgError> {
        let refused = |reason: String| Err(EmgError::Imu { reason });
        if electrodes + self.channels.len() > MAX_EMG_CHANNELS {
            return refused(format!(
                "{} channels beside {electrodes} of EMG, expected at most {MAX_EMG_CHANNELS} in all",
                self.channels.len()
            ));
        }
        let fits =
            |text: &str| (1..=MAX_NAME_BYTES).contains(&text.len()) && !text.contains(char::is_control);
        for (k, channel) in self.channels.iter().enumerate() {
            let ImuChannel { name, unit } = channel;
            if !(fits(name) && fits(unit)) {
                return refused(format!(
                    "channel {k} is called {name:?} with the unit {unit:?}, expected 1 to {MAX_NAME_BYTES} bytes each without \
                     control characters"
                ));
            }
            if self.channels[..k].iter().any(|other| other.name == *name) {
                return refused(format!("two channels are called {name:?}, expected each name once"));
            }
        }
        for (k, name) in self.features.iter().enumerate() {
            if !self.channels.iter().any(|channel| channel.name == *name) {
                return refused(format!("the feature {name:?} is no channel of it"));
            }
            if self.features[..k].contains(name) {
                return refused(format!("the feature {name:?} is named twice, expected once"));
            }
        }
        if self.frozen_ms > 10_000 {
            return refused(format!("frozen_ms is {}, expected at most 10000, or 0 for off", self.frozen_ms));
        }
        Ok(())
    }
}

/// Why what an inertial measurement unit says cannot be used: the number of a channel, from one, among those of the unit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum ImuFault {
    /// No numbers come.
    Silent(usize),
    /// No channel of the sensor changes.
    Frozen(usize),
}

/// Watches those channels of an inertial measurement unit that are features.
#[derive(Clone, Debug)]
pub(crate) struct ImuMonitor {
    /// Channels of the unit in a sample.
    channels: usize,
    sensors: Vec<Sensor>,
    /// In samples; none where it is off.
    frozen_limit: Option<u32>,
    silent_limit: u32,
}

/// The channels of one unit of measurement.
#[derive(Clone, Debug)]
struct Sensor {
    /// Places among the channels of the unit, and the newest values.
    channels: Vec<(usize, f64)>,
    /// Samples in a row in which none changed.
    same: u32,
    /// Samples in a row without numbers.
    silent: u32,
}

impl ImuMonitor {
    pub(crate) fn new(config: &ImuConfig, rate_hz: f64) -> ImuMonitor {
        let samples = |millis: f64| (millis * rate_hz / 1000.0).round().max(2.0) as u32;
        let mut sensors: Vec<(&str, Sensor)> = Vec::new();
        for index in config.feature_indices() {
            let unit = config.channels[index].unit.as_str();
            let known = sensors.iter().position(|(of, _)| *of == unit);
            let at = known.unwrap_or_else(|| {
                sensors.push((unit, Sensor { channels: Vec::new(), same: 0, silent: 0 }));
                sensors.len() - 1
            });
            sensors[at].1.channels.push((index, f64::NAN));
        }
        ImuMonitor {
            channels: config.channels.len(),
            sensors: sensors.into_iter().map(|(_, sensor)| sensor).collect(),
            frozen_limit: (config.frozen_ms > 0).then(|| samples(config.frozen_ms as f64)),
            silent_limit: samples(SILENT_MS),
        }
    }

    /// Channels of the unit in a sample.
    pub(crate) fn channels(&self) -> usize {
        self.channels
    }

    /// Whether all values that are features are numbers.
    pub(crate) fn is_usable(&self, values: &[f64]) -> bool {
        self.sensors.iter().flat_map(|sensor| &sensor.channels).all(|(index, _)| values[*index].is_finite())
    }

    /// Takes the unit's channels of the next sample. What is wrong now.
    pub(crate) fn push(&mut self, values: &[f64]) -> Option<ImuFault> {
        let mut fault = None;
        for sensor in &mut self.sensors {
            let (mut changed, mut numbers) = (false, true);
            for (index, newest) in &mut sensor.channels {
                let value = values[*index];
                changed |= *newest != value;
                numbers &= value.is_finite();
                *newest = value;
            }
            sensor.silent = if numbers { 0 } else { sensor.silent.saturating_add(1) };
            sensor.same = if changed { 0 } else { sensor.same.saturating_add(1) };
            let number = sensor.channels.first().map_or(0, |(index, _)| index + 1);
            let found = if sensor.silent >= self.silent_limit {
                Some(ImuFault::Silent(number))
            } else {
                self.frozen_limit.filter(|limit| sensor.same >= *limit).map(|_| ImuFault::Frozen(number))
            };
            fault = fault.or(found);
        }
        fault
    }

    /// What is wrong with recorded samples: a sensor that says nothing or the same all through them, whatever the limits. `values`
    /// are the unit's channels of each.
    pub(crate) fn recording_fault<'a>(
        config: &ImuConfig,
        values: impl ExactSizeIterator<Item = &'a [f64]>,
    ) -> Option<ImuFault> {
        let mut watch = ImuMonitor::new(config, 1000.0);
        let last = u32::try_from(values.len().checked_sub(1)?).unwrap_or(u32::MAX).max(1);
        (watch.frozen_limit, watch.silent_limit) = (Some(last), 1);
        let mut fault = None;
        for values in values {
            fault = watch.push(values);
            if matches!(fault, Some(ImuFault::Silent(_))) {
                break;
            }
        }
        fault
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn config(words: &[&str]) -> ImuConfig {
        ImuConfig::record_only(ImuChannel::armband_channels()).with_features(words).expect("known")
    }

    #[test]
    fn features_are_named_by_sensors_or_axes_and_an_unknown_name_is_refused() {
        assert_eq!(config(&["acceleration"]).feature_indices(), [4, 5, 6]);
        assert_eq!(config(&["angular_velocity_z", "orientation_w"]).feature_indices(), [0, 9]);
        assert_eq!(config(&["all"]).feature_indices().len(), 10);
        let unit = ImuConfig::record_only(ImuChannel::armband_channels());
        let error = unit.with_features(&["accel"]).expect_err("no such channel").to_string();
        assert!(error.contains("no channel \"accel\"; the stream has orientation_w, "), "{error}");
        let error = ImuConfig::default().with_features(&["all"]).expect_err("nothing").to_string();
        assert!(error.contains("the stream has none"), "{error}");
    }

    #[test]
    fn what_cannot_be_is_refused() {
        let refused = |change: fn(&mut ImuConfig)| {
            let mut config = config(&["acceleration"]);
            change(&mut config);
            config.check(8).expect_err("must be refused").to_string()
        };
        assert!(refused(|c| c.channels[1].name = "orientation_w".into()).contains("each name once"));
        assert!(refused(|c| c.channels[1].unit.clear()).contains("expected 1 to 64 bytes"));
        assert!(refused(|c| c.features.push("gravity".into())).contains("\"gravity\" is no channel"));
        assert!(refused(|c| c.features.push("acceleration_x".into())).contains("named twice"));
        assert!(refused(|c| c.frozen_ms = 10_001).contains("frozen_ms is 10001"));
        let many = config(&["acceleration"]);
        assert!(many.check(503).expect_err("too many").to_string().contains("at most 512 in all"));
    }

    /// The accelerometer stands still, the gyroscope goes on; then no numbers come; then all is well again.
    #[test]
    fn each_sensor_is_watched_by_itself_and_only_where_it_is_a_feature() {
        let sample = |k: u32, frozen: bool, silent: bool| -> Vec<f64> {
            let moving = f64::from(k);
            let acceleration = if silent {
                f64::NAN
            } else if frozen {
                1.0
            } else {
                moving
            };
            [&[0.5; 4][..], &[acceleration; 3], &[moving; 3]].concat()
        };
        // At 200 Hz: 200 samples are frozen_ms.
        let mut watch = ImuMonitor::new(&config(&["acceleration", "angular_velocity"]), 200.0);
        let found: Vec<Option<ImuFault>> = (0..700)
            .map(|k| watch.push(&sample(k, (100..400).contains(&k), (500..600).contains(&k))))
            .collect();
        let first = |fault| found.iter().position(|f| *f == Some(fault));
        assert_eq!(first(ImuFault::Frozen(5)), Some(300));
        assert_eq!((found[299], found[400]), (None, None));
        assert_eq!(first(ImuFault::Silent(5)), Some(509));
        assert_eq!(found[600], None);
        let mut elsewhere = ImuMonitor::new(&config(&["angular_velocity"]), 200.0);
        assert!((0..700).all(|k| elsewhere.push(&sample(k, true, true)).is_none()));
        let whole: Vec<Vec<f64>> = (0..50).map(|k| sample(k, true, false)).collect();
        let of =
            |words: &[&str]| ImuMonitor::recording_fault(&config(words), whole.iter().map(Vec::as_slice));
        assert_eq!(of(&["angular_velocity", "acceleration"]), Some(ImuFault::Frozen(5)));
        assert_eq!(of(&["angular_velocity"]), None);
    }
}
