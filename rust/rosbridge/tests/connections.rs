//! Clients that come, stop reading, are no clients, or may not come in.
#![allow(clippy::unwrap_used, clippy::disallowed_methods)]

mod common;

use common::{Client, server, texts};
use proact_http::{AccessConfig, AccessRight, AllowedAddress, ConnectionLimits, ServeError};
use proact_messages::{Time, builtin_type};
use proact_rosbridge::{LocalBus, RosbridgeError, RosbridgeOptions, RosbridgeServer, TopicMessage};
use serde_json::json;
use std::{
    io::{Read, Write},
    net::{Ipv4Addr, TcpStream},
    sync::Arc,
    time::{Duration, Instant},
};
use tokio_tungstenite::tungstenite::connect;

const TEXT: &str = "std_msgs/String";

#[test]
fn a_client_that_stops_reading_loses_old_messages_and_the_others_none() {
    let (server, bus) = server();
    let (mut stuck, mut reader) = (Client::connect(&server), Client::connect(&server));
    for client in [&mut stuck, &mut reader] {
        client.subscribe("/big");
        client.drain_messages();
    }
    let writer = bus.join("/writer");
    bus.advertise(writer, "/big", TEXT, false).unwrap();
    let kind = builtin_type(TEXT).unwrap();
    let rounds = 100;
    for n in 0..rounds {
        // Fifty megabytes in all; the one reads each before the next comes, the other reads nothing.
        let data = format!("{n:03}{}", "x".repeat(500_000));
        let value = kind.parse_json(json!({"data": data}), Time::default()).unwrap();
        bus.publish(&[TopicMessage::new("/big", Some(Arc::clone(&kind)), value)]);
        assert_eq!(reader.next()["msg"]["data"].as_str().unwrap()[..3], format!("{n:03}"));
    }
    let got = texts(&stuck.drain_messages(), "/big");
    let numbers: Vec<usize> = got.iter().map(|text| text[..3].parse().unwrap()).collect();
    assert!(numbers.is_sorted() && numbers.len() < rounds, "{numbers:?}");
    assert_eq!(numbers.last(), Some(&(rounds - 1)), "the newest is never lost");
    drop(stuck);
}

#[test]
fn ten_thousand_subscriptions_and_silent_connections_hurt_nobody() {
    let (server, _bus) = server();
    let silent: Vec<TcpStream> = (0..50).map(|_| TcpStream::connect(server.address()).unwrap()).collect();
    let (mut greedy, mut other) = (Client::connect(&server), Client::connect(&server));
    for n in 0..10_000 {
        greedy.subscribe(&format!("/t{n}"));
    }
    let refused = greedy.drain_messages();
    assert_eq!(refused.len(), 9000);
    assert!(refused.iter().all(|status| status["msg"].as_str().unwrap().contains("of 1000 topics")));
    other.advertise("/t5", TEXT);
    other.subscribe("/t5");
    other.publish("/t5", json!({"data": "still here"}));
    assert_eq!(texts(&other.drain_messages(), "/t5"), ["still here"]);
    assert_eq!(texts(&greedy.drain_messages(), "/t5"), ["still here"]);
    drop(silent);
}

#[test]
fn what_is_no_websocket_is_turned_away() {
    let (server, _bus) = server();
    for request in ["GET / HTTP/1.1\r\nHost: localhost\r\n\r\n", "\x16\x03\x01\x02\x00", "nonsense\r\n\r\n"] {
        let mut stream = TcpStream::connect(server.address()).unwrap();
        stream.write_all(request.as_bytes()).unwrap();
        stream.shutdown(std::net::Shutdown::Write).unwrap();
        let mut answer = Vec::new();
        // An end of the line, orderly or not, is all that is asked for.
        let _ = stream.read_to_end(&mut answer);
        assert!(!String::from_utf8_lossy(&answer).contains("101"), "{request:?}");
    }
    Client::connect(&server).drain_messages();
}

#[test]
fn foreign_pages_are_refused_and_listening_for_others_needs_a_guard() {
    let (server, bus) = server();
    let port = server.address().port();
    let ask = |origin: &str| {
        let request = tokio_tungstenite::tungstenite::http::Request::builder()
            .uri(format!("ws://127.0.0.1:{port}/"))
            .header("Host", format!("127.0.0.1:{port}"))
            .header("Origin", origin)
            .header("Connection", "Upgrade")
            .header("Upgrade", "websocket")
            .header("Sec-WebSocket-Version", "13")
            .header("Sec-WebSocket-Key", "AAAAAAAAAAAAAAAAAAAAAA==")
            .body(())
            .unwrap();
        connect(request).map(|_| ())
    };
    assert!(ask("http://localhost:8090").is_ok());
    assert!(ask("http://evil.example").unwrap_err().to_string().contains("403"));
    assert!(server.drain_notices().iter().any(|notice| notice.contains("evil.example")));
    assert!(ask("null").unwrap_err().to_string().contains("403"));

    let open = |access: AccessConfig| {
        let bind = Ipv4Addr::UNSPECIFIED.into();
        let options = RosbridgeOptions { port: 0, bind, access, ..RosbridgeOptions::default() };
        RosbridgeServer::start(options, Arc::clone(&bus))
    };
    assert!(matches!(
        open(AccessConfig::default()),
        Err(RosbridgeError::Serve(ServeError::AccessNotConfigured { .. }))
    ));
    let listed = AllowedAddress { address: "10.0.0.1".parse().unwrap(), right: AccessRight::Control };
    assert!(open(AccessConfig { allowed_addresses: vec![listed], ..AccessConfig::default() }).is_ok());
    assert!(matches!(
        open(AccessConfig { token: Some("short".to_owned()), ..AccessConfig::default() }),
        Err(RosbridgeError::Serve(ServeError::InvalidToken { .. }))
    ));
    let taken = RosbridgeOptions { port, ..RosbridgeOptions::default() };
    let error = RosbridgeServer::start(taken, LocalBus::new()).err().unwrap().to_string();
    assert!(error.contains(&port.to_string()) && error.contains("--rosbridge"), "{error}");
}

#[test]
fn a_client_too_many_is_told_so_and_comes_in_when_another_has_gone() {
    let (server, _bus) = server();
    let mut clients: Vec<Client> = (0..64).map(|_| Client::connect(&server)).collect();
    for client in &mut clients {
        client.drain_messages();
    }
    let address = format!("ws://{}/", server.address());
    assert!(connect(&address).unwrap_err().to_string().contains("503"));
    assert_eq!(server.client_count(), 64);
    let mut gone = clients.pop().unwrap();
    gone.0.close(None).unwrap();
    while gone.0.read().is_ok() {}
    // Its place is free before the server hangs up.
    Client::connect(&server).drain_messages();
}

#[test]
fn where_there_is_a_token_programs_on_this_machine_show_it_or_are_listed() {
    let start = |listed| {
        let access = AccessConfig {
            allowed_addresses: listed,
            token: Some("a-long-secret".to_owned()),
            ..AccessConfig::default()
        };
        let options = RosbridgeOptions { port: 0, access, ..RosbridgeOptions::default() };
        RosbridgeServer::start(options, LocalBus::new()).unwrap()
    };
    let server = start(vec![]);
    let refused = connect(format!("ws://{}/", server.address())).unwrap_err().to_string();
    assert!(refused.contains("401"), "{refused}");
    assert!(connect(format!("ws://{}/?token=a-long-secret", server.address())).is_ok());
    let here = |right| AllowedAddress { address: Ipv4Addr::LOCALHOST.into(), right };
    let server = start(vec![here(AccessRight::Control)]);
    assert!(connect(format!("ws://{}/", server.address())).is_ok());
    let server = start(vec![here(AccessRight::View)]);
    let refused = connect(format!("ws://{}/", server.address())).unwrap_err().to_string();
    assert!(refused.contains("403"), "{refused}");
}

#[test]
fn a_client_that_never_answers_a_ping_is_dropped() {
    let limits =
        ConnectionLimits { websocket_timeout: Duration::from_millis(250), ..ConnectionLimits::default() };
    let options = RosbridgeOptions { port: 0, limits, ..RosbridgeOptions::default() };
    let server = RosbridgeServer::start(options, LocalBus::new()).unwrap();
    // It says nothing and reads nothing, but holds the line.
    let asleep = Client::connect(&server);
    let begin = Instant::now();
    while server.client_count() > 0 {
        assert!(begin.elapsed() < Duration::from_secs(20), "a client that is silent stays for ever");
        std::thread::yield_now();
    }
    drop(asleep);
}

#[test]
fn a_crowd_that_is_refused_is_told_of_once_and_counted() {
    let (server, _bus) = server();
    for _ in 0..300 {
        let mut stream = TcpStream::connect(server.address()).unwrap();
        write!(
            stream,
            "GET / HTTP/1.1\r\nHost: localhost\r\nOrigin: http://evil.example\r\nConnection: close\r\n\r\n"
        )
        .unwrap();
        let mut answer = String::new();
        stream.read_to_string(&mut answer).unwrap();
        assert!(answer.starts_with("HTTP/1.1 403"), "{answer}");
    }
    let notices = server.drain_notices();
    // The second would be a count, on a machine so slow that it took ten seconds.
    assert!((1..=2).contains(&notices.len()) && notices[0].contains("evil.example"), "{notices:?}");
}
