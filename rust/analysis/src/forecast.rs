use crate::PROBABILITY_FLOOR;
use proact_types::SimTime;
use serde::{Deserialize, Serialize};

/// Sums of a few probabilities may differ from one by this much.
const SUM_TOLERANCE: f64 = 1e-6;

/// Why there is no score.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum AnalysisError {
    /// There is nothing to score.
    #[error("{what}: there is none, at least one is needed")]
    Empty {
        /// What is missing.
        what: String,
    },
    /// The truth is not among the alternatives.
    #[error("episode {episode}: the truth is alternative {truth}, the forecasts have {alternatives} (0 to {})", alternatives.saturating_sub(1))]
    Truth {
        /// Which episode, from zero.
        episode: usize,
        /// The truth.
        truth: usize,
        /// Number of alternatives.
        alternatives: usize,
    },
    /// The numbers are no probabilities.
    #[error("episode {episode}, forecast {forecast}: {got:?}, expected numbers from 0 to 1 that sum to 1")]
    Probabilities {
        /// Which episode, from zero.
        episode: usize,
        /// Which forecast of the episode, from zero.
        forecast: usize,
        /// What was given.
        got: Vec<f64>,
    },
    /// The forecasts are not in the order of time, or begin before the episode.
    #[error(
        "episode {episode}, forecast {forecast}: time {} ms stands after {} ms; forecasts must ascend from the \
         start of their episode", got.0, before.0
    )]
    Order {
        /// Which episode, from zero.
        episode: usize,
        /// Which forecast of the episode, from zero.
        forecast: usize,
        /// Its time.
        got: SimTime,
        /// The time before.
        before: SimTime,
    },
}

/// Probabilities of the alternatives at one instant.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Forecast {
    /// When.
    pub time: SimTime,
    /// One per alternative; they sum to one.
    pub probabilities: Vec<f64>,
}

/// A stretch of time with one truth, such as the picking of one block.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Episode {
    /// When it began.
    pub start: SimTime,
    /// The alternative that came true.
    pub truth: usize,
    /// In the order of time.
    pub forecasts: Vec<Forecast>,
}

impl Episode {
    /// Checks that everything is as it should be; `number` names the episode in errors.
    pub(crate) fn check(&self, number: usize) -> Result<(), AnalysisError> {
        if self.forecasts.is_empty() {
            return Err(AnalysisError::Empty { what: format!("forecast of episode {number}") });
        }
        let mut before = self.start;
        for (k, forecast) in self.forecasts.iter().enumerate() {
            let Forecast { time, probabilities } = forecast;
            let sum: f64 = probabilities.iter().sum();
            let within = probabilities.iter().all(|p| (0.0..=1.0 + SUM_TOLERANCE).contains(p));
            if !within || (sum - 1.0).abs() > SUM_TOLERANCE {
                return Err(AnalysisError::Probabilities {
                    episode: number,
                    forecast: k,
                    got: probabilities.clone(),
                });
            }
            if self.truth >= probabilities.len() {
                let alternatives = probabilities.len();
                return Err(AnalysisError::Truth { episode: number, truth: self.truth, alternatives });
            }
            if *time < before {
                return Err(AnalysisError::Order { episode: number, forecast: k, got: *time, before });
            }
            before = *time;
        }
        Ok(())
    }

    /// Milliseconds from the start until the truth becomes the top choice and stays it to the end; none if the last
    /// top choice is not the truth.
    pub fn time_to_correct_ms(&self) -> Option<u64> {
        let right = |f: &&Forecast| top_choice(&f.probabilities) == Some(self.truth);
        let since = self.forecasts.iter().rev().take_while(right).last()?;
        Some(since.time.millis_since(self.start))
    }

    /// How often the top choice changed from one alternative to another. Ties in between do not count.
    pub fn flips(&self) -> usize {
        let choices: Vec<usize> =
            self.forecasts.iter().filter_map(|f| top_choice(&f.probabilities)).collect();
        choices.windows(2).filter(|pair| pair[0] != pair[1]).count()
    }
}

/// The alternative with the highest probability; none if several share it.
pub fn top_choice(probabilities: &[f64]) -> Option<usize> {
    let best = probabilities.iter().copied().reduce(f64::max)?;
    let mut at = (0..probabilities.len()).filter(|&k| probabilities[k] == best);
    let first = at.next();
    first.filter(|_| at.next().is_none())
}

/// Share of the credit for the truth: one if it is the top choice, 1/n if it is one of n that share the top.
pub(crate) fn credit(probabilities: &[f64], truth: usize) -> f64 {
    let best = probabilities.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let sharing = probabilities.iter().filter(|p| **p == best).count();
    if probabilities.get(truth) == Some(&best) { 1.0 / sharing as f64 } else { 0.0 }
}

/// Logarithmic loss, -ln p(truth), with p at least [`PROBABILITY_FLOOR`]. Zero is perfect; ln n is guessing among
/// n. A truth outside the alternatives has probability zero.
pub fn log_loss(probabilities: &[f64], truth: usize) -> f64 {
    -probabilities.get(truth).copied().unwrap_or(0.0).max(PROBABILITY_FLOOR).ln()
}

/// Brier score over all alternatives, sum of (p - outcome)^2 (Brier, Monthly Weather Review 78, 1950, eq. 2, for one
/// forecast). Zero is perfect, two is certain and wrong.
pub fn brier(probabilities: &[f64], truth: usize) -> f64 {
    let outcome = |k| if k == truth { 1.0 } else { 0.0 };
    probabilities.iter().enumerate().map(|(k, p)| (p - outcome(k)).powi(2)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn episode(truth: usize, forecasts: &[(u64, [f64; 3])]) -> Episode {
        let forecasts = forecasts
            .iter()
            .map(|(t, p)| Forecast { time: SimTime(*t), probabilities: p.to_vec() })
            .collect();
        Episode { start: SimTime(100), truth, forecasts }
    }

    #[test]
    fn losses_agree_with_numbers_computed_by_hand() {
        let p = [0.7, 0.2, 0.1];
        assert!((log_loss(&p, 0) - 0.356_675).abs() < 1e-6, "-ln 0.7");
        assert!((log_loss(&p, 2) - std::f64::consts::LN_10).abs() < 1e-12, "-ln 0.1");
        assert!((log_loss(&[1.0, 0.0, 0.0], 1) - 13.815_511).abs() < 1e-6, "-ln of the floor");
        assert_eq!(log_loss(&[1.0, 0.0, 0.0], 0), 0.0);
        assert!((brier(&p, 0) - 0.14).abs() < 1e-12, "0.09 + 0.04 + 0.01");
        assert!((brier(&p, 2) - 1.34).abs() < 1e-12, "0.49 + 0.04 + 0.81");
        assert_eq!(brier(&[0.0, 1.0, 0.0], 0), 2.0);
    }

    #[test]
    fn a_shared_top_is_no_choice_and_shares_the_credit() {
        assert_eq!(top_choice(&[0.2, 0.5, 0.3]), Some(1));
        assert_eq!(top_choice(&[0.4, 0.4, 0.2]), None);
        assert_eq!(top_choice(&[]), None);
        assert_eq!(credit(&[0.4, 0.4, 0.2], 1), 0.5);
        assert_eq!(credit(&[0.4, 0.4, 0.2], 2), 0.0);
        assert_eq!(credit(&[0.25; 4], 3), 0.25);
    }

    #[test]
    fn time_to_correct_counts_from_the_start_to_the_last_change_to_the_truth() {
        let (a, b, tie) = ([0.8, 0.1, 0.1], [0.1, 0.8, 0.1], [0.45, 0.45, 0.1]);
        let run = episode(0, &[(110, b), (120, a), (130, b), (140, tie), (150, a), (160, a)]);
        assert_eq!(run.time_to_correct_ms(), Some(50), "for good from 150 ms on, and it began at 100");
        assert_eq!(run.flips(), 3, "b a b (tie) a a");
        assert_eq!(episode(0, &[(110, a), (120, b)]).time_to_correct_ms(), None);
        assert_eq!(episode(0, &[(110, a), (120, tie)]).time_to_correct_ms(), None);
        assert_eq!(episode(0, &[(100, a)]).time_to_correct_ms(), Some(0));
    }

    #[test]
    fn what_is_no_forecast_is_refused_with_its_place() {
        let good = [0.5, 0.25, 0.25];
        assert_eq!(episode(2, &[(100, good), (100, good)]).check(0), Ok(()));
        assert!(matches!(episode(0, &[]).check(4), Err(AnalysisError::Empty { .. })));
        for bad in [[0.5, 0.5, 0.5], [f64::NAN, 0.5, 0.5], [1.5, -0.5, 0.0]] {
            let error = episode(0, &[(100, good), (120, bad)]).check(4).expect_err("no probabilities");
            assert!(matches!(error, AnalysisError::Probabilities { episode: 4, forecast: 1, .. }), "{error}");
        }
        let error = episode(3, &[(100, good)]).check(4).expect_err("there is no alternative 3");
        assert_eq!(error.to_string(), "episode 4: the truth is alternative 3, the forecasts have 3 (0 to 2)");
        let error = episode(0, &[(99, good)]).check(4).expect_err("before its episode");
        assert!(error.to_string().contains("99 ms stands after 100 ms"), "{error}");
    }
}
