//! The content of a message.

use base64::{Engine, engine::general_purpose::STANDARD as BASE64};
use serde::{Deserialize, Serialize, Serializer, ser::Error};
use serde_json::Value as Json;
use std::sync::Arc;

/// A value in a message.
#[derive(Clone, Debug, PartialEq)]
pub enum MessageValue {
    /// `bool`.
    Bool(bool),
    /// Signed whole numbers.
    Int(i64),
    /// Unsigned whole numbers.
    Uint(u64),
    /// `float32` and `float64`. In JSON what is not finite becomes `null`, and `null` becomes not-a-number.
    Float(f64),
    /// `string`.
    Text(String),
    /// `time`.
    Time(Time),
    /// `duration`.
    Duration(Duration),
    /// `uint8[]` and `char[]`; base64 in JSON.
    Bytes(Vec<u8>),
    /// `float32[]` and `float64[]`.
    Floats(Vec<f64>),
    /// Any other array.
    List(Vec<MessageValue>),
    /// A message: its fields in ROS's order.
    Message(Vec<(Arc<str>, MessageValue)>),
    /// A message of a type whose definition is not known: handed on as it came.
    Opaque(Json),
}

/// A point in time as ROS 1 has it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct Time {
    /// Whole seconds since ROS's epoch.
    pub secs: u32,
    /// Nanoseconds beyond, below 1e9.
    pub nsecs: u32,
}

/// A stretch of time as ROS 1 has it: whole seconds and nanoseconds, both of one sign.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Duration {
    /// Seconds.
    pub secs: i32,
    /// Nanoseconds.
    pub nsecs: i32,
}

impl MessageValue {
    /// The field of a message, or none.
    pub fn get(&self, name: &str) -> Option<&MessageValue> {
        match self {
            MessageValue::Message(fields) => {
                fields.iter().find(|(field, _)| &**field == name).map(|(_, value)| value)
            }
            _ => None,
        }
    }

    /// The number, if it is one.
    pub fn as_f64(&self) -> Option<f64> {
        match self {
            MessageValue::Float(x) => Some(*x),
            MessageValue::Int(n) => Some(*n as f64),
            MessageValue::Uint(n) => Some(*n as f64),
            _ => None,
        }
    }

    /// The text, if it is one.
    pub fn as_text(&self) -> Option<&str> {
        match self {
            MessageValue::Text(text) => Some(text),
            _ => None,
        }
    }
}

impl Serialize for MessageValue {
    fn serialize<S: Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        match self {
            MessageValue::Bool(value) => to.serialize_bool(*value),
            MessageValue::Int(value) => to.serialize_i64(*value),
            MessageValue::Uint(value) => to.serialize_u64(*value),
            MessageValue::Float(value) => to.serialize_f64(*value),
            MessageValue::Text(value) => to.serialize_str(value),
            MessageValue::Time(time) => time.serialize(to),
            MessageValue::Duration(duration) => duration.serialize(to),
            MessageValue::Bytes(bytes) if to.is_human_readable() => to.serialize_str(&BASE64.encode(bytes)),
            MessageValue::Bytes(bytes) => to.serialize_bytes(bytes),
            MessageValue::Floats(values) => to.collect_seq(values),
            MessageValue::List(values) => to.collect_seq(values),
            MessageValue::Message(fields) => {
                to.collect_map(fields.iter().map(|(name, value)| (&**name, value)))
            }
            MessageValue::Opaque(json) if to.is_human_readable() => json.serialize(to),
            // JSON has its keys in any order, bytes have not.
            MessageValue::Opaque(_) => Err(S::Error::custom("a message whose type is not known")),
        }
    }
}
