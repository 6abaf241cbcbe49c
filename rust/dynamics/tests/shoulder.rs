//! A tracked shoulder carries the arm: noise, jitter and gaps of a real tracker, and a person's lean.

#![allow(missing_docs)]
#![allow(clippy::unwrap_used)]

mod common;

use nalgebra::{Translation3, UnitQuaternion};
use proact_testbed::{Setup, Testbed, TrialConfig};
use proact_types::{Pose, TICK_SECS, TickInput, Vector};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Normal};

/// A tracker at 60 Hz whose poses arrive up to 4 ms late, of which one in fifty is lost, and 250 ms of them every ten
/// seconds.
struct Tracker {
    rng: ChaCha8Rng,
    place: Normal<f64>,
    turn: Normal<f64>,
    next: f64,
    on_the_way: Option<(u64, Pose)>,
}

impl Tracker {
    fn new(meters: f64, degrees: f64) -> Self {
        Self {
            rng: ChaCha8Rng::seed_from_u64(7),
            place: Normal::new(0.0, meters).unwrap(),
            turn: Normal::new(0.0, degrees.to_radians()).unwrap(),
            next: 0.0,
            on_the_way: None,
        }
    }

    /// The pose that arrives in tick `now`, of a shoulder that is at `truth`.
    fn at(&mut self, now: u64, truth: &Pose) -> Option<Pose> {
        if now as f64 >= self.next {
            self.next += 1000.0 / 60.0;
            let mut three = |of: Normal<f64>| Vector::from_fn(|_, _| of.sample(&mut self.rng));
            let translation = Translation3::from(three(self.place));
            let turn = UnitQuaternion::from_scaled_axis(three(self.turn));
            let pose = Pose::from_parts(translation * truth.translation, turn * truth.rotation);
            let (lost, late) = (self.rng.random_range(0..50) == 0, self.rng.random_range(0..=4));
            if !lost && now % 10_000 < 9_750 {
                self.on_the_way = Some((now + late, pose));
            }
        }
        self.on_the_way.take_if(|(arrives, _)| *arrives <= now).map(|(_, pose)| pose)
    }
}

fn testbed() -> (Testbed, Pose) {
    let config = TrialConfig::new("A", 1, Setup::named("still").unwrap());
    let home = config.setup.body.shoulder_pose(&Default::default());
    (common::testbed(config, None), home)
}

fn step(testbed: &mut Testbed, shoulder: Option<Pose>) {
    testbed.tick(&TickInput { shoulder, ..TickInput::default() }, false).unwrap();
}

// Catches a base that passes a tracker's noise on to the arm: 0.5 mm saturated a joint in two samples of three.
#[test]
fn an_arm_that_is_told_nothing_is_quiet_behind_a_noisy_tracker() {
    let (mut testbed, home) = testbed();
    let model = proact_description::mpl_right_arm();
    let arm = model.arm_count();
    let limits: Vec<f64> = model.moving().map(|joint| model.joints[joint].limits.effort).collect();
    let mut tracker = Tracker::new(0.5e-3, 0.2);
    let start = testbed.plant().state().position.clone();
    let (mut wander, mut effort, mut speed) = (0.0_f64, 0.0_f64, 0.0_f64);
    for now in 0..30_000 {
        step(&mut testbed, tracker.at(now, &home));
        let state = testbed.plant().state();
        let shares = state.effort.iter().zip(&limits).map(|(effort, limit)| effort.abs() / limit);
        effort = shares.fold(effort, f64::max);
        for k in 0..arm {
            wander = wander.max((state.position[k] - start[k]).abs());
            speed = speed.max(state.velocity[k].abs());
        }
    }
    println!("wander {wander:.2e} rad, effort {effort:.3} of the limit, speed {speed:.2e} rad/s");
    assert!(effort < 1.0, "a joint is at its effort limit: {effort}");
    assert!(wander < 2e-3, "{wander} rad");
    assert!(speed < 0.02, "{speed} rad/s");
}

/// Minimum jerk from 0 to `distance` from 0.5 s on, with this highest speed.
fn lean(distance: f64, peak: f64, secs: f64) -> f64 {
    let s = ((secs - 0.5) / (1.875 * distance / peak)).clamp(0.0, 1.0);
    distance * s.powi(3) * (10.0 - 15.0 * s + 6.0 * s * s)
}

// Catches a filter that is quiet because it is slow.
#[test]
fn a_lean_is_followed_within_5_mm_after_a_lag_below_30_ms() {
    for distance in [0.2, 0.3, 0.5] {
        let (mut testbed, home) = testbed();
        let mut tracker = Tracker::new(0.5e-3, 0.2);
        // The trunk turns about a hip that is half a metre below.
        let truth = |tick: u64| {
            let turn = UnitQuaternion::from_axis_angle(
                &Vector::y_axis(),
                lean(distance, 0.5, tick as f64 * TICK_SECS) / 0.5,
            );
            let hip = Vector::new(0.0, 0.0, -0.5);
            let position = home.translation.vector + hip - turn * hip;
            Pose::from_parts(position.into(), turn * home.rotation)
        };
        let mut followed = Vec::new();
        for now in 0..4000 {
            step(&mut testbed, tracker.at(now, &truth(now)));
            followed.push(testbed.plant().state().world_from_base);
        }
        let furthest = |lag: u64| {
            let off = |now: u64| {
                let (is, was) = (&followed[now as usize], truth(now - lag));
                let distance = (is.translation.vector - was.translation.vector).norm();
                (distance, is.rotation.angle_to(&was.rotation))
            };
            (100..4000).map(off).fold((0.0_f64, 0.0_f64), |max, (a, b)| (max.0.max(a), max.1.max(b)))
        };
        let best = (0..60).min_by(|a, b| furthest(*a).0.total_cmp(&furthest(*b).0)).unwrap();
        let (off, turned) = furthest(best);
        println!("{distance} m: {:.2} mm, {turned:.4} rad at a lag of {best} ms", off * 1e3);
        assert!(best < 30, "{distance} m: {best} ms");
        assert!(off < 5e-3, "{distance} m: {off} m");
    }
}

// Catches accelerations that fall on one tick in ten.
#[test]
fn the_base_has_no_steps_in_its_acceleration() {
    let (mut testbed, home) = testbed();
    let mut positions = Vec::new();
    for now in 0..1000_u64 {
        // 3 mm at once, as a tracker's poses never are.
        let away = if now < 300 { 0.0 } else { 3e-3 };
        step(&mut testbed, now.is_multiple_of(17).then(|| Pose::translation(away, 0.0, 0.0) * home));
        positions.push(testbed.plant().state().world_from_base.translation.x);
    }
    let rate =
        |of: &[f64]| -> Vec<f64> { of.windows(2).map(|pair| (pair[1] - pair[0]) / TICK_SECS).collect() };
    let acceleration = rate(&rate(&positions));
    let highest = acceleration.iter().fold(0.0_f64, |max, a| max.max(a.abs()));
    let step = acceleration.windows(2).map(|pair| (pair[1] - pair[0]).abs()).fold(0.0, f64::max);
    println!("acceleration up to {highest:.2} m/s2, in a tick {step:.2} more");
    assert!(highest > 0.5, "it moves: {highest} m/s2");
    assert!(step < highest / 4.0, "{step} of {highest} m/s2 come in one tick");
}
