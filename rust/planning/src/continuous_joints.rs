//! Continuous joints: a planner takes angles a whole turn apart for the same.

use proact_arm::{ArmModel, JointKind};
use proact_types::{PlanGoal, PlanReply, PlanRequest};
use std::{
    f64::consts::{PI, TAU},
    sync::Arc,
};

/// Which arm joints turn for ever. The planner works within a turn either way of zero; a request is brought there and the
/// reply is put back, so that the arm goes the shorter way round and keeps counting its turns.
#[derive(Clone, Debug)]
pub(crate) struct TurnNormalizer(Vec<bool>);

impl TurnNormalizer {
    /// Those of `model`, and the model with the limits that the planner works within.
    pub(crate) fn for_model(model: Arc<ArmModel>) -> (Self, Arc<ArmModel>) {
        let is_continuous = |&joint: &usize| model.joints[joint].kind == JointKind::Continuous;
        let own = Self(model.arm.iter().map(is_continuous).collect());
        if !own.0.contains(&true) {
            return (own, model);
        }
        let mut within = (*model).clone();
        for joint in within.joints.iter_mut().filter(|joint| joint.kind == JointKind::Continuous) {
            (joint.limits.lower, joint.limits.upper) = (-TAU, TAU);
        }
        (own, Arc::new(within))
    }

    /// The request near zero, and the whole turns that were taken off each joint, rad; none if it stays as it is.
    pub(crate) fn wrap(&self, request: &PlanRequest) -> Option<(PlanRequest, Vec<f64>)> {
        if !self.0.contains(&true) || request.start.len() != self.0.len() {
            return None;
        }
        let turns =
            |(angle, is_continuous): (&f64, &bool)| if *is_continuous { whole_turns(*angle) } else { 0.0 };
        let taken: Vec<f64> = request.start.iter().zip(&self.0).map(turns).collect();
        let mut near = request.clone();
        near.start.iter_mut().zip(&taken).for_each(|(angle, turns)| *angle -= turns);
        if let PlanGoal::Joints { q } = &mut near.goal {
            for ((goal, start), is_continuous) in q.iter_mut().zip(&near.start).zip(&self.0) {
                if *is_continuous {
                    *goal -= whole_turns(*goal - start);
                }
            }
        }
        Some((near, taken))
    }

    /// Puts the turns back into a reply.
    pub(crate) fn unwrap(reply: &mut PlanReply, taken: &[f64]) {
        for point in &mut reply.trajectory.points {
            point.q.iter_mut().zip(taken).for_each(|(angle, turns)| *angle += turns);
        }
    }
}

/// The whole turns in an angle, rad: what is left is within half a turn.
fn whole_turns(angle: f64) -> f64 {
    TAU * ((angle + PI) / TAU).floor()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_left_of_an_angle_is_within_half_a_turn() {
        for (angle, left) in
            [(0.0, 0.0), (3.0, 3.0), (-3.0, -3.0), (7.0, 7.0 - TAU), (-20.0, -20.0 + 3.0 * TAU)]
        {
            assert!((angle - whole_turns(angle) - left).abs() < 1e-12, "{angle}");
        }
    }
}
