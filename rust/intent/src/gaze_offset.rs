use proact_types::{GazeSample, Vector};
use std::ops::AddAssign;

/// Rounds of the search for the direction that the error led to the measured one. Each takes off nine tenths of what is
/// left, at errors and slopes as they occur.
const MAX_ITERATIONS: usize = 16;
/// Errors do not add up to more than this, rad: a source that is further off is broken, and its error's tangent grows
/// without bound.
const MAX_OFFSET_RAD: f64 = 0.5;

/// A constant error of a gaze source, as a calibration finds it: how far it points to the left of where the person
/// looks, and above it, rad, as seen along the gaze. Taken off each sample.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct GazeOffset {
    /// To the left, level.
    pub left_rad: f64,
    /// Upwards, across the gaze.
    pub up_rad: f64,
}

impl GazeOffset {
    /// The sample without the error; its origin and validity stay, and its direction gets length 1.
    pub fn correct(&self, sample: GazeSample) -> GazeSample {
        let measured = match sample.direction.try_normalize(0.0) {
            Some(measured) if *self != GazeOffset::default() => measured,
            _ => return sample,
        };
        let mut direction = measured;
        for _ in 0..MAX_ITERATIONS {
            let error = self.direction_offset(&direction);
            let length = (1.0 + error.norm_squared()).sqrt();
            direction = (measured * length - error).normalize();
        }
        GazeSample { direction, ..sample }
    }

    /// The error beside a unit vector that is looked along.
    fn direction_offset(&self, direction: &Vector) -> Vector {
        // Straight up or down nothing is to the left: any level direction will do.
        let left = Vector::z().cross(direction).try_normalize(1e-6).unwrap_or(Vector::y());
        let up = direction.cross(&left);
        left * self.left_rad.tan() + up * self.up_rad.tan()
    }
}

/// An error that is found on top of one that is taken off already, up to half a radian in all.
impl AddAssign for GazeOffset {
    fn add_assign(&mut self, more: GazeOffset) {
        self.left_rad = (self.left_rad + more.left_rad).clamp(-MAX_OFFSET_RAD, MAX_OFFSET_RAD);
        self.up_rad = (self.up_rad + more.up_rad).clamp(-MAX_OFFSET_RAD, MAX_OFFSET_RAD);
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
        let error = GazeOffset { left_rad: 0.1, up_rad: -0.05 };
        for (yaw, pitch) in [(0.0_f64, 0.0_f64), (1.0, -0.6), (-3.1, 0.9), (3.1, -1.2)] {
            let direction = Vector::new(pitch.cos() * yaw.cos(), pitch.cos() * yaw.sin(), pitch.sin());
            let corrected = error.correct(sample(direction + error.direction_offset(&direction)));
            assert!((corrected.direction - direction).norm() < 1e-8, "{corrected:?} at {yaw} {pitch}");
            assert_eq!((corrected.origin, corrected.valid), (Point::new(1.0, 2.0, 3.0), true));
        }
        let ahead = error.correct(sample(Vector::x())).direction;
        assert!((ahead.y.atan2(ahead.x) + 0.1).abs() < 1e-3 && (ahead.z - 0.05).abs() < 1e-3, "{ahead}");
    }

    #[test]
    fn without_an_error_a_sample_stays_to_the_bit_and_straight_down_is_corrected_somehow() {
        let odd = sample(Vector::new(0.1, -0.7, 0.3));
        assert_eq!(GazeOffset::default().correct(odd), odd);
        let down = GazeOffset { left_rad: 0.1, up_rad: 0.1 }.correct(sample(-Vector::z())).direction;
        assert!((down.norm() - 1.0).abs() < 1e-12 && down.z < -0.95, "{down}");
    }

    #[test]
    fn errors_add_up_to_a_bound() {
        let mut error = GazeOffset { left_rad: 0.1, up_rad: 0.2 };
        error += GazeOffset { left_rad: -0.3, up_rad: 0.1 };
        assert!((error.left_rad + 0.2).abs() < 1e-15 && (error.up_rad - 0.3).abs() < 1e-15);
        for _ in 0..20 {
            error += GazeOffset { left_rad: 0.3, up_rad: -0.3 };
        }
        assert_eq!(error, GazeOffset { left_rad: MAX_OFFSET_RAD, up_rad: -MAX_OFFSET_RAD });
        for direction in [Vector::x(), -Vector::z(), Vector::new(0.3, -0.2, -0.9)] {
            assert!(error.correct(sample(direction)).direction.iter().all(|x| x.is_finite()));
        }
    }
}
