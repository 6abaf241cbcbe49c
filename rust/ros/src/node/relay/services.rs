//! ROS's services over TCP with types that are known only at run time; rosrust's need a compiled type.

use super::super::master::{self, MasterAddresses};
use proact_messages::ServiceType;
use std::{
    collections::BTreeMap,
    io::{self, Read, Write},
    net::{TcpListener, TcpStream, ToSocketAddrs},
    sync::{
        Arc,
        atomic::{AtomicBool, AtomicUsize, Ordering},
    },
    time::{Duration, Instant},
};

/// More bytes than this in one message are refused.
const MAX_MESSAGE_BYTES: usize = 64 << 20;
/// How long a connection may take over its first words.
const HANDSHAKE_TIMEOUT: Duration = Duration::from_secs(5);
/// Calls of one service that may run at the same time.
const MAX_CALLS: usize = 64;

type ServiceHeader = BTreeMap<String, String>;

/// Answers a request, bytes to bytes, or says in a sentence why not.
pub type ServiceHandler = dyn Fn(&[u8]) -> Result<Vec<u8>, String> + Send + Sync;

fn send(stream: &mut impl Write, bytes: &[u8]) -> io::Result<()> {
    stream.write_all(&(bytes.len() as u32).to_le_bytes())?;
    stream.write_all(bytes)
}

fn receive(stream: &mut impl Read) -> io::Result<Vec<u8>> {
    let mut length = [0; 4];
    stream.read_exact(&mut length)?;
    let length = u32::from_le_bytes(length) as usize;
    if length > MAX_MESSAGE_BYTES {
        return Err(io::Error::other(format!(
            "a message of {length} bytes, at most {MAX_MESSAGE_BYTES} are taken"
        )));
    }
    let mut bytes = vec![0; length];
    stream.read_exact(&mut bytes)?;
    Ok(bytes)
}

fn send_header(stream: &mut impl Write, words: &[(&str, &str)]) -> io::Result<()> {
    let mut bytes = Vec::new();
    for (key, value) in words {
        let pair = format!("{key}={value}");
        bytes.extend((pair.len() as u32).to_le_bytes());
        bytes.extend(pair.as_bytes());
    }
    send(stream, &bytes)
}

fn receive_header(stream: &mut impl Read) -> io::Result<ServiceHeader> {
    let bytes = receive(stream)?;
    let (mut words, mut rest) = (ServiceHeader::new(), &bytes[..]);
    while !rest.is_empty() {
        let pair = receive(&mut rest)?;
        if let Some((key, value)) = String::from_utf8_lossy(&pair).split_once('=') {
            words.insert(key.to_owned(), value.to_owned());
        }
    }
    Ok(words)
}

fn connect(addresses: &MasterAddresses, service: &str, timeout: Duration) -> Result<TcpStream, String> {
    let uri = master::service_address(addresses, service)
        .map_err(|_| format!("service {service} is offered by nobody"))?;
    let failed = |e: io::Error| format!("service {service} at {uri} cannot be reached: {e}");
    let at = uri.trim_start_matches("rosrpc://").trim_end_matches('/');
    let mut last = io::Error::other("it has no address");
    for address in at.to_socket_addrs().map_err(failed)? {
        match TcpStream::connect_timeout(&address, timeout.min(HANDSHAKE_TIMEOUT)) {
            Ok(stream) => {
                let limits = stream
                    .set_read_timeout(Some(timeout))
                    .and_then(|()| stream.set_write_timeout(Some(timeout)))
                    .and_then(|()| stream.set_nodelay(true));
                return limits.map(|()| stream).map_err(failed);
            }
            Err(error) => last = error,
        }
    }
    Err(failed(last))
}

/// The type of a service, which its provider tells when asked without a call.
pub(super) fn service_type(addresses: &MasterAddresses, service: &str) -> Result<String, String> {
    let mut stream = connect(addresses, service, HANDSHAKE_TIMEOUT)?;
    let words = [("callerid", &*addresses.name), ("service", service), ("md5sum", "*"), ("probe", "1")];
    let answer = send_header(&mut stream, &words).and_then(|()| receive_header(&mut stream));
    let answer = answer.map_err(|e| format!("service {service} does not tell its type: {e}"))?;
    answer.get("type").cloned().ok_or_else(|| format!("service {service} does not tell its type: {answer:?}"))
}

/// Calls a service: bytes there, bytes back. Gives up at `deadline`.
pub(super) fn call(
    addresses: &MasterAddresses,
    service: &str,
    kind: &ServiceType,
    request: &[u8],
    deadline: Instant,
) -> Result<Vec<u8>, String> {
    let left = deadline.saturating_duration_since(Instant::now());
    // Zero would mean for ever.
    let mut stream = connect(addresses, service, left.max(Duration::from_millis(1)))?;
    let failed = |e: io::Error| format!("service {service} did not answer: {e}");
    let words =
        [("callerid", &*addresses.name), ("service", service), ("md5sum", kind.md5()), ("type", &kind.name)];
    let hello =
        send_header(&mut stream, &words).and_then(|()| receive_header(&mut stream)).map_err(failed)?;
    if let Some(error) = hello.get("error") {
        return Err(format!("service {service}: {error}"));
    }
    send(&mut stream, request).map_err(failed)?;
    let mut done = [0];
    stream.read_exact(&mut done).map_err(failed)?;
    let answer = receive(&mut stream).map_err(failed)?;
    if done[0] == 0 { Err(String::from_utf8_lossy(&answer).into_owned()) } else { Ok(answer) }
}

/// A service on the graph, until it is dropped.
pub struct RawService {
    addresses: MasterAddresses,
    name: String,
    uri: String,
    port: u16,
    ended: Arc<AtomicBool>,
}

impl RawService {
    /// Listens, and tells the master.
    pub(super) fn serve(
        addresses: &MasterAddresses,
        name: &str,
        kind: ServiceType,
        handler: Arc<ServiceHandler>,
    ) -> Result<Self, String> {
        let failed = |e: io::Error| format!("service {name}: {e}");
        // As rosrust's own listeners: on this machine alone if the node is one of this machine, else for whoever reaches it.
        let host = addresses.slave.host();
        let here = host == "localhost" || host.starts_with("127.");
        let listener =
            TcpListener::bind((if here { host.as_str() } else { "0.0.0.0" }, 0)).map_err(failed)?;
        let port = listener.local_addr().map_err(failed)?.port();
        let uri = format!("rosrpc://{host}:{port}");
        let ended = Arc::new(AtomicBool::new(false));
        let (seen, service, caller) = (ended.clone(), name.to_owned(), addresses.name.clone());
        std::thread::spawn(move || {
            let calls = Arc::new(AtomicUsize::new(0));
            for stream in listener.incoming() {
                if seen.load(Ordering::Relaxed) {
                    return;
                }
                let Ok(stream) = stream else { continue };
                if calls.fetch_add(1, Ordering::Relaxed) >= MAX_CALLS {
                    // Closed at once: the caller sees that nobody serves it.
                    calls.fetch_sub(1, Ordering::Relaxed);
                    continue;
                }
                let (calls, service, caller) = (calls.clone(), service.clone(), caller.clone());
                let (kind, handler) = (kind.clone(), handler.clone());
                std::thread::spawn(move || {
                    // A caller that leaves half way harms nobody.
                    let _ = serve_connection(stream, &service, &caller, &kind, &*handler);
                    calls.fetch_sub(1, Ordering::Relaxed);
                });
            }
        });
        let registered = Self { addresses: addresses.clone(), name: name.to_owned(), uri, port, ended };
        master::register_service(addresses, name, &registered.uri)
            .map_err(|reason| format!("service {name}: {reason}"))?;
        Ok(registered)
    }
}

impl Drop for RawService {
    fn drop(&mut self) {
        // The master may be gone; then it knows of no service either.
        let _ = master::unregister_service(&self.addresses, &self.name, &self.uri);
        self.ended.store(true, Ordering::Relaxed);
        // Wakes the listener, which then sees that it has ended.
        let _ = TcpStream::connect(("127.0.0.1", self.port));
    }
}

/// Serves one connection.
fn serve_connection(
    mut stream: TcpStream,
    service: &str,
    caller: &str,
    kind: &ServiceType,
    handler: &ServiceHandler,
) -> io::Result<()> {
    stream.set_nodelay(true)?;
    stream.set_read_timeout(Some(HANDSHAKE_TIMEOUT))?;
    let header = receive_header(&mut stream)?;
    let sum = header.get("md5sum").map_or("*", String::as_str);
    if sum != "*" && sum != kind.md5() {
        let error = format!("{service} is {} with the sum {}, got {sum}", kind.name, kind.md5());
        return send_header(&mut stream, &[("error", &error)]);
    }
    send_header(
        &mut stream,
        &[
            ("callerid", caller),
            ("md5sum", kind.md5()),
            ("type", &kind.name),
            ("request_type", &kind.request.name),
            ("response_type", &kind.response.name),
        ],
    )?;
    if header.contains_key("probe") {
        return Ok(());
    }
    let persistent =
        header.get("persistent").is_some_and(|word| matches!(word.as_str(), "1" | "true" | "True"));
    if persistent {
        stream.set_read_timeout(None)?;
    }
    loop {
        let request = receive(&mut stream)?;
        let (done, answer) = match handler(&request) {
            Ok(answer) => (1, answer),
            Err(reason) => (0, reason.into_bytes()),
        };
        stream.write_all(&[done])?;
        send(&mut stream, &answer)?;
        if !persistent {
            return Ok(());
        }
    }
}
