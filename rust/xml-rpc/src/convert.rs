//! Values to types of Rust and back.

use crate::{
    error::{Error, Result},
    value::{Params, Value},
};
use serde::{
    Deserialize, Deserializer, Serialize,
    de::{
        Error as _, IntoDeserializer, Visitor,
        value::{MapDeserializer, SeqDeserializer},
    },
    forward_to_deserialize_any,
};
use serde_json::Value as Json;

/// What a call brought, as a type of Rust: a single value, or several as a tuple.
///
/// # Errors
/// [`Error::Value`].
pub fn from_params<'a, T: Deserialize<'a>>(mut params: Params) -> Result<T> {
    match (params.len(), params.pop()) {
        (1, Some(value)) => T::deserialize(value),
        (_, last) => {
            params.extend(last);
            T::deserialize(Value::Array(params))
        }
    }
}

/// The arguments of a call; a tuple is several.
///
/// # Errors
/// [`Error::Value`] for what XML-RPC has no type for.
pub fn into_params<T: Serialize>(value: &T) -> Result<Params> {
    let json = serde_json::to_value(value).map_err(|error| Error::Value { what: error.to_string() })?;
    Ok(match from_json(json)? {
        Value::Array(params) => params,
        single => vec![single],
    })
}

fn from_json(json: Json) -> Result<Value> {
    Ok(match json {
        // No value is written as an array without any.
        Json::Null => Value::Array(Vec::new()),
        Json::Bool(yes) => Value::Bool(yes),
        Json::String(text) => Value::String(text),
        Json::Array(values) => Value::Array(values.into_iter().map(from_json).collect::<Result<_>>()?),
        Json::Object(members) => {
            let member = |(name, value)| Ok((name, from_json(value)?));
            Value::Struct(members.into_iter().map(member).collect::<Result<_>>()?)
        }
        Json::Number(number) => match (number.as_i64(), number.as_f64()) {
            (Some(n), _) => Value::Int(i32::try_from(n).map_err(|_| Error::Value {
                what: format!("{n} is too large a number, expected one of 32 bits"),
            })?),
            (None, Some(x)) if number.is_f64() => Value::Double(x),
            _ => {
                return Err(Error::Value {
                    what: format!("{number} is too large a number, expected one of 32 bits"),
                });
            }
        },
    })
}

/// Numbers may come as texts: roslaunch and rosparam are lax with types.
macro_rules! lax_numbers {
    ($($method:ident $number:ty, $visit:ident;)*) => {$(
        fn $method<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value> {
            match &self {
                Value::String(text) => match text.trim().parse::<$number>() {
                    Ok(number) => visitor.$visit(number),
                    Err(_) => Err(Error::custom(format!("{text:?} is no number, expected one"))),
                },
                _ => self.deserialize_any(visitor),
            }
        }
    )*};
}

impl<'de> Deserializer<'de> for Value {
    type Error = Error;

    fn deserialize_any<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value> {
        match self {
            Value::Int(n) => visitor.visit_i32(n),
            Value::Bool(yes) => visitor.visit_bool(yes),
            Value::Double(x) => visitor.visit_f64(x),
            Value::String(text) | Value::DateTime(text) => visitor.visit_string(text),
            Value::Base64(bytes) => visitor.visit_byte_buf(bytes),
            Value::Array(values) => {
                let mut values = SeqDeserializer::new(values.into_iter());
                let result = visitor.visit_seq(&mut values)?;
                values.end()?;
                Ok(result)
            }
            Value::Struct(members) => {
                let mut members = MapDeserializer::new(members.into_iter());
                let result = visitor.visit_map(&mut members)?;
                members.end()?;
                Ok(result)
            }
        }
    }

    lax_numbers! {
        deserialize_bool bool, visit_bool;
        deserialize_i8 i8, visit_i8;
        deserialize_i16 i16, visit_i16;
        deserialize_i32 i32, visit_i32;
        deserialize_i64 i64, visit_i64;
        deserialize_u8 u8, visit_u8;
        deserialize_u16 u16, visit_u16;
        deserialize_u32 u32, visit_u32;
        deserialize_u64 u64, visit_u64;
        deserialize_f32 f32, visit_f32;
        deserialize_f64 f64, visit_f64;
    }

    fn deserialize_option<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value> {
        match self {
            Value::Array(values) if values.is_empty() => visitor.visit_none(),
            Value::Array(mut values) if values.len() == 1 => visitor.visit_some(values.remove(0)),
            other => visitor.visit_some(other),
        }
    }

    fn deserialize_newtype_struct<V: Visitor<'de>>(self, _: &'static str, visitor: V) -> Result<V::Value> {
        visitor.visit_newtype_struct(self)
    }

    forward_to_deserialize_any! {
        i128 u128 char str string bytes byte_buf unit unit_struct seq tuple tuple_struct map struct enum identifier
        ignored_any
    }
}

impl<'de> IntoDeserializer<'de, Error> for Value {
    type Deserializer = Value;

    fn into_deserializer(self) -> Value {
        self
    }
}
