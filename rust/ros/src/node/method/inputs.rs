//! What the method listens to.

use super::{MethodNode, STATE};
use crate::{
    gaze_topic_monitor::{GazeTopic, GazeTopicMonitor, GazeUpdate},
    joy,
    messages::{
        geometry_msgs::{PoseStamped, Vector3Stamped},
        proact_msgs::{Decision, Intent, Person, State},
        sensor_msgs::Joy,
        std_msgs::String as Text,
    },
    node::{NodeError, RosGraph, convert, graph::Jobs, stage::StageNode, wire},
};
use proact_emg::EmgOutput;
use proact_messages::original::relative;
use proact_testbed::stages::{EmgStageOutput, GazeFreshness, IntentOutput};
use proact_types::{
    Command, HandState, Heartbeat, HeartbeatKind, InputSource, JointVector, MAX_HEARTBEATS, MethodStyle,
    ObjectId, Point, Pose, Scene, SimTime, TickInput,
};
use rosrust::Subscriber;
use std::collections::VecDeque;

const PERSON: &str = "proact/person";
const DECISION: &str = "proact/decision";
const INTENT: &str = "proact/intent";

/// A block that nobody has looked at for this long is not highlighted, ms.
const HIGHLIGHT_TIMEOUT_MS: u64 = 500;
/// Decisions that wait for a step, at most: half a second of them.
const MAX_PENDING_DECISIONS: usize = 50;

/// In real time: what came since the last step, and what holds on.
pub(super) struct ReceivedInputs {
    /// From our EMG stage: decisions in their order, then what it said last.
    decisions: VecDeque<EmgStageOutput>,
    gesture: EmgStageOutput,
    /// The newest decision, and its tick.
    last_decision: Option<(SimTime, Option<Box<EmgOutput>>)>,
    intent: IntentOutput,
    /// When somebody else's block was looked at.
    highlighted_at: Option<SimTime>,
    /// What other people's topics tell of gaze; our own intent stage tells better.
    gaze_monitor: GazeTopicMonitor,
    has_typed_intent: bool,
    heartbeats: Vec<Heartbeat>,
    shoulder: Option<Pose>,
    limb: Option<JointVector>,
    shoulder_updated: bool,
    /// The gesture and intent of the last step.
    last_inputs: (EmgStageOutput, IntentOutput),
    joystick_gesture: Command,
    /// The newest gesture is the joystick's, whose silence counts then.
    joystick_active: bool,
}

impl ReceivedInputs {
    pub(super) fn new(scene: &Scene) -> Self {
        // Before the first gaze the place is the middle of where objects may be put.
        let place_point = scene.place_region.center(scene.table_height);
        let intent = IntentOutput { place_point, ..IntentOutput::default() };
        Self {
            decisions: VecDeque::new(),
            gesture: EmgStageOutput::default(),
            last_decision: None,
            intent,
            highlighted_at: None,
            gaze_monitor: GazeTopicMonitor::default(),
            has_typed_intent: false,
            heartbeats: vec![],
            shoulder: None,
            limb: None,
            shoulder_updated: false,
            last_inputs: Default::default(),
            joystick_gesture: Command::NoMotion,
            joystick_active: false,
        }
    }

    pub(super) fn record_heartbeat(&mut self, source: InputSource, kind: HeartbeatKind) {
        let heartbeat = Heartbeat { source, kind };
        if self.heartbeats.len() < MAX_HEARTBEATS && !self.heartbeats.contains(&heartbeat) {
            self.heartbeats.push(heartbeat);
        }
    }

    /// What a step at `now` acts on. What came once is gone then.
    pub(super) fn take_inputs(&mut self, now: SimTime) -> (EmgStageOutput, IntentOutput, TickInput) {
        let mut emg_output = self.gesture.clone();
        if let Some(decision) = self.decisions.pop_front() {
            emg_output = decision;
        }
        (self.gesture.published_command, self.gesture.decision) = (None, None);
        self.gesture.events.clear();
        let mut intent = self.intent.clone();
        self.intent.gaze_freshness = None;
        self.intent.events.clear();
        if self.highlighted_at.is_some_and(|at| now.millis_since(at) > HIGHLIGHT_TIMEOUT_MS) {
            self.highlighted_at = None;
            self.intent.highlight = None;
            intent.highlight = None;
        }
        let input = TickInput {
            heartbeats: self.heartbeats.drain(..).take(MAX_HEARTBEATS).collect(),
            shoulder: self.shoulder.filter(|_| std::mem::take(&mut self.shoulder_updated)),
            limb: self.limb.take(),
            ..TickInput::default()
        };
        (emg_output, intent, input)
    }

    /// What the last step acted on.
    pub(super) fn set_last_inputs(&mut self, emg_output: &EmgStageOutput, intent: &IntentOutput) {
        self.last_inputs = (emg_output.clone(), intent.clone());
    }

    pub(super) fn last_inputs(&self) -> (&EmgStageOutput, &IntentOutput) {
        (&self.last_inputs.0, &self.last_inputs.1)
    }

    /// Somebody else's message tells of the gaze.
    fn record_gaze(&mut self, now: SimTime, topic: GazeTopic, values: [f64; 3]) {
        self.intent.eye_seen_at = Some(now);
        match self.gaze_monitor.record(now, topic, values) {
            Some(GazeUpdate::Fresh) => self.intent.gaze_freshness = Some(GazeFreshness::Fresh),
            // A measurement that waits for a step is not to be lost.
            Some(GazeUpdate::Repeated) => {
                self.intent.gaze_freshness.get_or_insert(GazeFreshness::Repeated);
            }
            None => {}
        }
    }

    /// Why somebody else's intent node gives nothing, if it has been silent for longer than `limit_ms`.
    pub(super) fn stale_intent(&self, now: SimTime, limit_ms: u64) -> Option<String> {
        let silent = !self.has_typed_intent && self.gaze_monitor.intent_is_stale(now, limit_ms);
        silent.then(|| format!("the intent node is silent: nothing on {}", relative::BLOCK_ID))
    }
}

pub(super) fn subscribe(graph: &RosGraph, jobs: &Jobs<MethodNode>) -> Result<Vec<Subscriber>, NodeError> {
    let mut all = subscribe_to_stages(graph, jobs)?;
    all.extend(subscribe_to_external_nodes(graph, jobs)?);
    Ok(all)
}

/// What our own stages say, in typed messages.
fn subscribe_to_stages(graph: &RosGraph, jobs: &Jobs<MethodNode>) -> Result<Vec<Subscriber>, NodeError> {
    Ok(vec![
        graph.subscribe(STATE, 100, jobs, |node: &mut MethodNode, m: State| {
            match wire::read_state(&m, node.counts) {
                Ok(instant) => {
                    node.context.record_stamped_input(STATE, &m.header);
                    if !node.context.lockstep {
                        // A simulator that was started again counts anew.
                        node.state = Default::default();
                    }
                    let new = node.state.update(SimTime(m.tick), instant);
                    node.republish_if_repeated(new);
                }
                Err(reason) => node.context.node_diagnostics.record_refusal("state", &reason),
            }
        })?,
        graph.subscribe_with_caller(PERSON, 100, jobs, |node: &mut MethodNode, m: Person, caller| {
            if node.context.register_typed_caller(caller) {
                // What it published of shoulder and gaze in the original's types may have come first.
                for tracker in [InputSource::ShoulderTracker, InputSource::EyeTracker] {
                    node.received.record_heartbeat(tracker, HeartbeatKind::Closed);
                }
            }
            match wire::read_person(&m) {
                Ok((input, _)) if node.context.lockstep => {
                    let new = node.person.update(SimTime(m.tick), input);
                    node.republish_if_repeated(new);
                }
                Ok((input, _)) => {
                    node.context.record_stamped_input(PERSON, &m.header);
                    node.received.shoulder_updated |= input.shoulder.is_some();
                    node.received.shoulder = input.shoulder.or(node.received.shoulder);
                    node.received.limb = input.limb.or(node.received.limb.take());
                    for heartbeat in input.heartbeats {
                        node.received.record_heartbeat(heartbeat.source, heartbeat.kind);
                    }
                }
                Err(reason) => node.context.node_diagnostics.record_refusal("person", &reason),
            }
        })?,
        graph.subscribe_with_caller(DECISION, 100, jobs, |node: &mut MethodNode, m: Decision, caller| {
            node.context.register_typed_caller(caller);
            match wire::read_decision(&m) {
                Ok(output) if node.context.lockstep => {
                    let new = node.decision.update(SimTime(m.tick), output);
                    node.republish_if_repeated(new);
                }
                Ok(output) => {
                    node.context.record_stamped_input(DECISION, &m.header);
                    node.receive_decision(SimTime(m.tick), output);
                }
                Err(reason) => node.context.node_diagnostics.record_refusal("decision", &reason),
            }
        })?,
        graph.subscribe_with_caller(INTENT, 100, jobs, |node: &mut MethodNode, m: Intent, caller| {
            node.context.register_typed_caller(caller);
            node.received.has_typed_intent = true;
            match wire::read_intent(&m, node.counts.objects) {
                Ok(output) if node.context.lockstep => {
                    let new = node.intent.update(SimTime(m.tick), output);
                    node.republish_if_repeated(new);
                }
                Ok(output) => {
                    node.context.record_stamped_input(INTENT, &m.header);
                    // The stage's ticks are not quite these; a measurement that waits is not to be lost.
                    let gaze_freshness = match node.received.intent.gaze_freshness {
                        Some(GazeFreshness::Fresh) => Some(GazeFreshness::Fresh),
                        before => output.gaze_freshness.or(before),
                    };
                    node.received.highlighted_at = output.highlight.map(|_| node.context.now());
                    node.received.intent = IntentOutput { gaze_freshness, ..output };
                }
                Err(reason) => node.context.node_diagnostics.record_refusal("intent", &reason),
            }
        })?,
        graph.subscribe("proact/heartbeat", 100, jobs, |node: &mut MethodNode, m: Text| {
            if !node.context.lockstep {
                node.receive_heartbeat(&m.data);
            }
        })?,
    ])
}

/// What other people's nodes say, in the original's types.
fn subscribe_to_external_nodes(
    graph: &RosGraph,
    jobs: &Jobs<MethodNode>,
) -> Result<Vec<Subscriber>, NodeError> {
    Ok(vec![
        graph.subscribe_with_caller(relative::EMG, 1, jobs, |node: &mut MethodNode, m: Text, caller| {
            if node.context.is_typed_caller(caller) {
                return;
            }
            match m.data.parse::<Command>() {
                Ok(emg_output) => {
                    node.received.joystick_active = false;
                    node.receive_gesture(emg_output);
                }
                Err(error) => node.context.node_diagnostics.record_refusal("emg", &error.to_string()),
            }
        })?,
        graph.subscribe(relative::JOY, 1, jobs, |node: &mut MethodNode, m: Joy| {
            let gazes = node.parts.method.info().style == MethodStyle::Selecting;
            let closed = matches!(node.hand, HandState::Closed | HandState::Closing);
            let command = joy::gesture_from_joystick(&m.axes, &m.buttons, gazes, closed);
            // A joystick at rest repeats itself; it must not talk over the armband.
            if command != node.received.joystick_gesture || command != Command::NoMotion {
                (node.received.joystick_gesture, node.received.joystick_active) = (command, true);
                node.receive_gesture(command);
            } else if node.received.joystick_active {
                node.received.record_heartbeat(InputSource::GestureTopic, HeartbeatKind::Alive);
            }
        })?,
        graph.subscribe_with_caller(
            relative::BLOCK_ID,
            1,
            jobs,
            |node: &mut MethodNode, m: Text, caller| {
                if node.context.is_typed_caller(caller) {
                    return;
                }
                let now = node.context.now();
                let mut objects = node.parts.scene.objects.iter();
                match objects.position(|object| object.ros_name == m.data).map(ObjectId::new) {
                    Some(block) => {
                        node.received.intent.highlight = Some(block);
                        node.received.highlighted_at = Some(now);
                        node.received.record_gaze(now, GazeTopic::Block, [0.0; 3]);
                    }
                    None => node
                        .context
                        .node_diagnostics
                        .record_refusal("block_id", &format!("{:?} is no object", m.data)),
                }
            },
        )?,
        graph.subscribe_with_caller(
            relative::GAZE_HIT,
            1,
            jobs,
            |node: &mut MethodNode, m: Vector3Stamped, caller| {
                if node.context.is_typed_caller(caller) {
                    return;
                }
                let point = Point::new(m.vector.x, m.vector.y, m.vector.z);
                if !point.iter().all(|v| v.is_finite()) {
                    return node
                        .context
                        .node_diagnostics
                        .record_refusal("gaze", "the gaze's place on the table is not finite");
                }
                node.received.intent.place_point = point;
                node.received.record_gaze(node.context.now(), GazeTopic::Hit, point.coords.into());
            },
        )?,
        subscribe_to_gaze(graph, jobs, relative::GAZE_HIT_LOGGING, GazeTopic::LoggedHit)?,
        subscribe_to_gaze(graph, jobs, relative::GAZE_POSITION, GazeTopic::Position)?,
        subscribe_to_gaze(graph, jobs, relative::GAZE_DIRECTION, GazeTopic::Direction)?,
        // The simulator judges the pose; here it only counts that it comes and moves.
        graph.subscribe_with_caller(
            relative::SHOULDER,
            1,
            jobs,
            |node: &mut MethodNode, m: PoseStamped, caller| {
                let pose = convert::read_pose(&m.pose);
                let Some(pose) = pose.ok().filter(|_| !node.context.is_typed_caller(caller)) else { return };
                let repeats = node.received.shoulder.replace(pose) == Some(pose);
                node.received.shoulder_updated = true;
                let kind = if repeats { HeartbeatKind::Repeated } else { HeartbeatKind::Fresh };
                node.received.record_heartbeat(InputSource::ShoulderTracker, kind);
            },
        )?,
    ])
}

/// A topic that says no more than that the eye tracker measures.
fn subscribe_to_gaze(
    graph: &RosGraph,
    jobs: &Jobs<MethodNode>,
    name: &str,
    topic: GazeTopic,
) -> Result<Subscriber, NodeError> {
    graph.subscribe_with_caller(name, 1, jobs, move |node: &mut MethodNode, m: Vector3Stamped, caller| {
        if !node.received.has_typed_intent && !node.context.is_typed_caller(caller) {
            let values = [m.vector.x, m.vector.y, m.vector.z];
            node.received.record_gaze(node.context.now(), topic, values);
        }
    })
}

impl MethodNode {
    /// In lock-step: whoever sent an old message has not heard what was said since.
    fn republish_if_repeated(&mut self, new: bool) {
        if !new {
            let done = self.republish_last();
            self.context.report_error("publish", done);
        }
    }

    /// What our EMG stage says. A change of gesture, and a message, act at once.
    fn receive_decision(&mut self, tick: SimTime, output: EmgStageOutput) {
        // After a restart of the master a connection may be there twice, and every message come twice.
        if output.decision.is_some() {
            let decided = Some((tick, output.decision.clone()));
            if self.received.last_decision == decided {
                return;
            }
            self.received.last_decision = decided;
        }
        let acts = output.published_command.is_some() || output.command != self.received.gesture.command;
        let kept =
            EmgStageOutput { published_command: None, decision: None, events: vec![], ..output.clone() };
        self.received.gesture = kept;
        if output.decision.is_some() && self.received.decisions.len() < MAX_PENDING_DECISIONS {
            self.received.decisions.push_back(output);
        }
        if acts {
            self.step_now();
        }
    }

    /// A gesture from somebody else's topic or a joystick. Acts at once, between two ticks.
    fn receive_gesture(&mut self, command: Command) {
        let decided_at = Some(self.context.now());
        let (confidence, effort) = (1.0, 1.0);
        let (message, recognized) = (Some(command), command.into());
        self.received.gesture = EmgStageOutput {
            command,
            recognized_gesture: recognized,
            published_command: message,
            decided_at,
            confidence,
            effort,
            ..EmgStageOutput::default()
        };
        for kind in [HeartbeatKind::Command, HeartbeatKind::Alive] {
            self.received.record_heartbeat(InputSource::GestureTopic, kind);
        }
        self.step_now();
    }

    fn step_now(&mut self) {
        let done = self.step_real_time(self.context.now());
        self.context.report_error("publish", done);
    }
}
