use super::TrainingSet;
use serde::{Deserialize, Serialize};

/// The nearest windows of the training vote, as scikit-learn's `KNeighborsClassifier` behind a `StandardScaler`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct KNearestNeighbors {
    classes: usize,
    /// Of each feature over the training.
    mean: Vec<f64>,
    /// Standard deviation of each feature over the training.
    #[serde(rename = "spread")]
    sd: Vec<f64>,
    /// `[windows][features]`, standardised.
    windows: Vec<f64>,
    /// Class of each window.
    labels: Vec<usize>,
}

/// How many vote (scikit-learn's default).
const NEIGHBOR_COUNT: usize = 5;

impl KNearestNeighbors {
    pub(crate) fn fit(set: &TrainingSet<'_>) -> KNearestNeighbors {
        let (mean, spread) = set.mean_and_sd();
        let windows = set.standardized(&mean, &spread);
        KNearestNeighbors { classes: set.classes, mean, sd: spread, windows, labels: set.labels.to_vec() }
    }

    pub(crate) fn classes(&self) -> usize {
        self.classes
    }

    pub(crate) fn features(&self) -> usize {
        self.mean.len()
    }

    pub(crate) fn is_sound(&self) -> bool {
        let features = self.features();
        self.classes >= 2
            && features > 0
            && !self.labels.is_empty()
            && self.sd.len() == features
            && self.labels.len().checked_mul(features) == Some(self.windows.len())
            && self.labels.iter().all(|label| *label < self.classes)
            && self.mean.iter().chain(&self.windows).all(|v| v.is_finite())
            && self.sd.iter().all(|v| v.is_finite() && *v > 0.0)
    }

    pub(crate) fn map_features(&self, order: &dyn Fn(&[f64]) -> Vec<f64>) -> KNearestNeighbors {
        KNearestNeighbors {
            mean: order(&self.mean),
            sd: order(&self.sd),
            windows: self.windows.chunks_exact(self.features()).flat_map(order).collect(),
            ..self.clone()
        }
    }

    pub(crate) fn scores(&self, features: &[f64], out: &mut [f64]) {
        if !features.iter().all(|v| v.is_finite()) {
            out.fill(f64::NAN);
            return;
        }
        // The nearest so far, the nearest first: distance and class.
        let mut nearest = [(f64::INFINITY, 0); NEIGHBOR_COUNT];
        for (window, label) in self.windows.chunks_exact(self.features()).zip(&self.labels) {
            let scaled = features.iter().zip(&self.mean).zip(&self.sd).map(|((x, m), s)| (x - m) / s);
            let distance: f64 = scaled.zip(window).map(|(x, w)| (x - w).powi(2)).sum();
            let rank = nearest.iter().position(|(other, _)| distance < *other);
            if let Some(rank) = rank {
                nearest[rank..].rotate_right(1);
                nearest[rank] = (distance, *label);
            }
        }
        out.fill(0.0);
        let voters = nearest.iter().filter(|(distance, _)| distance.is_finite());
        let share = 1.0 / voters.clone().count().max(1) as f64;
        voters.for_each(|(_, class)| out[*class] += share);
    }
}
