//! The base of the arm behind a tracked shoulder: the one filter between the poses of a tracker and the physics.

use nalgebra::{Quaternion, SVector, UnitQuaternion};
use proact_types::{Pose, TICK_SECS, Vector};

/// Each of the filter's five equal poles, rad/s: quick enough for a lean, slow enough for a tracker's noise.
const POLE_RAD_PER_S: f64 = 35.0;
/// What the filter adds to the age of a pose, s.
const LAG_SECS: f64 = 0.015;

/// A pose as far as this from where the base is led, m, is a jump, not a movement;
const JUMP_M: f64 = 0.1;
/// so is one turned by as much as this, rad.
const JUMP_RAD: f64 = 0.35;
/// After a jump the base waits this long for the shoulder to come back, in ticks; then it goes to where that is,
const JUMP_WAIT_TICKS: u32 = 1000;
/// at this speed, m/s,
const RECOVERY_SPEED_M_PER_S: f64 = 0.2;
/// and turns at this one, rad/s.
const RECOVERY_SPEED_RAD_PER_S: f64 = 0.5;

/// Fastest that a shoulder is followed: a tracker that jumps must not hurl the arm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FollowSpeedLimits {
    /// m/s.
    pub m_per_s: f64,
    /// rad/s.
    pub rad_per_s: f64,
}

/// Leads the base behind tracked poses: `world_from_base`, metres, a step a tick.
///
/// Poses may come at any rate, late, with gaps and noise. What is asked of the base has a continuous acceleration: no
/// pose, however far from the one before, kicks the arm. A shoulder that moves with constant acceleration is
/// followed exactly, [`LAG_SECS`] after its poses arrive (a tracker's own delay, and half the time between two poses, come on
/// top). Speeds above [`FollowSpeedLimits`] are cut. After a jump the base
/// stands, and in the end goes slowly to where the shoulder has stayed. Deterministic.
#[derive(Clone, Debug)]
pub struct ShoulderFilter {
    speeds: FollowSpeedLimits,
    /// As tracked last.
    tracked: Pose,
    /// On its way to `asked`, within the speeds: what is filtered.
    rate_limited: Pose,
    low_pass: LowPassCascade,
    following: FollowMode,
}

/// How the base takes what is asked.
#[derive(Clone, Copy, Debug, PartialEq)]
enum FollowMode {
    Tracking,
    /// Not at all since a jump, for so many ticks.
    WaitingAfterJump(u32),
    Recovering,
}

impl ShoulderFilter {
    /// A base that stands at `pose`.
    pub fn new(pose: Pose, speeds: FollowSpeedLimits) -> Self {
        Self {
            speeds,
            tracked: pose,
            rate_limited: pose,
            low_pass: LowPassCascade::at(&pose),
            following: FollowMode::Tracking,
        }
    }

    /// `world_from_base` asked for now.
    pub fn pose(&self) -> Pose {
        self.low_pass.pose()
    }

    /// Where the shoulder is, as tracked last.
    pub fn tracked_pose(&self) -> Pose {
        self.tracked
    }

    /// A new tracked pose; a finite one.
    pub fn set_tracked_pose(&mut self, pose: Pose) {
        self.tracked = pose;
    }

    /// Whether the plant refused to follow in the last tick, and where its base is. True if arm and hand must stand still:
    /// the base waits after a jump, or is on its way to where the shoulder went.
    pub fn update_pause(&mut self, refused: bool, at: Pose) -> bool {
        if refused {
            // The plant's base is elsewhere: from there on.
            self.rate_limited = at;
            self.low_pass = LowPassCascade::at(&at);
        }
        refused || self.following != FollowMode::Tracking
    }

    /// Advances by one tick.
    pub fn step(&mut self) {
        let distance = (self.tracked.translation.vector - self.rate_limited.translation.vector).norm();
        let turn = self.rate_limited.rotation.angle_to(&self.tracked.rotation);
        let far = distance >= JUMP_M || turn >= JUMP_RAD;
        self.following = match self.following {
            FollowMode::Tracking if far => FollowMode::WaitingAfterJump(0),
            FollowMode::WaitingAfterJump(_) if !far => FollowMode::Tracking,
            FollowMode::WaitingAfterJump(JUMP_WAIT_TICKS) => FollowMode::Recovering,
            FollowMode::WaitingAfterJump(ticks) => FollowMode::WaitingAfterJump(ticks + 1),
            FollowMode::Recovering if self.rate_limited == self.tracked => FollowMode::Tracking,
            as_before => as_before,
        };
        let (speed, turn_speed) = match self.following {
            FollowMode::Tracking => (self.speeds.m_per_s, self.speeds.rad_per_s),
            FollowMode::WaitingAfterJump(_) => (0.0, 0.0),
            FollowMode::Recovering => (RECOVERY_SPEED_M_PER_S, RECOVERY_SPEED_RAD_PER_S),
        };
        self.rate_limited = interpolate_pose(
            &self.rate_limited,
            &self.tracked,
            step_fraction(distance, speed).min(step_fraction(turn, turn_speed)),
        );
        self.low_pass.step(&self.rate_limited);
    }
}

/// How much of a way may be gone in a tick at this speed.
fn step_fraction(distance: f64, speed: f64) -> f64 {
    if distance > 0.0 { (speed * TICK_SECS / distance).min(1.0) } else { 1.0 }
}

fn interpolate_pose(from: &Pose, to: &Pose, share: f64) -> Pose {
    if share >= 1.0 {
        return *to;
    }
    // Between opposite attitudes there is no shortest way; a tracker does not stay there.
    from.try_lerp_slerp(to, share, 1e-9).unwrap_or(*from)
}

/// A pose as seven numbers: place, and attitude as a quaternion, of either sign.
type PoseVector = SVector<f64, 7>;

/// Five equal low passes one behind the other, and of the last three outputs that sum which has the delay [`LAG_SECS`] for
/// every motion up to constant acceleration. Three poles more than zeros: acceleration has no steps.
#[derive(Clone, Debug)]
struct LowPassCascade {
    stages: [PoseVector; 5],
    /// Of what it lacks, how much a pass takes in each tick.
    share: f64,
    /// Of the third and fourth pass; the fifth has what is missing to 1.
    weights: [f64; 2],
}

impl LowPassCascade {
    /// At rest.
    fn at(pose: &Pose) -> Self {
        let share = 1.0 - (-POLE_RAD_PER_S * TICK_SECS).exp();
        Self { stages: [pose_vector(pose); 5], share, weights: weights(share, LAG_SECS / TICK_SECS) }
    }

    fn step(&mut self, pose: &Pose) {
        let mut input = pose_vector(pose);
        // The same attitude has two quaternions: the nearer one.
        if input.fixed_rows::<4>(3).dot(&self.stages[4].fixed_rows::<4>(3)) < 0.0 {
            input.fixed_rows_mut::<4>(3).neg_mut();
        }
        for pass in &mut self.stages {
            *pass += (input - *pass) * self.share;
            input = *pass;
        }
    }

    fn pose(&self) -> Pose {
        let [_, _, third, fourth, fifth] = &self.stages;
        // Differences, so that a base at rest is where it is told to the bit.
        let sum = fifth + (third - fifth) * self.weights[0] + (fourth - fifth) * self.weights[1];
        let rotation = Quaternion::from(sum.fixed_rows::<4>(3).into_owned());
        Pose::from_parts(
            Vector::from(sum.fixed_rows::<3>(0).into_owned()).into(),
            UnitQuaternion::new_normalize(rotation),
        )
    }
}

fn pose_vector(pose: &Pose) -> PoseVector {
    let (position, rotation) = (pose.translation.vector, pose.rotation.coords);
    PoseVector::from_iterator(position.iter().chain(rotation.iter()).copied())
}

/// Weights of the third and fourth pass. `k` passes delay by a random number of ticks whose mean is `k m` and whose
/// variance `k v`; the weights give the sum the first two moments of a delay by `lag` ticks.
fn weights(share: f64, lag: f64) -> [f64; 2] {
    let m = (1.0 - share) / share;
    let v = m / share;
    // The sums of k w and of k k w over the weights w of the passes k = 3, 4, 5, which are 1 together.
    let first = lag / m;
    let second = (lag * lag - v * first) / (m * m);
    // With the fifth weight put in: 2 third + fourth = 5 - first, 16 third + 9 fourth = 25 - second.
    let (p, q) = (5.0 - first, 25.0 - second);
    [(9.0 * p - q) / 2.0, q - 8.0 * p]
}

#[cfg(test)]
mod tests {
    use super::*;

    const SPEEDS: FollowSpeedLimits = FollowSpeedLimits { m_per_s: 2.0, rad_per_s: 6.0 };

    fn base() -> ShoulderFilter {
        ShoulderFilter::new(Pose::identity(), SPEEDS)
    }

    /// Ticks in which arm and hand stand still, and the highest speed, m/s.
    fn run(base: &mut ShoulderFilter, ticks: u32, mut target_pose: impl FnMut(u32) -> Pose) -> (u32, f64) {
        let (mut paused, mut fastest) = (0, 0.0_f64);
        for tick in 0..ticks {
            if tick.is_multiple_of(10) {
                base.set_tracked_pose(target_pose(tick));
            }
            let before = base.pose();
            base.step();
            fastest =
                fastest.max((base.pose().translation.vector - before.translation.vector).norm() / TICK_SECS);
            paused += u32::from(base.update_pause(false, base.pose()));
        }
        (paused, fastest)
    }

    #[test]
    fn constant_acceleration_is_followed_with_the_stated_lag() {
        let mut base = base();
        let position = |secs: f64| 0.1 * secs * secs;
        for tick in 1..=2000 {
            base.set_tracked_pose(Pose::translation(position(f64::from(tick) * TICK_SECS), 0.0, 0.0));
            base.step();
        }
        let (is, expected) = (base.pose().translation.x, position(2.0 - LAG_SECS));
        assert!((is - expected).abs() < 1e-9, "{is}, expected {expected} m");
    }

    #[test]
    fn a_base_at_rest_stays_to_the_bit_and_an_attitude_has_one_quaternion() {
        let pose = Pose::from_parts(
            Vector::new(-0.6, -0.18, 1.445).into(),
            UnitQuaternion::from_euler_angles(0.1, 0.2, 3.0),
        );
        let mut base = ShoulderFilter::new(pose, SPEEDS);
        let first = base.pose();
        let same = UnitQuaternion::new_unchecked(-pose.rotation.into_inner());
        for tick in 0..300 {
            base.set_tracked_pose(Pose::from_parts(
                pose.translation,
                if tick % 2 == 0 { same } else { pose.rotation },
            ));
            base.step();
            assert_eq!(base.pose(), first);
        }
    }

    #[test]
    fn a_base_does_not_follow_a_jump_and_goes_on_when_the_shoulder_is_back() {
        let mut base = base();
        let away = |_| Pose::translation(0.3, 0.0, 0.0);
        assert_eq!(run(&mut base, 500, away), (500, 0.0));
        let (paused, fastest) = run(&mut base, 1000, |_| Pose::translation(0.002, 0.0, 0.0));
        assert!(paused == 0 && fastest < 0.1, "{paused} ticks, {fastest} m/s");
        assert!((base.pose().translation.x - 0.002).abs() < 1e-9);
    }

    #[test]
    fn a_base_goes_slowly_to_where_the_shoulder_has_stayed_for_a_second() {
        let mut base = base();
        // The shoulder trembles, as tracking does.
        let away = |tick: u32| Pose::translation(0.3 + 1e-4 * f64::from(tick / 10 % 3), 0.0, 0.0);
        let (paused, fastest) = run(&mut base, 4000, away);
        assert!((base.pose().translation.x - 0.3).abs() < 1e-3, "{}", base.pose());
        assert!(fastest < 1.4 * RECOVERY_SPEED_M_PER_S, "{fastest} m/s");
        assert!((2400..2600).contains(&paused), "one second of waiting and 1.5 of way: {paused} ms");
    }

    #[test]
    fn a_shoulder_that_turns_at_once_is_followed_within_its_speed() {
        let mut base = base();
        base.set_tracked_pose(Pose::rotation(Vector::new(0.0, 0.0, 0.3)));
        let mut fastest = 0.0_f64;
        for _ in 0..1000 {
            let before = base.pose().rotation;
            base.step();
            fastest = fastest.max(before.angle_to(&base.pose().rotation) / TICK_SECS);
        }
        assert!((base.pose().rotation.angle() - 0.3).abs() < 1e-9);
        assert!((3.0..7.0).contains(&fastest), "{fastest} rad/s");
    }
}
