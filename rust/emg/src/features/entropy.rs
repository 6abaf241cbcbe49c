//! Entropies of a window: how rarely patterns that are alike stay alike for one sample more. Both compare every pattern with
//! every other one, so that their cost grows with the square of the window's length.

use crate::lanes::{Lanes, each, mean, ones};

/// Samples in the shorter patterns.
const DIMENSION: usize = 2;
/// Largest difference of like samples, in standard deviations.
const TOLERANCE: f64 = 0.3;

/// Sample entropy. `standardised` is filled with the window less its mean over its standard deviation.
pub(crate) fn sample_entropy(x: &[Lanes], standardised: &mut [Lanes]) -> Lanes {
    let (mean, spread) = mean_and_spread(x);
    for (to, from) in standardised.iter_mut().zip(x) {
        *to = (*from - mean) / spread;
    }
    let tolerance = Lanes::splat(TOLERANCE);
    // Pairs of patterns that are alike, of both lengths, and those of them with the last pattern.
    let (mut pairs, mut with_last) = ([Lanes::ZERO; 2], [Lanes::ZERO; 2]);
    for lag in 1..x.len() {
        let (mut near, mut like) = (Lanes::ZERO, [Lanes::ZERO; 2]);
        for (one, other) in standardised.iter().zip(&standardised[lag..]) {
            let before = std::mem::replace(&mut near, (*one - *other).abs().simd_le(tolerance));
            like = [before & near, like[0] & near];
            pairs[0] += ones(like[0]);
            pairs[1] += ones(like[1]);
        }
        with_last[0] += ones(like[0]);
        with_last[1] += ones(like[1]);
    }
    // Each of two patterns is compared with the other one; the last one is compared with none itself.
    let alike = |k: usize| {
        let compared = (x.len() - DIMENSION - 1) * (x.len() - DIMENSION - k);
        (pairs[k] * 2.0 - with_last[k]) / compared as f64
    };
    // No pattern is like another one where there is no scale, at either length.
    logarithm_of_ratio(alike(0), alike(1)) & !spread.simd_eq(Lanes::ZERO)
}

/// Fuzzy entropy: likeness falls off smoothly, and the mean of a pattern does not count.
pub(crate) fn fuzzy_entropy(x: &[Lanes]) -> Lanes {
    let tolerance = mean_and_spread(x).1 * TOLERANCE;
    logarithm_of_ratio(likeness::<DIMENSION>(x, tolerance), likeness::<{ DIMENSION + 1 }>(x, tolerance))
}

fn likeness<const LENGTH: usize>(x: &[Lanes], tolerance: Lanes) -> Lanes {
    let patterns = x.len() - LENGTH + 1;
    let centred = |at: usize| -> [Lanes; LENGTH] {
        let mean = mean(&x[at..at + LENGTH]);
        std::array::from_fn(|k| x[at + k] - mean)
    };
    let like = |one: &[Lanes; LENGTH], other: &[Lanes; LENGTH]| {
        let distances = one.iter().zip(other).map(|(p, q)| (*p - *q).abs());
        let distance = distances.fold(Lanes::ZERO, Lanes::fast_max);
        (-(distance * distance) / tolerance).exp()
    };
    // Each of two patterns is compared with the other one; the last one is compared with none itself.
    let last = centred(patterns - 1);
    let mut sum = Lanes::ZERO;
    for a in 0..patterns - 1 {
        let one = centred(a);
        let later: Lanes = (a + 1..patterns - 1).map(|b| like(&one, &centred(b))).sum();
        sum += later * 2.0 + like(&one, &last);
    }
    sum / ((x.len() - LENGTH - 1) * (x.len() - LENGTH)) as f64
}

fn logarithm_of_ratio(shorter: Lanes, longer: Lanes) -> Lanes {
    each((shorter + f64::EPSILON) / (longer + f64::EPSILON), f64::ln)
}

fn mean_and_spread(x: &[Lanes]) -> (Lanes, Lanes) {
    let mean = mean(x);
    let squares = x.iter().map(|v| (*v - mean) * (*v - mean));
    (mean, (squares.sum::<Lanes>() / x.len() as f64).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lanes::lanes_of;

    #[test]
    fn a_rhythm_has_less_entropy_than_noise() {
        // The second is Weyl's sequence: evenly spread, without a period in the window. The third has no spread.
        let sample = |k: u32| [(f64::from(k) * 0.5).sin(), (f64::from(k * k) * 0.618_034).fract(), 1.0];
        let x: Vec<Lanes> = (0..100).map(|k| lanes_of(&sample(k))).collect();
        let mut scratch = vec![Lanes::ZERO; 100];
        let [rhythm, noise, constant, _] = sample_entropy(&x, &mut scratch).to_array();
        assert!(rhythm < 0.5 * noise && constant == 0.0, "{rhythm} {noise} {constant}");
        let [rhythm, noise, ..] = fuzzy_entropy(&x).to_array();
        assert!(rhythm < noise, "{rhythm} {noise}");
    }
}
