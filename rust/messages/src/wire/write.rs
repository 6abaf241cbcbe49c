//! A serialiser of serde's that a definition guides: it writes a [`MessageValue`](crate::Value) or a struct alike.

use super::WireError;
use crate::definition::{ArrayKind, FieldType, MessageField, MessageType};
use serde::ser::{
    Error, Impossible, Serialize, SerializeMap, SerializeSeq, SerializeStruct, SerializeTuple, Serializer,
};
use std::{
    fmt::Display,
    sync::{Arc, LazyLock},
};

impl MessageType {
    /// The message as bytes, without its length before it.
    ///
    /// # Errors
    /// [`WireError::Mismatch`] for a value or a struct whose fields are not those of this type, in its order.
    pub fn to_bytes(self: &Arc<Self>, message: &impl Serialize) -> Result<Vec<u8>, WireError> {
        let mut bytes = Vec::new();
        self.write(message, &mut bytes)?;
        Ok(bytes)
    }

    /// Appends the message, without its length before it.
    ///
    /// # Errors
    /// As [`MessageType::to_bytes`]; what was appended until then stays.
    pub fn write(self: &Arc<Self>, message: &impl Serialize, to: &mut Vec<u8>) -> Result<(), WireError> {
        let kind = FieldType::Message(Arc::clone(self));
        let slot = ValueSerializer { kind: &kind, count: ArrayKind::Single, out: to };
        message.serialize(slot).map_err(|error| match error {
            // What serde says of a value that no bytes can hold.
            WireError::Mismatch { path, got, expected } if path.is_empty() && expected.is_empty() => {
                WireError::Mismatch { path: self.name.clone(), got, expected: self.name.clone() }
            }
            other => other.in_field(&self.name),
        })
    }
}

impl Error for WireError {
    fn custom<T: Display>(reason: T) -> Self {
        WireError::Mismatch { path: String::new(), got: reason.to_string(), expected: String::new() }
    }
}

/// What `time` and `duration` consist of.
static TIME: LazyLock<Vec<MessageField>> = LazyLock::new(|| time_fields("uint32"));
static DURATION: LazyLock<Vec<MessageField>> = LazyLock::new(|| time_fields("int32"));

fn time_fields(whole: &str) -> Vec<MessageField> {
    let kind = FieldType::Int { bits: 32, signed: whole == "int32" };
    let part = |name: &str| MessageField {
        name: name.into(),
        kind: kind.clone(),
        count: ArrayKind::Single,
        type_text: whole.into(),
    };
    vec![part("secs"), part("nsecs")]
}

/// Where a value goes.
struct ValueSerializer<'a> {
    kind: &'a FieldType,
    count: ArrayKind,
    out: &'a mut Vec<u8>,
}

impl<'a> ValueSerializer<'a> {
    fn refuse<T>(&self, got: impl Display) -> Result<T, WireError> {
        let mut got = got.to_string();
        if got.chars().count() > 60 {
            got = got.chars().take(57).collect::<String>() + "...";
        }
        let expected = self.kind.name() + &self.count.brackets();
        Err(WireError::Mismatch { path: String::new(), got, expected })
    }

    fn serialize_integer(self, number: impl Into<i128>) -> Result<(), WireError> {
        let number: i128 = number.into();
        match (self.kind, self.count) {
            (FieldType::Int { bits, signed }, ArrayKind::Single)
                if FieldType::range(*bits, *signed).contains(&number) =>
            {
                self.out.extend_from_slice(&number.to_le_bytes()[..usize::from(bits / 8)]);
                Ok(())
            }
            _ => self.refuse(number),
        }
    }

    fn write_length(&mut self, length: usize) -> Result<(), WireError> {
        match (self.count, u32::try_from(length)) {
            (ArrayKind::Variable, Ok(length)) => self.out.extend_from_slice(&length.to_le_bytes()),
            (ArrayKind::Fixed(expected), _) if expected == length => {}
            _ => return self.refuse(format!("an array of {length}")),
        }
        Ok(())
    }

    fn array_serializer(mut self, length: usize) -> Result<ArraySerializer<'a>, WireError> {
        self.write_length(length)?;
        Ok(ArraySerializer { kind: self.kind, index: 0, out: self.out })
    }

    fn message_serializer(self) -> Result<MessageSerializer<'a>, WireError> {
        let fields = match (self.kind, self.count) {
            (FieldType::Message(inner), ArrayKind::Single) => &inner.fields,
            (FieldType::Time, ArrayKind::Single) => &*TIME,
            (FieldType::Duration, ArrayKind::Single) => &*DURATION,
            _ => return self.refuse("a message"),
        };
        Ok(MessageSerializer { fields, next: 0, out: self.out })
    }
}

impl<'a> Serializer for ValueSerializer<'a> {
    type Ok = ();
    type Error = WireError;
    type SerializeSeq = ArraySerializer<'a>;
    type SerializeTuple = ArraySerializer<'a>;
    type SerializeTupleStruct = Impossible<(), WireError>;
    type SerializeTupleVariant = Impossible<(), WireError>;
    type SerializeMap = MessageSerializer<'a>;
    type SerializeStruct = MessageSerializer<'a>;
    type SerializeStructVariant = Impossible<(), WireError>;

    fn is_human_readable(&self) -> bool {
        false
    }

    fn serialize_bool(self, value: bool) -> Result<(), WireError> {
        match (self.kind, self.count) {
            (FieldType::Bool, ArrayKind::Single) => {
                self.out.push(u8::from(value));
                Ok(())
            }
            _ => self.refuse(value),
        }
    }

    fn serialize_i8(self, value: i8) -> Result<(), WireError> {
        self.serialize_integer(value)
    }

    fn serialize_i16(self, value: i16) -> Result<(), WireError> {
        self.serialize_integer(value)
    }

    fn serialize_i32(self, value: i32) -> Result<(), WireError> {
        self.serialize_integer(value)
    }

    fn serialize_i64(self, value: i64) -> Result<(), WireError> {
        self.serialize_integer(value)
    }

    fn serialize_u8(self, value: u8) -> Result<(), WireError> {
        self.serialize_integer(value)
    }

    fn serialize_u16(self, value: u16) -> Result<(), WireError> {
        self.serialize_integer(value)
    }

    fn serialize_u32(self, value: u32) -> Result<(), WireError> {
        self.serialize_integer(value)
    }

    fn serialize_u64(self, value: u64) -> Result<(), WireError> {
        self.serialize_integer(value)
    }

    fn serialize_f32(self, value: f32) -> Result<(), WireError> {
        self.serialize_f64(value.into())
    }

    fn serialize_f64(self, value: f64) -> Result<(), WireError> {
        match (self.kind, self.count) {
            (FieldType::Float64, ArrayKind::Single) => self.out.extend_from_slice(&value.to_le_bytes()),
            // ROS rounds to the nearest too.
            (FieldType::Float32, ArrayKind::Single) => {
                self.out.extend_from_slice(&(value as f32).to_le_bytes())
            }
            _ => return self.refuse(value),
        }
        Ok(())
    }

    fn serialize_char(self, value: char) -> Result<(), WireError> {
        self.refuse(format!("{value:?}"))
    }

    fn serialize_str(mut self, value: &str) -> Result<(), WireError> {
        if !matches!((self.kind, self.count), (FieldType::Text, ArrayKind::Single)) {
            return self.refuse(format!("{value:?}"));
        }
        // A text is an array of its bytes.
        self.count = ArrayKind::Variable;
        self.write_length(value.len())?;
        self.out.extend_from_slice(value.as_bytes());
        Ok(())
    }

    fn serialize_bytes(mut self, value: &[u8]) -> Result<(), WireError> {
        if !matches!(self.kind, FieldType::Int { bits: 8, signed: false }) {
            return self.refuse(format!("{} bytes", value.len()));
        }
        self.write_length(value.len())?;
        self.out.extend_from_slice(value);
        Ok(())
    }

    fn serialize_none(self) -> Result<(), WireError> {
        self.refuse("nothing")
    }

    fn serialize_some<T: Serialize + ?Sized>(self, value: &T) -> Result<(), WireError> {
        value.serialize(self)
    }

    fn serialize_unit(self) -> Result<(), WireError> {
        self.refuse("nothing")
    }

    fn serialize_unit_struct(self, name: &'static str) -> Result<(), WireError> {
        self.refuse(name)
    }

    fn serialize_unit_variant(self, name: &'static str, _: u32, _: &'static str) -> Result<(), WireError> {
        self.refuse(name)
    }

    fn serialize_newtype_struct<T: Serialize + ?Sized>(
        self,
        _: &'static str,
        value: &T,
    ) -> Result<(), WireError> {
        value.serialize(self)
    }

    fn serialize_newtype_variant<T: Serialize + ?Sized>(
        self,
        name: &'static str,
        _: u32,
        _: &'static str,
        _: &T,
    ) -> Result<(), WireError> {
        self.refuse(name)
    }

    fn serialize_seq(self, length: Option<usize>) -> Result<ArraySerializer<'a>, WireError> {
        match length {
            Some(length) => self.array_serializer(length),
            None => self.refuse("an array whose length is not known before"),
        }
    }

    fn serialize_tuple(self, length: usize) -> Result<ArraySerializer<'a>, WireError> {
        self.array_serializer(length)
    }

    fn serialize_tuple_struct(
        self,
        name: &'static str,
        _: usize,
    ) -> Result<Self::SerializeTupleStruct, WireError> {
        self.refuse(name)
    }

    fn serialize_tuple_variant(
        self,
        name: &'static str,
        _: u32,
        _: &'static str,
        _: usize,
    ) -> Result<Self::SerializeTupleVariant, WireError> {
        self.refuse(name)
    }

    fn serialize_map(self, _: Option<usize>) -> Result<MessageSerializer<'a>, WireError> {
        self.message_serializer()
    }

    fn serialize_struct(self, _: &'static str, _: usize) -> Result<MessageSerializer<'a>, WireError> {
        self.message_serializer()
    }

    fn serialize_struct_variant(
        self,
        name: &'static str,
        _: u32,
        _: &'static str,
        _: usize,
    ) -> Result<Self::SerializeStructVariant, WireError> {
        self.refuse(name)
    }
}

/// The entries of an array.
struct ArraySerializer<'a> {
    kind: &'a FieldType,
    index: usize,
    out: &'a mut Vec<u8>,
}

impl SerializeSeq for ArraySerializer<'_> {
    type Ok = ();
    type Error = WireError;

    fn serialize_element<T: Serialize + ?Sized>(&mut self, value: &T) -> Result<(), WireError> {
        let slot = ValueSerializer { kind: self.kind, count: ArrayKind::Single, out: &mut *self.out };
        value.serialize(slot).map_err(|error| error.in_field(&format!("[{}]", self.index)))?;
        self.index += 1;
        Ok(())
    }

    fn end(self) -> Result<(), WireError> {
        Ok(())
    }
}

impl SerializeTuple for ArraySerializer<'_> {
    type Ok = ();
    type Error = WireError;

    fn serialize_element<T: Serialize + ?Sized>(&mut self, value: &T) -> Result<(), WireError> {
        SerializeSeq::serialize_element(self, value)
    }

    fn end(self) -> Result<(), WireError> {
        Ok(())
    }
}

/// The fields of a message, a time or a duration.
struct MessageSerializer<'a> {
    fields: &'a [MessageField],
    next: usize,
    out: &'a mut Vec<u8>,
}

impl<'a> MessageSerializer<'a> {
    /// The next field, if that is its name.
    fn expect_field(&self, name: &str) -> Result<&'a MessageField, WireError> {
        let expected = match self.fields.get(self.next) {
            Some(field) if &*field.name == name => return Ok(field),
            Some(field) => format!("{:?}", field.name),
            None => "no more fields".to_owned(),
        };
        Err(WireError::Mismatch { path: name.to_owned(), got: format!("the field {name:?}"), expected })
    }

    fn write_field<T: Serialize + ?Sized>(
        &mut self,
        field: &'a MessageField,
        value: &T,
    ) -> Result<(), WireError> {
        self.next += 1;
        let slot = ValueSerializer { kind: &field.kind, count: field.count, out: &mut *self.out };
        value.serialize(slot).map_err(|error| error.in_field(&field.name))
    }

    fn finish(self) -> Result<(), WireError> {
        let Some(missing) = self.fields.get(self.next) else { return Ok(()) };
        let plural = if self.next == 1 { "" } else { "s" };
        Err(WireError::Mismatch {
            path: String::new(),
            got: format!("a message of {} field{plural}", self.next),
            expected: format!("the field {:?} too", missing.name),
        })
    }
}

impl SerializeStruct for MessageSerializer<'_> {
    type Ok = ();
    type Error = WireError;

    fn serialize_field<T: Serialize + ?Sized>(
        &mut self,
        name: &'static str,
        value: &T,
    ) -> Result<(), WireError> {
        let field = self.expect_field(name)?;
        self.write_field(field, value)
    }

    fn end(self) -> Result<(), WireError> {
        self.finish()
    }
}

impl SerializeMap for MessageSerializer<'_> {
    type Ok = ();
    type Error = WireError;

    fn serialize_key<T: Serialize + ?Sized>(&mut self, name: &T) -> Result<(), WireError> {
        // serde gives no text but what is written: it is written behind the message, looked at, and taken away.
        let start = self.out.len();
        name.serialize(ValueSerializer {
            kind: &FieldType::Text,
            count: ArrayKind::Single,
            out: &mut *self.out,
        })?;
        let name = String::from_utf8_lossy(&self.out[start + 4..]);
        let found = self.expect_field(&name).map(|_| ());
        self.out.truncate(start);
        found
    }

    fn serialize_value<T: Serialize + ?Sized>(&mut self, value: &T) -> Result<(), WireError> {
        let Some(field) = self.fields.get(self.next) else {
            return Err(WireError::custom("a value without a key"));
        };
        self.write_field(field, value)
    }

    fn end(self) -> Result<(), WireError> {
        self.finish()
    }
}
