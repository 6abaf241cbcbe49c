//! A recorded trial, computed again.

use crate::{
    arm::Arm,
    libraries,
    record::CLASSIFIER_FILE,
    trial::{self, ComparedPlans},
};
use proact_emg::Classifier;
use proact_recording::{RecordingError, Trial, read_result};
use proact_testbed::{
    Divergence, SpanDigest, Testbed, TestbedError, TrialConfig, TrialResult, first_divergence, replay,
};
use proact_types::{PlanReply, PlanStatus};
use serde::Serialize;
use std::{collections::BTreeMap, error::Error, fs, path::Path};

/// What a replay found.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Replayed {
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
    /// The record has a result; a trial that crashed has none and is replayed as far as it goes.
    pub finished: bool,
    /// What planning again gave; none if it was not asked for.
    pub replanned: Option<Replanned>,
}

/// Recorded plans beside those that the same requests give now.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Replanned {
    /// Plans that are equal to the last bit.
    pub equal: usize,
    /// Numbers of the requests whose plan is another one now.
    pub different: Vec<u64>,
    /// Numbers of the requests that were cancelled, or that a deadline ended: nothing to compare.
    pub not_comparable: Vec<u64>,
}

#[derive(Debug, thiserror::Error)]
enum ReplayError {
    #[error(transparent)]
    Recording(#[from] RecordingError),
    #[error(transparent)]
    Testbed(#[from] TestbedError),
}

/// A recorded trial, ready to be recomputed.
pub struct Opened {
    /// The files.
    pub record: Trial,
    /// What the trial depended on.
    pub config: TrialConfig,
    /// At time zero; it takes its plans from the log.
    pub testbed: Testbed,
    /// What the same requests give now, if that was asked for.
    pub plans: Option<ComparedPlans>,
    /// The recorded digests, at least one.
    pub recorded: Vec<SpanDigest>,
}

/// How a trial is replayed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ReplayOptions {
    /// Compute its plans again beside the recorded ones, which otherwise come from the log.
    pub replan: bool,
    /// Although this program, or a library, has another version than the one that the trial was recorded with.
    pub other_versions: bool,
}

/// Refuses a record of other versions than those that are here.
///
/// # Errors
/// [`OtherVersions`].
pub(crate) fn check_versions(recorded: &BTreeMap<String, String>) -> Result<(), OtherVersions> {
    let here = libraries::versions();
    let differs = |(name, recorded): (&String, &String)| {
        let here = here.get(name).map_or("none", String::as_str);
        (here != recorded).then(|| format!("{name} {recorded} (here: {here})"))
    };
    let differences: Vec<String> = recorded.iter().filter_map(differs).collect();
    if differences.is_empty() { Ok(()) } else { Err(OtherVersions { differences: differences.join(", ") }) }
}

/// The record is of another program or library.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "the trial was recorded with {differences}: its numbers may be others here; replay --other-versions tries it"
)]
pub struct OtherVersions {
    differences: String,
}

/// Reads the trial in `dir`.
///
/// # Errors
/// A directory that is no trial, a damaged file (with its offset), a configuration that no longer fits, another arm,
/// task or version of a library than the trial was recorded with.
pub fn open_trial(dir: &Path, options: ReplayOptions) -> Result<Opened, Box<dyn Error>> {
    let ReplayOptions { replan, other_versions } = options;
    let record = Trial::open(dir)?;
    if !other_versions {
        check_versions(&record.header().versions)?;
    }
    let config = TrialConfig::from_toml(&record.header().config_toml)?;
    let arm = Arm::recorded(dir, &config)?;
    let classifier = read_classifier(dir, &config)?;
    let recorded: Vec<SpanDigest> = record.digests()?;
    if recorded.is_empty() {
        return Err("the record holds no complete span: there is nothing to compare".into());
    }
    let (testbed, plans) = if replan {
        let (testbed, plans) = trial::replanned(&arm, config.clone(), classifier)?;
        (testbed, Some(plans))
    } else {
        (trial::replayed(&arm, config.clone(), classifier)?, None)
    };
    Ok(Opened { record, config, testbed, plans, recorded })
}

/// The classifier of the trial in `dir`; none if its gestures came without EMG.
pub(crate) fn read_classifier(
    dir: &Path,
    config: &TrialConfig,
) -> Result<Option<Classifier>, Box<dyn Error>> {
    let path = dir.join(CLASSIFIER_FILE);
    match fs::read(&path) {
        Ok(text) => {
            let read = serde_json::from_slice(&text);
            Ok(Some(read.map_err(|e| format!("{} is damaged: {e}", path.display()))?))
        }
        Err(_) if config.emg.is_none() => Ok(None),
        Err(error) => Err(format!("{}: {error}", path.display()).into()),
    }
}

/// Recomputes the trial in `dir` from its configuration, classifier and input log, and compares digests.
///
/// # Errors
/// As [`open_trial`].
pub fn replay_trial(dir: &Path, options: ReplayOptions) -> Result<Replayed, Box<dyn Error>> {
    let Opened { record, mut testbed, plans, recorded, .. } = open_trial(dir, options)?;
    let last = recorded.last().ok_or("an opened trial has a digest")?;
    let mut again = Replanned::default();
    let mut logged: Vec<PlanReply> = Vec::new();
    let inputs = record.inputs()?.map(|entry| entry.map(|e| (e.tick, e.input)).map_err(ReplayError::from));
    let inputs = inputs.inspect(|entry| {
        if let Ok((_, input)) = entry {
            logged.extend(input.plan.clone());
        }
    });
    let spans = replay(&mut testbed, inputs, last.tick)?;
    if let Some(plans) = &plans {
        for reply in &logged {
            match plans.reply(reply.id) {
                Some((now, false)) if reply.status != PlanStatus::Cancelled => {
                    if now == *reply {
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
    let finished = read_result::<TrialResult>(dir).is_ok();
    Ok(Replayed {
        agrees: divergence.is_none() && again.different.is_empty(),
        spans: spans.len(),
        digest: testbed.digest(),
        recorded: last.chain.clone(),
        divergence,
        finished,
        replanned: options.replan.then_some(again),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_record_of_another_library_or_program_is_refused_by_name() {
        let here = libraries::versions();
        assert_eq!(check_versions(&here), Ok(()));
        for name in ["ODE", "OMPL", "KDL", "proact"] {
            let mut other = here.clone();
            other.insert(name.to_owned(), "another.so.1".to_owned()).expect("each is recorded");
            let error = check_versions(&other).expect_err("another version").to_string();
            assert!(error.contains(&format!("{name} another.so.1 (here: {})", here[name])), "{error}");
        }
    }
}
