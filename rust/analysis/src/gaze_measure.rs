//! What the eyes of a person did in a trial, from the samples that were recorded.

use proact_types::{GazeSample, SimTime, Vector};

/// Faster than this, degrees a second, the eye is on its way: the usual limit between fixations and saccades (Salvucci and
/// Goldberg 2000, I-VT).
pub const SACCADE_THRESHOLD_DEG_PER_S: f64 = 100.0;
/// Shorter than this, milliseconds, the eye did not stay.
pub const MIN_FIXATION_MS: u64 = 80;
/// Two gazes further apart than this, milliseconds, say nothing of the way between them.
const MAX_GAP_MS: u64 = 100;

/// Where the eyes went, sample by sample.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct GazeMeasure {
    /// Samples.
    pub samples: u64,
    /// Those in which the tracker saw the eye.
    pub valid: u64,
    /// The angle that the gaze went, degrees.
    pub path_deg: f64,
    /// Fixations that are over.
    pub fixations: u64,
    /// Their lengths together, milliseconds.
    pub fixation_ms: u64,
    last: Option<(SimTime, Vector)>,
    /// When the fixation that goes on began.
    since: Option<SimTime>,
}

impl GazeMeasure {
    /// Takes in the next sample.
    pub fn push(&mut self, time: SimTime, gaze: &GazeSample) {
        self.samples += 1;
        let direction =
            gaze.direction.try_normalize(1e-9).filter(|d| gaze.valid && d.iter().all(|v| v.is_finite()));
        let Some(direction) = direction else { return };
        self.valid += 1;
        let before = self.last.replace((time, direction));
        let Some((then, other)) = before.filter(|(then, _)| time.millis_since(*then) <= MAX_GAP_MS) else {
            self.end_fixation(before.map_or(time, |(then, _)| then));
            self.since = Some(time);
            return;
        };
        let degrees = direction.angle(&other).to_degrees();
        self.path_deg += degrees;
        let secs = time.millis_since(then) as f64 * 1e-3;
        if degrees > SACCADE_THRESHOLD_DEG_PER_S * secs {
            self.end_fixation(then);
        } else {
            self.since.get_or_insert(then);
        }
    }

    fn end_fixation(&mut self, at: SimTime) {
        let lasted = self.since.take().map_or(0, |since| at.millis_since(since));
        if lasted >= MIN_FIXATION_MS {
            self.fixations += 1;
            self.fixation_ms += lasted;
        }
    }

    /// Ends the fixation that goes on: the trial, or its phase, is over.
    pub fn finish(mut self) -> Self {
        if let Some((time, _)) = self.last {
            self.end_fixation(time);
        }
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proact_types::Point;

    fn look(measure: &mut GazeMeasure, millis: u64, degrees: f64) {
        let (sin, cos) = degrees.to_radians().sin_cos();
        let gaze = GazeSample {
            origin: Point::origin(),
            direction: Vector::new(2.0 * cos, 2.0 * sin, 0.0),
            valid: true,
        };
        measure.push(SimTime(millis), &gaze);
    }

    #[test]
    fn two_rests_and_a_jump_between_them_are_two_fixations() {
        let mut measure = GazeMeasure::default();
        (0..30).for_each(|k| look(&mut measure, 16 * k, 0.01 * k as f64));
        (30..50).for_each(|k| look(&mut measure, 16 * k, 20.0));
        let measure = measure.finish();
        assert_eq!((measure.samples, measure.valid, measure.fixations), (50, 50, 2));
        assert_eq!(measure.fixation_ms, 16 * 29 + 16 * 19);
        assert!((measure.path_deg - 20.0).abs() < 1e-6, "{}", measure.path_deg);
    }

    #[test]
    fn a_blink_and_a_silence_end_no_way_and_a_glance_is_no_fixation() {
        let mut measure = GazeMeasure::default();
        (0..3).for_each(|k| look(&mut measure, 16 * k, 0.0));
        let blink = GazeSample { origin: Point::origin(), direction: Vector::zeros(), valid: false };
        measure.push(SimTime(48), &blink);
        look(&mut measure, 1000, 40.0);
        let measure = measure.finish();
        assert_eq!((measure.samples, measure.valid, measure.fixations, measure.path_deg), (5, 4, 0, 0.0));
    }
}
