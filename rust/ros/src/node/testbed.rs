//! `proact node testbed`: the whole testbed in one node, under the original's names.

use super::{
    NodeDiagnostics, NodeError, RosGraph,
    arm_actions::{ArmActions, HasArmActions},
    control_interface::ControlInterface,
    convert,
    gaze_topics::{self, GazeTopicNode, GazeTopics},
    graph::{Jobs, TickRate, parameter},
    plan_request,
    publishers::{MarkerData, WorldPublisherOptions, WorldPublishers},
    rosout, wire,
};
use crate::{
    compat::CompatOption,
    frames::WORLD,
    messages::{
        geometry_msgs::{PoseStamped, Vector3Stamped},
        moveit_msgs::MotionPlanRequest,
        proact_msgs::Frame,
        std_msgs::{Bool, Int8, String as Text},
        std_srvs::{Empty, EmptyRes},
        trajectory_msgs::JointTrajectory,
    },
    publishing::Publisher,
};
use proact_messages::original;
use proact_messages::original::relative;
use proact_testbed::{RunningTrial, Testbed, TrialResult, TrialStep};
use proact_types::{
    Command, DisplayFrame, EventKind, GazeSample, HandState, InputSource, PlanReply, Pose, Scene, SimTime,
};
use std::{sync::Arc, time::Duration};

/// How long the node waits at its end until subscribers have the result.
const LAST_MESSAGE_TIMEOUT: Duration = Duration::from_secs(1);

/// What the callbacks bring for the next tick.
struct TestbedInputs {
    node_diagnostics: Arc<NodeDiagnostics>,
    gesture: Option<Command>,
    gaze_topics: GazeTopics,
    gaze: Option<GazeSample>,
    paused: bool,
    actions: ArmActions,
}

impl TestbedInputs {
    fn new(faults: Arc<NodeDiagnostics>, actions: ArmActions) -> Self {
        let gaze_topics = GazeTopics::default();
        Self { node_diagnostics: faults, gesture: None, gaze_topics, gaze: None, paused: false, actions }
    }
}

impl HasArmActions for TestbedInputs {
    fn actions(&mut self) -> &mut ArmActions {
        &mut self.actions
    }
}

impl GazeTopicNode for TestbedInputs {
    fn gaze_topics(&mut self) -> &mut GazeTopics {
        &mut self.gaze_topics
    }

    fn node_diagnostics(&self) -> &Arc<NodeDiagnostics> {
        &self.node_diagnostics
    }

    fn receive_gaze(&mut self, gaze: GazeSample) {
        self.gaze = Some(gaze);
    }
}

/// The topics of the methods and of the person.
struct TestbedPublishers {
    emg: Publisher<Text>,
    gaze: [Publisher<Vector3Stamped>; 4],
    head: Publisher<PoseStamped>,
    wxyz_head_quaternion: bool,
    mode: Publisher<Int8>,
    success: Publisher<Bool>,
    frozen: Publisher<Bool>,
    block_id: Publisher<Text>,
    current_block: Publisher<Text>,
    place: Publisher<PoseStamped>,
    request: Publisher<MotionPlanRequest>,
    command: Publisher<JointTrajectory>,
    frame: Publisher<Frame>,
    result: Publisher<Text>,
}

/// Runs a trial in real time until it is over or the graph ends the node; answers the trial's result. With
/// `simulated`, the session's own participant acts; otherwise `/emg`, `/gaze_position` with `/gaze_direction` are
/// listened to. `urdf` is the arm's description. Either way other programs' goals move arm and hand, until the method commands them.
///
/// # Errors
/// [`NodeError`].
pub fn run_testbed(mut trial: RunningTrial, simulated: bool, urdf: &str) -> Result<TrialResult, NodeError> {
    let mut graph = RosGraph::join("proact_testbed")?;
    let rate = read_rate_parameter()?;
    let stay: bool = parameter("~keep_running", false, "true or false")?;
    let model = trial.testbed().model().clone();
    let choices = WorldPublisherOptions::from_parameters(&model, trial.testbed().task().scene())?;
    let shifted_head = choices.compat.has(CompatOption::HeadQuaternion);
    let actions = ArmActions::new(&graph, &model, trial.testbed().targets(), choices.compat.clone())?;
    let publishers = WorldPublishers::new(&graph, &model, trial.testbed().task().scene(), choices)?;
    let topics = TestbedPublishers {
        emg: graph.advertise(relative::EMG, 10, false)?,
        gaze: [
            graph.advertise(relative::GAZE_POSITION, 10, false)?,
            graph.advertise(relative::GAZE_DIRECTION, 10, false)?,
            graph.advertise(relative::GAZE_POSITION_ROS, 10, false)?,
            graph.advertise(relative::GAZE_DIRECTION_ROS, 10, false)?,
        ],
        head: graph.advertise(relative::HEAD_ROS, 1, false)?,
        wxyz_head_quaternion: shifted_head,
        mode: graph.advertise(relative::MODE, 1, true)?,
        success: graph.advertise(relative::SUCCESS, 1, false)?,
        frozen: graph.advertise(relative::SELECTION_FROZEN, 1, false)?,
        block_id: graph.advertise(relative::BLOCK_ID, 1, false)?,
        current_block: graph.advertise(relative::CURRENT_BLOCK, 1, false)?,
        place: graph.advertise(relative::PLACE_LOCATION, 1, false)?,
        request: graph.advertise(relative::PLAN_REQUEST, 1, false)?,
        command: graph.advertise(relative::ARM_COMMAND, 1, false)?,
        frame: graph.advertise("proact/frame", 2, false)?,
        result: graph.advertise("proact/result", 1, true)?,
    };
    let testbed = trial.testbed();
    let task_name = &testbed.config().task.name;
    let mut interface = ControlInterface::new(&graph, &model, urdf, task_name, testbed.task())?;
    let jobs: Jobs<TestbedInputs> = Jobs::default();
    let mut listening = ArmActions::subscribe(&graph, &jobs)?;
    if !simulated {
        listening.extend(subscribe(&graph, &jobs)?);
    }
    let pause = |name: &str, paused: bool| {
        graph.advertise_service::<Empty, _>(name, &jobs, move |inbox: &mut TestbedInputs, _| {
            inbox.paused = paused;
            Ok(EmptyRes {})
        })
    };
    let _pausing = [pause("gazebo/pause_physics", true)?, pause("gazebo/unpause_physics", false)?];
    graph.watch_master()?;

    let mut inbox = TestbedInputs::new(graph.node_diagnostics().clone(), actions);
    let mut pace = TickRate::new();
    let mut plan: Option<PlanReply> = None;
    let mut seen = LastPublished::default();
    let mut finished = false;
    while graph.is_ok() {
        jobs.run(&mut inbox);
        if graph.master_restarted() {
            inbox.paused = true;
            rosout::warn(super::PAUSED_AFTER_RESTART);
        }
        if inbox.paused {
            pace.sleep();
            continue;
        }
        if let Some(command) = inbox.gesture.take() {
            trial.person_stage_mut().set_command_from(InputSource::GestureTopic, command);
            trial.person_stage_mut().record_heartbeat(InputSource::GestureTopic);
        }
        if let Some(gaze) = inbox.gaze.take() {
            trial.person_stage_mut().set_gaze(gaze);
        }
        let next = trial.testbed().now().plus_millis(1);
        trial.set_external_targets(inbox.actions.step_controllers(next, trial.testbed().plant().state()));
        let step = trial.step(false)?;
        let acted = finish_actions(&mut inbox.actions, &step, trial.testbed());
        if let Err(error) = acted {
            graph.node_diagnostics().record_refusal("publish", &error.to_string());
        }
        for event in &step.output.events {
            if let EventKind::Stopped { reason, .. } = &event.kind {
                graph.node_diagnostics().record_stop(reason);
            }
        }
        if let Err(error) = interface.publish(step.time, trial.testbed().task().state()) {
            graph.node_diagnostics().record_refusal("publish", &error.to_string());
        }
        let head = trial.head_pose();
        let sent = publish(&step, &trial, &publishers, &topics, &head, rate, &mut plan, &mut seen);
        if let Err(error) = sent {
            graph.node_diagnostics().record_refusal("publish", &error.to_string());
        }
        graph.publish_diagnostics(convert::time(step.time));
        if step.output.finished && !finished {
            finished = true;
            let json = to_json("the result", &trial.result())?;
            // The last words of the node: whoever listens gets them before it leaves.
            let _ = topics.result.send(Text { data: json });
            topics.result.flush(LAST_MESSAGE_TIMEOUT);
            if !stay {
                break;
            }
        }
        pace.sleep();
    }
    graph.stop_watching();
    Ok(trial.result())
}

/// What came of the tick for those whose goals move arm and hand.
fn finish_actions(
    actions: &mut ArmActions,
    step: &TrialStep,
    testbed: &Testbed,
) -> rosrust::error::Result<()> {
    if step.output.arm_commanded {
        actions.preempt_arm();
    }
    if step.output.hand_commanded {
        actions.preempt_hand();
    }
    actions.finish_tick(testbed.targets(), testbed.is_hand_settled())?;
    actions.publish(testbed.plant().state())
}

/// Instants a second: `~rate_hz`, which must divide 1000.
pub(super) fn read_rate_parameter() -> Result<u64, NodeError> {
    let rate: i32 = parameter("~rate_hz", 100, "a divisor of 1000")?;
    if rate < 1 || 1000 % rate != 0 {
        return Err(NodeError::Parameter {
            name: "~rate_hz".to_owned(),
            got: rate.to_string(),
            expected: "a divisor of 1000",
        });
    }
    Ok(rate as u64)
}

pub(super) fn to_json(what: &'static str, value: &impl serde::Serialize) -> Result<String, NodeError> {
    serde_json::to_string(value).map_err(|source| NodeError::Json { what, source })
}

fn subscribe(graph: &RosGraph, jobs: &Jobs<TestbedInputs>) -> Result<Vec<rosrust::Subscriber>, NodeError> {
    let mut listening = gaze_topics::subscribe(graph, jobs)?;
    listening.push(graph.subscribe(relative::EMG, 1, jobs, |inbox: &mut TestbedInputs, message: Text| {
        match message.data.parse::<Command>() {
            Ok(command) => inbox.gesture = Some(command),
            Err(error) => inbox.node_diagnostics.record_refusal("emg", &error.to_string()),
        }
    })?);
    Ok(listening)
}

/// What was last told, so that events are told once.
#[derive(Default)]
struct LastPublished {
    mode: Option<u8>,
    hand: HandState,
}

#[allow(clippy::too_many_arguments)]
fn publish(
    step: &TrialStep,
    trial: &RunningTrial,
    publishers: &WorldPublishers,
    topics: &TestbedPublishers,
    head: &Pose,
    rate: u64,
    plan: &mut Option<PlanReply>,
    seen: &mut LastPublished,
) -> rosrust::error::Result<()> {
    let time = step.time;
    let testbed = trial.testbed();
    let state = testbed.plant().state();
    if time.0.is_multiple_of(1000 / rate) {
        publishers.publish_clock(time)?;
        publishers.publish_state(time, state, Some(head))?;
        let mut pose = convert::pose_stamped(time, WORLD, head);
        if topics.wxyz_head_quaternion {
            let q = &mut pose.pose.orientation;
            (q.x, q.y, q.z, q.w) = (q.w, q.x, q.y, q.z);
        }
        topics.head.send(pose)?;
    }
    if let Some(command) = step.output.published_command {
        topics.emg.send(Text { data: command.ros_name().to_owned() })?;
    }
    if let Some(gaze) = step.input.gaze.filter(|g| g.valid) {
        for (k, publisher) in topics.gaze.iter().enumerate() {
            let v = if k % 2 == 0 { gaze.origin.coords } else { gaze.direction.normalize() };
            publisher
                .send(Vector3Stamped { header: convert::header(time, WORLD), vector: convert::vector(&v) })?;
        }
    }
    for event in &step.output.events {
        if super::is_grasp_event(&event.kind) {
            publishers.publish_grasp(event)?;
        }
        match &event.kind {
            EventKind::Locked { .. } => topics.frozen.send(Bool { data: true })?,
            EventKind::Unlocked => topics.frozen.send(Bool { data: false })?,
            _ => {}
        }
    }
    if let Some(request) = &step.output.request {
        topics.request.send(plan_request::message(testbed.model(), request, time))?;
    }
    if let Some(reply) = step.output.plan.as_ref().filter(|reply| !reply.trajectory.points.is_empty()) {
        topics.command.send(trajectory_message(testbed.model(), time, reply))?;
        *plan = Some(reply.clone());
    }
    if let Some(frame) = &step.frame {
        publish_frame(frame, testbed.task().scene(), topics, seen)?;
        let view = MarkerData {
            posterior: &frame.target.posterior,
            highlighted: frame.target.object,
            place: frame.target.place,
            gaze: frame.gaze,
            plan: plan.as_ref(),
        };
        publishers.publish_markers(time, state, &view)?;
    }
    Ok(())
}

fn publish_frame(
    frame: &DisplayFrame,
    scene: &Scene,
    topics: &TestbedPublishers,
    seen: &mut LastPublished,
) -> rosrust::error::Result<()> {
    if topics.frame.subscriber_count() > 0 {
        topics.frame.send(wire::frame(frame))?;
    }
    if let Some(mode) = &frame.mode
        && seen.mode != Some(original::mode_number(mode.controlled_dof))
    {
        let number = original::mode_number(mode.controlled_dof);
        seen.mode = Some(number);
        topics.mode.send(Int8 { data: number as i8 })?;
    }
    let objects = &scene.objects;
    let name = |k: usize| Text { data: objects.get(k).map_or(String::new(), |o| o.ros_name.clone()) };
    if let Some(object) = frame.target.object.filter(|_| frame.hand.held_object.is_none()) {
        topics.current_block.send(name(object.index()))?;
    }
    let best = frame.target.posterior.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1));
    if let Some((k, _)) = best.filter(|(_, p)| **p > 0.0) {
        topics.block_id.send(name(k))?;
    }
    if let Some(place_point) = frame.target.place {
        let pose = Pose::translation(place_point.x, place_point.y, place_point.z);
        topics.place.send(convert::pose_stamped(frame.time, WORLD, &pose))?;
    }
    if seen.hand != frame.hand.state {
        seen.hand = frame.hand.state;
        match seen.hand {
            HandState::Closed => topics.success.send(Bool { data: true })?,
            HandState::Open => topics.success.send(Bool { data: false })?,
            HandState::Closing | HandState::Opening => {}
        }
    }
    Ok(())
}

/// A plan as the message that a trajectory controller takes.
pub(super) fn trajectory_message(
    model: &proact_arm::ArmModel,
    time: SimTime,
    reply: &PlanReply,
) -> JointTrajectory {
    let points =
        reply.trajectory.points.iter().map(|p| crate::messages::trajectory_msgs::JointTrajectoryPoint {
            positions: p.q.to_vec(),
            velocities: p.qd.to_vec(),
            time_from_start: convert::duration(p.time_secs),
            ..Default::default()
        });
    JointTrajectory {
        header: convert::header(time, &model.links[0].name),
        joint_names: model.arm.iter().map(|j| model.joints[*j].name.clone()).collect(),
        points: points.collect(),
    }
}
