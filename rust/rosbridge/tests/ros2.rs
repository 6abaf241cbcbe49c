//! Clients of ROS 2: the conversation of `ros2_double.txt`, and goals that go wrong.
#![allow(clippy::unwrap_used, clippy::disallowed_methods)]

mod common;

use common::{Client, server};
use proact_messages::{RosVersion, Time, builtin_type};
use proact_rosbridge::{RosbridgeServer, TopicMessage};
use serde_json::{Value as Json, json};
use std::collections::{BTreeMap, VecDeque};
use tokio_tungstenite::tungstenite::Message;

/// A client with what has come to it and was not looked at yet.
struct ConversationClient {
    client: Client,
    waiting: VecDeque<Json>,
}

impl ConversationClient {
    fn connect(server: &RosbridgeServer) -> Self {
        Self { client: Client::connect(server), waiting: VecDeque::new() }
    }

    /// Sends a text and waits until it has been handled.
    fn send(&mut self, text: &str) {
        self.client.0.send(Message::text(text)).unwrap();
        self.waiting.extend(self.client.drain_messages());
    }

    fn next(&mut self) -> Json {
        self.waiting.pop_front().unwrap_or_else(|| self.client.next())
    }
}

/// Compares a message with what is expected; `$name` takes its text, or must be it.
fn compare(got: &Json, expected: &Json, names: &mut BTreeMap<String, String>) -> bool {
    match (got, expected) {
        (_, Json::String(any)) if any == "..." => true,
        (Json::String(text), Json::String(name)) if name.starts_with('$') => {
            names.entry(name.clone()).or_insert_with(|| text.clone()) == text
        }
        (Json::Object(got), Json::Object(expected)) => {
            got.len() == expected.len()
                && expected
                    .iter()
                    .all(|(key, value)| got.get(key).is_some_and(|got| compare(got, value, names)))
        }
        (Json::Array(got), Json::Array(expected)) => {
            got.len() == expected.len()
                && got.iter().zip(expected).all(|(got, expected)| compare(got, expected, names))
        }
        (got, expected) => got == expected,
    }
}

#[test]
fn the_double_of_ros_2_is_answered_word_for_word() {
    let (server, _bus) = server();
    let mut sides: BTreeMap<char, ConversationClient> = BTreeMap::new();
    let mut names = BTreeMap::new();
    for line in include_str!("ros2_double.txt").lines() {
        let mut letters = line.chars();
        let (Some(name), Some(direction)) = (letters.next(), letters.next()) else { continue };
        if name == '#' {
            continue;
        }
        let side = sides.entry(name).or_insert_with(|| ConversationClient::connect(&server));
        let text = line.get(3..).unwrap();
        match direction {
            '>' => {
                let text = names.iter().fold(text.to_owned(), |text, (name, value): (&String, &String)| {
                    text.replace(&format!("\"{name}\""), &format!("\"{value}\""))
                });
                side.send(&text);
            }
            '<' => {
                let (got, expected) = (side.next(), serde_json::from_str(text).unwrap());
                assert!(compare(&got, &expected, &mut names), "got {got}\nexpected {line}");
            }
            other => panic!("{other} in {line}"),
        }
    }
    for (name, side) in &mut sides {
        assert_eq!(side.client.drain_messages(), Vec::<Json>::new(), "{name}");
        assert!(side.waiting.is_empty(), "{name}: {:?}", side.waiting);
    }
}

#[test]
fn the_address_makes_a_client_one_of_ros_2() {
    let (server, _bus) = server();
    let mut client = Client::connect_to(&server, "/?token=x&ros=2");
    client.advertise("/clock", "rosgraph_msgs/Clock");
    client.subscribe("/clock");
    client.publish("/clock", json!({"clock": {"secs": 1, "nsecs": 2}}));
    assert_eq!(client.next()["msg"], json!({"clock": {"sec": 1, "nanosec": 2}}));
}

#[test]
fn each_convention_is_written_once_and_both_at_once_where_they_agree() {
    for (name, alike) in [("std_msgs/String", true), ("geometry_msgs/Pose", true), ("std_msgs/Header", false)]
    {
        let kind = builtin_type(name).unwrap();
        let message = TopicMessage::new("/a", Some(kind.clone()), kind.default_value(Time::default()));
        let text = |convention| message.text(convention).as_str().as_ptr();
        assert_eq!(text(RosVersion::Ros1), text(RosVersion::Ros1), "{name}");
        assert_eq!(text(RosVersion::Ros2), text(RosVersion::Ros2), "{name}");
        assert_eq!(text(RosVersion::Ros1) == text(RosVersion::Ros2), alike, "{name}");
        let cbor = |convention| message.cbor(convention).as_ptr();
        assert_eq!(cbor(RosVersion::Ros1) == cbor(RosVersion::Ros2), alike, "{name}");
    }
}

/// A server of `/lab/move` that speaks actionlib's topics, connected.
fn action_server(server: &RosbridgeServer) -> Client {
    let mut owner = Client::connect(server);
    owner.send(json!({
        "op": "advertise", "topic": "/lab/move/status", "type": "actionlib_msgs/GoalStatusArray", "latch": true,
    }));
    owner.publish("/lab/move/status", json!({"status_list": []}));
    owner.advertise("/lab/move/feedback", "lab_msgs/MoveActionFeedback");
    owner.advertise("/lab/move/result", "lab_msgs/MoveActionResult");
    owner.send(json!({"op": "subscribe", "topic": "/lab/move/goal", "type": "lab_msgs/MoveActionGoal"}));
    owner.send(json!({"op": "subscribe", "topic": "/lab/move/cancel", "type": "actionlib_msgs/GoalID"}));
    owner.drain_messages();
    owner
}

fn goal(id: Json, args: Json) -> Json {
    json!({
        "op": "send_action_goal", "id": id, "action": "/lab/move", "action_type": "lab_msgs/action/Move",
        "args": args, "feedback": true,
    })
}

#[test]
fn goals_of_a_client_that_goes_are_cancelled() {
    let (server, _bus) = server();
    let mut owner = action_server(&server);
    let mut client = Client::connect(&server);
    client.send(goal(json!("g"), json!({"to": 1})));
    let sent = owner.next();
    assert_eq!(sent["msg"]["goal"], json!({"to": 1}));
    drop(client);
    let cancelled = owner.next();
    assert_eq!(cancelled["topic"], "/lab/move/cancel");
    assert_eq!(cancelled["msg"]["id"], sent["msg"]["goal_id"]["id"]);
}

#[test]
fn goals_of_a_server_that_goes_fail() {
    let (server, _bus) = server();
    let mut owner = action_server(&server);
    let mut client = Client::connect(&server);
    client.send(goal(json!("g"), json!({})));
    owner.next();
    drop(owner);
    let result = client.next();
    assert_eq!((&result["op"], &result["result"]), (&json!("action_result"), &json!(false)));
    assert!(result["values"].as_str().unwrap().contains("its server is gone"), "{result}");
    // It is known no more.
    client.send(goal(json!("g"), json!({})));
    assert!(client.next()["values"].as_str().unwrap().contains("there are none here"));
}

#[test]
fn a_goal_that_cannot_be_is_refused_and_reaches_no_server() {
    let (server, _bus) = server();
    let mut owner = action_server(&server);
    let mut client = Client::connect(&server);
    client.send(goal(json!("g"), json!({})));
    owner.next();
    // The same id again, arguments that are no object where the fields are not known.
    for (message, part) in [
        (goal(json!("g"), json!({})), "same id is in progress"),
        (goal(json!("h"), json!([1])), "give args as an object"),
        (goal(json!("h"), json!("x")), "expected an object or a list"),
        (goal(json!("h"), json!(1e300)), "expected an object or a list"),
    ] {
        client.send(message.clone());
        let result = client.next();
        assert_eq!((&result["op"], &result["result"]), (&json!("action_result"), &json!(false)), "{message}");
        assert!(result["values"].as_str().unwrap().contains(part), "{message}: {result}");
        assert_eq!(client.next()["op"], "status", "{message}");
    }
    // What is not even a goal is answered with a status alone.
    for (message, part) in [
        (json!({"op": "send_action_goal"}), "\"action\" is missing"),
        (json!({"op": "send_action_goal", "action": "/lab/move"}), "\"action_type\" is missing"),
        (goal(json!({"a": 1}), json!({})), "\"id\" is an object"),
        (json!({"op": "cancel_action_goal", "action": "/lab/move"}), "expected the \"id\""),
        (
            json!({"op": "advertise_action", "action": "/own", "type": "lab_msgs/action/Move"}),
            "not offered over",
        ),
        (json!({"op": "action_result", "action": "/own", "id": "x", "values": {}}), "not offered over"),
    ] {
        client.send(message.clone());
        let status = client.next();
        assert_eq!((&status["op"], &status["level"]), (&json!("status"), &json!("error")), "{message}");
        assert!(status["msg"].as_str().unwrap().contains(part), "{message}: {status}");
    }
    // Another client's goal is not this one's to cancel.
    let mut other = Client::connect(&server);
    other.send(json!({"op": "set_level", "level": "warning"}));
    other.send(json!({"op": "cancel_action_goal", "action": "/lab/move", "id": "g"}));
    assert!(other.next()["msg"].as_str().unwrap().contains("no goal \"g\""));
    assert_eq!(owner.drain_messages(), Vec::<Json>::new());
}

/// What a server says of a goal may be anything.
#[test]
fn nonsense_of_a_server_ends_no_connection() {
    let (server, _bus) = server();
    let mut owner = action_server(&server);
    let mut client = Client::connect(&server);
    client.send(goal(json!("g"), json!({})));
    let id = owner.next()["msg"]["goal_id"]["id"].clone();
    for topic in ["feedback", "result", "status"] {
        for msg in [
            json!({}),
            json!({"status": 1, "feedback": 2, "result": 3, "status_list": 4}),
            json!({"status": {"goal_id": 7}, "status_list": [null, {"goal_id": {"id": id}, "status": "x"}]}),
            json!({"status": {"goal_id": {"id": "x".repeat(100_000)}, "status": 3}}),
        ] {
            owner.publish(&format!("/lab/move/{topic}"), msg);
        }
    }
    owner.drain_messages();
    assert_eq!(client.drain_messages(), Vec::<Json>::new());
    owner.publish("/lab/move/result", json!({"status": {"goal_id": {"id": id}, "status": 1e300}}));
    let result = client.next();
    assert_eq!((&result["result"], &result["status"]), (&json!(false), &json!(0)), "{result}");
}
