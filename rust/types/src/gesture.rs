use crate::Command;
use arrayvec::ArrayString;
use serde::{Deserialize, Serialize};
use std::{fmt, str::FromStr};

/// Most gestures that one classifier may tell apart.
pub const MAX_GESTURES: usize = 64;

/// The name of a gesture that an EMG model tells apart: any text, unlike [`Command`], which is what a method takes.
///
/// Not empty, at most [`Gesture::MAX_BYTES`] bytes, no control characters, no space at either end. Lives on the
/// stack, so that the EMG stage can hand it on without an allocation.
#[derive(Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
#[cfg_attr(feature = "ts", ts(type = "string"))]
#[serde(try_from = "String", into = "String")]
pub struct Gesture(ArrayString<{ Gesture::MAX_BYTES }>);

impl Gesture {
    /// Longest name, bytes of UTF-8.
    pub const MAX_BYTES: usize = 64;

    /// The name as text.
    pub fn as_str(&self) -> &str {
        &self.0
    }

    /// The command of the same name; none for a gesture that only a model knows.
    pub fn same_named_command(self) -> Option<Command> {
        self.as_str().parse().ok()
    }
}

impl Default for Gesture {
    /// The relaxed hand of the five: `no_motion`.
    fn default() -> Self {
        Command::NoMotion.into()
    }
}

impl fmt::Debug for Gesture {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Debug::fmt(self.as_str(), f)
    }
}

impl fmt::Display for Gesture {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.as_str())
    }
}

/// The text cannot be the name of a gesture.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "{:?} cannot be the name of a gesture; expected 1 to {} bytes without control characters, no space at either end",
    .0.chars().take(80).collect::<String>(), Gesture::MAX_BYTES
)]
pub struct InvalidGesture(pub String);

impl FromStr for Gesture {
    type Err = InvalidGesture;

    fn from_str(text: &str) -> Result<Self, InvalidGesture> {
        let bad = || InvalidGesture(text.to_owned());
        if text.is_empty() || text.trim() != text || text.chars().any(char::is_control) {
            return Err(bad());
        }
        ArrayString::from(text).map(Gesture).map_err(|_| bad())
    }
}

impl TryFrom<String> for Gesture {
    type Error = InvalidGesture;

    fn try_from(text: String) -> Result<Self, InvalidGesture> {
        text.parse()
    }
}

impl From<Gesture> for String {
    fn from(name: Gesture) -> String {
        name.as_str().to_owned()
    }
}

impl From<Command> for Gesture {
    fn from(command: Command) -> Self {
        let mut name = ArrayString::new();
        // Names of commands are short; the test below holds them to it.
        name.push_str(command.ros_name());
        Gesture(name)
    }
}

impl PartialEq<Command> for Gesture {
    fn eq(&self, other: &Command) -> bool {
        self.as_str() == other.ros_name()
    }
}

impl PartialEq<Gesture> for Command {
    fn eq(&self, other: &Gesture) -> bool {
        other == self
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_come_back_from_json_and_are_those_of_the_commands_where_they_agree() {
        for gesture in Command::ALL {
            let name = Gesture::from(gesture);
            assert_eq!(
                (name, name.same_named_command()),
                (gesture.ros_name().parse().unwrap(), Some(gesture))
            );
            assert_eq!(name, gesture);
        }
        // The order of names is that of the five's numbers.
        assert!(Command::ALL.map(Gesture::from).is_sorted());
        let pinch: Gesture = serde_json::from_str("\"Pinch grip é\"").unwrap();
        assert_eq!((pinch.as_str(), pinch.same_named_command()), ("Pinch grip é", None));
        assert_eq!(serde_json::to_string(&pinch).unwrap(), "\"Pinch grip é\"");
        assert_eq!(Gesture::default(), Command::NoMotion);
    }

    #[test]
    fn what_cannot_be_shown_or_kept_is_no_name() {
        let long = "x".repeat(Gesture::MAX_BYTES);
        assert!(long.parse::<Gesture>().is_ok());
        for text in ["", " fist", "fist ", "fi\nst", "\u{7f}", &(long + "x")] {
            let error = text.parse::<Gesture>().unwrap_err().to_string();
            assert!(error.contains("expected 1 to 64 bytes"), "{error}");
            assert!(serde_json::from_value::<Gesture>(text.into()).is_err(), "{text:?}");
        }
    }
}
