//! HO, from one joint or axis to another.

use super::{AXES, FIRST_AXIS, JOINTS, JoggingParticipant};
use crate::reach::back_is_shorter;
use proact_types::{Gesture, SimTime};

/// HO is held this long to go one joint or axis on: learnt in practice, so that nobody looks between two of them, ms.
const TAP_MILLIS: u64 = 300;
/// What was done with the last HO is seen this long after the reaction time, ms.
const LOOK_MILLIS: u64 = 100;
/// HO held this long has been understood as the way back, or never will, ms.
const BACK_MILLIS: u64 = 5000;

/// HO on its way to a mode.
#[derive(Clone, Copy, Debug)]
pub(super) struct Turning {
    to: u8,
    /// HO stays held: the modes go back one by one.
    back: bool,
    /// As often HO has yet to be made.
    taps: usize,
    /// Since when HO is held, or was let go the last time.
    since: Option<SimTime>,
}

impl JoggingParticipant {
    /// The way from one mode to another.
    pub(super) fn way_to(&self, from: u8, to: u8) -> Turning {
        let modes: Vec<u8> = match from {
            joint if joint < FIRST_AXIS => {
                (0..JOINTS).filter(|&joint| !self.limb.has(joint.into())).collect()
            }
            _ => (FIRST_AXIS..FIRST_AXIS + AXES).collect(),
        };
        let place = |mode: u8| modes.iter().position(|&other| other == mode).unwrap_or_default();
        let (at, goal) = (place(from), place(to));
        let back = back_is_shorter(at, goal, modes.len());
        Turning { to, back, taps: (goal + modes.len() - at) % modes.len(), since: None }
    }

    /// HO goes on until the mode is there: made anew for each step ahead, held for steps back.
    pub(super) fn turn_on(&mut self, now: SimTime, mode: u8) -> Option<Gesture> {
        let making = self.habits.gesture() == Gesture::HandOpen;
        let look_millis = self.habits.options.relax_ms.max(self.habits.options.reaction_ms + LOOK_MILLIS);
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
