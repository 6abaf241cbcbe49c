//! A trial on rosbridge, for the original headset app and any other client.

use crate::print_status;
use proact_http::AccessConfig;
use proact_rosbridge::{
    CameraTopics, HeadsetInput, HeadsetTopics, LocalBus, RosbridgeOptions, RosbridgeServer, TopicBus,
};
use proact_testbed::RunningTrial;
use proact_types::{DisplayFrame, InputSource};
use std::{
    error::Error,
    net::{IpAddr, SocketAddr},
    sync::Arc,
    time::Duration,
};

/// Where rosbridge is served, and for whom.
#[derive(Clone, Debug)]
pub struct RosbridgeEndpoint {
    /// TCP port.
    pub port: u16,
    /// Address to listen on.
    pub bind: IpAddr,
    /// Who may come.
    pub access: AccessConfig,
}

impl RosbridgeEndpoint {
    fn options(self) -> RosbridgeOptions {
        let RosbridgeEndpoint { port, bind, access } = self;
        RosbridgeOptions { port, bind, access, ..RosbridgeOptions::default() }
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
pub fn serve_ros_graph(port: Option<u16>, bind: IpAddr, access: AccessConfig) -> Result<(), Box<dyn Error>> {
    let relay = Arc::new(proact_ros::node::relay::Relay::join("proact_rosbridge", true)?);
    let port = match port {
        Some(port) => port,
        None => relay.port(9090)?,
    };
    let endpoint = RosbridgeEndpoint { port, bind, access };
    let bus = crate::ros_bus::RosBus::new(Arc::clone(&relay));
    let server = RosbridgeServer::start(endpoint.options(), bus)?;
    print_status(format_args!("rosbridge: ws://{}/", server.address()));
    while relay.is_ok() {
        for notice in server.drain_notices() {
            print_status(format_args!("rosbridge: {notice}"));
        }
        relay.publish_diagnostics();
        std::thread::sleep(std::time::Duration::from_millis(100));
    }
    Ok(())
}

/// The ROS graph as a bus, for a command that has its own way to end.
#[cfg(feature = "ros")]
fn ros_graph_bus() -> Result<Arc<dyn TopicBus>, Box<dyn Error>> {
    let relay = proact_ros::node::relay::Relay::join("proact", false)?;
    Ok(crate::ros_bus::RosBus::new(Arc::new(relay)))
}

#[cfg(not(feature = "ros"))]
fn ros_graph_bus() -> Result<Arc<dyn TopicBus>, Box<dyn Error>> {
    Err(crate::NO_ROS.into())
}

impl Rosbridge {
    /// Serves the trial; with `ros` on the bus that a ROS graph is.
    ///
    /// # Errors
    /// A place that cannot be served, or no graph.
    pub fn open(
        trial: &RunningTrial,
        endpoint: RosbridgeEndpoint,
        ros: bool,
    ) -> Result<Self, Box<dyn Error>> {
        let bus: Arc<dyn TopicBus> = if ros { ros_graph_bus()? } else { LocalBus::new() };
        let testbed = trial.testbed();
        let topics =
            HeadsetTopics::new(Arc::clone(&bus), testbed.model(), testbed.task().scene(), trial.head_pose())?;
        let camera = CameraTopics::new(Arc::clone(&bus), testbed.model(), testbed.task().scene())?;
        let limits = testbed.config().profile.dead_man;
        let frozen_gaze = limits.map(|limits| Duration::from_millis(limits.gaze_timeout_ms));
        let options = RosbridgeOptions { frozen_gaze_timeout: frozen_gaze, ..endpoint.options() };
        Ok(Self { topics, camera, server: RosbridgeServer::start(options, bus)? })
    }

    /// Where it is served.
    pub fn address(&self) -> SocketAddr {
        self.server.address()
    }

    /// Another trial begins.
    ///
    /// # Errors
    /// Somebody else uses the topic of an object for another type.
    pub fn restart(&self, trial: &RunningTrial) -> Result<(), Box<dyn Error>> {
        Ok(self.topics.restart(trial.testbed().task().scene(), trial.head_pose())?)
    }

    /// Publishes an instant, and prints what happened to the clients.
    pub fn publish(&self, frame: &DisplayFrame) {
        self.topics.publish(frame);
        self.camera.set_frame(frame);
        for notice in self.server.drain_notices() {
            print_status(format_args!("rosbridge: {notice}"));
        }
    }

    /// Hands what clients brought to a person's trial.
    pub fn apply_to(&self, trial: &mut RunningTrial) {
        apply_topic_inputs(&self.topics, trial);
    }
}

/// Hands what the topics of a headset brought to a person's trial. False if nothing came.
pub fn apply_topic_inputs(topics: &HeadsetTopics, trial: &mut RunningTrial) -> bool {
    let inputs = topics.drain_inputs();
    let came = !inputs.is_empty();
    for input in inputs {
        match input {
            HeadsetInput::Gesture(command) => {
                trial.person_stage_mut().set_command_from(InputSource::GestureTopic, command)
            }
            HeadsetInput::Heartbeat => trial.person_stage_mut().record_heartbeat(InputSource::GestureTopic),
            HeadsetInput::Gaze(gaze) => trial.person_stage_mut().set_gaze(gaze),
            HeadsetInput::Head(pose) => trial.person_stage_mut().track_head(pose),
            HeadsetInput::Shoulder(pose) => trial.person_stage_mut().track_shoulder(pose),
        }
    }
    came
}
