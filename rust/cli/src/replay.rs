use crate::{record::CLASSIFIER_FILE, replay_page, trial};
use clap::Args;
use proact_recording::{RecordingError, Trial, read_result};
use proact_testbed::{
    Divergence, SpanDigest, Testbed, TestbedError, TrialConfig, TrialResult, first_divergence, replay,
};
use serde::Serialize;
use std::{
    error::Error,
    fs,
    path::{Path, PathBuf},
};

/// Arguments of `proact replay`.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  proact replay trials/D-seated-seed1\n  \
    proact replay trials/A-still-seed1 trials/D-still-seed1 --page\n\n\
    Exit code 0 only if every span of the recomputed trial has the recorded digest.")]
pub(crate) struct ReplayArgs {
    /// Trial directory; several with --page
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
    /// The recorded digests, at least one.
    pub(crate) recorded: Vec<SpanDigest>,
}

/// Reads the trial in `dir`.
///
/// # Errors
/// A directory that is no trial, a damaged file (with its offset), a configuration that no longer fits.
pub(crate) fn open_trial(dir: &Path) -> Result<Opened, Box<dyn Error>> {
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
    let testbed = trial::replayed(config.clone(), classifier)?;
    Ok(Opened { record, config, testbed, recorded })
}

/// Recomputes the trial in `dir` from its configuration, classifier and input log, and compares digests.
///
/// # Errors
/// A directory that is no trial, a damaged file (with its offset), a configuration that no longer fits.
pub fn replay_trial(dir: &Path) -> Result<Replayed, Box<dyn Error>> {
    let Opened { record, mut testbed, recorded, .. } = open_trial(dir)?;
    let last = recorded.last().ok_or("an opened trial has a digest")?;
    let inputs = record.inputs()?.map(|entry| entry.map(|e| (e.tick, e.input)).map_err(ReplayError::from));
    let spans = replay(&mut testbed, inputs, last.tick)?;
    let divergence = first_divergence(&recorded, &spans);
    let finished = read_result::<TrialResult>(dir).is_ok();
    Ok(Replayed {
        agrees: divergence.is_none(),
        spans: spans.len(),
        digest: testbed.digest(),
        recorded: last.chain.clone(),
        divergence,
        finished,
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
    let replayed = replay_trial(dir)?;
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
    if !replayed.finished {
        println!("note: the trial has no result; it was replayed as far as it was recorded");
    }
    Ok(replayed.agrees)
}
