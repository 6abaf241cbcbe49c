//! A double of the original headset app: its handshake, binary frames and burst of subscriptions, and what it
//! does with the poses.
#![allow(clippy::unwrap_used, clippy::disallowed_methods)]

mod common;

use common::{Client, frame, scene, server};
use nalgebra::{Point3, Quaternion, Translation3, UnitQuaternion};
use proact_rosbridge::{HeadsetInput, HeadsetTopics};
use proact_types::{Command, Event, EventKind, HandState, ModeView, ObjectId, Point, Pose, SimTime, Vector};
use serde_json::{Value as Json, json};
use std::{collections::BTreeMap, sync::Arc};

const POSE: &str = "geometry_msgs/PoseStamped";
const IN: [(&str, &str); 13] = [
    ("/rosworld_pose_msg", POSE),
    ("/mpl_right_arm/base_pose", POSE),
    ("/red_block1_pose_msg", POSE),
    ("/red_block2_pose_msg", POSE),
    ("/blue_block1_pose_msg", POSE),
    ("/blue_block2_pose_msg", POSE),
    ("/mpl_right_arm/wrapped_joint_states", "sensor_msgs/JointState"),
    ("/place_location_selected", POSE),
    ("/current_block", "std_msgs/String"),
    ("/grasp_status", "std_msgs/Bool"),
    ("/mode", "std_msgs/Int8"),
    ("/selection_frozen", "std_msgs/Bool"),
    ("/success", "std_msgs/Bool"),
];
const OUT: [(&str, &str); 5] = [
    ("/hololens/head", POSE),
    ("/gaze_position", "geometry_msgs/Vector3Stamped"),
    ("/gaze_direction", "geometry_msgs/Vector3Stamped"),
    ("/gaze_hit_location_unity", "geometry_msgs/Vector3Stamped"),
    ("/gaze_target_object", "std_msgs/String"),
];

/// The app's requests after connecting, in its wording.
fn handshake(app: &mut Client) {
    for (topic, kind) in OUT {
        app.send_binary(&json!({"op": "advertise", "id": topic, "topic": topic, "type": kind}));
    }
    for (n, (topic, kind)) in IN.iter().enumerate() {
        app.send_binary(&json!({
            "op": "subscribe", "id": format!("{topic}:{n}"), "topic": topic, "type": kind,
            "throttle_rate": 0, "queue_length": 1, "fragment_size": 2_147_483_647, "compression": "none",
        }));
    }
}

fn publish(app: &mut Client, topic: &str, msg: Json) {
    app.send_binary(&json!({"op": "publish", "id": topic, "topic": topic, "msg": msg}));
}

/// The app reads on until the trial's joint states have come; the last message of each topic, as the app keeps it.
fn read_frame(app: &mut Client, last: &str) -> BTreeMap<String, Json> {
    let mut latest = BTreeMap::new();
    loop {
        let message = app.next();
        assert_eq!(message["op"], "publish", "the app understands nothing else here: {message}");
        let topic = message["topic"].as_str().unwrap().to_owned();
        latest.insert(topic.clone(), message["msg"].clone());
        if topic == last {
            return latest;
        }
    }
}

/// What the app makes of a pose: it swaps axes into Unity's, left-handed with y up.
fn unity(pose: &Json) -> ([f64; 3], [f64; 4]) {
    let number = |value: &Json| value.as_f64().unwrap();
    let (p, q) = (&pose["pose"]["position"], &pose["pose"]["orientation"]);
    let (x, y, z) = (number(&p["x"]), number(&p["y"]), number(&p["z"]));
    let (qx, qy, qz, qw) = (number(&q["x"]), number(&q["y"]), number(&q["z"]), number(&q["w"]));
    ([-y, z, x], [qy, -qz, -qx, qw])
}

/// And back.
fn ros((p, q): ([f64; 3], [f64; 4])) -> Pose {
    let turn = UnitQuaternion::from_quaternion(Quaternion::new(q[3], -q[2], q[0], -q[1]));
    Pose::from_parts(Translation3::new(p[2], -p[0], p[1]), turn)
}

fn close(a: &Pose, b: &Pose) -> bool {
    (a.translation.vector - b.translation.vector).norm() < 1e-9 && a.rotation.angle_to(&b.rotation) < 1e-9
}

/// The head of somebody who sits before the box, turned a little to the left and looking down.
fn head() -> Pose {
    Pose::from_parts(Translation3::new(-0.5, 0.1, 1.6), UnitQuaternion::from_euler_angles(0.0, 0.4, 0.3))
}

#[test]
fn the_app_gets_one_consistent_instant_with_absolute_poses_in_its_own_world() {
    let (server, bus) = server();
    let mut app = Client::connect(&server);
    // The app comes first: nobody publishes yet.
    handshake(&mut app);
    app.drain_messages();
    let arm = proact_description::mpl_right_arm();
    let topics = HeadsetTopics::new(Arc::clone(&bus), &arm, &scene(), head()).unwrap();
    let display_frame = frame(head());
    topics.publish(&display_frame);
    let got = read_frame(&mut app, "/current_block");

    // Its world begins at its head, level: the turn to the left is the only one.
    let world_from_unity =
        Pose::from_parts(head().translation, UnitQuaternion::from_euler_angles(0.0, 0.0, 0.3));
    let in_unity = |topic: &str| ros(unity(&got[topic]));
    assert!(close(&in_unity("/rosworld_pose_msg"), &world_from_unity.inverse()));
    let world = |topic: &str| world_from_unity * in_unity(topic);
    assert!(close(&world("/mpl_right_arm/base_pose"), &display_frame.world_from_base));
    for (topic, block) in IN[2..6].iter().zip(&display_frame.objects) {
        assert!(close(&world(topic.0), block), "{}", topic.0);
    }
    let place_pose = in_unity("/place_location_selected");
    assert!(place_pose.rotation.angle() < 1e-12, "the disc lies level in the app's world");
    let place_point = world_from_unity * Point::from(place_pose.translation.vector);
    assert!((place_point - display_frame.target.place.unwrap()).norm() < 1e-9);
    assert_eq!(got["/current_block"]["data"], "bluecylinder2");

    // One instant: every stamp is the frame's.
    for (topic, message) in got.iter().filter(|(_, message)| message.get("header").is_some()) {
        assert_eq!(message["header"]["stamp"], json!({"secs": 12, "nsecs": 345_000_000}), "{topic}");
        assert_eq!(message["header"]["seq"], 1, "{topic}");
    }

    // 27 joints by name, sorted, wrapped.
    let joints = &got["/mpl_right_arm/wrapped_joint_states"];
    let names: Vec<&str> =
        joints["name"].as_array().unwrap().iter().map(|name| name.as_str().unwrap()).collect();
    assert_eq!(names.len(), 27);
    assert!(names.is_sorted());
    for (index, joint) in arm.moving().enumerate() {
        let at = names.iter().position(|name| *name == arm.joints[joint].name).unwrap();
        let angle = joints["position"][at].as_f64().unwrap();
        assert!(angle.abs() <= std::f64::consts::PI);
        assert!((angle - display_frame.joints[index]).sin().abs() < 1e-9);
    }
}

#[test]
fn what_happened_before_the_app_came_is_told_at_once_and_changes_once_each() {
    let (server, bus) = server();
    let arm = proact_description::mpl_right_arm();
    let topics = HeadsetTopics::new(Arc::clone(&bus), &arm, &scene(), head()).unwrap();
    let mut display_frame = frame(head());
    let directions = ["flexion".to_owned(), "extension".to_owned()];
    display_frame.mode = Some(ModeView {
        controlled_dof: proact_types::ControlledDof::Translation(1),
        name: "y".to_owned(),
        directions,
        we_sign: -1,
        next_in_secs: None,
    });
    display_frame.target.locked = true;
    topics.publish(&display_frame);

    let mut app = Client::connect(&server);
    handshake(&mut app);
    let before: BTreeMap<String, Json> = app
        .drain_messages()
        .into_iter()
        .map(|message| (message["topic"].as_str().unwrap().to_owned(), message["msg"]["data"].clone()))
        .collect();
    assert_eq!(before["/mode"], 8);
    assert_eq!(before["/selection_frozen"], true);
    assert_eq!(before["/grasp_status"], false);
    assert!(!before.contains_key("/success"));

    display_frame.hand.state = HandState::Closed;
    display_frame.events =
        vec![Event { time: SimTime(1), kind: EventKind::ObjectAttached { object: ObjectId(0) } }];
    display_frame.hand.held_object = Some(ObjectId(0));
    topics.publish(&display_frame);
    let got = read_frame(&mut app, "/success");
    assert_eq!(got["/grasp_status"]["data"], true);
    assert_eq!(got["/success"]["data"], true);
    assert!(!got.contains_key("/mode") && !got.contains_key("/selection_frozen"));
    assert!(!got.contains_key("/current_block"), "no marker while the hand holds a block");
}

#[test]
fn gaze_and_head_of_the_app_and_a_classifiers_gestures_reach_the_trial() {
    let (server, bus) = server();
    let arm = proact_description::mpl_right_arm();
    let topics = HeadsetTopics::new(Arc::clone(&bus), &arm, &scene(), head()).unwrap();
    let mut app = Client::connect(&server);
    handshake(&mut app);
    let header = json!({"seq": 1, "stamp": {"secs": 1_700_000_000, "nsecs": 5_000_000}, "frame_id": ""});
    let of_head =
        json!({"seq": 1, "stamp": {"secs": 1_700_000_000, "nsecs": 5_000_000}, "frame_id": "Unity"});
    publish(&mut app, "/gaze_position", json!({"header": header, "vector": {"x": 0.1, "y": 0.2, "z": -0.1}}));
    publish(&mut app, "/gaze_direction", json!({"header": header, "vector": {"x": 1.0, "y": 0.0, "z": 0.0}}));
    let turned = json!({"x": 0.0, "y": 0.0, "z": 1.0, "w": 0.0});
    let position = json!({"x": 0.1, "y": 0.2, "z": -0.1});
    publish(
        &mut app,
        "/hololens/head",
        json!({"header": of_head, "pose": {"position": position, "orientation": turned}}),
    );
    publish(&mut app, "/gaze_target_object", json!({"data": "redcylinder1"}));
    app.drain_messages();
    let mut armband = Client::connect(&server);
    armband.advertise("/emg", "std_msgs/String");
    armband.publish("/emg", json!({"data": "wrist_flexion"}));
    armband.drain_messages();

    let world_from_unity =
        Pose::from_parts(head().translation, UnitQuaternion::from_euler_angles(0.0, 0.0, 0.3));
    let eye = Point3::new(0.1, 0.2, -0.1);
    let inputs = topics.drain_inputs();
    let [
        HeadsetInput::Gaze(gaze),
        HeadsetInput::Head(pose),
        HeadsetInput::Gesture(gesture),
        HeadsetInput::Heartbeat,
    ] = inputs[..]
    else {
        panic!("{inputs:?}");
    };
    assert!((gaze.origin - world_from_unity * eye).norm() < 1e-12);
    assert!((gaze.direction - world_from_unity.rotation * Vector::x()).norm() < 1e-12);
    let expected = world_from_unity
        * Pose::from_parts(
            Translation3::from(eye.coords),
            UnitQuaternion::from_euler_angles(0.0, 0.0, std::f64::consts::PI),
        );
    assert!(close(&pose, &expected), "{pose} {expected}");
    assert_eq!(gesture, Command::WristFlexion);

    // Where the world was fixed is told back, and used from then on.
    app.send(json!({"op": "call_service", "id": "fix", "service": "/fix_world", "args": {"fixWorld": true}}));
    let answer = app.next();
    assert_eq!((&answer["op"], &answer["result"]), (&json!("service_response"), &json!(true)));
    topics.publish(&frame(head()));
    let got = read_frame(&mut app, "/rosworld_pose_msg");
    let unity_from_world = ros(unity(&got["/rosworld_pose_msg"]));
    let values = &answer["values"];
    let number = |name: &str| values[name].as_f64().unwrap();
    let turn = Quaternion::new(number("qw"), number("qx"), number("qy"), number("qz"));
    let reported_pose = Pose::from_parts(
        Translation3::new(number("x"), number("y"), number("z")),
        UnitQuaternion::from_quaternion(turn),
    );
    assert!(close(&unity_from_world.inverse(), &reported_pose));
}

/// Between two trials nothing is published.
#[test]
fn who_comes_after_the_end_of_a_trial_gets_its_last_state() {
    let (server, bus) = server();
    let arm = proact_description::mpl_right_arm();
    let topics = HeadsetTopics::new(Arc::clone(&bus), &arm, &scene(), head()).unwrap();
    let display_frame = frame(head());
    topics.publish(&display_frame);
    let mut late = Client::connect(&server);
    handshake(&mut late);
    let came: Vec<String> =
        late.drain_messages().iter().map(|message| message["topic"].as_str().unwrap().to_owned()).collect();
    for (topic, _) in &IN[..7] {
        assert_eq!(came.iter().filter(|came| came == topic).count(), 1, "{topic}: {came:?}");
    }
    // Blocks that the next trial has not are nowhere.
    let mut fewer = scene();
    fewer.objects.truncate(1);
    topics.restart(&fewer, head()).unwrap();
    let mut later = Client::connect(&server);
    later.send(json!({"op": "subscribe", "topic": "/blue_block2_pose_msg"}));
    later.send(json!({"op": "subscribe", "topic": "/red_block1_pose_msg"}));
    let came = later.drain_messages();
    assert!(
        came.iter().all(|message| message["topic"] == "/red_block1_pose_msg") && came.len() == 1,
        "{came:?}"
    );
}
