//! `proact analyze`: numbers from recorded trials.

use crate::progress::bar;
use clap::Args;
use proact_app::{answer, intent_scores};
use proact_control::MethodRegistry;
use proact_intent::IntentOptions;
use std::{
    error::Error,
    fs,
    path::{Path, PathBuf},
};

/// Arguments of `proact analyze`.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  proact analyze trials --intent\n  \
    proact analyze trials/D-seated-seed1 --intent --json\n\n\
    A pick lasts from the start of the trial, or a release, until a block is attached: that block is what was meant. \
    Every model gets the recorded gaze and the recomputed places of the blocks. Exit code 0 only if every trial could \
    be used.")]
pub(crate) struct AnalyzeArgs {
    /// Trial directory, or a folder of trial directories
    dir: PathBuf,
    /// Score the models of intent: loss, calibration, time to correct
    #[arg(long)]
    intent: bool,
    /// Options of the models, as TOML such as "sigma = 0.03"; by default each trial's own and the models' defaults
    #[arg(long, value_name = "FILE")]
    options: Option<PathBuf>,
    /// One JSON object on standard output
    #[arg(long)]
    json: bool,
}

/// Runs the command; true if every trial could be used.
///
/// # Errors
/// No trial there, none of use, unreadable options.
pub(crate) fn command(methods: &MethodRegistry, args: &AnalyzeArgs) -> Result<bool, Box<dyn Error>> {
    if !args.intent {
        return Err("say what to analyze: --intent is what there is".into());
    }
    let options = args.options.as_deref().map(read_options).transpose()?;
    let bar = bar(!args.json, 0, "{elapsed} {bar:40} {pos} of {len} trials  {msg}");
    let report = intent_scores::intent(methods, &args.dir, options.as_ref(), |done, all, dir| {
        bar.set_length(all as u64);
        bar.set_position(done as u64);
        bar.set_message(dir.display().to_string());
    })?;
    bar.finish_and_clear();
    if args.json {
        answer(serde_json::to_string(&report)?)?;
    } else {
        answer(report.to_string().trim_end())?;
    }
    Ok(report.skipped.is_empty())
}

fn read_options(path: &Path) -> Result<IntentOptions, Box<dyn Error>> {
    let named = |error: &dyn Error| format!("options of the intent models, {}: {error}", path.display());
    let text = fs::File::open(path)
        .and_then(|file| proact_types::read_text(file, proact_types::MOST_TEXT_BYTES))
        .map_err(|e| named(&e))?;
    let options: IntentOptions = toml::from_str(&text).map_err(|e| named(&e))?;
    options.check().map_err(|e| named(&e))?;
    Ok(options)
}
