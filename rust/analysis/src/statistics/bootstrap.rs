use super::{BOOTSTRAP_RESAMPLES, CONFIDENCE};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::Serialize;
use statrs::distribution::{ContinuousCDF, Normal};

/// Draws that differ from the estimate by less than this share are equal to it.
const TIE_TOLERANCE: f64 = 1e-9;

/// Where a true value is, with a stated confidence.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ConfidenceInterval {
    /// Its lower end.
    pub low: f64,
    /// Its upper end.
    pub high: f64,
}

/// Interval of a statistic of `people`, 95 %, by drawing people again with replacement 10,000 times from `seed`; bias-corrected
/// and accelerated (Efron 1987).
///
/// `statistic` takes the places of the people drawn, some twice, and may have none. None without an estimate, with fewer than three
/// people, or where the draws do not differ. A bootstrap of fewer than some ten people is too narrow; say so beside it.
pub fn bootstrap_interval(
    people: usize,
    seed: u64,
    statistic: impl Fn(&[usize]) -> Option<f64>,
) -> Option<ConfidenceInterval> {
    if people < 3 {
        return None;
    }
    let everybody: Vec<usize> = (0..people).collect();
    let estimate = statistic(&everybody)?;
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut drawn = vec![0; people];
    let mut draws = Vec::with_capacity(BOOTSTRAP_RESAMPLES);
    for _ in 0..BOOTSTRAP_RESAMPLES {
        drawn.iter_mut().for_each(|index| *index = rng.random_range(0..people));
        draws.extend(statistic(&drawn));
    }
    let without = |gone: usize| everybody.iter().copied().filter(|index| *index != gone).collect::<Vec<_>>();
    let jackknife: Vec<f64> = (0..people).filter_map(|gone| statistic(&without(gone))).collect();
    bca_interval(estimate, &draws, &jackknife, CONFIDENCE)
}

/// The bias-corrected and accelerated interval of an estimate from its `draws` and from the values without one person each.
///
/// None where they do not differ, or one is not finite.
pub fn bca_interval(
    estimate: f64,
    draws: &[f64],
    jackknife: &[f64],
    confidence: f64,
) -> Option<ConfidenceInterval> {
    let mut draws = draws.to_vec();
    if draws.is_empty() || jackknife.is_empty() || draws.iter().chain(jackknife).any(|v| !v.is_finite()) {
        return None;
    }
    draws.sort_by(f64::total_cmp);
    let normal = Normal::standard();
    // The same people drawn in another order give the estimate itself, but for the last digits.
    let same = TIE_TOLERANCE * draws[0].abs().max(draws[draws.len() - 1].abs());
    let below = draws.partition_point(|draw| *draw < estimate - same) as f64;
    let up_to = draws.partition_point(|draw| *draw <= estimate + same) as f64;
    let bias = normal.inverse_cdf((below + up_to) / (2.0 * draws.len() as f64));
    let mean = super::mean(jackknife);
    let power = |exponent: i32| jackknife.iter().map(|value| (mean - value).powi(exponent)).sum::<f64>();
    let acceleration = power(3) / (6.0 * power(2).powf(1.5));
    if !bias.is_finite() || !acceleration.is_finite() {
        return None;
    }
    let end = |tail: f64| {
        let z = bias + normal.inverse_cdf(tail);
        quantile(&draws, normal.cdf(bias + z / (1.0 - acceleration * z)))
    };
    let tail = (1.0 - confidence) / 2.0;
    Some(ConfidenceInterval { low: end(tail), high: end(1.0 - tail) })
}

/// Between the two nearest of sorted values.
fn quantile(sorted: &[f64], share: f64) -> f64 {
    let index = share.clamp(0.0, 1.0) * (sorted.len() - 1) as f64;
    let (below, part) = (index.floor() as usize, index.fract());
    let above = sorted[(below + 1).min(sorted.len() - 1)];
    sorted[below] + part * (above - sorted[below])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_interval_of_a_mean_holds_it_and_hangs_on_the_seed() {
        let values: Vec<f64> = (0..30).map(f64::from).collect();
        let of = |drawn: &[usize]| {
            Some(drawn.iter().map(|index| values[*index]).sum::<f64>() / drawn.len() as f64)
        };
        let interval = bootstrap_interval(30, 7, of).unwrap();
        // Mean 14.5, standard error 8.655 / sqrt(30) = 1.58.
        assert!((interval.low - 11.4).abs() < 0.2 && (interval.high - 17.6).abs() < 0.2, "{interval:?}");
        assert_eq!(bootstrap_interval(30, 7, of), Some(interval));
        assert_ne!(bootstrap_interval(30, 8, of), Some(interval));
    }

    #[test]
    fn without_a_spread_there_is_no_interval() {
        assert_eq!(bootstrap_interval(8, 1, |_| Some(4.0)), None);
        assert_eq!(bootstrap_interval(8, 1, |_| None), None);
        assert_eq!(bootstrap_interval(2, 1, |drawn| Some(drawn[0] as f64)), None);
        assert_eq!(bca_interval(1.0, &[1.0, f64::NAN], &[1.0, 2.0], 0.95), None);
    }
}
