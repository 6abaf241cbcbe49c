use super::{
    DigestDifference, DigestStore, Platform, StageDifferenceCounts, TrialEntry, add_digest_line,
    digest_differences,
};
use proact_files::write_atomically;
use std::{error::Error, fmt, fs, path::Path};

/// What an update changed.
pub struct DigestUpdate {
    /// Every digest that differs from the committed one; none on a platform that had none.
    pub differences: Vec<DigestDifference>,
    /// Which stages changed, of how many spans.
    stage_counts: StageDifferenceCounts,
    /// The platform that had none before.
    new_platform: Option<Platform>,
    /// The line of the changelog; none where nothing changed.
    pub changelog_line: Option<String>,
    trial_count: usize,
}

impl fmt::Display for DigestUpdate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Some(line) = &self.changelog_line else {
            return write!(
                f,
                "nothing has changed: the digests of {} trials are the committed ones",
                self.trial_count
            );
        };
        match &self.new_platform {
            None => {
                self.differences.iter().try_for_each(|difference| writeln!(f, "{difference}"))?;
                writeln!(f, "field hashes that changed: {}", self.stage_counts)?;
            }
            Some(platform) => writeln!(f, "first digests of the platform {platform}")?,
        }
        write!(f, "updated; CHANGELOG.md says: {line}")
    }
}

/// Runs the trials of `repository` and makes their digests the committed ones of this platform; `reason` goes into its
/// changelog.
///
/// # Errors
/// No reason, no repository, a trial that breaks off.
pub fn update_digests(repository: &Path, reason: &str) -> Result<DigestUpdate, Box<dyn Error>> {
    let reason = reason.trim().trim_end_matches('.');
    if reason.is_empty() {
        return Err(
            "update-digests needs the reason why results change: ./proact update-digests \"REASON\"".into()
        );
    }
    let changelog = repository.join("CHANGELOG.md");
    let log = fs::read_to_string(&changelog).map_err(|error| {
        format!("cannot read {}: {error}; give the repository with --repository", changelog.display())
    })?;
    let (store, platform) = (DigestStore::in_repository(repository), Platform::current());
    let committed = store.digests(&platform)?;
    let known = committed.is_some();
    let committed = committed.unwrap_or_default();
    let outcomes = store.outcomes()?;
    let run = store.trials()?.iter().map(TrialEntry::run).collect::<Result<Vec<_>, _>>()?;

    let different = digest_differences(&committed, &outcomes, &run);
    let ended_otherwise = run.iter().map(|trial| &trial.outcome).ne(&outcomes);
    if different.is_empty() && !ended_otherwise {
        return Ok(DigestUpdate {
            differences: different,
            stage_counts: StageDifferenceCounts::default(),
            new_platform: None,
            changelog_line: None,
            trial_count: run.len(),
        });
    }
    let differences = StageDifferenceCounts::count(&committed, &run);
    let line = if known {
        let changed: Vec<&str> = differences
            .stages
            .iter()
            .filter(|(_, changed, _)| *changed > 0)
            .map(|(stage, ..)| *stage)
            .collect();
        let stages = if changed.is_empty() { "no stage".to_owned() } else { changed.join(", ") };
        format!("{reason} ({} of {} trials; {stages}).", different.len(), run.len())
    } else {
        format!("{reason} ({} trials, on a platform that had none).", run.len())
    };
    let log = add_digest_line(&log, &line).ok_or("CHANGELOG.md has no section \"## Unreleased\"")?;
    store.write(&platform, &run)?;
    write_atomically(&changelog, log)?;
    let first_of = (!known).then_some(platform);
    Ok(DigestUpdate {
        differences: different,
        stage_counts: differences,
        new_platform: first_of,
        changelog_line: Some(line),
        trial_count: run.len(),
    })
}
