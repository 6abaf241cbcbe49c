//! `inputs.log`: everything that entered the testbed from outside, tick by tick.
//!
//! Layout, little endian: the eight bytes `PROACTIN`, the record's format as `u32`, then records. A record is
//! its payload's length as `u32`, the bitwise complement of that length, the payload, and the payload's CRC-32.
//! The complement is there so that a damaged length is not taken for a truncated file. The first payload is the
//! header as JSON, every other one a [`Record`] in postcard's encoding, which keeps every bit of a float. The
//! last one is the end mark: a log without it was broken off.

use crate::{RECORD_FORMAT, RecordingError, StudyTrialId, UNKNOWN_COMMIT, files, format};
use proact_types::{IntentAnswer, ParticipantAnswer, SimTime, TickInput, WindowAnswer};
use serde::{Deserialize, Serialize, de::DeserializeOwned};
use std::{
    collections::BTreeMap,
    fs::File,
    io::{BufReader, BufWriter, Read, Write},
    path::{Path, PathBuf},
};

const MAGIC: &[u8; 8] = b"PROACTIN";
/// Bytes of a record around its payload: length, complement, CRC-32.
const LENGTH_BYTES: u64 = 8;
const CHECKSUM_BYTES: u64 = 4;
/// Longest payload, bytes. A tick's input has some hundred, with a plan some hundred thousand.
const MAX_RECORD_BYTES: u32 = 64 << 20;

/// First record of the log.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct LogHeader {
    /// Seed of the trial.
    pub seed: u64,
    /// Versions of program and libraries.
    pub versions: BTreeMap<String, String>,
    /// Source commit of the program; `unknown` in records from before it was written.
    #[serde(default = "unknown_commit")]
    pub commit: String,
    /// Where in a study the trial belongs.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[serde(rename = "place")]
    pub study_trial: Option<StudyTrialId>,
    /// SHA-256 of `config.toml` and of whatever else the trial began with, so that an edited one is noticed.
    pub files: BTreeMap<String, String>,
}

fn unknown_commit() -> String {
    UNKNOWN_COMMIT.to_owned()
}

/// What the header of any format says of the program that wrote it, whatever else it holds.
#[derive(Default, Deserialize)]
#[serde(default)]
struct WriterVersion {
    versions: BTreeMap<String, String>,
    commit: Option<String>,
}

impl WriterVersion {
    fn label(self) -> Option<String> {
        let version = self.versions.get("proact")?;
        Some(match self.commit.filter(|commit| commit != UNKNOWN_COMMIT) {
            Some(commit) => format!("{version} at commit {commit}"),
            None => version.clone(),
        })
    }
}

/// What is written, borrowed; postcard's encoding is that of [`Record`].
#[derive(Serialize)]
enum LogRecordRef<'a> {
    Tick(SimTime, &'a TickInput),
    End(LogEnd),
    #[serde(rename = "Decoded")]
    TickWithDecoder(SimTime, &'a TickInput, &'a [WindowAnswer]),
    #[serde(rename = "Inferred")]
    TickWithIntent(SimTime, &'a TickInput, &'a [WindowAnswer], &'a IntentAnswer),
    #[serde(rename = "Told")]
    TickWithParticipant(
        SimTime,
        &'a TickInput,
        &'a [WindowAnswer],
        &'a Option<IntentAnswer>,
        &'a ParticipantAnswer,
    ),
}

/// Every record but the first.
#[derive(Deserialize)]
enum LogRecord {
    Tick(SimTime, Box<TickInput>),
    End(LogEnd),
    /// A tick in which a process that decodes EMG was asked. Behind the others, so that logs without one are read as ever.
    #[serde(rename = "Decoded")]
    TickWithDecoder(SimTime, Box<TickInput>, Vec<WindowAnswer>),
    /// A tick in which an intent model in another process was asked, behind them for the same reason.
    #[serde(rename = "Inferred")]
    TickWithIntent(SimTime, Box<TickInput>, Vec<WindowAnswer>, IntentAnswer),
    /// A tick with news of a participant in another program, last for the same reason.
    #[serde(rename = "Told")]
    TickWithParticipant(SimTime, Box<TickInput>, Vec<WindowAnswer>, Option<IntentAnswer>, ParticipantAnswer),
}

/// The end mark of a finished trial.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct LogEnd {
    /// Last tick of the trial.
    pub time: SimTime,
    /// Number of ticks with input.
    pub records: u64,
}

/// One tick's input, read back.
#[derive(Clone, Debug, PartialEq)]
pub struct InputRecord {
    /// Byte offset of the record in the file.
    pub offset: u64,
    /// The tick.
    pub tick: SimTime,
    /// What entered.
    pub input: TickInput,
}

/// Bytes before a payload: its length, and the same with all bits turned.
const LENGTH_PREFIX_BYTES: usize = 8;

/// Writes `inputs.log`.
#[derive(Debug)]
pub(crate) struct InputLogWriter {
    file: BufWriter<File>,
    path: PathBuf,
    last_tick: Option<SimTime>,
    records: u64,
    /// The record before, whose memory the next one takes.
    record: Vec<u8>,
}

impl InputLogWriter {
    pub(crate) fn new(file: File, path: &Path, header: &LogHeader) -> Result<Self, RecordingError> {
        let mut log = InputLogWriter {
            // Room for what comes between two hand-overs.
            file: BufWriter::with_capacity(1 << 16, file),
            path: path.to_owned(),
            last_tick: None,
            records: 0,
            record: Vec::new(),
        };
        let payload = serde_json::to_vec(header).map_err(RecordingError::encode("the log header"))?;
        // In one piece: a log is not there, or has its head.
        log.put(MAGIC)?;
        log.put(&RECORD_FORMAT.to_le_bytes())?;
        log.record.extend_from_slice(&[0; LENGTH_PREFIX_BYTES]);
        log.record.extend_from_slice(&payload);
        log.put_record()?;
        log.flush()?;
        Ok(log)
    }

    /// Appends the input of `tick`, unless it is empty.
    pub(crate) fn write(&mut self, tick: SimTime, input: &TickInput) -> Result<(), RecordingError> {
        if let Some(last) = self.last_tick.filter(|last| *last >= tick) {
            return Err(RecordingError::OutOfOrder { got: tick, last });
        }
        self.last_tick = Some(tick);
        if *input == TickInput::default() {
            return Ok(());
        }
        self.records += 1;
        self.put_value(&match (input.decoder.as_slice(), &input.intent, &input.participant) {
            ([], None, None) => LogRecordRef::Tick(tick, input),
            (answers, None, None) => LogRecordRef::TickWithDecoder(tick, input, answers),
            (answers, Some(answer), None) => LogRecordRef::TickWithIntent(tick, input, answers, answer),
            (answers, intent, Some(participant)) => {
                LogRecordRef::TickWithParticipant(tick, input, answers, intent, participant)
            }
        })
    }

    /// Records written so far.
    pub(crate) fn records(&self) -> u64 {
        self.records
    }

    pub(crate) fn file(&self) -> Result<File, RecordingError> {
        self.file.get_ref().try_clone().map_err(RecordingError::io("open once more", &self.path))
    }

    pub(crate) fn flush(&mut self) -> Result<(), RecordingError> {
        self.file.flush().map_err(RecordingError::io("write to", &self.path))
    }

    /// Appends the end mark and hands the file to the disk.
    pub(crate) fn finish(mut self, time: SimTime) -> Result<(), RecordingError> {
        if let Some(last) = self.last_tick.filter(|last| *last > time) {
            return Err(RecordingError::OutOfOrder { got: time, last });
        }
        self.put_value(&LogRecordRef::End(LogEnd { time, records: self.records }))?;
        self.flush()?;
        self.file.get_ref().sync_all().map_err(RecordingError::io("write to", &self.path))
    }

    fn put_value(&mut self, record: &LogRecordRef<'_>) -> Result<(), RecordingError> {
        let mut bytes = std::mem::take(&mut self.record);
        bytes.clear();
        bytes.extend_from_slice(&[0; LENGTH_PREFIX_BYTES]);
        let bytes = postcard::to_extend(record, bytes).map_err(RecordingError::encode("an input record"))?;
        self.record = bytes;
        self.put_record()
    }

    /// Completes and writes `self.record`, a payload behind room for its length, in one piece.
    fn put_record(&mut self) -> Result<(), RecordingError> {
        let payload = &self.record[LENGTH_PREFIX_BYTES..];
        let length = u32::try_from(payload.len()).map_err(RecordingError::encode("an input record"))?;
        let sum = crc32fast::hash(payload);
        self.record[..4].copy_from_slice(&length.to_le_bytes());
        self.record[4..LENGTH_PREFIX_BYTES].copy_from_slice(&(!length).to_le_bytes());
        self.record.extend_from_slice(&sum.to_le_bytes());
        self.file.write_all(&self.record).map_err(RecordingError::io("write to", &self.path))
    }

    fn put(&mut self, bytes: &[u8]) -> Result<(), RecordingError> {
        self.file.write_all(bytes).map_err(RecordingError::io("write to", &self.path))
    }
}

/// Reads `inputs.log`: an iterator over the ticks that had input, in ascending order.
///
/// It stops after the end mark, or after the first error. [`RecordingError::Truncated`] as the last item means
/// that all items before it are good and the trial was broken off there; any other error means that the file
/// is not what was written.
#[derive(Debug)]
pub struct InputLog {
    file: BufReader<File>,
    path: PathBuf,
    format: u32,
    header: LogHeader,
    length: u64,
    offset: u64,
    last_tick: Option<SimTime>,
    records: u64,
    end: Option<LogEnd>,
    stopped: bool,
}

impl InputLog {
    /// Opens the log of the trial in `dir`.
    ///
    /// # Errors
    /// [`RecordingError::NotATrial`] without a log; [`RecordingError::Damaged`], [`RecordingError::WrongFormat`]
    /// or [`RecordingError::Truncated`] if its head is not that of one.
    pub fn open(dir: &Path) -> Result<Self, RecordingError> {
        let path = dir.join(crate::INPUTS_FILE);
        let file = files::open(&path).map_err(|source| match source.kind() {
            std::io::ErrorKind::NotFound => {
                RecordingError::NotATrial { dir: dir.to_owned(), missing: crate::INPUTS_FILE }
            }
            _ => RecordingError::Io { action: "open", path: path.clone(), source },
        })?;
        let length = file.metadata().map_err(RecordingError::io("read", &path))?.len();
        let mut log = InputLog {
            file: BufReader::new(file),
            path,
            format: RECORD_FORMAT,
            header: LogHeader {
                seed: 0,
                versions: BTreeMap::new(),
                commit: unknown_commit(),
                study_trial: None,
                files: BTreeMap::new(),
            },
            length,
            offset: 0,
            last_tick: None,
            records: 0,
            end: None,
            stopped: false,
        };
        let head: [u8; 12] = log.read_bytes(0)?;
        if head[..8] != *MAGIC {
            return Err(log.damaged(0, "it does not start as an input log does"));
        }
        let found = u32::from_le_bytes([head[8], head[9], head[10], head[11]]);
        let start = log.offset;
        let payload = log.read_record();
        // The first record of another format may look like anything; what it says of its writer helps.
        let writer =
            payload.as_ref().ok().and_then(|json| serde_json::from_slice::<WriterVersion>(json).ok());
        format::check_readable(dir, found, writer.and_then(WriterVersion::label).as_deref())?;
        log.format = found;
        let payload = payload?;
        log.header = serde_json::from_slice(&payload).map_err(|e| log.damaged(start, &e.to_string()))?;
        Ok(log)
    }

    pub(crate) fn format(&self) -> u32 {
        self.format
    }

    pub(crate) fn header(&self) -> &LogHeader {
        &self.header
    }

    /// Seed of the trial.
    pub fn seed(&self) -> u64 {
        self.header.seed
    }

    /// Where in a study the trial belongs; none for a trial of its own, and in records from before this was written.
    pub fn study_trial(&self) -> Option<&StudyTrialId> {
        self.header.study_trial.as_ref()
    }

    /// The end mark, once the iterator has passed it.
    pub fn end(&self) -> Option<LogEnd> {
        self.end
    }

    fn read_next(&mut self) -> Result<Option<InputRecord>, RecordingError> {
        let offset = self.offset;
        let payload = self.read_record()?;
        match self.decode(offset, &payload)? {
            LogRecord::Tick(tick, input) => self.checked_record(offset, tick, *input).map(Some),
            LogRecord::TickWithDecoder(tick, input, decoder) => {
                self.checked_record(offset, tick, TickInput { decoder, ..*input }).map(Some)
            }
            LogRecord::TickWithIntent(tick, input, decoder, intent) => self
                .checked_record(offset, tick, TickInput { decoder, intent: Some(intent), ..*input })
                .map(Some),
            LogRecord::TickWithParticipant(tick, input, decoder, intent, participant) => {
                let input = TickInput { decoder, intent, participant: Some(participant), ..*input };
                self.checked_record(offset, tick, input).map(Some)
            }
            LogRecord::End(end) => {
                if end.records != self.records {
                    let reason =
                        format!("the end mark counts {} records, {} were read", end.records, self.records);
                    return Err(self.damaged(offset, &reason));
                }
                if self.offset != self.length {
                    return Err(self.damaged(self.offset, "there are bytes after the end mark"));
                }
                self.end = Some(end);
                Ok(None)
            }
        }
    }

    /// The input of `tick`, which must come after the tick before.
    fn checked_record(
        &mut self,
        offset: u64,
        tick: SimTime,
        input: TickInput,
    ) -> Result<InputRecord, RecordingError> {
        if let Some(last) = self.last_tick.filter(|last| *last >= tick) {
            let reason = format!("tick {} stands after tick {}", tick.0, last.0);
            return Err(self.damaged(offset, &reason));
        }
        self.last_tick = Some(tick);
        self.records += 1;
        Ok(InputRecord { offset, tick, input })
    }

    fn decode<T: DeserializeOwned>(&self, offset: u64, payload: &[u8]) -> Result<T, RecordingError> {
        match postcard::take_from_bytes(payload) {
            Ok((value, [])) => Ok(value),
            Ok((_, rest)) => Err(self.damaged(offset, &format!("{} bytes too many", rest.len()))),
            Err(error) => Err(self.damaged(offset, &error.to_string())),
        }
    }

    fn read_record(&mut self) -> Result<Vec<u8>, RecordingError> {
        let start = self.offset;
        let [a, b, c, d, e, f, g, h]: [u8; LENGTH_BYTES as usize] = self.read_bytes(start)?;
        let length = u32::from_le_bytes([a, b, c, d]);
        if u32::from_le_bytes([e, f, g, h]) != !length {
            return Err(self.damaged(start, "the record's length does not match its complement"));
        }
        if length > MAX_RECORD_BYTES {
            let reason = format!("a record has {length} bytes, expected at most {MAX_RECORD_BYTES}");
            return Err(self.damaged(start, &reason));
        }
        // Compare with what is left before any memory is asked for.
        if self.length - self.offset < u64::from(length) + CHECKSUM_BYTES {
            return Err(self.truncated(start));
        }
        let mut payload = vec![0; length as usize];
        self.file.read_exact(&mut payload).map_err(RecordingError::io("read", &self.path))?;
        self.offset += u64::from(length);
        let expected = u32::from_le_bytes(self.read_bytes(start)?);
        let got = crc32fast::hash(&payload);
        if got != expected {
            let reason = format!("its checksum is {got:08x}, the file says {expected:08x}");
            return Err(self.damaged(start, &reason));
        }
        Ok(payload)
    }

    /// Reads `N` bytes of the record that starts at `start`.
    fn read_bytes<const N: usize>(&mut self, start: u64) -> Result<[u8; N], RecordingError> {
        if self.length - self.offset < N as u64 {
            return Err(self.truncated(start));
        }
        let mut bytes = [0; N];
        self.file.read_exact(&mut bytes).map_err(RecordingError::io("read", &self.path))?;
        self.offset += N as u64;
        Ok(bytes)
    }

    fn damaged(&self, offset: u64, reason: &str) -> RecordingError {
        RecordingError::Damaged { file: self.path.clone(), offset, reason: reason.to_owned() }
    }

    fn truncated(&self, offset: u64) -> RecordingError {
        RecordingError::Truncated { file: self.path.clone(), offset, records: self.records }
    }
}

impl Iterator for InputLog {
    type Item = Result<InputRecord, RecordingError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.stopped {
            return None;
        }
        let item = self.read_next().transpose();
        self.stopped = !matches!(item, Some(Ok(_)));
        item
    }
}
