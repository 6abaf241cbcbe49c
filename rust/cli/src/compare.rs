//! `proact compare`: control methods on the same simulated people, in the order of what they score.

use crate::{
    batch_args::{BatchArgs, BatchOutcome, BatchTrialArgs},
    interrupt::interrupt_flag,
    progress::progress_bar,
};
use clap::Args;
use proact_app::{
    Registry,
    analysis::{self, ReportOptions, leader_board},
    batch::{Batch, ConditionSummary, MethodsBatch, SIMULATED_DISCLAIMER, Sweep},
    print_result, print_result_json, print_status,
};
use proact_types::Number;
use serde_json::{Value, json};
use std::error::Error;

/// Arguments of `proact compare`.
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  proact compare A B C D\n  proact compare C,D,mine.toml --participants 24 --trials 3 --out board\n  \
    proact compare C D --participant-kind person --set participant.gaze_error_deg=3 --json\n\n\
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
        common: args.trial.trial_options(),
        participants: args.participants as usize,
        trials: args.trials as usize,
        seed: args.batch.seed.unwrap_or(1),
    };
    let batch = Batch::of_methods(&list, args.batch.participant_kind, Sweep::default())?;
    let (dir, merged) = match args.batch.with_default_out("comparison").run(
        registry,
        &batch,
        !args.json,
        &interrupted,
    )? {
        BatchOutcome::Merged(dir, merged) => (dir, merged),
        BatchOutcome::Shard(dir, shard, trials) => {
            let text = format!(
                "all {trials} trials of shard {shard} are in {}; the report follows when the last shard is there. {SIMULATED_DISCLAIMER}",
                dir.display()
            );
            let object = json!({ "shard": shard.to_string(), "trials": trials, "out": dir, "merged": false, "note": SIMULATED_DISCLAIMER });
            if args.json {
                print_result_json(&object)?;
            } else {
                print_result(text)?;
            }
            return Ok(true);
        }
        BatchOutcome::Submitted(script, number) => {
            let object = json!({ "script": script, "job": number, "note": SIMULATED_DISCLAIMER });
            let text =
                format!("job {number} of Slurm, by {}; its last task writes the report", script.display());
            if args.json {
                print_result_json(&object)?;
            } else {
                print_result(text)?;
            }
            return Ok(true);
        }
        // With a folder nothing is only summed up.
        BatchOutcome::Interrupted(_) | BatchOutcome::Summed(..) => {
            print_status("interrupted; the same command goes on where it was");
            return Ok(false);
        }
    };
    let collected = analysis::collect_analysis_data(&registry.methods, &dir, 1, &|_, _| {})?;
    let options = ReportOptions { out: dir.join("analysis"), seed: list.seed, leader_board: true };
    let drawing = progress_bar(!args.json, 0, "{elapsed} {bar:40} {pos} of {len} figures");
    let written = analysis::report(&collected, &options, |done, all| {
        drawing.set_length(all as u64);
        drawing.set_position(done as u64);
    })?;
    drawing.finish_and_clear();
    let leaders = leader_board(&collected, list.seed);
    let summaries = merged.tally.summaries();
    let all_counted = summaries.iter().all(|summary| summary.scores.is_some());
    let failed: Vec<&ConditionSummary> = summaries.iter().filter(|summary| summary.failed > 0).collect();
    failed.iter().filter_map(|summary| summary.failed_line()).for_each(print_status);
    summaries.iter().filter_map(ConditionSummary::idle_line).for_each(print_status);
    if args.json {
        let failed: Vec<Value> = failed
            .iter()
            .map(|own| json!({ "method": own.condition, "trials": own.failed, "failure": own.failure }))
            .collect();
        let object = json!({ "leaders": leaders, "failed": failed, "out": dir, "report": written.page, "tables": written.tables,
            "figures": written.figures, "notes": written.notes, "lines": merged.lines, "note": SIMULATED_DISCLAIMER });
        print_result_json(&object)?;
        return Ok(all_counted);
    }
    print_result("     method      mean  [95 % interval]    sd   all   none  better than the next")?;
    for leader in &leaders {
        let interval = leader
            .interval
            .map_or_else(String::new, |i| format!("[{:.2}, {:.2}]", Number(i.low), Number(i.high)));
        let sd = leader.scores.sd.map_or_else(|| "-".to_owned(), |sd| format!("{sd:.2}"));
        let next = leader.versus_next.as_ref().map_or_else(String::new, |next| next.to_string());
        print_result(format_args!(
            "{:>3}. {:10} {:5.2}  {interval:15} {sd:>5} {:4.0} % {:4.0} %  {next}",
            leader.rank,
            leader.method,
            leader.scores.mean,
            leader.top_score_fraction * 100.0,
            leader.zero_score_fraction * 100.0
        ))?;
    }
    for own in failed.iter().filter(|own| own.scores.is_none()) {
        let reason = own.failure.as_deref().unwrap_or_default();
        print_result(format_args!("   - {:10} failed, all {} trials: {reason}", own.condition, own.failed))?;
    }
    print_result(format_args!("{SIMULATED_DISCLAIMER} Open {}", written.page.display()))?;
    Ok(all_counted)
}
