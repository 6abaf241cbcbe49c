//! rosbridge: topics and services as JSON over WebSockets, protocol version 2, with no ROS master.
//!
//! [`RosbridgeServer`] serves any [`TopicBus`]; [`LocalBus`] is the one inside this process. [`HeadsetTopics`]
//! publishes a trial on it under the names that the original headset app subscribes to, and takes the app's gaze,
//! head and gestures back.
//!
//! No client can hold up another, or the trial: whoever reads too slowly loses old messages, and each client's
//! memory is bounded. Text and binary frames are taken alike.

mod access;
mod bus;
mod camera_topics;
mod cbor;
mod connection;
mod definition;
mod fragments;
mod headset;
mod headset_input;
mod local_bus;
mod outbox;
mod png;
mod rosapi;
mod server;
mod services;
mod session;
mod value;
mod wire;

pub use access::Access;
pub use bus::{
    BusError, Graph, MemberId, Reply, ServiceInfo, ServiceProvider, TopicBus, TopicInfo, TopicMessage,
    TopicSink, TopicType, check_name,
};
pub use camera_topics::CameraTopics;
pub use definition::{Count, DefinitionError, Field, Kind, MessageType, known_type, known_types, plain_name};
pub use headset::{HeadsetInput, HeadsetTopics};
pub use local_bus::LocalBus;
pub use server::{RosbridgeOptions, RosbridgeServer};
pub use services::Answering;
pub use value::{Time, Value, ValueError};
pub use wire::WireError;
