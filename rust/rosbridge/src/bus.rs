//! The port through which the server knows topics and services: [`TopicBus`].

use crate::png;
use axum::{body::Bytes, extract::ws::Utf8Bytes};
use ciborium::Value as Cbor;
use proact_messages::{
    MessageType, MessageValue, Ros2Message, RosVersion, ServiceType, Time, builtin_type, ros1_name,
};
use serde::Serialize;
use serde_json::Value as Json;
use std::{
    collections::BTreeMap,
    sync::{Arc, OnceLock},
    time::Instant,
};

/// Somebody on the bus: a client of rosbridge, the trial, a ROS node.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct MemberId(pub u64);

/// Topics and services of one process, or of a whole ROS graph.
///
/// Order does not matter: a topic may be subscribed to before anybody publishes it. Messages of one publisher
/// arrive in their order. Nothing here blocks on a receiver.
pub trait TopicBus: Send + Sync {
    /// A new member with a name, such as `/proact`.
    fn join(&self, name: &str) -> MemberId;

    /// The member goes, with all its topics, subscriptions and services. Calls that it has not answered fail.
    fn leave(&self, member: MemberId);

    /// The member will publish on a topic. With `latch`, who subscribes later gets the last message at once.
    ///
    /// # Errors
    /// [`BusError::TypeConflict`], [`BusError::BadName`], [`BusError::TooMany`].
    fn advertise(&self, member: MemberId, topic: &str, type_name: &str, latch: bool) -> Result<(), BusError>;

    /// The member publishes there no more.
    ///
    /// # Errors
    /// [`BusError::NotAdvertised`].
    fn unadvertise(&self, member: MemberId, topic: &str) -> Result<(), BusError>;

    /// The type of a topic, once somebody has named it.
    fn topic_type(&self, topic: &str) -> Option<TopicType>;

    /// Hands out messages of one instant together.
    fn publish(&self, messages: &[Arc<TopicMessage>]);

    /// Has the member's sink get what is published from now on, and the last message of a latched topic. Without
    /// `type_name` the publisher decides. A second call replaces the first.
    ///
    /// # Errors
    /// [`BusError::TypeConflict`], [`BusError::BadName`], [`BusError::TooMany`].
    fn subscribe(
        &self,
        member: MemberId,
        topic: &str,
        type_name: Option<&str>,
        sink: Arc<dyn TopicSink>,
    ) -> Result<(), BusError>;

    /// How many receive what is published here on a topic now. On a ROS graph only connections that stand count.
    fn receiver_count(&self, topic: &str) -> usize;

    /// Ends a subscription.
    ///
    /// # Errors
    /// [`BusError::NotSubscribed`].
    fn unsubscribe(&self, member: MemberId, topic: &str) -> Result<(), BusError>;

    /// Offers a service; one of the same name is replaced, as in ROS.
    ///
    /// # Errors
    /// [`BusError::BadName`], [`BusError::TooMany`].
    fn advertise_service(
        &self,
        member: MemberId,
        service: &str,
        type_name: &str,
        provider: Arc<dyn ServiceProvider>,
    ) -> Result<(), BusError>;

    /// Takes a service back.
    ///
    /// # Errors
    /// [`BusError::NoService`] if the member does not offer it.
    fn unadvertise_service(&self, member: MemberId, service: &str) -> Result<(), BusError>;

    /// The message type of that name in either spelling, if its fields are known.
    fn message_type(&self, name: &str) -> Option<Arc<MessageType>>;

    /// The service type of that name in either spelling, if its fields are known, so that calls are checked.
    fn service_type(&self, name: &str) -> Option<Arc<ServiceType>>;

    /// Calls a service; the answer comes through `reply`, a failure too. Arguments are an object, or a list in the order of
    /// the fields where these are known.
    fn call_service(&self, service: &str, arguments: Json, reply: ServiceReply);

    /// Who publishes, subscribes and offers what.
    fn graph(&self) -> Graph;
}

/// What a topic carries.
#[derive(Clone, Debug, PartialEq)]
pub struct TopicType {
    /// Such as `std_msgs/String`.
    pub name: String,
    /// Its fields; without them messages are handed on unchecked.
    pub definition: Option<Arc<MessageType>>,
}

impl TopicType {
    /// The type of that name in either spelling, with its fields if they are known.
    pub fn from_name(name: &str) -> Self {
        TopicType { name: ros1_name(name), definition: builtin_type(name) }
    }
}

/// Takes the messages of a subscription. Must not block and must not call the bus.
pub trait TopicSink: Send + Sync {
    /// One message. Those of one instant come one after the other, then [`TopicSink::wake`].
    fn deliver(&self, message: &Arc<TopicMessage>);

    /// The messages of an instant are complete.
    fn wake(&self);
}

/// Answers service calls. Must not block.
pub trait ServiceProvider: Send + Sync {
    /// Begins to answer; the reply may be given later.
    fn call(&self, arguments: Json, reply: ServiceReply);
}

/// The way back of a service call. Dropped without an answer, it tells the caller so.
pub struct ServiceReply {
    callback: Option<ReplyCallback>,
    deadline: Option<Instant>,
}

type ReplyCallback = Box<dyn FnOnce(Result<Json, String>) + Send>;

impl ServiceReply {
    /// A reply that ends in `to`: the values, or one sentence of what went wrong.
    pub fn new(to: impl FnOnce(Result<Json, String>) + Send + 'static) -> Self {
        ServiceReply { callback: Some(Box::new(to)), deadline: None }
    }

    /// The caller waits no longer than until then.
    pub fn with_deadline(mut self, deadline: Instant) -> Self {
        self.deadline = Some(deadline);
        self
    }

    /// Until when the caller waits.
    pub fn deadline(&self) -> Option<Instant> {
        self.deadline
    }

    /// Answers.
    pub fn answer(mut self, result: Result<Json, String>) {
        if let Some(to) = self.callback.take() {
            to(result);
        }
    }
}

impl Drop for ServiceReply {
    fn drop(&mut self) {
        if let Some(to) = self.callback.take() {
            to(Err("the provider of the service went away without an answer".to_owned()));
        }
    }
}

/// A message on its way, with each of its written forms made at most once for all receivers.
#[derive(Debug)]
pub struct TopicMessage {
    /// The topic.
    pub topic: Arc<str>,
    /// The type's fields, if they are known.
    pub definition: Option<Arc<MessageType>>,
    /// The content.
    pub value: MessageValue,
    ros1: MessageEncodings,
    ros2: MessageEncodings,
    cbor_raw: OnceLock<Option<Bytes>>,
}

/// The written forms of a message in one convention.
#[derive(Debug, Default)]
struct MessageEncodings {
    text: OnceLock<Utf8Bytes>,
    png: OnceLock<Utf8Bytes>,
    cbor: OnceLock<Bytes>,
}

#[derive(Serialize)]
struct Publish<'a, M> {
    op: &'static str,
    topic: &'a str,
    msg: M,
}

impl TopicMessage {
    /// A message; `value` has been read with `definition`, or built field by field in its order.
    pub fn new(
        topic: impl Into<Arc<str>>,
        definition: Option<Arc<MessageType>>,
        value: MessageValue,
    ) -> Arc<Self> {
        let (ros1, ros2, cbor_raw) = Default::default();
        Arc::new(TopicMessage { topic: topic.into(), definition, value, ros1, ros2, cbor_raw })
    }

    /// The same message under another name of its topic.
    pub(crate) fn with_topic(&self, topic: &Arc<str>) -> Arc<Self> {
        TopicMessage::new(Arc::clone(topic), self.definition.clone(), self.value.clone())
    }

    /// How it is written for clients of either ROS: the same where both have the message alike.
    fn encodings(&self, convention: RosVersion) -> (&MessageEncodings, RosVersion) {
        let alike = self.definition.as_ref().is_some_and(|kind| !kind.differs_in_ros2());
        match convention {
            RosVersion::Ros2 if !alike => (&self.ros2, RosVersion::Ros2),
            _ => (&self.ros1, RosVersion::Ros1),
        }
    }

    /// `{"op":"publish","topic":..,"msg":..}`.
    pub fn text(&self, convention: RosVersion) -> &Utf8Bytes {
        let (written, convention) = self.encodings(convention);
        let (op, topic, value) = ("publish", &*self.topic, &self.value);
        written.text.get_or_init(|| {
            let text = match convention {
                RosVersion::Ros1 => serde_json::to_string(&Publish { op, topic, msg: value }),
                RosVersion::Ros2 => {
                    let msg = Ros2Message { value, kind: self.definition.as_deref() };
                    serde_json::to_string(&Publish { op, topic, msg })
                }
            };
            text.expect("plain values with string keys always serialise; what is not finite becomes null")
                .into()
        })
    }

    /// The text as a picture: `{"op":"png","data":..}`.
    pub fn png(&self, convention: RosVersion) -> &Utf8Bytes {
        let (written, convention) = self.encodings(convention);
        written.png.get_or_init(|| png::encode_message(self.text(convention)).into())
    }

    /// The same as CBOR.
    pub fn cbor(&self, convention: RosVersion) -> &Bytes {
        let (written, convention) = self.encodings(convention);
        written
            .cbor
            .get_or_init(|| self.publish_as_cbor(self.value.to_cbor(self.definition.as_deref(), convention)))
    }

    /// As CBOR with `secs`, `nsecs` and `bytes` for content: what `clock` said when this was asked for first, and the
    /// message as ROS sends it, without its length. None for a type whose fields are not known.
    pub fn cbor_raw(&self, clock: impl FnOnce() -> Time) -> Option<&Bytes> {
        let made = self.cbor_raw.get_or_init(|| {
            let bytes = self.definition.as_ref()?.to_bytes(&self.value).ok()?;
            let Time { secs, nsecs } = clock();
            Some(self.publish_as_cbor(Cbor::Map(vec![
                (Cbor::from("secs"), Cbor::from(secs)),
                (Cbor::from("nsecs"), Cbor::from(nsecs)),
                (Cbor::from("bytes"), Cbor::Bytes(bytes)),
            ])))
        });
        made.as_ref()
    }

    fn publish_as_cbor(&self, msg: Cbor) -> Bytes {
        let map = Cbor::Map(vec![
            (Cbor::from("op"), Cbor::from("publish")),
            (Cbor::from("topic"), Cbor::from(&*self.topic)),
            (Cbor::from("msg"), msg),
        ]);
        let mut bytes = Vec::new();
        ciborium::into_writer(&map, &mut bytes)
            .expect("a vector takes every byte and the values are plain data");
        bytes.into()
    }
}

/// Who does what on a bus, by name.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Graph {
    /// Topics.
    pub topics: BTreeMap<String, TopicInfo>,
    /// Services.
    pub services: BTreeMap<String, ServiceInfo>,
    /// Names of all members.
    pub members: Vec<String>,
}

/// A topic in a [`Graph`].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TopicInfo {
    /// Its type; empty while nobody has named it.
    pub type_name: String,
    /// Names of the members that publish.
    pub publishers: Vec<String>,
    /// Names of the members that subscribe.
    pub subscribers: Vec<String>,
}

/// A service in a [`Graph`].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ServiceInfo {
    /// Its type.
    pub type_name: String,
    /// Name of the member that offers it.
    pub provider: String,
}

/// What a bus refuses.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum BusError {
    /// A topic has one type.
    #[error("topic {topic} has the type {has}, got {got}; use that type or another topic")]
    TypeConflict {
        /// The topic.
        topic: String,
        /// Its type.
        has: String,
        /// The type asked for.
        got: String,
    },
    /// Not a name of a topic or service.
    #[error("{what} name {name:?} is not allowed; expected 1 to 255 visible ASCII characters")]
    BadName {
        /// `topic`, `type` or `service`.
        what: &'static str,
        /// The name, shortened.
        name: String,
    },
    /// Not a name of a type.
    #[error("type {name:?} is not allowed; expected a package and a name, as std_msgs/String")]
    BadType {
        /// The name, shortened.
        name: String,
    },
    /// The table is full.
    #[error("there are {limit} {what} already, no more are taken; give some up first")]
    TooMany {
        /// `topics` or `services`.
        what: &'static str,
        /// How many are allowed.
        limit: usize,
    },
    /// Nothing to take back.
    #[error("topic {topic} is not advertised by this client")]
    NotAdvertised {
        /// The topic.
        topic: String,
    },
    /// Nothing to end.
    #[error("topic {topic} is not subscribed to by this client")]
    NotSubscribed {
        /// The topic.
        topic: String,
    },
    /// No such service, or not this member's.
    #[error("service {service} is not offered by this client")]
    NoService {
        /// The service.
        service: String,
    },
}

/// Checks a name of a topic, type or service.
///
/// # Errors
/// [`BusError::BadName`].
pub fn check_name(what: &'static str, name: &str) -> Result<(), BusError> {
    if (1..=255).contains(&name.len()) && name.bytes().all(|byte| byte.is_ascii_graphic()) {
        return Ok(());
    }
    Err(BusError::BadName { what, name: name.chars().take(60).collect() })
}

/// Checks the name of a type of messages or services.
///
/// # Errors
/// [`BusError::BadType`].
pub fn check_type(name: &str) -> Result<(), BusError> {
    let plain = ros1_name(name);
    let word = |word: &str| {
        word.starts_with(|c: char| c.is_ascii_alphabetic())
            && word.chars().all(|c| c.is_ascii_alphanumeric() || c == '_')
    };
    match plain.split_once('/') {
        Some((package, short)) if word(package) && word(short) && plain.len() <= 255 => Ok(()),
        _ => Err(BusError::BadType { name: name.chars().take(60).collect() }),
    }
}
