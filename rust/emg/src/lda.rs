use crate::{CovarianceNormalization, EmgError, Priors};
use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};

/// Linear discriminant analysis, as scikit-learn's solver `svd` with default options: priors from the class
/// counts, no shrinkage. Agrees with scikit-learn to about 1e-13.
///
/// Formulas: scikit-learn, `LinearDiscriminantAnalysis._solve_svd`; equal to the pooled-covariance discriminant
/// with a pseudo-inverse, so constant or duplicated features do no harm. Scaling or shifting a feature changes
/// nothing.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Lda {
    classes: usize,
    features: usize,
    #[serde(rename = "normalisation")]
    covariance_normalization: CovarianceNormalization,
    /// `[classes][features]`, row-major.
    coefficients: Vec<f64>,
    /// `[classes]`.
    intercepts: Vec<f64>,
}

/// Singular values below this, of standardised features, count as zero (scikit-learn's `tol`).
const TOLERANCE: f64 = 1e-4;

impl Lda {
    /// Fits to `samples`, `[windows][features]`, with `labels` from 0 to `classes - 1`, one a window.
    ///
    /// # Errors
    /// Wrong lengths, values that are not finite, fewer than two classes, a class without windows, no more windows
    /// than classes, or data in which nothing varies.
    pub fn fit(
        samples: &DMatrix<f64>,
        labels: &[usize],
        classes: usize,
        normalization: CovarianceNormalization,
    ) -> Result<Lda, EmgError> {
        Self::fit_with_priors(samples, labels, classes, normalization, Priors::Counts)
    }

    /// [`Lda::fit`] with a choice of priors, as scikit-learn's option `priors`.
    ///
    /// # Errors
    /// As [`Lda::fit`].
    pub fn fit_with_priors(
        samples: &DMatrix<f64>,
        labels: &[usize],
        classes: usize,
        normalization: CovarianceNormalization,
        priors: Priors,
    ) -> Result<Lda, EmgError> {
        let counts = check(samples, labels, classes)?;
        let (windows, features) = samples.shape();
        let priors = priors.class_priors(&counts);

        // Class means, and the overall mean as their weighted sum.
        let mut means = DMatrix::zeros(classes, features);
        for (row, &class) in samples.row_iter().zip(labels) {
            let mut mean = means.row_mut(class);
            mean += row;
        }
        for (mut mean, count) in means.row_iter_mut().zip(&counts) {
            mean /= *count as f64;
        }
        let overall = DVector::from_iterator(features, means.column_iter().map(|c| dot(c.iter(), &priors)));

        // Within-class deviations, standardised by column and whitened.
        let mut within = samples.clone();
        for (mut row, &class) in within.row_iter_mut().zip(labels) {
            row -= means.row(class);
        }
        let spread: Vec<f64> = within.column_iter().map(|c| population_sd(c.as_slice())).collect();
        let divisor = match normalization {
            CovarianceNormalization::Windows => windows,
            CovarianceNormalization::WindowsLessClasses => windows - classes,
        };
        let factor = (1.0 / divisor as f64).sqrt();
        for (mut column, sd) in within.column_iter_mut().zip(&spread) {
            column *= factor / sd;
        }
        let (singular, v_t) = singular_values(within)?;
        let rank = singular.iter().filter(|s| **s > TOLERANCE).count();
        if rank == 0 {
            return Err(EmgError::NoVariance);
        }
        let whitening = DMatrix::from_fn(features, rank, |j, r| v_t[(r, j)] / spread[j] / singular[r]);

        // Directions in the whitened space along which the class means differ.
        let mut between = DMatrix::zeros(classes, features);
        for (k, prior) in priors.iter().enumerate() {
            let weight = (windows as f64 * prior / (classes - 1) as f64).sqrt();
            between.row_mut(k).copy_from(&((means.row(k) - overall.transpose()) * weight));
        }
        let (singular, v_t) = singular_values(between * &whitening)?;
        let rank = singular.iter().filter(|s| **s > TOLERANCE * singular[0]).count();
        let scalings = whitening * v_t.rows(0, rank).transpose();

        let mut lda = Lda {
            classes,
            features,
            covariance_normalization: normalization,
            coefficients: Vec::with_capacity(classes * features),
            intercepts: Vec::with_capacity(classes),
        };
        for (k, prior) in priors.iter().enumerate() {
            let projected = (means.row(k) - overall.transpose()) * &scalings;
            let coefficients = &scalings * projected.transpose();
            let offset = -0.5 * projected.norm_squared() + prior.ln();
            lda.intercepts.push(offset - overall.dot(&coefficients));
            lda.coefficients.extend(coefficients.iter());
        }
        if lda.coefficients.iter().chain(&lda.intercepts).all(|v| v.is_finite()) {
            Ok(lda)
        } else {
            Err(EmgError::NoConvergence)
        }
    }

    /// Of coefficients, `[classes][features]`, and intercepts made elsewhere.
    pub(crate) fn from_parts(
        classes: usize,
        features: usize,
        normalization: CovarianceNormalization,
        coefficients: Vec<f64>,
        intercepts: Vec<f64>,
    ) -> Result<Lda, EmgError> {
        let lda =
            Lda { classes, features, covariance_normalization: normalization, coefficients, intercepts };
        if lda.is_sound() { Ok(lda) } else { Err(EmgError::NoConvergence) }
    }

    /// The same discriminant for features in another order, which `order` gives a vector.
    pub(crate) fn map_features(&self, order: &dyn Fn(&[f64]) -> Vec<f64>) -> Result<Lda, EmgError> {
        let rows = self.coefficients.chunks_exact(self.features.max(1));
        let (intercepts, coefficients) = (self.intercepts.clone(), rows.flat_map(order).collect());
        Lda::from_parts(self.classes, self.features, self.covariance_normalization, coefficients, intercepts)
    }

    /// Whether the lengths fit and every value is finite.
    pub(crate) fn is_sound(&self) -> bool {
        let values = self.coefficients.iter().chain(&self.intercepts);
        self.classes >= 2
            && self.intercepts.len() == self.classes
            && self.classes.checked_mul(self.features) == Some(self.coefficients.len())
            && values.into_iter().all(|v| v.is_finite())
    }

    /// Number of classes.
    pub fn classes(&self) -> usize {
        self.classes
    }

    /// Number of features.
    pub fn features(&self) -> usize {
        self.features
    }

    /// How the covariance was normalised.
    pub fn covariance_normalization(&self) -> CovarianceNormalization {
        self.covariance_normalization
    }

    /// Writes the decision value of each class for one feature vector to `out`, `[classes]`. The class is that of
    /// the largest value, the first of equals.
    ///
    /// # Panics
    /// If a length differs from [`Lda::features`] or [`Lda::classes`]; the caller owns both.
    pub fn decide(&self, features: &[f64], out: &mut [f64]) {
        assert_eq!((features.len(), out.len()), (self.features, self.classes), "features and classes");
        let rows = self.coefficients.chunks_exact(self.features);
        for ((value, row), intercept) in out.iter_mut().zip(rows).zip(&self.intercepts) {
            *value = dot(features.iter(), row) + intercept;
        }
    }
}

impl Priors {
    /// The probability of each class from its number of windows.
    pub(crate) fn class_priors(self, counts: &[usize]) -> Vec<f64> {
        let total = counts.iter().sum::<usize>() as f64;
        let prior = |count: &usize| match self {
            Priors::Counts => *count as f64 / total,
            Priors::Equal => 1.0 / counts.len() as f64,
        };
        counts.iter().map(prior).collect()
    }
}

/// Turns decision values into probabilities that sum to one, in place; the maximum is subtracted first so that
/// large values do not overflow.
pub(crate) fn softmax(values: &mut [f64]) {
    let largest = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let mut sum = 0.0;
    for value in values.iter_mut() {
        *value = (*value - largest).exp();
        sum += *value;
    }
    for value in values.iter_mut() {
        *value /= sum;
    }
}

/// Checks the training data; returns the number of windows of each class.
pub(crate) fn check(
    samples: &DMatrix<f64>,
    labels: &[usize],
    classes: usize,
) -> Result<Vec<usize>, EmgError> {
    let windows = samples.nrows();
    if labels.len() != windows {
        return Err(EmgError::LabelCount { windows, labels: labels.len() });
    }
    if classes < 2 {
        return Err(EmgError::TooFewClasses { got: classes });
    }
    if windows <= classes {
        return Err(EmgError::TooFewWindows { windows, classes });
    }
    if samples.ncols() == 0 {
        return Err(EmgError::NoVariance);
    }
    for (window, row) in samples.row_iter().enumerate() {
        if let Some((index, &value)) = row.iter().enumerate().find(|(_, v)| !v.is_finite()) {
            return Err(EmgError::NotFinite { window, index, value });
        }
    }
    let mut counts = vec![0; classes];
    for &class in labels {
        *counts.get_mut(class).ok_or(EmgError::EmptyClass { class, classes, windows: 0 })? += 1;
    }
    match counts.iter().position(|c| *c == 0) {
        Some(class) => Err(EmgError::EmptyClass { class, classes, windows: 0 }),
        None => Ok(counts),
    }
}

/// Singular values in descending order and the transposed right singular vectors, by one-sided Jacobi rotations
/// (Hestenes 1958) after a QR decomposition.
///
/// nalgebra's own decomposition gave wrong vectors for some matrices with duplicated and constant columns, which
/// dead channels bring; the test of the closed form in `moments.rs` found it.
pub(crate) fn singular_values(matrix: DMatrix<f64>) -> Result<(DVector<f64>, DMatrix<f64>), EmgError> {
    // Six to ten sweeps are usual.
    const MAX_SWEEPS: usize = 60;
    let mut columns = if matrix.nrows() > matrix.ncols() { matrix.qr().unpack_r() } else { matrix };
    let count = columns.ncols();
    let mut vectors = DMatrix::<f64>::identity(count, count);
    // A dot product is not more exact than this; to ask for more would turn some columns for ever.
    let rounding = columns.nrows() as f64 * f64::EPSILON;
    // So would columns that are rounding only.
    let nothing = (f64::EPSILON * columns.norm()).powi(2);
    let mut turned = true;
    for _ in 0..MAX_SWEEPS {
        turned = false;
        for p in 0..count {
            for q in p + 1..count {
                let (a, b) = (columns.column(p).norm_squared(), columns.column(q).norm_squared());
                let product = columns.column(p).dot(&columns.column(q));
                if a <= nothing || b <= nothing || product.abs() <= rounding * (a * b).sqrt() {
                    continue;
                }
                turned = true;
                let zeta = (b - a) / (2.0 * product);
                let tangent = zeta.signum() / (zeta.abs() + zeta.hypot(1.0));
                let cosine = 1.0 / tangent.hypot(1.0);
                rotate(&mut columns, p, q, cosine, cosine * tangent);
                rotate(&mut vectors, p, q, cosine, cosine * tangent);
            }
        }
        if !turned {
            break;
        }
    }
    let values = DVector::from_iterator(count, columns.column_iter().map(|c| c.norm()));
    if turned || !values.iter().all(|v| v.is_finite()) {
        return Err(EmgError::NoConvergence);
    }
    let mut order: Vec<usize> = (0..count).collect();
    order.sort_by(|a, b| values[*b].total_cmp(&values[*a]));
    Ok((
        DVector::from_fn(count, |k, _| values[order[k]]),
        DMatrix::from_fn(count, count, |k, j| vectors[(j, order[k])]),
    ))
}

/// Turns two columns in their plane.
fn rotate(matrix: &mut DMatrix<f64>, p: usize, q: usize, cosine: f64, sine: f64) {
    for row in 0..matrix.nrows() {
        let (a, b) = (matrix[(row, p)], matrix[(row, q)]);
        matrix[(row, p)] = cosine * a - sine * b;
        matrix[(row, q)] = sine * a + cosine * b;
    }
}

fn dot<'a>(a: impl Iterator<Item = &'a f64>, b: &[f64]) -> f64 {
    a.zip(b).map(|(a, b)| a * b).sum()
}

/// Population standard deviation; one for a constant column, so that dividing by it does nothing.
fn population_sd(values: &[f64]) -> f64 {
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / values.len() as f64;
    if variance > 0.0 { variance.sqrt() } else { 1.0 }
}
