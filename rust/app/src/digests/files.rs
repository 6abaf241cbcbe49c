use super::{Platform, TrialDigest, TrialEntry, TrialOutcome};
use proact_files::write_atomically;
use proact_testbed::{Digest, DigestField, SpanDigest};
use proact_types::SimTime;
use serde::Deserialize;
use std::{
    collections::BTreeMap,
    fmt::Write,
    fs, io,
    path::{Path, PathBuf},
};

/// The list of trials, in the folder of digests.
const LIST_FILE: &str = "trials.toml";
/// How they ended, the same file for all platforms.
const OUTCOMES_FILE: &str = "outcomes.jsonl";
/// In the place of a hash: nothing was said of the field in this span.
const NO_HASH: &str = "-";

/// Why committed digests cannot be read or written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum DigestError {
    /// The system refused.
    #[error("cannot {action} {}: {source}", path.display())]
    Io {
        /// Such as `read`.
        action: &'static str,
        /// Which file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// A file is not what `proact update-digests` writes.
    #[error("{}, line {line}: {reason}; `./proact update-digests` writes the file anew", path.display())]
    Unreadable {
        /// Which file.
        path: PathBuf,
        /// Where, from one; zero if it is no matter of a line.
        line: usize,
        /// What does not fit.
        reason: String,
    },
}

/// The folder of committed digests.
#[derive(Clone, Debug)]
pub struct DigestStore {
    dir: PathBuf,
}

impl DigestStore {
    /// That of the repository at `root`.
    pub fn in_repository(root: &Path) -> Self {
        Self { dir: root.join("tests/digests") }
    }

    /// The trials, in the order in which they run.
    ///
    /// # Errors
    /// [`DigestError`] for a list that is missing or malformed.
    pub fn trials(&self) -> Result<Vec<TrialEntry>, DigestError> {
        #[derive(Deserialize)]
        #[serde(deny_unknown_fields)]
        struct TrialListFile {
            trial: Vec<TrialEntry>,
        }
        let path = self.dir.join(LIST_FILE);
        let text = self.read(LIST_FILE)?.unwrap_or_default();
        let list: TrialListFile =
            toml::from_str(&text).map_err(|error| unreadable(&path, 0, &error.to_string()))?;
        Ok(list.trial)
    }

    /// The digests of `platform` by the trial's name, as [`TrialDigest`]s without outcome and chain; none if it has
    /// no file.
    ///
    /// # Errors
    /// [`DigestError`] for a malformed file.
    pub fn digests(&self, platform: &Platform) -> Result<Option<BTreeMap<String, TrialDigest>>, DigestError> {
        let name = platform.file_name();
        let Some(text) = self.read(&name)? else { return Ok(None) };
        let wrong = |line, reason: &str| unreadable(&self.dir.join(&name), line, reason);
        parse(&text).map(Some).map_err(|(line, reason)| wrong(line, &reason))
    }

    /// How the trials ended when the digests were updated; empty if they never were.
    ///
    /// # Errors
    /// [`DigestError`] for a malformed file.
    pub fn outcomes(&self) -> Result<Vec<TrialOutcome>, DigestError> {
        let path = self.dir.join(OUTCOMES_FILE);
        let text = self.read(OUTCOMES_FILE)?.unwrap_or_default();
        let read = |(k, line): (usize, &str)| {
            serde_json::from_str(line).map_err(|error| unreadable(&path, k + 1, &error.to_string()))
        };
        text.lines().enumerate().map(read).collect()
    }

    /// Writes the digests of `platform`, and the outcomes.
    ///
    /// # Errors
    /// [`DigestError::Io`].
    pub fn write(&self, platform: &Platform, trials: &[TrialDigest]) -> Result<(), DigestError> {
        let outcome = |trial: &TrialDigest| serde_json::to_string(&trial.outcome).map(|line| line + "\n");
        let outcomes: Result<String, _> = trials.iter().map(outcome).collect();
        let outcomes = outcomes.map_err(|error| self.io("write", OUTCOMES_FILE, error.into()))?;
        for (name, text) in
            [(platform.file_name(), print(platform, trials)), (OUTCOMES_FILE.into(), outcomes)]
        {
            write_atomically(&self.dir.join(&name), text)
                .map_err(|error| self.io("write", &name, error.into()))?;
        }
        Ok(())
    }

    fn read(&self, name: &str) -> Result<Option<String>, DigestError> {
        match fs::read_to_string(self.dir.join(name)) {
            Ok(text) => Ok(Some(text)),
            Err(error) if error.kind() == io::ErrorKind::NotFound && name != LIST_FILE => Ok(None),
            Err(error) => Err(self.io("read", name, error)),
        }
    }

    fn io(&self, action: &'static str, name: &str, source: io::Error) -> DigestError {
        DigestError::Io { action, path: self.dir.join(name), source }
    }
}

fn unreadable(path: &Path, line: usize, reason: &str) -> DigestError {
    DigestError::Unreadable { path: path.to_owned(), line, reason: reason.to_owned() }
}

/// The hash of a field of which nothing was said in a span.
fn no_hash() -> String {
    let empty = Digest::new("").end_tick(SimTime(1), true).and_then(|span| span.fields.into_iter().next());
    empty.expect("a last tick ends a span, which has a hash for each field")
}

fn print(platform: &Platform, trials: &[TrialDigest]) -> String {
    let nothing = no_hash();
    let names: Vec<&str> = DigestField::ALL.iter().map(|field| field.name()).collect();
    let mut text = format!("platform {platform}\nfields {}\n", names.join(" "));
    let mut add = |line: &[&str]| writeln!(text, "{}", line.join(" ")).expect("text takes every line");
    for trial in trials {
        add(&["trial", &trial.outcome.trial, "configuration", &trial.configuration]);
        for span in &trial.spans {
            let hashes =
                span.fields.iter().map(|hash| if *hash == nothing { NO_HASH } else { hash.as_str() });
            let tick = span.tick.0.to_string();
            add(&std::iter::once(tick.as_str()).chain(hashes).collect::<Vec<_>>());
        }
    }
    text
}

fn parse(text: &str) -> Result<BTreeMap<String, TrialDigest>, (usize, String)> {
    let nothing = no_hash();
    let names: Vec<&str> = DigestField::ALL.iter().map(|field| field.name()).collect();
    let mut trials: BTreeMap<String, TrialDigest> = BTreeMap::new();
    let mut current = String::new();
    for (k, line) in text.lines().enumerate() {
        let wrong = |reason: &str| (k + 1, reason.to_owned());
        let words: Vec<&str> = line.split(' ').collect();
        match words[..] {
            ["platform", _] if k == 0 => {}
            ["fields", ref fields @ ..] if k == 1 && *fields == names[..] => {}
            ["fields", ..] => return Err(wrong("the fields are not those of this program")),
            ["trial", name, "configuration", configuration] => {
                current = name.to_owned();
                let outcome =
                    TrialOutcome { trial: name.to_owned(), ticks: 0, on_target: 0, blocks: Vec::new() };
                let trial =
                    TrialDigest { outcome, configuration: configuration.to_owned(), spans: Vec::new() };
                if trials.insert(current.clone(), trial).is_some() {
                    return Err(wrong("the trial stands there twice"));
                }
            }
            [tick, ref hashes @ ..] if hashes.len() == names.len() => {
                let tick = tick.parse().map_err(|_| wrong("a span begins with its last tick"))?;
                let hash = |hash: &&str| if *hash == NO_HASH { nothing.clone() } else { (*hash).to_owned() };
                let fields = hashes.iter().map(hash).collect();
                let Some(trial) = trials.get_mut(&current) else {
                    return Err(wrong("a span before any trial"));
                };
                trial.outcome.ticks = tick;
                trial.spans.push(SpanDigest { tick: SimTime(tick), fields, chain_hash: String::new() });
            }
            _ => return Err(wrong("neither a trial nor a span with a hash for each field")),
        }
    }
    Ok(trials)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn trial() -> TrialDigest {
        let mut digest = Digest::new("a");
        digest.field(DigestField::Joints).number(0.5);
        let spans = digest.end_tick(SimTime(1), true).into_iter().collect();
        let outcome = TrialOutcome { trial: "D".into(), ticks: 1, on_target: 0, blocks: vec![] };
        TrialDigest { outcome, configuration: "0123456789abcdef".into(), spans }
    }

    #[test]
    fn digests_survive_their_file_without_the_chain() {
        let temp_dir = tempfile::tempdir().unwrap();
        fs::create_dir_all(temp_dir.path().join("tests/digests")).unwrap();
        let (store, platform) = (DigestStore::in_repository(temp_dir.path()), Platform::current());
        assert!(store.digests(&platform).unwrap().is_none(), "an unknown platform");
        assert!(store.outcomes().unwrap().is_empty());
        let mut trial = trial();
        store.write(&platform, std::slice::from_ref(&trial)).unwrap();
        trial.spans[0].chain_hash.clear();
        assert_eq!(store.digests(&platform).unwrap().unwrap()["D"], trial);
        assert_eq!(store.outcomes().unwrap(), [trial.outcome]);
    }

    #[test]
    fn a_damaged_file_is_refused_with_its_line() {
        let text = print(&Platform::current(), &[trial()]);
        assert!(parse(&text).is_ok());
        for (from, to, line) in [
            ("input.emg ", "", 2),
            ("trial D", "trial", 3),
            ("trial D", "spans D", 3),
            ("\n1 ", "\none ", 4),
            ("\n1 -", "\n1", 4),
        ] {
            let error = parse(&text.replacen(from, to, 1)).expect_err(from);
            assert_eq!(error.0, line, "{from:?}: {}", error.1);
        }
    }
}
