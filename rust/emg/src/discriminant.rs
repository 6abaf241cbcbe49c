//! What tells the classes of feature vectors apart: one type for each [`ClassifierKind`], behind [`Discriminant`].

mod external;
mod k_nearest_neighbors;
mod muscle_sites;
mod naive_bayes;
mod quadratic_discriminant;
mod random_forest;
mod regressor;
mod sigmoid;
mod support_vector_machine;

use crate::lda::softmax;
use crate::{EmgConfig, EmgError, Lda};
use nalgebra::DMatrix;
use proact_types::{Drives, Gesture};
use serde::{Deserialize, Serialize};
use std::{fmt, str::FromStr};

pub(crate) use external::ExternalDiscriminant;
pub(crate) use k_nearest_neighbors::KNearestNeighbors;
pub use muscle_sites::MuscleSite;
pub(crate) use muscle_sites::MuscleSites;
pub(crate) use naive_bayes::NaiveBayes;
pub(crate) use quadratic_discriminant::QuadraticDiscriminant;
pub(crate) use random_forest::RandomForest;
pub(crate) use regressor::Regressor;
pub(crate) use support_vector_machine::SupportVectorMachine;

/// How windows are told apart. The names are LibEMG's, in small letters; the definitions are scikit-learn's with its
/// default options, with one exception: features are standardised for `svm` and `knn`, which depend on their scale.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ClassifierKind {
    /// Linear discriminant analysis: the default, and the only one that adaptation can follow a user with.
    #[default]
    Lda,
    /// Quadratic discriminant analysis: a covariance for each class. It needs more windows a class than features, and
    /// features that vary in every class.
    Qda,
    /// Gaussian naive Bayes: a mean and a variance for each class and feature, features taken as independent.
    Nb,
    /// The five nearest windows of the training vote; of two that are equally near the earlier counts.
    Knn,
    /// Support vectors with a linear kernel, C = 1, one class against one; probabilities by Platt's sigmoid on windows that
    /// were left out, and pairwise coupling. The most probable class is recognised.
    Svm,
    /// A forest of 100 trees, each grown on a draw of the windows and looking at the root of the number of features at each
    /// node. Draws have a fixed seed, so that the same windows give the same forest.
    Rf,
    /// Linear regression: no classes but degrees of freedom, driven in proportion and at the same time
    /// ([`crate::RegressionConfig`]); features are standardised.
    Linear,
    /// The same with a penalty on the squared coefficients.
    Ridge,
    /// Direct control: the mean absolute value of one channel for each of two gestures, and switching by co-contraction
    /// ([`crate::TwoSiteConfig`]).
    TwoSite,
    /// A process of any language that tells gestures apart ([`crate::DecoderProcessConfig`]).
    Process,
    /// A process of any language that drives degrees of freedom.
    ProcessRegressor,
}

impl ClassifierKind {
    /// All of them, in the order in which they are listed.
    pub const ALL: [ClassifierKind; 11] = {
        use ClassifierKind::*;
        [Lda, Qda, Nb, Knn, Svm, Rf, Linear, Ridge, TwoSite, Process, ProcessRegressor]
    };

    /// Whether it drives degrees of freedom in the place of telling gestures apart.
    pub fn is_regression(self) -> bool {
        matches!(self, ClassifierKind::Linear | ClassifierKind::Ridge | ClassifierKind::ProcessRegressor)
    }

    /// Whether another process decides.
    pub fn is_process(self) -> bool {
        matches!(self, ClassifierKind::Process | ClassifierKind::ProcessRegressor)
    }

    /// Whether it tells how probable a gesture is.
    pub fn has_posterior(self) -> bool {
        !self.is_regression() && self != ClassifierKind::TwoSite
    }

    pub(crate) fn is_lda(&self) -> bool {
        *self == ClassifierKind::Lda
    }
}

impl fmt::Display for ClassifierKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            ClassifierKind::Lda => "lda",
            ClassifierKind::Qda => "qda",
            ClassifierKind::Nb => "nb",
            ClassifierKind::Knn => "knn",
            ClassifierKind::Svm => "svm",
            ClassifierKind::Rf => "rf",
            ClassifierKind::Linear => "linear",
            ClassifierKind::Ridge => "ridge",
            ClassifierKind::TwoSite => "two_site",
            ClassifierKind::Process => "process",
            ClassifierKind::ProcessRegressor => "process_regressor",
        })
    }
}

impl FromStr for ClassifierKind {
    type Err = EmgError;

    fn from_str(name: &str) -> Result<ClassifierKind, EmgError> {
        let of = |kind: &ClassifierKind| kind.to_string().eq_ignore_ascii_case(name);
        let found = ClassifierKind::ALL.into_iter().find(of);
        found.ok_or_else(|| EmgError::UnknownClassifier { name: name.to_owned() })
    }
}

/// A trained one of any kind. In a model file it is a key of its own, `lda` and so on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Discriminant {
    Lda(Lda),
    Qda(QuadraticDiscriminant),
    Nb(NaiveBayes),
    Knn(KNearestNeighbors),
    Svm(SupportVectorMachine),
    Rf(RandomForest),
    Linear(Regressor),
    Ridge(Regressor),
    TwoSite(MuscleSites),
    Process(ExternalDiscriminant),
}

/// What a discriminant learns from: `[windows][features]` and the class of each window.
pub(crate) struct TrainingSet<'a> {
    pub(crate) samples: &'a DMatrix<f64>,
    pub(crate) labels: &'a [usize],
    pub(crate) classes: usize,
    /// The gesture of each class.
    pub(crate) gestures: &'a [Gesture],
}

impl TrainingSet<'_> {
    /// Places of the windows of a class.
    fn of_class(&self, class: usize) -> impl Iterator<Item = usize> {
        self.labels.iter().enumerate().filter(move |(_, label)| **label == class).map(|(index, _)| index)
    }

    /// Mean of each feature and its population standard deviation; one where a feature is constant.
    fn mean_and_sd(&self) -> (Vec<f64>, Vec<f64>) {
        let count = self.samples.nrows() as f64;
        let column = |c: nalgebra::DVectorView<'_, f64>| {
            let mean = c.sum() / count;
            let spread = (c.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / count).sqrt();
            (mean, if spread > 0.0 { spread } else { 1.0 })
        };
        self.samples.column_iter().map(|c| column(c.as_view())).unzip()
    }

    /// The windows with mean 0 and deviation 1 of each feature, one after the other.
    fn standardized(&self, mean: &[f64], spread: &[f64]) -> Vec<f64> {
        let row = |row: usize| {
            (0..self.samples.ncols()).map(move |j| (self.samples[(row, j)] - mean[j]) / spread[j])
        };
        (0..self.samples.nrows()).flat_map(row).collect()
    }
}

impl Discriminant {
    /// # Errors
    /// Data that cannot be learnt from: too few windows, nothing that varies, values that are not finite.
    pub(crate) fn fit(config: &EmgConfig, set: &TrainingSet<'_>) -> Result<Discriminant, EmgError> {
        // A co-contraction is a class without windows, which the others refuse.
        let counts = match config.classifier {
            ClassifierKind::TwoSite => Vec::new(),
            _ => crate::lda::check(set.samples, set.labels, set.classes)?,
        };
        let priors = config.priors.class_priors(&counts);
        let regress = |alpha| Regressor::fit(set, &config.regression, config.rest, alpha);
        Ok(match config.classifier {
            ClassifierKind::Lda => Discriminant::Lda(Lda::fit_with_priors(
                set.samples,
                set.labels,
                set.classes,
                config.covariance_normalization,
                config.priors,
            )?),
            ClassifierKind::Qda => {
                Discriminant::Qda(QuadraticDiscriminant::fit(set, &priors, config.covariance_normalization)?)
            }
            ClassifierKind::Nb => Discriminant::Nb(NaiveBayes::fit(set, &priors)?),
            ClassifierKind::Knn => Discriminant::Knn(KNearestNeighbors::fit(set)),
            ClassifierKind::Svm => Discriminant::Svm(SupportVectorMachine::fit(set)?),
            ClassifierKind::Rf => Discriminant::Rf(RandomForest::fit(set)),
            ClassifierKind::Linear => Discriminant::Linear(regress(0.0)?),
            ClassifierKind::Ridge => Discriminant::Ridge(regress(config.regression.ridge_alpha)?),
            ClassifierKind::TwoSite => Discriminant::TwoSite(MuscleSites::fit(set, config)?),
            ClassifierKind::Process | ClassifierKind::ProcessRegressor => {
                return Err(EmgError::NeedsProcess { what: "train" });
            }
        })
    }

    pub(crate) fn kind(&self) -> ClassifierKind {
        match self {
            Discriminant::Lda(_) => ClassifierKind::Lda,
            Discriminant::Qda(_) => ClassifierKind::Qda,
            Discriminant::Nb(_) => ClassifierKind::Nb,
            Discriminant::Knn(_) => ClassifierKind::Knn,
            Discriminant::Svm(_) => ClassifierKind::Svm,
            Discriminant::Rf(_) => ClassifierKind::Rf,
            Discriminant::Linear(_) => ClassifierKind::Linear,
            Discriminant::Ridge(_) => ClassifierKind::Ridge,
            Discriminant::TwoSite(_) => ClassifierKind::TwoSite,
            Discriminant::Process(d) if d.is_regressor() => ClassifierKind::ProcessRegressor,
            Discriminant::Process(_) => ClassifierKind::Process,
        }
    }

    pub(crate) fn classes(&self) -> usize {
        match self {
            Discriminant::Lda(d) => d.classes(),
            Discriminant::Qda(d) => d.classes(),
            Discriminant::Nb(d) => d.classes(),
            Discriminant::Knn(d) => d.classes(),
            Discriminant::Svm(d) => d.classes(),
            Discriminant::Rf(d) => d.classes(),
            Discriminant::Linear(d) | Discriminant::Ridge(d) => d.classes(),
            Discriminant::TwoSite(d) => d.classes(),
            Discriminant::Process(d) => d.classes(),
        }
    }

    pub(crate) fn features(&self) -> usize {
        match self {
            Discriminant::Lda(d) => d.features(),
            Discriminant::Qda(d) => d.features(),
            Discriminant::Nb(d) => d.features(),
            Discriminant::Knn(d) => d.features(),
            Discriminant::Svm(d) => d.features(),
            Discriminant::Rf(d) => d.features(),
            Discriminant::Linear(d) | Discriminant::Ridge(d) => d.features(),
            Discriminant::TwoSite(d) => d.features(),
            Discriminant::Process(d) => d.features(),
        }
    }

    /// Whether all lengths fit and every value is finite, as after reading a file.
    pub(crate) fn is_sound(&self) -> bool {
        match self {
            Discriminant::Lda(d) => d.is_sound(),
            Discriminant::Qda(d) => d.is_sound(),
            Discriminant::Nb(d) => d.is_sound(),
            Discriminant::Knn(d) => d.is_sound(),
            Discriminant::Svm(d) => d.is_sound(),
            Discriminant::Rf(d) => d.is_sound(),
            Discriminant::Linear(d) | Discriminant::Ridge(d) => d.is_sound(),
            Discriminant::TwoSite(d) => d.is_sound(),
            Discriminant::Process(d) => d.is_sound(),
        }
    }

    /// The same one for features in another order, which `order` gives a vector.
    pub(crate) fn map_features(&self, order: &dyn Fn(&[f64]) -> Vec<f64>) -> Result<Discriminant, EmgError> {
        Ok(match self {
            Discriminant::Lda(d) => Discriminant::Lda(d.map_features(order)?),
            Discriminant::Qda(d) => Discriminant::Qda(d.map_features(order)),
            Discriminant::Nb(d) => Discriminant::Nb(d.map_features(order)),
            Discriminant::Knn(d) => Discriminant::Knn(d.map_features(order)),
            Discriminant::Svm(d) => Discriminant::Svm(d.map_features(order)),
            Discriminant::Rf(d) => Discriminant::Rf(d.map_features(order)),
            Discriminant::Linear(d) => Discriminant::Linear(d.map_features(order)),
            Discriminant::Ridge(d) => Discriminant::Ridge(d.map_features(order)),
            Discriminant::TwoSite(d) => Discriminant::TwoSite(d.map_features(order)),
            // It may know the channels by their places.
            Discriminant::Process(_) => return Err(EmgError::NeedsProcess { what: "turn" }),
        })
    }

    /// Writes one score a class to `out`; the class of the largest is recognised, the first of equals.
    pub(crate) fn scores(&self, features: &[f64], out: &mut [f64]) {
        match self {
            Discriminant::Lda(d) => d.decide(features, out),
            Discriminant::Qda(d) => d.scores(features, out),
            Discriminant::Nb(d) => d.scores(features, out),
            Discriminant::Knn(d) => d.scores(features, out),
            Discriminant::Svm(d) => d.scores(features, out),
            Discriminant::Rf(d) => d.scores(features, out),
            Discriminant::Linear(d) | Discriminant::Ridge(d) => d.scores(features, out),
            Discriminant::TwoSite(d) => d.scores(features, out),
            // Nothing that can be known here: the caller asks the process.
            Discriminant::Process(_) => out.fill(f64::NAN),
        }
    }

    /// Makes probabilities of scores, in place.
    pub(crate) fn posterior(&self, scores: &mut [f64]) {
        match self {
            Discriminant::Lda(_) | Discriminant::Qda(_) | Discriminant::Nb(_) => softmax(scores),
            // Theirs are probabilities.
            Discriminant::Knn(_) | Discriminant::Svm(_) | Discriminant::Rf(_) => {}
            // Nor has this one anything but yes and no.
            Discriminant::TwoSite(_) | Discriminant::Process(_) => {}
            Discriminant::Linear(_) | Discriminant::Ridge(_) => Regressor::posterior(scores),
        }
    }

    /// The sites of direct control; none of another kind.
    pub(crate) fn sites(&self) -> Option<&MuscleSites> {
        if let Discriminant::TwoSite(d) = self { Some(d) } else { None }
    }

    /// What is known of a decoder in another process; none of another kind.
    pub(crate) fn external(&self) -> Option<&ExternalDiscriminant> {
        if let Discriminant::Process(d) = self { Some(d) } else { None }
    }

    /// What drives degrees of freedom; none of a classifier.
    pub(crate) fn regressor(&self) -> Option<&Regressor> {
        if let Discriminant::Linear(d) | Discriminant::Ridge(d) = self { Some(d) } else { None }
    }

    /// The same to be changed.
    pub(crate) fn regressor_mut(&mut self) -> Option<&mut Regressor> {
        if let Discriminant::Linear(d) | Discriminant::Ridge(d) = self { Some(d) } else { None }
    }

    /// Each drive before the dead band, -1 to 1, NaN where it overflows; empty of a classifier.
    pub(crate) fn drives(&self, features: &[f64]) -> Drives {
        self.regressor().map(|regressor| regressor.predict(features)).unwrap_or_default()
    }
}

#[cfg(test)]
mod tests;
