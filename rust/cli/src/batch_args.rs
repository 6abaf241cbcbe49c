//! How a batch is run: the options that `simulate` and `compare` share.

use crate::{progress::progress_bar, study::worker_command};
use clap::Args;
use proact_app::{
    Registry,
    batch::{
        Batch, BatchFolder, BatchRunOptions, ConditionSummary, MergedBatch, ScoreTally, Shard, ShardFile,
        SlurmJob, merge_shards, run_batch, submit,
    },
    print_status,
    study::ParticipantKind,
};
use proact_study::TrialOptions;
use proact_tasks::DEFAULT_TASK;
use proact_types::Instruction;
use std::{
    error::Error,
    path::{Path, PathBuf},
    sync::atomic::AtomicBool,
};

/// Tasks of a job array where nobody says how many.
const DEFAULT_SLURM_SHARDS: &str = "8";

/// How many programs this machine runs at once.
pub(crate) fn processor_count() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}

/// What the trials of a batch have in common.
#[derive(Debug, Args)]
pub(crate) struct BatchTrialArgs {
    /// The task: a name, or a file that describes one; modified_bbt by default
    #[arg(long, value_name = "NAME|FILE")]
    task: Option<String>,
    /// The arm: a name, or a folder
    #[arg(long, value_name = "NAME|FOLDER")]
    arm: Option<String>,
    /// Where person and box are; seated by default
    #[arg(long)]
    setup: Option<String>,
    /// How the methods behave
    #[arg(long)]
    profile: Option<String>,
    /// Seconds after which a trial ends
    #[arg(long, value_name = "SECONDS")]
    time_limit: Option<f64>,
    /// What people are told to do with the body, free or limit_body; free by default, or as the plan has it
    #[arg(long)]
    instruction: Option<Instruction>,
    /// Another value of the trial configuration; may be repeated
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
}

impl BatchTrialArgs {
    /// The trials where no plan says what they are.
    pub(crate) fn trial_options(&self) -> TrialOptions {
        TrialOptions {
            method: None,
            task: Some(self.task.clone().unwrap_or_else(|| DEFAULT_TASK.to_owned())),
            arm: self.arm.clone(),
            setup: Some(self.setup.clone().unwrap_or_else(|| "seated".to_owned())),
            profile: self.profile.clone(),
            limit_secs: self.time_limit,
            instruction: self.instruction,
            set: self.set.clone(),
        }
    }

    /// What overrules the trials of a plan, which says the rest itself.
    pub(crate) fn plan_overrides(&self) -> TrialOptions {
        TrialOptions {
            limit_secs: self.time_limit,
            instruction: self.instruction,
            set: self.set.clone(),
            ..TrialOptions::default()
        }
    }
}

/// How a batch is run.
#[derive(Debug, Args)]
pub(crate) struct BatchArgs {
    /// The kind of simulated people
    #[arg(long, value_name = "KIND", default_value = ParticipantKind::NAMES[0])]
    pub(crate) participant_kind: ParticipantKind,
    /// Seed of people and trials [default: that of the plan, or 1]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(..=i64::MAX as u64))]
    pub(crate) seed: Option<u64>,
    /// So many trials at once, each in a program of its own; by default one a processor
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=256))]
    jobs: Option<u16>,
    /// Folder for the trials, each a line as it ends; the same command takes it up again where it was cut off
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Only every N-th trial, from the K-th on; the shard that ends last puts all in order
    #[arg(long, value_name = "K/N", requires = "out")]
    shard: Option<Shard>,
    /// Have Slurm run the shards: writes a script for a job array of N tasks into the folder and submits it
    #[arg(long, value_name = "N", num_args = 0..=1, require_equals = true, default_missing_value = DEFAULT_SLURM_SHARDS, requires = "out",
          conflicts_with = "shard", value_parser = clap::value_parser!(u32).range(1..=Shard::MAX_COUNT as i64))]
    slurm: Option<u32>,
    /// An option of sbatch such as --partition=long; may be repeated
    #[arg(long, value_name = "OPTION", requires = "slurm", allow_hyphen_values = true)]
    sbatch_option: Vec<String>,
}

/// What became of a batch.
pub(crate) enum BatchOutcome {
    /// It ran to its end, and nothing was kept but these.
    Summed(Vec<ConditionSummary>, Vec<String>),
    /// It ran to its end, and is in the folder.
    Merged(PathBuf, Box<MergedBatch>),
    /// The shard ran to its end, but others did not yet.
    Shard(PathBuf, Shard, usize),
    /// Slurm has it: the script and the job's number.
    Submitted(PathBuf, String),
    /// It was ended before.
    Interrupted(Option<PathBuf>),
}

impl BatchArgs {
    /// So many trials at once.
    pub(crate) fn jobs(&self) -> usize {
        self.jobs.map_or_else(processor_count, usize::from)
    }

    /// The same with a folder if none was given.
    pub(crate) fn with_default_out(mut self, out: &str) -> Self {
        self.out.get_or_insert_with(|| out.into());
        self
    }

    /// Runs the batch, or what is left of it.
    ///
    /// # Errors
    /// A trial that cannot be run, a folder of another batch, a disk that refuses.
    pub(crate) fn run(
        &self,
        registry: &Registry,
        batch: &Batch,
        visible: bool,
        interrupted: &AtomicBool,
    ) -> Result<BatchOutcome, Box<dyn Error>> {
        let programs = BatchRunOptions { jobs: self.jobs(), worker_command: &worker_command, interrupted };
        let template = "{elapsed} {bar:40} {pos} of {len} trials, {eta} left  {msg}";
        let Some(out) = &self.out else {
            let progress = progress_bar(visible, batch.count() as u64, template);
            let mut score_counts = ScoreTally::default();
            let mut digests = vec![String::new(); batch.count()];
            let whole = run_batch(batch, 0..batch.count(), None, &programs, |trial, result| {
                let label = batch.label(trial);
                score_counts.take(&label, trial.index, result);
                digests[trial.index].clone_from(&result.digest);
                progress.set_message(format!("{label}: {} {}", result.score, result.score_name));
                progress.inc(1);
            })?;
            progress.finish_and_clear();
            digests.retain(|digest| !digest.is_empty());
            let summed = BatchOutcome::Summed(score_counts.summaries(), digests);
            return Ok(if whole { summed } else { BatchOutcome::Interrupted(None) });
        };
        let out = std::path::absolute(out)?;
        let shard = self.shard.unwrap_or(Shard::WHOLE);
        let shards = self.slurm.map_or(shard.count, |shards| shards as usize);
        let folder = BatchFolder::open_or_resume(&out, batch.describe(registry, shards)?)?;
        if self.slurm.is_some() {
            let job = SlurmJob {
                dir: out.clone(),
                program: std::env::current_exe()?,
                arguments: shard_command_args(std::env::args().skip(1), &out),
                shards,
                jobs: self.jobs.map_or(1, usize::from),
                options: self.sbatch_option.clone(),
            };
            let (script, number) = submit(&job)?;
            return Ok(BatchOutcome::Submitted(script, number));
        }
        let mut file = ShardFile::open_or_resume(&folder, shard)?;
        if file.damaged > 0 {
            print_status(format_args!(
                "{} damaged lines of shard {shard} do not count; their trials are run again",
                file.damaged
            ));
        }
        let own = (0..batch.count()).filter(|index| shard.contains(*index));
        let pending: Vec<usize> = own.clone().filter(|index| !file.is_completed(*index)).collect();
        let (all, before) = (own.count(), file.count());
        // Since the time that is left follows from trials of this run alone.
        let progress = progress_bar(visible, all as u64, template).with_position(before as u64);
        progress.reset_eta();
        let whole = run_batch(batch, pending.into_iter(), Some(&mut file), &programs, |trial, result| {
            progress.set_message(format!("{}: {} {}", batch.label(trial), result.score, result.score_name));
            progress.inc(1);
        })?;
        progress.finish_and_clear();
        drop(file);
        if !whole {
            return Ok(BatchOutcome::Interrupted(Some(out)));
        }
        match merge_shards(&folder, false)? {
            Some(merged) => Ok(BatchOutcome::Merged(out, Box::new(merged))),
            None => Ok(BatchOutcome::Shard(out, shard, all)),
        }
    }
}

/// The words of this program without those that say how the batch is divided; files by their whole paths are the caller's business,
/// but for the folder.
fn shard_command_args(words: impl Iterator<Item = String>, out: &Path) -> Vec<String> {
    const OPTIONS_WITH_VALUE: [&str; 4] = ["--sbatch-option", "--jobs", "--shard", "--out"];
    let mut own = Vec::new();
    let mut skips = false;
    for word in words {
        let name = word.split('=').next().unwrap_or_default();
        if std::mem::take(&mut skips) || word == "--json" || name == "--slurm" {
            continue;
        }
        if OPTIONS_WITH_VALUE.contains(&name) {
            skips = !word.contains('=');
            continue;
        }
        own.push(word);
    }
    own.extend(["--out".to_owned(), out.display().to_string()]);
    own
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_task_of_an_array_gets_the_words_of_the_command_without_its_division() {
        let words = "simulate study1 --set a=b --slurm=4 --jobs 3 --sbatch-option --partition=x --sbatch-option=--mem=1G --out here \
                     --json --seed 7";
        let own = shard_command_args(words.split_whitespace().map(str::to_owned), Path::new("/data/here"));
        assert_eq!(own.join(" "), "simulate study1 --set a=b --seed 7 --out /data/here");
    }
}
