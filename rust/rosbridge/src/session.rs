//! The protocol, from one client's view: text in, calls on the bus and answers in its outbox.

use crate::{
    bus::{BusError, MemberId, ServiceReply, TopicBus, TopicMessage, TopicSink},
    fields::{Fields, Level, Refusal, global, kind_of, refuse},
    fragments::Fragments,
    outbox::{Compression, Delivery, Outbox, Reply},
    png,
    services::{Offered, RemoteProvider},
};
use proact_messages::{Time, Value, plain_name};
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
const MAX_IDS: usize = 100;
/// What a client may get wrong before its connection is closed.
const MAX_MISTAKES: u32 = 20_000;
/// A service call that names no time of its own fails after this.
const CALL_TIMEOUT: Duration = Duration::from_secs(30);
/// Longest time that a service call may ask for.
const MAX_CALL_TIMEOUT: f64 = 3600.0;

const OPERATIONS: &str = "advertise, unadvertise, publish, subscribe, unsubscribe, call_service, \
    advertise_service, unadvertise_service, service_response, fragment, png or set_level";

/// One client.
pub(crate) struct Session {
    bus: Arc<dyn TopicBus>,
    member: MemberId,
    outbox: Arc<Outbox>,
    /// The ids under which each topic is advertised.
    advertised: HashMap<String, BTreeSet<String>>,
    subscribed: HashMap<String, BTreeMap<String, Delivery>>,
    offered: Arc<Offered>,
    fragments: Fragments,
    level: Level,
    /// What is to be said of the message at hand although it is obeyed.
    remarks: Vec<Refusal>,
    /// Topics on which the client was told that it leaves fields out.
    partial: BTreeSet<String>,
    mistakes: u32,
    first_mistake: Option<String>,
}

/// The connection is to be closed.
#[derive(Debug)]
pub(crate) struct TooManyMistakes;

/// When a message is handled, by both clocks.
#[derive(Clone, Copy)]
pub(crate) struct Now {
    /// For throttles and timeouts.
    pub(crate) instant: Instant,
    /// For stamps that a client leaves out.
    pub(crate) time: Time,
}

impl Session {
    pub(crate) fn new(bus: Arc<dyn TopicBus>, name: &str) -> Self {
        let member = bus.join(name);
        Session {
            bus,
            member,
            outbox: Arc::default(),
            advertised: HashMap::new(),
            subscribed: HashMap::new(),
            offered: Arc::default(),
            fragments: Fragments::default(),
            level: Level::Error,
            remarks: Vec::new(),
            partial: BTreeSet::new(),
            mistakes: 0,
            first_mistake: None,
        }
    }

    /// What waits for this client.
    pub(crate) fn outbox(&self) -> &Arc<Outbox> {
        &self.outbox
    }

    /// The calls that this client has not answered yet.
    pub(crate) fn offered(&self) -> &Arc<Offered> {
        &self.offered
    }

    /// Obeys one message, or answers with a status why not.
    ///
    /// # Errors
    /// [`TooManyMistakes`] once there were too many mistakes.
    pub(crate) fn handle(&mut self, bytes: &[u8], now: Now) -> Result<(), TooManyMistakes> {
        let (id, result) = match serde_json::from_slice(bytes) {
            Ok(json) => self.obey(json, now, true),
            Err(error) => (
                None,
                refuse(format!("message ignored: {error}; expected a JSON object of at most 128 levels")),
            ),
        };
        for Refusal(level, text) in std::mem::take(&mut self.remarks) {
            self.status(level, id.clone(), text);
        }
        let Err(Refusal(level, text)) = result else { return Ok(()) };
        self.first_mistake.get_or_insert_with(|| text.clone());
        self.status(level, id, text);
        self.mistakes += 1;
        if self.mistakes > MAX_MISTAKES { Err(TooManyMistakes) } else { Ok(()) }
    }

    /// Has something said of the message at hand, if the client wants to hear it.
    fn remark(&mut self, level: Level, text: impl FnOnce() -> String) {
        if level >= self.level {
            self.remarks.push(Refusal(level, text()));
        }
    }

    /// What the client got wrong first.
    pub(crate) fn first_mistake(&self) -> Option<&str> {
        self.first_mistake.as_deref()
    }

    fn status(&self, level: Level, id: Option<Json>, mut text: String) {
        if level < self.level {
            return;
        }
        // A client's own words may be in it, and they may be long.
        if let Some((end, _)) = text.char_indices().nth(500) {
            text.truncate(end);
        }
        let level = match level {
            Level::Info => "info",
            Level::Warning => "warning",
            _ => "error",
        };
        let mut status = json!({"op": "status", "level": level, "msg": text});
        if let Some(id) = id {
            status["id"] = id;
        }
        self.reply(&status, None, Compression::None);
    }

    fn reply(&self, json: &Json, fragment_size: Option<usize>, compression: Compression) {
        self.outbox.reply(Reply { text: json.to_string().into(), fragment_size, compression });
    }

    /// The id of the message, and whether it was obeyed.
    fn obey(&mut self, json: Json, now: Now, whole: bool) -> (Option<Json>, Result<(), Refusal>) {
        let Json::Object(map) = json else {
            let kind = kind_of(&json);
            return (
                None,
                refuse(format!("message ignored: it is {kind}, expected an object with the key \"op\"")),
            );
        };
        let id = map.get("id").filter(|id| id.is_string() || id.is_number()).cloned();
        let mut message = Fields { map, op: String::new() };
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
                "set_level" | "status_level" => self.set_level(message),
                "fragment" if whole => self.fragment(message, now),
                "png" if whole => self.picture(message, now),
                "auth" => Err(Refusal(
                    Level::Warning,
                    "auth is not used here: give the token in the address, ws://host:port/?token=.."
                        .to_owned(),
                )),
                "status" => Ok(()),
                other => refuse(format!("unknown op {other:?}, expected {OPERATIONS}")),
            }
        });
        (id, result)
    }

    /// A message as a picture, whole or in pieces.
    fn picture(&mut self, mut message: Fields, now: Now) -> Result<(), Refusal> {
        let id = message.id()?.unwrap_or_default();
        let (number, total) = (message.count("num")?, message.count("total")?);
        let mut data = message.text("data")?;
        if let (Some(number), Some(total)) = (number, total) {
            let whole = self.fragments.take(&format!("png {id}"), number, total, data, now.instant);
            match whole.map_err(|text| Refusal(Level::Error, format!("png: {text}")))? {
                None => return Ok(()),
                Some(whole) => data = whole,
            }
        }
        let text = png::text(&data, MAX_MESSAGE_BYTES)
            .map_err(|text| Refusal(Level::Error, format!("png: {text}")))?;
        match serde_json::from_slice(&text) {
            Ok(json) => self.obey(json, now, false).1,
            Err(error) => refuse(format!("png: the picture holds no JSON: {error}")),
        }
    }

    /// A piece; the whole message is obeyed once it is complete. Its own id then is in the answer.
    fn fragment(&mut self, mut message: Fields, now: Now) -> Result<(), Refusal> {
        let id = message.id()?.unwrap_or_default();
        let (number, total) = (message.count("num")?, message.count("total")?);
        let data = message.text("data")?;
        let (Some(number), Some(total)) = (number, total) else {
            return refuse("fragment: expected the numbers \"num\" and \"total\"");
        };
        let whole = self.fragments.take(&id, number, total, data, now.instant);
        match whole.map_err(|text| Refusal(Level::Error, format!("fragment: {text}")))? {
            None => Ok(()),
            Some(text) => match serde_json::from_str(&text) {
                // Pieces within pieces are not taken.
                Ok(json) => self.obey(json, now, false).1,
                Err(error) => {
                    refuse(format!("fragment: the message {id:?} is put together and not JSON: {error}"))
                }
            },
        }
    }

    fn publish(&mut self, mut message: Fields, now: Now) -> Result<(), Refusal> {
        let topic = message.name("topic")?;
        let Some(kind) = self.bus.topic_type(&topic) else {
            return refuse(format!("publish: the type of topic {topic} is not known; advertise it first"));
        };
        let json = message.map.remove("msg").unwrap_or_else(|| Json::Object(Map::new()));
        let value = match &kind.definition {
            Some(definition) => {
                if self.level <= Level::Warning && !self.partial.contains(&topic) {
                    let missing = definition.left_out(&json);
                    if !missing.is_empty() {
                        self.partial.insert(topic.clone());
                        self.remark(Level::Warning, || {
                            format!(
                                "publish on {topic}: {} left out of {}, filled with zero, empty or false; said once",
                                missing.join(", "),
                                definition.name
                            )
                        });
                    }
                }
                match definition.read(json, now.time) {
                    Ok(value) => value,
                    Err(error) => return refuse(format!("publish on {topic}: {error}")),
                }
            }
            None if json.is_object() => Value::Opaque(json),
            None => {
                let got = kind_of(&json);
                return refuse(format!("publish on {topic}: the message is {got}, expected an object"));
            }
        };
        self.bus.publish(&[TopicMessage::new(topic, kind.definition, value)]);
        Ok(())
    }

    fn subscribe(&mut self, mut message: Fields) -> Result<(), Refusal> {
        let called = message.text("topic")?;
        let topic = global(&called);
        let id = message.id()?.unwrap_or_default();
        let type_name = message.optional_text("type")?.filter(|name| !name.is_empty());
        let throttle = message.number("throttle_rate")?.unwrap_or(0.0).clamp(0.0, 3.6e6);
        let delivery = Delivery {
            throttle: Duration::from_secs_f64(throttle / 1000.0),
            queue_length: message.count("queue_length")?.unwrap_or(0),
            fragment_size: message.count("fragment_size")?.filter(|size| *size > 0),
            compression: message.compression()?,
        };
        let known = self.subscribed.len();
        let ids = self.subscribed.get(&topic);
        if (ids.is_none() && known >= MAX_NAMES) || ids.is_some_and(|ids| ids.len() >= MAX_IDS) {
            return refuse(format!(
                "subscribe: {topic} is one too many, this client has {known} of {MAX_NAMES} topics and at most \
                 {MAX_IDS} subscriptions to each"
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
        } else if let (Some(asked), Some(kind)) = (type_name, self.bus.topic_type(&topic))
            && plain_name(&asked) != kind.name
        {
            return refuse(format!("subscribe: topic {topic} has the type {}, got {asked}", kind.name));
        }
        match self.bus.topic_type(&topic) {
            None => self.remark(Level::Warning, || {
                format!(
                    "subscribe: nobody has named the type of {topic} yet; messages come once somebody does"
                )
            }),
            Some(kind) if delivery.compression == Compression::CborRaw && kind.definition.is_none() => {
                self.remark(Level::Warning, || {
                    format!(
                        "subscribe: the fields of {} are not known here, so {topic} cannot come as cbor-raw",
                        kind.name
                    )
                });
            }
            Some(kind) => self.remark(Level::Info, || format!("subscribe: {topic}, {}", kind.name)),
        }
        self.subscribed.entry(topic.clone()).or_default().insert(id, delivery);
        self.settle(&topic);
        Ok(())
    }

    /// Several subscriptions to one topic are served together: the most demanding of each wish counts.
    fn settle(&mut self, topic: &str) {
        let wishes = self.subscribed.get(topic).into_iter().flat_map(BTreeMap::values);
        let together = wishes.copied().reduce(|a, b| Delivery {
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
        });
        if let Some(delivery) = together {
            self.outbox.set_delivery(topic, delivery);
        }
    }

    fn unsubscribe(&mut self, mut message: Fields) -> Result<(), Refusal> {
        let topic = message.name("topic")?;
        let id = message.id()?;
        if let (Some(id), Some(ids)) = (id, self.subscribed.get_mut(&topic)) {
            if ids.remove(&id).is_none() {
                return refuse(format!("unsubscribe: topic {topic} has no subscription with the id {id:?}"));
            }
            if !ids.is_empty() {
                self.settle(&topic);
                return Ok(());
            }
        }
        self.subscribed.remove(&topic);
        self.bus.unsubscribe(self.member, &topic)?;
        self.outbox.remove(&topic);
        self.remark(Level::Info, || format!("unsubscribe: {topic}"));
        Ok(())
    }

    fn advertise(&mut self, mut message: Fields) -> Result<(), Refusal> {
        let (topic, type_name) = (message.name("topic")?, message.text("type")?);
        let id = message.id()?.unwrap_or_default();
        let latch = message.flag("latch")?.unwrap_or(false);
        let known = self.advertised.len();
        let ids = self.advertised.get(&topic);
        if (ids.is_none() && known >= MAX_NAMES) || ids.is_some_and(|ids| ids.len() >= MAX_IDS) {
            return refuse(format!(
                "advertise: {topic} is one too many, this client has {known} of {MAX_NAMES}"
            ));
        }
        self.bus.advertise(self.member, &topic, &type_name, latch)?;
        match self.bus.topic_type(&topic).and_then(|kind| kind.definition) {
            Some(kind) => self.remark(Level::Info, || format!("advertise: {topic}, {}", kind.name)),
            None => self.remark(Level::Warning, || {
                format!("advertise: the fields of {type_name} are not known here; messages on {topic} go on unchecked")
            }),
        }
        self.advertised.entry(topic).or_default().insert(id);
        Ok(())
    }

    fn unadvertise(&mut self, mut message: Fields) -> Result<(), Refusal> {
        let topic = message.name("topic")?;
        if let (Some(id), Some(ids)) = (message.id()?, self.advertised.get_mut(&topic)) {
            ids.remove(&id);
            if !ids.is_empty() {
                return Ok(());
            }
        }
        self.advertised.remove(&topic);
        match self.bus.unadvertise(self.member, &topic) {
            Ok(()) => self.remark(Level::Info, || format!("unadvertise: {topic}")),
            // As the protocol has it: nothing is wrong afterwards.
            Err(error @ BusError::NotAdvertised { .. }) => {
                self.remark(Level::Warning, || format!("unadvertise: {error}"));
            }
            Err(error) => return Err(error.into()),
        }
        Ok(())
    }

    fn call_service(&mut self, mut message: Fields, now: Now) -> Result<(), Refusal> {
        let service = message.text("service")?;
        let id = message.map.remove("id");
        let arguments = message.map.remove("args").unwrap_or_else(|| Json::Object(Map::new()));
        let fragment_size = message.count("fragment_size")?.filter(|size| *size > 0);
        let compression = message.compression()?;
        let timeout = match message.number("timeout")? {
            Some(secs) if secs > 0.0 => Duration::from_secs_f64(secs.min(MAX_CALL_TIMEOUT)),
            _ => CALL_TIMEOUT,
        };
        let outbox = Arc::clone(&self.outbox);
        let name = service.clone();
        let reply = ServiceReply::new(move |result| {
            let (values, result) = match result {
                Ok(values) => (values, true),
                Err(reason) => (Json::String(reason), false),
            };
            let mut response = json!({
                "op": "service_response", "service": name, "values": values, "result": result,
            });
            if let Some(id) = id {
                response["id"] = id;
            }
            outbox.reply(Reply { text: response.to_string().into(), fragment_size, compression });
        });
        self.bus.call_service(&global(&service), arguments, reply.within(now.instant + timeout));
        Ok(())
    }

    fn advertise_service(&mut self, mut message: Fields) -> Result<(), Refusal> {
        let (called, type_name) = (message.text("service")?, message.text("type")?);
        let service = global(&called);
        if !self.offered.add(&service, MAX_NAMES) {
            return refuse(format!(
                "advertise_service: {service} is one too many, at most {MAX_NAMES} are allowed"
            ));
        }
        let provider = RemoteProvider::new(&called, Arc::clone(&self.outbox), Arc::clone(&self.offered));
        let result = self.bus.advertise_service(self.member, &service, &type_name, Arc::new(provider));
        if result.is_err() {
            self.offered.remove(&service);
        } else if self.bus.knows_service_type(&type_name) {
            self.remark(Level::Info, || format!("advertise_service: {service}, {type_name}"));
        } else {
            self.remark(Level::Warning, || {
                format!("advertise_service: the fields of {type_name} are not known here; calls of {service} go on unchecked")
            });
        }
        Ok(result?)
    }

    fn unadvertise_service(&mut self, mut message: Fields) -> Result<(), Refusal> {
        let service = message.name("service")?;
        let result = self.bus.unadvertise_service(self.member, &service);
        self.offered.remove(&service);
        if result.is_ok() {
            self.remark(Level::Info, || format!("unadvertise_service: {service}"));
        }
        Ok(result?)
    }

    fn service_response(&mut self, mut message: Fields) -> Result<(), Refusal> {
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
        match self.offered.answer(&service, &id, result) {
            true => Ok(()),
            false => refuse(format!(
                "service_response: no call of {service} with the id {id:?} waits for an answer"
            )),
        }
    }

    fn set_level(&mut self, mut message: Fields) -> Result<(), Refusal> {
        self.level = match message.text("level")?.as_str() {
            "info" => Level::Info,
            "warning" => Level::Warning,
            "error" => Level::Error,
            "none" => Level::Silent,
            other => return refuse(format!("set_level: {other:?}, expected none, error, warning or info")),
        };
        self.remark(Level::Info, || "set_level: what is obeyed is said from now on".to_owned());
        Ok(())
    }
}

impl Drop for Session {
    fn drop(&mut self) {
        self.bus.leave(self.member);
        // Whoever waits for an answer of this client is told that none comes.
        self.offered.close();
    }
}
