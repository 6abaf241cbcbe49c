//! `proact simulate`: many trials with simulated participants, in figures.

use crate::{
    batch_args::{BatchArgs, BatchOutcome, BatchTrialArgs},
    interrupt::interrupt_flag,
};
use clap::Args;
use proact_app::{
    Registry,
    analysis::{SweepReport, sweep_report},
    batch::{
        Batch, BatchFolder, ConditionSummary, MergedBatch, MethodsBatch, SIMULATED_DISCLAIMER, Sweep,
        merge_shards,
    },
    print_result, print_result_json,
    study::Study,
};
use proact_types::Number;
use serde_json::{Map, Value, json};
use std::{
    error::Error,
    path::{Path, PathBuf},
    time::Instant,
};

/// Trials of each method where nobody says how many.
const DEFAULT_SEED_COUNT: usize = 5;

/// Arguments of `proact simulate`.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  proact simulate\n  proact simulate --methods C,D --seeds 20 --json\n  \
    proact simulate study1 --participants 100 --out night\n  proact simulate study1 --participants 100 --out night --shard 2/4\n  \
    proact simulate --merge night\n  proact simulate study1 --participants 1000 --out night --slurm=50 --sbatch-option --time=4:00:00\n  \
    proact simulate --methods C,D --sweep participant.gaze_error_deg=0,1.5,3 --sweep intent.gaze_sigma=0.01,0.03,0.1 \
    --out sweep\n\n\
    Simulated participants say nothing about people. Without --out nothing is kept but these figures. With it each trial is a line \
    on the disk as it ends, in DIR/shard-K-of-N.log; when all are there, trials.jsonl and the tables for proact analyze DIR follow, \
    the same byte for byte whatever ran beside what. docs/batches.md has the whole of it.")]
pub(crate) struct SimulateArgs {
    /// Plan, or folder, of a study whose trials are run; study1 and study2 are the paper's
    #[arg(value_name = "PLAN", conflicts_with_all = ["methods", "seeds", "trials", "task", "arm", "setup", "profile"])]
    plan: Option<PathBuf>,
    /// Methods to run, by name or by the file of an outside one
    #[arg(long, value_name = "NAMES", value_delimiter = ',', default_value = "A,B,C,D")]
    methods: Vec<String>,
    /// Trials of each method, with the seeds from --seed on: as many people, one trial each
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    seeds: Option<u32>,
    /// People; those of a plan by default
    #[arg(long, value_name = "N", conflicts_with = "seeds", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    participants: Option<u32>,
    /// Trials of each of them by each method
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=1000))]
    trials: u32,
    #[command(flatten)]
    trial: BatchTrialArgs,
    /// Values of a key that are run each, all with all if repeated; heat maps are drawn with --out
    #[arg(long, value_name = "KEY=VALUE,VALUE")]
    sweep: Vec<String>,
    /// Put the shards in a folder together, and run nothing
    #[arg(long, value_name = "DIR", exclusive = true)]
    merge: Option<PathBuf>,
    #[command(flatten)]
    batch: BatchArgs,
    /// One JSON object on standard output
    #[arg(long)]
    json: bool,
}

pub(crate) fn command(registry: &Registry, args: &SimulateArgs) -> Result<bool, Box<dyn Error>> {
    let start = Instant::now();
    if let Some(dir) = &args.merge {
        let folder = BatchFolder::open(dir)?;
        // Whatever is missing is an error: that is what was asked for.
        let merged = merge_shards(&folder, true)?.ok_or("not all trials are there")?;
        return print_folder_summary(args, &folder.dir, merged, start);
    }
    let interrupted = interrupt_flag()?;
    let sweep = Sweep::parse(&args.sweep)?;
    let batch = match &args.plan {
        Some(plan) => {
            let people = args.participants.map(|people| people as usize);
            let study = Study::open_with_participants(plan, &registry.methods, people, args.batch.seed)?;
            Batch::of_study(&study, &args.trial.plan_overrides(), args.batch.participant_kind, sweep)?
        }
        None => Batch::of_methods(&args.methods_batch(), args.batch.participant_kind, sweep)?,
    };
    match args.batch.run(registry, &batch, !args.json, &interrupted)? {
        BatchOutcome::Summed(summaries, digests) => {
            let mut seeds: Vec<u64> = (0..batch.count()).map(|index| batch.trial(index).seed).collect();
            seeds.sort_unstable();
            seeds.dedup();
            let more = json!({ "seeds": seeds, "digests": digests });
            print_summary(args, &summaries, more, start)
        }
        BatchOutcome::Merged(dir, merged) => print_folder_summary(args, &dir, *merged, start),
        BatchOutcome::Shard(dir, shard, trials) => {
            let text = format!(
                "all {trials} trials of shard {shard} are in {}; others are missing. The last shard puts all of them together, as does \
                 proact simulate --merge {0}. {SIMULATED_DISCLAIMER}",
                dir.display()
            );
            let object = json!({ "shard": shard.to_string(), "trials": trials, "out": dir, "merged": false, "note": SIMULATED_DISCLAIMER });
            if args.json {
                print_result_json(&object)?;
            } else {
                print_result(text)?;
            }
            Ok(true)
        }
        BatchOutcome::Submitted(script, number) => {
            let object = json!({ "script": script, "job": number, "note": SIMULATED_DISCLAIMER });
            let text = format!(
                "job {number} of Slurm, by {}; squeue --job {number} tells how far it is",
                script.display()
            );
            if args.json {
                print_result_json(&object)?;
            } else {
                print_result(text)?;
            }
            Ok(true)
        }
        BatchOutcome::Interrupted(dir) => {
            if let Some(dir) = dir {
                proact_app::print_status(format_args!(
                    "interrupted; the same command goes on in {}",
                    dir.display()
                ));
            }
            Ok(false)
        }
    }
}

impl SimulateArgs {
    fn methods_batch(&self) -> MethodsBatch {
        let people = self.seeds.or(self.participants).map_or(DEFAULT_SEED_COUNT, |people| people as usize);
        MethodsBatch {
            methods: self.methods.clone(),
            common: self.trial.trial_options(),
            participants: people,
            trials: self.trials as usize,
            seed: self.batch.seed.unwrap_or(1),
        }
    }
}

/// What a folder holds, and where; of a sweep with its report.
fn print_folder_summary(
    args: &SimulateArgs,
    dir: &Path,
    merged: MergedBatch,
    start: Instant,
) -> Result<bool, Box<dyn Error>> {
    let folder = BatchFolder::open(dir)?;
    let sweep = sweep_report(&folder, &merged)?;
    let mut more = json!({ "out": dir, "merged": true, "lines": merged.lines, "tables": merged.tables, "digests": merged.digests });
    if let (Some(SweepReport { page, figures, table }), Some(object)) = (&sweep, more.as_object_mut()) {
        object.insert("report".into(), json!(page));
        object.insert("figures".into(), json!(figures));
        object.insert("sweep".into(), json!(table));
    }
    let all_counted = print_summary(args, &merged.tally.summaries(), more, start)?;
    if !args.json {
        match sweep {
            Some(report) => {
                print_result(format_args!("tables and heat maps: open {}", report.page.display()))?
            }
            None => {
                print_result(format_args!("tables in {0}; the report: proact analyze {0}", dir.display()))?
            }
        }
    }
    Ok(all_counted)
}

/// Prints the figures. False if all trials of a condition failed.
fn print_summary(
    args: &SimulateArgs,
    summaries: &[ConditionSummary],
    more: Value,
    start: Instant,
) -> Result<bool, Box<dyn Error>> {
    let all_counted = summaries.iter().all(|summary| summary.scores.is_some());
    summaries.iter().filter_map(ConditionSummary::failed_line).for_each(proact_app::print_status);
    summaries.iter().filter_map(ConditionSummary::idle_line).for_each(proact_app::print_status);
    if args.json {
        let mut methods = Map::new();
        for summary in summaries {
            let mut figures = serde_json::to_value(summary)?;
            if summary.scores.is_none() {
                figures["trials"] = json!(0);
            }
            methods.insert(summary.condition.clone(), figures);
        }
        let mut object = json!({ "methods": methods, "jobs": args.batch.jobs(),
            "wall_seconds": start.elapsed().as_secs_f64(), "note": SIMULATED_DISCLAIMER });
        if let (Some(object), Value::Object(more)) = (object.as_object_mut(), more) {
            object.extend(more);
        }
        print_result_json(&object)?;
        return Ok(all_counted);
    }
    print_result("         mean    sd   min median   max  trials")?;
    for ConditionSummary { condition, score_name, scores, failed, failure, .. } in summaries {
        let Some(scores) = scores else {
            let reason = failure.as_deref().unwrap_or_default();
            print_result(format_args!("{condition:6} failed, all {failed} trials: {reason}"))?;
            continue;
        };
        let sd = scores.sd.map_or("    -".to_owned(), |sd| format!("{sd:5.2}"));
        print_result(format_args!(
            "{condition:6} {:6.2} {sd} {:5.1} {:6.1} {:5.1} {:7}  {score_name}{}",
            Number(scores.mean),
            Number(scores.min),
            Number(scores.median),
            Number(scores.max),
            scores.count,
            if *failed > 0 { format!("; {failed} more trials failed") } else { String::new() }
        ))?;
    }
    print_result(format_args!("{SIMULATED_DISCLAIMER} In {:.0} s.", start.elapsed().as_secs_f64()))?;
    Ok(all_counted)
}
