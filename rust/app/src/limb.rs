//! A person's own limb, tracked by another program and sent over UDP.

use proact_devices::RefusedDatagrams;
use proact_testbed::RunningTrial;
use serde::Deserialize;
use std::{
    io,
    net::{SocketAddr, UdpSocket},
    time::Instant,
};

/// Datagrams taken in one go: a flood must not hold up the trial.
const MAX_DATAGRAMS_PER_POLL: usize = 256;

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
    InvalidDatagram(String),
}

/// Listens on this machine for `{"angles": [..]}`, one datagram for each measurement.
pub struct LimbReceiver {
    socket: UdpSocket,
    refused: RefusedDatagrams,
}

/// Other keys are ignored.
#[derive(Deserialize)]
struct LimbMessage {
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
        let socket = bound.map_err(|source| LimbError::Port { port, source })?;
        Ok(Self { socket, refused: RefusedDatagrams::default() })
    }

    /// Where it listens.
    ///
    /// # Errors
    /// [`LimbError::Socket`].
    pub fn address(&self) -> Result<SocketAddr, LimbError> {
        Ok(self.socket.local_addr()?)
    }

    /// Throws away what came since the last call. False if nothing did.
    pub fn discard_received(&mut self) -> bool {
        let mut buffer = [0; 4096];
        (0..MAX_DATAGRAMS_PER_POLL).take_while(|_| self.socket.recv(&mut buffer).is_ok()).count() > 0
    }

    /// Hands the newest measurement to the trial. False if none came. Datagrams that are no measurement of this arm are counted.
    pub fn apply_to(&mut self, trial: &mut RunningTrial) -> bool {
        let mut newest = None;
        let mut buffer = [0; 4096];
        for _ in 0..MAX_DATAGRAMS_PER_POLL {
            let length = match self.socket.recv(&mut buffer) {
                Ok(length) => length,
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => break,
                Err(error) => {
                    self.refused.record_refusal(LimbError::Socket(error));
                    break;
                }
            };
            match parse_angles(&buffer[..length], trial.testbed().model().arm_count()) {
                Ok(angles) => newest = Some(angles),
                Err(reason) => self.refused.record_refusal(LimbError::InvalidDatagram(reason)),
            }
        }
        newest.is_some_and(|angles| trial.person_stage_mut().track_limb(&angles).is_ok())
    }

    /// The report that is due at `now` of datagrams that were refused, once a second at most.
    pub fn report_refused(&mut self, now: Instant) -> Option<String> {
        self.refused.report(now)
    }
}

/// The angles that a datagram has, one for each of `joints`.
fn parse_angles(message: &[u8], joints: usize) -> Result<Vec<f64>, String> {
    let LimbMessage { angles } = serde_json::from_slice(message).map_err(|error| error.to_string())?;
    match angles.iter().position(|angle| !angle.is_finite()) {
        Some(index) => Err(format!("angle {index} is {}, expected a finite number", angles[index])),
        None if angles.len() != joints => {
            Err(format!("{} angles, the arm has {joints} joints", angles.len()))
        }
        None => Ok(angles),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proact_testbed::{Setup, TrialConfig};

    #[test]
    fn a_limb_that_is_sent_is_followed_and_what_is_no_limb_is_refused() {
        let config = TrialConfig::new("A", 1, Setup::named("still").unwrap());
        let config = config.with_overrides(&["profile.level=below_elbow"]).unwrap();
        let mut trial = crate::trial::live_trial(config).unwrap().trial;
        let mut receiver = LimbReceiver::bind(0).unwrap();
        let sender = UdpSocket::bind("127.0.0.1:0").unwrap();
        let start = trial.testbed().plant().state().position[3];
        let address = receiver.address().unwrap();
        let send = |text: &str| sender.send_to(text.as_bytes(), address).unwrap();
        send("rubbish");
        send("{\"angles\": [1.0]}");
        assert!(!receiver.apply_to(&mut trial));
        let report = receiver.report_refused(Instant::now()).unwrap();
        assert!(
            report.starts_with("2 datagrams refused") && report.contains("an angle for each joint"),
            "{report}"
        );
        // A key that the program does not know does not matter, nor does what comes after.
        send(&format!("{{\"angles\": [1.0, -0.2, 0.1, {}, 0, 0, 0], \"quality\": 1}}", start - 0.2));
        send("rubbish");
        assert!(receiver.apply_to(&mut trial));
        for _ in 0..1000 {
            trial.step(false).unwrap();
        }
        let elbow = trial.testbed().plant().state().position[3];
        assert!((elbow - start + 0.2).abs() < 0.02, "{start} to {elbow} rad");
        let taken = receiver.address().unwrap().port();
        let error = LimbReceiver::bind(taken).err().unwrap().to_string();
        assert!(error.contains("--limb-udp"), "{error}");
    }
}
