//! HO, from one joint or axis to another.

use super::{AXIS_MODES, FIRST_AXIS_MODE};
use crate::{reach::back_is_shorter, sensorimotor::SensorimotorModel};
use proact_types::{Command, SimTime};

/// HO is held this long to go one joint or axis on: learnt in practice, so that nobody looks between two of them, ms.
const TAP_MILLIS: u64 = 300;
/// What was done with the last HO is seen this long after the reaction time, ms.
const LOOK_MILLIS: u64 = 100;
/// HO held this long has been understood as the way back, or never will, ms.
const MAX_BACK_HOLD_MS: u64 = 5000;

/// The cycle of modes, gone through with HO.
pub(crate) struct ModeCycle {
    /// Joints that the method drives, and the hand where it is a mode, in the order of the cycle.
    joints: Vec<u8>,
    /// The hand among them.
    hand: Option<u8>,
    mode_change: Option<ModeChange>,
}

/// HO on its way to a mode.
#[derive(Clone, Copy, Debug)]
struct ModeChange {
    target_mode: u8,
    /// HO stays held: the modes go back one by one.
    is_backward: bool,
    /// As often HO has yet to be made.
    taps: usize,
    /// Since when HO is held, or was let go the last time.
    since: Option<SimTime>,
}

impl ModeCycle {
    /// The cycle of an arm of `joints` joints of which the method does not drive the joints `own`, by their positions in the arm.
    pub(crate) fn new(joints: usize, own: &[usize]) -> Self {
        let joints = (0..joints).filter(|joint| !own.contains(joint)).map(|joint| joint as u8).collect();
        Self { joints, hand: None, mode_change: None }
    }

    /// A cycle of these places of an arm of `joints` joints; the place behind the last joint is the hand.
    pub(crate) fn of(joints: usize, cycle: &[usize]) -> Self {
        let hand = cycle.contains(&joints).then_some(joints as u8);
        Self { joints: cycle.iter().map(|&index| index as u8).collect(), hand, mode_change: None }
    }

    /// The mode in which WE opens the hand and WF closes it, where `mode` is one of a cycle that has it.
    pub(crate) fn hand(&self, mode: u8) -> Option<u8> {
        self.hand.filter(|_| mode < FIRST_AXIS_MODE)
    }

    /// Another stage begins.
    pub(crate) fn begin(&mut self) {
        self.mode_change = None;
    }

    /// Sets out from one mode to another.
    pub(crate) fn start_change(&mut self, from: u8, to: u8) {
        let axes: Vec<u8> = (FIRST_AXIS_MODE..FIRST_AXIS_MODE + AXIS_MODES).collect();
        let modes = if from < FIRST_AXIS_MODE { &self.joints } else { &axes };
        let mode_index = |mode: u8| modes.iter().position(|&other| other == mode).unwrap_or_default();
        let (at, goal) = (mode_index(from), mode_index(to));
        let back = back_is_shorter(at, goal, modes.len());
        self.mode_change = Some(ModeChange {
            target_mode: to,
            is_backward: back,
            taps: (goal + modes.len() - at) % modes.len(),
            since: None,
        });
    }

    /// HO goes on until the mode is there: made anew for each step ahead, held for steps back. None if it is there.
    pub(crate) fn continue_change(
        &mut self,
        now: SimTime,
        mode: u8,
        sensorimotor: &SensorimotorModel,
    ) -> Option<Command> {
        let making = sensorimotor.command() == Command::HandOpen;
        let observation_millis =
            sensorimotor.options.relax_ms.max(sensorimotor.options.reaction_ms + LOOK_MILLIS);
        let turning = self.mode_change.as_mut()?;
        let held = turning.since.map_or(0, |since| now.millis_since(since));
        if turning.is_backward {
            if making {
                turning.since.get_or_insert(now);
            }
            if mode != turning.target_mode && held <= MAX_BACK_HOLD_MS {
                return Some(Command::HandOpen);
            }
            self.mode_change = None;
            return Some(Command::NoMotion);
        }
        match (turning.taps, making) {
            (0, _) if held < observation_millis => Some(Command::NoMotion),
            (0, _) => {
                self.mode_change = None;
                None
            }
            (_, false) => {
                turning.since = None;
                Some(Command::HandOpen)
            }
            (_, true) if held < TAP_MILLIS => {
                turning.since.get_or_insert(now);
                Some(Command::HandOpen)
            }
            (_, true) => {
                turning.taps -= 1;
                turning.since = Some(now);
                Some(Command::NoMotion)
            }
        }
    }
}
