//! OyMotion's gForce Pro and Pro+ armbands.
//!
//! [`protocol`] is the bytes, [`GForceParser`] makes numbered samples of them, [`GForceSimulator`] is the other side; none of
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
mod link;
mod parser;
pub mod protocol;
mod reconnecting_link;
mod server;
mod simulator;

#[cfg(feature = "ble")]
pub use ble::BleConnector;
pub use driver::{GForce, GForceError, GForceOptions};
pub use fragments::{AssemblyOutcome, FragmentAssembler, split_into_fragments};
pub use link::{FrameSocket, GattConnector, GattLink, LinkError, SocketLink, TcpConnector};
pub use parser::GForceParser;
pub use protocol::Characteristic;
pub(crate) use reconnecting_link::{LinkEvent, ReconnectingLink};
pub use server::{GattSimulator, serve, serve_connection};
pub(crate) use simulator::PROMPT_OPCODE;
pub use simulator::{CodeSource, GForceSimulator, GForceSimulatorOptions, Notification, SharedPrompt};
