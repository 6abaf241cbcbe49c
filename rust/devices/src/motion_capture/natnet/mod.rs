//! NatNet: what OptiTrack's Motive streams over UDP.
//!
//! [`NatNetClient`] asks the server for version 3.1 of the stream and parses that alone. Multicast or unicast: the server
//! says which it does. Motive numbers its bodies; their names come with the definitions, which are asked for at the start
//! and whenever they change.

mod client;
mod packet;
mod server;

pub use client::{NatNetClient, NatNetOptions};
pub use packet::{
    NatNetError, NatNetFrame, NatNetMessage, NatNetRigidBody, NatNetServerInfo, RigidBodyDefinition, parse,
};
pub use server::NatNetServer;

/// The port of commands.
pub const NATNET_COMMAND_PORT: u16 = 1510;
/// The port of frames, unless the server says another.
pub const NATNET_DATA_PORT: u16 = 1511;
/// The group of frames, unless the server says another.
pub const NATNET_GROUP: [u8; 4] = [239, 255, 42, 99];
