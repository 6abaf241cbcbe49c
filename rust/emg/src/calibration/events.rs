use crate::{ChannelFault, ChannelStatus};
use proact_types::{EmgSample, Gesture};
use serde::{Deserialize, Serialize};

/// What the person is asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
pub struct Prompt {
    /// The gesture.
    pub gesture: Gesture,
    /// Which repetition of it, from 0.
    pub repetition: usize,
}

/// What the session is doing.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
#[serde(tag = "name", rename_all = "snake_case")]
pub enum CalibrationPhase {
    /// A channel or the stream is red, or no samples come: the prompt waits.
    Blocked {
        /// What comes next.
        prompt: Prompt,
    },
    /// The gesture is shown; the recording begins in so many seconds.
    Preparing {
        /// What is asked for.
        prompt: Prompt,
        /// Seconds until the recording begins.
        #[serde(rename = "left_secs")]
        remaining_secs: f64,
    },
    /// The gesture is being recorded.
    Recording {
        /// What is asked for.
        prompt: Prompt,
        /// Share recorded, 0 to 1.
        share: f64,
    },
    /// A round is over: look at the report, then proceed, record a gesture again, or finish.
    Reviewing,
    /// The model is made.
    Finished,
}

/// Why a repetition was not kept.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "reason", rename_all = "snake_case")]
pub enum RepetitionRejection {
    /// Too many samples were lost on the way, or one was unusable.
    Gap {
        /// Samples lost in this repetition; 0 for one with a NaN or another number of channels.
        lost: u64,
    },
    /// Samples stopped coming.
    Silence,
    /// A sensor of the inertial measurement unit that decisions need said nothing, or the same all the time.
    Imu,
    /// Channels were red.
    Red {
        /// Which, from 0, and why.
        channels: Vec<(usize, Option<ChannelFault>)>,
        /// The stream as a whole was red: losses or a wrong rate.
        stream: bool,
    },
}

/// What happened in a step.
#[derive(Clone, Debug, PartialEq)]
pub enum CalibrationEvent {
    /// The person is asked for a gesture.
    Prompted(Prompt),
    /// Recording began.
    Recording(Prompt),
    /// The repetition was kept.
    RepetitionAccepted(Prompt),
    /// The repetition was not kept, and the same prompt comes again.
    RepetitionRejected(Prompt, RepetitionRejection),
    /// The prompt waits: red, or no samples.
    Blocked(Prompt, RepetitionRejection),
    /// All gestures of a round were recorded. There is a report from the second round on.
    RoundFinished,
}

/// A repetition that was kept: raw codes, and the worst light while it was recorded.
#[derive(Clone, Debug, PartialEq)]
pub struct Repetition {
    /// What the person was asked for.
    pub gesture: Gesture,
    /// Raw codes; counters rise by one, and step over samples that were lost.
    pub samples: Vec<EmgSample>,
    /// The worst light; never red.
    pub status: ChannelStatus,
}
