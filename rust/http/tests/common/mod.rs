//! A server on a port of the system's choice, and requests to it.
#![allow(dead_code)]

use proact_http::{AccessConfig, AllowedOrigins, ConnectionLimits, HttpServer, HttpServerOptions};
use std::{
    io::{Read, Write},
    net::{Ipv4Addr, TcpStream},
};

pub fn options(pages: AllowedOrigins) -> HttpServerOptions {
    HttpServerOptions {
        name: "test",
        port: 0,
        further_ports: 0,
        port_option: "--port",
        bind: Ipv4Addr::LOCALHOST.into(),
        https: false,
        access: AccessConfig::default(),
        allowed_origins: pages,
        send_buffer_bytes: 64 * 1024,
        limits: ConnectionLimits::default(),
    }
}

/// The whole answer to a request for `path` with these lines of a head.
pub fn ask(server: &HttpServer, path: &str, lines: &[&str]) -> String {
    let mut stream = TcpStream::connect(server.address()).unwrap();
    let head = lines.iter().map(|line| format!("{line}\r\n")).collect::<String>();
    write!(stream, "GET {path} HTTP/1.1\r\nConnection: close\r\n{head}\r\n").unwrap();
    let mut answer = String::new();
    stream.read_to_string(&mut answer).unwrap();
    answer
}

pub fn status(answer: &str) -> &str {
    answer.split(' ').nth(1).unwrap()
}
