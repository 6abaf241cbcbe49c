use crate::{JointVector, ObjectId, Point, Pose, Shape};
use serde::{Deserialize, Serialize};

/// An obstacle of one plan.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Obstacle {
    /// Named in collision reports.
    pub name: String,
    /// Its shape.
    pub shape: Shape,
    /// `world_from_obstacle`.
    pub pose: Pose,
    /// As [`crate::Object::loose`].
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub loose: bool,
}

/// An object in the hand: it moves with the tip and collides as part of the arm.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct AttachedObject {
    /// Its name.
    pub name: String,
    /// Its shape.
    pub shape: Shape,
    /// `tip_from_object`.
    pub tip_from_object: Pose,
    /// As [`crate::Object::loose`].
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub loose: bool,
}

/// Where a plan should lead.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "goal", rename_all = "snake_case")]
pub enum PlanGoal {
    /// Around the object with an open hand, from a pre-grasp pose and straight down.
    Pick {
        /// Which object.
        object: ObjectId,
        /// Its center, in `world`.
        #[serde(rename = "centre")]
        center: Point,
    },
    /// Lift the carried object, carry it, and lower it until it stands on the table here.
    Place {
        /// Place on the table top, in `world`.
        point: Point,
    },
    /// These arm angles.
    Joints {
        /// One angle per arm joint.
        q: JointVector,
    },
    /// This pose of the tip.
    TipPose {
        /// `world_from_tip`.
        pose: Pose,
    },
}

/// A question to the planner. It holds all that the answer depends on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PlanRequest {
    /// Number of the request in this trial, from 1.
    pub id: u64,
    /// `world_from_base` for which the plan is made.
    pub world_from_base: Pose,
    /// Arm angles at the start.
    pub start: JointVector,
    /// Hand angles, held during the motion.
    pub hand: JointVector,
    /// What to reach.
    pub goal: PlanGoal,
    /// Under which name the object of a pick is among the obstacles; none for other goals.
    #[serde(default)]
    #[serde(rename = "picked")]
    pub picked_object: Option<String>,
    /// Everything to keep clear of.
    pub obstacles: Vec<Obstacle>,
    /// The object in the hand.
    pub attached: Option<AttachedObject>,
    /// Arm joints that stay at their angles of `start`, by position, ascending: those of the person's own limb. The plan
    /// moves the others.
    #[serde(default)]
    #[serde(rename = "held")]
    pub held_joints: Vec<usize>,
    /// Seeds every random choice of the answer.
    pub seed: u64,
}

impl PlanRequest {
    /// Width of the object that the hand is about, metres: that is picked, or in the hand. None if there is none, or what
    /// is picked is not among the obstacles.
    pub fn grip_width(&self) -> Option<f64> {
        let shape = match &self.goal {
            PlanGoal::Pick { .. } => {
                let picked = self.picked_object.as_deref()?;
                self.obstacles.iter().find(|o| o.name == picked).map(|o| o.shape)
            }
            _ => self.attached.as_ref().map(|object| object.shape),
        };
        shape.map(|shape| shape.grip_width())
    }
}

/// How a plan ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
#[serde(rename_all = "snake_case")]
pub enum PlanStatus {
    /// It leads to the goal.
    Ok,
    /// It leads to a point on the way, because the goal is out of reach.
    Intermediate,
    /// The goal is reachable, no way was found within the limit.
    NoPlan,
    /// No arm angles reach the goal nor a useful point on the way.
    Unreachable,
    /// The arm starts in collision.
    StartInCollision,
    /// Every way of reaching the goal is in collision.
    GoalInCollision,
    /// The request was malformed.
    Invalid,
    /// It was cancelled.
    Cancelled,
}

impl PlanStatus {
    /// All of them, in the order of their numbers.
    pub const ALL: [PlanStatus; 8] = [
        PlanStatus::Ok,
        PlanStatus::Intermediate,
        PlanStatus::NoPlan,
        PlanStatus::Unreachable,
        PlanStatus::StartInCollision,
        PlanStatus::GoalInCollision,
        PlanStatus::Invalid,
        PlanStatus::Cancelled,
    ];
}

/// One point of a trajectory.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrajectoryPoint {
    /// Seconds from the start of the trajectory.
    pub time_secs: f64,
    /// Arm angles, rad.
    pub q: JointVector,
    /// Arm joint speeds, rad/s.
    pub qd: JointVector,
}

/// A path in time: cubic Hermite between points. Starts and ends at rest.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Trajectory {
    /// Times ascend strictly from zero.
    pub points: Vec<TrajectoryPoint>,
}

impl Trajectory {
    /// Seconds from start to end; zero when empty.
    pub fn duration_secs(&self) -> f64 {
        self.points.last().map_or(0.0, |p| p.time_secs)
    }

    /// Angles and speeds at `time_secs`, clamped to the ends, NaN to the first; none when empty.
    pub fn sample(&self, time_secs: f64) -> Option<(JointVector, JointVector)> {
        let (first, last) = (self.points.first()?, self.points.last()?);
        let rest = |p: &TrajectoryPoint| (p.q.clone(), p.q.iter().map(|_| 0.0).collect());
        if time_secs.is_nan() || time_secs <= first.time_secs {
            return Some(rest(first));
        }
        if time_secs >= last.time_secs {
            return Some(rest(last));
        }
        let next = self.points.partition_point(|p| p.time_secs <= time_secs);
        let (a, b) = (&self.points[next - 1], &self.points[next]);
        let h = b.time_secs - a.time_secs;
        let s = (time_secs - a.time_secs) / h;
        // Cubic Hermite basis and its derivative with respect to s.
        let (s2, s3) = (s * s, s * s * s);
        let (h00, h10, h01, h11) =
            (2.0 * s3 - 3.0 * s2 + 1.0, s3 - 2.0 * s2 + s, 3.0 * s2 - 2.0 * s3, s3 - s2);
        let (d00, d10, d01, d11) =
            (6.0 * s2 - 6.0 * s, 3.0 * s2 - 4.0 * s + 1.0, 6.0 * s - 6.0 * s2, 3.0 * s2 - 2.0 * s);
        let joint = |k: usize| {
            let (p0, p1, m0, m1) = (a.q[k], b.q[k], h * a.qd[k], h * b.qd[k]);
            (h00 * p0 + h10 * m0 + h01 * p1 + h11 * m1, (d00 * p0 + d10 * m0 + d01 * p1 + d11 * m1) / h)
        };
        Some((0..a.q.len()).map(joint).unzip())
    }
}

/// The planner's answer.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PlanReply {
    /// Which request it answers.
    pub id: u64,
    /// How it ended.
    pub status: PlanStatus,
    /// The way, empty unless the status is `ok` or `intermediate`.
    pub trajectory: Trajectory,
    /// One sentence for the display and the log when there is no full plan; empty otherwise.
    pub reason: String,
    /// Free space that the way keeps more than 5 cm of the tip's path away from its ends, metres, at most the planner's padding;
    /// none if it is not that long, or if nobody measured it. Not recorded with the reply: the log of the plans has it.
    #[serde(skip)]
    pub clearance_m: Option<f64>,
}

impl PlanReply {
    /// The answer that there is no way.
    pub fn without_plan(id: u64, status: PlanStatus, reason: impl Into<String>) -> Self {
        Self { id, status, trajectory: Trajectory::default(), reason: reason.into(), clearance_m: None }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::joints;

    fn trajectory() -> Trajectory {
        let point =
            |time_secs, q: f64, qd: f64| TrajectoryPoint { time_secs, q: joints(&[q]), qd: joints(&[qd]) };
        Trajectory { points: vec![point(0.0, 0.0, 0.0), point(1.0, 0.5, 0.8), point(2.0, 1.0, 0.0)] }
    }

    #[test]
    fn the_ways_in_which_a_plan_ends_stand_at_their_numbers() {
        for (index, status) in PlanStatus::ALL.into_iter().enumerate() {
            assert_eq!(status as usize, index, "{status:?}");
        }
    }

    #[test]
    fn a_trajectory_passes_its_points_at_their_speeds_and_rests_at_both_ends() {
        let trajectory = trajectory();
        let at = |t| trajectory.sample(t).map(|(q, qd)| (q[0], qd[0]));
        assert_eq!(at(-1.0), Some((0.0, 0.0)));
        assert_eq!(at(1.0), Some((0.5, 0.8)));
        assert_eq!(at(9.0), Some((1.0, 0.0)));
        assert_eq!(Trajectory::default().sample(0.0), None);
    }

    #[test]
    fn the_speed_is_the_derivative_of_the_angle_everywhere() {
        let trajectory = trajectory();
        let angle = |t| trajectory.sample(t).expect("not empty").0[0];
        for k in 1..200 {
            let (t, h) = (f64::from(k) * 0.01, 1e-6);
            let speed = trajectory.sample(t).expect("not empty").1[0];
            // Central differences of a cubic are exact to h squared; at the middle point the third derivative jumps.
            assert!(((angle(t + h) - angle(t - h)) / (2.0 * h) - speed).abs() < 1e-5, "at {t} s");
        }
    }
}
