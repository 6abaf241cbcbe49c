use crate::{Command, Heartbeat, JointVector, PlanReply, Point, Pose, Vector};
use arrayvec::ArrayVec;
use serde::{Deserialize, Serialize};
use smallvec::SmallVec;

/// A stream of more EMG channels is refused as damaged. Amplifiers for grids of electrodes have up to 400.
pub const MAX_EMG_CHANNELS: usize = 512;

/// One value per EMG channel. Up to 16, as armbands have, lie in the value itself and need no memory of their own.
pub type ChannelValues = SmallVec<[f64; 16]>;

/// One sample of all EMG channels.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct EmgSample {
    /// The device's sample counter: a step of more than one is a gap.
    pub counter: u64,
    /// One value per channel, in the device's counts (or volts: LDA does not care, thresholds do).
    #[serde(with = "channel_values")]
    pub channels: ChannelValues,
}

/// Channels in logs: a sequence. One that says that it is longer than a stream can be is refused before memory is asked
/// for, since a damaged log may say anything.
mod channel_values {
    use super::{ChannelValues, MAX_EMG_CHANNELS};
    use serde::{Deserializer, Serializer, de};
    use std::fmt;

    pub(super) fn serialize<S: Serializer>(values: &ChannelValues, to: S) -> Result<S::Ok, S::Error> {
        to.collect_seq(values)
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<ChannelValues, D::Error> {
        from.deserialize_seq(ChannelValuesVisitor)
    }

    struct ChannelValuesVisitor;

    impl<'de> de::Visitor<'de> for ChannelValuesVisitor {
        type Value = ChannelValues;

        fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            write!(f, "at most {MAX_EMG_CHANNELS} channels")
        }

        fn visit_seq<A: de::SeqAccess<'de>>(self, mut sequence: A) -> Result<ChannelValues, A::Error> {
            let mut values = ChannelValues::new();
            while let Some(value) = sequence.next_element()? {
                if values.len() == MAX_EMG_CHANNELS {
                    return Err(de::Error::invalid_length(MAX_EMG_CHANNELS + 1, &self));
                }
                values.push(value);
            }
            Ok(values)
        }
    }
}

/// One gaze measurement.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
pub struct GazeSample {
    /// The eye, in `world`.
    #[cfg_attr(feature = "ts", ts(as = "[f64; 3]"))]
    pub origin: Point,
    /// Where it looks, in `world`; any length above zero.
    #[cfg_attr(feature = "ts", ts(as = "[f64; 3]"))]
    pub direction: Vector,
    /// False while the tracker has lost the eye or the person blinks.
    pub valid: bool,
}

/// Answer of a part in another process to one line. It belongs to the input log: a replay asks no process.
///
/// In the input log the first two variants have the encoding of a `Result`, which logs of older programs hold.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum ExternalAnswer {
    /// The line that it wrote.
    #[serde(rename = "Ok")]
    Line(String),
    /// It cannot answer, and why: it has ended, or wrote bytes that are no line.
    #[serde(rename = "Err")]
    Failed(String),
    /// It has not answered in time, and how long that was.
    #[serde(rename = "Missed")]
    TimedOut(String),
}

impl ExternalAnswer {
    /// The line, or the reason for its absence.
    pub fn text(&self) -> &str {
        let (Self::Line(text) | Self::Failed(text) | Self::TimedOut(text)) = self;
        text
    }
}

impl From<Result<String, String>> for ExternalAnswer {
    fn from(answer: Result<String, String>) -> Self {
        answer.map_or_else(Self::Failed, Self::Line)
    }
}

/// Answer of a method in another process to one control step.
pub type MethodAnswer = ExternalAnswer;

/// Answer of an intent model in another process to one gaze.
pub type IntentAnswer = ExternalAnswer;

/// How it stands with a participant in another program: it acts again, or why it gives nothing. It belongs to the input log: a
/// replay asks no participant.
pub type ParticipantAnswer = Result<(), String>;

/// What a process that decodes EMG said of one window. It belongs to the input log: a replay asks no process.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum WindowAnswer {
    /// Its line.
    Line(String),
    /// It has not answered in time, milliseconds: no decision for this window.
    #[serde(rename = "Late")]
    TimedOut {
        /// Time that was waited.
        deadline_ms: u64,
    },
    /// It has ended, or cannot be asked: why.
    Failed(String),
}

/// Most EMG samples that one tick can hold: an amplifier may have 8 kHz.
pub const MAX_TICK_SAMPLES: usize = 8;

/// Most signs that one tick can hold: one of each kind that a source may give at once.
pub const MAX_HEARTBEATS: usize = 8;

/// Everything that enters the testbed from outside in one tick. The sequence of these, with the configuration
/// and the seeds, is the trial.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TickInput {
    /// EMG samples that arrived in this tick, oldest first, at most [`MAX_TICK_SAMPLES`].
    pub emg: Vec<EmgSample>,
    /// A gesture given directly (keys, buttons), in force until the next one. Overrides the classifier.
    #[serde(rename = "gesture")]
    pub command: Option<Command>,
    /// New gaze measurement.
    pub gaze: Option<GazeSample>,
    /// New tracked shoulder pose: `world_from_shoulder`, the place and attitude of the arm's `base_link`.
    pub shoulder: Option<Pose>,
    /// New tracked angles of the person's own limb, in the joints of the arm, rad. Those of joints that the
    /// prosthesis has do not matter.
    pub limb: Option<JointVector>,
    /// What was heard of live sources, for the decision whether they are alive. Simulated ones give none.
    #[serde(rename = "signs")]
    pub heartbeats: ArrayVec<Heartbeat, MAX_HEARTBEATS>,
    /// Plans that took effect in this tick. Filled by the tick itself when it records, and by a replay.
    pub plan: Option<PlanReply>,
    /// What a method in another process answered in this tick. Filled as `plan` is.
    pub method: Option<MethodAnswer>,
    /// What a process that decodes EMG said of the windows that ended in this tick, in their order. Filled as `plan` is. The
    /// input log keeps it beside the other fields, so that ticks without it are written as they always were.
    #[serde(skip)]
    pub decoder: Vec<WindowAnswer>,
    /// What an intent model in another process answered to the gaze of this tick. Filled as `plan` is, and kept as `decoder` is.
    #[serde(skip)]
    pub intent: Option<IntentAnswer>,
    /// News of a participant in another program: it began to fail, fails otherwise, or acts again. Kept as `decoder` is.
    #[serde(skip)]
    pub participant: Option<ParticipantAnswer>,
}

#[cfg(test)]
mod tests {
    use super::*;

    fn json(channels: usize) -> String {
        let values = vec!["1.5"; channels].join(",");
        format!("{{\"counter\":7,\"channels\":[{values}]}}")
    }

    #[test]
    fn a_sample_has_any_number_of_channels_that_an_amplifier_can_have() {
        for channels in [0, 8, 16, 17, 64, MAX_EMG_CHANNELS] {
            let sample: EmgSample = serde_json::from_str(&json(channels)).expect("a sample");
            assert_eq!(sample.channels.len(), channels);
            assert_eq!(serde_json::to_string(&sample).expect("numbers"), json(channels));
        }
        let error = serde_json::from_str::<EmgSample>(&json(MAX_EMG_CHANNELS + 1)).expect_err("too many");
        assert!(error.to_string().contains("at most 512 channels"), "{error}");
    }
}
