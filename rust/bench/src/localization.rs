//! `proact bench localization`: simulated sessions with known truth, ours beside the original's method.
//!
//! A minute of free head movement calibrates, then a minute of work is shown. Noise 0.3 mm and 0.2 degrees in each coordinate of
//! both systems, 5 % occlusion in bursts, delays of 4 ms and up to 20 ms more, a drift of 1 cm a minute whose direction
//! wanders. Movements are sums of sines of random phases, 0.1 to 2 Hz, and leans of minimum jerk.

use crate::{BenchFigure, BenchReport, quantile};
use nalgebra::{UnitQuaternion, Vector3};
use proact_localization::{
    BodySample, CalibrationOptions, DriftCorrection, PoseFilter, PoseFilterConfig, TimedPose, calibrate,
    one_shot, pair_streams,
};
use proact_types::{Pose, Vector};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Exp, Normal};
use std::{error::Error, f64::consts::TAU};

const SEEDS: u64 = 100;
const CALIBRATION_SECS: f64 = 60.0;
const END_SECS: f64 = 120.0;
const NOISE_M: f64 = 3e-4;
const NOISE_DEG: f64 = 0.2;
const DRIFT_M_PER_S: f64 = 0.01 / 60.0;

/// Sums of sines: amplitude falls with frequency as that of people does.
struct Sway(Vec<[(f64, f64, f64); 3]>);

impl Sway {
    fn new(rng: &mut ChaCha8Rng, rms: [f64; 3], top_hz: f64) -> Self {
        let count = 12;
        let mut all = Vec::new();
        for _ in 0..count {
            all.push([0, 1, 2].map(|k| {
                let hz = 0.1 * (top_hz / 0.1).powf(rng.random::<f64>());
                (rms[k] * (0.1 / hz).sqrt(), hz, rng.random::<f64>() * TAU)
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
struct Truth {
    head_place: Sway,
    head_turn: Sway,
    shoulder_place: Sway,
    shoulder_turn: Sway,
    leans: Vec<(f64, f64, f64)>,
    drift: Vec<Vector>,
    x: Pose,
    y: Pose,
}

fn pose(place: Vector, turn: Vector) -> Pose {
    Pose::from_parts(place.into(), UnitQuaternion::from_scaled_axis(turn))
}

impl Truth {
    fn new(rng: &mut ChaCha8Rng) -> Self {
        let deg = 1.0_f64.to_radians();
        let head_place = Sway::new(rng, [0.03, 0.04, 0.02], 1.0);
        let head_turn = Sway::new(rng, [8.0 * deg, 12.0 * deg, 18.0 * deg], 2.0);
        let shoulder_place = Sway::new(rng, [0.004, 0.004, 0.002], 2.0);
        let shoulder_turn = Sway::new(rng, [deg, deg, deg], 2.0);
        let mut leans = Vec::new();
        let mut t = 0.0;
        while t < END_SECS {
            t += 3.0 + 6.0 * rng.random::<f64>();
            leans.push((t, 0.8 + 0.8 * rng.random::<f64>(), 0.05 + 0.25 * rng.random::<f64>()));
        }
        let mut way = Vector::zeros();
        let mut heading: Vector = draw(rng, 1.0).normalize();
        let mut drift = vec![way];
        for _ in 0..(END_SECS * 10.0) as usize {
            heading = (heading + draw(rng, 0.05)).normalize();
            way += heading * DRIFT_M_PER_S * 0.1;
            drift.push(way);
        }
        let x = pose(Vector::new(0.03, 0.02, 0.08), draw(rng, 0.8));
        let yaw = Vector3::z() * (rng.random::<f64>() - 0.5) * TAU;
        let y = pose(draw(rng, 1.0), yaw);
        Self { head_place, head_turn, shoulder_place, shoulder_turn, leans, drift, x, y }
    }

    fn drifted(&self, t: f64) -> Vector {
        let at = (t.clamp(0.0, END_SECS - 0.2) * 10.0).max(0.0);
        self.drift[at as usize].lerp(&self.drift[at as usize + 1], at.fract())
    }

    fn headset_world_from_tracking(&self, t: f64) -> Pose {
        Pose::from_parts((self.y.translation.vector + self.drifted(t)).into(), self.y.rotation)
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

    fn shoulder(&self, t: f64) -> Pose {
        let lean = self.lean(t);
        let place = Vector::new(0.4 + lean, 0.9, 1.4 - 0.3 * lean) + self.shoulder_place.at(t);
        pose(place, self.shoulder_turn.at(t) + Vector::y() * 1.2 * lean + Vector::z() * lean)
    }

    /// `tracking_from_markers`, on a neck of 0.15 m.
    fn markers(&self, t: f64) -> Pose {
        let free = if t < CALIBRATION_SECS { 0.0 } else { self.lean(t) };
        let base = Vector::new(0.45 + free, 1.08, 1.6) + self.head_place.at(t);
        pose(base, self.head_turn.at(t)) * Pose::translation(0.08, 0.0, 0.15)
    }

    fn head(&self, t: f64) -> Pose {
        self.headset_world_from_tracking(t) * self.markers(t) * self.x.inverse()
    }
}

fn draw(rng: &mut ChaCha8Rng, sigma: f64) -> Vector {
    let normal = Normal::new(0.0, sigma).expect("a positive sigma");
    Vector::new(normal.sample(rng), normal.sample(rng), normal.sample(rng))
}

fn noisy(rng: &mut ChaCha8Rng, true_pose: Pose) -> Pose {
    let turn = UnitQuaternion::from_scaled_axis(draw(rng, NOISE_DEG.to_radians()));
    Pose::from_parts((true_pose.translation.vector + draw(rng, NOISE_M)).into(), true_pose.rotation * turn)
}

/// Samples at `hz` as they arrive in their order: measured at, arrived at, pose. Occluded ones are missing.
fn stream(
    rng: &mut ChaCha8Rng,
    hz: f64,
    occluded: bool,
    truth: impl Fn(f64) -> Pose,
) -> Vec<(f64, f64, Pose)> {
    // Bursts of 80 ms on average, 5 % of the time.
    let burst = Exp::new(1.0 / 0.08).expect("a positive rate");
    let clear = Exp::new(1.0 / 1.52).expect("a positive rate");
    let (mut hidden, mut until, mut last) = (false, 1.0, 0.0_f64);
    let mut all = Vec::new();
    for k in 0..((END_SECS - 1.0) * hz) as usize {
        let t = k as f64 / hz;
        while occluded && t > until {
            hidden = !hidden;
            until += if hidden { burst.sample(rng) } else { clear.sample(rng) };
        }
        let pose = noisy(rng, truth(t));
        last = last.max(t + 0.004 + 0.02 * rng.random::<f64>());
        if !hidden {
            all.push((t, last, pose));
        }
    }
    all
}

#[derive(Default)]
struct Errors {
    m: Vec<f64>,
    deg: Vec<f64>,
}

impl Errors {
    fn push(&mut self, is: &Pose, truth: &Pose) {
        self.m.push((is.translation.vector - truth.translation.vector).norm());
        self.deg.push(is.rotation.angle_to(&truth.rotation).to_degrees());
    }

    fn within(&self) -> f64 {
        let good = self.m.iter().zip(&self.deg).filter(|(m, deg)| **m <= 0.005 && **deg <= 0.5).count();
        100.0 * good as f64 / self.m.len() as f64
    }
}

/// Over sessions: calibration at the head, displayed base, lag, ms.
#[derive(Default)]
struct Found {
    calibration: Errors,
    shown: Errors,
    lag_ms: Vec<f64>,
}

/// The shift of the truth that what was shown is nearest to, ms.
fn lag_ms(shown: &[(f64, Pose)], truth: &Truth) -> f64 {
    let cost = |ms: i32| {
        let parts = shown.iter().step_by(4).map(|(t, pose)| {
            (pose.translation.vector - truth.shoulder(t - f64::from(ms) * 1e-3).translation.vector)
                .norm_squared()
        });
        parts.sum::<f64>()
    };
    (-20..200).min_by(|a, b| cost(*a).total_cmp(&cost(*b))).map_or(0.0, f64::from)
}

fn session(seed: u64, ours: &mut Found, original: &mut Found) -> Result<(), Box<dyn Error>> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let truth = Truth::new(&mut rng);
    let markers = stream(&mut rng, 100.0, true, |t| truth.markers(t));
    let head = stream(&mut rng, 60.0, false, |t| truth.head(t));
    let shoulder = stream(&mut rng, 100.0, true, |t| truth.shoulder(t));
    let timed = |all: &[(f64, f64, Pose)]| -> Vec<TimedPose> {
        all.iter().map(|(t, _, pose)| TimedPose { stamp_secs: *t, pose: *pose }).collect()
    };
    let (head, markers) = (timed(&head), timed(&markers));
    let minute = |all: &[TimedPose]| -> Vec<TimedPose> {
        all.iter().filter(|timed| timed.stamp_secs < CALIBRATION_SECS).copied().collect()
    };
    let found = calibrate(&minute(&head), &minute(&markers), &CalibrationOptions::default())?;
    // At the head: where the calibration is used.
    let place = Pose::from_parts(found.head_place.into(), UnitQuaternion::identity());
    let truly = truth.headset_world_from_tracking(found.end_secs) * place;
    ours.calibration.push(&(found.headset_world_from_tracking * place), &truly);
    let pairs = pair_streams(&head, &markers, found.clock_offset_secs);
    let one = pairs.iter().find(|pair| pair.stamp_secs >= CALIBRATION_SECS).ok_or("no pair")?;
    let frozen = one_shot(&truth.x, &one.head, &one.markers);
    original
        .calibration
        .push(&(frozen * place), &(truth.headset_world_from_tracking(one.stamp_secs) * place));

    let mut drift = DriftCorrection::new(&found);
    let mut filter = PoseFilter::new(PoseFilterConfig::default());
    let (mut next, mut pair, mut newest) = (0, 0, None);
    let (mut shown, mut shown_original) = (Vec::new(), Vec::new());
    let mut told = None;
    for frame in 0..((END_SECS - 2.0) * 60.0) as u32 {
        let now = f64::from(frame) / 60.0;
        while let Some((t, arrival, pose)) = shoulder.get(next).filter(|(_, arrival, _)| *arrival <= now) {
            let nanos = |secs: f64| (secs * 1e9) as i64;
            let (stamp, arrival) = (nanos(*t), nanos(*arrival));
            filter.take(&BodySample {
                body: "pad".into(),
                id: None,
                stamp,
                arrival,
                pose: *pose,
                tracked: true,
            });
            newest = Some(*pose);
            next += 1;
        }
        // Pairs have both streams' delay and the next pose of the markers.
        while let Some(both) = pairs.get(pair).filter(|both| both.stamp_secs + 0.04 <= now) {
            if both.stamp_secs > CALIBRATION_SECS {
                drift.take(both.stamp_secs, &both.head, &both.markers);
            }
            pair += 1;
        }
        let followed = filter.at((now * 1e9) as i64);
        // The original tells the headset ten times a second, unfiltered.
        if frame % 6 == 0 {
            told = newest;
        }
        let (Some(followed), Some(told)) = (followed, told) else { continue };
        if now < CALIBRATION_SECS + 1.0 {
            continue;
        }
        let truly = truth.headset_world_from_tracking(now) * truth.shoulder(now);
        ours.shown.push(&(drift.headset_world_from_tracking() * followed.pose), &truly);
        original.shown.push(&(frozen * told), &truly);
        shown.push((now, followed.pose));
        shown_original.push((now, told));
    }
    ours.lag_ms.push(lag_ms(&shown, &truth));
    original.lag_ms.push(lag_ms(&shown_original, &truth));
    Ok(())
}

/// All sessions as figures.
pub(crate) fn localization() -> Result<BenchReport, Box<dyn Error>> {
    let (mut ours, mut original) = (Found::default(), Found::default());
    let bar = indicatif::ProgressBar::new(SEEDS);
    for seed in 0..SEEDS {
        session(seed, &mut ours, &mut original)?;
        bar.inc(1);
    }
    bar.finish_and_clear();
    let mut figures = Vec::new();
    let peer = "original's method";
    let mut all = |name: &str, unit: &str, factor: f64, note: &str, ours: &[f64], original: &[f64]| {
        for (share, word) in [(0.5, "median"), (0.99, "99 %"), (1.0, "worst")] {
            let figure =
                BenchFigure::alone(&format!("{name}, {word}"), factor * quantile(ours, share), unit, note);
            figures.push(figure.beside(peer, factor * quantile(original, share)));
        }
    };
    let note = "of 100 seeds, at the head; the original is given the true place of its markers";
    all("calibration, place", "mm", 1e3, note, &ours.calibration.m, &original.calibration.m);
    all("calibration, attitude", "deg", 1.0, note, &ours.calibration.deg, &original.calibration.deg);
    let note = "every frame of 57 s, 100 seeds, occlusions included";
    all("displayed base, place", "mm", 1e3, note, &ours.shown.m, &original.shown.m);
    all("displayed base, attitude", "deg", 1.0, note, &ours.shown.deg, &original.shown.deg);
    all(
        "lag of the displayed base",
        "ms",
        1.0,
        "best fitting shift, in steps of 1 ms",
        &ours.lag_ms,
        &original.lag_ms,
    );
    let within =
        BenchFigure::alone("displayed base within 5 mm and 0.5 deg", ours.shown.within(), "%", "of frames");
    figures.push(within.beside(peer, original.shown.within()));
    Ok(BenchReport { stage: "localization".to_owned(), figures })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn three_sessions_are_calibrated_to_3_mm_and_less_late_than_the_originals() {
        let (mut ours, mut original) = (Found::default(), Found::default());
        for seed in 1000..1003 {
            session(seed, &mut ours, &mut original).unwrap();
        }
        assert!(ours.calibration.m.iter().all(|m| *m < 0.003), "{:?}", ours.calibration.m);
        assert!(ours.calibration.deg.iter().all(|deg| *deg < 0.3), "{:?}", ours.calibration.deg);
        assert!(quantile(&ours.lag_ms, 1.0) < 20.0 && quantile(&original.lag_ms, 0.5) > 40.0);
    }
}
