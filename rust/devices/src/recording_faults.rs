//! Recordings are judged before anything is trained on them, tested with them or fed from them.

use crate::{DeviceError, Recording, Recordings};
use proact_emg::{ChannelStatus, RecordedRepetition, RecordingFault, RecordingSet, check_recordings};
use proact_types::{EmgSample, Gesture};
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
    /// [`DeviceError::FaultyRecordings`] for findings that make an accuracy wrong, unless `policy` accepts them.
    pub fn check_faults(
        &self,
        reps: &[u32],
        policy: FaultPolicy,
    ) -> Result<Vec<RecordingFault>, DeviceError> {
        let used = self.items.iter().filter(|item| reps.is_empty() || reps.contains(&item.repetition));
        let used: Vec<&Recording> = used.collect();
        let stream = RecordingProperties {
            rate_hz: self.rate_hz,
            channels: self.channels,
            rest: self.rest,
            unknown_rate_keys: &self.unknown_rate_keys,
        };
        apply_policy(&self.path, stream, &used, policy)
    }
}

impl Recording {
    /// Judges a file by itself, of `rate_hz`.
    ///
    /// # Errors
    /// As [`Recordings::judge`].
    pub fn check_faults(
        &self,
        rate_hz: f64,
        policy: FaultPolicy,
    ) -> Result<Vec<RecordingFault>, DeviceError> {
        let channels = self.samples.first().map_or(0, |sample| sample.len());
        let stream =
            RecordingProperties { rate_hz, channels, rest: Gesture::default(), unknown_rate_keys: &[] };
        apply_policy(&self.path, stream, &[self], policy)
    }
}

/// What all recordings of a folder have in common.
struct RecordingProperties<'a> {
    rate_hz: f64,
    channels: usize,
    rest: Gesture,
    unknown_rate_keys: &'a [String],
}

fn apply_policy(
    path: &Path,
    stream: RecordingProperties<'_>,
    used: &[&Recording],
    policy: FaultPolicy,
) -> Result<Vec<RecordingFault>, DeviceError> {
    let numbered: Vec<Vec<EmgSample>> = used.iter().map(|item| item.numbered_samples().collect()).collect();
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
    let RecordingProperties { rate_hz, channels, rest, unknown_rate_keys } = stream;
    let findings = check_recordings(&RecordingSet {
        rate_hz,
        channels,
        rest,
        unknown_rate_keys,
        repetitions: &repetitions,
    });
    if policy == FaultPolicy::Refuse && findings.iter().any(|finding| finding.status() == ChannelStatus::Red)
    {
        return Err(DeviceError::FaultyRecordings { path: path.to_owned(), findings });
    }
    Ok(findings)
}

/// Those of accepted findings that make an accuracy wrong, as a model file and a trial's record keep them.
pub fn accepted_fault_texts(findings: &[RecordingFault]) -> Vec<String> {
    findings
        .iter()
        .filter(|finding| finding.status() == ChannelStatus::Red)
        .map(RecordingFault::to_string)
        .collect()
}

/// Findings as JSON: each with its sentence, and whether it is refused unless it is accepted.
pub fn findings_json(findings: &[RecordingFault]) -> serde_json::Value {
    let object = |finding: &RecordingFault| {
        let mut object = serde_json::json!(finding);
        object["text"] = finding.to_string().into();
        object["makes_accuracy_wrong"] = (finding.status() == ChannelStatus::Red).into();
        object
    };
    findings.iter().map(object).collect()
}
