//! Numbers from logged trials.
//!
//! Pure: values in, values out. Reads no files and has no clock; what is drawn comes from a seed. Depends on the vocabulary
//! alone; who reads trials and prints tables are the commands `analyze` and `study export`.
//!
//! [`scoring`] says what a person did in a trial, [`gaze_measure`] are of what a person did, [`plausibility`] what cannot be, [`summary`] of a sample of numbers, [`statistics`] of samples of the same people, [`simulate_power`] of a design,
//! [`table`] what every table of the project is.
//!
//! [`score`] says how good forecasts are of which of a few things a person means:
//!
//! ```
//! use proact_analysis::{Episode, Forecast, score_forecasts};
//! use proact_types::SimTime;
//! let say = |millis, probabilities: [f64; 2]| Forecast { time: SimTime(millis), probabilities: probabilities.to_vec() };
//! let episode = Episode { start: SimTime(0), truth: 0, forecasts: vec![say(10, [0.4, 0.6]), say(30, [0.8, 0.2])] };
//! let score = score_forecasts(&[episode])?;
//! assert_eq!((score.accuracy, score.time_to_correct_ms.median), (0.5, Some(30.0)));
//! # Ok::<(), proact_analysis::AnalysisError>(())
//! ```

#![cfg_attr(test, allow(clippy::unwrap_used))]

mod forecast;
mod forecast_score;
pub mod gaze_measure;
pub mod plausibility;
pub mod power;
pub mod scoring;
pub mod statistics;
pub mod summary;
pub mod table;

pub use forecast::{AnalysisError, Episode, Forecast, brier, log_loss, top_choice};
pub use forecast_score::{ForecastScore, Quartiles, ReliabilityBin, score_forecasts};

/// Probabilities below this count as this in a logarithm: one forecast that excludes the truth would otherwise
/// make the mean infinite. The worst loss of one forecast is then 13.8.
pub const PROBABILITY_FLOOR: f64 = 1e-6;
/// Bins of confidence between zero and one.
pub const RELIABILITY_BINS: usize = 10;
