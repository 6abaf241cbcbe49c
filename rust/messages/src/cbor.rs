//! Messages as CBOR (RFC 8949), with arrays of numbers as typed arrays (RFC 8746), little endian.

use crate::{
    definition::{Count, Kind, MessageField, MessageType},
    value::Value,
};
use ciborium::Value as Cbor;
use serde_json::Value as Json;

impl Value {
    /// The message as CBOR; its type decides how wide the numbers of arrays are.
    pub fn to_cbor(&self, kind: Option<&MessageType>) -> Cbor {
        match (self, kind) {
            (Value::Message(values), Some(kind)) => Cbor::Map(
                values
                    .iter()
                    .zip(&kind.fields)
                    .map(|((name, value), field)| (Cbor::from(&**name), entry(value, field)))
                    .collect(),
            ),
            (Value::Opaque(json), _) => plain(json),
            (value, _) => plain(&serde_json::to_value(value).unwrap_or(Json::Null)),
        }
    }
}

fn entry(value: &Value, field: &MessageField) -> Cbor {
    match value {
        Value::Bytes(bytes) => Cbor::Bytes(bytes.clone()),
        Value::Floats(values) => match field.kind {
            Kind::Float32 => typed(85, values.iter().flat_map(|x| (*x as f32).to_le_bytes())),
            _ => typed(86, values.iter().flat_map(|x| x.to_le_bytes())),
        },
        Value::List(values) => match &field.kind {
            Kind::Int { bits, signed } if field.count != Count::One => integers(values, *bits, *signed),
            kind => Cbor::Array(values.iter().map(|value| single(value, kind)).collect()),
        },
        value => single(value, &field.kind),
    }
}

fn single(value: &Value, kind: &Kind) -> Cbor {
    match (value, kind) {
        (Value::Message(_), Kind::Message(inner)) => value.to_cbor(Some(inner)),
        (Value::Bool(value), _) => Cbor::from(*value),
        (Value::Int(value), _) => Cbor::from(*value),
        (Value::Uint(value), _) => Cbor::from(*value),
        (Value::Float(value), _) => Cbor::from(*value),
        (Value::Text(value), _) => Cbor::from(value.as_str()),
        (Value::Time(time), _) => seconds(time.secs.into(), time.nsecs.into()),
        (Value::Duration(time), _) => seconds(time.secs.into(), time.nsecs.into()),
        (value, _) => plain(&serde_json::to_value(value).unwrap_or(Json::Null)),
    }
}

fn seconds(secs: i64, nsecs: i64) -> Cbor {
    Cbor::Map(vec![(Cbor::from("secs"), Cbor::from(secs)), (Cbor::from("nsecs"), Cbor::from(nsecs))])
}

fn typed(tag: u64, bytes: impl Iterator<Item = u8>) -> Cbor {
    Cbor::Tag(tag, Box::new(Cbor::Bytes(bytes.collect())))
}

/// Tags of RFC 8746: 64 + 8 for signed + 4 for little endian + the width's power, 8-bit ones without the 4.
fn integers(values: &[Value], bits: u8, signed: bool) -> Cbor {
    let wide: Vec<i128> = values
        .iter()
        .map(|value| match value {
            Value::Int(n) => i128::from(*n),
            Value::Uint(n) => i128::from(*n),
            _ => 0,
        })
        .collect();
    let width = usize::from(bits / 8);
    let tag = 64 + u64::from(signed) * 8 + if bits == 8 { 0 } else { 4 + u64::from(width.trailing_zeros()) };
    typed(tag, wide.iter().flat_map(|n| n.to_le_bytes().into_iter().take(width)))
}

fn plain(json: &Json) -> Cbor {
    match json {
        Json::Null => Cbor::Null,
        Json::Bool(value) => Cbor::from(*value),
        Json::Number(number) => match (number.as_i64(), number.as_u64()) {
            (Some(n), _) => Cbor::from(n),
            (_, Some(n)) => Cbor::from(n),
            _ => Cbor::from(number.as_f64().unwrap_or(f64::NAN)),
        },
        Json::String(text) => Cbor::from(text.as_str()),
        Json::Array(values) => Cbor::Array(values.iter().map(plain).collect()),
        Json::Object(map) => {
            Cbor::Map(map.iter().map(|(name, value)| (Cbor::from(name.as_str()), plain(value))).collect())
        }
    }
}
