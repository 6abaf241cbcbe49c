//! The folder of a batch: what it is, and a file for each shard to which each trial is a line.

use super::{BatchDescription, BatchError, BatchTrial};
use crate::study::TrialScores;
use proact_files::{make_folder, write_atomically};
use proact_recording::{FileLock, sha256_of_bytes};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use std::{
    fmt,
    fs::{self, File, OpenOptions, TryLockError},
    io::{self, BufRead, BufReader, Read, Seek, SeekFrom, Write},
    path::{Path, PathBuf},
    str::FromStr,
};

/// What the batch is.
pub(crate) const DESCRIPTION: &str = "batch.json";
/// Held while the folder is made and while shards are merged.
const LOCK: &str = "batch.lock";
/// More of a batch's description is none, bytes.
const MAX_DESCRIPTION_BYTES: u64 = 1 << 24;
/// A trial is no longer line than this, bytes.
const MAX_LINE_BYTES: u64 = 1 << 28;
/// Hexadecimal digits of a line's checksum, which a blank follows.
const CHECKSUM_DIGITS: usize = 16;

/// A part of a batch: every `of`-th trial, from the `number`-th on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shard {
    /// Which, from 1.
    pub number: usize,
    /// Of how many.
    pub count: usize,
}

impl Shard {
    /// The whole batch.
    pub const WHOLE: Self = Self { number: 1, count: 1 };
    /// More are most likely a slip.
    pub const MAX_COUNT: usize = 100_000;

    /// Whether the trial in place `index` belongs to it.
    pub fn contains(self, index: usize) -> bool {
        index % self.count == self.number - 1
    }

    fn file(self) -> String {
        format!("shard-{}-of-{}.log", self.number, self.count)
    }
}

impl FromStr for Shard {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers =
            text.split_once('/').and_then(|(number, of)| Some((number.parse().ok()?, of.parse().ok()?)));
        match numbers {
            Some((number, of)) if (1..=of).contains(&number) && of <= Self::MAX_COUNT => {
                Ok(Self { number, count: of })
            }
            _ => Err(format!(
                "{text:?} is no shard, expected K/N such as 2/8, with K from 1 to N and N at most {}",
                Self::MAX_COUNT
            )),
        }
    }
}

impl fmt::Display for Shard {
    fn fmt(&self, to: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(to, "{}/{}", self.number, self.count)
    }
}

/// What is kept of a trial, beside what its place in the batch says.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct TrialLine {
    /// Its place, from 0: the first key, since it is looked for in every line.
    pub(super) index: usize,
    /// Which trial of the batch.
    pub(super) trial: BatchTrial,
    /// Its result, without what hangs on the machine.
    pub(super) result: Map<String, Value>,
    /// What was scored.
    pub(super) scores: TrialScores,
}

/// The folder of a batch.
#[derive(Clone, Debug)]
pub struct BatchFolder {
    /// Where.
    pub dir: PathBuf,
    /// What.
    pub description: BatchDescription,
}

fn failed(path: &Path) -> impl FnOnce(io::Error) -> BatchError {
    let path = path.to_owned();
    move |error| BatchError::File { path, reason: error.to_string() }
}

impl BatchFolder {
    /// Makes the folder for the batch `requested`, or takes up the one that is there.
    ///
    /// # Errors
    /// [`BatchError`]: a folder of another batch, by what differs; one that is not empty and holds no batch.
    pub fn open_or_resume(dir: &Path, requested: BatchDescription) -> Result<Self, BatchError> {
        make_folder(dir).map_err(|error| failed(dir)(error.into()))?;
        let path = dir.join(DESCRIPTION);
        let mut names = Vec::new();
        for entry in fs::read_dir(dir).map_err(failed(dir))? {
            names.push(entry.map_err(failed(dir))?.file_name());
        }
        // A description that was begun is ours, and so is what a scheduler says of our script.
        let own = |name: &std::ffi::OsString| name.to_string_lossy().starts_with("batch.") || name == "slurm";
        if !path.is_file() && !names.iter().all(own) {
            return Err(BatchError::NotEmpty { dir: dir.to_owned() });
        }
        let _lock = Self::lock_dir(dir)?;
        if !path.is_file() {
            let text = serde_json::to_string_pretty(&requested).map_err(|e| failed(&path)(e.into()))?;
            write_atomically(&path, text + "\n").map_err(|error| failed(&path)(error.into()))?;
            return Ok(Self { dir: dir.to_owned(), description: requested });
        }
        let found = Self::open(dir)?;
        match found.description.difference(&requested) {
            Some((what, has, requested)) => {
                Err(BatchError::Mismatch { dir: dir.to_owned(), what, found: has, requested })
            }
            None => Ok(found),
        }
    }

    /// Opens the folder of a batch.
    ///
    /// # Errors
    /// [`BatchError`]: one that holds none.
    pub fn open(dir: &Path) -> Result<Self, BatchError> {
        let path = dir.join(DESCRIPTION);
        let file = File::open(&path).map_err(|error| match error.kind() {
            io::ErrorKind::NotFound => BatchError::NotABatch { dir: dir.to_owned(), file: DESCRIPTION },
            _ => failed(&path)(error),
        })?;
        let mut text = String::new();
        file.take(MAX_DESCRIPTION_BYTES).read_to_string(&mut text).map_err(failed(&path))?;
        let description = serde_json::from_str(&text)
            .map_err(|error| BatchError::File { path, reason: format!("it describes no batch: {error}") })?;
        Ok(Self { dir: dir.to_owned(), description })
    }

    /// Alone in the folder, until it is dropped.
    pub(super) fn lock_dir(dir: &Path) -> Result<FileLock, BatchError> {
        let path = dir.join(LOCK);
        let file = File::create(&path).map_err(failed(&path))?;
        FileLock::acquire(file).map_err(failed(&path))
    }

    /// Where the lines of a shard are.
    pub(super) fn shard_path(&self, shard: Shard) -> PathBuf {
        self.dir.join(shard.file())
    }
}

/// The file of a shard, to which this program alone writes.
#[derive(Debug)]
pub struct ShardFile {
    file: FileLock,
    path: PathBuf,
    /// Whether each trial of the batch is over.
    completed: Vec<bool>,
    /// Lines that were damaged; their trials are run again.
    pub damaged: usize,
}

impl ShardFile {
    /// Takes up the file where it stands. A line that was cut off by the end of the program, and one that is damaged, do not count.
    ///
    /// # Errors
    /// [`BatchError`]: another program writes to it.
    pub fn open_or_resume(folder: &BatchFolder, shard: Shard) -> Result<Self, BatchError> {
        let path = folder.shard_path(shard);
        let file =
            OpenOptions::new().read(true).append(true).create(true).open(&path).map_err(failed(&path))?;
        let file = match FileLock::try_acquire(file) {
            Ok(file) => file,
            Err(TryLockError::WouldBlock) => return Err(BatchError::Locked { path }),
            Err(TryLockError::Error(error)) => return Err(failed(&path)(error)),
        };
        let mut over = vec![false; folder.description.trials];
        let scan = scan(&path, |index, _, _| over[index] = true, folder.description.trials, shard)?;
        file.set_len(scan.valid_bytes).map_err(failed(&path))?;
        Ok(Self { file, path, completed: over, damaged: scan.damaged })
    }

    /// Whether the trial in place `index` is over.
    pub fn is_completed(&self, index: usize) -> bool {
        self.completed[index]
    }

    /// How many trials are over.
    pub fn count(&self) -> usize {
        self.completed.iter().filter(|over| **over).count()
    }

    /// Keeps a trial: it is on the disk when this returns.
    pub(super) fn push(&mut self, line: &TrialLine) -> Result<(), BatchError> {
        let json = serde_json::to_string(line).map_err(|e| failed(&self.path)(e.into()))?;
        let text = format!("{} {json}\n", &sha256_of_bytes(json.as_bytes())[..CHECKSUM_DIGITS]);
        let written = self.file.write_all(text.as_bytes()).and_then(|()| self.file.sync_data());
        written.map_err(failed(&self.path))?;
        self.completed[line.index] = true;
        Ok(())
    }
}

/// What was found in the file of a shard.
pub(super) struct ShardScan {
    /// Where its last whole line ends.
    pub(super) valid_bytes: u64,
    /// Whole lines that are none.
    pub(super) damaged: usize,
}

/// Tells the trial, the place and the length of the JSON text of every good line.
pub(super) fn scan(
    path: &Path,
    mut tell: impl FnMut(usize, u64, usize),
    trials: usize,
    shard: Shard,
) -> Result<ShardScan, BatchError> {
    /// All that is looked at.
    #[derive(Deserialize)]
    struct TrialLineIndex {
        index: usize,
    }
    let mut reader = BufReader::new(File::open(path).map_err(failed(path))?);
    let mut found = ShardScan { valid_bytes: 0, damaged: 0 };
    let mut line = Vec::new();
    loop {
        line.clear();
        let read = reader.by_ref().take(MAX_LINE_BYTES).read_until(b'\n', &mut line).map_err(failed(path))?;
        if line.pop() != Some(b'\n') {
            return Ok(found);
        }
        let json = verify_checksum(&line);
        let index =
            json.and_then(|json| serde_json::from_slice(json).ok()).map(|TrialLineIndex { index }| index);
        match index.filter(|index| *index < trials && shard.contains(*index)) {
            Some(index) => {
                let start = found.valid_bytes + CHECKSUM_DIGITS as u64 + 1;
                tell(index, start, line.len() - CHECKSUM_DIGITS - 1);
            }
            None => found.damaged += 1,
        }
        found.valid_bytes += read as u64;
    }
}

/// The JSON text behind a checksum that it has.
fn verify_checksum(line: &[u8]) -> Option<&[u8]> {
    let (check, json) = line.split_at_checked(CHECKSUM_DIGITS + 1)?;
    let expected = sha256_of_bytes(json);
    (check[..CHECKSUM_DIGITS] == expected.as_bytes()[..CHECKSUM_DIGITS] && check[CHECKSUM_DIGITS] == b' ')
        .then_some(json)
}

/// The line whose JSON text is there.
pub(super) fn read_line(
    file: &mut File,
    path: &Path,
    start: u64,
    length: usize,
) -> Result<TrialLine, BatchError> {
    let mut text = vec![0; length];
    file.seek(SeekFrom::Start(start)).and_then(|_| file.read_exact(&mut text)).map_err(failed(path))?;
    serde_json::from_slice(&text)
        .map_err(|error| BatchError::File { path: path.to_owned(), reason: format!("byte {start}: {error}") })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn description() -> BatchDescription {
        BatchDescription {
            program: "1".into(),
            source: "plan".into(),
            conditions: vec!["A".into()],
            vary: vec![],
            participant_kind: "competent".into(),
            participants: 4,
            seed: 1,
            trials: 4,
            shards: 2,
            config_hash: "00".into(),
            note: String::new(),
        }
    }

    fn line(index: usize) -> TrialLine {
        let trial = BatchTrial {
            index,
            cell: 0,
            participant: index + 1,
            session: None,
            condition: 0,
            position: None,
            trial: 1,
            seed: 7,
            arrangement: None,
            history: crate::study::ParticipantHistory::default(),
        };
        TrialLine { index, trial, result: Map::new(), scores: TrialScores::default() }
    }

    #[test]
    fn a_shard_is_every_nth_trial() {
        let second: Shard = "2/3".parse().unwrap();
        assert_eq!((0..7).filter(|index| second.contains(*index)).collect::<Vec<_>>(), [1, 4]);
        assert_eq!(second.to_string(), "2/3");
        for wrong in ["0/3", "4/3", "1", "1/", "a/b", "1/100001", "-1/2"] {
            assert!(wrong.parse::<Shard>().unwrap_err().contains("expected K/N"), "{wrong}");
        }
    }

    #[test]
    fn a_folder_takes_its_own_batch_and_says_in_what_another_one_differs() {
        let temp_dir = tempfile::tempdir().unwrap();
        let dir = temp_dir.path().join("batch");
        assert!(matches!(BatchFolder::open(&dir), Err(BatchError::NotABatch { .. })));
        BatchFolder::open_or_resume(&dir, description()).unwrap();
        assert_eq!(BatchFolder::open_or_resume(&dir, description()).unwrap().description, description());
        let others = [
            (BatchDescription { seed: 2, ..description() }, "other seed: 1, and this one has 2"),
            (BatchDescription { program: "2".into(), ..description() }, "other program version: 1"),
            (BatchDescription { config_hash: "01".into(), ..description() }, "other configuration"),
            (BatchDescription { shards: 3, ..description() }, "other number of shards: 2"),
            (BatchDescription { source: "other".into(), ..description() }, "other trials: plan"),
        ];
        for (other, reason) in others {
            let error = BatchFolder::open_or_resume(&dir, other).unwrap_err().to_string();
            assert!(error.contains(reason), "{error}");
        }
        let foreign = temp_dir.path().join("foreign");
        fs::create_dir(&foreign).unwrap();
        fs::write(foreign.join("thesis.txt"), "all of it").unwrap();
        assert!(matches!(
            BatchFolder::open_or_resume(&foreign, description()),
            Err(BatchError::NotEmpty { .. })
        ));
        assert_eq!(fs::read_dir(&foreign).unwrap().count(), 1, "nothing was put there");
        fs::write(dir.join(DESCRIPTION), "{\"seed\": 1").unwrap();
        assert!(BatchFolder::open(&dir).unwrap_err().to_string().contains("describes no batch"));
    }

    #[test]
    fn a_torn_line_is_cut_off_and_a_damaged_one_does_not_count_wherever_it_is() {
        let temp_dir = tempfile::tempdir().unwrap();
        let folder = BatchFolder::open_or_resume(temp_dir.path(), description()).unwrap();
        let shard = Shard { number: 1, count: 2 };
        let path = folder.shard_path(shard);
        let mut file = ShardFile::open_or_resume(&folder, shard).unwrap();
        assert!(matches!(ShardFile::open_or_resume(&folder, shard), Err(BatchError::Locked { .. })));
        file.push(&line(0)).unwrap();
        file.push(&line(2)).unwrap();
        drop(file);
        let whole = fs::read(&path).unwrap();
        let first = whole.iter().position(|byte| *byte == b'\n').unwrap() + 1;
        // At every byte at which a kill can have cut the second line.
        for end in first..whole.len() {
            fs::write(&path, &whole[..end]).unwrap();
            let mut file = ShardFile::open_or_resume(&folder, shard).unwrap();
            assert_eq!((file.is_completed(0), file.is_completed(2), file.damaged), (true, false, 0), "{end}");
            file.push(&line(2)).unwrap();
            drop(file);
            assert_eq!(fs::read(&path).unwrap(), whole, "{end}");
        }
        // At every byte that a disk can have changed in the first.
        for at in 0..first - 1 {
            let mut bytes = whole.clone();
            bytes[at] ^= 0x11;
            fs::write(&path, &bytes).unwrap();
            let file = ShardFile::open_or_resume(&folder, shard).unwrap();
            assert_eq!((file.is_completed(0), file.is_completed(2)), (false, true), "{at}");
            assert!(file.damaged >= 1);
        }
        // A trial of another shard, and one that the batch has not.
        for index in [1, 4] {
            fs::remove_file(&path).unwrap();
            let mut file = ShardFile::open_or_resume(&folder, shard).unwrap();
            file.completed.resize(5, false);
            file.push(&line(index)).unwrap();
            drop(file);
            let file = ShardFile::open_or_resume(&folder, shard).unwrap();
            assert_eq!((file.count(), file.damaged), (0, 1));
        }
    }
}
