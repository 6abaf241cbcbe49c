use crate::{EmgConfig, EmgError};
use proact_types::Drives;

/// From what a regressor says of a window to what drives the arm: smoothing, dead band, and nothing at all while the
/// signal is not to be trusted.
#[derive(Clone, Debug)]
pub(crate) struct DriveFilter {
    /// Of the way that smoothed drives take with each window.
    smoothing_factor: f64,
    dead_band: f64,
    smoothed: Drives,
}

impl DriveFilter {
    /// For `count` degrees of freedom, at rest.
    ///
    /// # Errors
    /// An increment that cannot be.
    pub(crate) fn new(config: &EmgConfig, count: usize) -> Result<Self, EmgError> {
        Ok(DriveFilter {
            smoothing_factor: config.regression.smoothing_factor(config.increment_millis()?),
            dead_band: config.regression.dead_band,
            smoothed: (0..count).map(|_| 0.0).collect(),
        })
    }

    /// Takes the drives of a window.
    pub(crate) fn step(&mut self, window: &Drives) -> Drives {
        for (smoothed, drive) in self.smoothed.iter_mut().zip(window) {
            *smoothed = self.smoothing_factor * drive + (1.0 - self.smoothing_factor) * *smoothed;
        }
        let beyond = |drive: &f64| if drive.abs() > self.dead_band { *drive } else { 0.0 };
        self.smoothed.iter().map(beyond).collect()
    }

    /// All zero, at once: what was smoothed before is forgotten.
    pub(crate) fn reset(&mut self) -> Drives {
        self.smoothed.iter_mut().for_each(|drive| *drive = 0.0);
        self.smoothed.clone()
    }
}
