//! From commands to joint targets, tick by tick: what stands between a control method and the position control
//! of the plant.

use nalgebra::UnitQuaternion;
use proact_control::{HandCommand, MotionCommand, MotionState};
use proact_types::{ArmModel, JointVector, Pose, TICK_SECS, Trajectory, joints};

/// Highest speed of the hand joints, rad/s (assumed; the original's 0.5 rad/s makes a grasp take two seconds).
const HAND_SPEED: f64 = 2.0;
/// Peak over mean speed of a minimum-jerk movement.
const PEAK_OVER_MEAN: f64 = 1.875;
/// A tracked shoulder pose arrives at 100 Hz; the base reaches it over this many ticks, without a jump.
const BASE_TICKS: u32 = 10;

/// Follows one trajectory of the arm at a time, within the joint limits.
#[derive(Clone, Debug)]
pub(crate) struct ArmMotion {
    limits: Vec<(f64, f64)>,
    position: JointVector,
    velocity: JointVector,
    path: Option<Trajectory>,
    elapsed_ticks: u64,
    finished: bool,
}

impl ArmMotion {
    pub(crate) fn new(model: &ArmModel, start: &[f64]) -> Self {
        Self {
            limits: model
                .arm
                .iter()
                .map(|&j| (model.joints[j].limits.lower, model.joints[j].limits.upper))
                .collect(),
            position: joints(start),
            velocity: start.iter().map(|_| 0.0).collect(),
            path: None,
            elapsed_ticks: 0,
            finished: false,
        }
    }

    /// Angles asked of the arm now, rad.
    pub(crate) fn position(&self) -> &JointVector {
        &self.position
    }

    pub(crate) fn velocity(&self) -> &JointVector {
        &self.velocity
    }

    pub(crate) fn state(&self) -> MotionState {
        match &self.path {
            Some(path) => {
                let progress = self.elapsed_ticks as f64 * TICK_SECS / path.duration_secs().max(TICK_SECS);
                MotionState::Following(progress.min(1.0))
            }
            None if self.finished => MotionState::Finished,
            None => MotionState::Holding,
        }
    }

    pub(crate) fn apply(&mut self, command: MotionCommand) {
        self.finished = false;
        self.elapsed_ticks = 0;
        self.path = match command {
            MotionCommand::Hold => None,
            MotionCommand::Follow(path) => Some(path),
        };
        self.velocity.iter_mut().for_each(|v| *v = 0.0);
    }

    pub(crate) fn step(&mut self) {
        let Some(path) = &self.path else { return };
        self.elapsed_ticks += 1;
        let elapsed = self.elapsed_ticks as f64 * TICK_SECS;
        if let Some((position, velocity)) = path.sample(elapsed) {
            for (k, &(lower, upper)) in self.limits.iter().enumerate() {
                self.position[k] = position[k].clamp(lower, upper);
                self.velocity[k] = if self.position[k] == position[k] { velocity[k] } else { 0.0 };
            }
        }
        if elapsed >= path.duration_secs() {
            self.path = None;
            self.finished = true;
            self.velocity.iter_mut().for_each(|v| *v = 0.0);
        }
    }
}

/// Moves the hand between its two poses, all joints together with minimum jerk.
#[derive(Clone, Debug)]
pub(crate) struct HandMotion {
    open: JointVector,
    closed: JointVector,
    from: JointVector,
    to: JointVector,
    position: JointVector,
    velocity: JointVector,
    elapsed_ticks: u64,
    duration_ticks: u64,
}

impl HandMotion {
    pub(crate) fn new(open: &[f64], closed: &[f64]) -> Self {
        let open = joints(open);
        Self {
            closed: joints(closed),
            from: open.clone(),
            to: open.clone(),
            position: open.clone(),
            velocity: open.iter().map(|_| 0.0).collect(),
            open,
            elapsed_ticks: 0,
            duration_ticks: 0,
        }
    }

    pub(crate) fn position(&self) -> &JointVector {
        &self.position
    }

    pub(crate) fn velocity(&self) -> &JointVector {
        &self.velocity
    }

    pub(crate) fn moving(&self) -> bool {
        self.elapsed_ticks < self.duration_ticks
    }

    pub(crate) fn apply(&mut self, command: HandCommand) {
        self.from = self.position.clone();
        self.to = match command {
            HandCommand::Open => self.open.clone(),
            HandCommand::Close => self.closed.clone(),
        };
        let travel = self.from.iter().zip(&self.to).fold(0.0_f64, |m, (a, b)| m.max((a - b).abs()));
        self.elapsed_ticks = 0;
        self.duration_ticks = (travel * PEAK_OVER_MEAN / HAND_SPEED / TICK_SECS).ceil() as u64;
    }

    /// Holds the fingers where they are: on the block that they took.
    pub(crate) fn freeze(&mut self, position: &[f64]) {
        self.position = joints(position);
        self.velocity.iter_mut().for_each(|v| *v = 0.0);
        self.duration_ticks = 0;
        self.elapsed_ticks = 0;
    }

    pub(crate) fn step(&mut self) {
        if !self.moving() {
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

/// Carries the base from one tracked pose to the next in a straight line, a step per tick.
#[derive(Clone, Debug)]
pub(crate) struct BaseMotion {
    pose: Pose,
    from: Pose,
    to: Pose,
    ticks: u32,
}

impl BaseMotion {
    pub(crate) fn new(pose: Pose) -> Self {
        Self { pose, from: pose, to: pose, ticks: BASE_TICKS }
    }

    pub(crate) fn pose(&self) -> Pose {
        self.pose
    }

    pub(crate) fn track(&mut self, pose: Pose) {
        self.from = self.pose;
        self.to = pose;
        self.ticks = 0;
    }

    pub(crate) fn step(&mut self) {
        if self.ticks >= BASE_TICKS {
            return;
        }
        self.ticks += 1;
        let s = f64::from(self.ticks) / f64::from(BASE_TICKS);
        let translation = self.from.translation.vector.lerp(&self.to.translation.vector, s);
        // Tracked poses 10 ms apart are never half a turn apart; were they, the nearer end is taken.
        let nearer = if s < 0.5 { self.from.rotation } else { self.to.rotation };
        let rotation: UnitQuaternion<f64> =
            self.from.rotation.try_slerp(&self.to.rotation, s, 1e-12).unwrap_or(nearer);
        self.pose = Pose::from_parts(translation.into(), rotation);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_hand_arrives_at_rest_within_its_speed() {
        let mut hand = HandMotion::new(&[0.0, 0.3], &[0.6, 0.3]);
        hand.apply(HandCommand::Close);
        let mut fastest: f64 = 0.0;
        while hand.moving() {
            hand.step();
            fastest = fastest.max(hand.velocity()[0]);
        }
        assert_eq!(hand.position().as_slice(), [0.6, 0.3]);
        assert!((1.9..=HAND_SPEED).contains(&fastest), "{fastest} rad/s");
        assert!(hand.velocity()[0].abs() < 1e-9);
    }

    #[test]
    fn the_base_moves_in_equal_steps_and_stops() {
        let mut base = BaseMotion::new(Pose::identity());
        base.track(Pose::translation(0.01, 0.0, 0.0));
        for tick in 1..=20_u32 {
            base.step();
            let expected = 0.001 * f64::from(tick.min(10));
            assert!((base.pose().translation.x - expected).abs() < 1e-12);
        }
    }
}
