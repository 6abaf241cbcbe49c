use crate::{
    codec,
    convert::{from_params, into_params},
    error::{Error, Result},
    http::{self, MissingLength},
    value::{Fault, Params, Response},
};
use serde::{Deserialize, Serialize};
use std::{
    fmt,
    io::ErrorKind,
    net::{TcpStream, ToSocketAddrs},
    str::FromStr,
    time::{Duration, Instant},
};

/// For the connection, and for the whole of a call.
const CONNECT_TIMEOUT: Duration = Duration::from_secs(10);
const CALL_TIMEOUT: Duration = Duration::from_secs(60);
/// The port of HTTP, where an address names none.
const HTTP_PORT: u16 = 80;

/// The address of a node or a master.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Url {
    uri: String,
    host: String,
    port: u16,
    path: String,
}

impl FromStr for Url {
    type Err = Error;

    fn from_str(text: &str) -> Result<Url> {
        let bad = || Error::Address { text: text.to_owned() };
        let plain = text.bytes().all(|byte| byte.is_ascii_graphic());
        let rest = text.strip_prefix("http://").filter(|_| plain).ok_or_else(bad)?;
        let (authority, path) = match rest.find('/') {
            Some(at) => rest.split_at(at),
            None => (rest, "/"),
        };
        // An address of version 6 has colons of its own, and brackets around it.
        let (host, port) = match authority.strip_prefix('[') {
            Some(rest) => rest.split_once(']').ok_or_else(bad)?,
            None => authority.find(':').map_or((authority, ""), |at| authority.split_at(at)),
        };
        let port = match port.strip_prefix(':') {
            Some(port) => port.parse().map_err(|_| bad())?,
            None if port.is_empty() => HTTP_PORT,
            None => return Err(bad()),
        };
        if host.is_empty() || host.contains('@') {
            return Err(bad());
        }
        Ok(Url { uri: text.to_owned(), host: host.to_owned(), port, path: path.to_owned() })
    }
}

impl Url {
    /// The host's name or address, as an address has it: in brackets if it is one of version 6.
    pub fn host(&self) -> String {
        if self.host.contains(':') { format!("[{}]", self.host) } else { self.host.clone() }
    }
}

impl fmt::Display for Url {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(&self.uri)
    }
}

/// Calls once.
///
/// # Errors
/// As [`Client::call_value`].
pub fn call_value(address: &Url, name: impl Into<String>, params: Params) -> Result<Response> {
    Client::new()?.call_value(address, name, params)
}

/// Calls nodes and masters, each call on a connection of its own.
#[derive(Debug)]
pub struct Client(());

impl Client {
    /// A client.
    ///
    /// # Errors
    /// None; the crate in whose place this stands had some.
    pub fn new() -> Result<Client> {
        Ok(Client(()))
    }

    /// Calls with values.
    ///
    /// # Errors
    /// [`Error::Connection`] without an answer in time, [`Error::Message`] for one that is no XML-RPC.
    pub fn call_value(&mut self, address: &Url, name: impl Into<String>, params: Params) -> Result<Response> {
        let failed = |source| Error::Connection { address: address.to_string(), source };
        let body = codec::write_call(&name.into(), &params);
        let answer = exchange(address, &body).map_err(failed)?;
        // Faults come with this status too.
        match answer.first_line.split(' ').nth(1) {
            Some("200") => codec::read_response(&answer.body),
            _ => Err(Error::Message {
                what: format!("{address} answered {:?}, expected 200", answer.first_line),
            }),
        }
    }

    /// Calls with types of Rust.
    ///
    /// # Errors
    /// As [`Client::call_value`], and [`Error::Value`] for a value that is of another type.
    pub fn call<'a, Q: Serialize, A: Deserialize<'a>>(
        &mut self,
        address: &Url,
        name: impl Into<String>,
        arguments: Q,
    ) -> Result<std::result::Result<A, Fault>> {
        match self.call_value(address, name, into_params(&arguments)?)? {
            Ok(values) => from_params(values).map(Ok),
            Err(fault) => Ok(Err(fault)),
        }
    }
}

fn exchange(address: &Url, body: &str) -> std::io::Result<http::HttpMessage> {
    let mut last = ErrorKind::AddrNotAvailable.into();
    for candidate in (address.host.as_str(), address.port).to_socket_addrs()? {
        match TcpStream::connect_timeout(&candidate, CONNECT_TIMEOUT) {
            Err(error) => last = error,
            Ok(mut stream) => {
                let deadline = Instant::now() + CALL_TIMEOUT;
                let _ = stream.set_nodelay(true);
                // Version 1.0: an answer has a length or goes on to the end, and never comes in pieces.
                let Url { port, path, .. } = address;
                let head = format!("POST {path} HTTP/1.0\r\nHost: {}:{port}", address.host());
                http::write(&mut stream, &head, body, deadline)?;
                return http::read(&mut stream, deadline, MissingLength::ReadToEnd);
            }
        }
    }
    Err(last)
}
