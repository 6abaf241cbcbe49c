//! Links that command gestures: a page on its WebSocket, and `/emg` on rosbridge.

use super::{Death, Device, Outcome, wait_for};
use crate::bridge::Link;
use proact_app::{drive_by_page, drive_by_topics, trial};
use proact_bridge::{PageContent, PageOptions, PageServer};
use proact_rosbridge::{HeadsetTopics, LocalBus, RosbridgeOptions, RosbridgeServer, TopicBus};
use proact_testbed::{Session, Setup, TrialConfig};
use proact_types::{Gesture, InputSource};
use serde_json::json;
use std::sync::Arc;

/// Ticks from one sign of life of the page to the next, and from one message of the topic.
const PAGE_TICKS: u64 = 40;
const TOPIC_TICKS: u64 = 50;

/// A trial of method A by keys, and who presses them.
pub(super) fn device(source: InputSource, death: Death) -> Outcome<(Session, Box<dyn Device>)> {
    let mut config = TrialConfig::new("A", 1, Setup::named("still")?);
    if let Some(ages) = &mut config.profile.dead_man {
        // These lines are read between ticks, in lock-step: their round trips say how busy the machine is.
        ages.delay_ms = 60_000;
    }
    let session = trial::live(config)?.session;
    let device: Box<dyn Device> = match source {
        InputSource::Page => Box::new(Page::new(&session, death)?),
        _ => Box::new(Topic::new(&session, death)?),
    };
    Ok((session, device))
}

/// How one end of a WebSocket dies.
fn die(link: &mut Option<Link>, death: Death, garbage: &[&str]) -> Outcome<()> {
    match (death, link.as_mut()) {
        (Death::Closed, Some(open)) => {
            open.close()?;
            *link = None;
        }
        (Death::Killed, _) => *link = None,
        (Death::Garbage, Some(open)) => {
            for text in garbage {
                open.feed((*text).to_owned())?;
            }
            open.flush()?;
        }
        _ => {}
    }
    Ok(())
}

struct Page {
    server: PageServer,
    link: Option<Link>,
    death: Death,
    held: Gesture,
    first_bad: Option<u64>,
}

impl Page {
    fn new(session: &Session, death: Death) -> Outcome<Self> {
        let testbed = session.testbed();
        let content = PageContent {
            title: "bench".to_owned(),
            setup: testbed.config().setup.name.clone(),
            arm: testbed.model().as_ref().clone(),
            meshes: vec![],
            scene: testbed.task().scene().clone(),
            briefing: testbed.task().briefing().clone(),
            interactive: true,
            lean: false,
            method: Default::default(),
            methods: vec![],
        };
        let server = PageServer::start(PageOptions { port: 0, ..PageOptions::default() }, content)?;
        let link = Some(Self::connect(&server)?);
        Ok(Self { server, link, death, held: Gesture::NoMotion, first_bad: None })
    }

    fn connect(server: &PageServer) -> Outcome<Link> {
        Link::open(&format!("{}live", server.url().replacen("http", "ws", 1)))
    }
}

impl Device for Page {
    fn feed(&mut self, session: &mut Session, tick: u64, gesture: Gesture, lives: bool) -> Outcome<()> {
        // The testbed looks after the page once a picture; a sign is due whenever the page sends one.
        let due = tick.is_multiple_of(PAGE_TICKS);
        if due && !lives {
            self.first_bad.get_or_insert(tick);
            let closes = matches!(self.death, Death::Closed | Death::Killed) && self.link.is_some();
            die(&mut self.link, self.death, &["nonsense", "{\"type\":\"fly\"}", "{\"type\":\"gaze\"}"])?;
            if closes {
                // The end of a connection is an input too.
                return wait_for("the end of the page", || {
                    let inputs = self.server.drain_inputs();
                    let came = !inputs.is_empty();
                    drive_by_page(&self.server, inputs, session);
                    Ok(came)
                });
            }
        }
        if due && lives {
            if self.link.is_none() {
                // A person whose key is still down opens the page again.
                self.link = Some(Self::connect(&self.server)?);
                self.held = Gesture::NoMotion;
            }
            let link = self.link.as_mut().ok_or("no connection")?;
            if gesture != self.held {
                link.send(&json!({"type": "gesture", "gesture": gesture}))?;
                self.held = gesture;
            } else {
                link.send(&json!({"type": "alive"}))?;
            }
            // A sign of life of a page that holds nothing, and does not drive, is no sign.
            link.settle_page(tick)?;
        }
        let inputs = self.server.drain_inputs();
        drive_by_page(&self.server, inputs, session);
        Ok(())
    }

    fn first_bad(&self) -> Option<u64> {
        self.first_bad
    }
}

struct Topic {
    // Taken back before the server ends.
    topics: HeadsetTopics,
    server: RosbridgeServer,
    link: Option<Link>,
    death: Death,
    first_bad: Option<u64>,
}

impl Topic {
    fn new(session: &Session, death: Death) -> Outcome<Self> {
        let bus: Arc<dyn TopicBus> = LocalBus::new();
        let topics = HeadsetTopics::new(
            bus.clone(),
            session.testbed().model(),
            session.testbed().task().scene(),
            session.head(),
        )?;
        let server =
            RosbridgeServer::start(RosbridgeOptions { port: 0, ..RosbridgeOptions::default() }, bus)?;
        let link = Some(Self::connect(&server)?);
        Ok(Self { topics, server, link, death, first_bad: None })
    }

    fn connect(server: &RosbridgeServer) -> Outcome<Link> {
        let mut link = Link::open(&format!("ws://{}", server.address()))?;
        link.send(&json!({"op": "advertise", "topic": "/emg", "type": "std_msgs/String"}))?;
        Ok(link)
    }
}

impl Device for Topic {
    fn feed(&mut self, session: &mut Session, tick: u64, gesture: Gesture, lives: bool) -> Outcome<()> {
        if tick.is_multiple_of(TOPIC_TICKS) {
            if lives {
                if self.link.is_none() {
                    self.link = Some(Self::connect(&self.server)?);
                }
                let link = self.link.as_mut().ok_or("no connection")?;
                let message = json!({"data": gesture.ros_name()});
                link.send(&json!({"op": "publish", "topic": "/emg", "msg": message}))?;
                return wait_for("a message on /emg", || Ok(drive_by_topics(&self.topics, session)));
            }
            self.first_bad.get_or_insert(tick);
            let wave = r#"{"op":"publish","topic":"/emg","msg":{"data":"wave"}}"#;
            let number = r#"{"op":"publish","topic":"/emg","msg":{"data":7}}"#;
            die(&mut self.link, self.death, &["nonsense", wave, number])?;
        }
        drive_by_topics(&self.topics, session);
        Ok(())
    }

    fn first_bad(&self) -> Option<u64> {
        self.first_bad
    }
}
