//! `proact node sim`: physics and controllers under the names that Gazebo and ros_control have.

mod inputs;
mod models;
mod robot;
mod services;
mod shoulder;

use super::{
    NodeError, RosGraph,
    arm_actions::{ArmActions, FEEDBACK_MS, OffersActions, STATUS_MS},
    convert,
    digest::Spans,
    graph::{Jobs, Pace, SimTimeParameter, parameter},
    judge::Judge,
    outlets::{Choices, Outlets, View},
    stage::{self, Tagged},
    testbed::rate,
    wire::{self, Asked},
};
use proact_arm::ArmModel;
use proact_control::{MotionCommand, ports::ArmKinematics};
use proact_testbed::{Field, TestbedError, TrialConfig};
use proact_types::{Event, EventKind, HandView, Pose, SimTime, TickInput};
pub use robot::PlantFactory;
use robot::{Moved, Robot};
use shoulder::ShoulderMarker;
use std::{
    collections::{BTreeMap, BTreeSet},
    sync::Arc,
    time::{Duration, Instant},
};

/// In lock-step: how long the loop waits for something to happen, and after what silence it speaks again.
const PATIENCE: Duration = Duration::from_millis(20);
const SPEAK_AGAIN: Duration = Duration::from_millis(200);
/// Nodes that are listened to for signs of life, at most.
const MOST_HEARTBEATS: usize = 64;
/// Silence of a node that has promised to speak, ms: then its commands no longer hold.
const SILENCE_MS: u64 = 120;
/// What the simulator is made of.
pub struct SimParts {
    /// Set-up, physics, limits.
    pub config: TrialConfig,
    /// The arm.
    pub model: Arc<ArmModel>,
    /// Makes the physics.
    pub factory: PlantFactory,
    /// The arm's kinematics.
    pub kinematics: Box<dyn ArmKinematics>,
}

/// The node's state: what jobs work on.
pub(super) struct SimNode {
    robot: Robot,
    judge: Judge,
    now: SimTime,
    paused: bool,
    faults: Arc<super::Faults>,
    actions: ArmActions,
    /// When each node that promised to speak last did.
    heartbeats: BTreeMap<String, SimTime>,
    base_stamp: f64,
    /// Nodes that say in typed messages what their messages in the original's types say as well.
    typed: BTreeSet<String>,
    /// Events of the stages before, for the display.
    events: Vec<EventKind>,
    /// In lock-step: what came of a tick.
    lockstep: bool,
    person: Tagged<(TickInput, Pose)>,
    command: Tagged<Asked>,
    spans: Option<Spans>,
    counts: wire::Counts,
}

/// Publishers that follow the world at a rate of their own.
struct Rates {
    /// Ticks from one instant to the next.
    period: u64,
    outlets: Outlets,
    shoulder: ShoulderMarker,
}

/// Runs the simulator until the graph ends the node.
///
/// # Errors
/// [`NodeError`].
pub fn run_sim(parts: SimParts) -> Result<(), NodeError> {
    let SimParts { config, model, factory, kinematics } = parts;
    let task = config.build_task(&model).map_err(TestbedError::Config)?;
    let counts = wire::Counts::of(&model, task.scene());
    let mut graph = RosGraph::join("proact_sim")?;
    let period = 1000 / rate()?;
    let paused: bool = parameter("~paused", false, "true or false")?;
    let scene = task.scene().clone();
    let choices = Choices::of_parameters(&model, &scene)?;
    let compat = choices.compat.clone();
    let outlets = Outlets::new(&graph, &model, &scene, choices)?;
    let robot = Robot::new(config.clone(), model.clone(), factory, scene)?;
    let mut node = SimNode {
        judge: Judge::new(&graph, &config, model.clone(), kinematics)?,
        actions: ArmActions::new(&graph, &model, &robot.said.command.position, compat)?,
        robot,
        now: SimTime(0),
        paused,
        faults: graph.faults().clone(),
        heartbeats: BTreeMap::new(),
        base_stamp: f64::NEG_INFINITY,
        typed: BTreeSet::new(),
        events: vec![],
        lockstep: stage::lockstep()?,
        person: Tagged::default(),
        command: Tagged::default(),
        spans: Spans::of_parameter()?,
        counts,
    };
    let jobs: Jobs<SimNode> = Jobs::default();
    let _listening = inputs::listen(&graph, &jobs, &node)?;
    let _serving = services::serve(&graph, &jobs)?;
    let shoulder = ShoulderMarker::new(&graph, &jobs, &node.robot.state().world_from_base)?;
    let rates = Rates { period, outlets, shoulder };
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

impl OffersActions for SimNode {
    fn actions(&mut self) -> &mut ArmActions {
        &mut self.actions
    }

    fn has_told(&self, caller: &str) -> bool {
        self.typed.contains(caller)
    }
}

impl SimNode {
    /// Keeps step with the clock on the wall.
    fn run(&mut self, graph: &RosGraph, jobs: &Jobs<SimNode>, rates: &Rates) -> Result<(), NodeError> {
        let mut pace = Pace::new();
        while graph.is_ok() {
            jobs.run(self);
            self.look_after(graph);
            if !self.paused {
                self.watch_heartbeat();
                self.tick(rates)?;
            }
            pace.tick();
        }
        Ok(())
    }

    /// Goes on with each tick when all have spoken.
    fn run_in_lockstep(
        &mut self,
        graph: &RosGraph,
        jobs: &Jobs<SimNode>,
        rates: &Rates,
    ) -> Result<(), NodeError> {
        let done = self.tell_first();
        self.note(done);
        let mut spoke = Instant::now();
        while graph.is_ok() {
            jobs.run_next(self, PATIENCE);
            self.look_after(graph);
            let next = SimTime(self.now.0 + 1);
            if !self.paused && self.person.is(next) && self.command.is(next) {
                if let (Some((input, head)), Some(asked)) = (self.person.get(), self.command.get()) {
                    let (shoulder, head, asked) = (input.shoulder, *head, asked.clone());
                    self.judge.head = head;
                    if let Some(pose) = shoulder {
                        self.robot.track(pose);
                    }
                    self.take_command(asked);
                }
                self.tick(rates)?;
                spoke = Instant::now();
            } else if spoke.elapsed() > SPEAK_AGAIN {
                // Who joined late has not heard it.
                let done = self.judge.repeat();
                self.note(done);
                spoke = Instant::now();
            }
        }
        Ok(())
    }

    fn look_after(&mut self, graph: &RosGraph) {
        if graph.master_restarted() && !self.lockstep {
            self.paused = true;
            rosrust::ros_warn!("{}", super::PAUSED_AFTER_RESTART);
        }
        graph.tell(convert::time(self.now));
    }

    /// The world before the first tick.
    fn tell_first(&mut self) -> rosrust::error::Result<()> {
        let task = self.judge.task().state().clone();
        let hand = HandView::default();
        self.judge.tell(self.now, &self.robot.moved(hand), &task, &[], true)
    }

    fn tick(&mut self, rates: &Rates) -> Result<(), NodeError> {
        self.now = self.now.plus_millis(1);
        let now = self.now;
        let driven = self.actions.ask(now, self.robot.state());
        let moved = self.robot.step(now, driven)?;
        let sent = self.publish(now, moved, rates);
        self.note(sent);
        Ok(())
    }

    fn publish(&mut self, now: SimTime, moved: Moved, rates: &Rates) -> rosrust::error::Result<()> {
        self.actions.told(&self.robot.said.command.position, moved.hand_rests)?;
        let mut events = std::mem::take(&mut self.events);
        events.extend(moved.events);
        let told = events.len();
        let hand = moved.world.hand;
        let task = self.judge.step(now, &self.robot.moved(hand), &mut events)?;
        if let Some(spans) = &mut self.spans {
            let shoulder = self.person.get().and_then(|(input, _)| input.shoulder);
            spans.digest.input(&TickInput { shoulder, ..TickInput::default() });
            spans.digest.actuation(&self.robot.said);
            spans.digest.world(self.robot.state(), moved.world.carried);
            spans.digest.task(&task.state, hand.holds);
            let own = [Field::InputShoulder, Field::Motion, Field::Joints, Field::Blocks, Field::Task];
            spans.end_tick(now, &own, task.state.finished);
        }
        self.robot.rearrange(&task.placements);
        let world = self.robot.state();
        let due = now.0.is_multiple_of(rates.period);
        self.judge.tell(now, &self.robot.moved(hand), &task.state, &events, due || self.lockstep)?;
        for kind in events[told..].iter().filter(|kind| super::is_grasp(kind)) {
            rates.outlets.grasp(&Event { time: now, kind: kind.clone() })?;
        }
        if due {
            rates.outlets.state(now, world, None)?;
            // Last: who ticks with the clock knows the world by then.
            rates.outlets.clock(now)?;
        }
        if now.0.is_multiple_of(FEEDBACK_MS) {
            rates.outlets.draw(now, world, &View::default())?;
        }
        if now.0.is_multiple_of(STATUS_MS) {
            rates.shoulder.keep_alive()?;
        }
        self.actions.publish(self.robot.state())
    }

    /// Stops the arm when a node that promised to speak fell silent.
    fn watch_heartbeat(&mut self) {
        let now = self.now;
        let silent = self.heartbeats.iter().find(|(_, at)| now.millis_since(**at) > SILENCE_MS);
        if let Some(name) = silent.map(|(name, _)| name.clone()) {
            self.heartbeats.remove(&name);
            let reason = format!("{name} is silent for {SILENCE_MS} ms: the arm holds");
            self.faults.refuse("heartbeat", &reason);
            self.robot.command_arm(MotionCommand::Hold);
            self.actions.stop_arm(&reason);
        }
    }

    fn note(&self, sent: rosrust::error::Result<()>) {
        if let Err(error) = sent {
            self.faults.refuse("publish", &error.to_string());
        }
    }
}
