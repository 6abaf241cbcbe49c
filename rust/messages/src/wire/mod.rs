//! Messages as ROS 1 sends them over TCP and keeps them in bags: little-endian, field after field.

mod read;
mod write;

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
    /// The message ends before the bytes do.
    #[error("{path}: {bytes} bytes are left over at the end")]
    TrailingBytes {
        /// The type.
        path: String,
        /// How many.
        bytes: usize,
    },
    /// A text that is not UTF-8.
    #[error("{path} is not UTF-8")]
    InvalidUtf8 {
        /// The field.
        path: String,
    },
    /// More messages in the message than could be meant.
    #[error("{path} holds more messages without a byte of their own than are taken")]
    TooManyValues {
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

impl WireError {
    /// The same, seen from what contains the field. Paths grow on the way out: most messages need none.
    fn in_field(mut self, outer: &str) -> Self {
        let (WireError::TooShort { path, .. }
        | WireError::TrailingBytes { path, .. }
        | WireError::InvalidUtf8 { path }
        | WireError::TooManyValues { path }
        | WireError::Mismatch { path, .. }) = &mut self;
        let dot = if path.is_empty() || path.starts_with('[') { "" } else { "." };
        *path = format!("{outer}{dot}{path}");
        self
    }
}

#[cfg(test)]
mod tests {
    use crate::{MessageType, MessageValue, Time, WireError, builtin_type, builtin_types};
    use serde_json::json;

    #[test]
    fn messages_without_a_byte_are_read_up_to_a_number_of_them() {
        let kind = MessageType::from_text(
            "a/B",
            "C[3] c\n====\nMSG: a/C\nstd_msgs/Empty e\n====\nMSG: std_msgs/Empty\n",
        );
        let kind = kind.unwrap();
        let value = kind.default_value(Time::default());
        assert_eq!(kind.from_bytes(&kind.to_bytes(&value).unwrap()), Ok(value));
        let any = MessageType::from_text(
            "a/B",
            "C[] c\n====\nMSG: a/C\nstd_msgs/Empty[1000] e\n====\nMSG: std_msgs/Empty\n",
        );
        let refused = any.unwrap().from_bytes(&4_000_000_000_u32.to_le_bytes());
        assert!(matches!(refused, Err(WireError::TooManyValues { .. })), "{refused:?}");
    }

    #[test]
    fn a_message_is_laid_out_field_by_field() {
        let text = "Header header\nPoint[] points\nfloat32[2] ends\nbyte level\nuint8[] raw\nchar[1] one\nint16[] small\n\
            duration lasts\n====\nMSG: std_msgs/Header\nuint32 seq\ntime stamp\nstring frame_id\n\
            ====\nMSG: lab_msgs/Point\nfloat64 x\n";
        let kind = MessageType::from_text("lab_msgs/Path", text).unwrap();
        let json = json!({
            "header": {"frame_id": "ab"}, "points": [{"x": 1.5}], "ends": [1, 2], "level": -3, "raw": [1, 2, 3],
            "one": [9], "small": [-2, 258], "lasts": {"secs": -1, "nsecs": -2},
        });
        let value = kind.parse_json(json, Time { secs: 7, nsecs: 9 }).unwrap();
        let bytes = kind.to_bytes(&value).unwrap();
        let expected: [&[u8]; 12] = [
            &[0, 0, 0, 0, 7, 0, 0, 0, 9, 0, 0, 0, 2, 0, 0, 0, b'a', b'b'],
            &[1, 0, 0, 0],
            &1.5f64.to_le_bytes(),
            &1f32.to_le_bytes(),
            &2f32.to_le_bytes(),
            &[0xfd],
            &[3, 0, 0, 0, 1, 2, 3],
            &[9],
            &[2, 0, 0, 0],
            &[0xfe, 0xff, 2, 1],
            &(-1i32).to_le_bytes(),
            &(-2i32).to_le_bytes(),
        ];
        assert_eq!(bytes, expected.concat());
        assert_eq!(kind.from_bytes(&bytes).unwrap(), value);
    }

    #[test]
    fn every_known_type_survives_the_way_there_and_back() {
        for kind in builtin_types() {
            let value = kind.default_value(Time { secs: 7, nsecs: 9 });
            let mut bytes = kind.to_bytes(&value).unwrap();
            assert_eq!(kind.from_bytes(&bytes).unwrap(), value, "{}", kind.name);
            if !bytes.is_empty() {
                let short = kind.from_bytes(&bytes[..bytes.len() - 1]);
                assert!(matches!(short, Err(WireError::TooShort { .. })), "{}", kind.name);
            }
            bytes.push(0);
            let long = kind.from_bytes(&bytes);
            assert!(matches!(long, Err(WireError::TrailingBytes { bytes: 1, .. })), "{}", kind.name);
        }
    }

    #[test]
    fn a_length_that_lies_and_a_text_that_is_none_are_refused() {
        let kind = MessageType::from_text("a/B", "float64[] data\nstring text").unwrap();
        let error = kind.from_bytes(&[0xff, 0xff, 0xff, 0xff]).unwrap_err();
        assert!(matches!(error, WireError::TooShort { .. }), "{error}");
        let error = kind.from_bytes(&[0, 0, 0, 0, 1, 0, 0, 0, 0xff]).unwrap_err();
        assert_eq!(error.to_string(), "a/B.text is not UTF-8");
        // A count of four billion must fail, not ask for memory.
        assert!(builtin_type("tf2_msgs/TFMessage").unwrap().from_bytes(&[255; 8]).is_err());
    }

    #[test]
    fn a_value_of_another_type_is_refused_with_its_place() {
        let kind = MessageType::from_text("a/B", "Point[] points\n====\nMSG: a/Point\nfloat64 x\nint8[2] n")
            .unwrap();
        let point = |name: &str, x: MessageValue, n: MessageValue| {
            MessageValue::Message(vec![(name.into(), x), ("n".into(), n)])
        };
        let whole = |point: MessageValue| {
            MessageValue::Message(vec![("points".into(), MessageValue::List(vec![point]))])
        };
        let two = || MessageValue::List(vec![MessageValue::Int(1), MessageValue::Int(2)]);
        assert!(kind.to_bytes(&whole(point("x", MessageValue::Float(1.0), two()))).is_ok());
        for (value, message) in [
            (whole(point("x", MessageValue::Bool(true), two())), "a/B.points[0].x is true, expected float64"),
            (
                whole(point("y", MessageValue::Float(1.0), two())),
                "a/B.points[0].y is the field \"y\", expected \"x\"",
            ),
            (
                whole(point("x", MessageValue::Float(1.0), MessageValue::List(vec![]))),
                "a/B.points[0].n is an array of 0, expected int8[2]",
            ),
            (
                whole(point(
                    "x",
                    MessageValue::Float(1.0),
                    MessageValue::List(vec![MessageValue::Int(128), MessageValue::Int(0)]),
                )),
                "a/B.points[0].n[0] is 128, expected int8",
            ),
            (
                MessageValue::Message(vec![]),
                "a/B is a message of 0 fields, expected the field \"points\" too",
            ),
            (
                MessageValue::Opaque(json!({"points": []})),
                "a/B is a message whose type is not known, expected a/B",
            ),
        ] {
            assert_eq!(kind.to_bytes(&value).unwrap_err().to_string(), message);
        }
    }
}
