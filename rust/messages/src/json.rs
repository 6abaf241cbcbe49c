//! Messages from JSON as rosbridge has it.

use crate::{
    definition::{ArrayKind, FieldType, MessageField, MessageType},
    ros2,
    value::{Duration, MessageValue, Time},
};
use base64::{Engine, engine::general_purpose::STANDARD as BASE64};
use serde_json::{Map, Value as Json};
use std::sync::Arc;

/// A message that does not fit its type.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{path} is {got}, expected {expected}")]
pub struct ValueError {
    /// Where in the message, such as `pose.position.x`.
    path: String,
    got: String,
    expected: String,
}

fn refuse<T>(path: &str, got: &Json, expected: impl Into<String>) -> Result<T, ValueError> {
    let mut got = got.to_string();
    // What is quoted back must not be longer than what a person reads.
    if got.chars().count() > 60 {
        got = got.chars().take(57).collect::<String>() + "...";
    }
    let path = if path.is_empty() { "the message".to_owned() } else { path.to_owned() };
    Err(ValueError { path, got, expected: expected.into() })
}

impl MessageType {
    /// Reads a message of this type. Fields that are left out get zero, empty or false; a time that is left out of
    /// a header, or is the word `now`, gets `now`. Whole numbers may be written as 3.0, truth as 0 or 1.
    ///
    /// # Errors
    /// [`ValueError`] with the field, what it is and what was expected; a field that the type lacks is one too.
    pub fn parse_json(&self, json: Json, now: Time) -> Result<MessageValue, ValueError> {
        self.parse_json_at(json, now, "")
    }

    fn parse_json_at(&self, json: Json, now: Time, path: &str) -> Result<MessageValue, ValueError> {
        let Json::Object(mut map) = json else {
            return refuse(path, &json, format!("an object ({})", self.name));
        };
        let mut fields = Vec::with_capacity(self.fields.len());
        for field in &self.fields {
            let given = map.remove(&*field.name);
            let given = given.or_else(|| map.remove(ros2::renamed_field(&self.name, &field.name)?));
            let value = match given {
                Some(json) => field.parse_json(json, now, path)?,
                None if self.name == "std_msgs/Header" && field.kind == FieldType::Time => {
                    MessageValue::Time(now)
                }
                None => field.default_value(now),
            };
            fields.push((Arc::clone(&field.name), value));
        }
        if let Some((name, value)) = map.into_iter().next() {
            let known: Vec<&str> = self.fields.iter().map(|field| &*field.name).collect();
            return refuse(
                &join(path, &name),
                &value,
                format!("only the fields of {}: {known:?}", self.name),
            );
        }
        Ok(MessageValue::Message(fields))
    }

    /// The fields that `json` leaves out, by their paths; a header and what is in it are meant to be left out. Entries of
    /// arrays are not looked into.
    pub fn missing_fields(&self, json: &Json) -> Vec<String> {
        let mut found = Vec::new();
        self.collect_missing_fields(json, "", &mut found);
        found
    }

    fn collect_missing_fields(&self, json: &Json, path: &str, found: &mut Vec<String>) {
        const HEADER: &str = "std_msgs/Header";
        let Some(map) = json.as_object().filter(|_| self.name != HEADER) else { return };
        for field in &self.fields {
            let inner = match &field.kind {
                FieldType::Message(inner) => Some(inner),
                _ => None,
            };
            let given = map.get(&*field.name);
            let given = given.or_else(|| map.get(ros2::renamed_field(&self.name, &field.name)?));
            match (given, inner) {
                (None, Some(inner)) if inner.name == HEADER => {}
                (None, _) => found.push(join(path, &field.name)),
                (Some(json), Some(inner)) => {
                    inner.collect_missing_fields(json, &join(path, &field.name), found)
                }
                (Some(_), None) => {}
            }
        }
    }

    /// The message with every field left out.
    pub fn default_value(&self, now: Time) -> MessageValue {
        self.parse_json(Json::Object(Map::new()), now).expect("fields that are left out are always allowed")
    }
}

fn join(path: &str, name: &str) -> String {
    if path.is_empty() { name.to_owned() } else { format!("{path}.{name}") }
}

impl MessageField {
    fn parse_json(&self, json: Json, now: Time, path: &str) -> Result<MessageValue, ValueError> {
        let length = match self.count {
            ArrayKind::Single => return self.kind.parse_json(json, now, || join(path, &self.name)),
            ArrayKind::Variable => None,
            ArrayKind::Fixed(length) => Some(length),
        };
        let path = join(path, &self.name);
        let expected = || match length {
            Some(length) => format!("an array of {length} ({})", self.kind.name()),
            None => format!("an array ({}[])", self.kind.name()),
        };
        let bytes = matches!(self.kind, FieldType::Int { bits: 8, signed: false });
        if let (true, Json::String(text)) = (bytes, &json) {
            return match BASE64.decode(text) {
                Ok(bytes) if length.is_none_or(|length| bytes.len() == length) => {
                    Ok(MessageValue::Bytes(bytes))
                }
                _ => refuse(&path, &json, expected() + ", as numbers or in base64"),
            };
        }
        let Json::Array(entries) = json else { return refuse(&path, &json, expected()) };
        if length.is_some_and(|length| entries.len() != length) {
            let count = Json::String(format!("{} entries", entries.len()));
            return refuse(&path, &count, expected());
        }
        let mut values = Vec::with_capacity(entries.len());
        for (n, entry) in entries.into_iter().enumerate() {
            values.push(self.kind.parse_json(entry, now, || format!("{path}[{n}]"))?);
        }
        Ok(self.pack(values))
    }

    /// Arrays of numbers in their dense form.
    fn pack(&self, values: Vec<MessageValue>) -> MessageValue {
        match self.kind {
            FieldType::Int { bits: 8, signed: false } => MessageValue::Bytes(
                values.iter().filter_map(|value| value.as_f64()).map(|number| number as u8).collect(),
            ),
            FieldType::Float32 | FieldType::Float64 => {
                MessageValue::Floats(values.iter().filter_map(MessageValue::as_f64).collect())
            }
            _ => MessageValue::List(values),
        }
    }

    fn default_value(&self, now: Time) -> MessageValue {
        match self.count {
            ArrayKind::Single => self.kind.default_value(now),
            ArrayKind::Variable => self.pack(Vec::new()),
            ArrayKind::Fixed(length) => {
                self.pack((0..length).map(|_| self.kind.default_value(now)).collect())
            }
        }
    }
}

impl FieldType {
    fn parse_json(
        &self,
        json: Json,
        now: Time,
        path: impl Fn() -> String,
    ) -> Result<MessageValue, ValueError> {
        let expected = || match self {
            FieldType::Int { bits, signed } => {
                format!("a whole number that fits {}", int_name(*bits, *signed))
            }
            FieldType::Float32 | FieldType::Float64 => format!("a number or null ({})", self.name()),
            FieldType::Time | FieldType::Duration => {
                format!("{{secs, nsecs}} or {{sec, nanosec}} ({})", self.name())
            }
            other => other.name(),
        };
        let value = match (self, &json) {
            (FieldType::Message(inner), _) => return inner.parse_json_at(json, now, &path()),
            (FieldType::Bool, Json::Bool(value)) => Some(MessageValue::Bool(*value)),
            (FieldType::Bool, Json::Number(number)) => match number.as_f64() {
                Some(0.0) => Some(MessageValue::Bool(false)),
                Some(1.0) => Some(MessageValue::Bool(true)),
                _ => None,
            },
            (FieldType::Int { bits, signed }, Json::Number(number)) => integer(number, *bits, *signed),
            (FieldType::Float32 | FieldType::Float64, Json::Number(number)) => {
                number.as_f64().map(MessageValue::Float)
            }
            (FieldType::Float32 | FieldType::Float64, Json::Null) => Some(MessageValue::Float(f64::NAN)),
            (FieldType::Text, Json::String(_)) => match json {
                Json::String(text) => return Ok(MessageValue::Text(text)),
                _ => None,
            },
            (FieldType::Time, Json::String(text)) if text == "now" => Some(MessageValue::Time(now)),
            (FieldType::Time, Json::Object(map)) => read_time(map),
            (FieldType::Duration, Json::Object(map)) => read_duration(map),
            _ => None,
        };
        value.map_or_else(|| refuse(&path(), &json, expected()), Ok)
    }

    fn default_value(&self, now: Time) -> MessageValue {
        match self {
            FieldType::Bool => MessageValue::Bool(false),
            FieldType::Int { signed: true, .. } => MessageValue::Int(0),
            FieldType::Int { .. } => MessageValue::Uint(0),
            FieldType::Float32 | FieldType::Float64 => MessageValue::Float(0.0),
            FieldType::Text => MessageValue::Text(String::new()),
            FieldType::Time => MessageValue::Time(Time::default()),
            FieldType::Duration => MessageValue::Duration(Duration::default()),
            FieldType::Message(inner) => inner.default_value(now),
        }
    }
}

fn int_name(bits: u8, signed: bool) -> String {
    FieldType::Int { bits, signed }.name()
}

/// A whole number in range; `3.0` counts as one.
fn integer(number: &serde_json::Number, bits: u8, signed: bool) -> Option<MessageValue> {
    let wide: i128 = match (number.as_i64(), number.as_u64(), number.as_f64()) {
        (Some(n), _, _) => n.into(),
        (_, Some(n), _) => n.into(),
        (_, _, Some(x)) if x.fract() == 0.0 && x.abs() < 1e19 => x as i128,
        _ => return None,
    };
    if !FieldType::range(bits, signed).contains(&wide) {
        return None;
    }
    // The range check proves that neither cast loses anything.
    Some(if signed { MessageValue::Int(wide as i64) } else { MessageValue::Uint(wide as u64) })
}

/// `secs` and `nsecs`, or `sec` and `nanosec` as newer clients write them; what is left out is zero.
fn time_parts(map: &Map<String, Json>) -> Option<(i64, i64)> {
    let mut parts = (0, 0);
    for (name, value) in map {
        let part = match name.as_str() {
            "secs" | "sec" => &mut parts.0,
            "nsecs" | "nanosec" => &mut parts.1,
            _ => return None,
        };
        let Json::Number(number) = value else { return None };
        let Some(MessageValue::Int(n)) = integer(number, 64, true) else { return None };
        *part = n;
    }
    Some(parts)
}

fn read_time(map: &Map<String, Json>) -> Option<MessageValue> {
    let (secs, nsecs) = time_parts(map)?;
    // A second's worth of nanoseconds is carried over, as ROS does.
    let secs = secs.checked_add(nsecs.div_euclid(1_000_000_000))?;
    let nsecs = nsecs.rem_euclid(1_000_000_000);
    Some(MessageValue::Time(Time { secs: secs.try_into().ok()?, nsecs: nsecs as u32 }))
}

fn read_duration(map: &Map<String, Json>) -> Option<MessageValue> {
    let (secs, nsecs) = time_parts(map)?;
    Some(MessageValue::Duration(Duration { secs: secs.try_into().ok()?, nsecs: nsecs.try_into().ok()? }))
}
