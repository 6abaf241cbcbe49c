//! A trial as ROS topics, under the original's names.
//!
//! | topic | type | when |
//! |---|---|---|
//! | `/clock` | `rosgraph_msgs/Clock` | each frame |
//! | `/tf` | `tf2_msgs/TFMessage` | each frame: `world` to base and objects; each state: the moving links |
//! | `/tf_static` | `tf2_msgs/TFMessage` | once, latched: the fixed links |
//! | `/mpl_right_arm/wrapped_joint_states` | `sensor_msgs/JointState` | each state (50 Hz), joints by alphabet as in the original |
//! | `/proact/stop_efforts` | `sensor_msgs/JointState` | each state: what stops and braking gears bear beside the motors, N m; the motors' own torques are in the joint states |
//! | `/gazebo/model_states` | `gazebo_msgs/ModelStates` | each state: arm and objects |
//! | `/mpl_right_arm/base_pose`, `/red_block1_pose_msg` and so on, an object each | `geometry_msgs/PoseStamped` | each frame |
//! | `/hololens_unity_camera_pose_ros` | `geometry_msgs/PoseStamped` | each frame: the head |
//! | `/current_block` | `std_msgs/String` | each frame with a marked block while the hand is empty |
//! | `/block_id` | `std_msgs/String` | each frame of a method that infers: the likeliest block |
//! | `/place_location_selected` | `geometry_msgs/PoseStamped` | each frame with a place marker |
//! | `/success` | `std_msgs/Bool` | the hand has closed (true) or opened (false) |
//! | `/gaze_position`, `/gaze_direction`, both also with `_ros` | `geometry_msgs/Vector3Stamped` | each valid gaze sample |
//! | `/emg` | `std_msgs/String` | each decision |
//! | `/grasp_event_republisher/grasp_events` | `gazebo_grasp_plugin_ros/GazeboGraspEvent` | object attached, released |
//! | `/grasp_status`, `/selection_frozen` | `std_msgs/Bool` | attached or released, locked or unlocked |
//! | `/mpl_right_arm/arm_controller/command` | `trajectory_msgs/JointTrajectory` | each plan that takes effect |
//! | `/proact/cues` | `proact_msgs/View` | each thing to hear or feel, as JSON |
//! | `/rosout` | `rosgraph_msgs/Log` | start and stop of the trial, and every event as JSON |
//!
//! **Frames.** Everything is in `world` and says so in its header. In the original, the poses for the headset
//! (base, blocks, place marker) and `/gaze_position`, `/gaze_direction` are in the headset's own
//! `hololens_world_test`, partly with other or empty frame names. There is no headset frame here, so the
//! `_ros` topics, which the original has in `world`, equal those without.
//!
//! **Time.** Stamps are simulated time since the start of the trial plus [`BAG_EPOCH_SECS`]: no clock is read,
//! so equal trials give equal bags, byte for byte.

use super::{
    BagWriter,
    messages::{self as ros, RosMessage},
    state_messages::StateMessages,
};
use crate::RecordingError;
use proact_arm::{ArmModel, Joint, JointKind};
use proact_messages::original::{ARM_MODEL, topic};
use proact_messages::{Duration, Time, original};
use proact_types::{
    BodyState, Command, DisplayFrame, Event, EventKind, FeedbackCue, GazeSample, HandState, ObjectId,
    PlanReply, PlantState, Pose, Scene, SimTime,
};
use std::{
    f64::consts::{PI, TAU},
    fs::File,
    path::{Path, PathBuf},
};

/// Seconds on the bag's clock at the start of a trial.
///
/// ROS time must be above zero to count as set, and tools subtract durations from it (tf buffers 10 s), so it
/// starts well above.
pub const BAG_EPOCH_SECS: u32 = 1000;

const WORLD_FRAME: &str = "world";
/// `rosgraph_msgs/Log.INFO`.
const LOG_LEVEL_INFO: i8 = 2;

/// Writes a trial's bag while it runs. Until [`TrialBag::finish`] it is called as in the end, with `.active`.
#[derive(Debug)]
pub struct TrialBag {
    bag: BagWriter,
    base_link: String,
    /// Moving joints as the state orders them.
    moving_joints: Vec<Joint>,
    /// Positions in `moving`, by the joints' names.
    alphabetical_joints: Vec<usize>,
    /// Names of the arm joints, base to tip.
    arm_joints: Vec<String>,
    /// Names of the objects' models, and topics of their poses, in the order of the scene.
    objects: Vec<(String, String)>,
    hand: Option<HandState>,
    /// The messages of a state, which is recorded most often: from one to the next only times and numbers change.
    state: StateMessages,
}

impl TrialBag {
    /// Compresses what is written from now on: a sixth of the size.
    pub fn enable_compression(&mut self) {
        self.bag.enable_compression();
    }

    /// Starts the bag `path` with the start mark and the fixed links of `arm`, before the objects of `scene`.
    ///
    /// # Errors
    /// [`RecordingError::Io`] if there is one already or it cannot be written.
    pub fn create(path: &Path, arm: &ArmModel, scene: &Scene) -> Result<Self, RecordingError> {
        let link = |index: usize| arm.links[index].name.clone();
        let moving: Vec<Joint> = arm.moving().map(|index| arm.joints[index].clone()).collect();
        let mut alphabetical: Vec<usize> = (0..moving.len()).collect();
        alphabetical.sort_by(|a, b| moving[*a].name.cmp(&moving[*b].name));
        let start = SimTime(0);
        let state = StateMessages::new(
            alphabetical.iter().map(|k| moving[*k].name.clone()).collect(),
            moving.iter().map(|j| transform(start, &link(j.parent), &link(j.child), &j.origin)).collect(),
            scene.objects.iter().map(|object| object.ros_name.clone()),
        );
        let mut bag = TrialBag {
            bag: BagWriter::create(path)?,
            base_link: arm.links.first().map(|l| l.name.clone()).unwrap_or_default(),
            moving_joints: moving,
            alphabetical_joints: alphabetical,
            arm_joints: arm.arm.iter().map(|index| arm.joints[*index].name.clone()).collect(),
            objects: scene
                .objects
                .iter()
                .map(|object| (object.ros_name.clone(), original::object_pose_topic(&object.ros_name)))
                .collect(),
            hand: None,
            state,
        };
        bag.write_log(start, "start-stop", "Start".to_owned())?;
        let transforms = arm
            .joints
            .iter()
            .filter(|j| j.kind == JointKind::Fixed)
            .map(|j| transform(start, &link(j.parent), &link(j.child), &j.origin))
            .collect();
        bag.bag.write("/tf_static", bag_time(start), &ros::TfMessage { transforms }, true)?;
        Ok(bag)
    }

    /// Records what was drawn. Call it for each frame, 60 times a second.
    ///
    /// The frame's events are not recorded here but by [`TrialBag::write_event`], its gaze by
    /// [`TrialBag::write_gaze`], its joints, with their speeds, by [`TrialBag::write_state`].
    ///
    /// # Errors
    /// [`RecordingError::WrongLength`] or [`RecordingError::NotFinite`] if the frame is malformed, and nothing of it
    /// is then recorded; [`RecordingError::Io`].
    pub fn write_frame(&mut self, frame: &DisplayFrame) -> Result<(), RecordingError> {
        let time = frame.time;
        check_length("object poses of a frame", frame.objects.len(), self.objects.len())?;
        for pose in [&frame.world_from_base, &frame.world_from_head].into_iter().chain(&frame.objects) {
            check_finite("a pose of a frame", time, pose_values(pose))?;
        }
        if let Some(place_point) = &frame.target.place {
            check_finite("the place marker of a frame", time, place_point.iter().copied())?;
        }

        self.write("/clock", time, &ros::Clock { clock: bag_time(time) })?;
        let objects = self.objects.iter().zip(&frame.objects);
        let transforms = std::iter::once((self.base_link.as_str(), &frame.world_from_base))
            .chain(objects.map(|((name, _), pose)| (name.as_str(), pose)))
            .map(|(child, pose)| transform(time, WORLD_FRAME, child, pose))
            .collect();
        self.write("/tf", time, &ros::TfMessage { transforms })?;
        self.write_pose(topic::BASE_POSE, time, &frame.world_from_base)?;
        for (k, pose) in frame.objects.iter().enumerate() {
            let topic = self.objects[k].1.clone();
            self.write_pose(&topic, time, pose)?;
        }
        self.write_pose(topic::HEAD_ROS, time, &frame.world_from_head)?;
        self.write_selection(frame)?;
        self.write_hand(time, frame.hand.state)
    }

    /// Records joints, links and models. Call it 50 times a second, as the original's topics run.
    ///
    /// Positions are wrapped to (-pi, pi] in the joint states, as in the original; velocities and motor torques are
    /// those of the simulation. The base is kinematic and has the twist zero in `/gazebo/model_states`.
    ///
    /// # Errors
    /// [`RecordingError::WrongLength`] or [`RecordingError::NotFinite`] if the state is malformed, and nothing of it
    /// is then recorded; [`RecordingError::Io`].
    pub fn write_state(&mut self, time: SimTime, state: &PlantState) -> Result<(), RecordingError> {
        for (what, values) in [
            ("joint positions of a state", &state.position),
            ("joint velocities of a state", &state.velocity),
            ("joint efforts of a state", &state.effort),
            ("stop efforts of a state", &state.limit_effort),
        ] {
            check_length(what, values.len(), self.moving_joints.len())?;
            check_finite(what, time, values.iter().copied())?;
        }
        check_length("objects of a state", state.objects.len(), self.objects.len())?;
        check_finite("the base pose of a state", time, pose_values(&state.world_from_base))?;
        for body in &state.objects {
            let twist = body.linear_velocity.iter().chain(&body.angular_velocity).copied();
            check_finite("an object of a state", time, pose_values(&body.pose).chain(twist))?;
        }

        let mut messages = std::mem::take(&mut self.state);
        let StateMessages { joints, limit_efforts: stops, links, models } = &mut messages;
        let stamp = bag_time(time);
        let refill = |to: &mut Vec<f64>, value: &dyn Fn(usize) -> f64| {
            to.clear();
            to.extend(self.alphabetical_joints.iter().map(|k| value(*k)));
        };
        (joints.header.stamp, stops.header.stamp) = (stamp, stamp);
        refill(&mut joints.position, &|k| wrap_angle(state.position[k]));
        refill(&mut joints.velocity, &|k| state.velocity[k]);
        refill(&mut joints.effort, &|k| state.effort[k]);
        refill(&mut stops.effort, &|k| state.limit_effort[k]);
        for ((link, joint), angle) in
            links.transforms.iter_mut().zip(&self.moving_joints).zip(&state.position)
        {
            link.header.stamp = stamp;
            link.transform = (&joint.transform_at(*angle)).into();
        }
        models.pose.clear();
        models.pose.push((&state.world_from_base).into());
        models.pose.extend(state.objects.iter().map(|body| ros::Pose::from(&body.pose)));
        models.twist.clear();
        models.twist.push(ros::Twist::default());
        let twist = |body: &BodyState| ros::Twist {
            linear: body.linear_velocity.into(),
            angular: body.angular_velocity.into(),
        };
        models.twist.extend(state.objects.iter().map(twist));
        let written = self
            .write(topic::WRAPPED_JOINT_STATES, time, joints)
            .and_then(|()| self.write("/proact/stop_efforts", time, stops))
            .and_then(|()| self.write("/tf", time, links))
            .and_then(|()| self.write(topic::MODEL_STATES, time, models));
        self.state = messages;
        written
    }

    /// Records a gaze sample. The original's messages have no sign for a lost eye, so a sample that is not
    /// valid is left out. The direction is recorded with length one.
    ///
    /// # Errors
    /// [`RecordingError::NotFinite`] for a valid sample that is none; [`RecordingError::Io`].
    pub fn write_gaze(&mut self, time: SimTime, gaze: &GazeSample) -> Result<(), RecordingError> {
        if !gaze.valid {
            return Ok(());
        }
        let direction = gaze.direction.normalize();
        check_finite("a gaze sample", time, gaze.origin.iter().chain(&direction).copied())?;
        for (topics, vector) in [
            ([topic::GAZE_POSITION, topic::GAZE_POSITION_ROS], gaze.origin.coords),
            ([topic::GAZE_DIRECTION, topic::GAZE_DIRECTION_ROS], direction),
        ] {
            for topic in topics {
                let message =
                    ros::Vector3Stamped { header: header(time, WORLD_FRAME), vector: vector.into() };
                self.write(topic, time, &message)?;
            }
        }
        Ok(())
    }

    /// Records the gesture in force. Call it for each decision, changed or not, as the original publishes it.
    ///
    /// # Errors
    /// [`RecordingError::Io`].
    pub fn write_emg(&mut self, time: SimTime, command: Command) -> Result<(), RecordingError> {
        self.write(topic::EMG, time, &ros::Text { data: command.ros_name().to_owned() })
    }

    /// Records a plan that took effect; one without a trajectory leaves nothing but its event.
    ///
    /// # Errors
    /// [`RecordingError::WrongLength`] or [`RecordingError::NotFinite`] if the trajectory is malformed;
    /// [`RecordingError::Io`].
    pub fn write_plan(&mut self, time: SimTime, reply: &PlanReply) -> Result<(), RecordingError> {
        if reply.trajectory.points.is_empty() {
            return Ok(());
        }
        let mut points = Vec::new();
        for point in &reply.trajectory.points {
            for (what, values) in [("angles of a plan", &point.q), ("speeds of a plan", &point.qd)] {
                check_length(what, values.len(), self.arm_joints.len())?;
                check_finite(what, time, values.iter().copied())?;
            }
            check_finite("a time of a plan", time, [point.time_secs])?;
            points.push(ros::JointTrajectoryPoint {
                positions: point.q.to_vec(),
                velocities: point.qd.to_vec(),
                time_from_start: ros_duration(point.time_secs),
                ..Default::default()
            });
        }
        let joint_names = self.arm_joints.clone();
        // In the original this header names the base, although joint angles have no frame.
        let header = header(time, &self.base_link);
        let message = ros::JointTrajectory { header, joint_names, points };
        self.write(topic::ARM_COMMAND, time, &message)
    }

    /// Records an event: on its own topic if the original has one, and always on `/rosout`.
    ///
    /// # Errors
    /// [`RecordingError::Io`].
    pub fn write_event(&mut self, event: &Event) -> Result<(), RecordingError> {
        let time = event.time;
        match &event.kind {
            EventKind::ObjectAttached { object: block } => self.write_grasp(time, *block, true)?,
            EventKind::ObjectReleased { object: block } => self.write_grasp(time, *block, false)?,
            EventKind::Locked { .. } => {
                self.write(topic::SELECTION_FROZEN, time, &ros::Bool { data: true })?;
            }
            EventKind::Unlocked => self.write(topic::SELECTION_FROZEN, time, &ros::Bool { data: false })?,
            _ => {}
        }
        let json = serde_json::to_string(&event.kind).map_err(RecordingError::encode("an event"))?;
        self.write_log(time, "proact", json)
    }

    /// Records what was to be heard or felt.
    ///
    /// # Errors
    /// [`RecordingError::Io`].
    pub fn write_cue(&mut self, cue: &FeedbackCue) -> Result<(), RecordingError> {
        let json = serde_json::to_string(cue).map_err(RecordingError::encode("a cue"))?;
        self.write("/proact/cues", cue.time, &ros::View { header: header(cue.time, WORLD_FRAME), json })
    }

    /// Records a message on a topic of the caller's choice. A topic carries one type.
    ///
    /// # Errors
    /// [`RecordingError::WrongType`]; [`RecordingError::Io`].
    pub fn write<M: RosMessage>(
        &mut self,
        topic: &str,
        time: SimTime,
        message: &M,
    ) -> Result<(), RecordingError> {
        self.bag.write(topic, bag_time(time), message, false)
    }

    /// Closes the open chunk, so that all messages so far are in the file, whole.
    ///
    /// # Errors
    /// [`RecordingError::Io`].
    pub fn flush(&mut self) -> Result<(), RecordingError> {
        self.bag.flush()
    }

    /// The file, for whoever hands it to the disk from time to time.
    ///
    /// # Errors
    /// [`RecordingError::Io`].
    pub fn file(&self) -> Result<File, RecordingError> {
        self.bag.file()
    }

    /// Writes the stop mark, completes the bag and gives it its name.
    ///
    /// # Errors
    /// [`RecordingError::Io`]; the file then keeps its `.active` name.
    pub fn finish(mut self, end: SimTime) -> Result<PathBuf, RecordingError> {
        self.write_log(end, "start-stop", "Stop".to_owned())?;
        self.bag.finish()
    }

    fn write_pose(&mut self, topic: &str, time: SimTime, pose: &Pose) -> Result<(), RecordingError> {
        self.write(topic, time, &ros::PoseStamped { header: header(time, WORLD_FRAME), pose: pose.into() })
    }

    /// The name of an object's model; empty for one that the scene does not have.
    fn ros_name(&self, object: ObjectId) -> String {
        self.objects.get(object.index()).map(|(name, _)| name.clone()).unwrap_or_default()
    }

    fn write_selection(&mut self, frame: &DisplayFrame) -> Result<(), RecordingError> {
        if let Some(object) = frame.target.object.filter(|_| frame.hand.held_object.is_none()) {
            self.write(topic::CURRENT_BLOCK, frame.time, &ros::Text { data: self.ros_name(object) })?;
        }
        // The first of equals, so that the choice does not depend on how a maximum is searched.
        let likeliest = (0..self.objects.len())
            .zip(&frame.target.posterior)
            .reduce(|best, next| if next.1 > best.1 { next } else { best });
        if let Some((object, _)) = likeliest {
            let name = self.ros_name(ObjectId::new(object));
            self.write(topic::BLOCK_ID, frame.time, &ros::Text { data: name })?;
        }
        match frame.target.place {
            Some(place_point) => {
                let pose = Pose::translation(place_point.x, place_point.y, place_point.z);
                self.write_pose(topic::PLACE_LOCATION, frame.time, &pose)
            }
            None => Ok(()),
        }
    }

    /// In the original the hand's commands report on `/success`: closed true, opened false.
    fn write_hand(&mut self, time: SimTime, state: HandState) -> Result<(), RecordingError> {
        let before = self.hand.replace(state);
        match state {
            _ if before.is_none_or(|b| b == state) => Ok(()),
            HandState::Closed => self.write(topic::SUCCESS, time, &ros::Bool { data: true }),
            HandState::Open => self.write(topic::SUCCESS, time, &ros::Bool { data: false }),
            HandState::Closing | HandState::Opening => Ok(()),
        }
    }

    fn write_grasp(&mut self, time: SimTime, block: ObjectId, attached: bool) -> Result<(), RecordingError> {
        let event = ros::GazeboGraspEvent {
            arm: ARM_MODEL.to_owned(),
            object: original::collision_name(&self.ros_name(block)),
            attached,
        };
        self.write(topic::GRASP_EVENTS, time, &event)?;
        self.write(topic::GRASP_STATUS, time, &ros::Bool { data: attached })
    }

    fn write_log(&mut self, time: SimTime, name: &str, msg: String) -> Result<(), RecordingError> {
        let message = ros::Log {
            header: header(time, ""),
            level: LOG_LEVEL_INFO,
            name: name.to_owned(),
            msg,
            function: "N/A".to_owned(),
            ..Default::default()
        };
        self.write("/rosout", time, &message)
    }
}

/// The bag's clock at a tick.
fn bag_time(time: SimTime) -> Time {
    let secs = u64::from(BAG_EPOCH_SECS) + time.0 / 1000;
    // A trial of 136 years would end at the last second that ROS can tell.
    Time { secs: u32::try_from(secs).unwrap_or(u32::MAX), nsecs: (time.0 % 1000) as u32 * 1_000_000 }
}

/// Seconds as ROS's duration, to the nearest nanosecond.
fn ros_duration(secs: f64) -> Duration {
    let nanos = (secs * 1e9).round() as i64;
    Duration { secs: (nanos / 1_000_000_000) as i32, nsecs: (nanos % 1_000_000_000) as i32 }
}

fn header(time: SimTime, frame: &str) -> ros::Header {
    ros::Header { seq: 0, stamp: bag_time(time), frame_id: frame.to_owned() }
}

fn transform(time: SimTime, parent: &str, child: &str, parent_from_child: &Pose) -> ros::TransformStamped {
    ros::TransformStamped {
        header: header(time, parent),
        child_frame_id: child.to_owned(),
        transform: parent_from_child.into(),
    }
}

/// The equal angle in (-pi, pi]; one that is there already is returned to the bit.
fn wrap_angle(angle: f64) -> f64 {
    angle - TAU * ((angle - PI) / TAU).ceil()
}

fn pose_values(pose: &Pose) -> impl Iterator<Item = f64> + '_ {
    pose.translation.vector.iter().chain(pose.rotation.coords.iter()).copied()
}

fn check_length(what: &'static str, got: usize, expected: usize) -> Result<(), RecordingError> {
    if got == expected { Ok(()) } else { Err(RecordingError::WrongLength { what, got, expected }) }
}

fn check_finite(
    what: &'static str,
    time: SimTime,
    values: impl IntoIterator<Item = f64>,
) -> Result<(), RecordingError> {
    match values.into_iter().find(|v| !v.is_finite()) {
        Some(value) => Err(RecordingError::NotFinite { what, value, time }),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn angles_wrap_into_the_half_open_circle() {
        for angle in [0.0, -0.0, 1.3, PI, -3.1] {
            assert_eq!(wrap_angle(angle), angle);
        }
        assert_eq!(wrap_angle(-PI), PI);
        for turns in [-3.0, -1.0, 1.0, 2.0] {
            assert!((wrap_angle(0.7 + turns * TAU) - 0.7).abs() < 1e-14);
        }
    }

    #[test]
    fn the_bag_clock_starts_at_its_epoch_and_counts_milliseconds() {
        assert_eq!(bag_time(SimTime(0)), Time { secs: 1000, nsecs: 0 });
        assert_eq!(bag_time(SimTime(61_007)), Time { secs: 1061, nsecs: 7_000_000 });
    }

    #[test]
    fn durations_are_nearest_nanoseconds() {
        assert_eq!(ros_duration(0.1 + 0.2), Duration { secs: 0, nsecs: 300_000_000 });
        assert_eq!(ros_duration(2.999_999_999_9), Duration { secs: 3, nsecs: 0 });
    }
}
