//! The base of the arm behind a tracked shoulder: the one filter between the poses of a tracker and the physics.

use nalgebra::{Quaternion, SVector, UnitQuaternion};
use proact_types::{Pose, TICK_SECS, Vector};

/// Each of the filter's five equal poles, rad/s: quick enough for a lean, slow enough for a tracker's noise.
const POLE_RAD_PER_S: f64 = 35.0;
/// What the filter adds to the age of a pose, s.
const LAG_SECS: f64 = 0.015;

/// A pose as far as this from where the base is led, m, is a jump, not a movement;
const JUMP_METRES: f64 = 0.1;
/// so is one turned by as much as this, rad.
const JUMP_RAD: f64 = 0.35;
/// After a jump the base waits this long for the shoulder to come back, in ticks; then it goes to where that is,
const JUMP_WAIT_TICKS: u32 = 1000;
/// at this speed, m/s,
const RECOVERY_SPEED: f64 = 0.2;
/// and turns at this one, rad/s.
const RECOVERY_TURN_SPEED: f64 = 0.5;

/// Fastest that a shoulder is followed: a tracker that jumps must not hurl the arm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FollowSpeeds {
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
/// top). Speeds above [`FollowSpeeds`] are cut. After a jump the base
/// stands, and in the end goes slowly to where the shoulder has stayed. Deterministic.
#[derive(Clone, Debug)]
pub struct BaseMotion {
    speeds: FollowSpeeds,
    /// As tracked last.
    asked: Pose,
    /// On its way to `asked`, within the speeds: what is filtered.
    led: Pose,
    smooth: Smooth,
    following: Following,
}

/// How the base takes what is asked.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Following {
    Closely,
    /// Not at all since a jump, for so many ticks.
    Waits(u32),
    Slowly,
}

impl BaseMotion {
    /// A base that stands at `pose`.
    pub fn new(pose: Pose, speeds: FollowSpeeds) -> Self {
        Self { speeds, asked: pose, led: pose, smooth: Smooth::at(&pose), following: Following::Closely }
    }

    /// `world_from_base` asked for now.
    pub fn pose(&self) -> Pose {
        self.smooth.pose()
    }

    /// Where the shoulder is, as tracked last.
    pub fn goal(&self) -> Pose {
        self.asked
    }

    /// A new tracked pose; a finite one.
    pub fn track(&mut self, pose: Pose) {
        self.asked = pose;
    }

    /// Whether the plant refused to follow in the last tick, and where its base is. True if arm and hand must stand still:
    /// the base waits after a jump, or is on its way to where the shoulder went.
    pub fn paused(&mut self, refused: bool, at: Pose) -> bool {
        if refused {
            // The plant's base is elsewhere: from there on.
            self.led = at;
            self.smooth = Smooth::at(&at);
        }
        refused || self.following != Following::Closely
    }

    /// Advances by one tick.
    pub fn step(&mut self) {
        let way = (self.asked.translation.vector - self.led.translation.vector).norm();
        let turn = self.led.rotation.angle_to(&self.asked.rotation);
        let far = way >= JUMP_METRES || turn >= JUMP_RAD;
        self.following = match self.following {
            Following::Closely if far => Following::Waits(0),
            Following::Waits(_) if !far => Following::Closely,
            Following::Waits(JUMP_WAIT_TICKS) => Following::Slowly,
            Following::Waits(ticks) => Following::Waits(ticks + 1),
            Following::Slowly if self.led == self.asked => Following::Closely,
            as_before => as_before,
        };
        let (speed, turn_speed) = match self.following {
            Following::Closely => (self.speeds.m_per_s, self.speeds.rad_per_s),
            Following::Waits(_) => (0.0, 0.0),
            Following::Slowly => (RECOVERY_SPEED, RECOVERY_TURN_SPEED),
        };
        self.led = toward(&self.led, &self.asked, share(way, speed).min(share(turn, turn_speed)));
        self.smooth.step(&self.led);
    }
}

/// How much of a way may be gone in a tick at this speed.
fn share(way: f64, speed: f64) -> f64 {
    if way > 0.0 { (speed * TICK_SECS / way).min(1.0) } else { 1.0 }
}

fn toward(from: &Pose, to: &Pose, share: f64) -> Pose {
    if share >= 1.0 {
        return *to;
    }
    // Between opposite attitudes there is no shortest way; a tracker does not stay there.
    from.try_lerp_slerp(to, share, 1e-9).unwrap_or(*from)
}

/// A pose as seven numbers: place, and attitude as a quaternion, of either sign.
type Numbers = SVector<f64, 7>;

/// Five equal low passes one behind the other, and of the last three outputs that sum which has the delay [`LAG_SECS`] for
/// every motion up to constant acceleration. Three poles more than zeros: acceleration has no steps.
#[derive(Clone, Debug)]
struct Smooth {
    passes: [Numbers; 5],
    /// Of what it lacks, how much a pass takes in each tick.
    share: f64,
    /// Of the third and fourth pass; the fifth has what is missing to 1.
    weights: [f64; 2],
}

impl Smooth {
    /// At rest.
    fn at(pose: &Pose) -> Self {
        let share = 1.0 - (-POLE_RAD_PER_S * TICK_SECS).exp();
        Self { passes: [numbers(pose); 5], share, weights: weights(share, LAG_SECS / TICK_SECS) }
    }

    fn step(&mut self, pose: &Pose) {
        let mut input = numbers(pose);
        // The same attitude has two quaternions: the nearer one.
        if input.fixed_rows::<4>(3).dot(&self.passes[4].fixed_rows::<4>(3)) < 0.0 {
            input.fixed_rows_mut::<4>(3).neg_mut();
        }
        for pass in &mut self.passes {
            *pass += (input - *pass) * self.share;
            input = *pass;
        }
    }

    fn pose(&self) -> Pose {
        let [_, _, third, fourth, fifth] = &self.passes;
        // Differences, so that a base at rest is where it is told to the bit.
        let sum = fifth + (third - fifth) * self.weights[0] + (fourth - fifth) * self.weights[1];
        let rotation = Quaternion::from(sum.fixed_rows::<4>(3).into_owned());
        Pose::from_parts(
            Vector::from(sum.fixed_rows::<3>(0).into_owned()).into(),
            UnitQuaternion::new_normalize(rotation),
        )
    }
}

fn numbers(pose: &Pose) -> Numbers {
    let (place, attitude) = (pose.translation.vector, pose.rotation.coords);
    Numbers::from_iterator(place.iter().chain(attitude.iter()).copied())
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

    const SPEEDS: FollowSpeeds = FollowSpeeds { m_per_s: 2.0, rad_per_s: 6.0 };

    fn base() -> BaseMotion {
        BaseMotion::new(Pose::identity(), SPEEDS)
    }

    /// Ticks in which arm and hand stand still, and the highest speed, m/s.
    fn run(base: &mut BaseMotion, ticks: u32, mut asked: impl FnMut(u32) -> Pose) -> (u32, f64) {
        let (mut paused, mut fastest) = (0, 0.0_f64);
        for tick in 0..ticks {
            if tick.is_multiple_of(10) {
                base.track(asked(tick));
            }
            let before = base.pose();
            base.step();
            fastest =
                fastest.max((base.pose().translation.vector - before.translation.vector).norm() / TICK_SECS);
            paused += u32::from(base.paused(false, base.pose()));
        }
        (paused, fastest)
    }

    #[test]
    fn constant_acceleration_is_followed_with_the_stated_lag() {
        let mut base = base();
        let place = |secs: f64| 0.1 * secs * secs;
        for tick in 1..=2000 {
            base.track(Pose::translation(place(f64::from(tick) * TICK_SECS), 0.0, 0.0));
            base.step();
        }
        let (is, expected) = (base.pose().translation.x, place(2.0 - LAG_SECS));
        assert!((is - expected).abs() < 1e-9, "{is}, expected {expected} m");
    }

    #[test]
    fn a_base_at_rest_stays_to_the_bit_and_an_attitude_has_one_quaternion() {
        let pose = Pose::from_parts(
            Vector::new(-0.6, -0.18, 1.445).into(),
            UnitQuaternion::from_euler_angles(0.1, 0.2, 3.0),
        );
        let mut base = BaseMotion::new(pose, SPEEDS);
        let first = base.pose();
        let same = UnitQuaternion::new_unchecked(-pose.rotation.into_inner());
        for tick in 0..300 {
            base.track(Pose::from_parts(pose.translation, if tick % 2 == 0 { same } else { pose.rotation }));
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
        assert!(fastest < 1.4 * RECOVERY_SPEED, "{fastest} m/s");
        assert!((2400..2600).contains(&paused), "one second of waiting and 1.5 of way: {paused} ms");
    }

    #[test]
    fn a_shoulder_that_turns_at_once_is_followed_within_its_speed() {
        let mut base = base();
        base.track(Pose::rotation(Vector::new(0.0, 0.0, 0.3)));
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
