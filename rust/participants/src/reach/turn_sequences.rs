//! Which few joints to turn, and in which order, for the hand to be somewhere.

use super::{ArmPosture, HandGoal, InternalArmModel};
use proact_types::{JointVector, Pose};

/// Joints that are moved for one way, at most.
const MAX_JOINTS_PER_SEQUENCE: u32 = 5;
/// A joint moves at least this far: shorter gestures are not recognised, rad.
const MIN_TURN_RAD: f64 = 0.05;
/// Points looked at on the way of one joint.
const SAMPLES: usize = 8;
/// A metre of obstacle in the way counts as this many seconds.
const PENETRATION_SECS_PER_M: f64 = 1000.0;
/// Obstacle that counts for nothing: a place to go around it is not looked for, metres.
const MAX_PENETRATION_M: f64 = 0.003;
/// A metre short of the goal counts as this many seconds.
const POSITION_ERROR_SECS_PER_M: f64 = 300.0;
/// ... a radian too much of tilt as this many, and whatever is left as this many more: another round is due.
const TILT_ERROR_SECS_PER_RAD: f64 = 20.0;
const EXTRA_ROUND_SECS: f64 = 5.0;
/// A gesture that goes one joint on takes this long, one joint back, and one that turns a joint this much beyond the
/// turn itself, seconds.
const SECS_PER_MODE: f64 = 0.65;
const SECS_PER_MODE_BACK: f64 = 1.0;
const SECS_PER_TURN: f64 = 1.0;
/// Before the other joints turn, one may lift the hand by as much, rad, and lower it when they are done ...
const LIFT_ANGLES_RAD: [f64; 6] = [0.3, 0.6, 0.9, -0.3, -0.6, -0.9];
/// ... if that brings the hand this much higher, metres.
const MIN_LIFT_M: f64 = 0.05;

/// A joint to turn, and how far.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct JointTurn {
    /// Position among the arm joints.
    pub(crate) joint: usize,
    /// Where it goes, rad.
    pub(crate) target_rad: f64,
    /// From where it was when the turn was thought of, rad.
    pub(crate) angle: f64,
}

/// Some joints in the order in which they turn.
struct TurnSequence {
    turns: Vec<JointTurn>,
    secs: f64,
    /// Obstacle in the way, metres.
    penetration_m: f64,
}

impl TurnSequence {
    fn cost(&self) -> f64 {
        self.secs + self.penetration_m * PENETRATION_SECS_PER_M
    }

    fn delayed_by(self, secs: f64) -> Self {
        Self { secs: self.secs + secs, ..self }
    }
}

/// Under what the joints are turned.
#[derive(Clone, Copy)]
pub(crate) struct TurnConstraints<'a> {
    /// The joint that is selected.
    pub(crate) selected_mode: usize,
    /// What a turn of one rad takes.
    pub(crate) secs_per_rad: f64,
    /// How far an arm that stands so sticks in things, metres.
    pub(crate) penetration_depth_m: &'a dyn Fn(&ArmPosture) -> f64,
    /// A joint may lift the hand on the way.
    pub(crate) allows_lift: bool,
    /// Turns that were tried in vain.
    pub(crate) is_refused: &'a dyn Fn(&JointTurn) -> bool,
}

impl TurnConstraints<'_> {
    /// What the turns take, changes from joint to joint apart.
    fn secs(&self, turns: &[JointTurn]) -> f64 {
        turns.iter().map(|turn| turn.angle.abs() * self.secs_per_rad + SECS_PER_TURN).sum()
    }
}

impl InternalArmModel {
    /// The joints to turn one after the other from `q` on the quickest way to the goal. A joint may come twice: it lifts
    /// the hand first and lowers it last. Empty if nothing that it would bring is worth the turns.
    pub(crate) fn plan_turns(
        &self,
        q: &[f64],
        goal: &HandGoal,
        conditions: &TurnConstraints<'_>,
    ) -> Vec<JointTurn> {
        let here = self.forward(q);
        // Where the hand is already counts for nothing: it has to get out of it.
        let depth = (conditions.penetration_depth_m)(&self.posture(q));
        let penetration_depth =
            |stance: &ArmPosture| ((conditions.penetration_depth_m)(stance) - depth).max(0.0);
        let conditions = TurnConstraints { penetration_depth_m: &penetration_depth, ..*conditions };
        // A straight way when the whole one is blocked: half of it, a quarter of it.
        let start = here * goal.point;
        let mut best: Option<TurnSequence> = None;
        for share in [1.0, 0.5, 0.25] {
            let goal = HandGoal { target: start + (goal.target - start) * share, ..*goal };
            let sequence = self.best_sequence(q, &goal, &conditions);
            let clearer = |sequence: &TurnSequence, best: &TurnSequence| {
                sequence.penetration_m < best.penetration_m - MAX_PENETRATION_M
            };
            if sequence
                .as_ref()
                .is_some_and(|sequence| best.as_ref().is_none_or(|best| clearer(sequence, best)))
            {
                best = sequence;
            }
            if best.as_ref().is_some_and(|best| best.penetration_m < 2.0 * MAX_PENETRATION_M) {
                break;
            }
        }
        best.map(|sequence| sequence.turns).unwrap_or_default()
    }

    fn best_sequence(
        &self,
        q: &[f64],
        goal: &HandGoal,
        conditions: &TurnConstraints<'_>,
    ) -> Option<TurnSequence> {
        let short = |pose: &Pose| {
            let (off, tilt) = goal.error(pose);
            let (far, aslant) =
                ((off - goal.point_tolerance_m).max(0.0), (tilt - goal.tilt_tolerance_rad).max(0.0));
            let again = if far > 0.0 || aslant > 0.0 { EXTRA_ROUND_SECS } else { 0.0 };
            again + far * POSITION_ERROR_SECS_PER_M + aslant * TILT_ERROR_SECS_PER_RAD
        };
        let now = short(&self.forward(q));
        let sets = (1_u32..1 << q.len()).filter(|set| set.count_ones() <= MAX_JOINTS_PER_SEQUENCE);
        let mut candidates: Vec<(f64, Vec<JointTurn>)> = sets
            .filter_map(|set| {
                let wanted = self.inverse(q, goal, set);
                let turns: Vec<JointTurn> = (0..q.len())
                    .map(|joint| JointTurn {
                        joint,
                        target_rad: wanted[joint],
                        angle: wanted[joint] - q[joint],
                    })
                    .filter(|turn| turn.angle.abs() >= MIN_TURN_RAD)
                    .collect();
                let whole = turns.len() == set.count_ones() as usize;
                let left = short(&self.forward(&apply_turns(q, &turns)));
                (whole && left + conditions.secs(&turns) < now && !turns.iter().any(conditions.is_refused))
                    .then(|| (left + conditions.secs(&turns), turns))
            })
            .collect();
        candidates.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut best: Option<TurnSequence> = None;
        for (secs, turns) in &candidates {
            if best.as_ref().is_some_and(|best| best.cost() <= *secs) {
                break;
            }
            let direct = self.order_turns(q, turns, None, conditions).delayed_by(*secs);
            let clear = direct.penetration_m <= MAX_PENETRATION_M;
            if best.as_ref().is_none_or(|best| direct.cost() < best.cost()) {
                best = Some(direct);
            }
            if !clear && conditions.allows_lift {
                best = self.best_lifted_sequence(q, goal, (*secs, turns), conditions, best);
            }
        }
        best
    }

    /// The best of `best` and the ways on which one joint lifts the hand first, or on the way, and lowers it last.
    fn best_lifted_sequence(
        &self,
        q: &[f64],
        goal: &HandGoal,
        (secs, turns): (f64, &[JointTurn]),
        conditions: &TurnConstraints<'_>,
        mut best: Option<TurnSequence>,
    ) -> Option<TurnSequence> {
        let end = apply_turns(q, turns);
        let height = |q: &[f64]| goal.up.dot(&(self.forward(q) * goal.point).coords);
        for (joint, lift) in (0..q.len()).flat_map(|joint| LIFT_ANGLES_RAD.map(|lift| (joint, lift))) {
            let limits = self.chain.limits()[joint];
            let via = (end[joint] + lift).clamp(limits.lower, limits.upper);
            let first = JointTurn { joint, target_rad: via, angle: via - q[joint] };
            let last = JointTurn { joint, target_rad: end[joint], angle: end[joint] - via };
            let mut before_last = end.clone();
            before_last[joint] = via;
            if [first, last]
                .iter()
                .any(|turn| turn.angle.abs() < MIN_TURN_RAD || (conditions.is_refused)(turn))
                || height(&before_last) < height(&end) + MIN_LIFT_M
            {
                continue;
            }
            let others = turns.iter().filter(|turn| turn.joint != joint).copied();
            let lifted: Vec<JointTurn> = others.chain([first]).collect();
            let secs = secs - conditions.secs(turns) + conditions.secs(&lifted) + conditions.secs(&[last]);
            let lowering = self.max_penetration_m(&before_last, &last, conditions.penetration_depth_m);
            let min_cost = secs + lowering * PENETRATION_SECS_PER_M;
            if best.as_ref().is_some_and(|best| best.cost() <= min_cost) {
                continue;
            }
            let mut sequence = self.order_turns(q, &lifted, Some(joint), conditions).delayed_by(secs);
            sequence.turns.push(last);
            sequence.penetration_m = sequence.penetration_m.max(lowering);
            if best.as_ref().is_none_or(|best| sequence.cost() < best.cost()) {
                best = Some(sequence);
            }
        }
        best
    }

    /// The turns in the order that is clear of obstacles and needs the fewest changes of mode, to that of the joint
    /// `then` in the end.
    fn order_turns(
        &self,
        q: &[f64],
        turns: &[JointTurn],
        then: Option<usize>,
        conditions: &TurnConstraints<'_>,
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
                .for_each(|(_, turn)| from[turn.joint] = turn.target_rad);
            let blocked: Vec<(usize, f64)> = (0..count)
                .filter(open)
                .map(|k| (k, self.max_penetration_m(&from, &turns[k], conditions.penetration_depth_m)))
                .collect();
            for last in 0..=count {
                let at = turns.get(last).map_or(conditions.selected_mode, |turn| turn.joint);
                let on = |&(k, blocked): &(usize, f64)| {
                    let (secs, later, _) = best[made | 1 << k][k];
                    (secs + change_secs(at, turns[k].joint, q.len()), later.max(blocked), k)
                };
                let cost = |(secs, blocked, _): &(f64, f64, usize)| secs + blocked * PENETRATION_SECS_PER_M;
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
        TurnSequence { turns: ordered, secs, penetration_m: blocked }
    }

    /// How much further than now the arm sticks in things on the rest of a turn, metres.
    pub(crate) fn added_penetration_m(
        &self,
        q: &[f64],
        turn: &JointTurn,
        penetration_depth: &dyn Fn(&ArmPosture) -> f64,
    ) -> f64 {
        let rest = JointTurn { angle: turn.target_rad - q[turn.joint], ..*turn };
        self.max_penetration_m(q, &rest, penetration_depth) - penetration_depth(&self.posture(q))
    }

    /// How far the arm sticks in things while one joint turns, metres.
    fn max_penetration_m(
        &self,
        from: &[f64],
        turn: &JointTurn,
        penetration_depth: &dyn Fn(&ArmPosture) -> f64,
    ) -> f64 {
        let mut q: JointVector = from.iter().copied().collect();
        (1..=SAMPLES).fold(0.0, |max: f64, sample| {
            q[turn.joint] = from[turn.joint] + turn.angle * sample as f64 / SAMPLES as f64;
            max.max(penetration_depth(&self.posture(&q)))
        })
    }
}

/// The angles `q` after the turns.
pub(crate) fn apply_turns(q: &[f64], turns: &[JointTurn]) -> JointVector {
    let mut end: JointVector = q.iter().copied().collect();
    turns.iter().for_each(|turn| end[turn.joint] = turn.target_rad);
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
        let end = |turns: &[JointTurn]| {
            let mut q = q;
            turns.iter().for_each(|turn| q[turn.joint] = turn.target_rad);
            goal.error(&arm.forward(&q)).0
        };
        let turns = |penetration_depth: &dyn Fn(&ArmPosture) -> f64, refused: &dyn Fn(&JointTurn) -> bool| {
            arm.plan_turns(
                &q,
                &goal,
                &TurnConstraints {
                    selected_mode: 0,
                    secs_per_rad: 2.5,
                    penetration_depth_m: penetration_depth,
                    allows_lift: true,
                    is_refused: refused,
                },
            )
        };
        let free = turns(&|_| 0.0, &|_| false);
        assert!(end(&free) < 0.02, "{free:?}");
        assert_eq!(free[0].joint, 0, "the selected joint costs no gesture");
        // A wall that the hand passes only when it has been lifted before it is swung aside.
        let wall = |arm: &ArmPosture| {
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
        let goal = HandGoal {
            target: end * goal(&arm).point,
            up: Vector::z(),
            tilt_tolerance_rad: 3.2,
            ..goal(&arm)
        };
        let fence = |arm: &ArmPosture| {
            let (y, z) = (arm.tip.translation.y, arm.tip.translation.z);
            if (0.1..0.2).contains(&y) && z < 0.0 { 0.1 } else { 0.0 }
        };
        let conditions = |lifting| TurnConstraints {
            selected_mode: 0,
            secs_per_rad: 2.5,
            penetration_depth_m: &fence,
            allows_lift: lifting,
            is_refused: &|_| false,
        };
        let turns = arm.plan_turns(&q, &goal, &conditions(true));
        let (first, last) = (turns[0], turns[turns.len() - 1]);
        assert!(turns.len() > 2 && first.joint == last.joint && first.angle * last.angle < 0.0, "{turns:?}");
        assert!(goal.error(&arm.forward(&apply_turns(&q, &turns))).0 < 0.02, "{turns:?}");
    }

    #[test]
    fn what_was_tried_in_vain_is_not_tried_again() {
        let arm = arm();
        let refused = |turn: &JointTurn| turn.joint == 0;
        let conditions = TurnConstraints {
            selected_mode: 0,
            secs_per_rad: 2.5,
            penetration_depth_m: &|_| 0.0,
            allows_lift: true,
            is_refused: &refused,
        };
        let turns = arm.plan_turns(&[0.0, 0.1, 0.1], &goal(&arm), &conditions);
        assert!(!turns.is_empty() && !turns.iter().any(refused), "{turns:?}");
    }

    #[test]
    fn a_turn_that_brings_less_than_it_costs_is_left() {
        let arm = arm();
        let goal = goal(&arm);
        let conditions = TurnConstraints {
            selected_mode: 0,
            secs_per_rad: 2.5,
            penetration_depth_m: &|_| 0.0,
            allows_lift: false,
            is_refused: &|_| false,
        };
        // To the side by less than a gesture turns; the last joint would make good a millimetre of two centimetres.
        assert_eq!(arm.plan_turns(&[0.43, -0.5, 0.96], &goal, &conditions), []);
        let turns = arm.plan_turns(&[0.5, -0.5, 0.9], &goal, &conditions);
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
