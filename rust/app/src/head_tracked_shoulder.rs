//! A shoulder without cameras: carried by the neck of a head that a headset tracks.

use proact_testbed::RunningTrial;
use proact_types::{Pose, Vector};

/// From the middle of the eyes to where the neck bends, in the head's axes (x ahead, y left, z up), m: the head turns about it
/// while the trunk keeps still (assumed; people differ by some centimetres).
const NECK_IN_HEAD: Vector = Vector::new(-0.1, 0.0, -0.15);

/// The shoulder as an offset from the neck.
///
/// At the first pose of a trial it is where the set-up has it; from there on it moves as the neck does, and keeps its attitude: a
/// head does not tell how the trunk turns. Good for leans, wrong by up to a few centimetres when the trunk twists.
#[derive(Debug, Default)]
pub struct HeadTrackedShoulder {
    /// From the neck to the shoulder, `world`, once the head was seen.
    offset: Option<Vector>,
    last: Option<Pose>,
}

impl HeadTrackedShoulder {
    /// Another trial begins.
    pub fn restart(&mut self) {
        *self = Self::default();
    }

    /// Hands the shoulder to a person's trial. False if the headset told nothing new: that is a silence, which stops the arm.
    pub fn apply_to(&mut self, trial: &mut RunningTrial) -> bool {
        let Some(head) = trial.headset_pose().filter(|head| self.last != Some(*head)) else { return false };
        self.last = Some(head);
        let rest = trial.testbed().config().setup.body.shoulder_pose(&Default::default());
        let position = self.shoulder_position(&head, &rest.translation.vector);
        trial.person_stage_mut().track_shoulder(Pose::from_parts(position.into(), rest.rotation));
        true
    }

    /// Where the shoulder is with this head, if it was at `rest` with the first.
    fn shoulder_position(&mut self, world_from_head: &Pose, rest: &Vector) -> Vector {
        let neck = (world_from_head * nalgebra::Point3::from(NECK_IN_HEAD)).coords;
        neck + *self.offset.get_or_insert(rest - neck)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::UnitQuaternion;
    use proact_testbed::{Setup, TrialConfig};
    use proact_types::{EventKind, InputSource, StopCause};

    fn head(neck: Vector, yaw: f64, nod: f64) -> Pose {
        let turn = UnitQuaternion::from_euler_angles(0.0, nod, yaw);
        Pose::from_parts((neck - turn * NECK_IN_HEAD).into(), turn)
    }

    #[test]
    fn a_lean_carries_the_shoulder_and_a_turn_of_the_head_does_not() {
        let (neck, rest) = (Vector::new(-0.7, 0.0, 1.5), Vector::new(-0.6, -0.18, 1.445));
        let mut shoulder = HeadTrackedShoulder::default();
        assert!((shoulder.shoulder_position(&head(neck, 0.0, 0.0), &rest) - rest).norm() < 1e-12);
        for (yaw, nod) in [(0.8, 0.0), (-0.5, 0.4), (0.0, -0.6)] {
            assert!((shoulder.shoulder_position(&head(neck, yaw, nod), &rest) - rest).norm() < 1e-12);
        }
        let lean = Vector::new(0.2, 0.02, -0.05);
        assert!(
            (shoulder.shoulder_position(&head(neck + lean, 0.3, 0.2), &rest) - rest - lean).norm() < 1e-12
        );
        shoulder.restart();
        assert!((shoulder.shoulder_position(&head(neck + lean, 0.3, 0.2), &rest) - rest).norm() < 1e-12);
    }

    #[test]
    fn a_headset_that_tells_nothing_new_is_silent() {
        let config = TrialConfig::new("A", 1, Setup::named("still").unwrap());
        let mut trial = crate::trial::live_trial(config).unwrap().trial;
        let mut shoulder = HeadTrackedShoulder::default();
        assert!(!shoulder.apply_to(&mut trial), "no headset");
        trial.person_stage_mut().track_head(head(Vector::new(-0.7, 0.0, 1.5), 0.0, 0.0));
        assert!(shoulder.apply_to(&mut trial) && !shoulder.apply_to(&mut trial));
        trial.person_stage_mut().track_head(head(Vector::new(-0.6, 0.0, 1.5), 0.0, 0.0));
        assert!(shoulder.apply_to(&mut trial));
    }

    #[test]
    fn a_headset_that_falls_silent_stops_the_arm() {
        let config = TrialConfig::new("A", 1, Setup::named("still").unwrap());
        let mut trial = crate::trial::live_trial(config).unwrap().trial;
        let mut shoulder = HeadTrackedShoulder::default();
        let mut stops = Vec::new();
        for tick in 1..=1000_u64 {
            if tick <= 500 && tick.is_multiple_of(16) {
                let sway = 0.001 * (tick as f64 * 0.01).sin();
                trial.person_stage_mut().track_head(head(Vector::new(-0.7 + sway, 0.0, 1.5), 0.0, 0.0));
            }
            shoulder.apply_to(&mut trial);
            let output = trial.step(false).unwrap().output;
            let stopped = output.events.iter().filter_map(|event| match &event.kind {
                EventKind::Stopped { source: InputSource::ShoulderTracker, cause, .. } => {
                    Some((tick, *cause))
                }
                _ => None,
            });
            stops.extend(stopped);
        }
        let [(tick, StopCause::Silent)] = stops[..] else { panic!("{stops:?}") };
        assert!((500..750).contains(&tick), "{tick} ms");
    }
}
