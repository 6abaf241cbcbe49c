//! Servers on a port of their own. The bytes of an input go out as they are, behind a handshake where there is one; then
//! the server must answer somebody else.

use super::TargetFn;
use proact_bridge::{PageContent, PageOptions, PageServer};
use proact_description::mpl_right_arm;
use proact_rosbridge::{LocalBus, RosbridgeOptions, RosbridgeServer, TopicBus};
use proact_tasks::{DEFAULT_TASK, TaskSpec};
use std::{
    io::{Read, Write},
    net::{Shutdown, SocketAddr, TcpStream},
    path::Path,
    sync::Arc,
    time::Duration,
};

/// Only what fails waits so long.
const TIMEOUT: Duration = Duration::from_secs(3);

fn page_server() -> PageServer {
    let task = TaskSpec::named(DEFAULT_TASK, 1).and_then(|task| task.build(false)).expect("it ships");
    let content = PageContent {
        title: "fuzz".to_owned(),
        setup: "still".to_owned(),
        arm: mpl_right_arm(),
        meshes: vec![],
        scene: task.scene().clone(),
        briefing: task.briefing().clone(),
        interactive: true,
        lean: true,
        method: Default::default(),
        methods: vec![],
    };
    PageServer::start(PageOptions { port: 0, ..PageOptions::default() }, content).expect("a free port")
}

/// Where a browser would connect.
fn address_of(server: &PageServer) -> SocketAddr {
    let port = server.url().trim_end_matches('/').rsplit(':').next().and_then(|port| port.parse().ok());
    SocketAddr::from(([127, 0, 0, 1], port.expect("the address ends with a port")))
}

/// Bytes up to the empty line that ends a head.
fn read_response_head(stream: &mut TcpStream) -> Vec<u8> {
    let (mut bytes, mut byte) = (Vec::new(), [0]);
    while !bytes.ends_with(b"\r\n\r\n") && stream.read(&mut byte).is_ok_and(|count| count == 1) {
        bytes.push(byte[0]);
    }
    bytes
}

fn connect(address: SocketAddr) -> TcpStream {
    let stream = TcpStream::connect(address).expect("the server listens");
    stream.set_read_timeout(Some(TIMEOUT)).expect("a socket");
    stream.set_nodelay(true).expect("a socket");
    stream
}

/// A WebSocket, open.
fn upgrade_to_websocket(address: SocketAddr, path: &str) -> TcpStream {
    let mut stream = connect(address);
    let request = format!(
        "GET {path} HTTP/1.1\r\nHost: localhost:{}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n\
         Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n\r\n",
        address.port()
    );
    stream.write_all(request.as_bytes()).expect("the server listens");
    let answer = read_response_head(&mut stream);
    assert!(answer.starts_with(b"HTTP/1.1 101"), "the server answers {:?}", String::from_utf8_lossy(&answer));
    stream
}

/// One frame: masked with zeros, so that its bytes are those of the input.
fn frame(kind: u8, payload: &[u8]) -> Vec<u8> {
    let mut bytes = vec![kind];
    match payload.len() {
        length @ 0..126 => bytes.push(0x80 | length as u8),
        length @ 126..65536 => {
            bytes.push(0x80 | 126);
            bytes.extend_from_slice(&(length as u16).to_be_bytes());
        }
        length => {
            bytes.push(0x80 | 127);
            bytes.extend_from_slice(&(length as u64).to_be_bytes());
        }
    }
    bytes.extend_from_slice(&[0; 4]);
    bytes.extend_from_slice(payload);
    bytes
}

/// Lines as messages: text, or with a byte above 127 in front frames of whatever kind that byte says.
fn send_lines(mut stream: TcpStream, bytes: &[u8]) {
    for line in bytes.split(|b| *b == b'\n') {
        let sent = match line {
            [kind, payload @ ..] if *kind >= 0x80 => stream.write_all(&frame(*kind, payload)),
            text => stream.write_all(&frame(0x81, text)),
        };
        if sent.is_err() {
            return;
        }
    }
    // A close, and whatever the server had to say until its own.
    let _ = stream.write_all(&frame(0x88, &[]));
    let _ = stream.shutdown(Shutdown::Write);
    let mut buffer = [0; 4096];
    while stream.read(&mut buffer).is_ok_and(|count| count > 0) {}
}

pub(super) fn page_socket(_: &Path) -> TargetFn {
    let server = page_server();
    let address = address_of(&server);
    Box::new(move |bytes| {
        // The first byte chooses who connects.
        let [role, bytes @ ..] = bytes else { return };
        let path = if role % 2 == 0 { "/live" } else { "/live?role=experimenter" };
        send_lines(upgrade_to_websocket(address, path), bytes);
        drop(server.drain_inputs());
        drop(upgrade_to_websocket(address, "/live"));
    })
}

pub(super) fn page_http(_: &Path) -> TargetFn {
    let server = page_server();
    let address = address_of(&server);
    Box::new(move |bytes| {
        let mut stream = connect(address);
        let _ = stream.write_all(bytes);
        let _ = stream.shutdown(Shutdown::Write);
        let mut buffer = [0; 4096];
        while stream.read(&mut buffer).is_ok_and(|count| count > 0) {}
        drop(upgrade_to_websocket(address, "/live"));
        // It lives as long as this does.
        let _ = &server;
    })
}

pub(super) fn rosbridge_socket(_: &Path) -> TargetFn {
    let bus: Arc<dyn TopicBus> = LocalBus::new();
    let options = RosbridgeOptions { port: 0, ..RosbridgeOptions::default() };
    let server = RosbridgeServer::start(options, Arc::clone(&bus)).expect("a free port");
    Box::new(move |bytes| {
        send_lines(upgrade_to_websocket(server.address(), "/"), bytes);
        drop(upgrade_to_websocket(server.address(), "/"));
        let _ = &bus;
    })
}
