//! Calibrations of headset and shoulder on disk: TOML with date, sources and a hash, one file of each kind in a folder.

use crate::HeadsetMarkerCalibration;
use proact_files::{make_folder, write_atomically};
use proact_localization::{HeadsetCalibrationVerdict, ShoulderCalibration, ShoulderVerdict};
use proact_testbed::Setup;
use serde::{Deserialize, Serialize, de::DeserializeOwned};
use std::{
    io,
    path::{Path, PathBuf},
};

/// The folder that commands look into unless they are told another.
pub const CALIBRATIONS_DIR: &str = "calibrations";

/// Why a calibration is not read or written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CalibrationFileError {
    /// The disk.
    #[error("{}: {source}", path.display())]
    Disk {
        /// Which file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// Not a calibration.
    #[error("{}: {reason}; repeat the calibration: proact localize --help", path.display())]
    Invalid {
        /// Which file.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
}

/// A kind of calibration.
pub trait CalibrationFile: Serialize + DeserializeOwned {
    /// Its file in the folder.
    const FILE: &'static str;
    /// The verdict in words.
    fn verdict(&self) -> String;
    /// Whether a trial may rest on it.
    fn is_good(&self) -> bool;
    /// What is left, m.
    fn residual_m(&self) -> f64;
}

impl CalibrationFile for HeadsetMarkerCalibration {
    const FILE: &'static str = "headset.toml";

    fn verdict(&self) -> String {
        self.headset.verdict.to_string()
    }

    fn is_good(&self) -> bool {
        self.headset.verdict == HeadsetCalibrationVerdict::Good
    }

    fn residual_m(&self) -> f64 {
        self.headset.residual_m
    }
}

impl CalibrationFile for ShoulderCalibration {
    const FILE: &'static str = "shoulder.toml";

    fn verdict(&self) -> String {
        self.verdict.to_string()
    }

    fn is_good(&self) -> bool {
        matches!(self.verdict, ShoulderVerdict::Good | ShoulderVerdict::NoCircles)
    }

    fn residual_m(&self) -> f64 {
        self.center.map_or(self.moved_m, |fit| fit.residual_m)
    }
}

/// A file that a calibration was made from.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CalibrationSource {
    /// As it was named.
    pub file: String,
    /// BLAKE3 of its bytes.
    pub hash: String,
}

/// A calibration with what it comes from.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SavedCalibration<T> {
    /// When it was made, UTC.
    pub made_at: String,
    /// What it was made from.
    pub sources: Vec<CalibrationSource>,
    /// The calibration.
    pub calibration: T,
}

/// What stands before the hash of all lines below it.
const HASH_PREFIX: &str = "# blake3 of what follows: ";

impl<T: CalibrationFile> SavedCalibration<T> {
    /// A calibration that is made now from `files`.
    ///
    /// # Errors
    /// A file cannot be read.
    pub fn new(calibration: T, files: &[PathBuf]) -> Result<Self, CalibrationFileError> {
        let source = |path: &PathBuf| {
            let disk = |source| CalibrationFileError::Disk { path: path.clone(), source };
            let mut hasher = blake3::Hasher::new();
            hasher.update_reader(std::fs::File::open(path).map_err(disk)?).map_err(disk)?;
            let hash = hasher.finalize().to_string();
            Ok(CalibrationSource { file: path.display().to_string(), hash })
        };
        let sources = files.iter().map(source).collect::<Result<_, _>>()?;
        let made_at = jiff::Timestamp::now().strftime("%Y-%m-%dT%H:%M:%SZ").to_string();
        Ok(Self { made_at, sources, calibration })
    }

    /// The text of its file.
    ///
    /// # Errors
    /// It cannot be written as TOML.
    pub fn text(&self) -> Result<String, toml::ser::Error> {
        let body = toml::to_string(self)?;
        Ok(format!("{HASH_PREFIX}{}\n{body}", blake3::hash(body.as_bytes())))
    }

    /// Writes it into `dir`, which is made if it is not there; the file.
    ///
    /// # Errors
    /// The disk refuses.
    pub fn save(&self, dir: &Path) -> Result<PathBuf, CalibrationFileError> {
        let path = dir.join(T::FILE);
        let disk = |source| CalibrationFileError::Disk { path: path.clone(), source };
        let text = self.text().map_err(|error| CalibrationFileError::Invalid {
            path: path.clone(),
            reason: error.to_string(),
        })?;
        make_folder(dir).and_then(|()| write_atomically(&path, &text)).map_err(|error| disk(error.into()))?;
        Ok(path)
    }

    /// Reads that of `dir`; none if there is none.
    ///
    /// # Errors
    /// The file cannot be read, is no calibration, or is not as it was written.
    pub fn load(dir: &Path) -> Result<Option<Self>, CalibrationFileError> {
        let path = dir.join(T::FILE);
        let read = std::fs::File::open(&path)
            .and_then(|file| proact_types::read_text(file, proact_types::MAX_TEXT_BYTES));
        let text = match read {
            Ok(text) => text,
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
            Err(source) => return Err(CalibrationFileError::Disk { path, source }),
        };
        let wrong = |reason: String| CalibrationFileError::Invalid { path: path.clone(), reason };
        let lines = text.strip_prefix(HASH_PREFIX).and_then(|rest| rest.split_once('\n'));
        let Some((hash, body)) = lines else {
            return Err(wrong(format!("the first line is not {HASH_PREFIX:?} with a hash")));
        };
        if blake3::hash(body.as_bytes()).to_string() != hash {
            return Err(wrong(
                "its hash is another than that of its lines: it was changed or damaged".to_owned(),
            ));
        }
        toml::from_str(body).map(Some).map_err(|error| wrong(error.to_string()))
    }

    /// One line for people: date, residual, verdict.
    pub fn summary(&self) -> String {
        let residual = 1e3 * self.calibration.residual_m();
        format!("of {}, residual {residual:.1} mm: {}", self.made_at, self.calibration.verdict())
    }
}

/// Both calibrations of a folder.
#[derive(Clone, Debug, Default)]
pub struct Calibrations {
    /// Where the arm sits on the person, and the box.
    pub shoulder: Option<SavedCalibration<ShoulderCalibration>>,
    /// Where the markers sit on the headset.
    pub headset: Option<SavedCalibration<HeadsetMarkerCalibration>>,
}

impl Calibrations {
    /// Those of `dir` that are there.
    ///
    /// # Errors
    /// As [`SavedCalibration::load`].
    pub fn load(dir: &Path) -> Result<Self, CalibrationFileError> {
        Ok(Self { shoulder: SavedCalibration::load(dir)?, headset: SavedCalibration::load(dir)? })
    }

    /// Those that a trial with the body `body` as its shoulder may rest on: good ones, and no shoulder of another body.
    pub fn for_body(self, body: &str) -> Self {
        let shoulder =
            self.shoulder.filter(|saved| saved.calibration.body == body && saved.calibration.is_good());
        Self { shoulder, headset: self.headset.filter(|saved| saved.calibration.is_good()) }
    }

    /// Puts the person of a set-up where the calibration has the shoulder, as a whole.
    pub fn place_person(&self, setup: &mut Setup) {
        let Some(saved) = &self.shoulder else { return };
        let shoulder = saved.calibration.placement.world_from_shoulder.translation.vector;
        let offset = shoulder - setup.body.shoulder_m.coords;
        for point in [&mut setup.body.hip_m, &mut setup.body.shoulder_m, &mut setup.body.eye_m] {
            *point += offset;
        }
    }

    /// Each kind with its line.
    pub fn summaries(&self) -> Vec<(&'static str, String, bool)> {
        let shoulder =
            self.shoulder.iter().map(|saved| ("shoulder", saved.summary(), saved.calibration.is_good()));
        let headset =
            self.headset.iter().map(|saved| ("headset", saved.summary(), saved.calibration.is_good()));
        shoulder.chain(headset).collect()
    }

    /// Writes them into a trial's directory, beside its record.
    ///
    /// # Errors
    /// The disk refuses.
    pub fn save_to_record(&self, dir: &Path) -> Result<(), CalibrationFileError> {
        let dir = dir.join(CALIBRATIONS_DIR);
        if let Some(shoulder) = &self.shoulder {
            shoulder.save(&dir)?;
        }
        if let Some(headset) = &self.headset {
            headset.save(&dir)?;
        }
        Ok(())
    }
}
