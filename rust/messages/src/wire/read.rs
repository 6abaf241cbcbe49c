//! Values from bytes.

use super::WireError;
use crate::{
    definition::{ArrayKind, FieldType, MAX_VALUES, MessageField, MessageType},
    value::{Duration, MessageValue, Time},
};
use std::sync::Arc;

impl MessageType {
    /// The message in `bytes`, without its length before it.
    ///
    /// # Errors
    /// [`WireError`] but for [`WireError::Mismatch`].
    pub fn from_bytes(&self, bytes: &[u8]) -> Result<MessageValue, WireError> {
        let mut from = Reader { rest: bytes, remaining_values: MAX_VALUES + bytes.len() };
        let value = self.decode(&mut from).map_err(|error| error.in_field(&self.name))?;
        match from.rest.len() {
            0 => Ok(value),
            bytes => Err(WireError::TrailingBytes { path: self.name.clone(), bytes }),
        }
    }

    fn decode(&self, from: &mut Reader<'_>) -> Result<MessageValue, WireError> {
        // Messages without fields take no bytes, so that the bytes alone do not bound how many there are.
        let left = from.remaining_values.checked_sub(1 + self.fields.len());
        from.remaining_values = left.ok_or_else(|| WireError::TooManyValues { path: String::new() })?;
        let fields = self.fields.iter().map(|field| {
            let value = field.decode(from).map_err(|error| error.in_field(&field.name))?;
            Ok((Arc::clone(&field.name), value))
        });
        Ok(MessageValue::Message(fields.collect::<Result<_, _>>()?))
    }
}

impl MessageField {
    fn decode(&self, from: &mut Reader<'_>) -> Result<MessageValue, WireError> {
        let length = match self.count {
            ArrayKind::Single => return self.kind.decode(from),
            ArrayKind::Variable => from.length()?,
            ArrayKind::Fixed(length) => length,
        };
        // An entry has a byte at least; so a length that lies cannot ask for memory. Messages without fields have none, but
        // are counted.
        if length > from.rest.len() && !matches!(self.kind, FieldType::Message(_)) {
            return Err(WireError::TooShort { path: String::new(), missing: length - from.rest.len() });
        }
        let mut entries = |size: usize| from.take(length.saturating_mul(size));
        Ok(match self.kind {
            FieldType::Int { bits: 8, signed: false } => MessageValue::Bytes(entries(1)?.to_vec()),
            FieldType::Float32 => {
                let four = entries(4)?.as_chunks().0;
                MessageValue::Floats(four.iter().map(|bytes| f32::from_le_bytes(*bytes).into()).collect())
            }
            FieldType::Float64 => {
                let eight = entries(8)?.as_chunks().0;
                MessageValue::Floats(eight.iter().map(|bytes| f64::from_le_bytes(*bytes)).collect())
            }
            _ => {
                let mut values = Vec::new();
                for number in 0..length {
                    let value =
                        self.kind.decode(from).map_err(|error| error.in_field(&format!("[{number}]")))?;
                    values.push(value);
                }
                MessageValue::List(values)
            }
        })
    }
}

impl FieldType {
    fn decode(&self, from: &mut Reader<'_>) -> Result<MessageValue, WireError> {
        Ok(match self {
            FieldType::Message(inner) => inner.decode(from)?,
            FieldType::Bool => MessageValue::Bool(from.array::<1>()?[0] != 0),
            FieldType::Int { bits, signed } => {
                let bytes = from.take(usize::from(bits / 8))?;
                let negative = *signed && bytes.last().is_some_and(|byte| byte & 0x80 != 0);
                let mut wide = [if negative { 0xff } else { 0 }; 8];
                wide[..bytes.len()].copy_from_slice(bytes);
                if *signed {
                    MessageValue::Int(i64::from_le_bytes(wide))
                } else {
                    MessageValue::Uint(u64::from_le_bytes(wide))
                }
            }
            FieldType::Float32 => MessageValue::Float(f32::from_le_bytes(from.array()?).into()),
            FieldType::Float64 => MessageValue::Float(f64::from_le_bytes(from.array()?)),
            FieldType::Text => {
                let length = from.length()?;
                let text = std::str::from_utf8(from.take(length)?);
                MessageValue::Text(
                    text.map_err(|_| WireError::InvalidUtf8 { path: String::new() })?.to_owned(),
                )
            }
            FieldType::Time => MessageValue::Time(Time {
                secs: u32::from_le_bytes(from.array()?),
                nsecs: u32::from_le_bytes(from.array()?),
            }),
            FieldType::Duration => MessageValue::Duration(Duration {
                secs: i32::from_le_bytes(from.array()?),
                nsecs: i32::from_le_bytes(from.array()?),
            }),
        })
    }
}

struct Reader<'a> {
    rest: &'a [u8],
    /// Messages and fields that may still come.
    remaining_values: usize,
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
