//! Rust structs from messages: their fields are found by name, and what a struct lacks is passed over.

use crate::value::MessageValue;
use serde::{
    de::{
        DeserializeOwned, Deserializer, Error, IntoDeserializer, Visitor,
        value::{MapDeserializer, SeqDeserializer},
    },
    forward_to_deserialize_any,
};

/// A message that does not fill a struct.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct StructError(String);

impl Error for StructError {
    fn custom<T: std::fmt::Display>(reason: T) -> Self {
        StructError(reason.to_string())
    }
}

impl MessageValue {
    /// The message as a struct.
    ///
    /// # Errors
    /// [`StructError`] with the field that is not there or is of another type.
    pub fn into_struct<T: DeserializeOwned>(self) -> Result<T, StructError> {
        T::deserialize(self)
    }
}

impl<'de> IntoDeserializer<'de, StructError> for MessageValue {
    type Deserializer = Self;

    fn into_deserializer(self) -> Self {
        self
    }
}

impl<'de> Deserializer<'de> for MessageValue {
    type Error = StructError;

    fn deserialize_any<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, StructError> {
        match self {
            MessageValue::Bool(value) => visitor.visit_bool(value),
            MessageValue::Int(value) => visitor.visit_i64(value),
            MessageValue::Uint(value) => visitor.visit_u64(value),
            MessageValue::Float(value) => visitor.visit_f64(value),
            MessageValue::Text(value) => visitor.visit_string(value),
            MessageValue::Time(t) => {
                visitor.visit_map(MapDeserializer::new([("secs", t.secs), ("nsecs", t.nsecs)].into_iter()))
            }
            MessageValue::Duration(t) => {
                visitor.visit_map(MapDeserializer::new([("secs", t.secs), ("nsecs", t.nsecs)].into_iter()))
            }
            MessageValue::Bytes(bytes) => visitor.visit_seq(SeqDeserializer::new(bytes.into_iter())),
            MessageValue::Floats(values) => visitor.visit_seq(SeqDeserializer::new(values.into_iter())),
            MessageValue::List(values) => visitor.visit_seq(SeqDeserializer::new(values.into_iter())),
            MessageValue::Message(fields) => {
                let fields = fields.into_iter().map(|(name, value)| (name.to_string(), value));
                visitor.visit_map(MapDeserializer::new(fields))
            }
            MessageValue::Opaque(json) => json.deserialize_any(visitor).map_err(StructError::custom),
        }
    }

    forward_to_deserialize_any! {
        bool i8 i16 i32 i64 i128 u8 u16 u32 u64 u128 f32 f64 char str string bytes byte_buf option unit unit_struct
        newtype_struct seq tuple tuple_struct map struct enum identifier ignored_any
    }
}

#[cfg(test)]
mod tests {
    use crate::{Duration, MessageType, Time, builtin_type};
    use serde::{Deserialize, Serialize};
    use serde_json::json;

    #[derive(Debug, Default, PartialEq, Serialize, Deserialize)]
    struct Dose {
        at: Time,
        lasts: Duration,
        level: i8,
        parts: Vec<f64>,
        ends: [f64; 2],
        notes: Vec<String>,
        fits: bool,
    }

    fn dose() -> Dose {
        Dose {
            at: Time { secs: 1, nsecs: 2 },
            lasts: Duration { secs: -1, nsecs: -2 },
            level: -3,
            parts: vec![0.5, f64::INFINITY],
            ends: [1.5, 2.5],
            notes: vec!["a".to_owned(), String::new()],
            fits: true,
        }
    }

    const TEXT: &str =
        "time at\nduration lasts\nbyte level\nfloat32[] parts\nfloat64[2] ends\nstring[] notes\nbool fits\n";

    #[test]
    fn a_struct_goes_through_bytes_and_comes_back() {
        let kind = MessageType::from_text("lab_msgs/Dose", TEXT).unwrap();
        let bytes = kind.to_bytes(&dose()).unwrap();
        assert_eq!(bytes.len(), 8 + 8 + 1 + 4 + 8 + 16 + 4 + 5 + 4 + 1);
        let value = kind.from_bytes(&bytes).unwrap();
        assert_eq!(kind.to_bytes(&value).unwrap(), bytes);
        assert_eq!(value.into_struct::<Dose>().unwrap(), dose());
    }

    #[test]
    fn a_labs_own_definition_may_have_more_fields_but_not_fewer_or_others() {
        let more = MessageType::from_text("lab_msgs/Dose", &format!("uint8 id\n{TEXT}string more")).unwrap();
        let value = more.parse_json(json!({"level": -3, "ends": [0, 1]}), Time::default()).unwrap();
        let read: Dose = value.into_struct().unwrap();
        assert_eq!((read.level, read.ends), (-3, [0.0, 1.0]));
        for (from, to, part) in [
            ("bool fits", "", "missing field `fits`"),
            ("byte level", "int32 level", "1000"),
            ("string[] notes", "float64[] notes", "expected a string"),
        ] {
            let other = MessageType::from_text("lab_msgs/Dose", &TEXT.replace(from, to)).unwrap();
            let level = if to.contains("int32") { 1000 } else { 1 };
            let notes = if to.contains("float64") { json!([1.0]) } else { json!(["x"]) };
            let value = other.parse_json(json!({"level": level, "notes": notes}), Time::default()).unwrap();
            let error = value.into_struct::<Dose>().unwrap_err().to_string();
            assert!(error.contains(part), "{error}");
        }
    }

    #[test]
    fn a_struct_that_does_not_agree_with_the_definition_is_not_written() {
        let (bool, point) =
            (builtin_type("std_msgs/Bool").unwrap(), builtin_type("geometry_msgs/Point").unwrap());
        #[derive(Serialize)]
        struct Swapped {
            y: f64,
            x: f64,
            z: f64,
        }
        let error = point.to_bytes(&Swapped { y: 0.0, x: 0.0, z: 0.0 }).unwrap_err().to_string();
        assert_eq!(error, "geometry_msgs/Point.y is the field \"y\", expected \"x\"");
        #[derive(Serialize)]
        struct Short {
            x: f64,
        }
        let error = point.to_bytes(&Short { x: 0.0 }).unwrap_err().to_string();
        assert!(error.contains("1 field") && error.contains("\"y\""), "{error}");
        #[derive(Serialize)]
        struct Data<T> {
            data: T,
        }
        let error = bool.to_bytes(&Data { data: 1u8 }).unwrap_err().to_string();
        assert_eq!(error, "std_msgs/Bool.data is 1, expected bool");
        let int8 = builtin_type("std_msgs/Int8").unwrap();
        assert!(int8.to_bytes(&Data { data: 127 }).is_ok());
        let error = int8.to_bytes(&Data { data: 128 }).unwrap_err().to_string();
        assert_eq!(error, "std_msgs/Int8.data is 128, expected int8");
        assert!(int8.to_bytes(&Data { data: Some(3i8) }).is_ok());
        for error in [
            int8.to_bytes(&Data { data: 'x' }).unwrap_err(),
            int8.to_bytes(&Data { data: () }).unwrap_err(),
            int8.to_bytes(&Data { data: "3" }).unwrap_err(),
            int8.to_bytes(&Data { data: [3i8] }).unwrap_err(),
            int8.to_bytes(&3).unwrap_err(),
        ] {
            assert!(error.to_string().starts_with("std_msgs/Int8"), "{error}");
        }
    }
}
