use crate::ports::ArmKinematics;
use crate::{ControlInput, ControlMethod, ControlOutput, LimiterProfile, MotionCommand, STEP_SECS};
use proact_arm::{ArmModel, JointLimits};
use proact_types::{JointVector, SimTime, Trajectory, zeros};

/// Longest time between two steps that speeds may change for, seconds: a late step must not let the arm jump.
const MAX_STEP_SECS: f64 = 0.02;
/// A trajectory this much faster than allowed, as a share, passes: planners meet the limits to rounding.
const SPEED_TOLERANCE: f64 = 0.05;

/// Keeps every command of a method within the position, speed and acceleration limits of the arm joints.
///
/// Speeds ramp up and, ahead of a joint limit, down. Goals are approached the same way. Trajectories that are too
/// fast are stretched in time. A stop passes at once: nothing delays it. Numbers that are not finite stop the arm.
#[derive(Clone, Debug)]
pub struct CommandLimiter<M> {
    method: M,
    limits: Vec<JointLimits>,
    acceleration: f64,
    velocity: JointVector,
    goal: Option<JointVector>,
    last: Option<SimTime>,
}

impl<M: ControlMethod> CommandLimiter<M> {
    /// Around `method`.
    pub fn new(method: M, profile: &LimiterProfile, model: &ArmModel) -> Self {
        Self {
            method,
            limits: model.arm.iter().map(|&j| model.joints[j].limits).collect(),
            acceleration: profile.acceleration_rad_per_s2,
            velocity: zeros(model.arm_count()),
            goal: None,
            last: None,
        }
    }

    /// Speeds as near to `requested` as the limits allow after `secs`.
    fn limited_velocity(&mut self, requested: &[f64], commanded: &[f64], secs: f64) -> Option<MotionCommand> {
        let fits = requested.len() == self.limits.len() && commanded.len() == self.limits.len();
        if !fits || !requested.iter().chain(commanded).all(|value| value.is_finite()) {
            return Some(self.hold());
        }
        // All joints change their speeds in proportion, so that the hand keeps to its direction.
        let fastest =
            requested.iter().zip(&self.limits).fold(1.0_f64, |m, (v, l)| m.max(v.abs() / l.velocity));
        let changes: JointVector =
            requested.iter().zip(&self.velocity).map(|(v, was)| v / fastest - was).collect();
        let greatest = changes.iter().fold(0.0_f64, |m, change| m.max(change.abs()));
        let share = (self.acceleration * secs / greatest).min(1.0);
        let brake = |distance: f64| max_stopping_speed(distance, self.acceleration);
        let speeds = (0..requested.len()).map(|k| {
            let ramped = self.velocity[k] + share * changes[k];
            // Braking comes before the ramp, joint by joint: at its limit a joint must stand.
            let (limits, angle) = (&self.limits[k], commanded[k]);
            ramped.clamp(-brake(angle - limits.lower), brake(limits.upper - angle))
        });
        self.velocity = speeds.collect();
        Some(MotionCommand::Velocity(self.velocity.clone()))
    }

    fn hold(&mut self) -> MotionCommand {
        self.velocity.iter_mut().for_each(|speed| *speed = 0.0);
        self.goal = None;
        MotionCommand::Hold
    }

    /// The trajectory, clamped to the limits and slow enough; none if it holds numbers that are none.
    fn slow_down(&self, mut path: Trajectory) -> Option<Trajectory> {
        let count = self.limits.len();
        let mut stretch = 1.0_f64;
        for point in &mut path.points {
            let whole = point.q.len() == count && point.qd.len() == count && point.time_secs.is_finite();
            if !whole || !point.q.iter().chain(&point.qd).all(|value| value.is_finite()) {
                return None;
            }
            for (k, limits) in self.limits.iter().enumerate() {
                point.q[k] = point.q[k].clamp(limits.lower, limits.upper);
                stretch = stretch.max(excess_ratio(point.qd[k], limits.velocity));
            }
        }
        for pair in path.points.windows(2) {
            let (a, b) = (&pair[0], &pair[1]);
            let h = b.time_secs - a.time_secs;
            // Times that do not ascend are no trajectory.
            if h.is_nan() || h <= 0.0 {
                return None;
            }
            for (k, limits) in self.limits.iter().enumerate() {
                // Ends of the second derivative of the cubic, and its greatest mean speed.
                let step = b.q[k] - a.q[k];
                let first = (6.0 * step / h - 4.0 * a.qd[k] - 2.0 * b.qd[k]) / h;
                let last = (-6.0 * step / h + 2.0 * a.qd[k] + 4.0 * b.qd[k]) / h;
                stretch = stretch.max(excess_ratio(step / h, limits.velocity));
                stretch = stretch.max(excess_ratio(first.abs().max(last.abs()), self.acceleration).sqrt());
            }
        }
        // A speed or step so great that no finite time is long enough.
        if !(stretch * path.duration_secs()).is_finite() {
            return None;
        }
        if stretch > 1.0 {
            for point in &mut path.points {
                point.time_secs *= stretch;
                point.qd.iter_mut().for_each(|speed| *speed /= stretch);
            }
        }
        Some(path)
    }
}

/// The ratio by which `value` is over `limit`; one when it is within.
fn excess_ratio(value: f64, limit: f64) -> f64 {
    let ratio = value.abs() / limit;
    if ratio > 1.0 + SPEED_TOLERANCE { ratio } else { 1.0 }
}

/// The greatest speed from which a joint stops within `distance`, and with which it does not pass it in one step.
fn max_stopping_speed(distance: f64, acceleration: f64) -> f64 {
    let distance = distance.max(0.0);
    (2.0 * acceleration * distance).sqrt().min(distance / STEP_SECS)
}

impl<M: ControlMethod> ControlMethod for CommandLimiter<M> {
    fn step(
        &mut self,
        now: SimTime,
        input: &ControlInput<'_>,
        kinematics: &mut dyn ArmKinematics,
    ) -> ControlOutput {
        let mut output = self.method.step(now, input, kinematics);
        let elapsed = self.last.replace(now).map_or(STEP_SECS, |last| now.millis_since(last) as f64 * 1e-3);
        let secs = elapsed.min(MAX_STEP_SECS);
        output.motion = match output.motion.take() {
            Some(MotionCommand::Hold) => Some(self.hold()),
            Some(MotionCommand::Velocity(requested)) => {
                self.goal = None;
                self.limited_velocity(&requested, input.commanded, secs)
            }
            Some(MotionCommand::Goto(goal)) => {
                self.goal = Some(goal);
                None
            }
            Some(MotionCommand::Follow(path)) => {
                let held = self.hold();
                Some(self.slow_down(path).map_or(held, MotionCommand::Follow))
            }
            None => None,
        }
        .or_else(|| {
            // A goal stands until it is reached or another command comes.
            let goal = self.goal.clone()?;
            if goal.len() != input.commanded.len() {
                return Some(self.hold());
            }
            let gaps: JointVector = goal.iter().zip(input.commanded).map(|(goal, q)| goal - q).collect();
            if gaps.iter().all(|gap| *gap == 0.0) {
                return Some(self.hold());
            }
            let requested: JointVector = gaps
                .iter()
                .map(|gap| gap.signum() * max_stopping_speed(gap.abs(), self.acceleration))
                .collect();
            self.limited_velocity(&requested, input.commanded, secs)
        });
        output
    }
}
