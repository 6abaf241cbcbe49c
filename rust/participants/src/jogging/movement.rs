//! Which movement comes next: the axis or the joint that is off.

use super::{AXES, FIRST_AXIS, JOINTS, JoggingParticipant, Stage, obstacles::Obstacles};
use crate::reach::{Conditions, HandGoal, Stance, Turn, made};
use proact_types::{BlockId, DisplayFrame, Gesture, Pose, Vector};

/// How fast WE and WF move a joint, rad/s, and the hand, m/s and rad/s: learnt in the first minutes of practice.
const JOINT_SPEED: f64 = 0.4;
const LINEAR_SPEED: f64 = 0.08;
const ANGULAR_SPEED: f64 = 0.4;
/// Signs of WE for the seven joints in the paper's order.
const JOINT_SIGNS: [f64; 7] = [1.0, -1.0, -1.0, 1.0, 1.0, 1.0, -1.0];
/// What is left below this along an axis is not worth another movement, metres, rad.
const LINEAR_DONE: f64 = 0.006;
pub(super) const ANGULAR_DONE: f64 = 0.15;
/// A joint this near to where it should be is left alone, rad.
pub(super) const TURN_DONE: f64 = 0.035;
/// A last turn that brings the arm further into something than this is thought of again, metres.
const GRAZE: f64 = 0.006;
/// The hand turns about the upright once it is this near to its place, metres.
const YAW_NEAR: f64 = 0.06;

/// What one mode is off by, and what brings it nearer.
#[derive(Clone, Copy, Debug)]
pub(super) struct Lack {
    pub(super) mode: u8,
    /// How far off, in the unit of its speed.
    pub(super) amount: f64,
    /// Per second.
    pub(super) speed: f64,
    pub(super) gesture: Gesture,
}

impl JoggingParticipant {
    /// The nearest axis in the cycle that is off and was not refused: none if all are right, an error if those that
    /// are off were refused.
    pub(super) fn axis_lack(
        &mut self,
        base_from_tip: &Pose,
        goal: &HandGoal,
        mode: u8,
    ) -> Result<Option<Lack>, ()> {
        let off = goal.target - base_from_tip * goal.point;
        let tilt = (base_from_tip.rotation * goal.axis).cross(&goal.up);
        let aside = off - goal.up * off.dot(&goal.up);
        self.near |= aside.norm() < YAW_NEAR;
        let turn = match &self.attitude {
            // Straight up in any attitude.
            _ if goal.tilt_done > 0.9 => Vector::zeros(),
            Some(wanted) if self.near => (wanted * base_from_tip.rotation.inverse()).scaled_axis(),
            _ => tilt,
        };
        let (mut turns, mut shifts) = (Vec::new(), Vec::new());
        for (k, sign) in [1.0, -1.0, 1.0].into_iter().enumerate() {
            let mode = FIRST_AXIS + k as u8;
            if off[k].abs() > LINEAR_DONE.max(goal.point_done / 2.0) {
                let gesture = sided(off[k] * sign);
                shifts.push(Lack { mode, amount: off[k], speed: LINEAR_SPEED, gesture });
            }
            if turn[k].abs() > ANGULAR_DONE {
                let gesture = sided(turn[k] * sign);
                turns.push(Lack { mode: mode + 3, amount: turn[k], speed: ANGULAR_SPEED, gesture });
            }
        }
        if turns.is_empty() && shifts.is_empty() {
            return Ok(None);
        }
        let free = |lack: &&Lack| !self.refused.contains(&(lack.mode, lack.gesture));
        let ahead = |lack: &&Lack| (lack.mode + AXES - mode) % AXES;
        // Turning the hand at its wrist carries the grasp centre along: tilt first, then place.
        let next = turns.iter().filter(free).min_by_key(ahead);
        let next = next.or_else(|| shifts.iter().filter(free).min_by_key(ahead)).copied();
        let turned_enough = shifts.is_empty() && tilt.norm() < goal.tilt_done;
        if next.is_none() && !turned_enough { Err(()) } else { Ok(next) }
    }

    /// Forgets the turns that are made; thinks of new ones when none is left.
    pub(super) fn think_of_turns(
        &mut self,
        seen: &DisplayFrame,
        q: &[f64],
        goal: &HandGoal,
        mode: u8,
        block: BlockId,
    ) {
        // What is left of a turn is left: the next round sees to it together with the rest.
        while self.turns.first().is_some_and(|turn| (turn.to - q[turn.joint]).abs() < TURN_DONE) {
            self.turns.remove(0);
        }
        if self.turns.len() > 1 || (!self.turns.is_empty() && self.movements == 0) {
            return;
        }
        let obstacles = Obstacles::new(&self.scene, seen, block, self.sense.fingers(&seen.joints));
        let in_the_way = |stance: &Stance| obstacles.depth(&seen.world_from_base, stance);
        // Before the last turn: does it still lead there, and clear of everything?
        if let Some(last) = self.turns.first() {
            let end = self.sense.forward(&made(q, &self.turns));
            let misses = goal.off(&end).0 > 2.0 * goal.point_done;
            if !misses && self.sense.bump(q, last, &in_the_way) < GRAZE {
                return;
            }
        }
        let refused =
            |turn: &Turn| self.refused.contains(&(turn.joint as u8, gesture_of(turn.joint, turn.angle)));
        let conditions = Conditions {
            mode: mode.into(),
            secs_per_rad: 1.0 / JOINT_SPEED,
            in_the_way: &in_the_way,
            lifting: !matches!(self.stage, Stage::Lift | Stage::Retreat),
            refused: &refused,
        };
        self.turns = self.sense.turns(q, goal, &conditions);
    }

    /// The joint to turn next; none if none helps.
    pub(super) fn joint_lack(
        &mut self,
        seen: &DisplayFrame,
        goal: &HandGoal,
        mode: u8,
        block: BlockId,
    ) -> Option<Lack> {
        let q = seen.joints.get(..JOINTS.into())?;
        self.think_of_turns(seen, q, goal, mode, block);
        let turn = self.turns.first()?;
        let amount = turn.to - q[turn.joint];
        let gesture = gesture_of(turn.joint, amount);
        Some(Lack { mode: turn.joint as u8, amount, speed: JOINT_SPEED, gesture })
    }
}

/// The gesture that turns a joint to one side or the other.
fn gesture_of(joint: usize, angle: f64) -> Gesture {
    sided(angle * JOINT_SIGNS[joint])
}

/// The gesture for one side or the other.
fn sided(amount: f64) -> Gesture {
    if amount > 0.0 { Gesture::WristExtension } else { Gesture::WristFlexion }
}
