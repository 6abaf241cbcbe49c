//! The person's own limb: joints that the prosthesis does not have are moved as people move them, all at once.

use super::{
    decision_context::{DecisionContext, ReachGoal},
    movement::{JOINT_TOLERANCE_RAD, Movements},
};
use proact_types::{JointVector, SimTime, joints};

/// A limb that has not got to where it was meant to be by now is in the way of something, ms.
const LIMB_MILLIS: u64 = 4000;
/// As often the limb is placed anew at one stage where the method moves the hand along axes.
const MOST_PLACINGS: u32 = 4;

/// The person's own joints.
#[derive(Clone, Debug, Default)]
pub(super) struct ResidualLimb {
    /// Their positions among the arm joints.
    own_joints: Vec<usize>,
    /// Where the limb goes, in the joints of the arm, rad.
    target_joints: Option<JointVector>,
    until: SimTime,
    move_count: u32,
}

impl ResidualLimb {
    pub(super) fn new(own: Vec<usize>) -> Self {
        Self { own_joints: own, ..Self::default() }
    }

    /// Whether it has this joint of the arm.
    pub(super) fn has_joint(&self, joint: usize) -> bool {
        self.own_joints.contains(&joint)
    }

    /// Where the limb goes; none where it has no joints of the arm.
    pub(super) fn target_joints(&self) -> Option<JointVector> {
        self.target_joints.clone()
    }

    /// Another stage begins.
    pub(super) fn begin(&mut self) {
        self.move_count = 0;
    }

    /// Moves the limb toward the aim, joint by joint as `movements` has its turns in mind; true while it is on its way,
    /// and the method has to wait.
    pub(super) fn reach(
        &mut self,
        now: SimTime,
        context: &DecisionContext,
        reach_goal: &ReachGoal,
        movements: &mut Movements,
    ) -> bool {
        let Some(q) = context.arm_angles().filter(|_| !self.own_joints.is_empty()) else { return false };
        if self.is_moving(now, q) {
            return true;
        }
        if reach_goal.jogs_axes() {
            self.move_count += 1;
            let reached = reach_goal.hand_goal.is_reached(&context.sense.forward(q));
            let own = self.own_joints.iter().fold(0, |set, joint| set | 1 << joint);
            return !reached
                && self.move_count <= MOST_PLACINGS
                && self.start_move(now, q, &context.sense.inverse(q, &reach_goal.hand_goal, own));
        }
        if let Some(met) = self.give_up(q) {
            movements.record_contact(met);
        }
        if movements.is_failing(reach_goal) {
            return false;
        }
        movements.plan_turns(context, reach_goal, q);
        match movements.planned_turns().first() {
            Some(turn) if self.has_joint(turn.joint) => {
                let mut wanted = joints(q);
                wanted[turn.joint] = turn.target_rad;
                self.start_move(now, q, &wanted)
            }
            _ => false,
        }
    }

    fn is_moving(&self, now: SimTime, q: &[f64]) -> bool {
        now < self.until && self.target_joints.as_ref().is_some_and(|to| self.furthest_joint(to, q).is_some())
    }

    /// The own joint that is furthest from where it goes, and to which side; none if all are there.
    fn furthest_joint(&self, to: &JointVector, q: &[f64]) -> Option<(u8, bool)> {
        let left = |joint: usize| to[joint] - q[joint];
        let far = self.own_joints.iter().copied().filter(|&joint| left(joint).abs() > JOINT_TOLERANCE_RAD);
        let farthest = far.max_by(|&a, &b| left(a).abs().total_cmp(&left(b).abs()))?;
        Some((farthest as u8, left(farthest) > 0.0))
    }

    /// A limb whose time is over stays where it is: the joint that did not get there, and to which side it should have.
    fn give_up(&mut self, q: &[f64]) -> Option<(u8, bool)> {
        let met = self.furthest_joint(self.target_joints.as_ref()?, q)?;
        self.target_joints = Some(joints(q));
        Some(met)
    }

    /// Moves the own joints to their angles in `wanted`; false if they are there.
    fn start_move(&mut self, now: SimTime, q: &[f64], wanted: &[f64]) -> bool {
        let mut to = self.target_joints.clone().unwrap_or_else(|| joints(q));
        self.own_joints.iter().for_each(|&joint| to[joint] = wanted[joint]);
        self.target_joints = Some(to);
        self.until = now.plus_millis(LIMB_MILLIS);
        self.is_moving(now, q)
    }
}
