//! From commands to joint targets, tick by tick: what stands between a control method and the position control
//! of the plant.

use crate::ConfigError;
use proact_arm::{ArmModel, JointLimits, MimicCouplings};
use proact_control::{MotionCommand, MotionState};
use proact_localization::FollowSpeedLimits;
use proact_types::{JointVector, TICK_SECS, Trajectory, format_number, joints};
use serde::{Deserialize, Serialize};

/// Peak over mean speed of a minimum-jerk movement.
const PEAK_OVER_MEAN: f64 = 1.875;
/// A speed command holds for this many ticks: two control steps. Silence stops the arm.
const VELOCITY_TICKS: u64 = 20;
/// A joint stops within this many ticks of the command and is on its target again if nothing is in its way.
const SETTLE_TICKS: u64 = 50;
/// A held joint that is further from its target than this is blocked or pushed, rad. The position control moves a joint
/// at 200 times its error in a second, so that what remains moves it at 0.02 rad/s at most.
const HOLD_TOLERANCE_RAD: f64 = 1e-4;

/// How fast hand, shoulder and limb follow what is asked of them.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct MotionConfig {
    /// Highest speed of the hand joints, rad/s. Assumed; the original's 0.5 rad/s makes a grasp take two seconds.
    pub hand_rad_per_s: f64,
    /// A tracked shoulder is followed at this speed at most, m/s: faster than people lean. A tracker that jumps must not
    /// hurl the arm through the blocks.
    pub shoulder_m_per_s: f64,
    /// The same for its turning, rad/s.
    pub shoulder_rad_per_s: f64,
    /// A joint of the tracked limb is followed at this speed at most, rad/s: the arm's speed too.
    pub limb_rad_per_s: f64,
}

impl Default for MotionConfig {
    fn default() -> Self {
        Self { hand_rad_per_s: 2.0, shoulder_m_per_s: 2.0, shoulder_rad_per_s: 6.0, limb_rad_per_s: 0.5 }
    }
}

impl MotionConfig {
    /// How fast a tracked shoulder is followed at most.
    pub fn shoulder(&self) -> FollowSpeedLimits {
        FollowSpeedLimits { m_per_s: self.shoulder_m_per_s, rad_per_s: self.shoulder_rad_per_s }
    }

    /// Checks ranges.
    ///
    /// # Errors
    /// [`ConfigError::Value`] naming the first key that is out of range.
    pub fn check(&self) -> Result<(), ConfigError> {
        for (key, got) in [
            ("motion.hand_rad_per_s", self.hand_rad_per_s),
            ("motion.shoulder_m_per_s", self.shoulder_m_per_s),
            ("motion.shoulder_rad_per_s", self.shoulder_rad_per_s),
            ("motion.limb_rad_per_s", self.limb_rad_per_s),
        ] {
            if !(0.01..=20.0).contains(&got) {
                let expected = "0.01 to 20";
                return Err(ConfigError::Value { key, got: format_number(got), expected });
            }
        }
        Ok(())
    }
}

/// Carries out one command for the arm at a time, within the joint limits.
#[derive(Clone, Debug)]
pub struct ArmMotion {
    limits: Vec<JointLimits>,
    position: JointVector,
    velocity: JointVector,
    active_command: ActiveCommand,
    elapsed_ticks: u64,
    /// For so many ticks the arm has held.
    held_ticks: u64,
}

/// What the arm does.
#[derive(Clone, Debug)]
enum ActiveCommand {
    Hold { finished: bool },
    Trajectory(Trajectory),
    Velocity(JointVector),
    Goto(JointVector),
}

impl ArmMotion {
    /// An arm that holds `start`, rad.
    pub fn new(model: &ArmModel, start: &[f64]) -> Self {
        Self {
            limits: model.arm.iter().map(|&j| model.joints[j].limits).collect(),
            position: joints(start),
            velocity: start.iter().map(|_| 0.0).collect(),
            active_command: ActiveCommand::Hold { finished: false },
            elapsed_ticks: 0,
            held_ticks: 0,
        }
    }

    /// Angles asked of the arm now, rad.
    pub fn position(&self) -> &JointVector {
        &self.position
    }

    /// Speeds that go with them, rad/s.
    pub fn velocity(&self) -> &JointVector {
        &self.velocity
    }

    /// Where the path that is followed ends, rad.
    pub fn goal(&self) -> Option<JointVector> {
        match &self.active_command {
            ActiveCommand::Trajectory(path) => path.points.last().map(|point| point.q.clone()),
            _ => None,
        }
    }

    /// What the arm does.
    pub fn state(&self) -> MotionState {
        match &self.active_command {
            ActiveCommand::Trajectory(path) => {
                let progress = self.elapsed_ticks as f64 * TICK_SECS / path.duration_secs().max(TICK_SECS);
                MotionState::Following(progress.min(1.0))
            }
            ActiveCommand::Hold { finished: true } => MotionState::Finished,
            ActiveCommand::Hold { finished: false } | ActiveCommand::Velocity(_) | ActiveCommand::Goto(_) => {
                MotionState::Holding
            }
        }
    }

    /// A new command, in place of the one before.
    pub fn apply(&mut self, command: MotionCommand) {
        self.elapsed_ticks = 0;
        self.velocity.iter_mut().for_each(|v| *v = 0.0);
        self.active_command = match command {
            MotionCommand::Hold => ActiveCommand::Hold { finished: false },
            MotionCommand::Follow(path) => ActiveCommand::Trajectory(path),
            MotionCommand::Velocity(speeds) => ActiveCommand::Velocity(speeds),
            MotionCommand::Goto(angles) => ActiveCommand::Goto(angles),
        };
    }

    /// Somebody else drives one joint in this tick: what was commanded is given up. Within the limits, as a command.
    pub fn override_joint(&mut self, joint: usize, position: f64, velocity: f64) {
        if !matches!(self.active_command, ActiveCommand::Hold { finished: false }) {
            self.apply(MotionCommand::Hold);
        }
        let limits = self.limits[joint];
        self.position[joint] = position.clamp(limits.lower, limits.upper);
        self.velocity[joint] = velocity;
        self.held_ticks = 0;
    }

    /// Gives up the targets that an arm that holds does not reach: a joint that something blocks or has pushed away is held
    /// where it is, `measured`, rad. Otherwise its motor would move it as soon as the contact breaks.
    pub fn release_unreached_targets(&mut self, measured: &[f64]) {
        let holds = matches!(self.active_command, ActiveCommand::Hold { .. });
        self.held_ticks = if holds { self.held_ticks + 1 } else { 0 };
        if self.held_ticks <= SETTLE_TICKS {
            return;
        }
        for ((target, is), limits) in self.position.iter_mut().zip(measured).zip(&self.limits) {
            if (*target - is).abs() > HOLD_TOLERANCE_RAD {
                *target = is.clamp(limits.lower, limits.upper);
            }
        }
    }

    /// Advances by one tick.
    pub fn step(&mut self) {
        self.elapsed_ticks += 1;
        let elapsed = self.elapsed_ticks as f64 * TICK_SECS;
        let (over, finished) = match &self.active_command {
            ActiveCommand::Hold { .. } => return,
            ActiveCommand::Trajectory(path) => {
                let sample = path.sample(elapsed);
                let over = elapsed >= path.duration_secs();
                if let Some((position, velocity)) = sample {
                    self.set_targets_within_limits(&position, &velocity);
                }
                (over, true)
            }
            ActiveCommand::Velocity(speeds) => {
                let speeds = speeds.clone();
                let next: JointVector =
                    self.position.iter().zip(&speeds).map(|(q, v)| q + v * TICK_SECS).collect();
                self.set_targets_within_limits(&next, &speeds);
                (self.elapsed_ticks >= VELOCITY_TICKS, false)
            }
            ActiveCommand::Goto(angles) => {
                let toward = |((q, goal), limits): ((&f64, &f64), &JointLimits)| {
                    (goal - q).clamp(-limits.velocity * TICK_SECS, limits.velocity * TICK_SECS)
                };
                let steps: JointVector =
                    self.position.iter().zip(angles).zip(&self.limits).map(toward).collect();
                let over = steps.iter().all(|step| *step == 0.0);
                let next: JointVector = self.position.iter().zip(&steps).map(|(q, step)| q + step).collect();
                let speeds: JointVector = steps.iter().map(|step| step / TICK_SECS).collect();
                self.set_targets_within_limits(&next, &speeds);
                (over, false)
            }
        };
        if over {
            self.active_command = ActiveCommand::Hold { finished };
            self.velocity.iter_mut().for_each(|v| *v = 0.0);
        }
    }

    /// Asks for angles and speeds, within the limits; what is not finite is not asked for.
    fn set_targets_within_limits(&mut self, position: &[f64], velocity: &[f64]) {
        for (k, limits) in self.limits.iter().enumerate() {
            if !(position[k].is_finite() && velocity[k].is_finite()) {
                self.velocity[k] = 0.0;
                continue;
            }
            let within = position[k].clamp(limits.lower, limits.upper);
            self.position[k] = within;
            self.velocity[k] = if within == position[k] { velocity[k] } else { 0.0 };
        }
    }
}

/// Moves the hand between its two poses, all joints together with minimum jerk.
#[derive(Clone, Debug)]
pub struct HandMotion {
    speed: f64,
    /// What the speed is multiplied by, by joint.
    per_radian: JointVector,
    from: JointVector,
    to: JointVector,
    position: JointVector,
    velocity: JointVector,
    elapsed_ticks: u64,
    duration_ticks: u64,
    /// Angles that each joint goes to by itself, in place of the movement to a pose, rad.
    joint_targets: Option<JointVector>,
}

impl HandMotion {
    /// A hand that rests at `open`, rad or m, and moves at `speed` at most, rad/s; joints that slide at `per_radian` times as many m/s.
    pub fn new(open: &[f64], speed: f64, per_radian: JointVector) -> Self {
        let open = joints(open);
        Self {
            speed,
            per_radian,
            from: open.clone(),
            to: open.clone(),
            velocity: open.iter().map(|_| 0.0).collect(),
            position: open,
            elapsed_ticks: 0,
            duration_ticks: 0,
            joint_targets: None,
        }
    }

    /// Angles asked of the hand now, rad.
    pub fn position(&self) -> &JointVector {
        &self.position
    }

    /// Speeds that go with them, rad/s.
    pub fn velocity(&self) -> &JointVector {
        &self.velocity
    }

    /// Whether it is on its way.
    pub fn is_moving(&self) -> bool {
        self.joint_targets.is_some() || self.elapsed_ticks < self.duration_ticks
    }

    /// Each joint goes to its angle, rad, at the hand's speed at most, until something else is asked.
    pub fn move_joints_to(&mut self, angles: JointVector) {
        self.duration_ticks = 0;
        self.elapsed_ticks = 0;
        // What is there already is not on its way: a decoder says the same angles again and again.
        self.velocity.iter_mut().for_each(|v| *v = 0.0);
        self.joint_targets = (angles != self.position).then_some(angles);
    }

    /// Stays where it is asked to be.
    pub fn hold(&mut self) {
        self.velocity.iter_mut().for_each(|v| *v = 0.0);
        self.duration_ticks = 0;
        self.elapsed_ticks = 0;
        self.joint_targets = None;
    }

    /// Where it goes, or went last, rad.
    pub fn goal(&self) -> &JointVector {
        &self.to
    }

    /// Sets off to these angles, rad, from where it is.
    pub fn go_to(&mut self, angles: &JointVector) {
        self.joint_targets = None;
        self.from = self.position.clone();
        self.to = angles.clone();
        let ways = self.from.iter().zip(&self.to).zip(&self.per_radian);
        let travel =
            ways.into_iter().fold(0.0_f64, |m, ((a, b), per_radian)| m.max((a - b).abs() / per_radian));
        self.elapsed_ticks = 0;
        self.duration_ticks = (travel * PEAK_OVER_MEAN / self.speed / TICK_SECS).ceil() as u64;
    }

    /// Holds the fingers where they are: on the block that they took.
    pub fn hold_at(&mut self, position: &[f64]) {
        self.hold();
        self.position = joints(position);
    }

    /// Somebody else drives one joint in this tick: what was commanded is given up. Joints that follow others go where
    /// these are.
    pub fn override_joint(&mut self, couplings: &MimicCouplings, joint: usize, position: f64, velocity: f64) {
        self.duration_ticks = 0;
        self.elapsed_ticks = 0;
        self.joint_targets = None;
        self.position[joint] = position;
        self.velocity[joint] = velocity;
        couplings.apply(&mut self.position, &mut self.velocity);
    }

    /// Advances by one tick.
    pub fn step(&mut self) {
        if let Some(angles) = self.joint_targets.take() {
            for (k, angle) in angles.iter().enumerate() {
                let max_step = self.speed * TICK_SECS * self.per_radian[k];
                let step = (angle - self.position[k]).clamp(-max_step, max_step);
                self.position[k] += step;
                self.velocity[k] = step / TICK_SECS;
            }
            // In the tick after the last step the fingers are at rest.
            self.joint_targets = self.velocity.iter().any(|v| *v != 0.0).then_some(angles);
            return;
        }
        if !self.is_moving() {
            return;
        }
        self.elapsed_ticks += 1;
        let duration = self.duration_ticks as f64;
        let s = self.elapsed_ticks as f64 / duration;
        let (s2, s3) = (s * s, s * s * s);
        let shape = s3 * (10.0 - 15.0 * s + 6.0 * s2);
        let slope = 30.0 * s2 * (1.0 - 2.0 * s + s2) / (duration * TICK_SECS);
        for k in 0..self.position.len() {
            let travel = self.to[k] - self.from[k];
            self.position[k] = self.from[k] + travel * shape;
            self.velocity[k] = travel * slope;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_hand_arrives_at_rest_within_its_speed() {
        let mut hand = HandMotion::new(&[0.0, 0.3], 2.0, joints(&[1.0, 1.0]));
        hand.go_to(&joints(&[0.6, 0.3]));
        let mut fastest: f64 = 0.0;
        while hand.is_moving() {
            hand.step();
            fastest = fastest.max(hand.velocity()[0]);
        }
        assert_eq!(hand.position().as_slice(), [0.6, 0.3]);
        assert!((1.9..=2.0).contains(&fastest), "{fastest} rad/s");
        assert!(hand.velocity()[0].abs() < 1e-9);
    }

    #[test]
    fn single_fingers_go_to_their_angles_at_the_hands_speed_and_stop_when_they_are_told() {
        let mut hand = HandMotion::new(&[0.0, 0.3], 2.0, joints(&[1.0, 1.0]));
        hand.move_joints_to(joints(&[0.1, 0.3]));
        (0..25).for_each(|_| hand.step());
        assert!((hand.position()[0] - 0.05).abs() < 1e-9 && hand.is_moving(), "2 rad/s for 25 ms");
        assert_eq!((hand.velocity()[0], hand.velocity()[1]), (2.0, 0.0));
        (0..30).for_each(|_| hand.step());
        assert_eq!((hand.position().as_slice(), hand.is_moving()), (&[0.1, 0.3][..], false));
        hand.move_joints_to(joints(&[0.0, 0.0]));
        (0..10).for_each(|_| hand.step());
        hand.hold();
        let held = hand.position().clone();
        (0..10).for_each(|_| hand.step());
        assert_eq!((hand.position(), hand.velocity()[0]), (&held, 0.0));
    }

    fn arm() -> ArmMotion {
        let limits = JointLimits { lower: -1.0, upper: 1.0, velocity: 0.5, effort: 1.0 };
        ArmMotion {
            limits: vec![limits; 2],
            position: joints(&[0.0, 0.9]),
            velocity: joints(&[0.0, 0.0]),
            active_command: ActiveCommand::Hold { finished: false },
            elapsed_ticks: 0,
            held_ticks: 0,
        }
    }

    #[test]
    fn a_speed_command_that_is_not_renewed_stops_the_arm_and_limits_hold() {
        let mut arm = arm();
        arm.apply(MotionCommand::Velocity(joints(&[0.4, 10.0])));
        (0..100).for_each(|_| arm.step());
        assert!((arm.position()[0] - 0.4 * 0.02).abs() < 1e-12, "{:?}", arm.position());
        assert_eq!(arm.position()[1], 1.0, "the joint limit");
        assert_eq!(arm.velocity().as_slice(), [0.0, 0.0]);
    }

    #[test]
    fn an_arm_that_holds_gives_up_targets_that_it_does_not_reach_and_keeps_those_that_it_does() {
        let mut arm = arm();
        let blocked = |arm: &mut ArmMotion, measured: [f64; 2], ticks: u64| {
            for _ in 0..ticks {
                arm.step();
                arm.release_unreached_targets(&measured);
            }
        };
        arm.apply(MotionCommand::Velocity(joints(&[0.4, 0.0])));
        blocked(&mut arm, [0.0, 0.9], VELOCITY_TICKS - 1);
        arm.apply(MotionCommand::Hold);
        let setpoints = arm.position().clone();
        assert!(setpoints[0] > 0.007, "{setpoints:?}");
        blocked(&mut arm, [0.0, 0.9], SETTLE_TICKS);
        assert_eq!(*arm.position(), setpoints, "a joint that only lags gets there");
        // A method may say it again and again.
        arm.apply(MotionCommand::Hold);
        blocked(&mut arm, [0.0, 0.9 + HOLD_TOLERANCE_RAD / 2.0], 1);
        assert_eq!(arm.position().as_slice(), [0.0, 0.9], "the second one is where it should be");
        blocked(&mut arm, [-2.0, 0.5], 1);
        assert_eq!(arm.position().as_slice(), [-1.0, 0.5], "pushed away, and within the limits");
    }

    #[test]
    fn a_goal_is_approached_at_the_joints_speed_and_numbers_that_are_none_are_not_asked_for() {
        let mut arm = arm();
        arm.apply(MotionCommand::Goto(joints(&[0.1, f64::NAN])));
        (0..100).for_each(|_| arm.step());
        assert!((arm.position()[0] - 0.05).abs() < 1e-12, "0.5 rad/s for 0.1 s");
        assert_eq!(arm.position()[1], 0.9);
        (0..200).for_each(|_| arm.step());
        assert!((arm.position()[0] - 0.1).abs() < 1e-12);
    }
}
