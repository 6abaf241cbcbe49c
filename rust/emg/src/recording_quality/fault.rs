//! What can be wrong with recordings, and how bad it is.

use crate::{ChannelFault, ChannelStatus};
use proact_types::Gesture;
use serde::Serialize;

/// What is wrong with recordings, or with the newest seconds of a live stream. Channels count from 0; `files` are those in which it was found.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(tag = "fault", rename_all = "snake_case")]
pub enum RecordingFault {
    /// A channel that is dead, cut off or hums.
    Channel {
        /// Which channel.
        channel: usize,
        /// How bad it is where it is found.
        #[serde(rename = "light")]
        status: ChannelStatus,
        /// Why.
        finding: ChannelFault,
        /// In which recordings, gesture and repetition.
        recordings: Vec<(Gesture, u32)>,
        /// Recordings in all.
        #[serde(rename = "of")]
        recording_count: usize,
        /// The gesture or repetition that it covers while the others are better.
        #[serde(rename = "coincides")]
        coincidence: Option<Coincidence>,
        /// Their files.
        files: Vec<String>,
    },
    /// A channel is as loud at rest as in any gesture, and louder at rest than the others: no muscle drives it.
    Noisy {
        /// Which channel.
        channel: usize,
        /// Standard deviation at rest over the median of all channels.
        #[serde(rename = "times")]
        ratio: f64,
        /// Their files.
        files: Vec<String>,
    },
    /// A column only rises: time stamps or a counter, not a muscle.
    TimeStamps {
        /// Which channel.
        channel: usize,
        /// Their files.
        files: Vec<String>,
    },
    /// A column counts, and begins again: a sample or packet number, not a muscle.
    Counter {
        /// Which channel.
        channel: usize,
        /// Their files.
        files: Vec<String>,
    },
    /// A column holds one value in each recording, and not in all the same: a label, not a muscle.
    Label {
        /// Which channel.
        channel: usize,
        /// Their files.
        files: Vec<String>,
    },
    /// The level of a column tells the gesture: a label with noise, or one added to an electrode.
    LabelWithin {
        /// Which channel.
        channel: usize,
        /// Standard deviation of the levels of the gestures over that of a recording's samples.
        #[serde(rename = "times")]
        ratio: f64,
        /// Their files.
        files: Vec<String>,
    },
    /// Four columns keep their length together: an orientation (quaternion), not muscles.
    Orientation {
        /// Which channels.
        channels: Vec<usize>,
        /// The length.
        length: f64,
        /// Their files.
        files: Vec<String>,
    },
    /// Three columns keep their length together: an acceleration or a magnetic field, not muscles.
    Acceleration {
        /// Which channels.
        channels: Vec<usize>,
        /// The length.
        length: f64,
        /// Their files.
        files: Vec<String>,
    },
    /// A column moves slowly, as a limb does: no electrode, or one whose level drifts.
    Slow {
        /// Which channel.
        channel: usize,
        /// Share of its variance below 10 Hz, or within recordings below 15 Hz, whichever is larger.
        share: f64,
        /// At least half of the channels are slow: envelopes, or a converter without a high pass.
        #[serde(rename = "most")]
        is_majority_slow: bool,
        /// Their files.
        files: Vec<String>,
    },
    /// Rows repeat the one before in all channels: the device sent fewer samples than were written.
    #[serde(rename = "held")]
    RepeatedRows {
        /// Share of rows that repeat the one before, in the recordings that are named.
        share: f64,
        /// Most equal rows one after the other.
        #[serde(rename = "longest")]
        max_run: usize,
        /// Recordings in which rows are held.
        recordings: usize,
        /// Recordings in all.
        #[serde(rename = "of")]
        recording_count: usize,
        /// Their files.
        files: Vec<String>,
    },
    /// Channels keep their value, but for the last digit, while others go on: a slower reader held them.
    #[serde(rename = "held_channels")]
    RepeatedSamples {
        /// Which channels.
        channels: Vec<usize>,
        /// Share of their samples that are held, above what a muscle has by chance; the largest.
        share: f64,
        /// Their files.
        files: Vec<String>,
    },
    /// Samples of channels lie on straight lines between fewer true ones.
    Interpolated {
        /// Which channels.
        channels: Vec<usize>,
        /// Share of their samples that lie on a line, above what a muscle has by chance; the largest.
        share: f64,
        /// Their files.
        files: Vec<String>,
    },
    /// The same samples stand in two recordings: what is tested was trained on.
    #[serde(rename = "shared")]
    CopiedRecording {
        /// The earlier recording, gesture and repetition.
        first: (Gesture, u32),
        /// The later one.
        second: (Gesture, u32),
        /// Samples of the later one that stand in the earlier one too.
        samples: usize,
        /// Samples of the later one.
        #[serde(rename = "of")]
        later_samples: usize,
        /// The file of the earlier and that of the later.
        files: Vec<String>,
    },
    /// A recording is another one of its gesture, altered: with noise, at another speed, filtered, backwards, with the channels
    /// moved on.
    AlteredCopy {
        /// The earlier recording, gesture and repetition.
        first: (Gesture, u32),
        /// The later one.
        second: (Gesture, u32),
        /// Correlation of the fluctuations of their loudness.
        correlation: f64,
        /// How many times as fast the earlier one is played where they are most alike.
        speed: f64,
        /// The later one runs backwards.
        backwards: bool,
        /// Channel c of the earlier one is channel c + rotation of the later one.
        rotation: usize,
        /// The file of the earlier and that of the later.
        files: Vec<String>,
    },
    /// A live stream is far louder or quieter than the training of its model: another unit or gain.
    #[serde(rename = "other_range")]
    AmplitudeMismatch {
        /// How many times as loud as the loudest recording of the training, the median of the channels.
        #[serde(rename = "times")]
        ratio: f64,
    },
    /// A live stream has another rate than its source says.
    #[serde(rename = "other_rate")]
    RateMismatch {
        /// Samples per second by the device's counter and the host's clock.
        measured_hz: f64,
        /// What the source says.
        nominal_hz: f64,
    },
    /// The rate was assumed although the metadata seems to say it under an unknown key.
    #[serde(rename = "rate_key")]
    UnknownRateKey {
        /// Which keys.
        keys: Vec<String>,
        /// What was assumed, Hz.
        assumed_hz: f64,
    },
}

/// With what a fault of a channel coincides: a gesture that is recognised by the fault, or a repetition that is tested or
/// trained on with another set of channels than the others.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Coincidence {
    /// Most recordings of this gesture.
    Gesture(Gesture),
    /// Most recordings of this repetition.
    Repetition(u32),
}

impl RecordingFault {
    /// Whether it is the same finding, whatever its figures are: of the same kind and channels.
    pub(crate) fn is_same_finding(&self, other: &RecordingFault) -> bool {
        core::mem::discriminant(self) == core::mem::discriminant(other) && self.channels() == other.channels()
    }

    /// The channels that it is about; none if it is about the whole stream, or about whole recordings.
    fn channels(&self) -> &[usize] {
        match self {
            RecordingFault::Channel { channel, .. }
            | RecordingFault::Noisy { channel, .. }
            | RecordingFault::TimeStamps { channel, .. }
            | RecordingFault::Counter { channel, .. }
            | RecordingFault::Label { channel, .. }
            | RecordingFault::LabelWithin { channel, .. }
            | RecordingFault::Slow { channel, .. } => core::slice::from_ref(channel),
            RecordingFault::Orientation { channels, .. }
            | RecordingFault::Acceleration { channels, .. }
            | RecordingFault::RepeatedSamples { channels, .. }
            | RecordingFault::Interpolated { channels, .. } => channels,
            RecordingFault::RepeatedRows { .. }
            | RecordingFault::CopiedRecording { .. }
            | RecordingFault::AlteredCopy { .. }
            | RecordingFault::AmplitudeMismatch { .. }
            | RecordingFault::RateMismatch { .. }
            | RecordingFault::UnknownRateKey { .. } => &[],
        }
    }

    /// Red: nothing should be trained on it or tested with it. Amber is said and used all the same: a channel that is dead or hums in no
    /// more than half of the recordings and not just in one gesture or repetition, a noisy one, and slow channels that are at least half
    /// of all.
    pub fn status(&self) -> ChannelStatus {
        match self {
            RecordingFault::Channel {
                status: light,
                recordings,
                recording_count: of,
                coincidence: None,
                ..
            } if 2 * recordings.len() <= *of => (*light).min(ChannelStatus::Amber),
            RecordingFault::Channel { status: light, .. } => *light,
            RecordingFault::Slow { is_majority_slow: true, .. } | RecordingFault::Noisy { .. } => {
                ChannelStatus::Amber
            }
            _ => ChannelStatus::Red,
        }
    }
}
