//! HO, from one joint or axis to another.

use super::{AXES, FIRST_AXIS};
use crate::{habits::Habits, reach::back_is_shorter};
use proact_types::{Gesture, SimTime};

/// HO is held this long to go one joint or axis on: learnt in practice, so that nobody looks between two of them, ms.
const TAP_MILLIS: u64 = 300;
/// What was done with the last HO is seen this long after the reaction time, ms.
const LOOK_MILLIS: u64 = 100;
/// HO held this long has been understood as the way back, or never will, ms.
const BACK_MILLIS: u64 = 5000;

/// The cycle of modes, gone through with HO.
pub(crate) struct ModeCycle {
    /// Joints that the method drives, and the hand where it is a mode, in the order of the cycle.
    joints: Vec<u8>,
    /// The hand among them.
    hand: Option<u8>,
    turning: Option<Turning>,
}

/// HO on its way to a mode.
#[derive(Clone, Copy, Debug)]
struct Turning {
    to: u8,
    /// HO stays held: the modes go back one by one.
    back: bool,
    /// As often HO has yet to be made.
    taps: usize,
    /// Since when HO is held, or was let go the last time.
    since: Option<SimTime>,
}

impl ModeCycle {
    /// The cycle of an arm of `joints` joints of which the method does not drive the joints `own`, by their positions in the arm.
    pub(crate) fn new(joints: usize, own: &[usize]) -> Self {
        let joints = (0..joints).filter(|joint| !own.contains(joint)).map(|joint| joint as u8).collect();
        Self { joints, hand: None, turning: None }
    }

    /// A cycle of these places of an arm of `joints` joints; the place behind the last joint is the hand.
    pub(crate) fn of(joints: usize, cycle: &[usize]) -> Self {
        let hand = cycle.contains(&joints).then_some(joints as u8);
        Self { joints: cycle.iter().map(|&place| place as u8).collect(), hand, turning: None }
    }

    /// The mode in which WE opens the hand and WF closes it, where `mode` is one of a cycle that has it.
    pub(crate) fn hand(&self, mode: u8) -> Option<u8> {
        self.hand.filter(|_| mode < FIRST_AXIS)
    }

    /// Another stage begins.
    pub(crate) fn begin(&mut self) {
        self.turning = None;
    }

    /// Sets out from one mode to another.
    pub(crate) fn go(&mut self, from: u8, to: u8) {
        let axes: Vec<u8> = (FIRST_AXIS..FIRST_AXIS + AXES).collect();
        let modes = if from < FIRST_AXIS { &self.joints } else { &axes };
        let place = |mode: u8| modes.iter().position(|&other| other == mode).unwrap_or_default();
        let (at, goal) = (place(from), place(to));
        let back = back_is_shorter(at, goal, modes.len());
        self.turning = Some(Turning { to, back, taps: (goal + modes.len() - at) % modes.len(), since: None });
    }

    /// HO goes on until the mode is there: made anew for each step ahead, held for steps back. None if it is there.
    pub(crate) fn go_on(&mut self, now: SimTime, mode: u8, habits: &Habits) -> Option<Gesture> {
        let making = habits.gesture() == Gesture::HandOpen;
        let look_millis = habits.options.relax_ms.max(habits.options.reaction_ms + LOOK_MILLIS);
        let turning = self.turning.as_mut()?;
        let held = turning.since.map_or(0, |since| now.millis_since(since));
        if turning.back {
            if making {
                turning.since.get_or_insert(now);
            }
            if mode != turning.to && held <= BACK_MILLIS {
                return Some(Gesture::HandOpen);
            }
            self.turning = None;
            return Some(Gesture::NoMotion);
        }
        match (turning.taps, making) {
            (0, _) if held < look_millis => Some(Gesture::NoMotion),
            (0, _) => {
                self.turning = None;
                None
            }
            (_, false) => {
                turning.since = None;
                Some(Gesture::HandOpen)
            }
            (_, true) if held < TAP_MILLIS => {
                turning.since.get_or_insert(now);
                Some(Gesture::HandOpen)
            }
            (_, true) => {
                turning.taps -= 1;
                turning.since = Some(now);
                Some(Gesture::NoMotion)
            }
        }
    }
}
