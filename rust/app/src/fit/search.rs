use super::{
    FITTED_METHOD, FitJournal, FitTarget, FitTrials, PARAMETERS,
    evaluation::{count_scores, kinematic_scores},
    hashed_text::hashed_text,
    journal::FitEvaluation,
    population_at,
};
use crate::{Registry, paper::PaperResults};
use argmin::{
    core::{CostFunction, Executor},
    solver::neldermead::NelderMead,
};
use proact_participants::Population;
use std::{
    cell::RefCell,
    error::Error,
    path::Path,
    sync::atomic::{AtomicBool, Ordering},
};

/// How far the corners of the first simplex are from where the search begins, in coordinates of [`Parameter`](super::Parameter).
const INITIAL_SIMPLEX_STEP: f64 = 0.7;
/// What a coordinate adds to the objective by being off its beginning, per square: five values are more than five shares of trials
/// can tell, and what they leave open stays where it was.
const REGULARIZATION_WEIGHT: f64 = 0.002;
/// Draws the people of the fit, and their trials.
const FIT_SEED: u64 = 22;

/// How the fit is done.
pub struct FitOptions<'a> {
    /// People of each evaluation, each with three trials.
    pub participants: usize,
    /// So many evaluations at most.
    pub evaluations: usize,
    /// So many trials at once.
    pub jobs: usize,
    /// Raised by Ctrl-C or a request to end.
    pub interrupted: &'a AtomicBool,
}

/// What was found.
#[derive(Clone, Debug)]
pub struct FitResult {
    /// The people.
    pub population: Population,
    /// Values of the parameters, in their order.
    pub values: Vec<f64>,
    /// How far the fitted trials are off ([`FitTarget::distance`]).
    pub distance: f64,
    /// How many of the fitted trials had 0, 1, ... blocks.
    pub counts: Vec<usize>,
    /// Evaluations.
    pub evaluations: usize,
}

/// What a fit tells of: trials that ended, and the smallest objective so far once an evaluation is over.
pub type FitProgress<'a> = &'a (dyn Fn(usize, Option<f64>) + Sync);

struct FitProblem<'a> {
    registry: &'a Registry,
    evaluation: &'a FitTrials,
    start: Population,
    origin: Vec<f64>,
    target: FitTarget,
    max_score: usize,
    options: &'a FitOptions<'a>,
    journal: RefCell<&'a mut FitJournal>,
    progress: FitProgress<'a>,
    failure: RefCell<Option<String>>,
}

/// The objective once all evaluations are spent, or the search was interrupted or failed. Not an error, on which this version of
/// the crate argmin panics.
const TERMINATED_COST: f64 = 1e9;

impl FitProblem<'_> {
    fn objective(&self, evaluated: &FitEvaluation) -> f64 {
        let counts = count_scores(evaluated.scores.iter().copied(), self.max_score);
        let coordinates =
            PARAMETERS.iter().zip(&evaluated.values).map(|(own, value)| own.to_coordinate(*value));
        let pull: f64 =
            coordinates.zip(&self.origin).map(|(x, x0)| REGULARIZATION_WEIGHT * (x - x0).powi(2)).sum();
        self.target.distance(&counts).powi(2) + pull
    }

    fn record_failure(&self, error: &dyn Error) -> f64 {
        self.failure.replace(Some(error.to_string()));
        TERMINATED_COST
    }

    fn best(&self) -> Option<FitEvaluation> {
        let journal = self.journal.borrow();
        let all = journal.evaluations().iter();
        all.min_by(|a, b| self.objective(a).total_cmp(&self.objective(b))).cloned()
    }
}

impl CostFunction for FitProblem<'_> {
    type Param = Vec<f64>;
    type Output = f64;

    fn cost(&self, coordinates: &Self::Param) -> Result<f64, argmin::core::Error> {
        let mut population = population_at(&self.start, coordinates);
        let values: Vec<f64> = PARAMETERS.iter().map(|own| *(own.value)(&mut population)).collect();
        let known = self.journal.borrow().scores(&values).map(<[f64]>::to_vec);
        if let Some(scores) = known {
            return Ok(self.objective(&FitEvaluation { values, scores }));
        }
        if self.journal.borrow().evaluations().len() >= self.options.evaluations
            || self.failure.borrow().is_some()
        {
            return Ok(TERMINATED_COST);
        }
        let tell = || (self.progress)(1, None);
        let FitOptions { jobs, interrupted, .. } = *self.options;
        let scores =
            match kinematic_scores(self.registry, self.evaluation, &population, jobs, interrupted, &tell) {
                Ok(Some(scores)) => scores,
                Ok(None) => return Ok(TERMINATED_COST),
                Err(error) => return Ok(self.record_failure(&*error)),
            };
        let evaluated = FitEvaluation { values, scores };
        let cost = self.objective(&evaluated);
        if let Err(error) = self.journal.borrow_mut().push(evaluated) {
            return Ok(self.record_failure(&error));
        }
        (self.progress)(0, self.best().map(|best| self.objective(&best)));
        Ok(cost)
    }
}

/// Fits the population to method A, from the one that ships on or from where the journal in `dir` ends. None if it was interrupted.
///
/// Nelder and Mead's simplex (of the crate argmin), which needs no derivatives; with common random numbers the objective is a step
/// function without noise. The best of all evaluations counts.
///
/// # Errors
/// A journal of another fit, a trial that cannot be run, a disk that refuses.
pub fn fit(
    registry: &Registry,
    start: &Population,
    dir: &Path,
    options: &FitOptions<'_>,
    progress: FitProgress<'_>,
) -> Result<Option<FitResult>, Box<dyn Error>> {
    let paper = PaperResults::shipped();
    let evaluation = FitTrials::of_study1(registry, options.participants, FIT_SEED, &[FITTED_METHOD])?;
    let of = format!(
        "{} {} people, seed {FIT_SEED}, from {}",
        env!("CARGO_PKG_VERSION"),
        options.participants,
        proact_recording::sha256_of_bytes(hashed_text(start)?.as_bytes())
    );
    proact_files::make_folder(dir)?;
    let mut journal = FitJournal::open_or_resume(&dir.join("journal.jsonl"), &of)?;
    for _ in 0..journal.evaluations().len() * evaluation.count() {
        progress(1, None);
    }
    let mut from = *start;
    let origin: Vec<f64> = PARAMETERS.iter().map(|own| own.to_coordinate(*(own.value)(&mut from))).collect();
    let corner = |k: usize| {
        let mut corner = origin.clone();
        // Toward the middle of the bounds.
        corner[k] += if corner[k] > 0.0 { -INITIAL_SIMPLEX_STEP } else { INITIAL_SIMPLEX_STEP };
        corner
    };
    let mut simplex = vec![origin.clone()];
    simplex.extend((0..origin.len()).map(corner));
    let problem = FitProblem {
        registry,
        evaluation: &evaluation,
        start: *start,
        origin,
        target: FitTarget::from_paper(&paper),
        max_score: paper.study1.max_blocks,
        options,
        journal: RefCell::new(&mut journal),
        progress,
        failure: RefCell::default(),
    };
    let solver = NelderMead::new(simplex).with_sd_tolerance(1e-4)?;
    // Each iteration takes an evaluation, a known one or a new one.
    let max_evaluations = options.evaluations as u64;
    Executor::new(FitProblemRef(&problem), solver)
        .configure(|state| state.max_iters(max_evaluations))
        .timer(false)
        .run()?;
    if options.interrupted.load(Ordering::Relaxed) {
        return Ok(None);
    }
    if let Some(failure) = problem.failure.take() {
        return Err(failure.into());
    }
    let best = problem.best().ok_or("there was no evaluation")?;
    let counts = count_scores(best.scores.iter().copied(), problem.max_score);
    let mut population = *start;
    for (parameter, value) in PARAMETERS.iter().zip(&best.values) {
        *(parameter.value)(&mut population) = *value;
    }
    let distance = problem.target.distance(&counts);
    let evaluations = problem.journal.borrow().evaluations().len();
    Ok(Some(FitResult { population, values: best.values, distance, counts, evaluations }))
}

/// The executor takes what it runs; this lends it.
struct FitProblemRef<'a, 'b>(&'a FitProblem<'b>);

impl CostFunction for FitProblemRef<'_, '_> {
    type Param = Vec<f64>;
    type Output = f64;

    fn cost(&self, coordinates: &Self::Param) -> Result<f64, argmin::core::Error> {
        self.0.cost(coordinates)
    }
}
