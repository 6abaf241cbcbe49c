use clap::Args;
use proact_app::answer;
use std::{error::Error, path::PathBuf};

/// Arguments of `proact bless`.
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  ./proact bless \"Blend: the assistant's share is smoothed\"\n\n\
    After a change that is meant to change results. Runs the trials of tests/digests/trials.toml, writes their digests \
    for this platform and their outcomes, and adds the reason to CHANGELOG.md. Look at what changed before committing.")]
pub(crate) struct BlessArgs {
    /// Why the results change, for the changelog
    reason: Vec<String>,
    /// The repository
    #[arg(long, value_name = "DIR", default_value = ".")]
    repository: PathBuf,
}

pub(crate) fn command(args: &BlessArgs) -> Result<bool, Box<dyn Error>> {
    let blessed = proact_app::digests::bless(&args.repository, &args.reason.join(" "))?;
    answer(&blessed)?;
    Ok(true)
}
