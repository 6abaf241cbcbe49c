//! What a batch is, as its folder has it: another batch does not go into the same folder.

use proact_recording::sha256_of_bytes;
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
    #[serde(rename = "people")]
    pub participant_kind: String,
    /// How many.
    pub participants: usize,
    /// Draws them.
    pub seed: u64,
    /// How many trials.
    pub trials: usize,
    /// Into so many shards they are divided.
    pub shards: usize,
    /// Hash of the configurations of the first trials of all conditions in all cells.
    #[serde(rename = "configurations")]
    pub config_hash: String,
    /// What the trials are no evidence of.
    pub note: String,
}

/// Why a folder of a batch is of no use.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BatchError {
    /// It has another batch.
    #[error("{} holds a batch of other {what}: {found}, and this one has {requested}; name another folder with --out", dir.display())]
    Mismatch {
        /// The folder.
        dir: PathBuf,
        /// Of what.
        what: &'static str,
        /// What the folder's has.
        found: String,
        /// What was asked for.
        requested: String,
    },
    /// It has something else.
    #[error("{} is not empty, and holds no batch; name another folder with --out", dir.display())]
    NotEmpty {
        /// The folder.
        dir: PathBuf,
    },
    /// It holds no batch.
    #[error("{} holds no batch: there is no {file} in it; run proact simulate with --out first", dir.display())]
    NotABatch {
        /// The folder.
        dir: PathBuf,
        /// What is missing.
        file: &'static str,
    },
    /// Somebody else writes there.
    #[error("{} is being written by another program; wait for it, or end it", path.display())]
    Locked {
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
    /// The first thing in which `self`, that of the folder, differs from `requested`: what, and both values.
    pub(super) fn difference(&self, requested: &Self) -> Option<(&'static str, String, String)> {
        let pairs = [
            ("program version", self.program.clone(), requested.program.clone()),
            ("trials", self.source.clone(), requested.source.clone()),
            ("conditions", self.conditions.join(", "), requested.conditions.join(", ")),
            ("varied values", self.vary.join(" "), requested.vary.join(" ")),
            ("people", self.participant_kind.clone(), requested.participant_kind.clone()),
            ("participants", self.participants.to_string(), requested.participants.to_string()),
            ("seed", self.seed.to_string(), requested.seed.to_string()),
            ("number of trials", self.trials.to_string(), requested.trials.to_string()),
            ("number of shards", self.shards.to_string(), requested.shards.to_string()),
            ("configuration", self.config_hash.clone(), requested.config_hash.clone()),
        ];
        pairs.into_iter().find(|(_, has, requested)| has != requested)
    }
}

/// One hash of many texts.
pub(super) fn values_hash(texts: &[String]) -> String {
    let hashes: Vec<String> = texts.iter().map(|text| sha256_of_bytes(text.as_bytes())).collect();
    sha256_of_bytes(hashes.join("\n").as_bytes())
}
