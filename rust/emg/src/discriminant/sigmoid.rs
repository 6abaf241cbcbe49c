use proact_types::MAX_GESTURES;
use serde::{Deserialize, Serialize};

/// Probability of the first of two classes as a function of the decision value, `1 / (1 + exp(slope v + offset))` (Platt
/// 1999).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct PlattSigmoid {
    pub(crate) slope: f64,
    pub(crate) offset: f64,
}

impl PlattSigmoid {
    /// Fits to decision values, each with whether it is of the first class: Newton's method with backtracking (Lin, Lin and
    /// Weng, Machine Learning 68, 2007).
    pub(crate) fn fit(decisions: &[(f64, bool)]) -> PlattSigmoid {
        const MAX_ITERATIONS: usize = 100;
        const RIDGE: f64 = 1e-12;
        let first = decisions.iter().filter(|(_, first)| *first).count() as f64;
        let second = decisions.len() as f64 - first;
        let target =
            |is_first: bool| if is_first { (first + 1.0) / (first + 2.0) } else { 1.0 / (second + 2.0) };
        // Written so that no exponential overflows.
        let loss = |s: PlattSigmoid| -> f64 {
            let term = |(v, is_first): &(f64, bool)| {
                let z = s.slope * v + s.offset;
                let t = target(*is_first);
                if z >= 0.0 { t * z + (-z).exp().ln_1p() } else { (t - 1.0) * z + z.exp().ln_1p() }
            };
            decisions.iter().map(term).sum()
        };
        let mut s = PlattSigmoid { slope: 0.0, offset: ((second + 1.0) / (first + 1.0)).ln() };
        let mut now = loss(s);
        for _ in 0..MAX_ITERATIONS {
            let (mut aa, mut bb, mut ab, mut a, mut b) = (RIDGE, RIDGE, 0.0, 0.0, 0.0);
            for (v, is_first) in decisions {
                let p = s.probability(*v);
                let (weight, error) = (p * (1.0 - p), target(*is_first) - p);
                aa += v * v * weight;
                bb += weight;
                ab += v * weight;
                a += v * error;
                b += error;
            }
            if a.abs() < 1e-5 && b.abs() < 1e-5 {
                break;
            }
            let determinant = aa * bb - ab * ab;
            let (da, db) = (-(bb * a - ab * b) / determinant, -(aa * b - ab * a) / determinant);
            let downhill = a * da + b * db;
            let mut step = 1.0;
            let next = loop {
                let next = PlattSigmoid { slope: s.slope + step * da, offset: s.offset + step * db };
                let value = loss(next);
                if value < now + 1e-4 * step * downhill {
                    break Some((next, value));
                }
                step /= 2.0;
                if step < 1e-10 {
                    break None;
                }
            };
            let Some((next, value)) = next else { break };
            (s, now) = (next, value);
        }
        s
    }

    /// Probability of the first class.
    pub(crate) fn probability(&self, decision: f64) -> f64 {
        let z = self.slope * decision + self.offset;
        if z >= 0.0 { (-z).exp() / (1.0 + (-z).exp()) } else { 1.0 / (1.0 + z.exp()) }
    }
}

/// Probabilities of all classes from those of each pair, `pair(i, j)` for i before j (the second method of Wu, Lin and Weng,
/// Journal of Machine Learning Research 5, 2004). Does not allocate.
pub(crate) fn pairwise_coupling(pair: impl Fn(usize, usize) -> f64, out: &mut [f64]) {
    let classes = out.len();
    let r = |i: usize, j: usize| if i < j { pair(i, j) } else { 1.0 - pair(j, i) };
    let mut q = [[0.0; MAX_GESTURES]; MAX_GESTURES];
    for (i, row) in q.iter_mut().enumerate().take(classes) {
        for j in (0..classes).filter(|j| *j != i) {
            row[i] += r(j, i).powi(2);
            row[j] = -r(j, i) * r(i, j);
        }
    }
    out.fill(1.0 / classes as f64);
    let mut product = [0.0; MAX_GESTURES];
    for _ in 0..100.max(classes) {
        for (row, value) in q.iter().zip(&mut product).take(classes) {
            *value = row.iter().zip(&*out).map(|(q, p)| q * p).sum();
        }
        let mut whole: f64 = out.iter().zip(&product).map(|(p, v)| p * v).sum();
        if product[..classes].iter().all(|v| (v - whole).abs() < 0.005 / classes as f64) {
            break;
        }
        for t in 0..classes {
            let step = (whole - product[t]) / q[t][t];
            out[t] += step;
            whole = (whole + step * (step * q[t][t] + 2.0 * product[t])) / (1.0 + step).powi(2);
            for j in 0..classes {
                product[j] = (product[j] + step * q[t][j]) / (1.0 + step);
                out[j] /= 1.0 + step;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sigmoid_follows_the_share_of_the_first_class() {
        // At +1 nine of ten are of the first class, at -1 one of ten.
        let side = |v: f64, first: usize| (0..100).map(move |k| (v, k < first));
        let decisions: Vec<_> = side(1.0, 90).chain(side(-1.0, 10)).collect();
        let fitted = PlattSigmoid::fit(&decisions);
        assert!(
            (fitted.probability(1.0) - 0.9).abs() < 0.01 && (fitted.probability(-1.0) - 0.1).abs() < 0.01,
            "{fitted:?}"
        );
        assert!(fitted.probability(1e300) <= 1.0 && fitted.probability(-1e300) >= 0.0);
    }

    #[test]
    fn pairs_that_agree_are_coupled_exactly() {
        let p = [0.6, 0.3, 0.1];
        let mut out = [0.0; 3];
        pairwise_coupling(|i, j| p[i] / (p[i] + p[j]), &mut out);
        for (got, expected) in out.iter().zip(p) {
            assert!((got - expected).abs() < 0.01, "{out:?}");
        }
    }
}
