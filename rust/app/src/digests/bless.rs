use super::{Difference, Platform, Store, Tally, TrialEntry, differences, with_line};
use proact_files::write_whole;
use std::{error::Error, fmt, fs, path::Path};

/// What a blessing changed.
pub struct Blessed {
    /// Every digest that differs from the committed one; none on a platform that had none.
    pub different: Vec<Difference>,
    /// Which stages changed, of how many spans.
    tally: Tally,
    /// The platform that had none before.
    first_of: Option<Platform>,
    /// The line of the changelog; none where nothing changed.
    pub line: Option<String>,
    trials: usize,
}

impl fmt::Display for Blessed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Some(line) = &self.line else {
            return write!(
                f,
                "nothing has changed: the digests of {} trials are the committed ones",
                self.trials
            );
        };
        match &self.first_of {
            None => {
                self.different.iter().try_for_each(|difference| writeln!(f, "{difference}"))?;
                writeln!(f, "field hashes that changed: {}", self.tally)?;
            }
            Some(platform) => writeln!(f, "first digests of the platform {platform}")?,
        }
        write!(f, "blessed; CHANGELOG.md says: {line}")
    }
}

/// Runs the trials of `repository` and makes their digests the committed ones of this platform; `reason` goes into its
/// changelog.
///
/// # Errors
/// No reason, no repository, a trial that breaks off.
pub fn bless(repository: &Path, reason: &str) -> Result<Blessed, Box<dyn Error>> {
    let reason = reason.trim().trim_end_matches('.');
    if reason.is_empty() {
        return Err("bless needs the reason why results change: ./proact bless \"REASON\"".into());
    }
    let changelog = repository.join("CHANGELOG.md");
    let log = fs::read_to_string(&changelog).map_err(|error| {
        format!("cannot read {}: {error}; give the repository with --repository", changelog.display())
    })?;
    let (store, platform) = (Store::of(repository), Platform::here());
    let committed = store.digests(&platform)?;
    let known = committed.is_some();
    let committed = committed.unwrap_or_default();
    let outcomes = store.outcomes()?;
    let run = store.trials()?.iter().map(TrialEntry::run).collect::<Result<Vec<_>, _>>()?;

    let different = differences(&committed, &outcomes, &run);
    let ended_otherwise = run.iter().map(|trial| &trial.outcome).ne(&outcomes);
    if different.is_empty() && !ended_otherwise {
        return Ok(Blessed {
            different,
            tally: Tally::default(),
            first_of: None,
            line: None,
            trials: run.len(),
        });
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
    write_whole(&changelog, log)?;
    let first_of = (!known).then_some(platform);
    Ok(Blessed { different, tally, first_of, line: Some(line), trials: run.len() })
}
