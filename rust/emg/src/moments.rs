use crate::{CovarianceNormalization, EmgError, Lda, Priors};
use nalgebra::{DMatrix, DVector, SymmetricEigen};
use serde::{Deserialize, Serialize};

/// What a discriminant is made of: the class means and the pooled covariance. From these it can be made anew when
/// a window is added, without the windows themselves.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ClassMoments {
    /// Windows of each class.
    pub(crate) counts: Vec<f64>,
    /// `[classes][features]`.
    pub(crate) means: Vec<Vec<f64>>,
    /// `[features][features]`, row-major, divided by the number of windows.
    pub(crate) covariance: Vec<f64>,
}

/// Standard deviations below this, of standardised features, count as zero: the tolerance of [`Lda::fit`].
const TOLERANCE: f64 = 1e-4;

impl ClassMoments {
    /// Of `windows`, `[windows][features]`, with the class of each, all below `classes`.
    pub(crate) fn of<F: AsRef<[f64]>>(windows: &[F], labels: &[usize], classes: usize) -> ClassMoments {
        let features = windows.first().map_or(0, |w| w.as_ref().len());
        let mut moments = ClassMoments {
            counts: vec![0.0; classes],
            means: vec![vec![0.0; features]; classes],
            covariance: vec![0.0; features * features],
        };
        for (window, &class) in windows.iter().zip(labels) {
            moments.add(class, window.as_ref(), f64::INFINITY);
        }
        moments
    }

    /// Adds a window. Means and covariance are those of all windows so far (Welford 1962), except that the past
    /// counts for no more than `memory` windows a class.
    pub(crate) fn add(&mut self, class: usize, window: &[f64], memory: f64) {
        let past = self.counts[class].min(memory);
        let total = self.counts.iter().map(|c| c.min(memory)).sum::<f64>();
        self.counts[class] += 1.0;
        let mean = &mut self.means[class];
        let deviation: Vec<f64> = window.iter().zip(mean.iter()).map(|(x, m)| x - m).collect();
        mean.iter_mut().zip(&deviation).for_each(|(m, d)| *m += d / (past + 1.0));
        let (keep, weight) = (total / (total + 1.0), past / (past + 1.0) / (total + 1.0));
        for (row, a) in self.covariance.chunks_exact_mut(deviation.len()).zip(&deviation) {
            for (value, b) in row.iter_mut().zip(&deviation) {
                *value = keep * *value + weight * a * b;
            }
        }
    }

    /// The discriminant of these moments: [`Lda::fit`] in closed form, `covariance^+ (mean_k - mean)`.
    pub(crate) fn lda(
        &self,
        normalization: CovarianceNormalization,
        priors: Priors,
    ) -> Result<Lda, EmgError> {
        let (classes, features) = (self.counts.len(), self.means[0].len());
        let windows = self.counts.iter().sum::<f64>();
        let whole: Vec<usize> = self.counts.iter().map(|c| *c as usize).collect();
        let priors = priors.class_priors(&whole);
        let factor = match normalization {
            CovarianceNormalization::Windows => 1.0,
            CovarianceNormalization::WindowsLessClasses => windows / (windows - classes as f64),
        };
        let at = |i: usize, j: usize| self.covariance[i * features + j];
        let sd: Vec<f64> =
            (0..features).map(|i| if at(i, i) > 0.0 { at(i, i).sqrt() } else { 1.0 }).collect();
        let standardized = DMatrix::from_fn(features, features, |i, j| factor * at(i, j) / sd[i] / sd[j]);
        if !standardized.iter().all(|v| v.is_finite()) {
            return Err(EmgError::NoConvergence);
        }
        let eigen =
            SymmetricEigen::try_new(standardized, f64::EPSILON, 100_000).ok_or(EmgError::NoConvergence)?;
        let inverse = eigen.eigenvalues.map(|v| if v > TOLERANCE * TOLERANCE { 1.0 / v } else { 0.0 });
        if inverse.iter().all(|v| *v == 0.0) {
            return Err(EmgError::NoVariance);
        }
        let overall: Vec<f64> = (0..features)
            .map(|j| self.means.iter().zip(&priors).map(|(mean, prior)| mean[j] * prior).sum())
            .collect();
        let (mut coefficients, mut intercepts) = (Vec::new(), Vec::new());
        for (mean, prior) in self.means.iter().zip(&priors) {
            let standard = DVector::from_fn(features, |j, _| (mean[j] - overall[j]) / sd[j]);
            let projected = eigen.eigenvectors.tr_mul(&standard).component_mul(&inverse);
            let row: Vec<f64> =
                (&eigen.eigenvectors * projected).iter().zip(&sd).map(|(v, sd)| v / sd).collect();
            // The squared length of the projected mean, and the overall mean's share.
            let offset: f64 =
                row.iter().zip(mean).zip(&overall).map(|((c, m), o)| c * (0.5 * (m - o) + o)).sum();
            intercepts.push(prior.ln() - offset);
            coefficients.extend(row);
        }
        Lda::from_parts(classes, features, normalization, coefficients, intercepts)
    }

    /// Distance of a window from a class mean, in standard deviations of the classes along each feature, root mean
    /// square over features.
    pub(crate) fn distance(&self, class: usize, window: &[f64]) -> f64 {
        let features = window.len();
        let square = |j: usize| {
            let variance = self.covariance[j * features + j];
            if variance > 0.0 { (window[j] - self.means[class][j]).powi(2) / variance } else { 0.0 }
        };
        ((0..features).map(square).sum::<f64>() / features.max(1) as f64).sqrt()
    }

    /// The moments of the same windows with their features in another order, which `order` gives a vector.
    pub(crate) fn map_features(&self, order: &dyn Fn(&[f64]) -> Vec<f64>) -> ClassMoments {
        let features = self.means.first().map_or(0, Vec::len);
        let rows: Vec<Vec<f64>> = self.covariance.chunks_exact(features.max(1)).map(order).collect();
        // The rows themselves are in the order of the features, too: by columns.
        let columns: Vec<Vec<f64>> =
            (0..features).map(|j| order(&rows.iter().map(|row| row[j]).collect::<Vec<f64>>())).collect();
        ClassMoments {
            counts: self.counts.clone(),
            means: self.means.iter().map(|mean| order(mean)).collect(),
            covariance: (0..features * features).map(|k| columns[k % features][k / features]).collect(),
        }
    }

    /// Whether the lengths fit and every value is finite.
    pub(crate) fn is_sound(&self, classes: usize, features: usize, min_windows: f64) -> bool {
        let finite = |values: &[f64]| values.iter().all(|v| v.is_finite());
        self.counts.len() == classes
            && self.means.len() == classes
            && self.means.iter().all(|m| m.len() == features && finite(m))
            && self.covariance.len() == features * features
            && finite(&self.covariance)
            && self.counts.iter().all(|c| c.is_finite() && *c >= min_windows)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Agreement of the closed form with the two decompositions, relative to the largest decision value.
    const RELATIVE: f64 = 1e-9;

    fn data() -> (Vec<[f64; 5]>, Vec<usize>) {
        let window = |k: usize| {
            let (class, t) = (k % 3, k as f64);
            let a = (t * 1.3).sin() + class as f64;
            // The third feature repeats the first, the last is constant.
            [a, 40.0 * (t * 0.7).cos() - 9.0 * (class * class) as f64, a, (t * t).sin(), 7.0]
        };
        ((0..91).map(window).collect(), (0..91).map(|k| k % 3).collect())
    }

    #[test]
    fn the_closed_form_is_the_fitted_discriminant_window_by_window() {
        let (windows, labels) = data();
        for normalization in [CovarianceNormalization::Windows, CovarianceNormalization::WindowsLessClasses] {
            for priors in [Priors::Counts, Priors::Equal] {
                // Sixty windows at once, the others one by one.
                let mut moments = ClassMoments::of(&windows[..60], &labels[..60], 3);
                for (window, class) in windows.iter().zip(&labels).skip(60) {
                    moments.add(*class, window, f64::INFINITY);
                }
                let closed = moments.lda(normalization, priors).expect("good data");
                let matrix = DMatrix::from_fn(91, 5, |i, j| windows[i][j]);
                let fitted =
                    Lda::fit_with_priors(&matrix, &labels, 3, normalization, priors).expect("good data");
                for window in &windows {
                    let (mut a, mut b) = ([0.0; 3], [0.0; 3]);
                    closed.decide(window, &mut a);
                    fitted.decide(window, &mut b);
                    let scale = b.iter().fold(1.0_f64, |max, v| max.max(v.abs()));
                    assert!(a.iter().zip(&b).all(|(a, b)| (a - b).abs() <= RELATIVE * scale), "{a:?} {b:?}");
                }
            }
        }
    }

    #[test]
    fn a_short_memory_forgets_the_calibration() {
        let (windows, labels) = data();
        let mut moments = ClassMoments::of(&windows, &labels, 3);
        for _ in 0..200 {
            moments.add(1, &[5.0; 5], 20.0);
        }
        assert!(moments.means[1].iter().all(|m| (m - 5.0).abs() < 0.01), "{:?}", moments.means[1]);
        assert_eq!(moments.counts[1], 230.0);
    }
}
