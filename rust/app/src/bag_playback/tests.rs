use super::*;
use proact_recording::bag::{BagWriter, RosMessage, Time};
use std::f64::consts::TAU;

fn arm() -> Arm {
    Arm::load("mpl_right").unwrap()
}

/// A bag as the original's recorder writes it: receipt times of a wall clock, many topics, one of them unknown.
struct TestBag(BagWriter);

impl TestBag {
    fn write<M: RosMessage>(&mut self, topic: &str, ms: u32, message: &M) {
        let time = Time { secs: 1_600_000_000 + ms / 1000, nsecs: ms % 1000 * 1_000_000 };
        self.0.write(topic, time, message, false).unwrap();
    }

    fn models(&mut self, ms: u32, red1: [f64; 3]) {
        self.moving(ms, red1, 0.0);
    }

    /// With the speed of the block, m/s.
    fn moving(&mut self, ms: u32, red1: [f64; 3], speed: f64) {
        let pose = |[x, y, z]: [f64; 3]| ros::Pose {
            position: ros::Point { x, y, z },
            orientation: ros::Quaternion { w: 1.0, ..Default::default() },
        };
        let models = ros::ModelStates {
            name: vec!["ground_plane".into(), "mpl_right_arm".into(), "redcylinder1".into()],
            pose: vec![pose([0.0; 3]), pose([-0.4, 0.1, 1.5]), pose(red1)],
            twist: vec![
                ros::Twist::default(),
                ros::Twist::default(),
                ros::Twist { linear: ros::Vector3 { x: speed, y: 0.0, z: 0.0 }, ..Default::default() },
            ],
        };
        self.write("/gazebo/model_states", ms, &models);
    }
}

fn stamped(frame: &str, position: [f64; 3]) -> ros::PoseStamped {
    let [x, y, z] = position;
    ros::PoseStamped {
        header: ros::Header { frame_id: frame.to_owned(), ..Default::default() },
        pose: ros::Pose {
            position: ros::Point { x, y, z },
            orientation: ros::Quaternion { w: 1.0, ..Default::default() },
        },
    }
}

#[test]
fn the_head_is_the_headsets_own_where_the_bag_ties_its_world_to_ours() {
    // The headset's world stands at (-1, 0.2, 1.5) in ours, turned left by a quarter.
    let half = std::f64::consts::FRAC_1_SQRT_2;
    let tie = ros::TfMessage {
        transforms: vec![ros::TransformStamped {
            header: ros::Header { frame_id: "world".to_owned(), ..Default::default() },
            child_frame_id: HEADSET_WORLD.to_owned(),
            transform: ros::Transform {
                translation: ros::Vector3 { x: -1.0, y: 0.2, z: 1.5 },
                rotation: ros::Quaternion { z: half, w: half, ..Default::default() },
            },
        }],
    };
    let last_of = |tied: bool| {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("head.bag");
        let mut lab = TestBag(BagWriter::create(&path).unwrap());
        lab.models(0, [0.05, -0.2, 1.2]);
        if tied {
            lab.write("/tf", 1, &tie);
        }
        lab.write("/hololens/head", 2, &stamped("Unity", [0.3, 0.0, 0.1]));
        lab.write("/place_location_selected", 2, &stamped("ROSworld", [1.0, 0.0, -0.5]));
        // The original's, without a frame: not believed.
        lab.write("/hololens_unity_camera_pose_ros", 3, &stamped("", [9.0, 9.0, 9.0]));
        let eye = ros::Vector3 { x: 0.5, y: 0.5, z: 1.0 };
        let ahead = ros::Vector3 { x: 0.0, y: -1.0, z: 0.0 };
        for (topic, vector) in [("/gaze_position_ros", eye), ("/gaze_direction_ros", ahead)] {
            lab.write(topic, 4, &ros::Vector3Stamped { vector, ..Default::default() });
        }
        lab.0.finish().unwrap();
        read_playback(&path, &arm()).unwrap().frames.last().unwrap().clone()
    };
    let DisplayFrame { world_from_head: tied, target, .. } = last_of(true);
    assert!((target.place.unwrap() - Point::new(-1.0, 1.2, 1.0)).norm() < 1e-12, "{target:?}");
    assert!((tied.translation.vector - Vector::new(-1.0, 0.5, 1.6)).norm() < 1e-12, "{tied}");
    assert!((tied.rotation * Vector::x() - Vector::y()).norm() < 1e-12, "{tied}");
    let DisplayFrame { world_from_head: loose, target, .. } = last_of(false);
    assert_eq!(target.place, None);
    assert!((loose.translation.vector - Vector::new(0.5, 0.5, 1.0)).norm() < 1e-12, "{loose}");
    assert!((loose.rotation * Vector::x() + Vector::y()).norm() < 1e-12, "{loose}");
}

fn text(data: &str) -> ros::Text {
    ros::Text { data: data.to_owned() }
}

#[test]
fn a_labs_bag_shows_where_arm_and_blocks_were_and_what_was_done() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("participant1-mode4-trial2-2021.bag");
    let mut lab = TestBag(BagWriter::create(&path).unwrap());
    let arm = arm();
    let elbow = arm.model().joints[arm.model().arm[3]].name.clone();
    let target = TaskSpec::named(DEFAULT_TASK, 1).unwrap().build(false).unwrap().scene().targets[0].center;
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

    let trial = read_playback(&path, &arm).unwrap();
    assert_eq!((trial.method.as_str(), trial.digest_matches, trial.seed), ("D", None, None));
    assert!((trial.seconds - 3.992).abs() < 1e-9, "{}", trial.seconds);
    assert!((100..130).contains(&trial.frames.len()), "30 a second: {}", trial.frames.len());
    let last = trial.frames.last().unwrap();
    assert!((last.joints[3] - 3.98).abs() < 1e-9, "{:?}", last.joints);
    assert_eq!(last.world_from_base.translation.vector, Vector::new(-0.4, 0.1, 1.5));
    assert_eq!(last.objects[0].translation.vector, Vector::from(resting));
    assert_eq!(trial.frames[0].objects[0].translation.vector, Vector::new(0.05, -0.2, 1.2));
    assert_eq!((last.command, last.target.object), (Command::WristFlexion, Some(ObjectId(3))));
    assert_eq!(last.hand.held_object, Some(ObjectId(0)));
    assert!(last.events.iter().any(|e| e.kind == EventKind::ObjectAttached { object: ObjectId(0) }));
}

#[test]
fn a_block_that_comes_to_rest_as_the_bag_ends_is_on_target() {
    let score = |rests_ms: u32| {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("trial.bag");
        let mut lab = TestBag(BagWriter::create(&path).unwrap());
        let task = TaskSpec::named(DEFAULT_TASK, 1).unwrap().build(false).unwrap();
        let target = task.scene().targets[0].center;
        for ms in (0..=2000).step_by(20) {
            let there = ms >= 2000 - rests_ms;
            let speed = if there { 0.0 } else { 0.5 };
            lab.moving(ms, [target.x, target.y, target.z + 0.025], speed);
        }
        lab.0.finish().unwrap();
        let trial = read_playback(&path, &arm()).unwrap();
        (trial.score, trial.frames.last().unwrap().score)
    };
    assert_eq!(score(280), (1, 1), "a trial ends 300 ms after, by its own clock");
    assert_eq!(score(1000), (1, 1));
}

#[test]
fn a_bag_of_something_else_says_what_it_holds_and_another_file_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("camera.bag");
    let mut lab = TestBag(BagWriter::create(&path).unwrap());
    lab.write("/chatter", 0, &text("hello"));
    lab.0.finish().unwrap();
    let error = read_playback(&path, &arm()).unwrap_err().to_string();
    assert!(error.contains("/chatter") && error.contains("/gazebo/model_states"), "{error}");
    let cut = dir.path().join("cut.bag");
    let bytes = std::fs::read(&path).unwrap();
    for length in [0, 5, 20, 4100, bytes.len() / 2, bytes.len() - 30] {
        std::fs::write(&cut, &bytes[..length.min(bytes.len())]).unwrap();
        let error = read_playback(&cut, &arm()).unwrap_err().to_string();
        let expected_texts = ["cut.bag", "neither", "no whole message: the bag is cut off"];
        assert!(
            expected_texts.iter().any(|expected_text| error.contains(expected_text)),
            "{length}: {error}"
        );
    }
    assert!(read_playback(&dir.path().join("missing.bag"), &arm()).is_err());
}

#[test]
fn the_originals_file_names_tell_the_method() {
    for (name, method) in [
        ("participant3-mode1-trial2-2021.bag", "A"),
        ("participant3-mode4-trial2.bag", "D"),
        ("trial.bag", "?"),
        ("mode9.bag", "?"),
    ] {
        assert_eq!(method_from_file_name(Path::new(name)), method, "{name}");
    }
}

/// A state of the arm and of all blocks as the original's nodes publish it, in messages of their own.
fn write_state(lab: &mut TestBag, ms: u32, names: &[String], angle: f64, base_x: f64) {
    let task = default_task();
    let pose = |x: f64, y: f64, z: f64| ros::Pose {
        position: ros::Point { x, y, z },
        orientation: ros::Quaternion { w: 1.0, ..Default::default() },
    };
    let objects = &task.scene().objects;
    let mut models = ros::ModelStates {
        name: vec![ARM_MODEL.into()],
        pose: vec![pose(base_x, 0.1, 1.5)],
        twist: vec![ros::Twist::default(); objects.len() + 1],
    };
    for object in objects {
        let at = object.pose.translation.vector;
        models.name.push(object.ros_name.clone());
        models.pose.push(pose(at.x, at.y, at.z));
    }
    let state =
        ros::JointState { name: names.to_vec(), position: vec![angle; names.len()], ..Default::default() };
    lab.write("/gazebo/model_states", ms, &models);
    lab.write("/mpl_right_arm/wrapped_joint_states", ms, &state);
}

/// Caught: frames were kept before joints, base and objects had come, and before all messages of their instant.
#[test]
fn what_is_scored_is_on_an_even_grid_after_all_messages_of_an_instant_and_never_before_joints_base_and_objects()
 {
    let (arm, dir) = (arm(), tempfile::tempdir().unwrap());
    let path = dir.path().join("trial.bag");
    let mut lab = TestBag(BagWriter::create(&path).unwrap());
    let names: Vec<String> = arm.model().moving().map(|k| arm.model().joints[k].name.clone()).collect();
    lab.write("/emg", 0, &text("no_motion"));
    for ms in (20..=1000).step_by(20) {
        // The first instant has a part of the joints.
        let own = if ms == 20 { &names[..3] } else { &names[..] };
        write_state(&mut lab, ms, own, f64::from(ms) * 1e-3, f64::from(ms) * 1e-4);
        lab.write("/emg", ms + 7, &text("no_motion"));
    }
    let eye = ros::Vector3 { x: 0.5, y: 0.5, z: 1.0 };
    let ahead = ros::Vector3 { x: 0.0, y: -1.0, z: 0.0 };
    for (topic, vector) in [("/gaze_position_ros", eye), ("/gaze_direction_ros", ahead)] {
        lab.write(topic, 1010, &ros::Vector3Stamped { vector, ..Default::default() });
    }
    for ms in (1020..=2000).step_by(20).chain((4000..=4100).step_by(20)) {
        write_state(&mut lab, ms, &names, f64::from(ms) * 1e-3, f64::from(ms) * 1e-4);
    }
    lab.0.finish().unwrap();
    let watched = sample_bag(&path, arm.model(), default_task(), StartPoses::FromBag, 20).unwrap();
    assert_eq!(watched.missing, Vec::<String>::new());
    let times: Vec<u64> = watched.scored_frames.iter().map(|k| watched.frames[*k].time.0).collect();
    let expected: Vec<u64> = (40..=2000).step_by(20).chain((4000..=4100).step_by(20)).collect();
    assert_eq!(times, expected, "nothing is made up where the bag has a gap");
    assert_eq!(watched.gaps, [[SimTime(2000), SimTime(4000)]]);
    for frame in watched.scored_frames.iter().map(|k| &watched.frames[*k]) {
        let ms = frame.time.0;
        assert!(
            frame.joints.iter().all(|angle| (angle - ms as f64 * 1e-3).abs() < 1e-9),
            "{ms} {:?}",
            frame.joints
        );
        assert!((frame.world_from_base.translation.vector.x - ms as f64 * 1e-4).abs() < 1e-12, "{ms}");
        // A gaze expires as in the live trial: 500 ms after it was seen.
        assert_eq!(frame.gaze.is_some(), (1020..=1500).contains(&ms), "{ms}");
    }
}

/// Caught: a bag that was written topic after topic was read as if the arm had stood still, then the base.
#[test]
fn messages_are_taken_in_the_order_of_their_times_whatever_the_order_of_the_file() {
    let (arm, dir) = (arm(), tempfile::tempdir().unwrap());
    let names: Vec<String> = arm.model().moving().map(|k| arm.model().joints[k].name.clone()).collect();
    let instants: Vec<u32> = (0..=2000).step_by(20).collect();
    let backwards: Vec<u32> = instants.iter().rev().copied().collect();
    let [ordered, reversed] =
        [("ordered.bag", instants), ("reversed.bag", backwards)].map(|(name, instants)| {
            let path = dir.path().join(name);
            let mut lab = TestBag(BagWriter::create(&path).unwrap());
            for ms in instants {
                write_state(&mut lab, ms, &names, f64::from(ms) * 1e-3, f64::from(ms) * 1e-4);
            }
            lab.0.finish().unwrap();
            sample_bag(&path, arm.model(), default_task(), StartPoses::FromBag, 20).unwrap()
        });
    assert_eq!(ordered.scored_frames.len(), 101);
    assert_eq!(ordered.frames, reversed.frames);
    assert_eq!((ordered.scored_frames, ordered.gaps), (reversed.scored_frames, reversed.gaps));
}

#[test]
fn an_angle_in_a_bag_is_the_equal_one_within_the_limits_that_continues_the_one_before() {
    let limits = JointLimits { lower: -4.76, upper: 1.24, ..JointLimits::default() };
    assert!((unwrap_angle(2.0, None, &limits) - (2.0 - TAU)).abs() < 1e-12);
    assert!((unwrap_angle(-3.1, None, &limits) + 3.1).abs() < 1e-12);
    assert!((unwrap_angle(3.1, Some(-3.1), &limits) - (3.1 - TAU)).abs() < 1e-12);
}
