//! The actions that move arm and hand, `follow_joint_trajectory` of two controllers and `/grasp`, with what ros_control's
//! controllers ask of the joints meanwhile. Whoever has the physics asks [`ArmActions::ask`] before each tick, and tells what
//! came of it after.

mod goals;
mod server;

use super::{Faults, NodeError, RosGraph, convert, graph::Jobs};
use crate::{
    action::{GoalId, GoalState},
    compat::{Compat, Quirk},
    controllers::{Controllers, Ending, GoalTolerances},
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
use proact_control::HandCommand;
use proact_messages::original::ARM_MODEL;
use proact_testbed::stages::Driven;
use proact_types::{JointVector, PlantState, SimTime};
use rosrust::{Publisher, Subscriber, error::Result as Sent};
use server::{Action, goal_id};
use std::sync::Arc;

/// From one feedback to the next, ms (20 Hz, as ros_control).
pub(super) const FEEDBACK_MS: u64 = 50;
/// From one status list to the next, ms (5 Hz, as actionlib).
pub(super) const STATUS_MS: u64 = 200;
/// Controllers that have an action beside their command topic: those of arm and hand.
const WITH_ACTION: [&str; 2] = ["arm_controller", "hand_controller"];
const ARM: usize = 0;
const HAND: usize = 1;

type Follow = Action<FollowJointTrajectoryActionResult, FollowJointTrajectoryActionFeedback>;
type Grasp = Action<graspActionResult, graspActionFeedback>;

/// A node that offers them.
pub(super) trait OffersActions: 'static {
    fn actions(&mut self) -> &mut ArmActions;

    /// Whether this caller has said in a message of its own what its goals for the hand say as well.
    fn has_told(&self, _caller: &str) -> bool {
        false
    }
}

pub(super) struct ArmActions {
    pub controllers: Controllers,
    /// Joints of the arm, and all that move.
    counts: [usize; 2],
    follow: [Follow; 2],
    grasp: Grasp,
    states: [Publisher<JointTrajectoryControllerState>; 2],
    faults: Arc<Faults>,
    compat: Compat,
    now: SimTime,
    /// For the hand, in the next tick.
    hand: Option<HandCommand>,
    hold_hand: bool,
    /// A command for the hand that has not ended.
    hand_on_its_way: bool,
    /// Goals' trajectories that ended in this tick, by controller.
    endings: Vec<(String, Ending)>,
}

impl ArmActions {
    /// Offers the actions, with all joints held at `start`.
    pub(super) fn new(
        graph: &RosGraph,
        model: &ArmModel,
        start: &JointVector,
        compat: Compat,
    ) -> Result<Self, NodeError> {
        let follow = |name: &str| Follow::new(graph, &format!("{ARM_MODEL}/{name}/follow_joint_trajectory"));
        let state = |name: &str| graph.publish(&format!("{ARM_MODEL}/{name}/state"), 1, false);
        Ok(Self {
            controllers: Controllers::new(model, start),
            counts: [model.arm_count(), model.moving_count()],
            follow: [follow(WITH_ACTION[ARM])?, follow(WITH_ACTION[HAND])?],
            grasp: Action::new(graph, "grasp")?,
            states: [state(WITH_ACTION[ARM])?, state(WITH_ACTION[HAND])?],
            faults: graph.faults().clone(),
            compat,
            now: SimTime(0),
            hand: None,
            hold_hand: false,
            hand_on_its_way: false,
            endings: Vec::new(),
        })
    }

    /// Listens to goals and cancels.
    pub(super) fn listen<S: OffersActions>(
        graph: &RosGraph,
        jobs: &Jobs<S>,
    ) -> Result<Vec<Subscriber>, NodeError> {
        let mut all = Vec::new();
        for (k, name) in WITH_ACTION.into_iter().enumerate() {
            all.extend(Follow::listen(
                graph,
                &format!("{ARM_MODEL}/{name}/follow_joint_trajectory"),
                jobs,
                move |node: &mut S, goal: FollowJointTrajectoryActionGoal, _| node.actions().goal(k, &goal),
                move |node: &mut S, id| node.actions().cancel(k, &id),
            )?);
        }
        all.extend(Grasp::listen(
            graph,
            "grasp",
            jobs,
            |node: &mut S, goal: graspActionGoal, caller| {
                let told = node.has_told(caller);
                node.actions().grasp_goal(&goal, told);
            },
            |node: &mut S, id| node.actions().grasp_cancel(&id),
        )?);
        Ok(all)
    }

    /// What the controllers ask for in tick `now`, which comes next.
    pub(super) fn ask(&mut self, now: SimTime, state: &PlantState) -> Driven {
        self.now = now;
        self.endings = self.controllers.step(now, &state.position, &state.velocity);
        Driven {
            joints: self.controllers.driven(),
            hand: self.hand.take(),
            hold_hand: std::mem::take(&mut self.hold_hand),
        }
    }

    /// What came of it: the joints' targets, and whether the hand has arrived or holds something. Tells clients how their
    /// goals ended.
    pub(super) fn told(&mut self, targets: &[f64], hand_rests: bool) -> Sent<()> {
        self.controllers.follow_targets(targets);
        for (name, ending) in std::mem::take(&mut self.endings) {
            let Some(k) = WITH_ACTION.iter().position(|n| *n == name) else { continue };
            let (state, code, text) = match &ending {
                Ending::Reached => (GoalState::Succeeded, 0, ""),
                Ending::PathViolated(text) => (GoalState::Aborted, -4, text.as_str()),
                Ending::GoalViolated(text) => (GoalState::Aborted, -5, text.as_str()),
            };
            self.follow[k].end(state, text, self.now, follow_result(code, text))?;
        }
        if self.hand_on_its_way && hand_rests {
            self.hand_on_its_way = false;
            if self.grasp.goals.active().is_some() {
                self.grasp.end(GoalState::Succeeded, "", self.now, grasp_result(1))?;
            }
        }
        Ok(())
    }

    /// Feedback and status of the instant, as often as they are due.
    pub(super) fn publish(&mut self, state: &PlantState) -> Sent<()> {
        if self.now.0.is_multiple_of(FEEDBACK_MS) {
            self.feedback(state)?;
        }
        if self.now.0.is_multiple_of(STATUS_MS) {
            for follow in &mut self.follow {
                follow.status(self.now)?;
            }
            self.grasp.status(self.now)?;
        }
        Ok(())
    }

    /// Somebody else commands the arm now: what its controllers do is over. A goal is left to the caller.
    pub(super) fn let_go_of_arm(&mut self) {
        self.controllers.let_go(0..self.counts[0]);
    }

    /// The method commands the arm now.
    pub(super) fn method_has_arm(&mut self) {
        self.let_go_of_arm();
        self.end_follow(ARM, GoalState::Preempted, 0, "the method took its place");
    }

    /// The method commands the hand now.
    pub(super) fn method_has_hand(&mut self) {
        self.controllers.let_go(self.counts[0]..self.counts[1]);
        self.hand = None;
        self.hand_on_its_way = true;
        self.end_follow(HAND, GoalState::Preempted, 0, "the method took its place");
    }

    /// The arm was stopped for a reason.
    pub(super) fn stop_arm(&mut self, reason: &str) {
        self.let_go_of_arm();
        self.end_follow(ARM, GoalState::Aborted, -4, reason);
    }

    /// These controllers were stopped.
    pub(super) fn stopped(&mut self, names: &[String]) {
        for (k, name) in WITH_ACTION.into_iter().enumerate() {
            if names.iter().any(|n| n == name) {
                self.end_follow(k, GoalState::Aborted, 0, "its controller was stopped");
            }
        }
    }

    /// Arm and hand are back at `start`.
    pub(super) fn reset(&mut self, model: &ArmModel, start: &JointVector) {
        let text = "the world was reset";
        self.end_follow(ARM, GoalState::Aborted, 0, text);
        self.end_follow(HAND, GoalState::Aborted, 0, text);
        let sent = self.grasp.end(GoalState::Aborted, text, self.now, grasp_result(0));
        self.note(sent);
        self.controllers = Controllers::new(model, start);
        (self.hand, self.hold_hand, self.hand_on_its_way) = (None, false, false);
    }

    /// A trajectory on a controller's command topic: an action's goal before it is over then.
    pub(super) fn command(&mut self, name: &str, message: &JointTrajectory) {
        if let Err((_, reason)) = self.follow(name, message, None) {
            return self.faults.refuse("trajectory", &format!("{name}: {reason}"));
        }
        if let Some(k) = WITH_ACTION.iter().position(|n| *n == name) {
            self.end_follow(k, GoalState::Preempted, 0, "a command on the topic took its place");
        }
    }

    fn end_follow(&mut self, k: usize, state: GoalState, code: i32, text: &str) {
        let sent = self.follow[k].end(state, text, self.now, follow_result(code, text));
        self.note(sent);
    }

    /// Or the code and the reason of a refusal.
    fn follow(
        &mut self,
        name: &str,
        message: &JointTrajectory,
        tolerances: Option<GoalTolerances>,
    ) -> Result<(), (i32, String)> {
        let now = self.now;
        let refused = |reason: &str| (-1, reason.to_owned());
        let controller = self.controllers.get_mut(name).ok_or_else(|| refused("no such"))?;
        if !controller.running() {
            return Err(refused("the controller is not running; call switch_controller first"));
        }
        let stamp = &message.header.stamp;
        let begin = if stamp.nanos() == 0 { 0.0 } else { convert::secs_until(stamp, now) };
        let points: Vec<RawPoint> = message.points.iter().map(convert::read_point).collect();
        controller
            .follow(&message.joint_names, &points, begin, tolerances, now)
            .map_err(|error| (error.code(), error.to_string()))?;
        if name == WITH_ACTION[HAND] {
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
        let names = self.controllers.get_mut(name).map(|c| c.joint_names().to_vec()).unwrap_or_default();
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
        if self.follow[k].goals.cancel(id, self.now) {
            if let Some(controller) = self.controllers.get_mut(WITH_ACTION[k]) {
                controller.hold();
            }
            self.end_follow(k, GoalState::Preempted, 0, "cancelled");
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
            self.end_follow(HAND, GoalState::Preempted, 0, "the grasp action took its place");
            if !told {
                self.controllers.let_go(self.counts[0]..self.counts[1]);
                (self.hand, self.hold_hand, self.hand_on_its_way) = (Some(command), false, true);
            }
        }
        self.note(sent.map(|_| ()));
    }

    fn grasp_cancel(&mut self, id: &GoalId) {
        if self.compat.has(Quirk::GraspSucceeds) {
            return;
        }
        if self.grasp.goals.cancel(id, self.now) {
            self.stay();
            let sent = self.grasp.end(GoalState::Preempted, "cancelled", self.now, grasp_result(0));
            self.note(sent);
        }
    }

    /// A trajectory has the hand now: the grasp that ran ends with a result.
    fn leave_grasp(&mut self) {
        self.stay();
        let succeeds = self.compat.has(Quirk::GraspSucceeds);
        let state = if succeeds { GoalState::Succeeded } else { GoalState::Preempted };
        let text = "a trajectory of the hand took its place";
        let sent = self.grasp.end(state, text, self.now, grasp_result(0));
        self.note(sent);
    }

    /// The fingers stay where they are asked to be; a command for them is given up.
    fn stay(&mut self) {
        (self.hand, self.hold_hand, self.hand_on_its_way) = (None, true, false);
    }

    fn feedback(&mut self, state: &PlantState) -> Sent<()> {
        let now = self.now;
        for (k, name) in WITH_ACTION.into_iter().enumerate() {
            let Some(controller) = self.controllers.get_mut(name) else { continue };
            let mut desired = convert::trajectory_point(controller.desired());
            let mut actual = desired.clone();
            let joints = controller.joints();
            if k == HAND && self.grasp.goals.active().is_some() {
                desired.velocities.iter_mut().for_each(|v| *v = 0.0);
            }
            actual.positions = joints.iter().map(|j| state.position[*j]).collect();
            actual.velocities = joints.iter().map(|j| state.velocity[*j]).collect();
            let minus = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a - b).collect::<Vec<f64>>();
            let mut error = desired.clone();
            error.positions = minus(&desired.positions, &actual.positions);
            error.velocities = minus(&desired.velocities, &actual.velocities);
            let joint_names = controller.joint_names().to_vec();
            self.states[k].send(JointTrajectoryControllerState {
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

    fn note(&self, sent: Sent<()>) {
        if let Err(error) = sent {
            self.faults.refuse("publish", &error.to_string());
        }
    }
}
