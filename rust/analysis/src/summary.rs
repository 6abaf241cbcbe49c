//! A sample in a few figures.

use serde::Serialize;
use statrs::statistics::{Data, Distribution, Max, Min, OrderStatistics};

/// What a sample comes to.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct SampleSummary {
    /// Arithmetic mean.
    pub mean: f64,
    /// Standard deviation of the sample, by n - 1; none of a single value.
    pub sd: Option<f64>,
    /// Smallest value.
    pub min: f64,
    /// Largest value.
    pub max: f64,
    /// Median: the middle one, or the mean of the two in the middle.
    pub median: f64,
    /// How many values.
    #[serde(rename = "trials")]
    pub count: usize,
}

impl SampleSummary {
    /// Of these values; none of none, or where one is not finite.
    pub fn of(values: &[f64]) -> Option<Self> {
        if values.is_empty() || values.iter().any(|value| !value.is_finite()) {
            return None;
        }
        let mut data = Data::new(values.to_vec());
        Some(Self {
            mean: data.mean()?,
            sd: data.std_dev().filter(|_| values.len() > 1),
            min: data.min(),
            max: data.max(),
            median: data.median(),
            count: values.len(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sample_is_summed_up_and_a_broken_one_is_not() {
        let summary = SampleSummary::of(&[4.0, 1.0, 3.0, 2.0]).unwrap();
        assert_eq!(
            (summary.mean, summary.min, summary.max, summary.median, summary.count),
            (2.5, 1.0, 4.0, 2.5, 4)
        );
        // By hand: squares of 1.5, 0.5, 0.5, 1.5 are 5 together, over n - 1 = 3.
        assert!((summary.sd.unwrap() - (5.0_f64 / 3.0).sqrt()).abs() < 1e-12);
        assert_eq!(SampleSummary::of(&[7.0]).unwrap().sd, None);
        assert_eq!(SampleSummary::of(&[]), None);
        assert_eq!(SampleSummary::of(&[1.0, f64::NAN]), None);
    }
}
