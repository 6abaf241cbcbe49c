//! Trials of a batch, so many at once, each as it ends to whoever keeps it.

use super::{
    Batch, BatchTrial,
    folder::{ShardFile, TrialLine},
};
use crate::{
    study::{FinishedTrial, TrialWorker, WorkerError},
    threads::run_in_threads,
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
const MAX_WORKER_RESTARTS: usize = 3;
/// What of a result hangs on the machine.
pub(super) const MACHINE_DEPENDENT_KEYS: [&str; 3] = ["wall_seconds", "real_time_factor", "trial_dir"];

/// How trials are run.
pub struct BatchRunOptions<'a> {
    /// So many at once.
    pub jobs: usize,
    /// Starts a program that calls [`run_worker`](crate::study::work).
    pub worker_command: &'a (dyn Fn() -> Command + Sync),
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
    programs: &BatchRunOptions<'_>,
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
            let order = batch.trial_job(&trial);
            let mut lost = 0;
            let done = loop {
                let running = match &mut worker {
                    Some(running) => running,
                    None => worker.insert(TrialWorker::start(&mut (programs.worker_command)())?),
                };
                match running.run(&order, stopped) {
                    Err(WorkerError::WorkerExited { .. }) if stopped() => return Ok(()),
                    Err(WorkerError::WorkerExited { .. }) if lost < MAX_WORKER_RESTARTS => {
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
            let FinishedTrial { result, scores } = done;
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
                    result: machine_independent_result(&result)?,
                    scores,
                })?;
            }
            tell(&trial, &result);
        }
        Ok(())
    };
    run_in_threads(programs.jobs, &failed, work)?;
    Ok(!programs.interrupted.load(Ordering::Relaxed))
}

/// A result without what hangs on the machine.
fn machine_independent_result(result: &TrialResult) -> Result<Map<String, Value>, serde_json::Error> {
    let mut result: Map<String, Value> = serde_json::from_value(serde_json::to_value(result)?)?;
    MACHINE_DEPENDENT_KEYS.iter().for_each(|key| _ = result.remove(*key));
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
    /// Its trials in figures; none if all of them failed.
    #[serde(flatten)]
    pub scores: Option<SampleSummary>,
    /// Trials without a score, because a part in another process failed.
    #[serde(skip_serializing_if = "is_zero")]
    pub failed: usize,
    /// Why the first of them failed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub failure: Option<String>,
    /// Trials that count although a part in another process did nothing in them.
    #[serde(skip_serializing_if = "is_zero")]
    pub idle: usize,
    /// What did nothing in the first of them.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub idle_reason: Option<String>,
}

fn is_zero(count: &usize) -> bool {
    *count == 0
}

impl ConditionSummary {
    /// One line about the trials that count although a part did nothing in them, if there are any.
    pub fn idle_line(&self) -> Option<String> {
        let Self { condition, idle, idle_reason, .. } = self;
        let (all, reason) = (self.scores.map_or(0, |scores| scores.count), idle_reason.as_deref()?);
        Some(format!("{condition}: {idle} of {all} trials that count: {reason}"))
    }

    /// One line about the trials that failed, if any did.
    pub fn failed_line(&self) -> Option<String> {
        let Self { condition, failed, failure, .. } = self;
        let all = failed + self.scores.map_or(0, |scores| scores.count);
        let reason = failure.as_deref()?;
        Some(format!("{condition}: {failed} of {all} trials failed and do not count: {reason}"))
    }
}

/// Scores by condition, in whatever order trials end: one number a trial.
#[derive(Clone, Debug, Default)]
pub struct ScoreTally {
    conditions: Vec<ConditionScores>,
}

/// What came of a trial: its score and what did nothing in it, or why it failed.
type ScoreOrFailure = Result<(f64, Option<String>), String>;

/// Name of a condition and of its score, then place and outcome of each trial.
type ConditionScores = (String, String, Vec<(usize, ScoreOrFailure)>);

impl ScoreTally {
    /// Takes the trial in place `index`.
    pub fn take(&mut self, condition: &str, index: usize, result: &TrialResult) {
        let condition_index = self.conditions.iter().position(|(name, ..)| name == condition);
        let condition_index = condition_index.unwrap_or_else(|| {
            self.conditions.push((condition.to_owned(), result.score_name.clone(), Vec::new()));
            self.conditions.len() - 1
        });
        let counted = match result.failure() {
            Some(reason) => Err(reason.to_owned()),
            None => Ok((result.score, result.never_acted().map(str::to_owned))),
        };
        self.conditions[condition_index].2.push((index, counted));
    }

    /// Of each condition, in the order of their first trials.
    pub fn summaries(mut self) -> Vec<ConditionSummary> {
        // Sums of the same numbers in another order are other sums.
        self.conditions.iter_mut().for_each(|(.., scores)| scores.sort_by_key(|(index, _)| *index));
        self.conditions.sort_by_key(|(.., scores)| scores.first().map(|(index, _)| *index));
        let summary = |(condition, score_name, trials): ConditionScores| {
            let (mut scores, mut failures, mut idle) = (Vec::new(), Vec::new(), Vec::new());
            for (_, counted) in trials {
                match counted {
                    Ok((score, nothing)) => {
                        scores.push(score);
                        idle.extend(nothing);
                    }
                    Err(reason) => failures.push(reason),
                }
            }
            ConditionSummary {
                condition,
                score_name,
                scores: SampleSummary::of(&scores),
                failed: failures.len(),
                failure: failures.into_iter().next(),
                idle: idle.len(),
                idle_reason: idle.into_iter().next(),
            }
        };
        self.conditions.into_iter().map(summary).collect()
    }
}
