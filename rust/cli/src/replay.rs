use crate::replay_page;
use clap::Args;
use proact_app::{
    ReplanResult, ReplayOptions, counterfactual, print_result, print_result_json, print_status, replay_trial,
};
use proact_control::MethodRegistry;
use proact_testbed::Divergence;
use std::{
    error::Error,
    path::{Path, PathBuf},
};

/// Arguments of `proact replay`.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  proact replay trials/D-seated-seed1\n  \
    proact replay trials/A-still-seed1 trials/D-still-seed1 --page\n  \
    proact replay participant1-mode4-trial2.bag --page\n  \
    proact replay trials/D-seated-seed1 --override intent_model=filtered,intent.gaze_sigma=0.05\n\n\
    A trial that was broken off is recomputed up to its last digest, and called interrupted. Exit code 0 only if every \
    span of the recomputed trial has the recorded digest. A bag that is cut off is shown as far as it goes.")]
pub(crate) struct ReplayArgs {
    /// Trial directory; several with --page, and also bags of the original or of any ROS graph with its topics
    #[arg(required = true, value_name = "DIR")]
    dirs: Vec<PathBuf>,
    /// One JSON object on standard output
    #[arg(long, conflicts_with = "page")]
    json: bool,
    /// Look at the trials in the browser: scrub, compare, save pictures and videos
    #[arg(long)]
    page: bool,
    /// Port of the page; the next free one if it is taken
    #[arg(long, default_value_t = 8090, requires = "page")]
    port: u16,
    /// Print the address of the page, open nothing
    #[arg(long, requires = "page")]
    no_browser: bool,
    /// Compute every plan again and compare it with the recorded one
    #[arg(long, conflicts_with = "page")]
    replan: bool,
    /// What other values would have made of the recorded gaze and EMG, with commas between: intent_model=filtered,intent.gaze_sigma=0.05
    #[arg(long = "override", value_name = "KEY=VALUE", value_delimiter = ',', conflicts_with_all = ["page", "replan"])]
    overrides: Vec<String>,
    /// Replay also what was recorded with other versions of the libraries
    #[arg(long, conflicts_with = "page")]
    other_versions: bool,
}

pub(crate) fn command(methods: &MethodRegistry, args: &ReplayArgs) -> Result<bool, Box<dyn Error>> {
    if args.page {
        return replay_page::serve_replays(methods, &args.dirs, args.port, !args.no_browser);
    }
    let [dir] = args.dirs.as_slice() else {
        let count = args.dirs.len();
        return Err(format!("got {count} trial directories, expected one; add --page to compare them").into());
    };
    if dir.is_file() {
        return Err(format!(
            "{} is a file; a trial directory is computed again, a bag can be looked at: add --page",
            dir.display()
        )
        .into());
    }
    if !args.overrides.is_empty() {
        return run_counterfactual(methods, dir, args).map(|()| true);
    }
    let options = ReplayOptions {
        replan: args.replan,
        allow_other_versions: args.other_versions,
        methods: methods.clone(),
    };
    let replayed = replay_trial(dir, options)?;
    let interrupted =
        format!("interrupted: the record was not closed, and goes up to {:.3} s", replayed.seconds);
    if args.json {
        if !replayed.finished {
            print_status(interrupted);
        }
        print_result_json(&replayed)?;
        return Ok(replayed.agrees);
    }
    match &replayed.divergence {
        None => print_result(format_args!("agrees: {} spans, digest {}", replayed.spans, replayed.digest))?,
        Some(Divergence { from, to, fields }) => print_result(format_args!(
            "DIVERGES between {:.3} s and {:.3} s (ticks {} to {}), first in {}\n  recorded   {} by {}\n  recomputed {}",
            from.as_secs(),
            to.as_secs(),
            from.0,
            to.0,
            fields.join(", "),
            replayed.recorded,
            replayed.recorded_by,
            replayed.digest
        ))?,
    }
    if let Some(ReplanResult { equal, different, not_comparable }) = &replayed.replan_result {
        print_result(format_args!(
            "plans: {equal} equal, {} different {different:?}, {} not comparable {not_comparable:?}",
            different.len(),
            not_comparable.len()
        ))?;
    }
    if !replayed.finished {
        print_result(interrupted)?;
    }
    Ok(replayed.agrees)
}

/// What other values would have made of the trial.
fn run_counterfactual(methods: &MethodRegistry, dir: &Path, args: &ReplayArgs) -> Result<(), Box<dyn Error>> {
    let found = counterfactual(methods, dir, &args.overrides, args.other_versions)?;
    if args.json {
        return Ok(print_result_json(&found)?);
    }
    match found.display_differs_from_secs {
        None => {
            print_result(format_args!("the person would have seen the same in all {:.3} s", found.seconds))?
        }
        Some(secs) => print_result(format_args!(
            "from {secs:.3} s on of {:.3} s the person would have seen something else ({}): what follows is no evidence, since they would \
             have done something else",
            found.seconds,
            found.first_display_differences.join(", ")
        ))?,
    }
    print_result(format_args!(
        "{:<18}{:>10}{:>10}\n{:<18}{:>10}{:>10}\n{:<18}{:>10}{:>10}\n{:<18}{:>10}{:>10}\nthe same gesture in {:.1} % of the time",
        "",
        "recorded",
        "override",
        "score",
        found.score[0],
        found.score[1],
        "gesture changes",
        found.gesture_changes[0],
        found.gesture_changes[1],
        "plans",
        found.plans[0],
        found.plans[1],
        100.0 * found.same_gesture_fraction
    ))?;
    Ok(())
}
