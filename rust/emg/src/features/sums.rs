//! Sums over the samples of four channels, each in one pass. Functions of their own, so that their sums stay in registers.

use crate::lanes::{Lanes, each, mean, mean_absolute, ones};

/// MAV, ZC, SSC and WL.
#[inline(never)]
pub(crate) fn hudgins(x: &[Lanes], ssc_threshold: f64) -> [Lanes; 4] {
    let least = Lanes::splat(-ssc_threshold);
    let signs = |value: Lanes| (value.simd_gt(Lanes::ZERO), value.simd_lt(Lanes::ZERO));
    let crosses = |from: (Lanes, Lanes), to: (Lanes, Lanes)| ones(from.0 & to.1 | from.1 & to.0);
    let (mut last, mut sign, mut slope) = (x[1], signs(x[1]), x[1] - x[0]);
    let mut absolute = Lanes::ZERO + x[0].abs() + x[1].abs();
    let (mut crossings, mut turns, mut length) = (crosses(signs(x[0]), sign), Lanes::ZERO, slope.abs());
    for value in &x[2..] {
        absolute += value.abs();
        let (next, next_sign) = (*value - last, signs(*value));
        crossings += crosses(sign, next_sign);
        // (b - a) (b - c) >= threshold: the second factor is the next slope, negated.
        turns += ones((slope * next).simd_le(least));
        length += next.abs();
        (last, sign, slope) = (*value, next_sign, next);
    }
    [absolute / x.len() as f64, crossings, turns, length]
}

/// Sums of the squares of a signal and of its first and second differences.
#[inline(never)]
pub(crate) fn squares(x: &[Lanes]) -> [Lanes; 3] {
    let (mut last, mut slope) = (x[1], x[1] - x[0]);
    let mut sums = [x[0] * x[0] + x[1] * x[1], slope * slope, Lanes::ZERO];
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
#[inline(never)]
pub(crate) fn lengths(x: &[Lanes]) -> [Lanes; 2] {
    let (mut last, mut slope) = (x[1], x[1] - x[0]);
    let mut sums = [slope.abs(), Lanes::ZERO];
    for value in &x[2..] {
        let next = *value - last;
        sums[0] += next.abs();
        sums[1] += (next - slope).abs();
        (last, slope) = (*value, next);
    }
    sums
}

/// Second, third and fourth central moment, and where the spread is rounding only.
pub(crate) fn central_moments(x: &[Lanes]) -> ([Lanes; 3], Lanes) {
    let count = x.len() as f64;
    let mean = mean(x);
    let mut sums = [Lanes::ZERO; 3];
    for value in x {
        let from_mean = *value - mean;
        let square = from_mean * from_mean;
        sums[0] += square;
        sums[1] += from_mean * square;
        sums[2] += square * square;
    }
    let moments = sums.map(|sum| sum / count);
    // The limit of SciPy.
    let limit = mean * f64::EPSILON;
    (moments, moments[0].simd_le(limit * limit))
}

/// Samples whose neighbour is further away than `threshold`.
pub(crate) fn steps_beyond(x: &[Lanes], threshold: f64) -> Lanes {
    let threshold = Lanes::splat(threshold);
    x.windows(2).map(|pair| ones((pair[1] - pair[0]).abs().simd_gt(threshold))).sum()
}

/// Magnitude of the mean root: those of negative samples are imaginary.
pub(crate) fn mean_square_root(x: &[Lanes]) -> Lanes {
    let (mut real, mut imaginary) = (Lanes::ZERO, Lanes::ZERO);
    for value in x {
        let (root, negative) = (value.abs().sqrt(), value.simd_lt(Lanes::ZERO));
        real += root & !negative;
        imaginary += root & negative;
    }
    let (real, imaginary) = (real.to_array(), imaginary.to_array());
    Lanes::from(std::array::from_fn(|lane| f64::hypot(real[lane], imaginary[lane]))) / x.len() as f64
}

/// Second L-moment: 2 b1 - b0 with Hosking's unbiased weights (1990). Sorts `x`.
pub(crate) fn l_score(x: &mut [Lanes]) -> Lanes {
    sort(x);
    let last = x.len() as f64 - 1.0;
    let sum: Lanes = x.iter().enumerate().map(|(k, v)| *v * (2.0 * k as f64 / last - 1.0)).sum();
    sum / x.len() as f64
}

/// Sorts each lane: Batcher's exchanges (Knuth, The Art of Computer Programming 3, 5.2.2, algorithm M), the same ones
/// whatever the values are, so that four channels are sorted at once.
fn sort(x: &mut [Lanes]) {
    let largest = x.len().next_power_of_two() / 2;
    let mut group = largest;
    while group > 0 {
        let (mut offset, mut distance, mut merged) = (0, group, largest);
        loop {
            for start in (offset..x.len().saturating_sub(distance)).step_by(2 * group) {
                let (front, back) = x.split_at_mut(start + distance);
                for (a, b) in front[start..].iter_mut().take(group).zip(back) {
                    (*a, *b) = (a.fast_min(*b), a.fast_max(*b));
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
pub(crate) fn largest(x: &[Lanes]) -> Lanes {
    x.iter().fold(Lanes::splat(f64::NEG_INFINITY), |most, v| most.fast_max(*v))
}

/// Mean magnitude of the third powers.
pub(crate) fn mean_cube(x: &[Lanes]) -> Lanes {
    x.iter().map(|v| (*v * (*v * *v)).abs()).sum::<Lanes>() / x.len() as f64
}

/// Mean magnitude of the second half less that of the first.
pub(crate) fn slope_of_means(x: &[Lanes]) -> Lanes {
    // The middle of an odd length is rounded to the even number, as Python rounds.
    let half = (x.len() as f64 / 2.0).round_ties_even() as usize;
    mean_absolute(&x[half..x.len().min(2 * half)]) - mean_absolute(&x[..half])
}

/// Samples whose logarithms are taken together.
const LOGARITHMS: usize = 25;

/// Mean of the logarithms of the samples' magnitudes and one: that of products of several, unless they are too large for a
/// number.
pub(crate) fn mean_logarithm(x: &[Lanes]) -> Lanes {
    let sums = x.chunks(LOGARITHMS).map(|part| {
        let product = part.iter().fold(Lanes::ONE, |product, v| product * (v.abs() + Lanes::ONE));
        if product.is_finite().all() {
            product.ln()
        } else {
            part.iter().map(|v| each(v.abs() + Lanes::ONE, f64::ln)).sum()
        }
    });
    sums.sum::<Lanes>() / x.len() as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lanes::lanes_of;

    fn same(x: &[f64]) -> Vec<Lanes> {
        x.iter().map(|v| Lanes::splat(*v)).collect()
    }

    fn first(values: &[Lanes]) -> Vec<f64> {
        values.iter().map(|v| v.as_array()[0]).collect()
    }

    #[test]
    fn a_zero_between_two_signs_hides_the_crossing() {
        assert_eq!(first(&hudgins(&same(&[1.0, 0.0, -1.0]), 0.0))[1], 0.0);
        assert_eq!(first(&hudgins(&same(&[1.0, -1.0, 1.0]), 0.0))[1], 2.0);
    }

    #[test]
    fn a_dead_channel_shows_the_largest_number_of_slope_sign_changes() {
        assert_eq!(first(&hudgins(&same(&[5.0; 10]), 0.0)), [5.0, 0.0, 8.0, 0.0]);
        assert_eq!(first(&hudgins(&same(&[5.0; 10]), 1e-9))[2], 0.0);
    }

    #[test]
    fn logarithms_taken_together_are_those_taken_one_by_one() {
        let signals = [[0.0, -1.0, 20.0, 0.3], [1e90, -1e90, 1e90, 3.0], [f64::MAX, 1.0, f64::MAX, 1.0]];
        for x in signals {
            let apart = x.iter().map(|v| (v.abs() + 1.0).ln()).sum::<f64>() / 4.0;
            let together = first(&[mean_logarithm(&same(&x))])[0];
            assert!((together - apart).abs() <= 1e-14 * apart, "{x:?}: {together}, {apart}");
        }
    }

    #[test]
    fn the_l_score_is_half_the_mean_distance_of_two_samples() {
        let score = first(&[l_score(&mut same(&[4.0, 1.0, 2.0]))])[0];
        assert!((score - 0.5 * (3.0 + 2.0 + 1.0) / 3.0).abs() < 1e-15);
    }

    #[test]
    fn every_lane_is_sorted_at_any_length() {
        for length in (1..70).chain([100, 128, 1000]) {
            let value = |k: usize, lane: usize| ((k * k * (lane + 3)) as f64 * 0.618_034).fract();
            let mut x: Vec<Lanes> =
                (0..length).map(|k| lanes_of(&[0, 1, 2, 3].map(|lane| value(k, lane)))).collect();
            sort(&mut x);
            for lane in 0..4 {
                let mut expected: Vec<f64> = (0..length).map(|k| value(k, lane)).collect();
                expected.sort_unstable_by(f64::total_cmp);
                let got: Vec<f64> = x.iter().map(|v| v.as_array()[lane]).collect();
                assert_eq!(got, expected, "{length} samples, lane {lane}");
            }
        }
    }
}
