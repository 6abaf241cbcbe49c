//! Entropies of a window: how rarely patterns that are alike stay alike for one sample more. Both compare every pattern with
//! every other one, so that their cost grows with the square of the window's length.

/// Samples in the shorter patterns.
const DIMENSION: usize = 2;
/// Largest difference of like samples, in standard deviations.
const TOLERANCE: f64 = 0.3;

/// Sample entropy. `standardised` is filled with the window less its mean over its standard deviation.
pub(crate) fn sample_entropy(x: &[f64], standardised: &mut [f64]) -> f64 {
    let (mean, spread) = mean_and_spread(x);
    for (to, from) in standardised.iter_mut().zip(x) {
        *to = (from - mean) / spread;
    }
    if spread == 0.0 {
        // No pattern is like another one where there is no scale, at either length.
        return 0.0;
    }
    let alike = |length: usize| {
        let patterns = x.len() - length + 1;
        let like = |a: usize, b: usize| {
            (0..length).all(|k| (standardised[a + k] - standardised[b + k]).abs() <= TOLERANCE)
        };
        // The last pattern is compared with the others, not they with it.
        let count = |a: usize| (0..patterns).filter(|b| *b != a && like(a, *b)).count() as f64;
        let sum: f64 = (0..patterns - 1).map(count).sum();
        sum / ((x.len() - DIMENSION - 1) * (x.len() - length)) as f64
    };
    logarithm_of_ratio(alike(DIMENSION), alike(DIMENSION + 1))
}

/// Fuzzy entropy: likeness falls off smoothly, and the mean of a pattern does not count.
pub(crate) fn fuzzy_entropy(x: &[f64]) -> f64 {
    let tolerance = TOLERANCE * mean_and_spread(x).1;
    logarithm_of_ratio(likeness::<DIMENSION>(x, tolerance), likeness::<{ DIMENSION + 1 }>(x, tolerance))
}

fn likeness<const LENGTH: usize>(x: &[f64], tolerance: f64) -> f64 {
    let patterns = x.len() - LENGTH + 1;
    let centred = |at: usize| -> [f64; LENGTH] {
        let mean = x[at..at + LENGTH].iter().sum::<f64>() / LENGTH as f64;
        std::array::from_fn(|k| x[at + k] - mean)
    };
    let mut sum = 0.0;
    for a in 0..patterns - 1 {
        let one = centred(a);
        let mut likes = 0.0;
        for b in 0..patterns {
            let other = centred(b);
            let distance = one.iter().zip(&other).map(|(p, q)| (p - q).abs()).fold(0.0, f64::max);
            likes += (-distance.powi(2) / tolerance).exp();
        }
        // Less the pattern itself.
        sum += (likes - 1.0) / (x.len() - LENGTH - 1) as f64;
    }
    sum / (x.len() - LENGTH) as f64
}

fn logarithm_of_ratio(shorter: f64, longer: f64) -> f64 {
    ((shorter + f64::EPSILON) / (longer + f64::EPSILON)).ln()
}

fn mean_and_spread(x: &[f64]) -> (f64, f64) {
    let count = x.len() as f64;
    let mean = x.iter().sum::<f64>() / count;
    (mean, (x.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / count).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rhythm_has_less_entropy_than_noise() {
        let rhythm: Vec<f64> = (0..100).map(|k| (f64::from(k) * 0.5).sin()).collect();
        // Weyl's sequence: evenly spread, without a period in the window.
        let noise: Vec<f64> = (0..100_u32).map(|k| (f64::from(k * k) * 0.618_034).fract()).collect();
        let mut scratch = vec![0.0; 100];
        assert!(sample_entropy(&rhythm, &mut scratch) < 0.5 * sample_entropy(&noise, &mut scratch));
        assert!(fuzzy_entropy(&rhythm) < fuzzy_entropy(&noise));
    }
}
