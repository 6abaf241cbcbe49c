use crate::{
    CONFIG_FILE, DIGESTS_FILE, EVENTS_FILE, INPUTS_FILE, InputLog, RESULT_FILE, RecordingError,
    checked_lines::{LineWriter, read_lines},
    input_log::{InputLogWriter, LogHeader},
};
use proact_types::{Event, EventKind, SimTime, TickInput};
use serde::{Serialize, de::DeserializeOwned};
use std::{
    collections::BTreeMap,
    fs::{self, File},
    io::{ErrorKind, Write},
    path::{Path, PathBuf},
};

/// Ticks between two hand-overs to the operating system: what a crash of the process can lose.
pub const FLUSH_TICKS: u64 = 100;

/// What a trial is, besides its inputs.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct TrialHeader {
    /// The whole configuration, as TOML text.
    pub config_toml: String,
    /// Seed of every random stream of the trial.
    pub seed: u64,
    /// Versions of program and libraries, by name.
    pub versions: BTreeMap<String, String>,
}

/// Writes one trial directory.
///
/// Logs grow while the trial runs and are handed to the operating system every [`FLUSH_TICKS`] ticks, so a crash
/// of the process loses at most those. `result.json` comes last and in one piece: a directory without it is
/// an unfinished trial.
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
        fs::create_dir_all(dir).map_err(RecordingError::io("create the trial directory", dir))?;
        let mut entries = fs::read_dir(dir).map_err(RecordingError::io("read", dir))?;
        if entries.next().is_some() {
            return Err(RecordingError::OutputExists { dir: dir.to_owned() });
        }
        Self::create_files(dir, header).inspect_err(|_| {
            // The first error is the one to report; what cannot be removed stays.
            for name in [CONFIG_FILE, INPUTS_FILE, DIGESTS_FILE, EVENTS_FILE] {
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
        let (mut config, config_path) = create(CONFIG_FILE)?;
        config
            .write_all(header.config_toml.as_bytes())
            .and_then(|()| config.sync_all())
            .map_err(RecordingError::io("write to", &config_path))?;
        let log_header = LogHeader {
            seed: header.seed,
            versions: header.versions.clone(),
            config_crc32: crc32fast::hash(header.config_toml.as_bytes()),
        };
        let (inputs, inputs_path) = create(INPUTS_FILE)?;
        let (digests, digests_path) = create(DIGESTS_FILE)?;
        let (events, events_path) = create(EVENTS_FILE)?;
        Ok(TrialWriter {
            dir: dir.to_owned(),
            inputs: InputLogWriter::new(inputs, &inputs_path, &log_header)?,
            digests: LineWriter::new(digests, &digests_path, true),
            events: LineWriter::new(events, &events_path, false),
            last_flush: SimTime(0),
        })
    }

    /// The trial directory.
    pub fn dir(&self) -> &Path {
        &self.dir
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

    /// Appends one entry of the digest chain, and hands everything to the operating system: after a crash the
    /// inputs of every digest are there.
    ///
    /// # Errors
    /// [`RecordingError::Io`]; [`RecordingError::Encode`] if it is no JSON.
    pub fn write_digest<T: Serialize>(&mut self, digest: &T) -> Result<(), RecordingError> {
        self.digests.write(digest)?;
        self.flush()
    }

    /// Appends one event.
    ///
    /// # Errors
    /// [`RecordingError::NotFinite`], because JSON has no such number; [`RecordingError::Io`].
    pub fn write_event(&mut self, event: &Event) -> Result<(), RecordingError> {
        if let EventKind::BlockOnTarget { distance, .. } = event.kind
            && !distance.is_finite()
        {
            let what = "the distance of a block on target";
            return Err(RecordingError::NotFinite { what, value: distance, time: event.time });
        }
        self.events.write(event)
    }

    /// Ends the trial at its last tick `end`: closes the logs, then writes `result.json` in one piece.
    /// A bag has to be finished before.
    ///
    /// # Errors
    /// [`RecordingError::Io`], [`RecordingError::Encode`], [`RecordingError::OutOfOrder`] if a later tick was
    /// written. The trial is then unfinished.
    pub fn finish<R: Serialize>(self, end: SimTime, result: &R) -> Result<PathBuf, RecordingError> {
        let mut json = serde_json::to_vec_pretty(result).map_err(RecordingError::encode("the result"))?;
        json.push(b'\n');
        self.inputs.finish(end)?;
        self.digests.finish()?;
        self.events.finish()?;
        write_atomically(&self.dir, RESULT_FILE, &json)?;
        Ok(self.dir)
    }

    fn flush(&mut self) -> Result<(), RecordingError> {
        self.inputs.flush()?;
        self.digests.flush()?;
        self.events.flush()
    }
}

/// Writes a file under a temporary name, to the disk, and only then gives it its name.
fn write_atomically(dir: &Path, name: &str, bytes: &[u8]) -> Result<(), RecordingError> {
    let (path, temporary) = (dir.join(name), dir.join(format!("{name}.tmp")));
    let write = || {
        let mut file = File::create(&temporary)?;
        file.write_all(bytes)?;
        file.sync_all()?;
        fs::rename(&temporary, &path)?;
        // The new name is on the disk only when the directory is.
        File::open(dir)?.sync_all()
    };
    write().map_err(|source| {
        // The first error is the one to report.
        let _ = fs::remove_file(&temporary);
        RecordingError::Io { action: "write", path: path.clone(), source }
    })
}

/// A trial directory, opened for reading.
#[derive(Clone, Debug)]
pub struct Trial {
    dir: PathBuf,
    header: TrialHeader,
}

impl Trial {
    /// Opens the trial in `dir` and checks that its configuration is the one it ran with.
    ///
    /// # Errors
    /// [`RecordingError::NotATrial`] if a file is missing; [`RecordingError::Damaged`] if the head of the log or
    /// the configuration was changed.
    pub fn open(dir: &Path) -> Result<Self, RecordingError> {
        let log = InputLog::open(dir)?;
        let path = dir.join(CONFIG_FILE);
        let bytes = fs::read(&path).map_err(|source| match source.kind() {
            ErrorKind::NotFound => RecordingError::NotATrial { dir: dir.to_owned(), missing: CONFIG_FILE },
            _ => RecordingError::Io { action: "read", path: path.clone(), source },
        })?;
        let LogHeader { seed, versions, config_crc32 } = log.header().clone();
        let damaged = |offset: u64, reason: &str| RecordingError::Damaged {
            file: path.clone(),
            offset,
            reason: reason.to_owned(),
        };
        if crc32fast::hash(&bytes) != config_crc32 {
            return Err(damaged(0, "it was changed after the trial began"));
        }
        let config_toml = String::from_utf8(bytes)
            .map_err(|e| damaged(e.utf8_error().valid_up_to() as u64, "it is not UTF-8 text"))?;
        Ok(Trial { dir: dir.to_owned(), header: TrialHeader { config_toml, seed, versions } })
    }

    /// The trial directory.
    pub fn dir(&self) -> &Path {
        &self.dir
    }

    /// Configuration, seed and versions.
    pub fn header(&self) -> &TrialHeader {
        &self.header
    }

    /// The input log, from its first record.
    ///
    /// # Errors
    /// As [`InputLog::open`].
    pub fn inputs(&self) -> Result<InputLog, RecordingError> {
        InputLog::open(&self.dir)
    }

    /// The digest chain.
    ///
    /// # Errors
    /// [`RecordingError::Damaged`] or [`RecordingError::Truncated`] with the offset of the line.
    pub fn digests<T: DeserializeOwned>(&self) -> Result<Vec<T>, RecordingError> {
        read_lines(&self.dir.join(DIGESTS_FILE), true)
    }

    /// The events.
    ///
    /// # Errors
    /// [`RecordingError::Damaged`] or [`RecordingError::Truncated`] with the offset of the line.
    pub fn events(&self) -> Result<Vec<Event>, RecordingError> {
        read_lines(&self.dir.join(EVENTS_FILE), false)
    }
}

/// The result of the trial in `dir`.
///
/// # Errors
/// [`RecordingError::Unfinished`] if the trial was broken off, [`RecordingError::NotATrial`] if there is none,
/// [`RecordingError::Damaged`] if the file is not what it should be.
pub fn read_result<R: DeserializeOwned>(dir: &Path) -> Result<R, RecordingError> {
    let path = dir.join(RESULT_FILE);
    let bytes = fs::read(&path).map_err(|source| match source.kind() {
        ErrorKind::NotFound if dir.join(INPUTS_FILE).exists() => {
            RecordingError::Unfinished { dir: dir.to_owned() }
        }
        ErrorKind::NotFound => RecordingError::NotATrial { dir: dir.to_owned(), missing: INPUTS_FILE },
        _ => RecordingError::Io { action: "read", path: path.clone(), source },
    })?;
    serde_json::from_slice(&bytes).map_err(|error| RecordingError::Damaged {
        file: path,
        offset: byte_of(&bytes, error.line(), error.column()),
        reason: error.to_string(),
    })
}

/// Byte offset of a line and column, both from one, as serde_json reports them.
fn byte_of(bytes: &[u8], line: usize, column: usize) -> u64 {
    let before: usize =
        bytes.split_inclusive(|b| *b == b'\n').take(line.saturating_sub(1)).map(<[u8]>::len).sum();
    (before + column.saturating_sub(1)) as u64
}
