//! A person's own limb, tracked by another program and sent over UDP.

use proact_testbed::{Session, TestbedError};
use serde::Deserialize;
use std::{
    io,
    net::{SocketAddr, UdpSocket},
};

/// Datagrams taken in one go: a flood must not hold up the trial.
const MOST_AT_ONCE: usize = 256;

/// Why the limb cannot be followed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LimbError {
    /// The port.
    #[error("UDP port {port} for the limb: {source}; give another one to --limb-udp")]
    Port {
        /// Which one.
        port: u16,
        /// Why not.
        source: io::Error,
    },
    /// The network.
    #[error("the limb cannot be received: {0}")]
    Socket(#[from] io::Error),
    /// A datagram that is none.
    #[error("limb: {0}; expected {{\"angles\": [..]}} with an angle for each joint of the arm, rad")]
    Message(String),
}

/// Listens on this machine for `{"angles": [..]}`, one datagram for each measurement.
pub struct LimbReceiver {
    socket: UdpSocket,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Measured {
    angles: Vec<f64>,
}

impl LimbReceiver {
    /// Listens on UDP port `port` of this machine; 0 takes a free one.
    ///
    /// # Errors
    /// [`LimbError::Port`] if it is taken.
    pub fn bind(port: u16) -> Result<Self, LimbError> {
        let bound = UdpSocket::bind(("127.0.0.1", port)).and_then(|socket| {
            socket.set_nonblocking(true)?;
            Ok(socket)
        });
        Ok(Self { socket: bound.map_err(|source| LimbError::Port { port, source })? })
    }

    /// Where it listens.
    ///
    /// # Errors
    /// [`LimbError::Socket`].
    pub fn address(&self) -> Result<SocketAddr, LimbError> {
        Ok(self.socket.local_addr()?)
    }

    /// Throws away what came since the last call. False if nothing did.
    pub fn listen(&mut self) -> bool {
        let mut buffer = [0; 4096];
        (0..MOST_AT_ONCE).take_while(|_| self.socket.recv(&mut buffer).is_ok()).count() > 0
    }

    /// Hands the newest measurement to the trial. False if none came.
    ///
    /// # Errors
    /// A datagram that is no measurement of this arm.
    pub fn drive(&mut self, session: &mut Session) -> Result<bool, LimbError> {
        let mut newest = None;
        let mut buffer = [0; 4096];
        for _ in 0..MOST_AT_ONCE {
            match self.socket.recv(&mut buffer) {
                Ok(length) => newest = Some(buffer[..length].to_vec()),
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => break,
                Err(error) => return Err(error.into()),
            }
        }
        let Some(message) = newest else { return Ok(false) };
        let Measured { angles } =
            serde_json::from_slice(&message).map_err(|error| LimbError::Message(error.to_string()))?;
        session
            .person()
            .track_limb(&angles)
            .map_err(|error: TestbedError| LimbError::Message(error.to_string()))?;
        Ok(true)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proact_testbed::{Setup, TrialConfig};

    #[test]
    fn a_limb_that_is_sent_is_followed_and_what_is_no_limb_is_refused() {
        let config = TrialConfig::new("A", 1, Setup::named("still").unwrap());
        let config = config.with_values(&["profile.level=below_elbow"]).unwrap();
        let mut session = crate::trial::live(config).unwrap().session;
        let mut receiver = LimbReceiver::bind(0).unwrap();
        let sender = UdpSocket::bind("127.0.0.1:0").unwrap();
        let start = session.testbed().plant().state().position[3];
        let mut send = |text: &str| {
            sender.send_to(text.as_bytes(), receiver.address().unwrap()).unwrap();
            receiver.drive(&mut session)
        };
        for wrong in ["rubbish", "{\"angles\": [1.0]}", "{\"angles\": [0,0,0,0,0,0,0], \"hand\": 1}"] {
            let error = send(wrong).unwrap_err().to_string();
            assert!(error.contains("an angle for each joint"), "{error}");
        }
        send(&format!("{{\"angles\": [1.0, -0.2, 0.1, {}, 0, 0, 0]}}", start - 0.2)).unwrap();
        for _ in 0..1000 {
            session.step(false).unwrap();
        }
        let elbow = session.testbed().plant().state().position[3];
        assert!((elbow - start + 0.2).abs() < 0.02, "{start} to {elbow} rad");
        let taken = receiver.address().unwrap().port();
        let error = LimbReceiver::bind(taken).err().unwrap().to_string();
        assert!(error.contains("--limb-udp"), "{error}");
    }
}
