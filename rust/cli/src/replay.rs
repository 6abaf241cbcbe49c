use crate::{
    record::CLASSIFIER_FILE,
    replay_page,
    trial::{self, ComparedPlans},
};
use clap::Args;
use proact_recording::{RecordingError, Trial, read_result};
use proact_testbed::{
    Divergence, SpanDigest, Testbed, TestbedError, TrialConfig, TrialResult, first_divergence, replay,
};
use proact_types::{PlanReply, PlanStatus};
use serde::Serialize;
use std::{
    error::Error,
    fs,
    path::{Path, PathBuf},
};

/// Arguments of `proact replay`.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  proact replay trials/D-seated-seed1\n  \
    proact replay trials/A-still-seed1 trials/D-still-seed1 --page\n  \
    proact replay participant1-mode4-trial2.bag --page\n\n\
    Exit code 0 only if every span of the recomputed trial has the recorded digest.")]
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
}

/// What a replay found.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Replayed {
    /// Every span agrees.
    pub agrees: bool,
    /// Spans compared.
    pub spans: usize,
    /// Digest of the recomputed trial.
    pub digest: String,
    /// Digest of the record.
    pub recorded: String,
    /// Where they part.
    pub divergence: Option<Divergence>,
    /// The record has a result; a trial that crashed has none and is replayed as far as it goes.
    pub finished: bool,
    /// What planning again gave; none if it was not asked for.
    pub replanned: Option<Replanned>,
}

/// Recorded plans beside those that the same requests give now.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Replanned {
    /// Plans that are equal to the last bit.
    pub equal: usize,
    /// Numbers of the requests whose plan is another one now.
    pub different: Vec<u64>,
    /// Numbers of the requests that were cancelled, or that a deadline ended: nothing to compare.
    pub not_comparable: Vec<u64>,
}

#[derive(Debug, thiserror::Error)]
enum ReplayError {
    #[error(transparent)]
    Recording(#[from] RecordingError),
    #[error(transparent)]
    Testbed(#[from] TestbedError),
}

/// A recorded trial, ready to be recomputed.
pub(crate) struct Opened {
    pub(crate) record: Trial,
    pub(crate) config: TrialConfig,
    /// At time zero; it takes its plans from the log.
    pub(crate) testbed: Testbed,
    /// What the same requests give now, if that was asked for.
    pub(crate) plans: Option<ComparedPlans>,
    /// The recorded digests, at least one.
    pub(crate) recorded: Vec<SpanDigest>,
}

/// Reads the trial in `dir`; with `replan` its plans are computed again beside the recorded ones.
///
/// # Errors
/// A directory that is no trial, a damaged file (with its offset), a configuration that no longer fits.
pub(crate) fn open_trial(dir: &Path, replan: bool) -> Result<Opened, Box<dyn Error>> {
    let record = Trial::open(dir)?;
    let config = TrialConfig::from_toml(&record.header().config_toml)?;
    let classifier = match fs::read(dir.join(CLASSIFIER_FILE)) {
        Ok(text) => Some(
            serde_json::from_slice(&text)
                .map_err(|e| format!("{} is damaged: {e}", dir.join(CLASSIFIER_FILE).display()))?,
        ),
        Err(_) if config.emg.is_none() => None,
        Err(error) => return Err(format!("{}: {error}", dir.join(CLASSIFIER_FILE).display()).into()),
    };
    let recorded: Vec<SpanDigest> = record.digests()?;
    if recorded.is_empty() {
        return Err("the record holds no complete span: there is nothing to compare".into());
    }
    let (testbed, plans) = if replan {
        let (testbed, plans) = trial::replanned(config.clone(), classifier)?;
        (testbed, Some(plans))
    } else {
        (trial::replayed(config.clone(), classifier)?, None)
    };
    Ok(Opened { record, config, testbed, plans, recorded })
}

/// Recomputes the trial in `dir` from its configuration, classifier and input log, and compares digests; with
/// `replan` its plans as well, which otherwise come from the log.
///
/// # Errors
/// A directory that is no trial, a damaged file (with its offset), a configuration that no longer fits.
pub fn replay_trial(dir: &Path, replan: bool) -> Result<Replayed, Box<dyn Error>> {
    let Opened { record, mut testbed, plans, recorded, .. } = open_trial(dir, replan)?;
    let last = recorded.last().ok_or("an opened trial has a digest")?;
    let mut again = Replanned::default();
    let mut logged: Vec<PlanReply> = Vec::new();
    let inputs = record.inputs()?.map(|entry| entry.map(|e| (e.tick, e.input)).map_err(ReplayError::from));
    let inputs = inputs.inspect(|entry| {
        if let Ok((_, input)) = entry {
            logged.extend(input.plan.clone());
        }
    });
    let spans = replay(&mut testbed, inputs, last.tick)?;
    if let Some(plans) = &plans {
        for reply in &logged {
            match plans.reply(reply.id) {
                Some((now, false)) if reply.status != PlanStatus::Cancelled => {
                    if now == *reply {
                        again.equal += 1;
                    } else {
                        again.different.push(reply.id);
                    }
                }
                _ => again.not_comparable.push(reply.id),
            }
        }
    }
    let divergence = first_divergence(&recorded, &spans);
    let finished = read_result::<TrialResult>(dir).is_ok();
    Ok(Replayed {
        agrees: divergence.is_none() && again.different.is_empty(),
        spans: spans.len(),
        digest: testbed.digest(),
        recorded: last.chain.clone(),
        divergence,
        finished,
        replanned: replan.then_some(again),
    })
}

pub(crate) fn command(args: &ReplayArgs) -> Result<bool, Box<dyn Error>> {
    if args.page {
        return replay_page::show(&args.dirs, args.port, !args.no_browser);
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
    let replayed = replay_trial(dir, args.replan)?;
    if args.json {
        println!("{}", serde_json::to_string(&replayed)?);
        return Ok(replayed.agrees);
    }
    match &replayed.divergence {
        None => println!("agrees: {} spans, digest {}", replayed.spans, replayed.digest),
        Some(Divergence { from, to, fields }) => println!(
            "DIVERGES between {:.3} s and {:.3} s (ticks {} to {}), first in {}\n  recorded   {}\n  recomputed {}",
            from.as_secs(),
            to.as_secs(),
            from.0,
            to.0,
            fields.join(", "),
            replayed.recorded,
            replayed.digest
        ),
    }
    if let Some(Replanned { equal, different, not_comparable }) = &replayed.replanned {
        println!(
            "plans: {equal} equal, {} different {different:?}, {} not comparable {not_comparable:?}",
            different.len(),
            not_comparable.len()
        );
    }
    if !replayed.finished {
        println!("note: the trial has no result; it was replayed as far as it was recorded");
    }
    Ok(replayed.agrees)
}
