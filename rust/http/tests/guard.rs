//! What stands before every address of a router, over real sockets.
#![allow(clippy::unwrap_used, clippy::disallowed_methods)]

mod common;

use axum::{Router, response::Html, routing::get};
use common::{ask, options, status};
use proact_http::{
    AccessConfig, AccessRight, AllowedAddress, AllowedOrigins, HttpServer, HttpServerOptions, ServeError,
};
use std::{
    net::Ipv4Addr,
    sync::mpsc::{Receiver, channel},
};

const TOKEN: &str = "a-token-of-some-length";

fn start(options: HttpServerOptions) -> (HttpServer, Receiver<String>) {
    let router = Router::new()
        .route("/", get(|| async { "hello" }))
        .route("/page", get(|| async { Html("hello") }))
        .fallback(|| async { (axum::http::StatusCode::NOT_FOUND, "elsewhere") });
    let (send, refusals) = channel();
    let refused = move |reason| send.send(reason).unwrap();
    (HttpServer::start(options, router, refused, std::future::pending()).unwrap(), refusals)
}

#[test]
fn every_address_is_behind_the_rule_also_those_that_do_not_exist() {
    let (server, refusals) = start(options(AllowedOrigins::SameServer));
    for (path, found) in [("/", "200"), ("/nowhere", "404")] {
        assert_eq!(status(&ask(&server, path, &["Host: localhost"])), found);
        let foreign = ask(&server, path, &["Host: localhost", "Origin: http://evil.example"]);
        assert_eq!(status(&foreign), "403");
        assert!(foreign.contains("evil.example") && !foreign.contains("hello"), "{foreign}");
        assert!(refusals.recv().unwrap().contains("refused 127.0.0.1"), "the owner is told");
        assert_eq!(status(&ask(&server, path, &["Host: evil.example"])), "403");
    }
}

#[test]
fn what_cannot_be_read_does_not_pass_for_what_is_not_there() {
    let (server, _refusals) = start(options(AllowedOrigins::SameHost));
    let ours = "Origin: http://localhost";
    for lines in [
        &["Host: localhost", "Origin: http://b\u{fc}cher.example"][..],
        &["Host: localhost", ours, "Origin: http://evil.example"],
        &["Host: localhost", "Host: evil.example", ours],
        &[ours],
    ] {
        let answer = ask(&server, "/", lines);
        assert!(["400", "403"].contains(&status(&answer)), "{lines:?}: {answer}");
    }
    assert_eq!(status(&ask(&server, "/", &["Host: localhost", ours])), "200");
}

#[test]
fn the_key_of_a_websocket_has_sixteen_bytes() {
    let (server, _refusals) = start(options(AllowedOrigins::SameServer));
    let socket = ["Host: localhost", "Upgrade: WebSocket", "Sec-WebSocket-Version: 13"];
    for (key, found) in [
        (None, "403"),
        (Some("Sec-WebSocket-Key: AAAA"), "403"),
        (Some("Sec-WebSocket-Key: not base64 at all"), "403"),
        (Some("Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA=="), "200"),
    ] {
        let lines: Vec<&str> = socket.into_iter().chain(key).collect();
        assert_eq!(status(&ask(&server, "/", &lines)), found, "{key:?}");
    }
}

fn with_token() -> HttpServerOptions {
    HttpServerOptions {
        access: AccessConfig { token: Some(TOKEN.to_owned()), ..AccessConfig::default() },
        ..options(AllowedOrigins::SameServer)
    }
}

#[test]
fn a_browser_that_opens_a_page_with_the_token_keeps_it_and_is_sent_to_the_address_without_it() {
    let (server, _refusals) = start(with_token());
    let cookie = format!("proact_token_{}={TOKEN}", server.address().port());
    for (path, without) in
        [(format!("/page?token={TOKEN}"), "/page"), (format!("/page?a=b&token={TOKEN}&c=d"), "/page?a=b&c=d")]
    {
        let answer = ask(&server, &path, &["Host: localhost"]);
        assert_eq!(status(&answer), "303", "{answer}");
        let marked = format!("{without}{}entered", if without.contains('?') { '&' } else { '?' });
        assert!(answer.contains(&format!("location: {marked}\r\n")), "{answer}");
        // Whether the browser sends the cookie here depends on who had the link.
        for cookie in ["", &format!("Cookie: {cookie}")] {
            let lines = ["Host: localhost", cookie];
            let answer = ask(&server, &marked, &lines[..1 + usize::from(!cookie.is_empty())]);
            assert!(answer.contains(&format!("refresh: 0; url={without}\r\n")), "{answer}");
            assert!(status(&answer) == "200" && !answer.contains("hello"), "{answer}");
        }
        let kept = format!("set-cookie: {cookie}; Path=/; HttpOnly; SameSite=Strict\r\n");
        assert!(answer.contains(&kept) && answer.contains("cache-control: no-store"), "{answer}");
        assert!(!answer.contains("hello"), "{answer}");
        assert_eq!(status(&ask(&server, without, &["Host: localhost", &format!("Cookie: {cookie}")])), "200");
    }
    // What is no page is for programs, which keep nothing.
    for (path, found) in [
        (format!("/?token={TOKEN}"), "200"),
        (format!("/nowhere?token={TOKEN}"), "404"),
        ("/page?token=wrong".to_owned(), "401"),
        ("/page".to_owned(), "401"),
    ] {
        let answer = ask(&server, &path, &["Host: localhost"]);
        assert_eq!(status(&answer), found, "{path}");
        assert!(!answer.contains("set-cookie"), "{path}");
    }
    // Under a name that is not ours the page would be refused next.
    let foreign = ask(&server, &format!("/page?token={TOKEN}"), &["Host: lab.example.org"]);
    assert!(status(&foreign) == "403" && foreign.contains("--host-name lab.example.org"), "{foreign}");
}

#[test]
fn the_cookie_of_one_server_is_nothing_to_another_on_the_same_host() {
    let ((first, _refusals), (second, _others)) = (start(with_token()), start(with_token()));
    let cookie = format!("Cookie: proact_token_{}={TOKEN}", first.address().port());
    assert_eq!(status(&ask(&first, "/", &["Host: localhost", &cookie])), "200");
    assert_eq!(status(&ask(&second, "/", &["Host: localhost", &cookie])), "401");
}

#[test]
fn every_answer_keeps_browsers_from_framing_sniffing_and_telling_where_they_were() {
    let (server, _refusals) = start(with_token());
    let host = format!("localhost:{}", server.address().port());
    for path in
        ["/".to_owned(), format!("/page?token={TOKEN}"), format!("/?token={TOKEN}"), "/nowhere".to_owned()]
    {
        let answer = ask(&server, &path, &[&format!("Host: {host}")]);
        for line in [
            "x-frame-options: DENY\r\n",
            "x-content-type-options: nosniff\r\n",
            "referrer-policy: no-referrer\r\n",
            "cross-origin-resource-policy: same-origin\r\n",
            "content-security-policy: default-src 'none'; script-src 'self'; ",
            "frame-ancestors 'none'\r\n",
            &format!("connect-src 'self' ws://{host} wss://{host};"),
        ] {
            assert!(answer.contains(line), "{path}: {line} in {answer}");
        }
    }
    // Nobody writes rules of their own into ours.
    let answer = ask(&server, "/", &["Host: a; script-src *"]);
    assert!(answer.contains("connect-src 'self'; ") && !answer.contains("script-src *;"), "{answer}");
}

#[test]
fn a_taken_port_is_named_with_how_to_choose_another_and_the_next_one_used_if_allowed() {
    let (first, _refusals) = start(options(AllowedOrigins::SameServer));
    let port = first.address().port();
    let taken = HttpServerOptions { port, ..options(AllowedOrigins::SameServer) };
    let start_bare = |options| HttpServer::start(options, Router::new(), |_| {}, std::future::pending());
    let error = start_bare(taken.clone()).err().unwrap();
    assert!(matches!(error, ServeError::PortTaken { .. }), "{error}");
    assert!(
        error.to_string().contains(&format!("port {port}")) && error.to_string().contains("--port"),
        "{error}"
    );
    let next = start_bare(HttpServerOptions { further_ports: 20, ..taken.clone() }).unwrap();
    assert_ne!(next.address(), first.address());
    // Free again at once.
    drop(first);
    assert_eq!(start_bare(taken).unwrap().address().port(), port);
}

#[test]
fn listening_for_others_needs_somebody_who_may_come() {
    let open = |access: AccessConfig| {
        let options = HttpServerOptions {
            bind: Ipv4Addr::UNSPECIFIED.into(),
            access,
            ..options(AllowedOrigins::SameServer)
        };
        HttpServer::start(options, Router::new(), |_| {}, std::future::pending())
    };
    assert!(matches!(open(AccessConfig::default()), Err(ServeError::AccessNotConfigured { .. })));
    assert!(matches!(
        open(AccessConfig { token: Some("short".to_owned()), ..AccessConfig::default() }),
        Err(ServeError::InvalidToken { .. })
    ));
    assert!(matches!(
        open(AccessConfig { host_names: vec!["a b".to_owned()], ..AccessConfig::default() }),
        Err(ServeError::InvalidHostName { .. })
    ));
    let listed = AllowedAddress { address: "10.0.0.1".parse().unwrap(), right: AccessRight::Control };
    let server = open(AccessConfig { allowed_addresses: vec![listed], ..AccessConfig::default() }).unwrap();
    assert_eq!(server.remote_url(), None, "there is no token to give away");
}
