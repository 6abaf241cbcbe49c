use serde::{Deserialize, Serialize};
use std::{fmt, str::FromStr};

/// What a control method can be told by hand: its commands, named after the gestures that give them in the paper.
///
/// The gestures that an EMG model tells apart are its own ([`crate::Gesture`]);
/// [`crate::CommandMap`] makes commands of them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
#[serde(rename_all = "snake_case")]
pub enum Command {
    /// HC: closes the prosthetic hand (toggles it in methods A and B).
    HandClose,
    /// HO: cycles through joints or axes (A, B), opens the hand (C, D).
    HandOpen,
    /// NM, a relaxed hand: stops the arm.
    #[default]
    NoMotion,
    /// WE: moves in the positive direction (A, B), executes (C, D).
    WristExtension,
    /// WF: moves in the negative direction (A, B), locks (C, D).
    WristFlexion,
}

impl Command {
    /// All five in LibEMG's class order, which is alphabetical: class `k` is `ALL[k]`.
    pub const ALL: [Command; 5] = [
        Command::HandClose,
        Command::HandOpen,
        Command::NoMotion,
        Command::WristExtension,
        Command::WristFlexion,
    ];

    /// The text published on `/emg`.
    pub fn ros_name(self) -> &'static str {
        match self {
            Command::HandClose => "hand_close",
            Command::HandOpen => "hand_open",
            Command::NoMotion => "no_motion",
            Command::WristExtension => "wrist_extension",
            Command::WristFlexion => "wrist_flexion",
        }
    }

    /// Position in [`Command::ALL`].
    pub fn index(self) -> usize {
        self as usize
    }
}

impl fmt::Display for Command {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.ros_name())
    }
}

/// The text is none of the five gesture names.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "gesture {0:?} is unknown; expected hand_close, hand_open, no_motion, wrist_extension or wrist_flexion"
)]
pub struct UnknownCommand(pub String);

impl FromStr for Command {
    type Err = UnknownCommand;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        Command::ALL.into_iter().find(|g| g.ros_name() == text).ok_or_else(|| UnknownCommand(text.to_owned()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gestures_survive_their_names_and_foreign_words_are_refused_with_the_list() {
        for (k, command) in Command::ALL.into_iter().enumerate() {
            assert_eq!(command.ros_name().parse(), Ok(command));
            assert_eq!(command.index(), k);
        }
        let error = "wave".parse::<Command>().expect_err("not one of the five");
        assert!(
            error.to_string().contains("\"wave\"") && error.to_string().contains("wrist_flexion"),
            "{error}"
        );
    }
}
