//! Arm angles that bring a point of the hand somewhere and leave the turn about one axis free.
//!
//! Grips from above and upright objects do not care about the yaw about the vertical. Leaving it free makes one
//! search do the work of a sweep over yaw angles, and uses the arm's redundancy on straight paths.
//!
//! Letters: p the point, a the axis, t their targets; all in the base frame.

use crate::partial_arm::GoalTolerance;
use nalgebra::{UnitQuaternion, Vector6};
use proact_arm::{Chain, ChainPoses, JointLimits, damped_step_within_limits};
use proact_types::{Point, Vector};

/// What the hand should do: a point of it is brought to `target` while an axis of it points along `direction`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct IkGoal {
    /// In the tip's frame.
    pub point: Point,
    /// Unit vector in the tip's frame.
    pub axis: Vector,
    /// Where the point should be, base frame.
    pub target: Point,
    /// Where the axis should point, unit vector, base frame.
    pub direction: Vector,
    /// The whole orientation of the tip, base frame, where the turn about the axis is not free.
    pub orientation: Option<UnitQuaternion<f64>>,
    /// How far off both may be; none where they have to be met. Not with an orientation.
    pub tolerance: Option<GoalTolerance>,
}

/// Joint limits of the arm, rad.
#[derive(Clone, Debug)]
pub(crate) struct ArmJointLimits(pub Vec<JointLimits>);

/// Distance from the target at which the point has arrived, metres.
const POSITION_TOLERANCE_M: f64 = 2e-5;
/// Angle to the direction at which the axis has arrived, rad.
const AXIS_TOLERANCE_RAD: f64 = 2e-4;
/// Metres that weigh as much as one radian of the axis: about the length of the hand.
const AXIS_WEIGHT_M: f64 = 0.15;
/// Newton's method converges in fewer than ten steps where it converges at all; limits cost a few more.
const MAX_ITERATIONS: usize = 40;
/// Iterations after which the error must have fallen to this share; otherwise the search is given up.
const STALL_WINDOW: usize = 6;
const STALL_RATIO: f64 = 0.7;
/// Longest step of any joint, rad: beyond it the linear model is worthless.
const MAX_STEP_RAD: f64 = 0.35;

impl ArmJointLimits {
    /// `q` with every angle inside its limits.
    pub fn clamp(&self, q: &[f64]) -> Vec<f64> {
        q.iter().zip(&self.0).map(|(v, limits)| v.clamp(limits.lower, limits.upper)).collect()
    }

    /// True if every angle is inside its limits, but for `slack`.
    pub fn contains(&self, q: &[f64], slack: f64) -> bool {
        q.iter().zip(&self.0).all(|(v, limits)| *v >= limits.lower - slack && *v <= limits.upper + slack)
    }

    /// Smallest distance from a limit, as a share of the joint's range: 0 at a limit, 0.5 in the middle.
    pub fn margin(&self, q: &[f64]) -> f64 {
        let share = |(v, limits): (&f64, &JointLimits)| {
            (v - limits.lower).min(limits.upper - v) / (limits.upper - limits.lower)
        };
        q.iter().zip(&self.0).map(share).fold(0.5, f64::min)
    }

    /// What closeness to a limit costs, in radians of joint travel: half a radian at a limit, nothing from a twentieth of the
    /// joint's range on.
    pub fn limit_cost(&self, q: &[f64]) -> f64 {
        0.5 * (0.05 - self.margin(q)).max(0.0) / 0.05
    }
}

/// Arm angles within the limits that do what `reach` asks, near `seed`, by damped least squares; none if the search does
/// not arrive.
pub(crate) fn solve_ik(
    chain: &Chain,
    limits: &ArmJointLimits,
    reach: &IkGoal,
    seed: &[f64],
) -> Option<Vec<f64>> {
    if let (Some(slack), None) = (reach.tolerance, reach.orientation) {
        return solve_ik_within(chain, limits, reach, slack, seed);
    }
    let mut q = limits.clamp(seed);
    let mut poses = ChainPoses::default();
    let mut marked = f64::INFINITY;
    for iteration in 0..MAX_ITERATIONS {
        chain.link_poses_into(&q, &mut poses);
        let p = poses.tip * reach.point;
        let off = reach.target - p;
        let turn = match reach.orientation {
            Some(orientation) => (orientation * poses.tip.rotation.inverse()).scaled_axis(),
            None => rotation_onto(&(poses.tip.rotation * reach.axis), &reach.direction),
        };
        if off.norm() < POSITION_TOLERANCE_M && turn.norm() < AXIS_TOLERANCE_RAD {
            return Some(q);
        }
        let mut error = Vector6::zeros();
        error.fixed_rows_mut::<3>(0).copy_from(&off);
        error.fixed_rows_mut::<3>(3).copy_from(&(AXIS_WEIGHT_M * turn));
        // Pushing against its limits the arm creeps; another posture gets there sooner.
        if iteration % STALL_WINDOW == STALL_WINDOW - 1 {
            if error.norm() > STALL_RATIO * marked {
                return None;
            }
            marked = error.norm();
        }
        let free_axis = if reach.orientation.is_some() { Vector::zeros() } else { reach.direction };
        let mut task = chain.jacobian(&poses, &p);
        for column in &mut task {
            let w: Vector = column.fixed_rows::<3>(3).into();
            let counted = AXIS_WEIGHT_M * (w - free_axis * free_axis.dot(&w));
            column.fixed_rows_mut::<3>(3).copy_from(&counted);
        }
        // Far from the target the linear model is poor, near it damping only slows the end.
        let damping = 1e-7 + 0.02 * error.norm_squared();
        damped_step_within_limits(&mut q, &limits.0, &mut task, &error, damping, MAX_STEP_RAD);
    }
    None
}

/// As [`solve_ik`] for part of an arm: as near as it gets, if that is within `slack`. What is within its slack pulls no more.
fn solve_ik_within(
    chain: &Chain,
    limits: &ArmJointLimits,
    reach: &IkGoal,
    slack: GoalTolerance,
    seed: &[f64],
) -> Option<Vec<f64>> {
    let mut q = limits.clamp(seed);
    let mut poses = ChainPoses::default();
    let mut best: Option<(f64, Vec<f64>)> = None;
    for _ in 0..MAX_ITERATIONS {
        chain.link_poses_into(&q, &mut poses);
        let p = poses.tip * reach.point;
        let off = reach.target - p;
        let turn = rotation_onto(&(poses.tip.rotation * reach.axis), &reach.direction);
        if off.norm() < slack.position_m
            && turn.norm() < slack.axis_rad
            && best.as_ref().is_none_or(|b| off.norm() < b.0)
        {
            best = Some((off.norm(), q.clone()));
        }
        if best.is_some() && off.norm() < POSITION_TOLERANCE_M {
            break;
        }
        // Beyond the slack alone the axis counts, so that the point is met as well as can be.
        let beyond = (turn.norm() - 0.9 * slack.axis_rad).max(0.0);
        let turn = turn.try_normalize(1e-12).unwrap_or_default() * beyond;
        let axis_weight = if beyond > 0.0 { AXIS_WEIGHT_M } else { 0.0 };
        let mut error = Vector6::zeros();
        error.fixed_rows_mut::<3>(0).copy_from(&off);
        error.fixed_rows_mut::<3>(3).copy_from(&(axis_weight * turn));
        let mut task = chain.jacobian(&poses, &p);
        for column in &mut task {
            let w: Vector = column.fixed_rows::<3>(3).into();
            let counted = axis_weight * (w - reach.direction * reach.direction.dot(&w));
            column.fixed_rows_mut::<3>(3).copy_from(&counted);
        }
        let damping = 1e-5 + 0.02 * error.norm_squared();
        damped_step_within_limits(&mut q, &limits.0, &mut task, &error, damping, MAX_STEP_RAD);
    }
    best.map(|(_, q)| q)
}

/// Rotation vector that turns the unit vector `a` onto the unit vector `t` the short way.
fn rotation_onto(a: &Vector, t: &Vector) -> Vector {
    let cross = a.cross(t);
    let (sine, cosine) = (cross.norm(), a.dot(t));
    if sine > 1e-9 {
        cross * (sine.atan2(cosine) / sine)
    } else if cosine > 0.0 {
        Vector::zeros()
    } else {
        // Opposite: any axis across will do.
        let across = if t.x.abs() < 0.9 { Vector::x() } else { Vector::y() };
        t.cross(&across).normalize() * std::f64::consts::PI
    }
}

/// Length of one step on a straight way, metres.
const LINE_STEP_M: f64 = 0.005;
/// Largest change of any joint in one such step, rad: more is a jump to another posture.
const MAX_LINE_STEP_RAD: f64 = 0.25;

/// Arm angles along the straight way that moves the target of `reach` by `along`, starting at `start`, which
/// must already do what `reach` asks. The hand keeps its whole orientation as long as the arm can, then only its
/// axis. Ends where the arm cannot follow: the share covered is `points.len() - 1` of [`line_steps`].
pub(crate) fn straight_line(
    chain: &Chain,
    limits: &ArmJointLimits,
    reach: &IkGoal,
    along: &Vector,
    start: &[f64],
) -> Vec<Vec<f64>> {
    let steps = line_steps(along.norm());
    let mut points = vec![start.to_vec()];
    let mut orientation = Some(chain.forward(start).rotation);
    for k in 1..=steps {
        let target = reach.target + along * (k as f64 / steps as f64);
        let from = &points[points.len() - 1];
        let near = |q: &Vec<f64>| q.iter().zip(from).all(|(a, b)| (a - b).abs() < MAX_LINE_STEP_RAD);
        let mut next = None;
        if orientation.is_some() {
            next = solve_ik(chain, limits, &IkGoal { target, orientation, ..*reach }, from).filter(near);
        }
        if next.is_none() {
            orientation = None;
            next = solve_ik(chain, limits, &IkGoal { target, orientation, ..*reach }, from).filter(near);
        }
        let Some(q) = next else { break };
        points.push(q);
    }
    points
}

/// Number of steps on a straight way of `length` metres.
pub(crate) fn line_steps(length: f64) -> usize {
    (length / LINE_STEP_M).ceil().max(1.0) as usize
}
