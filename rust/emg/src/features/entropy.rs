//! Entropies of a window: how rarely patterns that are alike stay alike for one sample more. Both compare every pattern with
//! every other one, so that their cost grows with the square of the window's length.

use crate::lanes::{Lanes, Mask, exp, ln, mask_to_one, mean, select_or_zero, sum};
use fearless_simd::prelude::*;

/// Samples in the shorter patterns.
const DIMENSION: usize = 2;
/// Largest difference of like samples, in standard deviations.
const TOLERANCE: f64 = 0.3;

/// Sample entropy. `standardized` is filled with the window less its mean over its standard deviation.
#[inline(always)]
pub(crate) fn sample_entropy<S: Simd>(x: &[Lanes<S>], standardized: &mut [Lanes<S>]) -> Lanes<S> {
    let (mean, spread) = mean_and_spread(x);
    for (to, from) in standardized.iter_mut().zip(x) {
        *to = (*from - mean) / spread;
    }
    let (zero, none) = (Lanes::splat(x[0].simd, 0.0), Mask::splat(x[0].simd, false));
    // Pairs of patterns that are alike, of both lengths, and those of them with the last pattern.
    let (mut pairs, mut with_last) = ([zero; 2], [zero; 2]);
    for lag in 1..x.len() {
        let (mut near, mut like) = (none, [none; 2]);
        for (one, other) in standardized.iter().zip(&standardized[lag..]) {
            let before = std::mem::replace(&mut near, (*one - *other).abs().simd_le(TOLERANCE));
            like = [before & near, like[0] & near];
            pairs[0] += mask_to_one(like[0]);
            pairs[1] += mask_to_one(like[1]);
        }
        with_last[0] += mask_to_one(like[0]);
        with_last[1] += mask_to_one(like[1]);
    }
    // Each of two patterns is compared with the other one; the last one is compared with none itself.
    let alike = |k: usize| {
        let compared = (x.len() - DIMENSION - 1) * (x.len() - DIMENSION - k);
        (pairs[k] * 2.0 - with_last[k]) / compared as f64
    };
    // No pattern is like another one where there is no scale, at either length.
    select_or_zero(!spread.simd_eq(0.0), logarithm_of_ratio(alike(0), alike(1)))
}

/// Fuzzy entropy: likeness falls off smoothly, and the mean of a pattern does not count.
#[inline(always)]
pub(crate) fn fuzzy_entropy<S: Simd>(x: &[Lanes<S>]) -> Lanes<S> {
    let tolerance = mean_and_spread(x).1 * TOLERANCE;
    logarithm_of_ratio(
        mean_similarity::<_, DIMENSION>(x, tolerance),
        mean_similarity::<_, { DIMENSION + 1 }>(x, tolerance),
    )
}

#[inline(always)]
fn mean_similarity<S: Simd, const LENGTH: usize>(x: &[Lanes<S>], tolerance: Lanes<S>) -> Lanes<S> {
    let zero = Lanes::splat(x[0].simd, 0.0);
    let patterns = x.len() - LENGTH + 1;
    // Each of two patterns is compared with the other one; the last one is compared with none itself.
    let last: [_; LENGTH] = subtract_mean(&x[patterns - 1..]);
    let mut likenesses = zero;
    for a in 0..patterns - 1 {
        let one = subtract_mean(&x[a..]);
        let later = sum!(zero.simd, b in a + 1..patterns - 1 => fuzzy_similarity(one, subtract_mean(&x[b..]), tolerance));
        likenesses += later * 2.0 + fuzzy_similarity(one, last, tolerance);
    }
    likenesses / ((x.len() - LENGTH - 1) * (x.len() - LENGTH)) as f64
}

/// The first samples less their mean.
#[inline(always)]
fn subtract_mean<S: Simd, const LENGTH: usize>(x: &[Lanes<S>]) -> [Lanes<S>; LENGTH] {
    let mean = mean(&x[..LENGTH]);
    let mut pattern = [mean; LENGTH];
    for (to, from) in pattern.iter_mut().zip(x) {
        *to = *from - mean;
    }
    pattern
}

/// Likeness of two patterns, at most one.
#[inline(always)]
fn fuzzy_similarity<S: Simd, const LENGTH: usize>(
    one: [Lanes<S>; LENGTH],
    other: [Lanes<S>; LENGTH],
    tolerance: Lanes<S>,
) -> Lanes<S> {
    let mut distance = Lanes::splat(tolerance.simd, 0.0);
    for (p, q) in one.into_iter().zip(other) {
        distance = distance.max((p - q).abs());
    }
    exp(-(distance * distance) / tolerance)
}

#[inline(always)]
fn logarithm_of_ratio<S: Simd>(shorter: Lanes<S>, longer: Lanes<S>) -> Lanes<S> {
    ln((shorter + f64::EPSILON) / (longer + f64::EPSILON))
}

#[inline(always)]
fn mean_and_spread<S: Simd>(x: &[Lanes<S>]) -> (Lanes<S>, Lanes<S>) {
    let mean = mean(x);
    let squares = sum!(mean.simd, v in x => (*v - mean) * (*v - mean));
    (mean, (squares / x.len() as f64).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lanes::AlignedLanes;
    use fearless_simd::{Level, dispatch};

    #[test]
    fn a_rhythm_has_less_entropy_than_noise() {
        // The second is Weyl's sequence: evenly spread, without a period in the window. The third has no spread.
        let samples = |k: u32| [(f64::from(k) * 0.5).sin(), (f64::from(k * k) * 0.618_034).fract(), 1.0];
        let (sample, fuzzy) = dispatch!(Level::new(), simd => {
            let x: Vec<_> = (0..100).map(|k| AlignedLanes::from(&samples(k)[..]).0.simd_into(simd)).collect();
            (sample_entropy(&x, &mut x.clone()).to_array(), fuzzy_entropy(&x).to_array())
        });
        let [rhythm, noise, constant, ..] = sample;
        assert!(rhythm < 0.5 * noise && constant == 0.0, "{rhythm} {noise} {constant}");
        let [rhythm, noise, ..] = fuzzy;
        assert!(rhythm < noise, "{rhythm} {noise}");
    }
}
