//! What is said about recordings before anything is trained on them or tested with them.

use clap::Args;
use proact_app::{print_result_json, print_status, trial::AssemblyError};
use proact_devices::{DeviceError, FaultPolicy, Recordings, findings_json};
use proact_emg::{CalibrationConfig, RecordingFault};
use proact_types::Gesture;
use serde_json::json;
use std::error::Error;

/// What becomes of recordings with faults.
#[derive(Clone, Copy, Debug, Args)]
pub(crate) struct FaultArgs {
    /// Use recordings whose faults make an accuracy wrong all the same: columns that are no electrode, samples that stand in two
    /// recordings, held rows, an unread rate, dead or humming channels. With --json, in a model file and in a trial's configuration it
    /// is recorded what was accepted.
    #[arg(long)]
    accept_faults: bool,
}

impl FaultArgs {
    /// What they say.
    pub(crate) fn policy(self) -> FaultPolicy {
        if self.accept_faults { FaultPolicy::Accept } else { FaultPolicy::Refuse }
    }

    /// Judges the repetitions `reps` of recordings, all if none is named, and says what is found.
    ///
    /// # Errors
    /// As [`Recordings::check_recordings`].
    pub(super) fn check_recordings(
        self,
        recordings: &Recordings,
        reps: &[u32],
    ) -> Result<Vec<RecordingFault>, DeviceError> {
        let findings = recordings.check_faults(reps, self.policy())?;
        findings.iter().for_each(print_status);
        Ok(findings)
    }
}

/// Answers with the findings for which a command ends, if `json` asks for an answer. The error goes to standard error as any other.
pub(crate) fn print_refused_findings(error: &(dyn Error + 'static), json: bool) {
    let refusal = match error.downcast_ref::<AssemblyError>() {
        Some(AssemblyError::Device(error)) => Some(error),
        _ => error.downcast_ref::<DeviceError>(),
    };
    if let Some(DeviceError::FaultyRecordings { findings, .. }) = refusal.filter(|_| json) {
        // That nobody reads it is no reason for another error.
        let _ =
            print_result_json(&json!({ "error": error.to_string(), "findings": findings_json(findings) }));
    }
}

/// What the folder lacks: gestures that it should have, and repetitions that other gestures have. One sentence each.
pub(super) fn missing_recording_notes(recordings: &Recordings) -> Vec<String> {
    let mut sentences: Vec<String> = recordings
        .missing()
        .iter()
        .map(|gesture| format!("there is no recording of {gesture}: the model will never recognise it"))
        .collect();
    let count = |gesture: &Gesture| recordings.items.iter().filter(|r| r.gesture == *gesture).count();
    let gestures = recordings.gestures();
    let max_count = gestures.iter().map(count).max().unwrap_or(0);
    for gesture in gestures.iter().filter(|gesture| count(gesture) < max_count) {
        sentences
            .push(format!("{gesture} has {} repetitions, other gestures have {max_count}", count(gesture)));
    }
    sentences
}

/// In the order of the prompts, so that saved recordings give the model of their session to the last digit.
pub(super) fn sort_by_prompt_order(recordings: &mut Recordings, rest: Gesture) {
    let order = CalibrationConfig::round(&recordings.gestures(), rest);
    recordings.items.sort_by_key(|r| (r.repetition, order.iter().position(|g| *g == r.gesture)));
}
