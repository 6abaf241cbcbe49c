//! Recordings are judged before anything is trained on them, tested with them or fed from them.

use crate::{DeviceError, Recording, Recordings};
use proact_emg::{Light, RecordedFault, RecordedRepetition, RecordedSession, check_recordings};
use proact_types::{EmgSample, GestureName};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// What becomes of recordings with findings that make an accuracy wrong.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FaultPolicy {
    /// They are refused.
    #[default]
    Refuse,
    /// They are used all the same; models and trials record it.
    Accept,
}

impl Recordings {
    /// Judges the repetitions `reps` that are used together, all if none is named. What is found and accepted is answered, worst first.
    ///
    /// # Errors
    /// [`DeviceError::Faults`] for findings that make an accuracy wrong, unless `policy` accepts them.
    pub fn judge(&self, reps: &[u32], policy: FaultPolicy) -> Result<Vec<RecordedFault>, DeviceError> {
        let used = self.items.iter().filter(|item| reps.is_empty() || reps.contains(&item.repetition));
        let used: Vec<&Recording> = used.collect();
        let stream = Stream {
            rate_hz: self.rate_hz,
            channels: self.channels,
            rest: self.rest,
            unknown_rate_keys: &self.unknown_rate_keys,
        };
        judge(&self.path, stream, &used, policy)
    }
}

impl Recording {
    /// Judges a file by itself, of `rate_hz`.
    ///
    /// # Errors
    /// As [`Recordings::judge`].
    pub fn judge(&self, rate_hz: f64, policy: FaultPolicy) -> Result<Vec<RecordedFault>, DeviceError> {
        let channels = self.samples.first().map_or(0, |sample| sample.len());
        let stream = Stream { rate_hz, channels, rest: GestureName::default(), unknown_rate_keys: &[] };
        judge(&self.path, stream, &[self], policy)
    }
}

/// What all recordings of a folder have in common.
struct Stream<'a> {
    rate_hz: f64,
    channels: usize,
    rest: GestureName,
    unknown_rate_keys: &'a [String],
}

fn judge(
    path: &Path,
    stream: Stream<'_>,
    used: &[&Recording],
    policy: FaultPolicy,
) -> Result<Vec<RecordedFault>, DeviceError> {
    let numbered: Vec<Vec<EmgSample>> = used.iter().map(|item| item.numbered().collect()).collect();
    // As they lie in the folder: those of 3DC have the same names in two of them.
    let names: Vec<String> = used
        .iter()
        .map(|item| item.path.strip_prefix(path).unwrap_or(&item.path).display().to_string())
        .map(|name| if name.is_empty() { path.display().to_string() } else { name })
        .collect();
    let repetitions: Vec<RecordedRepetition<'_>> = used
        .iter()
        .zip(&numbered)
        .zip(&names)
        .map(|((item, samples), file)| RecordedRepetition {
            gesture: item.gesture,
            repetition: item.repetition,
            file,
            samples,
        })
        .collect();
    let Stream { rate_hz, channels, rest, unknown_rate_keys } = stream;
    let findings = check_recordings(&RecordedSession {
        rate_hz,
        channels,
        rest,
        unknown_rate_keys,
        repetitions: &repetitions,
    });
    if policy == FaultPolicy::Refuse && findings.iter().any(|finding| finding.light() == Light::Red) {
        return Err(DeviceError::Faults { path: path.to_owned(), findings });
    }
    Ok(findings)
}

/// Those of accepted findings that make an accuracy wrong, as a model file and a trial's record keep them.
pub fn accepted(findings: &[RecordedFault]) -> Vec<String> {
    findings.iter().filter(|finding| finding.light() == Light::Red).map(RecordedFault::to_string).collect()
}

/// Findings as JSON: each with its sentence, and whether it is refused unless it is accepted.
pub fn findings_json(findings: &[RecordedFault]) -> serde_json::Value {
    let object = |finding: &RecordedFault| {
        let mut object = serde_json::json!(finding);
        object["text"] = finding.to_string().into();
        object["makes_accuracy_wrong"] = (finding.light() == Light::Red).into();
        object
    };
    findings.iter().map(object).collect()
}
