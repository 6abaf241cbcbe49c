use crate::OutOfRange;
use serde::{Deserialize, Serialize};

/// What a simulated person is like in one trial, beside reaction, blinks and timing. The default is nobody: no delays and
/// no errors.
///
/// Every number has its source here, or is said to be assumed; `docs/simulated-participants.md` has the values
/// that a population draws. Nothing here is evidence about people.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PersonTraits {
    /// Median time to decide what to do next: which joint or axis, or the next step of a selection, ms. Assumed.
    pub decision_time_ms: u64,
    /// Spread of that time from one decision to the next: standard deviation of its logarithm. Assumed.
    pub decision_time_log_sd: f64,
    /// How often in a minute of muscle work the classifier begins to take a gesture for another one. Assumed. Errors come
    /// in bursts: independent ones are filtered out by three equal decisions.
    pub confusions_per_min: f64,
    /// Mean length of such a burst, ms. Assumed.
    pub confusion_burst_ms: u64,
    /// Share of the decisions in a burst that go to the neighbouring gesture. Assumed.
    pub confused_decision_share: f64,
    /// The rate grows by this share for each 25 degrees that the trunk leans. Assumed.
    pub confusion_gain_per_25_deg: f64,
    /// From the wish to look elsewhere to the eye being there, ms (saccade latency, about 200).
    pub saccade_ms: u64,
    /// Share of the time with the eyes on the hand while something moves. Assumed.
    pub hand_glance_share: f64,
    /// Width and height of what the headset shows, degrees (HoloLens 2: 43 and 29). What is outside is remembered.
    pub field_of_view_deg: [f64; 2],
    /// Standard deviation of the error in depth with which an object is seen, metres along the line of sight. Assumed.
    pub depth_error_m: f64,
    /// Chance that the direction in which a gesture moves a joint or an axis is known before it was seen to move. Assumed.
    pub learned_directions: f64,
    /// Chance of the wrong direction once it is known. Assumed.
    pub wrong_direction_probability: f64,
    /// Spread of the guess how fast a joint or an axis moves: standard deviation of its logarithm. Assumed.
    pub speed_estimate_log_sd: f64,
    /// Share of the person's own delay for which the end of a movement is anticipated, 0 to 1. Assumed.
    pub anticipation: f64,
    /// A long movement is ended by what is seen of it, and not after the time that it was thought to take. Assumed.
    pub visual_stop: bool,
    /// Standard deviation of an imagined movement, as a share of it. Assumed.
    pub forward_model_relative_error: f64,
    /// Chance that the trunk makes a correction that it is able to make, instead of the arm. Assumed.
    pub trunk_share: f64,
    /// Chance to notice, at one look, that something other than what is meant is highlighted, or that a marker is off.
    /// Assumed.
    pub error_detection_probability: f64,
    /// Chance to forget to lock a selection before WE. Assumed.
    pub lock_omission_probability: f64,
    /// Chance to let go of WE before the arm has arrived, taking it for arrived. Assumed.
    pub early_release_probability: f64,
}

impl Default for PersonTraits {
    fn default() -> Self {
        Self {
            decision_time_ms: 0,
            decision_time_log_sd: 0.0,
            confusions_per_min: 0.0,
            confusion_burst_ms: 700,
            confused_decision_share: 0.8,
            confusion_gain_per_25_deg: 0.0,
            saccade_ms: 0,
            hand_glance_share: 0.0,
            field_of_view_deg: [360.0, 180.0],
            depth_error_m: 0.0,
            learned_directions: 1.0,
            wrong_direction_probability: 0.0,
            speed_estimate_log_sd: 0.0,
            anticipation: 1.0,
            visual_stop: false,
            forward_model_relative_error: 0.0,
            trunk_share: 0.0,
            error_detection_probability: 1.0,
            lock_omission_probability: 0.0,
            early_release_probability: 0.0,
        }
    }
}

impl PersonTraits {
    /// True for the default: nobody in particular.
    pub fn is_default(&self) -> bool {
        *self == Self::default()
    }

    /// Checks ranges.
    ///
    /// # Errors
    /// The first key that is out of range.
    pub fn check(&self) -> Result<(), OutOfRange> {
        let refused = |key, got: String, expected| Err(OutOfRange { key, got, expected });
        let times = [
            ("participant.person.decision_time_ms", self.decision_time_ms),
            ("participant.person.confusion_burst_ms", self.confusion_burst_ms),
            ("participant.person.saccade_ms", self.saccade_ms),
        ];
        for (key, got) in times {
            if got > 60_000 {
                return refused(key, got.to_string(), "0 to 60000");
            }
        }
        let shares = [
            ("participant.person.confused_decision_share", self.confused_decision_share),
            ("participant.person.hand_glance_share", self.hand_glance_share),
            ("participant.person.learned_directions", self.learned_directions),
            ("participant.person.wrong_direction_probability", self.wrong_direction_probability),
            ("participant.person.anticipation", self.anticipation),
            ("participant.person.trunk_share", self.trunk_share),
            ("participant.person.error_detection_probability", self.error_detection_probability),
            ("participant.person.lock_omission_probability", self.lock_omission_probability),
            ("participant.person.early_release_probability", self.early_release_probability),
        ];
        for (key, got) in shares {
            if !(0.0..=1.0).contains(&got) {
                return refused(key, got.to_string(), "0 to 1");
            }
        }
        let spreads = [
            ("participant.person.decision_time_log_sd", self.decision_time_log_sd, 0.0..=3.0, "0 to 3"),
            ("participant.person.confusions_per_min", self.confusions_per_min, 0.0..=600.0, "0 to 600"),
            (
                "participant.person.confusion_gain_per_25_deg",
                self.confusion_gain_per_25_deg,
                0.0..=20.0,
                "0 to 20",
            ),
            ("participant.person.depth_error_m", self.depth_error_m, 0.0..=0.2, "0 to 0.2"),
            ("participant.person.speed_estimate_log_sd", self.speed_estimate_log_sd, 0.0..=3.0, "0 to 3"),
            (
                "participant.person.forward_model_relative_error",
                self.forward_model_relative_error,
                0.0..=2.0,
                "0 to 2",
            ),
        ];
        for (key, got, allowed, expected) in spreads {
            if !allowed.contains(&got) {
                return refused(key, got.to_string(), expected);
            }
        }
        let [width, height] = self.field_of_view_deg;
        if !((5.0..=360.0).contains(&width) && (5.0..=180.0).contains(&height)) {
            let got = format!("{:?}", self.field_of_view_deg);
            return refused(
                "participant.person.field_of_view_deg",
                got,
                "a width of 5 to 360 and a height of 5 to 180",
            );
        }
        Ok(())
    }
}
