//! What another inference or decision rule would have made of a recorded trial.

use crate::{
    arm::Arm,
    replay::{check_record, read_classifier},
    trial, warn_of_renamed_keys,
};
use proact_control::MethodRegistry;
use proact_testbed::{Testbed, TestbedError, TrialConfig, first_divergence};
use proact_types::{Command, DisplayFrame, Pose};
use serde::Serialize;
use std::{collections::BTreeSet, error::Error, path::Path};

/// What may be changed: everything else changes what the inputs were an answer to, from the first tick on.
const CHANGEABLE_KEYS: [&str; 3] = ["intent_model", "intent.", "emg."];

/// A recorded trial beside the same inputs with other values.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Counterfactual {
    /// The other values, as `key=value`.
    pub values: Vec<String>,
    /// From when on the person would have seen something else, seconds; none if they never would. What they did after it was an answer
    /// to something else: what follows is no evidence.
    #[serde(rename = "seen_from_s")]
    pub display_differs_from_secs: Option<f64>,
    /// What of the display was another first.
    #[serde(rename = "seen_first")]
    pub first_display_differences: Vec<&'static str>,
    /// Length of the record, seconds.
    pub seconds: f64,
    /// Share of the record in which the gesture in force was the same, 0 to 1. The EMG does not hang on the display for as long as the
    /// person would have made the same gestures.
    #[serde(rename = "same_gesture")]
    pub same_gesture_fraction: f64,
    /// Times at which the gesture in force changed: as recorded, and with the other values.
    pub gesture_changes: [u64; 2],
    /// What the task counted in the end: as recorded, and with the other values.
    pub score: [u32; 2],
    /// Plans that were asked for: as recorded, and with the other values.
    pub plans: [u64; 2],
}

/// Computes the trial in `dir` twice from its inputs, as it was and with `values` (`key=value`).
///
/// Deterministic: equal records and values, equal answers.
///
/// # Errors
/// A key that would change more than inference and decisions, values that cannot be, a record that cannot be computed again, one of a
/// method in another process.
pub fn counterfactual(
    methods: &MethodRegistry,
    dir: &Path,
    values: &[String],
    other_versions: bool,
) -> Result<Counterfactual, Box<dyn Error>> {
    for value in values {
        let key = value.split('=').next().unwrap_or_default().trim();
        if !CHANGEABLE_KEYS.iter().any(|may| key == *may || may.ends_with('.') && key.starts_with(may)) {
            return Err(format!(
                "{key:?} cannot be changed afterwards: with another one the person would have done something else from the start; \
                 expected intent_model, intent.KEY or emg.KEY"
            )
            .into());
        }
    }
    let checked = check_record(dir, other_versions)?;
    checked.record.check_replayable()?;
    let (record, config, recorded) = (checked.record, checked.config, checked.recorded_spans);
    if config.method_process.is_some() {
        return Err("the method was another program: what it would have answered is not in the record".into());
    }
    let other_model = values.iter().any(|value| value.trim_start().starts_with("intent_model"));
    if config.intent_process.is_some() && !other_model {
        return Err(
            "the intent model was another program: what it would have answered is not in the record; \
            give one of the program's own, such as intent_model=product"
                .into(),
        );
    }
    if config.emg.is_none() && values.iter().any(|value| value.trim_start().starts_with("emg.")) {
        return Err("the trial has no EMG: its gestures came from keys".into());
    }
    let arm = Arm::from_record(dir, &config)?;
    let mut renamed = Vec::new();
    let overridden = config.with_overrides_noting(values, &mut renamed);
    warn_of_renamed_keys(&renamed);
    let altered = TrialConfig { intent_process: None, ..overridden? };
    let mut own = trial::replay_testbed(methods, &arm, config.clone(), read_classifier(&record, &config)?)?
        .with_recorded_config(&record.header().config_toml);
    let (mut other, plans) =
        trial::replanning_testbed(methods, &arm, altered.clone(), read_classifier(&record, &altered)?)?;

    let mut found = Counterfactual {
        values: values.to_vec(),
        display_differs_from_secs: None,
        first_display_differences: Vec::new(),
        seconds: record.end().as_secs(),
        same_gesture_fraction: 1.0,
        gesture_changes: [0; 2],
        score: [0; 2],
        plans: [0; 2],
    };
    let (mut spans, mut same, mut parted) = (Vec::new(), 0, false);
    let mut gestures = [Command::NoMotion; 2];
    for tick in record.ticks()? {
        let (time, mut input) = tick?;
        let last = time == record.end();
        let output = own.tick(&input, last)?;
        spans.extend(output.span_digest.clone());
        // Plans of requests that the record has not are the planner's.
        if parted {
            input.plan = None;
        }
        let answer = other.tick(&input, last)?;
        let has_requests = [output.request.is_some(), answer.request.is_some()];
        for (count, has_request) in found.plans.iter_mut().zip(has_requests) {
            *count += u64::from(has_request);
        }
        let now = [own.command(), other.command()];
        same += u64::from(now[0] == now[1]);
        for (count, (then, now)) in found.gesture_changes.iter_mut().zip(gestures.iter_mut().zip(now)) {
            *count += u64::from(*then != now);
            *then = now;
        }
        if !parted
            && (has_requests[0] != has_requests[1] || now[0] != now[1] || own.targets() != other.targets())
        {
            parted = true;
            plans.start_serving();
        }
        if found.display_differs_from_secs.is_none() && own.frame_is_due() {
            found.first_display_differences =
                display_differences(&display_frame(&mut own)?, &display_frame(&mut other)?);
            if !found.first_display_differences.is_empty() {
                found.display_differs_from_secs = Some(time.as_secs());
                parted = true;
                plans.start_serving();
            }
        }
    }
    if let Some(difference) = first_divergence(&recorded, &spans) {
        return Err(format!(
            "the record cannot be computed again: it differs between {:.3} s and {:.3} s, first in {}",
            difference.from.as_secs(),
            difference.to.as_secs(),
            difference.fields.join(", ")
        )
        .into());
    }
    found.same_gesture_fraction = same as f64 / record.end().0.max(1) as f64;
    found.score = [own.task().state().score, other.task().state().score];
    Ok(found)
}

/// The instant as drawn, seen from anywhere: who looks does not change what there is to see.
fn display_frame(testbed: &mut Testbed) -> Result<DisplayFrame, TestbedError> {
    testbed.frame(Pose::identity())
}

/// What of two instants a person would see to be another. Numbers beside the scene, such as the confidence, do not count.
fn display_differences(a: &DisplayFrame, b: &DisplayFrame) -> Vec<&'static str> {
    let seen = [
        ("arm and hand", a.joints != b.joints || a.hand != b.hand),
        ("shoulder", a.world_from_base != b.world_from_base),
        ("objects", a.objects != b.objects),
        ("gesture", a.command != b.command),
        ("highlighted object", a.target.object != b.target.object),
        ("place marker", a.target.place != b.target.place),
        ("lock", a.target.locked != b.target.locked),
        ("planner", a.planner != b.planner || a.plan_goal != b.plan_goal),
        ("mode", a.mode != b.mode),
        ("stop", a.stop != b.stop),
    ];
    let differ: BTreeSet<&'static str> =
        seen.into_iter().filter(|(_, differs)| *differs).map(|(name, _)| name).collect();
    differ.into_iter().collect()
}
