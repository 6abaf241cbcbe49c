//! One movement: how long it is to be, when it is over, and what it brought.

use super::{FIRST_AXIS, movement::Lack, situation::Situation};
use crate::habits::Habits;
use proact_types::{Gesture, JointVector, ModeView, PlannerView, Pose, SimTime};
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

/// From the muscles' letting go to the end of the motion, beside the person's own reaction, ms: three decisions and a ramp.
const MACHINE_MILLIS: f64 = 200.0;
/// Who ends a movement by sight judges its speed once it was seen for this long, ms ...
const JUDGED_MILLIS: u64 = 250;
/// ... and gives it up when it takes this many times as long as was thought, and a moment more, ms.
const PATIENCE: (f64, f64) = (2.0, 700.0);
/// A joint or an axis that has gone this far the wrong way is seen to, rad, metres.
const WRONG_TURN: f64 = 0.05;
const WRONG_SHIFT: f64 = 0.01;

/// A movement gesture of a length that was decided before it began.
#[derive(Clone, Debug)]
pub(super) struct Pulse {
    lack: Lack,
    /// The gesture is the one that was meant.
    right: bool,
    gesture: Gesture,
    millis: u64,
    /// The end is chosen by what is seen, if the movement lasts long enough to be seen.
    by_sight: Option<BySight>,
    /// Where the arm was before: arm angles, or the hand's place and attitude.
    before: (JointVector, Pose),
    /// What it should bring, in the unit of its speed.
    amount: f64,
    began: Option<SimTime>,
    over: bool,
}

/// How a movement is ended that is followed with the eye.
#[derive(Clone, Copy, Debug)]
struct BySight {
    /// What it is to bring, as it is imagined, in the unit of its speed.
    meant: f64,
    /// For how long before the end the hand lets go, ms: the delay that is known of.
    ahead_millis: f64,
    /// It is given up after this long, ms.
    patience_millis: u64,
}

impl Pulse {
    /// The movement that brings what is lacking, but for how well a person times it and knows the `mode` that the display
    /// shows.
    pub(super) fn new(lack: &Lack, mode: &ModeView, situation: &Situation, habits: &mut Habits) -> Self {
        let spread = Normal::new(0.0, habits.options.timing_spread.max(0.0)).ok();
        let share = spread.map_or(0.0, |n| n.sample(&mut habits.rng).clamp(-0.4, 0.4));
        let longest = if lack.mode >= FIRST_AXIS { PULSE_MILLIS.1 } else { LONGEST_TURN_MILLIS };
        let speed = habits.skill.speed(lack.mode, lack.speed);
        let imagined = habits.skill.imagined(lack.amount.abs());
        let meant = imagined / speed * 1e3;
        let missed = (meant * share).clamp(-TIMING_MILLIS, TIMING_MILLIS);
        let delay = habits.options.reaction_ms as f64 + MACHINE_MILLIS;
        let anticipation = habits.options.person.anticipation;
        let late = (1.0 - anticipation) * delay;
        let millis = (meant + missed + late).clamp(PULSE_MILLIS.0, longest);
        let extends = (lack.amount > 0.0) == (mode.we_sign >= 0);
        let right = habits.skill.begins_rightly(lack.mode);
        let seen_to_move = meant > delay + JUDGED_MILLIS as f64;
        let by_sight = (habits.options.person.ends_by_sight && seen_to_move).then(|| BySight {
            meant: imagined * (1.0 + missed / meant),
            ahead_millis: anticipation * delay,
            patience_millis: (PATIENCE.0 * meant + PATIENCE.1).min(LONGEST_TURN_MILLIS) as u64,
        });
        // What is not held for a time that was thought of brings what is meant.
        let amount = if by_sight.is_some() { imagined } else { millis * 1e-3 * speed };
        Self {
            lack: *lack,
            right,
            gesture: if extends == right { Gesture::WristExtension } else { Gesture::WristFlexion },
            millis: millis as u64,
            by_sight,
            before: (situation.seen.joints.clone(), situation.base_from_tip()),
            amount,
            began: None,
            over: false,
        }
    }

    /// Mode and side of the movement.
    pub(super) fn kind(&self) -> (u8, bool) {
        self.lack.kind()
    }

    /// The gesture to make; none once the movement is over.
    pub(super) fn gesture(&self) -> Option<Gesture> {
        (!self.over).then_some(self.gesture)
    }

    /// Goes on while the hand makes `made`, until the time is over, the display refuses it, or it is seen to go the wrong
    /// way; true at the end.
    pub(super) fn go_on(&mut self, now: SimTime, situation: &Situation, made: Gesture) -> bool {
        if made != self.gesture {
            return false;
        }
        let seen = situation.seen;
        let began = *self.began.get_or_insert(now);
        // What is seen is as old as the reaction time: a refusal counts if it belongs to this movement.
        let refused = seen.gesture == self.gesture
            && seen.time > began
            && matches!(seen.planner, PlannerView::Failed { .. });
        let wrong = if self.moves_along() { WRONG_SHIFT } else { WRONG_TURN };
        let ends =
            refused || self.is_time(now, began, situation) || (!self.right && self.gone(situation) < -wrong);
        self.over |= ends;
        ends
    }

    /// Whether it is time to let go: after so long as was thought, or when what is seen will have come far enough by the time the
    /// motion stops.
    fn is_time(&self, now: SimTime, began: SimTime, situation: &Situation) -> bool {
        let held = now.millis_since(began);
        let Some(BySight { meant, ahead_millis, patience_millis }) = self.by_sight else {
            return held >= self.millis;
        };
        let seen = situation.seen.time.millis_since(began).saturating_sub(MACHINE_MILLIS as u64);
        if seen < JUDGED_MILLIS {
            return false;
        }
        let gone = self.gone(situation).max(0.0);
        held >= patience_millis || gone + gone / seen as f64 * ahead_millis >= meant
    }

    fn moves_along(&self) -> bool {
        (FIRST_AXIS..FIRST_AXIS + 3).contains(&self.lack.mode)
    }

    /// How far it has gone the way that was meant, in the unit of its speed; negative the other way.
    fn gone(&self, situation: &Situation) -> f64 {
        let (q, tip) = &self.before;
        let base_from_tip = situation.base_from_tip();
        let grasp_centre = situation.sense.grasp_centre(situation.width());
        let mode = usize::from(self.lack.mode);
        let moved = if self.lack.mode < FIRST_AXIS {
            situation.seen.joints[mode] - q[mode]
        } else if self.moves_along() {
            let axis = mode - usize::from(FIRST_AXIS);
            (base_from_tip * grasp_centre - tip * grasp_centre)[axis]
        } else {
            let axis = mode - usize::from(FIRST_AXIS) - 3;
            (base_from_tip.rotation * tip.rotation.inverse()).scaled_axis()[axis]
        };
        moved * self.lack.amount.signum()
    }

    /// What it brought of what it should have, as a share; negative if it went the other way.
    pub(super) fn share(&self, situation: &Situation) -> f64 {
        self.gone(situation) / self.amount
    }

    /// True if it brought too little: it has met something.
    pub(super) fn fell_short(&self, situation: &Situation) -> bool {
        let (q, tip) = &self.before;
        let base_from_tip = situation.base_from_tip();
        let grasp_centre = situation.sense.grasp_centre(situation.width());
        let moved = match self.lack.mode {
            joint if joint < FIRST_AXIS => situation.seen.joints[usize::from(joint)] - q[usize::from(joint)],
            axis if axis < FIRST_AXIS + 3 => (base_from_tip * grasp_centre - tip * grasp_centre).norm(),
            _ => base_from_tip.rotation.angle_to(&tip.rotation),
        };
        let short = self.amount - moved.abs();
        short > (1.0 - LEAST_PROGRESS) * self.amount || (self.lack.mode < FIRST_AXIS && short > TOUCHED)
    }
}
