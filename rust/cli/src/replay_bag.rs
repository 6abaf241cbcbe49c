//! A bag on the replay page: one of the original lab's, or our own.
//!
//! Shown is what the bag says, not what a simulation makes of it: arm joints and blocks at 30 Hz, gaze, gesture,
//! selection and grasp. Which blocks are on target is judged by our task from their poses.

use proact_bridge::{PageContent, RecordedTrial};
use proact_recording::{
    RecordingError,
    bag::{BagMessage, messages as ros, read_bag},
};
use proact_tasks::{Arrangement, BoxAndBlocks};
use proact_types::{
    ArmModel, BlockId, BodyState, DisplayFrame, Event, EventKind, GazeSample, Gesture, HandState, HandView,
    PlannerView, Point, Pose, SimTime, TargetView, Vector, zeros,
};
use std::{collections::HashMap, error::Error, path::Path};

/// From one frame to the next, milliseconds.
const PERIOD_MS: u64 = 33;
/// Gaze older than this is not shown, milliseconds.
const GAZE_MS: u64 = 200;
/// Name of the arm in `/gazebo/model_states`.
const ARM_MODEL: &str = "mpl_right_arm";

/// Reads the bag at `path` as it would have been displayed.
///
/// # Errors
/// A file that is no bag, or holds neither joints nor blocks under the original's names.
pub(crate) fn film(path: &Path, arm: &ArmModel) -> Result<RecordedTrial, Box<dyn Error>> {
    let mut film = Film::new(arm, method_of(path));
    read_bag(path, |message| film.take(message))?;
    if !film.joints_seen && !film.blocks_seen {
        film.topics.sort();
        return Err(format!(
            "the bag holds neither /mpl_right_arm/wrapped_joint_states nor /gazebo/model_states, which are shown; its \
             topics: {}",
            film.topics.join(", ")
        )
        .into());
    }
    film.keep();
    let content = PageContent {
        title: "Bag".to_owned(),
        setup: "bag".to_owned(),
        arm: arm.clone(),
        scene: film.task.scene().clone(),
        interactive: false,
        lean: false,
    };
    Ok(RecordedTrial {
        name: path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned(),
        method: film.frame.method.clone(),
        setup: "bag".to_owned(),
        seed: None,
        seconds: film.frame.time.as_secs(),
        on_target: film.task.state().on_target,
        content,
        agrees: None,
        finished: true,
        frames: film.frames,
    })
}

/// The original calls its bags `participant1-mode4-trial2-..`: modes 1 to 4 are methods A to D.
fn method_of(path: &Path) -> String {
    let name = path.file_stem().unwrap_or_default().to_string_lossy();
    let mode = name.split_once("mode").and_then(|(_, rest)| rest.chars().next());
    match mode {
        Some(digit @ '1'..='4') => ["A", "B", "C", "D"][digit as usize - '1' as usize].to_owned(),
        _ => "?".to_owned(),
    }
}

/// What has been read so far.
struct Film<'a> {
    arm: &'a ArmModel,
    /// Place in the joint vector of each joint.
    joints: HashMap<&'a str, usize>,
    task: BoxAndBlocks,
    bodies: [BodyState; 4],
    /// The instant as it stands.
    frame: DisplayFrame,
    eye: Option<Point>,
    looked: Option<SimTime>,
    first_ns: Option<u64>,
    due: SimTime,
    joints_seen: bool,
    blocks_seen: bool,
    topics: Vec<String>,
    frames: Vec<DisplayFrame>,
}

impl<'a> Film<'a> {
    fn new(arm: &'a ArmModel, method: String) -> Self {
        let joints =
            arm.moving().enumerate().map(|(n, joint)| (arm.joints[joint].name.as_str(), n)).collect();
        let no_arrangement = Arrangement::all().next().expect("there are arrangements");
        let task = BoxAndBlocks::new(no_arrangement).with_limit(SimTime(u64::MAX));
        let resting = |n: usize| BodyState {
            pose: task.scene().blocks[n].pose,
            linear: Vector::zeros(),
            angular: Vector::zeros(),
        };
        let bodies = std::array::from_fn(resting);
        let frame = DisplayFrame {
            time: SimTime(0),
            method,
            joints: zeros(arm.moving_count()),
            world_from_base: Pose::identity(),
            world_from_tip: Pose::identity(),
            world_from_head: Pose::identity(),
            blocks: bodies.iter().map(|body: &BodyState| body.pose).collect(),
            hand: HandView::default(),
            gaze: None,
            target: TargetView::default(),
            planner: PlannerView::Idle,
            goal: None,
            mode: None,
            gesture: Gesture::NoMotion,
            confidence: 1.0,
            effort: 0.0,
            emg_source: "bag".to_owned(),
            time_left_secs: BoxAndBlocks::LIMIT_SECS,
            next_block: None,
            on_target: 0,
            finished: false,
            events: Vec::new(),
        };
        Film {
            arm,
            joints,
            task,
            bodies,
            frame,
            eye: None,
            looked: None,
            first_ns: None,
            due: SimTime(0),
            joints_seen: false,
            blocks_seen: false,
            topics: Vec::new(),
            frames: Vec::new(),
        }
    }

    fn take(&mut self, message: &BagMessage<'_>) -> Result<(), RecordingError> {
        let first = *self.first_ns.get_or_insert(message.time_ns);
        // A recorder on another machine may step back a little.
        let now = SimTime(message.time_ns.saturating_sub(first) / 1_000_000).max(self.frame.time);
        self.frame.time = now;
        if !self.topics.iter().any(|topic| topic == message.topic) {
            self.topics.push(message.topic.to_owned());
        }
        match message.topic {
            "/mpl_right_arm/wrapped_joint_states" => {
                if let Some(state) = message.decode::<ros::JointState>()? {
                    self.turn(&state);
                }
            }
            "/gazebo/model_states" => {
                if let Some(models) = message.decode::<ros::ModelStates>()? {
                    self.place(&models);
                }
            }
            "/gaze_position_ros" => {
                if let Some(eye) = message.decode::<ros::Vector3Stamped>()? {
                    self.eye = Some(Point::from(vector(&eye.vector)));
                }
            }
            "/gaze_direction_ros" => {
                if let Some(gaze) = message.decode::<ros::Vector3Stamped>()? {
                    self.look(&vector(&gaze.vector));
                }
            }
            "/emg" => {
                if let Some(text) = message.decode::<ros::Text>()? {
                    let known = Gesture::ALL.into_iter().find(|gesture| gesture.ros_name() == text.data);
                    self.frame.gesture = known.unwrap_or(Gesture::NoMotion);
                }
            }
            "/current_block" => {
                if let Some(text) = message.decode::<ros::Text>()? {
                    self.frame.target.block = block_named(&text.data);
                }
            }
            "/selection_frozen" => {
                if let Some(frozen) = message.decode::<ros::Bool>()? {
                    self.frame.target.locked = frozen.data;
                }
            }
            "/place_location_selected" => {
                if let Some(place) = message.decode::<ros::PoseStamped>()? {
                    // The original's is in the headset's world, which the bag does not tie to ours.
                    let p = &place.pose.position;
                    self.frame.target.place =
                        (place.header.frame_id == "world").then(|| Point::new(p.x, p.y, p.z));
                }
            }
            "/success" => {
                if let Some(closed) = message.decode::<ros::Bool>()? {
                    self.frame.hand.state = if closed.data { HandState::Closed } else { HandState::Open };
                }
            }
            "/grasp_event_republisher/grasp_events" => {
                if let Some(event) = message.decode::<ros::GazeboGraspEvent>()? {
                    self.grasp(&event);
                }
            }
            _ => {}
        }
        if now >= self.due {
            self.keep();
            self.due = now.plus_millis(PERIOD_MS);
        }
        Ok(())
    }

    fn turn(&mut self, state: &ros::JointState) {
        for (name, angle) in state.name.iter().zip(&state.position) {
            if let Some(&place) = self.joints.get(name.as_str())
                && angle.is_finite()
            {
                self.frame.joints[place] = *angle;
                self.joints_seen = true;
            }
        }
    }

    fn place(&mut self, models: &ros::ModelStates) {
        for ((name, pose), twist) in models.name.iter().zip(&models.pose).zip(&models.twist) {
            let Some(pose) = pose_of(pose) else { continue };
            if name == ARM_MODEL {
                self.frame.world_from_base = pose;
            } else if let Some(block) = block_named(name) {
                let (linear, angular) = (vector(&twist.linear), vector(&twist.angular));
                self.bodies[block.index()] = BodyState { pose, linear, angular };
                self.blocks_seen = true;
            }
        }
    }

    fn look(&mut self, direction: &Vector) {
        let Some(origin) = self.eye else { return };
        let Some(direction) = direction.try_normalize(1e-9).filter(|d| d.iter().all(|x| x.is_finite()))
        else {
            return;
        };
        self.frame.gaze = Some(GazeSample { origin, direction, valid: true });
        self.looked = Some(self.frame.time);
        // The bag has no head pose in `world` that could be trusted, so the head looks where the eye looks.
        let left = Vector::z().cross(&direction).try_normalize(1e-9).unwrap_or(Vector::y());
        let axes = nalgebra::Matrix3::from_columns(&[direction, left, direction.cross(&left)]);
        let turn = nalgebra::Rotation3::from_matrix_unchecked(axes);
        self.frame.world_from_head =
            Pose::from_parts(origin.coords.into(), nalgebra::UnitQuaternion::from_rotation_matrix(&turn));
    }

    fn grasp(&mut self, event: &ros::GazeboGraspEvent) {
        let Some(block) = event.object.split("::").find_map(block_named) else { return };
        self.frame.hand.holds = event.attached.then_some(block);
        let kind = if event.attached {
            EventKind::BlockAttached { block }
        } else {
            EventKind::BlockReleased { block }
        };
        self.frame.events.push(Event { time: self.frame.time, kind });
    }

    /// Keeps the instant as a frame.
    fn keep(&mut self) {
        let frame = &mut self.frame;
        let step = self.task.step(frame.time, &self.bodies, frame.hand.holds);
        frame.events.extend(step.events.into_iter().map(|kind| Event { time: frame.time, kind }));
        frame.blocks = self.bodies.iter().map(|body| body.pose).collect();
        frame.world_from_tip = frame.world_from_base * self.arm.link_poses(&frame.joints)[self.arm.tip];
        frame.gaze =
            frame.gaze.filter(|_| self.looked.is_some_and(|then| frame.time.millis_since(then) <= GAZE_MS));
        frame.time_left_secs = BoxAndBlocks::LIMIT_SECS - frame.time.as_secs();
        (frame.next_block, frame.on_target) = (self.task.state().next, self.task.state().on_target);
        self.frames.push(frame.clone());
        frame.events.clear();
    }
}

fn vector(v: &ros::Vector3) -> Vector {
    Vector::new(v.x, v.y, v.z)
}

/// None if it is no pose.
fn pose_of(pose: &ros::Pose) -> Option<Pose> {
    let (p, q) = (&pose.position, &pose.orientation);
    let turn = nalgebra::Quaternion::new(q.w, q.x, q.y, q.z);
    let turn = nalgebra::UnitQuaternion::try_new(turn, 1e-6)?;
    let pose = Pose::from_parts(nalgebra::Translation3::new(p.x, p.y, p.z), turn);
    pose.to_homogeneous().iter().all(|x| x.is_finite()).then_some(pose)
}

fn block_named(name: &str) -> Option<BlockId> {
    BlockId::ALL.into_iter().find(|block| block.ros_name() == name)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proact_description::mpl_right_arm;
    use proact_recording::bag::{
        BagWriter,
        message::{Message, Time},
    };

    /// A bag as the original's recorder writes it: receipt times of a wall clock, many topics, one of them unknown.
    struct Lab(BagWriter);

    impl Lab {
        fn write<M: Message>(&mut self, topic: &str, ms: u32, message: &M) {
            let time = Time { secs: 1_600_000_000 + ms / 1000, nsecs: ms % 1000 * 1_000_000 };
            self.0.write(topic, time, message, false).unwrap();
        }

        fn models(&mut self, ms: u32, red1: [f64; 3]) {
            let pose = |[x, y, z]: [f64; 3]| ros::Pose {
                position: ros::Point { x, y, z },
                orientation: ros::Quaternion { w: 1.0, ..Default::default() },
            };
            let models = ros::ModelStates {
                name: vec!["ground_plane".into(), "mpl_right_arm".into(), "redcylinder1".into()],
                pose: vec![pose([0.0; 3]), pose([-0.4, 0.1, 1.5]), pose(red1)],
                twist: vec![ros::Twist::default(); 3],
            };
            self.write("/gazebo/model_states", ms, &models);
        }
    }

    fn text(data: &str) -> ros::Text {
        ros::Text { data: data.to_owned() }
    }

    #[test]
    fn a_labs_bag_shows_where_arm_and_blocks_were_and_what_was_done() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("participant1-mode4-trial2-2021.bag");
        let mut lab = Lab(BagWriter::create(&path).unwrap());
        let arm = mpl_right_arm();
        let elbow = arm.joints[arm.arm[3]].name.clone();
        let target =
            proact_tasks::BoxAndBlocks::new(Arrangement::all().next().unwrap()).scene().targets[0].centre;
        let resting = [target.x, target.y, target.z + 0.025];
        for ms in (0..4000).step_by(20) {
            let lifted = if ms < 2000 { [0.05, -0.2, 1.2] } else { resting };
            lab.models(ms, lifted);
            let state = ros::JointState {
                name: vec!["not_ours".into(), elbow.clone()],
                position: vec![9.0, f64::from(ms) * 1e-3],
                ..Default::default()
            };
            lab.write("/mpl_right_arm/wrapped_joint_states", ms, &state);
            lab.write("/something_else", ms, &text("x"));
        }
        lab.write("/emg", 3990, &text("wrist_flexion"));
        lab.write("/current_block", 3991, &text("bluecylinder2"));
        let object = "redcylinder1::link::collision".to_owned();
        let grasp = ros::GazeboGraspEvent { arm: "a".into(), object, attached: true };
        lab.write("/grasp_event_republisher/grasp_events", 3992, &grasp);
        lab.0.finish().unwrap();

        let trial = film(&path, &arm).unwrap();
        assert_eq!((trial.method.as_str(), trial.agrees, trial.seed), ("D", None, None));
        assert!((trial.seconds - 3.992).abs() < 1e-9, "{}", trial.seconds);
        assert!((100..130).contains(&trial.frames.len()), "30 a second: {}", trial.frames.len());
        let last = trial.frames.last().unwrap();
        assert!((last.joints[3] - 3.98).abs() < 1e-9, "{:?}", last.joints);
        assert_eq!(last.world_from_base.translation.vector, Vector::new(-0.4, 0.1, 1.5));
        assert_eq!(last.blocks[0].translation.vector, Vector::from(resting));
        assert_eq!(trial.frames[0].blocks[0].translation.vector, Vector::new(0.05, -0.2, 1.2));
        assert_eq!((last.gesture, last.target.block), (Gesture::WristFlexion, Some(BlockId::Blue2)));
        assert_eq!(last.hand.holds, Some(BlockId::Red1));
        assert!(last.events.iter().any(|e| e.kind == EventKind::BlockAttached { block: BlockId::Red1 }));
    }

    #[test]
    fn a_bag_of_something_else_says_what_it_holds_and_another_file_is_refused() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("camera.bag");
        let mut lab = Lab(BagWriter::create(&path).unwrap());
        lab.write("/chatter", 0, &text("hello"));
        lab.0.finish().unwrap();
        let error = film(&path, &mpl_right_arm()).unwrap_err().to_string();
        assert!(error.contains("/chatter") && error.contains("/gazebo/model_states"), "{error}");
        let cut = dir.path().join("cut.bag");
        let bytes = std::fs::read(&path).unwrap();
        for length in [0, 5, 20, 4100, bytes.len() / 2, bytes.len() - 30] {
            std::fs::write(&cut, &bytes[..length.min(bytes.len())]).unwrap();
            let error = film(&cut, &mpl_right_arm()).unwrap_err().to_string();
            assert!(error.contains("cut.bag") || error.contains("neither"), "{length}: {error}");
        }
        assert!(film(&dir.path().join("missing.bag"), &mpl_right_arm()).is_err());
    }

    #[test]
    fn the_originals_file_names_tell_the_method() {
        for (name, method) in [
            ("participant3-mode1-trial2-2021.bag", "A"),
            ("participant3-mode4-trial2.bag", "D"),
            ("trial.bag", "?"),
            ("mode9.bag", "?"),
        ] {
            assert_eq!(method_of(Path::new(name)), method, "{name}");
        }
    }
}
