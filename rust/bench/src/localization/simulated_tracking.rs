//! A simulated session with known truth: how head and shoulder move, how the headset's world drifts, and what both systems say.

use nalgebra::{UnitQuaternion, Vector3};
use proact_types::{Pose, Vector};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Exp, Normal};
use std::f64::consts::TAU;

pub(super) const CALIBRATION_SECS: f64 = 60.0;
pub(super) const END_SECS: f64 = 120.0;

/// Sway of the shoulder: standard deviation of its turn about each axis, degrees, and slowest and fastest sway, Hz.
pub(super) const SHOULDER_SWAY_DEG: f64 = 1.0;
pub(super) const SWAY_HZ: (f64, f64) = (0.1, 2.0);

/// What makes a session hard; each can be left out, to see what it costs.
#[derive(Clone, Copy, Debug)]
pub(super) struct TrackingConditions {
    /// Standard deviation of each coordinate of a place, m.
    pub noise_m: f64,
    /// Of each coordinate of a rotation vector, degrees.
    pub noise_deg: f64,
    /// Share of the time in which the cameras do not see the markers, in bursts of 80 ms on average.
    pub occluded_proportion: f64,
    /// Delay of a sample on top of 4 ms, uniform up to this, s.
    pub jitter_secs: f64,
    /// Of the headset's world.
    pub drift_m_per_s: f64,
    /// Whether the person leans.
    pub leans: bool,
}

impl TrackingConditions {
    /// 0.3 mm, 0.2 degrees, 5 % occlusion, 20 ms of jitter, 1 cm a minute of drift.
    pub(super) const NOMINAL: Self = Self {
        noise_m: 3e-4,
        noise_deg: 0.2,
        occluded_proportion: 0.05,
        jitter_secs: 0.02,
        drift_m_per_s: 0.01 / 60.0,
        leans: true,
    };
}

/// Sums of sines: amplitude falls with frequency as that of people does.
struct Sway(Vec<[(f64, f64, f64); 3]>);

impl Sway {
    fn new(rng: &mut ChaCha8Rng, rms: [f64; 3], top_hz: f64) -> Self {
        let count = 12;
        let mut all = Vec::new();
        for _ in 0..count {
            all.push([0, 1, 2].map(|k| {
                let hz = SWAY_HZ.0 * (top_hz / SWAY_HZ.0).powf(rng.random::<f64>());
                (rms[k] * (SWAY_HZ.0 / hz).sqrt(), hz, rng.random::<f64>() * TAU)
            }));
        }
        for k in 0..3 {
            let power: f64 = all.iter().map(|w| w[k].0 * w[k].0 / 2.0).sum();
            all.iter_mut().for_each(|w| w[k].0 *= rms[k] / power.sqrt());
        }
        Self(all)
    }

    fn at(&self, t: f64) -> Vector {
        let sum = |k: usize| self.0.iter().map(|w| w[k].0 * (TAU * w[k].1 * t + w[k].2).sin()).sum();
        Vector::new(sum(0), sum(1), sum(2))
    }
}

/// What is true.
pub(super) struct GroundTruth {
    head_translation_sway: Sway,
    head_rotation_sway: Sway,
    shoulder_translation_sway: Sway,
    shoulder_rotation_sway: Sway,
    leans: Vec<(f64, f64, f64)>,
    drift: Vec<Vector>,
    pub(super) head_from_markers: Pose,
    headset_world_from_tracking_start: Pose,
}

fn pose(position: Vector, turn: Vector) -> Pose {
    Pose::from_parts(position.into(), UnitQuaternion::from_scaled_axis(turn))
}

impl GroundTruth {
    fn new(rng: &mut ChaCha8Rng, conditions: &TrackingConditions) -> Self {
        let deg = 1.0_f64.to_radians();
        let head_position_sway = Sway::new(rng, [0.03, 0.04, 0.02], 1.0);
        let head_turn = Sway::new(rng, [8.0 * deg, 12.0 * deg, 18.0 * deg], 2.0);
        let shoulder_position_sway = Sway::new(rng, [0.004, 0.004, 0.002], 2.0);
        let shoulder_turn = Sway::new(rng, [SHOULDER_SWAY_DEG * deg; 3], SWAY_HZ.1);
        let mut leans = Vec::new();
        let mut t = 0.0;
        while t < END_SECS {
            t += 3.0 + 6.0 * rng.random::<f64>();
            let lean = (t, 0.8 + 0.8 * rng.random::<f64>(), 0.05 + 0.25 * rng.random::<f64>());
            if conditions.leans {
                leans.push(lean);
            }
        }
        let mut offset = Vector::zeros();
        let mut heading: Vector = gaussian_vector(rng, 1.0).normalize();
        let mut drift = vec![offset];
        for _ in 0..(END_SECS * 10.0) as usize {
            heading = (heading + gaussian_vector(rng, 0.05)).normalize();
            offset += heading * conditions.drift_m_per_s * 0.1;
            drift.push(offset);
        }
        let x = pose(Vector::new(0.03, 0.02, 0.08), gaussian_vector(rng, 0.8));
        let yaw = Vector3::z() * (rng.random::<f64>() - 0.5) * TAU;
        let y = pose(gaussian_vector(rng, 1.0), yaw);
        Self {
            head_translation_sway: head_position_sway,
            head_rotation_sway: head_turn,
            shoulder_translation_sway: shoulder_position_sway,
            shoulder_rotation_sway: shoulder_turn,
            leans,
            drift,
            head_from_markers: x,
            headset_world_from_tracking_start: y,
        }
    }

    fn drift_at(&self, t: f64) -> Vector {
        let at = (t.clamp(0.0, END_SECS - 0.2) * 10.0).max(0.0);
        self.drift[at as usize].lerp(&self.drift[at as usize + 1], at.fract())
    }

    pub(super) fn headset_world_from_tracking(&self, t: f64) -> Pose {
        Pose::from_parts(
            (self.headset_world_from_tracking_start.translation.vector + self.drift_at(t)).into(),
            self.headset_world_from_tracking_start.rotation,
        )
    }

    /// Forward and back again at every other lean.
    fn lean(&self, t: f64) -> f64 {
        self.leans.iter().enumerate().fold(0.0, |at, (k, (from, secs, far))| {
            let s = ((t - from) / secs).clamp(0.0, 1.0);
            let s = s * s * s * (10.0 - 15.0 * s + 6.0 * s * s);
            let goal = if k % 2 == 0 { *far } else { 0.0 };
            at + (goal - at) * s
        })
    }

    pub(super) fn shoulder(&self, t: f64) -> Pose {
        let lean = self.lean(t);
        let position = Vector::new(0.4 + lean, 0.9, 1.4 - 0.3 * lean) + self.shoulder_translation_sway.at(t);
        pose(position, self.shoulder_rotation_sway.at(t) + Vector::y() * 1.2 * lean + Vector::z() * lean)
    }

    /// `tracking_from_markers`, on a neck of 0.15 m.
    fn markers(&self, t: f64) -> Pose {
        let free = if t < CALIBRATION_SECS { 0.0 } else { self.lean(t) };
        let base = Vector::new(0.45 + free, 1.08, 1.6) + self.head_translation_sway.at(t);
        pose(base, self.head_rotation_sway.at(t)) * Pose::translation(0.08, 0.0, 0.15)
    }

    fn head(&self, t: f64) -> Pose {
        self.headset_world_from_tracking(t) * self.markers(t) * self.head_from_markers.inverse()
    }
}

fn gaussian_vector(rng: &mut ChaCha8Rng, sigma: f64) -> Vector {
    let normal = Normal::new(0.0, sigma).expect("a positive sigma");
    Vector::new(normal.sample(rng), normal.sample(rng), normal.sample(rng))
}

fn add_noise(rng: &mut ChaCha8Rng, conditions: &TrackingConditions, true_pose: Pose) -> Pose {
    let turn =
        UnitQuaternion::from_scaled_axis(gaussian_vector(rng, 1.0) * conditions.noise_deg.to_radians());
    let position = true_pose.translation.vector + gaussian_vector(rng, 1.0) * conditions.noise_m;
    Pose::from_parts(position.into(), true_pose.rotation * turn)
}

/// A sample as it arrives: measured at, arrived at, s, and what was measured.
pub(super) type PoseArrival = (f64, f64, Pose);

/// Samples at `hz` in the order in which they arrive. Occluded ones are missing.
fn simulate_stream(
    rng: &mut ChaCha8Rng,
    hz: f64,
    conditions: &TrackingConditions,
    cameras: bool,
    truth: impl Fn(f64) -> Pose,
) -> Vec<PoseArrival> {
    const BURST_SECS: f64 = 0.08;
    let occluded = cameras && conditions.occluded_proportion > 0.0;
    let clear_secs = BURST_SECS * (1.0 / conditions.occluded_proportion.max(1e-3) - 1.0);
    let burst = Exp::new(1.0 / BURST_SECS).expect("a positive rate");
    let clear = Exp::new(1.0 / clear_secs).expect("a positive rate");
    let (mut hidden, mut until, mut last) = (false, 1.0, 0.0_f64);
    let mut all = Vec::new();
    for k in 0..((END_SECS - 1.0) * hz) as usize {
        let t = k as f64 / hz;
        while occluded && t > until {
            hidden = !hidden;
            until += if hidden { burst.sample(rng) } else { clear.sample(rng) };
        }
        let pose = add_noise(rng, conditions, truth(t));
        last = last.max(t + 0.004 + conditions.jitter_secs * rng.random::<f64>());
        if !hidden {
            all.push((t, last, pose));
        }
    }
    all
}

/// A session: what is true, and what comes of it.
pub(super) struct SimulatedTracking {
    pub truth: GroundTruth,
    /// Cameras at the markers on the headset.
    pub markers: Vec<PoseArrival>,
    /// The headset itself.
    pub head: Vec<PoseArrival>,
    /// Cameras at the brace.
    pub shoulder: Vec<PoseArrival>,
}

impl SimulatedTracking {
    pub(super) fn new(seed: u64, conditions: &TrackingConditions) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let truth = GroundTruth::new(&mut rng, conditions);
        let markers = simulate_stream(&mut rng, 100.0, conditions, true, |t| truth.markers(t));
        let head = simulate_stream(&mut rng, 60.0, conditions, false, |t| truth.head(t));
        let shoulder = simulate_stream(&mut rng, 100.0, conditions, true, |t| truth.shoulder(t));
        Self { truth, markers, head, shoulder }
    }
}
