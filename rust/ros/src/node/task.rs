//! `proact node task`: judges and shows the world of a Gazebo that is not ours, where `node sim` is left out.
//!
//! The original's topics tell of joints, models and grasps. What is asked of the joints they do not tell: a stand-in of
//! the actuation stage follows the method's commands, and gives way where the arm is not where it should be.

use super::{
    NodeError, RosGraph, convert,
    graph::{self, Jobs},
    stage::{self, StageContext, StageNode},
    task_outputs::{TaskPublisher, WorldUpdate},
    wire::{self, MethodCommand},
};
use crate::{
    frames,
    gazebo::GazeboWorld,
    messages::{
        gazebo_grasp_plugin_ros::GazeboGraspEvent,
        gazebo_msgs::ModelStates,
        proact_msgs::{Command as CommandMessage, Person},
        sensor_msgs::JointState,
        std_msgs::Bool,
        tf2_msgs::TFMessage,
        trajectory_msgs::JointTrajectory,
    },
    publishing::Publisher,
};
use proact_arm::ArmModel;
use proact_control::{HandStateEstimator, MotionState, ports::ArmKinematics};
use proact_messages::original::{ARM_MODEL, relative};
use proact_testbed::{
    TestbedError, TrialConfig,
    stages::{ActuationInput, ActuationOutput, ActuationStage, ExternalJointTarget},
};
use proact_types::{BodyState, Command, EventKind, HandView, InputSource, SimTime, Stop, StopCause, Vector};
use rosrust::Subscriber;
use std::sync::Arc;

/// A held arm that is this far from where it was asked to be, rad, was moved or stopped by somebody else.
const MAX_HOLD_DEVIATION_RAD: f64 = 0.05;
/// The same while it follows a path.
const MAX_PATH_DEVIATION_RAD: f64 = 0.2;
/// A command needs this long to show in the joints, ms.
const COMMAND_SETTLING_MS: u64 = 300;
const COMMAND: &str = "proact/command";

/// What the task's node is made of.
pub struct TaskParts {
    /// Set-up and limits.
    pub config: TrialConfig,
    /// The arm.
    pub model: Arc<ArmModel>,
    /// Its URDF, for the parameter `/robot_description`.
    pub urdf: String,
    /// The arm's kinematics.
    pub kinematics: Box<dyn ArmKinematics>,
}

struct TaskNode {
    context: StageContext,
    model: Arc<ArmModel>,
    world: GazeboWorld,
    task_publisher: TaskPublisher,
    hand_tracker: HandStateEstimator,
    mirrored_actuation: ActuationStage,
    last_actuation: ActuationOutput,
    /// The stand-in is where the arm was seen first.
    is_initialized: bool,
    pending_commands: Vec<MethodCommand>,
    last_command_number: u64,
    commanded_at: SimTime,
    events: Vec<EventKind>,
    counts: wire::ExpectedCounts,
    hold_publishers: HoldPublishers,
}

/// Judges and shows until the graph ends the node.
///
/// # Errors
/// [`NodeError`].
pub fn run_task(parts: TaskParts) -> Result<(), NodeError> {
    let TaskParts { config, model, urdf, kinematics } = parts;
    let graph = RosGraph::join("proact_task")?;
    let base = config.setup.body.shoulder_pose(&Default::default());
    let task = config.build_task(&model).map_err(TestbedError::Config)?;
    let stand_in = ActuationStage::new(&config, &model, task.scene())?;
    let scene = task.scene().clone();
    // The frames of the arm and of the lab are the Gazebo's; where the hand grips it does not know.
    let tf_static = graph.advertise("/tf_static", 1, true)?;
    let grasp_center = frames::grasp_center(&model, &scene);
    let transforms = grasp_center.iter().map(|frame| convert::transform(SimTime(0), frame)).collect();
    tf_static.send(TFMessage { transforms }).map_err(graph::setup_error("/tf_static"))?;
    let mut node = TaskNode {
        context: StageContext::new(&graph)?,
        world: GazeboWorld::new(model.clone(), &scene, base),
        task_publisher: TaskPublisher::new(&graph, &config, model.clone(), &urdf, kinematics)?,
        hand_tracker: HandStateEstimator::new(&model).map_err(TestbedError::from)?,
        last_actuation: stand_in.output(),
        mirrored_actuation: stand_in,
        is_initialized: false,
        pending_commands: vec![],
        last_command_number: 0,
        commanded_at: SimTime(0),
        events: vec![],
        counts: wire::ExpectedCounts::of(&model, &scene),
        hold_publishers: HoldPublishers::new(&graph, &model)?,
        model,
    };
    let jobs: Jobs<TaskNode> = Jobs::default();
    let _world = subscribe_to_world(&graph, &jobs)?;
    let _person =
        graph.subscribe(
            "proact/person",
            100,
            &jobs,
            |node: &mut TaskNode, m: Person| match wire::read_person(&m) {
                Ok((_, head)) => node.task_publisher.head = head,
                Err(reason) => node.context.node_diagnostics.record_refusal("person", &reason),
            },
        )?;
    let _command = graph.subscribe(COMMAND, 100, &jobs, |node: &mut TaskNode, m: CommandMessage| {
        match wire::read_command(&m, node.counts) {
            Ok(method_command) => {
                // A method's display comes with each of its steps; a bare command promises no other.
                if method_command.method_status.is_some() {
                    node.context.record_stamped_input(COMMAND, &m.header);
                }
                node.pending_commands.push(method_command);
            }
            Err(reason) => node.context.node_diagnostics.record_refusal("command", &reason),
        }
    })?;
    stage::run(graph, &jobs, &mut node)
}

impl StageNode for TaskNode {
    fn context(&mut self) -> &mut StageContext {
        &mut self.context
    }

    fn tick(&mut self, now: SimTime) -> rosrust::error::Result<()> {
        if !self.world.is_complete() {
            return Ok(());
        }
        self.check_method(now)?;
        self.world.follow_attached();
        let method_command = (!self.pending_commands.is_empty()).then(|| self.pending_commands.remove(0));
        let (mut motion, mut hand) = (None, None);
        if let Some(method_command) = method_command {
            (motion, hand) = (method_command.motion, method_command.hand);
            if motion.is_some() {
                (self.last_command_number, self.commanded_at) = (method_command.command_number, now);
            }
            if let Some(command) = hand {
                self.hand_tracker.set_command(command);
            }
            self.task_publisher.method_status =
                method_command.method_status.or(self.task_publisher.method_status.take());
            self.events.extend(method_command.events);
        }
        let driven = self.deviating_joints(now);
        let world = self.world.state();
        let input = ActuationInput {
            shoulder: None,
            motion,
            hand,
            fingers: None,
            frozen_fingers: None,
            external_targets: &driven,
            world,
        };
        self.last_actuation = self.mirrored_actuation.step(now, input);
        let mut events = std::mem::take(&mut self.events);
        let arm = self.model.arm_count();
        let fingers = (&world.position[arm..], &world.velocity[arm..]);
        let state = self.hand_tracker.step(fingers.0, fingers.1, self.last_actuation.hand_moving);
        let hand = HandView { state, held_object: self.world.held_object() };
        let moved = WorldUpdate {
            world,
            hand,
            actuation: &self.last_actuation,
            last_command_number: self.last_command_number,
        };
        let task = self.task_publisher.step(now, &moved, &mut events)?;
        // The world comes with the clock: one message of it says all.
        let due = self.context.stamp() == now || !events.is_empty();
        self.task_publisher.publish(now, self.context.stamp(), &moved, &task.state, &events, due)
    }

    fn is_ready(&self, _next: SimTime) -> bool {
        false
    }

    fn republish_last(&mut self) -> rosrust::error::Result<()> {
        self.task_publisher.republish_last()
    }
}

impl TaskNode {
    /// The world goes on by what `topic` brought. Its stamps are by whatever clock a lab's Gazebo has.
    fn record_input(&mut self, topic: &'static str, taken: bool) {
        if taken {
            let now = self.context.stamp();
            self.context.record_input(topic, now);
        }
    }

    /// Sends Gazebo's controllers an empty trajectory, which makes them hold: Gazebo does not know that the method is silent.
    fn check_method(&mut self, now: SimTime) -> rosrust::error::Result<()> {
        let silent = self.context.inputs.stale().any(|topic| *topic == COMMAND);
        let relaxed = self
            .task_publisher
            .method_status
            .as_ref()
            .is_some_and(|status| status.gesture == Command::NoMotion);
        if silent && self.task_publisher.hold_stop.is_none() {
            let (source, cause) = (InputSource::Stage, StopCause::Silent);
            let reason = format!("{COMMAND} is silent");
            self.task_publisher.hold_stop = Some(Stop { source, cause, since: now, reason });
            self.hold_publishers.send(self.context.stamp())?;
        } else if !silent && relaxed {
            self.task_publisher.hold_stop = None;
        }
        Ok(())
    }

    /// The joints of an arm that is not where it was asked to be: then it is where it is.
    fn deviating_joints(&mut self, now: SimTime) -> Vec<ExternalJointTarget> {
        let arm = self.model.arm_count();
        let (commanded, seen) =
            (&self.last_actuation.command.position[..arm], &self.world.state().position[..arm]);
        let off = commanded.iter().zip(seen).fold(0.0_f64, |max, (a, b)| max.max((a - b).abs()));
        let follows = matches!(self.last_actuation.motion, MotionState::Following(_));
        let settled = now.millis_since(self.commanded_at) >= COMMAND_SETTLING_MS;
        let max_deviation = if follows { MAX_PATH_DEVIATION_RAD } else { MAX_HOLD_DEVIATION_RAD };
        if self.is_initialized && (!settled || off <= max_deviation) {
            return vec![];
        }
        if self.is_initialized && follows {
            let reason = format!("the arm does not follow: {off:.2} rad off; the path is given up");
            self.context.node_diagnostics.record_refusal("arm", &reason);
        }
        self.is_initialized = true;
        let here = |(joint, position): (usize, &f64)| ExternalJointTarget {
            joint,
            position: *position,
            velocity: 0.0,
        };
        seen.iter().enumerate().map(here).collect()
    }
}

/// Trajectories without points for the arm's controllers, which hold then: the one of the arm, and one for each joint.
struct HoldPublishers(Vec<(Publisher<JointTrajectory>, Vec<String>)>);

impl HoldPublishers {
    fn new(graph: &RosGraph, model: &ArmModel) -> Result<Self, NodeError> {
        let names: Vec<String> = model.arm.iter().map(|joint| model.joints[*joint].name.clone()).collect();
        let publish =
            |controller: &str| graph.advertise(&format!("{ARM_MODEL}/{controller}/command"), 1, false);
        let mut all = vec![(publish("arm_controller")?, names.clone())];
        for (k, name) in names.into_iter().enumerate() {
            all.push((publish(&format!("j{k}_controller"))?, vec![name]));
        }
        Ok(Self(all))
    }

    fn send(&self, stamp: SimTime) -> rosrust::error::Result<()> {
        for (publisher, joint_names) in &self.0 {
            let (header, joint_names) = (convert::header(stamp, ""), joint_names.clone());
            publisher.send(JointTrajectory { header, joint_names, points: vec![] })?;
        }
        Ok(())
    }
}

/// Joints, models, and what the hand holds, as the original's Gazebo tells them.
fn subscribe_to_world(graph: &RosGraph, jobs: &Jobs<TaskNode>) -> Result<Vec<Subscriber>, NodeError> {
    Ok(vec![
        graph.subscribe(relative::WRAPPED_JOINT_STATES, 1, jobs, |node: &mut TaskNode, m: JointState| {
            let done = node.world.update_joints(&m.name, &m.position, &m.velocity);
            node.record_input(relative::WRAPPED_JOINT_STATES, done.is_ok());
            node.context.report_error("joint_states", done);
        })?,
        graph.subscribe(relative::MODEL_STATES, 1, jobs, |node: &mut TaskNode, m: ModelStates| {
            let done = update_models(&mut node.world, &m);
            node.record_input(relative::MODEL_STATES, done.is_ok());
            node.context.report_error("model_states", done);
        })?,
        graph.subscribe(relative::GRASP_EVENTS, 1, jobs, |node: &mut TaskNode, m: GazeboGraspEvent| {
            match node.world.object_of_collision(&m.object) {
                Some(block) => node.world.update_grasp(block, m.attached),
                None => {
                    let reason = format!("{:?} is no object's collision", m.object);
                    node.context.node_diagnostics.record_refusal("grasp_events", &reason);
                }
            }
        })?,
        graph.subscribe(relative::GRASP_STATUS, 1, jobs, |node: &mut TaskNode, m: Bool| {
            node.world.update_grasp_status(m.data);
        })?,
    ])
}

fn update_models(world: &mut GazeboWorld, message: &ModelStates) -> Result<(), String> {
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
            Ok(BodyState {
                pose: convert::read_pose(pose)?,
                linear_velocity: linear,
                angular_velocity: angular,
            })
        })
        .collect::<Result<_, String>>()?;
    for (name, body) in names.iter().zip(bodies) {
        if name == ARM_MODEL {
            world.update_base(body.pose);
        }
        world.update_body(name, body);
    }
    Ok(())
}
