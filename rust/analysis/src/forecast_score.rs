use crate::{AnalysisError, Episode, RELIABILITY_BINS, brier, forecast::credit, log_loss, top_choice};
use serde::{Deserialize, Serialize};

/// How good forecasts are. Means are over time within an episode, then over episodes: each episode weighs the
/// same, however long it was.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ForecastScore {
    /// Number of episodes.
    pub episodes: usize,
    /// Number of forecasts in them.
    pub forecasts: usize,
    /// Mean logarithmic loss, nats; lower is better.
    pub log_loss: f64,
    /// Mean Brier score, 0 to 2; lower is better.
    pub brier: f64,
    /// Share of forecasts whose top choice is the truth; a shared top earns its share.
    pub accuracy: f64,
    /// Expected calibration error: mean distance between confidence and accuracy over the bins, weighted by what is
    /// in them (Naeini et al., AAAI 2015). Confidence is the probability of the top choice.
    pub expected_calibration_error: f64,
    /// Confidence against accuracy, in bins of equal width; empty ones included.
    pub reliability: Vec<ReliabilityBin>,
    /// From the start of an episode until the top choice is the truth for good.
    pub time_to_correct_ms: Quartiles,
    /// Episodes that ended with another top choice than the truth.
    pub never_correct: usize,
    /// Changes of the top choice, per episode.
    pub flips_per_episode: f64,
}

/// Forecasts of similar confidence.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ReliabilityBin {
    /// Smallest confidence.
    #[serde(rename = "from")]
    pub min_confidence: f64,
    /// Largest confidence; belongs to the next bin, except one.
    #[serde(rename = "to")]
    pub max_confidence: f64,
    /// Number of forecasts.
    pub forecasts: usize,
    /// Their share of all, with each episode weighing the same.
    #[serde(rename = "share")]
    pub weight: f64,
    /// Their mean confidence; zero if the bin is empty.
    pub confidence: f64,
    /// Their accuracy; zero if the bin is empty.
    pub accuracy: f64,
}

/// Quartiles of what could be measured; none if nothing could. Between two values, linear.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Quartiles {
    /// A quarter is below.
    pub lower: Option<f64>,
    /// Half is below.
    pub median: Option<f64>,
    /// Three quarters are below.
    pub upper: Option<f64>,
}

impl Quartiles {
    /// Of `values` in any order, which must not hold NaN.
    pub fn of(mut values: Vec<f64>) -> Self {
        values.sort_by(f64::total_cmp);
        // Type 7 of Hyndman and Fan, American Statistician 50, 1996: the default of R and NumPy.
        let at = |share: f64| {
            let index = share * (values.len().checked_sub(1)?) as f64;
            let below = index.floor() as usize;
            let above = index.ceil() as usize;
            Some(values[below] + (values[above] - values[below]) * (index - below as f64))
        };
        Self { lower: at(0.25), median: at(0.5), upper: at(0.75) }
    }
}

/// Scores the forecasts of `episodes`.
///
/// # Errors
/// [`AnalysisError`] if there are no episodes, or one has no forecasts, forecasts that are no probabilities, a truth
/// outside them, or times that do not ascend.
pub fn score_forecasts(episodes: &[Episode]) -> Result<ForecastScore, AnalysisError> {
    if episodes.is_empty() {
        return Err(AnalysisError::Empty { what: "episode".to_owned() });
    }
    for (number, episode) in episodes.iter().enumerate() {
        episode.check(number)?;
    }

    // Multiplied, not divided by a width: 0.6 belongs to the bin from 0.6, and 0.6 / 0.1 is below 6.
    let count = RELIABILITY_BINS as f64;
    let mut bins: Vec<ReliabilityBin> = (0..RELIABILITY_BINS)
        .map(|k| ReliabilityBin {
            min_confidence: k as f64 / count,
            max_confidence: (k + 1) as f64 / count,
            ..Default::default()
        })
        .collect();
    let (mut loss, mut squares, mut accuracy, mut forecasts) = (0.0, 0.0, 0.0, 0);
    for episode in episodes {
        // The weight of one forecast: all weights sum to one.
        let weight = 1.0 / (episodes.len() * episode.forecasts.len()) as f64;
        for forecast in &episode.forecasts {
            let p = &forecast.probabilities;
            let right = credit(p, episode.truth);
            loss += weight * log_loss(p, episode.truth);
            squares += weight * brier(p, episode.truth);
            accuracy += weight * right;
            forecasts += 1;
            let confidence = p.iter().copied().fold(0.0, f64::max);
            let bin = &mut bins[((confidence * count) as usize).min(RELIABILITY_BINS - 1)];
            bin.forecasts += 1;
            bin.weight += weight;
            bin.confidence += weight * confidence;
            bin.accuracy += weight * right;
        }
    }
    let error = bins.iter().map(|bin| (bin.accuracy - bin.confidence).abs()).sum();
    for bin in bins.iter_mut().filter(|bin| bin.forecasts > 0) {
        bin.confidence /= bin.weight;
        bin.accuracy /= bin.weight;
    }

    let times: Vec<f64> =
        episodes.iter().filter_map(|e| e.time_to_correct_ms()).map(|millis| millis as f64).collect();
    let flips: usize = episodes.iter().map(Episode::flips).sum();
    let wrong_at_the_end =
        |e: &&Episode| e.forecasts.last().is_none_or(|last| top_choice(&last.probabilities) != Some(e.truth));
    Ok(ForecastScore {
        episodes: episodes.len(),
        forecasts,
        log_loss: loss,
        brier: squares,
        accuracy,
        expected_calibration_error: error,
        reliability: bins,
        never_correct: episodes.iter().filter(wrong_at_the_end).count(),
        time_to_correct_ms: Quartiles::of(times),
        flips_per_episode: flips as f64 / episodes.len() as f64,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Forecast;
    use proact_types::SimTime;
    use proptest::prelude::*;

    fn episode(truth: usize, forecasts: &[(u64, [f64; 2])]) -> Episode {
        let forecasts = forecasts
            .iter()
            .map(|(t, p)| Forecast { time: SimTime(*t), probabilities: p.to_vec() })
            .collect();
        Episode { start: SimTime(0), truth, forecasts }
    }

    #[test]
    fn every_number_agrees_with_one_computed_by_hand() {
        // A long episode, right three times of four, and a short one that is wrong.
        let long = episode(0, &[(10, [0.9, 0.1]), (20, [0.8, 0.2]), (30, [0.4, 0.6]), (40, [0.9, 0.1])]);
        let short = episode(1, &[(5, [0.75, 0.25])]);
        let s = score_forecasts(&[long, short]).expect("well formed");
        assert_eq!((s.episodes, s.forecasts, s.never_correct), (2, 5, 1));
        let close = |got: f64, expected: f64, what: &str| {
            assert!((got - expected).abs() < 1e-6, "{what}: {got}, expected {expected}");
        };
        // (0.105361 + 0.223144 + 0.916291 + 0.105361) / 4 = 0.337539; -ln 0.25 = 1.386294; the mean of both.
        close(s.log_loss, 0.861_917, "log loss");
        // (0.02 + 0.08 + 0.72 + 0.02) / 4 = 0.21; 2 * 0.75^2 = 1.125.
        close(s.brier, 0.667_5, "Brier");
        close(s.accuracy, (0.75 + 0.0) / 2.0, "accuracy");
        // Bins: 0.9 twice, right: 0.25 of the weight, off by 0.1; 0.8 once, right: 0.125, off by 0.2; 0.75 once,
        // wrong: 0.5, off by 0.75; 0.6 once, wrong: 0.125, off by 0.6.
        close(s.expected_calibration_error, 0.025 + 0.025 + 0.375 + 0.075, "calibration");
        let counts: Vec<usize> = s.reliability.iter().map(|b| b.forecasts).collect();
        assert_eq!(counts, [0, 0, 0, 0, 0, 0, 1, 1, 1, 2]);
        let last = s.reliability[9];
        close(last.confidence, 0.9, "mean confidence of the last bin");
        close(last.accuracy, 1.0, "accuracy of the last bin");
        close(last.weight, 0.25, "share of the last bin");
        assert_eq!(s.time_to_correct_ms.median, Some(40.0), "of the long one alone");
        close(s.flips_per_episode, 1.0, "flips: 0 1 0, and none");
    }

    #[test]
    fn certainty_belongs_to_the_last_bin_and_a_perfect_forecast_has_no_error() {
        let s = score_forecasts(&[episode(1, &[(0, [0.0, 1.0])])]).expect("well formed");
        assert_eq!((s.log_loss, s.brier, s.accuracy, s.expected_calibration_error), (0.0, 0.0, 1.0, 0.0));
        assert_eq!(s.reliability[RELIABILITY_BINS - 1].forecasts, 1);
    }

    #[test]
    fn quartiles_agree_with_those_of_numpy() {
        // numpy.quantile([1, 2, 4, 8], [0.25, 0.5, 0.75]) gives 1.75, 3, 5.
        let q = Quartiles::of(vec![8.0, 1.0, 4.0, 2.0]);
        assert_eq!((q.lower, q.median, q.upper), (Some(1.75), Some(3.0), Some(5.0)));
        assert_eq!(Quartiles::of(vec![7.0]).median, Some(7.0));
        assert_eq!(Quartiles::of(vec![]), Quartiles::default());
    }

    #[test]
    fn without_episodes_there_is_no_score() {
        assert!(matches!(score_forecasts(&[]), Err(AnalysisError::Empty { .. })));
        assert!(score_forecasts(&[episode(0, &[(0, [0.5, 0.5])]), episode(0, &[])]).is_err());
    }

    proptest! {
        #[test]
        fn scores_stay_in_their_ranges_and_repeating_an_episode_changes_no_mean(
            truth in 0_usize..2,
            shares in prop::collection::vec(0.0..=1.0, 1..30),
        ) {
            let forecasts: Vec<(u64, [f64; 2])> =
                shares.iter().enumerate().map(|(k, p)| (k as u64, [*p, 1.0 - p])).collect();
            let one = episode(truth, &forecasts);
            let s = score_forecasts(std::slice::from_ref(&one)).expect("well formed");
            prop_assert!((0.0..=13.9).contains(&s.log_loss) && (0.0..=2.0 + 1e-9).contains(&s.brier));
            prop_assert!((0.0..=1.0 + 1e-9).contains(&s.accuracy));
            prop_assert!((0.0..=1.0 + 1e-9).contains(&s.expected_calibration_error));
            let total: f64 = s.reliability.iter().map(|b| b.weight).sum();
            prop_assert!((total - 1.0).abs() < 1e-9);
            let twice = score_forecasts(&[one.clone(), one]).expect("well formed");
            prop_assert!((s.log_loss - twice.log_loss).abs() < 1e-9);
            prop_assert!((s.expected_calibration_error - twice.expected_calibration_error).abs() < 1e-9);
        }
    }
}
