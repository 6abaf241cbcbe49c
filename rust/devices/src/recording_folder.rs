use crate::{DeviceError, Recording, Recordings, metadata::Metadata};
use proact_emg::{Calibration, ImuChannel};
use proact_files::{make_folder, write_atomically};
use proact_types::{ChannelValues, Gesture, MAX_TEXT_BYTES, read_text};
use std::{
    collections::BTreeSet,
    fs::File,
    io::{ErrorKind, Write},
    path::{Path, PathBuf},
};

/// A folder that recordings are put into one by one: `R_<repetition>_C_<class>.csv` files with `metadata.json` beside
/// them, which [`Recordings::open`] and LibEMG read.
#[derive(Clone, Debug)]
pub struct RecordingFolder {
    dir: PathBuf,
    /// In the order of their class numbers.
    gestures: Vec<Gesture>,
    /// Channels of an inertial measurement unit behind the electrodes.
    imu: usize,
}

impl RecordingFolder {
    /// Makes the folder if it is not there, for recordings of `rate_hz` of `gestures`, whose class numbers are in
    /// alphabetical order; `rest` is that of a relaxed hand, and `imu` the channels that follow the electrodes.
    ///
    /// # Errors
    /// A folder that cannot be written, or one that holds recordings already.
    pub fn create(
        dir: &Path,
        rate_hz: f64,
        gestures: &[Gesture],
        rest: Gesture,
        imu: &[ImuChannel],
    ) -> Result<Self, DeviceError> {
        make_folder(dir).map_err(|error| write_error(dir)(error.into()))?;
        let gestures: Vec<Gesture> = gestures.iter().copied().collect::<BTreeSet<_>>().into_iter().collect();
        let named = gestures
            .iter()
            .zip(0..)
            .map(|(gesture, class): (_, usize)| (class.to_string(), gesture.as_str().into()));
        let classes: serde_json::Map<String, serde_json::Value> = named.collect();
        let mut metadata = serde_json::json!({ "rate_hz": rate_hz, "class_map": classes });
        if rest != Gesture::default() {
            metadata["rest"] = rest.as_str().into();
        }
        if !imu.is_empty() {
            metadata["imu"] = serde_json::json!(imu);
        }
        let path = dir.join(METADATA_FILE);
        let mut file = std::fs::File::create_new(&path).map_err(write_error(&path))?;
        file.write_all(format!("{metadata:#}\n").as_bytes())
            .and_then(|()| file.sync_all())
            .map_err(write_error(&path))?;
        Ok(Self { dir: dir.to_owned(), gestures, imu: imu.len() })
    }

    /// The folder.
    pub fn path(&self) -> &Path {
        &self.dir
    }

    /// Writes the repetition that a calibration kept last.
    ///
    /// # Errors
    /// As [`RecordingFolder::write_recording`].
    pub fn write_newest(&self, calibration: &Calibration) -> Result<(), DeviceError> {
        let Some((last, before)) = calibration.repetitions().split_last() else { return Ok(()) };
        let number = before.iter().filter(|other| other.gesture == last.gesture).count();
        let number = u32::try_from(number).unwrap_or(u32::MAX);
        self.write_recording(&Recording::bridge_gaps(number, last.gesture, &last.samples))
    }

    /// Writes one recording, in one piece and to the disk. It takes the place of one of the same gesture and number.
    ///
    /// # Errors
    /// A gesture that the folder is not for, or a file that cannot be written; one that was there before stays then.
    pub fn write_recording(&self, item: &Recording) -> Result<(), DeviceError> {
        let name = self.file_name(item.gesture, item.repetition)?;
        let line = |row: &[f64]| row.iter().map(f64::to_string).collect::<Vec<_>>().join(",") + "\n";
        let split = |row: &ChannelValues| row.len() - self.imu.min(row.len());
        let text: String = item.samples.iter().map(|row| line(&row[..split(row)])).collect();
        // First, so that no row is ever taken for a measured one.
        self.mark_bridged_rows(&name, &item.bridged)?;
        if self.imu > 0 {
            let text: String = item.samples.iter().map(|row| line(&row[split(row)..])).collect();
            self.replace_file(&imu_file_name(&name), &text)?;
        }
        self.replace_file(&name, &text)
    }

    /// Removes a recording that is to be made again. That there is none is no error.
    ///
    /// # Errors
    /// A gesture that the folder is not for, or a file that cannot be removed.
    pub fn remove_recording(&self, gesture: Gesture, repetition: u32) -> Result<(), DeviceError> {
        let name = self.file_name(gesture, repetition)?;
        for path in [self.dir.join(&name), self.dir.join(imu_file_name(&name))] {
            match std::fs::remove_file(&path) {
                Err(error) if error.kind() != ErrorKind::NotFound => return Err(write_error(&path)(error)),
                _ => {}
            }
        }
        Ok(())
    }

    /// The folder of a session that was interrupted, to go on with; its recordings.
    ///
    /// # Errors
    /// A folder that cannot be read, or that is for other gestures or another stream.
    pub fn resume(
        dir: &Path,
        rate_hz: f64,
        channels: usize,
        gestures: &[Gesture],
        rest: Gesture,
        imu: &[ImuChannel],
    ) -> Result<(Self, Recordings), DeviceError> {
        let gestures: Vec<Gesture> = gestures.iter().copied().collect::<BTreeSet<_>>().into_iter().collect();
        let metadata = Metadata::read(dir)?;
        let differs = |what: &str, has: String, requested: String| DeviceError::Metadata {
            path: dir.to_owned(),
            reason: format!("it is for {what} {has}, this calibration has {requested}: name another folder"),
        };
        let named = |list: &[Gesture]| list.iter().map(Gesture::as_str).collect::<Vec<_>>().join(", ");
        let expected = metadata.gestures();
        if expected != gestures {
            return Err(differs("the gestures", named(&expected), named(&gestures)));
        }
        if metadata.rest.unwrap_or_default() != rest {
            return Err(differs("rest", metadata.rest.unwrap_or_default().to_string(), rest.to_string()));
        }
        let has = if metadata.has_imu() { metadata.imu(dir)? } else { &[] };
        if has != imu {
            let named = |list: &[ImuChannel]| match list.len() {
                0 => "none".to_owned(),
                _ => list.iter().map(|channel| channel.name.as_str()).collect::<Vec<_>>().join(", "),
            };
            return Err(differs("the inertial channels", named(has), named(imu)));
        }
        let folder = Self { dir: dir.to_owned(), gestures, imu: imu.len() };
        let open = if imu.is_empty() { Recordings::open } else { Recordings::open_with_imu };
        let recordings = match open(dir, Some(rate_hz)) {
            Ok(recordings) => recordings,
            // Stopped before the first was kept.
            Err(DeviceError::NoRecordings { .. }) => {
                let (path, items) = (dir.to_owned(), Vec::new());
                return Ok((
                    folder,
                    Recordings {
                        path,
                        rate_hz,
                        channels,
                        imu: imu.to_vec(),
                        expected,
                        rest,
                        items,
                        notes: Vec::new(),
                        unknown_rate_keys: Vec::new(),
                    },
                ));
            }
            Err(error) => return Err(error),
        };
        if recordings.channels != channels {
            return Err(differs("channels", recordings.channels.to_string(), channels.to_string()));
        }
        Ok((folder, recordings))
    }

    /// The name of a recording's file.
    fn file_name(&self, gesture: Gesture, repetition: u32) -> Result<String, DeviceError> {
        let unlisted = |_| DeviceError::GestureNotListed { path: self.dir.clone(), gesture };
        let class = self.gestures.binary_search(&gesture).map_err(unlisted)?;
        Ok(format!("R_{repetition}_C_{class}.csv"))
    }

    /// Writes into the metadata which rows of a file nobody measured.
    fn mark_bridged_rows(&self, name: &str, bridged: &[[usize; 2]]) -> Result<(), DeviceError> {
        let path = self.dir.join(METADATA_FILE);
        let text = File::open(&path)
            .and_then(|file| read_text(file, MAX_TEXT_BYTES))
            .map_err(|source| DeviceError::Read { path: path.clone(), source })?;
        let mut metadata: serde_json::Value = serde_json::from_str(&text)
            .map_err(|error| DeviceError::Metadata { path: path.clone(), reason: error.to_string() })?;
        if bridged.is_empty() && metadata["bridged"].get(name).is_none() {
            return Ok(());
        }
        if let Some(object) = metadata.as_object_mut() {
            let marks = object.entry("bridged").or_insert_with(|| serde_json::json!({}));
            marks[name] = serde_json::json!(bridged);
        }
        self.replace_file(METADATA_FILE, &format!("{metadata:#}\n"))
    }

    /// Puts a whole file in the place of one, on the disk.
    fn replace_file(&self, name: &str, text: &str) -> Result<(), DeviceError> {
        let path = self.dir.join(name);
        write_atomically(&path, text).map_err(|error| write_error(&path)(error.into()))
    }
}

/// The name of what an inertial measurement unit said beside the recording called `name`.
fn imu_file_name(name: &str) -> String {
    name.replace(".csv", "_IMU.csv")
}

/// What stands beside the recordings of a folder.
const METADATA_FILE: &str = "metadata.json";

/// For `map_err`: a file or folder that cannot be written.
fn write_error(path: &Path) -> impl FnOnce(std::io::Error) -> DeviceError {
    let path = path.to_owned();
    move |source| DeviceError::Write { path, source }
}
