//! The graph for programs that learn types at run time: raw topics and services, for the rosbridge server.

mod definitions;
mod services;

pub use definitions::{DefinitionSources, MessageDefinition};
pub use services::{RawService, ServiceHandler};

use super::{NodeError, RosGraph, master::MasterAddresses};
use crate::publishing::{Publisher, TopicDescription};
use proact_messages::ServiceType;
use rosrust::{RawMessage, Subscriber, SubscriptionHandler};
use std::{
    collections::{BTreeMap, HashMap},
    sync::Arc,
    time::{Duration, Instant},
};

/// Messages that wait for one subscriber or subscription.
const QUEUE: usize = 100;
/// What the master says is believed for so long.
const CACHE_DURATION: Duration = Duration::from_secs(1);

/// A message as it came.
#[derive(Debug)]
pub struct RawIncoming<'a> {
    /// Type, as the publisher has it.
    pub type_name: &'a str,
    /// Its definition with all that it needs.
    pub text: &'a str,
    /// Whether whoever comes later gets it too.
    pub latched: bool,
    /// The content, without its length.
    pub bytes: &'a [u8],
}

/// A topic that raw messages are published on, until it is dropped.
pub struct RawPublisher {
    publisher: Publisher<RawMessage>,
    latched: bool,
}

impl RawPublisher {
    /// Publishes a message, given without its length. Without subscribers it is kept only if the topic is latched.
    ///
    /// # Errors
    /// One sentence.
    pub fn send(&self, bytes: Vec<u8>) -> Result<(), String> {
        if !self.latched && self.publisher.subscriber_count() == 0 {
            return Ok(());
        }
        self.publisher.send(RawMessage(bytes)).map_err(|error| error.to_string())
    }

    /// Nodes that are connected to the topic.
    pub fn subscriber_count(&self) -> usize {
        self.publisher.subscriber_count()
    }
}

/// A subscription to raw messages, until it is dropped.
pub struct RawSubscriber {
    _subscriber: Subscriber,
}

/// Who does what on the graph.
#[derive(Clone, Debug, Default)]
pub struct GraphState {
    /// Topic to type.
    pub types: BTreeMap<String, String>,
    /// Topic to names of nodes.
    pub publishers: BTreeMap<String, Vec<String>>,
    /// Topic to names of nodes.
    pub subscribers: BTreeMap<String, Vec<String>>,
    /// Service to names of nodes.
    pub services: BTreeMap<String, Vec<String>>,
}

/// A node that passes on what others say.
pub struct Relay {
    graph: RosGraph,
    addresses: MasterAddresses,
    definitions: DefinitionSources,
    graph_state: std::sync::Mutex<Option<(Instant, GraphState)>>,
}

impl Relay {
    /// Joins the graph as `name`, or as `__name:=` says. With `interruptible`, Ctrl-C ends the node; otherwise that is
    /// the caller's.
    ///
    /// # Errors
    /// [`NodeError::NoMaster`].
    pub fn join(name: &str, interruptible: bool) -> Result<Self, NodeError> {
        let mut graph = RosGraph::join_with(name, interruptible)?;
        graph.watch_master()?;
        Ok(Self {
            addresses: graph.addresses()?,
            graph,
            definitions: DefinitionSources::default(),
            graph_state: std::sync::Mutex::default(),
        })
    }

    /// The node's name.
    pub fn name(&self) -> String {
        rosrust::name()
    }

    /// The private parameter `~port`, or `default`.
    ///
    /// # Errors
    /// [`NodeError::Parameter`] for what is no port.
    pub fn port(&self, default: u16) -> Result<u16, NodeError> {
        let port: i32 = super::graph::parameter("~port", default.into(), "a port, 0 to 65535")?;
        u16::try_from(port).map_err(|_| NodeError::Parameter {
            name: "~port".to_owned(),
            got: port.to_string(),
            expected: "a port, 0 to 65535",
        })
    }

    /// Where types are looked up.
    pub fn definitions(&self) -> &DefinitionSources {
        &self.definitions
    }

    /// False when the node is to end.
    pub fn is_ok(&self) -> bool {
        self.graph.is_ok()
    }

    /// Tells `/diagnostics` how things are, once a second at most.
    pub fn publish_diagnostics(&self) {
        self.graph.publish_diagnostics(rosrust::now());
    }

    /// Refuses something that came in: `/rosout` and `/diagnostics` tell.
    pub fn record_refusal(&self, kind: &'static str, reason: &str) {
        self.graph.node_diagnostics().record_refusal(kind, reason);
    }

    /// Who does what. The master is asked once a second at most.
    pub fn graph_state(&self) -> GraphState {
        let mut last = self.graph_state.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        if let Some((at, graph_state)) = &*last
            && at.elapsed() < CACHE_DURATION
        {
            return graph_state.clone();
        }
        let types = rosrust::topics().unwrap_or_default();
        let state = rosrust::state();
        let graph_state = state.map_or_else(
            |_| GraphState::default(),
            |state| GraphState {
                types: types.into_iter().map(|topic| (topic.name, topic.datatype)).collect(),
                publishers: state.publishers.into_iter().map(|t| (t.name, t.connections)).collect(),
                subscribers: state.subscribers.into_iter().map(|t| (t.name, t.connections)).collect(),
                services: state.services.into_iter().map(|t| (t.name, t.connections)).collect(),
            },
        );
        *last = Some((Instant::now(), graph_state.clone()));
        graph_state
    }

    /// A publisher of raw messages.
    ///
    /// # Errors
    /// [`NodeError::Setup`].
    pub fn advertise(
        &self,
        topic: &str,
        kind: &MessageDefinition,
        latched: bool,
    ) -> Result<RawPublisher, NodeError> {
        let description = TopicDescription {
            type_name: kind.kind.name.clone(),
            md5: kind.kind.md5().to_owned(),
            definition: kind.text.clone(),
        };
        let publisher = Publisher::with_description(topic, QUEUE, latched, description)
            .map_err(super::graph::setup_error(topic))?;
        Ok(RawPublisher { publisher, latched })
    }

    /// A subscription to whatever comes there from other nodes. `take` runs in a thread of rosrust's and must not block.
    ///
    /// # Errors
    /// [`NodeError::Setup`].
    pub fn subscribe(
        &self,
        topic: &str,
        take: impl FnMut(&RawIncoming<'_>) + Send + 'static,
    ) -> Result<RawSubscriber, NodeError> {
        let handler = RawSubscription { own_name: rosrust::name(), publishers: HashMap::new(), take };
        let subscriber =
            rosrust::subscribe_with(topic, QUEUE, handler).map_err(super::graph::setup_error(topic))?;
        Ok(RawSubscriber { _subscriber: subscriber })
    }

    /// The type of a service on the graph; its provider is asked.
    ///
    /// # Errors
    /// One sentence.
    pub fn service_type(&self, service: &str) -> Result<String, String> {
        services::service_type(&self.addresses, service)
    }

    /// Calls a service; blocks until the answer is there or `deadline` has passed.
    ///
    /// # Errors
    /// One sentence: the provider's, or why there is no answer.
    pub fn call(
        &self,
        service: &str,
        kind: &ServiceType,
        request: &[u8],
        deadline: Instant,
    ) -> Result<Vec<u8>, String> {
        services::call(&self.addresses, service, kind, request, deadline)
    }

    /// Offers a service. `handler` runs in a thread of each call.
    ///
    /// # Errors
    /// One sentence.
    pub fn advertise_service(
        &self,
        name: &str,
        kind: ServiceType,
        handler: Arc<ServiceHandler>,
    ) -> Result<RawService, String> {
        RawService::serve(&self.addresses, name, kind, handler)
    }
}

/// Hands on messages with what their publishers said of them.
struct RawSubscription<F> {
    own_name: String,
    publishers: HashMap<String, HashMap<String, String>>,
    take: F,
}

impl<F: FnMut(&RawIncoming<'_>) + Send + 'static> SubscriptionHandler<RawMessage> for RawSubscription<F> {
    fn connection(&mut self, headers: HashMap<String, String>) {
        let publisher = headers.get("callerid").cloned().unwrap_or_default();
        self.publishers.insert(publisher, headers);
    }

    fn message(&mut self, message: RawMessage, publisher: &str) {
        // What this node publishes itself has been handed out already.
        if publisher == self.own_name {
            return;
        }
        let Some(headers) = self.publishers.get(publisher) else { return };
        let word = |key: &str| headers.get(key).map_or("", String::as_str);
        (self.take)(&RawIncoming {
            type_name: word("type"),
            text: word("message_definition"),
            latched: word("latching") == "1",
            bytes: &message.0,
        });
    }
}
