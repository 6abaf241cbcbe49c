//! Messages as CBOR (RFC 8949), with arrays of numbers as typed arrays (RFC 8746), little endian.

use crate::{
    definition::{ArrayKind, FieldType, MessageField, MessageType},
    ros2::{self, RosVersion, ros2_json},
    value::MessageValue,
};
use ciborium::Value as Cbor;
use serde_json::Value as Json;

impl MessageValue {
    /// The message as CBOR, as clients of either ROS read it; its type decides how wide the numbers of arrays are.
    pub fn to_cbor(&self, kind: Option<&MessageType>, convention: RosVersion) -> Cbor {
        let pair = |name: &str, value, field| (Cbor::from(name), field_to_cbor(value, field, convention));
        match (self, kind) {
            (MessageValue::Message(values), Some(kind)) if convention == RosVersion::Ros2 => Cbor::Map(
                ros2::ros2_fields(values, kind)
                    .map(|(name, value, field)| pair(name, value, field))
                    .collect(),
            ),
            (MessageValue::Message(values), Some(kind)) => Cbor::Map(
                values
                    .iter()
                    .zip(&kind.fields)
                    .map(|((name, value), field)| pair(name, value, field))
                    .collect(),
            ),
            (MessageValue::Opaque(json), _) if convention == RosVersion::Ros2 => {
                json_to_cbor(&ros2_json(json.clone()))
            }
            (MessageValue::Opaque(json), _) => json_to_cbor(json),
            (value, _) => json_to_cbor(&serde_json::to_value(value).unwrap_or(Json::Null)),
        }
    }
}

fn field_to_cbor(value: &MessageValue, field: &MessageField, convention: RosVersion) -> Cbor {
    match value {
        MessageValue::Bytes(bytes) => Cbor::Bytes(bytes.clone()),
        MessageValue::Floats(values) => match field.kind {
            FieldType::Float32 => typed_array(85, values.iter().flat_map(|x| (*x as f32).to_le_bytes())),
            _ => typed_array(86, values.iter().flat_map(|x| x.to_le_bytes())),
        },
        MessageValue::List(values) => match &field.kind {
            FieldType::Int { bits, signed } if field.count != ArrayKind::Single => {
                integer_array(values, *bits, *signed)
            }
            kind => Cbor::Array(values.iter().map(|value| value_to_cbor(value, kind, convention)).collect()),
        },
        value => value_to_cbor(value, &field.kind, convention),
    }
}

fn value_to_cbor(value: &MessageValue, kind: &FieldType, convention: RosVersion) -> Cbor {
    if let (RosVersion::Ros2, Some((sec, nanosec))) = (convention, ros2::time_parts(value)) {
        return Cbor::Map(vec![
            (Cbor::from("sec"), Cbor::from(sec)),
            (Cbor::from("nanosec"), Cbor::from(nanosec)),
        ]);
    }
    match (value, kind) {
        (MessageValue::Message(_), FieldType::Message(inner)) => value.to_cbor(Some(inner), convention),
        (MessageValue::Bool(value), _) => Cbor::from(*value),
        (MessageValue::Int(value), _) => Cbor::from(*value),
        (MessageValue::Uint(value), _) => Cbor::from(*value),
        (MessageValue::Float(value), _) => Cbor::from(*value),
        (MessageValue::Text(value), _) => Cbor::from(value.as_str()),
        (MessageValue::Time(time), _) => time_to_cbor(time.secs.into(), time.nsecs.into()),
        (MessageValue::Duration(time), _) => time_to_cbor(time.secs.into(), time.nsecs.into()),
        (value, _) => json_to_cbor(&serde_json::to_value(value).unwrap_or(Json::Null)),
    }
}

fn time_to_cbor(secs: i64, nsecs: i64) -> Cbor {
    Cbor::Map(vec![(Cbor::from("secs"), Cbor::from(secs)), (Cbor::from("nsecs"), Cbor::from(nsecs))])
}

fn typed_array(tag: u64, bytes: impl Iterator<Item = u8>) -> Cbor {
    Cbor::Tag(tag, Box::new(Cbor::Bytes(bytes.collect())))
}

/// Tags of RFC 8746: 64 + 8 for signed + 4 for little endian + the width's power, 8-bit ones without the 4.
fn integer_array(values: &[MessageValue], bits: u8, signed: bool) -> Cbor {
    let wide: Vec<i128> = values
        .iter()
        .map(|value| match value {
            MessageValue::Int(n) => i128::from(*n),
            MessageValue::Uint(n) => i128::from(*n),
            _ => 0,
        })
        .collect();
    let width = usize::from(bits / 8);
    let tag = 64 + u64::from(signed) * 8 + if bits == 8 { 0 } else { 4 + u64::from(width.trailing_zeros()) };
    typed_array(tag, wide.iter().flat_map(|n| n.to_le_bytes().into_iter().take(width)))
}

fn json_to_cbor(json: &Json) -> Cbor {
    match json {
        Json::Null => Cbor::Null,
        Json::Bool(value) => Cbor::from(*value),
        Json::Number(number) => match (number.as_i64(), number.as_u64()) {
            (Some(n), _) => Cbor::from(n),
            (_, Some(n)) => Cbor::from(n),
            _ => Cbor::from(number.as_f64().unwrap_or(f64::NAN)),
        },
        Json::String(text) => Cbor::from(text.as_str()),
        Json::Array(values) => Cbor::Array(values.iter().map(json_to_cbor).collect()),
        Json::Object(map) => Cbor::Map(
            map.iter().map(|(name, value)| (Cbor::from(name.as_str()), json_to_cbor(value))).collect(),
        ),
    }
}
