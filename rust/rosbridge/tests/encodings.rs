//! What a message looks like as text, as a picture and as CBOR, and what comes of its numbers.
#![allow(clippy::unwrap_used, clippy::disallowed_methods)]

mod common;

use common::{Client, server};
use proact_messages::{MessageType, Ros2Message, RosVersion, Time, builtin_types, ros2_name};
use proact_rosbridge::TopicMessage;
use serde_json::{Value as Json, json};
use std::sync::Arc;
use tokio_tungstenite::tungstenite::Message;

/// A message of each known type, with something in every field.
fn samples() -> Vec<(String, Arc<TopicMessage>)> {
    let now = Time { secs: 7, nsecs: 8 };
    let one = |kind: &Arc<MessageType>| {
        let topic = format!("/all/{}", kind.name);
        let mut json = serde_json::to_value(kind.default_value(now)).unwrap();
        fill(&mut json, 1);
        let value = kind
            .parse_json(json.clone(), now)
            .unwrap_or_else(|error| panic!("{}: {error}: {json}", kind.name));
        (kind.name.clone(), TopicMessage::new(topic, Some(Arc::clone(kind)), value))
    };
    builtin_types().map(one).collect()
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
    for convention in [RosVersion::Ros1, RosVersion::Ros2] {
        check_encodings(convention);
    }
}

fn check_encodings(convention: RosVersion) {
    let (server, bus) = server();
    let mut plain = Client::connect(&server);
    let mut png = Client::connect(&server);
    let mut cbor = Client::connect(&server);
    let samples = samples();
    let writer = bus.join("/writer");
    for (kind, message) in &samples {
        bus.advertise(writer, &message.topic, kind, false).unwrap();
        for (client, compression) in [(&mut plain, "none"), (&mut png, "png"), (&mut cbor, "cbor")] {
            let kind = if convention == RosVersion::Ros2 { ros2_name(kind, "msg") } else { kind.clone() };
            client.send(json!({
                "op": "subscribe", "topic": &*message.topic, "type": kind, "compression": compression,
            }));
        }
    }
    for client in [&mut plain, &mut png, &mut cbor] {
        client.drain_messages();
    }
    for (kind, message) in &samples {
        bus.publish(std::slice::from_ref(message));
        let text = plain.next();
        let ros2 = Ros2Message { value: &message.value, kind: message.definition.as_deref() };
        let expected = match convention {
            RosVersion::Ros1 => serde_json::to_value(&message.value),
            RosVersion::Ros2 => serde_json::to_value(ros2),
        };
        assert_eq!(text["msg"], expected.unwrap(), "{kind}");
        let picture = png.next();
        assert_eq!(picture["op"], "png");
        assert_eq!(text_of_picture(picture["data"].as_str().unwrap()), text, "{kind}");
        let Message::Binary(bytes) = cbor.frame() else { panic!("{kind}: CBOR comes as a binary frame") };
        let decoded: ciborium::Value = ciborium::from_reader(&bytes[..]).unwrap();
        assert_eq!(json_of_cbor(&decoded), text, "{kind}");
    }
}

#[test]
fn cbor_raw_of_every_type_holds_the_bytes_that_ros_sends() {
    let (server, bus) = server();
    let mut client = Client::connect(&server);
    let samples = samples();
    let writer = bus.join("/writer");
    for (kind, message) in &samples {
        bus.advertise(writer, &message.topic, kind, false).unwrap();
        client.send(json!({"op": "subscribe", "topic": &*message.topic, "compression": "cbor-raw"}));
    }
    client.drain_messages();
    for (kind, message) in &samples {
        bus.publish(std::slice::from_ref(message));
        let Message::Binary(bytes) = client.frame() else {
            panic!("{kind}: cbor-raw comes as a binary frame")
        };
        let decoded: ciborium::Value = ciborium::from_reader(&bytes[..]).unwrap();
        let of = |map: &ciborium::Value, name: &str| {
            let pairs = map.as_map().unwrap();
            pairs.iter().find(|(key, _)| key.as_text() == Some(name)).unwrap().1.clone()
        };
        assert_eq!(of(&decoded, "op").as_text(), Some("publish"));
        assert_eq!(of(&decoded, "topic").as_text(), Some(&*message.topic));
        let msg = of(&decoded, "msg");
        let definition = message.definition.as_ref().unwrap();
        let back = definition.from_bytes(of(&msg, "bytes").as_bytes().unwrap()).unwrap();
        assert_eq!(back, message.value, "{kind}");
        assert!(of(&msg, "secs").as_integer().unwrap() > 1_600_000_000.into());
        assert!(of(&msg, "nsecs").as_integer().unwrap() < 1_000_000_000.into());
    }
    // A text by hand: its length, then its letters.
    client.advertise("/hello", "std_msgs/String");
    client.send(json!({"op": "subscribe", "topic": "/hello", "compression": "cbor-raw"}));
    client.publish("/hello", json!({"data": "hi"}));
    let Message::Binary(bytes) = client.frame() else { panic!("a binary frame") };
    assert!(bytes.windows(6).any(|six| six == [2, 0, 0, 0, b'h', b'i']), "{bytes:?}");
}

#[test]
fn a_client_may_send_pictures_whole_or_in_pieces() {
    use base64::{Engine, engine::general_purpose::STANDARD};
    let (server, _bus) = server();
    let mut client = Client::connect(&server);
    client.advertise("/chat", "std_msgs/String");
    client.subscribe("/chat");
    let picture = |text: &str| {
        let publish = json!({"op": "publish", "topic": "/chat", "msg": {"data": text}}).to_string();
        let mut data = publish.into_bytes();
        data.resize(data.len().div_ceil(3) * 3, b'\n');
        let mut file = Vec::new();
        let mut encoder = png::Encoder::new(&mut file, (data.len() / 3) as u32, 1);
        encoder.set_color(png::ColorType::Rgb);
        encoder.write_header().unwrap().write_image_data(&data).unwrap();
        STANDARD.encode(file)
    };
    client.send(json!({"op": "png", "data": picture("whole")}));
    assert_eq!(client.next()["msg"]["data"], "whole");
    let base64 = picture(&"in pieces ".repeat(50));
    let (first, second) = base64.split_at(base64.len() / 2);
    for (num, data) in [(1, second), (0, first)] {
        client.send(json!({"op": "png", "id": "p", "num": num, "total": 2, "data": data}));
    }
    assert!(client.next()["msg"]["data"].as_str().unwrap().starts_with("in pieces"));
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
