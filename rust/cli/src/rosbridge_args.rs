//! `--rosbridge`: a trial for the original headset app, and for any other client of rosbridge.

use crate::access_args::AccessArgs;
use clap::Args;
use proact_app::{Rosbridge, RosbridgeEndpoint, print_status};
use proact_http::{AccessConfig, AccessRight, AllowedAddress};
use proact_testbed::RunningTrial;
use std::{
    error::Error,
    net::{IpAddr, Ipv4Addr},
};

/// Where rosbridge is served, and for whom.
#[derive(Debug, Args)]
pub(crate) struct RosbridgeArgs {
    /// Serve rosbridge for the original headset app and other clients, on port 9090 unless another is given
    #[arg(long, value_name = "PORT", num_args = 0..=1, default_missing_value = "9090")]
    rosbridge: Option<u16>,
    /// Address to serve rosbridge on; this machine only, or all addresses with --rosbridge-allow or --token
    #[arg(long, value_name = "ADDRESS", requires = "rosbridge")]
    rosbridge_bind: Option<IpAddr>,
    /// Another machine that may connect to rosbridge and act without a token, such as a headset; may be repeated
    #[arg(long, value_name = "ADDRESS", requires = "rosbridge")]
    rosbridge_allow: Vec<IpAddr>,
    /// For page and rosbridge alike
    #[command(flatten)]
    pub(crate) access: AccessArgs,
    /// Join the ROS graph as the node /proact: its topics and services and those of the clients become the same
    #[arg(long, requires = "rosbridge")]
    ros: bool,
}

impl RosbridgeArgs {
    /// Begins to serve if it is asked for, and prints the address.
    pub(crate) fn open(&self, trial: &RunningTrial) -> Result<Option<Rosbridge>, Box<dyn Error>> {
        let Some(port) = self.rosbridge else { return Ok(None) };
        let endpoint = RosbridgeEndpoint { port, bind: self.bind(), access: self.rosbridge_access()? };
        let rosbridge = Rosbridge::open(trial, endpoint, self.ros)?;
        print_status(format_args!("rosbridge: ws://{}/", rosbridge.address()));
        Ok(Some(rosbridge))
    }

    /// `proact node rosbridge`: nothing but the graph, until it ends the node.
    #[cfg(feature = "ros")]
    pub(crate) fn relay(&self) -> Result<(), Box<dyn Error>> {
        proact_app::serve_ros_graph(self.rosbridge, self.bind(), self.rosbridge_access()?)
    }

    /// A token in the environment alone opens nothing: somebody has to ask for it.
    fn bind(&self) -> IpAddr {
        let others = !self.rosbridge_allow.is_empty() || self.access.requests_token();
        let all = if others { Ipv4Addr::UNSPECIFIED } else { Ipv4Addr::LOCALHOST };
        self.rosbridge_bind.unwrap_or(all.into())
    }

    /// Every client of rosbridge can act, and the original app can send no token: a listed machine may.
    fn rosbridge_access(&self) -> Result<AccessConfig, Box<dyn Error>> {
        let may_act = |&address| AllowedAddress { address, right: AccessRight::Control };
        self.access.access(self.rosbridge_allow.iter().map(may_act).collect())
    }
}
