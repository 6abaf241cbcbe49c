use crate::{DeviceError, GazeDevice, GazeFrame, RawGazeSample, RefusedDatagrams};
use serde::Deserialize;
use std::{
    io,
    net::{SocketAddr, UdpSocket},
    time::Instant,
};

/// Where eye trackers send their samples unless told otherwise.
pub const GAZE_UDP_PORT: u16 = 25040;

/// First bytes of a binary sample.
const MAGIC: [u8; 4] = *b"PGZ1";
/// Length of a binary sample, bytes.
const BINARY_BYTES: usize = 56;
/// Bits of the flags.
const FLAG_VALID: u32 = 1;
const FLAG_HEAD_FRAME: u32 = 2;
/// Samples taken in one go: a flood must not hold up the trial.
const MAX_SAMPLES_PER_POLL: usize = 256;

/// Keys that are not listed here, such as a tracker's own confidence, are ignored.
#[derive(Deserialize)]
struct GazeJson {
    #[serde(default)]
    origin: [f64; 3],
    direction: [f64; 3],
    #[serde(default = "default_valid")]
    valid: bool,
    #[serde(default)]
    frame: GazeFrame,
}

fn default_valid() -> bool {
    true
}

impl RawGazeSample {
    /// Reads one datagram. Either JSON, `{"origin": [x, y, z], "direction": [x, y, z], "valid": true, "frame":
    /// "world" | "head"}`, where all but the direction may be left out and other keys are ignored; or 56 bytes, little endian: `PGZ1`, flags
    /// (u32; 1 = valid, 2 = in the frame of the head), origin and direction (three f64 each). Metres; the direction
    /// has any length above zero.
    ///
    /// # Errors
    /// [`DeviceError::GazeMessage`] for anything else, with the reason.
    pub fn parse(message: &[u8]) -> Result<RawGazeSample, DeviceError> {
        let wrong = |reason: String| DeviceError::GazeMessage { reason };
        let GazeJson { origin, direction, valid, frame } = if message.starts_with(&MAGIC) {
            parse_binary(message).ok_or_else(|| {
                wrong(format!("a binary sample of {} bytes, expected {BINARY_BYTES}", message.len()))
            })?
        } else {
            serde_json::from_slice(message).map_err(|error| wrong(error.to_string()))?
        };
        RawGazeSample::new(origin, direction, valid, frame)
    }

    /// The binary form.
    pub fn to_bytes(self) -> [u8; BINARY_BYTES] {
        let mut bytes = [0; BINARY_BYTES];
        bytes[..4].copy_from_slice(&MAGIC);
        let in_head = if self.frame == GazeFrame::Head { FLAG_HEAD_FRAME } else { 0 };
        bytes[4..8].copy_from_slice(&((u32::from(self.sample.valid) * FLAG_VALID) | in_head).to_le_bytes());
        let numbers = self.sample.origin.iter().chain(self.sample.direction.iter());
        for (bytes_out, number) in bytes[8..].chunks_exact_mut(8).zip(numbers) {
            bytes_out.copy_from_slice(&number.to_le_bytes());
        }
        bytes
    }
}

fn parse_binary(message: &[u8]) -> Option<GazeJson> {
    let message: &[u8; BINARY_BYTES] = message.try_into().ok()?;
    let flags = u32::from_le_bytes(message[4..8].try_into().ok()?);
    let number = |n: usize| {
        let bytes: Option<[u8; 8]> = message[8 + 8 * n..16 + 8 * n].try_into().ok();
        bytes.map(f64::from_le_bytes)
    };
    Some(GazeJson {
        origin: [number(0)?, number(1)?, number(2)?],
        direction: [number(3)?, number(4)?, number(5)?],
        valid: flags & FLAG_VALID != 0,
        frame: if flags & FLAG_HEAD_FRAME != 0 { GazeFrame::Head } else { GazeFrame::World },
    })
}

/// Gaze samples that an eye tracker's program sends over UDP. Datagrams that are no samples are counted and reported.
#[derive(Debug)]
pub struct GazeReceiver {
    socket: UdpSocket,
    refused: RefusedDatagrams,
}

impl GazeReceiver {
    /// Listens on `port` of this machine only; 0 for any that is free.
    ///
    /// # Errors
    /// [`DeviceError::Udp`] if the port is taken.
    pub fn bind(port: u16) -> Result<GazeReceiver, DeviceError> {
        let failed = |source| DeviceError::Udp { address: format!("127.0.0.1:{port}"), source };
        let socket = UdpSocket::bind(("127.0.0.1", port)).map_err(failed)?;
        socket.set_nonblocking(true).map_err(failed)?;
        Ok(GazeReceiver { socket, refused: RefusedDatagrams::default() })
    }

    /// Where it listens.
    ///
    /// # Errors
    /// The system does not say.
    pub fn address(&self) -> io::Result<SocketAddr> {
        self.socket.local_addr()
    }

    /// Datagrams so far that were no samples.
    pub fn refused(&self) -> u64 {
        self.refused.total()
    }
}

impl GazeDevice for GazeReceiver {
    fn latest(&mut self) -> Result<Option<RawGazeSample>, DeviceError> {
        let mut latest = None;
        let mut bytes = [0; 1024];
        for _ in 0..MAX_SAMPLES_PER_POLL {
            match self.socket.recv(&mut bytes) {
                Ok(count) => match RawGazeSample::parse(&bytes[..count]) {
                    Ok(sent) => latest = Some(sent),
                    Err(error) => self.refused.record_refusal(error),
                },
                Err(e) if e.kind() == io::ErrorKind::WouldBlock => break,
                Err(source) => return Err(DeviceError::Udp { address: "127.0.0.1".to_owned(), source }),
            }
        }
        Ok(latest)
    }

    fn report_refused(&mut self, now: Instant) -> Option<String> {
        self.refused.report(now)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proact_types::{GazeSample, Point, Vector};
    use proptest::prelude::*;

    #[test]
    fn both_forms_are_read_and_directions_become_unit_vectors() {
        let text = br#"{"origin": [0.1, 0, 1.5], "direction": [0, 0, -4], "frame": "world"}"#;
        let sent = RawGazeSample::parse(text).unwrap();
        assert_eq!(sent.sample.direction, Vector::new(0.0, 0.0, -1.0));
        assert!(sent.sample.valid && sent.frame == GazeFrame::World);
        let sent = RawGazeSample { frame: GazeFrame::Head, ..sent };
        assert_eq!(RawGazeSample::parse(&sent.to_bytes()).unwrap(), sent);
        let more =
            br#"{"direction": [0, 0, -4], "confidence": 0.97, "pupil": {"left": 3.1}, "frame": "head"}"#;
        assert_eq!(RawGazeSample::parse(more).unwrap().sample.direction, Vector::new(0.0, 0.0, -1.0));
        let lost = RawGazeSample::parse(br#"{"direction": [0, 0, 0], "valid": false}"#).unwrap();
        assert!(!lost.sample.valid);
    }

    #[test]
    fn anything_else_is_refused_with_the_reason() {
        for (message, part) in [
            (&b""[..], "EOF"),
            (b"[1]", "invalid"),
            (br#"{"origin": [0, 0, 0]}"#, "direction"),
            (br#"{"direction": [0, 0, 0]}"#, "above zero"),
            (br#"{"direction": [1e300, 1e300, 0]}"#, "above zero"),
            (br#"{"direction": [1, 0, 0], "origin": [1e9, 0, 0]}"#, "up to 100 m"),
            (br#"{"direction": [1, 0, 0], "frame": "moon"}"#, "moon"),
            (b"PGZ1 short", "expected 56"),
        ] {
            let error = RawGazeSample::parse(message).unwrap_err().to_string();
            assert!(error.contains(part), "{}: {error}", String::from_utf8_lossy(message));
        }
        let nan =
            GazeSample { origin: Point::origin(), direction: Vector::new(f64::NAN, 0.0, 0.0), valid: true };
        assert!(
            RawGazeSample::parse(&RawGazeSample { sample: nan, frame: GazeFrame::World }.to_bytes()).is_err()
        );
    }

    #[test]
    fn of_what_came_the_newest_counts_and_nonsense_is_counted() {
        let mut receiver = GazeReceiver::bind(0).unwrap();
        let sender = UdpSocket::bind("127.0.0.1:0").unwrap();
        let address = receiver.address().unwrap();
        assert_eq!(receiver.latest().unwrap(), None);
        for message in [&br#"{"direction": [1, 0, 0]}"#[..], b"nonsense", br#"{"direction": [0, 1, 0]}"#] {
            sender.send_to(message, address).unwrap();
        }
        // On the loopback a datagram is there once it is sent.
        let sent = receiver.latest().unwrap().unwrap();
        assert_eq!(sent.sample.direction, Vector::y());
        assert_eq!(receiver.refused(), 1);
        let report = receiver.report_refused(Instant::now()).unwrap();
        assert!(report.starts_with("1 datagram refused, 1 so far; reason of the first: "), "{report}");
        assert!(GazeReceiver::bind(address.port()).is_err(), "the port is taken");
    }

    proptest! {
        #[test]
        fn no_bytes_make_it_panic(bytes in prop::collection::vec(any::<u8>(), 0..100), binary in any::<bool>()) {
            let mut message = if binary { MAGIC.to_vec() } else { Vec::new() };
            message.extend(bytes);
            let _ = RawGazeSample::parse(&message);
        }
    }
}
