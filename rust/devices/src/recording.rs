use crate::{
    DeviceError, RecordingFolder,
    metadata::Metadata,
    sample_file::{SampleFile, read_rows, read_samples},
};
use proact_emg::{ImuChannel, RATES_HZ};
use proact_types::{ChannelValues, Command, EmgSample, Gesture};
use std::{
    collections::BTreeSet,
    path::{Path, PathBuf},
};

/// Rate of the Myo armband, with which the freely licensed recordings were made.
pub const MYO_RATE_HZ: f64 = 200.0;

/// How recordings lie in a folder.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum RecordingLayout {
    /// `R_<repetition>_C_<class>.csv` or `R_<repetition>_C_<class>_EMG.csv`, one column a channel; class numbers
    /// by the folder's metadata, else in the order of [`Command::ALL`].
    LibEmg,
    /// That of a participant of the 3DC data set: `train/EMG/3dc_EMG_gesture_<repetition>_<class>.txt` and the same in `test`, whose
    /// repetitions follow. 1000 Hz.
    ThreeDc,
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
    pub gesture: Gesture,
    /// `[samples][channels]`, without gaps; those of an inertial measurement unit follow the electrodes ([`Recordings::imu`]).
    pub samples: Vec<ChannelValues>,
    /// First row, from 0, and number of rows that were lost: what stands there nobody measured.
    pub bridged: Vec<[usize; 2]>,
    /// Where it was read from.
    pub path: PathBuf,
}

impl Recording {
    /// Samples per second of a file by itself, by the rules of [`Recordings::open`].
    ///
    /// # Errors
    /// Metadata beside it that cannot be used, or a rate that nobody says.
    pub fn rate_hz(&self, requested_hz: Option<f64>) -> Result<f64, DeviceError> {
        let beside = Metadata::read(self.path.parent().unwrap_or(Path::new("")))?.rate_hz;
        let rate_hz = requested_hz.or(beside).or(self.is_from_myo().then_some(MYO_RATE_HZ));
        rate_hz.ok_or_else(|| DeviceError::UnknownRate { path: self.path.clone() })
    }

    /// Whether its samples are what a Myo gives: eight signed bytes.
    fn is_from_myo(&self) -> bool {
        let byte = |value: &f64| value.fract() == 0.0 && (-128.0..=127.0).contains(value);
        self.samples.iter().all(|sample| sample.len() == MYO_CHANNELS && sample.iter().all(byte))
    }

    /// The samples with counters from 0, which step over those that were lost.
    pub fn numbered_samples(&self) -> impl Iterator<Item = EmgSample> + '_ {
        let lost = |row: usize| self.bridged.iter().any(|[first, rows]| row >= *first && row - first < *rows);
        let measured = self.samples.iter().enumerate().filter(move |(row, _)| !lost(*row));
        measured.map(|(row, channels)| EmgSample { counter: row as u64, channels: channels.clone() })
    }

    /// Samples that may have gaps as a recording without: what was lost lies on a straight line, and is marked.
    pub fn bridge_gaps(repetition: u32, gesture: Gesture, samples: &[EmgSample]) -> Recording {
        let (mut rows, mut bridged): (Vec<ChannelValues>, Vec<[usize; 2]>) = (Vec::new(), Vec::new());
        for (k, sample) in samples.iter().enumerate() {
            let before = k.checked_sub(1).map(|k| &samples[k]);
            let gap = before.map_or(0, |before| sample.counter.saturating_sub(before.counter + 1));
            if let Some(before) = before.filter(|_| gap > 0) {
                bridged.push([rows.len(), gap as usize]);
                for step in 1..=gap {
                    let share = step as f64 / (gap + 1) as f64;
                    let line = before.channels.iter().zip(&sample.channels).map(|(a, b)| a + share * (b - a));
                    rows.push(line.collect());
                }
            }
            rows.push(sample.channels.clone());
        }
        Recording { repetition, gesture, samples: rows, bridged, path: PathBuf::new() }
    }
}

/// All recordings of one person and session.
#[derive(Clone, Debug, PartialEq)]
pub struct Recordings {
    /// The folder.
    pub path: PathBuf,
    /// Samples per second.
    pub rate_hz: f64,
    /// Electrodes, which come first in every sample.
    pub channels: usize,
    /// Channels of an inertial measurement unit, which follow them. Only [`Recordings::open_with_imu`] reads any.
    pub imu: Vec<ImuChannel>,
    /// The gestures that there should be, in alphabetical order: those that the folder names, else the five.
    pub expected: Vec<Gesture>,
    /// The gesture of a relaxed hand.
    pub rest: Gesture,
    /// Sorted by repetition, then gesture.
    pub items: Vec<Recording>,
    /// What was odd about the files and was read all the same, one sentence each.
    pub notes: Vec<String>,
    /// Keys of the metadata that may be the rate but are unknown, where the rate was assumed. Empty where the rate is known.
    pub unknown_rate_keys: Vec<String>,
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
    /// `collection_details.json`, where classes may have names, too; else as asked for; else it is [`MYO_RATE_HZ`] if the
    /// files are those of a Myo, which has one rate: the layout of myo_readings, or eight channels of signed bytes.
    ///
    /// # Errors
    /// A missing or empty folder, a folder of several sessions, a file with anything but finite numbers in
    /// rows of one length, metadata that cannot be or disagrees, or a rate that nobody says; each says where and what.
    pub fn open(dir: &Path, requested_hz: Option<f64>) -> Result<Recordings, DeviceError> {
        Recordings::open_layout(dir, requested_hz, false)
    }

    /// [`Recordings::open`] of a folder with what an inertial measurement unit said: a file `R_<repetition>_C_<class>_IMU.csv` beside each
    /// of the electrodes', a column a channel, whose names and units `metadata.json` has under `imu`. Rows of a unit that is slower
    /// than the electrodes are held: row k of n belongs to the time from k / n of the recording on.
    ///
    /// # Errors
    /// As [`Recordings::open`]; a folder that says nothing of such channels, or has other columns than it says.
    pub fn open_with_imu(dir: &Path, requested_hz: Option<f64>) -> Result<Recordings, DeviceError> {
        Recordings::open_layout(dir, requested_hz, true)
    }

    fn open_layout(dir: &Path, requested_hz: Option<f64>, with_imu: bool) -> Result<Recordings, DeviceError> {
        if let Some(value) = requested_hz.filter(|rate_hz| !RATES_HZ.contains(rate_hz)) {
            let expected = "1 to 1000000 samples per second";
            return Err(DeviceError::Parameter { name: "EMG rate", value, expected });
        }
        let names = file_names(dir)?;
        let mut metadata = Metadata::read(dir)?;
        let metadata_hz = match (metadata.rate_hz, requested_hz) {
            (Some(recorded_hz), Some(requested_hz)) if recorded_hz != requested_hz => {
                return Err(DeviceError::RateDisagrees {
                    path: dir.to_owned(),
                    recorded_hz,
                    asked_hz: requested_hz,
                });
            }
            (recorded_hz, requested_hz) => recorded_hz.or(requested_hz),
        };
        let imu = if with_imu { metadata.imu(dir)?.to_vec() } else { Vec::new() };
        let (mut items, mut notes) = (Vec::new(), Vec::new());
        match detect_layout(dir, &names) {
            Some(RecordingLayout::LibEmg) => {
                for name in &names {
                    if let Some((repetition, class)) = parse_name(name) {
                        let path = dir.join(name);
                        let gesture = metadata.gesture(&path, class)?;
                        let SampleFile { mut samples, notes: noted } = read_samples(&path)?;
                        notes.extend(noted);
                        if with_imu {
                            append_imu(&mut samples, &imu_path(&path), imu.len(), &mut notes)?;
                        }
                        let bridged = metadata.bridged(&path, name, samples.len())?;
                        items.push(Recording { repetition, gesture, samples, bridged, path });
                    }
                }
            }
            Some(RecordingLayout::ThreeDc) if with_imu => {
                return Err(Metadata::default().missing_imu_error(dir));
            }
            Some(RecordingLayout::ThreeDc) => {
                metadata.name_classes(&THREE_DC_CLASSES);
                items.extend(read_three_dc(dir, &metadata, &mut notes)?);
            }
            Some(RecordingLayout::MyoReadings) if with_imu => {
                return Err(Metadata::default().missing_imu_error(dir));
            }
            Some(RecordingLayout::MyoReadings) => {
                let rate_hz = metadata_hz.unwrap_or(MYO_RATE_HZ);
                for (label, gesture) in MYO_LABELS {
                    let name = format!("{label}.txt");
                    if names.contains(&name) {
                        let path = dir.join(name);
                        items.extend(read_myo_readings(&path, label, gesture.into(), rate_hz, &mut notes)?);
                    }
                }
            }
            None => return Err(unknown_layout_error(dir, &names)),
        }
        items.sort_by_key(|r| (r.repetition, r.gesture));
        let (expected, rest) = (metadata.gestures(), metadata.rest.unwrap_or_default());
        let myo = metadata_hz.is_none() && items.iter().all(Recording::is_from_myo);
        let three_dc = items.iter().any(|r: &Recording| three_dc_name(&r.path).is_some());
        let rate_hz = metadata_hz.or(myo.then_some(MYO_RATE_HZ)).or(three_dc.then_some(THREE_DC_RATE_HZ));
        let rate_hz = rate_hz.ok_or_else(|| DeviceError::UnknownRate { path: dir.to_owned() })?;
        let path = dir.to_owned();
        let unknown_rate_keys = if metadata_hz.is_none() { metadata.unknown_rate_keys() } else { Vec::new() };
        notes.extend(metadata.notes(&unknown_rate_keys));
        let mut recordings =
            Recordings { path, rate_hz, channels: 0, imu, expected, rest, items, notes, unknown_rate_keys };
        recordings.check_items()?;
        Ok(recordings)
    }

    /// Writes all of them into `dir`, as [`RecordingFolder`] does.
    ///
    /// # Errors
    /// A folder or file that cannot be written; none is replaced.
    pub fn write(&self, dir: &Path) -> Result<(), DeviceError> {
        let folder = RecordingFolder::create(dir, self.rate_hz, &self.expected, self.rest, &self.imu)?;
        self.items.iter().try_for_each(|item| folder.write_recording(item))
    }

    /// Checks that all files have the channels of the first, and no repetition comes twice.
    fn check_items(&mut self) -> Result<(), DeviceError> {
        let columns = self.items.first().and_then(|r| r.samples.first()).map_or(0, |s| s.len());
        self.channels = columns - self.imu.len().min(columns);
        for (k, item) in self.items.iter().enumerate() {
            let got = item.samples.first().map_or(0, |s| s.len());
            if got != columns {
                let expected = format!("{} as in {}", columns - self.imu.len(), self.items[0].path.display());
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
    pub fn find(&self, gesture: impl Into<Gesture>, repetition: u32) -> Result<&Recording, DeviceError> {
        let gesture = gesture.into();
        let of_gesture = || self.items.iter().filter(|r| r.gesture == gesture);
        of_gesture().find(|r| r.repetition == repetition).ok_or_else(|| DeviceError::MissingRepetition {
            repetition,
            gesture,
            available: of_gesture().map(|r| r.repetition).collect(),
        })
    }

    /// The gestures of which there is at least one recording, in alphabetical order.
    pub fn gestures(&self) -> Vec<Gesture> {
        self.items.iter().map(|r| r.gesture).collect::<BTreeSet<_>>().into_iter().collect()
    }

    /// Those of the gestures that there should be of which there is none.
    pub fn missing(&self) -> Vec<Gesture> {
        let there = self.gestures();
        self.expected.iter().copied().filter(|g| !there.contains(g)).collect()
    }
}

/// Folders of a participant of the 3DC data set, in the order in which they were recorded.
const THREE_DC_SETS: [&str; 2] = ["train/EMG", "test/EMG"];
/// Rate of the 3DC armband (Cote-Allard et al. 2019).
const THREE_DC_RATE_HZ: f64 = 1000.0;
/// The gestures of the 3DC data set by their class numbers, as LibEMG names them; the first is a relaxed hand.
const THREE_DC_CLASSES: [&str; 11] = [
    "Neutral",
    "Radial Deviation",
    "Wrist Flexion",
    "Ulnar Deviation",
    "Wrist Extension",
    "Supination",
    "Pronation",
    "Power Grip",
    "Open Hand",
    "Chuck Grip",
    "Pinch Grip",
];

/// Repetition and class of a file `3dc_EMG_gesture_<repetition>_<class>.txt`.
fn three_dc_name(path: &Path) -> Option<(u32, u32)> {
    let name = path.file_name()?.to_str()?;
    let numbers = name.strip_prefix("3dc_EMG_gesture_")?.strip_suffix(".txt")?;
    let (repetition, class) = numbers.split_once('_')?;
    Some((repetition.parse().ok()?, class.parse().ok()?))
}

fn has_three_dc(dir: &Path) -> bool {
    let mut inside = THREE_DC_SETS.iter().flat_map(|set| file_names(&dir.join(set)).unwrap_or_default());
    inside.any(|name| three_dc_name(Path::new(&name)).is_some())
}

/// Reads both sets of a participant; the repetitions of the second are numbered on from those of the first.
fn read_three_dc(
    dir: &Path,
    metadata: &Metadata,
    notes: &mut Vec<String>,
) -> Result<Vec<Recording>, DeviceError> {
    let (mut items, mut before): (Vec<Recording>, u32) = (Vec::new(), 0);
    for set in THREE_DC_SETS.map(|set| dir.join(set)).into_iter().filter(|set| set.is_dir()) {
        for name in file_names(&set)? {
            let path = set.join(name);
            let Some((repetition, class)) = three_dc_name(&path) else { continue };
            let gesture = metadata.gesture(&path, class)?;
            let SampleFile { samples, notes: noted } = read_samples(&path)?;
            notes.extend(noted);
            let repetition = before.saturating_add(repetition);
            items.push(Recording { repetition, gesture, samples, bridged: Vec::new(), path });
        }
        before = items.iter().map(|r| r.repetition + 1).max().unwrap_or(0);
    }
    Ok(items)
}

/// Labels of the myo_readings layout. Rest has a file of its own.
const MYO_LABELS: [(u32, Command); 4] = [
    (0, Command::NoMotion),
    (1, Command::WristFlexion),
    (2, Command::WristExtension),
    (7, Command::HandClose),
];

/// Channels of the myo_readings layout; the label follows.
const MYO_CHANNELS: usize = 8;

/// The label is the cue on the screen; the person follows it late. Samples this close to an edge are left out.
const MYO_EDGE_SECS: f64 = 0.5;

/// The rest file is one long stretch; it is cut into as many repetitions as the other files have.
const MYO_REPETITIONS: usize = 6;

fn file_names(dir: &Path) -> Result<Vec<String>, DeviceError> {
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

fn detect_layout(dir: &Path, names: &[String]) -> Option<RecordingLayout> {
    if names.iter().any(|n| parse_name(n).is_some()) {
        Some(RecordingLayout::LibEmg)
    } else if has_three_dc(dir) {
        Some(RecordingLayout::ThreeDc)
    } else if MYO_LABELS.iter().any(|(label, _)| names.contains(&format!("{label}.txt"))) {
        Some(RecordingLayout::MyoReadings)
    } else {
        None
    }
}

fn unknown_layout_error(dir: &Path, names: &[String]) -> DeviceError {
    let holds_recordings = |name: &&String| {
        let inside = dir.join(name);
        file_names(&inside).is_ok_and(|inner| detect_layout(&inside, &inner).is_some())
    };
    let sessions: Vec<String> = names.iter().filter(holds_recordings).cloned().collect();
    let path = dir.to_owned();
    if sessions.is_empty() {
        DeviceError::NoRecordings { path }
    } else {
        DeviceError::ManySessions { path, sessions }
    }
}

/// Where the inertial measurement unit of the recording at `path` is.
fn imu_path(path: &Path) -> PathBuf {
    let stem = path.file_stem().and_then(|stem| stem.to_str()).unwrap_or_default();
    path.with_file_name(format!("{}_IMU.csv", stem.strip_suffix("_EMG").unwrap_or(stem)))
}

/// Reads the `channels` columns of an inertial measurement unit behind those of the electrodes.
fn append_imu(
    samples: &mut [ChannelValues],
    path: &Path,
    channels: usize,
    notes: &mut Vec<String>,
) -> Result<(), DeviceError> {
    let SampleFile { samples: rows, notes: noted } = read_rows(path, Some(channels))?;
    notes.extend(noted);
    let count = samples.len();
    for (k, sample) in samples.iter_mut().enumerate() {
        sample.extend_from_slice(&rows[k * rows.len() / count]);
    }
    Ok(())
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
    gesture: Gesture,
    rate_hz: f64,
    notes: &mut Vec<String>,
) -> Result<Vec<Recording>, DeviceError> {
    let SampleFile { samples: rows, notes: noted } = read_rows(path, Some(MYO_CHANNELS + 1))?;
    notes.extend(noted);
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
    let cues: Vec<&[ChannelValues]> = if gesture == Command::NoMotion {
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
        bridged: Vec::new(),
        path: path.to_owned(),
    };
    Ok(cues.into_iter().zip(0..).map(recording).collect())
}
