//! What the ProACT paper prints of its results, as `data/paper_results.toml` has it, and which results of single trials admit it.
//!
//! The crate that simulates people does not depend on this one: it cannot know these numbers.

use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// How far a number may be off that is printed with two digits behind the point.
const ROUNDING_TOLERANCE: f64 = 0.005 + 1e-9;

/// The paper's results.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PaperResults {
    /// Its first study.
    pub study1: PaperStudy,
    /// What is told and not counted.
    #[serde(rename = "in_words")]
    pub quoted_results: Vec<QuotedResult>,
}

/// The block counts of a study.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PaperStudy {
    /// How many people.
    pub participants: usize,
    /// Trials of each by each method.
    pub trials_each: usize,
    /// Blocks of a trial.
    #[serde(rename = "most")]
    pub max_blocks: usize,
    /// By method.
    pub methods: BTreeMap<String, BlockCounts>,
    /// Other numbers of the text.
    pub counts: BTreeMap<String, u32>,
}

/// Blocks on target in the trials with a method, as printed.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BlockCounts {
    /// Mean over trials.
    pub mean: f64,
    /// Standard deviation.
    pub sd: f64,
    /// Fewest in a trial.
    pub min: usize,
    /// Most in a trial.
    pub max: usize,
    /// Median.
    pub median: f64,
}

/// A result without a number.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct QuotedResult {
    /// Number of the study.
    pub study: usize,
    /// What it is about.
    pub topic: String,
    /// What the paper says, shortened.
    pub text: String,
}

impl PaperResults {
    /// What ships with the program.
    ///
    /// # Panics
    /// Never: the file ships with the program and is tested.
    pub fn shipped() -> Self {
        toml::from_str(include_str!("../data/paper_results.toml"))
            .expect("ships with the program and is tested there")
    }
}

impl PaperStudy {
    /// All ways in which the trials with `method` can have come out: how many trials had 0, 1, ... blocks, for each. With so few
    /// trials the rounded numbers leave hardly a choice. The standard deviation is the one over n - 1: with the one over n three
    /// of the four methods' rows are impossible.
    pub fn admissible_counts(&self, method: &str) -> Vec<Vec<usize>> {
        let Some(printed) = self.methods.get(method) else { return Vec::new() };
        let mut found = Vec::new();
        let mut counts = vec![0; self.max_blocks + 1];
        enumerate_counts(&mut counts, 0, self.participants * self.trials_each, &mut |counts| {
            if printed.is_consistent(counts) {
                found.push(counts.to_vec());
            }
        });
        found
    }
}

/// Tells `take` of every way to divide `left` trials among the places of `counts` from `index` on.
fn enumerate_counts(counts: &mut [usize], index: usize, left: usize, take: &mut impl FnMut(&[usize])) {
    if index + 1 == counts.len() {
        counts[index] = left;
        take(counts);
        return;
    }
    for here in 0..=left {
        counts[index] = here;
        enumerate_counts(counts, index + 1, left - here, take);
    }
}

impl BlockCounts {
    /// Whether trials of which `counts[k]` had k blocks give what is printed.
    fn is_consistent(&self, counts: &[usize]) -> bool {
        let trials: usize = counts.iter().sum();
        let moment = |f: &dyn Fn(f64) -> f64| {
            counts.iter().enumerate().map(|(k, n)| *n as f64 * f(k as f64)).sum::<f64>()
        };
        let mean = moment(&|k| k) / trials as f64;
        let sd = (moment(&|k| (k - mean).powi(2)) / (trials as f64 - 1.0)).sqrt();
        let nth = |n: usize| {
            let mut before = 0;
            counts.iter().position(|count| {
                before += count;
                before > n
            })
        };
        let middle = |n: usize| nth(n).unwrap_or_default() as f64;
        let median = (middle((trials - 1) / 2) + middle(trials / 2)) / 2.0;
        (mean - self.mean).abs() <= ROUNDING_TOLERANCE
            && (sd - self.sd).abs() <= ROUNDING_TOLERANCE
            && median == self.median
            && nth(0) == Some(self.min)
            && nth(trials - 1) == Some(self.max)
    }
}

/// The share of trials with at most 0, 1, ... blocks.
pub fn cumulative_fractions(counts: &[usize]) -> Vec<f64> {
    let trials = counts.iter().sum::<usize>().max(1) as f64;
    let mut before = 0;
    let up_to = |count: &usize| {
        before += count;
        before as f64 / trials
    };
    counts.iter().map(up_to).collect()
}

/// The Kolmogorov distance of two distributions of block counts.
pub fn kolmogorov_distance(one: &[usize], other: &[usize]) -> f64 {
    let pairs = cumulative_fractions(one).into_iter().zip(cumulative_fractions(other));
    pairs.map(|(one, other)| (one - other).abs()).fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_printed_leaves_hardly_a_choice_of_single_results() {
        let study = PaperResults::shipped().study1;
        assert_eq!(study.admissible_counts("A"), [[3, 8, 1, 5, 7], [5, 3, 4, 6, 6]]);
        assert_eq!(study.admissible_counts("B").len(), 5);
        assert_eq!(study.admissible_counts("C"), [[0, 1, 5, 4, 14], [0, 2, 2, 7, 13]]);
        assert_eq!(study.admissible_counts("D"), [[0, 0, 1, 6, 17]]);
        // Not so by the other definition of the standard deviation, nor with a mean that no whole number of blocks gives.
        let odd = BlockCounts { mean: 2.23, ..study.methods["A"] };
        assert!(!study.admissible_counts("A").iter().any(|counts| odd.is_consistent(counts)));
    }

    #[test]
    fn all_methods_together_brought_as_many_blocks_as_the_text_counts_but_for_rounding() {
        let study = PaperResults::shipped().study1;
        let blocks = |method: &str| {
            let counts = &study.admissible_counts(method)[0];
            counts.iter().enumerate().map(|(k, n)| k * n).sum::<usize>()
        };
        let all: usize = ["A", "B", "C", "D"].into_iter().map(blocks).sum();
        // One more than the text has.
        assert_eq!(all, study.counts["picks_across"] as usize + 1);
    }

    #[test]
    fn the_distance_is_the_largest_difference_of_shares() {
        assert_eq!(kolmogorov_distance(&[1, 1, 2], &[1, 1, 2]), 0.0);
        assert_eq!(kolmogorov_distance(&[4, 0, 0], &[0, 0, 4]), 1.0);
        assert_eq!(kolmogorov_distance(&[2, 0, 2], &[1, 1, 2]), 0.25);
    }
}
