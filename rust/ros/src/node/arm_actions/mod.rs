//! The actions that move arm and hand, `follow_joint_trajectory` of two controllers and `/grasp`, with what ros_control's
//! controllers ask of the joints meanwhile. Whoever has the physics asks [`ArmActions::step_controllers`] before each tick, and tells what
//! came of it after.

mod goals;
mod server;

use super::{NodeDiagnostics, NodeError, RosGraph, convert, graph::Jobs};
use crate::{
    action::{GoalId, GoalState},
    compat::{CompatOption, CompatOptions},
    controllers::{Controllers, GoalResult, GoalTolerances},
    messages::{
        control_msgs::{
            FollowJointTrajectoryActionFeedback, FollowJointTrajectoryActionGoal,
            FollowJointTrajectoryActionResult, JointTrajectoryControllerState,
        },
        mpl_control::{graspActionFeedback, graspActionGoal, graspActionResult},
        trajectory_msgs::JointTrajectory,
    },
    publishing::Publisher,
    trajectory::RawPoint,
};
use goals::{follow_result, grasp_result, tolerances, with_default_id};
use proact_arm::ArmModel;
use proact_control::HandCommand;
use proact_messages::original::ARM_MODEL;
use proact_testbed::stages::ExternalTargets;
use proact_types::{JointVector, PlantState, SimTime};
use rosrust::{Subscriber, error::Result as Sent};
use server::{ActionServer, goal_id};
use std::sync::Arc;

/// From one feedback to the next, ms (20 Hz, as ros_control).
pub(super) const FEEDBACK_MS: u64 = 50;
/// From one status list to the next, ms (5 Hz, as actionlib).
pub(super) const STATUS_MS: u64 = 200;
/// Controllers that have an action beside their command topic: those of arm and hand.
const ACTION_CONTROLLERS: [&str; 2] = ["arm_controller", "hand_controller"];
const ARM: usize = 0;
const HAND: usize = 1;

type FollowActionServer =
    ActionServer<FollowJointTrajectoryActionResult, FollowJointTrajectoryActionFeedback>;
type GraspActionServer = ActionServer<graspActionResult, graspActionFeedback>;

/// A node that offers them.
pub(super) trait HasArmActions: 'static {
    fn actions(&mut self) -> &mut ArmActions;

    /// Whether this caller has said in a message of its own what its goals for the hand say as well.
    fn has_typed_command(&self, _caller: &str) -> bool {
        false
    }
}

pub(super) struct ArmActions {
    pub controllers: Controllers,
    /// Joints of the arm, and all that move.
    joint_counts: [usize; 2],
    follow: [FollowActionServer; 2],
    grasp: GraspActionServer,
    state_publishers: [Publisher<JointTrajectoryControllerState>; 2],
    node_diagnostics: Arc<NodeDiagnostics>,
    compat: CompatOptions,
    now: SimTime,
    /// For the hand, in the next tick.
    hand_command: Option<HandCommand>,
    hold_hand: bool,
    /// A command for the hand that has not ended.
    hand_command_active: bool,
    /// Goals' trajectories that ended in this tick, by controller.
    goal_results: Vec<(String, GoalResult)>,
}

impl ArmActions {
    /// Offers the actions, with all joints held at `start`.
    pub(super) fn new(
        graph: &RosGraph,
        model: &ArmModel,
        start: &JointVector,
        compat: CompatOptions,
    ) -> Result<Self, NodeError> {
        let follow = |name: &str| {
            FollowActionServer::new(graph, &format!("{ARM_MODEL}/{name}/follow_joint_trajectory"))
        };
        let state = |name: &str| graph.advertise(&format!("{ARM_MODEL}/{name}/state"), 1, false);
        Ok(Self {
            controllers: Controllers::new(model, start),
            joint_counts: [model.arm_count(), model.moving_count()],
            follow: [follow(ACTION_CONTROLLERS[ARM])?, follow(ACTION_CONTROLLERS[HAND])?],
            grasp: ActionServer::new(graph, "grasp")?,
            state_publishers: [state(ACTION_CONTROLLERS[ARM])?, state(ACTION_CONTROLLERS[HAND])?],
            node_diagnostics: graph.node_diagnostics().clone(),
            compat,
            now: SimTime(0),
            hand_command: None,
            hold_hand: false,
            hand_command_active: false,
            goal_results: Vec::new(),
        })
    }

    /// Listens to goals and cancels.
    pub(super) fn subscribe<S: HasArmActions>(
        graph: &RosGraph,
        jobs: &Jobs<S>,
    ) -> Result<Vec<Subscriber>, NodeError> {
        let mut all = Vec::new();
        for (k, name) in ACTION_CONTROLLERS.into_iter().enumerate() {
            all.extend(FollowActionServer::subscribe(
                graph,
                &format!("{ARM_MODEL}/{name}/follow_joint_trajectory"),
                jobs,
                move |node: &mut S, goal: FollowJointTrajectoryActionGoal, _| node.actions().goal(k, &goal),
                move |node: &mut S, id| node.actions().cancel(k, &id),
            )?);
        }
        all.extend(GraspActionServer::subscribe(
            graph,
            "grasp",
            jobs,
            |node: &mut S, goal: graspActionGoal, caller| {
                let has_typed_command = node.has_typed_command(caller);
                node.actions().grasp_goal(&goal, has_typed_command);
            },
            |node: &mut S, id| node.actions().grasp_cancel(&id),
        )?);
        Ok(all)
    }

    /// What the controllers ask for in tick `now`, which comes next.
    pub(super) fn step_controllers(&mut self, now: SimTime, state: &PlantState) -> ExternalTargets {
        self.now = now;
        self.goal_results = self.controllers.step(now, &state.position, &state.velocity);
        ExternalTargets {
            joints: self.controllers.joint_targets(),
            hand: self.hand_command.take(),
            hold_hand: std::mem::take(&mut self.hold_hand),
        }
    }

    /// What came of it: the joints' targets, and whether the hand has arrived or holds something. Tells clients how their
    /// goals ended.
    pub(super) fn finish_tick(&mut self, targets: &[f64], hand_rests: bool) -> Sent<()> {
        self.controllers.sync_to_targets(targets);
        for (name, ending) in std::mem::take(&mut self.goal_results) {
            let Some(k) = ACTION_CONTROLLERS.iter().position(|n| *n == name) else { continue };
            let (state, code, text) = match &ending {
                GoalResult::Reached => (GoalState::Succeeded, 0, ""),
                GoalResult::PathViolated(text) => (GoalState::Aborted, -4, text.as_str()),
                GoalResult::GoalViolated(text) => (GoalState::Aborted, -5, text.as_str()),
            };
            self.follow[k].end(state, text, self.now, follow_result(code, text))?;
        }
        if self.hand_command_active && hand_rests {
            self.hand_command_active = false;
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
    pub(super) fn release_arm(&mut self) {
        self.controllers.release_joints(0..self.joint_counts[0]);
    }

    /// The method commands the arm now.
    pub(super) fn preempt_arm(&mut self) {
        self.release_arm();
        self.end_follow_goal(ARM, GoalState::Preempted, 0, "the method took its place");
    }

    /// The method commands the hand now.
    pub(super) fn preempt_hand(&mut self) {
        self.controllers.release_joints(self.joint_counts[0]..self.joint_counts[1]);
        self.hand_command = None;
        self.hand_command_active = true;
        self.end_follow_goal(HAND, GoalState::Preempted, 0, "the method took its place");
    }

    /// The arm was stopped for a reason.
    pub(super) fn stop_arm(&mut self, reason: &str) {
        self.release_arm();
        self.end_follow_goal(ARM, GoalState::Aborted, -4, reason);
    }

    /// These controllers were stopped.
    pub(super) fn abort_stopped_controllers(&mut self, names: &[String]) {
        for (k, name) in ACTION_CONTROLLERS.into_iter().enumerate() {
            if names.iter().any(|n| n == name) {
                self.end_follow_goal(k, GoalState::Aborted, 0, "its controller was stopped");
            }
        }
    }

    /// Arm and hand are back at `start`.
    pub(super) fn reset(&mut self, model: &ArmModel, start: &JointVector) {
        let text = "the world was reset";
        self.end_follow_goal(ARM, GoalState::Aborted, 0, text);
        self.end_follow_goal(HAND, GoalState::Aborted, 0, text);
        let sent = self.grasp.end(GoalState::Aborted, text, self.now, grasp_result(0));
        self.report_error(sent);
        self.controllers = Controllers::new(model, start);
        (self.hand_command, self.hold_hand, self.hand_command_active) = (None, false, false);
    }

    /// A trajectory on a controller's command topic: an action's goal before it is over then.
    pub(super) fn receive_command(&mut self, name: &str, message: &JointTrajectory) {
        if let Err((_, reason)) = self.start_trajectory(name, message, None) {
            return self.node_diagnostics.record_refusal("trajectory", &format!("{name}: {reason}"));
        }
        if let Some(k) = ACTION_CONTROLLERS.iter().position(|n| *n == name) {
            self.end_follow_goal(k, GoalState::Preempted, 0, "a command on the topic took its place");
        }
    }

    fn end_follow_goal(&mut self, k: usize, state: GoalState, code: i32, text: &str) {
        let sent = self.follow[k].end(state, text, self.now, follow_result(code, text));
        self.report_error(sent);
    }

    /// Or the code and the reason of a refusal.
    fn start_trajectory(
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
        if name == ACTION_CONTROLLERS[HAND] {
            self.preempt_grasp();
        }
        Ok(())
    }

    fn goal(&mut self, k: usize, message: &FollowJointTrajectoryActionGoal) {
        let (now, goal, name) = (self.now, &message.goal, ACTION_CONTROLLERS[k]);
        let id = with_default_id(goal_id(&message.goal_id), now);
        let newer = follow_result(0, "a newer goal took its place");
        // The same goal again, or one that its cancel overtook: what the controller does goes on.
        if !self.follow[k].goals.would_begin(&id) {
            let sent = self.follow[k].admit(id, now, newer).map(|_| ());
            return self.report_error(sent);
        }
        let names = self.controllers.get_mut(name).map(|c| c.joint_names().to_vec()).unwrap_or_default();
        let checked = tolerances(&names, goal).map_err(|reason| (-1, reason)).and_then(|tolerances| {
            if goal.trajectory.points.is_empty() {
                return Err((-1, "the trajectory has no points".to_owned()));
            }
            self.start_trajectory(name, &goal.trajectory, Some(tolerances))
        });
        let sent = match checked {
            Ok(()) => self.follow[k].admit(id, now, newer).map(|_| ()),
            Err((code, reason)) => {
                self.node_diagnostics.record_refusal("trajectory", &format!("{name}: {reason}"));
                self.follow[k].reject(id, &reason, now, follow_result(code, &reason))
            }
        };
        self.report_error(sent);
    }

    fn cancel(&mut self, k: usize, id: &GoalId) {
        if self.follow[k].goals.cancel(id, self.now) {
            if let Some(controller) = self.controllers.get_mut(ACTION_CONTROLLERS[k]) {
                controller.hold();
            }
            self.end_follow_goal(k, GoalState::Preempted, 0, "cancelled");
        }
    }

    /// `has_typed_command`: the method has said so in full already.
    fn grasp_goal(&mut self, message: &graspActionGoal, has_typed_command: bool) {
        let now = self.now;
        let id = with_default_id(goal_id(&message.goal_id), now);
        let command = match message.goal.instruct {
            1 => HandCommand::Close,
            2 => HandCommand::Open,
            other => {
                let reason = format!("instruct is {other}, expected 1 to close or 2 to open");
                self.node_diagnostics.record_refusal("grasp", &reason);
                let sent = self.grasp.reject(id, &reason, now, grasp_result(0));
                return self.report_error(sent);
            }
        };
        let sent = self.grasp.admit(id, now, grasp_result(0));
        if matches!(sent, Ok(true)) {
            self.end_follow_goal(HAND, GoalState::Preempted, 0, "the grasp action took its place");
            if !has_typed_command {
                self.controllers.release_joints(self.joint_counts[0]..self.joint_counts[1]);
                (self.hand_command, self.hold_hand, self.hand_command_active) = (Some(command), false, true);
            }
        }
        self.report_error(sent.map(|_| ()));
    }

    fn grasp_cancel(&mut self, id: &GoalId) {
        if self.compat.has(CompatOption::GraspSucceeds) {
            return;
        }
        if self.grasp.goals.cancel(id, self.now) {
            self.freeze_hand();
            let sent = self.grasp.end(GoalState::Preempted, "cancelled", self.now, grasp_result(0));
            self.report_error(sent);
        }
    }

    /// A trajectory has the hand now: the grasp that ran ends with a result.
    fn preempt_grasp(&mut self) {
        self.freeze_hand();
        let succeeds = self.compat.has(CompatOption::GraspSucceeds);
        let state = if succeeds { GoalState::Succeeded } else { GoalState::Preempted };
        let text = "a trajectory of the hand took its place";
        let sent = self.grasp.end(state, text, self.now, grasp_result(0));
        self.report_error(sent);
    }

    /// The fingers stay where they are asked to be; a command for them is given up.
    fn freeze_hand(&mut self) {
        (self.hand_command, self.hold_hand, self.hand_command_active) = (None, true, false);
    }

    fn feedback(&mut self, state: &PlantState) -> Sent<()> {
        let now = self.now;
        for (k, name) in ACTION_CONTROLLERS.into_iter().enumerate() {
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
            self.state_publishers[k].send(JointTrajectoryControllerState {
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

    fn report_error(&self, sent: Sent<()>) {
        if let Err(error) = sent {
            self.node_diagnostics.record_refusal("publish", &error.to_string());
        }
    }
}
