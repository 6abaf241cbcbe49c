//! A trial on rosbridge, for the original headset app and any other client.

use crate::tell;
use proact_http::Access;
use proact_rosbridge::{
    CameraTopics, HeadsetInput, HeadsetTopics, LocalBus, RosbridgeOptions, RosbridgeServer, TopicBus,
};
use proact_testbed::Session;
use proact_types::{DisplayFrame, InputSource};
use std::{
    error::Error,
    net::{IpAddr, SocketAddr},
    sync::Arc,
};

/// Where rosbridge is served, and for whom.
#[derive(Clone, Debug)]
pub struct RosbridgePlace {
    /// TCP port.
    pub port: u16,
    /// Address to listen on.
    pub bind: IpAddr,
    /// Who may come.
    pub access: Access,
}

impl RosbridgePlace {
    /// Serves a bus.
    fn serve(self, bus: Arc<dyn TopicBus>) -> Result<RosbridgeServer, Box<dyn Error>> {
        let RosbridgePlace { port, bind, access } = self;
        let options = RosbridgeOptions { port, bind, access, ..RosbridgeOptions::default() };
        Ok(RosbridgeServer::start(options, bus)?)
    }
}

/// A trial on rosbridge.
pub struct Rosbridge {
    // Ended before the server: its topics are taken back while the clients still are there.
    topics: HeadsetTopics,
    camera: CameraTopics,
    server: RosbridgeServer,
}

/// Serves a ROS graph on rosbridge until the node is told to end. Without `port` the node's own parameter `~port` counts,
/// and 9090 without that.
///
/// # Errors
/// No graph, or a place that cannot be served.
#[cfg(feature = "ros")]
pub fn relay(port: Option<u16>, bind: IpAddr, access: Access) -> Result<(), Box<dyn Error>> {
    let relay = Arc::new(proact_ros::node::relay::Relay::join("proact_rosbridge", true)?);
    let port = match port {
        Some(port) => port,
        None => relay.port(9090)?,
    };
    let place = RosbridgePlace { port, bind, access };
    let server = place.serve(crate::ros_bus::RosBus::new(Arc::clone(&relay)))?;
    tell(format_args!("rosbridge: ws://{}/", server.address()));
    while relay.is_ok() {
        for notice in server.drain_notices() {
            tell(format_args!("rosbridge: {notice}"));
        }
        relay.tell();
        std::thread::sleep(std::time::Duration::from_millis(100));
    }
    Ok(())
}

/// The ROS graph as a bus, for a command that has its own way to end.
#[cfg(feature = "ros")]
fn graph() -> Result<Arc<dyn TopicBus>, Box<dyn Error>> {
    let relay = proact_ros::node::relay::Relay::join("proact", false)?;
    Ok(crate::ros_bus::RosBus::new(Arc::new(relay)))
}

#[cfg(not(feature = "ros"))]
fn graph() -> Result<Arc<dyn TopicBus>, Box<dyn Error>> {
    Err(crate::NO_ROS.into())
}

impl Rosbridge {
    /// Serves the trial; with `ros` on the bus that a ROS graph is.
    ///
    /// # Errors
    /// A place that cannot be served, or no graph.
    pub fn open(session: &Session, place: RosbridgePlace, ros: bool) -> Result<Self, Box<dyn Error>> {
        let bus: Arc<dyn TopicBus> = if ros { graph()? } else { LocalBus::new() };
        let testbed = session.testbed();
        let topics =
            HeadsetTopics::new(Arc::clone(&bus), testbed.model(), testbed.task().scene(), session.head())?;
        let camera = CameraTopics::new(Arc::clone(&bus), testbed.model(), testbed.task().scene())?;
        Ok(Self { topics, camera, server: place.serve(bus)? })
    }

    /// Where it is served.
    pub fn address(&self) -> SocketAddr {
        self.server.address()
    }

    /// Another trial begins.
    ///
    /// # Errors
    /// Somebody else uses the topic of an object for another type.
    pub fn restart(&self, session: &Session) -> Result<(), Box<dyn Error>> {
        Ok(self.topics.restart(session.testbed().task().scene(), session.head())?)
    }

    /// Publishes an instant, and prints what happened to the clients.
    pub fn publish(&self, frame: &DisplayFrame) {
        self.topics.publish(frame);
        self.camera.show(frame);
        for notice in self.server.drain_notices() {
            tell(format_args!("rosbridge: {notice}"));
        }
    }

    /// Hands what clients brought to a person's trial.
    pub fn drive(&self, session: &mut Session) {
        drive_by_topics(&self.topics, session);
    }
}

/// Hands what the topics of a headset brought to a person's trial. False if nothing came.
pub fn drive_by_topics(topics: &HeadsetTopics, session: &mut Session) -> bool {
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
