//! One movement: how long it is to be, when it is over, and what it brought.

use super::{FIRST_AXIS, movement::Lack, situation::Situation};
use crate::habits::Habits;
use proact_types::{DisplayFrame, Gesture, JointVector, PlannerView, Pose, SimTime};
use rand_distr::{Distribution, Normal};

/// No movement gesture is held shorter or longer than this, ms: three decisions, and a look in between.
const PULSE_MILLIS: (f64, f64) = (150.0, 2500.0);
/// A joint is turned all the way at once.
const LONGEST_TURN_MILLIS: f64 = 8000.0;
/// A long movement is followed with the eye and ended this near to the moment that was meant, ms.
const TIMING_MILLIS: f64 = 50.0;
/// A movement that gives less than this share of what it should has met something.
const LEAST_PROGRESS: f64 = 0.4;
/// ... and so has a joint that stops this much short of where it was turned, rad.
const TOUCHED: f64 = 0.06;

/// A movement gesture of a length that was decided before it began.
#[derive(Clone, Debug)]
pub(super) struct Pulse {
    mode: u8,
    gesture: Gesture,
    millis: u64,
    /// Where the arm was before: arm angles, or the hand's place and attitude.
    before: (JointVector, Pose),
    /// What it should bring, in the unit of its speed.
    amount: f64,
    began: Option<SimTime>,
    over: bool,
}

impl Pulse {
    /// The movement that brings what is lacking, but for how well a person times it.
    pub(super) fn new(lack: &Lack, situation: &Situation, habits: &mut Habits) -> Self {
        let spread = Normal::new(0.0, habits.options.timing_spread.max(0.0)).ok();
        let share = spread.map_or(0.0, |n| n.sample(&mut habits.rng).clamp(-0.4, 0.4));
        let longest = if lack.mode >= FIRST_AXIS { PULSE_MILLIS.1 } else { LONGEST_TURN_MILLIS };
        let meant = lack.amount.abs() / lack.speed * 1e3;
        let missed = (meant * share).clamp(-TIMING_MILLIS, TIMING_MILLIS);
        let millis = (meant + missed).clamp(PULSE_MILLIS.0, longest);
        Self {
            mode: lack.mode,
            gesture: lack.gesture,
            millis: millis as u64,
            before: (situation.seen.joints.clone(), situation.base_from_tip()),
            amount: millis * 1e-3 * lack.speed,
            began: None,
            over: false,
        }
    }

    /// Mode and gesture of the movement.
    pub(super) fn kind(&self) -> (u8, Gesture) {
        (self.mode, self.gesture)
    }

    /// The gesture to make; none once the movement is over.
    pub(super) fn gesture(&self) -> Option<Gesture> {
        (!self.over).then_some(self.gesture)
    }

    /// Goes on while the hand makes `made`, until the time is over or the display refuses it; true at the end.
    pub(super) fn go_on(&mut self, now: SimTime, seen: &DisplayFrame, made: Gesture) -> bool {
        if made != self.gesture {
            return false;
        }
        let began = *self.began.get_or_insert(now);
        // What is seen is as old as the reaction time: a refusal counts if it belongs to this movement.
        let refused = seen.gesture == self.gesture
            && seen.time > began
            && matches!(seen.planner, PlannerView::Failed { .. });
        let ends = refused || now.millis_since(began) >= self.millis;
        self.over |= ends;
        ends
    }

    /// True if it brought too little: it has met something.
    pub(super) fn fell_short(&self, situation: &Situation) -> bool {
        let (q, tip) = &self.before;
        let base_from_tip = situation.base_from_tip();
        let grasp_centre = situation.sense.grasp_centre(situation.width());
        let moved = match self.mode {
            joint if joint < FIRST_AXIS => situation.seen.joints[usize::from(joint)] - q[usize::from(joint)],
            axis if axis < FIRST_AXIS + 3 => (base_from_tip * grasp_centre - tip * grasp_centre).norm(),
            _ => base_from_tip.rotation.angle_to(&tip.rotation),
        };
        let short = self.amount - moved.abs();
        short > (1.0 - LEAST_PROGRESS) * self.amount || (self.mode < FIRST_AXIS && short > TOUCHED)
    }
}
