//! Message types as data: what fields a type has, in ROS's order.

use std::{
    collections::BTreeMap,
    sync::{Arc, LazyLock},
};

/// A message type of ROS 1.
#[derive(Debug, PartialEq)]
pub struct MessageType {
    /// Full name, such as `std_msgs/String`.
    pub name: String,
    /// Fields in ROS's order.
    pub fields: Vec<Field>,
}

/// A field of a message.
#[derive(Clone, Debug, PartialEq)]
pub struct Field {
    /// Name.
    pub name: String,
    /// Type of the value, or of each entry of an array.
    pub kind: Kind,
    /// How many.
    pub count: Count,
}

/// The type of a single value.
#[derive(Clone, Debug, PartialEq)]
pub enum Kind {
    /// True or false.
    Bool,
    /// A whole number; `byte` is `int8` and `char` is `uint8`, as ROS 1 has it.
    Int {
        /// 8, 16, 32 or 64.
        bits: u8,
        /// Below zero too.
        signed: bool,
    },
    /// A floating-point number of 32 bits.
    Float32,
    /// A floating-point number of 64 bits.
    Float64,
    /// UTF-8 text.
    Text,
    /// Unsigned seconds and nanoseconds.
    Time,
    /// Signed seconds and nanoseconds.
    Duration,
    /// Another message.
    Message(Arc<MessageType>),
}

/// Whether a field is an array.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Count {
    /// A single value.
    One,
    /// An array of any length.
    Any,
    /// An array of this length.
    Exactly(usize),
}

/// Why a definition cannot be read.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "{type_name}: field {text:?} cannot be read: {reason}; expected a type and a name, such as \"float64[] data\""
)]
pub struct DefinitionError {
    /// The type that has the field.
    pub type_name: String,
    /// The field as written.
    pub text: String,
    /// What is wrong with it.
    pub reason: String,
}

impl Kind {
    /// Name in a message definition.
    pub fn name(&self) -> String {
        match self {
            Kind::Bool => "bool".to_owned(),
            Kind::Int { bits, signed } => format!("{}int{bits}", if *signed { "" } else { "u" }),
            Kind::Float32 => "float32".to_owned(),
            Kind::Float64 => "float64".to_owned(),
            Kind::Text => "string".to_owned(),
            Kind::Time => "time".to_owned(),
            Kind::Duration => "duration".to_owned(),
            Kind::Message(inner) => inner.name.clone(),
        }
    }

    pub(super) fn primitive(name: &str) -> Option<Kind> {
        Some(match name {
            "bool" => Kind::Bool,
            "byte" | "int8" => Kind::Int { bits: 8, signed: true },
            "char" | "uint8" => Kind::Int { bits: 8, signed: false },
            "int16" => Kind::Int { bits: 16, signed: true },
            "uint16" => Kind::Int { bits: 16, signed: false },
            "int32" => Kind::Int { bits: 32, signed: true },
            "uint32" => Kind::Int { bits: 32, signed: false },
            "int64" => Kind::Int { bits: 64, signed: true },
            "uint64" => Kind::Int { bits: 64, signed: false },
            "float32" => Kind::Float32,
            "float64" => Kind::Float64,
            "string" => Kind::Text,
            "time" => Kind::Time,
            "duration" => Kind::Duration,
            _ => return None,
        })
    }
}

impl MessageType {
    /// Reads a type from its fields, such as `["uint32 seq", "time stamp", "string frame_id"]`; constants and
    /// comments left out. `known` finds the types of fields that are messages, by their full names.
    ///
    /// # Errors
    /// [`DefinitionError`] with the field that cannot be read.
    pub fn parse<'a>(
        name: &str,
        fields: impl IntoIterator<Item = &'a str>,
        known: impl Fn(&str) -> Option<Arc<MessageType>>,
    ) -> Result<MessageType, DefinitionError> {
        let mut found: Vec<Field> = Vec::new();
        for text in fields {
            let refuse = |reason: &str| DefinitionError {
                type_name: name.to_owned(),
                text: text.to_owned(),
                reason: reason.to_owned(),
            };
            let mut words = text.split_whitespace();
            let (Some(kind), Some(field), None) = (words.next(), words.next(), words.next()) else {
                return Err(refuse("not two words"));
            };
            let (kind, count) = match kind.split_once('[') {
                None => (kind, Count::One),
                Some((kind, "]")) => (kind, Count::Any),
                Some((kind, length)) => {
                    let length = length.strip_suffix(']').and_then(|digits| digits.parse().ok());
                    (kind, Count::Exactly(length.ok_or_else(|| refuse("no length between the brackets"))?))
                }
            };
            if found.iter().any(|other| other.name == field) {
                return Err(refuse("the name is there twice"));
            }
            let kind = Kind::primitive(kind)
                .or_else(|| known(kind).map(Kind::Message))
                .ok_or_else(|| refuse("the type is unknown"))?;
            found.push(Field { name: field.to_owned(), kind, count });
        }
        Ok(MessageType { name: name.to_owned(), fields: found })
    }
}

/// The name as ROS 1 has it: `std_msgs/msg/String`, which newer clients send, is `std_msgs/String`.
pub fn plain_name(name: &str) -> String {
    name.replacen("/msg/", "/", 1)
}

/// The types of `messages.txt`.
static KNOWN: LazyLock<BTreeMap<String, Arc<MessageType>>> = LazyLock::new(|| {
    let mut known: BTreeMap<String, Arc<MessageType>> = BTreeMap::new();
    for line in include_str!("messages.txt").lines().filter(|line| !line.starts_with('#')) {
        let (name, fields) = line.split_once(':').expect("the table is tested line by line");
        let fields = fields.split(',').map(str::trim).filter(|field| !field.is_empty());
        let parsed = MessageType::parse(name, fields, |inner| known.get(inner).cloned())
            .expect("the table is tested line by line");
        known.insert(name.to_owned(), Arc::new(parsed));
    }
    known
});

/// A type that is known without a ROS installation, by its name in either spelling.
pub fn known_type(name: &str) -> Option<Arc<MessageType>> {
    KNOWN.get(&plain_name(name)).cloned()
}

/// All of them, by name.
pub fn known_types() -> impl Iterator<Item = &'static Arc<MessageType>> {
    KNOWN.values()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_is_read_whole_and_keeps_the_order_of_the_fields() {
        assert!(known_types().count() > 60);
        let state = known_type("sensor_msgs/msg/JointState").unwrap();
        let names: Vec<&str> = state.fields.iter().map(|field| field.name.as_str()).collect();
        assert_eq!(names, ["header", "name", "position", "velocity", "effort"]);
        assert_eq!(state.fields[1].count, Count::Any);
        assert_eq!(state.fields[0].kind.name(), "std_msgs/Header");
        assert_eq!(known_type("std_msgs/Nothing"), None);
    }

    #[test]
    fn a_field_that_cannot_be_read_is_named_with_the_reason() {
        for (field, reason) in [
            ("float64", "two words"),
            ("float64 a b", "two words"),
            ("float64[x] a", "length"),
            ("float80 a", "unknown"),
            ("", "two words"),
        ] {
            let error = MessageType::parse("a/B", [field], |_| None).unwrap_err().to_string();
            assert!(error.contains(reason) && error.contains("a/B"), "{field:?}: {error}");
        }
        let error = MessageType::parse("a/B", ["bool a", "bool a"], |_| None).unwrap_err().to_string();
        assert!(error.contains("twice"), "{error}");
    }
}
