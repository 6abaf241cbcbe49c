use proact_types::{GazeSample, Vector};
use std::ops::AddAssign;

/// A direction stays this far from straight up and down, rad: there a turn to the left is none.
const POLE: f64 = 0.01;

/// A constant error of a gaze source, as a calibration finds it: how far it points to the left of where the person
/// looks, and above it, rad. Taken off each sample.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct GazeOffset {
    /// About `world` z.
    pub left: f64,
    /// Towards `world` z.
    pub up: f64,
}

impl GazeOffset {
    /// The sample without the error; its origin and validity stay.
    pub fn correct(&self, sample: GazeSample) -> GazeSample {
        if *self == GazeOffset::default() {
            return sample;
        }
        let (x, y, z) = (sample.direction.x, sample.direction.y, sample.direction.z);
        let most = std::f64::consts::FRAC_PI_2 - POLE;
        let yaw = y.atan2(x) - self.left;
        let pitch = (z.atan2(x.hypot(y)) - self.up).clamp(-most, most);
        let direction = Vector::new(pitch.cos() * yaw.cos(), pitch.cos() * yaw.sin(), pitch.sin());
        GazeSample { direction: direction * sample.direction.norm(), ..sample }
    }
}

/// An error that is found on top of one that is taken off already.
impl AddAssign for GazeOffset {
    fn add_assign(&mut self, more: GazeOffset) {
        self.left += more.left;
        self.up += more.up;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proact_types::Point;

    fn sample(direction: Vector) -> GazeSample {
        GazeSample { origin: Point::new(1.0, 2.0, 3.0), direction, valid: true }
    }

    #[test]
    fn the_error_of_a_source_that_looks_left_and_up_is_taken_off() {
        let error = GazeOffset { left: 0.1, up: -0.05 };
        for (yaw, pitch) in [(0.0_f64, 0.0_f64), (1.0, -0.6), (-3.1, 0.9), (3.1, -1.2)] {
            let at = |yaw: f64, pitch: f64| {
                Vector::new(pitch.cos() * yaw.cos(), pitch.cos() * yaw.sin(), pitch.sin())
            };
            let corrected = error.correct(sample(at(yaw + 0.1, pitch - 0.05)));
            assert!((corrected.direction - at(yaw, pitch)).norm() < 1e-12, "{corrected:?}");
            assert_eq!((corrected.origin, corrected.valid), (Point::new(1.0, 2.0, 3.0), true));
        }
    }

    #[test]
    fn without_an_error_a_sample_stays_to_the_bit_and_nothing_goes_over_the_pole() {
        let odd = sample(Vector::new(0.1, -0.7, 0.3));
        assert_eq!(GazeOffset::default().correct(odd), odd);
        let up = GazeOffset { left: 0.0, up: -0.3 }.correct(sample(Vector::new(0.1, 0.0, 1.0).normalize()));
        assert!(up.direction.x > 0.0 && up.direction.z < 1.0, "{up:?}");
    }

    #[test]
    fn errors_add_up() {
        let mut error = GazeOffset { left: 0.1, up: 0.2 };
        error += GazeOffset { left: -0.3, up: 0.1 };
        assert!((error.left + 0.2).abs() < 1e-15 && (error.up - 0.3).abs() < 1e-15);
    }
}
