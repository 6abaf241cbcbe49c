use super::regressor::drive_scores;
use crate::decoder_process::DecodeResponse;
use crate::{EmgConfig, EmgError};
use arrayvec::ArrayVec;
use proact_types::{DegreeOfFreedom, Drives, Gesture, MAX_DRIVES};
use serde::{Deserialize, Serialize};

/// By how much the sum of a posterior may differ from one: what four decimals lose in 64 classes.
const SUM_TOLERANCE: f64 = 0.01;

/// What is known of a decoder in another process: everything but how it decides.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct ExternalDiscriminant {
    classes: usize,
    features: usize,
    /// What it learnt, JSON text that the process is given when it starts.
    state: String,
    /// Degrees of freedom of a regressor; none of a classifier.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    drives: Option<ExternalDrives>,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct ExternalDrives {
    drives: Vec<DegreeOfFreedom>,
    /// Class of the positive and of the negative gesture of each drive.
    #[serde(rename = "places")]
    class_indices: Vec<[usize; 2]>,
    /// Class of the relaxed hand.
    rest: usize,
    dead_band: f64,
}

impl ExternalDiscriminant {
    /// The decoder of `config` over `gestures`, for windows of so many `features`.
    ///
    /// # Errors
    /// A gesture of a degree of freedom that is not among them.
    pub(crate) fn new(
        config: &EmgConfig,
        gestures: &[Gesture],
        features: usize,
        state: &str,
    ) -> Result<ExternalDiscriminant, EmgError> {
        let index =
            |gesture: Gesture| gestures.binary_search(&gesture).map_err(|_| EmgError::NotTrained(gesture));
        let drives = if config.classifier.is_regression() {
            let drives = config.regression.drives.clone();
            let pair = |drive: &DegreeOfFreedom| Ok([index(drive.positive())?, index(drive.negative())?]);
            let class_indices = drives.iter().map(pair).collect::<Result<_, EmgError>>()?;
            let dead_band = config.regression.dead_band;
            Some(ExternalDrives { drives, class_indices, rest: index(config.rest)?, dead_band })
        } else {
            None
        };
        Ok(ExternalDiscriminant { classes: gestures.len(), features, state: state.to_owned(), drives })
    }

    pub(crate) fn classes(&self) -> usize {
        self.classes
    }

    pub(crate) fn features(&self) -> usize {
        self.features
    }

    pub(crate) fn state(&self) -> &str {
        &self.state
    }

    pub(crate) fn is_regressor(&self) -> bool {
        self.drives.is_some()
    }

    pub(crate) fn drives(&self) -> &[DegreeOfFreedom] {
        self.drives.as_ref().map_or(&[], |of| &of.drives)
    }

    pub(crate) fn set_dead_band(&mut self, dead_band: f64) {
        if let Some(of) = &mut self.drives {
            of.dead_band = dead_band;
        }
    }

    pub(crate) fn is_sound(&self) -> bool {
        let of = |of: &ExternalDrives| {
            let mut classes: Vec<usize> = of.class_indices.iter().flatten().copied().collect();
            classes.push(of.rest);
            classes.sort_unstable();
            (1..=MAX_DRIVES).contains(&of.drives.len())
                && of.class_indices.len() == of.drives.len()
                && classes == (0..self.classes).collect::<Vec<_>>()
                && (0.0..1.0).contains(&of.dead_band)
        };
        let state =
            self.state.is_empty() || serde_json::from_str::<serde::de::IgnoredAny>(&self.state).is_ok();
        self.classes >= 2 && self.features > 0 && state && self.drives.as_ref().is_none_or(of)
    }

    /// Whether the classes are those of `gestures`.
    pub(crate) fn matches_gestures(&self, gestures: &[Gesture]) -> bool {
        let at = |index: usize| gestures.get(index).copied();
        self.drives.as_ref().is_none_or(|of| {
            of.drives.iter().zip(&of.class_indices).all(|(drive, [positive, negative])| {
                at(*positive) == Some(drive.positive()) && at(*negative) == Some(drive.negative())
            })
        })
    }

    /// One score a class and the drives, as `line` says of window number `window`. Scores sum to one.
    ///
    /// # Errors
    /// What is wrong with the line, for a person.
    pub(crate) fn parse_response(&self, window: u64, line: &str) -> Result<(Vec<f64>, Drives), String> {
        let answer: DecodeResponse =
            serde_json::from_str(line).map_err(|e| format!("it answered {}: {e}", truncated(line)))?;
        if let Some(error) = answer.error {
            return Err(format!("it says {}", truncated(&error)));
        }
        if answer.window != window {
            return Err(format!("it answered window {}, expected {window}", answer.window));
        }
        match (&self.drives, answer.posterior, answer.drives) {
            (None, Some(posterior), None) => Ok((self.posterior(posterior)?, Drives::new())),
            (Some(of), None, Some(drives)) => of.read(&drives, self.classes),
            (None, ..) => Err("it answered without a posterior, or with drives".to_owned()),
            (Some(_), ..) => Err("it answered without drives, or with a posterior".to_owned()),
        }
    }

    fn posterior(&self, mut values: Vec<f64>) -> Result<Vec<f64>, String> {
        if values.len() != self.classes {
            return Err(format!("posterior has {} values, expected {}", values.len(), self.classes));
        }
        if let Some((k, value)) = values.iter().enumerate().find(|(_, v)| !(0.0..=1.0).contains(*v)) {
            return Err(format!("posterior {k} is {value}, expected 0 to 1"));
        }
        let sum: f64 = values.iter().sum();
        if (sum - 1.0).abs() > SUM_TOLERANCE {
            return Err(format!("posterior sums to {sum}, expected 1"));
        }
        values.iter_mut().for_each(|value| *value /= sum);
        Ok(values)
    }
}

impl ExternalDrives {
    fn read(&self, values: &[f64], classes: usize) -> Result<(Vec<f64>, Drives), String> {
        if values.len() != self.drives.len() {
            return Err(format!("drives has {} values, expected {}", values.len(), self.drives.len()));
        }
        if let Some((k, value)) = values.iter().enumerate().find(|(_, v)| !v.is_finite()) {
            return Err(format!("drive {k} is {value}, expected a finite number"));
        }
        let drives: Drives = values.iter().map(|value| value.clamp(-1.0, 1.0)).collect::<ArrayVec<_, _>>();
        let mut scores = vec![0.0; classes];
        drive_scores(&drives, &self.class_indices, self.rest, self.dead_band, &mut scores);
        super::Regressor::posterior(&mut scores);
        Ok((scores, drives))
    }
}

/// Text of a process that goes into one sentence.
fn truncated(text: &str) -> String {
    const MAX_CHARS: usize = 120;
    let end = text.char_indices().nth(MAX_CHARS).map_or(text.len(), |(at, _)| at);
    format!("{:?}{}", &text[..end], if end < text.len() { " ..." } else { "" })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ClassifierKind;
    use proact_types::Command;

    fn outside(classifier: ClassifierKind) -> ExternalDiscriminant {
        let gestures = Command::ALL.map(Gesture::from);
        ExternalDiscriminant::new(&EmgConfig { classifier, ..EmgConfig::default() }, &gestures, 32, "{}")
            .expect("five")
    }

    #[test]
    fn a_posterior_is_taken_as_it_is_said_and_everything_else_is_told_with_what_was_expected() {
        let of = outside(ClassifierKind::Process);
        let read = |line: &str| of.parse_response(7, line);
        let (scores, drives) = read("{\"window\":7,\"posterior\":[0.5,0.25,0.25,0,0]}").expect("good");
        assert_eq!((scores, drives.len()), (vec![0.5, 0.25, 0.25, 0.0, 0.0], 0));
        for (line, expected) in [
            ("{\"window\":7,\"posterior\":[0.5,0.5]}", "posterior has 2 values, expected 5"),
            ("{\"window\":7,\"posterior\":[NaN,0,0,0,1]}", "it answered"),
            ("{\"window\":7,\"posterior\":[null,0,0,0,1]}", "it answered"),
            ("{\"window\":7,\"posterior\":[-0.5,0.5,0.5,0.5,0]}", "posterior 0 is -0.5, expected 0 to 1"),
            ("{\"window\":7,\"posterior\":[1,1,0,0,0]}", "sums to 2, expected 1"),
            ("{\"window\":8,\"posterior\":[1,0,0,0,0]}", "window 8, expected 7"),
            ("{\"window\":7,\"drives\":[0,0]}", "without a posterior"),
            ("{\"window\":7,\"error\":\"no memory\"}", "it says \"no memory\""),
            ("hello", "it answered \"hello\""),
        ] {
            let error = read(line).expect_err(line);
            assert!(error.contains(expected), "{line}: {error}");
        }
        assert!(read(&"x".repeat(5000)).expect_err("long").len() < 300);
    }

    #[test]
    fn drives_are_clipped_to_their_range_and_the_largest_is_the_class() {
        let of = outside(ClassifierKind::ProcessRegressor);
        let (scores, drives) = of.parse_response(1, "{\"window\":1,\"drives\":[-1.4,0.5]}").expect("good");
        assert_eq!(drives.as_slice(), [-1.0, 0.5]);
        let largest = (0..5).max_by(|a, b| scores[*a].total_cmp(&scores[*b]));
        assert_eq!(largest, Some(Command::WristFlexion.index()));
        assert!((scores.iter().sum::<f64>() - 1.0).abs() < 1e-12);
        assert!(
            of.parse_response(1, "{\"window\":1,\"drives\":[1]}")
                .is_err_and(|e| e.contains("1 values, expected 2"))
        );
        assert!(
            of.parse_response(1, "{\"window\":1,\"posterior\":[1,0,0,0,0]}")
                .is_err_and(|e| e.contains("without drives"))
        );
    }
}
