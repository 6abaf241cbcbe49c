use serde::{Deserialize, Serialize};

/// More points than any check has.
const MAX_POINTS: usize = 32;
/// Longest name of a gaze source, bytes.
const MAX_SOURCE_NAME_BYTES: usize = 64;
/// Largest correction that a page may ask for, degrees.
const MAX_CORRECTION_DEG: f64 = 20.0;

/// How well a gaze source follows known points, as the page measured it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
#[serde(deny_unknown_fields)]
pub struct GazeCheck {
    /// What looked: `mouse`, `head`, `hand`, or the name of a tracker.
    pub source: String,
    /// One entry a point, in the order shown.
    pub points: Vec<GazePoint>,
    /// What is to be taken off the gaze from now on, degrees to the left and upwards; none if it stays as it is.
    #[serde(default)]
    pub correction_deg: Option<[f64; 2]>,
}

/// What was measured while one point was looked at.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
#[serde(deny_unknown_fields)]
pub struct GazePoint {
    /// Mean angle between gaze and point, degrees; none if no sample was valid.
    pub accuracy_deg: Option<f64>,
    /// Root mean square angle from one valid sample to the next, degrees; none with fewer than two.
    pub precision_deg: Option<f64>,
    /// Mean of gaze minus point, degrees to the left and upwards; none if no sample was valid.
    #[serde(default)]
    pub offset_deg: Option<[f64; 2]>,
    /// Samples that were missing or invalid, 0 to 1.
    pub lost_share: f64,
    /// Gaps of 70 to 500 ms.
    pub blinks: u32,
    /// Samples that came.
    pub samples: u32,
}

impl GazeCheck {
    /// # Errors
    /// Which number is out of its range.
    pub(crate) fn validate(&self) -> Result<(), String> {
        let (name, count) = (self.source.len(), self.points.len());
        if !(1..=MAX_SOURCE_NAME_BYTES).contains(&name) {
            return Err(format!("gaze source has {name} bytes, expected 1 to {MAX_SOURCE_NAME_BYTES}"));
        }
        if !(1..=MAX_POINTS).contains(&count) {
            return Err(format!("gaze check has {count} points, expected 1 to {MAX_POINTS} points"));
        }
        for point in &self.points {
            for (what, angle) in [("accuracy", point.accuracy_deg), ("precision", point.precision_deg)] {
                if let Some(angle) = angle.filter(|angle| !(0.0..=180.0).contains(angle)) {
                    return Err(format!("gaze {what} is {angle}, expected 0 to 180 degrees"));
                }
            }
            if let Some(angle) =
                point.offset_deg.into_iter().flatten().find(|angle| !(-180.0..=180.0).contains(angle))
            {
                return Err(format!("gaze offset is {angle}, expected -180 to 180 degrees"));
            }
            if !(0.0..=1.0).contains(&point.lost_share) {
                return Err(format!("gaze lost share is {}, expected 0 to 1", point.lost_share));
            }
        }
        let wild = |angle: &f64| !(-MAX_CORRECTION_DEG..=MAX_CORRECTION_DEG).contains(angle);
        if let Some(angle) = self.correction_deg.into_iter().flatten().find(wild) {
            return Err(format!("gaze correction is {angle}, expected at most {MAX_CORRECTION_DEG} degrees"));
        }
        Ok(())
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    pub(crate) fn sample_check() -> GazeCheck {
        let point = GazePoint {
            accuracy_deg: Some(0.5),
            precision_deg: Some(0.1),
            offset_deg: Some([0.4, -0.3]),
            lost_share: 0.0,
            blinks: 1,
            samples: 60,
        };
        GazeCheck { source: "mouse".into(), points: vec![point], correction_deg: None }
    }

    #[test]
    fn numbers_out_of_range_are_refused_by_name() {
        assert_eq!(sample_check().validate(), Ok(()));
        let mut bad = sample_check();
        bad.points[0].accuracy_deg = Some(181.0);
        assert!(bad.validate().unwrap_err().contains("accuracy is 181"));
        let mut bad = sample_check();
        bad.points[0].offset_deg = Some([0.0, f64::NAN]);
        assert!(bad.validate().unwrap_err().contains("offset is NaN"));
        let bad = GazeCheck { correction_deg: Some([0.0, -21.0]), ..sample_check() };
        assert!(bad.validate().unwrap_err().contains("correction is -21"));
        let mut bad = sample_check();
        bad.points[0].lost_share = f64::NAN;
        assert!(bad.validate().unwrap_err().contains("lost share"));
        assert!(
            GazeCheck { source: String::new(), ..sample_check() }.validate().unwrap_err().contains("source")
        );
        assert!(GazeCheck { points: vec![], ..sample_check() }.validate().unwrap_err().contains("0 points"));
    }
}
