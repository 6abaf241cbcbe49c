//! Values from bytes.

use super::WireError;
use crate::{
    definition::{Count, Kind, MOST_PARTS, MessageField, MessageType},
    value::{Duration, Time, Value},
};
use std::sync::Arc;

impl MessageType {
    /// The message in `bytes`, without its length before it.
    ///
    /// # Errors
    /// [`WireError`] but for [`WireError::Mismatch`].
    pub fn from_bytes(&self, bytes: &[u8]) -> Result<Value, WireError> {
        let mut from = Reader { rest: bytes, parts: MOST_PARTS + bytes.len() };
        let value = self.take(&mut from).map_err(|error| error.within(&self.name))?;
        match from.rest.len() {
            0 => Ok(value),
            bytes => Err(WireError::LeftOver { path: self.name.clone(), bytes }),
        }
    }

    fn take(&self, from: &mut Reader<'_>) -> Result<Value, WireError> {
        // Messages without fields take no bytes, so that the bytes alone do not bound how many there are.
        let left = from.parts.checked_sub(1 + self.fields.len());
        from.parts = left.ok_or_else(|| WireError::TooMany { path: String::new() })?;
        let fields = self.fields.iter().map(|field| {
            let value = field.take(from).map_err(|error| error.within(&field.name))?;
            Ok((Arc::clone(&field.name), value))
        });
        Ok(Value::Message(fields.collect::<Result<_, _>>()?))
    }
}

impl MessageField {
    fn take(&self, from: &mut Reader<'_>) -> Result<Value, WireError> {
        let length = match self.count {
            Count::One => return self.kind.take(from),
            Count::Any => from.length()?,
            Count::Exactly(length) => length,
        };
        // An entry has a byte at least; so a length that lies cannot ask for memory. Messages without fields have none, but
        // are counted.
        if length > from.rest.len() && !matches!(self.kind, Kind::Message(_)) {
            return Err(WireError::TooShort { path: String::new(), missing: length - from.rest.len() });
        }
        let mut entries = |size: usize| from.take(length.saturating_mul(size));
        Ok(match self.kind {
            Kind::Int { bits: 8, signed: false } => Value::Bytes(entries(1)?.to_vec()),
            Kind::Float32 => {
                let four = entries(4)?.as_chunks().0;
                Value::Floats(four.iter().map(|bytes| f32::from_le_bytes(*bytes).into()).collect())
            }
            Kind::Float64 => {
                let eight = entries(8)?.as_chunks().0;
                Value::Floats(eight.iter().map(|bytes| f64::from_le_bytes(*bytes)).collect())
            }
            _ => {
                let mut values = Vec::new();
                for number in 0..length {
                    let value = self.kind.take(from).map_err(|error| error.within(&format!("[{number}]")))?;
                    values.push(value);
                }
                Value::List(values)
            }
        })
    }
}

impl Kind {
    fn take(&self, from: &mut Reader<'_>) -> Result<Value, WireError> {
        Ok(match self {
            Kind::Message(inner) => inner.take(from)?,
            Kind::Bool => Value::Bool(from.array::<1>()?[0] != 0),
            Kind::Int { bits, signed } => {
                let bytes = from.take(usize::from(bits / 8))?;
                let negative = *signed && bytes.last().is_some_and(|byte| byte & 0x80 != 0);
                let mut wide = [if negative { 0xff } else { 0 }; 8];
                wide[..bytes.len()].copy_from_slice(bytes);
                if *signed {
                    Value::Int(i64::from_le_bytes(wide))
                } else {
                    Value::Uint(u64::from_le_bytes(wide))
                }
            }
            Kind::Float32 => Value::Float(f32::from_le_bytes(from.array()?).into()),
            Kind::Float64 => Value::Float(f64::from_le_bytes(from.array()?)),
            Kind::Text => {
                let length = from.length()?;
                let text = std::str::from_utf8(from.take(length)?);
                Value::Text(text.map_err(|_| WireError::NotText { path: String::new() })?.to_owned())
            }
            Kind::Time => Value::Time(Time {
                secs: u32::from_le_bytes(from.array()?),
                nsecs: u32::from_le_bytes(from.array()?),
            }),
            Kind::Duration => Value::Duration(Duration {
                secs: i32::from_le_bytes(from.array()?),
                nsecs: i32::from_le_bytes(from.array()?),
            }),
        })
    }
}

struct Reader<'a> {
    rest: &'a [u8],
    /// Messages and fields that may still come.
    parts: usize,
}

impl<'a> Reader<'a> {
    fn take(&mut self, count: usize) -> Result<&'a [u8], WireError> {
        let Some((head, rest)) = self.rest.split_at_checked(count) else {
            return Err(WireError::TooShort { path: String::new(), missing: count - self.rest.len() });
        };
        self.rest = rest;
        Ok(head)
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], WireError> {
        let mut bytes = [0; N];
        bytes.copy_from_slice(self.take(N)?);
        Ok(bytes)
    }

    fn length(&mut self) -> Result<usize, WireError> {
        Ok(u32::from_le_bytes(self.array()?) as usize)
    }
}
