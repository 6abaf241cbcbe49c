//! A recorded trial, computed again.

use crate::{
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
use std::{error::Error, fs, path::Path};

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

/// Reads the trial in `dir`; with `replan` its plans are computed again beside the recorded ones.
///
/// # Errors
/// A directory that is no trial, a damaged file (with its offset), a configuration that no longer fits.
pub fn open_trial(dir: &Path, replan: bool) -> Result<Opened, Box<dyn Error>> {
    let record = Trial::open(dir)?;
    let config = TrialConfig::from_toml(&record.header().config_toml)?;
    let classifier = read_classifier(dir, &config)?;
    let recorded: Vec<SpanDigest> = record.digests()?;
    if recorded.is_empty() {
        return Err("the record holds no complete span: there is nothing to compare".into());
    }
    let (testbed, plans) = if replan {
        let (testbed, plans) = trial::replanned(config.clone(), classifier)?;
        (testbed, Some(plans))
    } else {
        (trial::replayed(config.clone(), classifier)?, None)
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

/// Recomputes the trial in `dir` from its configuration, classifier and input log, and compares digests; with
/// `replan` its plans as well, which otherwise come from the log.
///
/// # Errors
/// A directory that is no trial, a damaged file (with its offset), a configuration that no longer fits.
pub fn replay_trial(dir: &Path, replan: bool) -> Result<Replayed, Box<dyn Error>> {
    let Opened { record, mut testbed, plans, recorded, .. } = open_trial(dir, replan)?;
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
        replanned: replan.then_some(again),
    })
}
