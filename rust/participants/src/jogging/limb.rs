//! The person's own limb: joints that the prosthesis does not have are moved as people move them, all at once.

use super::{
    movement::{Movements, TURN_DONE},
    situation::{Aim, Situation},
};
use proact_types::{JointVector, SimTime, joints};

/// A limb that has not got to where it was meant to be by now is in the way of something, ms.
const LIMB_MILLIS: u64 = 4000;
/// As often the limb is placed anew at one stage where the method moves the hand along axes.
const MOST_PLACINGS: u32 = 4;

/// The person's own joints.
#[derive(Clone, Debug, Default)]
pub(super) struct Limb {
    /// Their positions among the arm joints.
    own: Vec<usize>,
    /// Where the limb goes, in the joints of the arm, rad.
    to: Option<JointVector>,
    until: SimTime,
    placings: u32,
}

impl Limb {
    pub(super) fn new(own: Vec<usize>) -> Self {
        Self { own, ..Self::default() }
    }

    /// Whether it has this joint of the arm.
    pub(super) fn has(&self, joint: usize) -> bool {
        self.own.contains(&joint)
    }

    /// Where the limb goes; none where it has no joints of the arm.
    pub(super) fn to(&self) -> Option<JointVector> {
        self.to.clone()
    }

    /// Another stage begins.
    pub(super) fn begin(&mut self) {
        self.placings = 0;
    }

    /// Moves the limb toward the aim, joint by joint as `movements` has its turns in mind; true while it is on its way,
    /// and the method has to wait.
    pub(super) fn reach(
        &mut self,
        now: SimTime,
        situation: &Situation,
        aim: &Aim,
        movements: &mut Movements,
    ) -> bool {
        let Some(q) = situation.arm_angles().filter(|_| !self.own.is_empty()) else { return false };
        if self.under_way(now, q) {
            return true;
        }
        if aim.by_axis() {
            self.placings += 1;
            let reached = aim.goal.reached(&situation.sense.forward(q));
            let own = self.own.iter().fold(0, |set, joint| set | 1 << joint);
            return !reached
                && self.placings <= MOST_PLACINGS
                && self.go(now, q, &situation.sense.inverse(q, &aim.goal, own));
        }
        if let Some(met) = self.give_up(q) {
            movements.met_something(met);
        }
        if movements.are_in_vain(aim) {
            return false;
        }
        movements.think_of_turns(situation, aim, q);
        match movements.turns().first() {
            Some(turn) if self.has(turn.joint) => {
                let mut wanted = joints(q);
                wanted[turn.joint] = turn.to;
                self.go(now, q, &wanted)
            }
            _ => false,
        }
    }

    fn under_way(&self, now: SimTime, q: &[f64]) -> bool {
        now < self.until && self.to.as_ref().is_some_and(|to| self.furthest(to, q).is_some())
    }

    /// The own joint that is furthest from where it goes, and to which side; none if all are there.
    fn furthest(&self, to: &JointVector, q: &[f64]) -> Option<(u8, bool)> {
        let left = |joint: usize| to[joint] - q[joint];
        let far = self.own.iter().copied().filter(|&joint| left(joint).abs() > TURN_DONE);
        let most = far.max_by(|&a, &b| left(a).abs().total_cmp(&left(b).abs()))?;
        Some((most as u8, left(most) > 0.0))
    }

    /// A limb whose time is over stays where it is: the joint that did not get there, and to which side it should have.
    fn give_up(&mut self, q: &[f64]) -> Option<(u8, bool)> {
        let met = self.furthest(self.to.as_ref()?, q)?;
        self.to = Some(joints(q));
        Some(met)
    }

    /// Moves the own joints to their angles in `wanted`; false if they are there.
    fn go(&mut self, now: SimTime, q: &[f64], wanted: &[f64]) -> bool {
        let mut to = self.to.clone().unwrap_or_else(|| joints(q));
        self.own.iter().for_each(|&joint| to[joint] = wanted[joint]);
        self.to = Some(to);
        self.until = now.plus_millis(LIMB_MILLIS);
        self.under_way(now, q)
    }
}
