//! Topics and services inside this process.

use crate::bus::{
    BusError, Graph, MemberId, ServiceInfo, ServiceProvider, ServiceReply, TopicBus, TopicInfo, TopicMessage,
    TopicSink, TopicType, check_name, check_type,
};
use crate::service_types;
use proact_messages::{MessageType, ServiceType, builtin_type, ros1_name};
use serde_json::Value as Json;
use std::{
    collections::{BTreeMap, HashMap},
    sync::{Arc, Mutex, MutexGuard, PoisonError, RwLock, RwLockReadGuard, RwLockWriteGuard},
};

/// Most topics, and most services, that may exist at a time.
const MAX_NAMES: usize = 20_000;

/// A [`TopicBus`] within one process.
#[derive(Default)]
pub struct LocalBus {
    state: RwLock<State>,
}

#[derive(Default)]
struct State {
    next_member: u64,
    members: BTreeMap<MemberId, String>,
    topics: HashMap<String, Topic>,
    services: HashMap<String, Service>,
}

#[derive(Default)]
struct Topic {
    kind: Option<TopicType>,
    /// Who publishes, and whether latched.
    publishers: BTreeMap<MemberId, bool>,
    subscribers: BTreeMap<MemberId, Arc<dyn TopicSink>>,
    last: Mutex<Option<Arc<TopicMessage>>>,
}

struct Service {
    member: MemberId,
    type_name: String,
    /// What is asked, if its fields are known.
    request: Option<Arc<MessageType>>,
    provider: Arc<dyn ServiceProvider>,
}

impl LocalBus {
    /// A bus without members.
    pub fn new() -> Arc<Self> {
        Arc::new(Self::default())
    }

    fn read(&self) -> RwLockReadGuard<'_, State> {
        // No code that holds the lock can panic half way through a change.
        self.state.read().unwrap_or_else(PoisonError::into_inner)
    }

    fn write(&self) -> RwLockWriteGuard<'_, State> {
        self.state.write().unwrap_or_else(PoisonError::into_inner)
    }
}

impl State {
    /// The topic, made if need be, with its type settled.
    fn topic(&mut self, name: &str, type_name: Option<&str>) -> Result<&mut Topic, BusError> {
        check_name("topic", name)?;
        if let Some(type_name) = type_name {
            check_type(type_name)?;
        }
        if !self.topics.contains_key(name) && self.topics.len() >= MAX_NAMES {
            return Err(BusError::TooMany { what: "topics", limit: MAX_NAMES });
        }
        let topic = self.topics.entry(name.to_owned()).or_default();
        if let Some(requested) = type_name.map(TopicType::from_name) {
            match &topic.kind {
                Some(kind) if kind.name != requested.name => {
                    let (topic, has, got) = (name.to_owned(), kind.name.clone(), requested.name);
                    return Err(BusError::TypeConflict { topic, has, got });
                }
                Some(_) => {}
                None => topic.kind = Some(requested),
            }
        }
        Ok(topic)
    }

    /// Forgets a topic that nobody has to do with any more.
    fn remove_if_unused(&mut self, name: &str) {
        if self.topics.get(name).is_some_and(Topic::is_unused) {
            self.topics.remove(name);
        }
    }
}

impl Topic {
    fn is_unused(&self) -> bool {
        self.publishers.is_empty() && self.subscribers.is_empty()
    }

    fn last(&self) -> MutexGuard<'_, Option<Arc<TopicMessage>>> {
        self.last.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn drop_publisher(&mut self, member: MemberId) -> bool {
        let found = self.publishers.remove(&member).is_some();
        if !self.publishers.values().any(|latch| *latch) {
            *self.last() = None;
        }
        found
    }
}

impl TopicBus for LocalBus {
    fn join(&self, name: &str) -> MemberId {
        let mut state = self.write();
        state.next_member += 1;
        let member = MemberId(state.next_member);
        state.members.insert(member, name.to_owned());
        member
    }

    fn leave(&self, member: MemberId) {
        let mut state = self.write();
        state.members.remove(&member);
        for topic in state.topics.values_mut() {
            topic.drop_publisher(member);
            topic.subscribers.remove(&member);
        }
        state.topics.retain(|_, topic| !topic.is_unused());
        let services = std::mem::take(&mut state.services);
        let (gone, kept) = services.into_iter().partition(|(_, service)| service.member == member);
        state.services = kept;
        drop(state);
        // Outside the lock: the end of a provider answers the calls that wait for it.
        drop::<HashMap<_, _>>(gone);
    }

    fn advertise(&self, member: MemberId, topic: &str, type_name: &str, latch: bool) -> Result<(), BusError> {
        let mut state = self.write();
        let entry = state.topic(topic, Some(type_name));
        let result = entry.map(|entry| {
            entry.publishers.insert(member, latch);
        });
        state.remove_if_unused(topic);
        result
    }

    fn unadvertise(&self, member: MemberId, topic: &str) -> Result<(), BusError> {
        let mut state = self.write();
        let found = state.topics.get_mut(topic).is_some_and(|entry| entry.drop_publisher(member));
        state.remove_if_unused(topic);
        if found { Ok(()) } else { Err(BusError::NotAdvertised { topic: topic.to_owned() }) }
    }

    fn topic_type(&self, topic: &str) -> Option<TopicType> {
        self.read().topics.get(topic)?.kind.clone()
    }

    fn publish(&self, messages: &[Arc<TopicMessage>]) {
        let state = self.read();
        let mut reached: Vec<&Arc<dyn TopicSink>> = Vec::new();
        for message in messages {
            let Some(topic) = state.topics.get(&*message.topic) else { continue };
            if topic.publishers.values().any(|latch| *latch) {
                *topic.last() = Some(Arc::clone(message));
            }
            for sink in topic.subscribers.values() {
                sink.deliver(message);
                if !reached.iter().any(|other| Arc::ptr_eq(other, sink)) {
                    reached.push(sink);
                }
            }
        }
        for sink in reached {
            sink.wake();
        }
    }

    fn subscribe(
        &self,
        member: MemberId,
        topic: &str,
        type_name: Option<&str>,
        sink: Arc<dyn TopicSink>,
    ) -> Result<(), BusError> {
        let mut state = self.write();
        let entry = state.topic(topic, type_name);
        let result = entry.map(|entry| {
            if let Some(last) = &*entry.last() {
                sink.deliver(last);
                sink.wake();
            }
            entry.subscribers.insert(member, sink);
        });
        state.remove_if_unused(topic);
        result
    }

    fn receiver_count(&self, topic: &str) -> usize {
        self.read().topics.get(topic).map_or(0, |entry| entry.subscribers.len())
    }

    fn unsubscribe(&self, member: MemberId, topic: &str) -> Result<(), BusError> {
        let mut state = self.write();
        let entry = state.topics.get_mut(topic);
        let found = entry.is_some_and(|entry| entry.subscribers.remove(&member).is_some());
        state.remove_if_unused(topic);
        if found { Ok(()) } else { Err(BusError::NotSubscribed { topic: topic.to_owned() }) }
    }

    fn advertise_service(
        &self,
        member: MemberId,
        service: &str,
        type_name: &str,
        provider: Arc<dyn ServiceProvider>,
    ) -> Result<(), BusError> {
        check_name("service", service)?;
        check_type(type_name)?;
        let mut state = self.write();
        if !state.services.contains_key(service) && state.services.len() >= MAX_NAMES {
            return Err(BusError::TooMany { what: "services", limit: MAX_NAMES });
        }
        let request = service_types::builtin_service_type(type_name).map(|kind| Arc::clone(&kind.request));
        let entry = Service { member, type_name: ros1_name(type_name), request, provider };
        let replaced = state.services.insert(service.to_owned(), entry);
        drop(state);
        drop(replaced);
        Ok(())
    }

    fn unadvertise_service(&self, member: MemberId, service: &str) -> Result<(), BusError> {
        let mut state = self.write();
        if state.services.get(service).is_none_or(|entry| entry.member != member) {
            return Err(BusError::NoService { service: service.to_owned() });
        }
        let removed = state.services.remove(service);
        drop(state);
        drop(removed);
        Ok(())
    }

    fn message_type(&self, name: &str) -> Option<Arc<MessageType>> {
        builtin_type(name)
    }

    fn service_type(&self, name: &str) -> Option<Arc<ServiceType>> {
        service_types::builtin_service_type(name)
    }

    fn call_service(&self, service: &str, arguments: Json, reply: ServiceReply) {
        let state = self.read();
        let found =
            state.services.get(service).map(|entry| (entry.request.clone(), Arc::clone(&entry.provider)));
        drop(state);
        let Some((request, provider)) = found else {
            return reply.answer(Err(format!("service {service} is offered by nobody")));
        };
        match service_types::arguments_by_name(request.as_deref(), arguments) {
            Ok(arguments) => provider.call(arguments, reply),
            Err(reason) => reply.answer(Err(format!("call of {service}: {reason}"))),
        }
    }

    fn graph(&self) -> Graph {
        let state = self.read();
        let name = |member: &MemberId| state.members.get(member).cloned().unwrap_or_default();
        let topics = state.topics.iter().map(|(topic, entry)| {
            let info = TopicInfo {
                type_name: entry.kind.as_ref().map(|kind| kind.name.clone()).unwrap_or_default(),
                publishers: entry.publishers.keys().map(name).collect(),
                subscribers: entry.subscribers.keys().map(name).collect(),
            };
            (topic.clone(), info)
        });
        let services = state.services.iter().map(|(service, entry)| {
            let info = ServiceInfo { type_name: entry.type_name.clone(), provider: name(&entry.member) };
            (service.clone(), info)
        });
        Graph {
            topics: topics.collect(),
            services: services.collect(),
            members: state.members.values().cloned().collect(),
        }
    }
}
