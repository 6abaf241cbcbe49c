use crate::feature::AR_ORDER;
use crate::lanes::{Lanes, sum};
use fearless_simd::prelude::*;

/// Autoregressive coefficients by Burg's method, without the leading one.
///
/// The running denominator is Andersen's recursion (1978), as librosa has it. A zero channel gives zeros.
#[inline(always)]
pub(crate) fn burg<S: Simd>(
    x: &[Lanes<S>],
    forward: &mut [Lanes<S>],
    backward: &mut [Lanes<S>],
) -> [Lanes<S>; AR_ORDER] {
    let zero = Lanes::splat(x[0].simd, 0.0);
    let mut count = x.len() - 1;
    forward[..count].copy_from_slice(&x[1..]);
    backward[..count].copy_from_slice(&x[..count]);
    let (mut denominator, mut product) = (zero, zero);
    for pair in x.windows(2) {
        denominator += pair[1] * pair[1] + pair[0] * pair[0];
        product += pair[1] * pair[0];
    }
    let mut coefficients = [zero; AR_ORDER];
    // The errors shrink by one sample at each order: the forward ones at their start, the backward ones at their
    // end. `skip` is that start.
    for order in 0..AR_ORDER.min(count) {
        let skip = order;
        let reflection = product * -2.0 / (denominator + f64::MIN_POSITIVE);
        let before = coefficients;
        for j in 0..order {
            coefficients[j] = before[j] + reflection * before[order - 1 - j];
        }
        coefficients[order] = reflection;
        // The next order's product pairs each forward error with the backward one before.
        product = zero;
        let mut last = zero;
        for (f, b) in forward[skip..skip + count].iter_mut().zip(&mut backward[..count]) {
            (*f, *b) = (*f + reflection * *b, *b + reflection * *f);
            product += *f * last;
            last = *b;
        }
        let (first, last) = (forward[skip], backward[count - 1]);
        denominator = (Lanes::splat(zero.simd, 1.0) - reflection * reflection) * denominator
            - last * last
            - first * first;
        count -= 1;
    }
    coefficients
}

/// Cepstral coefficients from autoregressive ones, by LibEMG's recursion.
#[inline(always)]
pub(crate) fn cepstrum<S: Simd>(a: &[Lanes<S>; AR_ORDER]) -> [Lanes<S>; AR_ORDER] {
    let mut c = *a;
    c[0] = -a[0];
    for p in 1..AR_ORDER {
        let lower = sum!(a[0].simd, l in 1..p => a[p] * c[p - l] * (1.0 - l as f64 / p as f64));
        c[p] = -a[p] - lower;
    }
    c
}
