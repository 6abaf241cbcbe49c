//! Which movement comes next: the axis or the joint that is off.

use super::{
    AXIS_MODES, FIRST_AXIS_MODE, TransferPhase,
    decision_context::{DecisionContext, ReachGoal},
    hand_tilt::HandTilt,
    key_press::KeyPress,
};
use crate::reach::{ArmPosture, JointTurn, TurnConstraints, apply_turns};
use proact_types::{Pose, Vector};

/// After so many movements the place is good enough, or not to be had.
const MAX_MOVEMENTS: u32 = 28;
/// Joint by joint, after so many that brought too little another way is looked for.
const MAX_FAILED_MOVEMENTS: u32 = 3;
/// How fast WE and WF move a joint, rad/s, and the hand, m/s and rad/s: what practice has taught.
const JOINT_SPEED: f64 = 0.4;
const LINEAR_SPEED: f64 = 0.08;
const ANGULAR_SPEED: f64 = 0.4;
/// What is left below this along an axis is not worth another movement, metres, rad.
const LINEAR_TOLERANCE_M: f64 = 0.006;
pub(super) const ANGULAR_TOLERANCE_RAD: f64 = 0.15;
/// On its way down the hand is taken no further than this beside the line upon which its place lies, metres. Assumed: half the
/// width of an open hand.
const MAX_LATERAL_OFFSET_M: f64 = 0.05;
/// A joint this near to where it should be is left alone, rad.
pub(super) const JOINT_TOLERANCE_RAD: f64 = 0.035;
/// A last turn that brings the arm further into something than this is thought of again, metres.
const MAX_ADDED_PENETRATION_M: f64 = 0.006;

/// What one mode is off by, and what brings it nearer.
#[derive(Clone, Copy, Debug)]
pub(super) struct ModeError {
    pub(super) mode: u8,
    /// How far off, in the unit of its speed, with its sign.
    pub(super) error: f64,
    /// Per second.
    pub(super) speed: f64,
}

impl ModeError {
    /// The mode, and whether it goes to its positive side.
    pub(super) fn direction(&self) -> (u8, bool) {
        (self.mode, self.error > 0.0)
    }

    /// The same no further than until the hand, which has `off` to go, is [`MAX_LATERAL_OFFSET_M`] beside the line along `up` through
    /// its place, or as far as it is now; none if that leaves nothing worth a movement.
    fn limited_to_lateral_offset(self, off: &Vector, up: &Vector) -> Option<Self> {
        let beside = |v: Vector| v - up * v.dot(up);
        let mut shift = Vector::zeros();
        shift[usize::from(self.mode - FIRST_AXIS_MODE)] = self.error;
        let (now, shift) = (beside(*off), beside(shift));
        // The larger root of |now - share shift| = most.
        let max_offset = MAX_LATERAL_OFFSET_M.max(now.norm());
        let (a, b, c) = (shift.norm_squared(), now.dot(&shift), now.norm_squared() - max_offset * max_offset);
        let share = if a < 1e-12 { 1.0 } else { (b + (b * b - a * c).max(0.0).sqrt()) / a };
        let amount = self.error * share.clamp(0.0, 1.0);
        (amount.abs() >= LINEAR_TOLERANCE_M).then_some(Self { error: amount, ..self })
    }
}

/// The movements of one stage: what was tried, and what is thought of next.
#[derive(Default)]
pub(super) struct Movements {
    /// Modes and sides, true for the positive one, that were refused since the last one that was not.
    refused_directions: Vec<(u8, bool)>,
    /// What method A has yet to turn, in this order.
    planned_turns: Vec<JointTurn>,
    /// Movements since the stage began.
    movement_count: u32,
    /// ... and those of them that brought too little.
    failed_count: u32,
}

impl Movements {
    /// Another stage begins.
    pub(super) fn begin(&mut self) {
        *self = Self::default();
    }

    /// The same, after `refused` was tried in vain in the stage before.
    pub(super) fn begin_phase_avoiding(&mut self, refused: Vec<(u8, bool)>) {
        *self = Self { refused_directions: refused, ..Self::default() };
    }

    /// What method A has yet to turn, in this order.
    pub(super) fn planned_turns(&self) -> &[JointTurn] {
        &self.planned_turns
    }

    /// What was refused, once several joints were turned in vain.
    pub(super) fn failed_directions(&self, reach_goal: &ReachGoal) -> Option<Vec<(u8, bool)>> {
        self.is_failing(reach_goal).then(|| self.refused_directions.clone())
    }

    /// Remembers a movement that brought too little; forgets the others when one went well.
    pub(super) fn record_outcome(&mut self, key_press: &KeyPress, context: &DecisionContext) {
        if key_press.was_blocked(context) {
            self.record_contact(key_press.direction());
        } else {
            self.refused_directions.clear();
        }
    }

    /// A movement in this mode, to its positive side or not, met something: another way is thought of.
    pub(super) fn record_contact(&mut self, kind: (u8, bool)) {
        self.refused_directions.push(kind);
        self.failed_count += 1;
        self.planned_turns.clear();
    }

    /// What to move next: none if the hand is where it should be, an error if nothing is left that would help.
    pub(super) fn next(
        &mut self,
        context: &DecisionContext,
        reach_goal: &ReachGoal,
        hand_tilt: &mut HandTilt,
    ) -> Result<Option<ModeError>, ()> {
        let base_from_tip = context.base_from_tip();
        let goal = &reach_goal.hand_goal;
        let good_enough = self.movement_count > MAX_MOVEMENTS;
        match () {
            () if self.is_failing(reach_goal) => Err(()),
            () if good_enough && goal.error(&base_from_tip).0 < 2.0 * goal.point_tolerance_m => Ok(None),
            () if good_enough => Err(()),
            () if !reach_goal.jogs_axes() && goal.is_reached(&base_from_tip) => Ok(None),
            () if reach_goal.jogs_axes() => self.axis_error(&base_from_tip, reach_goal, hand_tilt),
            () => self.joint_error(context, reach_goal).map(Some).ok_or(()),
        }
    }

    /// The movement that was thought of begins.
    pub(super) fn start(&mut self, reach_goal: &ReachGoal) {
        self.movement_count += 1;
        if !reach_goal.jogs_axes() {
            self.planned_turns.remove(0);
        }
    }

    /// Forgets the turns that are made; thinks of new ones when none is left.
    pub(super) fn plan_turns(&mut self, context: &DecisionContext, reach_goal: &ReachGoal, q: &[f64]) {
        // What is left of a turn is left: the next round sees to it together with the rest.
        while self
            .planned_turns
            .first()
            .is_some_and(|turn| (turn.target_rad - q[turn.joint]).abs() < JOINT_TOLERANCE_RAD)
        {
            self.planned_turns.remove(0);
        }
        if self.planned_turns.len() > 1 || (!self.planned_turns.is_empty() && self.movement_count == 0) {
            return;
        }
        let DecisionContext { sense, frame: seen, .. } = context;
        let obstacles = context.obstacles();
        let penetration_depth =
            |stance: &ArmPosture| obstacles.penetration_depth_m(&seen.world_from_base, stance);
        // Before the last turn: does it still lead there, and clear of everything?
        if let Some(last) = self.planned_turns.first() {
            let end = sense.forward(&apply_turns(q, &self.planned_turns));
            let misses = reach_goal.hand_goal.error(&end).0 > 2.0 * reach_goal.hand_goal.point_tolerance_m;
            if !misses && sense.added_penetration_m(q, last, &penetration_depth) < MAX_ADDED_PENETRATION_M {
                return;
            }
        }
        let refused =
            |turn: &JointTurn| self.refused_directions.contains(&(turn.joint as u8, turn.angle > 0.0));
        let conditions = TurnConstraints {
            selected_mode: reach_goal.selected_mode.into(),
            secs_per_rad: 1.0 / JOINT_SPEED,
            penetration_depth_m: &penetration_depth,
            allows_lift: !matches!(reach_goal.phase, TransferPhase::Lift | TransferPhase::Retreat),
            is_refused: &refused,
        };
        self.planned_turns = sense.plan_turns(q, &reach_goal.hand_goal, &conditions);
    }

    /// True joint by joint after several movements that brought too little.
    pub(super) fn is_failing(&self, reach_goal: &ReachGoal) -> bool {
        !reach_goal.jogs_axes() && self.failed_count >= MAX_FAILED_MOVEMENTS
    }

    /// The axis to move along or turn about next, of those that are off and were not refused: none if the hand is where it
    /// should be, an error if those that are off were refused.
    ///
    /// Axes lean with the trunk, so that a straight way down is one along two or three of them. Whoever watches the hand
    /// goes up along the axis that leads most nearly up. On the way down the hand goes aside first, staying above its place, and
    /// then down upon it, not along the table to it. Else the nearest axis in the cycle is next.
    fn axis_error(
        &self,
        base_from_tip: &Pose,
        reach_goal: &ReachGoal,
        hand_tilt: &mut HandTilt,
    ) -> Result<Option<ModeError>, ()> {
        let goal = &reach_goal.hand_goal;
        let off = goal.target - base_from_tip * goal.point;
        let tilt = (base_from_tip.rotation * goal.axis).cross(&goal.up);
        let turn = hand_tilt.remaining_rotation(reach_goal, base_from_tip, &off, &tilt);
        let (mut turns, mut shifts) = (Vec::new(), Vec::new());
        for k in 0..3 {
            let mode = FIRST_AXIS_MODE + k as u8;
            if off[k].abs() > LINEAR_TOLERANCE_M.max(goal.point_tolerance_m / 2.0) {
                shifts.push(ModeError { mode, error: off[k], speed: LINEAR_SPEED });
            }
            if turn[k].abs() > ANGULAR_TOLERANCE_RAD {
                turns.push(ModeError { mode: mode + 3, error: turn[k], speed: ANGULAR_SPEED });
            }
        }
        let there = shifts.is_empty() || goal.is_reached(base_from_tip);
        if turns.is_empty() && there {
            return Ok(None);
        }
        let (up, down) = (reach_goal.is_retreat(), reach_goal.is_descent());
        if down {
            let above: Vec<ModeError> =
                shifts.iter().filter_map(|shift| shift.limited_to_lateral_offset(&off, &goal.up)).collect();
            shifts = if above.is_empty() { shifts } else { above };
        }
        let free = |mode_error: &&ModeError| !self.refused_directions.contains(&mode_error.direction());
        let ahead =
            |mode_error: &&ModeError| (mode_error.mode + AXIS_MODES - reach_goal.selected_mode) % AXIS_MODES;
        // Turning the hand at its wrist carries the grasp centre along: tilt first, then place.
        let next = turns.iter().filter(free).min_by_key(ahead);
        let shorter = |a: &&ModeError, b: &&ModeError| a.error.abs().total_cmp(&b.error.abs());
        let next = next.or_else(|| match () {
            () if up => shifts.iter().filter(free).max_by(shorter),
            () if down => shifts.iter().filter(free).min_by(shorter),
            () => shifts.iter().filter(free).min_by_key(ahead),
        });
        let next = next.copied();
        let turned_enough = shifts.is_empty() && tilt.norm() < goal.tilt_tolerance_rad;
        if next.is_none() && !turned_enough { Err(()) } else { Ok(next) }
    }

    /// The joint to turn next; none if none helps.
    fn joint_error(&mut self, context: &DecisionContext, reach_goal: &ReachGoal) -> Option<ModeError> {
        let q = context.arm_angles()?;
        self.plan_turns(context, reach_goal, q);
        let turn = self.planned_turns.first()?;
        Some(ModeError { mode: turn.joint as u8, error: turn.target_rad - q[turn.joint], speed: JOINT_SPEED })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reach::HandGoal;
    use proact_types::Point;

    const Z: u8 = FIRST_AXIS_MODE + 2;

    /// The hand is at the origin of leaning axes, and should be at `off`, the way that it stands.
    fn aim(stage: TransferPhase, mode: u8, off: Vector) -> ReachGoal {
        let goal = HandGoal {
            point: Point::origin(),
            axis: off.normalize() * off.z.signum(),
            target: Point::from(off),
            up: if off.z < 0.0 { -off.normalize() } else { off.normalize() },
            excess_height_weight: 1.0,
            point_tolerance_m: 0.012,
            tilt_tolerance_rad: 0.3,
            orientation: None,
        };
        ReachGoal { phase: stage, hand_goal: goal, selected_mode: mode }
    }

    fn next(stage: TransferPhase, mode: u8, off: Vector, hand: &Vector) -> Option<ModeError> {
        let base_from_tip = Pose::translation(hand.x, hand.y, hand.z);
        Movements::default().axis_error(&base_from_tip, &aim(stage, mode, off), &mut HandTilt::new()).unwrap()
    }

    /// Caught hands that were pulled back, out of reach, to come up: with leaning axes back is a little up, too.
    #[test]
    fn the_way_up_begins_along_the_axis_that_leads_most_nearly_up() {
        let up = Vector::new(-0.098, -0.064, 0.204);
        for mode in FIRST_AXIS_MODE..FIRST_AXIS_MODE + AXIS_MODES {
            let mode_error = next(TransferPhase::Lift, mode, up, &Vector::zeros()).unwrap();
            assert_eq!((mode_error.mode, mode_error.error > 0.0), (Z, true), "from mode {mode}");
        }
    }

    /// Caught hands that were lowered beside a block and then pushed it.
    #[test]
    fn the_hand_comes_down_upon_its_place_and_never_far_beside_it() {
        let off = Vector::new(0.088, 0.067, -0.188);
        let up = -off.normalize();
        let (mut hand, mut mode, mut count) = (Vector::zeros(), Z, 0);
        while let Some(mode_error) = next(TransferPhase::Lower, mode, off, &hand) {
            hand[usize::from(mode_error.mode - FIRST_AXIS_MODE)] += mode_error.error;
            let left = off - hand;
            let aside = (left - up * left.dot(&up)).norm();
            assert!(aside < MAX_LATERAL_OFFSET_M + 1e-9, "{aside} beside its place");
            (mode, count) = (mode_error.mode, count + 1);
            assert!(count < 20, "it does not end");
        }
        assert_eq!(mode, Z, "the last movement goes down");
        assert!((off - hand).norm() <= 0.012 && count < 8, "{count} movements");
    }
}
