//! Goals of clients for action servers: rosbridge's operations for actions of ROS 2 on the five topics of ROS 1's actionlib,
//! `goal`, `cancel`, `feedback`, `result` and `status` below the action's name.
//!
//! A goal is published once its server listens. It ends with the server's result; without one when the server goes, or no
//! longer lists the goal. The goals of a client that goes are cancelled.

use crate::{
    bus::{BusError, Graph, MemberId, TopicBus, TopicMessage, TopicSink, check_name, check_type},
    outbox::{Compression, Outbox, QueuedReply},
    service_types,
    session::ReceiveTime,
};
use proact_messages::{FieldType, MessageValue, RosVersion, Time, ros1_name, ros2_json};
use serde_json::{Map, Value as Json, json};
use std::{
    collections::{BTreeMap, HashMap, HashSet},
    sync::{Arc, Mutex, MutexGuard, PoisonError},
    time::{Duration, Instant},
};

/// Most goals of one client that are in progress.
const MAX_GOALS: usize = 1000;
/// A goal waits so long for a connection to its server.
const CONNECT_TIMEOUT: Duration = Duration::from_secs(5);
/// The server's topics are taken as connected after this time without a status list, too.
const STATUS_WAIT: Duration = Duration::from_secs(1);
/// A goal that status lists leave out for so long is lost, as is a result that does not follow the goal's last status.
const LOST_GOAL_TIMEOUT: Duration = Duration::from_secs(5);
/// Topics of an action are given up after this time without a goal.
const IDLE_TIMEOUT: Duration = Duration::from_secs(30);
/// Most names of actions in an answer.
const MAX_LISTED_ACTIONS: usize = 20;

/// Longest reason for which a goal failed, letters.
const MAX_REASON_CHARS: usize = 1000;

const GOAL_ID: &str = "actionlib_msgs/GoalID";

/// `STATUS_CANCELED` of `action_msgs/GoalStatus`.
const CANCELED: u8 = 5;

/// The action servers on a bus: name and type, such as `control_msgs/FollowJointTrajectory`.
pub(crate) fn action_servers(graph: &Graph) -> BTreeMap<&str, &str> {
    let mut found = BTreeMap::new();
    for (topic, goal) in &graph.topics {
        let names = (topic.strip_suffix("/goal"), goal.type_name.strip_suffix("ActionGoal"));
        let (Some(action), Some(type_name)) = names else { continue };
        let Some(result) = graph.topics.get(&format!("{action}/result")) else { continue };
        let same_type = result.type_name.strip_suffix("ActionResult") == Some(type_name);
        if same_type && !goal.subscribers.is_empty() && !result.publishers.is_empty() {
            found.insert(action, type_name);
        }
    }
    found
}

/// Who sent a goal, and how the client wants to hear of it.
pub(crate) struct GoalClient {
    pub(crate) client: MemberId,
    pub(crate) outbox: Arc<Outbox>,
    /// The goal's id, text or number.
    pub(crate) id: Option<Json>,
    /// The action as the client calls it.
    pub(crate) client_action_name: String,
    pub(crate) feedback: bool,
    pub(crate) fragment_size: Option<usize>,
    pub(crate) compression: Compression,
    pub(crate) ros_version: RosVersion,
}

impl GoalClient {
    fn send_message(&self, op: &str, fields: Json) {
        let mut message = json!({"op": op, "action": self.client_action_name});
        if let (Some(message), Json::Object(fields)) = (message.as_object_mut(), fields) {
            message.extend(fields);
            message.extend(self.id.clone().map(|id| ("id".to_owned(), id)));
        }
        self.outbox.reply(QueuedReply {
            text: message.to_string().into(),
            fragment_size: self.fragment_size,
            compression: self.compression,
        });
    }

    fn convert_values(&self, values: Json) -> Json {
        if self.ros_version == RosVersion::Ros2 { ros2_json(values) } else { values }
    }

    fn send_result(&self, status: u8, values: Json) {
        // Some servers leave out the result of a goal that was cancelled.
        let values = if values.is_null() { Json::Object(Map::new()) } else { values };
        self.send_message(
            "action_result",
            json!({"values": self.convert_values(values), "status": status, "result": true}),
        );
    }

    /// No result comes. What the client wrote itself may be in the reason, and may be long.
    pub(crate) fn send_failure(&self, reason: &str) {
        let reason: String = reason.chars().take(MAX_REASON_CHARS).collect();
        self.send_message("action_result", json!({"values": reason, "status": 0, "result": false}));
    }
}

/// How a goal ended.
enum GoalEnd {
    /// With a result; the status is that of `action_msgs/GoalStatus`.
    Result(u8),
    /// It was never taken on.
    Rejected,
    /// The server does not know how.
    Lost,
}

/// Whether `actionlib_msgs/GoalStatus` means an end.
fn goal_end(status: i64) -> Option<GoalEnd> {
    match status {
        3 => Some(GoalEnd::Result(4)),
        2 | 8 => Some(GoalEnd::Result(CANCELED)),
        4 => Some(GoalEnd::Result(6)),
        5 => Some(GoalEnd::Rejected),
        9 => Some(GoalEnd::Lost),
        _ => None,
    }
}

enum GoalStage {
    /// Until the server listens.
    Waiting { goal: Arc<TopicMessage>, since: Instant },
    /// With the first of the latest status lists that leave it out.
    Sent { missing: Option<Instant> },
    /// The status list says so; its result is on the way.
    Ended { since: Instant },
}

struct PendingGoal {
    action: Arc<str>,
    sender: GoalClient,
    stage: GoalStage,
}

#[derive(Default)]
struct PendingGoalsState {
    /// By their ids on the bus.
    goals: HashMap<String, PendingGoal>,
    /// Actions of which a status list has come.
    status_received: HashSet<Arc<str>>,
}

/// The goals in progress. The bus hands it what servers publish.
#[derive(Default)]
struct PendingGoals {
    state: Mutex<PendingGoalsState>,
}

fn lock<T>(of: &Mutex<T>) -> MutexGuard<'_, T> {
    // No code that holds one of these locks can panic half way through a change.
    of.lock().unwrap_or_else(PoisonError::into_inner)
}

impl PendingGoals {
    fn take(&self, action: &str, id: &str) -> Option<PendingGoal> {
        let mut open = lock(&self.state);
        open.goals.get(id).filter(|goal| &*goal.action == action)?;
        open.goals.remove(id)
    }

    fn feedback(&self, action: &str, mut message: Json) {
        let open = lock(&self.state);
        let goal = goal_id(&message["status"]).and_then(|id| open.goals.get(id));
        if let Some(goal) = goal.filter(|goal| &*goal.action == action && goal.sender.feedback) {
            let values = goal.sender.convert_values(take_field(&mut message, "feedback"));
            goal.sender.send_message("action_feedback", json!({"values": values}));
        }
    }

    fn result(&self, action: &str, mut message: Json) {
        let status = take_field(&mut message, "status");
        let Some(goal) = goal_id(&status).and_then(|id| self.take(action, id)) else { return };
        let text = status["text"].as_str().unwrap_or_default().to_owned();
        match status["status"].as_i64().and_then(goal_end) {
            Some(GoalEnd::Result(status)) => {
                goal.sender.send_result(status, take_field(&mut message, "result"))
            }
            Some(GoalEnd::Rejected) => goal.sender.send_failure(&format!("the goal was rejected: {text}")),
            Some(GoalEnd::Lost) => goal.sender.send_failure(&format!("the goal was lost: {text}")),
            None => goal.sender.send_failure(&format!(
                "the server's result has the status {}, which is no end of a goal",
                status["status"]
            )),
        }
    }

    fn status(&self, action: &Arc<str>, message: &Json, now: Instant) {
        let mut open = lock(&self.state);
        open.status_received.insert(Arc::clone(action));
        let list = message["status_list"].as_array().map(Vec::as_slice).unwrap_or_default();
        let listed: HashMap<&str, i64> =
            list.iter().filter_map(|goal| Some((goal_id(goal)?, goal["status"].as_i64()?))).collect();
        let mut lost = Vec::new();
        for (id, goal) in open.goals.iter_mut().filter(|(_, goal)| goal.action == *action) {
            let GoalStage::Sent { missing } = &mut goal.stage else { continue };
            match listed.get(&**id).copied().map(goal_end) {
                Some(Some(_)) => goal.stage = GoalStage::Ended { since: now },
                Some(None) => *missing = None,
                None if now.duration_since(*missing.get_or_insert(now)) >= LOST_GOAL_TIMEOUT => {
                    lost.push(id.clone())
                }
                None => {}
            }
        }
        for goal in lost.iter().filter_map(|id| open.goals.remove(id)) {
            goal.sender.send_failure(&format!("action {action}: its server lists the goal no longer"));
        }
    }

    /// Whether the goal may be published: its server is connected both ways, as far as can be seen.
    fn server_is_connected(&self, action: &str, since: Instant, now: Instant) -> bool {
        lock(&self.state).status_received.contains(action) || now.duration_since(since) >= STATUS_WAIT
    }
}

/// A field of a message, taken out.
fn take_field(message: &mut Json, name: &str) -> Json {
    message.get_mut(name).map(Json::take).unwrap_or_default()
}

/// The id in something with a `goal_id`.
fn goal_id(status: &Json) -> Option<&str> {
    status["goal_id"]["id"].as_str()
}

/// One topic of an action server.
struct ActionTopicSink {
    action: Arc<str>,
    topic: ActionTopic,
    goals: Arc<PendingGoals>,
}

#[derive(Clone, Copy)]
enum ActionTopic {
    Feedback,
    Result,
    Status,
}

impl TopicSink for ActionTopicSink {
    fn deliver(&self, message: &Arc<TopicMessage>) {
        let Ok(json) = serde_json::to_value(&message.value) else { return };
        match self.topic {
            ActionTopic::Feedback => self.goals.feedback(&self.action, json),
            ActionTopic::Result => self.goals.result(&self.action, json),
            ActionTopic::Status => self.goals.status(&self.action, &json, Instant::now()),
        }
    }

    fn wake(&self) {}
}

/// An action whose topics are connected.
struct ActionConnection {
    connected_at: Instant,
    last_used_at: Instant,
}

#[derive(Default)]
struct ActionConnections {
    /// In whose name goals are published, from the first one on.
    member: Option<MemberId>,
    actions: HashMap<Arc<str>, ActionConnection>,
    next: u64,
}

/// The actions of a bus, for all clients.
pub(crate) struct ActionBridge {
    bus: Arc<dyn TopicBus>,
    connections: Mutex<ActionConnections>,
    goals: Arc<PendingGoals>,
}

impl ActionBridge {
    pub(crate) fn new(bus: Arc<dyn TopicBus>) -> Self {
        Self { bus, connections: Mutex::default(), goals: Arc::default() }
    }

    /// Sends a goal.
    ///
    /// # Errors
    /// One sentence; the caller tells the sender, which comes back.
    pub(crate) fn send(
        &self,
        action: &str,
        type_name: &str,
        arguments: Json,
        sender: GoalClient,
        now: ReceiveTime,
    ) -> Result<(), (GoalClient, String)> {
        let kind = match self.check_goal(action, type_name, &sender) {
            Ok(kind) => kind,
            Err(reason) => return Err((sender, reason)),
        };
        let mut links = lock(&self.connections);
        links.next += 1;
        // The time tells it from a goal of a bridge that ran before.
        let id = format!("rosbridge-{}-{}.{:09}", links.next, now.time.secs, now.time.nsecs);
        let name: Arc<str> = action.into();
        let message = self
            .connect(&mut links, &name, &kind, now.instant)
            .map_err(|error| error.to_string())
            .and_then(|()| self.goal_message(action, &id, arguments));
        let message = match message {
            Ok(message) => message,
            Err(reason) => return Err((sender, reason)),
        };
        let stage = GoalStage::Waiting { goal: message, since: now.instant };
        lock(&self.goals.state).goals.insert(id, PendingGoal { action: name, sender, stage });
        drop(links);
        self.poll(now.instant);
        Ok(())
    }

    /// The type of the action, after what can be checked before its topics are connected.
    fn check_goal(&self, action: &str, type_name: &str, sender: &GoalClient) -> Result<String, String> {
        check_name("action", action)
            .and_then(|()| check_type(type_name))
            .map_err(|error| error.to_string())?;
        let graph = self.bus.graph();
        let servers = action_servers(&graph);
        let Some(kind) = servers.get(action) else {
            let names: Vec<&str> = servers.keys().copied().take(MAX_LISTED_ACTIONS).collect();
            let more = servers.len() - names.len();
            return Err(match (names.is_empty(), more) {
                (true, _) => format!("there is no action {action}; there are none here"),
                (_, 0) => format!("there is no action {action}; there are {}", names.join(", ")),
                _ => format!("there is no action {action}; there are {} and {more} more", names.join(", ")),
            });
        };
        if ros1_name(type_name) != *kind {
            return Err(format!("action {action} has the type {kind}, got {type_name}"));
        }
        let open = lock(&self.goals.state);
        let own = || open.goals.values().filter(|goal| goal.sender.client == sender.client);
        if own().count() >= MAX_GOALS {
            return Err(format!("{MAX_GOALS} goals of this client are in progress; wait for one to end"));
        }
        if sender.id.is_some() && own().any(|goal| goal.sender.id == sender.id) {
            return Err("a goal of this client with the same id is in progress; give each its own".to_owned());
        }
        Ok((*kind).to_owned())
    }

    /// Connects the five topics, if they are not.
    fn connect(
        &self,
        links: &mut ActionConnections,
        action: &Arc<str>,
        kind: &str,
        now: Instant,
    ) -> Result<(), BusError> {
        if let Some(link) = links.actions.get_mut(action) {
            link.last_used_at = now;
            return Ok(());
        }
        let member = *links.member.get_or_insert_with(|| self.bus.join("/rosbridge_actions"));
        let subscribe = |part, topic: &str, type_name: &str| {
            let sink =
                ActionTopicSink { action: Arc::clone(action), topic: part, goals: Arc::clone(&self.goals) };
            self.bus.subscribe(member, &format!("{action}/{topic}"), Some(type_name), Arc::new(sink))
        };
        let linked = subscribe(ActionTopic::Result, "result", &format!("{kind}ActionResult"))
            .and_then(|()| subscribe(ActionTopic::Feedback, "feedback", &format!("{kind}ActionFeedback")))
            .and_then(|()| subscribe(ActionTopic::Status, "status", "actionlib_msgs/GoalStatusArray"))
            .and_then(|()| {
                self.bus.advertise(member, &format!("{action}/goal"), &format!("{kind}ActionGoal"), false)
            })
            .and_then(|()| self.bus.advertise(member, &format!("{action}/cancel"), GOAL_ID, false));
        match &linked {
            Ok(()) => {
                links
                    .actions
                    .insert(Arc::clone(action), ActionConnection { connected_at: now, last_used_at: now });
            }
            Err(_) => self.disconnect(member, action),
        }
        linked
    }

    fn disconnect(&self, member: MemberId, action: &str) {
        for topic in ["result", "feedback", "status"] {
            // One that was refused has nothing to end.
            let _ = self.bus.unsubscribe(member, &format!("{action}/{topic}"));
        }
        for topic in ["goal", "cancel"] {
            let _ = self.bus.unadvertise(member, &format!("{action}/{topic}"));
        }
        lock(&self.goals.state).status_received.remove(action);
    }

    /// A goal as its server reads it. A time that is left out is zero, which servers read as "at once".
    fn goal_message(&self, action: &str, id: &str, arguments: Json) -> Result<Arc<TopicMessage>, String> {
        let topic = format!("{action}/goal");
        let definition = self.bus.topic_type(&topic).and_then(|kind| kind.definition);
        let goal =
            definition.as_ref().and_then(|kind| kind.fields.iter().find(|field| &*field.name == "goal"));
        let goal = match goal.map(|field| &field.kind) {
            Some(FieldType::Message(goal)) => service_types::arguments_by_name(Some(goal), arguments)?,
            _ if arguments.is_array() => {
                return Err(format!(
                    "the fields of {action}'s goals are not known here; give args as an object"
                ));
            }
            _ => service_types::arguments_by_name(None, arguments)?,
        };
        let zero = json!({"secs": 0, "nsecs": 0});
        let whole = json!({
            "header": {"stamp": zero, "frame_id": ""}, "goal_id": {"stamp": zero, "id": id}, "goal": goal,
        });
        self.read_message(topic, whole)
    }

    fn read_message(&self, topic: String, json: Json) -> Result<Arc<TopicMessage>, String> {
        let definition = self.bus.topic_type(&topic).and_then(|kind| kind.definition);
        let value = match &definition {
            Some(kind) => kind.parse_json(json, Time::default()).map_err(|error| error.to_string())?,
            None => MessageValue::Opaque(json),
        };
        Ok(TopicMessage::new(topic, definition, value))
    }

    /// Cancels a goal of a client. False if no such goal is in progress.
    pub(crate) fn cancel(&self, client: MemberId, action: &str, id: &Json) -> bool {
        let open = lock(&self.goals.state);
        let own = open.goals.iter().find(|(_, goal)| {
            goal.sender.client == client && &*goal.action == action && goal.sender.id.as_ref() == Some(id)
        });
        let found = own.map(|(id, _)| id.clone());
        drop(open);
        let Some(id) = found else { return false };
        self.send_cancel(action, &id);
        true
    }

    /// Cancels the goals for an action that came through this server; false if it knows no such action.
    pub(crate) fn cancel_all(&self, action: &str) -> bool {
        let ids = self.goal_ids(|goal| &*goal.action == action);
        for (action, id) in &ids {
            self.send_cancel(action, id);
        }
        !ids.is_empty() || action_servers(&self.bus.graph()).contains_key(action)
    }

    /// The client is gone: what it set going is cancelled.
    pub(crate) fn cancel_client_goals(&self, client: MemberId) {
        for (action, id) in self.goal_ids(|goal| goal.sender.client == client) {
            self.send_cancel(&action, &id);
            self.goals.take(&action, &id);
        }
    }

    fn goal_ids(&self, which: impl Fn(&PendingGoal) -> bool) -> Vec<(Arc<str>, String)> {
        let open = lock(&self.goals.state);
        let found = open.goals.iter().filter(|(_, goal)| which(goal));
        found.map(|(id, goal)| (Arc::clone(&goal.action), id.clone())).collect()
    }

    fn send_cancel(&self, action: &str, id: &str) {
        let mut open = lock(&self.goals.state);
        let waits = open.goals.get(id).is_some_and(|goal| matches!(goal.stage, GoalStage::Waiting { .. }));
        let never_sent = if waits { open.goals.remove(id) } else { None };
        drop(open);
        if let Some(goal) = never_sent {
            return goal.sender.send_result(CANCELED, Json::Object(Map::new()));
        }
        let cancel = json!({"stamp": {"secs": 0, "nsecs": 0}, "id": id});
        match self.read_message(format!("{action}/cancel"), cancel) {
            Ok(message) => self.bus.publish(&[message]),
            Err(reason) => {
                if let Some(goal) = self.goals.take(action, id) {
                    goal.sender.send_failure(&format!("it cannot be cancelled: {reason}"));
                }
            }
        }
    }

    /// Publishes goals whose servers listen by now, gives up those whose servers are gone, and topics that nobody needs.
    pub(crate) fn poll(&self, now: Instant) {
        let actions: HashSet<Arc<str>> =
            lock(&self.goals.state).goals.values().map(|g| g.action.clone()).collect();
        for action in actions {
            let reached = self.bus.receiver_count(&format!("{action}/goal")) > 0;
            let since = lock(&self.connections).actions.get_mut(&action).map(|link| {
                link.last_used_at = now;
                link.connected_at
            });
            let ready =
                reached && since.is_some_and(|since| self.goals.server_is_connected(&action, since, now));
            let (mut messages, mut failed) = (Vec::new(), Vec::new());
            let mut open = lock(&self.goals.state);
            for (id, goal) in open.goals.iter_mut().filter(|(_, goal)| goal.action == action) {
                match &goal.stage {
                    GoalStage::Waiting { goal: message, .. } if ready => {
                        messages.push(Arc::clone(message));
                        goal.stage = GoalStage::Sent { missing: None };
                    }
                    GoalStage::Waiting { since, .. } if now.duration_since(*since) >= CONNECT_TIMEOUT => failed.push((
                        id.clone(),
                        "no connection to its server within 5 s; if the action's package is not on this machine, see \
                         ROS_PACKAGE_PATH",
                    )),
                    GoalStage::Sent { .. } if !reached => failed.push((id.clone(), "its server is gone")),
                    GoalStage::Ended { since } if now.duration_since(*since) >= LOST_GOAL_TIMEOUT => {
                        failed.push((id.clone(), "it has ended, and its server sent no result"));
                    }
                    _ => {}
                }
            }
            let failed: Vec<_> =
                failed.into_iter().filter_map(|(id, why)| Some((open.goals.remove(&id)?, why))).collect();
            drop(open);
            for message in messages {
                self.bus.publish(&[message]);
            }
            for (goal, why) in failed {
                goal.sender.send_failure(&format!("action {action}: {why}"));
            }
        }
        self.disconnect_idle(now);
    }

    fn disconnect_idle(&self, now: Instant) {
        let mut links = lock(&self.connections);
        let Some(member) = links.member else { return };
        let idle = |link: &ActionConnection| now.duration_since(link.last_used_at) >= IDLE_TIMEOUT;
        let gone: Vec<_> = links.actions.extract_if(|_, link| idle(link)).map(|(action, _)| action).collect();
        for action in gone {
            self.disconnect(member, &action);
        }
    }
}

impl Drop for ActionBridge {
    fn drop(&mut self) {
        if let Some(member) = lock(&self.connections).member {
            self.bus.leave(member);
        }
    }
}
