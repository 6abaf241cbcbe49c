//! A serialiser of serde's that a definition guides: it writes a [`Value`](crate::Value) or a struct alike.

use super::WireError;
use crate::definition::{Count, Kind, MessageField, MessageType};
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
        let kind = Kind::Message(Arc::clone(self));
        let slot = Slot { kind: &kind, count: Count::One, to };
        message.serialize(slot).map_err(|error| match error {
            // What serde says of a value that no bytes can hold.
            WireError::Mismatch { path, got, expected } if path.is_empty() && expected.is_empty() => {
                WireError::Mismatch { path: self.name.clone(), got, expected: self.name.clone() }
            }
            other => other.within(&self.name),
        })
    }
}

impl Error for WireError {
    fn custom<T: Display>(reason: T) -> Self {
        WireError::Mismatch { path: String::new(), got: reason.to_string(), expected: String::new() }
    }
}

/// What `time` and `duration` consist of.
static TIME: LazyLock<Vec<MessageField>> = LazyLock::new(|| parts_of("uint32"));
static DURATION: LazyLock<Vec<MessageField>> = LazyLock::new(|| parts_of("int32"));

fn parts_of(whole: &str) -> Vec<MessageField> {
    let kind = Kind::Int { bits: 32, signed: whole == "int32" };
    let part = |name: &str| MessageField {
        name: name.into(),
        kind: kind.clone(),
        count: Count::One,
        written: whole.into(),
    };
    vec![part("secs"), part("nsecs")]
}

/// Where a value goes.
struct Slot<'a> {
    kind: &'a Kind,
    count: Count,
    to: &'a mut Vec<u8>,
}

impl<'a> Slot<'a> {
    fn refuse<T>(&self, got: impl Display) -> Result<T, WireError> {
        let mut got = got.to_string();
        if got.chars().count() > 60 {
            got = got.chars().take(57).collect::<String>() + "...";
        }
        let expected = self.kind.name() + &self.count.brackets();
        Err(WireError::Mismatch { path: String::new(), got, expected })
    }

    fn whole(self, number: impl Into<i128>) -> Result<(), WireError> {
        let number: i128 = number.into();
        match (self.kind, self.count) {
            (Kind::Int { bits, signed }, Count::One) if Kind::range(*bits, *signed).contains(&number) => {
                self.to.extend_from_slice(&number.to_le_bytes()[..usize::from(bits / 8)]);
                Ok(())
            }
            _ => self.refuse(number),
        }
    }

    fn length(&mut self, length: usize) -> Result<(), WireError> {
        match (self.count, u32::try_from(length)) {
            (Count::Any, Ok(length)) => self.to.extend_from_slice(&length.to_le_bytes()),
            (Count::Exactly(expected), _) if expected == length => {}
            _ => return self.refuse(format!("an array of {length}")),
        }
        Ok(())
    }

    fn elements(mut self, length: usize) -> Result<Elements<'a>, WireError> {
        self.length(length)?;
        Ok(Elements { kind: self.kind, number: 0, to: self.to })
    }

    fn parts(self) -> Result<Parts<'a>, WireError> {
        let fields = match (self.kind, self.count) {
            (Kind::Message(inner), Count::One) => &inner.fields,
            (Kind::Time, Count::One) => &*TIME,
            (Kind::Duration, Count::One) => &*DURATION,
            _ => return self.refuse("a message"),
        };
        Ok(Parts { fields, next: 0, to: self.to })
    }
}

impl<'a> Serializer for Slot<'a> {
    type Ok = ();
    type Error = WireError;
    type SerializeSeq = Elements<'a>;
    type SerializeTuple = Elements<'a>;
    type SerializeTupleStruct = Impossible<(), WireError>;
    type SerializeTupleVariant = Impossible<(), WireError>;
    type SerializeMap = Parts<'a>;
    type SerializeStruct = Parts<'a>;
    type SerializeStructVariant = Impossible<(), WireError>;

    fn is_human_readable(&self) -> bool {
        false
    }

    fn serialize_bool(self, value: bool) -> Result<(), WireError> {
        match (self.kind, self.count) {
            (Kind::Bool, Count::One) => {
                self.to.push(u8::from(value));
                Ok(())
            }
            _ => self.refuse(value),
        }
    }

    fn serialize_i8(self, value: i8) -> Result<(), WireError> {
        self.whole(value)
    }

    fn serialize_i16(self, value: i16) -> Result<(), WireError> {
        self.whole(value)
    }

    fn serialize_i32(self, value: i32) -> Result<(), WireError> {
        self.whole(value)
    }

    fn serialize_i64(self, value: i64) -> Result<(), WireError> {
        self.whole(value)
    }

    fn serialize_u8(self, value: u8) -> Result<(), WireError> {
        self.whole(value)
    }

    fn serialize_u16(self, value: u16) -> Result<(), WireError> {
        self.whole(value)
    }

    fn serialize_u32(self, value: u32) -> Result<(), WireError> {
        self.whole(value)
    }

    fn serialize_u64(self, value: u64) -> Result<(), WireError> {
        self.whole(value)
    }

    fn serialize_f32(self, value: f32) -> Result<(), WireError> {
        self.serialize_f64(value.into())
    }

    fn serialize_f64(self, value: f64) -> Result<(), WireError> {
        match (self.kind, self.count) {
            (Kind::Float64, Count::One) => self.to.extend_from_slice(&value.to_le_bytes()),
            // ROS rounds to the nearest too.
            (Kind::Float32, Count::One) => self.to.extend_from_slice(&(value as f32).to_le_bytes()),
            _ => return self.refuse(value),
        }
        Ok(())
    }

    fn serialize_char(self, value: char) -> Result<(), WireError> {
        self.refuse(format!("{value:?}"))
    }

    fn serialize_str(mut self, value: &str) -> Result<(), WireError> {
        if !matches!((self.kind, self.count), (Kind::Text, Count::One)) {
            return self.refuse(format!("{value:?}"));
        }
        // A text is an array of its bytes.
        self.count = Count::Any;
        self.length(value.len())?;
        self.to.extend_from_slice(value.as_bytes());
        Ok(())
    }

    fn serialize_bytes(mut self, value: &[u8]) -> Result<(), WireError> {
        if !matches!(self.kind, Kind::Int { bits: 8, signed: false }) {
            return self.refuse(format!("{} bytes", value.len()));
        }
        self.length(value.len())?;
        self.to.extend_from_slice(value);
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

    fn serialize_seq(self, length: Option<usize>) -> Result<Elements<'a>, WireError> {
        match length {
            Some(length) => self.elements(length),
            None => self.refuse("an array whose length is not known before"),
        }
    }

    fn serialize_tuple(self, length: usize) -> Result<Elements<'a>, WireError> {
        self.elements(length)
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

    fn serialize_map(self, _: Option<usize>) -> Result<Parts<'a>, WireError> {
        self.parts()
    }

    fn serialize_struct(self, _: &'static str, _: usize) -> Result<Parts<'a>, WireError> {
        self.parts()
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
struct Elements<'a> {
    kind: &'a Kind,
    number: usize,
    to: &'a mut Vec<u8>,
}

impl SerializeSeq for Elements<'_> {
    type Ok = ();
    type Error = WireError;

    fn serialize_element<T: Serialize + ?Sized>(&mut self, value: &T) -> Result<(), WireError> {
        let slot = Slot { kind: self.kind, count: Count::One, to: &mut *self.to };
        value.serialize(slot).map_err(|error| error.within(&format!("[{}]", self.number)))?;
        self.number += 1;
        Ok(())
    }

    fn end(self) -> Result<(), WireError> {
        Ok(())
    }
}

impl SerializeTuple for Elements<'_> {
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
struct Parts<'a> {
    fields: &'a [MessageField],
    next: usize,
    to: &'a mut Vec<u8>,
}

impl<'a> Parts<'a> {
    /// The next field, if that is its name.
    fn named(&self, name: &str) -> Result<&'a MessageField, WireError> {
        let expected = match self.fields.get(self.next) {
            Some(field) if &*field.name == name => return Ok(field),
            Some(field) => format!("{:?}", field.name),
            None => "no more fields".to_owned(),
        };
        Err(WireError::Mismatch { path: name.to_owned(), got: format!("the field {name:?}"), expected })
    }

    fn put<T: Serialize + ?Sized>(&mut self, field: &'a MessageField, value: &T) -> Result<(), WireError> {
        self.next += 1;
        let slot = Slot { kind: &field.kind, count: field.count, to: &mut *self.to };
        value.serialize(slot).map_err(|error| error.within(&field.name))
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

impl SerializeStruct for Parts<'_> {
    type Ok = ();
    type Error = WireError;

    fn serialize_field<T: Serialize + ?Sized>(
        &mut self,
        name: &'static str,
        value: &T,
    ) -> Result<(), WireError> {
        let field = self.named(name)?;
        self.put(field, value)
    }

    fn end(self) -> Result<(), WireError> {
        self.finish()
    }
}

impl SerializeMap for Parts<'_> {
    type Ok = ();
    type Error = WireError;

    fn serialize_key<T: Serialize + ?Sized>(&mut self, name: &T) -> Result<(), WireError> {
        // serde gives no text but what is written: it is written behind the message, looked at, and taken away.
        let start = self.to.len();
        name.serialize(Slot { kind: &Kind::Text, count: Count::One, to: &mut *self.to })?;
        let name = String::from_utf8_lossy(&self.to[start + 4..]);
        let found = self.named(&name).map(|_| ());
        self.to.truncate(start);
        found
    }

    fn serialize_value<T: Serialize + ?Sized>(&mut self, value: &T) -> Result<(), WireError> {
        let Some(field) = self.fields.get(self.next) else {
            return Err(WireError::custom("a value without a key"));
        };
        self.put(field, value)
    }

    fn end(self) -> Result<(), WireError> {
        self.finish()
    }
}
