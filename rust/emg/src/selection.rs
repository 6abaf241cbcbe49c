use crate::{CovarianceNormalization, EmgError, Feature, FeatureLayout, FeatureVector, Lda};
use nalgebra::{DMatrix, DVector, RowDVector, SymmetricEigen};
use serde::Serialize;
use std::{fmt, ops::Range, str::FromStr};

/// By what features are chosen: the criteria of LibEMG's `FeatureSelector`, by its definitions.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum SelectionCriterion {
    /// Share of windows that LDA recognises, leaving one repetition out; the more the better.
    Accuracy,
    /// Share of windows that LDA takes for a gesture other than rest, wrongly; the less the better.
    ActiveError,
    /// Mean semi-principal axis: geometric means of the principal directions of each class; the more the better.
    MeanSemiPrincipalAxis,
    /// Feature efficiency: share of the windows of two classes that lie outside the overlap of their ranges, the best partner
    /// of each class; the more the better. Features are looked at one by one.
    FeatureEfficiency,
    /// Repeatability index: Mahalanobis distance of a repetition's mean from the others of its class; the less the better.
    Repeatability,
    /// Separability index: half the Mahalanobis distance of a class from its nearest neighbour; the more the better.
    Separability,
}

impl SelectionCriterion {
    /// All of them.
    pub const ALL: [SelectionCriterion; 6] = {
        use SelectionCriterion::*;
        [Accuracy, ActiveError, MeanSemiPrincipalAxis, FeatureEfficiency, Repeatability, Separability]
    };

    fn more_is_better(self) -> bool {
        !matches!(self, SelectionCriterion::ActiveError | SelectionCriterion::Repeatability)
    }
}

/// Windows to choose features by.
#[derive(Clone, Debug)]
pub struct SelectionData<'a> {
    /// Features of each window.
    pub windows: &'a [FeatureVector],
    /// Where the features stand.
    pub layout: FeatureLayout,
    /// Class of each window, from 0.
    pub labels: &'a [usize],
    /// Repetition of each window.
    pub repetitions: &'a [u32],
    /// The class of the relaxed hand, for [`SelectionCriterion::ActiveError`].
    pub rest: usize,
}

/// A feature as it was chosen.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SelectedFeature {
    /// LibEMG's name.
    pub feature: String,
    /// The criterion of all features up to this one; of this one alone for feature efficiency.
    pub value: f64,
}

/// Puts features in order: the best first, then the one that is best beside it, and so on; `max_features` at most.
///
/// # Errors
/// Fewer than two classes or repetitions, lengths that differ, or windows that LDA cannot be fitted to.
pub fn select_features(
    data: &SelectionData<'_>,
    criterion: SelectionCriterion,
    max_features: usize,
) -> Result<Vec<SelectedFeature>, EmgError> {
    let windows = data.windows.len();
    for labels in [data.labels.len(), data.repetitions.len()] {
        if labels != windows {
            return Err(EmgError::LabelCount { windows, labels });
        }
    }
    let expected = data.layout.count();
    if let Some(window) = data.windows.iter().find(|w| w.len() != expected) {
        return Err(EmgError::FeatureCount { got: window.len(), expected });
    }
    let better = |a: f64, b: f64| if criterion.more_is_better() { a > b } else { a < b };
    let mut left: Vec<(Feature, Range<usize>)> =
        data.layout.feature_ranges().map(|(feature, _, range)| (feature, range)).collect();
    let (mut chosen, mut columns) = (Vec::new(), Vec::new());
    while !left.is_empty() && chosen.len() < max_features {
        let mut best: Option<(usize, f64)> = None;
        for (index, (_, range)) in left.iter().enumerate() {
            let alone = criterion == SelectionCriterion::FeatureEfficiency;
            let before = if alone { &[][..] } else { &columns[..] };
            let columns: Vec<usize> = before.iter().copied().chain(range.clone()).collect();
            let value = FeatureTable::new(data, &columns).value(criterion)?;
            if best.is_none_or(|(_, best_value)| better(value, best_value)) {
                best = Some((index, value));
            }
        }
        let Some((index, value)) = best else { break };
        let (feature, range) = left.remove(index);
        columns.extend(range);
        chosen.push(SelectedFeature { feature: feature.name().to_owned(), value });
    }
    Ok(chosen)
}

/// Some columns of the windows.
struct FeatureTable<'a> {
    data: &'a SelectionData<'a>,
    matrix: DMatrix<f64>,
    classes: usize,
    repetitions: Vec<u32>,
}

impl<'a> FeatureTable<'a> {
    fn new(data: &'a SelectionData<'a>, columns: &[usize]) -> FeatureTable<'a> {
        let matrix = DMatrix::from_fn(data.windows.len(), columns.len(), |i, j| data.windows[i][columns[j]]);
        let mut repetitions = data.repetitions.to_vec();
        repetitions.sort_unstable();
        repetitions.dedup();
        let classes = data.labels.iter().max().map_or(0, |max_label| max_label + 1);
        FeatureTable { data, matrix, classes, repetitions }
    }

    fn rows(&self, keep: impl Fn(usize, u32) -> bool) -> Vec<usize> {
        let of = |k: &usize| keep(self.data.labels[*k], self.data.repetitions[*k]);
        (0..self.data.labels.len()).filter(of).collect()
    }

    fn value(&self, criterion: SelectionCriterion) -> Result<f64, EmgError> {
        if self.classes < 2 {
            return Err(EmgError::TooFewClasses { got: self.classes });
        }
        let folds = self.repetitions.iter().copied();
        let mean = |values: Vec<f64>| values.iter().sum::<f64>() / values.len() as f64;
        Ok(match criterion {
            SelectionCriterion::Accuracy => {
                mean(folds.map(|f| self.fold_accuracy(f, None)).collect::<Result<_, _>>()?)
            }
            SelectionCriterion::ActiveError => {
                mean(folds.map(|f| self.fold_accuracy(f, Some(self.data.rest))).collect::<Result<_, _>>()?)
            }
            SelectionCriterion::MeanSemiPrincipalAxis => {
                mean(folds.map(|f| self.principal_axes(f)).collect())
            }
            SelectionCriterion::FeatureEfficiency => mean(folds.map(|f| self.efficiency(f)).collect()),
            SelectionCriterion::Repeatability => self.repeatability(),
            SelectionCriterion::Separability => self.separability(),
        })
    }

    /// Percentage of the windows of a repetition that LDA recognises without having seen it; with a class of rest, the
    /// percentage that it takes for another class than rest, wrongly.
    fn fold_accuracy(&self, fold: u32, rest: Option<usize>) -> Result<f64, EmgError> {
        let (train, test) = (self.rows(|_, r| r != fold), self.rows(|_, r| r == fold));
        let labels: Vec<usize> = train.iter().map(|k| self.data.labels[*k]).collect();
        let lda = Lda::fit(
            &self.matrix.select_rows(&train),
            &labels,
            self.classes,
            CovarianceNormalization::Windows,
        )?;
        let mut scores = vec![0.0; self.classes];
        let mut counted = 0;
        for k in &test {
            let row: Vec<f64> = self.matrix.row(*k).iter().copied().collect();
            lda.decide(&row, &mut scores);
            let class = (1..scores.len()).fold(0, |best, c| if scores[c] > scores[best] { c } else { best });
            let right = class == self.data.labels[*k];
            counted += usize::from(rest.map_or(right, |rest| !right && class != rest));
        }
        Ok(100.0 * counted as f64 / test.len() as f64)
    }

    fn principal_axes(&self, fold: u32) -> f64 {
        // Scaled by all values together, as there.
        let all = self.matrix.select_rows(&self.rows(|_, r| r != fold));
        let mean = all.mean();
        let spread = all.map(|v| (v - mean).powi(2)).mean().sqrt();
        let mut sum = 0.0;
        for class in 0..self.classes {
            let rows = self.matrix.select_rows(&self.rows(|c, r| c == class && r != fold));
            let (_, covariance) = moments(&rows.map(|v| (v - mean) / spread));
            let mut eigen = SymmetricEigen::new(covariance);
            let mut order: Vec<usize> = (0..eigen.eigenvalues.len()).collect();
            order.sort_by(|a, b| eigen.eigenvalues[*b].total_cmp(&eigen.eigenvalues[*a]));
            // No more directions than windows.
            for index in order.into_iter().take(rows.nrows()) {
                let axis = eigen.eigenvectors.column_mut(index);
                sum += axis.iter().map(|v| v.abs()).product::<f64>().powf(1.0 / axis.len() as f64);
            }
        }
        sum / self.classes as f64
    }

    fn efficiency(&self, fold: u32) -> f64 {
        let classes: Vec<Vec<usize>> =
            (0..self.classes).map(|class| self.rows(|c, r| c == class && r != fold)).collect();
        let pair = |one: &[usize], other: &[usize], column: usize| {
            let values = |rows: &[usize]| rows.iter().map(|k| self.matrix[(*k, column)]).collect::<Vec<_>>();
            let (a, b) = (values(one), values(other));
            let minimum = |v: &[f64]| v.iter().copied().fold(f64::INFINITY, f64::min);
            let maximum = |v: &[f64]| v.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            let (low, high) = (minimum(&a).max(minimum(&b)), maximum(&a).min(maximum(&b)));
            let whole = (a.len() + b.len()) as f64;
            let confused = a.iter().chain(&b).filter(|v| **v < high && **v > low).count() as f64;
            (whole - confused) / whole
        };
        let best_partner = |i: usize| {
            let others = (0..classes.len()).filter(|j| *j != i);
            let columns = |j: usize| (0..self.matrix.ncols()).map(move |column| (j, column));
            let values = others.flat_map(columns).map(|(j, column)| pair(&classes[i], &classes[j], column));
            values.fold(0.0, f64::max)
        };
        (0..classes.len()).map(best_partner).sum::<f64>() / (classes.len() - 1) as f64
    }

    fn repeatability(&self) -> f64 {
        let mut sum = 0.0;
        for class in 0..self.classes {
            for fold in &self.repetitions {
                let others = self.matrix.select_rows(&self.rows(|c, r| c == class && r != *fold));
                let this = self.matrix.select_rows(&self.rows(|c, r| c == class && r == *fold));
                sum += mahalanobis(&others, &this) / 2.0;
            }
        }
        sum / (self.classes * self.classes) as f64
    }

    fn separability(&self) -> f64 {
        let classes: Vec<DMatrix<f64>> =
            (0..self.classes).map(|class| self.matrix.select_rows(&self.rows(|c, _| c == class))).collect();
        let nearest = |i: usize| {
            let others = (0..classes.len()).filter(|j| *j != i);
            others.map(|j| mahalanobis(&classes[i], &classes[j]) / 2.0).fold(f64::INFINITY, f64::min)
        };
        (0..classes.len()).map(nearest).sum::<f64>() / self.classes as f64
    }
}

/// Mean and covariance (divided by one less than the rows).
fn moments(rows: &DMatrix<f64>) -> (RowDVector<f64>, DMatrix<f64>) {
    let mean = rows.row_mean();
    let mut centered = rows.clone();
    centered.row_iter_mut().for_each(|mut row| row -= &mean);
    (mean, centered.tr_mul(&centered) / (rows.nrows() as f64 - 1.0))
}

/// Distance of the mean of `other` from that of `one` by the pseudo-inverse of the covariance of `one`.
fn mahalanobis(one: &DMatrix<f64>, other: &DMatrix<f64>) -> f64 {
    let (mean, covariance) = moments(one);
    let off: DVector<f64> = (mean - other.row_mean()).transpose();
    let eigen = SymmetricEigen::new(covariance);
    // NumPy's limit for its pseudo-inverse.
    let limit = 1e-15 * eigen.eigenvalues.amax();
    let along = eigen.eigenvectors.tr_mul(&off);
    let terms = along.iter().zip(&eigen.eigenvalues).filter(|(_, value)| value.abs() > limit);
    terms.map(|(component, value)| component * component / value).sum::<f64>().sqrt()
}

impl fmt::Display for SelectionCriterion {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            SelectionCriterion::Accuracy => "accuracy",
            SelectionCriterion::ActiveError => "active_error",
            SelectionCriterion::MeanSemiPrincipalAxis => "mean_semi_principal_axis",
            SelectionCriterion::FeatureEfficiency => "feature_efficiency",
            SelectionCriterion::Repeatability => "repeatability",
            SelectionCriterion::Separability => "separability",
        })
    }
}

impl FromStr for SelectionCriterion {
    type Err = EmgError;

    fn from_str(name: &str) -> Result<SelectionCriterion, EmgError> {
        let found = SelectionCriterion::ALL.into_iter().find(|criterion| criterion.to_string() == name);
        found.ok_or_else(|| EmgError::UnknownCriterion { name: name.to_owned() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::FeatureSet;
    use std::collections::BTreeMap;

    /// What LibEMG 2.0.3 makes of windows of three classes, from `tests/make_selection_vectors.py`.
    #[derive(serde::Deserialize)]
    struct Reference {
        features: String,
        channels: usize,
        windows: Vec<Vec<f64>>,
        labels: Vec<usize>,
        repetitions: Vec<u32>,
        /// Per criterion: names in their order and the values.
        order: BTreeMap<String, (Vec<String>, Vec<f64>)>,
    }

    #[test]
    fn orders_and_values_are_libemgs() {
        let reference: Reference = serde_json::from_str(include_str!("../tests/selection_vectors.json"))
            .expect("the vectors are JSON");
        let set: FeatureSet = reference.features.parse().expect("known");
        let data = SelectionData {
            windows: &reference.windows,
            layout: set.layout(reference.channels, 1000.0),
            labels: &reference.labels,
            repetitions: &reference.repetitions,
            rest: 2,
        };
        for criterion in SelectionCriterion::ALL {
            let got = select_features(&data, criterion, usize::MAX).expect("good data");
            let (names, values) = &reference.order[&criterion.to_string()];
            let got_names: Vec<&str> = got.iter().map(|f| f.feature.as_str()).collect();
            assert_eq!(
                got_names,
                names.iter().map(String::as_str).collect::<Vec<_>>(),
                "{criterion} {got:?} {values:?}"
            );
            for (got, expected) in got.iter().zip(values) {
                let error = (got.value - expected).abs() / expected.abs().max(1e-12);
                assert!(error < 1e-6, "{criterion} {got:?}, LibEMG {expected}");
            }
            assert_eq!(criterion.to_string().parse::<SelectionCriterion>(), Ok(criterion));
        }
        let one = SelectionData { labels: &vec![0; reference.labels.len()], ..data.clone() };
        assert!(select_features(&one, SelectionCriterion::Separability, 1).is_err());
        let short = SelectionData { labels: &[0], ..data };
        assert!(select_features(&short, SelectionCriterion::Accuracy, 1).is_err());
    }
}
