//! XML-RPC, the calls between ROS 1 nodes and their master.
//!
//! It has the names of the crate `xml-rpc` 0.1 from crates.io, as far as rosrust uses them, and stands in its place; [`intercept_calls`] is its own. All that
//! comes in from the network is bounded: size, depth and number of values, time, and connections at once. There is no access
//! control in ROS 1, and none here: docs/ros1.md says how to fence a graph.
//!
//! It uses the real clock, threads and sockets.
//!
//! ```
//! use xml_rpc::{Client, Server, Value};
//! let mut server = Server::default();
//! server.register_value("twice", |arguments| match arguments[..] {
//!     [Value::Int(n)] => Ok(vec![Value::Int(2 * n)]),
//!     _ => Err(xml_rpc::Fault::new(1, "expected one number")),
//! });
//! let bound = server.bind(&"127.0.0.1:0".parse()?)?;
//! let address = format!("http://{}/", bound.local_addr()).parse()?;
//! std::thread::spawn(move || bound.run());
//! let answer = Client::new()?.call_value(&address, "twice", vec![Value::Int(21)])?;
//! assert_eq!(answer, Ok(vec![Value::Int(42)]));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
// A server lives by the real clock and in threads of its own.
#![allow(clippy::disallowed_methods)]
#![cfg_attr(test, allow(clippy::unwrap_used))]

mod client;
mod codec;
mod convert;
pub mod error;
mod http;
pub mod server;
mod value;

pub use client::{Client, Url, call_value};
pub use convert::{from_params, into_params};
pub use server::{Server, intercept_calls, rouille};
pub use value::{Fault, Params, Response, Value};

/// Reading and writing of messages, for tests that feed them anything.
pub mod text {
    pub use crate::codec::{read_call, read_response, write_call, write_response};
}
