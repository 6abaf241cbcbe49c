//! Sums over the samples of eight channels, each in one pass.

use crate::lanes::{Lanes, Mask, ln, mask_to_one, mean, mean_absolute, select_or_zero, sum};
use fearless_simd::prelude::*;

/// MAV and ZC.
#[inline(always)]
pub(crate) fn magnitude_and_crossings<S: Simd>(x: &[Lanes<S>]) -> [Lanes<S>; 2] {
    let signs = |value: Lanes<S>| (value.simd_gt(0.0), value.simd_lt(0.0));
    let (mut absolute, mut crossings, mut sign) = (x[0].abs(), zero(x), signs(x[0]));
    for value in &x[1..] {
        let next = signs(*value);
        absolute += value.abs();
        crossings += mask_to_one(sign.0 & next.1 | sign.1 & next.0);
        sign = next;
    }
    [absolute / x.len() as f64, crossings]
}

/// SSC and WL.
#[inline(always)]
pub(crate) fn slope_sign_changes_and_waveform_length<S: Simd>(
    x: &[Lanes<S>],
    ssc_threshold: f64,
) -> [Lanes<S>; 2] {
    let (mut last, mut slope) = (x[1], x[1] - x[0]);
    let (mut turns, mut length) = (zero(x), slope.abs());
    for value in &x[2..] {
        let next = *value - last;
        // (b - a) (b - c) >= threshold: the second factor is the next slope, negated.
        turns += mask_to_one((slope * next).simd_le(-ssc_threshold));
        length += next.abs();
        (last, slope) = (*value, next);
    }
    [turns, length]
}

/// Sums of the squares of a signal and of its first and second differences.
#[inline(always)]
pub(crate) fn squares<S: Simd>(x: &[Lanes<S>]) -> [Lanes<S>; 3] {
    let (mut last, mut slope) = (x[1], x[1] - x[0]);
    let mut sums = [x[0] * x[0] + x[1] * x[1], slope * slope, zero(x)];
    for value in &x[2..] {
        let next = *value - last;
        let bend = next - slope;
        sums[0] += *value * *value;
        sums[1] += next * next;
        sums[2] += bend * bend;
        (last, slope) = (*value, next);
    }
    sums
}

/// Sums of the magnitudes of the first and second differences of a signal.
#[inline(always)]
pub(crate) fn lengths<S: Simd>(x: &[Lanes<S>]) -> [Lanes<S>; 2] {
    let (mut last, mut slope) = (x[1], x[1] - x[0]);
    let mut sums = [slope.abs(), zero(x)];
    for value in &x[2..] {
        let next = *value - last;
        sums[0] += next.abs();
        sums[1] += (next - slope).abs();
        (last, slope) = (*value, next);
    }
    sums
}

/// Second, third and fourth central moment, and where the spread is rounding only.
#[inline(always)]
pub(crate) fn central_moments<S: Simd>(x: &[Lanes<S>]) -> ([Lanes<S>; 3], Mask<S>) {
    let count = x.len() as f64;
    let mean = mean(x);
    let mut sums = [zero(x); 3];
    for value in x {
        let from_mean = *value - mean;
        let square = from_mean * from_mean;
        sums[0] += square;
        sums[1] += from_mean * square;
        sums[2] += square * square;
    }
    let moments = [sums[0] / count, sums[1] / count, sums[2] / count];
    // The limit of SciPy.
    let limit = mean * f64::EPSILON;
    (moments, moments[0].simd_le(limit * limit))
}

/// Samples whose neighbour is further away than `threshold`.
#[inline(always)]
pub(crate) fn willison_amplitude<S: Simd>(x: &[Lanes<S>], threshold: f64) -> Lanes<S> {
    sum!(x[0].simd, pair in x.windows(2) => mask_to_one((pair[1] - pair[0]).abs().simd_gt(threshold)))
}

/// Magnitude of the mean root: those of negative samples are imaginary.
#[inline(always)]
pub(crate) fn mean_square_root<S: Simd>(x: &[Lanes<S>]) -> Lanes<S> {
    let (mut real, mut imaginary) = (zero(x), zero(x));
    for value in x {
        let (root, negative) = (value.abs().sqrt(), value.simd_lt(0.0));
        real += select_or_zero(!negative, root);
        imaginary += select_or_zero(negative, root);
    }
    // Roots of numbers are far from where squares overflow.
    (real * real + imaginary * imaginary).sqrt() / x.len() as f64
}

/// Second L-moment: 2 b1 - b0 with Hosking's unbiased weights (1990). Sorts `x`.
#[inline(always)]
pub(crate) fn l_score<S: Simd>(x: &mut [Lanes<S>]) -> Lanes<S> {
    sort(x);
    let last = x.len() as f64 - 1.0;
    let simd = x[0].simd;
    sum!(simd, (k, v) in x.iter().enumerate() => *v * (2.0 * k as f64 / last - 1.0)) / x.len() as f64
}

/// Sorts each lane: Batcher's exchanges (Knuth, The Art of Computer Programming 3, 5.2.2, algorithm M), the same ones
/// whatever the values are, so that eight channels are sorted at once.
#[inline(always)]
fn sort<S: Simd>(x: &mut [Lanes<S>]) {
    let largest = x.len().next_power_of_two() / 2;
    let mut group = largest;
    while group > 0 {
        let (mut offset, mut distance, mut merged) = (0, group, largest);
        loop {
            for start in (offset..x.len().saturating_sub(distance)).step_by(2 * group) {
                let (front, back) = x.split_at_mut(start + distance);
                for (a, b) in front[start..].iter_mut().take(group).zip(back) {
                    (*a, *b) = (a.min(*b), a.max(*b));
                }
            }
            if merged == group {
                break;
            }
            (distance, merged, offset) = (merged - group, merged / 2, group);
        }
        group /= 2;
    }
}

/// Largest sample.
#[inline(always)]
pub(crate) fn largest<S: Simd>(x: &[Lanes<S>]) -> Lanes<S> {
    let mut maximum = x[0];
    for value in &x[1..] {
        maximum = maximum.max(*value);
    }
    maximum
}

/// Mean magnitude of the third powers.
#[inline(always)]
pub(crate) fn mean_cube<S: Simd>(x: &[Lanes<S>]) -> Lanes<S> {
    sum!(x[0].simd, v in x => (*v * (*v * *v)).abs()) / x.len() as f64
}

/// Mean magnitude of the second half less that of the first.
#[inline(always)]
pub(crate) fn mav_slope<S: Simd>(x: &[Lanes<S>]) -> Lanes<S> {
    // The middle of an odd length is rounded to the even number, as Python rounds.
    let half = (x.len() as f64 / 2.0).round_ties_even() as usize;
    mean_absolute(&x[half..x.len().min(2 * half)]) - mean_absolute(&x[..half])
}

/// Samples whose logarithms are taken together.
const LOGARITHMS: usize = 25;
/// Products at a time: one alone waits for each of its multiplications.
const PRODUCTS: usize = 4;

/// Mean of the logarithms of the samples' magnitudes and one: that of products of several, unless they are too large for a
/// number.
#[inline(always)]
pub(crate) fn mean_logarithm<S: Simd>(x: &[Lanes<S>]) -> Lanes<S> {
    let mut logarithms = zero(x);
    for part in x.chunks(PRODUCTS * LOGARITHMS) {
        let mut products = [Lanes::splat(x[0].simd, 1.0); PRODUCTS];
        let (rows, rest) = part.as_chunks::<PRODUCTS>();
        for row in rows {
            for k in 0..PRODUCTS {
                products[k] *= row[k].abs() + 1.0;
            }
        }
        for (product, value) in products.iter_mut().zip(rest) {
            *product *= value.abs() + 1.0;
        }
        let largest = products[0].max(products[1]).max(products[2].max(products[3]));
        logarithms += if largest.simd_lt(f64::INFINITY).all_true() {
            sum!(x[0].simd, product in products => ln(product))
        } else {
            sum!(x[0].simd, v in part => ln(v.abs() + 1.0))
        };
    }
    logarithms / x.len() as f64
}

#[inline(always)]
fn zero<S: Simd>(x: &[Lanes<S>]) -> Lanes<S> {
    Lanes::splat(x[0].simd, 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lanes::LANES;
    use fearless_simd::{Level, dispatch};

    /// The same signal in every lane.
    fn same<S: Simd>(simd: S, x: &[f64]) -> Vec<Lanes<S>> {
        x.iter().map(|v| Lanes::splat(simd, *v)).collect()
    }

    /// MAV, ZC, SSC and WL.
    fn hudgins_of(x: &[f64], ssc_threshold: f64) -> [f64; 4] {
        dispatch!(Level::new(), simd => {
            let x = same(simd, x);
            let ([mav, zc], [ssc, wl]) = (magnitude_and_crossings(&x), slope_sign_changes_and_waveform_length(&x, ssc_threshold));
            [mav, zc, ssc, wl].map(|value| value[0])
        })
    }

    #[test]
    fn a_zero_between_two_signs_hides_the_crossing() {
        assert_eq!(hudgins_of(&[1.0, 0.0, -1.0], 0.0)[1], 0.0);
        assert_eq!(hudgins_of(&[1.0, -1.0, 1.0], 0.0)[1], 2.0);
    }

    #[test]
    fn a_dead_channel_shows_the_largest_number_of_slope_sign_changes() {
        assert_eq!(hudgins_of(&[5.0; 10], 0.0), [5.0, 0.0, 8.0, 0.0]);
        assert_eq!(hudgins_of(&[5.0; 10], 1e-9)[2], 0.0);
    }

    #[test]
    fn logarithms_taken_together_are_those_taken_one_by_one() {
        let signals = [[0.0, -1.0, 20.0, 0.3], [1e90, -1e90, 1e90, 3.0], [f64::MAX, 1.0, f64::MAX, 1.0]];
        for x in signals {
            // Several of the large ones in each product.
            let x = x.repeat(3);
            let scalar_result = x.iter().map(|v| (v.abs() + 1.0).ln()).sum::<f64>() / x.len() as f64;
            let together = dispatch!(Level::new(), simd => mean_logarithm(&same(simd, &x))[0]);
            assert!(
                (together - scalar_result).abs() <= 1e-14 * scalar_result,
                "{x:?}: {together}, {scalar_result}"
            );
        }
    }

    #[test]
    fn the_l_score_is_half_the_mean_distance_of_two_samples() {
        let score = dispatch!(Level::new(), simd => l_score(&mut same(simd, &[4.0, 1.0, 2.0]))[0]);
        assert!((score - 0.5 * (3.0 + 2.0 + 1.0) / 3.0).abs() < 1e-15);
    }

    #[test]
    fn every_lane_is_sorted_at_any_length() {
        for length in (1..70).chain([100, 128, 1000]) {
            let value = |k: usize, lane: usize| ((k * k * (lane + 3)) as f64 * 0.618_034).fract();
            let sorted: Vec<[f64; LANES]> = dispatch!(Level::new(), simd => {
                let mut x: Vec<_> = (0..length).map(|k| Lanes::from_fn(simd, |lane| value(k, lane))).collect();
                sort(&mut x);
                x.into_iter().map(Lanes::to_array).collect()
            });
            for lane in 0..LANES {
                let mut expected: Vec<f64> = (0..length).map(|k| value(k, lane)).collect();
                expected.sort_unstable_by(f64::total_cmp);
                let got: Vec<f64> = sorted.iter().map(|v| v[lane]).collect();
                assert_eq!(got, expected, "{length} samples, lane {lane}");
            }
        }
    }
}
