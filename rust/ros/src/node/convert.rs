//! Between our values and messages.

use super::EPOCH_SECS;
use crate::{
    messages::{geometry_msgs, std_msgs, trajectory_msgs},
    trajectory::{JointSetpoint, RawPoint},
};
use nalgebra::{Quaternion, Translation3, UnitQuaternion};
use proact_types::{Point, Pose, SimTime, Vector};
use rosrust::{Duration, Time};

/// A quaternion may be off unit length by this much and is then made unit; one further off is refused.
const UNIT_TOLERANCE: f64 = 1e-2;

pub(super) fn time(at: SimTime) -> Time {
    let (secs, millis) = (at.0 / 1000, at.0 % 1000);
    Time { sec: EPOCH_SECS + secs as u32, nsec: millis as u32 * 1_000_000 }
}

/// The tick of a time on the graph; before [`EPOCH_SECS`] it is the first.
pub(super) fn tick(at: &Time) -> SimTime {
    let secs = u64::from(at.sec.saturating_sub(EPOCH_SECS));
    SimTime(secs * 1000 + u64::from(at.nsec) / 1_000_000)
}

/// Seconds from `now` to a stamp.
pub(super) fn secs_until(stamp: &Time, now: SimTime) -> f64 {
    let now = time(now);
    f64::from(stamp.sec) - f64::from(now.sec) + (f64::from(stamp.nsec) - f64::from(now.nsec)) * 1e-9
}

pub(super) fn header(at: SimTime, frame: &str) -> std_msgs::Header {
    std_msgs::Header { seq: 0, stamp: time(at), frame_id: frame.to_owned() }
}

pub(super) fn duration(secs: f64) -> Duration {
    Duration::from_nanos((secs * 1e9).round() as i64)
}

pub(super) fn seconds(duration: &Duration) -> f64 {
    f64::from(duration.sec) + f64::from(duration.nsec) * 1e-9
}

pub(super) fn vector(v: &Vector) -> geometry_msgs::Vector3 {
    geometry_msgs::Vector3 { x: v.x, y: v.y, z: v.z }
}

pub(super) fn point(p: &Point) -> geometry_msgs::Point {
    geometry_msgs::Point { x: p.x, y: p.y, z: p.z }
}

fn quaternion(pose: &Pose) -> geometry_msgs::Quaternion {
    let q = pose.rotation.coords;
    geometry_msgs::Quaternion { x: q.x, y: q.y, z: q.z, w: q.w }
}

pub(super) fn pose(pose: &Pose) -> geometry_msgs::Pose {
    geometry_msgs::Pose {
        position: point(&Point::from(pose.translation.vector)),
        orientation: quaternion(pose),
    }
}

pub(super) fn pose_stamped(at: SimTime, frame: &str, of: &Pose) -> geometry_msgs::PoseStamped {
    geometry_msgs::PoseStamped { header: header(at, frame), pose: pose(of) }
}

pub(super) fn transform(at: SimTime, frame: &crate::frames::Frame) -> geometry_msgs::TransformStamped {
    geometry_msgs::TransformStamped {
        header: header(at, &frame.parent),
        child_frame_id: frame.child.clone(),
        transform: unstamped_transform(&frame.pose),
    }
}

pub(super) fn unstamped_transform(pose: &Pose) -> geometry_msgs::Transform {
    geometry_msgs::Transform { translation: vector(&pose.translation.vector), rotation: quaternion(pose) }
}

/// A pose that came in.
pub(super) fn read_pose(message: &geometry_msgs::Pose) -> Result<Pose, String> {
    let p = &message.position;
    checked_pose("pose", [p.x, p.y, p.z], &message.orientation)
}

/// A transform that came in.
pub(super) fn read_transform(message: &geometry_msgs::Transform) -> Result<Pose, String> {
    let t = &message.translation;
    checked_pose("transform", [t.x, t.y, t.z], &message.rotation)
}

fn checked_pose(what: &str, [x, y, z]: [f64; 3], q: &geometry_msgs::Quaternion) -> Result<Pose, String> {
    if let Some(bad) = [x, y, z, q.x, q.y, q.z, q.w].iter().find(|v| !v.is_finite()) {
        return Err(format!("a {what} holds {bad}, expected finite numbers"));
    }
    let rotation = Quaternion::new(q.w, q.x, q.y, q.z);
    if (rotation.norm() - 1.0).abs() > UNIT_TOLERANCE {
        return Err(format!("a quaternion has length {}, expected 1", rotation.norm()));
    }
    Ok(Pose::from_parts(Translation3::new(x, y, z), UnitQuaternion::from_quaternion(rotation)))
}

pub(super) fn read_point(message: &trajectory_msgs::JointTrajectoryPoint) -> RawPoint {
    RawPoint {
        positions: message.positions.clone(),
        velocities: message.velocities.clone(),
        accelerations: message.accelerations.clone(),
        time_secs: seconds(&message.time_from_start),
    }
}

pub(super) fn trajectory_point(setpoints: &[JointSetpoint]) -> trajectory_msgs::JointTrajectoryPoint {
    trajectory_msgs::JointTrajectoryPoint {
        positions: setpoints.iter().map(|k| k.position).collect(),
        velocities: setpoints.iter().map(|k| k.velocity.unwrap_or(0.0)).collect(),
        ..Default::default()
    }
}
