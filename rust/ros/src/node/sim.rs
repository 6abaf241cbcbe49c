//! `proact node sim`: physics and controllers under the names that Gazebo and ros_control have.

mod inputs;
mod models;
mod robot;
mod services;
mod shoulder;

use super::{
    NodeError, RosGraph,
    arm_actions::{ArmActions, FEEDBACK_MS, HasArmActions, STATUS_MS},
    convert,
    digest::SpanDigestWriter,
    graph::{Jobs, SimTimeParameter, TickRate, parameter},
    publishers::{MarkerData, WorldPublisherOptions, WorldPublishers},
    rosout,
    stage::{self, TickMessage},
    task_outputs::TaskPublisher,
    testbed::read_rate_parameter,
    wire::{self, MethodCommand},
};
use crate::{
    heartbeat::{self, HEARTBEAT_TIMEOUT_MS, HeartbeatMonitor},
    messages::std_msgs::String as Text,
    publishing::Publisher,
};
use proact_arm::ArmModel;
use proact_control::{MotionCommand, ports::ArmKinematics};
use proact_testbed::{DigestField, TestbedError, TrialConfig};
use proact_types::{Event, EventKind, HandView, InputSource, Pose, SimTime, Stop, StopCause, TickInput};
pub use robot::PlantFactory;
use robot::{Robot, RobotStep};
use shoulder::ShoulderMarker;
use std::{
    collections::{BTreeMap, BTreeSet},
    sync::Arc,
    time::{Duration, Instant},
};

/// In lock-step: how long the loop waits for something to happen, and after what silence it speaks again.
const POLL_TIMEOUT: Duration = Duration::from_millis(20);
const REPUBLISH_PERIOD: Duration = Duration::from_millis(200);
const COMMAND: &str = "proact/command";
const PERSON: &str = "proact/person";

/// What the simulator is made of.
pub struct SimParts {
    /// Set-up, physics, limits.
    pub config: TrialConfig,
    /// The arm.
    pub model: Arc<ArmModel>,
    /// Its URDF, for the parameter `/robot_description`.
    pub urdf: String,
    /// Makes the physics.
    pub factory: PlantFactory,
    /// The arm's kinematics.
    pub kinematics: Box<dyn ArmKinematics>,
}

/// The node's state: what jobs work on.
pub(super) struct SimNode {
    robot: Robot,
    task_publisher: TaskPublisher,
    now: SimTime,
    paused: bool,
    node_diagnostics: Arc<super::NodeDiagnostics>,
    actions: ArmActions,
    /// Nodes that promised to speak, and the input that each misses.
    heartbeats: HeartbeatMonitor<String>,
    missing_inputs: BTreeMap<String, String>,
    /// Topics that the simulator needs, and which node publishes each.
    inputs: HeartbeatMonitor<&'static str>,
    publishers: BTreeMap<&'static str, String>,
    heartbeat: Publisher<Text>,
    base_stamp: f64,
    /// Nodes that say in typed messages what their messages in the original's types say as well.
    typed_callers: BTreeSet<String>,
    /// Events of the stages before, for the display.
    events: Vec<EventKind>,
    /// In lock-step: what came of a tick.
    lockstep: bool,
    person: TickMessage<(TickInput, Pose)>,
    command: TickMessage<MethodCommand>,
    span_digests: Option<SpanDigestWriter>,
    counts: wire::ExpectedCounts,
}

/// Publishers that follow the world at a rate of their own.
struct PeriodicPublishers {
    /// Ticks from one instant to the next.
    period_ticks: u64,
    world_publishers: WorldPublishers,
    shoulder: ShoulderMarker,
}

/// Runs the simulator until the graph ends the node.
///
/// # Errors
/// [`NodeError`].
pub fn run_sim(parts: SimParts) -> Result<(), NodeError> {
    let SimParts { config, model, urdf, factory, kinematics } = parts;
    let task = config.build_task(&model).map_err(TestbedError::Config)?;
    let counts = wire::ExpectedCounts::of(&model, task.scene());
    let mut graph = RosGraph::join("proact_sim")?;
    let period = 1000 / read_rate_parameter()?;
    let paused: bool = parameter("~paused", false, "true or false")?;
    let scene = task.scene().clone();
    let choices = WorldPublisherOptions::from_parameters(&model, &scene)?;
    let compat = choices.compat.clone();
    let publishers = WorldPublishers::new(&graph, &model, &scene, choices)?;
    let robot = Robot::new(config.clone(), model.clone(), factory, scene)?;
    let mut node = SimNode {
        task_publisher: TaskPublisher::new(&graph, &config, model.clone(), &urdf, kinematics)?,
        actions: ArmActions::new(&graph, &model, &robot.last_actuation.command.position, compat)?,
        robot,
        now: SimTime(0),
        paused,
        node_diagnostics: graph.node_diagnostics().clone(),
        heartbeats: HeartbeatMonitor::default(),
        missing_inputs: BTreeMap::new(),
        inputs: HeartbeatMonitor::default(),
        publishers: BTreeMap::new(),
        heartbeat: graph.advertise("proact/heartbeat", 10, false)?,
        base_stamp: f64::NEG_INFINITY,
        typed_callers: BTreeSet::new(),
        events: vec![],
        lockstep: stage::read_lockstep_parameter()?,
        person: TickMessage::default(),
        command: TickMessage::default(),
        span_digests: SpanDigestWriter::from_parameter()?,
        counts,
    };
    let jobs: Jobs<SimNode> = Jobs::default();
    let _listening = inputs::subscribe(&graph, &jobs, &node)?;
    let _serving = services::advertise_services(&graph, &jobs)?;
    let shoulder = ShoulderMarker::new(&graph, &jobs, &node.robot.state().world_from_base)?;
    let rates = PeriodicPublishers { period_ticks: period, world_publishers: publishers, shoulder };
    let _sim_time = SimTimeParameter::set();
    graph.watch_master()?;
    if node.lockstep {
        node.run_in_lockstep(&graph, &jobs, &rates)?
    } else {
        node.run(&graph, &jobs, &rates)?
    }
    graph.stop_watching();
    Ok(())
}

impl HasArmActions for SimNode {
    fn actions(&mut self) -> &mut ArmActions {
        &mut self.actions
    }

    fn has_typed_command(&self, caller: &str) -> bool {
        self.typed_callers.contains(caller)
    }
}

impl SimNode {
    /// Keeps step with the clock on the wall.
    fn run(
        &mut self,
        graph: &RosGraph,
        jobs: &Jobs<SimNode>,
        rates: &PeriodicPublishers,
    ) -> Result<(), NodeError> {
        let mut pace = TickRate::new();
        while graph.is_ok() {
            jobs.run(self);
            self.check_graph(graph);
            if !self.paused {
                self.check_heartbeats();
                self.tick(rates)?;
            }
            pace.sleep();
        }
        Ok(())
    }

    /// Goes on with each tick when all have spoken.
    fn run_in_lockstep(
        &mut self,
        graph: &RosGraph,
        jobs: &Jobs<SimNode>,
        rates: &PeriodicPublishers,
    ) -> Result<(), NodeError> {
        let done = self.publish_initial_state();
        self.report_error(done);
        let mut spoke = Instant::now();
        while graph.is_ok() {
            jobs.run_next(self, POLL_TIMEOUT);
            self.check_graph(graph);
            let next = SimTime(self.now.0 + 1);
            if !self.paused && self.person.is_at(next) && self.command.is_at(next) {
                if let (Some((input, head)), Some(method_command)) = (self.person.get(), self.command.get()) {
                    let (shoulder, head, method_command) = (input.shoulder, *head, method_command.clone());
                    self.task_publisher.head = head;
                    if let Some(pose) = shoulder {
                        self.robot.set_shoulder(pose);
                    }
                    self.apply_command(method_command);
                }
                self.tick(rates)?;
                spoke = Instant::now();
            } else if spoke.elapsed() > REPUBLISH_PERIOD {
                // Who joined late has not heard it.
                let done = self.task_publisher.republish_last();
                self.report_error(done);
                spoke = Instant::now();
            }
        }
        Ok(())
    }

    fn check_graph(&mut self, graph: &RosGraph) {
        if graph.master_restarted() && !self.lockstep {
            self.paused = true;
            rosout::warn(super::PAUSED_AFTER_RESTART);
        }
        graph.publish_diagnostics(convert::time(self.now));
    }

    /// The world before the first tick.
    fn publish_initial_state(&mut self) -> rosrust::error::Result<()> {
        let task = self.task_publisher.task().state().clone();
        let hand = HandView::default();
        self.task_publisher.publish(self.now, self.now, &self.robot.world_update(hand), &task, &[], true)
    }

    fn tick(&mut self, rates: &PeriodicPublishers) -> Result<(), NodeError> {
        self.now = self.now.plus_millis(1);
        let now = self.now;
        let driven = self.actions.step_controllers(now, self.robot.state());
        let moved = self.robot.step(now, driven)?;
        let sent = self.publish(now, moved, rates);
        self.report_error(sent);
        Ok(())
    }

    fn publish(
        &mut self,
        now: SimTime,
        moved: RobotStep,
        rates: &PeriodicPublishers,
    ) -> rosrust::error::Result<()> {
        self.actions.finish_tick(&self.robot.last_actuation.command.position, moved.hand_rests)?;
        let mut events = std::mem::take(&mut self.events);
        events.extend(moved.events);
        let event_count = events.len();
        let hand = moved.world.hand;
        let task = self.task_publisher.step(now, &self.robot.world_update(hand), &mut events)?;
        if let Some(spans) = &mut self.span_digests {
            let shoulder = self.person.get().and_then(|(input, _)| input.shoulder);
            spans.digest.input(&TickInput { shoulder, ..TickInput::default() });
            spans.digest.actuation(&self.robot.last_actuation);
            spans.digest.world(self.robot.state(), moved.world.carried_object);
            spans.digest.task(&task.state, hand.held_object);
            let own = [
                DigestField::InputShoulder,
                DigestField::Motion,
                DigestField::Joints,
                DigestField::Blocks,
                DigestField::Task,
            ];
            spans.end_tick(now, &own, task.state.finished);
        }
        self.robot.rearrange(&task.placements);
        let world = self.robot.state();
        let due = now.0.is_multiple_of(rates.period_ticks);
        self.task_publisher.publish(
            now,
            now,
            &self.robot.world_update(hand),
            &task.state,
            &events,
            due || self.lockstep,
        )?;
        for kind in events[event_count..].iter().filter(|kind| super::is_grasp_event(kind)) {
            rates.world_publishers.publish_grasp(&Event { time: now, kind: kind.clone() })?;
        }
        if due {
            rates.world_publishers.publish_state(now, world, None)?;
            if !self.lockstep {
                let missed = self.inputs.stale().next().copied();
                self.heartbeat.send(Text { data: heartbeat::format_heartbeat(&rosrust::name(), missed) })?;
            }
            // Last: who ticks with the clock knows the world by then.
            rates.world_publishers.publish_clock(now)?;
        }
        if now.0.is_multiple_of(FEEDBACK_MS) {
            rates.world_publishers.publish_markers(now, world, &MarkerData::default())?;
        }
        if now.0.is_multiple_of(STATUS_MS) {
            rates.shoulder.keep_alive()?;
        }
        self.actions.publish(self.robot.state())
    }

    /// Stops the arm when a node that promised to speak, or one of its topics, fell silent.
    fn check_heartbeats(&mut self) {
        for name in self.heartbeats.step(self.now) {
            self.stop_arm(&format!("{name} is silent for {HEARTBEAT_TIMEOUT_MS} ms"));
            if self.publishers.get(COMMAND) == Some(&name) {
                self.hold_arm(format!("{name} is silent"));
            }
            // It is gone: nothing of it is missed until it is back.
            self.heartbeats.forget(&name);
            self.missing_inputs.remove(&name);
            let inputs = &mut self.inputs;
            self.publishers.retain(|topic, publisher| {
                let stays = *publisher != name;
                if !stays {
                    inputs.forget(topic);
                }
                stays
            });
        }
        for topic in self.inputs.step(self.now) {
            self.stop_arm(&format!("{topic} is silent for {HEARTBEAT_TIMEOUT_MS} ms"));
            if topic == COMMAND {
                self.hold_arm(format!("{topic} is silent"));
            }
        }
    }

    /// The arm holds, and what controllers did with it ends.
    fn stop_arm(&mut self, why: &str) {
        let reason = format!("{why}: the arm holds");
        self.node_diagnostics.record_refusal("heartbeat", &reason);
        self.robot.command_arm(MotionCommand::Hold);
        self.actions.stop_arm(&reason);
    }

    /// The method's commands for the arm do not count until the hand relaxed.
    fn hold_arm(&mut self, reason: String) {
        if self.task_publisher.hold_stop.is_some() {
            return;
        }
        let (source, cause) = (InputSource::Stage, StopCause::Silent);
        self.events.push(EventKind::Stopped { source, cause, reason: reason.clone() });
        self.task_publisher.hold_stop = Some(Stop { source, cause, since: self.now, reason });
    }

    /// In real time: a message on `topic` by the node `caller`, sent at `sent` by the graph's time. An old one is no sign of life.
    fn record_input(&mut self, topic: &'static str, sent: SimTime, caller: &str) {
        if self.now.millis_since(sent) > HEARTBEAT_TIMEOUT_MS {
            return;
        }
        self.inputs.record(topic, self.now);
        if self.publishers.get(topic).is_none_or(|known| known != caller) {
            self.publishers.insert(topic, caller.to_owned());
        }
    }

    /// A node says that it lives, and may miss an input: it cannot do its part then.
    fn receive_heartbeat(&mut self, text: &str) {
        let (name, missed) = heartbeat::parse_heartbeat(text);
        if name == rosrust::name() {
            return;
        }
        self.heartbeats.record(name.to_owned(), self.now);
        match missed.filter(|_| self.heartbeats.is_watched(&name.to_owned())) {
            None => {
                self.missing_inputs.remove(name);
            }
            Some(input) => {
                if self.missing_inputs.insert(name.to_owned(), input.to_owned()).is_none() {
                    self.stop_arm(&format!("{name} misses {input}"));
                }
            }
        }
    }

    fn report_error(&self, sent: rosrust::error::Result<()>) {
        if let Err(error) = sent {
            self.node_diagnostics.record_refusal("publish", &error.to_string());
        }
    }
}
