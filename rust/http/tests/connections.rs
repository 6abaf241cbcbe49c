//! Clients that dawdle or come in crowds, over real sockets. All waiting is for the server to hang up, with a limit that only
//! a fault reaches.
#![allow(clippy::unwrap_used, clippy::disallowed_methods)]

mod common;

use axum::{Router, body::Body, routing::get};
use common::{ask, options, status};
use proact_http::{AllowedOrigins, ConnectionLimits, HttpServer, HttpServerOptions};
use std::{
    io::{ErrorKind, Read, Write},
    net::TcpStream,
    process::Command,
    time::{Duration, Instant},
};

/// Only a server that never hangs up takes so long.
const LIMIT: Duration = Duration::from_secs(20);
/// Short enough to wait for.
const SHORT: Duration = Duration::from_millis(300);

fn start(options: HttpServerOptions) -> HttpServer {
    let large = || async { Body::from(vec![0_u8; 64_000_000]) };
    let router = Router::new().route("/", get(|| async { "hello" })).route("/large", get(large));
    HttpServer::start(options, router, |_| {}, std::future::pending()).unwrap()
}

fn impatient() -> HttpServerOptions {
    let limits =
        ConnectionLimits { request_timeout: SHORT, write_timeout: SHORT, ..ConnectionLimits::default() };
    HttpServerOptions { limits, ..options(AllowedOrigins::SameServer) }
}

fn connect(server: &HttpServer) -> TcpStream {
    let stream = TcpStream::connect(server.address()).unwrap();
    stream.set_read_timeout(Some(LIMIT)).unwrap();
    stream
}

/// Reads until the server hangs up.
fn wait_for_end(mut stream: TcpStream) {
    let mut rest = [0; 65536];
    loop {
        match stream.read(&mut rest) {
            Ok(0) => return,
            Ok(_) => {}
            Err(error) if error.kind() == ErrorKind::WouldBlock => panic!("the server did not hang up"),
            // Cut off is an end too.
            Err(_) => return,
        }
    }
}

#[test]
fn who_sends_no_whole_head_in_time_is_hung_up_on_however_slowly_it_goes_on() {
    let server = start(impatient());
    let idle = connect(&server);
    let mut half = connect(&server);
    half.write_all(b"GET / HTTP/1.1\r\nHost: local").unwrap();
    let mut slow = connect(&server);
    slow.set_read_timeout(Some(Duration::from_millis(20))).unwrap();
    let begin = Instant::now();
    for byte in b"GET / HTTP/1.1\r\nHost: localhost\r\nX: ".iter().chain(std::iter::repeat(&b'x')) {
        // A byte at a time, each long before the limit is over.
        let mut answer = [0];
        let gone = slow.write_all(&[*byte]).is_err()
            || match slow.read(&mut answer) {
                Ok(n) => n == 0,
                Err(error) => error.kind() != ErrorKind::WouldBlock,
            };
        if gone {
            break;
        }
        assert!(begin.elapsed() < LIMIT, "a head that never ends is read for ever");
    }
    wait_for_end(idle);
    wait_for_end(half);
}

#[test]
fn a_connection_that_asked_once_and_falls_silent_is_closed() {
    let server = start(impatient());
    let mut kept = connect(&server);
    write!(kept, "GET / HTTP/1.1\r\nHost: localhost\r\n\r\n").unwrap();
    wait_for_end(kept);
    // A body that is announced and never comes.
    let mut body = connect(&server);
    write!(body, "GET / HTTP/1.1\r\nHost: localhost\r\nContent-Length: 1000000\r\n\r\n").unwrap();
    wait_for_end(body);
}

#[test]
fn a_handshake_that_is_not_finished_is_given_up() {
    let server = start(HttpServerOptions { https: true, ..impatient() });
    let idle = connect(&server);
    let mut half = connect(&server);
    half.write_all(&[22, 3, 1, 2, 0, 1]).unwrap();
    wait_for_end(idle);
    wait_for_end(half);
}

#[test]
fn who_asks_for_much_and_reads_nothing_is_given_up() {
    let server = start(impatient());
    let mut greedy = connect(&server);
    write!(greedy, "GET /large HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n").unwrap();
    // The system's buffers take some of it, the rest waits for us. Others are served meanwhile, until the time is over.
    let begin = Instant::now();
    while begin.elapsed() < 3 * SHORT {
        assert_eq!(status(&ask(&server, "/", &["Host: localhost"])), "200");
    }
    let mut got = Vec::new();
    let _ = greedy.read_to_end(&mut got);
    assert!(got.len() < 64_000_000, "all {} bytes came", got.len());
}

#[test]
fn beside_fifteen_hundred_half_open_connections_a_page_still_comes_in() {
    // This process holds both ends, more than the 1,024 handles that are usual.
    let raised =
        Command::new("prlimit").args(["--nofile=4096:", "--pid", &std::process::id().to_string()]).status();
    assert!(raised.unwrap().success(), "prlimit of util-linux raises the number of handles");
    let server = start(options(AllowedOrigins::SameServer));
    let mut streams = Vec::new();
    for n in 0..1500 {
        let mut stream = connect(&server);
        if n % 2 == 0 {
            // An error means that it was hung up on already.
            let _ = stream.write_all(b"GET / HTTP/1.1\r\nHost: ");
        }
        streams.push(stream);
        if n % 100 == 99 {
            assert_eq!(status(&ask(&server, "/", &["Host: localhost"])), "200", "beside {n}");
        }
    }
    // Those that had to go were hung up on, and the rest is no more than are allowed.
    let mut open = 0;
    for stream in &mut streams {
        stream.set_nonblocking(true).unwrap();
        let mut byte = [0];
        open += usize::from(
            matches!(stream.read(&mut byte), Err(error) if error.kind() == ErrorKind::WouldBlock),
        );
    }
    assert!(open <= ConnectionLimits::default().max_unauthorized_per_address, "{open} are open");
    drop(streams);
    assert_eq!(status(&ask(&server, "/", &["Host: localhost"])), "200");
}

#[test]
fn where_everybody_was_let_in_the_next_one_is_told_that_there_is_no_room() {
    let limits = ConnectionLimits { max_connections: 3, ..ConnectionLimits::default() };
    let server = start(HttpServerOptions { limits, ..options(AllowedOrigins::SameServer) });
    let mut kept: Vec<TcpStream> = (0..3).map(|_| connect(&server)).collect();
    for stream in &mut kept {
        write!(stream, "GET / HTTP/1.1\r\nHost: localhost\r\n\r\n").unwrap();
        stream.read_exact(&mut [0; 12]).unwrap();
    }
    let mut late = connect(&server);
    let mut answer = String::new();
    late.read_to_string(&mut answer).unwrap();
    assert!(answer.starts_with("HTTP/1.1 503") && answer.ends_with("try again"), "{answer}");
    let gone = kept.pop().unwrap();
    gone.shutdown(std::net::Shutdown::Write).unwrap();
    wait_for_end(gone);
    assert_eq!(status(&ask(&server, "/", &["Host: localhost"])), "200");
}
