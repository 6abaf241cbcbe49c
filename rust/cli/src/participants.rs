//! `proact participants`: the simulated people, fitted to the paper's method A, and what follows from that for the others.

use crate::{
    batch_args::processor_count, interrupt::interrupt_flag, progress::progress_bar, study::worker_command,
};
use clap::{Args, Subcommand};
use proact_app::{
    Registry,
    batch::SIMULATED_DISCLAIMER,
    fit::{
        FITTED_METHOD, FitOptions, FitTarget, MethodPrediction, PARAMETERS, StudyPrediction, StudyScores,
        fit, master_seeds, population_at_start, predict,
    },
    paper::PaperResults,
    print_result, print_result_json, print_status,
};
use proact_files::{make_folder, write_atomically};
use proact_participants::Population;
use proact_types::Number;
use serde_json::json;
use std::{error::Error, fs, path::PathBuf};

/// What to do with the simulated people.
#[derive(Debug, Subcommand)]
pub(crate) enum ParticipantsCommand {
    /// Fit the population to what the paper prints of method A of its first study, and of nothing else
    #[command(after_help = "Example:\n  proact participants fit --out fit\n\n\
        Each evaluation is the paper's trials with method A, without physics, always with the same random numbers. The folder has \
        a line for each in journal.jsonl, as it ends: the same command goes on where it was cut off. The values that are found are \
        in fitted.toml; those that ship are in rust/participants/data/population.toml. Simulated participants are no evidence about \
        people.")]
    Fit(FitArgs),
    /// Predict the paper's first study by the people that ship, beside what the paper prints
    #[command(after_help = "Example:\n  proact participants predict --out prediction\n\n\
        Without --master-seeds, the three master seeds follow from a hash of the population: nobody can have fitted it to them. The first \
        --full-physics of them are run with physics and planner, and all of them without. What was run is in the folder, a study a file, and is \
        not run again. Simulated participants are no evidence about people.")]
    Predict(PredictArgs),
}

/// Arguments of `proact participants fit`.
#[derive(Debug, Args)]
pub(crate) struct FitArgs {
    /// Folder of the fit
    #[arg(long, value_name = "DIR", default_value = "fit")]
    out: PathBuf,
    /// People of each evaluation, with three trials each
    #[arg(long, value_name = "N", default_value_t = 12, value_parser = clap::value_parser!(u32).range(8..=1000))]
    participants: u32,
    /// Evaluations at most
    #[arg(long, value_name = "N", default_value_t = 24, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    evaluations: u32,
    /// So many trials at once; by default one a processor
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=256))]
    jobs: Option<u16>,
    /// One JSON object on standard output
    #[arg(long)]
    json: bool,
}

/// Arguments of `proact participants predict`.
#[derive(Debug, Args)]
pub(crate) struct PredictArgs {
    /// Folder for what is run
    #[arg(long, value_name = "DIR", default_value = "prediction")]
    out: PathBuf,
    /// People of each study
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u32).range(2..=1000))]
    participants: u32,
    /// Of the seeds, so many with physics and planner
    #[arg(long, value_name = "N", default_value_t = 2)]
    full_physics: usize,
    /// Master seeds, with commas between; by default three that follow from a hash of the population
    #[arg(long, value_name = "N", value_delimiter = ',')]
    master_seeds: Vec<u64>,
    /// So many trials at once; by default one a processor
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=256))]
    jobs: Option<u16>,
    /// One JSON object on standard output
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(registry: &Registry, command: &ParticipantsCommand) -> Result<bool, Box<dyn Error>> {
    match command {
        ParticipantsCommand::Fit(args) => fit_people(registry, args),
        ParticipantsCommand::Predict(args) => predict_paper(registry, args),
    }
}

fn job_count(jobs: Option<u16>) -> usize {
    jobs.map_or_else(processor_count, usize::from)
}

fn fit_people(registry: &Registry, args: &FitArgs) -> Result<bool, Box<dyn Error>> {
    let interrupted = interrupt_flag()?;
    let (participants, evaluations) = (args.participants as usize, args.evaluations as usize);
    let options =
        FitOptions { participants, evaluations, jobs: job_count(args.jobs), interrupted: &interrupted };
    let each = PaperResults::shipped().study1.trials_each;
    let template = "{elapsed} {bar:40} {pos} of at most {len} trials, {eta} left at most  {msg}";
    let progress = progress_bar(!args.json, (participants * each * evaluations) as u64, template);
    let show_progress = |trials: usize, best: Option<f64>| {
        progress.inc(trials as u64);
        if let Some(best) = best {
            progress.set_message(format!("objective {best:.4}"));
        }
    };
    let fitted =
        fit(registry, &population_at_start(&Population::standard()), &args.out, &options, &show_progress)?;
    progress.finish_and_clear();
    let Some(fitted) = fitted else {
        print_status(format_args!("interrupted; the same command goes on in {}", args.out.display()));
        return Ok(false);
    };
    let path = args.out.join("fitted.toml");
    write_atomically(&path, &toml::to_string(&fitted.population)?)?;
    let values = PARAMETERS.iter().zip(&fitted.values);
    if args.json {
        let values: serde_json::Map<_, _> =
            values.map(|(own, value)| (own.name.to_owned(), json!(value))).collect();
        let object = json!({ "values": values, "counts": fitted.counts, "distance": fitted.distance,
            "evaluations": fitted.evaluations, "population": path, "note": SIMULATED_DISCLAIMER });
        print_result_json(&object)?;
        return Ok(true);
    }
    for (own, value) in values {
        print_result(format_args!("{:28} {value}", own.name))?;
    }
    let target = FitTarget::from_paper(&PaperResults::shipped());
    print_result(format_args!(
        "method {FITTED_METHOD}: trials with 0, 1, ... blocks {:?}, {:.3} off the paper's shares, after {} evaluations; in {}",
        fitted.counts,
        target.distance(&fitted.counts),
        fitted.evaluations,
        path.display()
    ))?;
    print_result(SIMULATED_DISCLAIMER)?;
    Ok(true)
}

fn predict_paper(registry: &Registry, args: &PredictArgs) -> Result<bool, Box<dyn Error>> {
    let interrupted = interrupt_flag()?;
    let population = Population::standard();
    let seeds = if args.master_seeds.is_empty() {
        master_seeds(&population)?.to_vec()
    } else {
        args.master_seeds.clone()
    };
    make_folder(&args.out)?;
    let people = args.participants as usize;
    let mut plan: Vec<(u64, bool)> = seeds.iter().take(args.full_physics).map(|seed| (*seed, true)).collect();
    plan.extend(seeds.iter().map(|seed| (*seed, false)));
    let each = people * 4 * PaperResults::shipped().study1.trials_each;
    let template = "{elapsed} {bar:40} {pos} of {len} trials, {eta} left  {msg}";
    let progress = progress_bar(!args.json, (each * plan.len()) as u64, template);
    let mut studies = Vec::new();
    for (seed, whole) in plan {
        let chain = if whole { "whole" } else { "kinematic" };
        progress.set_message(format!("seed {seed}, {chain}"));
        let path = args.out.join(format!("study-{seed}-{people}-{chain}.json"));
        if let Ok(text) = fs::read_to_string(&path) {
            progress.inc(each as u64);
            studies.push(
                serde_json::from_str::<StudyScores>(&text)
                    .map_err(|error| format!("{}: {error}", path.display()))?,
            );
            continue;
        }
        let worker: Option<&(dyn Fn() -> std::process::Command + Sync)> =
            if whole { Some(&worker_command) } else { None };
        let ended = || progress.inc(1);
        let study =
            StudyScores::run(registry, (people, seed), worker, job_count(args.jobs), &interrupted, &ended)?;
        let Some(study) = study else {
            print_status(format_args!("interrupted; what is whole of {} stays", args.out.display()));
            return Ok(false);
        };
        write_atomically(&path, &serde_json::to_string(&study)?)?;
        studies.push(study);
    }
    progress.finish_and_clear();
    let (whole, kinematic): (Vec<StudyScores>, Vec<StudyScores>) =
        studies.into_iter().partition(|study| study.full_physics);
    let both = [("whole chain", whole), ("without physics", kinematic)];
    let predicted: Vec<(&str, Vec<u64>, StudyPrediction)> = both
        .iter()
        .filter(|(_, studies)| !studies.is_empty())
        .map(|(name, studies)| (*name, studies.iter().map(|study| study.seed).collect(), predict(studies)))
        .collect();
    if args.json {
        let tables: Vec<_> = predicted
            .iter()
            .map(|(chain, seeds, prediction)| json!({ "chain": chain, "seeds": seeds, "prediction": prediction }))
            .collect();
        print_result_json(
            &json!({ "participants": people, "predictions": tables, "note": SIMULATED_DISCLAIMER }),
        )?;
        return Ok(true);
    }
    for (chain, seeds, prediction) in &predicted {
        print_result(format_args!(
            "{chain}, seeds {seeds:?}, {people} people each\n\n{}",
            table(prediction)
        ))?;
    }
    print_result(SIMULATED_DISCLAIMER)?;
    Ok(true)
}

/// A prediction as a table of Markdown.
fn table(prediction: &StudyPrediction) -> String {
    let row = |own: &MethodPrediction| {
        let MethodPrediction {
            method,
            fitted,
            trials,
            mean,
            sd,
            min,
            max,
            zero_fraction: none,
            full_fraction: all,
            distance,
            ..
        } = own;
        let role = if *fitted { "fitted" } else { "predicted" };
        let percent = |[own, low, high]: &[f64; 3]| {
            format!("{:.0} ({:.0} to {:.0})", own * 100.0, low * 100.0, high * 100.0)
        };
        format!(
            "| {method} | {role} | {trials} | {:.2} ({:.2}) | {:+.2} | {:.2} ({:.2}) | {} to {} ({} to {}) | {} | {} | {:.2} to {:.2} |\n",
            mean[0],
            mean[1],
            Number(mean[0] - mean[1]),
            sd[0],
            sd[1],
            min[0],
            max[0],
            min[1],
            max[1],
            percent(none),
            percent(all),
            distance[0],
            distance[1]
        )
    };
    let rows: String = prediction.methods.iter().map(row).collect();
    format!(
        "| method | | trials | mean (paper) | gap | sd (paper) | range (paper) | % none (paper) | % all (paper) | Kolmogorov distance |\n\
         |---|---|---|---|---|---|---|---|---|---|\n{rows}\n\
         C and D above A and B: in {:.0} % of the studies as run, in {:.0} % of studies of eight drawn from their people; under the \
         paper's own counts in {:.0} %.\n",
        prediction.order_fraction_simulated * 100.0,
        prediction.order_fraction_bootstrap * 100.0,
        prediction.order_fraction_paper * 100.0
    )
}
