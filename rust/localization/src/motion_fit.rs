//! Straight motion of a body through its last samples.

use nalgebra::{SVector, UnitQuaternion};
use proact_types::{Pose, Vector};
use std::collections::VecDeque;

/// A sample on our clock.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Moment {
    /// s.
    pub time: f64,
    pub pose: Pose,
}

/// Windows, s, shortest first.
const WINDOWS_SECS: [f64; 4] = [0.07, 0.11, 0.17, 0.26];
/// Fewer samples than this have no speed.
const LEAST_SAMPLES: usize = 4;
/// The newest samples of a window may be off its line by this many standard deviations of their mean: below 1 noise alone
/// would shorten the window, at 2 the bend of a lean is seen too late.
const OFF_LINE: f64 = 1.3;
/// Of so many of the newest samples is the mean taken.
const NEWEST: usize = 4;

/// A motion with constant speed, in place or as a rotation vector.
struct Line {
    /// Where it is at the newest sample.
    at: Vector,
    speed: Vector,
}

/// The pose at `time`, s. Past the newest sample the speed is given up with the time constant `coast_secs` once a gap is longer
/// than 50 ms. None without samples.
pub(crate) fn predict(recent: &VecDeque<Moment>, time: f64, coast_secs: f64) -> Option<Pose> {
    const FULL_SPEED_SECS: f64 = 0.05;
    let newest = recent.back()?;
    let ahead = time - newest.time;
    let beyond = (ahead - FULL_SPEED_SECS).max(0.0);
    let ahead = ahead.min(FULL_SPEED_SECS) + coast_secs * (1.0 - (-beyond / coast_secs).exp());
    let (places, turns) = coordinates(recent, &newest.pose);
    let place = line(recent, &places, noise(recent, &places));
    let turn = line(recent, &turns, noise(recent, &turns));
    Some(Pose::from_parts(
        (newest.pose.translation.vector + place.at + place.speed * ahead).into(),
        newest.pose.rotation * UnitQuaternion::from_scaled_axis(turn.at + turn.speed * ahead),
    ))
}

/// Standard deviation of a coordinate of a sample, m and rad.
pub(crate) fn noise_of(recent: &VecDeque<Moment>) -> Option<(f64, f64)> {
    let newest = recent.back().filter(|_| recent.len() > 5)?;
    let (places, turns) = coordinates(recent, &newest.pose);
    Some((noise(recent, &places), noise(recent, &turns)))
}

/// Of each sample place and turn against the newest: small numbers, far from where rotation vectors end.
fn coordinates(recent: &VecDeque<Moment>, newest: &Pose) -> (Vec<Vector>, Vec<Vector>) {
    let place = |moment: &Moment| moment.pose.translation.vector - newest.translation.vector;
    let turn = |moment: &Moment| (newest.rotation.inverse() * moment.pose.rotation).scaled_axis();
    (recent.iter().map(place).collect(), recent.iter().map(turn).collect())
}

/// Standard deviation of one coordinate, from the median of second differences: motion with constant speed has none, and one
/// sample in a few may be wrong.
fn noise(recent: &VecDeque<Moment>, values: &[Vector]) -> f64 {
    // Of the norm of three Gaussians the median is 1.538 standard deviations; a second difference has the variance 6.
    const MEDIAN: f64 = 1.538;
    let mut differences: Vec<f64> = (1..values.len().saturating_sub(1))
        .map(|k| {
            let share = (recent[k].time - recent[k - 1].time) / (recent[k + 1].time - recent[k - 1].time);
            let between = values[k - 1].lerp(&values[k + 1], share);
            (values[k] - between).norm() / (1.0 + share * share + (1.0 - share) * (1.0 - share)).sqrt()
        })
        .collect();
    if differences.is_empty() {
        return 0.0;
    }
    differences.sort_by(f64::total_cmp);
    differences[differences.len() / 2] / MEDIAN
}

/// The line through the longest window that its newest samples do not leave.
fn line(recent: &VecDeque<Moment>, values: &[Vector], noise: f64) -> Line {
    let newest = recent[recent.len() - 1].time;
    let mut best: Option<Line> = None;
    for window in WINDOWS_SECS {
        let from = recent.iter().position(|moment| moment.time >= newest - window).unwrap_or_default();
        let count = recent.len() - from;
        if count < LEAST_SAMPLES {
            continue;
        }
        let Some(line) = through(recent, values, from) else { continue };
        if best.is_some() && leaves(recent, values, from, &line, noise) {
            break;
        }
        best = Some(line);
    }
    best.unwrap_or_else(|| Line { at: values[values.len() - 1], speed: Vector::zeros() })
}

/// Whether the newest samples, or the middle ones, are on one side of the line: the motion is curved.
fn leaves(recent: &VecDeque<Moment>, values: &[Vector], from: usize, line: &Line, noise: f64) -> bool {
    let newest = recent[recent.len() - 1].time;
    let count = values.len() - from;
    let left = |k: usize| values[k] - line.at - line.speed * (recent[k].time - newest);
    let mean = |range: std::ops::Range<usize>| {
        let some = range.len() as f64;
        range.map(left).sum::<Vector>() / some
    };
    let newest_ones = mean(values.len() - NEWEST.min(count)..values.len());
    let third = (count / 3).max(1);
    let middle = mean(from + third..from + 2 * third);
    // Three coordinates: their norm is 1.7 times one.
    let allowed = |some: usize| OFF_LINE * 1.7 * noise / (some as f64).sqrt();
    newest_ones.norm() > allowed(NEWEST.min(count)) || middle.norm() > allowed(third)
}

fn through(recent: &VecDeque<Moment>, values: &[Vector], from: usize) -> Option<Line> {
    let newest = recent[recent.len() - 1].time;
    // Sums of 1, t, t^2, v, t v.
    let mut sums = SVector::<f64, 3>::zeros();
    let (mut places, mut moved) = (Vector::zeros(), Vector::zeros());
    for (moment, value) in recent.iter().zip(values).skip(from) {
        let t = moment.time - newest;
        sums += SVector::<f64, 3>::new(1.0, t, t * t);
        places += value;
        moved += value * t;
    }
    let [n, t, tt] = [sums[0], sums[1], sums[2]];
    let spread = n * tt - t * t;
    (spread > 1e-9)
        .then(|| Line { at: (places * tt - moved * t) / spread, speed: (moved * n - places * t) / spread })
}
