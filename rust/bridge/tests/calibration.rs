//! The calibration page's server as a browser meets it.
#![allow(clippy::unwrap_used, clippy::disallowed_methods)]

use futures_util::{SinkExt, StreamExt};
use proact_bridge::{
    CalibrationCommand, CalibrationScreen, CalibrationServer, CalibrationView, PageOptions, TestKind,
};
use proact_http::{AccessConfig, AccessRight, AllowedAddress, ConnectionLimits};
use proact_types::Command;
use serde_json::{Value, json};
use std::{
    net::Ipv4Addr,
    time::{Duration, Instant},
};
use tokio::{
    io::{AsyncReadExt, AsyncWriteExt},
    net::TcpStream,
};
use tokio_tungstenite::{
    MaybeTlsStream, WebSocketStream, connect_async,
    tungstenite::{Message, client::IntoClientRequest},
};

/// Only a hanging server takes so long.
const TIMEOUT: Duration = Duration::from_secs(20);

fn start_server() -> (CalibrationServer, String) {
    let options = PageOptions {
        port: 0,
        allow_next_port: false,
        bind: Ipv4Addr::LOCALHOST.into(),
        ..PageOptions::default()
    };
    let server = CalibrationServer::start(options).unwrap();
    let authority = server.url().trim_start_matches("http://").trim_end_matches('/').to_owned();
    (server, authority)
}

async fn next(client: &mut WebSocketStream<MaybeTlsStream<TcpStream>>) -> Value {
    let message =
        tokio::time::timeout(TIMEOUT, client.next()).await.expect("no answer in time").unwrap().unwrap();
    serde_json::from_str(message.to_text().unwrap()).unwrap()
}

#[tokio::test]
async fn a_page_gets_the_newest_object_and_its_buttons_arrive_in_order() {
    let (server, authority) = start_server();
    let screen = |source: &'static str| CalibrationScreen {
        source,
        messages: &[],
        begun: true,
        result: &Value::Null,
        view: CalibrationView::Ready { next: TestKind::Tac1 },
    };
    server.publish(&screen("one"));
    let (mut client, _) = connect_async(format!("ws://{authority}/calibration")).await.unwrap();
    let expected = json!({ "type": "ready", "next": "tac1", "source": "one", "messages": [], "begun": true, "result": null });
    assert_eq!(next(&mut client).await, expected);
    server.publish(&screen("two"));
    assert_eq!(next(&mut client).await["source"], "two");
    for text in
        [r#"{"type":"begin"}"#, r#"{"type":"record_again","gesture":"hand_open"}"#, r#"{"type":"finish"}"#]
    {
        client.send(Message::text(text)).await.unwrap();
    }
    let (mut got, begin) = (Vec::new(), Instant::now());
    while got.len() < 3 && begin.elapsed() < TIMEOUT {
        got.extend(server.drain_commands());
        tokio::task::yield_now().await;
    }
    let again = CalibrationCommand::RecordAgain { gesture: Command::HandOpen.into() };
    assert_eq!(got, [CalibrationCommand::Begin, again, CalibrationCommand::Finish]);
}

#[tokio::test]
async fn malformed_messages_are_answered_with_the_reason_and_change_nothing() {
    let (server, authority) = start_server();
    let (mut client, _) = connect_async(format!("ws://{authority}/calibration")).await.unwrap();
    assert_eq!(next(&mut client).await["type"], "nothing");
    for (text, why) in [
        ("", "EOF"),
        ("[]", "expected"),
        (r#"{"type":"fly"}"#, "unknown variant `fly`"),
        (r#"{"type":"record_again"}"#, "missing field `gesture`"),
        (r#"{"type":"record_again","gesture":""}"#, "expected 1 to 64 bytes"),
    ] {
        client.send(Message::text(text)).await.unwrap();
        let answer = next(&mut client).await;
        assert_eq!(answer["type"], "error");
        assert!(answer["message"].as_str().unwrap().contains(why), "{text:?}: {answer}");
    }
    assert!(server.drain_commands().is_empty());
}

#[tokio::test]
async fn the_page_is_served_and_pages_of_other_sites_are_refused() {
    let (_server, authority) = start_server();
    let answer = ask(&authority, "/").await;
    assert!(answer.starts_with("HTTP/1.1 200") && answer.contains("/calibrate-"), "{answer}");
    let mut foreign = format!("ws://{authority}/calibration").into_client_request().unwrap();
    foreign.headers_mut().insert("Origin", "http://evil.example".parse().unwrap());
    assert!(connect_async(foreign).await.unwrap_err().to_string().contains("403"));
}

/// The answer to `GET target`.
async fn ask(authority: &str, target: &str) -> String {
    let mut stream = TcpStream::connect(authority).await.unwrap();
    let request = format!("GET {target} HTTP/1.1\r\nHost: {authority}\r\nConnection: close\r\n\r\n");
    stream.write_all(request.as_bytes()).await.unwrap();
    let mut answer = String::new();
    tokio::time::timeout(TIMEOUT, stream.read_to_string(&mut answer))
        .await
        .expect("no answer in time")
        .unwrap();
    answer
}

#[tokio::test]
async fn another_machine_needs_the_token() {
    let options = PageOptions {
        port: 0,
        bind: Ipv4Addr::UNSPECIFIED.into(),
        access: AccessConfig { token: Some("long-secret".to_owned()), ..AccessConfig::default() },
        ..PageOptions::default()
    };
    let server = CalibrationServer::start(options).unwrap();
    let Some(url) = server.remote_url() else {
        eprintln!("skipped: this machine has no address but its own");
        return;
    };
    // From an address that is not loopback, this machine is another one.
    let (authority, rest) = url.trim_start_matches("http://").split_once('/').unwrap();
    assert_eq!(rest, "?token=long-secret");
    for (target, status) in [
        ("/", "401"),
        ("/calibration", "401"),
        ("/?token=long-wrong!", "401"),
        ("/?token=long-secret", "303"),
        ("/healthz?token=long-secret", "200"),
    ] {
        let answer = ask(authority, target).await;
        assert!(answer.starts_with(&format!("HTTP/1.1 {status}")), "{target}: {answer}");
    }
}

#[tokio::test]
async fn a_machine_that_may_only_watch_presses_no_buttons() {
    let listed = vec![AllowedAddress { address: Ipv4Addr::LOCALHOST.into(), right: AccessRight::View }];
    let access = AccessConfig {
        allowed_addresses: listed,
        token: Some("long-secret".to_owned()),
        ..AccessConfig::default()
    };
    let options = PageOptions { port: 0, access, ..PageOptions::default() };
    let server = CalibrationServer::start(options).unwrap();
    let authority = server.url().trim_start_matches("http://").trim_end_matches('/').to_owned();
    let (mut client, _) = connect_async(format!("ws://{authority}/calibration")).await.unwrap();
    assert_eq!(next(&mut client).await["type"], "nothing");
    client.send(Message::text(r#"{"type":"begin"}"#)).await.unwrap();
    let answer = next(&mut client).await;
    assert!(answer["message"].as_str().unwrap().contains("may only watch"), "{answer}");
    assert!(server.drain_commands().is_empty());
}

#[tokio::test]
async fn a_page_that_never_answers_a_ping_is_dropped() {
    let limits =
        ConnectionLimits { websocket_timeout: Duration::from_millis(250), ..ConnectionLimits::default() };
    let server = CalibrationServer::start(PageOptions { port: 0, limits, ..PageOptions::default() }).unwrap();
    let authority = server.url().trim_start_matches("http://").trim_end_matches('/').to_owned();
    let request = format!(
        "GET /calibration HTTP/1.1\r\nHost: {authority}\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n\
         Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n\r\n"
    );
    let mut stream = TcpStream::connect(&authority).await.unwrap();
    stream.write_all(request.as_bytes()).await.unwrap();
    // All that comes until the server hangs up: reading alone answers no ping.
    let mut all = Vec::new();
    let ended = tokio::time::timeout(TIMEOUT, stream.read_to_end(&mut all)).await;
    assert!(ended.is_ok(), "a page that is silent stays for ever");
    assert!(all.starts_with(b"HTTP/1.1 101"));
}
