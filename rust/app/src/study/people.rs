//! Who simulated participants are: the one place that turns a person and what that person has done before into values of a trial's
//! configuration.

use serde::{Deserialize, Serialize};
use std::{fmt, str::FromStr};

/// Which kind of simulated participant.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum People {
    /// One who sees late and blinks, and otherwise does what is best: the participant of `proact demo`.
    #[default]
    Competent,
}

impl People {
    /// Names of all kinds.
    pub const NAMES: [&str; 1] = ["competent"];
}

impl FromStr for People {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        match name {
            "competent" => Ok(Self::Competent),
            _ => Err(format!("there are no people called {name:?}, expected {}", Self::NAMES.join(", "))),
        }
    }
}

impl fmt::Display for People {
    fn fmt(&self, to: &mut fmt::Formatter<'_>) -> fmt::Result {
        to.write_str(match self {
            Self::Competent => "competent",
        })
    }
}

/// What a person has done before a trial.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TrialHistory {
    /// Trials under the same condition.
    pub same_condition: usize,
    /// Trials in all.
    pub trials: usize,
    /// Since the session began, minutes, by the plan.
    pub minutes: f64,
    /// Number of the session, from 1.
    pub session: usize,
}

/// Values of the configuration of a trial of person `index` (from 1) among those that `master_seed` draws, as `--set` takes them.
pub fn person_values(
    people: People,
    _master_seed: u64,
    _index: usize,
    _history: &TrialHistory,
) -> Vec<String> {
    match people {
        // They differ by the seed of the trial alone.
        People::Competent => Vec::new(),
    }
}
