//! Batches: many trials with simulated participants, in programs of their own, on one machine or many.
//!
//! A [`Batch`] is a list of trials in a stated order that follows from its description alone. Each trial ends as one line in the file
//! of its [`Shard`], written as it ends; [`merge_shards`] puts the lines in order. What comes out is therefore the same, byte for byte,
//! whatever ran beside what, where, and how often it was killed in between.

mod description;
mod folder;
mod merge;
mod run;
mod slurm;
mod sweep;
mod trial_list;

pub use description::{BatchDescription, BatchError};
pub(crate) use folder::DESCRIPTION;
pub use folder::{BatchFolder, Shard, ShardFile};
pub use merge::{MergedBatch, merge_shards};
pub use run::{BatchRunOptions, ConditionSummary, ScoreTally, run_batch};
pub use slurm::{SlurmJob, submit};
pub use sweep::Sweep;
pub(crate) use trial_list::label;
pub use trial_list::{Batch, BatchTrial, MethodsBatch};

/// What every output of a batch says.
pub const SIMULATED_DISCLAIMER: &str = "Simulated participants: no evidence about people.";
