//! ROS 1 messages as data: one codec for the rosbridge server, the bags and the relay to a ROS graph.
//!
//! A [`MessageType`] is read from its definition, the text of a `.msg` file, and knows ROS's checksum over it. With it
//! a [`Value`] is read from JSON or from the bytes that ROS sends, and written as either, or as CBOR. A Rust struct whose
//! fields are those of the definition is written as bytes by the same writer, and filled from a [`Value`], through serde.
//! The types that the testbed uses, and those of `std_msgs` and `geometry_msgs`, are known without a ROS installation.
//!
//! Pure: no clock, no files, no threads. Whoever reads a message says what time it is.
//!
//! ```
//! use proact_messages::{MessageType, Time, known_type};
//! let point = known_type("geometry_msgs/Point").expect("it is in the table");
//! assert_eq!(point.md5(), "4a842b65f413084dc2b10fb484ea7f17");
//!
//! let dose = MessageType::from_text("lab_msgs/Dose", "uint8 FULL=3 # most\nfloat32 amount\nstring unit\n")?;
//! let value = dose.read(serde_json::json!({"amount": 0.5}), Time::default())?;
//! let bytes = dose.to_bytes(&value)?;
//! assert_eq!(bytes, [0, 0, 0, 63, 0, 0, 0, 0]);
//! assert_eq!(dose.from_bytes(&bytes)?, value);
//! assert_eq!(serde_json::to_string(&value)?, r#"{"amount":0.5,"unit":""}"#);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
#![cfg_attr(test, allow(clippy::unwrap_used))]

mod cbor;
mod definition;
mod json;
mod known;
pub mod original;
mod service;
mod structs;
mod value;
mod wire;

pub use definition::{Constant, Count, DefinitionError, Kind, MessageField, MessageType, plain_name};
pub use json::ValueError;
pub use known::{known_type, known_types};
pub use service::ServiceType;
pub use structs::StructError;
pub use value::{Duration, Time, Value};
pub use wire::WireError;
