//! A bag on the replay page: one of the original lab's, or our own.
//!
//! Shown is what the bag says, not what a simulation makes of it: arm joints and blocks at 30 Hz, gaze, gesture,
//! selection and grasp. Which blocks are on target is judged by our task from their poses. The head is the headset's
//! own, put into `world` by the frames in the bag; without these it is where the eye is and looks where the eye looks.

mod received;

use self::received::{MAX_STATE_AGE_MS, ReceiptTimes, unwrap_angle};
use crate::{Arm, print_status};
use proact_arm::{ArmModel, JointLimits};
use proact_bridge::{PageContent, RecordedTrial};
use proact_control::MethodRegistry;
use proact_messages::original;
use proact_messages::original::{ARM_MODEL, topic};
use proact_recording::{
    RecordingError,
    bag::{BagEnd, BagMessage, messages as ros, read_bag_by_time},
};
use proact_tasks::{DEFAULT_TASK, Task, TaskInput, TaskSpec};
use proact_testbed::stages::GAZE_MAX_AGE_MS;
use proact_types::{
    BodyState, Command, DisplayFrame, Event, EventKind, GazeSample, Gesture, HandState, HandView, Object,
    ObjectId, PlannerView, Point, Pose, SimTime, TargetView, Vector, zeros,
};
use std::{collections::HashMap, error::Error, path::Path};

/// From one frame to the next, milliseconds.
const PERIOD_MS: u64 = 33;
/// The headset's world among the frames of `/tf`.
const HEADSET_WORLD: &str = "hololens_world_test";
/// Topics that something is taken from.
const USED_TOPICS: [&str; 14] = [
    topic::WRAPPED_JOINT_STATES,
    topic::MODEL_STATES,
    topic::GAZE_POSITION_ROS,
    topic::GAZE_DIRECTION_ROS,
    "/tf",
    "/tf_static",
    topic::HEAD,
    topic::HEAD_ROS,
    topic::EMG,
    topic::CURRENT_BLOCK,
    topic::SELECTION_FROZEN,
    topic::PLACE_LOCATION,
    topic::SUCCESS,
    topic::GRASP_EVENTS,
];

/// Reads the bag at `path` as it would have been displayed, as far as it goes; standard error tells where it is cut off.
///
/// # Errors
/// A file that is no bag, or holds neither joints nor blocks under the original's names.
pub fn read_playback(path: &Path, arm: &Arm) -> Result<RecordedTrial, Box<dyn Error>> {
    let BagFrames { frames, task, end, .. } =
        sample_bag(path, arm.model(), default_task(), StartPoses::FromBag, PERIOD_MS)?;
    let last = frames.last().ok_or("the bag holds no instant")?;
    let content = PageContent {
        title: "Bag".to_owned(),
        setup: "bag".to_owned(),
        arm: arm.model().as_ref().clone(),
        meshes: arm.meshes(),
        scene: task.scene().clone(),
        briefing: task.briefing().clone(),
        interactive: false,
        lean: false,
        method: MethodRegistry::standard()
            .get(&last.method)
            .map(|entry| entry.info().clone())
            .unwrap_or_default(),
        methods: vec![],
    };
    if end != BagEnd::Complete {
        print_status(format_args!("{}: {end}", path.display()));
    }
    Ok(RecordedTrial {
        name: path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned(),
        method: last.method.clone(),
        setup: "bag".to_owned(),
        seed: None,
        seconds: last.time.as_secs(),
        score: task.state().score,
        content,
        digest_matches: None,
        finished: end == BagEnd::Complete,
        frames,
        emg: None,
    })
}

/// The task of the original. Where its blocks start is in the bag, see [`StartPoses::OfBag`].
pub(crate) fn default_task() -> Box<dyn Task> {
    let task =
        TaskSpec::named(DEFAULT_TASK, 0).and_then(|task| task.build_with_limit(false, Some(MAX_BAG_SECS)));
    task.expect("the default task ships with the program and is tested there")
}

/// Where the objects of a bag stand at the start of the trial.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum StartPoses {
    /// Where the task has them, which is that of the recorded configuration.
    FromTask,
    /// Where the bag has each of them first: nothing but the bag is known of the trial.
    FromBag,
}

/// What was seen in a bag.
pub(crate) struct BagFrames {
    /// Its instants.
    pub(crate) frames: Vec<DisplayFrame>,
    /// Positions in `frames` of those that can be scored: on the even grid of the period, each after all messages up to it,
    /// with joints, base and objects that were received and are not older than [`MAX_STATE_AGE_MS`].
    pub(crate) scored_frames: Vec<usize>,
    /// What scoring needs and the bag never has.
    pub(crate) missing: Vec<String>,
    /// From when to when it has nothing that can be scored, between instants that can.
    pub(crate) gaps: Vec<[SimTime; 2]>,
    /// The task after the last one.
    pub(crate) task: Box<dyn Task>,
    /// The objects then.
    pub(crate) bodies: Vec<BodyState>,
    /// Decisions of the EMG's classifier.
    pub(crate) decisions: u64,
    /// Whether the bag is whole.
    pub(crate) end: BagEnd,
}

/// Reads the bag at `path`, an instant each `period_ms`, judged by `task`.
///
/// # Errors
/// As [`read`].
pub(crate) fn sample_bag(
    path: &Path,
    arm: &ArmModel,
    task: Box<dyn Task>,
    starts: StartPoses,
    period_ms: u64,
) -> Result<BagFrames, Box<dyn Error>> {
    let mut playback = BagPlayback::new(arm, method_from_file_name(path), task, starts, period_ms);
    let end = read_bag_by_time(
        path,
        |topic| USED_TOPICS.contains(&topic),
        |message| playback.apply_message(message),
    )?;
    if !playback.received.has_any_joint() && !playback.received.has_any_object() {
        playback.topics.sort();
        let shown = [topic::WRAPPED_JOINT_STATES, topic::MODEL_STATES];
        if playback.topics.iter().any(|topic| shown.contains(&topic.as_str())) {
            return Err("the bag is of another arm or task: neither its joints nor its objects have the names that are \
                        expected, those of mpl_right and of the task modified_bbt"
                .into());
        }
        if end != BagEnd::Complete && playback.topics.is_empty() {
            return Err(format!("the bag holds no whole message: {end}").into());
        }
        return Err(format!(
            "the bag holds neither {} nor {}, which are shown; its topics: {}",
            topic::WRAPPED_JOINT_STATES,
            topic::MODEL_STATES,
            playback.topics.join(", ")
        )
        .into());
    }
    playback.finish(&end);
    let missing = playback.received.missing(playback.arm, playback.task.scene());
    let BagPlayback { frames, scored_frames: scored, task, bodies, decisions, .. } = playback;
    let times = scored.iter().map(|index| frames[*index].time);
    let steps = times.clone().zip(times.skip(1)).map(|(from, to)| [from, to]);
    let gaps = steps.filter(|[from, to]| to.millis_since(*from) > period_ms).collect();
    Ok(BagFrames { frames, scored_frames: scored, missing, gaps, task, bodies, decisions, end })
}

/// The original calls its bags `participant1-mode4-trial2-..`: modes 1 to 4 are methods A to D.
pub(crate) fn method_from_file_name(path: &Path) -> String {
    let name = path.file_stem().unwrap_or_default().to_string_lossy();
    let mode = name.split_once("mode").and_then(|(_, rest)| rest.chars().next());
    match mode {
        Some(digit @ '1'..='4') => ["A", "B", "C", "D"][digit as usize - '1' as usize].to_owned(),
        _ => "?".to_owned(),
    }
}

/// What lies still at the end of a bag goes on lying there: a trial ends when its last block has rested for long enough, which a
/// recorder that sees each hundredth of a second, or a fiftieth, learns after the end. Milliseconds.
const REST_EXTRAPOLATION_MS: u64 = 500;
/// A trial of the original takes so long, seconds; a bag may hold more than a trial.
const TRIAL_SECS: f64 = 300.0;
const MAX_BAG_SECS: f64 = 3600.0;

/// What has been read so far.
struct BagPlayback<'a> {
    arm: &'a ArmModel,
    /// Place in the joint vector of each joint.
    joint_indices: HashMap<&'a str, usize>,
    task: Box<dyn Task>,
    start_poses: StartPoses,
    bodies: Vec<BodyState>,
    /// The instant as it stands.
    frame: DisplayFrame,
    eye: Option<Point>,
    world_from_headset: Option<Pose>,
    /// The head has a pose of its own.
    head_seen: bool,
    last_gaze_time: Option<SimTime>,
    first_ns: Option<u64>,
    /// Of the message that was read last.
    now: SimTime,
    /// The next instant of the grid.
    next_frame_time: SimTime,
    period_ms: u64,
    decisions: u64,
    received: ReceiptTimes,
    topics: Vec<String>,
    frames: Vec<DisplayFrame>,
    scored_frames: Vec<usize>,
}

impl<'a> BagPlayback<'a> {
    fn new(
        arm: &'a ArmModel,
        method: String,
        task: Box<dyn Task>,
        starts: StartPoses,
        period_ms: u64,
    ) -> Self {
        let joints =
            arm.moving().enumerate().map(|(n, joint)| (arm.joints[joint].name.as_str(), n)).collect();
        let resting = |object: &Object| BodyState {
            pose: object.pose,
            linear_velocity: Vector::zeros(),
            angular_velocity: Vector::zeros(),
        };
        let bodies: Vec<BodyState> = task.scene().objects.iter().map(resting).collect();
        let frame = DisplayFrame {
            time: SimTime(0),
            method,
            joints: zeros(arm.moving_count()),
            world_from_base: Pose::identity(),
            world_from_tip: Pose::identity(),
            world_from_head: Pose::identity(),
            objects: bodies.iter().map(|body: &BodyState| body.pose).collect(),
            hand: HandView::default(),
            gaze: None,
            target: TargetView::default(),
            planner: PlannerView::Idle,
            plan_goal: None,
            mode: None,
            stop: None,
            command: Command::NoMotion,
            recognized_gesture: Gesture::default(),
            confidence: 1.0,
            effort: 0.0,
            emg_source: "bag".to_owned(),
            time_left_secs: TRIAL_SECS,
            next_object: None,
            task_goal: None,
            score: 0,
            finished: false,
            events: Vec::new(),
            contacts: Vec::new(),
            feedback: Vec::new(),
        };
        BagPlayback {
            arm,
            joint_indices: joints,
            received: ReceiptTimes::new(arm.moving_count(), bodies.len()),
            task,
            start_poses: starts,
            bodies,
            frame,
            eye: None,
            world_from_headset: None,
            head_seen: false,
            last_gaze_time: None,
            first_ns: None,
            now: SimTime(0),
            next_frame_time: SimTime(0),
            period_ms,
            decisions: 0,
            topics: Vec::new(),
            frames: Vec::new(),
            scored_frames: Vec::new(),
        }
    }

    fn apply_message(&mut self, message: &BagMessage<'_>) -> Result<(), RecordingError> {
        let first = *self.first_ns.get_or_insert(message.time_ns);
        // A recorder on another machine may step back a little.
        let now = SimTime(message.time_ns.saturating_sub(first) / 1_000_000).max(self.now);
        self.emit_frames_until(now);
        self.now = now;
        if !self.topics.iter().any(|topic| topic == message.topic) {
            self.topics.push(message.topic.to_owned());
        }
        match message.topic {
            topic::WRAPPED_JOINT_STATES => {
                if let Some(state) = message.decode::<ros::JointState>()? {
                    self.apply_joint_state(&state);
                }
            }
            topic::MODEL_STATES => {
                if let Some(models) = message.decode::<ros::ModelStates>()? {
                    self.apply_model_states(&models);
                }
            }
            topic::GAZE_POSITION_ROS => {
                if let Some(eye) = message.decode::<ros::Vector3Stamped>()? {
                    self.eye = Some(Point::from(vector(&eye.vector)));
                }
            }
            topic::GAZE_DIRECTION_ROS => {
                if let Some(gaze) = message.decode::<ros::Vector3Stamped>()? {
                    self.apply_gaze(&vector(&gaze.vector));
                }
            }
            // Of the many frames the headset's is the only one that is asked for.
            "/tf" | "/tf_static" if message.contains_text(HEADSET_WORLD) => {
                if let Some(frames) = message.decode::<ros::TfMessage>()? {
                    self.apply_tf(&frames);
                }
            }
            topic::HEAD => {
                if let Some(head) = message.decode::<ros::PoseStamped>()? {
                    let head = to_pose(&head.pose).zip(self.world_from_headset);
                    self.set_head_pose(head.map(|(head, world)| world * head));
                }
            }
            // Ours says so; the original's has no frame, and a wrong turn.
            topic::HEAD_ROS => {
                if let Some(head) = message.decode::<ros::PoseStamped>()? {
                    self.set_head_pose(to_pose(&head.pose).filter(|_| head.header.frame_id == "world"));
                }
            }
            topic::EMG => {
                if let Some(text) = message.decode::<ros::Text>()? {
                    self.decisions += 1;
                    let known = Command::ALL.into_iter().find(|command| command.ros_name() == text.data);
                    self.frame.command = known.unwrap_or(Command::NoMotion);
                }
            }
            topic::CURRENT_BLOCK => {
                if let Some(text) = message.decode::<ros::Text>()? {
                    self.frame.target.object = self.object_named(&text.data);
                }
            }
            topic::SELECTION_FROZEN => {
                if let Some(frozen) = message.decode::<ros::Bool>()? {
                    self.frame.target.locked = frozen.data;
                }
            }
            topic::PLACE_LOCATION => {
                if let Some(place_pose) = message.decode::<ros::PoseStamped>()? {
                    // The original's is in the headset's world, whatever it says.
                    let ours = place_pose.header.frame_id == "world";
                    let world = if ours { Some(Pose::identity()) } else { self.world_from_headset };
                    let p = &place_pose.pose.position;
                    self.frame.target.place = world.map(|world| world * Point::new(p.x, p.y, p.z));
                }
            }
            topic::SUCCESS => {
                if let Some(closed) = message.decode::<ros::Bool>()? {
                    self.frame.hand.state = if closed.data { HandState::Closed } else { HandState::Open };
                }
            }
            topic::GRASP_EVENTS => {
                if let Some(event) = message.decode::<ros::GazeboGraspEvent>()? {
                    self.apply_grasp_event(&event);
                }
            }
            _ => {}
        }
        Ok(())
    }

    /// Keeps the instants of the grid before `now`, whose messages have all been read.
    fn emit_frames_until(&mut self, now: SimTime) {
        let has_state = self.received.has_any_joint() || self.received.has_any_object();
        if has_state && now.millis_since(self.now) <= MAX_STATE_AGE_MS {
            while self.next_frame_time < now {
                self.emit_frame();
            }
        } else if self.next_frame_time < now {
            if has_state && self.next_frame_time <= self.now {
                self.emit_frame();
            }
            self.next_frame_time = SimTime(now.0.div_ceil(self.period_ms) * self.period_ms);
        }
    }

    /// Keeps the instant that is due.
    fn emit_frame(&mut self) {
        if self.received.is_complete(self.next_frame_time) {
            self.scored_frames.push(self.frames.len());
        }
        self.push_frame(self.next_frame_time);
        self.next_frame_time = self.next_frame_time.plus_millis(self.period_ms);
    }

    /// Keeps the end of the bag. An instant at which the bag is cut off may lack messages, and is not scored.
    fn finish(&mut self, end: &BagEnd) {
        if *end == BagEnd::Complete && self.now == self.next_frame_time {
            self.emit_frame();
        } else {
            self.push_frame(self.now);
        }
        if *end == BagEnd::Complete {
            self.extrapolate_rest();
        }
    }

    fn apply_joint_state(&mut self, state: &ros::JointState) {
        for (name, angle) in state.name.iter().zip(&state.position) {
            if let Some(&index) = self.joint_indices.get(name.as_str())
                && angle.is_finite()
            {
                let before = self.received.joints[index].map(|_| self.frame.joints[index]);
                let joint = self.arm.moving().nth(index);
                let limits = joint.map_or_else(JointLimits::default, |joint| self.arm.joints[joint].limits);
                self.frame.joints[index] = unwrap_angle(*angle, before, &limits);
                self.received.joints[index] = Some(self.now);
            }
        }
    }

    fn apply_model_states(&mut self, models: &ros::ModelStates) {
        for ((name, pose), twist) in models.name.iter().zip(&models.pose).zip(&models.twist) {
            let Some(pose) = to_pose(pose) else { continue };
            if name == ARM_MODEL {
                self.frame.world_from_base = pose;
                self.received.base = Some(self.now);
            } else if let Some(block) = self.object_named(name) {
                if self.start_poses == StartPoses::FromBag && self.received.objects[block.index()].is_none() {
                    self.task.set_start(block, pose);
                }
                let (linear, angular) = (vector(&twist.linear), vector(&twist.angular));
                self.bodies[block.index()] =
                    BodyState { pose, linear_velocity: linear, angular_velocity: angular };
                self.received.objects[block.index()] = Some(self.now);
            }
        }
    }

    /// Learns where the headset's world is.
    fn apply_tf(&mut self, frames: &ros::TfMessage) {
        let of_headset = |frame: &&ros::TransformStamped| {
            frame.child_frame_id.trim_start_matches('/') == HEADSET_WORLD
                && frame.header.frame_id.trim_start_matches('/') == "world"
        };
        let Some(frame) = frames.transforms.iter().rfind(of_headset) else { return };
        let ros::Vector3 { x, y, z } = frame.transform.translation;
        let orientation = frame.transform.rotation.clone();
        let pose = to_pose(&ros::Pose { position: ros::Point { x, y, z }, orientation });
        self.world_from_headset = pose.or(self.world_from_headset);
    }

    fn set_head_pose(&mut self, world_from_head: Option<Pose>) {
        if let Some(pose) = world_from_head {
            self.frame.world_from_head = pose;
            self.head_seen = true;
        }
    }

    fn apply_gaze(&mut self, direction: &Vector) {
        let Some(origin) = self.eye else { return };
        let Some(direction) = direction.try_normalize(1e-9).filter(|d| d.iter().all(|x| x.is_finite()))
        else {
            return;
        };
        self.frame.gaze = Some(GazeSample { origin, direction, valid: true });
        self.last_gaze_time = Some(self.now);
        if self.head_seen {
            return;
        }
        let left = Vector::z().cross(&direction).try_normalize(1e-9).unwrap_or(Vector::y());
        let axes = nalgebra::Matrix3::from_columns(&[direction, left, direction.cross(&left)]);
        let turn = nalgebra::Rotation3::from_matrix_unchecked(axes);
        self.frame.world_from_head =
            Pose::from_parts(origin.coords.into(), nalgebra::UnitQuaternion::from_rotation_matrix(&turn));
    }

    fn apply_grasp_event(&mut self, event: &ros::GazeboGraspEvent) {
        let model = original::model_from_collision(&event.object);
        let Some(block) = self.object_named(model) else { return };
        self.frame.hand.held_object = event.attached.then_some(block);
        let kind = if event.attached {
            EventKind::ObjectAttached { object: block }
        } else {
            EventKind::ObjectReleased { object: block }
        };
        self.frame.events.push(Event { time: self.now, kind });
    }

    fn object_named(&self, ros_name: &str) -> Option<ObjectId> {
        self.task.scene().objects.iter().position(|object| object.ros_name == ros_name).map(ObjectId::new)
    }

    /// Judges on with the last instant.
    fn extrapolate_rest(&mut self) {
        let Some(last) = self.frames.last_mut() else { return };
        for ms in (PERIOD_MS..=REST_EXTRAPOLATION_MS).step_by(PERIOD_MS as usize) {
            let seen = TaskInput {
                objects: &self.bodies,
                held: last.hand.held_object,
                fingertips: &[],
                joints: &last.joints[..self.arm.arm_count()],
                hand: last.world_from_tip * Point::from(self.arm.widest_grasp().center),
            };
            let events = self.task.step(last.time.plus_millis(ms), &seen);
            last.events.extend(events.into_iter().map(|kind| Event { time: last.time, kind }));
        }
        (last.next_object, last.score) = (self.task.state().next_object, self.task.state().score);
        last.task_goal.clone_from(&self.task.state().goal);
    }

    /// Keeps what was received as the frame of `time`.
    fn push_frame(&mut self, time: SimTime) {
        let has_objects = self.received.has_any_object();
        let frame = &mut self.frame;
        frame.time = time;
        frame.world_from_tip = frame.world_from_base * self.arm.link_poses(&frame.joints)[self.arm.tip];
        let seen = TaskInput {
            objects: &self.bodies,
            held: frame.hand.held_object,
            fingertips: &[],
            joints: &frame.joints[..self.arm.arm_count()],
            hand: frame.world_from_tip * Point::from(self.arm.widest_grasp().center),
        };
        // Before the first model states, the objects have the poses of the scene, not those of the trial.
        let events = if has_objects { self.task.step(time, &seen) } else { Vec::new() };
        frame.events.extend(events.into_iter().map(|kind| Event { time, kind }));
        frame.objects = self.bodies.iter().map(|body| body.pose).collect();
        frame.gaze = frame
            .gaze
            .filter(|_| self.last_gaze_time.is_some_and(|then| time.millis_since(then) <= GAZE_MAX_AGE_MS));
        frame.time_left_secs = TRIAL_SECS - frame.time.as_secs();
        (frame.next_object, frame.score) = (self.task.state().next_object, self.task.state().score);
        frame.task_goal.clone_from(&self.task.state().goal);
        self.frames.push(frame.clone());
        frame.events.clear();
    }
}

fn vector(v: &ros::Vector3) -> Vector {
    Vector::new(v.x, v.y, v.z)
}

/// None if it is no pose.
fn to_pose(pose: &ros::Pose) -> Option<Pose> {
    let (p, q) = (&pose.position, &pose.orientation);
    let turn = nalgebra::Quaternion::new(q.w, q.x, q.y, q.z);
    let turn = nalgebra::UnitQuaternion::try_new(turn, 1e-6)?;
    let pose = Pose::from_parts(nalgebra::Translation3::new(p.x, p.y, p.z), turn);
    pose.to_homogeneous().iter().all(|x| x.is_finite()).then_some(pose)
}

#[cfg(test)]
mod tests;
