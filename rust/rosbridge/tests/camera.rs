//! Pictures that clients ask for.
#![allow(clippy::unwrap_used, clippy::disallowed_methods)]

mod common;

use common::frame;
use proact_description::mpl_right_arm;
use proact_messages::{MessageValue, Time};
use proact_rosbridge::{CameraTopics, LocalBus, ServiceReply, TopicBus, TopicMessage, TopicSink};
use proact_types::{Pose, Scene};
use serde_json::{Value as Json, json};
use std::sync::{
    Arc, Mutex,
    mpsc::{Sender, channel},
};

const TOPICS: [&str; 3] = ["/proact/camera/image_raw", "/proact/camera/camera_info", "/proact/camera/pose"];

struct Collect(Mutex<Sender<Arc<TopicMessage>>>);

impl TopicSink for Collect {
    fn deliver(&self, message: &Arc<TopicMessage>) {
        self.0.lock().unwrap().send(Arc::clone(message)).unwrap();
    }
    fn wake(&self) {}
}

fn call(bus: &Arc<dyn TopicBus>) -> Json {
    let (send, answer) = channel();
    bus.call_service(
        "/proact/camera/take",
        json!({}),
        ServiceReply::new(move |result| send.send(result).unwrap()),
    );
    answer.recv().unwrap().unwrap()
}

#[test]
fn each_call_publishes_one_picture_whose_messages_agree_with_their_definitions() {
    let bus: Arc<dyn TopicBus> = LocalBus::new();
    let scene = Scene { table_height: 1.0, ..Scene::default() };
    let camera = CameraTopics::new(Arc::clone(&bus), &mpl_right_arm(), &scene).unwrap();
    let (send, received) = channel();
    let sink = Arc::new(Collect(Mutex::new(send)));
    let member = bus.join("/test");
    for topic in TOPICS {
        let sink: Arc<dyn TopicSink> = Arc::<Collect>::clone(&sink);
        bus.subscribe(member, topic, None, sink).unwrap();
    }
    assert_eq!(call(&bus)["success"], false, "there is nothing to see yet");
    camera.set_frame(&frame(Pose::translation(-0.5, 0.0, 1.6)));
    assert_eq!(call(&bus)["success"], true);
    let messages: Vec<Arc<TopicMessage>> = received.try_iter().collect();
    assert_eq!(messages.iter().map(|m| &*m.topic).collect::<Vec<_>>(), TOPICS);
    for message in &messages {
        let json = serde_json::to_value(&message.value).unwrap();
        let kind = message.definition.clone().unwrap();
        assert_eq!(kind.parse_json(json, Time::default()).unwrap(), message.value, "{}", message.topic);
    }
    let Some(MessageValue::Bytes(data)) = messages[0].value.get("data") else { panic!("no data") };
    assert_eq!(data.len(), 3 * 640 * 480);
    drop(camera);
    assert!(bus.graph().services.is_empty(), "the service goes with the camera");
}
