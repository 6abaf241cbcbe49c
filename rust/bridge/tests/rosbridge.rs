//! The rosbridge server over real sockets: what clients may do in any order, and what they may do wrong.
#![allow(clippy::unwrap_used, clippy::disallowed_methods)]

mod common;

use common::{Client, server};
use proact_bridge::{
    BridgeError,
    rosbridge::{Access, LocalBus, RosbridgeOptions, RosbridgeServer, Time, TopicMessage, known_types},
};
use serde_json::{Value as Json, json};
use std::{
    io::{Read, Write},
    net::{Ipv4Addr, TcpStream},
    sync::Arc,
};
use tokio_tungstenite::tungstenite::{Message, connect};

const TEXT: &str = "std_msgs/String";

fn texts(messages: &[Json], topic: &str) -> Vec<String> {
    let of_topic = messages.iter().filter(|message| message["topic"] == topic);
    of_topic.map(|message| message["msg"]["data"].as_str().unwrap().to_owned()).collect()
}

#[test]
fn a_subscription_before_the_first_publisher_gets_every_message_in_order() {
    let (server, _bus) = server();
    let (mut reader, mut writer) = (Client::connect(&server), Client::connect(&server));
    reader.subscribe("/chat");
    assert_eq!(reader.settle(), Vec::<Json>::new());
    writer.advertise("/chat", TEXT);
    for n in 0..1000 {
        writer.publish("/chat", json!({"data": n.to_string()}));
    }
    writer.settle();
    let got = texts(&reader.settle(), "/chat");
    assert_eq!(got, (0..1000).map(|n| n.to_string()).collect::<Vec<_>>());
    reader.send(json!({"op": "unsubscribe", "topic": "/chat"}));
    reader.settle();
    writer.publish("/chat", json!({"data": "more"}));
    writer.settle();
    assert_eq!(reader.settle(), Vec::<Json>::new());
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
    writer.settle();
    let mut reader = Client::connect(&server);
    reader.subscribe("/map");
    assert_eq!(texts(&reader.settle(), "/map"), ["new"]);
    writer.send(json!({"op": "unadvertise", "topic": "/map"}));
    writer.settle();
    let mut late = Client::connect(&server);
    late.subscribe("/map");
    assert_eq!(late.settle(), Vec::<Json>::new());
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
        (r#"{"op":"subscribe","topic":7}"#, "\"topic\" is a number"),
        (r#"{"op":"subscribe","topic":"/n","type":"std_msgs/Bool"}"#, "got std_msgs/Bool"),
        (r#"{"op":"subscribe","topic":"/n","compression":"zip"}"#, "expected none, png or cbor"),
        (r#"{"op":"subscribe","topic":"/n","throttle_rate":-1}"#, "not negative"),
        (r#"{"op":"unsubscribe","topic":"/n"}"#, "not subscribed"),
        (r#"{"op":"unadvertise","topic":"/m"}"#, "not advertised"),
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
    assert_eq!(client.settle(), Vec::<Json>::new());
    let notices = server.drain_notices().join("\n");
    assert_eq!(notices.matches("further ones").count(), 1, "{notices}");
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
    let mut got = texts(&client.settle(), "/chat");
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
    let mut pieces = client.settle();
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
    provider.settle();
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
    provider.settle();
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

/// A message of each known type, with something in every field.
fn samples() -> Vec<(String, Arc<TopicMessage>)> {
    let now = Time { secs: 7, nsecs: 8 };
    let one = |kind: &Arc<proact_bridge::rosbridge::MessageType>| {
        let topic = format!("/all/{}", kind.name);
        let mut json = serde_json::to_value(kind.empty(now)).unwrap();
        fill(&mut json, 1);
        let value =
            kind.read(json.clone(), now).unwrap_or_else(|error| panic!("{}: {error}: {json}", kind.name));
        (kind.name.clone(), TopicMessage::new(topic, Some(Arc::clone(kind)), value))
    };
    known_types().map(one).collect()
}

/// Puts numbers and texts in the place of zeros; empty arrays stay, their entries' type is not seen here.
fn fill(json: &mut Json, depth: u32) {
    match json {
        Json::Number(number) if number.is_f64() => *json = json!(f64::from(depth) + 0.5),
        Json::Number(_) => *json = json!(depth),
        Json::Object(map) => map.values_mut().for_each(|value| fill(value, depth + 1)),
        Json::Array(values) => values.iter_mut().for_each(|value| fill(value, depth + 1)),
        _ => {}
    }
}

#[test]
fn png_and_cbor_of_every_type_hold_what_the_text_holds() {
    let (server, bus) = server();
    let mut plain = Client::connect(&server);
    let mut png = Client::connect(&server);
    let mut cbor = Client::connect(&server);
    let samples = samples();
    let writer = bus.join("/writer");
    for (kind, message) in &samples {
        bus.advertise(writer, &message.topic, kind, false).unwrap();
        for (client, compression) in [(&mut plain, "none"), (&mut png, "png"), (&mut cbor, "cbor")] {
            client.send(json!({"op": "subscribe", "topic": &*message.topic, "compression": compression}));
        }
    }
    for client in [&mut plain, &mut png, &mut cbor] {
        client.settle();
    }
    for (kind, message) in &samples {
        bus.publish(std::slice::from_ref(message));
        let text = plain.next();
        assert_eq!(text["msg"], serde_json::to_value(&message.value).unwrap(), "{kind}");
        let picture = png.next();
        assert_eq!(picture["op"], "png");
        assert_eq!(text_of_picture(picture["data"].as_str().unwrap()), text, "{kind}");
        let Message::Binary(bytes) = cbor.frame() else { panic!("{kind}: CBOR comes as a binary frame") };
        let decoded: ciborium::Value = ciborium::from_reader(&bytes[..]).unwrap();
        assert_eq!(json_of_cbor(&decoded), text, "{kind}");
    }
}

fn text_of_picture(base64: &str) -> Json {
    use base64::{Engine, engine::general_purpose::STANDARD};
    let bytes = STANDARD.decode(base64).unwrap();
    let mut reader = png::Decoder::new(std::io::Cursor::new(bytes)).read_info().unwrap();
    let mut data = vec![0; reader.output_buffer_size().unwrap()];
    reader.next_frame(&mut data).unwrap();
    serde_json::from_slice(&data).unwrap()
}

/// CBOR as JSON, typed arrays as lists of numbers, byte strings in base64.
fn json_of_cbor(value: &ciborium::Value) -> Json {
    use base64::{Engine, engine::general_purpose::STANDARD};
    use ciborium::Value as Cbor;
    match value {
        Cbor::Bool(value) => json!(value),
        Cbor::Integer(value) => json!(i64::try_from(*value).unwrap()),
        Cbor::Float(value) => json!(value),
        Cbor::Text(value) => json!(value),
        Cbor::Bytes(bytes) => json!(STANDARD.encode(bytes)),
        Cbor::Array(values) => values.iter().map(json_of_cbor).collect(),
        Cbor::Map(pairs) => pairs
            .iter()
            .map(|(name, value)| (name.as_text().unwrap().to_owned(), json_of_cbor(value)))
            .collect(),
        Cbor::Tag(tag, inner) => {
            let bytes = inner.as_bytes().unwrap();
            match tag {
                85 => {
                    bytes.chunks(4).map(|four| json!(f32::from_le_bytes(four.try_into().unwrap()))).collect()
                }
                86 => bytes
                    .chunks(8)
                    .map(|eight| json!(f64::from_le_bytes(eight.try_into().unwrap())))
                    .collect(),
                72 => bytes.iter().map(|byte| json!(*byte as i8)).collect(),
                77 => bytes.chunks(2).map(|two| json!(i16::from_le_bytes(two.try_into().unwrap()))).collect(),
                78 => {
                    bytes.chunks(4).map(|four| json!(i32::from_le_bytes(four.try_into().unwrap()))).collect()
                }
                79 => bytes
                    .chunks(8)
                    .map(|eight| json!(i64::from_le_bytes(eight.try_into().unwrap())))
                    .collect(),
                69 => bytes.chunks(2).map(|two| json!(u16::from_le_bytes(two.try_into().unwrap()))).collect(),
                70 => {
                    bytes.chunks(4).map(|four| json!(u32::from_le_bytes(four.try_into().unwrap()))).collect()
                }
                71 => bytes
                    .chunks(8)
                    .map(|eight| json!(u64::from_le_bytes(eight.try_into().unwrap())))
                    .collect(),
                other => panic!("tag {other}"),
            }
        }
        other => panic!("{other:?}"),
    }
}

#[test]
fn arrays_of_every_number_type_go_through_cbor_with_their_extremes() {
    let (server, _bus) = server();
    let mut client = Client::connect(&server);
    for (kind, data) in [
        ("Int8", json!([-128, 127])),
        ("Int16", json!([-32768, 32767])),
        ("Int32", json!([i32::MIN, i32::MAX])),
        ("Int64", json!([i64::MIN, i64::MAX])),
        ("UInt16", json!([0, 65535])),
        ("UInt32", json!([0, u32::MAX])),
        ("UInt64", json!([0, u64::MAX])),
        ("Float32", json!([0.5, -1.5])),
        ("Float64", json!([0.1, 1e300])),
    ] {
        let topic = format!("/{kind}");
        client.advertise(&topic, &format!("std_msgs/{kind}MultiArray"));
        client.send(json!({"op": "subscribe", "topic": topic, "compression": "cbor"}));
        client.publish(&topic, json!({"data": data}));
        let Message::Binary(bytes) = client.frame() else { panic!("{kind}: CBOR comes as a binary frame") };
        let decoded: ciborium::Value = ciborium::from_reader(&bytes[..]).unwrap();
        assert_eq!(json_of_cbor(&decoded)["msg"]["data"], data, "{kind}");
    }
    // Bytes travel in base64 as text; both spellings come in.
    client.advertise("/bytes", "std_msgs/UInt8MultiArray");
    client.subscribe("/bytes");
    for data in [json!([1, 2, 255]), json!("AQL/")] {
        client.publish("/bytes", json!({"data": data}));
        assert_eq!(client.next()["msg"]["data"], "AQL/");
    }
}

#[test]
fn a_stamp_that_is_left_out_is_now_and_what_is_not_finite_is_null() {
    let (server, _bus) = server();
    let mut client = Client::connect(&server);
    client.advertise("/p", "geometry_msgs/PointStamped");
    client.subscribe("/p");
    client.publish("/p", json!({"point": {"x": null, "y": 2}}));
    let got = &client.next()["msg"];
    assert!(got["header"]["stamp"]["secs"].as_u64().unwrap() > 1_600_000_000);
    assert_eq!(got["point"], json!({"x": null, "y": 2.0, "z": 0.0}));
    client.publish("/p", json!({"header": {"stamp": "now"}}));
    assert!(client.next()["msg"]["header"]["stamp"]["secs"].as_u64().unwrap() > 1_600_000_000);
    client.publish("/p", json!({"header": {"stamp": {"secs": 5}}}));
    assert_eq!(client.next()["msg"]["header"]["stamp"], json!({"secs": 5, "nsecs": 0}));
}

#[test]
fn messages_of_a_type_that_is_not_known_go_through_as_they_are() {
    let (server, _bus) = server();
    let mut client = Client::connect(&server);
    client.advertise("/own", "my_pkg/Own");
    client.subscribe("/own");
    let msg = json!({"a": [1, {"b": null}], "c": "d"});
    client.publish("/own", msg.clone());
    assert_eq!(client.next()["msg"], msg);
    client.publish("/own", json!([1]));
    assert!(client.next()["msg"].as_str().unwrap().contains("expected an object"));
}

#[test]
fn a_client_that_stops_reading_loses_old_messages_and_the_others_none() {
    let (server, bus) = server();
    let (mut stuck, mut reader) = (Client::connect(&server), Client::connect(&server));
    for client in [&mut stuck, &mut reader] {
        client.subscribe("/big");
        client.settle();
    }
    let writer = bus.join("/writer");
    bus.advertise(writer, "/big", TEXT, false).unwrap();
    let kind = proact_bridge::rosbridge::known_type(TEXT).unwrap();
    let rounds = 100;
    for n in 0..rounds {
        // Fifty megabytes in all; the one reads each before the next comes, the other reads nothing.
        let data = format!("{n:03}{}", "x".repeat(500_000));
        let value = kind.read(json!({"data": data}), Time::default()).unwrap();
        bus.publish(&[TopicMessage::new("/big", Some(Arc::clone(&kind)), value)]);
        assert_eq!(reader.next()["msg"]["data"].as_str().unwrap()[..3], format!("{n:03}"));
    }
    let got = texts(&stuck.settle(), "/big");
    let numbers: Vec<usize> = got.iter().map(|text| text[..3].parse().unwrap()).collect();
    assert!(numbers.is_sorted() && numbers.len() < rounds, "{numbers:?}");
    assert_eq!(numbers.last(), Some(&(rounds - 1)), "the newest is never lost");
    drop(stuck);
}

#[test]
fn ten_thousand_subscriptions_and_silent_connections_hurt_nobody() {
    let (server, _bus) = server();
    let silent: Vec<TcpStream> = (0..50).map(|_| TcpStream::connect(server.address()).unwrap()).collect();
    let (mut greedy, mut other) = (Client::connect(&server), Client::connect(&server));
    for n in 0..10_000 {
        greedy.subscribe(&format!("/t{n}"));
    }
    let refused = greedy.settle();
    assert_eq!(refused.len(), 9000);
    assert!(refused.iter().all(|status| status["msg"].as_str().unwrap().contains("of 1000 topics")));
    other.advertise("/t5", TEXT);
    other.subscribe("/t5");
    other.publish("/t5", json!({"data": "still here"}));
    assert_eq!(texts(&other.settle(), "/t5"), ["still here"]);
    assert_eq!(texts(&greedy.settle(), "/t5"), ["still here"]);
    drop(silent);
}

#[test]
fn what_is_no_websocket_is_turned_away() {
    let (server, _bus) = server();
    for request in ["GET / HTTP/1.1\r\nHost: localhost\r\n\r\n", "\x16\x03\x01\x02\x00", "nonsense\r\n\r\n"] {
        let mut stream = TcpStream::connect(server.address()).unwrap();
        stream.write_all(request.as_bytes()).unwrap();
        stream.shutdown(std::net::Shutdown::Write).unwrap();
        let mut answer = Vec::new();
        // An end of the line, orderly or not, is all that is asked for.
        let _ = stream.read_to_end(&mut answer);
        assert!(!String::from_utf8_lossy(&answer).contains("101"), "{request:?}");
    }
    Client::connect(&server).settle();
}

#[test]
fn foreign_pages_are_refused_and_listening_for_others_needs_a_guard() {
    let (server, bus) = server();
    let port = server.address().port();
    let ask = |origin: &str| {
        let request = tokio_tungstenite::tungstenite::http::Request::builder()
            .uri(format!("ws://127.0.0.1:{port}/"))
            .header("Host", format!("127.0.0.1:{port}"))
            .header("Origin", origin)
            .header("Connection", "Upgrade")
            .header("Upgrade", "websocket")
            .header("Sec-WebSocket-Version", "13")
            .header("Sec-WebSocket-Key", "AAAAAAAAAAAAAAAAAAAAAA==")
            .body(())
            .unwrap();
        connect(request).map(|_| ())
    };
    assert!(ask("http://localhost:8090").is_ok());
    assert!(ask("http://evil.example").unwrap_err().to_string().contains("403"));
    assert!(server.drain_notices().iter().any(|notice| notice.contains("evil.example")));

    let open = |access: Access| {
        let options = RosbridgeOptions { port: 0, bind: Ipv4Addr::UNSPECIFIED.into(), access };
        RosbridgeServer::start(options, Arc::clone(&bus))
    };
    assert!(matches!(open(Access::default()), Err(BridgeError::Unguarded { .. })));
    assert!(open(Access { allowed: vec!["10.0.0.1".parse().unwrap()], token: None }).is_ok());
    assert!(matches!(
        open(Access { allowed: vec![], token: Some("short".to_owned()) }),
        Err(BridgeError::Content { .. })
    ));
    let taken = RosbridgeOptions { port, ..RosbridgeOptions::default() };
    let error = RosbridgeServer::start(taken, LocalBus::new()).err().unwrap().to_string();
    assert!(error.contains(&port.to_string()) && error.contains("--rosbridge"), "{error}");
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
