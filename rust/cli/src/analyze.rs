//! `proact analyze`: tables, figures and statistics of whatever was recorded.

use crate::{
    announce::announce,
    interrupt::{interrupt_flag, wait_for_interrupt},
    progress::progress_bar,
};
use clap::Args;
use proact_app::{
    analysis::{self, ReportLibrary, ReportOptions},
    intent_scores, print_result, print_result_json, print_status,
};
use proact_bridge::{PageOptions, PageServer, TrialLibrary};
use proact_control::MethodRegistry;
use proact_intent::IntentOptions;
use proact_types::renamed_keys::{ConfigFile, rename_keys_in_toml};
use serde_json::json;
use std::{
    error::Error,
    fs,
    path::{Path, PathBuf},
    sync::Arc,
};

/// Arguments of `proact analyze`.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  proact analyze mystudy\n  proact analyze trials --out report\n  \
    proact analyze bags/participant1-mode4-trial2.bag\n  proact analyze mystudy --page\n  \
    proact analyze trials --intent --json\n\n\
    Takes a study, a folder of recorded trials, bags of the original lab, or tables of an export. Writes report.html, which needs \
    no network, every figure as SVG and PNG, every table as CSV and LaTeX. docs/analysis.md defines each figure.\n\n\
    With --intent a pick lasts from the start of the trial, or a release, until a block is attached: that block is what was meant. \
    Every model gets the recorded gaze and the recomputed places of the blocks; exit code 0 only if every trial could be used.")]
pub(crate) struct AnalyzeArgs {
    /// Study, trial, folder of trials or of bags, bag, or folder of exported tables
    dir: PathBuf,
    /// Folder for the report; by default analysis in the folder, or beside a trial or bag
    #[arg(long, value_name = "DIR", conflicts_with = "intent")]
    out: Option<PathBuf>,
    /// Trials that are scored at once; by default as many as there are processors
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=256), conflicts_with = "intent")]
    jobs: Option<u16>,
    /// Seed of bootstraps and drawn permutations
    #[arg(long, default_value_t = 1, conflicts_with = "intent")]
    seed: u64,
    /// Score the models of intent instead: loss, calibration, time to correct
    #[arg(long)]
    intent: bool,
    /// Options of the models, as TOML such as "gaze_sigma = 0.03"; by default each trial's own and the models' defaults
    #[arg(long, value_name = "FILE", requires = "intent")]
    intent_options: Option<PathBuf>,
    /// One JSON object on standard output
    #[arg(long)]
    json: bool,
    /// Then look at the report in the browser, where each trial links to its replay
    #[arg(long, conflicts_with_all = ["json", "intent"])]
    page: bool,
    /// Port of the page; the next free one if it is taken
    #[arg(long, default_value_t = 8090, requires = "page")]
    port: u16,
    /// Print the address of the page, open nothing
    #[arg(long, requires = "page")]
    no_browser: bool,
}

/// Runs the command; true if all went well, with --intent if every trial could be used.
///
/// # Errors
/// Nothing to analyse there, a folder that is somebody else's, unreadable options.
pub(crate) fn command(methods: &MethodRegistry, args: &AnalyzeArgs) -> Result<bool, Box<dyn Error>> {
    if args.intent { intent(methods, args) } else { report(methods, args).map(|()| true) }
}

fn report(methods: &MethodRegistry, args: &AnalyzeArgs) -> Result<(), Box<dyn Error>> {
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let jobs = args.jobs.map_or(cores, usize::from);
    let scoring = progress_bar(!args.json, 0, "{elapsed} {bar:40} {pos} of {len} trials scored");
    scoring.enable_steady_tick(std::time::Duration::from_millis(500));
    let out = args.out.clone().unwrap_or_else(|| analysis::report_folder(&args.dir));
    analysis::check_report_folder(&out)?;
    let collected = analysis::collect_analysis_data(methods, &args.dir, jobs, &|done, all| {
        scoring.set_length(all as u64);
        scoring.set_position(done as u64);
    })?;
    scoring.finish_and_clear();
    let drawing = progress_bar(!args.json, 0, "{elapsed} {bar:40} {pos} of {len} figures");
    let written = analysis::report(
        &collected,
        &ReportOptions { out, seed: args.seed, leader_board: false },
        |done, all| {
            drawing.set_length(all as u64);
            drawing.set_position(done as u64);
        },
    )?;
    drawing.finish_and_clear();
    if args.json {
        let object = json!({
            "tables": written.tables, "figures": written.figures, "report": written.page, "notes": written.notes,
            "faults": collected.implausible_cells,
        });
        return Ok(print_result_json(&object)?);
    }
    written.notes.iter().for_each(print_status);
    print_result(format_args!(
        "{} tables and {} figures of {} trials; open {}",
        written.tables.len(),
        written.figures.len(),
        collected.tables["trials"].rows.len(),
        written.page.display()
    ))?;
    match args.page {
        true => serve_report(args, ReportLibrary::new(methods, &collected, written)?),
        false => Ok(()),
    }
}

/// Serves the report and the replays of its trials until Ctrl-C.
fn serve_report(args: &AnalyzeArgs, library: ReportLibrary) -> Result<(), Box<dyn Error>> {
    // Any trial that can be shown has the arm and the scene that a page wants to begin with.
    let mut refusals = Vec::new();
    let content = (0..library.list().len()).find_map(|number| match library.trial(number) {
        Ok(trial) => Some(trial.content),
        Err(refusal) => {
            refusals.push(refusal);
            None
        }
    });
    let content = content.ok_or_else(|| format!("no trial can be replayed:\n  {}", refusals.join("\n  ")))?;
    let server = PageServer::start(PageOptions { port: args.port, ..PageOptions::default() }, content)?;
    server.set_trials(Arc::new(library))?;
    announce(&server, "report", !args.no_browser, false);
    wait_for_interrupt(&*interrupt_flag()?);
    Ok(())
}

fn intent(methods: &MethodRegistry, args: &AnalyzeArgs) -> Result<bool, Box<dyn Error>> {
    let options = args.intent_options.as_deref().map(read_options).transpose()?;
    let bar = progress_bar(!args.json, 0, "{elapsed} {bar:40} {pos} of {len} trials  {msg}");
    let report =
        intent_scores::score_intent_models(methods, &args.dir, options.as_ref(), |done, all, dir| {
            bar.set_length(all as u64);
            bar.set_position(done as u64);
            bar.set_message(dir.display().to_string());
        })?;
    bar.finish_and_clear();
    if args.json {
        print_result_json(&report)?;
    } else {
        print_result(report.to_string().trim_end())?;
    }
    Ok(report.skipped.is_empty())
}

fn read_options(path: &Path) -> Result<IntentOptions, Box<dyn Error>> {
    let named = |error: &dyn Error| format!("options of the intent models, {}: {error}", path.display());
    let text = fs::File::open(path)
        .and_then(|file| proact_types::read_text(file, proact_types::MAX_TEXT_BYTES))
        .map_err(|e| named(&e))?;
    let (text, renamed) = rename_keys_in_toml(&text, ConfigFile::Trial, "intent").map_err(|e| named(&e))?;
    proact_app::warn_of_renamed_keys(&renamed);
    let options: IntentOptions = toml::from_str(&text).map_err(|e| named(&e))?;
    options.check().map_err(|e| named(&e))?;
    Ok(options)
}
