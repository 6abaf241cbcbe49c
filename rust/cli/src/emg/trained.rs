//! What comes of a training beside the model: what a process makes of it, its figures, and what is answered.

use proact_app::{
    analysis::{TrainingFigure, training_figures},
    answer, tell,
};
use proact_devices::{DeviceError, Evaluation, Recording, Recordings, leave_one_out, train_process};
use proact_emg::{CalibrationReport, DriveScore, EmgConfig, EmgModel, Repetition, feature_space};
use proact_files::{is_replaced, write_whole};
use proact_types::{EmgSample, GestureName};
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
pub(super) fn decoded(
    config: &EmgConfig,
    model: EmgModel,
    repetitions: &[Repetition],
) -> Result<(EmgModel, Option<Evaluation>), Box<dyn Error>> {
    if !config.classifier.is_process() {
        return Ok((model, None));
    }
    let judged = match leave_one_out(&centred(&model, repetitions), config) {
        // One round cannot be judged, and is learnt from all the same.
        Err(DeviceError::NoRepetitions { .. }) => None,
        judged => Some(judged?),
    };
    let slices: Vec<(GestureName, &[EmgSample])> =
        repetitions.iter().map(|r| (r.gesture, r.samples.as_slice())).collect();
    Ok((train_process(config, model, &slices)?, judged))
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
        imu: model.config.imu.channels.clone(),
        expected: model.classifier.gestures().to_vec(),
        rest: model.config.rest,
        items,
        notes: Vec::new(),
    }
}

/// Draws the confusion, of the process if one decodes, and the feature space, and writes them beside the model at `out`, as
/// `NAME.confusion.svg` and `NAME.feature_space.svg`. What cannot be drawn is told: the model is written all the same.
///
/// # Errors
/// A disk that refuses.
pub(super) fn draw(
    out: &Path,
    model: &EmgModel,
    repetitions: &[Repetition],
    report: Option<&CalibrationReport>,
    process: Option<&Evaluation>,
) -> Result<Vec<TrainingFigure>, Box<dyn Error>> {
    let slices: Vec<(GestureName, &[EmgSample])> =
        repetitions.iter().map(|r| (r.gesture, r.samples.as_slice())).collect();
    let own = report.map(|report| (report.classes.as_slice(), report.confusion.as_slice()));
    let judged = process.map(|judged| (judged.classes.as_slice(), judged.confusion.as_slice())).or(own);
    let figures = feature_space(model, &slices)
        .map_err(|error| error.to_string())
        .and_then(|space| training_figures(judged, &space).map_err(|error| error.to_string()));
    let figures = match figures {
        Ok(figures) => figures,
        Err(reason) => {
            tell(format_args!("the training is not drawn: {reason}"));
            Vec::new()
        }
    };
    // Nothing stands beside a model that goes through a pipe.
    if is_replaced(out) {
        for figure in &figures {
            write_whole(&plot_path(out, figure), &figure.svg)?;
        }
    }
    Ok(figures)
}

fn plot_path(out: &Path, figure: &TrainingFigure) -> PathBuf {
    out.with_extension(format!("{}.svg", figure.name))
}

/// Where the figures are, by name, for the command's answer.
pub(super) fn plots(out: &Path, figures: &[TrainingFigure]) -> Value {
    let path = |figure: &TrainingFigure| plot_path(out, figure).display().to_string().into();
    let drawn = figures.iter().filter(|_| is_replaced(out));
    Value::Object(drawn.map(|figure| (figure.name.to_owned(), path(figure))).collect())
}

/// The answer as the calibration page gets it, with the figures themselves.
pub(super) fn on_page(answer: &Value, figures: &[TrainingFigure]) -> Value {
    let shown = |figure: &TrainingFigure| json!({"title": figure.title, "caption": figure.caption, "drawing": figure.drawing});
    let mut answer = answer.clone();
    answer["figures"] = figures.iter().map(shown).collect();
    answer
}

/// What a process makes of the recordings, for the terminal; empty of another decoder.
pub(super) fn process_text(judged: Option<&Evaluation>) -> String {
    let Some(judged) = judged else { return String::new() };
    let mut text = format!(
        "\nthe process itself, leaving one repetition out: {:.1} % of {} windows\n",
        100.0 * judged.accuracy,
        judged.windows
    );
    for DriveScore { drive, r2, mean_absolute_error } in &judged.drives {
        text += &format!("  {drive}: R2 {r2:.3}, mean absolute error {mean_absolute_error:.3}\n");
    }
    text + "what is said above of the recordings is by lda or ridge on the same features"
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
