use crate::feature::AR_ORDER;
use crate::lanes::Lanes;

/// Autoregressive coefficients by Burg's method, without the leading one.
///
/// The running denominator is Andersen's recursion (1978), as librosa has it. A zero channel gives zeros.
pub(crate) fn burg(x: &[Lanes], forward: &mut [Lanes], backward: &mut [Lanes]) -> [Lanes; AR_ORDER] {
    let mut count = x.len() - 1;
    forward[..count].copy_from_slice(&x[1..]);
    backward[..count].copy_from_slice(&x[..count]);
    let (mut denominator, mut product) = (Lanes::ZERO, Lanes::ZERO);
    for pair in x.windows(2) {
        denominator += pair[1] * pair[1] + pair[0] * pair[0];
        product += pair[1] * pair[0];
    }
    let mut coefficients = [Lanes::ZERO; AR_ORDER];
    // The errors shrink by one sample at each order: the forward ones at their start, the backward ones at their
    // end. `skip` is that start.
    for order in 0..AR_ORDER.min(count) {
        let skip = order;
        let reflection = product * -2.0 / (denominator + Lanes::splat(f64::MIN_POSITIVE));
        let before = coefficients;
        for j in 0..order {
            coefficients[j] = before[j] + reflection * before[order - 1 - j];
        }
        coefficients[order] = reflection;
        // The next order's product pairs each forward error with the backward one before.
        product = Lanes::ZERO;
        let mut last = Lanes::ZERO;
        for (f, b) in forward[skip..skip + count].iter_mut().zip(&mut backward[..count]) {
            (*f, *b) = (*f + reflection * *b, *b + reflection * *f);
            product += *f * last;
            last = *b;
        }
        let (first, last) = (forward[skip], backward[count - 1]);
        denominator = (Lanes::ONE - reflection * reflection) * denominator - last * last - first * first;
        count -= 1;
    }
    coefficients
}

/// Cepstral coefficients from autoregressive ones, by LibEMG's recursion.
pub(crate) fn cepstrum(a: &[Lanes; AR_ORDER]) -> [Lanes; AR_ORDER] {
    let mut c = [Lanes::ZERO; AR_ORDER];
    c[0] = -a[0];
    for p in 1..AR_ORDER {
        let lower: Lanes = (1..p).map(|l| a[p] * c[p - l] * (1.0 - l as f64 / p as f64)).sum();
        c[p] = -a[p] - lower;
    }
    c
}
