use super::TrainingSet;
use crate::EmgError;
use serde::{Deserialize, Serialize};

/// Gaussian naive Bayes, as scikit-learn's `GaussianNB`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct NaiveBayes {
    /// `[classes][features]`.
    means: Vec<Vec<f64>>,
    /// `[classes][features]`.
    variances: Vec<Vec<f64>>,
    /// Of the priors.
    #[serde(rename = "logarithms")]
    log_priors: Vec<f64>,
}

/// Share of the largest variance of a feature over all windows that is added to every variance (scikit-learn's
/// `var_smoothing`).
const SMOOTHING: f64 = 1e-9;

impl NaiveBayes {
    pub(crate) fn fit(set: &TrainingSet<'_>, priors: &[f64]) -> Result<NaiveBayes, EmgError> {
        let features = set.samples.ncols();
        let all: Vec<usize> = (0..set.samples.nrows()).collect();
        let moments = |rows: &[usize]| -> (Vec<f64>, Vec<f64>) {
            let count = rows.len() as f64;
            let mean = |j: usize| rows.iter().map(|i| set.samples[(*i, j)]).sum::<f64>() / count;
            let variance = |j: usize, mean: f64| {
                rows.iter().map(|i| (set.samples[(*i, j)] - mean).powi(2)).sum::<f64>() / count
            };
            (0..features).map(|j| (j, mean(j))).map(|(j, mean)| (mean, variance(j, mean))).unzip()
        };
        let floor = SMOOTHING * moments(&all).1.into_iter().fold(0.0, f64::max);
        if floor == 0.0 {
            return Err(EmgError::NoVariance);
        }
        let of_class = |class: usize| {
            let (means, mut variances) = moments(&set.of_class(class).collect::<Vec<_>>());
            variances.iter_mut().for_each(|v| *v += floor);
            (means, variances)
        };
        let (means, variances) = (0..set.classes).map(of_class).unzip();
        Ok(NaiveBayes { means, variances, log_priors: priors.iter().map(|p| p.ln()).collect() })
    }

    pub(crate) fn classes(&self) -> usize {
        self.means.len()
    }

    pub(crate) fn features(&self) -> usize {
        self.means.first().map_or(0, Vec::len)
    }

    pub(crate) fn is_sound(&self) -> bool {
        let (classes, features) = (self.classes(), self.features());
        classes >= 2
            && features > 0
            && self.variances.len() == classes
            && self.log_priors.len() == classes
            && self.means.iter().chain(&self.variances).all(|row| row.len() == features)
            && self.means.iter().flatten().chain(&self.log_priors).all(|v| v.is_finite())
            && self.variances.iter().flatten().all(|v| v.is_finite() && *v > 0.0)
    }

    pub(crate) fn map_features(&self, order: &dyn Fn(&[f64]) -> Vec<f64>) -> NaiveBayes {
        let map = |rows: &[Vec<f64>]| rows.iter().map(|row| order(row)).collect();
        NaiveBayes {
            means: map(&self.means),
            variances: map(&self.variances),
            log_priors: self.log_priors.clone(),
        }
    }

    pub(crate) fn scores(&self, features: &[f64], out: &mut [f64]) {
        let classes = self.means.iter().zip(&self.variances).zip(&self.log_priors);
        for (score, ((means, variances), logarithm)) in out.iter_mut().zip(classes) {
            let terms = features.iter().zip(means).zip(variances);
            let density = terms.map(|((x, mean), variance)| {
                (2.0 * std::f64::consts::PI * variance).ln() + (x - mean).powi(2) / variance
            });
            *score = logarithm - 0.5 * density.sum::<f64>();
        }
    }
}
