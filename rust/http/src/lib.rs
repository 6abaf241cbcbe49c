//! What the page's server and rosbridge's share: the rule who may connect, ports, certificates, and the thread that
//! serves. WebSockets are axum's in both.
//!
//! A [`HttpServer`] serves a router of axum's in a thread of its own until it is dropped. Nothing of the router is reached
//! but through [`AccessConfig`]: with the token or from a list, without a token from this machine alone, and by no page of another
//! site. Who dawdles, or holds many connections, is dropped and keeps nobody else out ([`ConnectionLimits`]).
//!
//! It uses the real clock, threads and sockets. It knows nothing of trials, topics or pages.
//!
//! ```no_run
//! use axum::{Router, routing::get};
//! use proact_http::{AllowedOrigins, HttpServer, HttpServerOptions};
//! let options = HttpServerOptions {
//!     name: "hello",
//!     port: 8090,
//!     further_ports: 20,
//!     port_option: "--port",
//!     bind: std::net::Ipv4Addr::LOCALHOST.into(),
//!     https: false,
//!     access: Default::default(),
//!     allowed_origins: AllowedOrigins::SameServer,
//!     send_buffer_bytes: 64 * 1024,
//!     limits: Default::default(),
//! };
//! let router = Router::new().route("/", get(|| async { "hello\n" }));
//! let server = HttpServer::start(options, router, |refusal| eprintln!("{refusal}"), std::future::pending())?;
//! println!("open {}", server.url());
//! # Ok::<(), proact_http::ServeError>(())
//! ```
// A web server lives by the real clock and in a thread of its own.
#![allow(clippy::disallowed_methods)]
#![cfg_attr(test, allow(clippy::unwrap_used))]

mod access;
mod connections;
mod error;
mod guard;
mod log_throttle;
mod server;
mod tls;
mod websocket_liveness;

pub use access::{AccessConfig, AccessRight, AllowedAddress, AllowedOrigins};
pub use connections::ConnectionLimits;
pub use error::ServeError;
pub use log_throttle::LogThrottle;
pub use server::{HttpServer, HttpServerOptions, Peer};
pub use websocket_liveness::WebSocketLiveness;
