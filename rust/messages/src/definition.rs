//! Message types as data: what fields and constants a type has, in ROS's order, and ROS's checksum over them.

use crate::ros2;
use md5::{Digest, Md5};
use std::{
    collections::{BTreeMap, BTreeSet},
    ops::RangeInclusive,
    sync::Arc,
};

/// Between the definitions in a text with dependencies.
const SEPARATOR: &str = "================================================================================";

/// Deepest type in a type: whatever reads or writes a message descends as deep.
const MAX_DEPTH: usize = 32;
/// Most messages, fields and values in a message whose arrays of any length are empty: such a message is made of every type.
pub(crate) const MAX_VALUES: usize = 1_000_000;

/// A message type of ROS 1.
#[derive(Debug, PartialEq)]
pub struct MessageType {
    /// Full name, such as `std_msgs/String`.
    pub name: String,
    /// Constants, in ROS's order. They are not sent.
    pub constants: Vec<Constant>,
    /// Fields in ROS's order.
    pub fields: Vec<MessageField>,
    md5: String,
    /// Messages, fields and values in a message whose arrays of any length are empty.
    value_count: usize,
    differs_in_ros2: bool,
}

/// A constant of a message type.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Constant {
    /// Type, as written.
    pub kind: String,
    /// Name.
    pub name: String,
    /// Value, as written.
    pub value: String,
}

/// A field of a message.
#[derive(Clone, Debug, PartialEq)]
pub struct MessageField {
    /// Name.
    pub name: Arc<str>,
    /// Type of the value, or of each entry of an array.
    pub kind: FieldType,
    /// How many.
    pub count: ArrayKind,
    /// The type as it is written in the definition: `byte` for an `int8`; messages by their full names.
    pub type_text: String,
}

/// The type of a single value.
#[derive(Clone, Debug, PartialEq)]
pub enum FieldType {
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
pub enum ArrayKind {
    /// A single value.
    Single,
    /// An array of any length.
    Variable,
    /// An array of this length.
    Fixed(usize),
}

/// Why a definition cannot be read.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "{type_name}: {text:?} cannot be read: {reason}; expected a field such as \"float64[] data\" or a constant such as \
     \"uint8 FULL=3\""
)]
pub struct DefinitionError {
    /// The type that has the line.
    pub type_name: String,
    /// The line as written.
    pub text: String,
    /// What is wrong with it.
    pub reason: String,
}

impl FieldType {
    /// Name in a message definition.
    pub fn name(&self) -> String {
        match self {
            FieldType::Bool => "bool".to_owned(),
            FieldType::Int { bits, signed } => format!("{}int{bits}", if *signed { "" } else { "u" }),
            FieldType::Float32 => "float32".to_owned(),
            FieldType::Float64 => "float64".to_owned(),
            FieldType::Text => "string".to_owned(),
            FieldType::Time => "time".to_owned(),
            FieldType::Duration => "duration".to_owned(),
            FieldType::Message(inner) => inner.name.clone(),
        }
    }

    /// The numbers that fit a whole number of so many bits.
    pub(crate) fn range(bits: u8, signed: bool) -> RangeInclusive<i128> {
        if signed { -(1i128 << (bits - 1))..=(1i128 << (bits - 1)) - 1 } else { 0..=(1i128 << bits) - 1 }
    }

    fn primitive(name: &str) -> Option<FieldType> {
        Some(match name {
            "bool" => FieldType::Bool,
            "byte" | "int8" => FieldType::Int { bits: 8, signed: true },
            "char" | "uint8" => FieldType::Int { bits: 8, signed: false },
            "int16" => FieldType::Int { bits: 16, signed: true },
            "uint16" => FieldType::Int { bits: 16, signed: false },
            "int32" => FieldType::Int { bits: 32, signed: true },
            "uint32" => FieldType::Int { bits: 32, signed: false },
            "int64" => FieldType::Int { bits: 64, signed: true },
            "uint64" => FieldType::Int { bits: 64, signed: false },
            "float32" => FieldType::Float32,
            "float64" => FieldType::Float64,
            "string" => FieldType::Text,
            "time" => FieldType::Time,
            "duration" => FieldType::Duration,
            _ => return None,
        })
    }
}

impl ArrayKind {
    /// What stands behind the type in a definition.
    pub fn brackets(self) -> String {
        match self {
            ArrayKind::Single => String::new(),
            ArrayKind::Variable => "[]".to_owned(),
            ArrayKind::Fixed(length) => format!("[{length}]"),
        }
    }
}

/// Finds the type of a field by its full name, or says why not.
type TypeLookup<'a> = dyn FnMut(&str) -> Result<Arc<MessageType>, DefinitionError> + 'a;

impl MessageType {
    /// Reads a type from the text of its definition; `source` gives those of the types that it needs, by their full
    /// names.
    ///
    /// # Errors
    /// [`DefinitionError`] with the line that cannot be read, or the type that is nowhere or contains itself.
    pub fn load(
        name: &str,
        text: &str,
        source: &dyn Fn(&str) -> Option<String>,
    ) -> Result<Arc<MessageType>, DefinitionError> {
        Self::load_nested(name, text, source, &mut Vec::new(), &mut BTreeMap::new()).map(Arc::new)
    }

    /// `above` are the types that contain it, `known` those that were read before: each is read once, however many contain
    /// it.
    pub(crate) fn load_nested(
        name: &str,
        text: &str,
        source: &dyn Fn(&str) -> Option<String>,
        above: &mut Vec<String>,
        known: &mut BTreeMap<String, Arc<MessageType>>,
    ) -> Result<MessageType, DefinitionError> {
        above.push(name.to_owned());
        let mut find = |needed: &str| {
            if let Some(known) = known.get(needed) {
                return Ok(Arc::clone(known));
            }
            let refuse = |reason: &str| DefinitionError {
                type_name: name.to_owned(),
                text: needed.to_owned(),
                reason: reason.to_owned(),
            };
            if above.iter().any(|outer| outer == needed) {
                return Err(refuse("it contains itself"));
            }
            if above.len() > MAX_DEPTH {
                return Err(refuse("the types stand too deep in each other"));
            }
            let text = source(needed).ok_or_else(|| refuse("its definition is not there"))?;
            let found = Arc::new(Self::load_nested(needed, &text, source, above, known)?);
            known.insert(needed.to_owned(), Arc::clone(&found));
            Ok(found)
        };
        let parsed = Self::parse(name, text, &mut find);
        above.pop();
        parsed
    }

    /// Reads a type from the text that connections of ROS and bags carry: its definition, then those of the types that
    /// it needs, each after a line of `=` and a line `MSG: package/Name`.
    ///
    /// # Errors
    /// [`DefinitionError`].
    pub fn from_text(name: &str, text: &str) -> Result<Arc<MessageType>, DefinitionError> {
        let mut parts: BTreeMap<&str, String> = BTreeMap::new();
        let mut current = name;
        for line in text.lines() {
            if let Some(next) = line.trim().strip_prefix("MSG:") {
                current = next.trim();
                // A type without fields, such as std_msgs/Empty, has no lines.
                parts.entry(current).or_default();
            } else if !line.starts_with("====") {
                let part = parts.entry(current).or_default();
                part.push_str(line);
                part.push('\n');
            }
        }
        let own = parts.remove(name).unwrap_or_default();
        Self::load(name, &own, &|needed| parts.get(needed).cloned())
    }

    /// Reads the lines of a definition.
    pub(crate) fn parse(
        name: &str,
        text: &str,
        find: &mut TypeLookup<'_>,
    ) -> Result<MessageType, DefinitionError> {
        let (mut constants, mut fields) = (Vec::new(), Vec::<MessageField>::new());
        // The message itself is one; what reads a message counts alike.
        let (mut names, mut parts) = (BTreeSet::new(), 1_usize);
        let mut differs_in_ros2 = name == "std_msgs/Header";
        for line in text.lines() {
            let refuse = |reason: &str| DefinitionError {
                type_name: name.to_owned(),
                text: line.trim().to_owned(),
                reason: reason.to_owned(),
            };
            let plain = line.split('#').next().unwrap_or_default().trim();
            if plain.is_empty() {
                continue;
            }
            if plain.contains('=') {
                // The value of a text goes to the end of the line, `#` and all.
                let whole = if plain.starts_with("string") { line.trim() } else { plain };
                let parts = whole.split_once('=').and_then(|(declared, value)| {
                    let (kind, name) = declared.trim().split_once([' ', '\t'])?;
                    Some(Constant {
                        kind: kind.to_owned(),
                        name: name.trim().to_owned(),
                        value: value.trim().to_owned(),
                    })
                });
                constants.push(parts.ok_or_else(|| refuse("not a type, a name and a value"))?);
                continue;
            }
            let mut words = plain.split_whitespace();
            let (Some(kind), Some(field), None) = (words.next(), words.next(), words.next()) else {
                return Err(refuse("not two words"));
            };
            let (kind, count) = match kind.split_once('[') {
                None => (kind, ArrayKind::Single),
                Some((kind, "]")) => (kind, ArrayKind::Variable),
                Some((kind, length)) => {
                    let length = length.strip_suffix(']').and_then(|digits| digits.parse().ok());
                    (kind, ArrayKind::Fixed(length.ok_or_else(|| refuse("no length between the brackets"))?))
                }
            };
            if !names.insert(field) {
                return Err(refuse("the name is there twice"));
            }
            let (kind, written) = match FieldType::primitive(kind) {
                Some(primitive) => (primitive, kind.to_owned()),
                None => {
                    let full = full_name(kind, name);
                    (FieldType::Message(find(&full)?), full)
                }
            };
            let of_one = if let FieldType::Message(inner) = &kind { inner.value_count } else { 1 };
            let nested = match count {
                ArrayKind::Single => of_one,
                ArrayKind::Variable => 0,
                ArrayKind::Fixed(length) => of_one.saturating_mul(length),
            };
            parts = parts.saturating_add(nested).saturating_add(1);
            if parts > MAX_VALUES {
                return Err(refuse("with it an empty message has more than a million values"));
            }
            differs_in_ros2 |= ros2::field_differs(name, field, &kind);
            fields.push(MessageField { name: field.into(), kind, count, type_text: written });
        }
        let md5 = hexadecimal(Md5::new_with_prefix(checksum_text(&constants, &fields)));
        Ok(MessageType { name: name.to_owned(), constants, fields, md5, value_count: parts, differs_in_ros2 })
    }

    /// Whether its messages are written differently as ROS 2 has them.
    pub fn differs_in_ros2(&self) -> bool {
        self.differs_in_ros2
    }

    /// ROS's checksum over the type and those that it needs, in hexadecimal.
    pub fn md5(&self) -> &str {
        &self.md5
    }

    /// What the checksum is made of.
    pub(crate) fn checksum_text(&self) -> String {
        checksum_text(&self.constants, &self.fields)
    }

    /// The types that it needs, each once, in the order in which they are met.
    pub fn dependencies(&self) -> Vec<&Arc<MessageType>> {
        let mut found = Vec::new();
        self.collect_dependencies(&mut found);
        found
    }

    fn collect_dependencies<'a>(&'a self, found: &mut Vec<&'a Arc<MessageType>>) {
        for field in &self.fields {
            if let FieldType::Message(inner) = &field.kind
                && !found.iter().any(|known| known.name == inner.name)
            {
                found.push(inner);
                inner.collect_dependencies(found);
            }
        }
    }

    /// Its definition without comments, then those of the types that it needs: what [`MessageType::from_text`] reads.
    pub fn full_text(&self) -> String {
        let others =
            self.dependencies().into_iter().map(|inner| (inner.name.as_str(), inner.definition_text()));
        join_texts(self.definition_text(), others)
    }

    fn definition_text(&self) -> String {
        let constants = self.constants.iter().map(|c| format!("{} {}={}\n", c.kind, c.name, c.value));
        let fields =
            self.fields.iter().map(|f| format!("{}{} {}\n", f.type_text, f.count.brackets(), f.name));
        constants.chain(fields).collect()
    }

    /// The definition in `own`, then those that `source` has of the types that it needs, comments and all.
    pub fn full_text_from(&self, own: &str, source: &dyn Fn(&str) -> Option<String>) -> String {
        let whole = |text: &str| text.trim_end().to_owned() + "\n";
        let others = self.dependencies().into_iter().map(|inner| {
            (inner.name.as_str(), source(&inner.name).map_or(inner.definition_text(), |t| whole(&t)))
        });
        join_texts(whole(own), others)
    }
}

fn join_texts<'a>(mut text: String, others: impl Iterator<Item = (&'a str, String)>) -> String {
    for (name, definition) in others {
        text += &format!("{SEPARATOR}\nMSG: {name}\n{definition}");
    }
    text
}

/// The full name of a type that a definition of `of` names.
fn full_name(kind: &str, of: &str) -> String {
    match kind {
        "Header" => "std_msgs/Header".to_owned(),
        full if full.contains('/') => full.to_owned(),
        local => format!("{}/{local}", of.split('/').next().unwrap_or_default()),
    }
}

/// By ROS's rule: the constants, then the fields, with checksums for the types of messages, which lose their brackets.
fn checksum_text(constants: &[Constant], fields: &[MessageField]) -> String {
    let constants = constants.iter().map(|c| format!("{} {}={}", c.kind, c.name, c.value));
    let fields = fields.iter().map(|field| match &field.kind {
        FieldType::Message(inner) => format!("{} {}", inner.md5, field.name),
        _ => format!("{}{} {}", field.type_text, field.count.brackets(), field.name),
    });
    constants.chain(fields).collect::<Vec<_>>().join("\n")
}

pub(crate) fn hexadecimal(sum: Md5) -> String {
    sum.finalize().iter().map(|byte| format!("{byte:02x}")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::builtin_type;

    #[test]
    fn a_text_with_its_dependencies_becomes_a_type_and_the_text_again() {
        let text = "# a comment\nHeader header\nint8 UP=1 # a constant\nstring NAME= a # b\nPoint[] points # there\n\
            float32[2] ends\nbyte level\n================\nMSG: std_msgs/Header\nuint32 seq\ntime stamp\nstring frame_id\n\
            ================\nMSG: lab_msgs/Point\nfloat64 x\n";
        let kind = MessageType::from_text("lab_msgs/Path", text).unwrap();
        let names: Vec<&str> = kind.fields.iter().map(|f| &*f.name).collect();
        assert_eq!(names, ["header", "points", "ends", "level"]);
        assert_eq!(kind.fields[1].kind.name(), "lab_msgs/Point");
        assert_eq!(kind.constants[1].value, "a # b");
        let expected = format!(
            "int8 UP=1\nstring NAME=a # b\nstd_msgs/Header header\nlab_msgs/Point[] points\nfloat32[2] ends\nbyte level\n\
             {SEPARATOR}\nMSG: std_msgs/Header\nuint32 seq\ntime stamp\nstring frame_id\n{SEPARATOR}\nMSG: lab_msgs/Point\nfloat64 x\n"
        );
        assert_eq!(kind.full_text(), expected);
        assert_eq!(MessageType::from_text("lab_msgs/Path", &expected).unwrap(), kind);
    }

    #[test]
    fn a_definition_names_each_type_that_it_needs_once() {
        let text = builtin_type("geometry_msgs/PoseStamped").unwrap().full_text();
        for needed in
            ["std_msgs/Header", "geometry_msgs/Pose", "geometry_msgs/Point", "geometry_msgs/Quaternion"]
        {
            assert_eq!(text.matches(&format!("MSG: {needed}\n")).count(), 1, "{text}");
        }
        assert!(!text.contains("MSG: geometry_msgs/PoseStamped"), "{text}");
    }

    #[test]
    fn a_line_that_cannot_be_read_is_named_with_the_reason() {
        for (line, reason) in [
            ("float64", "two words"),
            ("float64 a b", "two words"),
            ("float64[x] a", "length"),
            ("float80 a", "not there"),
            ("a/C c", "not there"),
            ("B b", "contains itself"),
            ("uint8=3", "a name and a value"),
            ("bool a\nbool a", "twice"),
        ] {
            let error = MessageType::from_text("a/B", line).unwrap_err().to_string();
            assert!(error.contains(reason) && error.contains("a/B"), "{line:?}: {error}");
        }
    }

    #[test]
    fn types_that_announce_more_than_memory_holds_are_refused() {
        let refused = |text: &str| MessageType::from_text("a/B", text).unwrap_err().to_string();
        assert!(refused("float64[4294967295] x").contains("more than a million values"));
        let nested = |n: usize| format!("{SEPARATOR}\nMSG: a/T{n}\nT{}[500] t\n", n + 1);
        let text = format!("T0 t\n{}{}{SEPARATOR}\nMSG: a/T2\nbool x\n", nested(0), nested(1));
        assert!(MessageType::from_text("a/B", &text).is_ok(), "a quarter of a million times one");
        assert!(refused(&text.replace("bool x", "bool x\nbool y")).contains("more than a million values"));
        let deep: String = (0..1000).map(|n| format!("{SEPARATOR}\nMSG: a/T{n}\nT{} t\n", n + 1)).collect();
        assert!(refused(&format!("T0 t\n{deep}")).contains("too deep in each other"));
    }

    #[test]
    fn a_type_that_many_others_contain_is_read_once() {
        // Each contains all that follow: read anew for each, they would be two to the power of thirty.
        let fields = |from: usize| (from..30).map(|n| format!("T{n}[] t{n}\n")).collect::<String>();
        let types: String =
            (0..30).map(|n| format!("{SEPARATOR}\nMSG: a/T{n}\nbool x\n{}", fields(n + 1))).collect();
        let kind = MessageType::from_text("a/B", &(fields(0) + &types)).unwrap();
        assert_eq!(kind.dependencies().len(), 30);
    }

    #[test]
    fn types_that_contain_each_other_are_refused() {
        let text = format!("C c\n{SEPARATOR}\nMSG: a/C\nB b\n");
        let error = MessageType::from_text("a/B", &text).unwrap_err().to_string();
        assert!(error.contains("contains itself"), "{error}");
    }
}
