//! Trials of a batch, so many at once, each as it ends to whoever keeps it.

use super::{
    Batch, BatchTrial,
    folder::{ShardFile, TrialLine},
};
use crate::{
    study::{TrialDone, Worker, WorkerError},
    threads::in_threads,
};
use proact_analysis::summary::SampleSummary;
use proact_testbed::{TrialEnd, TrialResult};
use serde::Serialize;
use serde_json::{Map, Value};
use std::{
    error::Error,
    process::Command,
    sync::{
        Mutex, PoisonError,
        atomic::{AtomicBool, Ordering},
    },
};

/// So often in a row a trial is begun again whose program ended before it did.
const MOST_LOST: usize = 3;
/// What of a result hangs on the machine.
pub(super) const OF_THE_MACHINE: [&str; 3] = ["wall_seconds", "real_time_factor", "trial_dir"];

/// How trials are run.
pub struct BatchPrograms<'a> {
    /// So many at once.
    pub jobs: usize,
    /// Starts a program that calls [`work`](crate::study::work).
    pub worker: &'a (dyn Fn() -> Command + Sync),
    /// Raised by Ctrl-C or a request to end.
    pub interrupted: &'a AtomicBool,
}

/// Runs the trials in the places `pending`. Each is kept in `keep`, if there is one, then `tell` hears of it. False if it was
/// interrupted.
///
/// # Errors
/// A trial that cannot be run, a disk that refuses. What ended before stays.
pub fn run_batch(
    batch: &Batch,
    pending: impl Iterator<Item = usize> + Send,
    keep: Option<&mut ShardFile>,
    programs: &BatchPrograms<'_>,
    tell: impl FnMut(&BatchTrial, &TrialResult) + Send,
) -> Result<bool, Box<dyn Error>> {
    let pending = Mutex::new(pending);
    let kept = Mutex::new((keep, tell));
    let failed = AtomicBool::new(false);
    let stopped = || programs.interrupted.load(Ordering::Relaxed) || failed.load(Ordering::Relaxed);
    let work = || -> Result<(), Box<dyn Error>> {
        let mut worker = None;
        while !stopped() {
            let index = pending.lock().unwrap_or_else(PoisonError::into_inner).next();
            let Some(trial) = index.map(|index| batch.trial(index)) else { break };
            let order = batch.order(&trial);
            let mut lost = 0;
            let done = loop {
                let running = match &mut worker {
                    Some(running) => running,
                    None => worker.insert(Worker::start(&mut (programs.worker)())?),
                };
                match running.run(&order, stopped) {
                    Err(WorkerError::Gone { .. }) if stopped() => return Ok(()),
                    Err(WorkerError::Gone { .. }) if lost < MOST_LOST => {
                        lost += 1;
                        worker = None;
                    }
                    Err(error) => {
                        let number = trial.index + 1;
                        return Err(format!("trial {number}, {}: {error}", batch.label(&trial)).into());
                    }
                    Ok(done) => break done,
                }
            };
            let TrialDone { result, scores } = done;
            if result.ended == TrialEnd::Interrupt {
                break;
            }
            let mut kept = kept.lock().unwrap_or_else(PoisonError::into_inner);
            let (keep, tell) = &mut *kept;
            if let Some(file) = keep {
                let scores = scores.ok_or("a trial of a batch came back without its scores")?;
                file.push(&TrialLine {
                    index: trial.index,
                    trial: trial.clone(),
                    result: of_the_trial(&result)?,
                    scores,
                })?;
            }
            tell(&trial, &result);
        }
        Ok(())
    };
    in_threads(programs.jobs, &failed, work)?;
    Ok(!programs.interrupted.load(Ordering::Relaxed))
}

/// A result without what hangs on the machine.
fn of_the_trial(result: &TrialResult) -> Result<Map<String, Value>, serde_json::Error> {
    let mut result: Map<String, Value> = serde_json::from_value(serde_json::to_value(result)?)?;
    OF_THE_MACHINE.iter().for_each(|key| _ = result.remove(*key));
    Ok(result)
}

/// What the trials of a condition came to.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ConditionSummary {
    /// Its name.
    #[serde(skip)]
    pub condition: String,
    /// What is counted, such as `blocks on target`.
    pub score_name: String,
    /// Its trials in figures.
    #[serde(flatten)]
    pub scores: SampleSummary,
}

/// Scores by condition, in whatever order trials end: one number a trial.
#[derive(Clone, Debug, Default)]
pub struct ScoreTally {
    conditions: Vec<ConditionScores>,
}

/// Name of a condition and of its score, then place and score of each trial.
type ConditionScores = (String, String, Vec<(usize, f64)>);

impl ScoreTally {
    /// Takes the score of the trial in place `index`.
    pub fn take(&mut self, condition: &str, index: usize, score_name: &str, score: f64) {
        let place = self.conditions.iter().position(|(name, ..)| name == condition);
        let place = place.unwrap_or_else(|| {
            self.conditions.push((condition.to_owned(), score_name.to_owned(), Vec::new()));
            self.conditions.len() - 1
        });
        self.conditions[place].2.push((index, score));
    }

    /// Of each condition, in the order of their first trials.
    pub fn summaries(mut self) -> Vec<ConditionSummary> {
        // Sums of the same numbers in another order are other sums.
        self.conditions.iter_mut().for_each(|(.., scores)| scores.sort_by_key(|(index, _)| *index));
        self.conditions.sort_by_key(|(.., scores)| scores.first().map(|(index, _)| *index));
        let summary = |(condition, score_name, scores): ConditionScores| {
            let scores: Vec<f64> = scores.into_iter().map(|(_, score)| score).collect();
            Some(ConditionSummary { condition, score_name, scores: SampleSummary::of(&scores)? })
        };
        self.conditions.into_iter().filter_map(summary).collect()
    }
}
