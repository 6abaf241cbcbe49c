//! The rosbridge server over real sockets: what clients may do in any order, and what they may do wrong.
#![allow(clippy::unwrap_used, clippy::disallowed_methods)]

mod common;

use common::{Client, server, texts};
use proact_rosbridge::{LocalBus, RosbridgeOptions, RosbridgeServer, TopicBus};
use serde_json::{Value as Json, json};
use std::{sync::Arc, time::Duration};
use tokio_tungstenite::tungstenite::Message;

const TEXT: &str = "std_msgs/String";

#[test]
fn a_subscription_before_the_first_publisher_gets_every_message_in_order() {
    let (server, _bus) = server();
    let (mut reader, mut writer) = (Client::connect(&server), Client::connect(&server));
    reader.subscribe("/chat");
    assert_eq!(reader.drain_messages(), Vec::<Json>::new());
    writer.advertise("/chat", TEXT);
    for n in 0..1000 {
        writer.publish("/chat", json!({"data": n.to_string()}));
    }
    writer.drain_messages();
    let got = texts(&reader.drain_messages(), "/chat");
    assert_eq!(got, (0..1000).map(|n| n.to_string()).collect::<Vec<_>>());
    reader.send(json!({"op": "unsubscribe", "topic": "/chat"}));
    reader.drain_messages();
    writer.publish("/chat", json!({"data": "more"}));
    writer.drain_messages();
    assert_eq!(reader.drain_messages(), Vec::<Json>::new());
}

#[test]
fn a_name_without_its_first_slash_is_the_same_topic_and_comes_back_as_it_was_called() {
    let (server, _bus) = server();
    let mut client = Client::connect(&server);
    client.advertise("/chat", TEXT);
    client.subscribe("chat");
    client.publish("chat", json!({"data": "x"}));
    assert_eq!(client.next()["topic"], "chat");
    client.send(json!({"op": "call_service", "service": "rosapi/topics"}));
    let answer = client.next();
    assert_eq!(answer["service"], "rosapi/topics");
    assert_eq!(answer["values"]["topics"], json!(["/chat"]));
    client.send(json!({"op": "advertise_service", "service": "add", "type": "my_pkg/Add"}));
    client.send(json!({"op": "call_service", "service": "/add", "id": 1}));
    let call = client.next();
    assert_eq!(call["service"], "add");
    client.send(
        json!({"op": "service_response", "service": "add", "id": call["id"], "values": {}, "result": true}),
    );
    assert_eq!(client.next()["result"], true);
}

#[test]
fn a_latched_message_waits_for_who_comes_late_until_its_publisher_leaves() {
    let (server, _bus) = server();
    let mut writer = Client::connect(&server);
    writer.send(json!({"op": "advertise", "topic": "/map", "type": TEXT, "latch": true}));
    writer.publish("/map", json!({"data": "old"}));
    writer.publish("/map", json!({"data": "new"}));
    writer.drain_messages();
    let mut reader = Client::connect(&server);
    reader.subscribe("/map");
    assert_eq!(texts(&reader.drain_messages(), "/map"), ["new"]);
    writer.send(json!({"op": "unadvertise", "topic": "/map"}));
    writer.drain_messages();
    let mut late = Client::connect(&server);
    late.subscribe("/map");
    assert_eq!(late.drain_messages(), Vec::<Json>::new());
}

#[test]
fn every_mistake_is_answered_with_what_was_expected_and_the_connection_lives_on() {
    let (server, _bus) = server();
    let mut client = Client::connect(&server);
    client.advertise("/n", "std_msgs/Int8");
    for (text, part) in [
        ("", "EOF"),
        ("{", "EOF"),
        ("nonsense", "expected"),
        ("[1,2]", "it is an array, expected an object"),
        ("null", "it is null"),
        ("\"publish\"", "it is a text"),
        ("{}", "\"op\" is missing"),
        (r#"{"op":5}"#, "\"op\" is a number, expected a text"),
        (r#"{"op":"fly"}"#, "unknown op \"fly\", expected advertise"),
        (r#"{"op":"publish"}"#, "\"topic\" is missing"),
        (r#"{"op":"publish","topic":"/unknown","msg":{}}"#, "advertise it first"),
        (
            r#"{"op":"publish","topic":"/n","msg":{"data":128}}"#,
            "data is 128, expected a whole number that fits int8",
        ),
        (r#"{"op":"publish","topic":"/n","msg":{"data":"x"}}"#, "data is \"x\""),
        (
            r#"{"op":"publish","topic":"/n","msg":{"dat":1}}"#,
            "dat is 1, expected only the fields of std_msgs/Int8",
        ),
        (r#"{"op":"publish","topic":"/n","msg":[1]}"#, "expected an object (std_msgs/Int8)"),
        (
            r#"{"op":"advertise","topic":"/n","type":"std_msgs/String"}"#,
            "has the type std_msgs/Int8, got std_msgs/String",
        ),
        (r#"{"op":"advertise","topic":"with space","type":"std_msgs/String"}"#, "not allowed"),
        (r#"{"op":"advertise","topic":"/m","type":"String"}"#, "expected a package and a name"),
        (r#"{"op":"advertise","topic":"/m","type":"std_msgs/"}"#, "expected a package and a name"),
        (r#"{"op":"advertise_service","service":"/m","type":"a b/c"}"#, "expected a package and a name"),
        (r#"{"op":"png","data":"?"}"#, "no base64"),
        (r#"{"op":"png","data":"AAAA"}"#, "no picture"),
        (r#"{"op":"subscribe","topic":7}"#, "\"topic\" is a number"),
        (r#"{"op":"subscribe","topic":"/n","type":"std_msgs/Bool"}"#, "got std_msgs/Bool"),
        (r#"{"op":"subscribe","topic":"/n","compression":"zip"}"#, "expected none, png, cbor or cbor-raw"),
        (r#"{"op":"subscribe","topic":"/n","throttle_rate":-1}"#, "not negative"),
        (r#"{"op":"unsubscribe","topic":"/n"}"#, "not subscribed"),
        (r#"{"op":"unadvertise_service","service":"/s"}"#, "not offered"),
        (r#"{"op":"service_response","service":"/s","id":"x","values":{}}"#, "no call"),
        (r#"{"op":"fragment","id":"f","data":"x","num":0}"#, "\"total\""),
        (r#"{"op":"set_level","level":"loud"}"#, "expected none, error, warning or info"),
    ] {
        client.0.send(Message::text(text)).unwrap();
        let status = client.next();
        assert_eq!((&status["op"], &status["level"]), (&json!("status"), &json!("error")), "{text}");
        assert!(status["msg"].as_str().unwrap().contains(part), "{text}: {status}");
    }
    for bytes in [&b"\xff\xfe\x00"[..], &[0; 100], b"{\"op\":\"\xc3\"}"] {
        client.0.send(Message::binary(bytes.to_vec())).unwrap();
        assert_eq!(client.next()["op"], "status");
    }
    let deep = "[".repeat(100_000);
    client.0.send(Message::text(deep)).unwrap();
    assert!(client.next()["msg"].as_str().unwrap().contains("recursion"));
    client.send(json!({"op": "subscribe", "id": "mine", "topic": 1}));
    assert_eq!(client.next()["id"], "mine");
    client.send(json!({"op": "set_level", "level": "none"}));
    client.send(json!({"op": "fly"}));
    assert_eq!(client.drain_messages(), Vec::<Json>::new());
    let notices = server.drain_notices().join("\n");
    assert_eq!(notices.matches("further ones").count(), 1, "{notices}");
}

/// What is obeyed is remarked on where the client wants to hear it, and only there.
#[test]
fn warnings_and_information_come_at_the_level_asked_for() {
    let (server, _bus) = server();
    let own = json!({"op": "advertise_service", "service": "/s", "type": "lab_msgs/Dose"});
    let messages = [
        (json!({"op": "set_level", "level": "info"}), "info", "set_level"),
        (
            json!({"op": "subscribe", "topic": "/later", "id": "x"}),
            "warning",
            "nobody has named the type of /later",
        ),
        (
            json!({"op": "advertise", "topic": "/p", "type": "geometry_msgs/PointStamped"}),
            "info",
            "advertise: /p",
        ),
        (json!({"op": "subscribe", "topic": "/p"}), "info", "subscribe: /p, geometry_msgs/PointStamped"),
        (
            json!({"op": "advertise", "topic": "/own", "type": "lab_msgs/Dose"}),
            "warning",
            "lab_msgs/Dose are not known",
        ),
        (
            json!({"op": "subscribe", "topic": "/own", "compression": "cbor-raw"}),
            "warning",
            "cannot come as cbor-raw",
        ),
        (own.clone(), "warning", "lab_msgs/Dose are not known"),
        (
            json!({"op": "advertise_service", "service": "/t", "type": "std_srvs/Trigger"}),
            "info",
            "std_srvs/Trigger",
        ),
        (json!({"op": "unadvertise_service", "service": "/t"}), "info", "/t"),
        (json!({"op": "unadvertise", "topic": "/never"}), "warning", "not advertised"),
        (json!({"op": "unsubscribe", "topic": "/later"}), "info", "/later"),
    ];
    let mut client = Client::connect(&server);
    for (message, level, part) in &messages {
        client.send(message.clone());
        let status = client.next();
        assert_eq!(
            (&status["op"], &status["level"]),
            (&json!("status"), &json!(level)),
            "{message}: {status}"
        );
        assert!(status["msg"].as_str().unwrap().contains(part), "{message}: {status}");
        assert_eq!(status["id"], message["id"]);
    }
    // A header may be left out without a word; of other fields it is said once.
    client.publish("/p", json!({"point": {"x": 1.0, "y": 2.0, "z": 3.0}}));
    assert_eq!(client.next()["op"], "publish");
    for expects_status in [true, false] {
        client.publish("/p", json!({"point": {"x": 1.0}}));
        let mut received = vec![client.next()];
        if expects_status {
            received.push(client.next());
        }
        let status = received.iter().find(|message| message["op"] == "status");
        assert_eq!(status.is_some(), expects_status, "{received:?}");
        if let Some(status) = status {
            assert!(status["msg"].as_str().unwrap().contains("point.y, point.z left out"), "{status}");
        }
        assert!(
            received.iter().any(|message| message["msg"]["point"] == json!({"x": 1.0, "y": 0.0, "z": 0.0}))
        );
    }
    let mut quiet = Client::connect(&server);
    for (message, ..) in &messages[1..] {
        quiet.send(message.clone());
    }
    assert!(
        quiet.drain_messages().iter().all(|reply| reply["op"] != "status"),
        "errors alone are said unless asked for"
    );
}

#[test]
fn arguments_of_a_service_come_by_name_or_in_order_and_wrong_ones_are_refused() {
    let (server, _bus) = server();
    let mut provider = Client::connect(&server);
    provider.send(json!({"op": "advertise_service", "service": "/arm", "type": "std_srvs/SetBool"}));
    provider.drain_messages();
    let mut caller = Client::connect(&server);
    let call = |args: Json| json!({"op": "call_service", "service": "/arm", "id": "c", "args": args});
    for (args, expected) in
        [(json!([true]), true), (json!({"data": true}), true), (json!([]), false), (json!({}), false)]
    {
        caller.send(call(args.clone()));
        let service_call = provider.next();
        assert_eq!(service_call["args"], json!({"data": expected}), "{args}");
        provider.send(json!({
            "op": "service_response", "service": "/arm", "id": service_call["id"], "result": true,
            "values": {"success": true, "message": ""},
        }));
        assert_eq!(caller.next()["result"], true, "{args}");
    }
    for (args, part) in [
        (json!([true, 1]), "got 2 arguments, expected at most 1"),
        (json!({"dat": true}), "only the fields of std_srvs/SetBoolRequest"),
        (json!({"data": "x"}), "data is"),
        (json!("x"), "expected an object or a list"),
        (json!(7), "expected an object or a list"),
    ] {
        caller.send(call(args.clone()));
        let response = caller.next();
        assert_eq!((&response["op"], &response["id"]), (&json!("service_response"), &json!("c")), "{args}");
        assert_eq!(response["result"], false, "{args}");
        assert!(response["values"].as_str().unwrap().contains(part), "{args}: {response}");
    }
    assert_eq!(provider.drain_messages(), Vec::<Json>::new(), "a refused call reaches nobody");
    caller.send(json!({"op": "call_service", "service": "/rosapi/set_param", "args": ["/a", "5"]}));
    assert_eq!(caller.next()["result"], true);
    caller.send(json!({"op": "call_service", "service": "/rosapi/get_param", "args": ["/a"]}));
    assert_eq!(caller.next()["values"]["value"], "5");
}

#[test]
fn the_longest_message_allowed_goes_through_and_one_byte_more_does_not() {
    const LONGEST: usize = 8 * 1024 * 1024;
    let (server, _bus) = server();
    let mut reader = Client::connect(&server);
    reader.send(json!({"op": "subscribe", "topic": "/long", "type": TEXT}));
    reader.drain_messages();
    let mut writer = Client::connect(&server);
    writer.advertise("/long", TEXT);
    writer.drain_messages();
    let frame = |letters: usize| {
        json!({"op": "publish", "topic": "/long", "msg": {"data": "x".repeat(letters)}}).to_string()
    };
    let letters = LONGEST - frame(0).len();
    writer.0.send(Message::text(frame(letters))).unwrap();
    assert_eq!(reader.next()["msg"]["data"].as_str().unwrap().len(), letters);
    // The server hangs up while the message is still on its way.
    let _ = writer.0.send(Message::text(frame(letters + 1)));
    while let Ok(message) = writer.0.read() {
        assert!(message.is_close() || !message.is_text(), "{message:?}");
    }
}

#[test]
fn pieces_in_any_order_and_of_several_messages_are_put_together() {
    let (server, _bus) = server();
    let mut client = Client::connect(&server);
    client.advertise("/chat", TEXT);
    client.subscribe("/chat");
    let piece = |id: &str, num: usize, text: &str| {
        let parts: Vec<&str> = text.split_inclusive(['a', 'e', ' ']).collect();
        json!({"op": "fragment", "id": id, "num": num, "total": parts.len(), "data": parts[num]})
    };
    let message = |data: &str| json!({"op": "publish", "topic": "/chat", "msg": {"data": data}}).to_string();
    let (one, two) = (message("the first message"), message("the second"));
    let count = |text: &str| text.split_inclusive(['a', 'e', ' ']).count();
    for n in (0..count(&one).max(count(&two))).rev() {
        for (id, text) in [("1", &one), ("2", &two)] {
            if n < count(text) {
                client.send(piece(id, n, text));
            }
        }
    }
    let mut got = texts(&client.drain_messages(), "/chat");
    got.sort();
    assert_eq!(got, ["the first message", "the second"]);
    for _ in 0..2 {
        // Pieces within pieces, and nonsense within pieces.
        client.send(json!({"op": "fragment", "id": "x", "num": 0, "total": 1, "data": piece("1", 0, "ab").to_string()}));
        assert_eq!(client.next()["level"], "error");
        client.send(json!({"op": "fragment", "id": "x", "num": 0, "total": 1, "data": "nonsense"}));
        assert_eq!(client.next()["level"], "error");
    }
}

#[test]
fn long_messages_come_in_pieces_of_the_size_asked_for() {
    let (server, _bus) = server();
    let mut client = Client::connect(&server);
    client.advertise("/chat", TEXT);
    client.send(json!({"op": "subscribe", "topic": "/chat", "fragment_size": 30}));
    let text = "häufig über Öfen ".repeat(20);
    client.publish("/chat", json!({"data": text}));
    let mut pieces = client.drain_messages();
    assert!(pieces.len() > 10);
    pieces.sort_by_key(|piece| piece["num"].as_u64());
    let whole: String = pieces.iter().map(|piece| piece["data"].as_str().unwrap()).collect();
    assert!(
        pieces.iter().all(|piece| piece["op"] == "fragment" && piece["data"].as_str().unwrap().len() <= 30)
    );
    assert_eq!(serde_json::from_str::<Json>(&whole).unwrap()["msg"]["data"], text);
}

#[test]
fn a_service_is_answered_by_the_client_that_offers_it() {
    let (server, _bus) = server();
    let (mut provider, mut caller) = (Client::connect(&server), Client::connect(&server));
    provider.send(json!({"op": "advertise_service", "service": "/add", "type": "my_pkg/Add"}));
    provider.drain_messages();
    for n in 0..3 {
        caller.send(json!({"op": "call_service", "id": n, "service": "/add", "args": {"a": n, "b": 1}}));
    }
    let calls: Vec<Json> = (0..3).map(|_| provider.next()).collect();
    // Answers may come in any order.
    for call in calls.iter().rev() {
        let sum = call["args"]["a"].as_i64().unwrap() + 1;
        provider.send(json!({
            "op": "service_response", "id": call["id"], "service": "/add", "values": {"sum": sum}, "result": true,
        }));
    }
    for n in (0..3).rev() {
        let answer = caller.next();
        assert_eq!(
            answer,
            json!({
                "op": "service_response", "id": n, "service": "/add", "values": {"sum": n + 1}, "result": true,
            })
        );
    }
    caller.send(json!({"op": "call_service", "id": "x", "service": "/add", "args": [1, 2]}));
    let call = provider.next();
    assert_eq!(call["args"], json!([1, 2]));
    provider.send(json!({
        "op": "service_response", "id": call["id"], "service": "/add", "values": "not today", "result": false,
    }));
    let answer = caller.next();
    assert_eq!((&answer["result"], &answer["values"]), (&json!(false), &json!("not today")));
}

#[test]
fn calls_of_a_service_that_vanishes_or_never_was_fail_at_once() {
    let (server, _bus) = server();
    let (mut provider, mut caller) = (Client::connect(&server), Client::connect(&server));
    provider.send(json!({"op": "advertise_service", "service": "/gone", "type": "my_pkg/Gone"}));
    provider.drain_messages();
    caller.send(json!({"op": "call_service", "id": 1, "service": "/gone"}));
    assert_eq!(provider.next()["op"], "call_service");
    drop(provider);
    let answer = caller.next();
    assert_eq!((&answer["id"], &answer["result"]), (&json!(1), &json!(false)));
    assert!(answer["values"].as_str().unwrap().contains("went away"));
    caller.send(json!({"op": "call_service", "id": 2, "service": "/gone"}));
    let answer = caller.next();
    assert!(answer["values"].as_str().unwrap().contains("offered by nobody"), "{answer}");
}

#[test]
fn a_service_that_does_not_answer_fails_after_the_time_asked_for() {
    let (server, _bus) = server();
    let mut client = Client::connect(&server);
    client.send(json!({"op": "advertise_service", "service": "/slow", "type": "my_pkg/Slow"}));
    client.send(json!({"op": "call_service", "id": 1, "service": "/slow", "timeout": 0.01}));
    assert_eq!(client.next()["op"], "call_service");
    assert!(client.next()["values"].as_str().unwrap().contains("no answer in time"));
}

#[test]
fn rosapi_tells_what_there_is() {
    let (server, _bus) = server();
    let mut client = Client::connect(&server);
    client.advertise("/chat", TEXT);
    client.subscribe("/chat");
    let mut call = |name: &str, args: Json| {
        client.send(json!({"op": "call_service", "service": format!("/rosapi/{name}"), "args": args}));
        let answer = client.next();
        assert_eq!(answer["result"], true, "{answer}");
        answer["values"].clone()
    };
    assert_eq!(call("topics", json!({})), json!({"topics": ["/chat"], "types": [TEXT]}));
    assert_eq!(call("topic_type", json!({"topic": "/chat"}))["type"], TEXT);
    assert_eq!(call("topic_type", json!({"topic": "/none"}))["type"], "");
    assert_eq!(call("topics_for_type", json!({"type": TEXT}))["topics"], json!(["/chat"]));
    assert_eq!(call("publishers", json!(["/chat"]))["publishers"].as_array().unwrap().len(), 1);
    assert!(call("services", json!({}))["services"].as_array().unwrap().contains(&json!("/rosapi/topics")));
    assert_eq!(call("service_type", json!({"service": "/rosapi/topics"}))["type"], "rosapi/Topics");
    let details = call("message_details", json!({"type": "geometry_msgs/PoseStamped"}));
    assert_eq!(details["typedefs"][0]["fieldnames"], json!(["header", "pose"]));
    assert_eq!(call("has_param", json!({"name": "/a"}))["exists"], false);
    call("set_param", json!({"name": "/a", "value": "[1,2]"}));
    assert_eq!(call("get_param", json!({"name": "/a"}))["value"], "[1,2]");
    assert_eq!(call("get_param_names", json!({}))["names"], json!(["/a"]));
    call("delete_param", json!({"name": "/a"}));
}

#[test]
fn a_client_whose_gaze_stands_still_is_told_once_that_it_counts_as_a_frozen_eye_tracker() {
    let bus: Arc<dyn TopicBus> = LocalBus::new();
    // Any gaze that comes twice is frozen.
    let options = RosbridgeOptions {
        port: 0,
        frozen_gaze_timeout: Some(Duration::ZERO),
        ..RosbridgeOptions::default()
    };
    let server = RosbridgeServer::start(options, bus).unwrap();
    let mut client = Client::connect(&server);
    let mut statuses = |level: Option<&str>, xs: &[f64]| -> Vec<Json> {
        if let Some(level) = level {
            client.send(json!({"op": "set_level", "level": level}));
        }
        for topic in ["/gaze_position", "/gaze_direction"] {
            client.send(json!({"op": "advertise", "topic": topic, "type": "geometry_msgs/Vector3Stamped"}));
        }
        for x in xs {
            client.publish("/gaze_position", json!({"vector": {"x": 0.5, "y": 0.0, "z": 1.6}}));
            client.publish("/gaze_direction", json!({"vector": {"x": x, "y": 0.0, "z": -0.5}}));
        }
        client.drain_messages().into_iter().filter(|message| message["op"] == "status").collect()
    };
    let status_messages = statuses(None, &[0.8, 0.8, 0.8, 0.8]);
    assert_eq!(status_messages.len(), 1, "{status_messages:?}");
    assert_eq!(status_messages[0]["level"], "warning");
    assert!(
        status_messages[0]["msg"].as_str().unwrap().contains("frozen eye tracker"),
        "{status_messages:?}"
    );
    assert_eq!(statuses(None, &[0.8, 0.8]), Vec::<Json>::new(), "said once");
    assert_eq!(statuses(Some("none"), &[0.9, 0.9, 0.9]), Vec::<Json>::new(), "no status is wanted");
}
