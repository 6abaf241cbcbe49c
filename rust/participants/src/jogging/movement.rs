//! Which movement comes next: the axis or the joint that is off.

use super::{
    AXES, FIRST_AXIS, Stage,
    attitude::Attitude,
    pulse::Pulse,
    situation::{Aim, Situation},
};
use crate::reach::{Conditions, Stance, Turn, made};
use proact_types::{Pose, Vector};

/// After so many movements the place is good enough, or not to be had.
const MOST_MOVEMENTS: u32 = 28;
/// Joint by joint, after so many that brought too little another way is looked for.
const MOST_IN_VAIN: u32 = 3;
/// How fast WE and WF move a joint, rad/s, and the hand, m/s and rad/s: what practice has taught.
const JOINT_SPEED: f64 = 0.4;
const LINEAR_SPEED: f64 = 0.08;
const ANGULAR_SPEED: f64 = 0.4;
/// What is left below this along an axis is not worth another movement, metres, rad.
const LINEAR_DONE: f64 = 0.006;
pub(super) const ANGULAR_DONE: f64 = 0.15;
/// On its way down the hand is taken no further than this beside the line upon which its place lies, metres. Assumed: half the
/// width of an open hand.
const MOST_ASIDE: f64 = 0.05;
/// A joint this near to where it should be is left alone, rad.
pub(super) const TURN_DONE: f64 = 0.035;
/// A last turn that brings the arm further into something than this is thought of again, metres.
const GRAZE: f64 = 0.006;

/// What one mode is off by, and what brings it nearer.
#[derive(Clone, Copy, Debug)]
pub(super) struct Lack {
    pub(super) mode: u8,
    /// How far off, in the unit of its speed, with its sign.
    pub(super) amount: f64,
    /// Per second.
    pub(super) speed: f64,
}

impl Lack {
    /// The mode, and whether it goes to its positive side.
    pub(super) fn kind(&self) -> (u8, bool) {
        (self.mode, self.amount > 0.0)
    }

    /// The same no further than until the hand, which has `off` to go, is [`MOST_ASIDE`] beside the line along `up` through
    /// its place, or as far as it is now; none if that leaves nothing worth a movement.
    fn above_its_place(self, off: &Vector, up: &Vector) -> Option<Self> {
        let beside = |v: Vector| v - up * v.dot(up);
        let mut shift = Vector::zeros();
        shift[usize::from(self.mode - FIRST_AXIS)] = self.amount;
        let (now, shift) = (beside(*off), beside(shift));
        // The larger root of |now - share shift| = most.
        let most = MOST_ASIDE.max(now.norm());
        let (a, b, c) = (shift.norm_squared(), now.dot(&shift), now.norm_squared() - most * most);
        let share = if a < 1e-12 { 1.0 } else { (b + (b * b - a * c).max(0.0).sqrt()) / a };
        let amount = self.amount * share.clamp(0.0, 1.0);
        (amount.abs() >= LINEAR_DONE).then_some(Self { amount, ..self })
    }
}

/// The movements of one stage: what was tried, and what is thought of next.
#[derive(Default)]
pub(super) struct Movements {
    /// Modes and sides, true for the positive one, that were refused since the last one that was not.
    refused: Vec<(u8, bool)>,
    /// What method A has yet to turn, in this order.
    turns: Vec<Turn>,
    /// Movements since the stage began.
    made: u32,
    /// ... and those of them that brought too little.
    in_vain: u32,
}

impl Movements {
    /// Another stage begins.
    pub(super) fn begin(&mut self) {
        *self = Self::default();
    }

    /// The same, after `refused` was tried in vain in the stage before.
    pub(super) fn begin_after(&mut self, refused: Vec<(u8, bool)>) {
        *self = Self { refused, ..Self::default() };
    }

    /// What method A has yet to turn, in this order.
    pub(super) fn turns(&self) -> &[Turn] {
        &self.turns
    }

    /// What was refused, once several joints were turned in vain.
    pub(super) fn tried_in_vain(&self, aim: &Aim) -> Option<Vec<(u8, bool)>> {
        self.are_in_vain(aim).then(|| self.refused.clone())
    }

    /// Remembers a movement that brought too little; forgets the others when one went well.
    pub(super) fn judge(&mut self, pulse: &Pulse, situation: &Situation) {
        if pulse.fell_short(situation) {
            self.met_something(pulse.kind());
        } else {
            self.refused.clear();
        }
    }

    /// A movement in this mode, to its positive side or not, met something: another way is thought of.
    pub(super) fn met_something(&mut self, kind: (u8, bool)) {
        self.refused.push(kind);
        self.in_vain += 1;
        self.turns.clear();
    }

    /// What to move next: none if the hand is where it should be, an error if nothing is left that would help.
    pub(super) fn next(
        &mut self,
        situation: &Situation,
        aim: &Aim,
        attitude: &mut Attitude,
    ) -> Result<Option<Lack>, ()> {
        let base_from_tip = situation.base_from_tip();
        let goal = &aim.goal;
        let good_enough = self.made > MOST_MOVEMENTS;
        match () {
            () if self.are_in_vain(aim) => Err(()),
            () if good_enough && goal.off(&base_from_tip).0 < 2.0 * goal.point_done => Ok(None),
            () if good_enough => Err(()),
            () if !aim.by_axis() && goal.reached(&base_from_tip) => Ok(None),
            () if aim.by_axis() => self.axis_lack(&base_from_tip, aim, attitude),
            () => self.joint_lack(situation, aim).map(Some).ok_or(()),
        }
    }

    /// The movement that was thought of begins.
    pub(super) fn start(&mut self, aim: &Aim) {
        self.made += 1;
        if !aim.by_axis() {
            self.turns.remove(0);
        }
    }

    /// Forgets the turns that are made; thinks of new ones when none is left.
    pub(super) fn think_of_turns(&mut self, situation: &Situation, aim: &Aim, q: &[f64]) {
        // What is left of a turn is left: the next round sees to it together with the rest.
        while self.turns.first().is_some_and(|turn| (turn.to - q[turn.joint]).abs() < TURN_DONE) {
            self.turns.remove(0);
        }
        if self.turns.len() > 1 || (!self.turns.is_empty() && self.made == 0) {
            return;
        }
        let Situation { sense, seen, .. } = situation;
        let obstacles = situation.obstacles();
        let in_the_way = |stance: &Stance| obstacles.depth(&seen.world_from_base, stance);
        // Before the last turn: does it still lead there, and clear of everything?
        if let Some(last) = self.turns.first() {
            let end = sense.forward(&made(q, &self.turns));
            let misses = aim.goal.off(&end).0 > 2.0 * aim.goal.point_done;
            if !misses && sense.bump(q, last, &in_the_way) < GRAZE {
                return;
            }
        }
        let refused = |turn: &Turn| self.refused.contains(&(turn.joint as u8, turn.angle > 0.0));
        let conditions = Conditions {
            mode: aim.mode.into(),
            secs_per_rad: 1.0 / JOINT_SPEED,
            in_the_way: &in_the_way,
            lifting: !matches!(aim.stage, Stage::Lift | Stage::Retreat),
            refused: &refused,
        };
        self.turns = sense.turns(q, &aim.goal, &conditions);
    }

    /// True joint by joint after several movements that brought too little.
    pub(super) fn are_in_vain(&self, aim: &Aim) -> bool {
        !aim.by_axis() && self.in_vain >= MOST_IN_VAIN
    }

    /// The axis to move along or turn about next, of those that are off and were not refused: none if the hand is where it
    /// should be, an error if those that are off were refused.
    ///
    /// Axes lean with the trunk, so that a straight way down is one along two or three of them. Whoever watches the hand
    /// goes up along the axis that leads most nearly up. On the way down the hand goes aside first, staying above its place, and
    /// then down upon it, not along the table to it. Else the nearest axis in the cycle is next.
    fn axis_lack(
        &self,
        base_from_tip: &Pose,
        aim: &Aim,
        attitude: &mut Attitude,
    ) -> Result<Option<Lack>, ()> {
        let goal = &aim.goal;
        let off = goal.target - base_from_tip * goal.point;
        let tilt = (base_from_tip.rotation * goal.axis).cross(&goal.up);
        let turn = attitude.turn_left(aim, base_from_tip, &off, &tilt);
        let (mut turns, mut shifts) = (Vec::new(), Vec::new());
        for k in 0..3 {
            let mode = FIRST_AXIS + k as u8;
            if off[k].abs() > LINEAR_DONE.max(goal.point_done / 2.0) {
                shifts.push(Lack { mode, amount: off[k], speed: LINEAR_SPEED });
            }
            if turn[k].abs() > ANGULAR_DONE {
                turns.push(Lack { mode: mode + 3, amount: turn[k], speed: ANGULAR_SPEED });
            }
        }
        let there = shifts.is_empty() || goal.reached(base_from_tip);
        if turns.is_empty() && there {
            return Ok(None);
        }
        let (up, down) = (aim.goes_up(), aim.goes_down());
        if down {
            let above: Vec<Lack> =
                shifts.iter().filter_map(|shift| shift.above_its_place(&off, &goal.up)).collect();
            shifts = if above.is_empty() { shifts } else { above };
        }
        let free = |lack: &&Lack| !self.refused.contains(&lack.kind());
        let ahead = |lack: &&Lack| (lack.mode + AXES - aim.mode) % AXES;
        // Turning the hand at its wrist carries the grasp centre along: tilt first, then place.
        let next = turns.iter().filter(free).min_by_key(ahead);
        let shorter = |a: &&Lack, b: &&Lack| a.amount.abs().total_cmp(&b.amount.abs());
        let next = next.or_else(|| match () {
            () if up => shifts.iter().filter(free).max_by(shorter),
            () if down => shifts.iter().filter(free).min_by(shorter),
            () => shifts.iter().filter(free).min_by_key(ahead),
        });
        let next = next.copied();
        let turned_enough = shifts.is_empty() && tilt.norm() < goal.tilt_done;
        if next.is_none() && !turned_enough { Err(()) } else { Ok(next) }
    }

    /// The joint to turn next; none if none helps.
    fn joint_lack(&mut self, situation: &Situation, aim: &Aim) -> Option<Lack> {
        let q = situation.arm_angles()?;
        self.think_of_turns(situation, aim, q);
        let turn = self.turns.first()?;
        Some(Lack { mode: turn.joint as u8, amount: turn.to - q[turn.joint], speed: JOINT_SPEED })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reach::HandGoal;
    use proact_types::Point;

    const Z: u8 = FIRST_AXIS + 2;

    /// The hand is at the origin of leaning axes, and should be at `off`, the way that it stands.
    fn aim(stage: Stage, mode: u8, off: Vector) -> Aim {
        let goal = HandGoal {
            point: Point::origin(),
            axis: off.normalize() * off.z.signum(),
            target: Point::from(off),
            up: if off.z < 0.0 { -off.normalize() } else { off.normalize() },
            high_counts: 1.0,
            point_done: 0.012,
            tilt_done: 0.3,
            attitude: None,
        };
        Aim { stage, goal, mode }
    }

    fn next(stage: Stage, mode: u8, off: Vector, hand: &Vector) -> Option<Lack> {
        let base_from_tip = Pose::translation(hand.x, hand.y, hand.z);
        Movements::default().axis_lack(&base_from_tip, &aim(stage, mode, off), &mut Attitude::new()).unwrap()
    }

    /// Caught hands that were pulled back, out of reach, to come up: with leaning axes back is a little up, too.
    #[test]
    fn the_way_up_begins_along_the_axis_that_leads_most_nearly_up() {
        let up = Vector::new(-0.098, -0.064, 0.204);
        for mode in FIRST_AXIS..FIRST_AXIS + AXES {
            let lack = next(Stage::Lift, mode, up, &Vector::zeros()).unwrap();
            assert_eq!((lack.mode, lack.amount > 0.0), (Z, true), "from mode {mode}");
        }
    }

    /// Caught hands that were lowered beside a block and then pushed it.
    #[test]
    fn the_hand_comes_down_upon_its_place_and_never_far_beside_it() {
        let off = Vector::new(0.088, 0.067, -0.188);
        let up = -off.normalize();
        let (mut hand, mut mode, mut count) = (Vector::zeros(), Z, 0);
        while let Some(lack) = next(Stage::Lower, mode, off, &hand) {
            hand[usize::from(lack.mode - FIRST_AXIS)] += lack.amount;
            let left = off - hand;
            let aside = (left - up * left.dot(&up)).norm();
            assert!(aside < MOST_ASIDE + 1e-9, "{aside} beside its place");
            (mode, count) = (lack.mode, count + 1);
            assert!(count < 20, "it does not end");
        }
        assert_eq!(mode, Z, "the last movement goes down");
        assert!((off - hand).norm() <= 0.012 && count < 8, "{count} movements");
    }
}
