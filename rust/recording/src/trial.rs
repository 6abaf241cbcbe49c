use crate::{
    CONFIG_FILE, DIGESTS_FILE, EVENTS_FILE, INPUTS_FILE, InputLog, InputRecord, LogEnd, MANIFEST_FILE,
    RECORD_FORMAT, RESULT_FILE, RecordingError, TrialHeader,
    checked_lines::{ValidLines, read_lines},
    files, format,
    input_log::LogHeader,
    manifest,
    trial_writer::Coverage,
};
use proact_types::{Event, MAX_TEXT_BYTES, SimTime, TickInput};
use serde::de::DeserializeOwned;
use serde_json::Value;
use std::{
    fs,
    io::ErrorKind,
    path::{Path, PathBuf},
};

/// A recorded trial, opened for reading: finished, or interrupted and good up to its last digest.
///
/// A finished one has a manifest, and every file is as the manifest says. Of one without a manifest, whose process ended
/// before the trial did, counts what its digests vouch for: the inputs and events that the last good line of
/// `digests.log` counts were written before it. What lies behind is left out.
#[derive(Clone, Debug)]
pub struct TrialRecord {
    dir: PathBuf,
    format: u32,
    header: TrialHeader,
    is_finished: bool,
    extent: RecordExtent,
}

/// How much of a record counts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct RecordExtent {
    end: SimTime,
    digests: usize,
    inputs: u64,
    events: u64,
}

impl TrialRecord {
    /// Opens the trial in `dir` and checks it as a whole.
    ///
    /// # Errors
    /// [`RecordingError::NotATrial`] if there is none; [`RecordingError::WrongFormat`] for one of another program;
    /// [`RecordingError::Changed`] if a file of a finished trial, or one that the trial began with, is not what it was;
    /// [`RecordingError::Damaged`] if bytes that a digest vouches for cannot be read, [`RecordingError::UnknownKey`] if they have an
    /// unknown key.
    pub fn open(dir: &Path) -> Result<Self, RecordingError> {
        let mut log = match InputLog::open(dir) {
            Ok(log) => log,
            Err(error) => return Self::open_unstarted(dir, error),
        };
        let own = [CONFIG_FILE, INPUTS_FILE, DIGESTS_FILE, EVENTS_FILE, RESULT_FILE];
        let manifest = manifest::check(dir, &own);
        let finished = !matches!(manifest, Ok(false));
        let header = match (read_header(dir, log.header()), &manifest) {
            // A swapped log lists the hashes of another trial; only the manifest names the log itself.
            (Err(RecordingError::Changed { .. }), Err(RecordingError::Changed { dir, files })) => {
                return Err(RecordingError::Changed { dir: dir.clone(), files: files.clone() });
            }
            (Err(RecordingError::Changed { dir, .. }), Ok(false))
                if is_log_of_other_trial(&dir, &mut log) =>
            {
                let files = format!(
                    "{INPUTS_FILE} is of another trial than {CONFIG_FILE}, {DIGESTS_FILE} and {RESULT_FILE}, which agree"
                );
                return Err(RecordingError::Changed { dir, files });
            }
            (header, _) => header?,
        };
        let mut inputs = 0;
        let mut stop = None;
        for record in &mut log {
            match record {
                Ok(_) => inputs += 1,
                Err(error) => stop = Some(error),
            }
        }
        let digests: ValidLines<Coverage> = read_lines(&dir.join(DIGESTS_FILE), true)?;
        let events: ValidLines<Event> = read_lines(&dir.join(EVENTS_FILE), false)?;
        check_order(&dir.join(DIGESTS_FILE), &digests)?;

        let covered = |line: &Coverage| line.inputs <= inputs && line.events <= events.values.len() as u64;
        let good = digests.values.iter().take_while(|line| covered(line)).count();
        // What is cut off is missing; what is damaged was changed, unless no digest vouches for it.
        let vouched = good < digests.values.len();
        let damaged = |error: &RecordingError| !matches!(error, RecordingError::Truncated { .. });
        let stops = [(stop, vouched), (digests.error, true), (events.error, vouched)];
        for (error, counts) in stops {
            if let Some(error) = error.filter(|error| finished || (counts && damaged(error))) {
                return Err(error);
            }
        }
        let last = digests.values[..good].last();
        let extent = last.map_or(RecordExtent::default(), |line| RecordExtent {
            end: line.tick,
            digests: good,
            inputs: line.inputs,
            events: line.events,
        });
        let trial =
            TrialRecord { dir: dir.to_owned(), format: log.format(), header, is_finished: finished, extent };
        // A result is written when the logs are on the disk: with it they are whole, if only the manifest is missing.
        if finished || dir.join(RESULT_FILE).exists() {
            let end = log.end().map_or(SimTime(0), |end| end.time);
            let whole = (end, digests.values.len(), inputs, events.values.len() as u64);
            if whole != (extent.end, extent.digests, extent.inputs, extent.events) {
                return Err(trial.inconsistency_error(end));
            }
            // Whatever else is wrong was told before, with its place.
            manifest?;
        }
        Ok(trial)
    }

    /// The trial in `dir` if its process ended while it made the directory: there is a file for digests, with nothing in it
    /// yet, and no whole head of an input log.
    fn open_unstarted(dir: &Path, error: RecordingError) -> Result<Self, RecordingError> {
        let empty = |name| fs::metadata(dir.join(name)).is_ok_and(|file| file.is_file() && file.len() == 0);
        let cut = matches!(error, RecordingError::NotATrial { .. } | RecordingError::Truncated { .. });
        if !cut || !empty(DIGESTS_FILE) || dir.join(MANIFEST_FILE).exists() {
            return Err(error);
        }
        let (dir, header, extent) = (dir.to_owned(), TrialHeader::default(), RecordExtent::default());
        Ok(TrialRecord { dir, format: RECORD_FORMAT, header, is_finished: false, extent })
    }

    /// The format of the record.
    pub fn format(&self) -> u32 {
        self.format
    }

    /// Refuses a record that can be read, but whose inputs lead to another digest in this program.
    ///
    /// # Errors
    /// [`RecordingError::WrongFormat`] with the program that replays it.
    pub fn check_replayable(&self) -> Result<(), RecordingError> {
        let writer = self.header.versions.get("proact").map(String::as_str);
        format::check_replayable(&self.dir, self.format, writer)
    }

    fn inconsistency_error(&self, end: SimTime) -> RecordingError {
        let RecordExtent { end: digested, inputs, events, .. } = self.extent;
        RecordingError::Changed {
            dir: self.dir.clone(),
            files: format!(
                "{INPUTS_FILE} ends at tick {}, the last line of {DIGESTS_FILE} at tick {} with {inputs} inputs and \
                 {events} events",
                end.0, digested.0
            ),
        }
    }

    /// Whether there is a trial in `dir`, of whatever kind: a log of inputs, or of digests if it was interrupted while its
    /// directory was made.
    pub fn exists_in(dir: &Path) -> bool {
        [INPUTS_FILE, DIGESTS_FILE].iter().any(|name| dir.join(name).is_file())
    }

    /// The trial directory.
    pub fn dir(&self) -> &Path {
        &self.dir
    }

    /// Configuration, seed, versions and the files that the trial began with; all empty if it was interrupted while it was
    /// about to begin.
    pub fn header(&self) -> &TrialHeader {
        &self.header
    }

    /// Whether the trial was brought to its end, and its record closed.
    pub fn is_finished(&self) -> bool {
        self.is_finished
    }

    /// Last tick of the record; zero if it was interrupted before its first digest.
    pub fn end(&self) -> SimTime {
        self.extent.end
    }

    /// The inputs up to [`TrialRecord::end`], in ascending order.
    ///
    /// # Errors
    /// As [`InputLog::open`].
    pub fn inputs(
        &self,
    ) -> Result<impl Iterator<Item = Result<InputRecord, RecordingError>> + use<>, RecordingError> {
        let log = (self.extent.inputs > 0).then(|| InputLog::open(&self.dir)).transpose()?;
        Ok(log.into_iter().flatten().take(usize::try_from(self.extent.inputs).unwrap_or(usize::MAX)))
    }

    /// Each tick from the first to [`TrialRecord::end`] with what came in; what is empty was not recorded.
    ///
    /// # Errors
    /// As [`InputLog::open`]; of an item, [`RecordingError::Damaged`].
    pub fn ticks(
        &self,
    ) -> Result<impl Iterator<Item = Result<(SimTime, TickInput), RecordingError>> + use<>, RecordingError>
    {
        let mut inputs = self.inputs()?;
        let mut next = inputs.next().transpose()?;
        Ok((1..=self.end().0).map(move |tick| {
            let mut input = TickInput::default();
            while let Some(record) = next.take_if(|record| record.tick.0 <= tick) {
                input = record.input;
                next = inputs.next().transpose()?;
            }
            Ok((SimTime(tick), input))
        }))
    }

    /// The digest chain up to [`TrialRecord::end`].
    ///
    /// # Errors
    /// [`RecordingError::Damaged`] with the offset of a line that is no JSON, [`RecordingError::UnknownKey`] with one that is no `T`.
    pub fn digests<T: DeserializeOwned>(&self) -> Result<Vec<T>, RecordingError> {
        read_lines(&self.dir.join(DIGESTS_FILE), true)?.take_first(self.extent.digests)
    }

    /// The events up to [`TrialRecord::end`].
    ///
    /// # Errors
    /// [`RecordingError::Damaged`] with the offset of the line, [`RecordingError::UnknownKey`] with its unknown key.
    pub fn events(&self) -> Result<Vec<Event>, RecordingError> {
        if self.extent == RecordExtent::default() {
            return Ok(Vec::new());
        }
        let lines = read_lines(&self.dir.join(EVENTS_FILE), false)?;
        lines.take_first(usize::try_from(self.extent.events).unwrap_or(usize::MAX))
    }
}

/// Whether the input log alone is of another trial, in a record without a manifest: configuration, digests and result agree in the
/// seed and in the last digest, and the log has another seed, or ends elsewhere than the digests.
fn is_log_of_other_trial(dir: &Path, log: &mut InputLog) -> bool {
    let Ok(Some((seed, last))) = seed_of_other_files(dir) else { return false };
    log.by_ref().for_each(drop);
    let ends_there = |end: LogEnd| (end.time, end.records) == (last.tick, last.inputs);
    log.header().seed != seed || !log.end().is_some_and(ends_there)
}

/// Seed and last line of the digests, if configuration, digests and result agree in the seed and in the last digest.
fn seed_of_other_files(dir: &Path) -> Result<Option<(u64, Coverage)>, RecordingError> {
    let result: Value = read_result(dir)?;
    let path = dir.join(CONFIG_FILE);
    let config = files::read(&path, MAX_TEXT_BYTES).map_err(RecordingError::io("read", &path))?;
    let config = String::from_utf8_lossy(&config);
    let lines: ValidLines<Value> = read_lines(&dir.join(DIGESTS_FILE), true)?;
    let mut coverage: ValidLines<Coverage> = read_lines(&dir.join(DIGESTS_FILE), true)?;
    let (Some(line), Some(last)) = (lines.values.last(), coverage.values.pop()) else {
        return Ok(None);
    };
    // The keys before the first section; a seed beyond what TOML has is a text.
    let mut own = config.lines().take_while(|line| !line.starts_with('['));
    let of_config =
        own.find_map(|line| line.strip_prefix("seed = ")).map(|seed| seed.trim().trim_matches('"'));
    let Some(seed) = result.get("seed").and_then(Value::as_u64) else { return Ok(None) };
    let agree = of_config == Some(&*seed.to_string()) && result.get("digest") == line.get("chain");
    Ok(agree.then_some((seed, last)))
}

/// What the trial began with, which must be what the head of the log says.
fn read_header(dir: &Path, head: &LogHeader) -> Result<TrialHeader, RecordingError> {
    let mut files = std::collections::BTreeMap::new();
    let mut changed = Vec::new();
    let not_of_it = |name: &str| format!("{name} is not the one that {INPUTS_FILE} was begun with");
    for (name, sum) in &head.files {
        let path = dir.join(name);
        match files::read(&path, MAX_TEXT_BYTES) {
            Ok(bytes) if manifest::sha256_of_bytes(&bytes) == *sum => {
                files.insert(name.clone(), bytes);
            }
            Ok(_) => changed.push(not_of_it(name)),
            Err(error) if error.kind() == ErrorKind::NotFound => changed.push(format!("{name} is missing")),
            Err(source) => return Err(RecordingError::Io { action: "read", path, source }),
        }
    }
    let config_toml = files.remove(CONFIG_FILE).and_then(|bytes| String::from_utf8(bytes).ok());
    match config_toml {
        Some(config_toml) if changed.is_empty() => {
            let LogHeader { seed, versions, commit, study_trial, .. } = head.clone();
            Ok(TrialHeader { config_toml, seed, versions, commit, study_trial, files })
        }
        _ => {
            if changed.is_empty() {
                changed.push(format!("{CONFIG_FILE} is no text"));
            }
            Err(RecordingError::Changed { dir: dir.to_owned(), files: changed.join(", ") })
        }
    }
}

/// Each digest is of a later tick than the one before, and counts no less.
fn check_order(path: &Path, digests: &ValidLines<Coverage>) -> Result<(), RecordingError> {
    let lines = digests.values.iter().zip(digests.values.iter().skip(1));
    for (number, (one, next)) in lines.enumerate() {
        if next.tick <= one.tick || next.inputs < one.inputs || next.events < one.events {
            return Err(RecordingError::Damaged {
                file: path.to_owned(),
                offset: digests.offsets[number + 1],
                reason: format!(
                    "the digest of tick {} stands after that of tick {}",
                    next.tick.0, one.tick.0
                ),
            });
        }
    }
    Ok(())
}

/// The result of the trial in `dir`.
///
/// # Errors
/// [`RecordingError::Unfinished`] if the trial was broken off, [`RecordingError::NotATrial`] if there is none,
/// [`RecordingError::UnknownKey`] for a key or value that is not one of `R`, [`RecordingError::Damaged`] for a file that is no JSON.
pub fn read_result<R: DeserializeOwned>(dir: &Path) -> Result<R, RecordingError> {
    let path = dir.join(RESULT_FILE);
    let bytes = files::read(&path, MAX_TEXT_BYTES).map_err(|source| match source.kind() {
        ErrorKind::NotFound if dir.join(INPUTS_FILE).exists() => {
            RecordingError::Unfinished { dir: dir.to_owned() }
        }
        ErrorKind::NotFound => RecordingError::NotATrial { dir: dir.to_owned(), missing: INPUTS_FILE },
        _ => RecordingError::Io { action: "read", path: path.clone(), source },
    })?;
    serde_json::from_slice(&bytes).map_err(|error| {
        let offset = byte_offset(&bytes, error.line(), error.column());
        RecordingError::json(&path, error.line().max(1), offset, &error)
    })
}

/// Refuses the file `name` of JSON lines in `dir` if a line has keys or values that are not those of `T`. A file that is not there
/// and a last line that is cut off pass.
///
/// # Errors
/// [`RecordingError::UnknownKey`] with the line; [`RecordingError::Io`].
pub fn check_lines<T: DeserializeOwned>(dir: &Path, name: &str) -> Result<(), RecordingError> {
    let path = dir.join(name);
    if !path.exists() {
        return Ok(());
    }
    match read_lines::<T>(&path, false)?.error {
        Some(error @ RecordingError::UnknownKey { .. }) => Err(error),
        _ => Ok(()),
    }
}

/// Byte offset of a line and column, both from one, as serde_json reports them.
fn byte_offset(bytes: &[u8], line: usize, column: usize) -> u64 {
    let before: usize =
        bytes.split_inclusive(|b| *b == b'\n').take(line.saturating_sub(1)).map(<[u8]>::len).sum();
    (before + column.saturating_sub(1)) as u64
}
