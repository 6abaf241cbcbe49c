//! Messages as ROS 1 sends them over TCP and keeps them in bags: little-endian, field after field.

use super::{
    definition::{Count, DefinitionError, Field, Kind, MessageType},
    value::{Time, Value},
};
use std::{collections::BTreeMap, sync::Arc};

/// Why a message cannot be written or read.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum WireError {
    /// The bytes end before the message does.
    #[error("{path}: {missing} bytes are missing at the end")]
    TooShort {
        /// The field.
        path: String,
        /// How many, at least.
        missing: usize,
    },
    /// A text that is not UTF-8.
    #[error("{path} is not UTF-8")]
    NotText {
        /// The field.
        path: String,
    },
    /// A value of another type than the field.
    #[error("{path} is {got}, expected {expected}")]
    Mismatch {
        /// The field.
        path: String,
        /// What is there.
        got: String,
        /// The field's type.
        expected: String,
    },
}

impl MessageType {
    /// Reads a type from the text that connections of ROS carry: its definition, then those of the types that it
    /// needs, each after a line of `=` and a line `MSG: package/Name`.
    ///
    /// # Errors
    /// [`DefinitionError`] with the line that cannot be read.
    pub fn from_text(name: &str, text: &str) -> Result<Arc<MessageType>, DefinitionError> {
        let mut parts: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
        let mut lines: Vec<&str> = Vec::new();
        let mut current = name;
        for line in text.lines() {
            let line = line.trim();
            if let Some(next) = line.strip_prefix("MSG:") {
                parts.entry(current).or_insert_with(|| std::mem::take(&mut lines));
                (current, lines) = (next.trim(), Vec::new());
            } else if !line.starts_with("====") {
                lines.push(line);
            }
        }
        parts.entry(current).or_insert(lines);
        assemble(name, &parts, &mut Vec::new())
    }

    /// The message as bytes, without its length before it.
    ///
    /// # Errors
    /// [`WireError::Mismatch`] for a value that was not read with this type.
    pub fn to_bytes(&self, value: &Value) -> Result<Vec<u8>, WireError> {
        let mut bytes = Vec::new();
        self.write(value, &self.name, &mut bytes)?;
        Ok(bytes)
    }

    /// The message in `bytes`, without its length before it. What follows it is left alone.
    ///
    /// # Errors
    /// [`WireError::TooShort`], [`WireError::NotText`].
    pub fn from_bytes(&self, bytes: &[u8]) -> Result<Value, WireError> {
        self.read_bytes(&mut Reader { rest: bytes }, &self.name)
    }

    fn write(&self, value: &Value, path: &str, to: &mut Vec<u8>) -> Result<(), WireError> {
        let Value::Message(fields) = value else { return mismatch(path, value, &self.name) };
        if fields.len() != self.fields.len() {
            return mismatch(path, value, &format!("{} with {} fields", self.name, self.fields.len()));
        }
        for (field, (_, value)) in self.fields.iter().zip(fields) {
            field.write(value, &format!("{path}.{}", field.name), to)?;
        }
        Ok(())
    }

    fn read_bytes(&self, from: &mut Reader<'_>, path: &str) -> Result<Value, WireError> {
        let fields = self.fields.iter().map(|field| {
            let value = field.read_bytes(from, &format!("{path}.{}", field.name))?;
            Ok((field.name.clone(), value))
        });
        Ok(Value::Message(fields.collect::<Result<_, _>>()?))
    }
}

/// Builds a type from its lines and those of what it needs; `above` are the types that contain it.
fn assemble(
    name: &str,
    parts: &BTreeMap<&str, Vec<&str>>,
    above: &mut Vec<String>,
) -> Result<Arc<MessageType>, DefinitionError> {
    let refuse = |text: &str, reason: &str| DefinitionError {
        type_name: name.to_owned(),
        text: text.to_owned(),
        reason: reason.to_owned(),
    };
    let lines = parts.get(name).ok_or_else(|| refuse("", "its definition is not in the text"))?;
    if above.iter().any(|outer| outer == name) {
        return Err(refuse("", "it contains itself"));
    }
    above.push(name.to_owned());
    let package = name.split('/').next().unwrap_or_default();
    let mut inner: BTreeMap<&str, Arc<MessageType>> = BTreeMap::new();
    let mut fields = Vec::new();
    // What is no field: comments, constants.
    let words = lines.iter().map(|line| line.split('#').next().unwrap_or_default().trim());
    for line in words.filter(|line| !line.is_empty() && !line.contains('=')) {
        let kind = line.split([' ', '\t', '[']).next().unwrap_or_default();
        if Kind::primitive(kind).is_none() && !inner.contains_key(kind) {
            let full = match kind {
                "Header" => "std_msgs/Header".to_owned(),
                full if full.contains('/') => full.to_owned(),
                local => format!("{package}/{local}"),
            };
            inner.insert(kind, assemble(&full, parts, above)?);
        }
        fields.push(line);
    }
    above.pop();
    MessageType::parse(name, fields, |kind| inner.get(kind).cloned()).map(Arc::new)
}

fn mismatch<T>(path: &str, got: &Value, expected: &str) -> Result<T, WireError> {
    let mut got = serde_json::to_string(got).unwrap_or_default();
    if got.chars().count() > 60 {
        got = got.chars().take(57).collect::<String>() + "...";
    }
    Err(WireError::Mismatch { path: path.to_owned(), got, expected: expected.to_owned() })
}

struct Reader<'a> {
    rest: &'a [u8],
}

impl<'a> Reader<'a> {
    fn take(&mut self, count: usize, path: &str) -> Result<&'a [u8], WireError> {
        let Some((head, rest)) = self.rest.split_at_checked(count) else {
            let missing = count - self.rest.len();
            return Err(WireError::TooShort { path: path.to_owned(), missing });
        };
        self.rest = rest;
        Ok(head)
    }

    fn array<const N: usize>(&mut self, path: &str) -> Result<[u8; N], WireError> {
        let mut bytes = [0; N];
        bytes.copy_from_slice(self.take(N, path)?);
        Ok(bytes)
    }

    fn length(&mut self, path: &str) -> Result<usize, WireError> {
        Ok(u32::from_le_bytes(self.array(path)?) as usize)
    }
}

impl Field {
    fn write(&self, value: &Value, path: &str, to: &mut Vec<u8>) -> Result<(), WireError> {
        if self.count == Count::One {
            return self.kind.write(value, path, to);
        }
        let length = match value {
            Value::Bytes(bytes) => bytes.len(),
            Value::Floats(values) => values.len(),
            Value::List(values) => values.len(),
            other => return mismatch(path, other, &format!("an array of {}", self.kind.name())),
        };
        match self.count {
            Count::Exactly(expected) if expected != length => {
                return mismatch(path, value, &format!("an array of {expected} {}", self.kind.name()));
            }
            Count::Any => to.extend((length as u32).to_le_bytes()),
            _ => {}
        }
        match value {
            Value::Bytes(bytes) if matches!(self.kind, Kind::Int { bits: 8, signed: false }) => {
                to.extend(bytes);
            }
            Value::Floats(values) => {
                for value in values {
                    self.kind.write(&Value::Float(*value), path, to)?;
                }
            }
            Value::List(values) => {
                for value in values {
                    self.kind.write(value, path, to)?;
                }
            }
            other => return mismatch(path, other, &format!("an array of {}", self.kind.name())),
        }
        Ok(())
    }

    fn read_bytes(&self, from: &mut Reader<'_>, path: &str) -> Result<Value, WireError> {
        let length = match self.count {
            Count::One => return self.kind.read_bytes(from, path),
            Count::Any => from.length(path)?,
            Count::Exactly(length) => length,
        };
        // An entry has a byte at least; so a length that lies cannot ask for memory.
        if length > from.rest.len() {
            return Err(WireError::TooShort { path: path.to_owned(), missing: length - from.rest.len() });
        }
        if matches!(self.kind, Kind::Int { bits: 8, signed: false }) {
            return Ok(Value::Bytes(from.take(length, path)?.to_vec()));
        }
        let mut values = Vec::new();
        for _ in 0..length {
            values.push(self.kind.read_bytes(from, path)?);
        }
        Ok(match self.kind {
            Kind::Float32 | Kind::Float64 => Value::Floats(values.iter().filter_map(Value::as_f64).collect()),
            _ => Value::List(values),
        })
    }
}

impl Kind {
    fn write(&self, value: &Value, path: &str, to: &mut Vec<u8>) -> Result<(), WireError> {
        match (self, value) {
            (Kind::Message(inner), value) => return inner.write(value, path, to),
            (Kind::Bool, Value::Bool(value)) => to.push(u8::from(*value)),
            (Kind::Int { bits, .. }, Value::Int(_) | Value::Uint(_)) => {
                // The lower bytes are the number in either sign.
                let bytes = match value {
                    Value::Int(n) => n.to_le_bytes(),
                    Value::Uint(n) => n.to_le_bytes(),
                    _ => return mismatch(path, value, &self.name()),
                };
                to.extend(&bytes[..usize::from(bits / 8)]);
            }
            (Kind::Float32, value) if value.as_f64().is_some() => {
                to.extend((value.as_f64().unwrap_or_default() as f32).to_le_bytes());
            }
            (Kind::Float64, value) if value.as_f64().is_some() => {
                to.extend(value.as_f64().unwrap_or_default().to_le_bytes());
            }
            (Kind::Text, Value::Text(text)) => {
                to.extend((text.len() as u32).to_le_bytes());
                to.extend(text.as_bytes());
            }
            (Kind::Time, Value::Time(time)) => {
                to.extend(time.secs.to_le_bytes());
                to.extend(time.nsecs.to_le_bytes());
            }
            (Kind::Duration, Value::Duration { secs, nsecs }) => {
                to.extend(secs.to_le_bytes());
                to.extend(nsecs.to_le_bytes());
            }
            (_, other) => return mismatch(path, other, &self.name()),
        }
        Ok(())
    }

    fn read_bytes(&self, from: &mut Reader<'_>, path: &str) -> Result<Value, WireError> {
        Ok(match self {
            Kind::Message(inner) => inner.read_bytes(from, path)?,
            Kind::Bool => Value::Bool(from.array::<1>(path)?[0] != 0),
            Kind::Int { bits, signed } => {
                let bytes = from.take(usize::from(bits / 8), path)?;
                let negative = *signed && bytes.last().is_some_and(|byte| byte & 0x80 != 0);
                let mut wide = [if negative { 0xff } else { 0 }; 8];
                wide[..bytes.len()].copy_from_slice(bytes);
                if *signed {
                    Value::Int(i64::from_le_bytes(wide))
                } else {
                    Value::Uint(u64::from_le_bytes(wide))
                }
            }
            Kind::Float32 => Value::Float(f32::from_le_bytes(from.array(path)?).into()),
            Kind::Float64 => Value::Float(f64::from_le_bytes(from.array(path)?)),
            Kind::Text => {
                let length = from.length(path)?;
                let text = std::str::from_utf8(from.take(length, path)?);
                Value::Text(text.map_err(|_| WireError::NotText { path: path.to_owned() })?.to_owned())
            }
            Kind::Time => Value::Time(Time {
                secs: u32::from_le_bytes(from.array(path)?),
                nsecs: u32::from_le_bytes(from.array(path)?),
            }),
            Kind::Duration => Value::Duration {
                secs: i32::from_le_bytes(from.array(path)?),
                nsecs: i32::from_le_bytes(from.array(path)?),
            },
        })
    }
}

#[cfg(test)]
mod tests {
    use super::{super::definition::known_types, *};
    use serde_json::json;

    #[test]
    fn a_text_with_its_dependencies_becomes_a_type() {
        let text = "# a comment\nHeader header\nint8 UP=1 # a constant\nstring NAME=a # b\nPoint[] points # there\n\
            float32[2] ends\nbyte level\n================\nMSG: std_msgs/Header\nuint32 seq\ntime stamp\nstring frame_id\n\
            ================\nMSG: lab_msgs/Point\nfloat64 x\n";
        let kind = MessageType::from_text("lab_msgs/Path", text).unwrap();
        let names: Vec<&str> = kind.fields.iter().map(|f| f.name.as_str()).collect();
        assert_eq!(names, ["header", "points", "ends", "level"]);
        assert_eq!(kind.fields[1].kind.name(), "lab_msgs/Point");
        let value =
            kind.read(json!({"points": [{"x": 1.5}], "ends": [1, 2], "level": -3}), Time::default()).unwrap();
        let bytes = kind.to_bytes(&value).unwrap();
        // Header 4 + 8 + 4, points 4 + 8, ends 8, level 1.
        assert_eq!(bytes.len(), 16 + 12 + 8 + 1);
        assert_eq!(bytes.last(), Some(&0xfd));
        assert_eq!(kind.from_bytes(&bytes).unwrap(), value);
    }

    #[test]
    fn every_known_type_survives_the_way_there_and_back() {
        for kind in known_types() {
            let value = kind.empty(Time { secs: 7, nsecs: 9 });
            let bytes = kind.to_bytes(&value).unwrap();
            assert_eq!(kind.from_bytes(&bytes).unwrap(), value, "{}", kind.name);
            if !bytes.is_empty() {
                assert!(matches!(
                    kind.from_bytes(&bytes[..bytes.len() - 1]),
                    Err(WireError::TooShort { .. })
                ));
            }
        }
    }

    #[test]
    fn a_length_that_lies_and_a_text_that_is_none_are_refused() {
        let kind = MessageType::from_text("a/B", "float64[] data\nstring text").unwrap();
        let error = kind.from_bytes(&[0xff, 0xff, 0xff, 0xff]).unwrap_err();
        assert!(matches!(error, WireError::TooShort { .. }), "{error}");
        let error = kind.from_bytes(&[0, 0, 0, 0, 1, 0, 0, 0, 0xff]).unwrap_err();
        assert_eq!(error.to_string(), "a/B.text is not UTF-8");
        let error = kind.to_bytes(&Value::Message(vec![])).unwrap_err();
        assert!(error.to_string().contains("2 fields"), "{error}");
    }

    #[test]
    fn a_type_that_lacks_a_part_or_contains_itself_is_refused() {
        let error = MessageType::from_text("a/B", "C c").unwrap_err().to_string();
        assert!(error.contains("a/C") && error.contains("not in the text"), "{error}");
        let error = MessageType::from_text("a/B", "B b").unwrap_err().to_string();
        assert!(error.contains("contains itself"), "{error}");
    }
}
