//! Statistics of a few people who did the same thing in several ways: repeated measures.
//!
//! Small samples, ties and missing values are the rule, so the tests are those that need no normal distribution, and
//! their chances are counted out exactly where that can be done:
//!
//! | question | test | exact |
//! |---|---|---|
//! | does any condition differ? | [`friedman`], with Kendall's W | while the sums of ranks can be enumerated |
//! | do two differ? | [`wilcoxon`], signed ranks | up to 50 differences, also with ties |
//! | the same, of the means | [`paired_permutation`] | up to 20 differences |
//! | how much? | [`PairedEffect`] | intervals by [`bootstrap_interval`] over people |
//!
//! Several pairs of one measure are corrected together by [`holm`]. [`compare_conditions`] does all of it and says what was presumed.
//!
//! Pure and deterministic: what is drawn comes from a seed that is stated. Each result is compared with SciPy and statsmodels
//! in `rust/analysis/tests/scipy.rs`.
//!
//! ```
//! use proact_analysis::statistics::{RepeatedMeasures, compare_conditions};
//! let blocks = RepeatedMeasures::new(
//!     ["A", "D"].map(str::to_owned).to_vec(),
//!     vec![vec![Some(2.0), Some(4.0)], vec![Some(1.0), Some(4.0)], vec![Some(3.0), Some(4.0)], vec![Some(0.0), None]],
//! )?;
//! let found = compare_conditions(&blocks, 1);
//! assert_eq!((found.pairs[0].n, found.pairs[0].excluded), (3, 1));
//! assert_eq!(found.pairs[0].wilcoxon.as_ref().unwrap().p, 0.25);
//! # Ok::<(), proact_analysis::statistics::StatisticsError>(())
//! ```

mod bootstrap;
mod comparison;
mod effect;
mod friedman;
mod holm;
mod permutation;
mod ranks;
mod repeated_measures;
mod wilcoxon;

pub use bootstrap::{ConfidenceInterval, bca_interval, bootstrap_interval};
pub use comparison::{ConditionComparison, PairwiseComparison, compare_conditions};
pub use effect::{PairedEffect, skewness_test};
pub(crate) use friedman::friedman_asymptotic_p;
pub use friedman::{Friedman, friedman};
pub use holm::{holm, holm_of_pairs};
pub use permutation::{PermutationTest, paired_permutation};
pub use ranks::tied;
pub use repeated_measures::RepeatedMeasures;
pub use wilcoxon::{Wilcoxon, wilcoxon, wilcoxon_of_pairs};

use serde::Serialize;

/// Share of intervals that hold the true value.
pub const CONFIDENCE: f64 = 0.95;
/// Samples that are drawn again for an interval.
pub const BOOTSTRAP_RESAMPLES: usize = 10_000;

/// How a chance was found.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum PValueMethod {
    /// Every case was counted.
    Exact,
    /// By the distribution of a large sample.
    #[serde(rename = "approximate")]
    Asymptotic,
    /// Cases were drawn.
    #[serde(rename = "drawn")]
    MonteCarlo,
}

impl PValueMethod {
    /// For a table.
    pub fn label(self) -> &'static str {
        match self {
            PValueMethod::Exact => "exact",
            PValueMethod::Asymptotic => "approximate",
            PValueMethod::MonteCarlo => "drawn",
        }
    }
}

/// Why a statistic does not exist for these values.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum StatisticsError {
    /// Too little of something.
    #[error("{test} needs at least {least} {what}, got {got}")]
    TooFew {
        /// The test.
        test: &'static str,
        /// Of what.
        what: &'static str,
        /// How many it needs.
        least: usize,
        /// How many there are.
        got: usize,
    },
    /// Nothing differs.
    #[error("{test} compares nothing: all values of each participant are equal")]
    AllEqual {
        /// The test.
        test: &'static str,
    },
    /// A value is not finite.
    #[error("value {value} of row {row} is no finite number")]
    NotFinite {
        /// Which row, from 0.
        row: usize,
        /// The value.
        value: f64,
    },
    /// A row is too short or too long.
    #[error("row {row} has {got} values, expected {expected}: one a condition")]
    Ragged {
        /// Which row, from 0.
        row: usize,
        /// Its length.
        got: usize,
        /// The number of conditions.
        expected: usize,
    },
}

/// All finite.
fn check_finite(row: usize, values: &[f64]) -> Result<(), StatisticsError> {
    match values.iter().find(|value| !value.is_finite()) {
        Some(value) => Err(StatisticsError::NotFinite { row, value: *value }),
        None => Ok(()),
    }
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}
