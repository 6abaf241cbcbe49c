//! Trackers: the eye and the limb over UDP, the shoulder over rosbridge.

use super::{FailingSource, FailureMode, Outcome, wait_for};
use crate::bridge::WebSocketClient;
use proact_app::{EyeTracker, LimbReceiver, apply_topic_inputs, query::low_discrepancy, trial};
use proact_devices::GazeReceiver;
use proact_rosbridge::{HeadsetTopics, LocalBus, RosbridgeOptions, RosbridgeServer, TopicBus};
use proact_testbed::{RunningTrial, Setup, TrialConfig};
use proact_types::{Command, InputSource, Pose};
use serde_json::json;
use std::{
    net::{SocketAddr, UdpSocket},
    sync::Arc,
};

/// Ticks from one measurement to the next: an eye at 50 Hz, limb and shoulder at 100.
const EYE_TICKS: u64 = 20;
const BODY_TICKS: u64 = 10;

/// A trial whose gestures come from nowhere that can die, and a tracker that can.
pub(super) fn device(
    source: InputSource,
    death: FailureMode,
) -> Outcome<(RunningTrial, Box<dyn FailingSource>)> {
    let method = if source == InputSource::EyeTracker { "D" } else { "A" };
    let mut config = TrialConfig::new(method, 1, Setup::named("still")?);
    if source == InputSource::LimbTracker {
        config = config.with_overrides(&["profile.level=below_elbow"])?;
    }
    let trial = trial::live_trial(config)?.trial;
    let tracker: Box<dyn Tracker> = match source {
        InputSource::EyeTracker => Box::new(Eye::new(&trial)?),
        InputSource::LimbTracker => Box::new(Limb::new(&trial)?),
        _ => Box::new(Shoulder::new(&trial)?),
    };
    Ok((trial, Box::new(TrackerSource { tracker, failure: death, last_number: 0, first_bad_tick: None })))
}

/// What a tracker sends, and how it arrives.
trait Tracker {
    fn period_ticks(&self) -> u64;

    /// The gesture that moves the arm.
    fn moving_gesture(&self) -> Command {
        Command::WristExtension
    }

    /// Sends measurement `number`, and waits for it.
    fn send_measurement(&mut self, trial: &mut RunningTrial, number: u64) -> Outcome<()>;

    /// Sends what dies in its place, if anything, and waits for it if it is a measurement.
    fn fail(&mut self, trial: &mut RunningTrial, death: FailureMode, number: u64) -> Outcome<()>;
}

struct TrackerSource {
    tracker: Box<dyn Tracker>,
    failure: FailureMode,
    /// Of the last measurement.
    last_number: u64,
    first_bad_tick: Option<u64>,
}

impl FailingSource for TrackerSource {
    fn send_tick(
        &mut self,
        trial: &mut RunningTrial,
        tick: u64,
        command: Command,
        lives: bool,
    ) -> Outcome<()> {
        let moves = command == Command::WristExtension;
        trial.person_stage_mut().set_command(if moves { self.tracker.moving_gesture() } else { command });
        if !tick.is_multiple_of(self.tracker.period_ticks()) {
            return Ok(());
        }
        if lives {
            self.last_number = tick;
            return self.tracker.send_measurement(trial, tick);
        }
        self.first_bad_tick.get_or_insert(tick);
        match self.failure {
            FailureMode::Constant => self.tracker.send_measurement(trial, self.last_number),
            death => self.tracker.fail(trial, death, tick),
        }
    }

    fn first_bad_tick(&self) -> Option<u64> {
        self.first_bad_tick
    }
}

/// A number about zero, another for each measurement.
fn noise(number: u64, of: usize) -> f64 {
    low_discrepancy(number, of) - 0.5
}

struct Eye {
    tracker: EyeTracker,
    socket: UdpSocket,
    address: SocketAddr,
}

impl Eye {
    fn new(_trial: &RunningTrial) -> Outcome<Self> {
        let receiver = GazeReceiver::bind(0)?;
        let address = receiver.address()?;
        let tracker = EyeTracker::new(Box::new(receiver));
        Ok(Self { tracker, socket: UdpSocket::bind("127.0.0.1:0")?, address })
    }

    fn send(&self, text: &str) -> Outcome<()> {
        self.socket.send_to(text.as_bytes(), self.address)?;
        Ok(())
    }

    fn wait(&mut self, trial: &mut RunningTrial) -> Outcome<()> {
        wait_for("a gaze", || Ok(self.tracker.apply_to(trial)?))
    }
}

impl Tracker for Eye {
    fn period_ticks(&self) -> u64 {
        EYE_TICKS
    }

    /// A look at the first block from where the head is, with the noise of an eye.
    fn send_measurement(&mut self, trial: &mut RunningTrial, number: u64) -> Outcome<()> {
        let eye = trial.head_pose().translation.vector;
        let block = trial.testbed().task().scene().objects[0].pose.translation.vector;
        let mut direction = block - eye;
        direction.iter_mut().enumerate().for_each(|(k, value)| *value += 0.002 * noise(number, k));
        let (origin, direction): ([f64; 3], [f64; 3]) = (eye.into(), direction.into());
        self.send(&json!({"origin": origin, "direction": direction}).to_string())?;
        self.wait(trial)
    }

    fn fail(&mut self, trial: &mut RunningTrial, death: FailureMode, _number: u64) -> Outcome<()> {
        match death {
            FailureMode::Garbage => self.send("not a gaze")?,
            FailureMode::Zeros => {
                self.send(&json!({"origin": [0, 0, 0], "direction": [0, 0, 0]}).to_string())?
            }
            FailureMode::Blank => {
                self.send(&json!({"origin": [0, 0, 0], "direction": [1, 0, 0], "valid": false}).to_string())?;
                return self.wait(trial);
            }
            _ => {}
        }
        self.tracker.apply_to(trial)?;
        Ok(())
    }
}

struct Limb {
    receiver: LimbReceiver,
    socket: UdpSocket,
    start: Vec<f64>,
}

impl Limb {
    fn new(trial: &RunningTrial) -> Outcome<Self> {
        let testbed = trial.testbed();
        let start = testbed.plant().state().position[..testbed.model().arm_count()].to_vec();
        Ok(Self { receiver: LimbReceiver::bind(0)?, socket: UdpSocket::bind("127.0.0.1:0")?, start })
    }
}

impl Tracker for Limb {
    fn period_ticks(&self) -> u64 {
        BODY_TICKS
    }

    /// The wrist stands at the end to which extension turns it.
    fn moving_gesture(&self) -> Command {
        Command::WristFlexion
    }

    /// A limb that swings, for the joints of the level that the prosthesis does not have.
    fn send_measurement(&mut self, trial: &mut RunningTrial, number: u64) -> Outcome<()> {
        let swing = 0.25 * (number as f64 * 1.5e-3).sin();
        let angles: Vec<f64> = self.start.iter().map(|angle| angle - swing.abs()).collect();
        let text = json!({ "angles": angles }).to_string();
        self.socket.send_to(text.as_bytes(), self.receiver.address()?)?;
        wait_for("a limb", || Ok(self.receiver.apply_to(trial)))
    }

    fn fail(&mut self, trial: &mut RunningTrial, death: FailureMode, _number: u64) -> Outcome<()> {
        if death == FailureMode::Garbage {
            self.socket.send_to(b"{\"angles\": [1]}", self.receiver.address()?)?;
        }
        // What is no limb is an error that is shown, and nothing else.
        let _ = self.receiver.apply_to(trial);
        Ok(())
    }
}

struct Shoulder {
    // Taken back before the server ends.
    topics: HeadsetTopics,
    server: RosbridgeServer,
    client: Option<WebSocketClient>,
    start: Pose,
}

impl Shoulder {
    fn new(trial: &RunningTrial) -> Outcome<Self> {
        let bus: Arc<dyn TopicBus> = LocalBus::new();
        let topics = HeadsetTopics::new(
            bus.clone(),
            trial.testbed().model(),
            trial.testbed().task().scene(),
            trial.head_pose(),
        )?;
        let server =
            RosbridgeServer::start(RosbridgeOptions { port: 0, ..RosbridgeOptions::default() }, bus)?;
        let start = trial.testbed().plant().state().world_from_base;
        Ok(Self { topics, server, client: None, start })
    }
}

impl Tracker for Shoulder {
    fn period_ticks(&self) -> u64 {
        BODY_TICKS
    }

    /// A shoulder that breathes.
    fn send_measurement(&mut self, trial: &mut RunningTrial, number: u64) -> Outcome<()> {
        if self.client.is_none() {
            let mut link = WebSocketClient::open(&format!("ws://{}", self.server.address()))?;
            let kind = "gazebo_msgs/LinkState";
            link.send(&json!({"op": "advertise", "topic": "/gazebo/set_link_state", "type": kind}))?;
            self.client = Some(link);
        }
        let (p, q) = (self.start.translation.vector, self.start.rotation);
        let message = json!({
            "link_name": "mpl_right_arm::base_link",
            "pose": {
                "position": {"x": p.x, "y": p.y, "z": p.z + 0.005 * (number as f64 * 2e-3).sin()},
                "orientation": {"x": q.i, "y": q.j, "z": q.k, "w": q.w}
            }
        });
        let link = self.client.as_mut().ok_or("no connection")?;
        link.send(&json!({"op": "publish", "topic": "/gazebo/set_link_state", "msg": message}))?;
        wait_for("a shoulder", || Ok(apply_topic_inputs(&self.topics, trial)))
    }

    fn fail(&mut self, trial: &mut RunningTrial, death: FailureMode, _number: u64) -> Outcome<()> {
        match (death, &mut self.client) {
            (FailureMode::Closed, Some(link)) => {
                link.close()?;
                self.client = None;
            }
            (FailureMode::Garbage, Some(link)) => {
                let broken =
                    json!({"link_name": "mpl_right_arm::base_link", "pose": {"orientation": {"w": 9.0}}});
                link.send(&json!({"op": "publish", "topic": "/gazebo/set_link_state", "msg": broken}))?;
            }
            _ => {}
        }
        apply_topic_inputs(&self.topics, trial);
        Ok(())
    }
}
