//! What a batch is, as its folder has it: another batch does not go into the same folder.

use proact_recording::hash_of;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// What the trials of a batch follow from.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct BatchDescription {
    /// Version of the program.
    pub program: String,
    /// The plan by its hash, or people and trials of each method.
    pub source: String,
    /// What is compared.
    pub conditions: Vec<String>,
    /// What is varied, as the command line has it.
    pub vary: Vec<String>,
    /// The kind of people.
    pub people: String,
    /// How many.
    pub participants: usize,
    /// Draws them.
    pub seed: u64,
    /// How many trials.
    pub trials: usize,
    /// Into so many shards they are divided.
    pub shards: usize,
    /// Hash of the configurations of the first trials of all conditions in all cells.
    pub configurations: String,
    /// What the trials are no evidence of.
    pub note: String,
}

/// Why a folder of a batch is of no use.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BatchError {
    /// It has another batch.
    #[error("{} holds a batch of other {what}: {has}, and this one has {asked}; name another folder with --out", dir.display())]
    Other {
        /// The folder.
        dir: PathBuf,
        /// Of what.
        what: &'static str,
        /// What the folder's has.
        has: String,
        /// What was asked for.
        asked: String,
    },
    /// It has something else.
    #[error("{} is not empty, and holds no batch; name another folder with --out", dir.display())]
    Foreign {
        /// The folder.
        dir: PathBuf,
    },
    /// It holds no batch.
    #[error("{} holds no batch: there is no {file} in it; run proact simulate with --out first", dir.display())]
    None {
        /// The folder.
        dir: PathBuf,
        /// What is missing.
        file: &'static str,
    },
    /// Somebody else writes there.
    #[error("{} is being written by another program; wait for it, or end it", path.display())]
    Busy {
        /// The file.
        path: PathBuf,
    },
    /// Not all trials are over.
    #[error(
        "{}: {missing} of {trials} trials are missing, of shards {shards}; run these again, and what is there already stays",
        dir.display()
    )]
    Incomplete {
        /// The folder.
        dir: PathBuf,
        /// How many.
        missing: usize,
        /// Of how many.
        trials: usize,
        /// Of which shards, such as `2/4, 3/4`.
        shards: String,
    },
    /// The disk refuses, or a file is none of ours.
    #[error("{}: {reason}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// Why.
        reason: String,
    },
}

impl BatchDescription {
    /// The first thing in which `self`, that of the folder, differs from `asked`: what, and both values.
    pub(super) fn difference(&self, asked: &Self) -> Option<(&'static str, String, String)> {
        let pairs = [
            ("program version", self.program.clone(), asked.program.clone()),
            ("trials", self.source.clone(), asked.source.clone()),
            ("conditions", self.conditions.join(", "), asked.conditions.join(", ")),
            ("varied values", self.vary.join(" "), asked.vary.join(" ")),
            ("people", self.people.clone(), asked.people.clone()),
            ("participants", self.participants.to_string(), asked.participants.to_string()),
            ("seed", self.seed.to_string(), asked.seed.to_string()),
            ("number of trials", self.trials.to_string(), asked.trials.to_string()),
            ("number of shards", self.shards.to_string(), asked.shards.to_string()),
            ("configuration", self.configurations.clone(), asked.configurations.clone()),
        ];
        pairs.into_iter().find(|(_, has, asked)| has != asked)
    }
}

/// One hash of many texts.
pub(super) fn values_hash(texts: &[String]) -> String {
    let hashes: Vec<String> = texts.iter().map(|text| hash_of(text.as_bytes())).collect();
    hash_of(hashes.join("\n").as_bytes())
}
