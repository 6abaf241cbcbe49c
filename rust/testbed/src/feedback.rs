use crate::ConfigError;
use proact_types::{Cue, Tone, Vibration, format_number};
use serde::{Deserialize, Serialize};

/// Most mappings of a trial.
const MAX_MAPPINGS: usize = 32;
/// Values that go on are said at most this often, Hz: what a vibrating motor follows, and as the display.
const MAX_RATE_HZ: f64 = 60.0;

/// A way from what happens to what a person is to hear and feel.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "from", rename_all = "snake_case", deny_unknown_fields)]
pub enum FeedbackMapping {
    /// A cue at an event.
    Event {
        /// Which event.
        event: CueEvent,
        /// What is to be heard.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        sound: Option<Tone>,
        /// What is to be felt.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        vibration: Option<Vibration>,
    },
    /// The force of each digit on blocks, as the strength of a vibration.
    Pressure {
        /// Force at which the strength is one, N.
        full_n: f64,
        /// Forces below say nothing, N.
        #[serde(default)]
        threshold_n: f64,
        /// So often while the force lasts, Hz.
        #[serde(default = "FeedbackMapping::default_rate_hz")]
        rate_hz: f64,
    },
    /// The force of all digits together, as the height of a tone.
    Grip {
        /// The tone at the threshold, and at the full force, Hz.
        hz: [f64; 2],
        /// Force of the highest tone, N.
        full_n: f64,
        /// Forces below say nothing, N.
        #[serde(default)]
        threshold_n: f64,
        /// So often while the force lasts, Hz.
        #[serde(default = "FeedbackMapping::default_rate_hz")]
        rate_hz: f64,
    },
}

/// The events that can be heard and felt.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum CueEvent {
    /// The hand took hold of a block.
    ContactMade,
    /// The hand let go of a block.
    ContactLost,
    /// A block came to rest on its target.
    OnTarget,
    /// A block came to rest elsewhere.
    OffTarget,
}

impl From<CueEvent> for Cue {
    fn from(event: CueEvent) -> Self {
        match event {
            CueEvent::ContactMade => Cue::ContactMade,
            CueEvent::ContactLost => Cue::ContactLost,
            CueEvent::OnTarget => Cue::OnTarget,
            CueEvent::OffTarget => Cue::OffTarget,
        }
    }
}

impl FeedbackMapping {
    fn default_rate_hz() -> f64 {
        30.0
    }

    /// What a trial has unless it says otherwise. The tones are our own choice: up for contact, down for its loss.
    pub fn standard() -> Vec<Self> {
        let cue = |event, hz, strength: Option<f64>| Self::Event {
            event,
            sound: Some(Tone { hz, ms: 150 }),
            vibration: strength.map(|strength| Vibration { strength, ms: 150 }),
        };
        vec![
            cue(CueEvent::ContactMade, [440.0, 660.0], Some(1.0)),
            cue(CueEvent::ContactLost, [660.0, 440.0], Some(0.5)),
            cue(CueEvent::OnTarget, [880.0, 880.0], None),
            cue(CueEvent::OffTarget, [220.0, 220.0], None),
        ]
    }

    /// Checks the ranges of a trial's mappings.
    ///
    /// # Errors
    /// [`ConfigError::Value`] naming the first number that is out of range.
    pub fn check(mappings: &[Self]) -> Result<(), ConfigError> {
        let bad = |key, got: String, expected| Err(ConfigError::Value { key, got, expected });
        if mappings.len() > MAX_MAPPINGS {
            return bad("feedback", format!("{} mappings", mappings.len()), "at most 32");
        }
        let is_audible = |hz: &[f64; 2]| hz.iter().all(|hz| (20.0..=20_000.0).contains(hz));
        for mapping in mappings {
            let force = match mapping {
                Self::Event { sound, vibration, .. } => {
                    let lasts = |ms: u32| (1..=10_000).contains(&ms);
                    if let Some(tone) = sound.filter(|tone| !is_audible(&tone.hz) || !lasts(tone.ms)) {
                        return bad(
                            "feedback.sound",
                            format!("{tone:?}"),
                            "hz from 20 to 20000, ms from 1 to 10000",
                        );
                    }
                    let felt = |v: &Vibration| (0.0..=1.0).contains(&v.strength) && lasts(v.ms);
                    if let Some(buzz) = vibration.filter(|buzz| !felt(buzz)) {
                        return bad(
                            "feedback.vibration",
                            format!("{buzz:?}"),
                            "strength from 0 to 1, ms from 1 to 10000",
                        );
                    }
                    continue;
                }
                Self::Grip { hz, .. } if !is_audible(hz) => {
                    return bad("feedback.hz", format!("{hz:?}"), "20 to 20000");
                }
                Self::Grip { full_n, threshold_n, rate_hz, .. }
                | Self::Pressure { full_n, threshold_n, rate_hz } => (*full_n, *threshold_n, *rate_hz),
            };
            let (full, threshold, rate) = force;
            if !(0.001..=1000.0).contains(&full) {
                return bad("feedback.full_n", format_number(full), "0.001 to 1000");
            }
            if !(0.0..full).contains(&threshold) {
                return bad(
                    "feedback.threshold_n",
                    format_number(threshold),
                    "0 or more, and less than full_n",
                );
            }
            if !(1.0..=MAX_RATE_HZ).contains(&rate) {
                return bad("feedback.rate_hz", format_number(rate), "1 to 60");
            }
        }
        Ok(())
    }
}
