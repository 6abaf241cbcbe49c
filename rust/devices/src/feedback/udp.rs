use super::FeedbackSink;
use crate::DeviceError;
use proact_types::FeedbackCue;
use std::{io, net::UdpSocket};

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
    use proact_types::{Cue, SimTime, Tone};
    use std::time::Duration;

    #[test]
    fn cues_arrive_as_json_and_a_missing_listener_is_no_error() {
        let listener = UdpSocket::bind("127.0.0.1:0").unwrap();
        listener.set_read_timeout(Some(Duration::from_secs(5))).unwrap();
        let mut sink = UdpFeedback::connect(&listener.local_addr().unwrap().to_string()).unwrap();
        let sound = Some(Tone { hz: [660.0, 440.0], ms: 150 });
        let cue =
            FeedbackCue { time: SimTime(1234), cue: Cue::ContactLost, digit: None, sound, vibration: None };
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
