//! A node's publishers, and the server that all of them share.

use super::{
    connection::QueueLimits,
    statistics,
    topic_server::{OfferedTopic, TopicDescription, TopicServer, TopicServerOptions},
};
use rosrust::{
    Clock, Message, RawMessage, RawMessageDescription,
    error::{Error, Result},
};
use std::{
    collections::BTreeMap,
    io,
    marker::PhantomData,
    sync::{
        Arc, Mutex, MutexGuard, Once, OnceLock, PoisonError,
        atomic::{AtomicU64, AtomicUsize, Ordering},
    },
    time::{Duration, Instant},
};
use xml_rpc::{Params, Response, Value};

/// Bytes that may wait for one subscriber of a topic, whatever the number of messages: pictures are large.
const QUEUE_BYTES: usize = 16 << 20;
/// From one look at the master to the next, while a last message waits for its subscribers.
const SUBSCRIBER_POLL_PERIOD: Duration = Duration::from_millis(50);

/// What parameters of the node say about its publishers.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PublishingSettings {
    /// A subscriber that takes nothing for this long is closed.
    pub write_timeout: Duration,
    /// Queue length for each subscriber, in place of the topics' own.
    pub queue_size: Option<usize>,
    /// Takes a sentence for the log.
    pub log: fn(&str),
}

struct PublishingState {
    server: Arc<TopicServer>,
    settings: PublishingSettings,
}

/// A process has one node.
static PUBLISHING_STATE: OnceLock<PublishingState> = OnceLock::new();
/// Held while the node joins the graph.
static JOIN_LOCK: Mutex<()> = Mutex::new(());
/// Topics of this process that are registered with the master, and how many publishers each has. Held while the master is
/// called: a topic that is taken back and offered again must reach the master in this order.
static REGISTRATIONS: Mutex<BTreeMap<String, TopicRegistration>> = Mutex::new(BTreeMap::new());

struct TopicRegistration {
    publishers: usize,
    /// Registers the topic while it lives. No message is sent by it.
    _registration: rosrust::Publisher<RawMessage>,
}

fn lock<T>(of: &Mutex<T>) -> MutexGuard<'_, T> {
    // No code that holds one of these locks can panic half way through a change.
    of.lock().unwrap_or_else(PoisonError::into_inner)
}

/// While this lives, the node is about to join: subscribers that ask for a topic wait. rosrust registers `/rosout` itself, and
/// its subscriber would get rosrust's publisher in place of ours.
pub(crate) struct JoinGuard {
    _guard: MutexGuard<'static, ()>,
}

/// Before rosrust joins the graph. Calls of the node's XML-RPC server are answered here first from now on.
pub(crate) fn join() -> JoinGuard {
    xml_rpc::intercept_calls(handle_call);
    JoinGuard { _guard: lock(&JOIN_LOCK) }
}

/// Starts the server, once rosrust has joined the graph.
///
/// # Errors
/// No free port, or no thread.
pub(crate) fn start(settings: PublishingSettings) -> io::Result<()> {
    let (host, node) = (rosrust::hostname(), rosrust::name());
    // As rosrust does: a node of this machine alone is not to be reached from others.
    let is_local = host == "localhost" || host.starts_with("127.");
    let address = if is_local { host.as_str() } else { "0.0.0.0" };
    let options = TopicServerOptions {
        node: node.clone(),
        write_timeout: settings.write_timeout,
        log: Box::new(settings.log),
    };
    let hub = TopicServer::bind((address, 0), options)?;
    let watching = hub.clone();
    std::thread::Builder::new()
        .name("statistics".to_owned())
        .spawn(move || statistics::run_statistics(&watching, &node))?;
    // rosrust refuses a second node in the process before this is reached again.
    let _ = PUBLISHING_STATE.set(PublishingState { server: hub, settings });
    Ok(())
}

/// Topics that this node publishes.
pub(crate) fn topics() -> Vec<String> {
    PUBLISHING_STATE
        .get()
        .map_or_else(Vec::new, |shared| shared.server.topics().into_iter().map(|(topic, _)| topic).collect())
}

/// A publisher of messages `M`. Sending never waits for a subscriber: each has a queue of its own, which drops its oldest
/// message. Several publishers of a topic in one process share its connections.
pub(crate) struct Publisher<M: Message> {
    topic: String,
    offered_topic: Arc<OfferedTopic>,
    clock: Arc<dyn Clock>,
    sequence: Arc<AtomicUsize>,
    messages: PhantomData<fn(M)>,
}

impl<M: Message> Publisher<M> {
    /// A publisher whose subscribers have a queue of `queue` messages each. Names follow the node's namespace and remaps. With
    /// `latched`, who subscribes later gets the last message.
    ///
    /// # Errors
    /// A name that cannot be resolved, a topic that this node publishes with another type, or a master that refuses.
    pub(crate) fn new(topic: &str, queue: usize, latched: bool) -> Result<Self> {
        let description =
            TopicDescription { type_name: M::msg_type(), md5: M::md5sum(), definition: M::msg_definition() };
        Self::with_description(topic, queue, latched, description)
    }

    /// [`Publisher::new`] for a type that is known at run time alone.
    ///
    /// # Errors
    /// As [`Publisher::new`].
    pub(crate) fn with_description(
        name: &str,
        queue: usize,
        latched: bool,
        description: TopicDescription,
    ) -> Result<Self> {
        let shared = PUBLISHING_STATE.get().ok_or("the node has not joined the graph")?;
        let parameter =
            rosrust::param(name).ok_or_else(|| Error::from(format!("{name:?} is not a valid name")))?;
        let topic = parameter.name().to_owned();
        let messages = shared.settings.queue_size.unwrap_or(queue).max(1);
        let limits = QueueLimits { messages, bytes: QUEUE_BYTES };
        let mut registered = lock(&REGISTRATIONS);
        // Before the master tells subscribers where to ask.
        let topic_publisher = shared.server.advertise(&topic, &description, limits);
        let here = topic_publisher.description();
        if (&here.type_name, &here.md5) != (&description.type_name, &description.md5) {
            let reason =
                format!("{topic} is published as {} already, not {}", here.type_name, description.type_name);
            return Err(reason.into());
        }
        if let Some(known) = registered.get_mut(&topic) {
            known.publishers += 1;
        } else {
            let TopicDescription { type_name, md5, definition } = description;
            let description =
                RawMessageDescription { msg_definition: definition, md5sum: md5, msg_type: type_name };
            match rosrust::publish_with_description(name, 1, description) {
                Ok(registration) => {
                    registered.insert(
                        topic.clone(),
                        TopicRegistration { publishers: 1, _registration: registration },
                    );
                }
                Err(error) => {
                    shared.server.unadvertise(&topic);
                    return Err(error);
                }
            }
        }
        drop(registered);
        if latched {
            topic_publisher.latch();
        }
        Ok(Self {
            topic,
            offered_topic: topic_publisher,
            clock: Arc::new(GraphClock),
            sequence: Arc::default(),
            messages: PhantomData,
        })
    }

    /// Sends a message, stamped with the graph's time where its header has no stamp.
    ///
    /// # Errors
    /// A message that cannot be encoded.
    pub(crate) fn send(&self, mut message: M) -> Result<()> {
        message.set_header(&self.clock, &self.sequence);
        self.offered_topic.send(&message.encode_vec()?.into());
        Ok(())
    }

    /// Nodes that are connected.
    pub(crate) fn subscriber_count(&self) -> usize {
        self.offered_topic.subscriber_count()
    }

    /// Waits until every subscriber that the master knows is connected and has what was sent, at most for `timeout`.
    pub(crate) fn flush(&self, timeout: Duration) {
        let deadline = Instant::now() + timeout;
        let is_connected = || {
            let Ok(state) = rosrust::state() else { return true };
            let here = self.offered_topic.subscribers();
            let mut known = state.subscribers.into_iter().filter(|topic| topic.name == self.topic);
            known.all(|topic| topic.connections.iter().all(|name| here.contains(name)))
        };
        while !is_connected() && Instant::now() < deadline {
            std::thread::sleep(SUBSCRIBER_POLL_PERIOD);
        }
        self.offered_topic.flush(deadline);
    }
}

impl<M: Message> Drop for Publisher<M> {
    fn drop(&mut self) {
        let mut registered = lock(&REGISTRATIONS);
        let Some(known) = registered.get_mut(&self.topic) else { return };
        known.publishers -= 1;
        if known.publishers == 0 {
            if let Some(shared) = PUBLISHING_STATE.get() {
                shared.server.unadvertise(&self.topic);
            }
            registered.remove(&self.topic);
        }
    }
}

/// The graph's time, for headers without a stamp.
struct GraphClock;

impl Clock for GraphClock {
    fn now(&self) -> rosrust::Time {
        rosrust::now()
    }

    fn sleep(&self, duration: rosrust::Duration) {
        rosrust::sleep(duration);
    }

    fn wait_until(&self, time: rosrust::Time) {
        rosrust::sleep(time - rosrust::now());
    }
}

/// Calls to the node that rosrust does not answer as is needed here; `None` leaves a call to rosrust.
fn handle_call(method: &str, params: &Params) -> Option<Response> {
    match method {
        "requestTopic" => request_topic(arguments(params)),
        "getBusInfo" => bus_info(),
        "shutdown" => {
            let reason = match arguments(params) {
                [_, Value::String(reason), ..] => reason.as_str(),
                _ => "no reason given",
            };
            // The master may ask more than once.
            static LOGGED: Once = Once::new();
            if let Some(shared) = PUBLISHING_STATE.get() {
                // Of a second node of this name the master says "new node registered with same name".
                LOGGED.call_once(|| {
                    (shared.settings.log)(&format!("this node was asked to shut down: {reason}"))
                });
            }
            None
        }
        _ => None,
    }
}

/// Some callers put the arguments into one array.
fn arguments(params: &Params) -> &[Value] {
    match &params[..] {
        [Value::Array(inner), ..] => inner,
        all => all,
    }
}

fn success_response(what: &str, value: Value) -> Option<Response> {
    Some(Ok(vec![Value::Array(vec![Value::Int(1), Value::String(what.to_owned()), value])]))
}

fn request_topic(arguments: &[Value]) -> Option<Response> {
    let [_, Value::String(topic), Value::Array(protocols), ..] = arguments else { return None };
    drop(lock(&JOIN_LOCK));
    let hub = &PUBLISHING_STATE.get()?.server;
    hub.topic(topic)?;
    let is_tcpros = |protocol: &Value| {
        matches!(protocol, Value::Array(words)
            if matches!(words.first(), Some(Value::String(name)) if name == "TCPROS"))
    };
    protocols.iter().any(is_tcpros).then_some(())?;
    let location = [
        Value::String("TCPROS".to_owned()),
        Value::String(rosrust::hostname()),
        Value::Int(hub.port().into()),
    ];
    success_response("ready", Value::Array(location.into()))
}

/// Connections that this node publishes by, for `rosnode info`. rosrust does not say which it subscribes by.
fn bus_info() -> Option<Response> {
    /// Numbers of the connections that were listed.
    static NUMBER: AtomicU64 = AtomicU64::new(0);
    // A node that is just starting has none.
    let bus = PUBLISHING_STATE.get().map(|state| state.server.bus()).unwrap_or_default();
    let connections = bus.into_iter().map(|connection| {
        let number = NUMBER.fetch_add(1, Ordering::Relaxed) as i32;
        Value::Array(vec![
            Value::Int(number),
            Value::String(connection.subscriber),
            Value::String("o".to_owned()),
            Value::String("TCPROS".to_owned()),
            Value::String(connection.topic),
            Value::Bool(true),
        ])
    });
    success_response("bus info", Value::Array(connections.collect()))
}
