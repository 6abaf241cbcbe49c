use crate::ports::GazeTracker;
use proact_types::{GazeSample, Point, SimTime, Vector};
use std::ops::Range;

/// Ticks from one measurement to the next: 125 Hz.
const GAZE_TICKS: u64 = 8;
/// Tremor of the eye, rad. A ray that never changed would be that of a frozen tracker.
const TREMOR: f64 = 1e-4;

/// What a tracker does wrong for a while.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GazeFault {
    /// Directions that are no numbers, said to be valid.
    NotANumber,
    /// The eye is not seen.
    Blink,
    /// The measurement before, once more.
    Frozen,
    /// Nothing comes.
    Silent,
}

/// An eye tracker that measures the truth of an eye that trembles, but for the faults that it is told to have.
#[derive(Clone, Debug, Default)]
pub struct ScriptedGaze {
    faults: Vec<(Range<u64>, GazeFault)>,
    last: Option<GazeSample>,
}

impl ScriptedGaze {
    /// The same with `fault` in the `ticks`.
    pub fn with_fault(mut self, ticks: Range<u64>, fault: GazeFault) -> Self {
        self.faults.push((ticks, fault));
        self
    }
}

impl GazeTracker for ScriptedGaze {
    fn sample_at(&mut self, now: SimTime, eye: &Point, direction: &Vector, open: bool) -> Option<GazeSample> {
        if !now.0.is_multiple_of(GAZE_TICKS) {
            return None;
        }
        let direction = direction + Vector::z() * TREMOR * (now.0 as f64).sin();
        let truth = GazeSample { origin: *eye, direction, valid: open };
        let fault = self.faults.iter().find(|(ticks, _)| ticks.contains(&now.0)).map(|(_, fault)| *fault);
        let sample = match fault {
            None => Some(truth),
            Some(GazeFault::NotANumber) => {
                Some(GazeSample { direction: Vector::repeat(f64::NAN), valid: true, ..truth })
            }
            Some(GazeFault::Blink) => Some(GazeSample { valid: false, ..truth }),
            Some(GazeFault::Frozen) => self.last.or(Some(truth)),
            Some(GazeFault::Silent) => None,
        };
        self.last = sample.or(self.last);
        sample
    }
}
