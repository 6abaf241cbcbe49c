//! The latest frame and the last events, as every connection sees them.

use crate::{
    input_arbiter::ClientId,
    live::Role,
    signals::{Signals, TrialStatus},
    study::{ExperimenterScreen, ParticipantScreen, StudyScreen},
};
use axum::extract::ws::Utf8Bytes;
use proact_arm::Side;
use proact_types::{DisplayFrame, Event};
use serde::Serialize;
use serde_json::ser::Formatter;
use std::{collections::VecDeque, io, sync::Arc};

/// Events of the trial kept for clients that come late or missed frames: more than a usual trial has, 50 KB.
const MAX_EVENTS: usize = 512;

/// Messages from the server to the page.
#[derive(Serialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
#[serde(tag = "type", rename_all = "snake_case")]
pub(crate) enum ServerMessage<'a> {
    /// The first message of each connection.
    Hello {
        page_version: &'a str,
        #[cfg_attr(feature = "ts", ts(type = "number"))]
        revision: u64,
        /// The controller that is strapped to the brace: it is neither gaze nor buttons.
        brace_controller: Option<Side>,
    },
    /// There is new content to fetch.
    Content {
        #[cfg_attr(feature = "ts", ts(type = "number"))]
        revision: u64,
    },
    /// One instant.
    Frame(&'a DisplayFrame),
    /// Paused, or going on.
    Status(&'a TrialStatus),
    /// Who drives, by name; none if nobody does. `you`: this client does. `may_drive`: it may take over.
    Driver { name: Option<&'a str>, you: bool, may_drive: bool },
    /// A second arm beside the trial's, or that there is none any more.
    Ghost { arm: Option<&'a GhostArm> },
    /// What the experimenter watches beside the scene.
    Signals(&'a Signals),
    /// What a study shows to whoever conducts it.
    Study(&'a ExperimenterScreen),
    /// What a study shows to whoever takes part.
    Participant(&'a ParticipantScreen),
    /// The round trip of this client's line is longer than the trial allows, ms; null: no longer.
    Delay { ms: Option<f64> },
    /// The answer to `ping`, with the server's clock, ms.
    Pong { id: u32, clock_ms: f64 },
    /// Events of frames that this client did not get.
    Events { events: Vec<&'a Event> },
    /// The client's last message was ignored.
    Error { message: &'a str },
}

impl ServerMessage<'_> {
    /// As JSON text.
    pub(crate) fn to_text(&self) -> Utf8Bytes {
        let text = match self {
            Self::Frame(_) | Self::Ghost { .. } => {
                let mut text = Vec::new();
                let written =
                    self.serialize(&mut serde_json::Serializer::with_formatter(&mut text, RoundingFormatter));
                written.map(|()| String::from_utf8(text).expect("JSON is UTF-8"))
            }
            _ => proact_types::to_json(self),
        };
        text.expect("plain structs with string keys always serialise; non-finite numbers become null").into()
    }
}

/// What is drawn needs no more than a hundredth of a millimetre, and comes sixty times a second.
struct RoundingFormatter;

impl Formatter for RoundingFormatter {
    fn write_f64<W: ?Sized + io::Write>(&mut self, writer: &mut W, value: f64) -> io::Result<()> {
        // Adding zero makes a negative zero positive.
        write!(writer, "{}", (value * 1e5).round() / 1e5 + 0.0)
    }
}

/// What a study shows, as messages.
#[derive(Debug, PartialEq)]
pub(crate) struct StudyMessages {
    experimenter: Utf8Bytes,
    participant: Utf8Bytes,
}

impl StudyMessages {
    pub(crate) fn new(screen: &StudyScreen) -> Self {
        Self {
            experimenter: ServerMessage::Study(&screen.experimenter).to_text(),
            participant: ServerMessage::Participant(&screen.participant).to_text(),
        }
    }

    /// What a page of this role is told; answers are nothing for spectators.
    pub(crate) fn for_role(&self, role: Role) -> Option<Utf8Bytes> {
        match role {
            Role::Participant => Some(self.participant.clone()),
            Role::Experimenter => Some(self.experimenter.clone()),
            Role::Spectator => None,
        }
    }
}

/// A second arm that is seen through and moves nothing.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
pub struct GhostArm {
    /// Moving joints of the arm model, in its order, rad.
    pub joints: Vec<f64>,
    /// Red, green and blue, 0 to 1.
    #[serde(rename = "colour")]
    pub color: [f64; 3],
    /// From 0, not to be seen, to 1, solid.
    pub alpha: f64,
}

/// What all connections watch.
#[derive(Debug, Default)]
pub(crate) struct PageFeed {
    /// Grows with every new content.
    pub(crate) revision: u64,
    /// Grows with every frame.
    pub(crate) sequence: u64,
    /// The latest frame as a message; none before the first one of this content.
    pub(crate) frame: Option<Utf8Bytes>,
    /// The latest frame itself.
    pub(crate) latest: Option<Arc<DisplayFrame>>,
    /// The status as a message, and how often it was set; none before the first.
    pub(crate) status: (u64, Option<Utf8Bytes>),
    /// What a study shows, and how often that has changed; none without a study.
    pub(crate) study: (u64, Option<StudyMessages>),
    /// How often the driver has changed, and who it is.
    pub(crate) driver: (u64, Option<(ClientId, String)>),
    /// The second arm as a message, and how often that has changed; none before there was one.
    pub(crate) ghost: (u64, Option<Utf8Bytes>),
    /// The latest signals as a message, and how many there were.
    pub(crate) signals: (u64, Option<Utf8Bytes>),
    /// The last events, each with the number of its frame.
    events: VecDeque<(u64, Event)>,
}

impl PageFeed {
    /// Takes a new frame, already written out as `text`.
    pub(crate) fn publish(&mut self, frame: &DisplayFrame, text: Utf8Bytes) {
        self.sequence += 1;
        self.frame = Some(text);
        self.latest = Some(Arc::new(frame.clone()));
        for event in &frame.events {
            if self.events.len() == MAX_EVENTS {
                self.events.pop_front();
            }
            self.events.push_back((self.sequence, event.clone()));
        }
    }

    /// Starts over for new content.
    pub(crate) fn reset(&mut self) {
        self.revision += 1;
        self.frame = None;
        self.latest = None;
        self.signals.1 = None;
        self.ghost.1 = None;
        self.events.clear();
    }

    /// Events of the frames between `seen` and the latest one, without both; none if there are none.
    pub(crate) fn missed_events(&self, seen: u64) -> Option<Utf8Bytes> {
        let missed = |&&(frame, _): &&(u64, Event)| frame > seen && frame < self.sequence;
        let events: Vec<&Event> = self.events.iter().filter(missed).map(|(_, event)| event).collect();
        (!events.is_empty()).then(|| ServerMessage::Events { events }.to_text())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_drawn_goes_over_the_line_to_the_hundredth_of_a_millimetre() {
        let ghost =
            GhostArm { joints: vec![0.123_456_789, -1e-20, 2.0, -1.5e-5], color: [1.0; 3], alpha: 0.5 };
        let text = ServerMessage::Ghost { arm: Some(&ghost) }.to_text();
        assert!(text.contains(r#""joints":[0.12346,0,2,-0.00002]"#), "{text}");
        let whole = ServerMessage::Error { message: "0.123456789" }.to_text();
        assert!(whole.contains("0.123456789"), "{whole}");
    }
}
