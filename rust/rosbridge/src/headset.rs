//! The trial under the topics of the original headset app, and the app's gaze, head and gestures.
//!
//! Published at each [`HeadsetTopics::publish`], all of one instant and with its stamp (trial time): poses as
//! `geometry_msgs/PoseStamped` in the frame `hololens_world_test`, which is the app's world in ROS axes (x ahead,
//! y left, z up); joint states sorted by name, wrapped to (-pi, pi]; marker and place. On change, and latched for
//! who comes late: `/mode`, `/selection_frozen`, `/grasp_status`. On change only: `/success`.

use crate::{
    bus::{BusError, MemberId, TopicBus, TopicMessage, TopicSink},
    headset_input::HeadsetInbox,
    services::FunctionService,
};
use nalgebra::{Translation3, UnitQuaternion};
use proact_arm::ArmModel;
use proact_messages::original::topic;
use proact_messages::{MessageType, MessageValue, Time, builtin_type, original};
use proact_types::{DisplayFrame, EventKind, HandState, Object, Point, Pose, Scene};
use serde_json::json;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

pub use crate::headset_input::HeadsetInput;

/// Topics that keep their last message for who comes late.
const LATCHED: [(&str, &str); 3] = [
    (topic::MODE, "std_msgs/Int8"),
    (topic::SELECTION_FROZEN, "std_msgs/Bool"),
    (topic::GRASP_STATUS, "std_msgs/Bool"),
];
const POSE: &str = "geometry_msgs/PoseStamped";
const TEXT: &str = "std_msgs/String";
const BOOL: &str = "std_msgs/Bool";
/// The app's world, and the frame of all poses.
const FRAME: &str = "hololens_world_test";
/// Longest way from the head's place at the start of the trial that a tracked head or shoulder is believed, metres.
const MAX_HEAD_DISTANCE_M: f64 = 3.0;

/// A trial's topics on a bus.
pub struct HeadsetTopics {
    bus: Arc<dyn TopicBus>,
    member: MemberId,
    /// Names of the moving joints, each with its place in the frame's joint vector, sorted by name.
    joints: Vec<(String, usize)>,
    /// Names of the objects' models, and topics of their poses, in the order of the scene.
    objects: Mutex<Vec<(String, String)>>,
    inbox: Arc<HeadsetInbox>,
    published: Mutex<PublishedState>,
}

/// What has been said already.
#[derive(Default)]
struct PublishedState {
    sequence: u32,
    mode: Option<u8>,
    frozen: Option<bool>,
    hand: Option<HandState>,
}

impl HeadsetTopics {
    /// Joins the bus as `/proact`, advertises all topics, subscribes to the app's, and offers `/fix_world`.
    ///
    /// `world_from_head` is the head's pose at the start: the app's world begins there, level, looking where the
    /// head looks. `/fix_world` sets it anew from where the app says that the head is.
    ///
    /// # Errors
    /// [`BusError`] if somebody else uses these topics for other types.
    pub fn new(
        bus: Arc<dyn TopicBus>,
        arm: &ArmModel,
        scene: &Scene,
        world_from_head: Pose,
    ) -> Result<HeadsetTopics, BusError> {
        let member = bus.join("/proact");
        let mut joints: Vec<(String, usize)> =
            arm.moving().enumerate().map(|(index, joint)| (arm.joints[joint].name.clone(), index)).collect();
        joints.sort();
        let inbox = Arc::new(HeadsetInbox::new(world_from_head, MAX_HEAD_DISTANCE_M));
        let topics = HeadsetTopics {
            bus,
            member,
            joints,
            objects: Mutex::default(),
            inbox,
            published: Mutex::default(),
        };
        topics.advertise()?;
        topics.advertise_objects(scene)?;
        Ok(topics)
    }

    fn advertise(&self) -> Result<(), BusError> {
        for (topic, kind) in LATCHED {
            self.bus.advertise(self.member, topic, kind, true)?;
        }
        // Who comes between two trials sees how the last one ended.
        for topic in [topic::WORLD_POSE, topic::BASE_POSE] {
            self.bus.advertise(self.member, topic, POSE, true)?;
        }
        let joints = topic::WRAPPED_JOINT_STATES;
        self.bus.advertise(self.member, joints, "sensor_msgs/JointState", true)?;
        self.bus.advertise(self.member, topic::PLACE_LOCATION, POSE, false)?;
        self.bus.advertise(self.member, topic::CURRENT_BLOCK, TEXT, false)?;
        self.bus.advertise(self.member, topic::SUCCESS, BOOL, false)?;
        for (topic, kind) in HeadsetInbox::TOPICS {
            let sink: Arc<dyn TopicSink> = Arc::<HeadsetInbox>::clone(&self.inbox);
            self.bus.subscribe(self.member, topic, Some(kind), sink)?;
        }
        let inbox = Arc::clone(&self.inbox);
        let fix_world = move |_: &serde_json::Value| {
            let pose = inbox.fix_world()?;
            let (p, q) = (pose.translation.vector, pose.rotation);
            Ok(json!({"x": p.x, "y": p.y, "z": p.z, "qx": q.i, "qy": q.j, "qz": q.k, "qw": q.w}))
        };
        let provider = Arc::new(FunctionService(fix_world));
        self.bus.advertise_service(self.member, "/fix_world", "shoulder_localization/fixWorld", provider)?;
        self.bus.publish(&[self.bool_message(topic::GRASP_STATUS, false)]);
        Ok(())
    }

    /// These objects are there from now on.
    fn advertise_objects(&self, scene: &Scene) -> Result<(), BusError> {
        let named =
            |object: &Object| (object.ros_name.clone(), original::object_pose_topic(&object.ros_name));
        let objects: Vec<(String, String)> = scene.objects.iter().map(named).collect();
        for (_, topic) in &objects {
            self.bus.advertise(self.member, topic, POSE, true)?;
        }
        let mut displayed_objects = self.objects.lock().unwrap_or_else(PoisonError::into_inner);
        let before = std::mem::replace(&mut *displayed_objects, objects.clone());
        drop(displayed_objects);
        // What lay on the table of an earlier trial is nowhere now.
        for (_, topic) in before.iter().filter(|old| !objects.contains(old)) {
            self.bus.unadvertise(self.member, topic)?;
        }
        Ok(())
    }

    /// Another trial begins before `scene`: the head is there now. The app's world stays where it is.
    ///
    /// # Errors
    /// [`BusError`] if somebody else uses the topic of an object for another type.
    pub fn restart(&self, scene: &Scene, world_from_head: Pose) -> Result<(), BusError> {
        self.advertise_objects(scene)?;
        self.inbox.restart(world_from_head);
        let mut sent = self.lock_published();
        *sent = PublishedState { sequence: sent.sequence, ..PublishedState::default() };
        drop(sent);
        self.bus.publish(&[self.bool_message(topic::GRASP_STATUS, false)]);
        Ok(())
    }

    /// Publishes an instant.
    pub fn publish(&self, frame: &DisplayFrame) {
        let unity_from_world = self.inbox.world_from_unity().inverse();
        let mut sent = self.lock_published();
        sent.sequence = sent.sequence.wrapping_add(1);
        let header = header(sent.sequence, frame_time(frame));
        let pose = |topic: &str, world_from_thing: &Pose| {
            stamped_pose(topic, &header, &(unity_from_world * world_from_thing))
        };
        let mut messages =
            vec![pose(topic::WORLD_POSE, &Pose::identity()), pose(topic::BASE_POSE, &frame.world_from_base)];
        let objects = self.objects.lock().unwrap_or_else(PoisonError::into_inner).clone();
        messages.extend(objects.iter().zip(&frame.objects).map(|((_, topic), object)| pose(topic, object)));
        messages.push(self.joint_states(&header, frame));
        if let Some(place_point) = &frame.target.place {
            // The app wants the disc level in its own world, as the original sent it.
            let place_point: Point = unity_from_world * place_point;
            let level = Pose::from_parts(Translation3::from(place_point.coords), UnitQuaternion::identity());
            messages.push(stamped_pose(topic::PLACE_LOCATION, &header, &level));
        }
        let marked = frame.target.object.filter(|_| frame.hand.held_object.is_none());
        if let Some((name, _)) = marked.and_then(|object| objects.get(object.index())) {
            messages.push(string_message(topic::CURRENT_BLOCK, name));
        }
        self.push_changes(frame, &mut sent, &mut messages);
        drop(sent);
        self.bus.publish(&messages);
    }

    /// What is only said when it changes.
    fn push_changes(
        &self,
        frame: &DisplayFrame,
        sent: &mut PublishedState,
        messages: &mut Vec<Arc<TopicMessage>>,
    ) {
        for event in &frame.events {
            match event.kind {
                EventKind::ObjectAttached { .. } => {
                    messages.push(self.bool_message(topic::GRASP_STATUS, true))
                }
                EventKind::ObjectReleased { .. } => {
                    messages.push(self.bool_message(topic::GRASP_STATUS, false))
                }
                _ => {}
            }
        }
        let mode = frame.mode.as_ref().map(|mode| original::mode_number(mode.controlled_dof));
        if let Some(number) = mode
            && sent.mode != mode
        {
            messages.push(data_message(topic::MODE, "std_msgs/Int8", MessageValue::Int(number.into())));
            sent.mode = mode;
        }
        let frozen = Some(frame.target.locked);
        if sent.frozen != frozen {
            messages.push(self.bool_message(topic::SELECTION_FROZEN, frame.target.locked));
            sent.frozen = frozen;
        }
        // The original says so when a hand command returns: true for a close, false for an open.
        match (sent.hand, frame.hand.state) {
            (Some(before), now @ (HandState::Closed | HandState::Open)) if before != now => {
                messages.push(self.bool_message(topic::SUCCESS, now == HandState::Closed));
            }
            _ => {}
        }
        sent.hand = Some(frame.hand.state);
    }

    /// What the app and other clients brought since the last call, oldest first.
    pub fn drain_inputs(&self) -> Vec<HeadsetInput> {
        self.inbox.drain(std::time::Instant::now())
    }

    fn lock_published(&self) -> MutexGuard<'_, PublishedState> {
        // No code that holds the lock can panic half way through a change.
        self.published.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn bool_message(&self, topic: &str, value: bool) -> Arc<TopicMessage> {
        data_message(topic, BOOL, MessageValue::Bool(value))
    }

    fn joint_states(&self, header: &MessageValue, frame: &DisplayFrame) -> Arc<TopicMessage> {
        let name = |(name, _): &(String, usize)| MessageValue::Text(name.clone());
        let angle =
            |(_, index): &(String, usize)| wrap_angle(frame.joints.get(*index).copied().unwrap_or(f64::NAN));
        let fields = [
            ("header", header.clone()),
            ("name", MessageValue::List(self.joints.iter().map(name).collect())),
            ("position", MessageValue::Floats(self.joints.iter().map(angle).collect())),
            ("velocity", MessageValue::Floats(Vec::new())),
            ("effort", MessageValue::Floats(Vec::new())),
        ];
        let kind = builtin_type("sensor_msgs/JointState");
        TopicMessage::new(topic::WRAPPED_JOINT_STATES, kind, message_value(fields))
    }
}

impl Drop for HeadsetTopics {
    fn drop(&mut self) {
        self.bus.leave(self.member);
    }
}

/// An angle in (-pi, pi].
fn wrap_angle(angle: f64) -> f64 {
    use std::f64::consts::{PI, TAU};
    let turned = (angle + PI).rem_euclid(TAU) - PI;
    if turned == -PI { PI } else { turned }
}

pub(super) fn frame_time(frame: &DisplayFrame) -> Time {
    let ticks = frame.time.0;
    // Ticks are milliseconds; a trial is minutes long.
    Time { secs: (ticks / 1000) as u32, nsecs: (ticks % 1000) as u32 * 1_000_000 }
}

pub(super) fn message_value<const N: usize>(fields: [(&str, MessageValue); N]) -> MessageValue {
    MessageValue::Message(fields.into_iter().map(|(name, value)| (name.into(), value)).collect())
}

fn header(sequence: u32, stamp: Time) -> MessageValue {
    message_value([
        ("seq", MessageValue::Uint(sequence.into())),
        ("stamp", MessageValue::Time(stamp)),
        ("frame_id", MessageValue::Text(FRAME.to_owned())),
    ])
}

fn data_message(topic: &str, type_name: &str, data: MessageValue) -> Arc<TopicMessage> {
    let kind: Option<Arc<MessageType>> = builtin_type(type_name);
    TopicMessage::new(topic, kind, message_value([("data", data)]))
}

fn string_message(topic: &str, data: &str) -> Arc<TopicMessage> {
    data_message(topic, TEXT, MessageValue::Text(data.to_owned()))
}

pub(super) fn stamped_pose(topic: &str, header: &MessageValue, pose: &Pose) -> Arc<TopicMessage> {
    let (p, q) = (pose.translation.vector, pose.rotation);
    let number = MessageValue::Float;
    let position = message_value([("x", number(p.x)), ("y", number(p.y)), ("z", number(p.z))]);
    let orientation =
        message_value([("x", number(q.i)), ("y", number(q.j)), ("z", number(q.k)), ("w", number(q.w))]);
    let content = message_value([("position", position), ("orientation", orientation)]);
    TopicMessage::new(
        topic,
        builtin_type(POSE),
        message_value([("header", header.clone()), ("pose", content)]),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn angles_are_wrapped_into_one_turn() {
        use std::f64::consts::PI;
        for (angle, expected) in
            [(0.0, 0.0), (PI, PI), (-PI, PI), (3.5 * PI, -0.5 * PI), (-1.25 * PI, 0.75 * PI)]
        {
            assert!((wrap_angle(angle) - expected).abs() < 1e-12, "{angle}");
        }
    }

    #[test]
    fn every_message_agrees_with_its_definition() {
        let header = header(1, Time { secs: 2, nsecs: 3 });
        let pose = Pose::translation(1.0, 2.0, 3.0);
        for message in [
            stamped_pose("/a", &header, &pose),
            string_message("/b", "x"),
            data_message("/c", BOOL, MessageValue::Bool(true)),
        ] {
            let json = serde_json::to_value(&message.value).unwrap();
            let kind = message.definition.clone().unwrap();
            assert_eq!(kind.parse_json(json, Time::default()).unwrap(), message.value);
        }
    }
}
