//! The header of a TCPROS connection: fields `key=value`, each after its length in four bytes, all after their whole length.
//! Numbers are little endian. Subscriber and publisher send one each before the first message.

use std::{
    collections::BTreeMap,
    io::{self, Read, Write},
};

/// Longest header, bytes. The longest message definition of ROS 1 packages has some 40 kB.
const MAX_BYTES: usize = 256 * 1024;
/// Most fields. ROS 1 uses ten.
const MAX_FIELDS: usize = 64;
/// Bytes of a length.
const LENGTH_BYTES: usize = 4;

/// Fields by key.
pub(super) type HeaderFields = BTreeMap<String, String>;

/// Why a header cannot be read.
#[derive(Debug, thiserror::Error)]
pub(super) enum HeaderError {
    #[error("the header cannot be read: {0}")]
    Io(#[from] io::Error),
    #[error("the header has {got} bytes, at most {MAX_BYTES} are allowed")]
    TooLong { got: usize },
    #[error("the header has more than {MAX_FIELDS} fields")]
    TooManyFields,
    #[error("a field has {got} bytes, and {left} are left in the header")]
    FieldTooLong { got: usize, left: usize },
    #[error("field {field:?} has no '='")]
    WithoutValue { field: String },
}

/// Reads a header. Memory grows with the bytes that came, not with the length that was announced.
///
/// # Errors
/// [`HeaderError`].
pub(super) fn read(from: &mut impl Read) -> Result<HeaderFields, HeaderError> {
    let mut length = [0; LENGTH_BYTES];
    from.read_exact(&mut length)?;
    let length = u32::from_le_bytes(length) as usize;
    if length > MAX_BYTES {
        return Err(HeaderError::TooLong { got: length });
    }
    let mut bytes = Vec::new();
    from.take(length as u64).read_to_end(&mut bytes)?;
    if bytes.len() < length {
        return Err(io::Error::from(io::ErrorKind::UnexpectedEof).into());
    }
    parse(&bytes)
}

fn parse(mut bytes: &[u8]) -> Result<HeaderFields, HeaderError> {
    let mut fields = HeaderFields::new();
    let mut count = 0;
    while !bytes.is_empty() {
        count += 1;
        if count > MAX_FIELDS {
            return Err(HeaderError::TooManyFields);
        }
        let left = bytes.len().saturating_sub(LENGTH_BYTES);
        let Some((length, rest)) = bytes.split_first_chunk::<LENGTH_BYTES>() else {
            return Err(HeaderError::FieldTooLong { got: LENGTH_BYTES, left: bytes.len() });
        };
        let length = u32::from_le_bytes(*length) as usize;
        let Some((field, rest)) = rest.split_at_checked(length) else {
            return Err(HeaderError::FieldTooLong { got: length, left });
        };
        bytes = rest;
        // Comments of a message definition may have bytes that are not UTF-8.
        let field = String::from_utf8_lossy(field);
        let Some((key, value)) = field.split_once('=') else {
            return Err(HeaderError::WithoutValue { field: field.into_owned() });
        };
        fields.insert(key.to_owned(), value.to_owned());
    }
    Ok(fields)
}

/// Writes a header.
pub(super) fn write(fields: &[(&str, &str)]) -> Vec<u8> {
    let length = |bytes: usize| (bytes as u32).to_le_bytes();
    let of_field = |(key, value): &(&str, &str)| key.len() + 1 + value.len();
    let whole = fields.iter().map(|field| LENGTH_BYTES + of_field(field)).sum();
    let mut bytes = Vec::with_capacity(LENGTH_BYTES + whole);
    bytes.extend(length(whole));
    for field in fields {
        bytes.extend(length(of_field(field)));
        bytes.extend(field.0.as_bytes());
        bytes.push(b'=');
        bytes.extend(field.1.as_bytes());
    }
    bytes
}

/// Sends a subscriber's header and returns the publisher's.
///
/// # Errors
/// The socket's; an answer that is no header.
pub(crate) fn exchange(
    stream: &mut (impl Read + Write),
    fields: &[(&str, &str)],
) -> Result<BTreeMap<String, String>, String> {
    stream.write_all(&write(fields)).map_err(|error| error.to_string())?;
    read(stream).map_err(|error| error.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fields(pairs: &[(&str, &str)]) -> HeaderFields {
        pairs.iter().map(|(key, value)| ((*key).to_owned(), (*value).to_owned())).collect()
    }

    #[test]
    fn the_bytes_are_those_of_the_wiki() {
        let bytes = [11, 0, 0, 0, 7, 0, 0, 0, b'a', b'b', b'c', b'=', b'1', b'2', b'3'];
        assert_eq!(write(&[("abc", "123")]), bytes);
        assert_eq!(read(&mut &bytes[..]).unwrap(), fields(&[("abc", "123")]));
    }

    #[test]
    fn what_is_written_is_read_and_what_follows_is_left() {
        let pairs =
            [("md5sum", "*"), ("message_definition", "float64 x\nstring name=value\n"), ("empty", "")];
        let mut bytes = write(&pairs);
        bytes.extend(b"message");
        let mut rest = &bytes[..];
        assert_eq!(read(&mut rest).unwrap(), fields(&pairs));
        assert_eq!(rest, b"message");
        assert_eq!(read(&mut &[0, 0, 0, 0][..]).unwrap(), HeaderFields::new());
    }

    #[test]
    fn bytes_that_are_not_utf_8_do_not_end_the_connection() {
        let bytes = [7, 0, 0, 0, 3, 0, 0, 0, b'a', b'=', 0xfc];
        assert_eq!(read(&mut &bytes[..]).unwrap(), fields(&[("a", "\u{fffd}")]));
    }

    #[test]
    fn lengths_that_lie_are_refused() {
        let error_text = |bytes: &[u8]| read(&mut &bytes[..]).unwrap_err().to_string();
        assert_eq!(
            error_text(&[255, 255, 255, 255]),
            "the header has 4294967295 bytes, at most 262144 are allowed"
        );
        assert!(error_text(&[0, 0]).starts_with("the header cannot be read"));
        assert!(error_text(&[9, 0, 0, 0, 1]).starts_with("the header cannot be read"));
        assert_eq!(
            error_text(&[5, 0, 0, 0, 9, 0, 0, 0, b'a']),
            "a field has 9 bytes, and 1 are left in the header"
        );
        assert_eq!(error_text(&[2, 0, 0, 0, 9, 0]), "a field has 4 bytes, and 2 are left in the header");
        assert_eq!(error_text(&[5, 0, 0, 0, 1, 0, 0, 0, b'a']), "field \"a\" has no '='");
        let many = write(&vec![("a", "1"); MAX_FIELDS + 1]);
        assert_eq!(error_text(&many), "the header has more than 64 fields");
    }
}
