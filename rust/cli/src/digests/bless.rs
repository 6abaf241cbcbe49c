use super::{Platform, Store, Tally, TrialEntry, differences, with_line};
use clap::Args;
use std::{error::Error, fs, path::PathBuf};

/// Arguments of `proact bless`.
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  ./proact bless \"Blend: the assistant's share is smoothed\"\n\n\
    After a change that is meant to change results. Runs the trials of tests/digests/trials.toml, writes their digests \
    for this platform and their outcomes, and adds the reason to CHANGELOG.md. Look at what changed before committing.")]
pub struct BlessArgs {
    /// Why the results change, for the changelog
    reason: Vec<String>,
    /// The repository
    #[arg(long, value_name = "DIR", default_value = ".")]
    repository: PathBuf,
}

/// Runs the trials and makes their digests the committed ones of this platform.
///
/// # Errors
/// No reason, no repository, a trial that breaks off.
pub fn bless(args: &BlessArgs) -> Result<bool, Box<dyn Error>> {
    let reason = args.reason.join(" ");
    let reason = reason.trim().trim_end_matches('.');
    if reason.is_empty() {
        return Err("bless needs the reason why results change: ./proact bless \"REASON\"".into());
    }
    let changelog = args.repository.join("CHANGELOG.md");
    let log = fs::read_to_string(&changelog).map_err(|error| {
        format!("cannot read {}: {error}; give the repository with --repository", changelog.display())
    })?;
    let (store, platform) = (Store::of(&args.repository), Platform::here());
    let committed = store.digests(&platform)?;
    let known = committed.is_some();
    let committed = committed.unwrap_or_default();
    let outcomes = store.outcomes()?;
    let run = store.trials()?.iter().map(TrialEntry::run).collect::<Result<Vec<_>, _>>()?;

    let different = differences(&committed, &outcomes, &run);
    let ended_otherwise = run.iter().map(|trial| &trial.outcome).ne(&outcomes);
    if different.is_empty() && !ended_otherwise {
        println!("nothing has changed: the digests of {} trials are the committed ones", run.len());
        return Ok(true);
    }
    let tally = Tally::of(&committed, &run);
    let line = if known {
        let changed: Vec<&str> =
            tally.stages.iter().filter(|(_, changed, _)| *changed > 0).map(|(stage, ..)| *stage).collect();
        let stages = if changed.is_empty() { "no stage".to_owned() } else { changed.join(", ") };
        format!("{reason} ({} of {} trials; {stages}).", different.len(), run.len())
    } else {
        format!("{reason} ({} trials, on a platform that had none).", run.len())
    };
    let log = with_line(&log, &line).ok_or("CHANGELOG.md has no section \"## Unreleased\"")?;
    store.write(&platform, &run)?;
    fs::write(&changelog, log).map_err(|error| format!("cannot write {}: {error}", changelog.display()))?;

    if known {
        different.iter().for_each(|difference| println!("{difference}"));
        println!("field hashes that changed: {tally}");
    } else {
        println!("first digests of the platform {platform}");
    }
    println!("blessed; CHANGELOG.md says: {line}");
    Ok(true)
}
