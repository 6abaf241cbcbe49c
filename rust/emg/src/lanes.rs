//! Eight channels side by side in one value, so that the processor's vectors do the arithmetic of several channels at once:
//! AVX-512, AVX2, SSE2 or NEON, whatever the machine has, chosen while the program runs. Each lane computes what a number alone
//! would, operation by operation and rounded alike: a channel's features depend neither on its neighbours nor on the machine.

use fearless_simd::prelude::*;

/// Channels in one value.
pub(crate) const LANES: usize = 8;

/// The same quantity of eight channels, in the vectors of the kind of processor `S`.
pub(crate) type Lanes<S> = fearless_simd::f64x8<S>;

/// Where a comparison of [`Lanes`] holds.
pub(crate) type Mask<S> = fearless_simd::mask64x8<S>;

/// [`Lanes`] in memory, whatever the processor.
#[derive(Clone, Copy, Debug, Default)]
#[repr(align(64))]
pub(crate) struct AlignedLanes(pub(crate) [f64; LANES]);

#[cfg(test)]
impl From<&[f64]> for AlignedLanes {
    /// Up to eight values; zeros behind them.
    fn from(values: &[f64]) -> AlignedLanes {
        let mut eight = [0.0; LANES];
        eight[..values.len()].copy_from_slice(values);
        AlignedLanes(eight)
    }
}

/// One where a comparison holds, else zero.
#[inline(always)]
pub(crate) fn mask_to_one<S: Simd>(mask: Mask<S>) -> Lanes<S> {
    let simd = mask.token();
    mask.select(Lanes::splat(simd, 1.0), Lanes::splat(simd, 0.0))
}

/// The value where the mask holds, else zero.
#[inline(always)]
pub(crate) fn select_or_zero<S: Simd>(mask: Mask<S>, value: Lanes<S>) -> Lanes<S> {
    mask.select(value, Lanes::splat(value.simd, 0.0))
}

/// `sum!(simd, v in items => value)`: the sum of the values, from the first to the last. Closures would not do: what is not
/// inlined is not compiled for the processor's vectors.
macro_rules! sum {
    ($simd:expr, $item:pat in $items:expr => $value:expr) => {{
        let mut sum = $crate::lanes::Lanes::splat($simd, 0.0);
        for $item in $items {
            sum += $value;
        }
        sum
    }};
}
pub(crate) use sum;

/// Mean of at least one value.
#[inline(always)]
pub(crate) fn mean<S: Simd>(x: &[Lanes<S>]) -> Lanes<S> {
    sum!(x[0].simd, v in x => *v) / x.len() as f64
}

/// Mean magnitude of at least one value.
#[inline(always)]
pub(crate) fn mean_absolute<S: Simd>(x: &[Lanes<S>]) -> Lanes<S> {
    sum!(x[0].simd, v in x => v.abs()) / x.len() as f64
}

/// The logarithm of two in two parts; whole multiples of the first are exact.
const LN_2_HIGH: f64 = 0.693_147_180_369_123_8;
const LN_2_LOW: f64 = 1.908_214_929_270_587_7e-10;

/// Natural logarithm, to the last digit but one; minus infinity of zero, no number of what is below zero. Reduction and
/// minimax polynomial are those of fdlibm's `log` (Sun, 1993).
#[inline(always)]
pub(crate) fn ln<S: Simd>(x: Lanes<S>) -> Lanes<S> {
    /// The bits of the square root of one half, rounded down: the mantissa's least value.
    const MIN_MANTISSA_BITS: u64 = 0x3fe6_a09e_0000_0000;
    const ONE: u64 = 0x3ff0_0000_0000_0000;
    const MANTISSA: u64 = 0x000f_ffff_ffff_ffff;
    const COEFFICIENTS: [f64; 7] = [
        6.666_666_666_666_735e-1,
        3.999_999_999_940_942e-1,
        2.857_142_874_366_239e-1,
        2.222_219_843_214_978_4e-1,
        1.818_357_216_161_805e-1,
        1.531_383_769_920_937_3e-1,
        1.479_819_860_511_658_6e-1,
    ];
    let simd = x.simd;
    // Subnormal numbers are made normal by 2^54.
    let subnormal = x.simd_lt(f64::MIN_POSITIVE);
    let bits = subnormal.select(x * 18_014_398_509_481_984.0, x).to_bits() + (ONE - MIN_MANTISSA_BITS);
    let exponent =
        integer_to_float(bits >> 52) - 1023.0 - select_or_zero(subnormal, Lanes::splat(simd, 54.0));
    let f = Lanes::from_bits((bits & MANTISSA) + MIN_MANTISSA_BITS) - 1.0;
    let s = f / (f + 2.0);
    let (z, half_square) = (s * s, f * f * 0.5);
    let mut series = Lanes::splat(simd, COEFFICIENTS[6]);
    for coefficient in COEFFICIENTS[..6].iter().rev() {
        series = series * z + *coefficient;
    }
    let tail = s * (half_square + series * z) + exponent * LN_2_LOW;
    let logarithm = exponent * LN_2_HIGH - ((half_square - tail) - f);
    let logarithm = x.simd_gt(0.0).select(logarithm, Lanes::splat(simd, f64::NAN));
    let logarithm = x.simd_eq(0.0).select(Lanes::splat(simd, f64::NEG_INFINITY), logarithm);
    x.simd_eq(f64::INFINITY).select(x, logarithm)
}

/// Exponential function, to the last digits; no number of no number.
#[inline(always)]
pub(crate) fn exp<S: Simd>(x: Lanes<S>) -> Lanes<S> {
    let simd = x.simd;
    // Beyond these it is zero or infinite.
    let x = x.simd_lt(-746.0).select(Lanes::splat(simd, -746.0), x);
    let x = x.simd_gt(710.0).select(Lanes::splat(simd, 710.0), x);
    let power = (x * std::f64::consts::LOG2_E).round_ties_even();
    let rest = x - power * LN_2_HIGH - power * LN_2_LOW;
    // Taylor's series to the thirteenth power: what it leaves out is below the last digit.
    let mut series = Lanes::splat(simd, RECIPROCAL_FACTORIALS[13]);
    for coefficient in RECIPROCAL_FACTORIALS[..13].iter().rev() {
        series = series * rest + *coefficient;
    }
    // In two steps, since the power of two alone may be too small or too large for a number.
    let half = (power * 0.5).floor();
    series * power_of_two(half) * power_of_two(power - half)
}

/// Cube root, to the last digits, of what is not below zero.
#[inline(always)]
pub(crate) fn cbrt<S: Simd>(x: Lanes<S>) -> Lanes<S> {
    // The upper half of the bits is nearly the logarithm; a third of it begins with the root's first four bits (Kahan, as in
    // fdlibm). Each of Halley's steps triples them.
    let third = integer_to_float(x.to_bits() >> 32) * (1.0 / 3.0) + (715_094_163.0 + TWO_52);
    let mut root = Lanes::from_bits(third.to_bits() << 32);
    for _ in 0..3 {
        let cube = root * root * root;
        root *= (cube + x * 2.0) / (cube * 2.0 + x);
    }
    select_or_zero(x.simd_gt(0.0), root)
}

/// 1 / 0!, 1 / 1!, 1 / 2! and so on.
const RECIPROCAL_FACTORIALS: [f64; 14] = {
    let (mut reciprocals, mut factorial, mut k) = ([1.0; 14], 1.0, 1);
    while k < reciprocals.len() {
        factorial *= k as f64;
        reciprocals[k] = 1.0 / factorial;
        k += 1;
    }
    reciprocals
};

/// `x` to the power of `exponent`, for `x` from zero on and an exponent above zero.
#[inline(always)]
pub(crate) fn power<S: Simd>(x: Lanes<S>, exponent: f64) -> Lanes<S> {
    exp(ln(x) * exponent)
}

/// 2^52, whose last bit counts one.
const TWO_52: f64 = 4_503_599_627_370_496.0;

/// Whole numbers below 2^52 as numbers.
#[inline(always)]
fn integer_to_float<S: Simd>(bits: fearless_simd::u64x8<S>) -> Lanes<S> {
    Lanes::from_bits(bits | TWO_52.to_bits()) - TWO_52
}

/// Two to the power of a whole number from -1022 to 1023.
#[inline(always)]
fn power_of_two<S: Simd>(power: Lanes<S>) -> Lanes<S> {
    Lanes::from_bits((power + 1023.0 + TWO_52).to_bits() << 52)
}

#[cfg(test)]
mod tests {
    use super::*;
    use fearless_simd::{Level, dispatch};

    /// Largest difference of two functions in units of the last digit.
    fn worst(
        values: &[f64],
        of: impl Fn(AlignedLanes) -> AlignedLanes,
        expected: impl Fn(f64) -> f64,
    ) -> u64 {
        let scalar_result = |k: usize, got: f64| {
            let expected = expected(values[k]);
            assert_eq!(got.is_nan(), expected.is_nan(), "{}: {got}, {expected}", values[k]);
            if got.is_nan() { 0 } else { got.to_bits().abs_diff(expected.to_bits()) }
        };
        let got = values.chunks(LANES).flat_map(|part| of(part.into()).0.into_iter().take(part.len()));
        got.enumerate().map(|(k, got)| scalar_result(k, got)).max().unwrap_or(0)
    }

    #[test]
    fn functions_are_those_of_numbers_to_the_last_digits() {
        let special =
            [0.0, -0.0, 1.0, -1.0, f64::INFINITY, f64::NEG_INFINITY, f64::NAN, f64::MAX, f64::MIN_POSITIVE];
        let subnormal = [5e-324, 1e-310, 2.2e-308];
        let spread = (1..20_000).map(|k| f64::from(k) * 0.618_034).map(|turn| turn.fract() * 1490.0 - 745.0);
        let spread: Vec<f64> = spread.collect();
        let near_one = (0..2000).map(|k| 1.0 + (f64::from(k) - 1000.0) * 1e-5);
        let numbers: Vec<f64> = special.into_iter().chain(subnormal).chain(near_one).collect();
        let positive: Vec<f64> = spread.iter().map(|v| v.exp()).chain(numbers.iter().copied()).collect();
        dispatch!(Level::new(), simd => {
            let ln = |x: AlignedLanes| AlignedLanes(ln(x.0.simd_into(simd)).to_array());
            let exp = |x: AlignedLanes| AlignedLanes(exp(x.0.simd_into(simd)).to_array());
            let cbrt = |x: AlignedLanes| AlignedLanes(cbrt(x.0.simd_into(simd)).to_array());
            assert!(worst(&positive, ln, f64::ln) <= 1, "{}", worst(&positive, ln, f64::ln));
            let normal: Vec<f64> = positive.iter().filter(|x| (1e-300..1e300).contains(*x)).copied().collect();
            assert!(worst(&normal, cbrt, f64::cbrt) <= 4, "{}", worst(&normal, cbrt, f64::cbrt));
            assert_eq!(cbrt(AlignedLanes::default()).0, [0.0; LANES]);
            let whole: Vec<f64> = spread.iter().filter(|x| **x > -708.0).chain(&numbers).copied().collect();
            assert!(worst(&whole, exp, f64::exp) <= 4, "{}", worst(&whole, exp, f64::exp));
        });
    }
}
