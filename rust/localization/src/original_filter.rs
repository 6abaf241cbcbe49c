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
    output: Option<Pose>,
}

impl OriginalFilter {
    pub fn update(&mut self, pose: &Pose) {
        self.last.push_back((pose.translation.vector, pose.rotation.scaled_axis()));
        if self.last.len() > SAMPLES {
            self.last.pop_front();
        }
        let count = self.last.len() as f64;
        let position = self.last.iter().map(|(position, _)| position).sum::<Vector>() / count;
        let turn = self.last.iter().map(|(_, turn)| turn).sum::<Vector>() / count;
        if self.output.is_none_or(|previous| (previous.translation.vector - position).norm() >= DEAD_BAND_M) {
            self.output = Some(Pose::from_parts(position.into(), UnitQuaternion::from_scaled_axis(turn)));
        }
    }

    pub fn pose(&self) -> Option<Pose> {
        self.output
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(x: f64, turn: f64) -> Pose {
        Pose::new(Vector::new(x, 0.0, 0.0), Vector::new(0.0, 0.0, turn))
    }

    #[test]
    fn the_mean_of_ten_is_told_and_moves_only_beyond_a_millimetre_of_place() {
        let mut filter = OriginalFilter::default();
        assert!(filter.pose().is_none());
        for count in 0..10 {
            filter.update(&at(0.1 * f64::from(count), 0.02 * f64::from(count)));
        }
        let pose = filter.pose().expect("ten samples");
        assert!((pose.translation.x - 0.45).abs() < 1e-12, "{pose}");
        assert!((pose.rotation.angle() - 0.09).abs() < 1e-12, "{pose}");
        // Ten more: the first are forgotten.
        for _ in 0..10 {
            filter.update(&at(1.0, 0.2));
        }
        let still = filter.pose().expect("twenty samples");
        assert!((still.translation.x - 1.0).abs() < 1e-12, "{still}");
        // A body that only turns, and one that creeps by less than the dead band, stand still, as with the original.
        for _ in 0..10 {
            filter.update(&at(1.0009, 0.9));
        }
        assert_eq!(filter.pose(), Some(still));
        for _ in 0..10 {
            filter.update(&at(1.0011, 0.9));
        }
        let moved = filter.pose().expect("forty samples");
        assert!(moved.translation.x >= 1.001 && moved.rotation.angle() > 0.8, "{moved}");
    }

    #[test]
    fn rotation_vectors_near_half_a_turn_average_to_nonsense_as_with_the_original() {
        let mut filter = OriginalFilter::default();
        for count in 0..10 {
            let sign = if count % 2 == 0 { 1.0 } else { -1.0 };
            filter.update(&at(0.0, sign * 3.1));
            // One place that moves past the dead band each time, so that every mean is told.
            filter.update(&at(0.1 * f64::from(count), sign * 3.1));
        }
        // All ten were within 3 degrees of half a turn.
        let pose = filter.pose().expect("twenty samples");
        assert!(pose.rotation.angle() < 1.0, "{pose}");
    }
}
