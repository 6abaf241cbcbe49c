use crate::{DeviceError, metadata::Metadata};
use arrayvec::ArrayVec;
use proact_types::{EmgSample, Gesture, GestureName, LineRead, MAX_EMG_CHANNELS, read_line};
use std::{
    collections::BTreeSet,
    fs::File,
    io::{BufReader, Error, ErrorKind, Write},
    path::{Path, PathBuf},
};

/// One value per channel, in the device's counts.
pub type ChannelValues = ArrayVec<f64, MAX_EMG_CHANNELS>;

/// Rate of the Myo armband, with which the freely licensed recordings were made.
pub const MYO_RATE_HZ: f64 = 200.0;

/// Longest row of a file, bytes; 64 channels with all digits take a fortieth.
const LONGEST_ROW: usize = 64 << 10;
/// Most rows of a file: a quarter of an hour at 4 kHz, five hours at 200 Hz.
const MOST_ROWS: usize = 4_000_000;

/// How recordings lie in a folder.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Layout {
    /// `R_<repetition>_C_<class>.csv` or `R_<repetition>_C_<class>_EMG.csv`, one column a channel; class numbers
    /// by the folder's metadata, else in the order of [`Gesture::ALL`].
    LibEmg,
    /// `0.txt` (rest), `1.txt` (wrist flexion), `2.txt` (wrist extension), `7.txt` (hand close): 8 channels and
    /// the label that was shown. There is no hand-open class.
    MyoReadings,
}

/// One repetition of one gesture.
#[derive(Clone, Debug, PartialEq)]
pub struct Recording {
    /// Number of the repetition, from 0.
    pub repetition: u32,
    /// What the person did.
    pub gesture: GestureName,
    /// `[samples][channels]`, without gaps.
    pub samples: Vec<ChannelValues>,
    /// Where it was read from.
    pub path: PathBuf,
}

impl Recording {
    /// The samples with counters from 0.
    pub fn numbered(&self) -> impl Iterator<Item = EmgSample> + '_ {
        self.samples
            .iter()
            .zip(0..)
            .map(|(channels, counter)| EmgSample { counter, channels: channels.clone() })
    }
}

/// All recordings of one person and session.
#[derive(Clone, Debug, PartialEq)]
pub struct Recordings {
    /// The folder.
    pub path: PathBuf,
    /// Samples per second.
    pub rate_hz: f64,
    /// Channels of every sample.
    pub channels: usize,
    /// The gestures that there should be, in alphabetical order: those that the folder names, else the five.
    pub expected: Vec<GestureName>,
    /// The gesture of a relaxed hand.
    pub rest: GestureName,
    /// Sorted by repetition, then gesture.
    pub items: Vec<Recording>,
}

/// A folder that recordings are put into one by one: `R_<repetition>_C_<class>.csv` files with `metadata.json` beside
/// them, which [`Recordings::open`] and LibEMG read.
#[derive(Clone, Debug)]
pub struct RecordingFolder {
    dir: PathBuf,
    /// In the order of their class numbers.
    gestures: Vec<GestureName>,
}

impl RecordingFolder {
    /// Makes the folder if it is not there, for recordings of `rate_hz` of `gestures`, whose class numbers are in
    /// alphabetical order; `rest` is that of a relaxed hand.
    ///
    /// # Errors
    /// A folder that cannot be written, or one that holds recordings already.
    pub fn create(
        dir: &Path,
        rate_hz: f64,
        gestures: &[GestureName],
        rest: GestureName,
    ) -> Result<Self, DeviceError> {
        std::fs::create_dir_all(dir).map_err(unwritten(dir))?;
        let gestures: Vec<GestureName> =
            gestures.iter().copied().collect::<BTreeSet<_>>().into_iter().collect();
        let named = gestures
            .iter()
            .zip(0..)
            .map(|(gesture, class): (_, usize)| (class.to_string(), gesture.as_str().into()));
        let classes: serde_json::Map<String, serde_json::Value> = named.collect();
        let mut metadata = serde_json::json!({ "rate_hz": rate_hz, "class_map": classes });
        if rest != GestureName::default() {
            metadata["rest"] = rest.as_str().into();
        }
        let path = dir.join("metadata.json");
        let mut file = std::fs::File::create_new(&path).map_err(unwritten(&path))?;
        file.write_all(format!("{metadata:#}\n").as_bytes())
            .and_then(|()| file.sync_all())
            .map_err(unwritten(&path))?;
        Ok(Self { dir: dir.to_owned(), gestures })
    }

    /// The folder.
    pub fn path(&self) -> &Path {
        &self.dir
    }

    /// Writes one recording, in one piece and to the disk. It takes the place of one of the same gesture and number.
    ///
    /// # Errors
    /// A gesture that the folder is not for, or a file that cannot be written; one that was there before stays then.
    pub fn keep(&self, item: &Recording) -> Result<(), DeviceError> {
        let class = self
            .gestures
            .binary_search(&item.gesture)
            .map_err(|_| DeviceError::NotListed { path: self.dir.clone(), gesture: item.gesture })?;
        let line = |row: &ChannelValues| row.iter().map(f64::to_string).collect::<Vec<_>>().join(",") + "\n";
        let text: String = item.samples.iter().map(line).collect();
        let name = format!("R_{}_C_{class}.csv", item.repetition);
        let (path, partial) = (self.dir.join(&name), self.dir.join(format!("{name}.partial")));
        let write = || {
            let mut file = std::fs::File::create(&partial)?;
            file.write_all(text.as_bytes())?;
            file.sync_all()?;
            std::fs::rename(&partial, &path)
        };
        write().map_err(unwritten(&path))
    }
}

/// For `map_err`: a file or folder that cannot be written.
fn unwritten(path: &Path) -> impl FnOnce(std::io::Error) -> DeviceError {
    let path = path.to_owned();
    move |source| DeviceError::Write { path, source }
}

impl Recordings {
    /// [`Recordings::open`] with the rate given.
    ///
    /// # Errors
    /// As there.
    pub fn read(dir: &Path, rate_hz: f64) -> Result<Recordings, DeviceError> {
        Recordings::open(dir, Some(rate_hz))
    }

    /// Reads the folder `dir` in whichever layout it has: LibEMG's `R_<rep>_C_<class>.csv`, or that of
    /// myo_readings, `<label>.txt` with the label as ninth column. Files of other names are left alone.
    ///
    /// The rate is not in those files: it is taken from the folder's `metadata.json` or LibEMG 2's
    /// `collection_details.json`, where classes may have names, too; else as asked for; else [`MYO_RATE_HZ`], as the
    /// freely licensed sets.
    ///
    /// # Errors
    /// A missing or empty folder, a folder of several sessions, a file with anything but finite numbers in
    /// rows of one length, or metadata that cannot be or disagrees; each says where and what.
    pub fn open(dir: &Path, asked_hz: Option<f64>) -> Result<Recordings, DeviceError> {
        let rate_hz = asked_hz.unwrap_or(MYO_RATE_HZ);
        if !(rate_hz.is_finite() && rate_hz > 0.0) {
            let expected = "a finite number of samples per second above zero";
            return Err(DeviceError::Parameter { name: "EMG rate", value: rate_hz, expected });
        }
        let names = list(dir)?;
        let metadata = Metadata::read(dir)?;
        let rate_hz = match (metadata.rate_hz, asked_hz) {
            (Some(recorded_hz), Some(asked_hz)) if recorded_hz != asked_hz => {
                return Err(DeviceError::RateDisagrees { path: dir.to_owned(), recorded_hz, asked_hz });
            }
            (recorded_hz, _) => recorded_hz.unwrap_or(rate_hz),
        };
        let mut items = Vec::new();
        match layout(&names) {
            Some(Layout::LibEmg) => {
                for name in &names {
                    if let Some((repetition, class)) = parse_name(name) {
                        let path = dir.join(name);
                        let gesture = metadata.gesture(&path, class)?;
                        let samples = read_samples(&path)?;
                        items.push(Recording { repetition, gesture, samples, path });
                    }
                }
            }
            Some(Layout::MyoReadings) => {
                for (label, gesture) in MYO_LABELS {
                    let name = format!("{label}.txt");
                    if names.contains(&name) {
                        items.extend(read_myo_readings(&dir.join(name), label, gesture.into(), rate_hz)?);
                    }
                }
            }
            None => return Err(no_layout(dir, &names)),
        }
        items.sort_by_key(|r| (r.repetition, r.gesture));
        let (expected, rest) = (metadata.gestures(), metadata.rest.unwrap_or_default());
        let mut recordings = Recordings { path: dir.to_owned(), rate_hz, channels: 0, expected, rest, items };
        recordings.check_items()?;
        Ok(recordings)
    }

    /// Writes all of them into `dir`, as [`RecordingFolder`] does.
    ///
    /// # Errors
    /// A folder or file that cannot be written; none is replaced.
    pub fn write(&self, dir: &Path) -> Result<(), DeviceError> {
        let folder = RecordingFolder::create(dir, self.rate_hz, &self.expected, self.rest)?;
        self.items.iter().try_for_each(|item| folder.keep(item))
    }

    /// Checks that all files have the channels of the first, and no repetition comes twice.
    fn check_items(&mut self) -> Result<(), DeviceError> {
        self.channels = self.items.first().and_then(|r| r.samples.first()).map_or(0, |s| s.len());
        for (k, item) in self.items.iter().enumerate() {
            let got = item.samples.first().map_or(0, |s| s.len());
            if got != self.channels {
                let expected = format!("{} as in {}", self.channels, self.items[0].path.display());
                return Err(DeviceError::Columns { path: item.path.clone(), row: 1, got, expected });
            }
            let twin = |r: &&Recording| (r.repetition, r.gesture) == (item.repetition, item.gesture);
            if self.items[..k].iter().any(|r| twin(&r)) {
                let (repetition, gesture) = (item.repetition, item.gesture);
                return Err(DeviceError::Duplicate { path: item.path.clone(), repetition, gesture });
            }
        }
        Ok(())
    }

    /// Repetition `repetition` of `gesture`.
    ///
    /// # Errors
    /// [`DeviceError::MissingRepetition`] with those that exist.
    pub fn find(&self, gesture: impl Into<GestureName>, repetition: u32) -> Result<&Recording, DeviceError> {
        let gesture = gesture.into();
        let of_gesture = || self.items.iter().filter(|r| r.gesture == gesture);
        of_gesture().find(|r| r.repetition == repetition).ok_or_else(|| DeviceError::MissingRepetition {
            repetition,
            gesture,
            available: of_gesture().map(|r| r.repetition).collect(),
        })
    }

    /// The gestures of which there is at least one recording, in alphabetical order.
    pub fn gestures(&self) -> Vec<GestureName> {
        self.items.iter().map(|r| r.gesture).collect::<BTreeSet<_>>().into_iter().collect()
    }

    /// Those of the gestures that there should be of which there is none.
    pub fn missing(&self) -> Vec<GestureName> {
        let there = self.gestures();
        self.expected.iter().copied().filter(|g| !there.contains(g)).collect()
    }
}

/// Labels of the myo_readings layout. Rest has a file of its own.
const MYO_LABELS: [(u32, Gesture); 4] = [
    (0, Gesture::NoMotion),
    (1, Gesture::WristFlexion),
    (2, Gesture::WristExtension),
    (7, Gesture::HandClose),
];

/// Channels of the myo_readings layout; the label follows.
const MYO_CHANNELS: usize = 8;

/// The label is the cue on the screen; the person follows it late. Samples this close to an edge are left out.
const MYO_EDGE_SECS: f64 = 0.5;

/// The rest file is one long stretch; it is cut into as many repetitions as the other files have.
const MYO_REPETITIONS: usize = 6;

fn list(dir: &Path) -> Result<Vec<String>, DeviceError> {
    let failed = |source| DeviceError::Read { path: dir.to_owned(), source };
    if std::fs::metadata(dir).map_err(failed)?.is_file() {
        return Err(DeviceError::NotAFolder { path: dir.to_owned() });
    }
    let mut names = Vec::new();
    for entry in std::fs::read_dir(dir).map_err(failed)? {
        // Names that are no text cannot be recordings.
        names.extend(entry.map_err(failed)?.file_name().into_string().ok());
    }
    names.sort();
    Ok(names)
}

fn layout(names: &[String]) -> Option<Layout> {
    if names.iter().any(|n| parse_name(n).is_some()) {
        Some(Layout::LibEmg)
    } else if MYO_LABELS.iter().any(|(label, _)| names.contains(&format!("{label}.txt"))) {
        Some(Layout::MyoReadings)
    } else {
        None
    }
}

fn no_layout(dir: &Path, names: &[String]) -> DeviceError {
    let holds_recordings = |name: &&String| list(&dir.join(name)).is_ok_and(|inner| layout(&inner).is_some());
    let sessions: Vec<String> = names.iter().filter(holds_recordings).cloned().collect();
    let path = dir.to_owned();
    if sessions.is_empty() {
        DeviceError::NoRecordings { path }
    } else {
        DeviceError::ManySessions { path, sessions }
    }
}

/// Repetition and class of `R_<repetition>_C_<class>.csv`, with or without `_EMG`.
fn parse_name(name: &str) -> Option<(u32, u32)> {
    let stem = name.strip_suffix(".csv")?;
    let (repetition, class) =
        stem.strip_suffix("_EMG").unwrap_or(stem).strip_prefix("R_")?.split_once("_C_")?;
    Some((repetition.parse().ok()?, class.parse().ok()?))
}

/// Reads one file; a recording per cue of its gesture, edges cut.
fn read_myo_readings(
    path: &Path,
    label: u32,
    gesture: GestureName,
    rate_hz: f64,
) -> Result<Vec<Recording>, DeviceError> {
    let rows = read_rows(path, Some(MYO_CHANNELS + 1))?;
    for (row, values) in rows.iter().enumerate() {
        let shown = values[MYO_CHANNELS];
        if shown != 0.0 && shown != f64::from(label) {
            let path = path.to_owned();
            return Err(DeviceError::Label { path, row: row + 1, label: shown, expected: label });
        }
    }
    let without_label = |rows: &[ChannelValues]| -> Vec<ChannelValues> {
        rows.iter().map(|values| values[..MYO_CHANNELS].iter().copied().collect()).collect()
    };
    let edge = (MYO_EDGE_SECS * rate_hz).round() as usize;
    let cues: Vec<&[ChannelValues]> = if gesture == Gesture::NoMotion {
        rows.chunks((rows.len() / MYO_REPETITIONS).max(1)).take(MYO_REPETITIONS).collect()
    } else {
        let runs = rows.chunk_by(|a, b| a[MYO_CHANNELS] == b[MYO_CHANNELS]);
        runs.filter(|run| run[0][MYO_CHANNELS] != 0.0 && run.len() > 2 * edge)
            .map(|run| &run[edge..run.len() - edge])
            .collect()
    };
    let recording = |(cue, repetition)| Recording {
        repetition,
        gesture,
        samples: without_label(cue),
        path: path.to_owned(),
    };
    Ok(cues.into_iter().zip(0..).map(recording).collect())
}

/// Reads one file of samples: a row a sample, a column a channel, commas between, no header.
///
/// # Errors
/// A file that cannot be read, is empty, or has anything but finite numbers in rows of one length.
pub fn read_samples(path: &Path) -> Result<Vec<ChannelValues>, DeviceError> {
    read_rows(path, None)
}

/// Rows of numbers separated by commas, all of one length. `expected` columns, or those of the first row.
fn read_rows(path: &Path, expected: Option<usize>) -> Result<Vec<ChannelValues>, DeviceError> {
    let failed = |source| DeviceError::Read { path: path.to_owned(), source };
    let mut file = BufReader::new(File::open(path).map_err(failed)?);
    let mut columns = expected;
    let mut rows = Vec::new();
    let mut line = Vec::new();
    for row in 1.. {
        match read_line(&mut file, LONGEST_ROW, &mut line).map_err(failed)? {
            LineRead::End => break,
            LineRead::Whole if rows.len() == MOST_ROWS => {
                return Err(too_large(path, format!("it has more than {MOST_ROWS} rows")));
            }
            LineRead::Whole => {}
            LineRead::TooLong => {
                return Err(too_large(path, format!("row {row} has more than {LONGEST_ROW} bytes")));
            }
        }
        let line = std::str::from_utf8(&line).map_err(|_| {
            failed(Error::new(
                ErrorKind::InvalidData,
                format!("row {row} is not UTF-8 text, expected numbers"),
            ))
        })?;
        if line.trim().is_empty() {
            continue;
        }
        let got = line.split(',').count();
        let wanted = *columns.get_or_insert(got);
        if got != wanted || got > MAX_EMG_CHANNELS {
            let expected = if got > MAX_EMG_CHANNELS {
                format!("at most {MAX_EMG_CHANNELS}")
            } else {
                wanted.to_string()
            };
            return Err(DeviceError::Columns { path: path.to_owned(), row, got, expected });
        }
        let mut values = ChannelValues::new();
        for (text, column) in line.split(',').zip(1..) {
            let text = text.trim();
            match text.parse::<f64>() {
                Ok(value) if value.is_finite() => values.push(value),
                _ => {
                    let (path, text) = (path.to_owned(), text.to_owned());
                    return Err(DeviceError::NotANumber { path, row, column, text });
                }
            }
        }
        rows.push(values);
    }
    if rows.is_empty() {
        return Err(DeviceError::EmptyFile { path: path.to_owned() });
    }
    Ok(rows)
}

fn too_large(path: &Path, reason: String) -> DeviceError {
    let reason = format!("{reason}, expected at most that: one row of numbers a sample");
    DeviceError::Read { path: path.to_owned(), source: Error::new(ErrorKind::FileTooLarge, reason) }
}
