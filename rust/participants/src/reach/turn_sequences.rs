//! Which few joints to turn, and in which order, for the hand to be somewhere.

use super::{ArmSense, HandGoal, Stance};
use proact_types::{JointVector, Pose};

/// Joints that are moved for one way, at most.
const MOST_JOINTS: u32 = 5;
/// A joint moves at least this far: shorter gestures are not recognised, rad.
const LEAST_TURN: f64 = 0.05;
/// Points looked at on the way of one joint.
const SAMPLES: usize = 8;
/// A metre of obstacle in the way counts as this many seconds.
const SECS_PER_METRE: f64 = 1000.0;
/// Obstacle that counts for nothing: a place to go around it is not looked for, metres.
const CLEAR: f64 = 0.003;
/// A metre short of the goal counts as this many seconds.
const SECS_PER_METRE_OFF: f64 = 300.0;
/// ... a radian too much of tilt as this many, and whatever is left as this many more: another round is due.
const SECS_PER_RAD_OFF: f64 = 20.0;
const SECS_AGAIN: f64 = 5.0;
/// A gesture that goes one joint on takes this long, one joint back, and one that turns a joint this much beyond the
/// turn itself, seconds.
const SECS_PER_MODE: f64 = 0.65;
const SECS_PER_MODE_BACK: f64 = 1.0;
const SECS_PER_TURN: f64 = 1.0;
/// Before the other joints turn, one may lift the hand by as much, rad, and lower it when they are done ...
const LIFTS: [f64; 6] = [0.3, 0.6, 0.9, -0.3, -0.6, -0.9];
/// ... if that brings the hand this much higher, metres.
const LEAST_LIFT: f64 = 0.05;

/// A joint to turn, and how far.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Turn {
    /// Position among the arm joints.
    pub(crate) joint: usize,
    /// Where it goes, rad.
    pub(crate) to: f64,
    /// From where it was when the turn was thought of, rad.
    pub(crate) angle: f64,
}

/// Some joints in the order in which they turn.
struct TurnSequence {
    turns: Vec<Turn>,
    secs: f64,
    /// Obstacle in the way, metres.
    blocked: f64,
}

impl TurnSequence {
    fn cost(&self) -> f64 {
        self.secs + self.blocked * SECS_PER_METRE
    }

    fn later(self, secs: f64) -> Self {
        Self { secs: self.secs + secs, ..self }
    }
}

/// Under what the joints are turned.
#[derive(Clone, Copy)]
pub(crate) struct Conditions<'a> {
    /// The joint that is selected.
    pub(crate) mode: usize,
    /// What a turn of one rad takes.
    pub(crate) secs_per_rad: f64,
    /// How far an arm that stands so sticks in things, metres.
    pub(crate) in_the_way: &'a dyn Fn(&Stance) -> f64,
    /// A joint may lift the hand on the way.
    pub(crate) lifting: bool,
    /// Turns that were tried in vain.
    pub(crate) refused: &'a dyn Fn(&Turn) -> bool,
}

impl Conditions<'_> {
    /// What the turns take, changes from joint to joint apart.
    fn secs(&self, turns: &[Turn]) -> f64 {
        turns.iter().map(|turn| turn.angle.abs() * self.secs_per_rad + SECS_PER_TURN).sum()
    }
}

impl ArmSense {
    /// The joints to turn one after the other from `q` on the quickest way to the goal. A joint may come twice: it lifts
    /// the hand first and lowers it last. Empty if nothing that it would bring is worth the turns.
    pub(crate) fn turns(&self, q: &[f64], goal: &HandGoal, conditions: &Conditions<'_>) -> Vec<Turn> {
        let here = self.forward(q);
        // Where the hand is already counts for nothing: it has to get out of it.
        let depth = (conditions.in_the_way)(&self.stance(q));
        let in_the_way = |stance: &Stance| ((conditions.in_the_way)(stance) - depth).max(0.0);
        let conditions = Conditions { in_the_way: &in_the_way, ..*conditions };
        // A straight way when the whole one is blocked: half of it, a quarter of it.
        let start = here * goal.point;
        let mut best: Option<TurnSequence> = None;
        for share in [1.0, 0.5, 0.25] {
            let goal = HandGoal { target: start + (goal.target - start) * share, ..*goal };
            let way = self.way(q, &goal, &conditions);
            let clearer = |way: &TurnSequence, best: &TurnSequence| way.blocked < best.blocked - CLEAR;
            if way.as_ref().is_some_and(|way| best.as_ref().is_none_or(|best| clearer(way, best))) {
                best = way;
            }
            if best.as_ref().is_some_and(|best| best.blocked < 2.0 * CLEAR) {
                break;
            }
        }
        best.map(|way| way.turns).unwrap_or_default()
    }

    fn way(&self, q: &[f64], goal: &HandGoal, conditions: &Conditions<'_>) -> Option<TurnSequence> {
        let short = |pose: &Pose| {
            let (off, tilt) = goal.off(pose);
            let (far, aslant) = ((off - goal.point_done).max(0.0), (tilt - goal.tilt_done).max(0.0));
            let again = if far > 0.0 || aslant > 0.0 { SECS_AGAIN } else { 0.0 };
            again + far * SECS_PER_METRE_OFF + aslant * SECS_PER_RAD_OFF
        };
        let now = short(&self.forward(q));
        let sets = (1_u32..1 << q.len()).filter(|set| set.count_ones() <= MOST_JOINTS);
        let mut candidates: Vec<(f64, Vec<Turn>)> = sets
            .filter_map(|set| {
                let wanted = self.inverse(q, goal, set);
                let turns: Vec<Turn> = (0..q.len())
                    .map(|joint| Turn { joint, to: wanted[joint], angle: wanted[joint] - q[joint] })
                    .filter(|turn| turn.angle.abs() >= LEAST_TURN)
                    .collect();
                let whole = turns.len() == set.count_ones() as usize;
                let left = short(&self.forward(&made(q, &turns)));
                (whole && left + conditions.secs(&turns) < now && !turns.iter().any(conditions.refused))
                    .then(|| (left + conditions.secs(&turns), turns))
            })
            .collect();
        candidates.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut best: Option<TurnSequence> = None;
        for (secs, turns) in &candidates {
            if best.as_ref().is_some_and(|best| best.cost() <= *secs) {
                break;
            }
            let direct = self.order(q, turns, None, conditions).later(*secs);
            let clear = direct.blocked <= CLEAR;
            if best.as_ref().is_none_or(|best| direct.cost() < best.cost()) {
                best = Some(direct);
            }
            if !clear && conditions.lifting {
                best = self.lifted(q, goal, (*secs, turns), conditions, best);
            }
        }
        best
    }

    /// The best of `best` and the ways on which one joint lifts the hand first, or on the way, and lowers it last.
    fn lifted(
        &self,
        q: &[f64],
        goal: &HandGoal,
        (secs, turns): (f64, &[Turn]),
        conditions: &Conditions<'_>,
        mut best: Option<TurnSequence>,
    ) -> Option<TurnSequence> {
        let end = made(q, turns);
        let height = |q: &[f64]| goal.up.dot(&(self.forward(q) * goal.point).coords);
        for (joint, lift) in (0..q.len()).flat_map(|joint| LIFTS.map(|lift| (joint, lift))) {
            let limits = self.chain.limits()[joint];
            let via = (end[joint] + lift).clamp(limits.lower, limits.upper);
            let first = Turn { joint, to: via, angle: via - q[joint] };
            let last = Turn { joint, to: end[joint], angle: end[joint] - via };
            let mut before_last = end.clone();
            before_last[joint] = via;
            if [first, last].iter().any(|turn| turn.angle.abs() < LEAST_TURN || (conditions.refused)(turn))
                || height(&before_last) < height(&end) + LEAST_LIFT
            {
                continue;
            }
            let others = turns.iter().filter(|turn| turn.joint != joint).copied();
            let lifted: Vec<Turn> = others.chain([first]).collect();
            let secs = secs - conditions.secs(turns) + conditions.secs(&lifted) + conditions.secs(&[last]);
            let lowering = self.blocked(&before_last, &last, conditions.in_the_way);
            let least = secs + lowering * SECS_PER_METRE;
            if best.as_ref().is_some_and(|best| best.cost() <= least) {
                continue;
            }
            let mut way = self.order(q, &lifted, Some(joint), conditions).later(secs);
            way.turns.push(last);
            way.blocked = way.blocked.max(lowering);
            if best.as_ref().is_none_or(|best| way.cost() < best.cost()) {
                best = Some(way);
            }
        }
        best
    }

    /// The turns in the order that is clear of obstacles and needs the fewest changes of mode, to that of the joint
    /// `then` in the end.
    fn order(
        &self,
        q: &[f64],
        turns: &[Turn],
        then: Option<usize>,
        conditions: &Conditions<'_>,
    ) -> TurnSequence {
        let count = turns.len();
        // From each set of turns already made, by the one made last: seconds, obstacle, and what comes next. From
        // the end backwards.
        let mut best = vec![vec![(0.0_f64, 0.0_f64, 0_usize); count + 1]; 1 << count];
        if let Some(then) = then {
            for (last, turn) in turns.iter().enumerate() {
                best[(1 << count) - 1][last].0 = change_secs(turn.joint, then, q.len());
            }
        }
        for made in (0..(1_usize << count) - 1).rev() {
            let open = |k: &usize| made >> k & 1 == 0;
            let mut from: JointVector = q.iter().copied().collect();
            turns
                .iter()
                .enumerate()
                .filter(|(k, _)| !open(k))
                .for_each(|(_, turn)| from[turn.joint] = turn.to);
            let blocked: Vec<(usize, f64)> = (0..count)
                .filter(open)
                .map(|k| (k, self.blocked(&from, &turns[k], conditions.in_the_way)))
                .collect();
            for last in 0..=count {
                let at = turns.get(last).map_or(conditions.mode, |turn| turn.joint);
                let on = |&(k, blocked): &(usize, f64)| {
                    let (secs, later, _) = best[made | 1 << k][k];
                    (secs + change_secs(at, turns[k].joint, q.len()), later.max(blocked), k)
                };
                let cost = |(secs, blocked, _): &(f64, f64, usize)| secs + blocked * SECS_PER_METRE;
                let next = blocked.iter().map(on).min_by(|a, b| cost(a).total_cmp(&cost(b)));
                best[made][last] = next.unwrap_or_default();
            }
        }
        let (secs, blocked, _) = best[0][count];
        let (mut made, mut last, mut ordered) = (0, count, Vec::with_capacity(count + 1));
        while ordered.len() < count {
            last = best[made][last].2;
            made |= 1 << last;
            ordered.push(turns[last]);
        }
        TurnSequence { turns: ordered, secs, blocked }
    }

    /// How much further than now the arm sticks in things on the rest of a turn, metres.
    pub(crate) fn bump(&self, q: &[f64], turn: &Turn, in_the_way: &dyn Fn(&Stance) -> f64) -> f64 {
        let rest = Turn { angle: turn.to - q[turn.joint], ..*turn };
        self.blocked(q, &rest, in_the_way) - in_the_way(&self.stance(q))
    }

    /// How far the arm sticks in things while one joint turns, metres.
    fn blocked(&self, from: &[f64], turn: &Turn, in_the_way: &dyn Fn(&Stance) -> f64) -> f64 {
        let mut q: JointVector = from.iter().copied().collect();
        (1..=SAMPLES).fold(0.0, |most: f64, sample| {
            q[turn.joint] = from[turn.joint] + turn.angle * sample as f64 / SAMPLES as f64;
            most.max(in_the_way(&self.stance(&q)))
        })
    }
}

/// The angles `q` after the turns.
pub(crate) fn made(q: &[f64], turns: &[Turn]) -> JointVector {
    let mut end: JointVector = q.iter().copied().collect();
    turns.iter().for_each(|turn| end[turn.joint] = turn.to);
    end
}

/// True if the way back from one of `count` modes to another takes less time than the way on.
pub(crate) fn back_is_shorter(from: usize, to: usize, count: usize) -> bool {
    let ahead = (to + count - from) % count;
    ahead > 0 && back_secs(count - ahead) < ahead as f64 * SECS_PER_MODE
}

/// HO is held: one mode on at first, two back after a while, then one back each time.
fn back_secs(back: usize) -> f64 {
    SECS_PER_MODE_BACK * back as f64 + SECS_PER_MODE
}

/// Time from one of `count` modes to another, forward one by one or back, whichever is quicker.
fn change_secs(from: usize, to: usize, count: usize) -> f64 {
    let ahead = (to + count - from) % count;
    let forward = ahead as f64 * SECS_PER_MODE;
    if back_is_shorter(from, to, count) { back_secs(count - ahead) } else { forward }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{arm, goal};
    use super::*;
    use proact_types::Vector;

    #[test]
    fn the_turns_lead_to_the_goal_and_go_around_what_is_in_the_way() {
        let arm = arm();
        let (goal, q) = (goal(&arm), [0.0, 0.1, 0.1]);
        let end = |turns: &[Turn]| {
            let mut q = q;
            turns.iter().for_each(|turn| q[turn.joint] = turn.to);
            goal.off(&arm.forward(&q)).0
        };
        let turns = |in_the_way: &dyn Fn(&Stance) -> f64, refused: &dyn Fn(&Turn) -> bool| {
            arm.turns(
                &q,
                &goal,
                &Conditions { mode: 0, secs_per_rad: 2.5, in_the_way, lifting: true, refused },
            )
        };
        let free = turns(&|_| 0.0, &|_| false);
        assert!(end(&free) < 0.02, "{free:?}");
        assert_eq!(free[0].joint, 0, "the selected joint costs no gesture");
        // A wall that the hand passes only when it has been lifted before it is swung aside.
        let wall = |arm: &Stance| {
            if arm.tip.translation.y > 0.05 && arm.tip.translation.z < 0.05 { 0.1 } else { 0.0 }
        };
        let around = turns(&wall, &|_| false);
        assert_ne!(around.first().map(|turn| turn.joint), Some(0), "{around:?}");
    }

    #[test]
    fn a_joint_lifts_the_hand_over_what_is_in_the_way_and_lowers_it_behind() {
        let arm = arm();
        let q = [0.0, 0.3, 0.3];
        let end = arm.forward(&[0.8, 0.3, 0.3]);
        let goal = HandGoal { target: end * goal(&arm).point, up: Vector::z(), tilt_done: 3.2, ..goal(&arm) };
        let fence = |arm: &Stance| {
            let (y, z) = (arm.tip.translation.y, arm.tip.translation.z);
            if (0.1..0.2).contains(&y) && z < 0.0 { 0.1 } else { 0.0 }
        };
        let conditions = |lifting| Conditions {
            mode: 0,
            secs_per_rad: 2.5,
            in_the_way: &fence,
            lifting,
            refused: &|_| false,
        };
        let turns = arm.turns(&q, &goal, &conditions(true));
        let (first, last) = (turns[0], turns[turns.len() - 1]);
        assert!(turns.len() > 2 && first.joint == last.joint && first.angle * last.angle < 0.0, "{turns:?}");
        assert!(goal.off(&arm.forward(&made(&q, &turns))).0 < 0.02, "{turns:?}");
    }

    #[test]
    fn what_was_tried_in_vain_is_not_tried_again() {
        let arm = arm();
        let refused = |turn: &Turn| turn.joint == 0;
        let conditions =
            Conditions { mode: 0, secs_per_rad: 2.5, in_the_way: &|_| 0.0, lifting: true, refused: &refused };
        let turns = arm.turns(&[0.0, 0.1, 0.1], &goal(&arm), &conditions);
        assert!(!turns.is_empty() && !turns.iter().any(refused), "{turns:?}");
    }

    #[test]
    fn a_turn_that_brings_less_than_it_costs_is_left() {
        let arm = arm();
        let goal = goal(&arm);
        let conditions = Conditions {
            mode: 0,
            secs_per_rad: 2.5,
            in_the_way: &|_| 0.0,
            lifting: false,
            refused: &|_| false,
        };
        // To the side by less than a gesture turns; the last joint would make good a millimetre of two centimetres.
        assert_eq!(arm.turns(&[0.43, -0.5, 0.96], &goal, &conditions), []);
        let turns = arm.turns(&[0.5, -0.5, 0.9], &goal, &conditions);
        assert_eq!(turns.iter().map(|turn| turn.joint).collect::<Vec<_>>(), [0]);
    }

    #[test]
    fn modes_are_gone_to_forward_or_back_whichever_is_quicker() {
        assert!(!back_is_shorter(0, 0, 7) && !back_is_shorter(0, 3, 7));
        assert!(back_is_shorter(0, 6, 7) && back_is_shorter(1, 6, 7));
        assert_eq!(change_secs(2, 4, 7), 2.0 * SECS_PER_MODE);
        assert!(change_secs(0, 6, 7) < 6.0 * SECS_PER_MODE);
    }
}
