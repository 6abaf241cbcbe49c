//! The committed digests of sixteen short trials: a change of the arithmetic anywhere between EMG and task is noticed,
//! and named by trial, span, stage and field. `tests/digests/README.md` says what to do then.
#![allow(clippy::disallowed_methods)] // A test of files and of the program.

use proact_app::digests::{
    DigestStore, Platform, TrialDigest, TrialEntry, digest_differences, outcome_violations,
};
use std::{
    error::Error,
    fs,
    io::Write,
    path::{Path, PathBuf},
    process::{Command, Output},
};

type Outcome<T = ()> = Result<T, Box<dyn Error>>;

fn repository() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// Says it past the test's own output, which nobody sees when the test passes.
fn print_to_stderr(text: &str) {
    let _ = writeln!(std::io::stderr(), "{text}");
}

// Catches what a test of one part cannot: that results change although nobody meant them to.
#[test]
fn the_trials_have_their_committed_digests() -> Outcome {
    let (store, platform) = (DigestStore::in_repository(&repository()), Platform::current());
    let run: Vec<TrialDigest> =
        store.trials()?.iter().map(TrialEntry::run).collect::<Result<_, Box<dyn Error>>>()?;
    assert_eq!(run.len(), 16, "trials of the list");
    let outcomes = store.outcomes()?;

    let Some(committed) = store.digests(&platform)? else {
        print_to_stderr(&format!(
            "digests: the platform {platform} has none committed; only lengths and outcomes of the trials are compared"
        ));
        for now in run.iter().map(|trial| &trial.outcome) {
            let was = outcomes.iter().find(|was| was.trial == now.trial);
            if let Some(was) = was.filter(|was| was.ticks != now.ticks) {
                print_to_stderr(&format!(
                    "digests: {} takes {} ms here, {} ms where they were updated",
                    now.trial, now.ticks, was.ticks
                ));
            }
        }
        let violations = outcome_violations(&outcomes, &run);
        assert!(violations.is_empty(), "trials end otherwise on {platform}:\n{}", violations.join("\n"));
        return Ok(());
    };
    let different = digest_differences(&committed, &outcomes, &run);
    let named: Vec<String> = different.iter().map(ToString::to_string).collect();
    assert!(
        named.is_empty(),
        "digests differ from those committed for {platform}:\n{}\nIf this is meant: ./proact update-digests \"REASON\"",
        named.join("\n")
    );
    Ok(())
}

/// A repository with one trial of half a second, and `proact update-digests` in it.
struct DigestRepository(tempfile::TempDir);

impl DigestRepository {
    fn new() -> Outcome<Self> {
        let repository = Self(tempfile::tempdir()?);
        fs::create_dir_all(repository.path().join("tests/digests"))?;
        fs::write(
            repository.path().join("CHANGELOG.md"),
            "# Changelog\n\n## Unreleased\n\n### Added\n- a\n",
        )?;
        repository.list("limit_secs=0.5")?;
        Ok(repository)
    }

    fn path(&self) -> &Path {
        self.0.path()
    }

    fn list(&self, set: &str) -> Outcome {
        let list = format!(
            "[[trial]]\nname = \"D\"\nmethod = \"D\"\nsetup = \"still\"\nseed = 1\nset = [\"{set}\"]\n"
        );
        Ok(fs::write(self.path().join("tests/digests/trials.toml"), list)?)
    }

    fn update_digests(&self, reason: &[&str]) -> Outcome<Output> {
        let mut program = Command::new(env!("CARGO_BIN_EXE_proact"));
        Ok(program.arg("update-digests").args(reason).arg("--repository").arg(self.path()).output()?)
    }

    fn changelog(&self) -> Outcome<String> {
        Ok(fs::read_to_string(self.path().join("CHANGELOG.md"))?)
    }
}

// Catches an update that happens by accident, without a word in the changelog.
#[test]
fn without_a_reason_no_digest_is_updated() -> Outcome {
    let repository = DigestRepository::new()?;
    for reason in [&[][..], &["  "]] {
        let output = repository.update_digests(reason)?;
        assert!(!output.status.success());
        let error = String::from_utf8(output.stderr)?;
        assert_eq!(
            error,
            "proact: update-digests needs the reason why results change: ./proact update-digests \"REASON\"\n"
        );
    }
    assert_eq!(fs::read_dir(repository.path().join("tests/digests"))?.count(), 1);
    assert!(!repository.changelog()?.contains("### Digests"));
    Ok(())
}

// Catches an update that says nothing of what changed, or that leaves traces when nothing did.
#[test]
fn an_update_writes_digests_and_one_line_and_a_second_one_changes_nothing() -> Outcome {
    let repository = DigestRepository::new()?;
    let (store, platform) = (DigestStore::in_repository(repository.path()), Platform::current());
    assert!(repository.update_digests(&["the", "first"])?.status.success());
    let first = store.digests(&platform)?.ok_or("nothing was written")?;
    assert_eq!((first["D"].spans.len(), store.outcomes()?[0].ticks), (5, 500));
    let changelog = repository.changelog()?;
    assert!(changelog.ends_with("### Digests\n- the first (1 trials, on a platform that had none).\n"));

    let again = repository.update_digests(&["nothing"])?;
    assert!(String::from_utf8(again.stdout)?.starts_with("nothing has changed"));
    assert_eq!(repository.changelog()?, changelog);

    repository.list("limit_secs=0.3")?;
    let shorter = repository.update_digests(&["a shorter trial"])?;
    let stdout = String::from_utf8(shorter.stdout)?;
    // In its last tick the shorter trial is finished.
    assert!(
        stdout.contains("D: first differs in ticks 201 to 300, in task.state; its configuration"),
        "{stdout}"
    );
    assert!(stdout.contains("dynamics 4 of 10, task 3 of 5"), "{stdout}");
    let line = "### Digests\n- a shorter trial (1 of 1 trials; ";
    assert!(repository.changelog()?.contains(line), "{}", repository.changelog()?);
    assert_eq!(store.outcomes()?[0].ticks, 300);
    Ok(())
}
