//! `--rosbridge`: a trial for the original headset app, and for any other client of rosbridge.

use clap::Args;
use proact_http::Access;
use proact_rosbridge::{
    CameraTopics, HeadsetInput, HeadsetTopics, LocalBus, RosbridgeOptions, RosbridgeServer, TopicBus,
};
use proact_testbed::Session;
use proact_types::{DisplayFrame, InputSource};
use std::{
    error::Error,
    net::{IpAddr, Ipv4Addr},
    sync::Arc,
};

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

/// A trial on rosbridge.
pub(crate) struct Rosbridge {
    // Ended before the server: its topics are taken back while the clients still are there.
    topics: HeadsetTopics,
    camera: CameraTopics,
    server: RosbridgeServer,
}

impl RosbridgeArgs {
    /// Begins to serve if it is asked for, and prints the address.
    pub(crate) fn open(&self, session: &Session) -> Result<Option<Rosbridge>, Box<dyn Error>> {
        let Some(port) = self.rosbridge else { return Ok(None) };
        let bus: Arc<dyn TopicBus> = if self.ros { graph()? } else { LocalBus::new() };
        let topics = HeadsetTopics::new(Arc::clone(&bus), session.testbed().model(), session.head())?;
        let testbed = session.testbed();
        let camera = CameraTopics::new(Arc::clone(&bus), testbed.model(), testbed.task().scene())?;
        Ok(Some(Rosbridge { topics, camera, server: self.serve(port, bus)? }))
    }

    /// Serves a bus, and prints the address.
    fn serve(&self, port: u16, bus: Arc<dyn TopicBus>) -> Result<RosbridgeServer, Box<dyn Error>> {
        let access = Access { allowed: self.allow.clone(), token: self.token.clone() };
        let anybody = !self.allow.is_empty() || self.token.is_some();
        let all: IpAddr = if anybody { Ipv4Addr::UNSPECIFIED.into() } else { Ipv4Addr::LOCALHOST.into() };
        let bind = self.rosbridge_bind.unwrap_or(all);
        let server = RosbridgeServer::start(RosbridgeOptions { port, bind, access }, bus)?;
        eprintln!("rosbridge: ws://{}/", server.address());
        Ok(server)
    }

    /// `proact node rosbridge`: nothing but the graph, until it ends the node.
    #[cfg(feature = "ros")]
    pub(crate) fn relay(&self) -> Result<(), Box<dyn Error>> {
        let relay = Arc::new(proact_ros::node::relay::Relay::join("proact_rosbridge", true)?);
        let port = match self.rosbridge {
            Some(port) => port,
            None => relay.port(9090)?,
        };
        let server = self.serve(port, crate::ros_bus::RosBus::new(Arc::clone(&relay)))?;
        while relay.is_ok() {
            for notice in server.drain_notices() {
                eprintln!("rosbridge: {notice}");
            }
            relay.tell();
            std::thread::sleep(std::time::Duration::from_millis(100));
        }
        Ok(())
    }
}

/// The ROS graph as a bus, for a command that has its own way to end.
#[cfg(feature = "ros")]
fn graph() -> Result<Arc<dyn TopicBus>, Box<dyn Error>> {
    let relay = proact_ros::node::relay::Relay::join("proact", false)?;
    Ok(crate::ros_bus::RosBus::new(Arc::new(relay)))
}

#[cfg(not(feature = "ros"))]
fn graph() -> Result<Arc<dyn TopicBus>, Box<dyn Error>> {
    Err(crate::node::NO_ROS.into())
}

impl Rosbridge {
    /// Another trial begins.
    pub(crate) fn restart(&self, session: &Session) {
        self.topics.restart(session.head());
    }

    /// Publishes an instant, and prints what happened to the clients.
    pub(crate) fn publish(&self, frame: &DisplayFrame) {
        self.topics.publish(frame);
        self.camera.show(frame);
        for notice in self.server.drain_notices() {
            eprintln!("rosbridge: {notice}");
        }
    }

    /// Hands what clients brought to a person's trial.
    pub(crate) fn drive(&self, session: &mut Session) {
        drive_by_topics(&self.topics, session);
    }
}

/// Hands what the topics of a headset brought to a person's trial. False if nothing came.
pub(crate) fn drive_by_topics(topics: &HeadsetTopics, session: &mut Session) -> bool {
    let inputs = topics.drain_inputs();
    let came = !inputs.is_empty();
    for input in inputs {
        match input {
            HeadsetInput::Gesture(gesture) => session.person().command(InputSource::GestureTopic, gesture),
            HeadsetInput::Alive => session.person().hear(InputSource::GestureTopic),
            HeadsetInput::Gaze(gaze) => session.person().look(gaze),
            HeadsetInput::Head(pose) => session.person().track_head(pose),
            HeadsetInput::Shoulder(pose) => session.person().track_shoulder(pose),
        }
    }
    came
}
