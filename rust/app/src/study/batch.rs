//! Many trials with simulated participants, nothing of them kept but the results.

use super::worker::{TrialOrder, Worker, WorkerError};
use proact_analysis::summary::SampleSummary;
use proact_testbed::{TrialEnd, TrialResult};
use serde::Serialize;
use std::{
    error::Error,
    process::Command,
    sync::{
        Mutex, PoisonError,
        atomic::{AtomicBool, AtomicUsize, Ordering},
    },
};

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

/// Runs all `orders`, each of a condition, `jobs` at a time in programs that `worker` starts. The results are in the order of the
/// orders, whatever ran beside what; fewer if `interrupted` was raised.
///
/// # Errors
/// A trial that cannot be run.
pub fn simulate(
    orders: &[TrialOrder],
    jobs: usize,
    worker: &(dyn Fn() -> Command + Sync),
    interrupted: &AtomicBool,
    tell: impl Fn(usize, &TrialResult) + Sync,
) -> Result<Vec<(usize, TrialResult)>, Box<dyn Error>> {
    let next = AtomicUsize::new(0);
    let results = Mutex::new(Vec::new());
    let failed = AtomicBool::new(false);
    let stopped = || interrupted.load(Ordering::Relaxed) || failed.load(Ordering::Relaxed);
    let work = || -> Result<(), String> {
        let mut running = Worker::start(&mut worker()).map_err(|error| error.to_string())?;
        while !stopped() {
            let index = next.fetch_add(1, Ordering::Relaxed);
            let Some(order) = orders.get(index) else { break };
            match running.run(order, stopped) {
                Ok(result) if result.ended == TrialEnd::Interrupt => break,
                Ok(result) => {
                    tell(index, &result);
                    results.lock().unwrap_or_else(PoisonError::into_inner).push((index, result));
                }
                Err(WorkerError::Gone { .. }) if stopped() => break,
                Err(error) => return Err(error.to_string()),
            }
        }
        Ok(())
    };
    let failures: Vec<String> = std::thread::scope(|scope| {
        let run = || work().inspect_err(|_| failed.store(true, Ordering::Relaxed));
        let threads: Vec<_> = (0..jobs.clamp(1, orders.len().max(1))).map(|_| scope.spawn(run)).collect();
        let join = |thread: std::thread::ScopedJoinHandle<'_, Result<(), String>>| {
            thread.join().unwrap_or_else(|_| Err("a thread panicked".to_owned())).err()
        };
        threads.into_iter().filter_map(join).collect()
    });
    if let Some(failure) = failures.into_iter().next() {
        return Err(failure.into());
    }
    let mut results = results.into_inner().unwrap_or_else(PoisonError::into_inner);
    results.sort_by_key(|(index, _)| *index);
    Ok(results)
}

impl ConditionSummary {
    /// Of each condition, in the order of their first trials. `conditions` are those of the orders.
    pub fn of(conditions: &[String], results: &[(usize, TrialResult)]) -> Vec<Self> {
        let mut names: Vec<&String> = Vec::new();
        conditions.iter().for_each(|name| {
            if !names.contains(&name) {
                names.push(name);
            }
        });
        let summary = |name: &String| {
            let own =
                || results.iter().filter(|(index, _)| conditions[*index] == *name).map(|(_, result)| result);
            let scores: Vec<f64> = own().map(|result| result.score).collect();
            Some(Self {
                condition: name.clone(),
                score_name: own().next()?.score_name.clone(),
                scores: SampleSummary::of(&scores)?,
            })
        };
        names.into_iter().filter_map(summary).collect()
    }
}
