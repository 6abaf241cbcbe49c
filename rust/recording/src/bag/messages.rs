//! The message types that the trial's topics carry. Names and order of fields are ROS's interface; the tests
//! compare the sums with those of ROS's own packages.

use super::message::{Byte, Duration, Time, message};
use proact_types::{Point as WorldPoint, Pose as WorldPose, Vector};

message! {
    /// `std_msgs/Header`.
    Header = "std_msgs/Header" { seq: u32, stamp: Time, frame_id: String }
}
message! {
    /// `std_msgs/String`.
    Text = "std_msgs/String" { data: String }
}
message! {
    /// `std_msgs/Bool`.
    Bool = "std_msgs/Bool" { data: bool }
}
message! {
    /// `std_msgs/Int8`.
    Int8 = "std_msgs/Int8" { data: i8 }
}
message! {
    /// `std_msgs/Float64`.
    Float64 = "std_msgs/Float64" { data: f64 }
}
message! {
    /// `geometry_msgs/Vector3`.
    Vector3 = "geometry_msgs/Vector3" { x: f64, y: f64, z: f64 }
}
message! {
    /// `geometry_msgs/Point`.
    Point = "geometry_msgs/Point" { x: f64, y: f64, z: f64 }
}
message! {
    /// `geometry_msgs/Quaternion`.
    Quaternion = "geometry_msgs/Quaternion" { x: f64, y: f64, z: f64, w: f64 }
}
message! {
    /// `geometry_msgs/Pose`.
    Pose = "geometry_msgs/Pose" { position: Point, orientation: Quaternion }
}
message! {
    /// `geometry_msgs/Twist`: linear first, then angular.
    Twist = "geometry_msgs/Twist" { linear: Vector3, angular: Vector3 }
}
message! {
    /// `geometry_msgs/Transform`.
    Transform = "geometry_msgs/Transform" { translation: Vector3, rotation: Quaternion }
}
message! {
    /// `geometry_msgs/Vector3Stamped`.
    Vector3Stamped = "geometry_msgs/Vector3Stamped" { header: Header, vector: Vector3 }
}
message! {
    /// `geometry_msgs/PoseStamped`.
    PoseStamped = "geometry_msgs/PoseStamped" { header: Header, pose: Pose }
}
message! {
    /// `geometry_msgs/TransformStamped`: `header.frame_id` from `child_frame_id`.
    TransformStamped = "geometry_msgs/TransformStamped" {
        header: Header,
        child_frame_id: String,
        transform: Transform,
    }
}
message! {
    /// `tf2_msgs/TFMessage`.
    TfMessage = "tf2_msgs/TFMessage" { transforms: Vec<TransformStamped> }
}
message! {
    /// `sensor_msgs/JointState`.
    JointState = "sensor_msgs/JointState" {
        header: Header,
        name: Vec<String>,
        position: Vec<f64>,
        velocity: Vec<f64>,
        effort: Vec<f64>,
    }
}
message! {
    /// `trajectory_msgs/JointTrajectoryPoint`.
    JointTrajectoryPoint = "trajectory_msgs/JointTrajectoryPoint" {
        positions: Vec<f64>,
        velocities: Vec<f64>,
        accelerations: Vec<f64>,
        effort: Vec<f64>,
        time_from_start: Duration,
    }
}
message! {
    /// `trajectory_msgs/JointTrajectory`.
    JointTrajectory = "trajectory_msgs/JointTrajectory" {
        header: Header,
        joint_names: Vec<String>,
        points: Vec<JointTrajectoryPoint>,
    }
}
message! {
    /// `rosgraph_msgs/Clock`.
    Clock = "rosgraph_msgs/Clock" { clock: Time }
}
message! {
    /// `rosgraph_msgs/Log`; level 2 is INFO.
    Log = "rosgraph_msgs/Log" constants "byte DEBUG=1\nbyte INFO=2\nbyte WARN=4\nbyte ERROR=8\nbyte FATAL=16\n" {
        header: Header,
        level: Byte,
        name: String,
        msg: String,
        file: String,
        function: String,
        line: u32,
        topics: Vec<String>,
    }
}
message! {
    /// `gazebo_msgs/ModelStates`.
    ModelStates = "gazebo_msgs/ModelStates" { name: Vec<String>, pose: Vec<Pose>, twist: Vec<Twist> }
}
message! {
    /// `gazebo_grasp_plugin_ros/GazeboGraspEvent`; `object` is Gazebo's `model::link::collision`.
    GazeboGraspEvent = "gazebo_grasp_plugin_ros/GazeboGraspEvent" {
        arm: String,
        object: String,
        attached: bool,
    }
}

impl From<Vector> for Vector3 {
    fn from(v: Vector) -> Self {
        Vector3 { x: v.x, y: v.y, z: v.z }
    }
}

impl From<WorldPoint> for Point {
    fn from(p: WorldPoint) -> Self {
        Point { x: p.x, y: p.y, z: p.z }
    }
}

impl From<&WorldPose> for Quaternion {
    fn from(pose: &WorldPose) -> Self {
        let q = pose.rotation.coords;
        Quaternion { x: q.x, y: q.y, z: q.z, w: q.w }
    }
}

impl From<&WorldPose> for Pose {
    fn from(pose: &WorldPose) -> Self {
        Pose { position: WorldPoint::from(pose.translation.vector).into(), orientation: pose.into() }
    }
}

impl From<&WorldPose> for Transform {
    fn from(pose: &WorldPose) -> Self {
        Transform { translation: pose.translation.vector.into(), rotation: pose.into() }
    }
}

#[cfg(test)]
mod tests {
    use super::{super::message::Message, *};

    #[test]
    fn sums_are_those_of_ros() {
        let sums = [
            (Header::md5_sum(), "2176decaecbce78abc3b96ef049fabed"),
            (Text::md5_sum(), "992ce8a1687cec8c8bd883ec73ca41d1"),
            (Bool::md5_sum(), "8b94c1b53db61fb6aed406028ad6332a"),
            (Int8::md5_sum(), "27ffa0c9c4b8fb8492252bcad9e5c57b"),
            (Float64::md5_sum(), "fdb28210bfa9d7c91146260178d9a584"),
            (JointState::md5_sum(), "3066dcd76a6cfaef579bd0f34173e9fd"),
            (TfMessage::md5_sum(), "94810edda583a504dfda3829e70d7eec"),
            (Vector3Stamped::md5_sum(), "7b324c7325e683bf02a9b14b01090ec7"),
            (PoseStamped::md5_sum(), "d3812c3cbc69362b77dc0b19b345f8f5"),
            (Log::md5_sum(), "acffd30cd6b6de30f120938c17c593fb"),
            (Clock::md5_sum(), "a9c97c1d230cfc112e270351a944ee47"),
            (ModelStates::md5_sum(), "48c080191eb15c41858319b4d8a609c2"),
            (JointTrajectory::md5_sum(), "65b4f94a94d1ed67169da35a02f33d3f"),
        ];
        for (got, expected) in sums {
            assert_eq!(got, expected);
        }
    }

    #[test]
    fn a_definition_names_each_type_that_it_needs_once() {
        let text = PoseStamped::definition();
        for needed in
            ["std_msgs/Header", "geometry_msgs/Pose", "geometry_msgs/Point", "geometry_msgs/Quaternion"]
        {
            assert_eq!(text.matches(&format!("MSG: {needed}\n")).count(), 1, "{text}");
        }
        assert!(!text.contains("MSG: geometry_msgs/PoseStamped"), "{text}");
        assert_eq!(GazeboGraspEvent::definition(), "string arm\nstring object\nbool attached\n");
    }

    #[test]
    fn bytes_that_are_no_message_are_refused() {
        let bytes = [3, 0, 0, 0, b'a', b'b', b'c'];
        assert_eq!(Text::from_bytes(&bytes).unwrap(), Text { data: "abc".to_owned() });
        assert!(Text::from_bytes(&bytes[..6]).is_err());
        assert!(Text::from_bytes(&[1, 0, 0, 0, 255]).is_err(), "not UTF-8");
        assert!(Int8::from_bytes(&bytes).is_err(), "bytes left over");
        // A count of four billion must fail, not ask for memory.
        assert!(TfMessage::from_bytes(&[255; 8]).is_err());
    }
}
