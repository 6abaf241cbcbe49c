//! What comes of a training beside the model: what a process makes of it, its figures, and what is answered.

use proact_app::{
    analysis::{TrainingFigure, training_figures},
    print_result, print_result_json, print_status,
};
use proact_devices::{DeviceError, Evaluation, Recording, Recordings, leave_one_out, train_process};
use proact_emg::{CalibrationReport, DriveScore, EmgConfig, EmgModel, Repetition, feature_space};
use proact_files::{is_regular_or_missing, write_atomically};
use proact_types::{EmgSample, Gesture, Number};
use serde_json::{Value, json};
use std::{
    collections::BTreeMap,
    error::Error,
    path::{Path, PathBuf},
};

/// The model of a training, decoded by the process of `config` if that is what was asked for, with what the process makes of
/// each repetition after it has learnt from the others.
///
/// # Errors
/// A process that does not start, or gives no answer.
pub(super) fn decode_by_process(
    config: &EmgConfig,
    model: EmgModel,
    repetitions: &[Repetition],
) -> Result<(EmgModel, Option<Evaluation>), Box<dyn Error>> {
    if !config.classifier.is_process() {
        return Ok((model, None));
    }
    let evaluation = match leave_one_out(&subtract_dc_offset(&model, repetitions), config) {
        // One round cannot be judged, and is learnt from all the same.
        Err(DeviceError::NoRepetitions { .. }) => None,
        evaluation => Some(evaluation?),
    };
    let slices: Vec<(Gesture, &[EmgSample])> =
        repetitions.iter().map(|r| (r.gesture, r.samples.as_slice())).collect();
    Ok((train_process(config, model, &slices)?, evaluation))
}

/// The repetitions less the model's zero levels, as a folder of recordings has them.
fn subtract_dc_offset(model: &EmgModel, repetitions: &[Repetition]) -> Recordings {
    let mut counts: BTreeMap<Gesture, u32> = BTreeMap::new();
    let mut items = Vec::with_capacity(repetitions.len());
    for Repetition { gesture, samples, .. } in repetitions {
        let count = counts.entry(*gesture).or_default();
        let samples: Vec<EmgSample> = samples.iter().map(|sample| model.subtract_dc_offset(sample)).collect();
        items.push(Recording::bridge_gaps(*count, *gesture, &samples));
        *count += 1;
    }
    Recordings {
        path: PathBuf::new(),
        rate_hz: model.config.rate_hz,
        channels: model.config.channels,
        imu: model.config.imu.channels.clone(),
        expected: model.classifier.gestures().to_vec(),
        rest: model.config.rest,
        items,
        notes: Vec::new(),
        unknown_rate_keys: Vec::new(),
    }
}

/// Draws the confusion, of the process if one decodes, and the feature space, and writes them beside the model at `out`, as
/// `NAME.confusion.svg` and `NAME.feature_space.svg`. What cannot be drawn is told: the model is written all the same.
///
/// # Errors
/// A disk that refuses.
pub(super) fn write_figures(
    out: &Path,
    model: &EmgModel,
    repetitions: &[Repetition],
    report: Option<&CalibrationReport>,
    process: Option<&Evaluation>,
) -> Result<Vec<TrainingFigure>, Box<dyn Error>> {
    let slices: Vec<(Gesture, &[EmgSample])> =
        repetitions.iter().map(|r| (r.gesture, r.samples.as_slice())).collect();
    let own = report.map(|report| (report.classes.as_slice(), report.confusion.as_slice()));
    let confusion =
        process.map(|evaluation| (evaluation.classes.as_slice(), evaluation.confusion.as_slice())).or(own);
    let figures = feature_space(model, &slices)
        .map_err(|error| error.to_string())
        .and_then(|space| training_figures(confusion, &space).map_err(|error| error.to_string()));
    let figures = match figures {
        Ok(figures) => figures,
        Err(reason) => {
            print_status(format_args!("the training is not drawn: {reason}"));
            Vec::new()
        }
    };
    // Nothing stands beside a model that goes through a pipe.
    if is_regular_or_missing(out) {
        for figure in &figures {
            write_atomically(&plot_path(out, figure), &figure.svg)?;
        }
    }
    Ok(figures)
}

fn plot_path(out: &Path, figure: &TrainingFigure) -> PathBuf {
    out.with_extension(format!("{}.svg", figure.name))
}

/// Where the figures are, by name, for the command's answer.
pub(super) fn figure_paths(out: &Path, figures: &[TrainingFigure]) -> Value {
    let path = |figure: &TrainingFigure| plot_path(out, figure).display().to_string().into();
    let drawn = figures.iter().filter(|_| is_regular_or_missing(out));
    Value::Object(drawn.map(|figure| (figure.name.to_owned(), path(figure))).collect())
}

/// The answer as the calibration page gets it, with the figures themselves.
pub(super) fn result_for_page(answer: &Value, figures: &[TrainingFigure]) -> Value {
    let shown = |figure: &TrainingFigure| json!({"title": figure.title, "caption": figure.caption, "drawing": figure.inline_svg});
    let mut answer = answer.clone();
    answer["figures"] = figures.iter().map(shown).collect();
    answer
}

/// What a process makes of the recordings, for the terminal; empty of another decoder.
pub(super) fn process_text(evaluation: Option<&Evaluation>) -> String {
    let Some(evaluation) = evaluation else { return String::new() };
    let mut text = format!(
        "\nthe process itself, leaving one repetition out: {:.1} % of {} windows\n",
        100.0 * evaluation.accuracy,
        evaluation.windows
    );
    for DriveScore { drive, r2, mean_absolute_error } in &evaluation.drives {
        text += &format!("  {drive}: R2 {:.3}, mean absolute error {mean_absolute_error:.3}\n", Number(*r2));
    }
    text + "what is said above of the recordings is by lda or ridge on the same features"
}

pub(super) fn print_training_result(object: &Value, json: bool) -> Result<(), Box<dyn Error>> {
    if json {
        print_result_json(object)?;
    } else if let Some(text) = object["verdict"].as_str() {
        print_result(format_args!("{text}; it is in {}", object["model"].as_str().unwrap_or_default()))?;
    } else {
        print_result(format_args!("the model is in {}", object["model"].as_str().unwrap_or_default()))?;
    }
    Ok(())
}
