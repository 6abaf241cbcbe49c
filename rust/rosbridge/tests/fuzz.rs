//! Nothing that a client sends may bring the server down or keep it from answering others.
#![allow(clippy::unwrap_used, clippy::disallowed_methods)]

mod common;

use common::{Client, server};
use proact_rosbridge::RosbridgeServer;
use proptest::{
    prelude::*,
    test_runner::{Config, TestRunner},
};
use serde_json::{Value as Json, json};
use std::sync::{
    Once,
    atomic::{AtomicUsize, Ordering},
};
use tokio_tungstenite::tungstenite::Message;

/// Any JSON, with the protocol's own words among the texts and keys.
fn any_json() -> impl Strategy<Value = Json> {
    let word = prop_oneof![
        Just("op".to_owned()),
        Just("topic".to_owned()),
        Just("/chat".to_owned()),
        Just("publish".to_owned()),
        Just("std_msgs/String".to_owned()),
        "\\PC{0,12}",
    ];
    let leaf = prop_oneof![
        Just(Json::Null),
        any::<bool>().prop_map(Json::from),
        any::<i64>().prop_map(Json::from),
        any::<f64>().prop_map(Json::from),
        word.clone().prop_map(Json::from),
    ];
    leaf.prop_recursive(4, 32, 6, move |inner| {
        prop_oneof![
            prop::collection::vec(inner.clone(), 0..6).prop_map(Json::from),
            prop::collection::btree_map(word.clone(), inner, 0..6)
                .prop_map(|map| Json::Object(map.into_iter().collect())),
        ]
    })
}

/// A message with a true operation and arbitrary values under the keys that the protocol has.
fn any_message() -> impl Strategy<Value = Json> {
    let operation = prop::sample::select(vec![
        "advertise",
        "unadvertise",
        "publish",
        "subscribe",
        "unsubscribe",
        "call_service",
        "advertise_service",
        "unadvertise_service",
        "service_response",
        "fragment",
        "set_level",
        "status",
        "auth",
        "png",
        "send_action_goal",
        "cancel_action_goal",
        "advertise_action",
        "action_result",
    ]);
    let key = prop::sample::select(vec![
        "id",
        "topic",
        "type",
        "msg",
        "service",
        "args",
        "values",
        "result",
        "throttle_rate",
        "queue_length",
        "fragment_size",
        "compression",
        "level",
        "num",
        "total",
        "data",
        "latch",
        "timeout",
        "action",
        "action_type",
        "feedback",
    ]);
    let value = prop_oneof![
        any_json(),
        prop::sample::select(vec![
            json!("/chat"),
            json!("/rosapi/topics"),
            json!("std_msgs/String"),
            json!("std_msgs/msg/Header"),
            json!("/lab/move"),
            json!("/lab/move/goal"),
            json!("/lab/move/result"),
            json!("/lab/move/cancel"),
            json!("lab_msgs/MoveActionGoal"),
            json!("lab_msgs/MoveActionResult"),
            json!("lab_msgs/action/Move"),
            json!("/lab/move/_action/cancel_goal"),
            json!("png"),
            json!("cbor"),
            json!(0),
            json!(1),
            json!(3),
            json!({"data": "x"}),
            json!({}),
            json!([]),
            json!(1e300),
            json!(true),
        ]),
    ];
    (operation, prop::collection::btree_map(key, value, 0..8)).prop_map(|(operation, map)| {
        let mut message: serde_json::Map<String, Json> =
            map.into_iter().map(|(key, value)| (key.to_owned(), value)).collect();
        message.insert("op".to_owned(), json!(operation));
        Json::Object(message)
    })
}

/// Panics of the server's thread: they would end one client and not be seen otherwise.
static PANICS: AtomicUsize = AtomicUsize::new(0);

fn count_panics() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        let usual = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |info| {
            if std::thread::current().name() == Some("rosbridge") {
                PANICS.fetch_add(1, Ordering::Relaxed);
            }
            usual(info);
        }));
    });
}

fn still_answers(server: &RosbridgeServer) {
    let mut client = Client::connect(server);
    client.drain_messages();
    assert_eq!(PANICS.load(Ordering::Relaxed), 0, "the server's thread panicked");
}

/// Runs `cases` batches, each on a connection of its own; the server must answer the client, or close its
/// connection, and must answer others.
fn fuzz(batch: impl Strategy<Value = Vec<Message>>, cases: u32) {
    count_panics();
    let (server, _bus) = server();
    let mut runner = TestRunner::new_with_rng(
        Config { cases, failure_persistence: None, ..Config::default() },
        proptest::test_runner::TestRng::deterministic_rng(proptest::test_runner::RngAlgorithm::ChaCha),
    );
    let server = &server;
    runner
        .run(&batch, |messages| {
            let mut client = Client::connect(server);
            for message in messages {
                if client.0.send(message).is_err() {
                    break;
                }
            }
            drop(client);
            still_answers(server);
            Ok(())
        })
        .unwrap();
}

#[test]
fn arbitrary_bytes_are_survived() {
    let bytes = prop::collection::vec(any::<u8>(), 0..300);
    let message = (bytes, any::<bool>()).prop_map(|(bytes, text)| match String::from_utf8(bytes) {
        Ok(string) if text => Message::text(string),
        Ok(string) => Message::binary(string.into_bytes()),
        Err(error) => Message::binary(error.into_bytes()),
    });
    fuzz(prop::collection::vec(message, 1..40), 60);
}

#[test]
fn arbitrary_json_is_survived() {
    let message = any_json().prop_map(|json| Message::text(json.to_string()));
    fuzz(prop::collection::vec(message, 1..40), 60);
}

#[test]
fn operations_with_arbitrary_values_are_survived() {
    let message = any_message().prop_map(|json| Message::text(json.to_string()));
    fuzz(prop::collection::vec(message, 1..80), 120);
}

/// Goals for an action server, and what that server says of them.
fn action_messages() -> impl Strategy<Value = Json> {
    let id = prop_oneof![Just(json!("g")), Just(json!(1)), any_json()];
    let action = prop::sample::select(vec!["/lab/move", "lab/move", "/lab/other", ""]);
    let type_name =
        prop::sample::select(vec!["lab_msgs/action/Move", "lab_msgs/Move", "lab_msgs/action/Other", "/"]);
    let goal = (id.clone(), action.clone(), type_name, any_json(), any::<bool>()).prop_map(
        |(id, action, type_name, args, feedback)| {
            json!({
                "op": "send_action_goal", "id": id, "action": action, "action_type": type_name, "args": args,
                "feedback": feedback,
            })
        },
    );
    let cancel =
        (id, action).prop_map(|(id, action)| json!({"op": "cancel_action_goal", "id": id, "action": action}));
    let part = prop::sample::select(vec!["feedback", "result", "status"]);
    let status_update = (part, any_json(), any_json(), any::<u8>()).prop_map(|(part, a, b, number)| {
        let status = json!({"goal_id": {"id": a}, "status": number % 12, "text": b});
        json!({
            "op": "publish", "topic": format!("/lab/move/{part}"),
            "msg": {"status": status, "status_list": [status, b], "result": a, "feedback": b},
        })
    });
    prop_oneof![goal, cancel, status_update]
}

#[test]
fn goals_and_results_with_arbitrary_values_are_survived() {
    let server = [
        ("advertise", "result", "lab_msgs/MoveActionResult"),
        ("advertise", "feedback", "lab_msgs/MoveActionFeedback"),
        ("advertise", "status", "actionlib_msgs/GoalStatusArray"),
        ("subscribe", "goal", "lab_msgs/MoveActionGoal"),
    ];
    let server = server.map(|(op, topic, kind)| {
        Message::text(json!({"op": op, "topic": format!("/lab/move/{topic}"), "type": kind}).to_string())
    });
    let batch = prop::collection::vec(action_messages(), 1..40).prop_map(move |messages| {
        let messages = messages.into_iter().map(|json| Message::text(json.to_string()));
        server.iter().cloned().chain(messages).collect()
    });
    fuzz(batch, 60);
}

#[test]
fn half_a_message_and_then_nothing_is_survived() {
    use std::io::Write;
    let (server, _bus) = server();
    let mut clients: Vec<Client> = (0..20).map(|_| Client::connect(&server)).collect();
    for (n, client) in clients.iter_mut().enumerate() {
        let stream = client.0.get_mut();
        // The head of a masked frame of 125 bytes, and some of it; or an announcement of 2^63 bytes.
        let bytes: &[u8] = if n % 2 == 0 {
            &[0x81, 0xfd, 1, 2, 3, 4, 5, 6]
        } else {
            &[0x82, 0xff, 0x7f, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 1, 2, 3, 4, 0]
        };
        stream.write_all(bytes).unwrap();
    }
    still_answers(&server);
}
