use crate::Kinematics;
use nalgebra::Rotation3;
use proact_arm::{ArmModel, Inertial};
use proact_control::ports::KinematicsError;
use proact_types::{JointVector, Pose, Vector, zeros};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::f64::consts::TAU;

/// How [`effort_limits`] searches.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EffortOptions {
    /// Mass in the hand, kg: a block of the task.
    pub payload_kg: f64,
    /// Coulomb friction between block and finger: with it, two opposed fingers hold the block by pressing.
    pub finger_friction: f64,
    /// Furthest lean of the trunk forwards, rad. The person looks along x of the base, y is left.
    pub max_forward_lean_rad: f64,
    /// Furthest lean to either side, rad.
    pub max_lateral_lean_rad: f64,
    /// Effort limit as a multiple of the largest static torque.
    pub safety_factor: f64,
    /// Random configurations from which the search starts.
    pub samples: usize,
    /// Seeds them.
    pub seed: u64,
}

impl Default for EffortOptions {
    fn default() -> Self {
        Self {
            payload_kg: 0.1,
            finger_friction: 0.8,
            max_forward_lean_rad: 35f64.to_radians(),
            max_lateral_lean_rad: 25f64.to_radians(),
            safety_factor: 3.0,
            samples: 2000,
            seed: 1,
        }
    }
}

/// What a joint has to bear.
#[derive(Clone, Debug, PartialEq)]
pub struct EffortLimit {
    /// The joint.
    pub joint: String,
    /// Largest torque at rest against gravity, over all angles within the limits and all leans, N m.
    pub static_torque: f64,
    /// Torque with which a finger joint presses its last link on the block so that friction holds it, N m; zero
    /// for the arm.
    pub grip_torque: f64,
    /// The sum times the factor, N m.
    pub effort: f64,
}

/// Starts of the coordinate search for one joint, and sweeps from each.
const STARTS: usize = 4;
const SWEEPS: usize = 6;
/// Gravity of design.md 4, m/s^2.
const GRAVITY: f64 = 9.80665;

/// The largest static torque of every moving joint with a body at the grasp centre, and the effort limit that
/// follows, in the order of [`ArmModel::moving_count`].
///
/// The body's weight rests on the palm's frame, so gravity alone leaves finger joints with the weight of their own
/// links, a few mN m, with which no block can be held. They bear the grip as well: two opposed fingers hold mass m
/// by friction mu when each presses with `m g / (2 mu)`; the lever is the length of the stretched finger from the
/// joint to the centre of mass of its last link, the most that it can be.
///
/// Samples configurations, then climbs from the best ones one coordinate at a time. Gravity torque is
/// `a + b cos(x) + c sin(x)` in any one joint angle x, and in either lean, because the potential energy is linear
/// in cosine and sine of each: three evaluations give the maximum along a coordinate exactly. Deterministic for
/// a seed. Known weakness: coordinate climbing can stay below the true maximum; the best of several starts is
/// taken, and more samples show whether that matters.
///
/// # Errors
/// As [`Kinematics::new`] and [`Kinematics::set_payload`].
pub fn effort_limits(model: &ArmModel, options: &EffortOptions) -> Result<Vec<EffortLimit>, KinematicsError> {
    let mut search = EffortSearch::new(model, options)?;
    let mut random = ChaCha8Rng::seed_from_u64(options.seed);
    let mut samples = Vec::with_capacity(options.samples.max(STARTS));
    for _ in 0..options.samples.max(STARTS) {
        let x: Vec<f64> = search
            .ranges
            .iter()
            .map(|&(lower, upper)| lower + (upper - lower) * random.random::<f64>())
            .collect();
        let torque = search.torque(&x)?;
        samples.push((x, torque));
    }

    let mut limits = Vec::with_capacity(model.moving_count());
    for (k, joint) in model.moving().enumerate() {
        samples.sort_by(|a, b| b.1[k].abs().total_cmp(&a.1[k].abs()));
        let mut static_torque = 0.0f64;
        for (start, _) in &samples[..STARTS] {
            static_torque = static_torque.max(search.coordinate_ascent(start.clone(), k)?);
        }
        let lever = if model.hand.contains(&joint) {
            stretched_length(model, model.joints[joint].child)
        } else {
            0.0
        };
        let grip_torque = lever * options.payload_kg * GRAVITY / (2.0 * options.finger_friction);
        limits.push(EffortLimit {
            joint: model.joints[joint].name.clone(),
            static_torque,
            grip_torque,
            effort: options.safety_factor * (static_torque + grip_torque),
        });
    }
    Ok(limits)
}

/// Length of the stretched chain from the origin of `link` to the centre of mass of the last link below it, metres.
fn stretched_length(model: &ArmModel, link: usize) -> f64 {
    let below = model.joints.iter().filter(|joint| joint.parent == link);
    let max_reach = below
        .map(|joint| joint.origin.translation.vector.norm() + stretched_length(model, joint.child))
        .max_by(f64::total_cmp);
    max_reach
        .unwrap_or_else(|| model.links[link].inertial.map_or(0.0, |own| own.pose.translation.vector.norm()))
}

/// Coordinates: the moving joints, then the lean forwards and to the side.
struct EffortSearch {
    kinematics: Kinematics,
    ranges: Vec<(f64, f64)>,
    zero_velocity: JointVector,
}

impl EffortSearch {
    fn new(model: &ArmModel, options: &EffortOptions) -> Result<Self, KinematicsError> {
        let mut kinematics = Kinematics::new(model)?;
        let pose = Pose::from_parts(model.widest_grasp().center.into(), nalgebra::UnitQuaternion::identity());
        // At rest the shape of the body does not matter, only its weight.
        kinematics.set_payload(Some(&Inertial { mass: options.payload_kg, pose, inertia: [0.0; 6] }))?;
        let mut ranges: Vec<(f64, f64)> = model
            .moving()
            .map(|joint| (model.joints[joint].limits.lower, model.joints[joint].limits.upper))
            .collect();
        ranges.extend([
            (0.0, options.max_forward_lean_rad),
            (-options.max_lateral_lean_rad, options.max_lateral_lean_rad),
        ]);
        Ok(Self { kinematics, ranges, zero_velocity: zeros(model.moving_count()) })
    }

    fn torque(&mut self, x: &[f64]) -> Result<JointVector, KinematicsError> {
        let (q, lean) = x.split_at(self.zero_velocity.len());
        let world_from_base = Rotation3::from_axis_angle(&Vector::y_axis(), lean[0])
            * Rotation3::from_axis_angle(&Vector::x_axis(), lean[1]);
        let gravity = world_from_base.inverse() * Vector::new(0.0, 0.0, -GRAVITY);
        self.kinematics.inverse_dynamics(q, &self.zero_velocity, &self.zero_velocity, &gravity)
    }

    /// The largest absolute torque of joint `k` that coordinate-wise maximisation reaches from `x`.
    fn coordinate_ascent(&mut self, mut x: Vec<f64>, k: usize) -> Result<f64, KinematicsError> {
        let mut best = self.torque(&x)?[k].abs();
        for _ in 0..SWEEPS {
            let before = best;
            for coordinate in 0..x.len() {
                let here = x[coordinate];
                let mut third = [0.0; 3];
                for (step, value) in third.iter_mut().enumerate() {
                    x[coordinate] = here + TAU / 3.0 * step as f64;
                    *value = self.torque(&x)?[k];
                }
                let (angle, value) = maximize_sinusoid(third, here, self.ranges[coordinate]);
                // Coordinates that do not matter stay where they are.
                let better = value > best * (1.0 + 1e-9);
                x[coordinate] = if better { angle } else { here };
                best = if better { value } else { best };
            }
            if best <= before * (1.0 + 1e-6) {
                break;
            }
        }
        Ok(best)
    }
}

/// The angle within `range`, and the value there, at which `|a + b cos(x) + c sin(x)|` is largest, when `third`
/// holds the function at `here` and one and two thirds of a turn later.
fn maximize_sinusoid(third: [f64; 3], here: f64, range: (f64, f64)) -> (f64, f64) {
    // Discrete Fourier transform of three points, phase counted from `here`.
    let mean = third.iter().sum::<f64>() / 3.0;
    let cosine = (2.0 * third[0] - third[1] - third[2]) / 3.0;
    let sine = (third[1] - third[2]) / 3f64.sqrt();
    let value = |angle: f64| (mean + cosine * (angle - here).cos() + sine * (angle - here).sin()).abs();
    let crest = here + sine.atan2(cosine);
    let mut best = (range.0, value(range.0));
    let extremes = (-3..=3).map(|half_turns| crest + TAU / 2.0 * f64::from(half_turns));
    for angle in extremes.filter(|angle| (range.0..=range.1).contains(angle)).chain([range.1]) {
        if value(angle) > best.1 {
            best = (angle, value(angle));
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_largest_value_of_a_sinusoid_is_found_inside_and_at_the_ends_of_a_range() {
        let function = |x: f64| 0.5 + 2.0 * x.cos() - 1.5 * x.sin();
        let here = 0.3;
        let third = [0, 1, 2].map(|step| function(here + TAU / 3.0 * f64::from(step)));
        for range in [(-3.0, 3.0), (0.5, 1.0), (-0.2, 2.9), (1.0, 1.0)] {
            let (angle, value) = maximize_sinusoid(third, here, range);
            assert!((function(angle).abs() - value).abs() < 1e-12);
            let steps = 100_000;
            let scanned = (0..=steps)
                .map(|i| function(range.0 + (range.1 - range.0) * f64::from(i) / f64::from(steps)).abs())
                .fold(0.0, f64::max);
            // The scan misses the crest by at most half a step, a share of order 1e-9.
            assert!((value - scanned).abs() < 1e-7, "{range:?}: {value} against {scanned}");
        }
    }
}
