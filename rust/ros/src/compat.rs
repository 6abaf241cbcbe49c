//! Quirks of the original that can be brought back one by one, to compare with recordings of it.

use std::{collections::BTreeSet, str::FromStr};

/// A quirk of the original's topics.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum CompatOption {
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

impl CompatOption {
    /// All of them.
    pub const ALL: [CompatOption; 5] = [
        CompatOption::SlowPoses,
        CompatOption::BarePoses,
        CompatOption::ResentConstants,
        CompatOption::HeadQuaternion,
        CompatOption::GraspSucceeds,
    ];

    /// Its word in the parameter.
    pub fn name(self) -> &'static str {
        match self {
            CompatOption::SlowPoses => "slow_poses",
            CompatOption::BarePoses => "bare_poses",
            CompatOption::ResentConstants => "resent_constants",
            CompatOption::HeadQuaternion => "head_quaternion",
            CompatOption::GraspSucceeds => "grasp_succeeds",
        }
    }
}

/// The quirks that are on; none by default.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct CompatOptions(BTreeSet<CompatOption>);

impl CompatOptions {
    /// Whether a quirk is on.
    pub fn has(&self, option: CompatOption) -> bool {
        self.0.contains(&option)
    }
}

/// A word that names no quirk.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{got:?} is no quirk, expected words with commas between them: {}", CompatOption::ALL.map(CompatOption::name).join(", "))]
pub struct UnknownCompatOption {
    /// The word.
    got: String,
}

impl FromStr for CompatOptions {
    type Err = UnknownCompatOption;

    /// Words with commas between them; an empty text is no quirk.
    fn from_str(text: &str) -> Result<Self, UnknownCompatOption> {
        let words = text.split(',').map(str::trim).filter(|word| !word.is_empty());
        let option = |word: &str| {
            let found = CompatOption::ALL.into_iter().find(|option| option.name() == word);
            found.ok_or_else(|| UnknownCompatOption { got: word.to_owned() })
        };
        words.map(option).collect::<Result<_, _>>().map(CompatOptions)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_with_commas_switch_single_quirks_on() {
        let some: CompatOptions = "slow_poses, grasp_succeeds".parse().unwrap();
        let on: Vec<CompatOption> =
            CompatOption::ALL.into_iter().filter(|option| some.has(*option)).collect();
        assert_eq!(on, [CompatOption::SlowPoses, CompatOption::GraspSucceeds]);
        assert_eq!("".parse(), Ok(CompatOptions::default()));
    }

    #[test]
    fn an_unknown_word_is_refused_with_those_that_are_known() {
        let error = "slow_poses,teapot".parse::<CompatOptions>().unwrap_err().to_string();
        assert!(error.contains("teapot") && error.contains("bare_poses"), "{error}");
    }
}
