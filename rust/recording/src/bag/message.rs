//! How a ROS 1 message is described, summed and laid out in bytes.
//!
//! A message type is declared once, as a list of fields; its definition text, its MD5 sum and its encoding all
//! follow from that list and so cannot disagree.

use crate::RecordingError;
use md5::{Digest, Md5};

/// Anything that can be a field of a message.
pub trait Field: Sized {
    /// Name in a message definition, such as `float64[]`.
    fn type_name() -> String;

    /// What stands for the type in the text that is summed: its name, or for a message type its own sum.
    fn checksum_name() -> String {
        Self::type_name()
    }

    /// Adds the definitions that this type needs, each once, in the order in which they are met.
    fn collect_definitions(_found: &mut Vec<(&'static str, String)>) {}

    /// Appends the value, little endian.
    fn encode(&self, bytes: &mut Vec<u8>);

    /// Takes a value off the front; none if the bytes are not one.
    fn decode(bytes: &mut &[u8]) -> Option<Self>;
}

/// A message type of ROS 1.
pub trait Message: Field {
    /// Full name, such as `std_msgs/String`.
    const TYPE: &'static str;

    /// Definition without those that it needs: constants, then fields, one a line.
    fn own_definition() -> String;

    /// Text that is summed: the constants, then the fields, message types replaced by their sums.
    fn checksum_text() -> String;

    /// Full definition text, as bags and connections carry it.
    fn definition() -> String {
        let mut found = Vec::new();
        Self::collect_definitions(&mut found);
        let mut text = Self::own_definition();
        for (name, definition) in found.iter().filter(|(name, _)| *name != Self::TYPE) {
            text += &format!("{}\nMSG: {name}\n{definition}", "=".repeat(80));
        }
        text
    }

    /// MD5 sum by ROS's rule, in hexadecimal.
    fn md5_sum() -> String {
        Md5::digest(Self::checksum_text()).iter().map(|byte| format!("{byte:02x}")).collect()
    }

    /// Reads a message back.
    ///
    /// # Errors
    /// [`RecordingError::Encode`] if the bytes are not one message of this type.
    fn from_bytes(mut bytes: &[u8]) -> Result<Self, RecordingError> {
        match Self::decode(&mut bytes) {
            Some(message) if bytes.is_empty() => Ok(message),
            Some(_) => Err(RecordingError::Encode {
                what: Self::TYPE,
                reason: format!("{} bytes are left over", bytes.len()),
            }),
            None => {
                Err(RecordingError::Encode { what: Self::TYPE, reason: "the bytes end early".to_owned() })
            }
        }
    }
}

/// Declares a message type from its fields, in ROS's order.
macro_rules! message {
    (
        $(#[$doc:meta])* $name:ident = $ros:literal $(constants $constants:literal)? {
            $($field:ident: $type:ty),* $(,)?
        }
    ) => {
        $(#[$doc])*
        // The fields are ROS's, described in its own documentation.
        #[allow(missing_docs)]
        #[derive(Clone, Debug, Default, PartialEq)]
        pub struct $name {
            $(pub $field: $type),*
        }

        impl $crate::bag::message::Field for $name {
            fn type_name() -> String {
                $ros.to_owned()
            }

            fn checksum_name() -> String {
                <Self as $crate::bag::message::Message>::md5_sum()
            }

            fn collect_definitions(found: &mut Vec<(&'static str, String)>) {
                if found.iter().all(|(name, _)| *name != $ros) {
                    found.push(($ros, <Self as $crate::bag::message::Message>::own_definition()));
                    $(<$type as $crate::bag::message::Field>::collect_definitions(found);)*
                }
            }

            fn encode(&self, bytes: &mut Vec<u8>) {
                $($crate::bag::message::Field::encode(&self.$field, bytes);)*
            }

            fn decode(bytes: &mut &[u8]) -> Option<Self> {
                Some(Self { $($field: $crate::bag::message::Field::decode(bytes)?),* })
            }
        }

        impl $crate::bag::message::Message for $name {
            const TYPE: &'static str = $ros;

            fn own_definition() -> String {
                let mut text = String::new();
                $(text += $constants;)?
                $(text += &format!(
                    "{} {}\n",
                    <$type as $crate::bag::message::Field>::type_name(),
                    stringify!($field)
                );)*
                text
            }

            fn checksum_text() -> String {
                let mut text = String::new();
                $(text += $constants;)?
                $(text += &format!(
                    "{} {}\n",
                    <$type as $crate::bag::message::Field>::checksum_name(),
                    stringify!($field)
                );)*
                text.trim_end().to_owned()
            }
        }
    };
}
pub(crate) use message;

/// Splits `count` bytes off the front.
fn take<'a>(bytes: &mut &'a [u8], count: usize) -> Option<&'a [u8]> {
    let (front, rest) = bytes.split_at_checked(count)?;
    *bytes = rest;
    Some(front)
}

/// Numbers, which ROS lays out as they are in memory, little endian.
macro_rules! numbers {
    ($($type:ty => $ros:literal),* $(,)?) => {$(
        impl Field for $type {
            fn type_name() -> String {
                $ros.to_owned()
            }

            fn encode(&self, bytes: &mut Vec<u8>) {
                bytes.extend_from_slice(&self.to_le_bytes());
            }

            fn decode(bytes: &mut &[u8]) -> Option<Self> {
                take(bytes, size_of::<Self>())?.try_into().ok().map(<$type>::from_le_bytes)
            }
        }
    )*};
}
numbers!(i8 => "int8", u32 => "uint32", i32 => "int32", f64 => "float64");

/// A count of bytes or values. Only a message of more than 4 GB could not be counted.
fn encode_count(count: usize, bytes: &mut Vec<u8>) {
    u32::try_from(count).expect("messages are far below 4 GB").encode(bytes);
}

impl Field for bool {
    fn type_name() -> String {
        "bool".to_owned()
    }

    fn encode(&self, bytes: &mut Vec<u8>) {
        bytes.push(u8::from(*self));
    }

    fn decode(bytes: &mut &[u8]) -> Option<Self> {
        Some(take(bytes, 1)?[0] != 0)
    }
}

impl Field for String {
    fn type_name() -> String {
        "string".to_owned()
    }

    fn encode(&self, bytes: &mut Vec<u8>) {
        encode_count(self.len(), bytes);
        bytes.extend_from_slice(self.as_bytes());
    }

    fn decode(bytes: &mut &[u8]) -> Option<Self> {
        let length = u32::decode(bytes)? as usize;
        String::from_utf8(take(bytes, length)?.to_vec()).ok()
    }
}

impl<T: Field> Field for Vec<T> {
    fn type_name() -> String {
        format!("{}[]", T::type_name())
    }

    fn checksum_name() -> String {
        // By ROS's rule the brackets are summed for numbers and strings, but not for message types.
        let element = T::checksum_name();
        if element == T::type_name() { format!("{element}[]") } else { element }
    }

    fn collect_definitions(found: &mut Vec<(&'static str, String)>) {
        T::collect_definitions(found);
    }

    fn encode(&self, bytes: &mut Vec<u8>) {
        encode_count(self.len(), bytes);
        self.iter().for_each(|value| value.encode(bytes));
    }

    fn decode(bytes: &mut &[u8]) -> Option<Self> {
        let count = u32::decode(bytes)?;
        // No capacity in advance: a damaged count must not ask for memory.
        (0..count).map(|_| T::decode(bytes)).collect()
    }
}

/// ROS's `byte`: a signed byte under an old name.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Byte(pub i8);

impl Field for Byte {
    fn type_name() -> String {
        "byte".to_owned()
    }

    fn encode(&self, bytes: &mut Vec<u8>) {
        self.0.encode(bytes);
    }

    fn decode(bytes: &mut &[u8]) -> Option<Self> {
        i8::decode(bytes).map(Byte)
    }
}

/// ROS's `time`: seconds and nanoseconds since its epoch, never negative.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Time {
    /// Whole seconds.
    pub secs: u32,
    /// Nanoseconds, below one billion.
    pub nsecs: u32,
}

impl Field for Time {
    fn type_name() -> String {
        "time".to_owned()
    }

    fn encode(&self, bytes: &mut Vec<u8>) {
        self.secs.encode(bytes);
        self.nsecs.encode(bytes);
    }

    fn decode(bytes: &mut &[u8]) -> Option<Self> {
        Some(Time { secs: u32::decode(bytes)?, nsecs: u32::decode(bytes)? })
    }
}

/// ROS's `duration`: seconds and nanoseconds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Duration {
    /// Whole seconds.
    pub secs: i32,
    /// Nanoseconds of the same sign.
    pub nsecs: i32,
}

impl Field for Duration {
    fn type_name() -> String {
        "duration".to_owned()
    }

    fn encode(&self, bytes: &mut Vec<u8>) {
        self.secs.encode(bytes);
        self.nsecs.encode(bytes);
    }

    fn decode(bytes: &mut &[u8]) -> Option<Self> {
        Some(Duration { secs: i32::decode(bytes)?, nsecs: i32::decode(bytes)? })
    }
}
