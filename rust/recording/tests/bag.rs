//! Bags: what two independent readers find in a trial's bag, bad input.
#![allow(clippy::unwrap_used, clippy::disallowed_methods)]

use proact_arm::{ArmModel, Joint, JointKind, JointLimits, Link};
use proact_messages::builtin_type;
use proact_recording::{
    BAG_FILE, RecordingError, TrialBag,
    bag::{
        BAG_EPOCH_SECS, RosMessage,
        messages::{
            Bool, Clock, Float64, GazeboGraspEvent, Int8, JointState, JointTrajectory, Log, ModelStates,
            Text, TfMessage, Vector3Stamped,
        },
    },
};
use proact_types::{
    BodyState, Command, DisplayFrame, Event, EventKind, GazeSample, HandState, HandView, Object, ObjectId,
    PlanReply, PlanStatus, PlannerView, PlantState, Point, Pose, Scene, Shape, SimTime, TargetView,
    Trajectory, TrajectoryPoint, Vector, joints, zeros,
};
use rosbag::{ChunkRecord, IndexRecord, MessageRecord, RosBag};
use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
    process::{self, Output},
};

const SECONDS: u64 = 20;
const LAST_TICK: SimTime = SimTime(SECONDS * 1000);

/// A fixed joint, two arm joints and one hand joint, whose names do not stand in alphabetical order.
fn arm() -> ArmModel {
    let names = ["base_link", "mount", "upper", "wrist", "finger"];
    let links = names.map(|name| Link {
        name: name.to_owned(),
        inertial: None,
        collisions: Vec::new(),
        visuals: Vec::new(),
    });
    let kinds = [JointKind::Fixed, JointKind::Revolute, JointKind::Revolute, JointKind::Revolute];
    let joint = |(index, (name, kind)): (usize, (&str, JointKind))| Joint {
        name: name.to_owned(),
        kind,
        parent: index,
        child: index + 1,
        origin: Pose::translation(0.0, 0.0, 0.1 * (index as f64 + 1.0)),
        axis: Vector::x(),
        limits: JointLimits::default(),
        damping: 0.0,
        friction: 0.0,
    };
    ArmModel {
        name: "test_arm".to_owned(),
        links: links.to_vec(),
        joints: ["fixed", "shoulder", "elbow", "grip"]
            .into_iter()
            .zip(kinds)
            .enumerate()
            .map(joint)
            .collect(),
        arm: vec![1, 2],
        hand: vec![3],
        tip: 3,
        poses: Vec::new(),
        allowed_collisions: Vec::new(),
        ..Default::default()
    }
}

/// Four blocks under the original's names.
fn scene() -> Scene {
    let names = ["redcylinder1", "redcylinder2", "bluecylinder1", "bluecylinder2"];
    let shape = Shape::Cylinder { radius: 0.025, length: 0.05 };
    let block = |name| Object::with_default_friction(name, shape, 0.1, Pose::identity());
    Scene { objects: names.map(block).to_vec(), ..Scene::default() }
}

fn frame(time: SimTime) -> DisplayFrame {
    let secs = time.as_secs();
    let holding = secs > 10.0;
    DisplayFrame {
        time,
        method: "D".to_owned(),
        joints: zeros(3),
        world_from_base: Pose::new(Vector::new(-0.39 + 0.01 * secs, 0.12, 1.5), Vector::new(1.57, 0.0, 0.0)),
        world_from_tip: Pose::identity(),
        world_from_head: Pose::translation(-0.5, 0.0, 1.7),
        objects: (0..4).map(|k| Pose::translation(0.058, -0.2 + 0.01 * f64::from(k), 1.04)).collect(),
        hand: HandView {
            state: if holding { HandState::Closed } else { HandState::Open },
            held_object: holding.then_some(ObjectId(2)),
        },
        gaze: None,
        target: TargetView {
            object: Some(ObjectId(1)),
            place: holding.then(|| Point::new(0.058, 0.2083, 1.015)),
            locked: false,
            posterior: vec![0.1, 0.2, 0.6, 0.1],
        },
        planner: PlannerView::Idle,
        mode: None,
        stop: None,
        command: Command::NoMotion,
        recognized_gesture: Command::NoMotion.into(),
        confidence: 1.0,
        effort: 0.5,
        emg_source: "keys".to_owned(),
        time_left_secs: 300.0 - secs,
        plan_goal: None,
        next_object: Some(ObjectId(0)),
        task_goal: None,
        score: 0,
        finished: false,
        events: Vec::new(),
        contacts: Vec::new(),
        feedback: Vec::new(),
    }
}

fn state(time: SimTime) -> PlantState {
    let body = BodyState {
        pose: Pose::translation(0.058, -0.2, 1.04),
        linear_velocity: Vector::new(0.1, 0.0, 0.0),
        angular_velocity: Vector::new(0.0, 0.0, time.as_secs()),
    };
    PlantState {
        position: joints(&[0.1, 4.0, -0.3]),
        velocity: joints(&[1.0, 2.0, 3.0]),
        effort: joints(&[10.0, 20.0, 30.0]),
        limit_effort: joints(&[0.0, 0.5, -0.25]),
        world_from_base: frame(time).world_from_base,
        base_held: false,
        objects: [body; 4].into_iter().collect(),
        attached: None,
        contacts: Default::default(),
    }
}

fn plan() -> PlanReply {
    let point = |time_secs: f64| TrajectoryPoint { time_secs, q: joints(&[0.5, 0.6]), qd: zeros(2) };
    let trajectory = Trajectory { points: vec![point(0.0), point(1.25)] };
    PlanReply { id: 1, status: PlanStatus::Ok, trajectory, reason: String::new(), clearance_m: None }
}

/// Everything that a trial writes, for `SECONDS` simulated seconds.
fn write_trial(bag: &mut TrialBag) {
    for tick in 0..=LAST_TICK.0 {
        let now = SimTime(tick);
        if tick % 17 == 0 {
            bag.write_frame(&frame(now)).unwrap();
        }
        if tick % 20 == 0 {
            bag.write_state(now, &state(now)).unwrap();
        }
        if tick % 50 == 0 {
            bag.write_emg(now, Command::ALL[tick as usize / 50 % 5]).unwrap();
            // Every second sample is a blink.
            let gaze = GazeSample {
                origin: Point::new(-0.5, 0.0, 1.7),
                direction: Vector::new(3.0, 0.0, -4.0),
                valid: tick % 100 == 0,
            };
            bag.write_gaze(now, &gaze).unwrap();
        }
        let block = ObjectId(2);
        let kinds = match tick {
            4_000 => vec![EventKind::Locked { object: Some(block) }],
            5_000 => {
                bag.write_plan(now, &plan()).unwrap();
                vec![EventKind::PlanFinished { request: 1, status: PlanStatus::Ok, reason: None }]
            }
            10_001 => vec![EventKind::ObjectAttached { object: block }, EventKind::Unlocked],
            15_000 => vec![EventKind::ObjectReleased { object: block }],
            _ => vec![],
        };
        for kind in kinds {
            bag.write_event(&Event { time: now, kind }).unwrap();
        }
    }
}

fn finished_bag(dir: &Path) -> PathBuf {
    let mut bag = TrialBag::create(&dir.join(BAG_FILE), &arm(), &scene()).unwrap();
    write_trial(&mut bag);
    bag.finish(LAST_TICK).unwrap()
}

/// Messages of each topic, as the crate `rosbag` finds them: bag time in nanoseconds and bytes.
type Topics = BTreeMap<String, (String, Vec<(u64, Vec<u8>)>)>;

/// Reads the chunks, and checks every index record against them.
fn read_bag(path: &Path) -> Topics {
    let bag = RosBag::new(path).unwrap();
    let mut connections = BTreeMap::new();
    let (mut counts, mut chunk_infos) = (0, 0);
    for record in bag.index_records() {
        match record.unwrap() {
            IndexRecord::Connection(c) => {
                connections.insert(c.id, (c.topic.to_owned(), c.tp.to_owned()));
            }
            IndexRecord::ChunkInfo(info) => {
                chunk_infos += 1;
                counts += info.entries().map(|e| e.count).sum::<u32>();
            }
            IndexRecord::IndexData(_) => panic!("index data belongs to the chunks"),
        }
    }
    assert_eq!(bag.get_conn_count() as usize, connections.len());
    assert_eq!(bag.get_chunk_count(), chunk_infos);
    assert!(chunk_infos > 2, "the trial is too short to show that chunks are closed");

    let mut topics = Topics::new();
    let mut chunk = None;
    let (mut messages, mut indexed) = (0, 0);
    for record in bag.chunk_records() {
        match record.unwrap() {
            ChunkRecord::Chunk(data) => {
                for record in data.messages() {
                    if let MessageRecord::MessageData(m) = record.unwrap() {
                        let (topic, type_name) = &connections[&m.conn_id];
                        let entry =
                            topics.entry(topic.clone()).or_insert_with(|| (type_name.clone(), vec![]));
                        entry.1.push((m.time, m.data.to_vec()));
                        messages += 1;
                    }
                }
                chunk = Some(data);
            }
            ChunkRecord::IndexData(index) => {
                let mut data = chunk.as_ref().unwrap().messages();
                for entry in index.entries() {
                    data.seek(entry.offset).unwrap();
                    match data.next().unwrap().unwrap() {
                        MessageRecord::MessageData(m) => {
                            assert_eq!((m.conn_id, m.time), (index.conn_id, entry.time));
                        }
                        MessageRecord::Connection(_) => panic!("the index points at a connection"),
                    }
                    indexed += 1;
                }
            }
        }
    }
    assert_eq!((messages, messages), (indexed, counts));
    topics
}

fn last<M: RosMessage>(topics: &Topics, topic: &str) -> M {
    let (type_name, messages) = &topics[topic];
    assert_eq!(type_name, M::TYPE);
    builtin_type(M::TYPE).unwrap().from_bytes(&messages.last().unwrap().1).unwrap().into_struct().unwrap()
}

#[test]
fn a_trials_bag_holds_the_trial() {
    let temp_dir = tempfile::tempdir().unwrap();
    let path = finished_bag(temp_dir.path());
    assert_eq!(path, temp_dir.path().join("trial.bag"));
    assert_eq!(fs::read_dir(temp_dir.path()).unwrap().count(), 1, "the active name is gone");
    let topics = read_bag(&path);

    let frames = (LAST_TICK.0 / 17 + 1) as usize;
    let states = (LAST_TICK.0 / 20 + 1) as usize;
    let gazes = (LAST_TICK.0 / 100 + 1) as usize;
    let holding = (0..=LAST_TICK.0).step_by(17).filter(|t| *t > 10_000).count();
    let counts: BTreeMap<&str, usize> = topics.iter().map(|(t, (_, m))| (t.as_str(), m.len())).collect();
    let expected = BTreeMap::from([
        ("/block_id", frames),
        ("/blue_block1_pose_msg", frames),
        ("/blue_block2_pose_msg", frames),
        ("/clock", frames),
        ("/current_block", frames - holding),
        ("/emg", (LAST_TICK.0 / 50 + 1) as usize),
        ("/gaze_direction", gazes),
        ("/gaze_direction_ros", gazes),
        ("/gaze_position", gazes),
        ("/gaze_position_ros", gazes),
        ("/gazebo/model_states", states),
        ("/grasp_event_republisher/grasp_events", 2),
        ("/grasp_status", 2),
        ("/hololens_unity_camera_pose_ros", frames),
        ("/mpl_right_arm/arm_controller/command", 1),
        ("/mpl_right_arm/base_pose", frames),
        ("/mpl_right_arm/wrapped_joint_states", states),
        ("/place_location_selected", holding),
        ("/proact/stop_efforts", states),
        ("/red_block1_pose_msg", frames),
        ("/red_block2_pose_msg", frames),
        // Start, stop and the five events.
        ("/rosout", 7),
        ("/selection_frozen", 2),
        ("/success", 1),
        ("/tf", frames + states),
        ("/tf_static", 1),
    ]);
    assert_eq!(counts, expected);

    let joint_states: JointState = last(&topics, "/mpl_right_arm/wrapped_joint_states");
    assert_eq!(joint_states.name, ["elbow", "grip", "shoulder"]);
    assert_eq!(joint_states.position, [4.0 - std::f64::consts::TAU, -0.3, 0.1]);
    assert_eq!(joint_states.velocity, [2.0, 3.0, 1.0]);
    assert_eq!(joint_states.effort, [20.0, 30.0, 10.0]);
    let stops: JointState = last(&topics, "/proact/stop_efforts");
    assert_eq!((stops.name, stops.effort), (joint_states.name, vec![0.5, -0.25, 0.0]));
    assert_eq!(joint_states.header.stamp.secs, BAG_EPOCH_SECS + SECONDS as u32);
    // tick 19992 is the last frame; 20000 the last state.
    let clock: Clock = last(&topics, "/clock");
    assert_eq!((clock.clock.secs, clock.clock.nsecs), (BAG_EPOCH_SECS + 19, 992_000_000));
    assert_eq!(last::<Text>(&topics, "/block_id").data, "bluecylinder1");
    assert_eq!(last::<Text>(&topics, "/current_block").data, "redcylinder2");
    let gaze: Vector3Stamped = last(&topics, "/gaze_direction");
    assert_eq!((gaze.vector.x, gaze.vector.z, gaze.header.frame_id.as_str()), (0.6, -0.8, "world"));
    let grasp: GazeboGraspEvent = last(&topics, "/grasp_event_republisher/grasp_events");
    assert_eq!(grasp.object, "bluecylinder1::link::collision");
    assert!(!grasp.attached && !last::<Bool>(&topics, "/grasp_status").data);
    assert!(last::<Bool>(&topics, "/success").data, "the hand closed");
    let command: JointTrajectory = last(&topics, "/mpl_right_arm/arm_controller/command");
    assert_eq!(command.joint_names, ["shoulder", "elbow"]);
    let end = &command.points[1].time_from_start;
    assert_eq!((end.secs, end.nsecs), (1, 250_000_000));
    let log: Log = last(&topics, "/rosout");
    assert_eq!((log.name.as_str(), log.msg.as_str(), log.level), ("start-stop", "Stop", 2));
    let models: ModelStates = last(&topics, "/gazebo/model_states");
    assert_eq!(models.name[..2], ["mpl_right_arm", "redcylinder1"]);
    assert_eq!(models.twist[1].angular.z, SECONDS as f64);
    assert_eq!(last::<TfMessage>(&topics, "/tf_static").transforms[0].child_frame_id, "mount");
}

#[test]
fn tf_carries_the_arms_forward_kinematics() {
    let temp_dir = tempfile::tempdir().unwrap();
    let topics = read_bag(&finished_bag(temp_dir.path()));
    let tf: TfMessage = last(&topics, "/tf");
    let wrist = tf.transforms.iter().find(|t| t.child_frame_id == "wrist").unwrap();
    assert_eq!(wrist.header.frame_id, "upper");
    assert!((wrist.transform.translation.z - 0.3).abs() < 1e-15);
    // A turn of 4 rad about x.
    let rotation = &wrist.transform.rotation;
    assert!((rotation.x - 2.0_f64.sin()).abs() < 1e-15 && (rotation.w - 2.0_f64.cos()).abs() < 1e-15);
}

#[test]
fn equal_trials_give_equal_bags() {
    let (one, two) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let bytes = |dir: &Path| fs::read(finished_bag(dir)).unwrap();
    assert!(bytes(one.path()) == bytes(two.path()));
}

#[test]
fn malformed_frames_states_and_plans_are_refused_whole() {
    let temp_dir = tempfile::tempdir().unwrap();
    let mut bag = TrialBag::create(&temp_dir.path().join(BAG_FILE), &arm(), &scene()).unwrap();
    let now = SimTime(17);
    let not_finite = |r: Result<(), RecordingError>| matches!(r, Err(RecordingError::NotFinite { .. }));
    let wrong_length = |r: Result<(), RecordingError>| matches!(r, Err(RecordingError::WrongLength { .. }));

    let mut bad = frame(now);
    bad.objects[2].translation.x = f64::NAN;
    assert!(not_finite(bag.write_frame(&bad)));
    bad = frame(now);
    bad.target.place = Some(Point::new(0.0, f64::INFINITY, 0.0));
    assert!(not_finite(bag.write_frame(&bad)));
    bad = frame(now);
    bad.objects.clear();
    assert!(wrong_length(bag.write_frame(&bad)));

    let mut bad = state(now);
    bad.effort[1] = f64::NAN;
    assert!(not_finite(bag.write_state(now, &bad)));
    bad = state(now);
    bad.velocity.pop();
    assert!(wrong_length(bag.write_state(now, &bad)));
    bad = state(now);
    bad.objects.pop();
    assert!(wrong_length(bag.write_state(now, &bad)));

    let blind = GazeSample { origin: Point::origin(), direction: Vector::zeros(), valid: true };
    assert!(not_finite(bag.write_gaze(now, &blind)));
    let mut bad = plan();
    bad.trajectory.points[1].q.pop();
    assert!(wrong_length(bag.write_plan(now, &bad)));
    bad = plan();
    bad.trajectory.points[1].time_secs = f64::NAN;
    assert!(not_finite(bag.write_plan(now, &bad)));

    // Nothing of all that may be in the bag: only the two marks and the static transforms.
    let bytes = fs::read(bag.finish(now).unwrap()).unwrap();
    let text = String::from_utf8_lossy(&bytes);
    for topic in ["/clock", "wrapped_joint_states", "/gaze_position", "arm_controller"] {
        assert!(!text.contains(topic), "{topic}");
    }
    assert!(text.contains("/tf_static"));
}

#[test]
fn a_topic_keeps_its_type() {
    let temp_dir = tempfile::tempdir().unwrap();
    let mut bag = TrialBag::create(&temp_dir.path().join(BAG_FILE), &arm(), &scene()).unwrap();
    bag.write("/mode", SimTime(1), &Int8 { data: 3 }).unwrap();
    let error = bag.write("/mode", SimTime(2), &Float64 { data: 3.0 }).unwrap_err();
    assert_eq!(
        error.to_string(),
        "topic /mode carries std_msgs/Int8, got a message of type std_msgs/Float64"
    );
}

#[test]
fn no_bag_is_overwritten_and_none_is_begun_where_nothing_can_be_written() {
    let temp_dir = tempfile::tempdir().unwrap();
    let path = finished_bag(temp_dir.path());
    let before = fs::read(&path).unwrap();
    let error = TrialBag::create(&temp_dir.path().join(BAG_FILE), &arm(), &scene()).unwrap_err();
    assert!(error.to_string().contains("trial.bag"), "{error}");
    assert!(before == fs::read(&path).unwrap());
    assert!(TrialBag::create(&path, &arm(), &scene()).is_err());
}

/// Runs a program of Debian's with Debian's Python; none, with a word on the console, if it is not there.
fn debian_python(arguments: &[&str]) -> Option<Output> {
    let probe = process::Command::new("/usr/bin/python3").args(["-c", "import rosbag"]).output();
    if !probe.is_ok_and(|p| p.status.success()) {
        println!("skipped: python3-rosbag is not installed (sudo apt install python3-rosbag)");
        return None;
    }
    Some(process::Command::new("/usr/bin/python3").args(arguments).output().unwrap())
}

fn check_script() -> String {
    concat!(env!("CARGO_MANIFEST_DIR"), "/../../tests/bag/check_bag.py").to_owned()
}

#[test]
fn python_rosbag_reads_every_message() {
    let temp_dir = tempfile::tempdir().unwrap();
    let path = finished_bag(temp_dir.path());
    let Some(output) = debian_python(&[&check_script(), path.to_str().unwrap()]) else { return };
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{errors}");
    let report: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();

    let ours = read_bag(&path);
    let topics = report["topics"].as_object().unwrap();
    assert_eq!(topics.len(), ours.len());
    for (topic, (type_name, messages)) in &ours {
        assert_eq!(topics[topic]["type"], *type_name, "{topic}");
        assert_eq!(topics[topic]["count"], messages.len(), "{topic}");
    }
    // What Python decoded is what went in.
    let base = topics["/mpl_right_arm/base_pose"]["last_message"].as_str().unwrap();
    assert!(base.contains("frame_id: \"world\"") && base.contains("y: 0.12"), "{base}");
    let emg = topics["/emg"]["last_message"].as_str().unwrap();
    assert_eq!(emg, "data: \"hand_close\"");
    assert_eq!(topics["/emg"]["last_secs"], f64::from(BAG_EPOCH_SECS) + SECONDS as f64);
}

/// Every message with its topic, time and bytes, by our own reader.
fn messages(path: &Path) -> Vec<String> {
    let mut found = Vec::new();
    let end = proact_recording::bag::read_bag(path, |message| -> Result<(), RecordingError> {
        found.push(format!("{message:?}"));
        Ok(())
    });
    assert_eq!(end.unwrap(), proact_recording::bag::BagEnd::Complete);
    found
}

#[test]
fn a_compressed_bag_has_the_same_messages_in_a_fraction_of_the_size_and_ros_reads_it() {
    let temp_dir = tempfile::tempdir().unwrap();
    let plain = finished_bag(temp_dir.path());
    let path = temp_dir.path().join("small.bag");
    let mut bag = TrialBag::create(&path, &arm(), &scene()).unwrap();
    bag.enable_compression();
    write_trial(&mut bag);
    let small = bag.finish(LAST_TICK).unwrap();
    assert_eq!(messages(&plain), messages(&small));
    let size = |path: &Path| fs::metadata(path).unwrap().len();
    assert!(3 * size(&small) < size(&plain), "{} of {} bytes", size(&small), size(&plain));
    let Some(output) = debian_python(&[&check_script(), small.to_str().unwrap()]) else { return };
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let report: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let ours = read_bag(&plain);
    let topics = report["topics"].as_object().unwrap();
    assert_eq!(topics.len(), ours.len());
    for (topic, (_, messages)) in &ours {
        assert_eq!(topics[topic]["count"], messages.len(), "{topic}");
    }
}

#[test]
fn the_python_check_refuses_a_wrong_sum() {
    let temp_dir = tempfile::tempdir().unwrap();
    let path = finished_bag(temp_dir.path());
    let mut bytes = fs::read(&path).unwrap();
    let kind = builtin_type(Bool::TYPE).unwrap();
    let sum = kind.md5();
    let found: Vec<usize> =
        (0..bytes.len() - 32).filter(|at| bytes[*at..].starts_with(sum.as_bytes())).collect();
    for at in found {
        bytes[at] ^= 1;
    }
    fs::write(&path, bytes).unwrap();
    let Some(output) = debian_python(&[&check_script(), path.to_str().unwrap()]) else { return };
    assert!(!output.status.success());
    assert!(String::from_utf8_lossy(&output.stderr).contains("std_msgs/Bool"));
}

#[test]
fn a_bag_that_was_broken_off_is_recovered_by_rosbag_reindex() {
    let temp_dir = tempfile::tempdir().unwrap();
    let mut bag = TrialBag::create(&temp_dir.path().join(BAG_FILE), &arm(), &scene()).unwrap();
    write_trial(&mut bag);
    // A crash runs no destructor: the open chunk is gone.
    std::mem::forget(bag);
    let active = temp_dir.path().join("trial.bag.active");
    assert!(active.exists() && !temp_dir.path().join("trial.bag").exists());
    let active = active.to_str().unwrap();
    let Some(output) = debian_python(&[&check_script(), active]) else { return };
    assert!(!output.status.success(), "an unfinished bag has no index");
    let output = debian_python(&["/usr/bin/rosbag", "reindex", active]).unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let output = debian_python(&[&check_script(), active]).unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let report: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    // Most of the trial's messages are in complete chunks.
    assert!(report["messages"].as_u64().unwrap() > 10_000, "{}", report["messages"]);
}
