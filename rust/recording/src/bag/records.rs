//! The records that a bag is made of: ROS wiki, Bags/Format/2.0.
//!
//! A record is the length of its header, the header, the length of its data, the data; a header is fields, each of
//! them its length, its name, `=` and its value. Lengths are `u32`, little endian.

use super::Time;
use std::io::{self, Read};

pub(super) const VERSION_LINE: &[u8] = b"#ROSBAG V2.0\n";
pub(super) const OP_MESSAGE: u8 = 0x02;
pub(super) const OP_BAG_HEADER: u8 = 0x03;
pub(super) const OP_INDEX: u8 = 0x04;
pub(super) const OP_CHUNK: u8 = 0x05;
pub(super) const OP_CHUNK_INFO: u8 = 0x06;
pub(super) const OP_CONNECTION: u8 = 0x07;

/// Longest header or data of a record, bytes. Recorders close a chunk at 768 KiB unless told otherwise; a message that is
/// longer makes one of its own.
pub(super) const MAX_RECORD_BYTES: u32 = 256 << 20;

/// A record to be written.
pub(super) fn put_record(out: &mut Vec<u8>, fields: &[(&str, Vec<u8>)], data: &[u8]) {
    let mut header = Vec::new();
    for (name, value) in fields {
        put_field(&mut header, name, value);
    }
    out.extend(to_u32(header.len()).to_le_bytes());
    out.extend_from_slice(&header);
    out.extend(to_u32(data.len()).to_le_bytes());
    out.extend_from_slice(data);
}

/// What stands before a message: the header of its record, and room for its length in the last four bytes. It asks for no
/// memory of its own, since a trial has some thousand messages a second.
pub(super) fn put_message_header(out: &mut Vec<u8>, connection: u32, time: Time) {
    let start = out.len();
    out.extend_from_slice(&[0; 4]);
    put_field(out, "op", &[OP_MESSAGE]);
    put_field(out, "conn", &connection.to_le_bytes());
    put_field(out, "time", &encode_time(time));
    let length = to_u32(out.len() - start - 4);
    out[start..start + 4].copy_from_slice(&length.to_le_bytes());
    out.extend_from_slice(&[0; 4]);
}

/// A field of a header.
pub(super) fn put_field(out: &mut Vec<u8>, name: &str, value: &[u8]) {
    out.extend(to_u32(name.len() + 1 + value.len()).to_le_bytes());
    out.extend_from_slice(name.as_bytes());
    out.push(b'=');
    out.extend_from_slice(value);
}

pub(super) fn encode_u32(value: u32) -> Vec<u8> {
    value.to_le_bytes().to_vec()
}

pub(super) fn encode_time(time: Time) -> [u8; 8] {
    ((u64::from(time.nsecs) << 32) | u64::from(time.secs)).to_le_bytes()
}

pub(super) fn to_u32(value: usize) -> u32 {
    u32::try_from(value).expect("chunks are closed below 1 MB and messages are far below 4 GB")
}

/// A record that was read.
#[derive(Debug)]
pub(super) struct BagRecord {
    /// Its header.
    pub header: BagRecordHeader,
    /// Its data.
    pub data: Vec<u8>,
}

/// Why there is no record.
#[derive(Debug)]
pub(super) enum BagRecordError {
    /// The input ends within it.
    Truncated,
    /// What is there is none.
    Malformed(String),
    /// The system refuses.
    Io(io::Error),
}

impl BagRecord {
    /// Reads a record from the `left` bytes that remain of an input, which it reduces by its own; none at the end. No more
    /// memory is asked for than remains of the input.
    pub(super) fn read(input: &mut impl Read, left: &mut u64) -> Result<Option<BagRecord>, BagRecordError> {
        if *left == 0 {
            return Ok(None);
        }
        let header = read_block(input, left)?;
        let data = read_block(input, left)?;
        Ok(Some(BagRecord {
            header: BagRecordHeader::parse(&header).map_err(BagRecordError::Malformed)?,
            data,
        }))
    }
}

/// A length and as many bytes.
fn read_block(input: &mut impl Read, left: &mut u64) -> Result<Vec<u8>, BagRecordError> {
    let mut take = |length: usize| {
        if *left < length as u64 {
            return Err(BagRecordError::Truncated);
        }
        let mut bytes = vec![0; length];
        input.read_exact(&mut bytes).map_err(|error| match error.kind() {
            io::ErrorKind::UnexpectedEof => BagRecordError::Truncated,
            _ => BagRecordError::Io(error),
        })?;
        *left -= length as u64;
        Ok(bytes)
    };
    let length = take(4)?;
    let length = u32::from_le_bytes([length[0], length[1], length[2], length[3]]);
    if length > MAX_RECORD_BYTES {
        return Err(BagRecordError::Malformed(format!(
            "a record has {length} bytes, expected at most {MAX_RECORD_BYTES}"
        )));
    }
    take(length as usize)
}

/// The fields of a record's header, or of a connection's data.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct BagRecordHeader(Vec<(String, Vec<u8>)>);

impl BagRecordHeader {
    pub(super) fn parse(mut bytes: &[u8]) -> Result<Self, String> {
        let mut fields = Vec::new();
        while !bytes.is_empty() {
            let (length, rest) = bytes.split_first_chunk().ok_or("a field's length is cut off")?;
            let length = u32::from_le_bytes(*length) as usize;
            let (field, rest) = rest
                .split_at_checked(length)
                .ok_or_else(|| format!("a field of {length} bytes stands in a header with {}", rest.len()))?;
            let name = field.split(|byte| *byte == b'=').next().unwrap_or_default();
            let value = field.get(name.len() + 1..).ok_or("a field has no name")?;
            fields.push((String::from_utf8_lossy(name).into_owned(), value.to_vec()));
            bytes = rest;
        }
        Ok(Self(fields))
    }

    pub(super) fn op(&self) -> Result<u8, String> {
        Ok(u8::from_le_bytes(self.bytes("op")?))
    }

    pub(super) fn u32(&self, name: &str) -> Result<u32, String> {
        Ok(u32::from_le_bytes(self.bytes(name)?))
    }

    pub(super) fn u64(&self, name: &str) -> Result<u64, String> {
        Ok(u64::from_le_bytes(self.bytes(name)?))
    }

    /// A time, nanoseconds.
    pub(super) fn time_ns(&self, name: &str) -> Result<u64, String> {
        let [a, b, c, d, e, f, g, h] = self.bytes(name)?;
        let (secs, nsecs) = (u32::from_le_bytes([a, b, c, d]), u32::from_le_bytes([e, f, g, h]));
        Ok(u64::from(secs) * 1_000_000_000 + u64::from(nsecs))
    }

    pub(super) fn text(&self, name: &str) -> Result<&str, String> {
        std::str::from_utf8(self.value(name)?).map_err(|_| format!("field {name:?} is not UTF-8 text"))
    }

    fn bytes<const N: usize>(&self, name: &str) -> Result<[u8; N], String> {
        let value = self.value(name)?;
        value.try_into().map_err(|_| format!("field {name:?} has {} bytes, expected {N}", value.len()))
    }

    fn value(&self, name: &str) -> Result<&[u8], String> {
        let found = self.0.iter().find(|(field, _)| field == name);
        found.map(|(_, value)| value.as_slice()).ok_or_else(|| format!("a record has no field {name:?}"))
    }
}
