use crate::DeviceError;
use proact_types::{Event, EventKind, SimTime};
use serde::{Deserialize, Serialize};
use std::{io, net::UdpSocket};

/// What a person is to hear and feel at an event, as data: who drives a loudspeaker or a vibrating band decides how.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct FeedbackCue {
    /// When.
    pub time: SimTime,
    /// Why.
    pub cue: Cue,
    /// What is to be heard.
    pub sound: Option<Tone>,
    /// What is to be felt.
    pub vibration: Option<Vibration>,
}

/// The occasions for a cue.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
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
}

/// A tone.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Tone {
    /// Hz at the beginning, and at the end: it glides.
    pub hz: [f64; 2],
    /// Milliseconds.
    pub ms: u32,
}

/// A buzz.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Vibration {
    /// 0 to 1.
    pub strength: f64,
    /// Milliseconds.
    pub ms: u32,
}

impl FeedbackCue {
    /// The cue of an event, if it has one. The tones are our own choice: up for contact, down for its loss.
    pub fn of(event: &Event) -> Option<FeedbackCue> {
        let (cue, hz, strength) = match event.kind {
            EventKind::BlockAttached { .. } => (Cue::ContactMade, [440.0, 660.0], Some(1.0)),
            EventKind::BlockReleased { .. } => (Cue::ContactLost, [660.0, 440.0], Some(0.5)),
            EventKind::BlockOnTarget { .. } => (Cue::OnTarget, [880.0, 880.0], None),
            EventKind::BlockOffTarget { .. } => (Cue::OffTarget, [220.0, 220.0], None),
            _ => return None,
        };
        let vibration = strength.map(|strength| Vibration { strength, ms: 150 });
        Some(FeedbackCue { time: event.time, cue, sound: Some(Tone { hz, ms: 150 }), vibration })
    }
}

/// Something that makes cues heard or felt.
pub trait FeedbackSink {
    /// Begins a cue. Must not wait for its end.
    ///
    /// # Errors
    /// If the device cannot be reached; the trial goes on without it.
    fn begin(&mut self, cue: &FeedbackCue) -> Result<(), DeviceError>;
}

/// Cues as JSON datagrams, for a program that drives an actuator.
#[derive(Debug)]
pub struct UdpFeedback {
    socket: UdpSocket,
    target: String,
}

impl UdpFeedback {
    /// Sends to `target`, such as `127.0.0.1:25041`.
    ///
    /// # Errors
    /// [`DeviceError::Udp`] for an address that does not resolve.
    pub fn connect(target: &str) -> Result<UdpFeedback, DeviceError> {
        let failed = |source| DeviceError::Udp { address: target.to_owned(), source };
        let socket = UdpSocket::bind(("0.0.0.0", 0)).map_err(failed)?;
        socket.connect(target).map_err(failed)?;
        socket.set_nonblocking(true).map_err(failed)?;
        Ok(UdpFeedback { socket, target: target.to_owned() })
    }
}

impl FeedbackSink for UdpFeedback {
    /// That nobody listens is no error.
    fn begin(&mut self, cue: &FeedbackCue) -> Result<(), DeviceError> {
        let failed = |source| DeviceError::Udp { address: self.target.clone(), source };
        let text = serde_json::to_vec(cue).map_err(|error| failed(error.into()))?;
        match self.socket.send(&text) {
            Ok(_) => Ok(()),
            Err(e) if matches!(e.kind(), io::ErrorKind::ConnectionRefused | io::ErrorKind::WouldBlock) => {
                Ok(())
            }
            Err(source) => Err(failed(source)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proact_types::BlockId;
    use std::time::Duration;

    fn event(kind: EventKind) -> Event {
        Event { time: SimTime(1234), kind }
    }

    #[test]
    fn contact_is_heard_and_felt_and_a_plan_is_neither() {
        let made = FeedbackCue::of(&event(EventKind::BlockAttached { block: BlockId::Red1 })).unwrap();
        assert_eq!(made.cue, Cue::ContactMade);
        assert!(made.vibration.is_some_and(|buzz| buzz.strength == 1.0));
        assert!(made.sound.is_some_and(|tone| tone.hz[1] > tone.hz[0]));
        assert_eq!(FeedbackCue::of(&event(EventKind::PlanRequested { request: 1 })), None);
    }

    #[test]
    fn cues_arrive_as_json_and_a_missing_listener_is_no_error() {
        let listener = UdpSocket::bind("127.0.0.1:0").unwrap();
        listener.set_read_timeout(Some(Duration::from_secs(5))).unwrap();
        let mut sink = UdpFeedback::connect(&listener.local_addr().unwrap().to_string()).unwrap();
        let cue = FeedbackCue::of(&event(EventKind::BlockReleased { block: BlockId::Blue1 })).unwrap();
        sink.begin(&cue).unwrap();
        let mut bytes = [0; 512];
        let count = listener.recv(&mut bytes).unwrap();
        let text = std::str::from_utf8(&bytes[..count]).unwrap();
        assert!(
            text.starts_with(r#"{"time":1234,"cue":"contact_lost","sound":{"hz":[660.0,440.0]"#),
            "{text}"
        );
        assert_eq!(serde_json::from_str::<FeedbackCue>(text).unwrap(), cue);
        drop(listener);
        for _ in 0..3 {
            sink.begin(&cue).unwrap();
        }
        assert!(UdpFeedback::connect("nonsense").is_err());
    }
}
