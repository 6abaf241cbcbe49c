//! `proact simulate`: many trials with simulated participants, in figures.

use crate::{interrupt::interrupt_flag, progress::bar, study::worker_command};
use clap::Args;
use proact_app::{
    Registry, answer,
    study::{ConditionSummary, Study, TrialOrder, simulate},
};
use proact_study::TrialChoice;
use proact_tasks::DEFAULT_TASK;
use serde_json::{Map, Value, json};
use std::{error::Error, path::PathBuf, sync::atomic::Ordering, time::Instant};

/// Arguments of `proact simulate`.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  proact simulate\n  proact simulate --methods C,D --seeds 20 --json\n  \
    proact simulate pilot\n\n\
    Simulated participants say nothing about people. With a study, all trials of its plan are run as `study run --simulated` runs \
    them, and nothing is kept but these figures.")]
pub(crate) struct SimulateArgs {
    /// Folder or plan of a study, whose trials are run
    #[arg(value_name = "PLAN", conflicts_with_all = ["methods", "seeds", "task", "arm", "setup", "profile", "limit", "set"])]
    plan: Option<PathBuf>,
    /// Methods to compare
    #[arg(long, value_name = "NAMES", value_delimiter = ',', default_value = "A,B,C,D")]
    methods: Vec<String>,
    /// Trials of each method, with the seeds from 1 on
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = clap::value_parser!(u64).range(1..=100_000))]
    seeds: u64,
    /// The task: a name, or a file that describes one
    #[arg(long, value_name = "NAME|FILE", default_value = DEFAULT_TASK)]
    task: String,
    /// The arm: a name, or a folder
    #[arg(long, value_name = "NAME|FOLDER")]
    arm: Option<String>,
    /// Where person and box are
    #[arg(long, default_value = "seated")]
    setup: String,
    /// How the methods behave
    #[arg(long)]
    profile: Option<String>,
    /// Seconds after which a trial ends
    #[arg(long, value_name = "SECONDS")]
    limit: Option<f64>,
    /// Another value of the trial configuration; may be repeated
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// So many trials at once; by default one a processor
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=256))]
    jobs: Option<u16>,
    /// One JSON object on standard output
    #[arg(long)]
    json: bool,
}

/// How many programs this machine runs at once.
pub(crate) fn processors() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}

pub(crate) fn command(registry: &Registry, args: &SimulateArgs) -> Result<bool, Box<dyn Error>> {
    let interrupted = interrupt_flag()?;
    let start = Instant::now();
    let ordered = match &args.plan {
        Some(plan) => of_plan(&Study::open(plan, &registry.methods)?),
        None => of_methods(args),
    };
    let (conditions, orders): (Vec<String>, Vec<TrialOrder>) = ordered.into_iter().unzip();
    let progress =
        bar(!args.json, orders.len() as u64, "{elapsed} {bar:40} {pos} of {len} trials, {eta} left  {msg}");
    let jobs = args.jobs.map_or_else(processors, usize::from);
    let results = simulate(&orders, jobs, &worker_command, &interrupted, |index, result| {
        progress.set_message(format!("{}: {} {}", conditions[index], result.score, result.score_name));
        progress.inc(1);
    })?;
    progress.finish_and_clear();
    let summaries = ConditionSummary::of(&conditions, &results);
    if args.json {
        let mut methods = Map::new();
        for summary in &summaries {
            methods.insert(summary.condition.clone(), serde_json::to_value(summary)?);
        }
        let digests: Vec<&str> = results.iter().map(|(_, result)| result.digest.as_str()).collect();
        let mut seeds: Vec<u64> = results.iter().map(|(_, result)| result.seed).collect();
        seeds.sort_unstable();
        seeds.dedup();
        let object = json!({ "methods": Value::Object(methods), "seeds": seeds, "digests": digests, "jobs": jobs,
            "wall_seconds": start.elapsed().as_secs_f64() });
        answer(object.to_string())?;
    } else {
        answer("         mean    sd   min median   max  trials")?;
        for ConditionSummary { condition, score_name, scores } in &summaries {
            let sd = scores.sd.map_or("    -".to_owned(), |sd| format!("{sd:5.2}"));
            answer(format_args!(
                "{condition:6} {:6.2} {sd} {:5.1} {:6.1} {:5.1} {:7}  {score_name}",
                scores.mean, scores.min, scores.median, scores.max, scores.trials
            ))?;
        }
        answer(format_args!("simulated participants, in {:.0} s", start.elapsed().as_secs_f64()))?;
    }
    Ok(!interrupted.load(Ordering::Relaxed))
}

fn of_plan(study: &Study) -> Vec<(String, TrialOrder)> {
    study.schedule.trials().map(|trial| (trial.condition.clone(), study.order(trial, None))).collect()
}

fn of_methods(args: &SimulateArgs) -> Vec<(String, TrialOrder)> {
    let mut orders = Vec::new();
    for method in &args.methods {
        for seed in 1..=args.seeds {
            let choice = TrialChoice {
                method: Some(method.clone()),
                task: Some(args.task.clone()),
                arm: args.arm.clone(),
                setup: Some(args.setup.clone()),
                profile: args.profile.clone(),
                limit_secs: args.limit,
                set: args.set.clone(),
            };
            let order = TrialOrder { choice, seed, arrangement: None, dir: None, bag: String::new() };
            orders.push((method.clone(), order));
        }
    }
    orders
}
