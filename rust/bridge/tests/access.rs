//! What the page's server lets be done by those who may come in.
#![allow(clippy::unwrap_used, clippy::disallowed_methods)]

mod common;

use common::*;
use futures_util::StreamExt;
use proact_bridge::{ClientInput, PageOptions, PageServer, Signals, StudyAction};
use proact_http::{AccessConfig, AccessRight, AllowedAddress, ConnectionLimits};
use std::{
    net::Ipv4Addr,
    time::{Duration, Instant},
};
use tokio_tungstenite::{connect_async, tungstenite::client::IntoClientRequest};

/// The token is `long-secret`.
fn token() -> AccessConfig {
    AccessConfig { token: Some("long-secret".to_owned()), ..AccessConfig::default() }
}

#[tokio::test]
async fn a_machine_that_may_only_watch_sees_the_trial_and_ends_nothing() {
    let listed = vec![AllowedAddress { address: Ipv4Addr::LOCALHOST.into(), right: AccessRight::View }];
    let server = PageServer::start(
        PageOptions { access: AccessConfig { allowed_addresses: listed, ..token() }, ..options() },
        content(true),
    )
    .unwrap();
    let mut watcher = connect_as(&server, "experimenter").await;
    server.publish_signals(&Signals::default());
    next_of_type(&mut watcher, "signals").await;
    for text in [r#"{"type":"study","action":"abort"}"#, r#"{"type":"gesture","gesture":"hand_open"}"#] {
        send_text(&mut watcher, text).await;
        let refused = next_of_type(&mut watcher, "error").await;
        assert!(refused["message"].as_str().unwrap().contains("may only watch"), "{refused}");
    }
    // The same machine with the token.
    let url = format!("ws://{}/live?role=experimenter&token=long-secret", authority(&server));
    let (mut experimenter, _) = connect_async(url).await.unwrap();
    send_text(&mut experimenter, r#"{"type":"study","action":"abort"}"#).await;
    assert_eq!(await_inputs(&server, 1).await, [ClientInput::Study(StudyAction::Abort)]);
}

#[tokio::test]
async fn a_page_of_a_rebound_name_drives_nothing_though_its_browser_kept_the_token() {
    let server = PageServer::start(PageOptions { access: token(), ..options() }, content(true)).unwrap();
    let port = authority(&server).split(':').next_back().unwrap().to_owned();
    let ask = |host: String| {
        let mut request =
            format!("ws://127.0.0.1:{port}/live?role=experimenter").into_client_request().unwrap();
        let headers = request.headers_mut();
        headers.insert("Host", host.parse().unwrap());
        headers.insert("Origin", format!("http://{host}").parse().unwrap());
        headers.insert("Cookie", format!("proact_token_{port}=long-secret").parse().unwrap());
        connect_async(request)
    };
    let refused = ask(format!("evil.example:{port}")).await.unwrap_err().to_string();
    assert!(refused.contains("403"), "{refused}");
    assert!(ask(format!("localhost:{port}")).await.is_ok());
}

#[tokio::test]
async fn a_page_that_never_answers_a_ping_is_dropped_and_its_place_is_free() {
    let limits =
        ConnectionLimits { websocket_timeout: Duration::from_millis(250), ..ConnectionLimits::default() };
    let server = PageServer::start(PageOptions { limits, ..options() }, content(true)).unwrap();
    let mut awake = connect(&server).await;
    // It says nothing and reads nothing from now on, but holds the line.
    let asleep = connect(&server).await;
    let start = Instant::now();
    while server.client_count() > 1 {
        assert!(start.elapsed() < TIMEOUT, "a page that is silent stays for ever");
        // Reading answers pings.
        let _ = tokio::time::timeout(Duration::from_millis(20), awake.next()).await;
    }
    send_text(&mut awake, r#"{"type":"ping","id":7}"#).await;
    assert_eq!(next_of_type(&mut awake, "pong").await["id"], 7);
    drop(asleep);
}

#[test]
fn other_machines_get_an_address_with_the_token_and_only_if_they_can_connect() {
    let with_token = || PageOptions { access: token(), ..options() };
    let local = PageServer::start(with_token(), content(true)).unwrap();
    assert_eq!(local.remote_url(), None);
    assert!(local.page_url("spectator").ends_with("/spectator?token=long-secret"), "{}", local.page_url(""));
    let bind = Ipv4Addr::UNSPECIFIED.into();
    let open = PageServer::start(PageOptions { bind, https: true, ..with_token() }, content(true)).unwrap();
    assert!(open.url().starts_with("https://127.0.0.1:"), "{}", open.url());
    // None on a machine without a network.
    if let Some(url) = open.remote_url() {
        assert!(url.starts_with("https://") && url.ends_with("/?token=long-secret"), "{url}");
    }
}
