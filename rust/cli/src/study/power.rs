//! `proact study power`.

use crate::progress::progress_bar;
use clap::Args;
use proact_app::{
    analysis::collect_analysis_data,
    print_result, print_result_json,
    study::{self, PowerAtSampleSize, PowerOptions, Study},
};
use proact_control::MethodRegistry;
use proact_files::{check_output, write_atomically};
use proact_types::Number;
use serde_json::json;
use std::{error::Error, path::PathBuf};

/// Arguments of `proact study power`.
#[derive(Debug, Args)]
pub struct PowerArgs {
    /// Folder of the study, or its plan
    #[arg(value_name = "PLAN")]
    study: PathBuf,
    /// What is expected of each condition, as TOML (docs/studies.md)
    #[arg(long, value_name = "FILE", required_unless_present = "pilot")]
    effect: Option<PathBuf>,
    /// A pilot, recorded or simulated: a study, trials, or exported tables, whose people are drawn again
    #[arg(long, value_name = "DIR", conflicts_with = "effect")]
    pilot: Option<PathBuf>,
    /// The pilot's measure: a column of its table of trials
    #[arg(long, value_name = "COLUMN", default_value = "score", requires = "pilot")]
    measure: String,
    /// Numbers of people
    #[arg(long, value_name = "N,N", value_delimiter = ',', default_value = "4,6,8,12,16,24",
          value_parser = clap::value_parser!(u16).range(2..=200))]
    participants: Vec<u16>,
    /// A chance below this is a difference
    #[arg(long, value_name = "P", default_value_t = 0.05)]
    alpha: f64,
    /// Chance of a person to leave before the end
    #[arg(long, default_value_t = 0.0)]
    dropout: f64,
    /// Simulated studies for each number
    #[arg(long, default_value_t = 2000, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    runs: u32,
    /// Of all that is drawn
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// The curve as a figure: FILE.svg and FILE.png
    #[arg(long, value_name = "FILE")]
    figure: Option<PathBuf>,
}

pub(super) fn command(methods: &MethodRegistry, args: &PowerArgs, json: bool) -> Result<(), Box<dyn Error>> {
    if let Some(file) = &args.figure {
        for ending in ["svg", "png"] {
            check_output(&file.with_extension(ending))?;
        }
    }
    let study = Study::open(&args.study, methods)?;
    let scores = match (&args.effect, &args.pilot) {
        (Some(file), _) => study::read_expected_effect(file)?,
        (None, Some(dir)) => {
            let cores = std::thread::available_parallelism().map_or(1, usize::from);
            study::pilot_scores(
                &study,
                &collect_analysis_data(methods, dir, cores, &|_, _| {})?,
                &args.measure,
            )?
        }
        (None, None) => return Err("say what is expected with --effect FILE or --pilot DIR".into()),
    };
    let sizes: Vec<usize> = args.participants.iter().map(|people| usize::from(*people)).collect();
    let options = PowerOptions {
        runs: args.runs,
        alpha: args.alpha,
        dropout_probability: args.dropout,
        seed: args.seed,
    };
    let bar = progress_bar(!json, sizes.len() as u64, "{elapsed} {bar:40} {msg}");
    let found = study::power_by_size(&study, &scores, &sizes, &options, |people| {
        bar.inc(1);
        bar.set_message(format!("{people} people"));
    })?;
    bar.finish_and_clear();
    if let Some(file) = &args.figure {
        let (svg, png) = study::power_figure(&found)?;
        write_atomically(&file.with_extension("svg"), &svg)?;
        write_atomically(&file.with_extension("png"), png)?;
    }
    if json {
        return Ok(print_result_json(&json!({ "conditions": study.conditions(), "power": found }))?);
    }
    table(&study, &found, &options)
}

fn table(study: &Study, found: &[PowerAtSampleSize], options: &PowerOptions) -> Result<(), Box<dyn Error>> {
    let Some(first) = found.first() else { return Ok(()) };
    let mut head = format!("{:>6}", "people");
    if first.power.any_difference.is_some() {
        head += &format!("{:>12}", "any");
    }
    first.power.pairs.iter().for_each(|(a, b, _)| head += &format!("{:>12}", format!("{a} and {b}")));
    print_result(head)?;
    for PowerAtSampleSize { participants: people, power } in found {
        let shares = power.any_difference.iter().chain(power.pairs.iter().map(|(.., share)| share));
        let cells: String = shares.map(|share| format!("{:>12.2}", share.value)).collect();
        print_result(format_args!("{people:>6}{cells}"))?;
    }
    let means = study.conditions().into_iter().zip(&first.power.means);
    let means: Vec<String> = means.map(|(name, mean)| format!("{name} {:.2}", Number(*mean))).collect();
    print_result(format_args!(
        "Chance to find a difference at p <= {} in {} simulated studies each (Friedman; Wilcoxon, Holm over pairs). Means of their \
         scores: {}.",
        options.alpha,
        options.runs,
        means.join(", ")
    ))?;
    Ok(())
}
