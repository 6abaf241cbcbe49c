use crate::{DeviceError, random_stream};
use proact_types::{GazeSample, Point, SimTime, Vector};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

/// A head-mounted eye tracker with errors: a bias that lasts the whole session, as of a calibration that is a
/// little off, and noise from sample to sample.
///
/// The error is a turn of the true direction by a Gaussian angle about each of two axes across it. Bias and noise
/// keep the ratio of their measured lengths, 0.8 to 0.3 degrees, and are scaled together so that the root mean
/// square of the whole angle, over sessions and samples, is the `error_deg` asked for.
///
/// Known weaknesses: the error does not grow towards the edge of the field of view, and there is no drift.
#[derive(Clone, Debug)]
pub struct SimulatedEyeTracker {
    rng: ChaCha8Rng,
    /// Turn to the right and up, rad.
    bias_rad: [f64; 2],
    /// Standard deviation of each turn, rad.
    noise_rad: f64,
    /// Number of the next sample.
    next_sample: u64,
    /// Reported while there is nothing to measure.
    last_direction: Vector,
}

/// Root mean square lengths of bias and noise, degrees. The ratio is what counts: a first model after the
/// accuracy of 0.83 and the precision of 0.27 degrees measured on HoloLens 2 (ARETT, Sensors 2021, 21:2234).
const BIAS_DEG: f64 = 0.8;
const NOISE_DEG: f64 = 0.3;
/// Of a tracker without errors, rad: no eye holds still, and rays that repeat to the bit are those of a frozen tracker.
const TREMOR_RAD: f64 = 1e-7;
/// Samples per second. The headset of the original gives 30; 60 keeps the ray as fresh as the display.
const RATE_HZ: u64 = 60;

impl SimulatedEyeTracker {
    /// Error of the tracker class that the original uses, degrees (HoloLens 2: about 1.5).
    pub const DEFAULT_ERROR_DEG: f64 = 1.5;

    /// A tracker with a root mean square error of `error_deg` degrees, drawn from the stream `gaze` of `seed`.
    /// Zero gives one that is off by the eye's tremor alone.
    ///
    /// # Errors
    /// If the error is negative, not finite, or above 45 degrees.
    pub fn new(error_deg: f64, seed: u64) -> Result<SimulatedEyeTracker, DeviceError> {
        if !(0.0..=45.0).contains(&error_deg) {
            let expected = "0 to 45 degrees";
            return Err(DeviceError::Parameter { name: "gaze error", value: error_deg, expected });
        }
        let mut rng = random_stream(seed, "gaze");
        // A length spread over two axes.
        let scale = error_deg.to_radians() / BIAS_DEG.hypot(NOISE_DEG) / std::f64::consts::SQRT_2;
        let bias = [(); 2].map(|()| BIAS_DEG * scale * sample_normal(&mut rng));
        let noise_rad = if error_deg > 0.0 { NOISE_DEG * scale } else { TREMOR_RAD };
        Ok(SimulatedEyeTracker {
            rng,
            bias_rad: bias,
            noise_rad,
            next_sample: 0,
            last_direction: Vector::x(),
        })
    }

    /// The sample of tick `now`, if one is due: 60 a second. `eye` is where the ray begins, `direction` where the
    /// eye really points, both in `world`; the direction need not be a unit vector, the one returned is. While
    /// the eye is closed, or points nowhere, the sample is not valid and repeats the last direction.
    pub fn sample_at(
        &mut self,
        now: SimTime,
        eye: &Point,
        direction: &Vector,
        open: bool,
    ) -> Option<GazeSample> {
        let due = now.0 * RATE_HZ / 1000 + 1;
        if due <= self.next_sample {
            return None;
        }
        self.next_sample = due;
        // Drawn for closed eyes too: a blink must not change the errors after it.
        let [right, up] = self.bias_rad.map(|bias| bias + self.noise_rad * sample_normal(&mut self.rng));
        let finite = eye.iter().chain(direction.iter()).all(|v| v.is_finite());
        let unit = direction.try_normalize(f64::MIN_POSITIVE).filter(|_| open && finite);
        if let Some(unit) = unit {
            self.last_direction = rotate_direction(&unit, right, up);
        }
        Some(GazeSample { origin: *eye, direction: self.last_direction, valid: unit.is_some() })
    }
}

fn sample_normal(rng: &mut ChaCha8Rng) -> f64 {
    StandardNormal.sample(rng)
}

/// `direction`, a unit vector, turned by `right` and `up` radians as seen by an upright head.
fn rotate_direction(direction: &Vector, right: f64, up: f64) -> Vector {
    let to_right = direction.cross(&Vector::z());
    // Straight up or down there is no right; any axis across will do.
    let to_right = to_right.try_normalize(1e-9).unwrap_or_else(Vector::y);
    let upwards = to_right.cross(direction);
    let angle = right.hypot(up);
    if angle == 0.0 {
        return *direction;
    }
    let across = (to_right * right + upwards * up) / angle;
    direction * angle.cos() + across * angle.sin()
}
