//! rosbridge with a ROS graph behind it: what clients publish, offer and call reaches the graph, and the graph reaches
//! them.

use proact_messages::{MessageType, ServiceType, Time, builtin_type, ros1_name};
use proact_ros::node::relay::{RawIncoming, RawPublisher, RawService, RawSubscriber, Relay, ServiceHandler};
use proact_rosbridge::{
    BusError, Graph, LocalBus, MemberId, ServiceInfo, ServiceProvider, ServiceReply, TopicBus, TopicMessage,
    TopicSink, TopicType,
};
use serde_json::{Map, Value as Json};
use std::{
    collections::{BTreeMap, BTreeSet, HashMap},
    sync::{
        Arc, Mutex, MutexGuard, PoisonError, RwLock, RwLockReadGuard, RwLockWriteGuard,
        atomic::{AtomicUsize, Ordering},
        mpsc::sync_channel,
    },
    time::{Duration, Instant, SystemTime, UNIX_EPOCH},
};

/// How long a call may take for which nobody says how long.
const CALL_TIMEOUT: Duration = Duration::from_secs(30);
/// Calls into the graph that may run at the same time.
const MAX_CALLS: usize = 64;

/// A [`TopicBus`] whose topics and services are those of a ROS graph too.
pub struct RosBus {
    local: Arc<LocalBus>,
    relay: Arc<Relay>,
    /// In whose name messages of the graph come.
    graph_member: MemberId,
    links: RwLock<RosLinks>,
    types: Mutex<HashMap<String, Option<Arc<MessageType>>>>,
    service_types: Arc<Mutex<BTreeMap<String, String>>>,
    calls: Arc<AtomicUsize>,
}

#[derive(Default)]
struct RosLinks {
    outgoing: HashMap<String, PublishedTopic>,
    incoming: HashMap<String, SubscribedTopic>,
    services: HashMap<String, AdvertisedService>,
}

/// A topic that clients publish on. Without a link its type is known to nobody, and it stays among the clients.
struct PublishedTopic {
    members: BTreeSet<MemberId>,
    link: Option<Arc<(RawPublisher, Arc<MessageType>)>>,
}

/// A topic that clients subscribe to.
struct SubscribedTopic {
    members: BTreeSet<MemberId>,
    _link: Option<RawSubscriber>,
}

/// A service that a client offers.
struct AdvertisedService {
    member: MemberId,
    _link: Option<RawService>,
}

fn lock<T>(of: &Mutex<T>) -> MutexGuard<'_, T> {
    // No code that holds one of these locks can panic half way through a change.
    of.lock().unwrap_or_else(PoisonError::into_inner)
}

impl RosBus {
    pub fn new(relay: Arc<Relay>) -> Arc<Self> {
        let local = LocalBus::new();
        let graph = local.join("");
        Arc::new(Self {
            local,
            relay,
            graph_member: graph,
            links: RwLock::default(),
            types: Mutex::default(),
            service_types: Arc::default(),
            calls: Arc::default(),
        })
    }

    fn read(&self) -> RwLockReadGuard<'_, RosLinks> {
        self.links.read().unwrap_or_else(PoisonError::into_inner)
    }

    fn write(&self) -> RwLockWriteGuard<'_, RosLinks> {
        self.links.write().unwrap_or_else(PoisonError::into_inner)
    }

    /// The fields of a type, from the packages on this machine if they are not known anyway.
    fn resolve_message_type(&self, type_name: &str) -> Option<Arc<MessageType>> {
        let name = ros1_name(type_name);
        if let Some(known) = lock(&self.types).get(&name) {
            return known.clone();
        }
        let found = self.relay.definitions().message(&name).map(|definition| definition.kind);
        let found = found.or_else(|| builtin_type(&name));
        lock(&self.types).insert(name, found.clone());
        found
    }

    /// Checks a type that a client names against the graph's.
    fn check_type(&self, topic: &str, type_name: &str) -> Result<(), BusError> {
        let graph_state = self.relay.graph_state();
        match graph_state.types.get(topic) {
            Some(has) if *has != ros1_name(type_name) && has != "*" => Err(BusError::TypeConflict {
                topic: topic.to_owned(),
                has: has.clone(),
                got: ros1_name(type_name),
            }),
            _ => Ok(()),
        }
    }

    /// A publisher on the graph, if the type is to be found.
    fn open_publisher(
        &self,
        topic: &str,
        type_name: &str,
        latch: bool,
    ) -> Option<Arc<(RawPublisher, Arc<MessageType>)>> {
        let name = ros1_name(type_name);
        let definition = self.relay.definitions().message(&name)?;
        match self.relay.advertise(topic, &definition, latch) {
            Ok(publisher) => Some(Arc::new((publisher, definition.kind))),
            Err(error) => {
                self.relay.record_refusal("rosbridge", &error.to_string());
                None
            }
        }
    }

    /// The service of a node that a question of rosapi is about, if its type has not been told yet.
    fn unresolved_service(&self, arguments: &Json) -> Option<String> {
        let service = arguments.get("service").or_else(|| arguments.get(0))?.as_str()?;
        let is_known =
            self.read().services.contains_key(service) || lock(&self.service_types).contains_key(service);
        (!is_known && self.relay.graph_state().services.contains_key(service)).then(|| service.to_owned())
    }

    fn outgoing(&self, topic: &str) -> Option<Arc<(RawPublisher, Arc<MessageType>)>> {
        if let Some(out) = self.read().outgoing.get(topic) {
            return out.link.clone();
        }
        // Published without a word before, on a topic that somebody else has named.
        let kind = self.topic_type(topic)?;
        let link = self.open_publisher(topic, &kind.name, false);
        self.write()
            .outgoing
            .insert(topic.to_owned(), PublishedTopic { members: BTreeSet::new(), link: link.clone() });
        link
    }

    /// Has what other nodes publish handed out to the clients.
    fn open_subscriber(&self, topic: &str) -> Option<RawSubscriber> {
        let (local, graph, relay) = (Arc::clone(&self.local), self.graph_member, Arc::downgrade(&self.relay));
        let (name, mut known): (Arc<str>, Option<ReceivedType>) = (topic.into(), None);
        let take = move |message: &RawIncoming<'_>| {
            let refuse = |reason: String| {
                if let Some(relay) = relay.upgrade() {
                    relay.record_refusal("rosbridge", &format!("{name}: {reason}"));
                }
            };
            if known
                .as_ref()
                .is_none_or(|known| known.type_name != message.type_name || known.text != message.text)
            {
                known = None;
                match ReceivedType::from_message(message) {
                    Ok(new) => match local.advertise(graph, &name, message.type_name, message.latched) {
                        Ok(()) => known = Some(new),
                        Err(error) => return refuse(error.to_string()),
                    },
                    Err(reason) => return refuse(reason),
                }
            }
            let Some(known) = &known else { return };
            match known.fields.from_bytes(message.bytes) {
                Ok(value) => {
                    local.publish(&[TopicMessage::new(
                        Arc::clone(&name),
                        Some(Arc::clone(&known.fields)),
                        value,
                    )]);
                }
                Err(error) => refuse(error.to_string()),
            }
        };
        match self.relay.subscribe(topic, take) {
            Ok(subscriber) => Some(subscriber),
            Err(error) => {
                self.relay.record_refusal("rosbridge", &error.to_string());
                None
            }
        }
    }
}

/// What publishers of a topic say of its type.
struct ReceivedType {
    type_name: String,
    text: String,
    fields: Arc<MessageType>,
}

impl ReceivedType {
    fn from_message(message: &RawIncoming<'_>) -> Result<Self, String> {
        let fields = MessageType::from_text(message.type_name, message.text).map_err(|e| e.to_string())?;
        Ok(Self { type_name: message.type_name.to_owned(), text: message.text.to_owned(), fields })
    }
}

fn ros_time_now() -> Time {
    let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    Time { secs: since.as_secs() as u32, nsecs: since.subsec_nanos() }
}

/// Values as bytes; those that are given in order get their names.
fn encode(kind: &Arc<MessageType>, json: Json) -> Result<Vec<u8>, String> {
    let named = match json {
        Json::Array(values) if values.len() <= kind.fields.len() => {
            let names = kind.fields.iter().map(|field| field.name.to_string());
            Json::Object(names.zip(values).collect())
        }
        Json::Null => Json::Object(Map::new()),
        other => other,
    };
    let value = kind.parse_json(named, ros_time_now()).map_err(|e| e.to_string())?;
    kind.to_bytes(&value).map_err(|e| e.to_string())
}

fn decode(kind: &MessageType, bytes: &[u8]) -> Result<Json, String> {
    let value = kind.from_bytes(bytes).map_err(|e| e.to_string())?;
    serde_json::to_value(value).map_err(|e| e.to_string())
}

/// A client's service for the graph.
fn service_handler(kind: ServiceType, provider: Arc<dyn ServiceProvider>) -> Arc<ServiceHandler> {
    Arc::new(move |request: &[u8]| {
        let arguments = decode(&kind.request, request)?;
        let (answered, answer) = sync_channel(1);
        let reply = ServiceReply::new(move |result| {
            // The caller may have gone.
            let _ = answered.send(result);
        });
        provider.call(arguments, reply.with_deadline(Instant::now() + CALL_TIMEOUT));
        let result =
            answer.recv_timeout(CALL_TIMEOUT).map_err(|_| format!("no answer within {CALL_TIMEOUT:?}"))?;
        encode(&kind.response, result?)
    })
}

/// Calls a service of the graph.
fn call(relay: &Relay, service: &str, arguments: Json, deadline: Instant) -> Result<(String, Json), String> {
    let type_name = relay.service_type(service)?;
    let kind = relay.definitions().service(&type_name).ok_or_else(|| {
        format!(
            "service {service} is {type_name}, whose definition is in no package here; see ROS_PACKAGE_PATH"
        )
    })?;
    let request = encode(&kind.request, arguments)?;
    let answer = relay.call(service, &kind, &request, deadline)?;
    Ok((type_name, decode(&kind.response, &answer)?))
}

impl TopicBus for RosBus {
    fn join(&self, name: &str) -> MemberId {
        self.local.join(name)
    }

    fn leave(&self, member: MemberId) {
        self.local.leave(member);
        let mut links = self.write();
        let leave = |members: &mut BTreeSet<MemberId>| members.remove(&member) && members.is_empty();
        let gone: (Vec<PublishedTopic>, Vec<SubscribedTopic>, Vec<AdvertisedService>) = (
            links.outgoing.extract_if(|_, out| leave(&mut out.members)).map(|(_, out)| out).collect(),
            links.incoming.extract_if(|_, t| leave(&mut t.members)).map(|(_, t)| t).collect(),
            links.services.extract_if(|_, offered| offered.member == member).map(|(_, o)| o).collect(),
        );
        // The master is told without the lock.
        drop(links);
        drop(gone);
    }

    fn advertise(&self, member: MemberId, topic: &str, type_name: &str, latch: bool) -> Result<(), BusError> {
        self.check_type(topic, type_name)?;
        self.local.advertise(member, topic, type_name, latch)?;
        if let Some(out) = self.write().outgoing.get_mut(topic) {
            out.members.insert(member);
            return Ok(());
        }
        let link = self.open_publisher(topic, type_name, latch);
        self.write()
            .outgoing
            .insert(topic.to_owned(), PublishedTopic { members: BTreeSet::from([member]), link });
        Ok(())
    }

    fn unadvertise(&self, member: MemberId, topic: &str) -> Result<(), BusError> {
        self.local.unadvertise(member, topic)?;
        let mut links = self.write();
        let last = links.outgoing.get_mut(topic).is_some_and(|out| {
            out.members.remove(&member);
            out.members.is_empty()
        });
        let gone = last.then(|| links.outgoing.remove(topic));
        drop(links);
        drop(gone);
        Ok(())
    }

    fn topic_type(&self, topic: &str) -> Option<TopicType> {
        let name = match self.local.topic_type(topic) {
            Some(TopicType { definition: definition @ Some(_), name }) => {
                return Some(TopicType { name, definition });
            }
            Some(TopicType { name, .. }) => name,
            None => self.relay.graph_state().types.get(topic)?.clone(),
        };
        Some(TopicType { definition: self.resolve_message_type(&name), name })
    }

    fn publish(&self, messages: &[Arc<TopicMessage>]) {
        self.local.publish(messages);
        for message in messages {
            let Some(link) = self.outgoing(&message.topic) else { continue };
            let (publisher, fields) = &*link;
            let sent = fields.to_bytes(&message.value).map_err(|e| e.to_string());
            if let Err(reason) = sent.and_then(|bytes| publisher.send(bytes)) {
                self.relay.record_refusal("rosbridge", &format!("{}: {reason}", message.topic));
            }
        }
    }

    fn subscribe(
        &self,
        member: MemberId,
        topic: &str,
        type_name: Option<&str>,
        sink: Arc<dyn TopicSink>,
    ) -> Result<(), BusError> {
        if let Some(type_name) = type_name {
            self.check_type(topic, type_name)?;
        }
        self.local.subscribe(member, topic, type_name, sink)?;
        if let Some(topic) = self.write().incoming.get_mut(topic) {
            topic.members.insert(member);
            return Ok(());
        }
        let link = self.open_subscriber(topic);
        self.write()
            .incoming
            .insert(topic.to_owned(), SubscribedTopic { members: BTreeSet::from([member]), _link: link });
        Ok(())
    }

    fn receiver_count(&self, topic: &str) -> usize {
        let link = self.read().outgoing.get(topic).and_then(|out| out.link.clone());
        self.local.receiver_count(topic) + link.map_or(0, |link| link.0.subscriber_count())
    }

    fn unsubscribe(&self, member: MemberId, topic: &str) -> Result<(), BusError> {
        self.local.unsubscribe(member, topic)?;
        let mut links = self.write();
        let last = links.incoming.get_mut(topic).is_some_and(|topic| {
            topic.members.remove(&member);
            topic.members.is_empty()
        });
        let gone = last.then(|| links.incoming.remove(topic));
        drop(links);
        if gone.is_some() {
            drop(gone);
            // Nobody hears the graph there any more; it may never have said anything.
            let _ = self.local.unadvertise(self.graph_member, topic);
        }
        Ok(())
    }

    fn advertise_service(
        &self,
        member: MemberId,
        service: &str,
        type_name: &str,
        provider: Arc<dyn ServiceProvider>,
    ) -> Result<(), BusError> {
        self.local.advertise_service(member, service, type_name, Arc::clone(&provider))?;
        let kind = self.relay.definitions().service(&ros1_name(type_name));
        let link = kind.and_then(|kind| {
            let served = self.relay.advertise_service(service, kind.clone(), service_handler(kind, provider));
            served.map_err(|reason| self.relay.record_refusal("rosbridge", &reason)).ok()
        });
        let replaced =
            self.write().services.insert(service.to_owned(), AdvertisedService { member, _link: link });
        drop(replaced);
        Ok(())
    }

    fn unadvertise_service(&self, member: MemberId, service: &str) -> Result<(), BusError> {
        self.local.unadvertise_service(member, service)?;
        let gone = self.write().services.remove(service);
        drop(gone);
        Ok(())
    }

    fn message_type(&self, name: &str) -> Option<Arc<MessageType>> {
        self.resolve_message_type(name)
    }

    fn service_type(&self, name: &str) -> Option<Arc<ServiceType>> {
        let found = self.relay.definitions().service(&ros1_name(name)).map(Arc::new);
        found.or_else(|| self.local.service_type(name))
    }

    fn call_service(&self, service: &str, arguments: Json, reply: ServiceReply) {
        let is_local = self.read().services.contains_key(service);
        // Of a node's service, which its node tells when asked.
        let unresolved = (is_local && service == "/rosapi/service_type")
            .then(|| self.unresolved_service(&arguments))
            .flatten();
        if is_local && unresolved.is_none() {
            return self.local.call_service(service, arguments, reply);
        }
        if self.calls.fetch_add(1, Ordering::Relaxed) >= MAX_CALLS {
            self.calls.fetch_sub(1, Ordering::Relaxed);
            return reply.answer(Err(format!("{MAX_CALLS} calls of services run already; call again")));
        }
        let (relay, calls, types) = (self.relay.clone(), self.calls.clone(), self.service_types.clone());
        let (service, local) = (service.to_owned(), self.local.clone());
        std::thread::spawn(move || {
            if let Some(unresolved) = unresolved {
                let service_type = relay.service_type(&unresolved);
                calls.fetch_sub(1, Ordering::Relaxed);
                if let Ok(type_name) = service_type {
                    lock(&types).insert(unresolved, type_name);
                }
                return local.call_service(&service, arguments, reply);
            }
            let deadline = reply.deadline().unwrap_or_else(|| Instant::now() + CALL_TIMEOUT);
            let result = call(&relay, &service, arguments, deadline);
            calls.fetch_sub(1, Ordering::Relaxed);
            reply.answer(result.map(|(type_name, values)| {
                lock(&types).insert(service, type_name);
                values
            }));
        });
    }

    fn graph(&self) -> Graph {
        let mut graph = self.local.graph();
        graph.members.retain(|name| !name.is_empty());
        for info in graph.topics.values_mut() {
            info.publishers.retain(|name| !name.is_empty());
        }
        let (graph_state, own) = (self.relay.graph_state(), self.relay.name());
        for (topic, type_name) in graph_state.types {
            graph.topics.entry(topic).or_default().type_name = type_name;
        }
        let mut nodes = BTreeSet::new();
        let mut add = |names: Vec<String>, to: &mut Vec<String>| {
            for name in names.into_iter().filter(|name| *name != own) {
                nodes.insert(name.clone());
                to.push(name);
            }
        };
        for (topic, names) in graph_state.publishers {
            add(names, &mut graph.topics.entry(topic).or_default().publishers);
        }
        for (topic, names) in graph_state.subscribers {
            add(names, &mut graph.topics.entry(topic).or_default().subscribers);
        }
        for (service, names) in graph_state.services {
            let mut providers = Vec::new();
            add(names, &mut providers);
            if let Some(provider) = providers.pop() {
                let type_name = lock(&self.service_types).get(&service).cloned().unwrap_or_default();
                graph.services.insert(service, ServiceInfo { type_name, provider });
            }
        }
        graph.members.extend(nodes);
        graph
    }
}
