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
