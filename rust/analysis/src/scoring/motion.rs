//! Ways and speeds.

use super::Instant;
use proact_types::{Point, Vector};

/// A Gaussian of this width, milliseconds, has half the power at 6 Hz (sqrt(ln 2) / (2 pi 6 Hz)): the usual low pass of motion capture
/// (Winter, Biomechanics and Motor Control of Human Movement, 4th ed., 3.4).
const WIDTH_MS: f64 = 22.1;
/// Slower than this, metres a second, a hump of the speed is no movement of its own.
const HUMP_M_PER_S: f64 = 0.02;

/// Places over time, milliseconds, low-passed at 6 Hz; times may be uneven.
pub(super) fn smoothed(times: &[f64], places: &[Point]) -> Vec<Point> {
    let mut first = 0;
    let reach = 4.0 * WIDTH_MS;
    times
        .iter()
        .map(|now| {
            while times[first] < now - reach {
                first += 1;
            }
            let mut sum = Vector::zeros();
            let mut weights = 0.0;
            for (time, place) in
                times[first..].iter().zip(&places[first..]).take_while(|(t, _)| **t <= now + reach)
            {
                let weight = (-0.5 * ((time - now) / WIDTH_MS).powi(2)).exp();
                sum += place.coords * weight;
                weights += weight;
            }
            Point::from(sum / weights)
        })
        .collect()
}

pub(super) fn times_ms(instants: &[Instant]) -> Vec<f64> {
    instants.iter().map(|instant| instant.time.0 as f64).collect()
}

/// The way of something through some instants, low-passed.
pub(super) struct Way {
    times: Vec<f64>,
    places: Vec<Point>,
}

impl Way {
    /// None of fewer than two instants.
    pub(super) fn of(instants: &[Instant], place: impl Fn(&Instant) -> Point) -> Option<Self> {
        let times = times_ms(instants);
        let places: Vec<Point> = instants.iter().map(place).collect();
        (places.len() > 1).then(|| Self { places: smoothed(&times, &places), times })
    }

    /// Its length, metres.
    pub(super) fn length(&self) -> f64 {
        self.places.windows(2).map(|two| (two[1] - two[0]).norm()).sum()
    }

    /// Between its ends, metres.
    pub(super) fn straight(&self) -> f64 {
        (self.places[self.places.len() - 1] - self.places[0]).norm()
    }

    /// Furthest from where it began, metres.
    pub(super) fn range(&self) -> f64 {
        self.places.iter().map(|place| (place - self.places[0]).norm()).fold(0.0, f64::max)
    }

    /// Metres a second, and when in milliseconds, between each two instants.
    fn speeds(&self) -> Vec<(f64, f64)> {
        let steps = self.times.windows(2).zip(self.places.windows(2));
        let steps = steps.filter(|(times, _)| times[1] > times[0]);
        steps
            .map(|(times, places)| {
                let secs = (times[1] - times[0]) * 1e-3;
                ((places[1] - places[0]).norm() / secs, (times[0] + times[1]) / 2.0)
            })
            .collect()
    }

    /// The highest speed, metres a second, and when it was as a share of the whole time, 0 to 1.
    pub(super) fn peak(&self) -> Option<[f64; 2]> {
        let (speed, at) = self.speeds().into_iter().max_by(|a, b| a.0.total_cmp(&b.0))?;
        let (first, last) = (self.times[0], self.times[self.times.len() - 1]);
        Some([speed, (at - first) / (last - first)])
    }

    /// The strongest acceleration, metres a second squared, along the way and across it; none of fewer than three instants.
    pub(super) fn strongest_acceleration(&self) -> Option<f64> {
        let velocities: Vec<(f64, Vector)> = self
            .times
            .windows(2)
            .zip(self.places.windows(2))
            .filter(|(times, _)| times[1] > times[0])
            .map(|(times, places)| {
                ((times[0] + times[1]) / 2.0, (places[1] - places[0]) / ((times[1] - times[0]) * 1e-3))
            })
            .collect();
        let change = |two: &[(f64, Vector)]| (two[1].1 - two[0].1).norm() / ((two[1].0 - two[0].0) * 1e-3);
        velocities.windows(2).map(change).reduce(f64::max)
    }

    /// When the speed fell fastest, as a share of the whole time, 0 to 1; none where it never fell.
    pub(super) fn strongest_braking(&self) -> Option<f64> {
        let falls = |two: &[(f64, f64)]| {
            let [(before, from), (after, to)] = [two[0], two[1]];
            (to > from).then(|| ((before - after) / (to - from), (from + to) / 2.0))
        };
        let speeds = self.speeds();
        let falls = speeds.windows(2).filter_map(falls).filter(|(fall, _)| *fall > 0.0);
        let (_, at) = falls.max_by(|a, b| a.0.total_cmp(&b.0))?;
        let (first, last) = (self.times[0], self.times[self.times.len() - 1]);
        Some((at - first) / (last - first))
    }

    /// Humps of the speed that rise and fall by 0.02 m/s at least.
    pub(super) fn units(&self) -> usize {
        let (mut count, mut lowest, mut highest, mut rising) = (0, 0.0_f64, 0.0_f64, true);
        // Before and after, it rests.
        for speed in self.speeds().into_iter().map(|(speed, _)| speed).chain([0.0]) {
            if rising {
                highest = highest.max(speed);
                lowest = lowest.min(speed);
                if highest - lowest >= HUMP_M_PER_S && highest - speed >= HUMP_M_PER_S {
                    count += 1;
                    (rising, lowest) = (false, speed);
                }
            } else {
                lowest = lowest.min(speed);
                if speed - lowest >= HUMP_M_PER_S {
                    (rising, highest) = (true, speed);
                }
            }
        }
        count
    }
}
