//! Quirks of the original that can be brought back one by one, to compare with recordings of it.

use std::{collections::BTreeSet, str::FromStr};

/// A quirk of the original's topics.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Quirk {
    /// The arm's base and the blocks are told to the headset ten times a second only.
    SlowPoses,
    /// These poses do not say what frame they are in.
    BarePoses,
    /// Constant transforms are sent on `/tf` ten times a second, stamped a tenth of a second ahead.
    ResentConstants,
    /// The head's quaternion is w, x, y, z in the places of x, y, z, w.
    HeadQuaternion,
    /// `/grasp` does not listen to cancels: what has begun ends as succeeded.
    GraspSucceeds,
}

impl Quirk {
    /// All of them.
    pub const ALL: [Quirk; 5] = [
        Quirk::SlowPoses,
        Quirk::BarePoses,
        Quirk::ResentConstants,
        Quirk::HeadQuaternion,
        Quirk::GraspSucceeds,
    ];

    /// Its word in the parameter.
    pub fn name(self) -> &'static str {
        match self {
            Quirk::SlowPoses => "slow_poses",
            Quirk::BarePoses => "bare_poses",
            Quirk::ResentConstants => "resent_constants",
            Quirk::HeadQuaternion => "head_quaternion",
            Quirk::GraspSucceeds => "grasp_succeeds",
        }
    }
}

/// The quirks that are on; none by default.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Compat(BTreeSet<Quirk>);

impl Compat {
    /// Whether a quirk is on.
    pub fn has(&self, quirk: Quirk) -> bool {
        self.0.contains(&quirk)
    }
}

/// A word that names no quirk.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{got:?} is no quirk, expected words with commas between them: {}", Quirk::ALL.map(Quirk::name).join(", "))]
pub struct UnknownQuirk {
    /// The word.
    got: String,
}

impl FromStr for Compat {
    type Err = UnknownQuirk;

    /// Words with commas between them; an empty text is no quirk.
    fn from_str(text: &str) -> Result<Self, UnknownQuirk> {
        let words = text.split(',').map(str::trim).filter(|word| !word.is_empty());
        let quirk = |word: &str| {
            let found = Quirk::ALL.into_iter().find(|quirk| quirk.name() == word);
            found.ok_or_else(|| UnknownQuirk { got: word.to_owned() })
        };
        words.map(quirk).collect::<Result<_, _>>().map(Compat)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_with_commas_switch_single_quirks_on() {
        let some: Compat = "slow_poses, grasp_succeeds".parse().unwrap();
        let on: Vec<Quirk> = Quirk::ALL.into_iter().filter(|quirk| some.has(*quirk)).collect();
        assert_eq!(on, [Quirk::SlowPoses, Quirk::GraspSucceeds]);
        assert_eq!("".parse(), Ok(Compat::default()));
    }

    #[test]
    fn an_unknown_word_is_refused_with_those_that_are_known() {
        let error = "slow_poses,teapot".parse::<Compat>().unwrap_err().to_string();
        assert!(error.contains("teapot") && error.contains("bare_poses"), "{error}");
    }
}
