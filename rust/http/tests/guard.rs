//! What stands before every address of a router, over real sockets.
#![allow(clippy::unwrap_used, clippy::disallowed_methods)]

use axum::{Router, routing::get};
use proact_http::{Access, Options, Pages, ServeError, Server};
use std::{
    io::{Read, Write},
    net::{Ipv4Addr, TcpStream},
    sync::mpsc::{Receiver, channel},
};

const TOKEN: &str = "a-token-of-some-length";

fn options(pages: Pages) -> Options {
    Options {
        name: "test",
        port: 0,
        further_ports: 0,
        port_option: "--port",
        bind: Ipv4Addr::LOCALHOST.into(),
        https: false,
        access: Access { allowed: vec![], token: Some(TOKEN.to_owned()) },
        pages,
        send_buffer_bytes: 64 * 1024,
    }
}

fn start(options: Options) -> (Server, Receiver<String>) {
    let router = Router::new()
        .route("/", get(|| async { "hello" }))
        .fallback(|| async { (axum::http::StatusCode::NOT_FOUND, "elsewhere") });
    let (send, refusals) = channel();
    let refused = move |reason| send.send(reason).unwrap();
    (Server::start(options, router, refused, std::future::pending()).unwrap(), refusals)
}

/// The whole answer to a request for `path` with these lines of a head.
fn ask(server: &Server, path: &str, lines: &[&str]) -> String {
    let mut stream = TcpStream::connect(server.address()).unwrap();
    let head = lines.iter().map(|line| format!("{line}\r\n")).collect::<String>();
    write!(stream, "GET {path} HTTP/1.1\r\nConnection: close\r\n{head}\r\n").unwrap();
    let mut answer = String::new();
    stream.read_to_string(&mut answer).unwrap();
    answer
}

fn status(answer: &str) -> &str {
    answer.split(' ').nth(1).unwrap()
}

#[test]
fn every_address_is_behind_the_rule_also_those_that_do_not_exist() {
    let (server, refusals) = start(options(Pages::Own));
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
    let (server, _refusals) = start(options(Pages::OfThisHost));
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
    let (server, _refusals) = start(options(Pages::Own));
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

#[test]
fn a_browser_keeps_the_token_only_where_it_found_something() {
    let (server, _refusals) = start(options(Pages::Own));
    let answer = ask(&server, &format!("/?token={TOKEN}"), &["Host: localhost"]);
    let cookie = format!("set-cookie: proact_token={TOKEN}; Path=/; HttpOnly; SameSite=Strict");
    assert!(answer.contains(&cookie), "{answer}");
    for path in [format!("/nowhere?token={TOKEN}"), "/?token=wrong".to_owned(), "/".to_owned()] {
        assert!(!ask(&server, &path, &["Host: localhost"]).contains("set-cookie"), "{path}");
    }
}

#[test]
fn a_taken_port_is_named_with_how_to_choose_another_and_the_next_one_used_if_allowed() {
    let (first, _refusals) = start(options(Pages::Own));
    let port = first.address().port();
    let taken = Options { port, ..options(Pages::Own) };
    let start_bare = |options| Server::start(options, Router::new(), |_| {}, std::future::pending());
    let error = start_bare(taken.clone()).err().unwrap();
    assert!(matches!(error, ServeError::PortTaken { .. }), "{error}");
    assert!(
        error.to_string().contains(&format!("port {port}")) && error.to_string().contains("--port"),
        "{error}"
    );
    let next = start_bare(Options { further_ports: 20, ..taken.clone() }).unwrap();
    assert_ne!(next.address(), first.address());
    // Free again at once.
    drop(first);
    assert_eq!(start_bare(taken).unwrap().address().port(), port);
}

#[test]
fn listening_for_others_needs_somebody_who_may_come() {
    let open = |access: Access| {
        let options = Options { bind: Ipv4Addr::UNSPECIFIED.into(), access, ..options(Pages::Own) };
        Server::start(options, Router::new(), |_| {}, std::future::pending())
    };
    assert!(matches!(open(Access::default()), Err(ServeError::Unguarded { .. })));
    assert!(matches!(
        open(Access { token: Some("short".to_owned()), ..Access::default() }),
        Err(ServeError::Token { .. })
    ));
    let server = open(Access { allowed: vec!["10.0.0.1".parse().unwrap()], token: None }).unwrap();
    assert_eq!(server.remote_url(), None, "there is no token to give away");
}
