use crate::{
    Registry,
    batch::{Batch, BatchTrial, Sweep},
    study::{ParticipantKind, Study, TrialJob, population_overrides},
    threads::run_in_threads,
    trial,
};
use proact_devices::EmgOrigin;
use proact_participants::Population;
use proact_study::TrialOptions;
use std::{
    error::Error,
    path::Path,
    sync::{
        Mutex, PoisonError,
        atomic::{AtomicBool, AtomicUsize, Ordering},
    },
};

/// The trials of the paper's first study with some methods, with people of whatever population.
pub struct FitTrials {
    batch: Batch,
    trials: Vec<BatchTrial>,
    /// Draws people and trials.
    pub seed: u64,
}

impl FitTrials {
    /// The trials of `participants` people with `methods`, in the order of the plan.
    ///
    /// # Errors
    /// Too many trials.
    pub fn of_study1(
        registry: &Registry,
        participants: usize,
        seed: u64,
        methods: &[&str],
    ) -> Result<Self, Box<dyn Error>> {
        let study = Study::open_with_participants(
            Path::new("study1"),
            &registry.methods,
            Some(participants),
            Some(seed),
        )?;
        let batch =
            Batch::of_study(&study, &TrialOptions::default(), ParticipantKind::Competent, Sweep::default())?;
        let wanted = |trial: &BatchTrial| methods.contains(&batch.conditions[trial.condition].0.as_str());
        let trials: Vec<BatchTrial> =
            (0..batch.count()).map(|index| batch.trial(index)).filter(wanted).collect();
        if trials.is_empty() {
            return Err(format!("study1 has no trials with {}", methods.join(", ")).into());
        }
        Ok(Self { batch, trials, seed })
    }

    /// How many trials.
    pub fn count(&self) -> usize {
        self.trials.len()
    }

    /// Person (from 1), method and number of each trial.
    pub fn rows(&self) -> impl Iterator<Item = (usize, &str, usize)> {
        self.trials
            .iter()
            .map(|trial| (trial.participant, self.batch.conditions[trial.condition].0.as_str(), trial.trial))
    }

    /// The trial in a place as an order, with its person of `population`.
    pub fn trial_order(&self, index: usize, population: &Population) -> TrialJob {
        let trial = &self.trials[index];
        let mut order = self.batch.trial_job(trial);
        let person = population_overrides(population, self.seed, trial.participant, &trial.history);
        order.options.set.splice(0..0, person);
        order
    }
}

/// Runs all trials of an evaluation on the kinematic doubles, in `jobs` threads: the scores in their order, or none if it was
/// interrupted. `tell` hears of each trial that ends.
///
/// # Errors
/// A trial that cannot be put together or run.
pub fn kinematic_scores(
    registry: &Registry,
    evaluation: &FitTrials,
    population: &Population,
    jobs: usize,
    interrupted: &AtomicBool,
    tell: &(dyn Fn() + Sync),
) -> Result<Option<Vec<f64>>, Box<dyn Error>> {
    let scores = Mutex::new(vec![None; evaluation.count()]);
    let (next, failed) = (AtomicUsize::new(0), AtomicBool::new(false));
    run_in_threads(jobs, &failed, || {
        while !interrupted.load(Ordering::Relaxed) && !failed.load(Ordering::Relaxed) {
            let index = next.fetch_add(1, Ordering::Relaxed);
            if index >= evaluation.count() {
                break;
            }
            let score = kinematic_score(registry, &evaluation.trial_order(index, population), interrupted)
                .map_err(|error| format!("trial {}: {error}", index + 1))?;
            scores.lock().unwrap_or_else(PoisonError::into_inner)[index] = score;
            tell();
        }
        Ok(())
    })?;
    Ok(scores.into_inner().unwrap_or_else(PoisonError::into_inner).into_iter().collect())
}

/// The score of a trial; none if it was interrupted.
fn kinematic_score(
    registry: &Registry,
    order: &TrialJob,
    interrupted: &AtomicBool,
) -> Result<Option<f64>, Box<dyn Error>> {
    let (arm, config) = order.config(registry, None)?;
    let mut trial = trial::kinematic_trial(&registry.methods, &arm, config, &EmgOrigin::Synthetic)?;
    while !trial.step(false)?.output.finished {
        if trial.testbed().now().0.is_multiple_of(1000) && interrupted.load(Ordering::Relaxed) {
            return Ok(None);
        }
    }
    Ok(Some(trial.result().score))
}

/// How many of `scores` were 0, 1, ... up to `max_score`.
pub(super) fn count_scores(scores: impl IntoIterator<Item = f64>, max_score: usize) -> Vec<usize> {
    let mut counts = vec![0; max_score + 1];
    for score in scores {
        counts[(score.max(0.0).round() as usize).min(max_score)] += 1;
    }
    counts
}
