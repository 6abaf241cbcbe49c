//! Links that command gestures: a page on its WebSocket, and `/emg` on rosbridge.

use super::{FailingSource, FailureMode, Outcome, wait_for};
use crate::bridge::WebSocketClient;
use proact_app::{apply_page_inputs, apply_topic_inputs, trial};
use proact_bridge::{PageContent, PageOptions, PageServer};
use proact_rosbridge::{HeadsetTopics, LocalBus, RosbridgeOptions, RosbridgeServer, TopicBus};
use proact_testbed::{RunningTrial, Setup, TrialConfig};
use proact_types::{Command, InputSource};
use serde_json::json;
use std::sync::Arc;

/// Ticks from one sign of life of the page to the next, and from one message of the topic.
const PAGE_TICKS: u64 = 40;
const TOPIC_TICKS: u64 = 50;

/// A trial of method A by keys, and who presses them.
pub(super) fn device(
    source: InputSource,
    death: FailureMode,
) -> Outcome<(RunningTrial, Box<dyn FailingSource>)> {
    let mut config = TrialConfig::new("A", 1, Setup::named("still")?);
    if let Some(ages) = &mut config.profile.dead_man {
        // These lines are read between ticks, in lock-step: their round trips say how busy the machine is.
        ages.max_delay_ms = 60_000;
    }
    let trial = trial::live_trial(config)?.trial;
    let device: Box<dyn FailingSource> = match source {
        InputSource::Page => Box::new(PageSource::new(&trial, death)?),
        _ => Box::new(TopicSource::new(&trial, death)?),
    };
    Ok((trial, device))
}

/// How one end of a WebSocket dies.
fn fail_connection(link: &mut Option<WebSocketClient>, death: FailureMode, garbage: &[&str]) -> Outcome<()> {
    match (death, link.as_mut()) {
        (FailureMode::Closed, Some(open)) => {
            open.close()?;
            *link = None;
        }
        (FailureMode::Killed, _) => *link = None,
        (FailureMode::Garbage, Some(open)) => {
            for text in garbage {
                open.enqueue((*text).to_owned())?;
            }
            open.flush()?;
        }
        _ => {}
    }
    Ok(())
}

struct PageSource {
    server: PageServer,
    client: Option<WebSocketClient>,
    failure: FailureMode,
    held_gesture: Command,
    first_bad_tick: Option<u64>,
}

impl PageSource {
    fn new(trial: &RunningTrial, death: FailureMode) -> Outcome<Self> {
        let testbed = trial.testbed();
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
        Ok(Self {
            server,
            client: link,
            failure: death,
            held_gesture: Command::NoMotion,
            first_bad_tick: None,
        })
    }

    fn connect(server: &PageServer) -> Outcome<WebSocketClient> {
        WebSocketClient::open(&format!("{}live", server.url().replacen("http", "ws", 1)))
    }
}

impl FailingSource for PageSource {
    fn send_tick(
        &mut self,
        trial: &mut RunningTrial,
        tick: u64,
        command: Command,
        lives: bool,
    ) -> Outcome<()> {
        // The testbed looks after the page once a picture; a sign is due whenever the page sends one.
        let due = tick.is_multiple_of(PAGE_TICKS);
        if due && !lives {
            self.first_bad_tick.get_or_insert(tick);
            let closes =
                matches!(self.failure, FailureMode::Closed | FailureMode::Killed) && self.client.is_some();
            fail_connection(
                &mut self.client,
                self.failure,
                &["nonsense", "{\"type\":\"fly\"}", "{\"type\":\"gaze\"}"],
            )?;
            if closes {
                // The end of a connection is an input too.
                return wait_for("the end of the page", || {
                    let inputs = self.server.drain_inputs();
                    let came = !inputs.is_empty();
                    apply_page_inputs(&self.server, inputs, trial);
                    Ok(came)
                });
            }
        }
        if due && lives {
            if self.client.is_none() {
                // A person whose key is still down opens the page again.
                self.client = Some(Self::connect(&self.server)?);
                self.held_gesture = Command::NoMotion;
            }
            let link = self.client.as_mut().ok_or("no connection")?;
            if command != self.held_gesture {
                link.send(&json!({"type": "gesture", "gesture": command}))?;
                self.held_gesture = command;
            } else {
                link.send(&json!({"type": "alive"}))?;
            }
            // A sign of life of a page that holds nothing, and does not drive, is no sign.
            link.wait_until_page_handled(tick)?;
        }
        let inputs = self.server.drain_inputs();
        apply_page_inputs(&self.server, inputs, trial);
        Ok(())
    }

    fn first_bad_tick(&self) -> Option<u64> {
        self.first_bad_tick
    }
}

struct TopicSource {
    // Taken back before the server ends.
    topics: HeadsetTopics,
    server: RosbridgeServer,
    client: Option<WebSocketClient>,
    failure: FailureMode,
    first_bad_tick: Option<u64>,
}

impl TopicSource {
    fn new(trial: &RunningTrial, death: FailureMode) -> Outcome<Self> {
        let bus: Arc<dyn TopicBus> = LocalBus::new();
        let topics = HeadsetTopics::new(
            bus.clone(),
            trial.testbed().model(),
            trial.testbed().task().scene(),
            trial.head_pose(),
        )?;
        let server =
            RosbridgeServer::start(RosbridgeOptions { port: 0, ..RosbridgeOptions::default() }, bus)?;
        let link = Some(Self::connect(&server)?);
        Ok(Self { topics, server, client: link, failure: death, first_bad_tick: None })
    }

    fn connect(server: &RosbridgeServer) -> Outcome<WebSocketClient> {
        let mut link = WebSocketClient::open(&format!("ws://{}", server.address()))?;
        link.send(&json!({"op": "advertise", "topic": "/emg", "type": "std_msgs/String"}))?;
        Ok(link)
    }
}

impl FailingSource for TopicSource {
    fn send_tick(
        &mut self,
        trial: &mut RunningTrial,
        tick: u64,
        command: Command,
        lives: bool,
    ) -> Outcome<()> {
        if tick.is_multiple_of(TOPIC_TICKS) {
            if lives {
                if self.client.is_none() {
                    self.client = Some(Self::connect(&self.server)?);
                }
                let link = self.client.as_mut().ok_or("no connection")?;
                let message = json!({"data": command.ros_name()});
                link.send(&json!({"op": "publish", "topic": "/emg", "msg": message}))?;
                return wait_for("a message on /emg", || Ok(apply_topic_inputs(&self.topics, trial)));
            }
            self.first_bad_tick.get_or_insert(tick);
            let wave = r#"{"op":"publish","topic":"/emg","msg":{"data":"wave"}}"#;
            let number = r#"{"op":"publish","topic":"/emg","msg":{"data":7}}"#;
            fail_connection(&mut self.client, self.failure, &["nonsense", wave, number])?;
        }
        apply_topic_inputs(&self.topics, trial);
        Ok(())
    }

    fn first_bad_tick(&self) -> Option<u64> {
        self.first_bad_tick
    }
}
