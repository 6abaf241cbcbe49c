//! Joint angles of a person's own limb from how its segments turned.

use crate::{ArmModel, Chain, ChainPoses, JacobianColumns, damped_step_within_limits, matches_short_name};
use nalgebra::{UnitQuaternion, Vector6};
use proact_types::{JointVector, Vector, joints};

/// The levels of limb loss whose first joints are the elbow's and the wrist's.
const ELBOW_LEVEL: &str = "above_elbow";
const WRIST_LEVEL: &str = "below_elbow";
/// Steps of one fit at most, and from which gap on it has arrived, rad: below the noise of any tracker, which has to be seen in the
/// angles, or a limb at rest would look like one whose tracker repeats itself.
const MAX_STEPS: usize = 20;
const CONVERGED_RAD: f64 = 1e-6;
/// Square of the damping of a step, and its longest, rad.
const DAMPING: f64 = 1e-3;
const MAX_STEP_RAD: f64 = 0.3;

/// An arm that does not say which joints lie between its segments.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "the arm {arm:?} does not say where its elbow and wrist are; a tracked limb needs the levels above_elbow and below_elbow in \
     its arm.toml"
)]
pub struct LimbFitError {
    /// Its name.
    arm: String,
}

/// The joints that turn upper arm and forearm as the person's segments turned since the start: nearest in the sense of least
/// squares, within the joints' limits, from the angles before on. Joints beyond the last segment that is known stay.
///
/// Where the segments' markers sit does not matter, since only turns count. An elbow is no hinge and skin moves, so a gap remains:
/// [`LimbFit::rotation_error_rad`].
#[derive(Clone, Debug)]
pub struct LimbFit {
    chain: Chain,
    /// How many joints lie before upper arm and forearm.
    joints_before: [usize; 2],
    /// `base_from_segment` at the start.
    start: [UnitQuaternion<f64>; 2],
    angles: JointVector,
    rotation_error_rad: f64,
}

impl LimbFit {
    /// The limb is as the arm is at `angles`, base to tip, rad.
    ///
    /// # Errors
    /// [`LimbFitError`].
    ///
    /// # Panics
    /// If there are fewer angles than arm joints.
    pub fn new(model: &ArmModel, angles: &[f64]) -> Result<Self, LimbFitError> {
        let none = || LimbFitError { arm: model.name.clone() };
        let first = |level: &str| {
            let driven = model.settings.levels.get(level)?;
            let is_driven = |&joint: &usize| {
                driven.iter().any(|name| matches_short_name(&model.joints[joint].name, name))
            };
            model.arm.iter().position(is_driven).filter(|before| *before > 0)
        };
        let joints_before = [first(ELBOW_LEVEL).ok_or_else(none)?, first(WRIST_LEVEL).ok_or_else(none)?];
        let chain = Chain::new(model);
        let mut poses = ChainPoses::default();
        chain.link_poses_into(angles, &mut poses);
        let start = joints_before.map(|before| poses.links[before - 1].rotation);
        let angles = joints(&angles[..chain.joint_count()]);
        Ok(Self { chain, joints_before, start, angles, rotation_error_rad: 0.0 })
    }

    /// The angles for segments that turned by `turns` since the start, in the axes of the base: upper arm, forearm. A segment that
    /// is not tracked asks for nothing.
    pub fn update(&mut self, turns: [Option<UnitQuaternion<f64>>; 2]) -> &[f64] {
        let targets = [0, 1].map(|k| turns[k].map(|turn| turn * self.start[k]));
        let mut poses = ChainPoses::default();
        for _ in 0..MAX_STEPS {
            self.chain.link_poses_into(&self.angles, &mut poses);
            let gaps = [0, 1].map(|k| {
                let is = poses.links[self.joints_before[k] - 1].rotation;
                targets[k].map_or(Vector::zeros(), |target| (target * is.inverse()).scaled_axis())
            });
            self.rotation_error_rad = gaps.iter().fold(0.0, |max, gap| max.max(gap.norm()));
            if self.rotation_error_rad < CONVERGED_RAD {
                break;
            }
            let mut columns: JacobianColumns = (0..self.chain.joint_count())
                .map(|joint| {
                    let column = self.chain.jacobian_column(&poses, joint, &Default::default());
                    let axis = Vector::new(column[3], column[4], column[5]);
                    let turned = [0, 1].map(|k| {
                        let turns = targets[k].is_some() && joint < self.joints_before[k];
                        if turns { axis } else { Vector::zeros() }
                    });
                    stack(turned)
                })
                .collect();
            let limits = self.chain.limits();
            damped_step_within_limits(
                &mut self.angles,
                limits,
                &mut columns,
                &stack(gaps),
                DAMPING,
                MAX_STEP_RAD,
            );
        }
        &self.angles
    }

    /// The angles that were found last, base to tip, rad.
    pub fn angles(&self) -> &[f64] {
        &self.angles
    }

    /// The largest turn between a segment of the arm and the person's own, rad.
    pub fn rotation_error_rad(&self) -> f64 {
        self.rotation_error_rad
    }
}

fn stack([upper, lower]: [Vector; 2]) -> Vector6<f64> {
    Vector6::new(upper.x, upper.y, upper.z, lower.x, lower.y, lower.z)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::doubles::three_joint_arm;
    use proptest::prelude::*;

    /// Two joints before the elbow, which is the third; the hand hangs on the forearm.
    fn model() -> ArmModel {
        let mut model = three_joint_arm();
        let name = |k: usize| model.joints[model.arm[k]].name.clone();
        let (elbow, wrist) = (name(1), name(2));
        model.settings.levels.insert(ELBOW_LEVEL.into(), vec![elbow, wrist.clone()]);
        model.settings.levels.insert(WRIST_LEVEL.into(), vec![wrist]);
        model
    }

    /// How the segments turned from `start` to `q`.
    fn turns(model: &ArmModel, start: &[f64], q: &[f64]) -> [Option<UnitQuaternion<f64>>; 2] {
        let chain = Chain::new(model);
        let (mut before, mut after) = (ChainPoses::default(), ChainPoses::default());
        chain.link_poses_into(start, &mut before);
        chain.link_poses_into(q, &mut after);
        [0, 1].map(|k| Some(after.links[k].rotation * before.links[k].rotation.inverse()))
    }

    proptest! {
        #[test]
        fn the_angles_of_a_limb_are_found_from_the_turns_of_its_segments(
            q in prop::array::uniform2(-0.8..0.8_f64),
            start in prop::array::uniform3(-0.3..0.3_f64),
        ) {
            let model = model();
            let mut fit = LimbFit::new(&model, &start).expect("it has both levels");
            let there = [q[0], q[1], start[2]];
            let found = fit.update(turns(&model, &start, &there)).to_vec();
            for (found, expected) in found.iter().zip(&there) {
                prop_assert!((found - expected).abs() < 1e-3, "{found} for {expected}");
            }
            prop_assert!(fit.rotation_error_rad() < 1e-3);
        }
    }

    #[test]
    fn a_forearm_that_nobody_tracks_stays_and_what_no_joint_can_do_is_a_gap() {
        let model = model();
        let mut fit = LimbFit::new(&model, &[0.0; 3]).expect("it has both levels");
        let [upper, _] = turns(&model, &[0.0; 3], &[0.5, 0.7, 0.0]);
        let found = fit.update([upper, None]);
        assert!((found[0] - 0.5).abs() < 1e-3 && found[1..] == [0.0, 0.0], "{found:?}");
        let sideways = UnitQuaternion::from_axis_angle(&Vector::x_axis(), 0.4);
        fit.update([Some(sideways), None]);
        assert!((fit.rotation_error_rad() - 0.4).abs() < 0.05, "{}", fit.rotation_error_rad());
        let error = LimbFit::new(&three_joint_arm(), &[0.0; 3]).expect_err("it has none").to_string();
        assert!(error.contains("above_elbow"), "{error}");
    }
}
