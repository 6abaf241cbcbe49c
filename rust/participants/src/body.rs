use nalgebra::{Translation3, UnitQuaternion};
use proact_types::{Point, Pose, SimTime, TICK_SECS, TrunkPosture, Vector, format_number, shorten_numbers};
use serde::{Deserialize, Serialize};

/// Peak speed of a minimum-jerk movement over its mean speed.
const PEAK_OVER_MEAN: f64 = 1.875;
/// Search for a posture: steps, difference of an angle, rad, damping, m^2/rad^2, and what it may be off by, metres.
const TRUNK_STEPS: usize = 12;
const TRUNK_DIFFERENCE: f64 = 1e-4;
const TRUNK_DAMPING: f64 = 1e-4;
const TRUNK_IK_TOLERANCE_M: f64 = 0.012;
/// No movement of the trunk is quicker than this, s.
const SHORTEST_SECS: f64 = 0.4;

/// A participant's upper body: a trunk that turns about the hip, with the prosthesis at the shoulder and the eyes
/// on top. Points are those of the upright posture, in `world`, metres.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Body {
    /// Pivot of the trunk.
    pub hip_m: Point,
    /// Origin of the arm's `base_link`; its axes are those of `world` when upright.
    pub shoulder_m: Point,
    /// Between the eyes; the head turns with the trunk.
    pub eye_m: Point,
    /// Furthest lean forward, degrees; backwards a third of it.
    pub forward_max_deg: f64,
    /// Furthest lean to either side, degrees.
    pub lateral_max_deg: f64,
    /// Furthest turn to either side, degrees.
    pub axial_max_deg: f64,
    /// Highest speed about any axis, degrees per second.
    pub speed_max_deg_per_s: f64,
    /// Lean from which all places of the task can be reached: forward, lateral, axial, degrees.
    pub reaching_posture_deg: [f64; 3],
}

/// A number of a participant that is outside its range.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{key} = {}, expected {expected}", shorten_numbers(got))]
pub struct OutOfRange {
    /// As in the configuration of a trial.
    pub key: &'static str,
    /// What was given.
    pub got: String,
    /// What is allowed.
    pub expected: &'static str,
}

impl Body {
    /// Checks ranges.
    ///
    /// # Errors
    /// The first key that is out of range.
    pub fn check(&self) -> Result<(), OutOfRange> {
        let refused = |key, got: String, expected| Err(OutOfRange { key, got, expected });
        for (key, point) in [
            ("setup.body.hip_m", &self.hip_m),
            ("setup.body.shoulder_m", &self.shoulder_m),
            ("setup.body.eye_m", &self.eye_m),
        ] {
            if !point.iter().all(|meters| meters.abs() <= 10.0) {
                return refused(key, format!("{:?}", point.coords.as_slice()), "x, y, z of -10 to 10 m");
            }
        }
        for (key, degrees) in [
            ("setup.body.forward_max_deg", self.forward_max_deg),
            ("setup.body.lateral_max_deg", self.lateral_max_deg),
            ("setup.body.axial_max_deg", self.axial_max_deg),
        ] {
            if !(0.0..=90.0).contains(&degrees) {
                return refused(key, format_number(degrees), "0 to 90");
            }
        }
        if !(0.1..=1000.0).contains(&self.speed_max_deg_per_s) {
            return refused(
                "setup.body.speed_max_deg_per_s",
                format_number(self.speed_max_deg_per_s),
                "0.1 to 1000",
            );
        }
        if !self.reaching_posture_deg.iter().all(|degrees| degrees.abs() <= 90.0) {
            return refused(
                "setup.body.reaching_posture_deg",
                format!("{:?}", self.reaching_posture_deg),
                "three angles of -90 to 90",
            );
        }
        Ok(())
    }

    /// The same body with the arm on its other side: mirrored across the plane of x and z.
    pub fn mirrored(&self) -> Self {
        let across = |point: Point| Point::new(point.x, -point.y, point.z);
        let [forward, lateral, axial] = self.reaching_posture_deg;
        Self {
            hip_m: across(self.hip_m),
            shoulder_m: across(self.shoulder_m),
            eye_m: across(self.eye_m),
            // Adding zero turns -0 into 0.
            reaching_posture_deg: [forward, 0.0 - lateral, 0.0 - axial],
            ..*self
        }
    }

    /// The same body beside an arm whose base stands at `base`, `world`, metres. It keeps still: leaning moves no arm.
    pub fn for_fixed_base(&self, base: Point) -> Self {
        let (forward_max_deg, lateral_max_deg, axial_max_deg) = (0.0, 0.0, 0.0);
        Self {
            shoulder_m: base,
            forward_max_deg,
            lateral_max_deg,
            axial_max_deg,
            reaching_posture_deg: [0.0; 3],
            ..*self
        }
    }

    /// The nearest posture that this body can take; not-a-number becomes upright.
    pub fn clamp_posture(&self, posture: TrunkPosture) -> TrunkPosture {
        let within = |value: f64, low: f64, high: f64| {
            if value.is_finite() { value.clamp(low.to_radians(), high.to_radians()) } else { 0.0 }
        };
        TrunkPosture {
            forward: within(posture.forward, -self.forward_max_deg / 3.0, self.forward_max_deg),
            lateral: within(posture.lateral, -self.lateral_max_deg, self.lateral_max_deg),
            axial: within(posture.axial, -self.axial_max_deg, self.axial_max_deg),
        }
    }

    /// How long the trunk takes from rest in one posture to rest in another, s.
    pub(crate) fn movement_secs(&self, from: &TrunkPosture, to: &TrunkPosture) -> f64 {
        let turns = [to.forward - from.forward, to.lateral - from.lateral, to.axial - from.axial];
        let furthest = turns.into_iter().map(f64::abs).fold(0.0, f64::max);
        let speed_max = self.speed_max_deg_per_s.to_radians().max(1e-3);
        SHORTEST_SECS.max(PEAK_OVER_MEAN * furthest / speed_max)
    }

    /// `world_from_shoulder`: the pose of `base_link`.
    pub fn shoulder_pose(&self, posture: &TrunkPosture) -> Pose {
        self.trunk_frame(&self.shoulder_m, posture)
    }

    /// The posture near `from` in which `point`, which the shoulder carries, has moved by `shift`, `world`, metres; none if the
    /// trunk does not reach that far.
    pub(crate) fn posture_moving_point(
        &self,
        from: &TrunkPosture,
        point: &Point,
        shift: &Vector,
    ) -> Option<TrunkPosture> {
        let carried = self.shoulder_pose(from).inverse() * point;
        let wanted = point + shift;
        let posture = |angles: &Vector| {
            self.clamp_posture(TrunkPosture { forward: angles.x, lateral: angles.y, axial: angles.z })
        };
        let at = |angles: &Vector| self.shoulder_pose(&posture(angles)) * carried;
        let mut angles = Vector::new(from.forward, from.lateral, from.axial);
        for _ in 0..TRUNK_STEPS {
            let here = at(&angles);
            let columns = [Vector::x(), Vector::y(), Vector::z()]
                .map(|axis| (at(&(angles + axis * TRUNK_DIFFERENCE)) - here) / TRUNK_DIFFERENCE);
            let jacobian = nalgebra::Matrix3::from_columns(&columns);
            let normal = jacobian.transpose() * jacobian + nalgebra::Matrix3::identity() * TRUNK_DAMPING;
            let step = normal.try_inverse()? * jacobian.transpose() * (wanted - here);
            angles += step.map(|angle| angle.clamp(-0.2, 0.2));
        }
        ((at(&angles) - wanted).norm() < TRUNK_IK_TOLERANCE_M).then(|| posture(&angles))
    }

    /// `world_from_head`: origin at the eyes, x ahead, y left, z up.
    pub fn head_pose(&self, posture: &TrunkPosture) -> Pose {
        self.trunk_frame(&self.eye_m, posture)
    }

    /// A frame that moves with the trunk: first the side lean, then the forward lean, then the turn.
    fn trunk_frame(&self, point: &Point, posture: &TrunkPosture) -> Pose {
        let about = |axis, angle| UnitQuaternion::from_axis_angle(&axis, angle);
        let turn = about(Vector::z_axis(), posture.axial)
            * about(Vector::y_axis(), posture.forward)
            * about(Vector::x_axis(), posture.lateral);
        let position = self.hip_m + turn * (point - self.hip_m);
        Pose::from_parts(Translation3::from(position.coords), turn)
    }
}

/// A trunk in motion. Movements have minimum jerk and keep position, speed and acceleration when the goal
/// changes midway.
#[derive(Clone, Debug)]
pub struct Trunk {
    body: Body,
    goal: TrunkPosture,
    /// Position, speed and acceleration of forward, lateral, axial.
    state: [[f64; 3]; 3],
    /// Seconds left of the present movement.
    left_secs: f64,
}

impl Trunk {
    /// An upright, resting trunk.
    pub fn new(body: Body) -> Self {
        Self { body, goal: TrunkPosture::default(), state: [[0.0; 3]; 3], left_secs: 0.0 }
    }

    /// The body that moves.
    pub fn body(&self) -> &Body {
        &self.body
    }

    /// Moves for one tick toward `requested`, within the body's limits; the new posture.
    pub fn step(&mut self, _now: SimTime, requested: TrunkPosture) -> TrunkPosture {
        let goal = self.body.clamp_posture(requested);
        let targets = [goal.forward, goal.lateral, goal.axial];
        if goal != self.goal {
            self.goal = goal;
            // Time enough for the furthest axis; speed that is there already costs some more.
            let speed_max = self.body.speed_max_deg_per_s.to_radians().max(1e-3);
            let needed = |(state, target): (&[f64; 3], &f64)| {
                PEAK_OVER_MEAN * ((target - state[0]).abs() + state[1].abs() * SHORTEST_SECS) / speed_max
            };
            self.left_secs = self.state.iter().zip(&targets).map(needed).fold(SHORTEST_SECS, f64::max);
        }
        if self.left_secs <= TICK_SECS {
            self.state = targets.map(|target| [target, 0.0, 0.0]);
            self.left_secs = 0.0;
        } else {
            for (state, target) in self.state.iter_mut().zip(targets) {
                *state = minimum_jerk_step(*state, target, self.left_secs);
            }
            self.left_secs -= TICK_SECS;
        }
        self.posture()
    }

    /// The posture now.
    pub fn posture(&self) -> TrunkPosture {
        TrunkPosture { forward: self.state[0][0], lateral: self.state[1][0], axial: self.state[2][0] }
    }
}

/// One tick along the quintic from (position, speed, acceleration) to rest at `target` after `secs`.
fn minimum_jerk_step([p, v, a]: [f64; 3], target: f64, secs: f64) -> [f64; 3] {
    let d = target - p;
    let (s2, s3) = (secs * secs, secs * secs * secs);
    // Coefficients of t^3, t^4, t^5 that end with zero speed and acceleration.
    let c3 = (20.0 * d - 12.0 * v * secs - 3.0 * a * s2) / (2.0 * s3);
    let c4 = (-30.0 * d + 16.0 * v * secs + 3.0 * a * s2) / (2.0 * s3 * secs);
    let c5 = (12.0 * d - 6.0 * v * secs - a * s2) / (2.0 * s3 * s2);
    let t = TICK_SECS;
    let (t2, t3) = (t * t, t * t * t);
    [
        p + v * t + 0.5 * a * t2 + c3 * t3 + c4 * t2 * t2 + c5 * t2 * t3,
        v + a * t + 3.0 * c3 * t2 + 4.0 * c4 * t3 + 5.0 * c5 * t2 * t2,
        a + 6.0 * c3 * t + 12.0 * c4 * t2 + 20.0 * c5 * t3,
    ]
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    pub(crate) fn body() -> Body {
        Body {
            hip_m: Point::new(-0.6, 0.0, 0.995),
            shoulder_m: Point::new(-0.6, -0.18, 1.445),
            eye_m: Point::new(-0.55, 0.0, 1.7),
            forward_max_deg: 35.0,
            lateral_max_deg: 25.0,
            axial_max_deg: 40.0,
            speed_max_deg_per_s: 60.0,
            reaching_posture_deg: [24.0, -18.0, 28.0],
        }
    }

    #[test]
    fn leaning_moves_the_shoulder_ahead_sideways_and_around() {
        let upright = body().shoulder_pose(&TrunkPosture::default()).translation.vector;
        let moved = |posture| body().shoulder_pose(&posture).translation.vector - upright;
        assert!(moved(TrunkPosture { forward: 0.3, ..Default::default() }).x > 0.1);
        assert!(moved(TrunkPosture { lateral: 0.3, ..Default::default() }).y < -0.1, "right is -y");
        assert!(
            moved(TrunkPosture { axial: 0.5, ..Default::default() }).x > 0.08,
            "the right shoulder comes ahead"
        );
    }

    #[test]
    fn a_movement_arrives_at_rest_keeps_to_the_speed_limit_and_never_jumps() {
        let mut trunk = Trunk::new(body());
        let requested = TrunkPosture { forward: 2.0, lateral: -0.2, axial: 0.4 };
        let mut last = trunk.posture();
        let mut fastest: f64 = 0.0;
        for t in 0..3000 {
            // The goal changes in the middle of the movement.
            let requested = if t > 300 { TrunkPosture { axial: -0.3, ..requested } } else { requested };
            let posture = trunk.step(SimTime(t), requested);
            fastest = fastest.max((posture.forward - last.forward).abs() / TICK_SECS);
            fastest = fastest.max((posture.axial - last.axial).abs() / TICK_SECS);
            last = posture;
        }
        assert!((last.forward - 35.0_f64.to_radians()).abs() < 1e-12, "limited to what the body can do");
        assert!((last.axial + 0.3).abs() < 1e-12);
        assert!(fastest <= 60.0_f64.to_radians() * 1.001, "{} degrees/s", fastest.to_degrees());
    }

    #[test]
    fn the_trunk_moves_what_the_shoulder_carries_as_far_as_it_can() {
        let (body, from) = (body(), TrunkPosture { forward: 0.3, lateral: -0.1, axial: 0.2 });
        let hand = Point::new(-0.1, -0.1, 1.15);
        let shift = Vector::new(0.01, -0.03, -0.03);
        let to = body.posture_moving_point(&from, &hand, &shift).unwrap();
        let moved = body.shoulder_pose(&to) * (body.shoulder_pose(&from).inverse() * hand);
        assert!((moved - hand - shift).norm() < 0.012, "{}", moved - hand);
        assert_eq!(body.clamp_posture(to), to, "a posture that the body can take");
        assert_eq!(body.posture_moving_point(&from, &hand, &Vector::new(0.8, 0.0, 0.0)), None);
    }

    #[test]
    fn a_mirrored_body_moves_its_shoulder_as_in_a_mirror() {
        let (right, left) = (body(), body().mirrored());
        let posture = TrunkPosture { forward: 0.3, lateral: -0.2, axial: 0.4 };
        let other = TrunkPosture { lateral: 0.2, axial: -0.4, ..posture };
        let (a, b) = (right.shoulder_pose(&posture), left.shoulder_pose(&other));
        let (a, b) = (a.translation.vector, b.translation.vector);
        assert!((a - Vector::new(b.x, -b.y, b.z)).norm() < 1e-12, "{a} {b}");
        assert_eq!(left.reaching_posture_deg, [24.0, 18.0, -28.0]);
        assert_eq!(left.mirrored(), right);
    }

    #[test]
    fn a_posture_that_is_not_a_number_is_upright() {
        let bad = TrunkPosture { forward: f64::NAN, lateral: f64::INFINITY, axial: 0.1 };
        assert_eq!(body().clamp_posture(bad), TrunkPosture { axial: 0.1, ..Default::default() });
    }
}
