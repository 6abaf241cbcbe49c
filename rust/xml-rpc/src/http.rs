//! As much of HTTP as XML-RPC needs: one message with a length, on a connection of its own.

use std::{
    io::{Error, ErrorKind, Read, Result, Write},
    net::TcpStream,
    time::{Duration, Instant},
};

/// Longest head of a message, bytes.
const MAX_HEAD_BYTES: usize = 16 * 1024;
/// Longest body, bytes. The state of a graph of a thousand topics has about one million.
pub(crate) const MAX_BODY_BYTES: usize = 16 * 1024 * 1024;

/// A head and a body.
pub(crate) struct HttpMessage {
    /// Its first line.
    pub(crate) first_line: String,
    pub(crate) body: String,
}

/// Whether a message without a length goes on to the end of the connection, as an answer may, or has no body.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum MissingLength {
    ReadToEnd,
    NoBody,
}

/// Reads a message that is complete before the deadline.
pub(crate) fn read(stream: &mut TcpStream, deadline: Instant, without: MissingLength) -> Result<HttpMessage> {
    let invalid = |what: &str| Error::new(ErrorKind::InvalidData, what.to_owned());
    let mut data = Vec::new();
    let end = loop {
        if let Some(at) = data.windows(4).position(|four| four == b"\r\n\r\n") {
            break at;
        }
        if data.len() > MAX_HEAD_BYTES {
            return Err(invalid("a head of more than 16 KiB"));
        }
        if read_more(stream, &mut data, deadline)? == 0 {
            return Err(ErrorKind::UnexpectedEof.into());
        }
    };
    let head = std::str::from_utf8(&data[..end]).map_err(|_| invalid("a head that is no text"))?.to_owned();
    data.drain(..end + 4);
    let mut lines = head.split("\r\n");
    let first_line = lines.next().unwrap_or_default().to_owned();
    let mut length: Option<usize> = None;
    for (name, value) in lines.filter_map(|line| line.split_once(':')) {
        if name.trim().eq_ignore_ascii_case("transfer-encoding") {
            return Err(invalid("a body in pieces, expected a Content-Length"));
        }
        if name.trim().eq_ignore_ascii_case("content-length") {
            let given = value.trim().parse().map_err(|_| invalid("a Content-Length that is no number"))?;
            if length.replace(given).is_some_and(|other| other != given) {
                return Err(invalid("two different Content-Lengths"));
            }
        }
    }
    let wanted = match (length, without) {
        (Some(length), _) => length,
        (None, MissingLength::ReadToEnd) => usize::MAX,
        (None, MissingLength::NoBody) => return Err(invalid("no Content-Length")),
    };
    if wanted != usize::MAX && wanted > MAX_BODY_BYTES {
        return Err(invalid("a body of more than 16 MiB"));
    }
    while data.len() < wanted {
        if data.len() > MAX_BODY_BYTES {
            return Err(invalid("a body of more than 16 MiB"));
        }
        if read_more(stream, &mut data, deadline)? == 0 {
            match wanted {
                usize::MAX => break,
                _ => return Err(ErrorKind::UnexpectedEof.into()),
            }
        }
    }
    data.truncate(wanted);
    let body = String::from_utf8(data).map_err(|_| invalid("a body that is not UTF-8"))?;
    Ok(HttpMessage { first_line, body })
}

/// Reads what is there; zero at the end of the connection.
fn read_more(stream: &mut TcpStream, data: &mut Vec<u8>, deadline: Instant) -> Result<usize> {
    stream.set_read_timeout(Some(remaining_time(deadline)?))?;
    let mut piece = [0; 16 * 1024];
    let count = stream.read(&mut piece)?;
    data.extend_from_slice(&piece[..count]);
    Ok(count)
}

/// Writes a message with a length, all of it before the deadline.
pub(crate) fn write(stream: &mut TcpStream, head: &str, body: &str, deadline: Instant) -> Result<()> {
    let text = format!(
        "{head}\r\nContent-Type: text/xml\r\nContent-Length: {}\r\nConnection: close\r\n\r\n{body}",
        body.len()
    );
    let mut rest = text.as_bytes();
    while !rest.is_empty() {
        stream.set_write_timeout(Some(remaining_time(deadline)?))?;
        let count = stream.write(rest)?;
        if count == 0 {
            return Err(ErrorKind::WriteZero.into());
        }
        rest = &rest[count..];
    }
    Ok(())
}

/// Until the deadline; an error after it.
fn remaining_time(deadline: Instant) -> Result<Duration> {
    let left = deadline.saturating_duration_since(Instant::now());
    if left.is_zero() { Err(ErrorKind::TimedOut.into()) } else { Ok(left) }
}
