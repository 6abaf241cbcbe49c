//! Messages of VRPN 7, without any socket. All numbers are big-endian.

use std::collections::BTreeMap;

/// What both sides send first: `vrpn: ver. 07.38`, two spaces, the log mode, padded to [`COOKIE_LENGTH`] with zeros.
const COOKIE_TEXT: &[u8] = b"vrpn: ver. 07.38  0";
/// What of it must agree: everything up to the last dot, the major version.
const COOKIE_MAJOR: &[u8] = b"vrpn: ver. 07.";
/// Length of a cookie.
pub(super) const COOKIE_LENGTH: usize = 24;
/// Length of a message's header.
const HEADER_BYTES: usize = 24;
/// Messages begin at multiples of this.
const ALIGN: usize = 8;
/// Longest message: VRPN's own buffer.
const MAX_MESSAGE_BYTES: usize = 64_000;
/// Longest name of a device or type.
const MAX_NAME_BYTES: usize = 100;
/// Devices and types at most; VRPN's own limit is 2000.
const MAX_NAMES: usize = 2000;

const SENDER_DESCRIPTION: i32 = -1;
const TYPE_DESCRIPTION: i32 = -2;
const DISCONNECT: i32 = -5;

/// A device's pose, as sent.
pub(super) const POS_QUAT: &str = "vrpn_Tracker Pos_Quat";
pub(super) const PING: &str = "vrpn_Base ping_message";
pub(super) const PONG: &str = "vrpn_Base pong_message";
/// The connection's own device, which is no body.
const CONTROL: &str = "VRPN Control";

/// Why a VRPN connection cannot be understood.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum VrpnError {
    /// The other side is no VRPN of our major version.
    #[error("it greets with {got:?}, expected \"vrpn: ver. 07.\"; is this the port of a VRPN 7 server?")]
    Cookie {
        /// What came.
        got: String,
    },
    /// A message that no VRPN sends.
    #[error("a message of {got} bytes, expected {HEADER_BYTES} to {MAX_MESSAGE_BYTES}")]
    Length {
        /// As its header says.
        got: u32,
    },
    /// A message that is too short for what it is.
    #[error("{kind}: {got} bytes, expected {expected}")]
    Payload {
        /// Which message.
        kind: &'static str,
        /// Bytes that came.
        got: usize,
        /// Bytes that belong there.
        expected: usize,
    },
    /// A name that cannot be one.
    #[error("a name of {got} bytes, expected 1 to {MAX_NAME_BYTES} and at most {MAX_NAMES} of them")]
    Name {
        /// As the message says.
        got: i64,
    },
}

/// A pose of a tracker.
#[derive(Clone, Debug, PartialEq)]
pub struct VrpnPose {
    /// Name of the device; with the sensor behind a slash, if it is not the first.
    pub body: String,
    /// The server's number of the device.
    pub device: i32,
    /// Sensor of the device, from 0.
    pub sensor: i32,
    /// When, seconds of the server's clock,
    pub secs: u32,
    /// and microseconds.
    pub micros: u32,
    /// As sent, m by the protocol's word.
    pub position: [f64; 3],
    /// x, y, z, w.
    pub quaternion: [f64; 4],
}

/// What a server says that a client of trackers must know.
#[derive(Clone, Debug, PartialEq)]
pub enum VrpnEvent {
    /// The server's greeting was in order.
    CookieReceived,
    /// There is a device of this name.
    Device(String),
    /// A pose.
    Pose(VrpnPose),
    /// Whether the other side is there, about a device of its own number.
    Ping {
        /// Name of the device.
        device: String,
    },
    /// The other side is there.
    Pong,
    /// It takes its leave.
    Disconnect,
}

/// The greeting.
pub fn cookie() -> [u8; COOKIE_LENGTH] {
    let mut bytes = [0; COOKIE_LENGTH];
    bytes[..COOKIE_TEXT.len()].copy_from_slice(COOKIE_TEXT);
    bytes
}

/// Appends a message.
pub(super) fn write_message(
    out: &mut Vec<u8>,
    (secs, micros): (u32, u32),
    sender: i32,
    kind: i32,
    payload: &[u8],
) {
    out.extend(((HEADER_BYTES + payload.len()) as u32).to_be_bytes());
    out.extend(secs.to_be_bytes());
    out.extend(micros.to_be_bytes());
    out.extend(sender.to_be_bytes());
    out.extend(kind.to_be_bytes());
    // The sequence number is counted by receivers alone.
    out.extend(0_u32.to_be_bytes());
    out.extend(payload);
    out.resize(out.len().next_multiple_of(ALIGN), 0);
}

/// Appends the description of a sender or of a type, by its number.
pub(super) fn write_description(out: &mut Vec<u8>, is_sender: bool, number: i32, name: &str) {
    let mut payload = (name.len() as u32 + 1).to_be_bytes().to_vec();
    payload.extend(name.as_bytes());
    payload.push(0);
    let kind = if is_sender { SENDER_DESCRIPTION } else { TYPE_DESCRIPTION };
    write_message(out, (0, 0), number, kind, &payload);
}

/// The payload of [`POS_QUAT`].
pub(super) fn pose_payload(sensor: i32, position: [f64; 3], quaternion: [f64; 4]) -> Vec<u8> {
    let mut payload = sensor.to_be_bytes().to_vec();
    payload.extend([0; 4]);
    position.iter().chain(&quaternion).for_each(|number| payload.extend(number.to_be_bytes()));
    payload
}

/// Reads what a peer sends, however it is cut into pieces. Numbers of devices and types are the peer's own; they are told by
/// name. After an error the stream cannot be followed any more.
#[derive(Clone, Debug, Default)]
pub struct VrpnParser {
    bytes: Vec<u8>,
    cookie_received: bool,
    devices: BTreeMap<i32, String>,
    kinds: BTreeMap<i32, VrpnMessageKind>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum VrpnMessageKind {
    Pose,
    Ping,
    Pong,
    Other,
}

impl VrpnParser {
    /// Before the greeting.
    pub fn new() -> Self {
        Self::default()
    }

    /// Bytes that came.
    pub fn push(&mut self, bytes: &[u8]) {
        self.bytes.extend_from_slice(bytes);
    }

    /// The next event; none until more bytes come.
    ///
    /// # Errors
    /// [`VrpnError`]: the connection must be closed.
    pub fn next_event(&mut self) -> Result<Option<VrpnEvent>, VrpnError> {
        if !self.cookie_received {
            // A peer that is none is told by its first bytes.
            let known = self.bytes.len().min(COOKIE_MAJOR.len());
            if self.bytes[..known] != COOKIE_MAJOR[..known] {
                let shown = &self.bytes[..self.bytes.len().min(COOKIE_LENGTH)];
                return Err(VrpnError::Cookie { got: String::from_utf8_lossy(shown).into_owned() });
            }
            if self.bytes.len() < COOKIE_LENGTH {
                return Ok(None);
            }
            self.bytes.drain(..COOKIE_LENGTH);
            self.cookie_received = true;
            return Ok(Some(VrpnEvent::CookieReceived));
        }
        let mut at = 0;
        let event = loop {
            let Some(header) = self.bytes.get(at..at + HEADER_BYTES) else { break Ok(None) };
            let length = number(header, 0) as u32;
            let whole = length as usize;
            if !(HEADER_BYTES..=MAX_MESSAGE_BYTES).contains(&whole) {
                break Err(VrpnError::Length { got: length });
            }
            let Some(message) = self.bytes.get(at..at + whole.next_multiple_of(ALIGN)) else {
                break Ok(None);
            };
            let (header, payload) = message[..whole].split_at(HEADER_BYTES);
            let stamp = (number(header, 4) as u32, number(header, 8) as u32);
            let event = read(
                &mut self.devices,
                &mut self.kinds,
                (stamp, number(header, 12), number(header, 16)),
                payload,
            );
            at += message.len();
            match event {
                Ok(None) => {}
                other => break other,
            }
        };
        self.bytes.drain(..at);
        event
    }
}

/// What a message says; none if it does not concern us.
fn read(
    devices: &mut BTreeMap<i32, String>,
    kinds: &mut BTreeMap<i32, VrpnMessageKind>,
    ((secs, micros), sender, kind): ((u32, u32), i32, i32),
    payload: &[u8],
) -> Result<Option<VrpnEvent>, VrpnError> {
    match kind {
        SENDER_DESCRIPTION => {
            let name = read_name(payload, devices.len())?;
            devices.insert(sender, name.clone());
            return Ok((name != CONTROL).then_some(VrpnEvent::Device(name)));
        }
        TYPE_DESCRIPTION => {
            let kind = match read_name(payload, kinds.len())?.as_str() {
                POS_QUAT => VrpnMessageKind::Pose,
                PING => VrpnMessageKind::Ping,
                PONG => VrpnMessageKind::Pong,
                _ => VrpnMessageKind::Other,
            };
            kinds.insert(sender, kind);
            return Ok(None);
        }
        DISCONNECT => return Ok(Some(VrpnEvent::Disconnect)),
        _ => {}
    }
    let Some(device) = devices.get(&sender).filter(|name| name.as_str() != CONTROL) else { return Ok(None) };
    Ok(match kinds.get(&kind) {
        Some(VrpnMessageKind::Pose) => {
            const EXPECTED: usize = 64;
            if payload.len() != EXPECTED {
                return Err(VrpnError::Payload { kind: POS_QUAT, got: payload.len(), expected: EXPECTED });
            }
            let sensor = number(payload, 0);
            let float = |k: usize| {
                let mut bytes = [0; 8];
                bytes.copy_from_slice(&payload[8 + 8 * k..16 + 8 * k]);
                f64::from_be_bytes(bytes)
            };
            let body = if sensor == 0 { device.clone() } else { format!("{device}/{sensor}") };
            let position = [float(0), float(1), float(2)];
            let quaternion = [float(3), float(4), float(5), float(6)];
            Some(VrpnEvent::Pose(VrpnPose {
                body,
                device: sender,
                sensor,
                secs,
                micros,
                position,
                quaternion,
            }))
        }
        Some(VrpnMessageKind::Ping) => Some(VrpnEvent::Ping { device: device.clone() }),
        Some(VrpnMessageKind::Pong) => Some(VrpnEvent::Pong),
        _ => None,
    })
}

/// The name in a description, of which `known` are there already.
fn read_name(payload: &[u8], known: usize) -> Result<String, VrpnError> {
    let length = payload.get(..4).map_or(-1, |bytes| i64::from(number(bytes, 0)));
    let text = usize::try_from(length).ok().filter(|length| (2..=MAX_NAME_BYTES + 1).contains(length));
    let text = text.and_then(|length| payload.get(4..4 + length)).filter(|_| known < MAX_NAMES);
    let Some(text) = text else { return Err(VrpnError::Name { got: length }) };
    let end = text.iter().position(|byte| *byte == 0).unwrap_or(text.len());
    Ok(String::from_utf8_lossy(&text[..end]).into_owned())
}

/// The four bytes at `at`, which are there.
fn number(bytes: &[u8], at: usize) -> i32 {
    i32::from_be_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]])
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn stream(sensor: i32) -> Vec<u8> {
        let mut bytes = cookie().to_vec();
        write_description(&mut bytes, true, 4, CONTROL);
        write_description(&mut bytes, true, 9, "Shoulderpad");
        write_description(&mut bytes, false, 3, "vrpn_Tracker Velocity");
        write_description(&mut bytes, false, 7, POS_QUAT);
        write_description(&mut bytes, false, 8, PING);
        write_message(&mut bytes, (1, 2), 9, 3, &[0; 72]);
        write_message(
            &mut bytes,
            (5, 6),
            9,
            7,
            &pose_payload(sensor, [0.5, -0.25, 1.0], [0.0, 0.0, 0.0, 1.0]),
        );
        write_message(&mut bytes, (0, 0), 9, 8, &[]);
        write_message(&mut bytes, (0, 0), 4, 7, &pose_payload(0, [0.0; 3], [0.0, 0.0, 0.0, 1.0]));
        write_message(&mut bytes, (0, 0), 0, DISCONNECT, &[]);
        bytes
    }

    fn events(parser: &mut VrpnParser) -> Vec<VrpnEvent> {
        std::iter::from_fn(|| parser.next_event().unwrap()).collect()
    }

    #[test]
    fn a_stream_in_pieces_of_any_length_gives_the_same_events() {
        let expected = [
            VrpnEvent::CookieReceived,
            VrpnEvent::Device("Shoulderpad".into()),
            VrpnEvent::Pose(VrpnPose {
                body: "Shoulderpad/2".into(),
                device: 9,
                sensor: 2,
                secs: 5,
                micros: 6,
                position: [0.5, -0.25, 1.0],
                quaternion: [0.0, 0.0, 0.0, 1.0],
            }),
            VrpnEvent::Ping { device: "Shoulderpad".into() },
            VrpnEvent::Disconnect,
        ];
        for length in [1, 7, 24, 100, 10_000] {
            let mut parser = VrpnParser::new();
            let mut seen = Vec::new();
            for piece in stream(2).chunks(length) {
                parser.push(piece);
                seen.extend(events(&mut parser));
            }
            assert_eq!(seen, expected, "pieces of {length}");
        }
    }

    #[test]
    fn what_is_no_vrpn_is_refused_with_what_was_expected() {
        let mut parser = VrpnParser::new();
        parser.push(b"HTTP");
        assert!(parser.next_event().unwrap_err().to_string().contains("VRPN 7 server"));
        let after_greeting = |bytes: &[u8]| {
            let mut parser = VrpnParser::new();
            parser.push(&stream(0)[..stream(0).len() - 24]);
            events(&mut parser);
            parser.push(bytes);
            parser.next_event()
        };
        let mut long = Vec::new();
        write_message(&mut long, (0, 0), 9, 7, &[0; 60]);
        assert!(matches!(after_greeting(&long), Err(VrpnError::Payload { got: 60, expected: 64, .. })));
        for length in [0_u32, 23, 64_001, u32::MAX] {
            let mut header = length.to_be_bytes().to_vec();
            header.extend([0; 20]);
            assert_eq!(after_greeting(&header), Err(VrpnError::Length { got: length }));
        }
        for name_length in [0_u32, 1, 102, u32::MAX] {
            let mut bytes = Vec::new();
            let mut payload = name_length.to_be_bytes().to_vec();
            payload.extend([b'x'; 200]);
            write_message(&mut bytes, (0, 0), 3, SENDER_DESCRIPTION, &payload);
            assert!(matches!(after_greeting(&bytes), Err(VrpnError::Name { .. })), "{name_length}");
        }
    }

    proptest! {
        #[test]
        fn no_bytes_make_it_panic(at in 0_usize..600, value in any::<u8>(), bytes in prop::collection::vec(any::<u8>(), 0..200)) {
            let mut all = stream(0);
            let place = at % all.len();
            all[place] = value;
            all.extend(bytes);
            let mut parser = VrpnParser::new();
            parser.push(&all);
            while let Ok(Some(_)) = parser.next_event() {}
        }
    }
}
