//! Ranks, of which equal values share the mean.

/// Values that differ by less than this share of the largest size are tied. The same quantity computed in two ways (12.345 - 11.584
/// and 0.761) differs by rounding: a sum of n doubles is off by at most n 1.1e-16 of its size, and means here are of at most some
/// thousands of values. No measure has twelve significant digits, so no real difference is lost.
pub(super) const TIE_TOLERANCE: f64 = 1e-12;

/// Whether `a` and `b` are equal but for rounding.
pub fn tied(a: f64, b: f64) -> bool {
    (a - b).abs() <= TIE_TOLERANCE * max_abs([a, b])
}

/// The size of the largest of `values`: what [`TIE_TOLERANCE`] is a share of.
pub(super) fn max_abs(values: impl IntoIterator<Item = f64>) -> f64 {
    values.into_iter().fold(0.0, |max, value| value.abs().max(max))
}

/// Ranks of some values, doubled so that shared ones are whole numbers.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Ranks {
    /// Twice the rank of each value, from 2; equal values have the mean of their places.
    pub(super) doubled: Vec<u64>,
    /// Sum of t^3 - t over the groups of t equal values.
    pub(super) ties: f64,
}

impl Ranks {
    /// Of finite `values`. Those no more than `tolerance` above the smallest of a group belong to it, so that a long chain of close
    /// values is not one group.
    pub(super) fn of(values: &[f64], tolerance: f64) -> Self {
        let mut order: Vec<usize> = (0..values.len()).collect();
        order.sort_by(|a, b| values[*a].total_cmp(&values[*b]));
        let mut ranks = Ranks { doubled: vec![0; values.len()], ties: 0.0 };
        let mut first = 0;
        while let Some(smallest) = order.get(first).map(|index| values[*index]) {
            let group = &order[first..];
            let count = group.partition_point(|index| values[*index] - smallest <= tolerance);
            // Places first + 1 to first + count; twice their mean is 2 first + count + 1.
            for index in &group[..count] {
                ranks.doubled[*index] = (2 * first + count + 1) as u64;
            }
            let t = count as f64;
            ranks.ties += t * t * t - t;
            first += count;
        }
        ranks
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_values_share_the_mean_of_their_places() {
        let ranks = Ranks::of(&[3.0, -1.0, 3.0, 0.0, -0.0, 7.0], 0.0);
        assert_eq!(ranks.doubled, [9, 2, 9, 5, 5, 12]);
        assert_eq!(ranks.ties, 12.0);
    }

    #[test]
    fn values_that_differ_by_rounding_are_tied_and_a_chain_of_close_values_is_not() {
        let ranks = Ranks::of(&[0.761_000_000_000_001, 0.5, 0.760_999_999_999_999_2], TIE_TOLERANCE);
        assert_eq!((ranks.doubled, ranks.ties), (vec![5, 2, 5], 6.0));
        assert_eq!(Ranks::of(&[0.0, 0.75, 1.5, 2.25], 1.0).doubled, [3, 3, 7, 7]);
    }
}
