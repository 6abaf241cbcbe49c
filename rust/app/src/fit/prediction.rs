use super::{FITTED_METHOD, FitTrials, evaluation::count_scores, hashed_text::hashed_text, kinematic_scores};
use crate::{
    Registry,
    paper::{PaperResults, kolmogorov_distance},
    study::{TrialWorker, WorkerError},
    threads::run_in_threads,
};
use proact_participants::Population;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use std::{
    collections::BTreeMap,
    error::Error,
    process::Command,
    sync::{
        Mutex, PoisonError,
        atomic::{AtomicBool, AtomicUsize, Ordering},
    },
};

/// Studies that are drawn from the simulated people, or from the paper's counts, for the chance of an order.
const BOOTSTRAP_STUDIES: usize = 10_000;
/// Draws them.
const BOOTSTRAP_SEED: u64 = 2407;

/// The three master seeds of a prediction by `population`: from a hash of its values, so that no fit can know them before it ends.
///
/// # Errors
/// Never, but for a population that is no TOML.
pub fn master_seeds(population: &Population) -> Result<[u64; 3], Box<dyn Error>> {
    let hash = proact_recording::sha256_of_bytes(hashed_text(population)?.as_bytes());
    let seed = |k: usize| hash.get(6 * k..6 * k + 6).and_then(|part| u64::from_str_radix(part, 16).ok());
    match (seed(0), seed(1), seed(2)) {
        (Some(a), Some(b), Some(c)) => Ok([a, b, c]),
        _ => Err(format!("{hash:?} is no hash in hexadecimal digits").into()),
    }
}

/// The scores of a study: each trial's person, method and score.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StudyScores {
    /// Draws people and trials.
    pub seed: u64,
    /// With physics and planner.
    #[serde(rename = "whole_chain")]
    pub full_physics: bool,
    /// Person (from 1), method, number of the trial, score.
    pub trials: Vec<(usize, String, usize, f64)>,
}

impl StudyScores {
    /// Runs the paper's first study with `participants` people: in programs of their own with the whole chain if there is a `worker`,
    /// which starts one, else on the kinematic doubles. None if it was interrupted.
    ///
    /// # Errors
    /// A trial that cannot be run.
    pub fn run(
        registry: &Registry,
        (participants, seed): (usize, u64),
        worker: Option<&(dyn Fn() -> Command + Sync)>,
        jobs: usize,
        interrupted: &AtomicBool,
        tell: &(dyn Fn() + Sync),
    ) -> Result<Option<Self>, Box<dyn Error>> {
        let population = Population::standard();
        let evaluation = FitTrials::of_study1(registry, participants, seed, &["A", "B", "C", "D"])?;
        let scores = match worker {
            Some(worker) => full_physics_scores(&evaluation, &population, worker, jobs, interrupted, tell)?,
            None => kinematic_scores(registry, &evaluation, &population, jobs, interrupted, tell)?,
        };
        let Some(scores) = scores else { return Ok(None) };
        let rows = evaluation.rows().zip(scores);
        let trials = rows.map(|((person, method, number), score)| (person, method.to_owned(), number, score));
        Ok(Some(Self { seed, full_physics: worker.is_some(), trials: trials.collect() }))
    }

    fn method_scores<'a>(&'a self, method: &'a str) -> impl Iterator<Item = f64> + 'a {
        self.trials.iter().filter(move |(_, own, ..)| own == method).map(|(.., score)| *score)
    }
}

fn full_physics_scores(
    evaluation: &FitTrials,
    population: &Population,
    worker: &(dyn Fn() -> Command + Sync),
    jobs: usize,
    interrupted: &AtomicBool,
    tell: &(dyn Fn() + Sync),
) -> Result<Option<Vec<f64>>, Box<dyn Error>> {
    let next = AtomicUsize::new(0);
    let scores = Mutex::new(vec![None; evaluation.count()]);
    let failed = AtomicBool::new(false);
    let stopped = || interrupted.load(Ordering::Relaxed) || failed.load(Ordering::Relaxed);
    run_in_threads(jobs, &failed, || {
        let mut running = TrialWorker::start(&mut worker())?;
        while !stopped() {
            let index = next.fetch_add(1, Ordering::Relaxed);
            if index >= evaluation.count() {
                break;
            }
            let mut order = evaluation.trial_order(index, population);
            order.with_scores = false;
            match running.run(&order, stopped) {
                Err(WorkerError::WorkerExited { .. }) if stopped() => return Ok(()),
                Err(error) => return Err(error.into()),
                Ok(done) => {
                    scores.lock().unwrap_or_else(PoisonError::into_inner)[index] = Some(done.result.score);
                }
            }
            tell();
        }
        Ok(())
    })?;
    if interrupted.load(Ordering::Relaxed) {
        return Ok(None);
    }
    Ok(scores.into_inner().unwrap_or_else(PoisonError::into_inner).into_iter().collect())
}

/// What the simulated trials with a method came to, beside the paper's.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MethodPrediction {
    /// Its name.
    pub method: String,
    /// True for the one that the people were fitted to.
    pub fitted: bool,
    /// Trials.
    pub trials: usize,
    /// Mean, and the paper's.
    pub mean: [f64; 2],
    /// Standard deviation, and the paper's.
    pub sd: [f64; 2],
    /// Fewest, and the paper's.
    pub min: [usize; 2],
    /// Most, and the paper's.
    pub max: [usize; 2],
    /// Share of trials with none, and the least and the largest that the paper's row admits.
    #[serde(rename = "none")]
    pub zero_fraction: [f64; 3],
    /// Share of trials with all, and the least and the largest that the paper's row admits.
    #[serde(rename = "all")]
    pub full_fraction: [f64; 3],
    /// Kolmogorov distance to the nearest and to the furthest distribution that the paper's row admits.
    pub distance: [f64; 2],
    /// How many trials had 0, 1, ... blocks.
    pub counts: Vec<usize>,
}

/// A prediction beside the paper.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct StudyPrediction {
    /// By method.
    pub methods: Vec<MethodPrediction>,
    /// In what share of the studies as run both C and D are above both A and B.
    #[serde(rename = "order_in_studies")]
    pub order_fraction_simulated: f64,
    /// ... and in what share of studies of eight people drawn with replacement from those simulated.
    #[serde(rename = "order_drawn")]
    pub order_fraction_bootstrap: f64,
    /// ... and of studies whose trials are drawn from the paper's counts, as if a person's trials had nothing in common.
    #[serde(rename = "order_of_paper")]
    pub order_fraction_paper: f64,
}

/// Sums `studies` up beside the paper.
pub fn predict(studies: &[StudyScores]) -> StudyPrediction {
    let paper = PaperResults::shipped().study1;
    let method = |(name, printed): (&String, &crate::paper::BlockCounts)| {
        let scores: Vec<f64> = studies.iter().flat_map(|study| study.method_scores(name)).collect();
        let counts = count_scores(scores.iter().copied(), paper.max_blocks);
        let admitted = paper.admissible_counts(name);
        let share =
            |counts: &[usize], k: usize| counts[k] as f64 / counts.iter().sum::<usize>().max(1) as f64;
        let range = |values: Vec<f64>| {
            [values.iter().copied().fold(f64::INFINITY, f64::min), values.iter().copied().fold(0.0, f64::max)]
        };
        let beside = |k: usize| {
            let [low, high] = range(admitted.iter().map(|other| share(other, k)).collect());
            [share(&counts, k), low, high]
        };
        let (mean, sd) = mean_and_sd(&scores);
        MethodPrediction {
            method: name.clone(),
            fitted: name == FITTED_METHOD,
            trials: scores.len(),
            mean: [mean, printed.mean],
            sd: [sd, printed.sd],
            min: [counts.iter().position(|n| *n > 0).unwrap_or_default(), printed.min],
            max: [counts.iter().rposition(|n| *n > 0).unwrap_or_default(), printed.max],
            zero_fraction: beside(0),
            full_fraction: beside(paper.max_blocks),
            distance: range(admitted.iter().map(|other| kolmogorov_distance(&counts, other)).collect()),
            counts,
        }
    };
    let methods = paper.methods.iter().map(method).collect();
    let mut rng = ChaCha8Rng::seed_from_u64(BOOTSTRAP_SEED);
    let mut people: Vec<BTreeMap<&str, Vec<f64>>> = Vec::new();
    let mut in_order = 0;
    for study in studies {
        let mut by_person: BTreeMap<usize, BTreeMap<&str, Vec<f64>>> = BTreeMap::new();
        for (person, method, _, score) in &study.trials {
            by_person.entry(*person).or_default().entry(method).or_default().push(*score);
        }
        let own: Vec<_> = by_person.into_values().collect();
        in_order += usize::from(assisted_methods_lead(&own.iter().collect::<Vec<_>>()));
        people.extend(own);
    }
    let drawn = (0..BOOTSTRAP_STUDIES).filter(|_| {
        let study: Vec<_> =
            (0..paper.participants).map(|_| &people[rng.random_range(0..people.len())]).collect();
        assisted_methods_lead(&study)
    });
    let order_drawn = drawn.count() as f64 / BOOTSTRAP_STUDIES as f64;
    let trials = paper.participants * paper.trials_each;
    let pools: Vec<Vec<f64>> = ["A", "B", "C", "D"]
        .iter()
        .map(|name| {
            let counts = paper.admissible_counts(name).into_iter().next().unwrap_or_default();
            counts.iter().enumerate().flat_map(|(k, n)| vec![k as f64; *n]).collect()
        })
        .collect();
    let of_paper = (0..BOOTSTRAP_STUDIES).filter(|_| {
        let mut mean =
            |pool: &Vec<f64>| -> f64 { (0..trials).map(|_| pool[rng.random_range(0..pool.len())]).sum() };
        let means: Vec<f64> = pools.iter().map(&mut mean).collect();
        means[2].min(means[3]) > means[0].max(means[1])
    });
    let order_of_paper = of_paper.count() as f64 / BOOTSTRAP_STUDIES as f64;
    StudyPrediction {
        methods,
        order_fraction_simulated: in_order as f64 / studies.len().max(1) as f64,
        order_fraction_bootstrap: order_drawn,
        order_fraction_paper: order_of_paper,
    }
}

/// Whether the means of C and D are above those of A and B.
fn assisted_methods_lead(people: &[&BTreeMap<&str, Vec<f64>>]) -> bool {
    let mean = |method: &str| {
        let scores: Vec<f64> = people.iter().filter_map(|own| own.get(method)).flatten().copied().collect();
        mean_and_sd(&scores).0
    };
    mean("C").min(mean("D")) > mean("A").max(mean("B"))
}

/// Mean and standard deviation.
fn mean_and_sd(scores: &[f64]) -> (f64, f64) {
    let count = scores.len() as f64;
    let mean = scores.iter().sum::<f64>() / count;
    let squares: f64 = scores.iter().map(|score| (score - mean).powi(2)).sum();
    (mean, (squares / (count - 1.0)).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_study_that_came_out_as_the_papers_is_at_no_distance_and_in_its_order() {
        let paper = PaperResults::shipped().study1;
        let mut trials = Vec::new();
        for method in ["A", "B", "C", "D"] {
            let counts = &paper.admissible_counts(method)[0];
            let scores = counts.iter().enumerate().flat_map(|(k, n)| vec![k as f64; *n]);
            trials.extend(
                scores.enumerate().map(|(k, score)| (k / 3 + 1, method.to_owned(), k % 3 + 1, score)),
            );
        }
        let prediction = predict(&[StudyScores { seed: 1, full_physics: false, trials }]);
        for own in &prediction.methods {
            assert_eq!(own.distance[0], 0.0, "{own:?}");
            assert!(
                (own.mean[0] - own.mean[1]).abs() < 0.005 && (own.sd[0] - own.sd[1]).abs() < 0.006,
                "{own:?}"
            );
            assert_eq!((own.min[0], own.max[0]), (own.min[1], own.max[1]));
        }
        assert_eq!(prediction.order_fraction_simulated, 1.0);
        assert!(
            prediction.order_fraction_bootstrap > 0.8 && prediction.order_fraction_paper > 0.98,
            "{prediction:?}"
        );
    }

    #[test]
    fn seeds_follow_from_the_people() {
        let population = Population::standard();
        let mut other = population;
        other.decision_time_ms.median *= 1.01;
        assert_eq!(master_seeds(&population).unwrap(), master_seeds(&population).unwrap());
        assert_ne!(master_seeds(&population).unwrap(), master_seeds(&other).unwrap());
    }
}
