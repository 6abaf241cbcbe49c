use crate::feature::AR_ORDER;

/// Autoregressive coefficients by Burg's method, without the leading one.
///
/// The running denominator is Andersen's recursion (1978), as librosa has it. A zero channel gives zeros.
pub(crate) fn burg(x: &[f64], forward: &mut [f64], backward: &mut [f64]) -> [f64; AR_ORDER] {
    let mut count = x.len() - 1;
    forward[..count].copy_from_slice(&x[1..]);
    backward[..count].copy_from_slice(&x[..count]);
    let square = |v: f64| v * v;
    let both = forward[..count].iter().zip(&backward[..count]);
    let mut denominator: f64 = both.map(|(f, b)| square(*f) + square(*b)).sum();
    let mut coefficients = [0.0; AR_ORDER];
    // The errors shrink by one sample at each order: the forward ones at their start, the backward ones at their
    // end. `skip` is that start.
    for order in 0..AR_ORDER.min(count) {
        let skip = order;
        let pairs = || forward[skip..skip + count].iter().zip(&backward[..count]);
        let reflection = -2.0 * pairs().map(|(f, b)| f * b).sum::<f64>() / (denominator + f64::MIN_POSITIVE);
        let before = coefficients;
        for j in 0..order {
            coefficients[j] = before[j] + reflection * before[order - 1 - j];
        }
        coefficients[order] = reflection;
        for (f, b) in forward[skip..skip + count].iter_mut().zip(&mut backward[..count]) {
            (*f, *b) = (*f + reflection * *b, *b + reflection * *f);
        }
        denominator =
            (1.0 - square(reflection)) * denominator - square(backward[count - 1]) - square(forward[skip]);
        count -= 1;
    }
    coefficients
}

/// Cepstral coefficients from autoregressive ones, by LibEMG's recursion.
pub(crate) fn cepstrum(a: &[f64; AR_ORDER]) -> [f64; AR_ORDER] {
    let mut c = [0.0; AR_ORDER];
    c[0] = -a[0];
    for p in 1..AR_ORDER {
        let lower: f64 = (1..p).map(|l| a[p] * c[p - l] * (1.0 - l as f64 / p as f64)).sum();
        c[p] = -a[p] - lower;
    }
    c
}
