//! Packets of NatNet 3.1, without any socket. All numbers are little-endian.

/// Longest packet: what UDP carries.
pub(super) const MAX_PACKET_BYTES: usize = 65_507;
/// Length of the header: id and length of the payload.
const HEADER_BYTES: usize = 4;
/// The version that is asked for and parsed.
pub(super) const VERSION: [u8; 4] = [3, 1, 0, 0];

pub(super) const CONNECT: u16 = 0;
const SERVER_INFO: u16 = 1;
pub(super) const REQUEST: u16 = 2;
pub(super) const RESPONSE: u16 = 3;
pub(super) const REQUEST_DEFINITIONS: u16 = 4;
pub(super) const DEFINITIONS: u16 = 5;
const FRAME: u16 = 7;
const TEXT: u16 = 8;
pub(super) const KEEP_ALIVE: u16 = 10;

/// Why a packet cannot be read.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum NatNetError {
    /// It ends too early.
    #[error("a packet of {got} bytes ends within {part}")]
    Truncated {
        /// Bytes of the packet.
        got: usize,
        /// Where.
        part: &'static str,
    },
    /// A number of things that the rest of the packet cannot hold.
    #[error("{got} {part} in a packet with {remaining} bytes left")]
    Count {
        /// As the packet says.
        got: u32,
        /// Of what.
        part: &'static str,
        /// Bytes behind the number.
        remaining: usize,
    },
    /// Bytes behind the end of a frame: it is of another version than was asked for.
    #[error("{extra} bytes behind the end of a frame; it is not of version 3.1, which was asked for")]
    TrailingBytes {
        /// How many.
        extra: usize,
    },
}

/// A rigid body of a frame.
#[derive(Clone, Debug, PartialEq)]
pub struct NatNetRigidBody {
    /// Its number.
    pub id: i32,
    /// m, in Motive's axes.
    pub position: [f32; 3],
    /// x, y, z, w.
    pub quaternion: [f32; 4],
    /// Mean error of its markers, m.
    pub error: f32,
    /// Whether it is seen.
    pub tracked: bool,
}

/// A frame, as far as it is about rigid bodies.
#[derive(Clone, Debug, PartialEq)]
pub struct NatNetFrame {
    /// Its number.
    pub number: i32,
    /// All rigid bodies.
    pub bodies: Vec<NatNetRigidBody>,
    /// Since the software started, s.
    pub timestamp_secs: f64,
    /// Definitions are not those that were sent before.
    pub definitions_changed: bool,
}

/// What a server says of itself.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NatNetServerInfo {
    /// Such as `Motive`.
    pub program: String,
    /// Its version.
    pub program_version: [u8; 4],
    /// Of the stream.
    pub protocol_version: [u8; 4],
    /// Port of frames.
    pub data_port: u16,
    /// The group that frames go to; none where they are sent to each client.
    pub multicast_group: Option<[u8; 4]>,
}

/// The name of a number.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RigidBodyDefinition {
    /// The number.
    pub id: i32,
    /// The name.
    pub name: String,
}

/// A packet.
#[derive(Clone, Debug, PartialEq)]
pub enum NatNetMessage {
    /// Answer to the greeting.
    Server(NatNetServerInfo),
    /// Names of rigid bodies.
    Definitions(Vec<RigidBodyDefinition>),
    /// A frame.
    Frame(NatNetFrame),
    /// Answer to a request: text, or empty or a number.
    Response(Vec<u8>),
    /// A message for people.
    Text(String),
    /// What does not concern a client of rigid bodies.
    Other(u16),
}

/// A packet with its header.
pub(super) fn packet(id: u16, payload: &[u8]) -> Vec<u8> {
    let mut bytes = id.to_le_bytes().to_vec();
    bytes.extend((payload.len() as u16).to_le_bytes());
    bytes.extend(payload);
    bytes
}

/// The greeting.
pub(super) fn connect_packet() -> Vec<u8> {
    let mut payload = vec![0; 256];
    payload[..9].copy_from_slice(b"NatNetLib");
    // Twice: the program's version, and that of the protocol.
    payload.extend(VERSION);
    payload.extend(VERSION);
    packet(CONNECT, &payload)
}

/// Reads a packet. Memory that is taken is bounded by its length.
///
/// # Errors
/// [`NatNetError`] for one that is cut off, or holds together in no way.
pub fn parse(bytes: &[u8]) -> Result<NatNetMessage, NatNetError> {
    let mut reader = PacketReader { bytes, at: 0 };
    let (id, length) = (reader.u16("the header")?, usize::from(reader.u16("the header")?));
    let Some(payload) = bytes.get(HEADER_BYTES..HEADER_BYTES + length) else {
        return Err(NatNetError::Truncated { got: bytes.len(), part: "the payload" });
    };
    let mut reader = PacketReader { bytes: payload, at: 0 };
    Ok(match id {
        SERVER_INFO => NatNetMessage::Server(server_info(&mut reader)?),
        DEFINITIONS => NatNetMessage::Definitions(definitions(&mut reader)?),
        FRAME => NatNetMessage::Frame(frame(&mut reader)?),
        RESPONSE => NatNetMessage::Response(payload.to_vec()),
        TEXT => NatNetMessage::Text(String::from_utf8_lossy(payload).trim_end_matches('\0').to_owned()),
        other => NatNetMessage::Other(other),
    })
}

fn server_info(reader: &mut PacketReader<'_>) -> Result<NatNetServerInfo, NatNetError> {
    let part = "the server's name";
    let name = reader.take(256, part)?;
    let end = name.iter().position(|byte| *byte == 0).unwrap_or(name.len());
    let program = String::from_utf8_lossy(&name[..end]).into_owned();
    let (program_version, protocol_version) = (reader.array("its version")?, reader.array("its version")?);
    let (mut data_port, mut group) = (super::NATNET_DATA_PORT, Some(super::NATNET_GROUP));
    // Servers before version 3 end here.
    if reader.remaining() > 0 {
        reader.take(8, "the rate of the clock")?;
        data_port = reader.u16("the data port")?;
        let multicast = reader.take(1, "the kind of transmission")?[0] != 0;
        let address = reader.array("the group")?;
        group = multicast.then_some(address);
    }
    Ok(NatNetServerInfo { program, program_version, protocol_version, data_port, multicast_group: group })
}

/// Names of all rigid bodies up to the first thing that is neither marker set, body nor skeleton.
fn definitions(reader: &mut PacketReader<'_>) -> Result<Vec<RigidBodyDefinition>, NatNetError> {
    let mut found = Vec::new();
    for _ in 0..reader.count(4, "definitions")? {
        match reader.i32("the kind of a definition")? {
            0 => {
                reader.text("the name of a marker set")?;
                for _ in 0..reader.count(1, "marker names")? {
                    reader.text("the name of a marker")?;
                }
            }
            1 => found.push(body_definition(reader)?),
            2 => {
                reader.text("the name of a skeleton")?;
                reader.i32("the number of a skeleton")?;
                for _ in 0..reader.count(25, "bones")? {
                    // Bones are none of the bodies that frames list apart.
                    body_definition(reader)?;
                }
            }
            // Force plates, devices and cameras have no length here, and come behind the bodies.
            _ => break,
        }
    }
    Ok(found)
}

fn body_definition(reader: &mut PacketReader<'_>) -> Result<RigidBodyDefinition, NatNetError> {
    let part = "the definition of a body";
    let name = reader.text(part)?;
    let id = reader.i32(part)?;
    // Parent and offset from it.
    reader.take(4 + 12, part)?;
    let markers = reader.count(16, "markers of a body")?;
    reader.take(markers * 16, part)?;
    Ok(RigidBodyDefinition { id, name })
}

fn frame(reader: &mut PacketReader<'_>) -> Result<NatNetFrame, NatNetError> {
    let number = reader.i32("the number of the frame")?;
    for _ in 0..reader.count(5, "marker sets")? {
        reader.text("the name of a marker set")?;
        let markers = reader.count(12, "markers")?;
        reader.take(markers * 12, "markers")?;
    }
    let markers = reader.count(12, "other markers")?;
    reader.take(markers * 12, "other markers")?;
    let count = reader.count(RIGID_BODY_BYTES, "rigid bodies")?;
    let bodies = (0..count).map(|_| body(reader)).collect::<Result<Vec<_>, _>>()?;
    for _ in 0..reader.count(8, "skeletons")? {
        reader.i32("the number of a skeleton")?;
        let bones = reader.count(RIGID_BODY_BYTES, "bones")?;
        reader.take(bones * RIGID_BODY_BYTES, "bones")?;
    }
    let labeled_markers = reader.count(26, "labelled markers")?;
    reader.take(labeled_markers * 26, "labelled markers")?;
    for part in ["force plates", "devices"] {
        for _ in 0..reader.count(8, part)? {
            reader.i32(part)?;
            for _ in 0..reader.count(4, "channels")? {
                let values = reader.count(4, "values")?;
                reader.take(values * 4, "values")?;
            }
        }
    }
    let part = "the end of the frame";
    // Time code and its part; then the time of the frame, and three times of its transmission.
    reader.take(8, part)?;
    let seconds = f64::from_le_bytes(reader.array(part)?);
    reader.take(24, part)?;
    let flags = reader.u16(part)?;
    reader.take(4, part)?;
    if reader.remaining() > 0 {
        return Err(NatNetError::TrailingBytes { extra: reader.remaining() });
    }
    Ok(NatNetFrame { number, bodies, timestamp_secs: seconds, definitions_changed: flags & 2 != 0 })
}

/// Bytes of a rigid body in a frame.
const RIGID_BODY_BYTES: usize = 38;

fn body(reader: &mut PacketReader<'_>) -> Result<NatNetRigidBody, NatNetError> {
    let part = "a rigid body";
    let id = reader.i32(part)?;
    let mut numbers = [0.0; 8];
    for number in &mut numbers {
        *number = f32::from_le_bytes(reader.array(part)?);
    }
    let [x, y, z, qx, qy, qz, qw, error] = numbers;
    let tracked = reader.u16(part)? & 1 != 0;
    Ok(NatNetRigidBody { id, position: [x, y, z], quaternion: [qx, qy, qz, qw], error, tracked })
}

struct PacketReader<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl<'a> PacketReader<'a> {
    fn remaining(&self) -> usize {
        self.bytes.len() - self.at
    }

    fn take(&mut self, count: usize, part: &'static str) -> Result<&'a [u8], NatNetError> {
        let found = self.bytes[self.at..].get(..count);
        let found = found.ok_or(NatNetError::Truncated { got: self.bytes.len(), part })?;
        self.at += count;
        Ok(found)
    }

    fn array<const N: usize>(&mut self, part: &'static str) -> Result<[u8; N], NatNetError> {
        let mut array = [0; N];
        array.copy_from_slice(self.take(N, part)?);
        Ok(array)
    }

    fn u16(&mut self, part: &'static str) -> Result<u16, NatNetError> {
        Ok(u16::from_le_bytes(self.array(part)?))
    }

    fn i32(&mut self, part: &'static str) -> Result<i32, NatNetError> {
        Ok(i32::from_le_bytes(self.array(part)?))
    }

    /// A number of things of at least `each` bytes, which the rest can hold.
    fn count(&mut self, each: usize, part: &'static str) -> Result<usize, NatNetError> {
        let got = u32::from_le_bytes(self.array(part)?);
        let left = self.remaining();
        let count = usize::try_from(got).ok().filter(|count| *count <= left / each);
        count.ok_or(NatNetError::Count { got, part, remaining: left })
    }

    /// Up to a zero.
    fn text(&mut self, part: &'static str) -> Result<String, NatNetError> {
        let rest = &self.bytes[self.at..];
        let end = rest.iter().position(|byte| *byte == 0);
        let end = end.ok_or(NatNetError::Truncated { got: self.bytes.len(), part })?;
        self.at += end + 1;
        Ok(String::from_utf8_lossy(&rest[..end]).into_owned())
    }
}

/// A frame as a 3.1 server sends it, with nothing but rigid bodies.
pub(super) fn frame_packet(frame: &NatNetFrame) -> Vec<u8> {
    let mut payload = frame.number.to_le_bytes().to_vec();
    payload.extend([0; 8]);
    payload.extend((frame.bodies.len() as u32).to_le_bytes());
    for body in &frame.bodies {
        payload.extend(body.id.to_le_bytes());
        let numbers = body.position.iter().chain(&body.quaternion).chain(std::iter::once(&body.error));
        numbers.for_each(|number| payload.extend(number.to_le_bytes()));
        payload.extend(u16::from(body.tracked).to_le_bytes());
    }
    // No skeletons, labelled markers, force plates, devices; no time code.
    payload.extend([0; 16 + 8]);
    payload.extend(frame.timestamp_secs.to_le_bytes());
    payload.extend([0; 24]);
    payload.extend((u16::from(frame.definitions_changed) << 1).to_le_bytes());
    payload.extend([0; 4]);
    packet(FRAME, &payload)
}

/// What a server says of itself, as a packet.
pub(super) fn server_info_packet(info: &NatNetServerInfo) -> Vec<u8> {
    let mut payload = vec![0; 256];
    let name = info.program.as_bytes();
    let length = name.len().min(255);
    payload[..length].copy_from_slice(&name[..length]);
    payload.extend(info.program_version);
    payload.extend(info.protocol_version);
    payload.extend(10_000_000_u64.to_le_bytes());
    payload.extend(info.data_port.to_le_bytes());
    payload.push(u8::from(info.multicast_group.is_some()));
    payload.extend(info.multicast_group.unwrap_or_default());
    packet(SERVER_INFO, &payload)
}

/// Definitions as a packet.
pub(super) fn definitions_packet(bodies: &[RigidBodyDefinition]) -> Vec<u8> {
    let mut payload = (bodies.len() as u32).to_le_bytes().to_vec();
    for body in bodies {
        payload.extend(1_i32.to_le_bytes());
        payload.extend(body.name.as_bytes());
        payload.push(0);
        payload.extend(body.id.to_le_bytes());
        payload.extend((-1_i32).to_le_bytes());
        payload.extend([0; 12 + 4]);
    }
    packet(DEFINITIONS, &payload)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn a_frame() -> NatNetFrame {
        let body = |id| NatNetRigidBody {
            id,
            position: [0.1, 1.4, -0.3],
            quaternion: [0.0, 0.0, 0.0, 1.0],
            error: 0.0005,
            tracked: id != 8,
        };
        NatNetFrame {
            number: 42,
            bodies: vec![body(7), body(8)],
            timestamp_secs: 12.5,
            definitions_changed: true,
        }
    }

    fn info(group: Option<[u8; 4]>) -> NatNetServerInfo {
        NatNetServerInfo {
            program: "Motive".into(),
            program_version: [3, 1, 0, 0],
            protocol_version: [4, 1, 0, 0],
            data_port: 1511,
            multicast_group: group,
        }
    }

    #[test]
    fn what_is_written_is_read() {
        assert_eq!(parse(&frame_packet(&a_frame())), Ok(NatNetMessage::Frame(a_frame())));
        for group in [None, Some([239, 255, 42, 99])] {
            assert_eq!(parse(&server_info_packet(&info(group))), Ok(NatNetMessage::Server(info(group))));
        }
        let named = vec![RigidBodyDefinition { id: 7, name: "Schulter".into() }];
        assert_eq!(parse(&definitions_packet(&named)), Ok(NatNetMessage::Definitions(named)));
    }

    #[test]
    fn a_packet_cut_anywhere_is_refused_and_says_where() {
        let whole = frame_packet(&a_frame());
        for length in 0..whole.len() {
            let error = parse(&whole[..length]).unwrap_err();
            assert!(matches!(error, NatNetError::Truncated { .. }), "{length}: {error}");
            // The same with a header that fits the rest.
            if length >= HEADER_BYTES {
                let cut = packet(FRAME, &whole[HEADER_BYTES..length]);
                assert!(parse(&cut).is_err(), "{length}");
            }
        }
        let mut longer = whole[HEADER_BYTES..].to_vec();
        longer.extend([0; 8]);
        assert_eq!(parse(&packet(FRAME, &longer)), Err(NatNetError::TrailingBytes { extra: 8 }));
        let mut many = whole[HEADER_BYTES..].to_vec();
        many[12..16].copy_from_slice(&u32::MAX.to_le_bytes());
        assert!(matches!(parse(&packet(FRAME, &many)), Err(NatNetError::Count { got: u32::MAX, .. })));
    }

    proptest! {
        #[test]
        fn no_bytes_make_it_panic(at in 0_usize..200, value in any::<u8>(), id in 0_u16..16, bytes in prop::collection::vec(any::<u8>(), 0..300)) {
            let mut changed = frame_packet(&a_frame());
            let place = at % changed.len();
            changed[place] = value;
            let _ = parse(&changed);
            let _ = parse(&packet(id, &bytes));
            let _ = parse(&bytes);
        }
    }
}
