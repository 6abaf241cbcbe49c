use super::{
    PValueMethod, StatisticsError, check_finite,
    ranks::{Ranks, TIE_TOLERANCE, max_abs},
};
use serde::Serialize;
use statrs::distribution::{ContinuousCDF, Normal};

const TEST: &str = "Wilcoxon's signed-rank test";
/// More differences than this are left to the normal distribution.
const MAX_EXACT_DIFFERENCES: usize = 50;

/// Wilcoxon's signed-rank test of paired differences, two-sided.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Wilcoxon {
    /// Differences that are not zero.
    pub n: usize,
    /// Differences of zero, which are left out.
    pub zeros: usize,
    /// Sum of the ranks of positive differences.
    pub w_plus: f64,
    /// Sum of the ranks of negative differences.
    pub w_minus: f64,
    /// Chance of a sum as far from its middle, if differences were symmetric about zero.
    pub p: f64,
    /// How that chance was found.
    #[serde(rename = "chance")]
    pub p_method: PValueMethod,
    /// The smallest chance that so many differences can have: above the level, the test can show nothing.
    #[serde(rename = "least_p")]
    pub min_p: f64,
}

impl Wilcoxon {
    /// Matched-pairs rank-biserial correlation, -1 to 1 (Kerby 2014): share of the ranks for more, less that for less.
    pub fn rank_biserial(&self) -> f64 {
        (self.w_plus - self.w_minus) / (self.w_plus + self.w_minus)
    }
}

/// The test of `differences`.
///
/// Presumes that the people are independent and, as a statement on the median, that differences are symmetric. Differences of zero
/// are left out (Wilcoxon 1945). Sizes that differ by rounding alone (1e-12 of the largest) are tied, and what is as small is zero.
/// Up to 50 differences the chance is exact given the ties: each sign is as likely as the other.
/// Above, it is that of the normal distribution, corrected for ties, not for continuity.
///
/// # Errors
/// No difference that is not zero; a value that is not finite.
pub fn wilcoxon(differences: &[f64]) -> Result<Wilcoxon, StatisticsError> {
    test(differences, TIE_TOLERANCE * max_abs(differences.iter().copied()))
}

/// The test of the second value of each pair less the first.
///
/// As [`wilcoxon`], but rounding is measured by the values themselves: where they are large and differ by little, it is large beside
/// the differences.
///
/// # Errors
/// No pair that differs; a value that is not finite.
pub fn wilcoxon_of_pairs(pairs: &[[f64; 2]]) -> Result<Wilcoxon, StatisticsError> {
    PairedDifferences::of(pairs).wilcoxon()
}

fn test(differences: &[f64], tolerance: f64) -> Result<Wilcoxon, StatisticsError> {
    check_finite(0, differences)?;
    if differences.is_empty() {
        return Err(StatisticsError::TooFew { test: TEST, what: "differences", least: 1, got: 0 });
    }
    let SignedRanks { ranks, plus, minus } =
        SignedRanks::of(differences, tolerance).ok_or(StatisticsError::AllEqual { test: TEST })?;
    let n = ranks.doubled.len();
    let exact = n <= MAX_EXACT_DIFFERENCES;
    let p = if exact { exact_p(&ranks.doubled, plus.min(minus)) } else { normal_p(n, &ranks, plus) };
    Ok(Wilcoxon {
        n,
        zeros: differences.len() - n,
        w_plus: plus as f64 / 2.0,
        w_minus: minus as f64 / 2.0,
        p,
        p_method: if exact { PValueMethod::Exact } else { PValueMethod::Asymptotic },
        min_p: 2.0 * 0.5_f64.powi(n as i32),
    })
}

/// Matched-pairs rank-biserial correlation of `differences` alone, without the count of all signs; none if nothing differs.
pub(super) fn rank_biserial(differences: &[f64], tolerance: f64) -> Option<f64> {
    let SignedRanks { plus, minus, .. } = SignedRanks::of(differences, tolerance)?;
    Some((plus as f64 - minus as f64) / (plus + minus) as f64)
}

/// What the second values of pairs have more than the first.
pub(super) struct PairedDifferences {
    /// In the order of the pairs; what rounding alone can make is zero.
    pub(super) values: Vec<f64>,
    /// What rounding alone can make of equal values.
    pub(super) tolerance: f64,
}

impl PairedDifferences {
    pub(super) fn of(pairs: &[[f64; 2]]) -> Self {
        let tolerance = TIE_TOLERANCE * max_abs(pairs.iter().flatten().copied());
        let difference = |[a, b]: &[f64; 2]| if (b - a).abs() <= tolerance { 0.0 } else { b - a };
        Self { values: pairs.iter().map(difference).collect(), tolerance }
    }

    pub(super) fn wilcoxon(&self) -> Result<Wilcoxon, StatisticsError> {
        test(&self.values, self.tolerance)
    }
}

/// Ranks of what differs.
struct SignedRanks {
    /// Of the sizes.
    ranks: Ranks,
    /// Doubled sum of those for more.
    plus: u64,
    /// Doubled sum of those for less.
    minus: u64,
}

impl SignedRanks {
    fn of(differences: &[f64], tolerance: f64) -> Option<Self> {
        let signed: Vec<f64> = differences.iter().copied().filter(|d| d.abs() > tolerance).collect();
        let ranks = Ranks::of(&signed.iter().map(|d| d.abs()).collect::<Vec<_>>(), tolerance);
        let sum = |positive: bool| -> u64 {
            let own = signed.iter().zip(&ranks.doubled).filter(|(d, _)| (**d > 0.0) == positive);
            own.map(|(_, rank)| rank).sum()
        };
        let (plus, minus) = (sum(true), sum(false));
        (!signed.is_empty()).then_some(Self { ranks, plus, minus })
    }
}

/// Twice the chance of a doubled sum of `min_sum` or less, at most one.
fn exact_p(doubled: &[u64], min_sum: u64) -> f64 {
    let total: u64 = doubled.iter().sum();
    let mut probabilities = vec![0.0; total as usize + 1];
    probabilities[0] = 1.0;
    let mut reached = 0;
    for rank in doubled {
        let rank = *rank as usize;
        for sum in (0..=reached).rev() {
            let half = probabilities[sum] / 2.0;
            probabilities[sum] = half;
            probabilities[sum + rank] += half;
        }
        reached += rank;
    }
    (2.0 * probabilities[..=min_sum as usize].iter().sum::<f64>()).min(1.0)
}

fn normal_p(n: usize, ranks: &Ranks, plus: u64) -> f64 {
    let n = n as f64;
    let variance = (n * (n + 1.0) * (2.0 * n + 1.0) - ranks.ties / 2.0) / 24.0;
    let z = (plus as f64 / 2.0 - n * (n + 1.0) / 4.0) / variance.sqrt();
    2.0 * Normal::standard().sf(z.abs())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn five_differences_to_one_side_are_one_chance_in_sixteen() {
        let test = wilcoxon(&[1.0, 2.0, 3.0, 4.0, 5.0, 0.0]).unwrap();
        assert_eq!((test.n, test.zeros, test.w_plus, test.w_minus), (5, 1, 15.0, 0.0));
        assert_eq!((test.p, test.min_p, test.rank_biserial()), (0.0625, 0.0625, 1.0));
    }

    #[test]
    fn ties_are_counted_out() {
        // |d| = 1, 1, 2: ranks 1.5, 1.5, 3. W+ = 4.5 of 6; sums 0, 1.5, 1.5, 3, 3, 4.5, 4.5, 6: three of eight up to 1.5.
        let test = wilcoxon(&[1.0, -1.0, 2.0]).unwrap();
        assert_eq!((test.w_plus, test.w_minus, test.p), (4.5, 1.5, 0.75));
    }

    #[test]
    fn nothing_to_compare_is_refused() {
        assert!(matches!(wilcoxon(&[]), Err(StatisticsError::TooFew { got: 0, .. })));
        assert_eq!(wilcoxon(&[0.0, 0.0]).unwrap_err(), StatisticsError::AllEqual { test: TEST });
        assert!(wilcoxon(&[1.0, f64::INFINITY]).is_err());
    }

    /// The same difference, from values that are stored with rounding, was ranked as two: p was 0.922 for 0.945.
    #[test]
    fn differences_that_are_equal_but_for_rounding_are_tied_and_zero() {
        let test = wilcoxon(&[0.760_999_999_999_999_2, -0.761_000_000_000_001, 0.5]).unwrap();
        assert_eq!((test.w_plus, test.w_minus), (3.5, 2.5));
        // 0.1 + 0.2 is not 0.3, and 1e6 + 0.1 less 1e6 is off by 1e-11.
        let pairs = [[0.1 + 0.2, 0.3], [1e6, 1e6 + 0.1], [0.1, 0.0], [0.0, 5.0]];
        let test = wilcoxon_of_pairs(&pairs).unwrap();
        assert_eq!((test.n, test.zeros, test.w_plus, test.w_minus), (3, 1, 4.5, 1.5));
        let equal = wilcoxon_of_pairs(&[[0.1 + 0.2, 0.3], [7.0, 7.0]]);
        assert_eq!(equal.unwrap_err(), StatisticsError::AllEqual { test: TEST });
    }

    #[test]
    fn a_sum_at_its_middle_is_no_chance_at_all() {
        assert_eq!(wilcoxon(&[1.0, -1.0]).unwrap().p, 1.0);
    }
}
