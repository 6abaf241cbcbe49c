//! A recorded trial, computed again.

use crate::{
    arm::Arm,
    libraries,
    record_keys::check_keys,
    recorder::CLASSIFIER_FILE,
    trial::{self, ReplannedReplies},
};
use proact_control::MethodRegistry;
use proact_emg::Classifier;
use proact_recording::{CONFIG_FILE, RECORD_FORMAT, RecordingError, TrialHeader, TrialRecord, read_result};
use proact_testbed::{
    Divergence, SpanDigest, Testbed, TestbedError, TrialConfig, TrialResult, first_divergence, replay,
};
use proact_types::{PlanReply, PlanStatus, SimTime};
use serde::Serialize;
use std::{
    error::Error,
    path::{Path, PathBuf},
};

/// What a replay found.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct ReplayResult {
    /// Every span agrees.
    pub agrees: bool,
    /// Spans compared.
    pub spans: usize,
    /// Digest of the recomputed trial.
    pub digest: String,
    /// Digest of the record.
    pub recorded: String,
    /// Where they part.
    pub divergence: Option<Divergence>,
    /// The record was closed. One of a trial that was interrupted is replayed up to its last digest.
    pub finished: bool,
    /// Length of the record, seconds.
    pub seconds: f64,
    /// Format of the record.
    pub format: u32,
    /// The program that recorded it, with its source commit.
    pub recorded_by: String,
    /// What planning again gave; none if it was not asked for.
    #[serde(rename = "replanned")]
    pub replan_result: Option<ReplanResult>,
}

/// Recorded plans beside those that the same requests give now.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct ReplanResult {
    /// Plans that are equal to the last bit.
    pub equal: usize,
    /// Numbers of the requests whose plan is another one now.
    pub different: Vec<u64>,
    /// Numbers of the requests that were cancelled, or that a deadline ended: nothing to compare.
    pub not_comparable: Vec<u64>,
}

/// A trial cannot be recomputed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
enum ReplayError {
    /// Its inputs.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// A stage.
    #[error(transparent)]
    Testbed(#[from] TestbedError),
}

/// Result and logs of a finished record are not of one trial.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "the result in {} is of a trial that ended at {} ms with the digest {}; the logs beside it end at {} ms with {}",
    dir.display(), result.0, result.1, logs.0, logs.1
)]
pub struct ResultMismatch {
    dir: PathBuf,
    result: (u64, String),
    logs: (u64, String),
}

/// A recorded trial, ready to be recomputed.
pub struct OpenedTrial {
    /// The files.
    pub record: TrialRecord,
    /// What the trial depended on.
    pub config: TrialConfig,
    /// Its arm.
    pub arm: Arm,
    /// At time zero; it takes its plans from the log.
    pub testbed: Testbed,
    /// What the same requests give now, if that was asked for.
    pub plans: Option<ReplannedReplies>,
    /// The recorded digests; none if the trial was interrupted before its first.
    pub recorded_spans: Vec<SpanDigest>,
    /// What the trial ended with, if it did.
    pub result: Option<TrialResult>,
}

/// How a trial is replayed.
#[derive(Clone, Debug, Default)]
pub struct ReplayOptions {
    /// Compute its plans again beside the recorded ones, which otherwise come from the log.
    pub replan: bool,
    /// Although this program, or a library, has another version than the one that the trial was recorded with.
    pub allow_other_versions: bool,
    /// The methods among which a configuration names one; at first those that ship with the program.
    pub methods: MethodRegistry,
}

/// Refuses a record of other libraries than those that are here. For the program itself the format of the record stands:
/// versions of one format compute the same.
///
/// # Errors
/// [`VersionMismatch`].
pub(crate) fn check_versions(recorded: &TrialHeader) -> Result<(), VersionMismatch> {
    let here = libraries::versions();
    let differs = |(name, recorded): (&String, &String)| {
        let here = here.get(name).map_or("none", String::as_str);
        (here != recorded && name != libraries::PROGRAM_NAME)
            .then(|| format!("{name} {recorded} (here: {here})"))
    };
    let differences: Vec<String> = recorded.versions.iter().filter_map(differs).collect();
    match differences.is_empty() {
        true => Ok(()),
        false => Err(VersionMismatch { differences: differences.join(", "), writer: recorded.writer() }),
    }
}

/// The record is of another library.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "the trial was recorded with {differences}, by {writer}: its numbers may be others here; replay --other-versions tries it"
)]
pub struct VersionMismatch {
    differences: String,
    writer: String,
}

/// The configuration of a record.
///
/// # Errors
/// What this program does not know or cannot have, with the program that wrote it.
pub(crate) fn recorded_config(record: &TrialRecord) -> Result<TrialConfig, Box<dyn Error>> {
    TrialConfig::from_toml(&record.header().config_toml).map_err(|error| {
        let file = record.dir().join(CONFIG_FILE);
        format!("{}: {error}; {} wrote it and replays it", file.display(), record.header().writer()).into()
    })
}

/// A finished record and its result. Unknown keys are named before anything else that is wrong.
///
/// # Errors
/// [`RecordingError`].
pub(crate) fn read_trial(dir: &Path) -> Result<(TrialRecord, TrialResult), RecordingError> {
    check_keys(dir)?;
    let result = read_result(dir)?;
    let record = TrialRecord::open(dir)?;
    if !record.is_finished() {
        return Err(RecordingError::MissingManifest { dir: dir.to_owned() });
    }
    Ok((record, result))
}

/// The record of a trial, checked as a whole.
#[derive(Clone)]
pub(crate) struct CheckedRecord {
    /// The files.
    pub record: TrialRecord,
    /// What the trial depended on.
    pub config: TrialConfig,
    /// Its digests.
    pub recorded_spans: Vec<SpanDigest>,
    /// What it ended with, if it did.
    pub result: Option<TrialResult>,
}

/// Opens the record in `dir`; `other_versions` also takes one of another program or library.
///
/// # Errors
/// A directory that is no trial, files that are not as they were recorded, a result of another trial than the logs, a
/// configuration that no longer fits, other versions.
pub(crate) fn check_record(dir: &Path, other_versions: bool) -> Result<CheckedRecord, Box<dyn Error>> {
    let record = TrialRecord::open(dir)?;
    if !other_versions {
        check_versions(record.header())?;
    }
    let config = recorded_config(&record)?;
    let limit = SimTime::from_secs(config.limit_secs);
    if record.end() > limit {
        let (end, limit) = (record.end().as_secs(), limit.as_secs());
        return Err(
            format!("the record ends at {end:.3} s, and its trial lasted {limit:.3} s at most").into()
        );
    }
    let recorded: Vec<SpanDigest> = record.digests()?;
    let result = record.is_finished().then(|| read_result::<TrialResult>(dir)).transpose()?;
    if let Some(result) = &result {
        let stored = ((result.sim_seconds * 1e3).round() as u64, result.digest.clone());
        let logs = (record.end().0, last_digest(&recorded));
        if stored != logs {
            return Err(ResultMismatch { dir: dir.to_owned(), result: stored, logs }.into());
        }
    }
    Ok(CheckedRecord { record, config, recorded_spans: recorded, result })
}

/// The digest of a whole trial; empty before its first span.
pub(crate) fn last_digest(spans: &[SpanDigest]) -> String {
    spans.last().map_or_else(String::new, |span| span.chain_hash.clone())
}

/// Reads the trial in `dir`.
///
/// # Errors
/// As [`check_record`]; another arm or task than the trial was recorded with, a classifier that cannot be used.
pub fn open_trial(dir: &Path, options: &ReplayOptions) -> Result<OpenedTrial, Box<dyn Error>> {
    open_checked(dir, check_record(dir, options.allow_other_versions)?, options)
}

/// Reads the trial in `dir`, whose record is `checked`.
///
/// # Errors
/// As [`open_trial`].
pub(crate) fn open_checked(
    dir: &Path,
    checked: CheckedRecord,
    options: &ReplayOptions,
) -> Result<OpenedTrial, Box<dyn Error>> {
    let CheckedRecord { record, config, recorded_spans: recorded, result } = checked;
    record.check_replayable()?;
    let arm = Arm::from_record(dir, &config)?;
    let classifier = read_classifier(&record, &config)?;
    let (testbed, plans) = if options.replan {
        let (testbed, plans) = trial::replanning_testbed(&options.methods, &arm, config.clone(), classifier)?;
        (testbed, Some(plans))
    } else {
        (trial::replay_testbed(&options.methods, &arm, config.clone(), classifier)?, None)
    };
    let testbed = testbed.with_recorded_config(&record.header().config_toml);
    Ok(OpenedTrial { record, config, arm, testbed, plans, recorded_spans: recorded, result })
}

/// The classifier of a trial; none if its gestures came without EMG.
pub(crate) fn read_classifier(
    record: &TrialRecord,
    config: &TrialConfig,
) -> Result<Option<Classifier>, Box<dyn Error>> {
    let classifier_path = || record.dir().join(CLASSIFIER_FILE).display().to_string();
    match record.header().files.get(CLASSIFIER_FILE) {
        Some(text) => {
            let read = serde_json::from_slice(text);
            Ok(Some(read.map_err(|e| format!("{} is damaged: {e}", classifier_path()))?))
        }
        None if config.emg.is_none() => Ok(None),
        None => {
            Err(format!("the trial was recorded without {}, which its EMG needs", classifier_path()).into())
        }
    }
}

/// Recomputes the trial in `dir` from its configuration, classifier and input log, and compares digests.
///
/// # Errors
/// As [`open_trial`].
pub fn replay_trial(dir: &Path, options: ReplayOptions) -> Result<ReplayResult, Box<dyn Error>> {
    if is_unstarted(&TrialRecord::open(dir)?) {
        return Ok(ReplayResult { agrees: true, format: RECORD_FORMAT, ..ReplayResult::default() });
    }
    let OpenedTrial { record, mut testbed, plans, recorded_spans: recorded, .. } = open_trial(dir, &options)?;
    let mut again = ReplanResult::default();
    let mut logged: Vec<PlanReply> = Vec::new();
    let inputs = record.inputs()?.map(|entry| entry.map(|e| (e.tick, e.input)).map_err(ReplayError::from));
    let inputs = inputs.inspect(|entry| {
        if let Ok((_, input)) = entry {
            logged.extend(input.plan.clone());
        }
    });
    let spans = replay(&mut testbed, inputs, record.end())?;
    if let Some(plans) = &plans {
        for reply in &logged {
            match plans.reply(reply.id) {
                Some((now, false)) if reply.status != PlanStatus::Cancelled => {
                    // The log does not have it.
                    if (PlanReply { clearance_m: None, ..now }) == *reply {
                        again.equal += 1;
                    } else {
                        again.different.push(reply.id);
                    }
                }
                _ => again.not_comparable.push(reply.id),
            }
        }
    }
    let divergence = first_divergence(&recorded, &spans);
    Ok(ReplayResult {
        agrees: divergence.is_none() && again.different.is_empty(),
        spans: spans.len(),
        digest: testbed.digest(),
        recorded: last_digest(&recorded),
        divergence,
        finished: record.is_finished(),
        seconds: record.end().as_secs(),
        format: RECORD_FORMAT,
        recorded_by: record.header().writer(),
        replan_result: options.replan.then_some(again),
    })
}

/// Whether a trial was interrupted before its first digest: there is nothing to recompute, and no fault.
pub(crate) fn is_unstarted(record: &TrialRecord) -> bool {
    !record.is_finished() && record.end() == SimTime(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_record_of_another_library_is_refused_by_name_and_one_of_another_program_of_its_format_is_not() {
        let versions = libraries::versions();
        let commit = "0123456789ab".to_owned();
        let here = TrialHeader { versions: versions.clone(), commit, ..TrialHeader::default() };
        assert_eq!(check_versions(&here), Ok(()));
        let with = |name: &str, version: &str| {
            let mut other = here.clone();
            other.versions.insert(name.to_owned(), version.to_owned()).expect("each is recorded");
            check_versions(&other)
        };
        for name in ["ODE", "OMPL", "KDL"] {
            let error = with(name, "another.so.1").expect_err("another version").to_string();
            assert!(error.contains(&format!("{name} another.so.1 (here: {})", versions[name])), "{error}");
            assert!(error.contains("at commit 0123456789ab"), "{error}");
        }
        assert_eq!(with(libraries::PROGRAM_NAME, "0.0.9"), Ok(()));
    }
}
