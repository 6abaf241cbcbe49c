/// Chances of several tests of one question, corrected together so that the chance of any false alarm keeps the level.
///
/// Source: Holm 1979, Scand J Stat 6:65. Presumes nothing on how the tests depend on each other.
pub fn holm(p_values: &[f64]) -> Vec<f64> {
    let mut order: Vec<usize> = (0..p_values.len()).collect();
    order.sort_by(|a, b| p_values[*a].total_cmp(&p_values[*b]));
    let mut corrected = vec![0.0; p_values.len()];
    let mut largest: f64 = 0.0;
    for (rank, index) in order.into_iter().enumerate() {
        largest = largest.max(p_values[index] * (p_values.len() - rank) as f64).min(1.0);
        corrected[index] = largest;
    }
    corrected
}

/// [`holm`] over all pairs of conditions that a study compares. A pair without a test (nobody differs, or nobody has both values) counts
/// as one with p = 1: whether a pair is compared is decided before the data are seen, so it cannot fall out of the correction.
pub fn holm_of_pairs(p_values: &[Option<f64>]) -> Vec<Option<f64>> {
    let all: Vec<f64> = p_values.iter().map(|p_value| p_value.unwrap_or(1.0)).collect();
    holm(&all).into_iter().zip(p_values).map(|(corrected, tested)| tested.map(|_| corrected)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_later_chance_is_never_below_an_earlier_one() {
        // By hand: 0.01 x 4, 0.02 x 3, 0.03 x 2 -> 0.06, 0.5 x 1.
        let corrected = holm(&[0.5, 0.01, 0.03, 0.02]);
        for (found, expected) in corrected.iter().zip([0.5, 0.04, 0.06, 0.06]) {
            assert!((found - expected).abs() < 1e-15, "{corrected:?}");
        }
        assert_eq!(holm(&[0.7, 0.9]), [1.0, 1.0]);
        assert!(holm(&[]).is_empty());
    }
}
