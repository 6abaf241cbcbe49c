use crate::{Command, Gesture};
use serde::{Deserialize, Serialize};
use std::{fmt, str::FromStr};

/// Most degrees of freedom that one regressor drives.
pub const MAX_DRIVES: usize = 8;

/// How far each degree of freedom is driven, -1 to 1: 1 is the positive gesture made as hard as in the training. Empty
/// where nothing is driven but by gestures.
pub type Drives = arrayvec::ArrayVec<f64, MAX_DRIVES>;

/// A degree of freedom that muscles drive both ways, named by the gestures that do: `wrist_extension/wrist_flexion`.
///
/// Regression and proportional, simultaneous control know degrees of freedom in the place of classes (LibEMG, `EMGRegressor`).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
#[cfg_attr(feature = "ts", ts(type = "string"))]
#[serde(try_from = "String", into = "String")]
pub struct DegreeOfFreedom {
    positive: Gesture,
    negative: Gesture,
}

/// The text names no degree of freedom.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "{:?} is no degree of freedom; expected two different gestures with a / between them, as in wrist_extension/wrist_flexion",
    .0.chars().take(160).collect::<String>()
)]
pub struct InvalidDegreeOfFreedom(pub String);

impl DegreeOfFreedom {
    /// The wrist, by the gestures of the five.
    pub fn wrist() -> Self {
        Self { positive: Command::WristExtension.into(), negative: Command::WristFlexion.into() }
    }

    /// The hand, by the gestures of the five: opening is positive.
    pub fn hand() -> Self {
        Self { positive: Command::HandOpen.into(), negative: Command::HandClose.into() }
    }

    /// The gesture that drives it up to 1.
    pub fn positive(&self) -> Gesture {
        self.positive
    }

    /// The gesture that drives it down to -1.
    pub fn negative(&self) -> Gesture {
        self.negative
    }

    /// Where `gesture` drives it: 1, -1, or 0 if it is neither of the two.
    pub fn target(&self, gesture: Gesture) -> f64 {
        if gesture == self.positive {
            1.0
        } else if gesture == self.negative {
            -1.0
        } else {
            0.0
        }
    }
}

impl fmt::Display for DegreeOfFreedom {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(&format!("{}/{}", self.positive, self.negative))
    }
}

impl FromStr for DegreeOfFreedom {
    type Err = InvalidDegreeOfFreedom;

    fn from_str(text: &str) -> Result<Self, InvalidDegreeOfFreedom> {
        let bad = || InvalidDegreeOfFreedom(text.to_owned());
        let (positive, negative) = text.split_once('/').ok_or_else(bad)?;
        let name = |text: &str| text.parse::<Gesture>().map_err(|_| bad());
        let (positive, negative) = (name(positive)?, name(negative)?);
        // A second stroke would leave open where the first name ends.
        if positive == negative || negative.as_str().contains('/') {
            return Err(bad());
        }
        Ok(Self { positive, negative })
    }
}

impl TryFrom<String> for DegreeOfFreedom {
    type Error = InvalidDegreeOfFreedom;

    fn try_from(text: String) -> Result<Self, InvalidDegreeOfFreedom> {
        text.parse()
    }
}

impl From<DegreeOfFreedom> for String {
    fn from(of: DegreeOfFreedom) -> String {
        of.to_string()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn degrees_of_freedom_are_pairs_of_different_gestures() {
        let wrist: DegreeOfFreedom = "wrist_extension/wrist_flexion".parse().unwrap();
        assert_eq!(wrist, DegreeOfFreedom::wrist());
        assert_eq!(serde_json::to_string(&wrist).unwrap(), "\"wrist_extension/wrist_flexion\"");
        let targets = [Command::WristExtension, Command::WristFlexion, Command::NoMotion];
        assert_eq!(targets.map(|gesture| wrist.target(gesture.into())), [1.0, -1.0, 0.0]);
        for text in ["", "wrist", "a/", "/a", "a/a", "a/b/c", "a /b", "a/\n"] {
            let error = text.parse::<DegreeOfFreedom>().unwrap_err().to_string();
            assert!(error.contains("two different gestures"), "{error}");
        }
    }
}
