//! The message types that the trial's topics carry, as structs. Names and order of fields are ROS's interface; the codec
//! refuses a struct whose fields are not those of the definition.

use proact_messages::{Duration, Time};
use proact_types::{Point as WorldPoint, Pose as WorldPose, Vector};
use serde::{Deserialize, Serialize, de::DeserializeOwned};

/// A struct that stands for a message type of ROS 1.
pub trait RosMessage: Serialize + DeserializeOwned {
    /// Full name, such as `std_msgs/String`.
    const TYPE: &'static str;
}

/// Declares a struct with ROS's fields.
macro_rules! message {
    ($(#[$doc:meta])* $name:ident = $ros:literal { $($field:ident: $type:ty),* $(,)? }) => {
        $(#[$doc])*
        // The fields are ROS's, described in its own documentation.
        #[allow(missing_docs)]
        #[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
        pub struct $name {
            $(pub $field: $type),*
        }

        impl RosMessage for $name {
            const TYPE: &'static str = $ros;
        }
    };
}

message! {
    /// `std_msgs/BagRecordHeader`.
    Header = "std_msgs/Header" { seq: u32, stamp: Time, frame_id: String }
}
message! {
    /// `std_msgs/String`.
    Text = "std_msgs/String" { data: String }
}
message! {
    /// `proact_msgs/View`.
    View = "proact_msgs/View" { header: Header, json: String }
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
    /// `geometry_msgs/PoseJson`.
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
    Log = "rosgraph_msgs/Log" {
        header: Header,
        level: i8,
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
    use super::*;
    use proact_messages::builtin_type;

    fn check<M: RosMessage + Default + PartialEq + std::fmt::Debug>(filled: M) {
        let kind = builtin_type(M::TYPE).unwrap();
        for message in [filled, M::default()] {
            let bytes = kind.to_bytes(&message).unwrap();
            assert_eq!(kind.from_bytes(&bytes).unwrap().into_struct::<M>().unwrap(), message, "{}", M::TYPE);
        }
    }

    #[test]
    fn every_struct_is_what_its_definition_says_and_comes_back_from_bytes() {
        let header = Header { seq: 1, stamp: Time { secs: 2, nsecs: 3 }, frame_id: "a".to_owned() };
        let point = Point { x: 1.0, y: f64::INFINITY, z: -0.0 };
        let vector = Vector3 { x: 1.0, y: 2.0, z: 3.0 };
        let orientation = Quaternion { x: 1.0, y: 2.0, z: 3.0, w: 4.0 };
        let pose = Pose { position: point, orientation: orientation.clone() };
        let twist = Twist { linear: vector.clone(), angular: vector.clone() };
        let names = || vec!["b".to_owned(), String::new()];
        let transform = TransformStamped {
            header: header.clone(),
            child_frame_id: "c".to_owned(),
            transform: Transform { translation: vector.clone(), rotation: orientation },
        };
        check(Text { data: "d".to_owned() });
        check(Bool { data: true });
        check(Int8 { data: -1 });
        check(Float64 { data: 0.5 });
        check(Clock { clock: header.stamp });
        check(Vector3Stamped { header: header.clone(), vector });
        check(PoseStamped { header: header.clone(), pose: pose.clone() });
        check(TfMessage { transforms: vec![transform.clone(), transform] });
        check(JointState {
            header: header.clone(),
            name: names(),
            position: vec![1.0],
            velocity: vec![2.0, 3.0],
            effort: vec![],
        });
        let point = JointTrajectoryPoint {
            positions: vec![1.0],
            velocities: vec![2.0],
            accelerations: vec![],
            effort: vec![],
            time_from_start: Duration { secs: -4, nsecs: -5 },
        };
        check(JointTrajectory { header: header.clone(), joint_names: names(), points: vec![point] });
        check(ModelStates { name: names(), pose: vec![pose], twist: vec![twist] });
        check(GazeboGraspEvent { arm: "e".to_owned(), object: "f".to_owned(), attached: true });
        check(Log { header, level: 2, msg: "g".to_owned(), topics: names(), line: 6, ..Default::default() });
    }
}
