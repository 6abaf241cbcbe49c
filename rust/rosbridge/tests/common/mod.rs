//! A client of rosbridge that speaks raw frames, and a frame of a trial.
#![allow(dead_code)]

use nalgebra::{Translation3, UnitQuaternion};
use proact_rosbridge::{LocalBus, RosbridgeOptions, RosbridgeServer, TopicBus};
use proact_types::{
    DisplayFrame, HandView, Object, ObjectId, PlannerView, Point, Pose, Scene, Shape, SimTime, TargetView,
};
use serde_json::{Value as Json, json};
use std::{net::TcpStream, sync::Arc, time::Duration};
use tokio_tungstenite::tungstenite::{Message, WebSocket, client};

/// A server on a port of the system's choice, and its bus.
pub fn server() -> (RosbridgeServer, Arc<dyn TopicBus>) {
    let bus: Arc<dyn TopicBus> = LocalBus::new();
    let options = RosbridgeOptions { port: 0, ..RosbridgeOptions::default() };
    (RosbridgeServer::start(options, Arc::clone(&bus)).unwrap(), bus)
}

/// A connected client.
pub struct Client(pub WebSocket<TcpStream>);

impl Client {
    pub fn connect(server: &RosbridgeServer) -> Client {
        Self::connect_to(server, "/")
    }

    pub fn connect_to(server: &RosbridgeServer, path: &str) -> Client {
        let stream = TcpStream::connect(server.address()).unwrap();
        // Only a test that fails waits so long.
        stream.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
        stream.set_nodelay(true).unwrap();
        let url = format!("ws://{}{path}", server.address());
        let (socket, _) = client(url, stream).unwrap();
        Client(socket)
    }

    pub fn send(&mut self, json: Json) {
        self.0.send(Message::text(json.to_string())).unwrap();
    }

    pub fn send_binary(&mut self, json: &Json) {
        self.0.send(Message::binary(json.to_string().into_bytes())).unwrap();
    }

    /// The next data frame.
    pub fn frame(&mut self) -> Message {
        loop {
            match self.0.read().unwrap() {
                Message::Ping(_) | Message::Pong(_) => {}
                message => return message,
            }
        }
    }

    pub fn next(&mut self) -> Json {
        serde_json::from_str(self.frame().to_text().unwrap()).unwrap()
    }

    /// Waits until everything that was sent before has been handled.
    pub fn drain_messages(&mut self) -> Vec<Json> {
        let id = "settled?";
        self.send(json!({"op": "call_service", "id": id, "service": "/rosapi/get_time"}));
        let mut before = Vec::new();
        loop {
            let message = self.next();
            if message["id"] == id {
                return before;
            }
            before.push(message);
        }
    }

    pub fn subscribe(&mut self, topic: &str) {
        self.send(json!({"op": "subscribe", "topic": topic}));
    }

    pub fn advertise(&mut self, topic: &str, kind: &str) {
        self.send(json!({"op": "advertise", "topic": topic, "type": kind}));
    }

    pub fn publish(&mut self, topic: &str, msg: Json) {
        self.send(json!({"op": "publish", "topic": topic, "msg": msg}));
    }
}

/// The texts that were published on a topic, in their order.
pub fn texts(messages: &[Json], topic: &str) -> Vec<String> {
    let of_topic = messages.iter().filter(|message| message["topic"] == topic);
    of_topic.map(|message| message["msg"]["data"].as_str().unwrap().to_owned()).collect()
}

/// Four blocks under the original's names.
pub fn scene() -> Scene {
    let names = ["redcylinder1", "redcylinder2", "bluecylinder1", "bluecylinder2"];
    let shape = Shape::Cylinder { radius: 0.025, length: 0.05 };
    let block = |name| Object::with_default_friction(name, shape, 0.1, Pose::identity());
    Scene { objects: names.map(block).to_vec(), table_height: 1.0, ..Scene::default() }
}

/// An instant of a trial, with the head where `world_from_head` says.
pub fn frame(world_from_head: Pose) -> DisplayFrame {
    let turn = UnitQuaternion::from_euler_angles(0.1, -0.2, 0.7);
    let blocks = (0..4).map(|n| Pose::translation(0.1 * f64::from(n), -0.2, 1.04)).collect();
    DisplayFrame {
        time: SimTime(12_345),
        method: "D".to_owned(),
        joints: (0..27).map(|n| f64::from(n) * 0.3 - 4.0).collect(),
        world_from_base: Pose::from_parts(Translation3::new(-0.39, 0.12, 1.5), turn),
        world_from_tip: Pose::identity(),
        world_from_head,
        objects: blocks,
        hand: HandView::default(),
        gaze: None,
        target: TargetView {
            object: Some(ObjectId(3)),
            place: Some(Point::new(0.05, 0.2, 1.015)),
            locked: false,
            posterior: Vec::new(),
        },
        planner: PlannerView::Idle,
        mode: None,
        stop: None,
        command: proact_types::Command::NoMotion,
        recognized_gesture: proact_types::Command::NoMotion.into(),
        confidence: 1.0,
        effort: 0.5,
        emg_source: "keys".to_owned(),
        time_left_secs: 100.0,
        plan_goal: None,
        next_object: None,
        task_goal: None,
        score: 0,
        finished: false,
        events: Vec::new(),
        contacts: Vec::new(),
        feedback: Vec::new(),
    }
}
