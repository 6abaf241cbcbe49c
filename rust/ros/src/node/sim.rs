//! `proact node sim`: physics and controllers under the names that Gazebo and ros_control have.

mod goals;
mod inputs;
mod robot;
mod services;
mod shoulder;

use super::{
    NodeError, RosGraph,
    actions::{Action, goal_id},
    convert,
    digest::Spans,
    graph::{Jobs, Pace, SimTimeParameter, parameter},
    judge::{self, Judge},
    outlets::{Outlets, View},
    stage::{self, Tagged},
    testbed::{compat, rate},
    wire::{self, Asked},
};
use crate::{
    action::{GoalId, GoalState},
    compat::{Compat, Quirk},
    controllers::{Ending, GoalTolerances},
    messages::{
        control_msgs::{
            FollowJointTrajectoryActionFeedback, FollowJointTrajectoryActionGoal,
            FollowJointTrajectoryActionResult, JointTrajectoryControllerState,
        },
        mpl_control::{graspActionFeedback, graspActionGoal, graspActionResult},
        trajectory_msgs::JointTrajectory,
    },
    trajectory::RawPoint,
};
use goals::{follow_result, grasp_result, own_id, tolerances};
use proact_arm::ArmModel;
use proact_control::{HandCommand, MotionCommand, ports::ArmKinematics};
use proact_messages::original::ARM_MODEL;
use proact_testbed::{Field, TestbedError, TrialConfig};
use proact_types::{Event, EventKind, HandView, Pose, SimTime, TickInput};
pub use robot::PlantFactory;
use robot::{Moved, Robot};
use rosrust::Publisher;
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
/// From one feedback to the next, ms (20 Hz, as ros_control).
const FEEDBACK_MS: u64 = 50;
/// From one status list to the next, ms (5 Hz, as actionlib).
const STATUS_MS: u64 = 200;
/// Controllers that have an action beside their command topic.
const WITH_ACTION: [&str; 2] = ["arm_controller", "hand_controller"];

type Follow = Action<FollowJointTrajectoryActionResult, FollowJointTrajectoryActionFeedback>;
type Grasp = Action<graspActionResult, graspActionFeedback>;

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
    follow: [Follow; 2],
    grasp: Grasp,
    /// When each node that promised to speak last did.
    heartbeats: BTreeMap<String, SimTime>,
    base_stamp: f64,
    compat: Compat,
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
    states: Vec<Publisher<JointTrajectoryControllerState>>,
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
    let links: bool = parameter("~publish_links", true, "true or false")?;
    let paused: bool = parameter("~paused", false, "true or false")?;
    let compat = compat()?;
    let scene = task.scene().clone();
    let outlets = Outlets::new(&graph, &model, &scene, links, compat.clone())?;
    let controller = |name: &str| format!("{ARM_MODEL}/{name}");
    let states: Vec<Publisher<JointTrajectoryControllerState>> = WITH_ACTION
        .iter()
        .map(|name| graph.publish(&format!("{}/state", controller(name)), 1, false))
        .collect::<Result<_, _>>()?;
    let action = |name: &str| format!("{}/follow_joint_trajectory", controller(name));
    let mut node = SimNode {
        judge: Judge::new(&graph, &config, model.clone(), kinematics)?,
        robot: Robot::new(config, model, factory, scene)?,
        now: SimTime(0),
        paused,
        faults: graph.faults().clone(),
        follow: [
            Action::new(&graph, &action(WITH_ACTION[0]))?,
            Action::new(&graph, &action(WITH_ACTION[1]))?,
        ],
        grasp: Action::new(&graph, "grasp")?,
        heartbeats: BTreeMap::new(),
        base_stamp: f64::NEG_INFINITY,
        compat,
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
    let rates = Rates { period, outlets, states, shoulder };
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
        let robot = &self.robot;
        let moved =
            judge::Moved { world: robot.state(), hand, actuation: &robot.said, acted_on: robot.acted_on };
        self.judge.tell(self.now, &moved, &task, &[], true)
    }

    fn tick(&mut self, rates: &Rates) -> Result<(), NodeError> {
        self.now = self.now.plus_millis(1);
        let now = self.now;
        let moved = self.robot.step(now)?;
        let sent = self.publish(now, moved, rates);
        self.note(sent);
        Ok(())
    }

    fn publish(&mut self, now: SimTime, moved: Moved, rates: &Rates) -> rosrust::error::Result<()> {
        self.conclude(&moved.endings, moved.hand_arrived)?;
        let mut events = std::mem::take(&mut self.events);
        events.extend(moved.events);
        let told = events.len();
        let world = self.robot.state();
        let robot = &self.robot;
        let seen =
            judge::Moved { world, hand: moved.world.hand, actuation: &robot.said, acted_on: robot.acted_on };
        let task = self.judge.step(now, &seen, &mut events)?;
        if let Some(spans) = &mut self.spans {
            let shoulder = self.person.get().and_then(|(input, _)| input.shoulder);
            spans.digest.input(&TickInput { shoulder, ..TickInput::default() });
            spans.digest.actuation(&self.robot.said);
            spans.digest.world(world, moved.world.carried);
            spans.digest.task(&task, moved.world.hand.holds);
            let own = [Field::InputShoulder, Field::Motion, Field::Joints, Field::Blocks, Field::Task];
            spans.end_tick(now, &own, task.finished);
        }
        let due = now.0.is_multiple_of(rates.period);
        self.judge.tell(now, &seen, &task, &events, due || self.lockstep)?;
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
            self.feedback(&rates.states)?;
        }
        if now.0.is_multiple_of(STATUS_MS) {
            for follow in &mut self.follow {
                follow.status(now)?;
            }
            self.grasp.status(now)?;
            rates.shoulder.keep_alive()?;
        }
        Ok(())
    }

    /// The goal of a controller's action is over: the method commands its joints.
    fn end_follow(&mut self, k: usize) {
        let text = "the method took its place";
        let sent = self.follow[k].end(GoalState::Preempted, text, self.now, follow_result(0, text));
        self.note(sent);
    }

    /// A trajectory on a controller's command topic: an action's goal before it is over then.
    fn command(&mut self, name: &str, message: &JointTrajectory) {
        let now = self.now;
        if let Err(reason) = self.follow(name, message, None) {
            return self.faults.refuse("trajectory", &format!("{name}: {}", reason.1));
        }
        if let Some(k) = WITH_ACTION.iter().position(|n| *n == name) {
            let text = "a command on the topic took its place";
            let sent = self.follow[k].end(GoalState::Preempted, text, now, follow_result(0, text));
            self.note(sent);
        }
    }

    fn follow(
        &mut self,
        name: &str,
        message: &JointTrajectory,
        tolerances: Option<GoalTolerances>,
    ) -> Result<(), (i32, String)> {
        let now = self.now;
        let refused = |reason: String| (-1, reason);
        let controller = self.robot.controllers.get_mut(name).ok_or_else(|| refused("no such".to_owned()))?;
        if !controller.running() {
            return Err(refused("the controller is not running; call switch_controller first".to_owned()));
        }
        let stamp = &message.header.stamp;
        let begin = if stamp.nanos() == 0 { 0.0 } else { convert::secs_until(stamp, now) };
        let points: Vec<RawPoint> = message.points.iter().map(convert::read_point).collect();
        controller
            .follow(&message.joint_names, &points, begin, tolerances, now)
            .map_err(|error| (error.code(), error.to_string()))?;
        if name == "hand_controller" {
            self.leave_grasp();
        }
        Ok(())
    }

    fn goal(&mut self, k: usize, message: &FollowJointTrajectoryActionGoal) {
        let (now, goal, name) = (self.now, &message.goal, WITH_ACTION[k]);
        let id = own_id(goal_id(&message.goal_id), now);
        let newer = follow_result(0, "a newer goal took its place");
        // The same goal again, or one that its cancel overtook: what the controller does goes on.
        if !self.follow[k].goals.would_begin(&id) {
            let sent = self.follow[k].admit(id, now, newer).map(|_| ());
            return self.note(sent);
        }
        let names =
            self.robot.controllers.get_mut(name).map(|c| c.joint_names().to_vec()).unwrap_or_default();
        let begun = tolerances(&names, goal).map_err(|reason| (-1, reason)).and_then(|tolerances| {
            if goal.trajectory.points.is_empty() {
                return Err((-1, "the trajectory has no points".to_owned()));
            }
            self.follow(name, &goal.trajectory, Some(tolerances))
        });
        let sent = match begun {
            Ok(()) => self.follow[k].admit(id, now, newer).map(|_| ()),
            Err((code, reason)) => {
                self.faults.refuse("trajectory", &format!("{name}: {reason}"));
                self.follow[k].reject(id, &reason, now, follow_result(code, &reason))
            }
        };
        self.note(sent);
    }

    fn cancel(&mut self, k: usize, id: &GoalId) {
        let now = self.now;
        if self.follow[k].goals.cancel(id, now) {
            if let Some(controller) = self.robot.controllers.get_mut(WITH_ACTION[k]) {
                controller.hold();
            }
            let text = "cancelled";
            let sent = self.follow[k].end(GoalState::Preempted, text, now, follow_result(0, text));
            self.note(sent);
        }
    }

    /// `told`: the method has said so in full already.
    fn grasp_goal(&mut self, message: &graspActionGoal, told: bool) {
        let now = self.now;
        let id = own_id(goal_id(&message.goal_id), now);
        let command = match message.goal.instruct {
            1 => HandCommand::Close,
            2 => HandCommand::Open,
            other => {
                let reason = format!("instruct is {other}, expected 1 to close or 2 to open");
                self.faults.refuse("grasp", &reason);
                let sent = self.grasp.reject(id, &reason, now, grasp_result(0));
                return self.note(sent);
            }
        };
        let sent = self.grasp.admit(id, now, grasp_result(0));
        if matches!(sent, Ok(true)) {
            let text = "the grasp action took its place";
            let preempted = self.follow[1].end(GoalState::Preempted, text, now, follow_result(0, text));
            self.note(preempted);
            if !told {
                self.robot.command_hand(command);
            }
        }
        self.note(sent.map(|_| ()));
    }

    fn grasp_cancel(&mut self, id: &GoalId) {
        if self.compat.has(Quirk::GraspSucceeds) {
            return;
        }
        let now = self.now;
        if self.grasp.goals.cancel(id, now) {
            self.robot.hold_hand();
            let sent = self.grasp.end(GoalState::Preempted, "cancelled", now, grasp_result(0));
            self.note(sent);
        }
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
            let sent = self.follow[0].end(GoalState::Aborted, &reason, now, follow_result(-4, &reason));
            self.note(sent);
        }
    }

    /// Tells clients how their goals ended.
    fn conclude(&mut self, endings: &[(String, Ending)], hand_arrived: bool) -> rosrust::error::Result<()> {
        let now = self.now;
        for (name, ending) in endings {
            let Some(k) = WITH_ACTION.iter().position(|n| n == name) else { continue };
            let (state, code, text) = match ending {
                Ending::Reached => (GoalState::Succeeded, 0, ""),
                Ending::PathViolated(text) => (GoalState::Aborted, -4, text.as_str()),
                Ending::GoalViolated(text) => (GoalState::Aborted, -5, text.as_str()),
            };
            self.follow[k].end(state, text, now, follow_result(code, text))?;
        }
        if hand_arrived && self.grasp.goals.active().is_some() {
            self.grasp.end(GoalState::Succeeded, "", now, grasp_result(1))?;
        }
        Ok(())
    }

    fn feedback(
        &mut self,
        states: &[Publisher<JointTrajectoryControllerState>],
    ) -> rosrust::error::Result<()> {
        let (now, plant) = (self.now, self.robot.state().clone());
        for (k, name) in WITH_ACTION.into_iter().enumerate() {
            let Some(controller) = self.robot.controllers.get_mut(name) else { continue };
            let mut desired = convert::trajectory_point(controller.desired());
            let mut actual = desired.clone();
            let joints = controller.joints();
            if name == "hand_controller" && self.grasp.goals.active().is_some() {
                desired.velocities.iter_mut().for_each(|v| *v = 0.0);
            }
            actual.positions = joints.iter().map(|j| plant.position[*j]).collect();
            actual.velocities = joints.iter().map(|j| plant.velocity[*j]).collect();
            let minus = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a - b).collect::<Vec<f64>>();
            let mut error = desired.clone();
            error.positions = minus(&desired.positions, &actual.positions);
            error.velocities = minus(&desired.velocities, &actual.velocities);
            let joint_names = controller.joint_names().to_vec();
            states[k].send(JointTrajectoryControllerState {
                header: convert::header(now, ""),
                joint_names: joint_names.clone(),
                desired: desired.clone(),
                actual: actual.clone(),
                error: error.clone(),
            })?;
            self.follow[k].feedback(now, |header, status| {
                let mut message =
                    FollowJointTrajectoryActionFeedback { header, status, ..Default::default() };
                message.feedback.header = convert::header(now, "");
                message.feedback.joint_names = joint_names.clone();
                message.feedback.desired = desired.clone();
                message.feedback.actual = actual.clone();
                message.feedback.error = error.clone();
                message
            })?;
        }
        self.grasp.feedback(now, |header, status| {
            let mut message = graspActionFeedback { header, status, ..Default::default() };
            message.feedback.doing = 1;
            message
        })
    }

    fn note(&self, sent: rosrust::error::Result<()>) {
        if let Err(error) = sent {
            self.faults.refuse("publish", &error.to_string());
        }
    }
}
