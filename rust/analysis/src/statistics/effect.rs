use super::{
    ConfidenceInterval, bootstrap_interval, mean,
    ranks::{TIE_TOLERANCE, max_abs},
    wilcoxon::{PairedDifferences, rank_biserial},
};
use serde::Serialize;
use statrs::distribution::{ContinuousCDF, Normal};

/// How large a paired difference is.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct PairedEffect {
    /// Mean of the differences, in the measure's unit.
    pub mean: f64,
    /// Its interval.
    pub mean_interval: Option<ConfidenceInterval>,
    /// Matched-pairs rank-biserial correlation, -1 to 1; none if nothing differs.
    pub rank_biserial: Option<f64>,
    /// Its interval.
    pub rank_biserial_interval: Option<ConfidenceInterval>,
    /// Mean over standard deviation of the differences, corrected for small samples (Hedges' g of paired values, Cohen's d_z times J);
    /// none if they do not spread.
    #[serde(rename = "g")]
    pub hedges_g: Option<f64>,
    /// Its interval.
    #[serde(rename = "g_interval")]
    pub hedges_g_interval: Option<ConfidenceInterval>,
}

impl PairedEffect {
    /// Of `differences`, with intervals drawn from `seed`; none without a difference.
    ///
    /// g presumes that differences are near normal; the rank-biserial correlation does not.
    pub fn of(differences: &[f64], seed: u64) -> Option<Self> {
        let tolerance = TIE_TOLERANCE * max_abs(differences.iter().copied());
        Self::of_differences(&PairedDifferences { values: differences.to_vec(), tolerance }, seed)
    }

    pub(super) fn of_differences(differences: &PairedDifferences, seed: u64) -> Option<Self> {
        let PairedDifferences { values: differences, tolerance } = differences;
        if differences.is_empty() || differences.iter().any(|d| !d.is_finite()) {
            return None;
        }
        let drawn = |indices: &[usize]| indices.iter().map(|index| differences[*index]).collect::<Vec<f64>>();
        let interval = |of: &dyn Fn(&[f64]) -> Option<f64>| {
            bootstrap_interval(differences.len(), seed, |indices| of(&drawn(indices)))
        };
        let ranked = |d: &[f64]| rank_biserial(d, *tolerance);
        let standardized = |d: &[f64]| hedges_g(d, *tolerance);
        Some(Self {
            mean: mean(differences),
            mean_interval: interval(&|d| Some(mean(d))),
            rank_biserial: ranked(differences),
            rank_biserial_interval: interval(&ranked),
            hedges_g: standardized(differences),
            hedges_g_interval: interval(&standardized),
        })
    }
}

/// None if differences spread by no more than `tolerance`, which is rounding.
fn hedges_g(differences: &[f64], tolerance: f64) -> Option<f64> {
    let n = differences.len() as f64;
    let middle = mean(differences);
    let squares: f64 = differences.iter().map(|d| (d - middle).powi(2)).sum();
    let sd = (squares / (n - 1.0)).sqrt();
    // Hedges 1981, with n - 1 degrees of freedom.
    let correction = 1.0 - 3.0 / (4.0 * (n - 1.0) - 1.0);
    (n > 1.0 && sd > tolerance).then(|| correction * middle / sd)
}

/// Skewness of `values` and the chance of one as far from zero in a normal sample (D'Agostino 1970); none of fewer than eight
/// values, or if they do not spread.
///
/// What speaks of the median by signed ranks presumes symmetric differences: this says whether they are.
pub fn skewness_test(values: &[f64]) -> Option<[f64; 2]> {
    let n = values.len() as f64;
    let middle = mean(values);
    let moment = |power: i32| values.iter().map(|v| (v - middle).powi(power)).sum::<f64>() / n;
    let spread = moment(2);
    if values.len() < 8 || !spread.is_finite() || spread <= (1e-12 * middle).powi(2) {
        return None;
    }
    let skewness = moment(3) / spread.powf(1.5);
    let y = skewness * ((n + 1.0) * (n + 3.0) / (6.0 * (n - 2.0))).sqrt();
    let beta = 3.0 * (n * n + 27.0 * n - 70.0) * (n + 1.0) * (n + 3.0)
        / ((n - 2.0) * (n + 5.0) * (n + 7.0) * (n + 9.0));
    let w2 = (2.0 * (beta - 1.0)).sqrt() - 1.0;
    let (delta, alpha) = (1.0 / (0.5 * w2.ln()).sqrt(), (2.0 / (w2 - 1.0)).sqrt());
    let z = delta * (y / alpha).asinh();
    Some([skewness, 2.0 * Normal::standard().sf(z.abs())])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_effect_by_hand() {
        // Mean 2, sd 1, J = 1 - 3 / 7 = 4/7; all ranks to one side.
        let effect = PairedEffect::of(&[1.0, 2.0, 3.0], 1).unwrap();
        assert!((effect.hedges_g.unwrap() - 8.0 / 7.0).abs() < 1e-12, "{effect:?}");
        assert_eq!(
            (effect.mean, effect.rank_biserial, effect.rank_biserial_interval),
            (2.0, Some(1.0), None)
        );
    }

    #[test]
    fn equal_differences_have_no_standardized_effect() {
        let effect = PairedEffect::of(&[0.3, 0.3, 0.3, 0.3], 1).unwrap();
        assert_eq!((effect.hedges_g, effect.mean_interval), (None, None));
        assert_eq!(PairedEffect::of(&[0.0; 4], 1).unwrap().rank_biserial, None);
        assert_eq!(PairedEffect::of(&[], 1), None);
        assert_eq!(PairedEffect::of(&[2.0], 1).unwrap().hedges_g, None);
        // Large values that all gain the same; rounding was taken for a spread, and g was 1e10.
        let gain = PairedDifferences::of(&[[1e6, 1e6 + 0.1], [2e6, 2e6 + 0.1], [3e6, 3e6 + 0.1]]);
        assert_eq!(PairedEffect::of_differences(&gain, 1).unwrap().hedges_g, None);
    }

    #[test]
    fn one_far_value_is_skewed() {
        let [skewness, p] = skewness_test(&[0.0, 0.1, -0.1, 0.2, -0.2, 0.0, 0.1, 9.0]).unwrap();
        assert!(skewness > 2.0 && p < 0.01, "{skewness} {p}");
        assert_eq!(skewness_test(&[1.0; 9]), None);
        assert_eq!(skewness_test(&[1.0, 2.0, 3.0]), None);
    }
}
