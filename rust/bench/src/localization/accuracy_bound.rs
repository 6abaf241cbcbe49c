//! What no filter can do better: the attitude of a person who only sways, if the spectrum of the sway is known.

use super::{
    simulated_tracking::{END_SECS, PoseArrival, SHOULDER_SWAY_DEG, SWAY_HZ, TrackingConditions},
    tracking_run::TOLERANCE_M_DEG,
};
use nalgebra::{DMatrix, DVector};
use std::f64::consts::{PI, TAU};

/// Samples that the newest pose is estimated from, three seconds.
const SAMPLES: usize = 300;
const SAMPLE_SECS: f64 = 0.01;

/// Share of frames whose attitude can be within the goal at most, %: the samples of `streams` are fitted by the Gaussian process
/// that has the covariance of the sway (Rasmussen & Williams 2006, "Gaussian processes for machine learning", eq. 2.26), which no
/// causal estimator undercuts. Leans, gaps before the newest sample, places and the headset come on top.
pub(super) fn max_proportion_within(conditions: &TrackingConditions, streams: &[Vec<PoseArrival>]) -> f64 {
    let sigma_deg = SwayDeviation::new(conditions);
    let (mut sum, mut frames) = (0.0, 0_u32);
    for stream in streams {
        let mut next = 0;
        for frame in 120..((END_SECS - 2.0) * 60.0) as u32 {
            let now = f64::from(frame) / 60.0;
            while stream.get(next + 1).is_some_and(|(_, arrival, _)| *arrival <= now) {
                next += 1;
            }
            // Of three Gaussians the norm is below x standard deviations with this probability.
            let x = TOLERANCE_M_DEG.1 / sigma_deg.at(now - stream[next].0);
            sum += erf(x / 2.0_f64.sqrt()) - (2.0 / PI).sqrt() * x * (-x * x / 2.0).exp();
            frames += 1;
        }
    }
    100.0 * sum / f64::from(frames)
}

/// Standard deviation of one coordinate of the turn, degrees, over the age of the newest sample.
struct SwayDeviation {
    /// At every 10 ms of age.
    table_deg: Vec<f64>,
}

impl SwayDeviation {
    fn new(conditions: &TrackingConditions) -> Self {
        // Frequencies evenly on a logarithmic axis, power falling with each: as the simulated sway has them.
        let waves: Vec<f64> = (0..200)
            .map(|k| SWAY_HZ.0 * (SWAY_HZ.1 / SWAY_HZ.0).powf((f64::from(k) + 0.5) / 200.0))
            .collect();
        let power: f64 = waves.iter().map(|hz| 1.0 / hz).sum();
        let variance = SHOULDER_SWAY_DEG * SHOULDER_SWAY_DEG;
        let covariances: Vec<f64> = (0..SAMPLES + 60)
            .map(|k| {
                let t = k as f64 * SAMPLE_SECS;
                variance * waves.iter().map(|hz| (TAU * hz * t).cos() / hz).sum::<f64>() / power
            })
            .collect();
        let noise = conditions.noise_deg * conditions.noise_deg;
        let all = DMatrix::from_fn(SAMPLES, SAMPLES, |row, column| {
            covariances[row.abs_diff(column)] + if row == column { noise } else { 0.0 }
        });
        let solver = all.cholesky().expect("a covariance with noise is positive");
        let table = (0..60)
            .map(|age| {
                let with = DVector::from_fn(SAMPLES, |k, _| covariances[age + k]);
                (variance - with.dot(&solver.solve(&with))).max(0.0).sqrt()
            })
            .collect();
        Self { table_deg: table }
    }

    fn at(&self, age_secs: f64) -> f64 {
        let at = (age_secs / SAMPLE_SECS).clamp(0.0, (self.table_deg.len() - 1) as f64 - 1e-9);
        let k = at as usize;
        self.table_deg[k] + (self.table_deg[k + 1] - self.table_deg[k]) * at.fract()
    }
}

/// Abramowitz & Stegun 7.1.26: off by less than 1.5e-7.
fn erf(x: f64) -> f64 {
    let t = 1.0 / (1.0 + 0.327_591_1 * x);
    let sum = [1.061_405_429, -1.453_152_027, 1.421_413_741, -0.284_496_736, 0.254_829_592];
    1.0 - sum.iter().fold(0.0, |all, part| (all + part) * t) * (-x * x).exp()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn more_noise_and_older_samples_leave_less_within_reach() {
        let quiet = SwayDeviation::new(&TrackingConditions { noise_deg: 0.1, ..TrackingConditions::NOMINAL });
        let stated = SwayDeviation::new(&TrackingConditions::NOMINAL);
        assert!(quiet.at(0.02) < stated.at(0.02) && stated.at(0.02) < stated.at(0.1));
        // Far from the newest sample only the sway itself is known.
        assert!(stated.at(10.0) < SHOULDER_SWAY_DEG && stated.at(10.0) > 0.7 * SHOULDER_SWAY_DEG);
        assert!((erf(0.5) - 0.520_499_877_8).abs() < 2e-7);
    }
}
