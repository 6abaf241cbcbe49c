//! The original's `topic_utils/src/pose_filter.py`.

use nalgebra::UnitQuaternion;
use proact_types::{Pose, Vector};
use std::collections::VecDeque;

/// Its window.
const SAMPLES: usize = 10;
/// A mean place that moved less than this, m, repeats the whole pose before, attitude included.
const DEAD_BAND_M: f64 = 0.001;

/// Mean of the last ten places and of the last ten rotation vectors, with a dead band. About 45 ms late at 100 Hz; attitudes
/// near half a turn average to nonsense, and a body that only turns stands still: as it was.
#[derive(Clone, Debug, Default)]
pub(crate) struct OriginalFilter {
    last: VecDeque<(Vector, Vector)>,
    told: Option<Pose>,
}

impl OriginalFilter {
    pub fn take(&mut self, pose: &Pose) {
        self.last.push_back((pose.translation.vector, pose.rotation.scaled_axis()));
        if self.last.len() > SAMPLES {
            self.last.pop_front();
        }
        let count = self.last.len() as f64;
        let place = self.last.iter().map(|(place, _)| place).sum::<Vector>() / count;
        let turn = self.last.iter().map(|(_, turn)| turn).sum::<Vector>() / count;
        if self.told.is_none_or(|told| (told.translation.vector - place).norm() >= DEAD_BAND_M) {
            self.told = Some(Pose::from_parts(place.into(), UnitQuaternion::from_scaled_axis(turn)));
        }
    }

    pub fn pose(&self) -> Option<Pose> {
        self.told
    }
}
