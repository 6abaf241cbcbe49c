//! The content of a message, and its forms: JSON as rosbridge has it, and CBOR.

use super::definition::{Count, Field, Kind, MessageType};
use base64::{Engine, engine::general_purpose::STANDARD as BASE64};
use serde::{Serialize, Serializer, ser::SerializeMap};
use serde_json::{Map, Value as Json};

/// A value in a message.
#[derive(Clone, Debug, PartialEq)]
pub enum Value {
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
    /// `duration`: whole seconds and nanoseconds, both of one sign.
    Duration {
        /// Seconds.
        secs: i32,
        /// Nanoseconds.
        nsecs: i32,
    },
    /// `uint8[]` and `char[]`; base64 in JSON.
    Bytes(Vec<u8>),
    /// `float32[]` and `float64[]`.
    Floats(Vec<f64>),
    /// Any other array.
    List(Vec<Value>),
    /// A message: its fields in ROS's order.
    Message(Vec<(String, Value)>),
    /// A message of a type whose definition is not known: handed on as it came.
    Opaque(Json),
}

/// A point in time as ROS 1 has it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize)]
pub struct Time {
    /// Whole seconds.
    pub secs: u32,
    /// Nanoseconds beyond, below 1e9.
    pub nsecs: u32,
}

impl Value {
    /// The field of a message, or none.
    pub fn get(&self, name: &str) -> Option<&Value> {
        match self {
            Value::Message(fields) => fields.iter().find(|(field, _)| field == name).map(|(_, value)| value),
            _ => None,
        }
    }

    /// The number, if it is one.
    pub fn as_f64(&self) -> Option<f64> {
        match self {
            Value::Float(x) => Some(*x),
            Value::Int(n) => Some(*n as f64),
            Value::Uint(n) => Some(*n as f64),
            _ => None,
        }
    }

    /// The text, if it is one.
    pub fn as_text(&self) -> Option<&str> {
        match self {
            Value::Text(text) => Some(text),
            _ => None,
        }
    }
}

impl Serialize for Value {
    fn serialize<S: Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        match self {
            Value::Bool(value) => to.serialize_bool(*value),
            Value::Int(value) => to.serialize_i64(*value),
            Value::Uint(value) => to.serialize_u64(*value),
            Value::Float(value) => to.serialize_f64(*value),
            Value::Text(value) => to.serialize_str(value),
            Value::Time(time) => time.serialize(to),
            Value::Duration { secs, nsecs } => {
                let mut map = to.serialize_map(Some(2))?;
                map.serialize_entry("secs", secs)?;
                map.serialize_entry("nsecs", nsecs)?;
                map.end()
            }
            Value::Bytes(bytes) => to.serialize_str(&BASE64.encode(bytes)),
            Value::Floats(values) => to.collect_seq(values),
            Value::List(values) => to.collect_seq(values),
            Value::Message(fields) => to.collect_map(fields.iter().map(|(name, value)| (name, value))),
            Value::Opaque(json) => json.serialize(to),
        }
    }
}

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
            let value = match map.remove(&field.name) {
                Some(json) => field.read(json, now, path)?,
                None if self.name == "std_msgs/Header" && field.kind == Kind::Time => Value::Time(now),
                None => field.empty(now),
            };
            fields.push((field.name.clone(), value));
        }
        if let Some((name, value)) = map.into_iter().next() {
            let known: Vec<&str> = self.fields.iter().map(|field| field.name.as_str()).collect();
            return refuse(
                &join(path, &name),
                &value,
                format!("only the fields of {}: {known:?}", self.name),
            );
        }
        Ok(Value::Message(fields))
    }

    /// The message with every field left out.
    pub fn empty(&self, now: Time) -> Value {
        self.read(Json::Object(Map::new()), now).expect("fields that are left out are always allowed")
    }
}

fn join(path: &str, name: &str) -> String {
    if path.is_empty() { name.to_owned() } else { format!("{path}.{name}") }
}

impl Field {
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
            Kind::Duration => Value::Duration { secs: 0, nsecs: 0 },
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
    let (low, high) =
        if signed { (-(1i128 << (bits - 1)), (1i128 << (bits - 1)) - 1) } else { (0, (1i128 << bits) - 1) };
    if !(low..=high).contains(&wide) {
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
    Some(Value::Duration { secs: secs.try_into().ok()?, nsecs: nsecs.try_into().ok()? })
}
