use std::f64::consts::TAU;

/// Mains frequencies of the world.
pub(crate) const MAINS_HZ: [f64; 2] = [50.0, 60.0];
/// The frequency itself and two harmonics.
const HARMONICS: usize = 3;

/// Power of a signal at a frequency and its harmonics, sample by sample (Goertzel 1958).
#[derive(Clone, Copy, Debug)]
pub(crate) struct Goertzel {
    /// Twice the cosine of the angle per sample; none beyond 98 % of half the rate.
    factors: [Option<f64>; HARMONICS],
    states: [[f64; 2]; HARMONICS],
    samples: f64,
    /// The first sample of a block, subtracted from all: an offset would eat the digits.
    origin: f64,
}

impl Goertzel {
    pub(crate) fn new(hz: f64, rate_hz: f64) -> Self {
        let factor = |k: usize| {
            let hz = hz * (k + 1) as f64;
            (hz < 0.49 * rate_hz).then(|| 2.0 * (TAU * hz / rate_hz).cos())
        };
        Goertzel {
            factors: [factor(0), factor(1), factor(2)],
            states: [[0.0; 2]; HARMONICS],
            samples: 0.0,
            origin: 0.0,
        }
    }

    pub(crate) fn push(&mut self, value: f64) {
        if self.samples == 0.0 {
            self.origin = value;
        }
        self.samples += 1.0;
        for (factor, state) in self.factors.iter().zip(&mut self.states) {
            if let Some(factor) = factor {
                *state = [value - self.origin + factor * state[0] - state[1], state[0]];
            }
        }
    }

    /// Variance of the signal since the last call that lies at the frequencies; begins anew.
    pub(crate) fn finish(&mut self) -> f64 {
        let power = |(factor, [new, old]): (&Option<f64>, &[f64; 2])| {
            factor.map_or(0.0, |factor| new * new + old * old - factor * new * old)
        };
        let sum: f64 = self.factors.iter().zip(&self.states).map(power).sum();
        // A sine of amplitude a gives (a n / 2)^2 and has the variance a^2 / 2.
        let variance = 2.0 * sum / self.samples.max(1.0).powi(2);
        self.states = [[0.0; 2]; HARMONICS];
        self.samples = 0.0;
        variance
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sine_at_the_frequency_gives_its_variance_and_another_none() {
        for rate in [200.0, 1000.0] {
            let measure = |hz: f64| {
                let mut filter = Goertzel::new(50.0, rate);
                let block = (rate / 5.0) as usize;
                (0..block).for_each(|k| filter.push(1e6 + 4.0 * (TAU * hz * k as f64 / rate).sin()));
                filter.finish()
            };
            assert!((measure(50.0) - 8.0).abs() < 1e-6, "{}", measure(50.0));
            assert!(measure(60.0) < 1e-6 && measure(30.0) < 1e-6);
        }
    }
}
