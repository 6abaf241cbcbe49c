//! What comes of a training beside the model: what a process makes of it, and what is answered.

use proact_app::answer;
use proact_devices::{Evaluation, Recording, Recordings, leave_one_out, train_process};
use proact_emg::{DriveScore, EmgConfig, EmgModel, Repetition};
use proact_types::{EmgSample, GestureName};
use serde_json::Value;
use std::{collections::BTreeMap, error::Error, path::PathBuf};

/// The model of a training, decoded by the process of `config` if that is what was asked for, with what the process makes of
/// each repetition after it has learnt from the others.
///
/// # Errors
/// A process that does not start, or gives no answer.
pub(super) fn decoded(
    config: &EmgConfig,
    model: EmgModel,
    repetitions: &[Repetition],
) -> Result<(EmgModel, Option<Evaluation>), Box<dyn Error>> {
    if !config.classifier.is_process() {
        return Ok((model, None));
    }
    let judged = leave_one_out(&centred(&model, repetitions), config)?;
    let slices: Vec<(GestureName, &[EmgSample])> =
        repetitions.iter().map(|r| (r.gesture, r.samples.as_slice())).collect();
    Ok((train_process(config, model, &slices)?, Some(judged)))
}

/// The repetitions less the model's zero levels, as a folder of recordings has them.
fn centred(model: &EmgModel, repetitions: &[Repetition]) -> Recordings {
    let mut counts: BTreeMap<GestureName, u32> = BTreeMap::new();
    let mut items = Vec::with_capacity(repetitions.len());
    for Repetition { gesture, samples, .. } in repetitions {
        let count = counts.entry(*gesture).or_default();
        let samples: Vec<EmgSample> = samples.iter().map(|sample| model.centred(sample)).collect();
        items.push(Recording::bridging(*count, *gesture, &samples));
        *count += 1;
    }
    Recordings {
        path: PathBuf::new(),
        rate_hz: model.config.rate_hz,
        channels: model.config.channels,
        expected: model.classifier.gestures().to_vec(),
        rest: model.config.rest,
        items,
        notes: Vec::new(),
    }
}

/// What a process makes of the recordings, for the terminal; empty of another decoder.
pub(super) fn process_text(judged: Option<&Evaluation>) -> String {
    let Some(judged) = judged else { return String::new() };
    let mut text = format!(
        "the process itself, leaving one repetition out: {:.1} % of {} windows\n",
        100.0 * judged.accuracy,
        judged.windows
    );
    for DriveScore { drive, r2, mean_absolute_error } in &judged.drives {
        text += &format!("  {drive}: R2 {r2:.3}, mean absolute error {mean_absolute_error:.3}\n");
    }
    text + "what is said above of the recordings is by lda or ridge on the same features\n"
}

pub(super) fn print(object: &Value, json: bool) -> Result<(), Box<dyn Error>> {
    if json {
        answer(object)?;
    } else if let Some(text) = object["verdict"].as_str() {
        answer(format_args!("{text}; it is in {}", object["model"].as_str().unwrap_or_default()))?;
    } else {
        answer(format_args!("the model is in {}", object["model"].as_str().unwrap_or_default()))?;
    }
    Ok(())
}
