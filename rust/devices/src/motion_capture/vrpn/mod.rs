//! VRPN: the protocol that Motive, Vicon, Qualisys and most other tracking software can stream.
//!
//! [`VrpnClient`] connects over TCP alone (what VRPN writes `tcp://`), so that a firewall needs one port. A device that is
//! called `Shoulderpad` is the body `Shoulderpad`; its sensors beyond the first are `Shoulderpad/1` and so on.

mod client;
mod message;
mod server;

pub use client::VrpnClient;
pub use message::{VrpnError, VrpnEvent, VrpnParser, VrpnPose, cookie};
pub use server::VrpnServer;

/// The port on which VRPN servers listen.
pub const VRPN_PORT: u16 = 3883;
