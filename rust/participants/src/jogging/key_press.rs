//! One movement: how long it is to be, when it is over, and what it brought.

use super::{FIRST_AXIS_MODE, decision_context::DecisionContext, movement::ModeError};
use crate::sensorimotor::SensorimotorModel;
use proact_types::{Command, JointVector, ModeView, PlannerView, Pose, SimTime};
use rand_distr::{Distribution, Normal};

/// No movement gesture is held shorter or longer than this, ms: three decisions, and a look in between.
const KEY_PRESS_RANGE_MS: (f64, f64) = (150.0, 2500.0);
/// A joint is turned all the way at once.
const MAX_TURN_MS: f64 = 8000.0;
/// A long movement is followed with the eye and ended this near to the moment that was meant, ms.
const VISUAL_TIMING_SD_MS: f64 = 50.0;
/// A movement that gives less than this share of what it should has met something.
const MIN_PROGRESS: f64 = 0.4;
/// ... and so has a joint that stops this much short of where it was turned, rad.
const CONTACT_SHORTFALL_RAD: f64 = 0.06;

/// From the muscles' letting go to the end of the motion, beside the person's own reaction, ms: three decisions and a ramp.
const SYSTEM_DELAY_MS: f64 = 200.0;
/// Who ends a movement by sight judges its speed once it was seen for this long, ms ...
const SPEED_ESTIMATE_MS: u64 = 250;
/// ... and gives it up when it takes this many times as long as was thought, and a moment more, ms.
const GIVE_UP_FACTOR_AND_MS: (f64, f64) = (2.0, 700.0);
/// A joint or an axis that has gone this far the wrong way is seen to, rad, metres.
const WRONG_DIRECTION_RAD: f64 = 0.05;
const WRONG_DIRECTION_M: f64 = 0.01;

/// A movement gesture of a length that was decided before it began.
#[derive(Clone, Debug)]
pub(super) struct KeyPress {
    error: ModeError,
    /// The gesture is the one that was meant.
    is_intended_direction: bool,
    command: Command,
    millis: u64,
    /// The end is chosen by what is seen, if the movement lasts long enough to be seen.
    visual_stop: Option<VisualStop>,
    /// Where the arm was before: arm angles, or the hand's place and attitude.
    start_pose: (JointVector, Pose),
    /// What it should bring, in the unit of its speed.
    expected_amount: f64,
    started_at: Option<SimTime>,
    is_over: bool,
}

/// How a movement is ended that is followed with the eye.
#[derive(Clone, Copy, Debug)]
struct VisualStop {
    /// What it is to bring, as it is imagined, in the unit of its speed.
    intended_amount: f64,
    /// For how long before the end the hand lets go, ms: the delay that is known of.
    anticipation_ms: f64,
    /// It is given up after this long, ms.
    timeout_ms: u64,
}

impl KeyPress {
    /// The movement that brings what is lacking, but for how well a person times it and knows the `mode` that the display
    /// shows.
    pub(super) fn new(
        mode_error: &ModeError,
        mode: &ModeView,
        context: &DecisionContext,
        sensorimotor: &mut SensorimotorModel,
    ) -> Self {
        let spread = Normal::new(0.0, sensorimotor.options.timing_relative_sd.max(0.0)).ok();
        let share = spread.map_or(0.0, |n| n.sample(&mut sensorimotor.rng).clamp(-0.4, 0.4));
        let max_ms = if mode_error.mode >= FIRST_AXIS_MODE { KEY_PRESS_RANGE_MS.1 } else { MAX_TURN_MS };
        let speed = sensorimotor.skill.speed(mode_error.mode, mode_error.speed);
        let imagined = sensorimotor.skill.predicted_amount(mode_error.error.abs());
        let intended_ms = imagined / speed * 1e3;
        let missed = (intended_ms * share).clamp(-VISUAL_TIMING_SD_MS, VISUAL_TIMING_SD_MS);
        let delay = sensorimotor.options.reaction_ms as f64 + SYSTEM_DELAY_MS;
        let anticipation = sensorimotor.options.person.anticipation;
        let late = (1.0 - anticipation) * delay;
        let millis = (intended_ms + missed + late).clamp(KEY_PRESS_RANGE_MS.0, max_ms);
        let extends = (mode_error.error > 0.0) == (mode.we_sign >= 0);
        let right = sensorimotor.skill.starts_in_intended_direction(mode_error.mode);
        let seen_to_move = intended_ms > delay + SPEED_ESTIMATE_MS as f64;
        let by_sight = (sensorimotor.options.person.visual_stop && seen_to_move).then(|| VisualStop {
            intended_amount: imagined * (1.0 + missed / intended_ms),
            anticipation_ms: anticipation * delay,
            timeout_ms: (GIVE_UP_FACTOR_AND_MS.0 * intended_ms + GIVE_UP_FACTOR_AND_MS.1).min(MAX_TURN_MS)
                as u64,
        });
        // What is not held for a time that was thought of brings what is meant.
        let amount = if by_sight.is_some() { imagined } else { millis * 1e-3 * speed };
        Self {
            error: *mode_error,
            is_intended_direction: right,
            command: if extends == right { Command::WristExtension } else { Command::WristFlexion },
            millis: millis as u64,
            visual_stop: by_sight,
            start_pose: (context.frame.joints.clone(), context.base_from_tip()),
            expected_amount: amount,
            started_at: None,
            is_over: false,
        }
    }

    /// Mode and side of the movement.
    pub(super) fn direction(&self) -> (u8, bool) {
        self.error.direction()
    }

    /// The gesture to make; none once the movement is over.
    pub(super) fn command(&self) -> Option<Command> {
        (!self.is_over).then_some(self.command)
    }

    /// Goes on while the hand makes `made`, until the time is over, the display refuses it, or it is seen to go the wrong
    /// way; true at the end.
    pub(super) fn continue_press(&mut self, now: SimTime, context: &DecisionContext, made: Command) -> bool {
        if made != self.command {
            return false;
        }
        let seen = context.frame;
        let began = *self.started_at.get_or_insert(now);
        // What is seen is as old as the reaction time: a refusal counts if it belongs to this movement.
        let refused = seen.command == self.command
            && seen.time > began
            && matches!(seen.planner, PlannerView::Failed { .. });
        let wrong = if self.is_translation() { WRONG_DIRECTION_M } else { WRONG_DIRECTION_RAD };
        let ends = refused
            || self.is_time_to_release(now, began, context)
            || (!self.is_intended_direction && self.progress(context) < -wrong);
        self.is_over |= ends;
        ends
    }

    /// Whether it is time to let go: after so long as was thought, or when what is seen will have come far enough by the time the
    /// motion stops.
    fn is_time_to_release(&self, now: SimTime, began: SimTime, context: &DecisionContext) -> bool {
        let held = now.millis_since(began);
        let Some(VisualStop { intended_amount, anticipation_ms: ahead_millis, timeout_ms: timeout_millis }) =
            self.visual_stop
        else {
            return held >= self.millis;
        };
        let seen = context.frame.time.millis_since(began).saturating_sub(SYSTEM_DELAY_MS as u64);
        if seen < SPEED_ESTIMATE_MS {
            return false;
        }
        let gone = self.progress(context).max(0.0);
        held >= timeout_millis || gone + gone / seen as f64 * ahead_millis >= intended_amount
    }

    fn is_translation(&self) -> bool {
        (FIRST_AXIS_MODE..FIRST_AXIS_MODE + 3).contains(&self.error.mode)
    }

    /// How far it has gone the way that was meant, in the unit of its speed; negative the other way.
    fn progress(&self, context: &DecisionContext) -> f64 {
        let (q, tip) = &self.start_pose;
        let base_from_tip = context.base_from_tip();
        let grasp_center = context.sense.grasp_center(context.grip_width_m());
        let mode = usize::from(self.error.mode);
        let moved = if self.error.mode < FIRST_AXIS_MODE {
            context.frame.joints[mode] - q[mode]
        } else if self.is_translation() {
            let axis = mode - usize::from(FIRST_AXIS_MODE);
            (base_from_tip * grasp_center - tip * grasp_center)[axis]
        } else {
            let axis = mode - usize::from(FIRST_AXIS_MODE) - 3;
            (base_from_tip.rotation * tip.rotation.inverse()).scaled_axis()[axis]
        };
        moved * self.error.error.signum()
    }

    /// What it brought of what it should have, as a share; negative if it went the other way.
    pub(super) fn progress_share(&self, context: &DecisionContext) -> f64 {
        self.progress(context) / self.expected_amount
    }

    /// True if it brought too little: it has met something.
    pub(super) fn was_blocked(&self, context: &DecisionContext) -> bool {
        let (q, tip) = &self.start_pose;
        let base_from_tip = context.base_from_tip();
        let grasp_center = context.sense.grasp_center(context.grip_width_m());
        let moved = match self.error.mode {
            joint if joint < FIRST_AXIS_MODE => {
                context.frame.joints[usize::from(joint)] - q[usize::from(joint)]
            }
            axis if axis < FIRST_AXIS_MODE + 3 => (base_from_tip * grasp_center - tip * grasp_center).norm(),
            _ => base_from_tip.rotation.angle_to(&tip.rotation),
        };
        let short = self.expected_amount - moved.abs();
        short > (1.0 - MIN_PROGRESS) * self.expected_amount
            || (self.error.mode < FIRST_AXIS_MODE && short > CONTACT_SHORTFALL_RAD)
    }
}
