//! Ranks, of which equal values share the mean.

/// Ranks of some values, doubled so that shared ones are whole numbers.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Ranks {
    /// Twice the rank of each value, from 2; equal values have the mean of their places.
    pub(super) doubled: Vec<u64>,
    /// Sum of t^3 - t over the groups of t equal values.
    pub(super) ties: f64,
}

impl Ranks {
    /// Of values that are all finite.
    pub(super) fn of(values: &[f64]) -> Self {
        let mut order: Vec<usize> = (0..values.len()).collect();
        order.sort_by(|a, b| values[*a].total_cmp(&values[*b]));
        let mut ranks = Ranks { doubled: vec![0; values.len()], ties: 0.0 };
        let mut first = 0;
        for group in order.chunk_by(|a, b| values[*a] == values[*b]) {
            // Places first + 1 to first + t; twice their mean is 2 first + t + 1.
            for index in group {
                ranks.doubled[*index] = (2 * first + group.len() + 1) as u64;
            }
            let t = group.len() as f64;
            ranks.ties += t * t * t - t;
            first += group.len();
        }
        ranks
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_values_share_the_mean_of_their_places() {
        let ranks = Ranks::of(&[3.0, -1.0, 3.0, 0.0, -0.0, 7.0]);
        assert_eq!(ranks.doubled, [9, 2, 9, 5, 5, 12]);
        assert_eq!(ranks.ties, 12.0);
    }
}
