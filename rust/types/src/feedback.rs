use crate::SimTime;
use serde::{Deserialize, Serialize};

/// What a person is to hear and feel, as data: who drives a loudspeaker or a vibrating band decides how.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
pub struct FeedbackCue {
    /// When.
    pub time: SimTime,
    /// Why.
    pub cue: Cue,
    /// The digit that it is about; none if it is about none alone.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "ts", ts(optional))]
    pub digit: Option<Digit>,
    /// What is to be heard.
    pub sound: Option<Tone>,
    /// What is to be felt.
    pub vibration: Option<Vibration>,
}

/// The occasions for a cue.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
#[serde(rename_all = "snake_case")]
pub enum Cue {
    /// The hand took hold of a block.
    ContactMade,
    /// The hand let go of a block.
    ContactLost,
    /// A block came to rest on its target.
    OnTarget,
    /// A block came to rest elsewhere.
    OffTarget,
    /// A digit presses on a block; again and again while it does.
    Pressure,
    /// The digits together press on blocks; again and again while they do.
    Grip,
}

/// A digit of the hand.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
pub struct Digit {
    /// Its place among the hand's digits, from 0, in the order of the description.
    pub number: u8,
    /// Its first link.
    pub link: String,
}

/// A tone.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
#[serde(deny_unknown_fields)]
pub struct Tone {
    /// Hz at the beginning, and at the end: it glides.
    pub hz: [f64; 2],
    /// Milliseconds.
    pub ms: u32,
}

/// A buzz.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
#[serde(deny_unknown_fields)]
pub struct Vibration {
    /// 0 to 1. Zero ends the one before.
    pub strength: f64,
    /// Milliseconds; a later one for the same digit takes its place.
    pub ms: u32,
}

/// A link that touches blocks, as shown.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
pub struct ContactView {
    /// Its name.
    pub link: String,
    /// The sum of its normal forces on them, N.
    pub force: f64,
}
