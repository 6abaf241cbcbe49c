//! `proact compare`: control methods on the same simulated people, in the order of what they score.

use crate::{
    batch_args::{BatchArgs, BatchOutcome, BatchTrialArgs},
    interrupt::interrupt_flag,
    progress::bar,
};
use clap::Args;
use proact_app::{
    Registry,
    analysis::{self, ReportOptions, leader_board},
    answer,
    batch::{Batch, ConditionSummary, MethodsBatch, NO_EVIDENCE, Sweep},
    tell,
};
use serde_json::{Value, json};
use std::error::Error;

/// Arguments of `proact compare`.
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  proact compare A B C D\n  proact compare C,D,mine.toml --participants 24 --trials 3 --out board\n  \
    proact compare C D --people person --set participant.gaze_error_deg=3 --json\n\n\
    Every method meets the same simulated people, the same blocks and the same seeds, each as if it were the first that a person \
    meets. A method of one's own is the TOML file that names its program (docs/methods). The folder has the trials as of proact \
    simulate --out, and in analysis/ a report as of proact analyze with the leader board first. Simulated participants are no \
    evidence about people."
)]
pub(crate) struct CompareArgs {
    /// Methods by name, or by the file of an outside one
    #[arg(value_name = "METHODS", value_delimiter = ',', required = true)]
    methods: Vec<String>,
    /// Simulated people, each of whom does all methods
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u32).range(2..=10_000))]
    participants: u32,
    /// Trials of each of them by each method
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=1000))]
    trials: u32,
    #[command(flatten)]
    trial: BatchTrialArgs,
    #[command(flatten)]
    batch: BatchArgs,
    /// One JSON object on standard output
    #[arg(long)]
    json: bool,
}

pub(crate) fn command(registry: &Registry, args: CompareArgs) -> Result<bool, Box<dyn Error>> {
    if args.methods.len() < 2 {
        return Err(
            format!("one method, {}, is no comparison; name two or more", args.methods.join(", ")).into()
        );
    }
    let interrupted = interrupt_flag()?;
    let list = MethodsBatch {
        methods: args.methods,
        common: args.trial.choice(),
        participants: args.participants as usize,
        trials: args.trials as usize,
        seed: args.batch.seed.unwrap_or(1),
    };
    let batch = Batch::of_methods(&list, args.batch.people, Sweep::default())?;
    let (dir, merged) = match args.batch.within("comparison").run(
        registry,
        &batch,
        !args.json,
        &interrupted,
    )? {
        BatchOutcome::Merged(dir, merged) => (dir, merged),
        BatchOutcome::Shard(dir, shard, trials) => {
            let text = format!(
                "all {trials} trials of shard {shard} are in {}; the report follows when the last shard is there. {NO_EVIDENCE}",
                dir.display()
            );
            let object = json!({ "shard": shard.to_string(), "trials": trials, "out": dir, "merged": false, "note": NO_EVIDENCE });
            answer(if args.json { object.to_string() } else { text })?;
            return Ok(true);
        }
        BatchOutcome::Submitted(script, number) => {
            let object = json!({ "script": script, "job": number, "note": NO_EVIDENCE });
            let text =
                format!("job {number} of Slurm, by {}; its last task writes the report", script.display());
            answer(if args.json { object.to_string() } else { text })?;
            return Ok(true);
        }
        // With a folder nothing is only summed up.
        BatchOutcome::Interrupted(_) | BatchOutcome::Summed(..) => {
            tell("interrupted; the same command goes on where it was");
            return Ok(false);
        }
    };
    let collected = analysis::collect(&registry.methods, &dir, 1, &|_, _| {})?;
    let options = ReportOptions { out: dir.join("analysis"), seed: list.seed, leader_board: true };
    let drawing = bar(!args.json, 0, "{elapsed} {bar:40} {pos} of {len} figures");
    let written = analysis::report(&collected, &options, |done, all| {
        drawing.set_length(all as u64);
        drawing.set_position(done as u64);
    })?;
    drawing.finish_and_clear();
    let leaders = leader_board(&collected, list.seed);
    let summaries = merged.tally.summaries();
    let all_counted = summaries.iter().all(|summary| summary.scores.is_some());
    let failed: Vec<&ConditionSummary> = summaries.iter().filter(|summary| summary.failed > 0).collect();
    failed.iter().filter_map(|summary| summary.failed_line()).for_each(tell);
    if args.json {
        let failed: Vec<Value> = failed
            .iter()
            .map(|own| json!({ "method": own.condition, "trials": own.failed, "failure": own.failure }))
            .collect();
        let object = json!({ "leaders": leaders, "failed": failed, "out": dir, "report": written.page, "tables": written.tables,
            "figures": written.figures, "notes": written.notes, "lines": merged.lines, "note": NO_EVIDENCE });
        answer(object.to_string())?;
        return Ok(all_counted);
    }
    answer("     method      mean  [95 % interval]    sd   all   none  better than the next")?;
    for leader in &leaders {
        let interval = leader.interval.map_or_else(String::new, |i| format!("[{:.2}, {:.2}]", i.low, i.high));
        let sd = leader.scores.sd.map_or_else(|| "-".to_owned(), |sd| format!("{sd:.2}"));
        let next = leader.over_next.as_ref().map_or_else(String::new, |next| next.to_string());
        answer(format_args!(
            "{:>3}. {:10} {:5.2}  {interval:15} {sd:>5} {:4.0} % {:4.0} %  {next}",
            leader.place,
            leader.method,
            leader.scores.mean,
            leader.at_most * 100.0,
            leader.at_zero * 100.0
        ))?;
    }
    for own in failed.iter().filter(|own| own.scores.is_none()) {
        let reason = own.failure.as_deref().unwrap_or_default();
        answer(format_args!("   - {:10} failed, all {} trials: {reason}", own.condition, own.failed))?;
    }
    answer(format_args!("{NO_EVIDENCE} Open {}", written.page.display()))?;
    Ok(all_counted)
}
