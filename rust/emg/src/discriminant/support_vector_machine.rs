use super::TrainingSet;
use super::sigmoid::{PlattSigmoid, pairwise_coupling};
use crate::EmgError;
use serde::{Deserialize, Serialize};

/// Linear support vector machines of each pair of classes, as scikit-learn's `SVC(kernel="linear")` behind a
/// `StandardScaler`, with probabilities.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct SupportVectorMachine {
    classes: usize,
    features: usize,
    /// Pairs of classes (0, 1), (0, 2) .. (1, 2) and so on.
    pairs: Vec<Hyperplane>,
}

/// The plane between two classes, for features as they are.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Hyperplane {
    weights: Vec<f64>,
    bias: f64,
    sigmoid: PlattSigmoid,
}

/// What a window on the wrong side costs (scikit-learn's default).
const COST: f64 = 1.0;
/// Parts of which each is left out once, to fit the probabilities. A part is a run of neighbours in time: windows overlap.
const PROBABILITY_FOLDS: usize = 5;
/// How far the conditions of the optimum may be missed.
const TOLERANCE: f64 = 1e-5;

impl SupportVectorMachine {
    pub(crate) fn fit(set: &TrainingSet<'_>) -> Result<SupportVectorMachine, EmgError> {
        let features = set.samples.ncols();
        let (mean, spread) = set.mean_and_sd();
        let windows = set.standardized(&mean, &spread);
        let mut pairs = Vec::new();
        for a in 0..set.classes {
            for b in a + 1..set.classes {
                let sample = |index: usize, first| (&windows[index * features..][..features], first);
                let of = |class: usize, first| set.of_class(class).map(move |index| sample(index, first));
                let [ones, others]: [Vec<_>; 2] = [of(a, true).collect(), of(b, false).collect()];
                let (weights, bias) = solve_smo(&[&ones[..], &others[..]].concat(), features);
                let sigmoid = PlattSigmoid::fit(&cross_validated_decisions(&ones, &others, features));
                let raw: Vec<f64> = weights.iter().zip(&spread).map(|(w, s)| w / s).collect();
                let bias = bias - raw.iter().zip(&mean).map(|(w, m)| w * m).sum::<f64>();
                pairs.push(Hyperplane { weights: raw, bias, sigmoid });
            }
        }
        let fitted = SupportVectorMachine { classes: set.classes, features, pairs };
        if fitted.is_sound() { Ok(fitted) } else { Err(EmgError::NoConvergence) }
    }

    pub(crate) fn classes(&self) -> usize {
        self.classes
    }

    pub(crate) fn features(&self) -> usize {
        self.features
    }

    pub(crate) fn is_sound(&self) -> bool {
        let sound = |plane: &Hyperplane| {
            let PlattSigmoid { slope, offset } = plane.sigmoid;
            plane.weights.len() == self.features
                && plane.weights.iter().chain(&[plane.bias, slope, offset]).all(|v| v.is_finite())
        };
        self.classes >= 2
            && self.features > 0
            && self.classes.checked_mul(self.classes - 1) == Some(2 * self.pairs.len())
            && self.pairs.iter().all(sound)
    }

    pub(crate) fn map_features(&self, order: &dyn Fn(&[f64]) -> Vec<f64>) -> SupportVectorMachine {
        let map = |plane: &Hyperplane| Hyperplane { weights: order(&plane.weights), ..plane.clone() };
        SupportVectorMachine { pairs: self.pairs.iter().map(map).collect(), ..self.clone() }
    }

    pub(crate) fn scores(&self, features: &[f64], out: &mut [f64]) {
        let probability = |a: usize, b: usize| {
            let plane = &self.pairs[a * self.classes - a * (a + 1) / 2 + b - a - 1];
            // As far from certainty as LibSVM keeps it.
            plane.sigmoid.probability(plane.decide(features)).clamp(1e-7, 1.0 - 1e-7)
        };
        pairwise_coupling(probability, out);
    }

    /// The decision value of each pair, above zero for the first of the two.
    #[cfg(test)]
    pub(crate) fn decisions(&self, features: &[f64]) -> Vec<f64> {
        self.pairs.iter().map(|plane| plane.decide(features)).collect()
    }
}

impl Hyperplane {
    fn decide(&self, features: &[f64]) -> f64 {
        features.iter().zip(&self.weights).map(|(x, w)| x * w).sum::<f64>() + self.bias
    }
}

/// A window, and whether it is of the first class.
type LabeledWindow<'a> = (&'a [f64], bool);

/// Decision values of all windows, each by a machine that was trained without its part.
fn cross_validated_decisions(
    ones: &[LabeledWindow<'_>],
    others: &[LabeledWindow<'_>],
    features: usize,
) -> Vec<(f64, bool)> {
    let mut decisions = Vec::with_capacity(ones.len() + others.len());
    let parts = PROBABILITY_FOLDS.min(ones.len()).min(others.len()).max(1);
    for part in 0..parts {
        let range = |of: &[LabeledWindow<'_>]| part * of.len() / parts..(part + 1) * of.len() / parts;
        let (mut trained, mut tested) = (Vec::new(), Vec::new());
        for of in [ones, others] {
            let out = range(of);
            tested.extend_from_slice(&of[out.clone()]);
            trained.extend_from_slice(&of[..out.start]);
            trained.extend_from_slice(&of[out.end..]);
        }
        let one_sided = trained.iter().all(|(_, first)| *first) || trained.iter().all(|(_, first)| !*first);
        let (weights, bias) = solve_smo(if one_sided { &tested } else { &trained }, features);
        let value = |x: &[f64]| x.iter().zip(&weights).map(|(x, w)| x * w).sum::<f64>() + bias;
        decisions.extend(tested.iter().map(|(x, first)| (value(x), *first)));
    }
    decisions
}

/// Weights and bias of the machine with the widest margin, by sequential minimal optimisation with the pair that violates
/// the conditions most and gains most (Fan, Chen and Lin, Journal of Machine Learning Research 6, 2005).
fn solve_smo(samples: &[LabeledWindow<'_>], features: usize) -> (Vec<f64>, f64) {
    let count = samples.len();
    // Enough for separable and for hopeless data; what is left then is a plane short of the best.
    let max_steps = 200_000.max(100 * count);
    let sign = |k: usize| if samples[k].1 { 1.0 } else { -1.0 };
    let product = |a: usize, b: usize| samples[a].0.iter().zip(samples[b].0).map(|(x, y)| x * y).sum::<f64>();
    let squares: Vec<f64> = (0..count).map(|k| product(k, k)).collect();
    // Products with the windows that were moved, as they are asked for.
    let mut rows: Vec<Option<Vec<f64>>> = vec![None; count];
    let mut alpha = vec![0.0; count];
    let mut gradient = vec![-1.0; count];
    let up = |alpha: &[f64], k: usize| if sign(k) > 0.0 { alpha[k] < COST } else { alpha[k] > 0.0 };
    let down = |alpha: &[f64], k: usize| if sign(k) > 0.0 { alpha[k] > 0.0 } else { alpha[k] < COST };
    let bounds = |alpha: &[f64], gradient: &[f64]| {
        let value = |k: usize| -sign(k) * gradient[k];
        let rising = (0..count).filter(|k| up(alpha, *k)).map(|k| (value(k), k));
        let falling = (0..count).filter(|k| down(alpha, *k)).map(value);
        let max_violation =
            rising.fold((f64::NEG_INFINITY, 0), |best, next| if next.0 > best.0 { next } else { best });
        (max_violation, falling.fold(f64::INFINITY, f64::min))
    };
    for _ in 0..max_steps {
        let ((max, i), min) = bounds(&alpha, &gradient);
        if max - min < TOLERANCE || !(max - min).is_finite() {
            break;
        }
        let row_i = &*rows[i].get_or_insert_with(|| (0..count).map(|k| product(i, k)).collect());
        let mut best = (f64::INFINITY, i);
        for k in (0..count).filter(|k| down(&alpha, *k)) {
            let gap = max + sign(k) * gradient[k];
            if gap > 0.0 {
                let curvature = (squares[i] + squares[k] - 2.0 * row_i[k]).max(1e-12);
                let gain = -gap * gap / curvature;
                if gain < best.0 {
                    best = (gain, k);
                }
            }
        }
        let j = best.1;
        if j == i {
            break;
        }
        let row_j = rows[j].take().unwrap_or_else(|| (0..count).map(|k| product(j, k)).collect());
        let Some(row_i) = &rows[i] else { break };
        // Along the line that keeps the sum of the signed multipliers.
        let curvature = (squares[i] + squares[j] - 2.0 * row_i[j]).max(1e-12);
        let step = (max + sign(j) * gradient[j]) / curvature;
        let slack = |k: usize, rises: bool| if rises { COST - alpha[k] } else { alpha[k] };
        let step = step.min(slack(i, sign(i) > 0.0)).min(slack(j, sign(j) < 0.0));
        alpha[i] = (alpha[i] + sign(i) * step).clamp(0.0, COST);
        alpha[j] = (alpha[j] - sign(j) * step).clamp(0.0, COST);
        for (k, value) in gradient.iter_mut().enumerate() {
            *value += sign(k) * step * (row_i[k] - row_j[k]);
        }
        rows[j] = Some(row_j);
    }
    let mut weights = vec![0.0; features];
    for (k, (x, _)) in samples.iter().enumerate().filter(|(k, _)| alpha[*k] > 0.0) {
        weights.iter_mut().zip(*x).for_each(|(w, x)| *w += sign(k) * alpha[k] * x);
    }
    // Windows on the margin tell the bias; without any, the middle of what the others allow.
    let free: Vec<f64> =
        (0..count).filter(|k| alpha[*k] > 0.0 && alpha[*k] < COST).map(|k| -sign(k) * gradient[k]).collect();
    let bias = if free.is_empty() {
        let ((max, _), min) = bounds(&alpha, &gradient);
        (max + min) / 2.0
    } else {
        free.iter().sum::<f64>() / free.len() as f64
    };
    (weights, bias)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_points_are_divided_in_their_middle() {
        let (weights, bias) = solve_smo(&[(&[1.0, 3.0], true), (&[1.0, 1.0], false)], 2);
        assert!(weights[0].abs() < 1e-12 && (weights[1] - 1.0).abs() < 1e-6, "{weights:?}");
        assert!((bias + 2.0).abs() < 1e-6, "{bias}");
    }
}
