//! Ways and speeds.

use super::TracePoint;
use proact_types::{Point, Vector};

/// A Gaussian of this width, milliseconds, has half the power at 6 Hz (sqrt(ln 2) / (2 pi 6 Hz)): the usual low pass of motion capture
/// (Winter, Biomechanics and Motor Control of Human Movement, 4th ed., 3.4).
const LOW_PASS_SIGMA_MS: f64 = 22.1;
/// Slower than this, metres a second, a hump of the speed is no movement of its own.
const MIN_MOVEMENT_UNIT_M_PER_S: f64 = 0.02;

/// Places over time, milliseconds, low-passed at 6 Hz; times may be uneven.
pub(super) fn low_pass(times: &[f64], points: &[Point]) -> Vec<Point> {
    let mut first = 0;
    let reach = 4.0 * LOW_PASS_SIGMA_MS;
    times
        .iter()
        .map(|now| {
            while times[first] < now - reach {
                first += 1;
            }
            let mut sum = Vector::zeros();
            let mut weights = 0.0;
            for (time, point) in
                times[first..].iter().zip(&points[first..]).take_while(|(t, _)| **t <= now + reach)
            {
                let weight = (-0.5 * ((time - now) / LOW_PASS_SIGMA_MS).powi(2)).exp();
                sum += point.coords * weight;
                weights += weight;
            }
            Point::from(sum / weights)
        })
        .collect()
}

pub(super) fn times_ms(instants: &[TracePoint]) -> Vec<f64> {
    instants.iter().map(|instant| instant.time.0 as f64).collect()
}

/// The way of something through some instants, low-passed.
pub(super) struct PathMetrics {
    times_ms: Vec<f64>,
    positions: Vec<Point>,
}

impl PathMetrics {
    /// None of fewer than two instants.
    pub(super) fn of(instants: &[TracePoint], position_of: impl Fn(&TracePoint) -> Point) -> Option<Self> {
        let times = times_ms(instants);
        let points: Vec<Point> = instants.iter().map(position_of).collect();
        (points.len() > 1).then(|| Self { positions: low_pass(&times, &points), times_ms: times })
    }

    /// Its length, metres.
    pub(super) fn length(&self) -> f64 {
        self.positions.windows(2).map(|two| (two[1] - two[0]).norm()).sum()
    }

    /// Between its ends, metres.
    pub(super) fn end_to_end_distance_m(&self) -> f64 {
        (self.positions[self.positions.len() - 1] - self.positions[0]).norm()
    }

    /// Furthest from where it began, metres.
    pub(super) fn max_displacement_m(&self) -> f64 {
        self.positions.iter().map(|position| (position - self.positions[0]).norm()).fold(0.0, f64::max)
    }

    /// Metres a second, and when in milliseconds, between each two instants.
    fn speeds(&self) -> Vec<(f64, f64)> {
        let steps = self.times_ms.windows(2).zip(self.positions.windows(2));
        let steps = steps.filter(|(times, _)| times[1] > times[0]);
        steps
            .map(|(times, points)| {
                let secs = (times[1] - times[0]) * 1e-3;
                ((points[1] - points[0]).norm() / secs, (times[0] + times[1]) / 2.0)
            })
            .collect()
    }

    /// The highest speed, metres a second, and when it was as a share of the whole time, 0 to 1.
    pub(super) fn peak_speed_and_time(&self) -> Option<[f64; 2]> {
        let (speed, at) = self.speeds().into_iter().max_by(|a, b| a.0.total_cmp(&b.0))?;
        let (first, last) = (self.times_ms[0], self.times_ms[self.times_ms.len() - 1]);
        Some([speed, (at - first) / (last - first)])
    }

    /// The strongest acceleration, metres a second squared, along the way and across it; none of fewer than three instants.
    pub(super) fn peak_acceleration_m_per_s2(&self) -> Option<f64> {
        let velocities: Vec<(f64, Vector)> = self
            .times_ms
            .windows(2)
            .zip(self.positions.windows(2))
            .filter(|(times, _)| times[1] > times[0])
            .map(|(times, points)| {
                ((times[0] + times[1]) / 2.0, (points[1] - points[0]) / ((times[1] - times[0]) * 1e-3))
            })
            .collect();
        let change = |two: &[(f64, Vector)]| (two[1].1 - two[0].1).norm() / ((two[1].0 - two[0].0) * 1e-3);
        velocities.windows(2).map(change).reduce(f64::max)
    }

    /// When the speed fell fastest, as a share of the whole time, 0 to 1; none where it never fell.
    pub(super) fn peak_deceleration_time(&self) -> Option<f64> {
        let falls = |two: &[(f64, f64)]| {
            let [(before, from), (after, to)] = [two[0], two[1]];
            (to > from).then(|| ((before - after) / (to - from), (from + to) / 2.0))
        };
        let speeds = self.speeds();
        let falls = speeds.windows(2).filter_map(falls).filter(|(fall, _)| *fall > 0.0);
        let (_, at) = falls.max_by(|a, b| a.0.total_cmp(&b.0))?;
        let (first, last) = (self.times_ms[0], self.times_ms[self.times_ms.len() - 1]);
        Some((at - first) / (last - first))
    }

    /// Humps of the speed that rise and fall by 0.02 m/s at least.
    pub(super) fn movement_unit_count(&self) -> usize {
        let (mut count, mut lowest, mut highest, mut rising) = (0, 0.0_f64, 0.0_f64, true);
        // Before and after, it rests.
        for speed in self.speeds().into_iter().map(|(speed, _)| speed).chain([0.0]) {
            if rising {
                highest = highest.max(speed);
                lowest = lowest.min(speed);
                if highest - lowest >= MIN_MOVEMENT_UNIT_M_PER_S
                    && highest - speed >= MIN_MOVEMENT_UNIT_M_PER_S
                {
                    count += 1;
                    (rising, lowest) = (false, speed);
                }
            } else {
                lowest = lowest.min(speed);
                if speed - lowest >= MIN_MOVEMENT_UNIT_M_PER_S {
                    (rising, highest) = (true, speed);
                }
            }
        }
        count
    }
}
