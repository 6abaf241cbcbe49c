use crate::{
    CONFIG_FILE, DIGESTS_FILE, EVENTS_FILE, INPUTS_FILE, RESULT_FILE, RecordingError, UNKNOWN_COMMIT,
    checked_lines::LineWriter,
    input_log::{InputLogWriter, LogHeader},
    manifest,
};
use proact_files::{make_folder, write_atomically};
use proact_types::{Event, EventKind, SimTime, TickInput};
use serde::{Deserialize, Serialize};
use std::{
    collections::BTreeMap,
    fs::{self, File},
    io::Write,
    path::{Path, PathBuf},
};

/// Ticks between two hand-overs to the operating system: what a crash of the process can lose.
pub const FLUSH_TICKS: u64 = 100;

/// The place of a trial in a study. All numbers count from 1.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StudyTrialId {
    /// The participant's place in the plan.
    pub participant: usize,
    /// Name of the session.
    pub session: String,
    /// Name of the condition.
    pub condition: String,
    /// Among the participant's trials of the condition.
    pub trial: usize,
    /// How often the trial was begun, this time included.
    pub attempt: usize,
}

impl std::fmt::Display for StudyTrialId {
    fn fmt(&self, to: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { participant, session, condition, trial, attempt } = self;
        write!(
            to,
            "participant {participant}, session {session:?}, condition {condition:?}, trial {trial}, attempt {attempt}"
        )
    }
}

/// What a trial is, besides its inputs.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TrialHeader {
    /// The whole configuration, as TOML text.
    pub config_toml: String,
    /// Seed of every random stream of the trial.
    pub seed: u64,
    /// Versions of program and libraries, by name.
    pub versions: BTreeMap<String, String>,
    /// Source commit of the program that records, or [`UNKNOWN_COMMIT`](crate::UNKNOWN_COMMIT).
    pub commit: String,
    /// Where in a study the trial belongs; none for a trial of its own.
    pub study_trial: Option<StudyTrialId>,
    /// What else the trial depends on, as files by name: a trained classifier, the description of an arm.
    pub files: BTreeMap<String, Vec<u8>>,
}

impl TrialHeader {
    /// The program that recorded the trial, with its commit.
    pub fn writer(&self) -> String {
        let version = self.versions.get("proact").map_or("of an unknown version", String::as_str);
        match self.commit.as_str() {
            UNKNOWN_COMMIT => format!("proact {version} at an unknown commit"),
            commit => format!("proact {version} at commit {commit}"),
        }
    }
}

impl Default for TrialHeader {
    fn default() -> Self {
        Self {
            config_toml: String::new(),
            seed: 0,
            versions: BTreeMap::new(),
            commit: UNKNOWN_COMMIT.to_owned(),
            study_trial: None,
            files: BTreeMap::new(),
        }
    }
}

/// A line of `digests.log`: a digest, and of how much it can be recomputed. Inputs and events that are counted here were
/// handed to the operating system before.
#[derive(Debug, Serialize)]
struct DigestLine<'a, T> {
    #[serde(flatten)]
    digest: &'a T,
    inputs: u64,
    events: u64,
}

/// What every such line says, whatever the digest.
#[derive(Debug, Deserialize)]
pub(crate) struct Coverage {
    /// Last tick that went into the digest.
    pub tick: SimTime,
    /// Records of `inputs.log` up to there.
    pub inputs: u64,
    /// Lines of `events.jsonl` up to there.
    pub events: u64,
}

/// Writes one trial directory.
///
/// Logs grow while the trial runs and are handed to the operating system every [`FLUSH_TICKS`] ticks, so a crash of the
/// process loses at most those. A digest is handed over after the inputs and the events that it counts. `result.json`
/// comes when all else is complete, and the manifest, which covers it too, last: a directory without a manifest is an
/// interrupted trial.
#[derive(Debug)]
pub struct TrialWriter {
    dir: PathBuf,
    inputs: InputLogWriter,
    digests: LineWriter,
    events: LineWriter,
    last_flush: SimTime,
}

impl TrialWriter {
    /// Makes `dir` and the files in it. Call it before anything runs.
    ///
    /// # Errors
    /// [`RecordingError::OutputExists`] if there is something in `dir`; [`RecordingError::Io`] if the place
    /// cannot be written.
    /// Nothing that was made is then left behind, but for parent directories.
    pub fn create(dir: &Path, header: &TrialHeader) -> Result<Self, RecordingError> {
        let existed = dir.exists();
        make_folder(dir)
            .map_err(|error| RecordingError::io("create the trial directory", dir)(error.into()))?;
        let mut entries = fs::read_dir(dir).map_err(RecordingError::io("read", dir))?;
        if entries.next().is_some() {
            return Err(RecordingError::OutputExists { dir: dir.to_owned() });
        }
        Self::create_files(dir, header).inspect_err(|_| {
            // The first error is the one to report; what cannot be removed stays.
            let own = header.files.keys().map(String::as_str);
            for name in [CONFIG_FILE, INPUTS_FILE, DIGESTS_FILE, EVENTS_FILE].into_iter().chain(own) {
                let _ = fs::remove_file(dir.join(name));
            }
            if !existed {
                let _ = fs::remove_dir(dir);
            }
        })
    }

    fn create_files(dir: &Path, header: &TrialHeader) -> Result<Self, RecordingError> {
        let create = |name: &str| -> Result<(File, PathBuf), RecordingError> {
            let path = dir.join(name);
            let file = File::create_new(&path).map_err(RecordingError::io("create", &path))?;
            Ok((file, path))
        };
        // First: a directory with digests, if none yet, and no input log is of a trial that was about to begin.
        let (digests, digests_path) = create(DIGESTS_FILE)?;
        let (events, events_path) = create(EVENTS_FILE)?;
        // What the trial depends on is on the disk before anything depends on it.
        let mut files = BTreeMap::new();
        let own = header.files.iter().map(|(name, bytes)| (name.as_str(), bytes.as_slice()));
        for (name, bytes) in own.chain([(CONFIG_FILE, header.config_toml.as_bytes())]) {
            let (mut file, path) = create(name)?;
            file.write_all(bytes)
                .and_then(|()| file.sync_all())
                .map_err(RecordingError::io("write to", &path))?;
            files.insert(name.to_owned(), manifest::sha256_of_bytes(bytes));
        }
        let log_header = LogHeader {
            seed: header.seed,
            versions: header.versions.clone(),
            commit: header.commit.clone(),
            study_trial: header.study_trial.clone(),
            files,
        };
        // Last: a directory with an input log has all that a trial begins with.
        let (inputs, inputs_path) = create(INPUTS_FILE)?;
        let inputs = InputLogWriter::new(inputs, &inputs_path, &log_header)?;
        sync_dir(dir)?;
        Ok(TrialWriter {
            dir: dir.to_owned(),
            inputs,
            digests: LineWriter::new(digests, &digests_path, true),
            events: LineWriter::new(events, &events_path, false),
            last_flush: SimTime(0),
        })
    }

    /// The trial directory.
    pub fn dir(&self) -> &Path {
        &self.dir
    }

    /// The files that grow, for whoever hands them to the disk from time to time.
    ///
    /// # Errors
    /// [`RecordingError::Io`].
    pub fn growing_files(&self) -> Result<Vec<File>, RecordingError> {
        Ok(vec![self.inputs.file()?, self.events.file()?, self.digests.file()?])
    }

    /// Records the input of `tick`. Call it every tick, in order; a tick without input takes no space.
    ///
    /// Every bit is kept, NaN included: the log says what came in, whatever it was worth.
    ///
    /// # Errors
    /// [`RecordingError::OutOfOrder`], and [`RecordingError::Io`] such as a full disk.
    pub fn write_input(&mut self, tick: SimTime, input: &TickInput) -> Result<(), RecordingError> {
        self.inputs.write(tick, input)?;
        if tick.millis_since(self.last_flush) >= FLUSH_TICKS {
            self.last_flush = tick;
            self.flush()?;
        }
        Ok(())
    }

    /// Appends one entry of the digest chain, over all ticks so far, and hands everything to the operating system. Call it
    /// after the tick's input and events: the entry counts them. A digest is a struct with the field `tick`, the last tick
    /// that went into it.
    ///
    /// # Errors
    /// [`RecordingError::Io`]; [`RecordingError::Encode`] if it is no JSON.
    pub fn write_digest<T: Serialize>(&mut self, digest: &T) -> Result<(), RecordingError> {
        self.inputs.flush()?;
        self.events.flush()?;
        let (inputs, events) = (self.inputs.records(), self.events.lines());
        self.digests.write(&DigestLine { digest, inputs, events })?;
        self.digests.flush()
    }

    /// Appends one event.
    ///
    /// # Errors
    /// [`RecordingError::NotFinite`], because JSON has no such number; [`RecordingError::Io`].
    pub fn write_event(&mut self, event: &Event) -> Result<(), RecordingError> {
        if let EventKind::ObjectOnTarget { distance, .. } = event.kind
            && !distance.is_finite()
        {
            let what = "the distance of a block on target";
            return Err(RecordingError::NotFinite { what, value: distance, time: event.time });
        }
        self.events.write(event)
    }

    /// Ends the trial at its last tick `end`: closes the logs, writes `result.json` in one piece, then the manifest.
    /// Every other file of the directory, such as a bag, has to be finished before.
    ///
    /// # Errors
    /// [`RecordingError::Io`], [`RecordingError::Encode`], [`RecordingError::OutOfOrder`] if a later tick was
    /// written. The trial is then an interrupted one.
    pub fn finish<R: Serialize>(self, end: SimTime, result: &R) -> Result<PathBuf, RecordingError> {
        let mut json = serde_json::to_vec_pretty(result).map_err(RecordingError::encode("the result"))?;
        json.push(b'\n');
        self.inputs.finish(end)?;
        self.events.finish()?;
        self.digests.finish()?;
        write_file(&self.dir.join(RESULT_FILE), &json)?;
        manifest::write_manifest(&self.dir)?;
        Ok(self.dir)
    }

    fn flush(&mut self) -> Result<(), RecordingError> {
        self.inputs.flush()?;
        self.events.flush()
    }
}

/// Writes a file of a record as a whole.
pub(crate) fn write_file(path: &Path, bytes: &[u8]) -> Result<(), RecordingError> {
    write_atomically(path, bytes).map_err(|error| RecordingError::io("write", path)(error.into()))
}

/// A new name is on the disk only when the directory is.
fn sync_dir(dir: &Path) -> Result<(), RecordingError> {
    File::open(dir).and_then(|dir| dir.sync_all()).map_err(RecordingError::io("write to", dir))
}
