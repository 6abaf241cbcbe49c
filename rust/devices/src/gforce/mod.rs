//! OyMotion's gForce Pro and Pro+ armbands.
//!
//! [`protocol`] is the bytes, [`EmgParser`] makes numbered samples of them, [`Simulator`] is the other side; none of
//! the three knows a clock or a socket. [`GForce`] drives an armband over any [`GattLink`]: a socket to the simulator,
//! or a radio (feature `ble`).
//!
//! No armband was at hand when this was written: the layout of packages with an id, the size of fragments and the
//! zero level are from the maker's published programs.

#[cfg(feature = "ble")]
mod ble;
mod driver;
mod fragments;
pub mod imu;
mod kept_link;
mod link;
mod parser;
pub mod protocol;
mod server;
mod simulator;

#[cfg(feature = "ble")]
pub use ble::BleConnector;
pub use driver::{GForce, GForceError, GForceOptions};
pub use fragments::{Fragments, Joined, cut};
pub(crate) use kept_link::{Heard, KeptLink};
pub use link::{Connect, FrameSocket, GattLink, LinkError, SocketLink, TcpConnector};
pub use parser::EmgParser;
pub use protocol::Characteristic;
pub use server::{GattDouble, serve, serve_connection};
pub(crate) use simulator::PROMPT;
pub use simulator::{CodeSource, Notification, Prompted, Simulator, SimulatorOptions};
