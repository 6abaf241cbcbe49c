//! Fits the simulated people to what the paper prints of method A of its first study, and predicts the rest from that.
//!
//! The fit sees one row of the paper's table and no other: [`FitTarget`] holds all that it knows. Trials run on the kinematic
//! doubles ([`trial::kinematic_trial`](crate::trial::kinematic)); every evaluation meets the same people's random numbers and the same
//! seeds of trials, so that two evaluations differ by the values of the population alone.

mod evaluation;
mod hashed_text;
mod journal;
mod parameters;
mod prediction;
mod search;

pub use evaluation::{FitTrials, kinematic_scores};
pub use journal::{FitJournal, FitJournalError};
pub use parameters::{PARAMETERS, Parameter, population_at, population_at_start};
pub use prediction::{MethodPrediction, StudyPrediction, StudyScores, master_seeds, predict};
pub use search::{FitOptions, FitResult, fit};

use crate::paper::{PaperResults, cumulative_fractions};

/// The method that is fitted.
pub const FITTED_METHOD: &str = "A";

/// What the fit knows of the paper: how the trials with method A can have come out.
#[derive(Clone, Debug)]
pub struct FitTarget {
    /// Share of trials with at most 0, 1, ... blocks, for each way that the printed row admits.
    admissible_distributions: Vec<Vec<f64>>,
}

impl FitTarget {
    /// That of method A.
    pub fn from_paper(paper: &PaperResults) -> Self {
        let admitted = paper.study1.admissible_counts(FITTED_METHOD);
        Self {
            admissible_distributions: admitted.iter().map(|counts| cumulative_fractions(counts)).collect(),
        }
    }

    /// How far trials of which `counts[k]` had k blocks are off: the square root of the sum of squares of the differences of
    /// shares of trials with at most k blocks, to the nearest way that the paper admits. Mean, standard deviation, and shares of
    /// none and of all are all in it.
    pub fn distance(&self, counts: &[usize]) -> f64 {
        let own = cumulative_fractions(counts);
        let off = |other: &Vec<f64>| -> f64 { own.iter().zip(other).map(|(a, b)| (a - b).powi(2)).sum() };
        self.admissible_distributions.iter().map(off).fold(f64::INFINITY, f64::min).sqrt()
    }
}
