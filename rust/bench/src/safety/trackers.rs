//! Trackers: the eye and the limb over UDP, the shoulder over rosbridge.

use super::{Death, Device, Outcome, wait_for};
use crate::bridge::Link;
use proact_app::{EyeTracker, LimbReceiver, drive_by_topics, query::scattered, trial};
use proact_devices::GazeReceiver;
use proact_rosbridge::{HeadsetTopics, LocalBus, RosbridgeOptions, RosbridgeServer, TopicBus};
use proact_testbed::{Session, Setup, TrialConfig};
use proact_types::{Gesture, InputSource, Pose};
use serde_json::json;
use std::{
    net::{SocketAddr, UdpSocket},
    sync::Arc,
};

/// Ticks from one measurement to the next: an eye at 50 Hz, limb and shoulder at 100.
const EYE_TICKS: u64 = 20;
const BODY_TICKS: u64 = 10;

/// A trial whose gestures come from nowhere that can die, and a tracker that can.
pub(super) fn device(source: InputSource, death: Death) -> Outcome<(Session, Box<dyn Device>)> {
    let method = if source == InputSource::EyeTracker { "D" } else { "A" };
    let mut config = TrialConfig::new(method, 1, Setup::named("still")?);
    if source == InputSource::LimbTracker {
        config = config.with_values(&["profile.level=below_elbow"])?;
    }
    let session = trial::live(config)?.session;
    let tracker: Box<dyn Tracker> = match source {
        InputSource::EyeTracker => Box::new(Eye::new(&session)?),
        InputSource::LimbTracker => Box::new(Limb::new(&session)?),
        _ => Box::new(Shoulder::new(&session)?),
    };
    Ok((session, Box::new(Tracked { tracker, death, number: 0, first_bad: None })))
}

/// What a tracker sends, and how it arrives.
trait Tracker {
    fn period(&self) -> u64;

    /// The gesture that moves the arm.
    fn moving(&self) -> Gesture {
        Gesture::WristExtension
    }

    /// Sends measurement `number`, and waits for it.
    fn measure(&mut self, session: &mut Session, number: u64) -> Outcome<()>;

    /// Sends what dies in its place, if anything, and waits for it if it is a measurement.
    fn die(&mut self, session: &mut Session, death: Death, number: u64) -> Outcome<()>;
}

struct Tracked {
    tracker: Box<dyn Tracker>,
    death: Death,
    /// Of the last measurement.
    number: u64,
    first_bad: Option<u64>,
}

impl Device for Tracked {
    fn feed(&mut self, session: &mut Session, tick: u64, gesture: Gesture, lives: bool) -> Outcome<()> {
        let moves = gesture == Gesture::WristExtension;
        session.person().act(if moves { self.tracker.moving() } else { gesture });
        if !tick.is_multiple_of(self.tracker.period()) {
            return Ok(());
        }
        if lives {
            self.number = tick;
            return self.tracker.measure(session, tick);
        }
        self.first_bad.get_or_insert(tick);
        match self.death {
            Death::Constant => self.tracker.measure(session, self.number),
            death => self.tracker.die(session, death, tick),
        }
    }

    fn first_bad(&self) -> Option<u64> {
        self.first_bad
    }
}

/// A number about zero, another for each measurement.
fn noise(number: u64, of: usize) -> f64 {
    scattered(number, of) - 0.5
}

struct Eye {
    tracker: EyeTracker,
    socket: UdpSocket,
    address: SocketAddr,
}

impl Eye {
    fn new(_session: &Session) -> Outcome<Self> {
        let receiver = GazeReceiver::bind(0)?;
        let address = receiver.address()?;
        let tracker = EyeTracker::new(Box::new(receiver));
        Ok(Self { tracker, socket: UdpSocket::bind("127.0.0.1:0")?, address })
    }

    fn send(&self, text: &str) -> Outcome<()> {
        self.socket.send_to(text.as_bytes(), self.address)?;
        Ok(())
    }

    fn wait(&mut self, session: &mut Session) -> Outcome<()> {
        wait_for("a gaze", || Ok(self.tracker.drive(session)?))
    }
}

impl Tracker for Eye {
    fn period(&self) -> u64 {
        EYE_TICKS
    }

    /// A look at the first block from where the head is, with the noise of an eye.
    fn measure(&mut self, session: &mut Session, number: u64) -> Outcome<()> {
        let eye = session.head().translation.vector;
        let block = session.testbed().task().scene().objects[0].pose.translation.vector;
        let mut direction = block - eye;
        direction.iter_mut().enumerate().for_each(|(k, value)| *value += 0.002 * noise(number, k));
        let (origin, direction): ([f64; 3], [f64; 3]) = (eye.into(), direction.into());
        self.send(&json!({"origin": origin, "direction": direction}).to_string())?;
        self.wait(session)
    }

    fn die(&mut self, session: &mut Session, death: Death, _number: u64) -> Outcome<()> {
        match death {
            Death::Garbage => self.send("not a gaze")?,
            Death::Zeros => self.send(&json!({"origin": [0, 0, 0], "direction": [0, 0, 0]}).to_string())?,
            Death::Blank => {
                self.send(&json!({"origin": [0, 0, 0], "direction": [1, 0, 0], "valid": false}).to_string())?;
                return self.wait(session);
            }
            _ => {}
        }
        self.tracker.drive(session)?;
        Ok(())
    }
}

struct Limb {
    receiver: LimbReceiver,
    socket: UdpSocket,
    start: Vec<f64>,
}

impl Limb {
    fn new(session: &Session) -> Outcome<Self> {
        let testbed = session.testbed();
        let start = testbed.plant().state().position[..testbed.model().arm_count()].to_vec();
        Ok(Self { receiver: LimbReceiver::bind(0)?, socket: UdpSocket::bind("127.0.0.1:0")?, start })
    }
}

impl Tracker for Limb {
    fn period(&self) -> u64 {
        BODY_TICKS
    }

    /// The wrist stands at the end to which extension turns it.
    fn moving(&self) -> Gesture {
        Gesture::WristFlexion
    }

    /// A limb that swings, for the joints of the level that the prosthesis does not have.
    fn measure(&mut self, session: &mut Session, number: u64) -> Outcome<()> {
        let swing = 0.25 * (number as f64 * 1.5e-3).sin();
        let angles: Vec<f64> = self.start.iter().map(|angle| angle - swing.abs()).collect();
        let text = json!({ "angles": angles }).to_string();
        self.socket.send_to(text.as_bytes(), self.receiver.address()?)?;
        wait_for("a limb", || Ok(self.receiver.drive(session)))
    }

    fn die(&mut self, session: &mut Session, death: Death, _number: u64) -> Outcome<()> {
        if death == Death::Garbage {
            self.socket.send_to(b"{\"angles\": [1]}", self.receiver.address()?)?;
        }
        // What is no limb is an error that is shown, and nothing else.
        let _ = self.receiver.drive(session);
        Ok(())
    }
}

struct Shoulder {
    // Taken back before the server ends.
    topics: HeadsetTopics,
    server: RosbridgeServer,
    link: Option<Link>,
    start: Pose,
}

impl Shoulder {
    fn new(session: &Session) -> Outcome<Self> {
        let bus: Arc<dyn TopicBus> = LocalBus::new();
        let topics = HeadsetTopics::new(
            bus.clone(),
            session.testbed().model(),
            session.testbed().task().scene(),
            session.head(),
        )?;
        let server =
            RosbridgeServer::start(RosbridgeOptions { port: 0, ..RosbridgeOptions::default() }, bus)?;
        let start = session.testbed().plant().state().world_from_base;
        Ok(Self { topics, server, link: None, start })
    }
}

impl Tracker for Shoulder {
    fn period(&self) -> u64 {
        BODY_TICKS
    }

    /// A shoulder that breathes.
    fn measure(&mut self, session: &mut Session, number: u64) -> Outcome<()> {
        if self.link.is_none() {
            let mut link = Link::open(&format!("ws://{}", self.server.address()))?;
            let kind = "gazebo_msgs/LinkState";
            link.send(&json!({"op": "advertise", "topic": "/gazebo/set_link_state", "type": kind}))?;
            self.link = Some(link);
        }
        let (p, q) = (self.start.translation.vector, self.start.rotation);
        let message = json!({
            "link_name": "mpl_right_arm::base_link",
            "pose": {
                "position": {"x": p.x, "y": p.y, "z": p.z + 0.005 * (number as f64 * 2e-3).sin()},
                "orientation": {"x": q.i, "y": q.j, "z": q.k, "w": q.w}
            }
        });
        let link = self.link.as_mut().ok_or("no connection")?;
        link.send(&json!({"op": "publish", "topic": "/gazebo/set_link_state", "msg": message}))?;
        wait_for("a shoulder", || Ok(drive_by_topics(&self.topics, session)))
    }

    fn die(&mut self, session: &mut Session, death: Death, _number: u64) -> Outcome<()> {
        match (death, &mut self.link) {
            (Death::Closed, Some(link)) => {
                link.close()?;
                self.link = None;
            }
            (Death::Garbage, Some(link)) => {
                let broken =
                    json!({"link_name": "mpl_right_arm::base_link", "pose": {"orientation": {"w": 9.0}}});
                link.send(&json!({"op": "publish", "topic": "/gazebo/set_link_state", "msg": broken}))?;
            }
            _ => {}
        }
        drive_by_topics(&self.topics, session);
        Ok(())
    }
}
