use crate::random_stream;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use std::f64::consts::{FRAC_PI_2, TAU};

/// Noise of each axis: tremor and the sensor's own, g and deg/s. Assumed.
const ACCELERATION_NOISE_G: f64 = 0.02;
const ANGULAR_VELOCITY_NOISE_DEG_PER_S: f64 = 2.0;
/// Tremor of the pitch, rad: no worn sensor stands still. Assumed.
const PITCH_NOISE_RAD: f64 = 0.01;
/// Most by which the forearm is turned from one sample to the next, rad. Assumed: 150 deg/s at 50 samples a second.
const MAX_STEP_RAD: f64 = 0.052;
/// Natural logarithm of what the electrodes on the two sides of the arm hear more, or less, overhead than with a level forearm.
/// Assumed, and large: muscles that move below the skin and gravity have such an effect (Fougner et al. 2011).
const POSITION_GAIN: f64 = 0.6;

/// The inertial measurement unit of a simulated person, whose forearm is turned up and down, and what its turn does to the EMG.
///
/// The unit's x axis lies along the forearm towards the hand, z up when the forearm is level. With the forearm's pitch p, up
/// positive: acceleration `(sin p, 0, cos p)` g, orientation a turn by -p about y, angular velocity -dp/dt about y. The pitch trembles,
/// and acceleration and angular velocity have noise. Electrode c of n hears its muscles stronger by
/// `exp(0.6 sin p cos(2 pi c / n))`, whatever the gesture.
#[derive(Clone, Debug)]
pub struct SimulatedImu {
    rng: ChaCha8Rng,
    /// Radians.
    pitch_rad: f64,
    target_rad: f64,
}

impl SimulatedImu {
    /// A level forearm. Noise is drawn from the stream `emg/imu` of `seed`.
    pub fn new(seed: u64) -> SimulatedImu {
        SimulatedImu { rng: random_stream(seed, "emg/imu"), pitch_rad: 0.0, target_rad: 0.0 }
    }

    /// The forearm goes to position `position` of `count`, evenly from hanging to overhead; with one, it stays level.
    pub fn set_position(&mut self, position: usize, count: usize) {
        let share = if count > 1 { position.min(count - 1) as f64 / (count - 1) as f64 } else { 0.5 };
        self.target_rad = (2.0 * share - 1.0) * FRAC_PI_2;
    }

    /// The next values, 50 or so a second, in the order of [`proact_emg::ImuChannel::of_an_armband`].
    pub fn sample(&mut self) -> [f64; 10] {
        let step = (self.target_rad - self.pitch_rad).clamp(-MAX_STEP_RAD, MAX_STEP_RAD);
        self.pitch_rad += step;
        // At 50 samples a second.
        let turning = -step.to_degrees() * 50.0;
        let mut noise = |scale: f64| {
            let draw: f64 = StandardNormal.sample(&mut self.rng);
            scale * draw
        };
        let pitch = self.pitch_rad + noise(PITCH_NOISE_RAD);
        let (half, (sin, cos)) = (-pitch / 2.0, pitch.sin_cos());
        let acceleration = [sin, 0.0, cos].map(|g| g + noise(ACCELERATION_NOISE_G));
        let velocity = [0.0, turning, 0.0].map(|speed| speed + noise(ANGULAR_VELOCITY_NOISE_DEG_PER_S));
        let mut values = [half.cos(), 0.0, half.sin(), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
        values[4..7].copy_from_slice(&acceleration);
        values[7..].copy_from_slice(&velocity);
        values
    }

    /// What electrode `channel` of `channels` hears its muscles stronger by.
    pub fn gain(&self, channel: usize, channels: usize) -> f64 {
        let around = (TAU * channel as f64 / channels.max(1) as f64).cos();
        (POSITION_GAIN * self.pitch_rad.sin() * around).exp()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gravity_turns_with_the_forearm_and_its_length_stays() {
        let mut imu = SimulatedImu::new(3);
        for (position, expected) in [(0, [-1.0, 0.0, 0.0]), (1, [0.0, 0.0, 1.0]), (2, [1.0, 0.0, 0.0])] {
            imu.set_position(position, 3);
            for _ in 0..100 {
                imu.sample();
            }
            let mean =
                |k: usize, imu: &mut SimulatedImu| (0..400).map(|_| imu.sample()[k]).sum::<f64>() / 400.0;
            for (axis, expected) in expected.into_iter().enumerate() {
                // Five standard errors of the mean.
                assert!((mean(4 + axis, &mut imu) - expected).abs() < 0.005, "{position} {axis}");
            }
            let length: f64 = imu.sample()[..4].iter().map(|v| v * v).sum();
            assert!((length - 1.0).abs() < 1e-12, "a unit quaternion");
        }
        assert!(imu.gain(0, 8) > 1.5 && imu.gain(4, 8) < 0.7 && (imu.gain(2, 8) - 1.0).abs() < 1e-9);
    }
}
