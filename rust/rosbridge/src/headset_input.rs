//! What clients of rosbridge bring to a trial: gaze, head, shoulder and gestures, checked at the door.

use crate::bus::{TopicMessage, TopicSink};
use nalgebra::{Quaternion, Translation3, UnitQuaternion};
use proact_messages::MessageValue;
use proact_messages::original::topic;
use proact_types::{Command, GazeSample, Point, Pose, Vector};
use std::{
    sync::{Arc, Mutex, MutexGuard, PoisonError},
    time::{Duration, Instant},
};

/// What came in from a client of rosbridge. All numbers are finite and within sane bounds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum HeadsetInput {
    /// The gesture in force from now on.
    Gesture(Command),
    /// Where the person looks, in `world`.
    Gaze(GazeSample),
    /// `world_from_head`.
    Head(Pose),
    /// `world_from_shoulder`: where the arm's base is to go.
    Shoulder(Pose),
    /// A gesture came, new or the one in force once more.
    Heartbeat,
}

/// A gesture is released when its source is silent for longer. The testbed, which is told of each message, stops the
/// arm much sooner.
const GESTURE_TIMEOUT: Duration = Duration::from_millis(500);
/// A gaze direction belongs to an eye position that is not older.
const MAX_GAZE_LAG: Duration = Duration::from_millis(200);
/// Most inputs kept for a trial that does not fetch them.
const MAX_WAITING: usize = 512;

/// Collects inputs.
pub(super) struct HeadsetInbox {
    state: Mutex<State>,
    max_distance_m: f64,
}

struct State {
    world_from_unity: Pose,
    /// The trial's head at its start.
    start: Pose,
    /// The head as the app has it.
    unity_from_head: Option<Pose>,
    eye: Option<(Instant, Point)>,
    gesture: Option<(Instant, Command)>,
    waiting: Vec<HeadsetInput>,
}

impl HeadsetInbox {
    /// Topics that are listened to, with their types.
    pub(super) const TOPICS: [(&'static str, &'static str); 5] = [
        (topic::GAZE_POSITION, "geometry_msgs/Vector3Stamped"),
        (topic::GAZE_DIRECTION, "geometry_msgs/Vector3Stamped"),
        (topic::HEAD, "geometry_msgs/PoseStamped"),
        // How the original's own tracking moves the arm's base: a pose in the simulation's world.
        (topic::SET_LINK_STATE, "gazebo_msgs/LinkState"),
        (topic::EMG, "std_msgs/String"),
    ];

    pub(super) fn new(world_from_head: Pose, max_distance: f64) -> Self {
        let state = State {
            world_from_unity: yaw_only(&world_from_head),
            start: world_from_head,
            unity_from_head: None,
            eye: None,
            gesture: None,
            waiting: Vec::new(),
        };
        HeadsetInbox { state: Mutex::new(state), max_distance_m: max_distance }
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        // No code that holds the lock can panic half way through a change.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(super) fn restart(&self, world_from_head: Pose) {
        let mut state = self.lock();
        state.start = world_from_head;
        state.waiting.clear();
        state.gesture = None;
    }

    pub(super) fn world_from_unity(&self) -> Pose {
        self.lock().world_from_unity
    }

    /// Puts the app's world so that its head is where the trial's head started; the new `world_from_unity`.
    pub(super) fn fix_world(&self) -> Result<Pose, String> {
        let mut state = self.lock();
        let head = state.unity_from_head.ok_or("no /hololens/head has come yet")?;
        state.world_from_unity = yaw_only(&state.start) * yaw_only(&head).inverse();
        Ok(state.world_from_unity)
    }

    /// Everything since the last call, oldest first; a gesture whose source fell silent is released.
    pub(super) fn drain(&self, now: Instant) -> Vec<HeadsetInput> {
        let mut state = self.lock();
        if let Some((received_at, command)) = state.gesture
            && now.saturating_duration_since(received_at) > GESTURE_TIMEOUT
        {
            state.gesture = None;
            if command != Command::NoMotion {
                state.push(HeadsetInput::Gesture(Command::NoMotion));
            }
        }
        std::mem::take(&mut state.waiting)
    }

    fn receive(&self, topic: &str, value: &MessageValue, now: Instant) {
        let mut state = self.lock();
        match topic {
            topic::GAZE_POSITION => {
                let eye = value.get("vector").and_then(vector);
                state.eye = eye.map(|eye| (now, state.world_from_unity * Point::from(eye)));
            }
            topic::GAZE_DIRECTION => state.receive_gaze_direction(value, now),
            topic::HEAD => {
                let Some(head) = value.get("pose").and_then(pose) else { return };
                state.unity_from_head = Some(head);
                let head = state.world_from_unity * head;
                if state.is_near(&head, self.max_distance_m) {
                    state.push(HeadsetInput::Head(head));
                }
            }
            topic::SET_LINK_STATE => {
                let name = value.get("link_name").and_then(MessageValue::as_text).unwrap_or_default();
                let frame = value.get("reference_frame").and_then(MessageValue::as_text).unwrap_or_default();
                let Some(shoulder) = value.get("pose").and_then(pose) else { return };
                let ours = name.ends_with("base_link") && matches!(frame, "" | "world");
                if ours && state.is_near(&shoulder, self.max_distance_m) {
                    state.push(HeadsetInput::Shoulder(shoulder));
                }
            }
            topic::EMG => {
                let text = value.get("data").and_then(MessageValue::as_text).unwrap_or_default();
                let Ok(command) = text.parse::<Command>() else { return };
                let before = state.gesture.replace((now, command)).map(|(_, before)| before);
                if before != Some(command) {
                    state.push(HeadsetInput::Gesture(command));
                }
                state.push(HeadsetInput::Heartbeat);
            }
            _ => {}
        }
    }
}

impl State {
    /// A direction; with the eye's place it is a gaze sample. The app sends both in each of its frames.
    fn receive_gaze_direction(&mut self, value: &MessageValue, now: Instant) {
        let Some((seen, origin)) = self.eye else { return };
        let direction = value.get("vector").and_then(vector);
        let Some(direction) = direction.filter(|direction| direction.norm() > 1e-6) else { return };
        if now.saturating_duration_since(seen) <= MAX_GAZE_LAG {
            let direction = (self.world_from_unity.rotation * direction).normalize();
            self.push(HeadsetInput::Gaze(GazeSample { origin, direction, valid: true }));
        }
    }

    fn is_near(&self, pose: &Pose, max_distance: f64) -> bool {
        (pose.translation.vector - self.start.translation.vector).norm() <= max_distance
    }

    fn push(&mut self, input: HeadsetInput) {
        // Of samples of one kind only the last one counts; gestures all do.
        if !matches!(input, HeadsetInput::Gesture(_)) {
            let kind = std::mem::discriminant(&input);
            self.waiting.retain(|other| std::mem::discriminant(other) != kind);
        } else if self.waiting.len() >= MAX_WAITING {
            // Nobody fetches. What has piled up is stale, so it goes, and a stop stands in for it.
            self.waiting.clear();
            self.waiting.push(HeadsetInput::Gesture(Command::NoMotion));
        }
        self.waiting.push(input);
    }
}

impl TopicSink for HeadsetInbox {
    fn deliver(&self, message: &Arc<TopicMessage>) {
        self.receive(&message.topic, &message.value, Instant::now());
    }

    /// The trial fetches when it has time.
    fn wake(&self) {}
}

/// The pose with its turn about the vertical alone.
fn yaw_only(pose: &Pose) -> Pose {
    let ahead = pose.rotation * Vector::x();
    let turn = UnitQuaternion::from_axis_angle(&Vector::z_axis(), ahead.y.atan2(ahead.x));
    Pose::from_parts(pose.translation, turn)
}

/// A vector of finite numbers below a hundred metres.
fn vector(value: &MessageValue) -> Option<Vector> {
    let number = |name| value.get(name).and_then(MessageValue::as_f64).filter(|x| x.abs() <= 100.0);
    Some(Vector::new(number("x")?, number("y")?, number("z")?))
}

fn pose(value: &MessageValue) -> Option<Pose> {
    let position = value.get("position").and_then(vector)?;
    let q = value.get("orientation")?;
    let number = |name| q.get(name).and_then(MessageValue::as_f64);
    let q = Quaternion::new(number("w")?, number("x")?, number("y")?, number("z")?);
    // A turn is written as a unit quaternion; anything else is no turn.
    let turn = ((q.norm() - 1.0).abs() < 1e-2).then(|| UnitQuaternion::from_quaternion(q))?;
    Some(Pose::from_parts(Translation3::from(position), turn))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proact_messages::{Time, builtin_type};
    use serde_json::{Value as Json, json};

    fn inbox() -> HeadsetInbox {
        // The head is at the origin of the app's world, turned left by a quarter in ours and nodding.
        let turn = UnitQuaternion::from_euler_angles(0.0, 0.3, std::f64::consts::FRAC_PI_2);
        HeadsetInbox::new(Pose::from_parts(Translation3::new(-0.5, 0.0, 1.6), turn), 3.0)
    }

    fn give(inbox: &HeadsetInbox, topic: &str, json: Json, at: Instant) {
        let kind = HeadsetInbox::TOPICS.iter().find(|(name, _)| *name == topic).unwrap().1;
        let value = builtin_type(kind).unwrap().parse_json(json, Time::default()).unwrap();
        inbox.receive(topic, &value, at);
    }

    fn gaze(inbox: &HeadsetInbox, at: Instant) {
        give(inbox, "/gaze_position", json!({"vector": {"x": 1.0, "y": 0.0, "z": 0.0}}), at);
        give(inbox, "/gaze_direction", json!({"vector": {"x": 0.0, "y": 0.0, "z": -1.0}}), at);
    }

    #[test]
    fn gaze_is_turned_from_the_apps_world_into_ours() {
        let inbox = inbox();
        gaze(&inbox, Instant::now());
        let inputs = inbox.drain(Instant::now());
        let [HeadsetInput::Gaze(sample)] = inputs[..] else { panic!("{inputs:?}") };
        assert!((sample.origin - Point::new(-0.5, 1.0, 1.6)).norm() < 1e-12, "{sample:?}");
        assert!((sample.direction - Vector::new(0.0, 0.0, -1.0)).norm() < 1e-12, "{sample:?}");
    }

    #[test]
    fn a_direction_without_a_fresh_eye_is_no_gaze() {
        let inbox = inbox();
        let now = Instant::now();
        give(&inbox, "/gaze_direction", json!({"vector": {"x": 1.0}}), now);
        give(&inbox, "/gaze_position", json!({"vector": {"x": 1.0}}), now);
        give(&inbox, "/gaze_direction", json!({"vector": {"x": 1.0}}), now + MAX_GAZE_LAG * 2);
        give(&inbox, "/gaze_direction", json!({"vector": {}}), now);
        assert_eq!(inbox.drain(now), []);
    }

    #[test]
    fn nonsense_is_left_out() {
        let inbox = inbox();
        let now = Instant::now();
        for (topic, json) in [
            ("/hololens/head", json!({"pose": {"position": {"x": 1.0}}})),
            ("/hololens/head", json!({"pose": {"position": {"x": null}, "orientation": {"w": 1}}})),
            ("/hololens/head", json!({"pose": {"position": {"x": 50.0}, "orientation": {"w": 1}}})),
            (
                "/gazebo/set_link_state",
                json!({"link_name": "m::base_link", "pose": {"orientation": {"w": 3.0}}}),
            ),
            ("/gazebo/set_link_state", json!({"link_name": "other", "pose": {"orientation": {"w": 1.0}}})),
            ("/emg", json!({"data": "wave"})),
        ] {
            give(&inbox, topic, json, now);
        }
        assert_eq!(inbox.drain(now), []);
    }

    #[test]
    fn a_gesture_is_handed_on_once_and_released_when_its_source_falls_silent() {
        let inbox = inbox();
        let start = Instant::now();
        let at = |ms| start + Duration::from_millis(ms);
        for ms in [0, 50, 100] {
            give(&inbox, "/emg", json!({"data": "wrist_extension"}), at(ms));
        }
        let first = [HeadsetInput::Gesture(Command::WristExtension), HeadsetInput::Heartbeat];
        assert_eq!(inbox.drain(at(100)), first);
        assert_eq!(inbox.drain(at(590)), []);
        assert_eq!(inbox.drain(at(610)), [HeadsetInput::Gesture(Command::NoMotion)]);
        assert_eq!(inbox.drain(at(2000)), []);
    }

    #[test]
    fn fixing_the_world_puts_the_apps_head_where_the_trial_has_it() {
        let inbox = inbox();
        assert!(inbox.fix_world().unwrap_err().contains("/hololens/head"));
        let head = json!({"pose": {"position": {"x": 0.4, "y": -0.2, "z": 0.1}, "orientation": {"w": 1.0}}});
        give(&inbox, "/hololens/head", head.clone(), Instant::now());
        inbox.fix_world().unwrap();
        inbox.drain(Instant::now());
        give(&inbox, "/hololens/head", head, Instant::now());
        let inputs = inbox.drain(Instant::now());
        let [HeadsetInput::Head(pose)] = inputs[..] else { panic!("{inputs:?}") };
        assert!((pose.translation.vector - Vector::new(-0.5, 0.0, 1.6)).norm() < 1e-12, "{pose}");
    }

    #[test]
    fn an_inbox_that_nobody_empties_stays_small_and_ends_with_a_stop() {
        let inbox = inbox();
        let now = Instant::now();
        for n in 0..5000 {
            gaze(&inbox, now);
            let word = if n % 2 == 0 { "hand_close" } else { "hand_open" };
            give(&inbox, "/emg", json!({"data": word}), now);
        }
        let inputs = inbox.drain(now);
        assert!(
            inputs.len() <= MAX_WAITING + 3 && inputs.contains(&HeadsetInput::Gesture(Command::NoMotion))
        );
    }
}
