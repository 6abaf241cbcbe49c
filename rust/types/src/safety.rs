use crate::SimTime;
use serde::{Deserialize, Serialize};
use std::fmt;

/// What gives gestures or measurements to a trial, and may die while the arm moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
#[serde(rename_all = "snake_case")]
pub enum InputSource {
    /// EMG samples.
    Armband,
    /// Gestures by name from another program: `/emg` of rosbridge or of a ROS graph.
    GestureTopic,
    /// A browser page, with its keys, buttons and gamepads.
    Page,
    /// Gaze that is measured, whatever brings it.
    EyeTracker,
    /// The tracked shoulder.
    ShoulderTracker,
    /// The tracked angles of the person's own limb.
    LimbTracker,
    /// Another stage of the testbed, where each is a node of a ROS graph.
    Stage,
    /// A participant in another program.
    Participant,
    /// The control method, where it is another program.
    Method,
}

impl InputSource {
    /// All of them; of several that are dead the first is named.
    pub const ALL: [InputSource; 9] = [
        InputSource::Armband,
        InputSource::GestureTopic,
        InputSource::Page,
        InputSource::EyeTracker,
        InputSource::ShoulderTracker,
        InputSource::LimbTracker,
        InputSource::Stage,
        InputSource::Participant,
        InputSource::Method,
    ];

    /// Whether it measures where something is: the eye, the shoulder, the limb.
    pub fn is_tracker(self) -> bool {
        matches!(self, Self::EyeTracker | Self::ShoulderTracker | Self::LimbTracker)
    }

    /// Its place in [`InputSource::ALL`].
    pub fn index(self) -> usize {
        self as usize
    }
}

impl fmt::Display for InputSource {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            InputSource::Armband => "armband",
            InputSource::GestureTopic => "gesture topic",
            InputSource::Page => "page",
            InputSource::EyeTracker => "eye tracker",
            InputSource::ShoulderTracker => "shoulder tracker",
            InputSource::LimbTracker => "limb tracker",
            InputSource::Stage => "stage",
            InputSource::Participant => "participant",
            InputSource::Method => "method",
        })
    }
}

/// What was heard of a source within a tick, beside the values that it brought.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Heartbeat {
    /// Of which source.
    pub source: InputSource,
    /// What.
    pub kind: HeartbeatKind,
}

/// Kinds of [`Heartbeat`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum HeartbeatKind {
    /// The gesture of this tick is its command: its silence counts from now on.
    #[serde(rename = "commands")]
    Command,
    /// It said something, if only that it is there.
    Alive,
    /// Its gaze is that of a pointing device, which may rest.
    #[serde(rename = "points")]
    PointingDevice,
    /// It measured, and the values differ from those before.
    Fresh,
    /// It sent the values before once more, bit for bit.
    Repeated,
    /// It ended the connection. A tracker is forgotten then, as if it had never measured.
    Closed,
    /// It said something, over a line that is delayed by more than the limit.
    Delayed,
    /// It held a gesture and said nothing for so long that the gesture was let go in its name.
    Silent,
}

impl HeartbeatKind {
    /// All of them, in the order of their numbers.
    pub const ALL: [HeartbeatKind; 8] = [
        HeartbeatKind::Command,
        HeartbeatKind::Alive,
        HeartbeatKind::PointingDevice,
        HeartbeatKind::Fresh,
        HeartbeatKind::Repeated,
        HeartbeatKind::Closed,
        HeartbeatKind::Delayed,
        HeartbeatKind::Silent,
    ];
}

/// How a source died.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
#[serde(rename_all = "snake_case")]
pub enum StopCause {
    /// Nothing comes any more, or nothing that can be used.
    Silent,
    /// It ended the connection.
    Closed,
    /// The same values come over and over.
    Frozen,
    /// A channel stands still.
    Flat,
    /// A channel is at the end of its range.
    Railed,
    /// A channel is smoother than muscle ever is.
    Noiseless,
    /// Too many samples are lost.
    Lossy,
    /// Samples come at another rate than agreed.
    WrongRate,
    /// It measures, but sees nothing: the eye is lost.
    #[serde(rename = "lost")]
    TrackingLost,
    /// The program that decodes its samples, says what is meant, or acts, gives nothing usable.
    #[serde(rename = "undecided")]
    UnusableOutput,
    /// What comes is older than the limit when it arrives.
    Delayed,
}

impl StopCause {
    /// All of them, in the order of their numbers.
    pub const ALL: [StopCause; 11] = [
        StopCause::Silent,
        StopCause::Closed,
        StopCause::Frozen,
        StopCause::Flat,
        StopCause::Railed,
        StopCause::Noiseless,
        StopCause::Lossy,
        StopCause::WrongRate,
        StopCause::TrackingLost,
        StopCause::UnusableOutput,
        StopCause::Delayed,
    ];
}

/// The arm must stand still, and why.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
pub struct Stop {
    /// Who died.
    pub source: InputSource,
    /// How.
    pub cause: StopCause,
    /// When that was noticed.
    pub since: SimTime,
    /// As shown: what happened, and what to do if the source is back.
    pub reason: String,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sources_signs_and_causes_stand_at_their_numbers() {
        for (index, source) in InputSource::ALL.into_iter().enumerate() {
            assert_eq!(source.index(), index, "{source}");
        }
        for (index, kind) in HeartbeatKind::ALL.into_iter().enumerate() {
            assert_eq!(kind as usize, index, "{kind:?}");
        }
        for (index, cause) in StopCause::ALL.into_iter().enumerate() {
            assert_eq!(cause as usize, index, "{cause:?}");
        }
    }
}
