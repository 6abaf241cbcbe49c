//! `--rosbridge`: a trial for the original headset app, and for any other client of rosbridge.

use clap::Args;
use proact_app::tell;
use proact_app::{Rosbridge, RosbridgePlace};
use proact_http::Access;
use proact_testbed::Session;
use std::{error::Error, net::IpAddr};

/// Where rosbridge is served, and for whom.
#[derive(Debug, Args)]
pub(crate) struct RosbridgeArgs {
    /// Serve rosbridge for the original headset app and other clients, on port 9090 unless another is given
    #[arg(long, value_name = "PORT", num_args = 0..=1, default_missing_value = "9090")]
    rosbridge: Option<u16>,
    /// Address to serve rosbridge on; this machine only, or all addresses with --allow or --token
    #[arg(long, value_name = "ADDRESS", requires = "rosbridge")]
    rosbridge_bind: Option<IpAddr>,
    /// Another machine that may connect to rosbridge without a token, such as a headset; may be repeated
    #[arg(long, value_name = "ADDRESS", requires = "rosbridge")]
    allow: Vec<IpAddr>,
    /// What any other machine must send to connect to rosbridge: ws://host:port/?token=..
    #[arg(long, value_name = "TOKEN", requires = "rosbridge")]
    token: Option<String>,
    /// Join the ROS graph as the node /proact: its topics and services and those of the clients become the same
    #[arg(long, requires = "rosbridge")]
    ros: bool,
}

impl RosbridgeArgs {
    /// Begins to serve if it is asked for, and prints the address.
    pub(crate) fn open(&self, session: &Session) -> Result<Option<Rosbridge>, Box<dyn Error>> {
        let Some(port) = self.rosbridge else { return Ok(None) };
        let place = RosbridgePlace { port, bind: self.rosbridge_bind, access: self.access() };
        let rosbridge = Rosbridge::open(session, place, self.ros)?;
        tell(format_args!("rosbridge: ws://{}/", rosbridge.address()));
        Ok(Some(rosbridge))
    }

    /// `proact node rosbridge`: nothing but the graph, until it ends the node.
    #[cfg(feature = "ros")]
    pub(crate) fn relay(&self) -> Result<(), Box<dyn Error>> {
        proact_app::relay(self.rosbridge, self.rosbridge_bind, self.access())
    }

    fn access(&self) -> Access {
        Access { allowed: self.allow.clone(), token: self.token.clone() }
    }
}
