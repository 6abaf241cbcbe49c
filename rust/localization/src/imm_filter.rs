//! Kalman filters of one vector in motion: some for a person who sits, some for one who leans, and how likely each is.

use nalgebra::{Matrix3, RowVector3, Vector3};
use proact_types::Vector;

/// Kinds of motion that are told apart.
const MODES: usize = 3;

/// How a quantity moves, in its own unit U (m or rad).
#[derive(Clone, Copy, Debug)]
pub(crate) struct ManeuverModel {
    /// Standard deviation of the acceleration of each kind of motion, U/s^2, calmest first.
    pub acceleration_sds: [f64; MODES],
    /// For so long an acceleration lasts, s.
    pub acceleration_secs: f64,
    /// For so long a speed lasts, s.
    pub speed_secs: f64,
    /// What is known of place, speed and acceleration of a body that is seen for the first time.
    pub initial_sds: [f64; 3],
}

/// A kind of motion lasts this long, s.
const MODE_SECS: f64 = 2.0;

/// Place, speed and acceleration of one kind of motion; all three coordinates are equally well known.
#[derive(Clone, Copy, Debug)]
struct Mode {
    state: [Vector; 3],
    covariance: Matrix3<f64>,
    weight: f64,
}

/// Interacting multiple models (Blom & Bar-Shalom 1988, "The interacting multiple model algorithm for systems with Markovian
/// switching coefficients", IEEE Trans Autom Control 33:780) of a motion whose acceleration comes and goes (Singer 1970,
/// "Estimating optimal tracking filter performance for manned maneuvering targets", IEEE Trans Aerosp Electron Syst 6:473).
#[derive(Clone, Debug)]
pub(crate) struct ImmFilter {
    model: ManeuverModel,
    modes: [Mode; MODES],
}

impl ImmFilter {
    /// Seen at `position` for the first time.
    pub fn at(position: Vector, maneuvers: ManeuverModel) -> Self {
        let covariance =
            Matrix3::from_diagonal(&Vector3::from(maneuvers.initial_sds.map(|sigma| sigma * sigma)));
        let state = [position, Vector::zeros(), Vector::zeros()];
        let mode = Mode { state, covariance, weight: 1.0 / MODES as f64 };
        Self { model: maneuvers, modes: [mode; MODES] }
    }

    /// Goes on by `secs` and takes in a measurement whose coordinates have the standard deviation `noise`.
    pub fn update(&mut self, secs: f64, measured: &Vector, noise: f64) {
        self.mix(secs);
        let step = self.transition(secs);
        let spread = self.process_noise(secs);
        let mut likelihoods = [0.0; MODES];
        for (k, mode) in self.modes.iter_mut().enumerate() {
            mode.state = propagate(&mode.state, &step);
            let acceleration = self.model.acceleration_sds[k];
            mode.covariance =
                step * mode.covariance * step.transpose() + spread * (acceleration * acceleration);
            let variance = mode.covariance[(0, 0)] + noise * noise;
            let off = measured - mode.state[0];
            let gain = mode.covariance.column(0) / variance;
            for (part, gain) in mode.state.iter_mut().zip(gain.iter()) {
                *part += off * *gain;
            }
            let seen = Matrix3::identity() - gain * RowVector3::new(1.0, 0.0, 0.0);
            // Joseph's form stays positive.
            mode.covariance =
                seen * mode.covariance * seen.transpose() + gain * gain.transpose() * (noise * noise);
            likelihoods[k] = -0.5 * off.norm_squared() / variance - 1.5 * variance.ln();
        }
        let best = likelihoods.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let mut sum = 0.0;
        for (mode, likelihood) in self.modes.iter_mut().zip(likelihoods) {
            mode.weight = (mode.weight * (likelihood - best).exp()).max(1e-6);
            sum += mode.weight;
        }
        self.modes.iter_mut().for_each(|mode| mode.weight /= sum);
    }

    /// Place, speed and acceleration now.
    pub fn state(&self) -> [Vector; 3] {
        [0, 1, 2].map(|k| self.modes.iter().map(|mode| mode.state[k] * mode.weight).sum())
    }

    /// Where it is `secs` later.
    pub fn predict(&self, secs: f64) -> Vector {
        propagate(&self.state(), &self.transition(secs))[0]
    }

    /// Counts place, speed and acceleration from these.
    pub fn subtract_state(&mut self, origin: [Vector; 3]) {
        for mode in &mut self.modes {
            for (part, from) in mode.state.iter_mut().zip(origin) {
                *part -= from;
            }
        }
    }

    /// What each kind begins with, from all kinds that may have been before.
    fn mix(&mut self, secs: f64) {
        let leaves = 1.0 - (-secs / MODE_SECS).exp();
        let before = self.modes;
        for (to, mode) in self.modes.iter_mut().enumerate() {
            let shares: [f64; MODES] = std::array::from_fn(|from| {
                let goes = if from == to { 1.0 - leaves } else { leaves / (MODES - 1) as f64 };
                before[from].weight * goes
            });
            let sum: f64 = shares.iter().sum();
            let shares = shares.map(|share| share / sum);
            let state: [Vector; 3] = std::array::from_fn(|k| {
                before.iter().zip(shares).map(|(mode, share)| mode.state[k] * share).sum()
            });
            let mut covariance = Matrix3::zeros();
            for (other, share) in before.iter().zip(shares) {
                let off: [Vector; 3] = std::array::from_fn(|k| other.state[k] - state[k]);
                // The mean over the three coordinates, which share one covariance.
                let between = Matrix3::from_fn(|row, column| off[row].dot(&off[column]) / 3.0);
                covariance += (other.covariance + between) * share;
            }
            *mode = Mode { state, covariance, weight: sum };
        }
    }

    fn transition(&self, secs: f64) -> Matrix3<f64> {
        let [speed, acceleration] = [self.model.speed_secs, self.model.acceleration_secs];
        (Matrix3::new(0.0, 1.0, 0.0, 0.0, -1.0 / speed, 1.0, 0.0, 0.0, -1.0 / acceleration) * secs).exp()
    }

    /// What a standard deviation of 1 U/s^2 of acceleration adds in `secs`: the integral over the white jerk behind it, by Gauss
    /// and Legendre in three points.
    fn process_noise(&self, secs: f64) -> Matrix3<f64> {
        let jerk = 2.0 / self.model.acceleration_secs;
        let far = (0.6_f64).sqrt();
        let mut sum = Matrix3::zeros();
        for (at, weight) in [(-far, 5.0 / 18.0), (0.0, 8.0 / 18.0), (far, 5.0 / 18.0)] {
            let response = self.transition(secs * (0.5 + 0.5 * at)).column(2).into_owned();
            sum += response * response.transpose() * (weight * secs * jerk);
        }
        sum
    }
}

fn propagate(state: &[Vector; 3], step: &Matrix3<f64>) -> [Vector; 3] {
    std::array::from_fn(|row| (0..3).map(|k| state[k] * step[(row, k)]).sum())
}
