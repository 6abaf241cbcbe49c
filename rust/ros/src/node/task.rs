//! `proact node task`: judges and shows the world of a Gazebo that is not ours, where `node sim` is left out.
//!
//! The original's topics tell of joints, models and grasps. What is asked of the joints they do not tell: a stand-in of
//! the actuation stage follows the method's commands, and gives way where the arm is not where it should be.

use super::{
    NodeError, RosGraph, convert,
    graph::Jobs,
    judge::{Judge, Moved},
    stage::{self, Common, Stage},
    wire::{self, Asked},
};
use crate::{
    gazebo::GazeboWorld,
    messages::{
        gazebo_grasp_plugin_ros::GazeboGraspEvent,
        gazebo_msgs::ModelStates,
        proact_msgs::{Command, Person},
        sensor_msgs::JointState,
        std_msgs::Bool,
    },
};
use proact_arm::ArmModel;
use proact_control::{HandTracker, MotionState, ports::ArmKinematics};
use proact_messages::original::{ARM_MODEL, relative};
use proact_testbed::{
    TestbedError, TrialConfig,
    stages::{ActuationInput, ActuationOutput, ActuationStage, DrivenJoint},
};
use proact_types::{BodyState, EventKind, HandView, SimTime, Vector};
use rosrust::Subscriber;
use std::sync::Arc;

/// A held arm that is this far from where it was asked to be, rad, was moved or stopped by somebody else.
const STRAYED: f64 = 0.05;
/// The same while it follows a path.
const LEFT_BEHIND: f64 = 0.2;
/// A command needs this long to show in the joints, ms.
const SETTLING_MS: u64 = 300;

/// What the task's node is made of.
pub struct TaskParts {
    /// Set-up and limits.
    pub config: TrialConfig,
    /// The arm.
    pub model: Arc<ArmModel>,
    /// The arm's kinematics.
    pub kinematics: Box<dyn ArmKinematics>,
}

struct TaskNode {
    common: Common,
    model: Arc<ArmModel>,
    world: GazeboWorld,
    judge: Judge,
    tracker: HandTracker,
    stand_in: ActuationStage,
    said: ActuationOutput,
    /// The stand-in is where the arm was seen first.
    placed: bool,
    asked: Vec<Asked>,
    acted_on: u64,
    commanded_at: SimTime,
    events: Vec<EventKind>,
    counts: wire::Counts,
}

/// Judges and shows until the graph ends the node.
///
/// # Errors
/// [`NodeError`].
pub fn run_task(parts: TaskParts) -> Result<(), NodeError> {
    let TaskParts { config, model, kinematics } = parts;
    let graph = RosGraph::join("proact_task")?;
    let open = model.pose("hand", "open").map_err(TestbedError::Model)?;
    let base = config.setup.body.shoulder_pose(&Default::default());
    let task = config.build_task(&model).map_err(TestbedError::Config)?;
    let stand_in = ActuationStage::new(&config, &model, task.scene())?;
    let scene = task.scene().clone();
    let mut node = TaskNode {
        common: Common::new(&graph)?,
        world: GazeboWorld::new(model.clone(), &scene, base),
        judge: Judge::new(&graph, &config, model.clone(), kinematics)?,
        tracker: HandTracker::new(open),
        said: stand_in.output(),
        stand_in,
        placed: false,
        asked: vec![],
        acted_on: 0,
        commanded_at: SimTime(0),
        events: vec![],
        counts: wire::Counts::of(&model, &scene),
        model,
    };
    let jobs: Jobs<TaskNode> = Jobs::default();
    let _world = listen_to_world(&graph, &jobs)?;
    let _person =
        graph.listen(
            "proact/person",
            100,
            &jobs,
            |node: &mut TaskNode, m: Person| match wire::read_person(&m) {
                Ok((_, head)) => node.judge.head = head,
                Err(reason) => node.common.faults.refuse("person", &reason),
            },
        )?;
    let _command =
        graph.listen(
            "proact/command",
            100,
            &jobs,
            |node: &mut TaskNode, m: Command| match wire::read_command(&m, node.counts) {
                Ok(asked) => node.asked.push(asked),
                Err(reason) => node.common.faults.refuse("command", &reason),
            },
        )?;
    stage::run(graph, &jobs, &mut node)
}

impl Stage for TaskNode {
    fn common(&mut self) -> &mut Common {
        &mut self.common
    }

    fn tick(&mut self, now: SimTime) -> rosrust::error::Result<()> {
        if !self.world.is_complete() {
            return Ok(());
        }
        self.world.follow_attached();
        let asked = (!self.asked.is_empty()).then(|| self.asked.remove(0));
        let (mut motion, mut hand) = (None, None);
        if let Some(asked) = asked {
            (motion, hand) = (asked.motion, asked.hand);
            if motion.is_some() {
                (self.acted_on, self.commanded_at) = (asked.number, now);
            }
            if let Some(command) = hand {
                self.tracker.note(command);
            }
            self.judge.shown = asked.shown.or(self.judge.shown.take());
            self.events.extend(asked.events);
        }
        let driven = self.strayed(now);
        let world = self.world.state();
        let input = ActuationInput {
            shoulder: None,
            motion,
            hand,
            fingers: None,
            frozen: None,
            driven: &driven,
            world,
        };
        self.said = self.stand_in.step(now, input);
        let mut events = std::mem::take(&mut self.events);
        let arm = self.model.arm_count();
        let fingers = (&world.position[arm..], &world.velocity[arm..]);
        let state = self.tracker.step(fingers.0, fingers.1, self.said.hand_moving);
        let hand = HandView { state, holds: self.world.held() };
        let moved = Moved { world, hand, actuation: &self.said, acted_on: self.acted_on };
        let task = self.judge.step(now, &moved, &mut events)?;
        // The world comes with the clock: one message of it says all.
        let due = self.common.stamp() == now || !events.is_empty();
        self.judge.tell(now, &moved, &task.state, &events, due)
    }

    fn is_ready(&self, _next: SimTime) -> bool {
        false
    }

    fn repeat(&mut self) -> rosrust::error::Result<()> {
        self.judge.repeat()
    }
}

impl TaskNode {
    /// The joints of an arm that is not where it was asked to be: then it is where it is.
    fn strayed(&mut self, now: SimTime) -> Vec<DrivenJoint> {
        let arm = self.model.arm_count();
        let (asked, seen) = (&self.said.command.position[..arm], &self.world.state().position[..arm]);
        let off = asked.iter().zip(seen).fold(0.0_f64, |most, (a, b)| most.max((a - b).abs()));
        let follows = matches!(self.said.motion, MotionState::Following(_));
        let settled = now.millis_since(self.commanded_at) >= SETTLING_MS;
        let most = if follows { LEFT_BEHIND } else { STRAYED };
        if self.placed && (!settled || off <= most) {
            return vec![];
        }
        if self.placed && follows {
            let reason = format!("the arm does not follow: {off:.2} rad off; the path is given up");
            self.common.faults.refuse("arm", &reason);
        }
        self.placed = true;
        let here =
            |(joint, position): (usize, &f64)| DrivenJoint { joint, position: *position, velocity: 0.0 };
        seen.iter().enumerate().map(here).collect()
    }
}

/// Joints, models, and what the hand holds, as the original's Gazebo tells them.
fn listen_to_world(graph: &RosGraph, jobs: &Jobs<TaskNode>) -> Result<Vec<Subscriber>, NodeError> {
    Ok(vec![
        graph.listen(relative::WRAPPED_JOINT_STATES, 1, jobs, |node: &mut TaskNode, m: JointState| {
            let done = node.world.take_joints(&m.name, &m.position, &m.velocity);
            node.common.note("joint_states", done);
        })?,
        graph.listen(relative::MODEL_STATES, 1, jobs, |node: &mut TaskNode, m: ModelStates| {
            let done = take_models(&mut node.world, &m);
            node.common.note("model_states", done);
        })?,
        graph.listen(
            relative::GRASP_EVENTS,
            1,
            jobs,
            |node: &mut TaskNode, m: GazeboGraspEvent| match node.world.object_of_collision(&m.object) {
                Some(block) => node.world.take_grasp(block, m.attached),
                None => {
                    let reason = format!("{:?} is no object's collision", m.object);
                    node.common.faults.refuse("grasp_events", &reason);
                }
            },
        )?,
        graph.listen(relative::GRASP_STATUS, 1, jobs, |node: &mut TaskNode, m: Bool| {
            node.world.take_grasp_status(m.data);
        })?,
    ])
}

fn take_models(world: &mut GazeboWorld, message: &ModelStates) -> Result<(), String> {
    let (names, poses, twists) = (&message.name, &message.pose, &message.twist);
    if poses.len() != names.len() || twists.len() != names.len() {
        return Err(format!("{} names, {} poses, {} twists", names.len(), poses.len(), twists.len()));
    }
    // All or nothing: half an instant would be a world that never was.
    let bodies: Vec<BodyState> = poses
        .iter()
        .zip(twists)
        .map(|(pose, twist)| {
            let vector = |v: &crate::messages::geometry_msgs::Vector3| Vector::new(v.x, v.y, v.z);
            let (linear, angular) = (vector(&twist.linear), vector(&twist.angular));
            if !linear.iter().chain(angular.iter()).all(|v| v.is_finite()) {
                return Err("a twist is not finite".to_owned());
            }
            Ok(BodyState { pose: convert::read_pose(pose)?, linear, angular })
        })
        .collect::<Result<_, String>>()?;
    for (name, body) in names.iter().zip(bodies) {
        if name == ARM_MODEL {
            world.take_base(body.pose);
        }
        world.take_body(name, body);
    }
    Ok(())
}
