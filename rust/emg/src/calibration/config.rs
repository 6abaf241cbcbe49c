use crate::{EmgConfig, EmgError, QualityConfig};
use proact_types::{Command, Gesture, MAX_GESTURES};
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;

/// Where zero is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum DcOffsetSource {
    /// The median of each channel over all repetitions at rest: makers disagree about theirs.
    #[default]
    RestMedian,
    /// The same for all channels.
    Fixed(f64),
}

/// How a calibration is done.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CalibrationConfig {
    /// The stream, and what is trained on it.
    pub emg: EmgConfig,
    /// Gestures of a round, in the order of the prompts. Default: all five, rest first.
    pub gestures: Vec<Gesture>,
    /// Positions of the limb, by names that people understand: each round is recorded in one of them, in turn. Default none: people sit
    /// as in the trials.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub positions: Vec<String>,
    /// Length of a repetition, seconds. Default 3 (ProACT, arXiv:2407.05025).
    pub repetition_secs: f64,
    /// From the prompt to the start of the recording, seconds: the hand should be in the gesture by then. Default 2
    /// (no source has a number that includes the movement).
    pub prepare_secs: f64,
    /// Rounds before it can be good enough, at least 2. Default 2 (same source).
    #[serde(rename = "least_rounds")]
    pub min_rounds: usize,
    /// Rounds after which no more are offered. Default 8: more tire the arm.
    #[serde(rename = "most_rounds")]
    pub max_rounds: usize,
    /// Share of windows to be recognised, leaving one repetition out. Default 0.9 (no source has a number; two
    /// repetitions of practised people give 0.89 in the mean).
    pub target_accuracy: f64,
    /// The same for each gesture alone. Default 0.75.
    pub target_recall: f64,
    /// With a regressor, in the place of both: R2 of each degree of freedom, leaving one repetition out. Default 0.6 [assumed].
    pub target_r2: f64,
    /// Where zero is. Default: the median at rest.
    #[serde(rename = "zero")]
    pub dc_offset: DcOffsetSource,
    /// The zero level by the device's maker, for the lights before anything has been recorded.
    #[serde(rename = "nominal_zero")]
    pub nominal_dc_offset: f64,
    /// Share of a repetition that may be lost, at most, in gaps no longer than [`crate::GapInterpolationConfig::max_gap_ms`].
    /// Default 0.05. Windows with a gap in them are not trained on.
    #[serde(rename = "most_lost")]
    pub max_lost_share: f64,
    /// Limits of the traffic lights; rails are raw codes less the nominal zero.
    pub quality: QualityConfig,
}

impl Default for CalibrationConfig {
    fn default() -> Self {
        let emg = EmgConfig::default();
        let five = Command::ALL.map(Gesture::from);
        CalibrationConfig {
            gestures: CalibrationConfig::round(&five, emg.rest),
            emg,
            positions: Vec::new(),
            repetition_secs: 3.0,
            prepare_secs: 2.0,
            min_rounds: 2,
            max_rounds: 8,
            target_accuracy: 0.9,
            target_recall: 0.75,
            target_r2: 0.6,
            dc_offset: DcOffsetSource::RestMedian,
            nominal_dc_offset: 0.0,
            max_lost_share: 0.05,
            quality: QualityConfig::default(),
        }
    }
}

impl CalibrationConfig {
    /// The gestures in the order of a round: rest, then what moves.
    pub fn round(gestures: &[Gesture], rest: Gesture) -> Vec<Gesture> {
        let rested = gestures.iter().copied().filter(|gesture| *gesture == rest);
        rested.chain(prompted_gestures(gestures, rest)).collect()
    }

    /// Checks every value.
    ///
    /// # Errors
    /// The first that cannot work.
    pub fn check(&self) -> Result<(), EmgError> {
        self.emg.check()?;
        let refused = |name, value, expected| Err(EmgError::OutOfRange { name, value, expected });
        for (k, gesture) in self.gestures.iter().enumerate() {
            if self.gestures[..k].contains(gesture) {
                return Err(EmgError::RepeatedGesture { gesture: *gesture });
            }
        }
        if self.gestures.len() > MAX_GESTURES {
            return Err(EmgError::TooManyClasses { got: self.gestures.len() });
        }
        if self.gestures.len() < 2 {
            return Err(EmgError::TooFewClasses { got: self.gestures.len() });
        }
        if !(0.5..=60.0).contains(&self.repetition_secs) {
            return refused("repetition_secs", self.repetition_secs, "0.5 to 60");
        }
        if !(0.0..=60.0).contains(&self.prepare_secs) {
            return refused("prepare_secs", self.prepare_secs, "0 to 60");
        }
        if self.max_rounds == 0 || self.max_rounds > 100 {
            return refused("most_rounds", self.max_rounds as f64, "1 to 100");
        }
        let readable = |name: &String| (1..=64).contains(&name.len()) && !name.contains(char::is_control);
        let distinct: BTreeSet<&String> = self.positions.iter().collect();
        if distinct.len() < self.positions.len() || !self.positions.iter().all(readable) {
            return Err(EmgError::Positions { got: self.positions.clone() });
        }
        // Each position twice, so that one repetition can be left out and the others know its position.
        if 2 * self.positions.len() > self.max_rounds {
            return refused(
                "most_rounds",
                self.max_rounds as f64,
                "two rounds for each position of the limb",
            );
        }
        for (name, share) in [
            ("target_accuracy", self.target_accuracy),
            ("target_recall", self.target_recall),
            ("target_r2", self.target_r2),
            ("most_lost", self.max_lost_share),
        ] {
            if !(0.0..=1.0).contains(&share) {
                return refused(name, share, "0 to 1");
            }
        }
        let (window, recorded) = (self.emg.window_samples()?, self.samples());
        if recorded < window {
            return refused("repetition_secs", self.repetition_secs, "at least the length of a window");
        }
        Ok(())
    }

    /// Rounds before it can be good enough: each position of the limb twice, if there are some.
    pub fn needed_rounds(&self) -> usize {
        self.min_rounds.max(2 * self.positions.len())
    }

    /// The position of the limb of repetition `repetition` of a gesture; none if none are named.
    pub fn position_of(&self, repetition: usize) -> Option<&str> {
        let index = repetition.checked_rem(self.positions.len())?;
        Some(&self.positions[index])
    }

    /// Whether `gap` lost samples in a row, of `lost` in all, are few enough for a repetition of `samples`.
    pub(super) fn gap_is_acceptable(&self, gap: u64, lost: u64, samples: usize) -> bool {
        let max_gap = self.emg.gap_interpolation.max_gap_ms as f64 * self.emg.rate_hz / 1000.0;
        gap as f64 <= max_gap && lost as f64 <= self.max_lost_share * samples as f64
    }

    /// Samples of a repetition.
    pub(super) fn samples(&self) -> usize {
        (self.repetition_secs * self.emg.rate_hz).round() as usize
    }
}

/// The gestures but `rest` in the order in which people are asked for them: the four of the paper as opposite pairs, then
/// all others as they stand.
pub(crate) fn prompted_gestures(gestures: &[Gesture], rest: Gesture) -> impl Iterator<Item = Gesture> {
    use Command::{HandClose, HandOpen, WristExtension, WristFlexion};
    let pairs = [HandClose, HandOpen, WristFlexion, WristExtension].map(Gesture::from);
    let known = pairs.into_iter().filter(|gesture| gestures.contains(gesture));
    let others = gestures.iter().copied().filter(|gesture| !pairs.contains(gesture));
    let all: Vec<Gesture> = known.chain(others).filter(|gesture| *gesture != rest).collect();
    all.into_iter()
}
