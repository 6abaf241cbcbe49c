use super::{
    PValueMethod, StatisticsError, check_finite,
    ranks::{Ranks, TIE_TOLERANCE, max_abs},
};
use serde::Serialize;
use statrs::distribution::{ChiSquared, ContinuousCDF};
use std::collections::BTreeMap;

const TEST: &str = "Friedman's test";
/// More sets of rank sums than this are not enumerated.
const MAX_STATES: usize = 20_000;
/// More orders of one person's values than this are not enumerated.
const MAX_PERMUTATIONS: usize = 720;

/// Friedman's test that conditions do not differ, with Kendall's coefficient of concordance.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Friedman {
    /// People with a value under every condition.
    pub n: usize,
    /// Chi square of the rank sums, corrected for ties.
    pub statistic: f64,
    /// Conditions less one.
    pub degrees_of_freedom: usize,
    /// Chance of as large a statistic if the conditions did not differ.
    pub p: f64,
    /// How that chance was found.
    #[serde(rename = "chance")]
    pub p_method: PValueMethod,
    /// Kendall's W, 0 to 1: how much people agree about the order of the conditions.
    pub kendalls_w: f64,
    /// Mean rank of each condition; rank 1 is the smallest value.
    pub mean_ranks: Vec<f64>,
}

/// Friedman's test of `rows`: `[people][conditions]`.
///
/// Presumes that people are independent of each other. Values of a person that differ by rounding alone are tied. Exact given the ties (each order of a person's values is as likely as
/// any other) as long as the distinct sets of rank sums stay below 20,000 (some 20 people under 4 conditions); else by the
/// chi square distribution. Source: Friedman 1937, J Am Stat Assoc 32:675; ties as in Conover, Practical Nonparametric
/// Statistics, 3rd ed., 5.8. W = chi square / (n (k - 1)), Kendall and Babington Smith 1939.
///
/// # Errors
/// Fewer than two people or three conditions; nobody's values differ; a value that is not finite; rows of unequal length.
pub fn friedman(rows: &[Vec<f64>]) -> Result<Friedman, StatisticsError> {
    let RankSums { ranks, sums, statistic } = RankSums::of(rows)?;
    let (n, conditions) = (rows.len() as f64, sums.len());
    let degrees = (conditions - 1) as f64;
    let exact = exact_rank_sum_p(&ranks, sum_of_squares(&sums));
    let approximate = || ChiSquared::new(degrees).map_or(f64::NAN, |chi| chi.sf(statistic));
    Ok(Friedman {
        n: rows.len(),
        statistic,
        degrees_of_freedom: conditions - 1,
        p: exact.unwrap_or_else(approximate),
        p_method: if exact.is_some() { PValueMethod::Exact } else { PValueMethod::Asymptotic },
        kendalls_w: statistic / (n * degrees),
        mean_ranks: sums.iter().map(|sum| *sum as f64 / 2.0 / n).collect(),
    })
}

/// Kendall's W alone, without the count of all orders; none where there is none.
pub(super) fn kendalls_w(rows: &[Vec<f64>]) -> Option<f64> {
    let RankSums { sums, statistic, .. } = RankSums::of(rows).ok()?;
    Some(statistic / (rows.len() * (sums.len() - 1)) as f64)
}

/// The chance by the chi square distribution alone; none where there is none.
pub(crate) fn friedman_asymptotic_p(rows: &[Vec<f64>]) -> Option<f64> {
    let RankSums { sums, statistic, .. } = RankSums::of(rows).ok()?;
    Some(ChiSquared::new((sums.len() - 1) as f64).ok()?.sf(statistic))
}

/// What the conditions' ranks add up to.
struct RankSums {
    /// Of each person.
    ranks: Vec<Ranks>,
    /// Of each condition, doubled.
    sums: Vec<u64>,
    /// Chi square.
    statistic: f64,
}

impl RankSums {
    fn of(rows: &[Vec<f64>]) -> Result<Self, StatisticsError> {
        let conditions = rows.first().map_or(0, Vec::len);
        for (what, min_count, got) in [("people", 2, rows.len()), ("conditions", 3, conditions)] {
            if got < min_count {
                return Err(StatisticsError::TooFew { test: TEST, what, least: min_count, got });
            }
        }
        for (row, values) in rows.iter().enumerate() {
            if values.len() != conditions {
                return Err(StatisticsError::Ragged { row, got: values.len(), expected: conditions });
            }
            check_finite(row, values)?;
        }
        let of = |row: &Vec<f64>| Ranks::of(row, TIE_TOLERANCE * max_abs(row.iter().copied()));
        let ranks: Vec<Ranks> = rows.iter().map(of).collect();
        let (n, k) = (rows.len() as f64, conditions as f64);
        let ties: f64 = ranks.iter().map(|row| row.ties).sum();
        let spread = 1.0 - ties / (n * k * (k * k - 1.0));
        if spread <= 0.0 {
            return Err(StatisticsError::AllEqual { test: TEST });
        }
        let sums: Vec<u64> = (0..conditions).map(|j| ranks.iter().map(|row| row.doubled[j]).sum()).collect();
        // Sums are doubled, so their squares are fourfold.
        let squares = sum_of_squares(&sums) as f64 / 4.0;
        let statistic = (12.0 / (n * k * (k + 1.0)) * squares - 3.0 * n * (k + 1.0)) / spread;
        Ok(Self { ranks, sums, statistic: statistic.max(0.0) })
    }
}

fn sum_of_squares(sums: &[u64]) -> u64 {
    sums.iter().map(|sum| sum * sum).sum()
}

/// Chance that the squared rank sums come to `observed` or more if every order of each row is as likely; none if there are too
/// many to count.
///
/// The sums are kept sorted: which condition has which does not matter to their squares, nor to what the next row can add.
fn exact_rank_sum_p(ranks: &[Ranks], observed: u64) -> Option<f64> {
    let conditions = ranks.first()?.doubled.len();
    let mut states = BTreeMap::from([(vec![0_u64; conditions], 1.0_f64)]);
    for row in ranks {
        let orders = distinct_permutations(&row.doubled)?;
        let weight = 1.0 / orders.len() as f64;
        let mut next = BTreeMap::new();
        for (sums, probability) in &states {
            for order in &orders {
                let mut sums: Vec<u64> = sums.iter().zip(order).map(|(sum, rank)| sum + rank).collect();
                sums.sort_unstable();
                *next.entry(sums).or_insert(0.0) += probability * weight;
            }
        }
        if next.len() > MAX_STATES {
            return None;
        }
        states = next;
    }
    let p_value: f64 =
        states.iter().filter(|(sums, _)| sum_of_squares(sums) >= observed).map(|(_, c)| c).sum();
    Some(p_value.min(1.0))
}

/// All distinct orders of some ranks, in lexical order.
fn distinct_permutations(ranks: &[u64]) -> Option<Vec<Vec<u64>>> {
    let mut order = ranks.to_vec();
    order.sort_unstable();
    let mut all = vec![order.clone()];
    // The next order in the lexical sense, until there is none.
    while let Some(pivot) = (1..order.len()).rev().find(|i| order[i - 1] < order[*i]) {
        let swap = (pivot..order.len()).rev().find(|i| order[*i] > order[pivot - 1])?;
        order.swap(pivot - 1, swap);
        order[pivot..].reverse();
        if all.len() >= MAX_PERMUTATIONS {
            return None;
        }
        all.push(order.clone());
    }
    Some(all)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn three_people_who_agree_wholly_are_a_chance_of_one_in_thirty_six() {
        let rows = vec![vec![1.0, 2.0, 3.0], vec![10.0, 20.0, 30.0], vec![-3.0, 0.0, 5.0]];
        let test = friedman(&rows).unwrap();
        // By hand: sums 3, 6, 9; 12 / (3 3 4) 126 - 36 = 6; W = 6 / 6. Of 6^3 orders 6 agree wholly.
        assert!((test.statistic - 6.0).abs() < 1e-12 && (test.kendalls_w - 1.0).abs() < 1e-12);
        assert!((test.p - 6.0 / 216.0).abs() < 1e-12, "{test:?}");
        assert_eq!((test.p_method, test.mean_ranks), (PValueMethod::Exact, vec![1.0, 2.0, 3.0]));
    }

    #[test]
    fn ties_count_as_they_are() {
        // Two people, three conditions: (1, 1, 2) and (1, 2, 2). By hand: sums 1.5 + 1, 1.5 + 2.5, 3 + 2.5 = 2.5, 4, 5.5;
        // squares 52.5; ties 6 + 6; correction 1 - 12 / 48 = 3/4; (12 / 24 52.5 - 24) / 0.75 = 3.
        let test = friedman(&[vec![0.0, 0.0, 1.0], vec![0.0, 1.0, 1.0]]).unwrap();
        assert!((test.statistic - 3.0).abs() < 1e-12, "{test:?}");
        // Of nine pairs of orders, the odd one up meets the odd one down elsewhere in six.
        assert!((test.p - 6.0 / 9.0).abs() < 1e-12, "{test:?}");
    }

    /// Rounding was ranked: a person with equal values was counted as one who prefers.
    #[test]
    fn values_that_are_equal_but_for_rounding_are_tied() {
        let rounded = friedman(&[vec![0.1 + 0.2, 0.3, 1.0], vec![0.0, 1.0, 1.0]]).unwrap();
        assert_eq!(rounded, friedman(&[vec![0.3, 0.3, 1.0], vec![0.0, 1.0, 1.0]]).unwrap());
        assert!(friedman(&[vec![0.1 + 0.2, 0.3, 0.3], vec![1.0; 3]]).is_err());
    }

    #[test]
    fn what_cannot_be_compared_is_refused() {
        let few = |what, min_count, got| StatisticsError::TooFew { test: TEST, what, least: min_count, got };
        assert_eq!(friedman(&[]).unwrap_err(), few("people", 2, 0));
        assert_eq!(friedman(&[vec![1.0, 2.0], vec![1.0, 2.0]]).unwrap_err(), few("conditions", 3, 2));
        assert_eq!(
            friedman(&[vec![4.0; 3], vec![1.0; 3]]).unwrap_err(),
            StatisticsError::AllEqual { test: TEST }
        );
        let ragged = friedman(&[vec![1.0, 2.0, 3.0], vec![1.0]]).unwrap_err();
        assert_eq!(ragged, StatisticsError::Ragged { row: 1, got: 1, expected: 3 });
        assert!(friedman(&[vec![1.0, f64::NAN, 3.0], vec![1.0; 3]]).is_err());
    }

    #[test]
    fn many_people_are_left_to_the_chi_square_distribution() {
        let rows: Vec<Vec<f64>> = (0..200).map(|i| (0..5).map(|j| f64::from(i * j % 7)).collect()).collect();
        assert_eq!(friedman(&rows).unwrap().p_method, PValueMethod::Asymptotic);
        assert_eq!(friedman(&rows[..8]).unwrap().p_method, PValueMethod::Exact);
    }
}
