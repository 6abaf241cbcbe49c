//! rosbridge: topics and services as JSON over WebSockets, protocol version 2, with no ROS master.
//!
//! [`RosbridgeServer`] serves any [`TopicBus`]; [`LocalBus`] is the one inside this process. [`HeadsetTopics`]
//! publishes a trial on it under the names that the original headset app subscribes to, and takes the app's gaze,
//! head and gestures back; [`CameraTopics`] takes pictures of it.
//!
//! No client can hold up another, or the trial: whoever reads too slowly loses old messages, and each client's
//! memory is bounded. Text and binary frames are taken alike. Who may connect is [`proact_http`]'s rule, what a message
//! is [`proact_messages`]'s matter.
//!
//! It uses the real clock and threads. It computes nothing of a trial, and knows topics only through [`TopicBus`].
//!
//! ```no_run
//! use proact_messages::{Time, builtin_type};
//! use proact_rosbridge::{LocalBus, RosbridgeOptions, RosbridgeServer, TopicBus, TopicMessage};
//! use std::sync::Arc;
//! let bus: Arc<dyn TopicBus> = LocalBus::new();
//! let server = RosbridgeServer::start(RosbridgeOptions::default(), Arc::clone(&bus))?;
//! println!("ws://{}/", server.address());
//! let me = bus.join("/talker");
//! bus.advertise(me, "/chatter", "std_msgs/String", false)?;
//! let text = builtin_type("std_msgs/String").expect("it is in the table");
//! let hello = text.parse_json(serde_json::json!({"data": "hello"}), Time::default())?;
//! bus.publish(&[TopicMessage::new("/chatter", Some(text), hello)]);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
// A web server lives by the real clock and in a thread of its own.
#![allow(clippy::disallowed_methods)]
#![cfg_attr(test, allow(clippy::unwrap_used))]

mod actions;
mod bus;
mod camera_topics;
mod connection;
mod error;
mod fragments;
mod frozen_gaze;
mod headset;
mod headset_input;
mod local_bus;
mod outbox;
mod png;
mod request_fields;
mod rosapi;
mod server;
mod service_types;
mod services;
mod session;

pub use bus::{
    BusError, Graph, MemberId, ServiceInfo, ServiceProvider, ServiceReply, TopicBus, TopicInfo, TopicMessage,
    TopicSink, TopicType, check_name, check_type,
};
pub use camera_topics::CameraTopics;
pub use error::RosbridgeError;
pub use headset::{HeadsetInput, HeadsetTopics};
pub use local_bus::LocalBus;
pub use server::{RosbridgeOptions, RosbridgeServer};
pub use services::FunctionService;
