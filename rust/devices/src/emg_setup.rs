use crate::feed::check_synthesizable;
use crate::{
    DeviceError, EmgFeed, FaultPolicy, Recording, Recordings, SyntheticEmg, SyntheticModel, random_stream,
};
use proact_emg::{
    Classifier, DecoderInput, EmgConfig, EmgModel, RecordingFault, StreamFormat, extract_decoder_inputs,
    extract_features, noise_floors,
};
use proact_types::{Command, EmgSample, Gesture, SimTime};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Where a trial's EMG comes from.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub enum EmgOrigin {
    /// Real recordings.
    Recording {
        /// The folder.
        dir: PathBuf,
        /// Samples per second, where the folder does not say.
        #[serde(default)]
        rate_hz: Option<f64>,
        /// Repetitions to train on.
        #[serde(default = "default_train_reps")]
        train_reps: Vec<u32>,
        /// Repetitions to feed during the trial.
        #[serde(default = "default_feed_reps")]
        feed_reps: Vec<u32>,
        /// Complete lacking gestures with synthetic EMG.
        #[serde(default)]
        fill: bool,
        /// Whether recordings with findings that make an accuracy wrong are used.
        #[serde(default)]
        faults: FaultPolicy,
    },
    /// The generator alone, 8 channels at 1000 Hz.
    #[default]
    Synthetic,
}

impl EmgOrigin {
    /// The recordings in `dir` with default repetitions: train on 0 and 1, feed 2.
    pub fn recording(dir: impl Into<PathBuf>) -> EmgOrigin {
        EmgOrigin::Recording {
            dir: dir.into(),
            rate_hz: None,
            train_reps: default_train_reps(),
            feed_reps: default_feed_reps(),
            fill: false,
            faults: FaultPolicy::default(),
        }
    }

    /// The same with recordings that have faults, or without.
    pub fn with_faults(mut self, policy: FaultPolicy) -> EmgOrigin {
        if let EmgOrigin::Recording { faults, .. } = &mut self {
            *faults = policy;
        }
        self
    }

    /// The same for a folder that does not say its rate, Hz.
    pub fn at_rate(mut self, requested_hz: Option<f64>) -> EmgOrigin {
        if let EmgOrigin::Recording { rate_hz, .. } = &mut self {
            *rate_hz = requested_hz;
        }
        self
    }
}

fn default_train_reps() -> Vec<u32> {
    vec![0, 1]
}

fn default_feed_reps() -> Vec<u32> {
    vec![2]
}

/// A trained classifier, and the stream that it will see.
#[derive(Clone, Debug)]
pub struct EmgSetup {
    /// Trained on all gestures of the source.
    pub classifier: Classifier,
    /// The armband during the trial.
    pub feed: EmgFeed,
    /// Settings that fit the stream's rate and channels.
    pub config: EmgConfig,
    /// Zero level of each channel of the feed, for the pipeline to subtract; empty for one that is centred.
    pub dc_offset: Vec<f64>,
    /// For display and results: `recording`, `synthetic` or `recording+synthetic`.
    pub label: String,
    /// What was found in the recordings and accepted.
    pub findings: Vec<RecordingFault>,
}

/// [`prepare_emg_with`] default settings.
///
/// # Errors
/// As [`prepare_emg_with`].
pub fn prepare_emg(source: &EmgOrigin, seed: u64) -> Result<EmgSetup, DeviceError> {
    prepare_emg_with(source, None, seed)
}

/// Default settings for the stream of `source`: its rate, channels and rest gesture.
///
/// # Errors
/// A folder that cannot be used.
pub fn default_config(source: &EmgOrigin) -> Result<EmgConfig, DeviceError> {
    let (rate_hz, channels, rest) = match source {
        EmgOrigin::Synthetic => {
            (SYNTHETIC_RATE_HZ, SyntheticModel::shipped()?.channels(), Gesture::default())
        }
        EmgOrigin::Recording { dir, rate_hz, .. } => {
            let recordings = Recordings::open(dir, *rate_hz)?;
            (recordings.rate_hz, recordings.channels, recordings.rest)
        }
    };
    Ok(EmgConfig { rate_hz, channels, rest, ..EmgConfig::default() })
}

/// Reads or generates the recordings of `source`, trains the classifier, and opens the feed; with default settings if
/// there are none. Synthetic EMG for training and for feeding comes from different random streams of `seed`.
///
/// # Errors
/// A folder that cannot be used, a lacking gesture or repetition, settings that cannot work, or another rate or number of
/// channels than the source has.
pub fn prepare_emg_with(
    source: &EmgOrigin,
    config: Option<&EmgConfig>,
    seed: u64,
) -> Result<EmgSetup, DeviceError> {
    match source {
        EmgOrigin::Synthetic => {
            let recordings = Recordings {
                path: PathBuf::new(),
                rate_hz: SYNTHETIC_RATE_HZ,
                channels: SyntheticModel::shipped()?.channels(),
                imu: Vec::new(),
                expected: Command::ALL.map(Gesture::from).into(),
                rest: Gesture::default(),
                items: Vec::new(),
                notes: Vec::new(),
                unknown_rate_keys: Vec::new(),
            };
            train_and_open_feed(recordings, &default_train_reps(), &[], true, "synthetic", config, seed)
        }
        EmgOrigin::Recording { dir, rate_hz, train_reps, feed_reps, fill, faults } => {
            let recordings = Recordings::open(dir, *rate_hz)?;
            let missing = recordings.missing();
            if !missing.is_empty() && !fill {
                return Err(DeviceError::MissingGestures { path: dir.clone(), missing });
            }
            let findings = recordings.check_faults(&[&train_reps[..], feed_reps].concat(), *faults)?;
            let label = if missing.is_empty() { "recording" } else { "recording+synthetic" };
            let filled = !missing.is_empty();
            let setup = train_and_open_feed(recordings, train_reps, feed_reps, filled, label, config, seed)?;
            Ok(EmgSetup { findings, ..setup })
        }
    }
}

/// [`prepare_emg`] with a model that was trained before, in place of training one; with its settings if there are none.
///
/// # Errors
/// As [`prepare_emg`], and [`proact_emg::EmgError::DoesNotFit`] if the feed has other channels, another rate or another zero
/// level than the model, [`proact_emg::EmgError::TrainedOtherwise`] if the settings are not those of its training.
pub fn prepare_model(
    source: &EmgOrigin,
    model: &EmgModel,
    config: Option<&EmgConfig>,
    seed: u64,
) -> Result<EmgSetup, DeviceError> {
    let setup = prepare_emg(source, seed)?;
    let (rate_hz, channels) = (setup.config.rate_hz, setup.config.channels);
    // A relaxed hand on a copy of the feed tells where it rests.
    let mut probe = setup.feed.clone();
    let mut rest = vec![Vec::new(); channels];
    for tick in 0..REST_MILLIS {
        for sample in probe.sample_at(SimTime(tick), probe.gesture_for(Command::NoMotion)) {
            rest.iter_mut().zip(&sample.channels).for_each(|(values, value)| values.push(*value));
        }
    }
    let median = |mut values: Vec<f64>| {
        values.sort_unstable_by(f64::total_cmp);
        values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
    };
    let rest_medians = Some(rest.into_iter().map(median).collect());
    // The samples of a trial that is fed come without an inertial measurement unit.
    model.check_stream_format(&StreamFormat { rate_hz, channels, rest_medians, imu: Vec::new() })?;
    let dc_offset =
        if model.dc_offset.iter().all(|level| *level == 0.0) { Vec::new() } else { model.dc_offset.clone() };
    let classifier = model.classifier.clone();
    let config = match config {
        Some(requested) => requested.clone(),
        None => EmgConfig { liveness: model.liveness(None), ..model.config.clone() },
    };
    model.check_settings(&config)?;
    let feed = setup.feed.with_cocontraction_of(&config)?;
    Ok(EmgSetup { classifier, feed, config, dc_offset, label: setup.label, findings: setup.findings })
}

/// Length of rest in which the zero level of a feed is measured.
const REST_MILLIS: u64 = 1000;

/// As the gForce Pro+ in ProACT's setting (arXiv:2407.05025).
const SYNTHETIC_RATE_HZ: f64 = 1000.0;
/// Length of a synthetic training repetition, as ProACT's calibration (same source).
const SYNTHETIC_SECS: f64 = 3.0;

fn train_and_open_feed(
    mut recordings: Recordings,
    train_reps: &[u32],
    feed_reps: &[u32],
    synthetic: bool,
    label: &str,
    config: Option<&EmgConfig>,
    seed: u64,
) -> Result<EmgSetup, DeviceError> {
    let (rate_hz, channels, rest) = (recordings.rate_hz, recordings.channels, recordings.rest);
    let mut config = config.cloned().unwrap_or(EmgConfig { rate_hz, channels, rest, ..EmgConfig::default() });
    if (config.rate_hz, config.channels) != (rate_hz, channels) {
        return Err(DeviceError::StreamMismatch {
            asked: (config.rate_hz, config.channels),
            stream: (rate_hz, channels),
        });
    }
    let filling =
        if synthetic { Some(matched_generator(&recordings, seed, "emg/synthetic/feed")?) } else { None };
    let feed = EmgFeed::new(&recordings, feed_reps, filling, seed)?.with_cocontraction_of(&config)?;
    if synthetic {
        let mut generator = matched_generator(&recordings, seed, "emg/synthetic/train")?;
        fill_missing_gestures(&mut recordings, train_reps, &mut generator)?;
    }
    let classifier = train_classifier(&recordings, train_reps, &config)?;
    if config.liveness.noise_floors.is_empty() {
        config.liveness.noise_floors = training_noise_floors(&recordings, train_reps, &config);
    }
    let label = label.to_owned();
    Ok(EmgSetup { classifier, feed, config, dc_offset: Vec::new(), label, findings: Vec::new() })
}

/// A generator for the stream of `recordings`, as strong as they are: the scale is the ratio of amplitudes over
/// the gestures that were recorded.
fn matched_generator(recordings: &Recordings, seed: u64, name: &str) -> Result<SyntheticEmg, DeviceError> {
    let model = SyntheticModel::shipped()?;
    // What only the recordings have says nothing about the ratio.
    let gestures: Vec<Command> =
        recordings.gestures().into_iter().filter_map(Gesture::same_named_command).collect();
    let mean =
        |of: &dyn Fn(Command) -> f64| gestures.iter().map(|g| of(*g)).sum::<f64>() / gestures.len() as f64;
    let scale = if gestures.is_empty() {
        1.0
    } else {
        mean(&|g| recorded_rms(recordings, g.into())) / mean(&|g| model.rms(g))
    };
    SyntheticEmg::new(&model, recordings.rate_hz, recordings.channels, scale, random_stream(seed, name))
}

fn recorded_rms(recordings: &Recordings, gesture: Gesture) -> f64 {
    let of_gesture = recordings.items.iter().filter(|r| r.gesture == gesture);
    let (mut sum, mut count) = (0.0, 0_u64);
    for value in of_gesture.flat_map(|r| r.samples.iter().flatten()) {
        sum += value * value;
        count += 1;
    }
    (sum / count.max(1) as f64).sqrt()
}

/// Adds synthetic repetitions `reps` of all gestures that were not recorded.
///
/// # Errors
/// A gesture that the generator has no figures for.
fn fill_missing_gestures(
    recordings: &mut Recordings,
    reps: &[u32],
    generator: &mut SyntheticEmg,
) -> Result<(), DeviceError> {
    check_synthesizable(recordings)?;
    let samples = (SYNTHETIC_SECS * recordings.rate_hz).round() as usize;
    for gesture in recordings.missing().into_iter().filter_map(Gesture::same_named_command) {
        for &repetition in reps {
            recordings.items.push(Recording {
                repetition,
                gesture: gesture.into(),
                samples: (0..samples).map(|_| generator.next(gesture)).collect(),
                bridged: Vec::new(),
                path: Path::new("synthetic").to_owned(),
            });
        }
    }
    Ok(())
}

/// How quiet the channels are in the repetitions that the classifier is trained on.
fn training_noise_floors(recordings: &Recordings, reps: &[u32], config: &EmgConfig) -> Vec<f64> {
    let trained = recordings.items.iter().filter(|recording| reps.contains(&recording.repetition));
    let samples: Vec<Vec<EmgSample>> =
        trained.map(|recording| recording.numbered_samples().collect()).collect();
    let slices = samples.iter().map(Vec::as_slice);
    noise_floors(&config.liveness, config.rate_hz, config.channels, slices)
}

/// Trains on repetitions `reps` of all gestures in `recordings`. Windows never span two recordings.
///
/// # Errors
/// No repetitions, one that is missing or shorter than a window, or data that no classifier can be trained on.
pub fn train_classifier(
    recordings: &Recordings,
    reps: &[u32],
    config: &EmgConfig,
) -> Result<Classifier, DeviceError> {
    if reps.is_empty() {
        return Err(DeviceError::NoRepetitions { purpose: "train on" });
    }
    let (mut windows, mut labels) = (Vec::new(), Vec::new());
    for &rep in reps {
        for gesture in recordings.gestures() {
            let recording = recordings.find(gesture, rep)?;
            windows.extend(recording.windows(config)?);
            labels.resize(windows.len(), gesture);
        }
    }
    Ok(Classifier::train(config, &windows, &labels)?)
}

impl Recording {
    /// Features of every window.
    ///
    /// # Errors
    /// Settings that do not fit, or fewer samples than a window.
    pub fn windows(&self, config: &EmgConfig) -> Result<Vec<proact_emg::FeatureVector>, DeviceError> {
        Ok(extract_features(config, &self.checked_samples(config)?)?)
    }

    /// What a decoder is told of every window.
    ///
    /// # Errors
    /// As [`Recording::windows`].
    pub fn window_inputs(&self, config: &EmgConfig) -> Result<Vec<DecoderInput>, DeviceError> {
        Ok(extract_decoder_inputs(config, &self.checked_samples(config)?)?)
    }

    /// The samples, of which there is at least a window.
    fn checked_samples(&self, config: &EmgConfig) -> Result<Vec<EmgSample>, DeviceError> {
        let window = config.window_samples()?;
        if self.samples.len() < window {
            let (path, samples) = (self.path.clone(), self.samples.len());
            return Err(DeviceError::TooShort { path, samples, window });
        }
        Ok(self.numbered_samples().collect())
    }
}
