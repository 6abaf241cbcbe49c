//! `proact node testbed`: the whole testbed in one node, under the original's names.

use super::{
    Faults, NodeError, RosGraph,
    arm_actions::{ArmActions, OffersActions},
    convert,
    gaze_topics::{self, GazeTopics, Looks},
    graph::{Jobs, Pace, parameter},
    outlets::{Choices, Outlets, View},
    plan_request, wire,
};
use crate::{
    compat::Quirk,
    frames::WORLD,
    messages::{
        geometry_msgs::{PoseStamped, Vector3Stamped},
        moveit_msgs::MotionPlanRequest,
        proact_msgs::Frame,
        std_msgs::{Bool, Int8, String as Text},
        std_srvs::{Empty, EmptyRes},
        trajectory_msgs::JointTrajectory,
    },
};
use proact_messages::original;
use proact_messages::original::relative;
use proact_testbed::{Session, Step, Testbed, TrialResult};
use proact_types::{
    DisplayFrame, EventKind, GazeSample, Gesture, HandState, InputSource, PlanReply, Pose, Scene, SimTime,
};
use rosrust::Publisher;
use std::sync::Arc;

/// What the callbacks bring for the next tick.
struct Inbox {
    faults: Arc<Faults>,
    gesture: Option<Gesture>,
    gaze_topics: GazeTopics,
    gaze: Option<GazeSample>,
    paused: bool,
    actions: ArmActions,
}

impl Inbox {
    fn new(faults: Arc<Faults>, actions: ArmActions) -> Self {
        let gaze_topics = GazeTopics::default();
        Self { faults, gesture: None, gaze_topics, gaze: None, paused: false, actions }
    }
}

impl OffersActions for Inbox {
    fn actions(&mut self) -> &mut ArmActions {
        &mut self.actions
    }
}

impl Looks for Inbox {
    fn gaze_topics(&mut self) -> &mut GazeTopics {
        &mut self.gaze_topics
    }

    fn faults(&self) -> &Arc<Faults> {
        &self.faults
    }

    fn look(&mut self, gaze: GazeSample) {
        self.gaze = Some(gaze);
    }
}

/// The topics of the methods and of the person.
struct Topics {
    emg: Publisher<Text>,
    gaze: [Publisher<Vector3Stamped>; 4],
    head: Publisher<PoseStamped>,
    shifted_head: bool,
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
/// listened to. Either way other programs' goals move arm and hand, until the method commands them.
///
/// # Errors
/// [`NodeError`].
pub fn run_testbed(mut session: Session, simulated: bool) -> Result<TrialResult, NodeError> {
    let mut graph = RosGraph::join("proact_testbed")?;
    let rate = rate()?;
    let stay: bool = parameter("~stay", false, "true or false")?;
    let model = session.testbed().model().clone();
    let choices = Choices::of_parameters(&model, session.testbed().task().scene())?;
    let shifted_head = choices.compat.has(Quirk::HeadQuaternion);
    let actions = ArmActions::new(&graph, &model, session.testbed().targets(), choices.compat.clone())?;
    let outlets = Outlets::new(&graph, &model, session.testbed().task().scene(), choices)?;
    let topics = Topics {
        emg: graph.publish(relative::EMG, 10, false)?,
        gaze: [
            graph.publish(relative::GAZE_POSITION, 10, false)?,
            graph.publish(relative::GAZE_DIRECTION, 10, false)?,
            graph.publish(relative::GAZE_POSITION_ROS, 10, false)?,
            graph.publish(relative::GAZE_DIRECTION_ROS, 10, false)?,
        ],
        head: graph.publish(relative::HEAD_ROS, 1, false)?,
        shifted_head,
        mode: graph.publish(relative::MODE, 1, true)?,
        success: graph.publish(relative::SUCCESS, 1, false)?,
        frozen: graph.publish(relative::SELECTION_FROZEN, 1, false)?,
        block_id: graph.publish(relative::BLOCK_ID, 1, false)?,
        current_block: graph.publish(relative::CURRENT_BLOCK, 1, false)?,
        place: graph.publish(relative::PLACE_LOCATION, 1, false)?,
        request: graph.publish(relative::PLAN_REQUEST, 1, false)?,
        command: graph.publish(relative::ARM_COMMAND, 1, false)?,
        frame: graph.publish("proact/frame", 2, false)?,
        result: graph.publish("proact/result", 1, true)?,
    };
    let jobs: Jobs<Inbox> = Jobs::default();
    let mut listening = ArmActions::listen(&graph, &jobs)?;
    if !simulated {
        listening.extend(listen(&graph, &jobs)?);
    }
    let pause = |name: &str, paused: bool| {
        graph.serve::<Empty, _>(name, &jobs, move |inbox: &mut Inbox, _| {
            inbox.paused = paused;
            Ok(EmptyRes {})
        })
    };
    let _pausing = [pause("gazebo/pause_physics", true)?, pause("gazebo/unpause_physics", false)?];
    graph.watch_master()?;

    let mut inbox = Inbox::new(graph.faults().clone(), actions);
    let mut pace = Pace::new();
    let mut plan: Option<PlanReply> = None;
    let mut seen = Seen::default();
    let mut finished = false;
    while graph.is_ok() {
        jobs.run(&mut inbox);
        if graph.master_restarted() {
            inbox.paused = true;
            rosrust::ros_warn!("{}", super::PAUSED_AFTER_RESTART);
        }
        if inbox.paused {
            pace.tick();
            continue;
        }
        if let Some(gesture) = inbox.gesture.take() {
            session.person().command(InputSource::GestureTopic, gesture);
            session.person().hear(InputSource::GestureTopic);
        }
        if let Some(gaze) = inbox.gaze.take() {
            session.person().look(gaze);
        }
        let next = session.testbed().now().plus_millis(1);
        session.drive(inbox.actions.ask(next, session.testbed().plant().state()));
        let step = session.step(false)?;
        let acted = conclude(&mut inbox.actions, &step, session.testbed());
        if let Err(error) = acted {
            graph.faults().refuse("publish", &error.to_string());
        }
        for event in &step.output.events {
            if let EventKind::Stopped { reason, .. } = &event.kind {
                graph.faults().stop(reason);
            }
        }
        let head = session.head();
        let sent = publish(&step, &session, &outlets, &topics, &head, rate, &mut plan, &mut seen);
        if let Err(error) = sent {
            graph.faults().refuse("publish", &error.to_string());
        }
        graph.tell(convert::time(step.time));
        if step.output.finished && !finished {
            finished = true;
            let json = json("the result", &session.result())?;
            // The last words of the node: whoever listens gets them before it leaves.
            let _ = topics.result.send(Text { data: json });
            let wait = Some(std::time::Duration::from_secs(1));
            let _ = topics.result.wait_for_subscribers(wait);
            if !stay {
                break;
            }
        }
        pace.tick();
    }
    graph.stop_watching();
    Ok(session.result())
}

/// What came of the tick for those whose goals move arm and hand.
fn conclude(actions: &mut ArmActions, step: &Step, testbed: &Testbed) -> rosrust::error::Result<()> {
    if step.output.arm_commanded {
        actions.method_has_arm();
    }
    if step.output.hand_commanded {
        actions.method_has_hand();
    }
    actions.told(testbed.targets(), testbed.hand_rests())?;
    actions.publish(testbed.plant().state())
}

/// Instants a second: `~rate`, which must divide 1000.
pub(super) fn rate() -> Result<u64, NodeError> {
    let rate: i32 = parameter("~rate", 100, "a divisor of 1000")?;
    if rate < 1 || 1000 % rate != 0 {
        return Err(NodeError::Parameter {
            name: "~rate".to_owned(),
            got: rate.to_string(),
            expected: "a divisor of 1000",
        });
    }
    Ok(rate as u64)
}

pub(super) fn json(what: &'static str, value: &impl serde::Serialize) -> Result<String, NodeError> {
    serde_json::to_string(value).map_err(|source| NodeError::Json { what, source })
}

fn listen(graph: &RosGraph, jobs: &Jobs<Inbox>) -> Result<Vec<rosrust::Subscriber>, NodeError> {
    let mut listening = gaze_topics::listen(graph, jobs)?;
    listening.push(graph.listen(relative::EMG, 1, jobs, |inbox: &mut Inbox, message: Text| {
        match message.data.parse::<Gesture>() {
            Ok(gesture) => inbox.gesture = Some(gesture),
            Err(error) => inbox.faults.refuse("emg", &error.to_string()),
        }
    })?);
    Ok(listening)
}

/// What was last told, so that events are told once.
#[derive(Default)]
struct Seen {
    mode: Option<u8>,
    hand: HandState,
}

#[allow(clippy::too_many_arguments)]
fn publish(
    step: &Step,
    session: &Session,
    outlets: &Outlets,
    topics: &Topics,
    head: &Pose,
    rate: u64,
    plan: &mut Option<PlanReply>,
    seen: &mut Seen,
) -> rosrust::error::Result<()> {
    let time = step.time;
    let testbed = session.testbed();
    let state = testbed.plant().state();
    if time.0.is_multiple_of(1000 / rate) {
        outlets.clock(time)?;
        outlets.state(time, state, Some(head))?;
        let mut pose = convert::pose_stamped(time, WORLD, head);
        if topics.shifted_head {
            let q = &mut pose.pose.orientation;
            (q.x, q.y, q.z, q.w) = (q.w, q.x, q.y, q.z);
        }
        topics.head.send(pose)?;
    }
    if let Some(command) = step.output.message {
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
        if super::is_grasp(&event.kind) {
            outlets.grasp(event)?;
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
        topics.command.send(command(testbed.model(), time, reply))?;
        *plan = Some(reply.clone());
    }
    if let Some(frame) = &step.frame {
        show(frame, testbed.task().scene(), topics, seen)?;
        let view = View {
            posterior: &frame.target.posterior,
            marked: frame.target.object,
            place: frame.target.place,
            gaze: frame.gaze,
            plan: plan.as_ref(),
        };
        outlets.draw(time, state, &view)?;
    }
    Ok(())
}

fn show(frame: &DisplayFrame, scene: &Scene, topics: &Topics, seen: &mut Seen) -> rosrust::error::Result<()> {
    if topics.frame.subscriber_count() > 0 {
        topics.frame.send(wire::frame(frame))?;
    }
    if let Some(mode) = &frame.mode
        && seen.mode != Some(original::mode_number(mode.moves))
    {
        let number = original::mode_number(mode.moves);
        seen.mode = Some(number);
        topics.mode.send(Int8 { data: number as i8 })?;
    }
    let objects = &scene.objects;
    let name = |k: usize| Text { data: objects.get(k).map_or(String::new(), |o| o.ros_name.clone()) };
    if let Some(object) = frame.target.object.filter(|_| frame.hand.holds.is_none()) {
        topics.current_block.send(name(object.index()))?;
    }
    let best = frame.target.posterior.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1));
    if let Some((k, _)) = best.filter(|(_, p)| **p > 0.0) {
        topics.block_id.send(name(k))?;
    }
    if let Some(place) = frame.target.place {
        let pose = Pose::translation(place.x, place.y, place.z);
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
pub(super) fn command(model: &proact_arm::ArmModel, time: SimTime, reply: &PlanReply) -> JointTrajectory {
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
