//! ROS 1 messages as data: one codec for the rosbridge server, the bags and the relay to a ROS graph.
//!
//! A [`MessageType`] is read from its definition, the text of a `.msg` file, and knows ROS's checksum over it. With it
//! a [`MessageValue`] is read from JSON or from the bytes that ROS sends, and written as either, or as CBOR. A Rust struct whose
//! fields are those of the definition is written as bytes by the same writer, and filled from a [`MessageValue`], through serde.
//! The types that the testbed uses, and those of `std_msgs` and `geometry_msgs`, are known without a ROS installation.
//!
//! Pure: no clock, no files, no threads. Whoever reads a message says what time it is.
//!
//! ```
//! use proact_messages::{MessageType, Time, builtin_type};
//! let point = builtin_type("geometry_msgs/Point").expect("it is in the table");
//! assert_eq!(point.md5(), "4a842b65f413084dc2b10fb484ea7f17");
//!
//! let dose = MessageType::from_text("lab_msgs/Dose", "uint8 FULL=3 # most\nfloat32 amount\nstring unit\n")?;
//! let value = dose.parse_json(serde_json::json!({"amount": 0.5}), Time::default())?;
//! let bytes = dose.to_bytes(&value)?;
//! assert_eq!(bytes, [0, 0, 0, 63, 0, 0, 0, 0]);
//! assert_eq!(dose.from_bytes(&bytes)?, value);
//! assert_eq!(serde_json::to_string(&value)?, r#"{"amount":0.5,"unit":""}"#);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
#![cfg_attr(test, allow(clippy::unwrap_used))]

mod builtin_types;
mod cbor;
mod definition;
mod json;
pub mod original;
mod ros2;
mod service;
mod structs;
mod value;
mod wire;

pub use builtin_types::{builtin_type, builtin_types};
pub use definition::{ArrayKind, Constant, DefinitionError, FieldType, MessageField, MessageType};
pub use json::ValueError;
pub use ros2::{Ros2Message, RosVersion, ros1_name, ros2_json, ros2_name};
pub use service::ServiceType;
pub use structs::StructError;
pub use value::{Duration, MessageValue, Time};
pub use wire::WireError;
