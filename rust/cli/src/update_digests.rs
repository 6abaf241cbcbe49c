use clap::Args;
use proact_app::print_result;
use std::{error::Error, path::PathBuf};

/// Arguments of `proact update-digests`.
#[derive(Debug, Args)]
#[command(
    after_help = "Example:\n  ./proact update-digests \"Blend: the assistant's share is smoothed\"\n\n\
    After a change that is meant to change results. Runs the trials of tests/digests/trials.toml, writes their digests \
    for this platform and their outcomes, and adds the reason to CHANGELOG.md. Look at what changed before committing."
)]
pub(crate) struct UpdateDigestsArgs {
    /// Why the results change, for the changelog
    reason: Vec<String>,
    /// The repository
    #[arg(long, value_name = "DIR", default_value = ".")]
    repository: PathBuf,
}

pub(crate) fn command(args: &UpdateDigestsArgs) -> Result<bool, Box<dyn Error>> {
    let updated = proact_app::digests::update_digests(&args.repository, &args.reason.join(" "))?;
    print_result(&updated)?;
    Ok(true)
}
