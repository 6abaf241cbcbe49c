//! Inputs and outputs of the stages as messages of proact_msgs, and back without the loss of a bit.

mod display;

use super::convert;
use crate::messages::{
    geometry_msgs,
    proact_msgs::{Command as CommandMessage, Decision, Gaze, Intent, Person, State},
};
use nalgebra::{Quaternion, UnitQuaternion};
use proact_arm::ArmModel;
use proact_control::{HandCommand, MotionCommand, MotionState};
use proact_emg::EmgOutput;
use proact_tasks::TaskState;
use proact_testbed::stages::{ActuationOutput, EmgStageOutput, GazeFreshness, IntentOutput, MethodOutput};
use proact_types::{
    BodyState, Command, Drives, EmgSample, EventKind, GazeSample, Gesture, HandState, HandView, Heartbeat,
    HeartbeatKind, InputSource, InvalidGesture, JointVector, MAX_DRIVES, MAX_EMG_CHANNELS, MAX_GESTURES,
    MAX_TICK_SAMPLES, ObjectId, ObjectSet, PlantCommand, PlantState, Point, Pose, Scene, SimTime,
    TaskContext, TickInput, Trajectory, TrajectoryPoint, Vector,
};
use serde::{Serialize, de::DeserializeOwned};

pub use display::MethodStatus;
pub(super) use display::{frame, read_frame};

/// Why a message is not taken: one sentence.
pub(super) type DecodeError = String;

fn finite(what: &str, values: &[f64]) -> Result<(), DecodeError> {
    match values.iter().find(|value| !value.is_finite()) {
        Some(bad) => Err(format!("{what} holds {bad}, expected finite numbers")),
        None => Ok(()),
    }
}

fn joints(what: &str, values: &[f64]) -> Result<JointVector, DecodeError> {
    finite(what, values)?;
    let many =
        || format!("{what} has {} values, expected {} at most", values.len(), proact_types::MAX_JOINTS);
    JointVector::try_from(values).map_err(|_| many())
}

/// One of `all` by its place.
fn element_at<T: Copy>(what: &str, all: &[T], index: usize) -> Result<T, DecodeError> {
    let wrong = || format!("{what} is {index}, expected less than {}", all.len());
    all.get(index).copied().ok_or_else(wrong)
}

/// The same where -1 stands for none.
fn optional_element<T: Copy>(what: &str, all: &[T], index: i8) -> Result<Option<T>, DecodeError> {
    usize::try_from(index).ok().map(|index| element_at(what, all, index)).transpose()
}

/// The name of a gesture.
fn parse_gesture(text: &str) -> Result<Gesture, DecodeError> {
    text.parse().map_err(|error: InvalidGesture| error.to_string())
}

/// The value of an array that holds none or one.
fn optional_value<'a, T>(what: &str, values: &'a [T]) -> Result<Option<&'a T>, DecodeError> {
    match values {
        [] => Ok(None),
        [value] => Ok(Some(value)),
        _ => Err(format!("{what} has {} values, expected none or one", values.len())),
    }
}

fn encode_index(index: Option<usize>) -> i8 {
    index.map_or(-1, |index| index as i8)
}

fn encode_object(object: Option<ObjectId>) -> i16 {
    object.map_or(-1, |object| object.0 as i16)
}

/// One of `count` objects; none below zero.
fn decode_object(what: &str, index: i16, count: usize) -> Result<Option<ObjectId>, DecodeError> {
    let Ok(index) = u16::try_from(index) else { return Ok(None) };
    if usize::from(index) >= count {
        return Err(format!("{what} is {index}, expected less than {count}"));
    }
    Ok(Some(ObjectId(index)))
}

fn encode_set(set: &ObjectSet) -> Vec<u16> {
    set.iter().map(|object| object.0).collect()
}

fn decode_set(what: &str, indices: &[u16], count: usize) -> Result<ObjectSet, DecodeError> {
    match indices.iter().find(|index| usize::from(**index) >= count) {
        Some(wrong) => Err(format!("{what} holds {wrong}, expected less than {count}")),
        None => Ok(indices.iter().map(|index| ObjectId(*index)).collect()),
    }
}

/// How many there are of each, by which a message is judged.
#[derive(Clone, Copy, Debug)]
pub struct ExpectedCounts {
    /// Joints of the arm.
    pub arm: usize,
    /// Moving joints with the hand's.
    pub moving: usize,
    /// Objects of the scene.
    pub objects: usize,
}

impl ExpectedCounts {
    /// Of an arm before a scene.
    pub fn of(model: &ArmModel, scene: &Scene) -> Self {
        let objects = scene.objects.len();
        Self { arm: model.arm_count(), moving: model.moving_count(), objects }
    }
}

fn decode_tick(tick: i64) -> Option<SimTime> {
    u64::try_from(tick).ok().map(SimTime)
}

fn encode_tick(at: Option<SimTime>) -> i64 {
    at.map_or(-1, |at| at.0 as i64)
}

fn events_to_json<T: Serialize>(events: &[T]) -> Vec<String> {
    events.iter().filter_map(|event| serde_json::to_string(event).ok()).collect()
}

fn from_json<T: DeserializeOwned>(what: &str, text: &str) -> Result<T, DecodeError> {
    serde_json::from_str(text).map_err(|error| format!("{what}: {error}"))
}

fn events_from_json<T: DeserializeOwned>(texts: &[String]) -> Result<Vec<T>, DecodeError> {
    texts.iter().map(|text| from_json("an event", text)).collect()
}

/// A pose bit for bit, whatever the length of its quaternion.
fn exact_pose(pose: &geometry_msgs::Pose) -> Result<Pose, DecodeError> {
    let (p, q) = (&pose.position, &pose.orientation);
    finite("a pose", &[p.x, p.y, p.z, q.x, q.y, q.z, q.w])?;
    let rotation = UnitQuaternion::new_unchecked(Quaternion::new(q.w, q.x, q.y, q.z));
    Ok(Pose::from_parts(nalgebra::Translation3::new(p.x, p.y, p.z), rotation))
}

fn exact_vector(v: &geometry_msgs::Vector3) -> Vector {
    Vector::new(v.x, v.y, v.z)
}

fn gaze(sample: &GazeSample) -> Gaze {
    Gaze {
        origin: convert::point(&sample.origin),
        direction: convert::vector(&sample.direction),
        valid: sample.valid,
    }
}

/// A gaze may hold anything: the stage knows what is usable.
fn read_gaze(gaze: &Gaze) -> GazeSample {
    GazeSample {
        origin: Point::new(gaze.origin.x, gaze.origin.y, gaze.origin.z),
        direction: exact_vector(&gaze.direction),
        valid: gaze.valid,
    }
}

/// What a person gives in one tick; `stamp` is the graph's time.
pub(super) fn person(tick: SimTime, stamp: SimTime, input: &TickInput, head: &Pose) -> Person {
    Person {
        header: convert::header(stamp, ""),
        tick: tick.0,
        counters: input.emg.iter().map(|sample| sample.counter).collect(),
        samples: input.emg.iter().flat_map(|sample| sample.channels.iter().copied()).collect(),
        gesture: encode_index(input.command.map(Command::index)),
        gaze: input.gaze.iter().map(gaze).collect(),
        shoulder: input.shoulder.iter().map(convert::pose).collect(),
        limb: input.limb.iter().flatten().copied().collect(),
        head: convert::pose(head),
        sign_sources: input.heartbeats.iter().map(|heartbeat| heartbeat.source.index() as u8).collect(),
        sign_kinds: input.heartbeats.iter().map(|heartbeat| heartbeat.kind as u8).collect(),
    }
}

/// The inputs of a tick, and `world_from_head`.
pub(super) fn read_person(message: &Person) -> Result<(TickInput, Pose), DecodeError> {
    let mut input = TickInput::default();
    let samples = message.counters.len();
    let channels = message.samples.len().checked_div(samples).unwrap_or(0);
    if channels * samples != message.samples.len() || (samples > 0 && channels == 0) {
        return Err(format!("{} values for {samples} EMG samples", message.samples.len()));
    }
    if channels > MAX_EMG_CHANNELS {
        return Err(format!("{channels} EMG channels, expected at most {MAX_EMG_CHANNELS}"));
    }
    if samples > MAX_TICK_SAMPLES {
        return Err(format!("{samples} EMG samples for a tick, expected at most {MAX_TICK_SAMPLES}"));
    }
    for (counter, values) in message.counters.iter().zip(message.samples.chunks(channels.max(1))) {
        let sample = EmgSample { counter: *counter, channels: values.into() };
        input.emg.push(sample);
    }
    input.command = optional_element("gesture", &Command::ALL, message.gesture)?;
    input.gaze = optional_value("gaze", &message.gaze)?.map(read_gaze);
    input.shoulder = optional_value("the shoulder", &message.shoulder)?.map(exact_pose).transpose()?;
    if !message.limb.is_empty() {
        input.limb = Some(joints("the limb", &message.limb)?);
    }
    for (source, kind) in message.sign_sources.iter().zip(&message.sign_kinds) {
        let source = element_at("a sign's source", &InputSource::ALL, usize::from(*source))?;
        let kind = element_at("a sign's kind", &HeartbeatKind::ALL, usize::from(*kind))?;
        input.heartbeats.try_push(Heartbeat { source, kind }).map_err(|_| "too many signs".to_owned())?;
    }
    Ok((input, exact_pose(&message.head)?))
}

/// What the EMG stage says.
pub(super) fn decision(tick: SimTime, stamp: SimTime, output: &EmgStageOutput) -> Decision {
    let mut message = Decision {
        header: convert::header(stamp, ""),
        tick: tick.0,
        gesture: output.command.index() as u8,
        recognised: output.recognized_gesture.to_string(),
        message: encode_index(output.published_command.map(Command::index)),
        decided_at: encode_tick(output.decided_at),
        confidence: output.confidence,
        effort: output.effort,
        drives: output.drives.to_vec(),
        fault: output.fault.as_ref().and_then(|f| serde_json::to_string(f).ok()).unwrap_or_default(),
        armed: output.armed,
        events: events_to_json(&output.events),
        ..Decision::default()
    };
    if let Some(decision) = &output.decision {
        message.decided = true;
        message.decided_gesture = decision.gesture.to_string();
        message.decided_place = decision.class_index as u8;
        message.published = decision.published;
        message.window_class = decision.window_class.to_string();
        message.posterior = decision.posterior.to_vec();
        message.voted = decision.class.map(String::from).unwrap_or_default();
        message.stale = decision.stale;
        message.window_confidence = decision.confidence;
        message.window_effort = decision.effort;
        message.window_drives = decision.drives.to_vec();
    }
    message
}

/// Drives, of which none is out of its range.
fn drives(values: &[f64]) -> Result<Drives, DecodeError> {
    if values.len() > MAX_DRIVES || !values.iter().all(|drive| drive.abs() <= 1.0) {
        return Err(format!("drives are {values:?}, expected at most {MAX_DRIVES} numbers of -1 to 1"));
    }
    Ok(values.iter().copied().collect())
}

/// What the EMG stage said.
pub(super) fn read_decision(message: &Decision) -> Result<EmgStageOutput, DecodeError> {
    let mut output = EmgStageOutput {
        command: element_at("gesture", &Command::ALL, usize::from(message.gesture))?,
        recognized_gesture: parse_gesture(&message.recognised)?,
        decision: None,
        published_command: optional_element("message", &Command::ALL, message.message)?,
        decided_at: decode_tick(message.decided_at),
        confidence: message.confidence,
        effort: message.effort,
        drives: drives(&message.drives)?,
        fault: None,
        armed: message.armed,
        overridden: false,
        events: events_from_json(&message.events)?,
        // A classifier's own answers stay with the node that asks it.
        answers: vec![],
    };
    if !message.fault.is_empty() {
        output.fault = Some(from_json("fault", &message.fault)?);
    }
    if message.decided {
        let (got, decided_index) = (message.posterior.len(), usize::from(message.decided_place));
        if got > MAX_GESTURES || decided_index >= got {
            return Err(format!(
                "posterior has {got} values, expected more than {decided_index}, at most {MAX_GESTURES}"
            ));
        }
        output.decision = Some(Box::new(EmgOutput {
            gesture: parse_gesture(&message.decided_gesture)?,
            class_index: decided_index,
            published: message.published,
            window_class: parse_gesture(&message.window_class)?,
            posterior: message.posterior.iter().copied().collect(),
            confidence: message.window_confidence,
            class: Some(message.voted.as_str())
                .filter(|name| !name.is_empty())
                .map(parse_gesture)
                .transpose()?,
            effort: message.window_effort,
            drives: drives(&message.window_drives)?,
            stale: message.stale,
        }));
    }
    Ok(output)
}

const GAZE_FRESHNESS: [GazeFreshness; 3] =
    [GazeFreshness::Fresh, GazeFreshness::Repeated, GazeFreshness::EyeLost];

/// What the intent stage says.
pub(super) fn intent(tick: SimTime, stamp: SimTime, output: &IntentOutput) -> Intent {
    let freshness_index =
        output.gaze_freshness.and_then(|freshness| GAZE_FRESHNESS.iter().position(|h| *h == freshness));
    Intent {
        header: convert::header(stamp, crate::frames::WORLD),
        tick: tick.0,
        heard: freshness_index.map_or(0, |index| index as u8 + 1),
        posterior: output.posterior.to_vec(),
        highlight: encode_object(output.highlight),
        place: convert::point(&output.place_point),
        gaze: output.gaze.iter().map(gaze).collect(),
        seen_at: encode_tick(output.eye_seen_at),
        fault: output.fault.clone().unwrap_or_default(),
        events: events_to_json(&output.events),
    }
}

/// What the intent stage said of `objects` objects.
pub(super) fn read_intent(message: &Intent, objects: usize) -> Result<IntentOutput, DecodeError> {
    let place_point = Point::new(message.place.x, message.place.y, message.place.z);
    finite("the place", place_point.coords.as_slice())?;
    finite("the posterior", &message.posterior)?;
    // Before the first gaze there is none.
    let got = message.posterior.len();
    if got != 0 && got != objects {
        return Err(format!("posterior has {got} values, expected {objects}"));
    }
    let gaze_freshness = match message.heard {
        0 => None,
        index => Some(element_at("heard", &GAZE_FRESHNESS, usize::from(index) - 1)?),
    };
    Ok(IntentOutput {
        gaze_freshness,
        posterior: message.posterior.clone(),
        highlight: decode_object("highlight", message.highlight, objects)?,
        place_point,
        gaze: optional_value("gaze", &message.gaze)?.map(read_gaze),
        eye_seen_at: decode_tick(message.seen_at),
        answer: None,
        fault: Some(message.fault.clone()).filter(|fault| !fault.is_empty()),
        events: events_from_json(&message.events)?,
    })
}

/// What the method asks for. `number` counts commands for the arm; `method_status`: what there is to see, where that changed;
/// `events`: those of the stages before and its own.
pub(super) fn command(
    tick: SimTime,
    stamp: SimTime,
    output: &MethodOutput,
    number: u64,
    method_status: Option<&MethodStatus>,
    events: &[EventKind],
) -> CommandMessage {
    let mut message = CommandMessage {
        header: convert::header(stamp, ""),
        tick: tick.0,
        number: if output.motion.is_some() { number } else { 0 },
        hand: match output.hand {
            None => 0,
            Some(HandCommand::Open) => 1,
            Some(HandCommand::Close) => 2,
        },
        view: method_status.map(display::method_view).into_iter().collect(),
        events: events_to_json(events),
        ..CommandMessage::default()
    };
    match &output.motion {
        None => {}
        Some(MotionCommand::Hold) => message.motion = CommandMessage::HOLD,
        Some(MotionCommand::Follow(path)) => {
            message.motion = CommandMessage::FOLLOW;
            message.times = path.points.iter().map(|point| point.time_secs).collect();
            message.positions = path.points.iter().flat_map(|point| point.q.iter().copied()).collect();
            message.velocities = path.points.iter().flat_map(|point| point.qd.iter().copied()).collect();
        }
        Some(MotionCommand::Velocity(speeds)) => {
            message.motion = CommandMessage::VELOCITY;
            message.velocities = speeds.to_vec();
        }
        Some(MotionCommand::Goto(angles)) => {
            message.motion = CommandMessage::GOTO;
            message.positions = angles.to_vec();
        }
    }
    message
}

/// What a method asked for.
#[derive(Clone)]
pub(super) struct MethodCommand {
    pub motion: Option<MotionCommand>,
    pub command_number: u64,
    pub hand: Option<HandCommand>,
    pub method_status: Option<MethodStatus>,
    pub events: Vec<EventKind>,
}

/// What a method asked for.
pub(super) fn read_command(
    message: &CommandMessage,
    counts: ExpectedCounts,
) -> Result<MethodCommand, DecodeError> {
    let arm = counts.arm;
    let each = |what: &str, values: &[f64], points: usize| {
        if values.len() != arm * points {
            return Err(format!("{what} has {} values, expected {points} times {arm}", values.len()));
        }
        finite(what, values)
    };
    let motion = match message.motion {
        CommandMessage::NONE => None,
        CommandMessage::HOLD => Some(MotionCommand::Hold),
        CommandMessage::FOLLOW => {
            let points = message.times.len();
            each("positions", &message.positions, points)?;
            each("velocities", &message.velocities, points)?;
            finite("times", &message.times)?;
            let rows = message.positions.chunks(arm).zip(message.velocities.chunks(arm));
            let point = |(time_secs, (q, qd)): (&f64, (&[f64], &[f64]))| TrajectoryPoint {
                time_secs: *time_secs,
                q: proact_types::joints(q),
                qd: proact_types::joints(qd),
            };
            let points = message.times.iter().zip(rows).map(point).collect();
            Some(MotionCommand::Follow(Trajectory { points }))
        }
        CommandMessage::VELOCITY => {
            each("velocities", &message.velocities, 1)?;
            Some(MotionCommand::Velocity(joints("velocities", &message.velocities)?))
        }
        CommandMessage::GOTO => {
            each("positions", &message.positions, 1)?;
            Some(MotionCommand::Goto(joints("positions", &message.positions)?))
        }
        other => return Err(format!("motion is {other}, expected 0 to 4")),
    };
    let hand = match message.hand {
        0 => None,
        1 => Some(HandCommand::Open),
        2 => Some(HandCommand::Close),
        other => return Err(format!("hand is {other}, expected 0, 1 or 2")),
    };
    let view = optional_value("view", &message.view)?;
    let method_status = view.map(|view| display::read_method_view(view, counts)).transpose()?;
    Ok(MethodCommand {
        motion,
        command_number: message.number,
        hand,
        method_status,
        events: events_from_json(&message.events)?,
    })
}

/// The world, actuation and task after a tick.
#[derive(Clone)]
pub(super) struct TickState {
    /// The number of the command for the arm that was taken last.
    pub last_command_number: u64,
    pub world: PlantState,
    pub hand: HandView,
    pub actuation: ActuationOutput,
    pub task: TaskState,
    /// A display frame of this tick comes by itself.
    pub has_frame: bool,
}

pub(super) fn state(
    tick: SimTime,
    stamp: SimTime,
    world: &PlantState,
    hand: HandView,
    actuation: &ActuationOutput,
    task: &TaskState,
) -> State {
    let (motion, progress) = match actuation.motion {
        MotionState::Holding => (0, 0.0),
        MotionState::Following(progress) => (1, progress),
        MotionState::Finished => (2, 1.0),
    };
    let twist = |body: &BodyState| geometry_msgs::Twist {
        linear: convert::vector(&body.linear_velocity),
        angular: convert::vector(&body.angular_velocity),
    };
    State {
        header: convert::header(stamp, crate::frames::WORLD),
        tick: tick.0,
        position: world.position.to_vec(),
        velocity: world.velocity.to_vec(),
        effort: world.effort.to_vec(),
        stop_effort: world.limit_effort.to_vec(),
        base: convert::pose(&world.world_from_base),
        base_held: world.base_held,
        objects: world.objects.iter().map(|body| convert::pose(&body.pose)).collect(),
        twists: world.objects.iter().map(twist).collect(),
        attached: encode_object(world.attached.map(|(object, _)| ObjectId::new(object))),
        attached_at: convert::pose(&world.attached.map_or(Pose::identity(), |(_, pose)| pose)),
        hand: hand.state as u8,
        target: actuation.command.position.to_vec(),
        target_velocity: actuation.command.velocity.to_vec(),
        target_base: convert::pose(&actuation.command.world_from_base),
        motion,
        progress,
        goal: actuation.goal.iter().flatten().copied().collect(),
        hand_moving: actuation.hand_moving,
        paused: actuation.paused,
        candidates: encode_set(&task.candidates),
        due: encode_set(&task.context.expected_objects),
        context: task.context.selection_number,
        due_at_grasp: encode_set(&task.context_at_grasp.expected_objects),
        context_at_grasp: task.context_at_grasp.selection_number,
        next: encode_object(task.next_object),
        score: task.score,
        finished: task.finished,
        frame: false,
        acted_on: 0,
        events: vec![],
    }
}

/// The world, actuation and task after a tick.
pub(super) fn read_state(message: &State, counts: ExpectedCounts) -> Result<TickState, DecodeError> {
    let ExpectedCounts { moving, objects: count, .. } = counts;
    let all = |what: &str, values: &[f64]| {
        if values.len() != moving {
            return Err(format!("{what} has {} values, expected {moving}", values.len()));
        }
        joints(what, values)
    };
    if message.objects.len() != count || message.twists.len() != count {
        let (objects, twists) = (message.objects.len(), message.twists.len());
        return Err(format!("{objects} objects and {twists} twists, expected {count}"));
    }
    let mut objects = arrayvec::ArrayVec::new();
    for (pose, twist) in message.objects.iter().zip(&message.twists) {
        let (linear, angular) = (exact_vector(&twist.linear), exact_vector(&twist.angular));
        finite("a twist", linear.as_slice())?;
        finite("a twist", angular.as_slice())?;
        objects.push(BodyState {
            pose: exact_pose(pose)?,
            linear_velocity: linear,
            angular_velocity: angular,
        });
    }
    let attached = decode_object("attached", message.attached, count)?;
    let attached_at = exact_pose(&message.attached_at)?;
    let world = PlantState {
        position: all("position", &message.position)?,
        velocity: all("velocity", &message.velocity)?,
        effort: joints("effort", &message.effort)?,
        limit_effort: joints("stop_effort", &message.stop_effort)?,
        world_from_base: exact_pose(&message.base)?,
        base_held: message.base_held,
        objects,
        attached: attached.map(|block| (block.index(), attached_at)),
        contacts: Default::default(),
    };
    let actuation = ActuationOutput {
        command: PlantCommand {
            position: all("target", &message.target)?,
            velocity: all("target_velocity", &message.target_velocity)?,
            world_from_base: exact_pose(&message.target_base)?,
        },
        motion: match message.motion {
            0 => MotionState::Holding,
            1 => MotionState::Following(message.progress),
            2 => MotionState::Finished,
            other => return Err(format!("motion is {other}, expected 0 to 2")),
        },
        goal: (!message.goal.is_empty()).then(|| joints("goal", &message.goal)).transpose()?,
        hand_moving: message.hand_moving,
        paused: message.paused,
        events: vec![],
    };
    let context = |what, due: &[u16], number| {
        Ok::<_, DecodeError>(TaskContext {
            expected_objects: decode_set(what, due, count)?,
            selection_number: number,
        })
    };
    let task = TaskState {
        candidates: decode_set("candidates", &message.candidates, count)?,
        context: context("due", &message.due, message.context)?,
        context_at_grasp: context("due_at_grasp", &message.due_at_grasp, message.context_at_grasp)?,
        next_object: decode_object("next", message.next, count)?,
        goal: None,
        score: message.score,
        finished: message.finished,
    };
    let state = element_at("hand", &HandState::ALL, usize::from(message.hand))?;
    let hand = HandView { state, held_object: attached };
    Ok(TickState {
        last_command_number: message.acted_on,
        world,
        hand,
        actuation,
        task,
        has_frame: message.frame,
    })
}

#[cfg(test)]
mod tests;
