//! Settings of regression: degrees of freedom in the place of classes.

use crate::EmgError;
use proact_types::{DegreeOfFreedom, Gesture, MAX_DRIVES};
use serde::{Deserialize, Serialize};

/// How a regressor ([`crate::ClassifierKind::Linear`], [`crate::ClassifierKind::Ridge`]) is trained and what becomes of its
/// drives.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RegressionConfig {
    /// The degrees of freedom, each by its positive and its negative gesture: 1 to [`MAX_DRIVES`]. Default: the wrist and the
    /// hand of the five gestures.
    pub drives: Vec<DegreeOfFreedom>,
    /// Weight of the penalty on the squared coefficients of standardised features, with ridge; linear has none. Default 1
    /// (scikit-learn).
    pub ridge_alpha: f64,
    /// Drives up to this are zero, 0 to below 1; a hand of which all are zero is relaxed. Default 0.3: of LibEMG's test
    /// recordings 53 of 59 windows at rest lie within it, 42 within 0.2 (docs/emg.md). LibEMG has none unless one is set.
    pub dead_band: f64,
    /// Time constant over which drives are smoothed, milliseconds: each window takes them the share `1 - exp(-increment /
    /// smoothing_time_constant_ms)` of the way. Default 0, unsmoothed, as LibEMG.
    pub smoothing_time_constant_ms: f64,
}

impl Default for RegressionConfig {
    fn default() -> Self {
        RegressionConfig {
            drives: vec![DegreeOfFreedom::wrist(), DegreeOfFreedom::hand()],
            ridge_alpha: 1.0,
            dead_band: 0.3,
            smoothing_time_constant_ms: 0.0,
        }
    }
}

impl RegressionConfig {
    pub(crate) fn is_default(&self) -> bool {
        *self == RegressionConfig::default()
    }

    /// Checks every value; `rest` is the gesture of a relaxed hand.
    pub(crate) fn check(&self, rest: Gesture) -> Result<(), EmgError> {
        let refused = |name, value, expected| Err(EmgError::OutOfRange { name, value, expected });
        if !(self.ridge_alpha.is_finite() && self.ridge_alpha >= 0.0) {
            return refused("regression.ridge_alpha", self.ridge_alpha, "a finite number, at least 0");
        }
        if !(0.0..1.0).contains(&self.dead_band) {
            return refused("regression.dead_band", self.dead_band, "at least 0 and less than 1");
        }
        if !(0.0..=10_000.0).contains(&self.smoothing_time_constant_ms) {
            return refused(
                "regression.smoothing_time_constant_ms",
                self.smoothing_time_constant_ms,
                "0 to 10000",
            );
        }
        if !(1..=MAX_DRIVES).contains(&self.drives.len()) {
            return refused("number of regression.drives", self.drives.len() as f64, "1 to 8");
        }
        let mut seen = vec![rest];
        for drive in &self.drives {
            for gesture in [drive.positive(), drive.negative()] {
                if seen.contains(&gesture) {
                    let (drive, rests) = (drive.to_string(), gesture == rest);
                    return Err(EmgError::DuplicateDriveGesture { gesture, drive, rests });
                }
                seen.push(gesture);
            }
        }
        Ok(())
    }

    /// Share of the way that smoothed drives take with each window, 0 to 1.
    pub(crate) fn smoothing_factor(&self, increment_millis: f64) -> f64 {
        if self.smoothing_time_constant_ms > 0.0 {
            1.0 - (-increment_millis / self.smoothing_time_constant_ms).exp()
        } else {
            1.0
        }
    }
}
