use super::{PValueMethod, StatisticsError, check_finite, wilcoxon::PairedDifferences};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::Serialize;

/// Up to so many differences every choice of signs is tried.
const MAX_EXACT_DIFFERENCES: usize = 20;
/// Choices of signs that are drawn for more.
const MONTE_CARLO_DRAWS: u32 = 100_000;
/// Two sums that differ by less than this share of what they could be are equal: they were added in another order.
const TIE_TOLERANCE: f64 = 1e-12;

/// Permutation test of the mean of paired differences, two-sided.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct PermutationTest {
    /// Differences, zeros included.
    pub n: usize,
    /// Their mean.
    pub mean: f64,
    /// Chance of a mean as far from zero, if each difference were as likely to have the other sign.
    pub p: f64,
    /// How that chance was found.
    #[serde(rename = "chance")]
    pub p_method: PValueMethod,
}

/// The test of `differences`, by the signs that they could have. Drawn signs (more than 20 differences) come from `seed`.
///
/// Presumes that, without an effect, the two values of a person could be exchanged. Source: Fisher, The Design of
/// Experiments, 1935, section 21.
///
/// # Errors
/// No difference; a value that is not finite.
pub fn paired_permutation(differences: &[f64], seed: u64) -> Result<PermutationTest, StatisticsError> {
    test(differences, 0.0, seed)
}

impl PairedDifferences {
    /// As [`paired_permutation`]. Sums that rounding of the pairs' values alone tells apart are equal.
    pub(super) fn permutation(&self, seed: u64) -> Result<PermutationTest, StatisticsError> {
        test(&self.values, self.tolerance, seed)
    }
}

fn test(differences: &[f64], tolerance: f64, seed: u64) -> Result<PermutationTest, StatisticsError> {
    check_finite(0, differences)?;
    let n = differences.len();
    if n == 0 {
        let (test, what) = ("the paired permutation test", "differences");
        return Err(StatisticsError::TooFew { test, what, least: 1, got: 0 });
    }
    let sum: f64 = differences.iter().sum();
    let max_sum: f64 = differences.iter().map(|d| d.abs()).sum();
    let limit = sum.abs() - (TIE_TOLERANCE * max_sum).max(n as f64 * tolerance);
    let exact = n <= MAX_EXACT_DIFFERENCES;
    let p = if exact {
        count_as_extreme(differences, 0.0, limit) as f64 / (1_u64 << n) as f64
    } else {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut as_far = 0;
        for _ in 0..MONTE_CARLO_DRAWS {
            let mut signs = 0_u64;
            let drawn: f64 = differences
                .iter()
                .enumerate()
                .map(|(index, difference)| {
                    if index % 64 == 0 {
                        signs = rng.next_u64();
                    }
                    if signs >> (index % 64) & 1 == 1 { *difference } else { -difference }
                })
                .sum();
            as_far += u32::from(drawn.abs() >= limit);
        }
        // The choice that was observed is one of them (Phipson and Smyth 2010).
        f64::from(as_far + 1) / f64::from(MONTE_CARLO_DRAWS + 1)
    };
    let p_method = if exact { PValueMethod::Exact } else { PValueMethod::MonteCarlo };
    Ok(PermutationTest { n, mean: sum / n as f64, p, p_method })
}

/// How many choices of signs for `rest` bring `sum` as far from zero as `limit`.
fn count_as_extreme(rest: &[f64], sum: f64, limit: f64) -> u64 {
    match rest {
        [] => u64::from(sum.abs() >= limit),
        [first, rest @ ..] => {
            count_as_extreme(rest, sum + first, limit) + count_as_extreme(rest, sum - first, limit)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn signs_are_counted_out_by_hand() {
        // Sums of 1, 2, 4 with all signs: 7, 5, 3, 1 and their negatives. As far as 5: four of eight.
        let test = paired_permutation(&[-1.0, 2.0, 4.0], 1).unwrap();
        assert_eq!((test.p, test.p_method), (0.5, PValueMethod::Exact));
        assert!((test.mean - 5.0 / 3.0).abs() < 1e-12);
        assert_eq!(paired_permutation(&[0.0, 0.0], 1).unwrap().p, 1.0);
    }

    // Sums of values near 1000 were told apart by their rounding: p was 0.5625. In hundredths, less 1000, it is 0.625.
    #[test]
    fn sums_that_rounding_tells_apart_are_equal() {
        let a = [1002.26, 1002.15, 1000.95, 1002.18, 1000.56, 1000.22];
        let b = [1002.25, 1002.15, 1000.98, 1002.20, 1000.59, 1000.19];
        let pairs: Vec<[f64; 2]> = a.into_iter().zip(b).map(|(a, b)| [a, b]).collect();
        let whole: Vec<f64> = pairs.iter().map(|[a, b]| ((b - a) * 100.0).round()).collect();
        assert_eq!(paired_permutation(&whole, 1).unwrap().p, 0.625);
        assert_eq!(PairedDifferences::of(&pairs).permutation(1).unwrap().p, 0.625);
    }

    #[test]
    fn drawn_signs_come_near_the_counted_ones_and_hang_on_the_seed() {
        let differences: Vec<f64> = (0..20).map(|i| f64::from(i % 7) - 2.2).collect();
        let counted = paired_permutation(&differences, 1).unwrap().p;
        let mut more = differences.clone();
        more.push(0.0);
        let drawn = |seed| paired_permutation(&more, seed).unwrap();
        assert!((drawn(1).p - counted).abs() < 0.01, "{counted} {:?}", drawn(1));
        assert_eq!(drawn(1), drawn(1));
        assert_ne!(drawn(1), drawn(2));
    }
}
