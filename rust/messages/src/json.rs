//! Messages from JSON as rosbridge has it.

use crate::{
    definition::{Count, Kind, MessageField, MessageType},
    value::{Duration, Time, Value},
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
    pub fn read(&self, json: Json, now: Time) -> Result<Value, ValueError> {
        self.read_at(json, now, "")
    }

    fn read_at(&self, json: Json, now: Time, path: &str) -> Result<Value, ValueError> {
        let Json::Object(mut map) = json else {
            return refuse(path, &json, format!("an object ({})", self.name));
        };
        let mut fields = Vec::with_capacity(self.fields.len());
        for field in &self.fields {
            let value = match map.remove(&*field.name) {
                Some(json) => field.read(json, now, path)?,
                None if self.name == "std_msgs/Header" && field.kind == Kind::Time => Value::Time(now),
                None => field.empty(now),
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
        Ok(Value::Message(fields))
    }

    /// The fields that `json` leaves out, by their paths; a header and what is in it are meant to be left out. Entries of
    /// arrays are not looked into.
    pub fn left_out(&self, json: &Json) -> Vec<String> {
        let mut found = Vec::new();
        self.find_left_out(json, "", &mut found);
        found
    }

    fn find_left_out(&self, json: &Json, path: &str, found: &mut Vec<String>) {
        const HEADER: &str = "std_msgs/Header";
        let Some(map) = json.as_object().filter(|_| self.name != HEADER) else { return };
        for field in &self.fields {
            let inner = match &field.kind {
                Kind::Message(inner) => Some(inner),
                _ => None,
            };
            match (map.get(&*field.name), inner) {
                (None, Some(inner)) if inner.name == HEADER => {}
                (None, _) => found.push(join(path, &field.name)),
                (Some(json), Some(inner)) => inner.find_left_out(json, &join(path, &field.name), found),
                (Some(_), None) => {}
            }
        }
    }

    /// The message with every field left out.
    pub fn empty(&self, now: Time) -> Value {
        self.read(Json::Object(Map::new()), now).expect("fields that are left out are always allowed")
    }
}

fn join(path: &str, name: &str) -> String {
    if path.is_empty() { name.to_owned() } else { format!("{path}.{name}") }
}

impl MessageField {
    fn read(&self, json: Json, now: Time, path: &str) -> Result<Value, ValueError> {
        let length = match self.count {
            Count::One => return self.kind.read(json, now, || join(path, &self.name)),
            Count::Any => None,
            Count::Exactly(length) => Some(length),
        };
        let path = join(path, &self.name);
        let expected = || match length {
            Some(length) => format!("an array of {length} ({})", self.kind.name()),
            None => format!("an array ({}[])", self.kind.name()),
        };
        let bytes = matches!(self.kind, Kind::Int { bits: 8, signed: false });
        if let (true, Json::String(text)) = (bytes, &json) {
            return match BASE64.decode(text) {
                Ok(bytes) if length.is_none_or(|length| bytes.len() == length) => Ok(Value::Bytes(bytes)),
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
            values.push(self.kind.read(entry, now, || format!("{path}[{n}]"))?);
        }
        Ok(self.pack(values))
    }

    /// Arrays of numbers in their dense form.
    fn pack(&self, values: Vec<Value>) -> Value {
        match self.kind {
            Kind::Int { bits: 8, signed: false } => Value::Bytes(
                values.iter().filter_map(|value| value.as_f64()).map(|number| number as u8).collect(),
            ),
            Kind::Float32 | Kind::Float64 => Value::Floats(values.iter().filter_map(Value::as_f64).collect()),
            _ => Value::List(values),
        }
    }

    fn empty(&self, now: Time) -> Value {
        match self.count {
            Count::One => self.kind.empty(now),
            Count::Any => self.pack(Vec::new()),
            Count::Exactly(length) => self.pack((0..length).map(|_| self.kind.empty(now)).collect()),
        }
    }
}

impl Kind {
    fn read(&self, json: Json, now: Time, path: impl Fn() -> String) -> Result<Value, ValueError> {
        let expected = || match self {
            Kind::Int { bits, signed } => format!("a whole number that fits {}", int_name(*bits, *signed)),
            Kind::Float32 | Kind::Float64 => format!("a number or null ({})", self.name()),
            Kind::Time | Kind::Duration => format!("{{secs, nsecs}} ({})", self.name()),
            other => other.name(),
        };
        let value = match (self, &json) {
            (Kind::Message(inner), _) => return inner.read_at(json, now, &path()),
            (Kind::Bool, Json::Bool(value)) => Some(Value::Bool(*value)),
            (Kind::Bool, Json::Number(number)) => match number.as_f64() {
                Some(0.0) => Some(Value::Bool(false)),
                Some(1.0) => Some(Value::Bool(true)),
                _ => None,
            },
            (Kind::Int { bits, signed }, Json::Number(number)) => integer(number, *bits, *signed),
            (Kind::Float32 | Kind::Float64, Json::Number(number)) => number.as_f64().map(Value::Float),
            (Kind::Float32 | Kind::Float64, Json::Null) => Some(Value::Float(f64::NAN)),
            (Kind::Text, Json::String(_)) => match json {
                Json::String(text) => return Ok(Value::Text(text)),
                _ => None,
            },
            (Kind::Time, Json::String(text)) if text == "now" => Some(Value::Time(now)),
            (Kind::Time, Json::Object(map)) => read_time(map),
            (Kind::Duration, Json::Object(map)) => read_duration(map),
            _ => None,
        };
        value.map_or_else(|| refuse(&path(), &json, expected()), Ok)
    }

    fn empty(&self, now: Time) -> Value {
        match self {
            Kind::Bool => Value::Bool(false),
            Kind::Int { signed: true, .. } => Value::Int(0),
            Kind::Int { .. } => Value::Uint(0),
            Kind::Float32 | Kind::Float64 => Value::Float(0.0),
            Kind::Text => Value::Text(String::new()),
            Kind::Time => Value::Time(Time::default()),
            Kind::Duration => Value::Duration(Duration::default()),
            Kind::Message(inner) => inner.empty(now),
        }
    }
}

fn int_name(bits: u8, signed: bool) -> String {
    Kind::Int { bits, signed }.name()
}

/// A whole number in range; `3.0` counts as one.
fn integer(number: &serde_json::Number, bits: u8, signed: bool) -> Option<Value> {
    let wide: i128 = match (number.as_i64(), number.as_u64(), number.as_f64()) {
        (Some(n), _, _) => n.into(),
        (_, Some(n), _) => n.into(),
        (_, _, Some(x)) if x.fract() == 0.0 && x.abs() < 1e19 => x as i128,
        _ => return None,
    };
    if !Kind::range(bits, signed).contains(&wide) {
        return None;
    }
    // The range check proves that neither cast loses anything.
    Some(if signed { Value::Int(wide as i64) } else { Value::Uint(wide as u64) })
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
        let Some(Value::Int(n)) = integer(number, 64, true) else { return None };
        *part = n;
    }
    Some(parts)
}

fn read_time(map: &Map<String, Json>) -> Option<Value> {
    let (secs, nsecs) = time_parts(map)?;
    // A second's worth of nanoseconds is carried over, as ROS does.
    let secs = secs.checked_add(nsecs.div_euclid(1_000_000_000))?;
    let nsecs = nsecs.rem_euclid(1_000_000_000);
    Some(Value::Time(Time { secs: secs.try_into().ok()?, nsecs: nsecs as u32 }))
}

fn read_duration(map: &Map<String, Json>) -> Option<Value> {
    let (secs, nsecs) = time_parts(map)?;
    Some(Value::Duration(Duration { secs: secs.try_into().ok()?, nsecs: nsecs.try_into().ok()? }))
}
