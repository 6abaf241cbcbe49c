use crate::jog::DoubleConfirmation;
use crate::{ControlError, ControlInput, HandCommand};
use proact_types::{DegreeOfFreedom, Drives, HandState, MAX_DRIVES, ModeView, SimTime};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// What stands for the hand in [`Simultaneous::drives`].
const HAND: &str = "hand";

/// Simultaneous, proportional control with methods A and B: each degree of freedom of a regressor moves a joint, an axis or
/// the hand, all at the same time, at its drive times the method's speed. There is nothing to cycle through.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Simultaneous {
    /// The hand opens, or closes, when its drive goes over this, 0 to 1.
    #[serde(default = "Simultaneous::default_hand_on_threshold")]
    pub hand_on_threshold: f64,
    /// It takes the next command when its drive has been below this, 0 to `hand_on_threshold`.
    #[serde(default = "Simultaneous::default_hand_off_threshold")]
    pub hand_off_threshold: f64,
    /// What each degree of freedom moves: a joint of the arm (method A), `x` `y` `z` along or `rx` `ry` `rz` about an axis of
    /// `end_effector_jog.axes` (method B), or `hand`. A positive drive moves as WE does, and opens the hand.
    pub drives: BTreeMap<DegreeOfFreedom, String>,
}

impl Simultaneous {
    fn default_hand_on_threshold() -> f64 {
        0.5
    }

    fn default_hand_off_threshold() -> f64 {
        0.3
    }

    /// The degrees of freedom in the order of [`ControlInput::drives`].
    pub fn degrees_of_freedom(&self) -> impl Iterator<Item = DegreeOfFreedom> {
        self.drives.keys().copied()
    }

    /// What is moved beside the hand, in the order of [`ControlInput::drives`].
    pub(crate) fn driven_names(&self) -> impl Iterator<Item = &String> {
        self.drives.values().filter(|moves| *moves != HAND)
    }

    pub(crate) fn check(&self) -> Result<(), ControlError> {
        let refused = |key, got, expected| Err(ControlError::Value { key, got, expected });
        if !(0.001..=1.0).contains(&self.hand_on_threshold) {
            return refused("jog.simultaneous.hand_on_threshold", self.hand_on_threshold, "0.001 to 1");
        }
        if !(self.hand_off_threshold >= 0.0 && self.hand_off_threshold < self.hand_on_threshold) {
            let expected = "at least 0 and below jog.simultaneous.hand_on_threshold";
            return refused("jog.simultaneous.hand_off_threshold", self.hand_off_threshold, expected);
        }
        if !(1..=MAX_DRIVES).contains(&self.drives.len()) {
            return refused("number of jog.simultaneous.drives", self.drives.len() as f64, "1 to 8");
        }
        let mut moved = Vec::new();
        for (drive, moves) in &self.drives {
            if moved.contains(&moves) {
                return Err(ControlError::DuplicateDrive { drive: drive.to_string(), moves: moves.clone() });
            }
            moved.push(moves);
        }
        Ok(())
    }
}

/// From drives to what methods A and B move at one step.
#[derive(Clone, Debug)]
pub(crate) struct ProportionalDrives {
    /// Place in [`ControlInput::drives`] of what moves each thing beside the hand.
    drive_indices: Vec<usize>,
    hand_drive: Option<HandDrive>,
    was_moving: bool,
}

/// What drives ask of the arm.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum ProportionalMotion {
    /// Nothing new.
    None,
    /// All drives are zero again.
    Stop,
    /// The share of the method's speed for each thing that is moved, in the order of [`Simultaneous::moved`].
    Shares(Drives),
}

impl ProportionalDrives {
    /// `confirm_open_ms` as in [`crate::JogProfile::Time`].
    pub(crate) fn new(profile: &Simultaneous, confirm_open_ms: u64) -> Self {
        let of = |hand: bool| {
            let drives = profile.drives.values().enumerate();
            drives.filter(move |(_, moves)| (*moves == HAND) == hand).map(|(index, _)| index)
        };
        let hand = of(true).next().map(|index| HandDrive {
            drive_index: index,
            on_threshold: profile.hand_on_threshold,
            off_threshold: profile.hand_off_threshold,
            armed: true,
            confirm: DoubleConfirmation::new(confirm_open_ms),
        });
        Self { drive_indices: of(false).collect(), hand_drive: hand, was_moving: false }
    }

    pub(crate) fn step(
        &mut self,
        now: SimTime,
        input: &ControlInput<'_>,
    ) -> (ProportionalMotion, Option<HandCommand>) {
        let drive = |index: usize| input.drives.get(index).copied().filter(|drive| drive.is_finite());
        let hand = self.hand_drive.as_mut().and_then(|hand| hand.step(now, drive(hand.drive_index)?, input));
        let shares: Drives = self.drive_indices.iter().map(|index| drive(*index).unwrap_or(0.0)).collect();
        let moved = std::mem::replace(&mut self.was_moving, shares.iter().any(|share| *share != 0.0));
        let motion = match (moved, self.was_moving) {
            (_, true) => ProportionalMotion::Shares(shares),
            (true, false) => ProportionalMotion::Stop,
            (false, false) => ProportionalMotion::None,
        };
        (motion, hand)
    }

    /// Seconds left for opening the hand by a second command.
    pub(crate) fn remaining_secs(&self, now: SimTime) -> Option<f64> {
        self.hand_drive.as_ref()?.confirm.remaining_secs(now)
    }
}

/// The hand opens and closes as a whole, at a threshold with hysteresis.
#[derive(Clone, Debug)]
struct HandDrive {
    drive_index: usize,
    on_threshold: f64,
    off_threshold: f64,
    /// It was below since the last command.
    armed: bool,
    confirm: DoubleConfirmation,
}

impl HandDrive {
    fn step(&mut self, now: SimTime, drive: f64, input: &ControlInput<'_>) -> Option<HandCommand> {
        if drive.abs() < self.off_threshold {
            self.armed = true;
        }
        if !self.armed || drive.abs() < self.on_threshold {
            return None;
        }
        self.armed = false;
        let closed = matches!(input.hand.state, HandState::Closed | HandState::Closing);
        let is_requested = closed && input.hand.held_object.is_some() && drive > 0.0;
        match drive > 0.0 {
            true if is_requested && !self.confirm.is_confirmed(now) => None,
            true => Some(HandCommand::Open),
            false => Some(HandCommand::Close),
        }
    }
}

/// What is shown in the place of a selected mode: all that moves, with the directions of the first.
pub(crate) fn all_modes(views: &[ModeView]) -> Option<ModeView> {
    let names: Vec<&str> = views.iter().map(|view| view.name.as_str()).collect();
    views.first().map(|first| ModeView { name: names.join(" + "), ..first.clone() })
}
