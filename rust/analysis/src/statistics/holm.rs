/// Chances of several tests of one question, corrected together so that the chance of any false alarm keeps the level.
///
/// Source: Holm 1979, Scand J Stat 6:65. Presumes nothing on how the tests hang together.
pub fn holm(chances: &[f64]) -> Vec<f64> {
    let mut order: Vec<usize> = (0..chances.len()).collect();
    order.sort_by(|a, b| chances[*a].total_cmp(&chances[*b]));
    let mut corrected = vec![0.0; chances.len()];
    let mut largest: f64 = 0.0;
    for (place, index) in order.into_iter().enumerate() {
        largest = largest.max(chances[index] * (chances.len() - place) as f64).min(1.0);
        corrected[index] = largest;
    }
    corrected
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
