//! `proact node sim`: physics and controllers under the names that Gazebo and ros_control have.

mod goals;
mod services;
mod shoulder;

use super::{
    Graph, NodeError,
    actions::{Action, goal_id},
    convert,
    graph::{Jobs, Pace, parameter},
    outlets::{Outlets, View},
    testbed::{compat, rate},
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
        gazebo_msgs::LinkState,
        geometry_msgs::PoseStamped,
        mpl_control::{graspActionFeedback, graspActionGoal, graspActionResult},
        std_msgs::String as Text,
        trajectory_msgs::JointTrajectory,
    },
    simulator::{Simulator, is_grasp},
    trajectory::RawPoint,
};
use goals::{follow_result, grasp_result, own_id, tolerances};
use proact_control::HandCommand;
use proact_tasks::{Arrangement, BlockResult};
use proact_types::{EventKind, SimTime};
use rosrust::{Publisher, Subscriber};
use serde::Serialize;
use shoulder::ShoulderMarker;
use std::{collections::BTreeMap, sync::Arc};

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

/// The node's state: what jobs work on.
pub(super) struct SimNode {
    sim: Simulator,
    paused: bool,
    faults: Arc<super::Faults>,
    follow: [Follow; 2],
    grasp: Grasp,
    /// When each node that promised to speak last did.
    heartbeats: BTreeMap<String, SimTime>,
    base_stamp: f64,
    arrangement: Arrangement,
    compat: Compat,
}

/// Runs the simulator until the graph ends the node. `arrangement` is where its blocks stood at the start.
///
/// # Errors
/// [`NodeError`].
pub fn run_sim(sim: Simulator, arrangement: Arrangement) -> Result<(), NodeError> {
    let mut graph = Graph::join("proact_sim")?;
    let period = 1000 / rate()?;
    let links: bool = parameter("~publish_links", true, "true or false")?;
    let paused: bool = parameter("~paused", false, "true or false")?;
    let (model, scene) = (sim.model().clone(), sim.task().scene().clone());
    let compat = compat()?;
    let outlets = Outlets::new(&graph, &model, &scene, links, compat.clone())?;
    let controller = |name: &str| format!("mpl_right_arm/{name}");
    let states: Vec<Publisher<JointTrajectoryControllerState>> = WITH_ACTION
        .iter()
        .map(|name| graph.publish(&format!("{}/state", controller(name)), 1, false))
        .collect::<Result<_, _>>()?;
    let action = |name: &str| format!("{}/follow_joint_trajectory", controller(name));
    let mut node = SimNode {
        sim,
        paused,
        faults: graph.faults().clone(),
        follow: [
            Action::new(&graph, &action(WITH_ACTION[0]))?,
            Action::new(&graph, &action(WITH_ACTION[1]))?,
        ],
        grasp: Action::new(&graph, "grasp")?,
        heartbeats: BTreeMap::new(),
        base_stamp: f64::NEG_INFINITY,
        arrangement,
        compat,
    };
    let score: Publisher<Text> = graph.publish("proact/score", 1, true)?;
    let result: Publisher<Text> = graph.publish("proact/result", 1, true)?;
    let jobs: Jobs<SimNode> = Jobs::default();
    let _listening = listen(&graph, &jobs, &node)?;
    let _serving = services::serve(&graph, &jobs)?;
    let shoulder = ShoulderMarker::new(&graph, &jobs, &node.sim.state().world_from_base)?;
    graph.watch_master()?;

    let mut pace = Pace::new();
    while graph.is_ok() {
        jobs.run(&mut node);
        if graph.master_restarted() {
            node.paused = true;
            rosrust::ros_warn!("{}", super::PAUSED_AFTER_RESTART);
        }
        graph.tell(convert::time(node.sim.now()));
        if node.paused {
            pace.tick();
            continue;
        }
        node.watch_heartbeat();
        let output = node.sim.step()?;
        let now = node.sim.now();
        let sent = node.conclude(&output.endings, output.hand_arrived).and_then(|()| {
            for event in output.events.iter().filter(|e| is_grasp(&e.kind)) {
                outlets.grasp(event)?;
            }
            if !output.events.is_empty() {
                score.send(Text {
                    data: super::testbed::json("the score", &node.outcomes()).unwrap_or_default(),
                })?;
            }
            if output.events.iter().any(|e| e.kind == EventKind::TrialFinished) {
                let data = super::testbed::json("the result", &node.result()).unwrap_or_default();
                result.send(Text { data })?;
            }
            if now.0.is_multiple_of(period) {
                outlets.clock(now)?;
                outlets.state(now, node.sim.state(), None)?;
            }
            if now.0.is_multiple_of(FEEDBACK_MS) {
                outlets.draw(now, node.sim.state(), &View::default())?;
                node.feedback(&states)?;
            }
            if now.0.is_multiple_of(STATUS_MS) {
                for follow in &mut node.follow {
                    follow.status(now)?;
                }
                node.grasp.status(now)?;
                shoulder.keep_alive()?;
            }
            Ok(())
        });
        if let Err(error) = sent {
            graph.faults().refuse("publish", &error.to_string());
        }
        pace.tick();
    }
    graph.stop_watching();
    Ok(())
}

fn listen(graph: &Graph, jobs: &Jobs<SimNode>, node: &SimNode) -> Result<Vec<Subscriber>, NodeError> {
    let mut all = Vec::new();
    let names: Vec<String> = node.sim.controllers_ref().list().iter().map(|c| c.name().to_owned()).collect();
    for name in names {
        let topic = format!("mpl_right_arm/{name}/command");
        all.push(graph.listen(&topic, 1, jobs, move |node: &mut SimNode, message: JointTrajectory| {
            node.command(&name, &message);
        })?);
    }
    for (k, name) in WITH_ACTION.into_iter().enumerate() {
        let action = format!("mpl_right_arm/{name}/follow_joint_trajectory");
        all.extend(Follow::listen(
            graph,
            &action,
            jobs,
            move |node: &mut SimNode, goal: FollowJointTrajectoryActionGoal| node.goal(k, &goal),
            move |node: &mut SimNode, id| node.cancel(k, &id),
        )?);
    }
    all.extend(Grasp::listen(
        graph,
        "grasp",
        jobs,
        |node: &mut SimNode, goal: graspActionGoal| node.grasp_goal(&goal),
        |node: &mut SimNode, id| node.grasp_cancel(&id),
    )?);
    all.push(graph.listen("gazebo/set_link_state", 10, jobs, |node: &mut SimNode, link: LinkState| {
        if let Err(reason) = node.set_link(&link) {
            node.faults.refuse("pose", &reason);
        }
    })?);
    all.push(graph.listen("Shoulderpad_filtered_pose", 1, jobs, |node: &mut SimNode, m: PoseStamped| {
        node.shoulder(&m);
    })?);
    all.push(graph.listen("proact/heartbeat", 100, jobs, |node: &mut SimNode, message: Text| {
        let now = node.sim.now();
        if node.heartbeats.len() < MOST_HEARTBEATS || node.heartbeats.contains_key(&message.data) {
            node.heartbeats.insert(message.data, now);
        }
    })?);
    Ok(all)
}

/// How the trial in this world went: the text on `/proact/result`.
#[derive(Serialize)]
struct SimResult {
    arrangement: Arrangement,
    on_target: u32,
    outcomes: Vec<BlockResult>,
    sim_seconds: f64,
}

impl SimNode {
    fn outcomes(&self) -> Vec<BlockResult> {
        self.sim.task().results(&self.sim.state().blocks)
    }

    fn result(&self) -> SimResult {
        SimResult {
            arrangement: self.arrangement,
            on_target: self.sim.task().state().on_target,
            outcomes: self.outcomes(),
            sim_seconds: self.sim.now().as_secs(),
        }
    }

    /// A trajectory on a controller's command topic: an action's goal before it is over then.
    fn command(&mut self, name: &str, message: &JointTrajectory) {
        let now = self.sim.now();
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
        let now = self.sim.now();
        if name == "hand_controller" {
            self.sim.give_hand_back();
        }
        let refused = |reason: String| (-1, reason);
        let controller = self.sim.controllers().get_mut(name).ok_or_else(|| refused("no such".to_owned()))?;
        if !controller.running() {
            return Err(refused("the controller is not running; call switch_controller first".to_owned()));
        }
        let stamp = &message.header.stamp;
        let begin = if stamp.nanos() == 0 { 0.0 } else { convert::secs_until(stamp, now) };
        let points: Vec<RawPoint> = message.points.iter().map(convert::read_point).collect();
        controller
            .follow(&message.joint_names, &points, begin, tolerances, now)
            .map_err(|error| (error.code(), error.to_string()))
    }

    fn goal(&mut self, k: usize, message: &FollowJointTrajectoryActionGoal) {
        let (now, goal, name) = (self.sim.now(), &message.goal, WITH_ACTION[k]);
        let id = own_id(goal_id(&message.goal_id), now);
        let names =
            self.sim.controllers().get_mut(name).map(|c| c.joint_names().to_vec()).unwrap_or_default();
        let begun = tolerances(&names, goal).map_err(|reason| (-1, reason)).and_then(|tolerances| {
            if goal.trajectory.points.is_empty() {
                return Err((-1, "the trajectory has no points".to_owned()));
            }
            self.follow(name, &goal.trajectory, Some(tolerances))
        });
        let sent = match begun {
            Ok(()) => {
                self.follow[k].admit(id, now, follow_result(0, "a newer goal took its place")).map(|begins| {
                    if !begins && let Some(controller) = self.sim.controllers().get_mut(name) {
                        controller.hold();
                    }
                })
            }
            Err((code, reason)) => {
                self.faults.refuse("trajectory", &format!("{name}: {reason}"));
                self.follow[k].reject(id, &reason, now, follow_result(code, &reason))
            }
        };
        self.note(sent);
    }

    fn cancel(&mut self, k: usize, id: &GoalId) {
        let now = self.sim.now();
        if self.follow[k].goals.cancel(id, now) {
            if let Some(controller) = self.sim.controllers().get_mut(WITH_ACTION[k]) {
                controller.hold();
            }
            let text = "cancelled";
            let sent = self.follow[k].end(GoalState::Preempted, text, now, follow_result(0, text));
            self.note(sent);
        }
    }

    fn grasp_goal(&mut self, message: &graspActionGoal) {
        let now = self.sim.now();
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
            if let Err(error) = self.sim.command_hand(command) {
                self.faults.refuse("grasp", &error.to_string());
            }
        }
        self.note(sent.map(|_| ()));
    }

    fn grasp_cancel(&mut self, id: &GoalId) {
        if self.compat.has(Quirk::GraspSucceeds) {
            return;
        }
        let now = self.sim.now();
        if self.grasp.goals.cancel(id, now) {
            self.sim.give_hand_back();
            let sent = self.grasp.end(GoalState::Preempted, "cancelled", now, grasp_result(0));
            self.note(sent);
        }
    }

    fn shoulder(&mut self, message: &PoseStamped) {
        let stamp = message.header.stamp.seconds();
        if stamp != 0.0 && stamp < self.base_stamp {
            let reason =
                format!("Shoulderpad_filtered_pose goes back from {} s to {stamp} s", self.base_stamp);
            return self.faults.refuse("time", &reason);
        }
        match convert::read_pose(&message.pose) {
            Ok(pose) => {
                self.base_stamp = stamp;
                self.sim.track(pose);
            }
            Err(reason) => self.faults.refuse("pose", &format!("Shoulderpad_filtered_pose: {reason}")),
        }
    }

    fn set_link(&mut self, link: &LinkState) -> Result<(), String> {
        let base = format!("{}::{}", super::outlets::ARM_MODEL, self.sim.model().links[0].name);
        if link.link_name != base {
            return Err(format!("link {:?} cannot be set, only {base:?}", link.link_name));
        }
        if !matches!(link.reference_frame.as_str(), "" | "world") {
            return Err(format!("reference frame {:?}, expected world", link.reference_frame));
        }
        self.sim.track(convert::read_pose(&link.pose)?);
        Ok(())
    }

    /// Stops the arm when a node that promised to speak fell silent.
    fn watch_heartbeat(&mut self) {
        let now = self.sim.now();
        let silent = self.heartbeats.iter().find(|(_, at)| now.millis_since(**at) > SILENCE_MS);
        if let Some(name) = silent.map(|(name, _)| name.clone()) {
            self.heartbeats.remove(&name);
            let reason = format!("{name} is silent for {SILENCE_MS} ms: the arm holds");
            self.faults.refuse("heartbeat", &reason);
            let names: Vec<String> =
                self.sim.controllers().list().iter().map(|c| c.name().to_owned()).collect();
            for name in names.iter().filter(|n| *n != "hand_controller") {
                self.sim.controllers().hold_here(name);
            }
            let sent = self.follow[0].end(GoalState::Aborted, &reason, now, follow_result(-4, &reason));
            self.note(sent);
        }
    }

    /// Tells clients how their goals ended.
    fn conclude(&mut self, endings: &[(String, Ending)], hand_arrived: bool) -> rosrust::error::Result<()> {
        let now = self.sim.now();
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
        let (now, plant) = (self.sim.now(), self.sim.state().clone());
        for (k, name) in WITH_ACTION.into_iter().enumerate() {
            let Some(controller) = self.sim.controllers().get_mut(name) else { continue };
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
