//! The protocol, from one client's view: text in, calls on the bus and answers in its outbox.

use crate::{
    actions::{ActionBridge, GoalClient},
    bus::{BusError, MemberId, ServiceReply, TopicBus, TopicMessage, TopicSink},
    fragments::FragmentedMessages,
    frozen_gaze::FrozenGazeDetector,
    outbox::{Compression, DeliveryOptions, Outbox, QueuedReply},
    png,
    request_fields::{RequestError, RequestFields, StatusLevel, absolute_name, json_type_name, refuse},
    rosapi,
    services::{OfferedServices, RemoteProvider},
};
use proact_messages::{MessageValue, RosVersion, Time, ros1_name, ros2_json};
use serde_json::{Map, Value as Json, json};
use std::{
    collections::{BTreeMap, BTreeSet, HashMap},
    sync::Arc,
    time::{Duration, Instant},
};

/// Longest message, bytes.
pub(crate) const MAX_MESSAGE_BYTES: usize = 8 * 1024 * 1024;
/// Most topics that one client subscribes to or advertises, and most services that it offers.
const MAX_NAMES: usize = 1000;
/// Most subscriptions to, or advertisements of, one topic by one client, told apart by their ids.
const MAX_IDS_PER_TOPIC: usize = 100;
/// What a client may get wrong before its connection is closed.
const MAX_ERRORS: u32 = 20_000;
/// A service call that names no time of its own fails after this.
const CALL_TIMEOUT: Duration = Duration::from_secs(30);
/// Longest time that a service call may ask for.
const MAX_CALL_TIMEOUT_SECS: f64 = 3600.0;

const OPERATIONS: &str = "advertise, unadvertise, publish, subscribe, unsubscribe, call_service, \
    advertise_service, unadvertise_service, service_response, send_action_goal, cancel_action_goal, fragment, png or \
    set_level";
/// Operations of those that offer actions.
const ACTION_SERVERS_UNSUPPORTED: &str = "actions are not offered over rosbridge here: offer them on the ROS graph, or on the topics \
    goal, cancel, feedback, result and status as actionlib does";
/// The end of the name of a service of ROS 2 that cancels goals of an action.
const CANCEL_GOAL_SUFFIX: &str = "/_action/cancel_goal";

/// One client.
pub(crate) struct RosbridgeSession {
    bus: Arc<dyn TopicBus>,
    member: MemberId,
    actions: Arc<ActionBridge>,
    outbox: Arc<Outbox>,
    /// ROS 2's from the first name of a type on that has its form, or if the client's address says so.
    ros_version: RosVersion,
    /// The ids under which each topic is advertised.
    advertised: HashMap<String, BTreeSet<String>>,
    subscribed: HashMap<String, BTreeMap<String, DeliveryOptions>>,
    offered_services: Arc<OfferedServices>,
    fragments: FragmentedMessages,
    gaze_detector: FrozenGazeDetector,
    status_level: StatusLevel,
    /// What is to be said of the message at hand although it is obeyed.
    pending_statuses: Vec<RequestError>,
    /// Topics on which the client was told that it leaves fields out.
    warned_incomplete_topics: BTreeSet<String>,
    error_count: u32,
    first_error: Option<String>,
}

/// The connection is to be closed.
#[derive(Debug)]
pub(crate) struct TooManyErrors;

/// When a message is handled, by both clocks.
#[derive(Clone, Copy)]
pub(crate) struct ReceiveTime {
    /// For throttles and timeouts.
    pub(crate) instant: Instant,
    /// For stamps that a client leaves out.
    pub(crate) time: Time,
}

impl RosbridgeSession {
    /// A client `name`, whose gaze counts as frozen when it is the same for longer than `frozen_gaze`.
    pub(crate) fn new(
        bus: Arc<dyn TopicBus>,
        actions: Arc<ActionBridge>,
        name: &str,
        convention: RosVersion,
        frozen_gaze: Option<Duration>,
    ) -> Self {
        let member = bus.join(name);
        RosbridgeSession {
            bus,
            member,
            actions,
            outbox: Arc::default(),
            ros_version: convention,
            advertised: HashMap::new(),
            subscribed: HashMap::new(),
            offered_services: Arc::default(),
            fragments: FragmentedMessages::default(),
            gaze_detector: FrozenGazeDetector::new(frozen_gaze),
            status_level: StatusLevel::Error,
            pending_statuses: Vec::new(),
            warned_incomplete_topics: BTreeSet::new(),
            error_count: 0,
            first_error: None,
        }
    }

    /// What waits for this client.
    pub(crate) fn outbox(&self) -> &Arc<Outbox> {
        &self.outbox
    }

    /// The calls that this client has not answered yet.
    pub(crate) fn offered_services(&self) -> &Arc<OfferedServices> {
        &self.offered_services
    }

    /// Obeys one message, or answers with a status why not.
    ///
    /// # Errors
    /// [`TooManyErrors`] once there were too many mistakes.
    pub(crate) fn handle(&mut self, bytes: &[u8], now: ReceiveTime) -> Result<(), TooManyErrors> {
        let (id, result) = match serde_json::from_slice(bytes) {
            Ok(json) => self.execute(json, now, true),
            Err(error) => (
                None,
                refuse(format!("message ignored: {error}; expected a JSON object of at most 128 levels")),
            ),
        };
        for RequestError(level, text) in std::mem::take(&mut self.pending_statuses) {
            self.send_status_if_wanted(level, id.clone(), text);
        }
        let Err(RequestError(level, text)) = result else { return Ok(()) };
        self.first_error.get_or_insert_with(|| text.clone());
        self.send_status_if_wanted(level, id, text);
        self.error_count += 1;
        if self.error_count > MAX_ERRORS { Err(TooManyErrors) } else { Ok(()) }
    }

    /// Has something said of the message at hand, if the client wants to hear it.
    fn add_status(&mut self, level: StatusLevel, text: impl FnOnce() -> String) {
        if level >= self.status_level {
            self.pending_statuses.push(RequestError(level, text()));
        }
    }

    /// What the client got wrong first.
    pub(crate) fn first_error(&self) -> Option<&str> {
        self.first_error.as_deref()
    }

    /// Sends a status, if the client wants to hear of this level.
    fn send_status_if_wanted(&self, level: StatusLevel, id: Option<Json>, text: String) {
        if level >= self.status_level {
            self.send_status(level, id, text);
        }
    }

    fn send_status(&self, level: StatusLevel, id: Option<Json>, mut text: String) {
        // A client's own words may be in it, and they may be long.
        if let Some((end, _)) = text.char_indices().nth(500) {
            text.truncate(end);
        }
        let level = match level {
            StatusLevel::Info => "info",
            StatusLevel::Warning => "warning",
            _ => "error",
        };
        let mut status = json!({"op": "status", "level": level, "msg": text});
        if let Some(id) = id {
            status["id"] = id;
        }
        self.reply(&status, None, Compression::None);
    }

    fn reply(&self, json: &Json, fragment_size: Option<usize>, compression: Compression) {
        self.outbox.reply(QueuedReply { text: json.to_string().into(), fragment_size, compression });
    }

    /// The id of the message, and whether it was obeyed.
    fn execute(
        &mut self,
        json: Json,
        now: ReceiveTime,
        whole: bool,
    ) -> (Option<Json>, Result<(), RequestError>) {
        let Json::Object(map) = json else {
            let kind = json_type_name(&json);
            return (
                None,
                refuse(format!("message ignored: it is {kind}, expected an object with the key \"op\"")),
            );
        };
        let id = map.get("id").filter(|id| id.is_string() || id.is_number()).cloned();
        let mut message = RequestFields { map, op: String::new() };
        let result = message.text("op").and_then(|op| {
            message.op = op;
            match message.op.as_str() {
                "publish" => self.publish(message, now),
                "subscribe" => self.subscribe(message),
                "unsubscribe" => self.unsubscribe(message),
                "advertise" => self.advertise(message),
                "unadvertise" => self.unadvertise(message),
                "call_service" => self.call_service(message, now),
                "service_response" => self.service_response(message),
                "advertise_service" => self.advertise_service(message),
                "unadvertise_service" => self.unadvertise_service(message),
                "send_action_goal" => self.send_action_goal(message, now),
                "cancel_action_goal" => self.cancel_action_goal(message),
                "advertise_action" | "unadvertise_action" | "action_feedback" | "action_result" => {
                    refuse(format!("{}: {ACTION_SERVERS_UNSUPPORTED}", message.op))
                }
                "set_level" | "set_status_level" | "status_level" => self.set_level(message),
                "fragment" if whole => self.receive_fragment(message, now),
                "png" if whole => self.receive_png(message, now),
                "auth" => Err(RequestError(
                    StatusLevel::Warning,
                    "auth is not used here: give the token in the address, ws://host:port/?token=.."
                        .to_owned(),
                )),
                "status" => Ok(()),
                other => refuse(format!("unknown op {other:?}, expected {OPERATIONS}")),
            }
        });
        (id, result)
    }

    /// The convention of a type's name, which shows the client's as well.
    fn ros_version_of(&mut self, type_name: &str) -> RosVersion {
        let convention = RosVersion::from_type_name(type_name);
        self.ros_version = self.ros_version.max(convention);
        convention
    }

    /// A message as a picture, whole or in pieces.
    fn receive_png(&mut self, mut message: RequestFields, now: ReceiveTime) -> Result<(), RequestError> {
        let id = message.id()?.unwrap_or_default();
        let (number, total) = (message.count("num")?, message.count("total")?);
        let mut data = message.text("data")?;
        if let (Some(number), Some(total)) = (number, total) {
            let whole = self.fragments.add(&format!("png {id}"), number, total, data, now.instant);
            match whole.map_err(|text| RequestError(StatusLevel::Error, format!("png: {text}")))? {
                None => return Ok(()),
                Some(whole) => data = whole,
            }
        }
        let text = png::decode_text(&data, MAX_MESSAGE_BYTES)
            .map_err(|text| RequestError(StatusLevel::Error, format!("png: {text}")))?;
        match serde_json::from_slice(&text) {
            Ok(json) => self.execute(json, now, false).1,
            Err(error) => refuse(format!("png: the picture holds no JSON: {error}")),
        }
    }

    /// A piece; the whole message is obeyed once it is complete. Its own id then is in the answer.
    fn receive_fragment(&mut self, mut message: RequestFields, now: ReceiveTime) -> Result<(), RequestError> {
        let id = message.id()?.unwrap_or_default();
        let (number, total) = (message.count("num")?, message.count("total")?);
        let data = message.text("data")?;
        let (Some(number), Some(total)) = (number, total) else {
            return refuse("fragment: expected the numbers \"num\" and \"total\"");
        };
        let whole = self.fragments.add(&id, number, total, data, now.instant);
        match whole.map_err(|text| RequestError(StatusLevel::Error, format!("fragment: {text}")))? {
            None => Ok(()),
            Some(text) => match serde_json::from_str(&text) {
                // Pieces within pieces are not taken.
                Ok(json) => self.execute(json, now, false).1,
                Err(error) => {
                    refuse(format!("fragment: the message {id:?} is put together and not JSON: {error}"))
                }
            },
        }
    }

    fn publish(&mut self, mut message: RequestFields, now: ReceiveTime) -> Result<(), RequestError> {
        let topic = message.name("topic")?;
        let Some(kind) = self.bus.topic_type(&topic) else {
            return refuse(format!("publish: the type of topic {topic} is not known; advertise it first"));
        };
        let json = message.map.remove("msg").unwrap_or_else(|| Json::Object(Map::new()));
        let value = match &kind.definition {
            Some(definition) => {
                if self.status_level <= StatusLevel::Warning
                    && !self.warned_incomplete_topics.contains(&topic)
                {
                    let missing = definition.missing_fields(&json);
                    if !missing.is_empty() {
                        self.warned_incomplete_topics.insert(topic.clone());
                        self.add_status(StatusLevel::Warning, || {
                            format!(
                                "publish on {topic}: {} left out of {}, filled with zero, empty or false; said once",
                                missing.join(", "),
                                definition.name
                            )
                        });
                    }
                }
                match definition.parse_json(json, now.time) {
                    Ok(value) => value,
                    Err(error) => return refuse(format!("publish on {topic}: {error}")),
                }
            }
            None if json.is_object() => MessageValue::Opaque(json),
            None => {
                let got = json_type_name(&json);
                return refuse(format!("publish on {topic}: the message is {got}, expected an object"));
            }
        };
        if let Some(warning) = self.gaze_detector.check(&topic, &value, now.instant) {
            // The arm stands still because of it: a client that asked for errors alone gets this warning as well.
            if self.status_level < StatusLevel::Silent {
                self.send_status(StatusLevel::Warning, None, warning);
            }
        }
        self.bus.publish(&[TopicMessage::new(topic, kind.definition, value)]);
        Ok(())
    }

    fn subscribe(&mut self, mut message: RequestFields) -> Result<(), RequestError> {
        let called = message.text("topic")?;
        let topic = absolute_name(&called);
        let id = message.id()?.unwrap_or_default();
        let type_name = message.optional_text("type")?.filter(|name| !name.is_empty());
        let convention = match &type_name {
            Some(name) => self.ros_version_of(name),
            None => self.ros_version,
        };
        let throttle = message.number("throttle_rate")?.unwrap_or(0.0).clamp(0.0, 3.6e6);
        let delivery = DeliveryOptions {
            throttle: Duration::from_secs_f64(throttle / 1000.0),
            queue_length: message.count("queue_length")?.unwrap_or(0),
            fragment_size: message.count("fragment_size")?.filter(|size| *size > 0),
            compression: message.compression()?,
            ros_version: convention,
        };
        if (delivery.compression, convention) == (Compression::CborRaw, RosVersion::Ros2) {
            return refuse(format!(
                "subscribe: {topic} cannot come as cbor-raw in the form of ROS 2, the bytes here are ROS 1's; use cbor"
            ));
        }
        let known = self.subscribed.len();
        let ids = self.subscribed.get(&topic);
        if (ids.is_none() && known >= MAX_NAMES) || ids.is_some_and(|ids| ids.len() >= MAX_IDS_PER_TOPIC) {
            return refuse(format!(
                "subscribe: {topic} is one too many, this client has {known} of {MAX_NAMES} topics and at most \
                 {MAX_IDS_PER_TOPIC} subscriptions to each"
            ));
        }
        if ids.is_none() {
            // Before the bus, which may hand over a latched message at once.
            self.outbox.set_delivery(&topic, delivery);
            self.outbox.set_alias(&topic, (called != topic).then_some(&called));
            let sink: Arc<dyn TopicSink> = Arc::<Outbox>::clone(&self.outbox);
            if let Err(error) = self.bus.subscribe(self.member, &topic, type_name.as_deref(), sink) {
                self.outbox.remove(&topic);
                return Err(error.into());
            }
        } else if let (Some(requested), Some(kind)) = (type_name, self.bus.topic_type(&topic))
            && ros1_name(&requested) != kind.name
        {
            return refuse(format!("subscribe: topic {topic} has the type {}, got {requested}", kind.name));
        }
        match self.bus.topic_type(&topic) {
            None => self.add_status(StatusLevel::Warning, || {
                format!(
                    "subscribe: nobody has named the type of {topic} yet; messages come once somebody does"
                )
            }),
            Some(kind) if delivery.compression == Compression::CborRaw && kind.definition.is_none() => {
                self.add_status(StatusLevel::Warning, || {
                    format!(
                        "subscribe: the fields of {} are not known here, so {topic} cannot come as cbor-raw",
                        kind.name
                    )
                });
            }
            Some(kind) => self.add_status(StatusLevel::Info, || format!("subscribe: {topic}, {}", kind.name)),
        }
        self.subscribed.entry(topic.clone()).or_default().insert(id, delivery);
        self.merge_subscriptions(&topic);
        Ok(())
    }

    /// Several subscriptions to one topic are served together: the most demanding of each wish counts.
    fn merge_subscriptions(&mut self, topic: &str) {
        let subscriptions = self.subscribed.get(topic).into_iter().flat_map(BTreeMap::values);
        let together = subscriptions.copied().reduce(|a, b| DeliveryOptions {
            throttle: a.throttle.min(b.throttle),
            // Zero stands for no bound.
            queue_length: if a.queue_length.min(b.queue_length) == 0 {
                0
            } else {
                a.queue_length.max(b.queue_length)
            },
            fragment_size: match (a.fragment_size, b.fragment_size) {
                (Some(a), Some(b)) => Some(a.min(b)),
                (a, b) => a.or(b),
            },
            compression: a.compression.max(b.compression),
            ros_version: a.ros_version.max(b.ros_version),
        });
        if let Some(delivery) = together {
            self.outbox.set_delivery(topic, delivery);
        }
    }

    fn unsubscribe(&mut self, mut message: RequestFields) -> Result<(), RequestError> {
        let topic = message.name("topic")?;
        let id = message.id()?;
        if let (Some(id), Some(ids)) = (id, self.subscribed.get_mut(&topic)) {
            if ids.remove(&id).is_none() {
                return refuse(format!("unsubscribe: topic {topic} has no subscription with the id {id:?}"));
            }
            if !ids.is_empty() {
                self.merge_subscriptions(&topic);
                return Ok(());
            }
        }
        self.subscribed.remove(&topic);
        self.bus.unsubscribe(self.member, &topic)?;
        self.outbox.remove(&topic);
        self.add_status(StatusLevel::Info, || format!("unsubscribe: {topic}"));
        Ok(())
    }

    fn advertise(&mut self, mut message: RequestFields) -> Result<(), RequestError> {
        let (topic, type_name) = (message.name("topic")?, message.text("type")?);
        self.ros_version_of(&type_name);
        let id = message.id()?.unwrap_or_default();
        let latch = message.flag("latch")?.unwrap_or(false);
        let known = self.advertised.len();
        let ids = self.advertised.get(&topic);
        if (ids.is_none() && known >= MAX_NAMES) || ids.is_some_and(|ids| ids.len() >= MAX_IDS_PER_TOPIC) {
            return refuse(format!(
                "advertise: {topic} is one too many, this client has {known} of {MAX_NAMES}"
            ));
        }
        self.bus.advertise(self.member, &topic, &type_name, latch)?;
        match self.bus.topic_type(&topic).and_then(|kind| kind.definition) {
            Some(kind) => self.add_status(StatusLevel::Info, || format!("advertise: {topic}, {}", kind.name)),
            None => self.add_status(StatusLevel::Warning, || {
                format!("advertise: the fields of {type_name} are not known here; messages on {topic} go on unchecked")
            }),
        }
        self.advertised.entry(topic).or_default().insert(id);
        Ok(())
    }

    fn unadvertise(&mut self, mut message: RequestFields) -> Result<(), RequestError> {
        let topic = message.name("topic")?;
        if let (Some(id), Some(ids)) = (message.id()?, self.advertised.get_mut(&topic)) {
            ids.remove(&id);
            if !ids.is_empty() {
                return Ok(());
            }
        }
        self.advertised.remove(&topic);
        match self.bus.unadvertise(self.member, &topic) {
            Ok(()) => self.add_status(StatusLevel::Info, || format!("unadvertise: {topic}")),
            // As the protocol has it: nothing is wrong afterwards.
            Err(error @ BusError::NotAdvertised { .. }) => {
                self.add_status(StatusLevel::Warning, || format!("unadvertise: {error}"));
            }
            Err(error) => return Err(error.into()),
        }
        Ok(())
    }

    fn call_service(&mut self, mut message: RequestFields, now: ReceiveTime) -> Result<(), RequestError> {
        let service = message.text("service")?;
        let id = message.map.remove("id");
        let arguments = message.map.remove("args").unwrap_or_else(|| Json::Object(Map::new()));
        let fragment_size = message.count("fragment_size")?.filter(|size| *size > 0);
        let compression = message.compression()?;
        let timeout = match message.number("timeout")? {
            Some(secs) if secs > 0.0 => Duration::from_secs_f64(secs.min(MAX_CALL_TIMEOUT_SECS)),
            _ => CALL_TIMEOUT,
        };
        if let Some(type_name) = message.optional_text("type")? {
            self.ros_version_of(&type_name);
        }
        let outbox = Arc::clone(&self.outbox);
        let (name, full_name, convention) = (service.clone(), absolute_name(&service), self.ros_version);
        let reply = ServiceReply::new(move |result| {
            let (values, result) = match result {
                Ok(values) if convention == RosVersion::Ros2 => {
                    (ros2_json(rosapi::response_to_ros2(&full_name, values)), true)
                }
                Ok(values) => (values, true),
                Err(reason) => (Json::String(reason), false),
            };
            let mut response = json!({
                "op": "service_response", "service": name, "values": values, "result": result,
            });
            if let Some(id) = id {
                response["id"] = id;
            }
            outbox.reply(QueuedReply { text: response.to_string().into(), fragment_size, compression });
        });
        if let Some(action) = absolute_name(&service).strip_suffix(CANCEL_GOAL_SUFFIX)
            && self.actions.cancel_all(action)
        {
            reply.answer(Ok(json!({"return_code": 0, "goals_canceling": []})));
            return Ok(());
        }
        self.bus.call_service(
            &absolute_name(&service),
            arguments,
            reply.with_deadline(now.instant + timeout),
        );
        Ok(())
    }

    fn advertise_service(&mut self, mut message: RequestFields) -> Result<(), RequestError> {
        let (called, type_name) = (message.text("service")?, message.text("type")?);
        let service = absolute_name(&called);
        if !self.offered_services.add(&service, MAX_NAMES) {
            return refuse(format!(
                "advertise_service: {service} is one too many, at most {MAX_NAMES} are allowed"
            ));
        }
        let convention = self.ros_version_of(&type_name);
        let provider = RemoteProvider::new(
            &called,
            convention,
            Arc::clone(&self.outbox),
            Arc::clone(&self.offered_services),
        );
        let result = self.bus.advertise_service(self.member, &service, &type_name, Arc::new(provider));
        if result.is_err() {
            self.offered_services.remove(&service);
        } else if self.bus.service_type(&type_name).is_some() {
            self.add_status(StatusLevel::Info, || format!("advertise_service: {service}, {type_name}"));
        } else {
            self.add_status(StatusLevel::Warning, || {
                format!("advertise_service: the fields of {type_name} are not known here; calls of {service} go on unchecked")
            });
        }
        Ok(result?)
    }

    fn unadvertise_service(&mut self, mut message: RequestFields) -> Result<(), RequestError> {
        let service = message.name("service")?;
        let result = self.bus.unadvertise_service(self.member, &service);
        self.offered_services.remove(&service);
        if result.is_ok() {
            self.add_status(StatusLevel::Info, || format!("unadvertise_service: {service}"));
        }
        Ok(result?)
    }

    fn service_response(&mut self, mut message: RequestFields) -> Result<(), RequestError> {
        let service = message.text("service")?;
        let Some(id) = message.id()? else {
            return refuse("service_response: expected the \"id\" of the call");
        };
        let values = message.map.remove("values").unwrap_or_else(|| Json::Object(Map::new()));
        let result = match message.flag("result")? {
            Some(false) => Err(match values {
                Json::String(reason) => reason,
                other => other.to_string(),
            }),
            _ => Ok(values),
        };
        match self.offered_services.answer(&service, &id, result) {
            true => Ok(()),
            false => refuse(format!(
                "service_response: no call of {service} with the id {id:?} waits for an answer"
            )),
        }
    }

    fn send_action_goal(&mut self, mut message: RequestFields, now: ReceiveTime) -> Result<(), RequestError> {
        let (called, type_name) = (message.text("action")?, message.text("action_type")?);
        let id = message.map.get("id").cloned().filter(|id| !id.is_null());
        // Of the right kind.
        message.id()?;
        self.ros_version_of(&type_name);
        let arguments = message.map.remove("args").unwrap_or_else(|| Json::Object(Map::new()));
        let sender = GoalClient {
            client: self.member,
            outbox: Arc::clone(&self.outbox),
            id,
            client_action_name: called.clone(),
            feedback: message.flag("feedback")?.unwrap_or(false),
            fragment_size: message.count("fragment_size")?.filter(|size| *size > 0),
            compression: message.compression()?,
            ros_version: self.ros_version,
        };
        match self.actions.send(&absolute_name(&called), &type_name, arguments, sender, now) {
            Ok(()) => {
                self.add_status(StatusLevel::Info, || format!("send_action_goal: {called}, {type_name}"));
                Ok(())
            }
            Err((sender, reason)) => {
                let reason = format!("send_action_goal: {reason}");
                sender.send_failure(&reason);
                refuse(reason)
            }
        }
    }

    fn cancel_action_goal(&mut self, mut message: RequestFields) -> Result<(), RequestError> {
        let action = message.name("action")?;
        let id = message.map.get("id").cloned();
        let (Some(_), Some(id)) = (message.id()?, id) else {
            return refuse("cancel_action_goal: expected the \"id\" of the goal");
        };
        if self.actions.cancel(self.member, &action, &id) {
            self.add_status(StatusLevel::Info, || format!("cancel_action_goal: {action}, {id}"));
        } else {
            // It may have ended meanwhile.
            self.add_status(StatusLevel::Warning, || {
                format!("cancel_action_goal: this client has no goal {id} for {action} in progress")
            });
        }
        Ok(())
    }

    fn set_level(&mut self, mut message: RequestFields) -> Result<(), RequestError> {
        self.status_level = match message.text("level")?.as_str() {
            "info" => StatusLevel::Info,
            "warning" => StatusLevel::Warning,
            "error" => StatusLevel::Error,
            "none" => StatusLevel::Silent,
            other => return refuse(format!("set_level: {other:?}, expected none, error, warning or info")),
        };
        self.add_status(StatusLevel::Info, || "set_level: what is obeyed is said from now on".to_owned());
        Ok(())
    }
}

impl Drop for RosbridgeSession {
    fn drop(&mut self) {
        self.actions.cancel_client_goals(self.member);
        self.bus.leave(self.member);
        // Whoever waits for an answer of this client is told that none comes.
        self.offered_services.close();
    }
}
