use crate::DeviceError;
use proact_types::{GazeSample, Point, Vector};
use serde::Deserialize;
use std::time::Instant;

/// An eye further than this from the origin of its frame is a mistake, metres.
const MAX_ORIGIN_DISTANCE_M: f64 = 100.0;

/// In which frame an eye tracker measures.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum GazeFrame {
    /// The frame `world`.
    #[default]
    World,
    /// The head: x ahead, y left, z up, origin at the eye. What a tracker worn on the head gives.
    Head,
}

/// A sample as an eye tracker sent it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RawGazeSample {
    /// The sample, in `frame`; its direction is a unit vector.
    pub sample: GazeSample,
    /// The frame.
    pub frame: GazeFrame,
}

impl RawGazeSample {
    /// A sample from an eye at `origin`, metres, along `direction` of any length above zero.
    ///
    /// # Errors
    /// [`DeviceError::GazeMessage`] for an eye further off than 100 m, and for a valid sample without a direction.
    pub fn new(
        origin: [f64; 3],
        direction: [f64; 3],
        valid: bool,
        frame: GazeFrame,
    ) -> Result<RawGazeSample, DeviceError> {
        let wrong = |reason: String| DeviceError::GazeMessage { reason };
        if !origin.iter().all(|x| x.abs() <= MAX_ORIGIN_DISTANCE_M) {
            return Err(wrong(format!(
                "origin {origin:?}, expected coordinates up to {MAX_ORIGIN_DISTANCE_M} m"
            )));
        }
        let vector = Vector::from(direction);
        let unit = vector.try_normalize(1e-6).filter(|_| vector.norm().is_finite());
        let direction = match unit {
            Some(unit) => unit,
            // A tracker that has lost the eye need not know where it looks.
            None if !valid => Vector::x(),
            None => {
                return Err(wrong(format!("direction {direction:?}, expected a finite vector above zero")));
            }
        };
        Ok(RawGazeSample { sample: GazeSample { origin: Point::from(origin), direction, valid }, frame })
    }
}

/// Where an eye tracker's samples come in.
pub trait GazeDevice: Send {
    /// The newest sample since the last call; none if none came. Never waits.
    ///
    /// # Errors
    /// The connection cannot be used any more.
    fn latest(&mut self) -> Result<Option<RawGazeSample>, DeviceError>;

    /// What there is to report at `now` of messages that were no samples, once a second at most.
    fn report_refused(&mut self, _now: Instant) -> Option<String> {
        None
    }
}
