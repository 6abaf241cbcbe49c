use super::TrainingSet;
use crate::{CovarianceNormalization, EmgError};
use nalgebra::{Cholesky, DMatrix, DVector};
use serde::{Deserialize, Serialize};

/// Quadratic discriminant analysis: the logarithm of each class's normal density and prior, as scikit-learn's solver `svd`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct QuadraticDiscriminant {
    classes: Vec<ClassGaussian>,
}

/// A normal distribution and its prior.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct ClassGaussian {
    mean: Vec<f64>,
    /// `[features][features]`, row-major: turns a deviation from the mean into independent ones of variance 1.
    whitening: Vec<f64>,
    /// Logarithm of the prior less half that of the determinant of the covariance.
    offset: f64,
}

/// Share of a feature's variance that the others must leave unexplained.
const MIN_RESIDUAL_VARIANCE_SHARE: f64 = 1e-9;

impl QuadraticDiscriminant {
    pub(crate) fn fit(
        set: &TrainingSet<'_>,
        priors: &[f64],
        normalization: CovarianceNormalization,
    ) -> Result<QuadraticDiscriminant, EmgError> {
        let classes = (0..set.classes).zip(priors);
        let classes = classes.map(|(class, prior)| ClassGaussian::fit(set, class, *prior, normalization));
        Ok(QuadraticDiscriminant { classes: classes.collect::<Result<_, _>>()? })
    }

    pub(crate) fn classes(&self) -> usize {
        self.classes.len()
    }

    pub(crate) fn features(&self) -> usize {
        self.classes.first().map_or(0, |class| class.mean.len())
    }

    pub(crate) fn is_sound(&self) -> bool {
        let features = self.features();
        let sound = |class: &ClassGaussian| {
            class.mean.len() == features
                && features.checked_mul(features) == Some(class.whitening.len())
                && class.mean.iter().chain(&class.whitening).all(|v| v.is_finite())
                && class.offset.is_finite()
        };
        features > 0 && self.classes.len() >= 2 && self.classes.iter().all(sound)
    }

    pub(crate) fn map_features(&self, order: &dyn Fn(&[f64]) -> Vec<f64>) -> QuadraticDiscriminant {
        let map = |class: &ClassGaussian| ClassGaussian {
            mean: order(&class.mean),
            whitening: class.whitening.chunks_exact(class.mean.len()).flat_map(order).collect(),
            offset: class.offset,
        };
        QuadraticDiscriminant { classes: self.classes.iter().map(map).collect() }
    }

    pub(crate) fn scores(&self, features: &[f64], out: &mut [f64]) {
        for (score, class) in out.iter_mut().zip(&self.classes) {
            let deviation = || features.iter().zip(&class.mean).map(|(x, mean)| x - mean);
            let rows = class.whitening.chunks_exact(class.mean.len());
            let squares = rows.map(|row| deviation().zip(row).map(|(d, w)| d * w).sum::<f64>().powi(2));
            *score = class.offset - 0.5 * squares.sum::<f64>();
        }
    }
}

impl ClassGaussian {
    fn fit(
        set: &TrainingSet<'_>,
        class: usize,
        prior: f64,
        normalization: CovarianceNormalization,
    ) -> Result<ClassGaussian, EmgError> {
        let rows: Vec<usize> = set.of_class(class).collect();
        let (windows, features) = (rows.len(), set.samples.ncols());
        let singular = |feature| EmgError::SingularClass { class, windows, features, feature };
        if windows <= features {
            return Err(singular(None));
        }
        let divisor = match normalization {
            CovarianceNormalization::Windows => windows,
            CovarianceNormalization::WindowsLessClasses => windows - 1,
        } as f64;
        let samples = set.samples.select_rows(&rows);
        let mean = DVector::from_iterator(features, samples.column_iter().map(|c| c.sum() / windows as f64));
        let centered = DMatrix::from_fn(windows, features, |i, j| samples[(i, j)] - mean[j]);
        let covariance = centered.tr_mul(&centered) / divisor;
        // Correlations, so that the scale of a feature does not decide what counts as zero.
        let spread = covariance.diagonal().map(f64::sqrt);
        let constant = (0..features).find(|j| spread[*j] <= f64::EPSILON * mean[*j].abs());
        if let Some(feature) = constant {
            return Err(singular(Some(feature)));
        }
        let correlation =
            DMatrix::from_fn(features, features, |i, j| covariance[(i, j)] / spread[i] / spread[j]);
        let lower = Cholesky::new(correlation).ok_or_else(|| singular(None))?.unpack();
        if let Some(feature) = (0..features).find(|j| lower[(*j, *j)].powi(2) < MIN_RESIDUAL_VARIANCE_SHARE) {
            return Err(singular(Some(feature)));
        }
        let inverse = lower
            .solve_lower_triangular(&DMatrix::identity(features, features))
            .ok_or_else(|| singular(None))?;
        let log_determinant: f64 = (0..features).map(|j| 2.0 * (lower[(j, j)] * spread[j]).ln()).sum();
        let whitening = (0..features).flat_map(|i| (0..features).map(move |j| (i, j)));
        Ok(ClassGaussian {
            mean: mean.iter().copied().collect(),
            whitening: whitening.map(|(i, j)| inverse[(i, j)] / spread[j]).collect(),
            offset: prior.ln() - 0.5 * log_determinant,
        })
    }
}
