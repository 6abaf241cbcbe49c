use proact_emg::Classifier;
use proact_recording::{RecordingError, TrialHeader, TrialWriter};
use proact_testbed::{Step, TrialConfig, TrialResult};
use proact_types::{ArmModel, SimTime, TickInput};
use std::{
    fs, io,
    path::{Path, PathBuf},
};

/// Name of the trained classifier in a trial directory.
pub(crate) const CLASSIFIER_FILE: &str = "classifier.json";

/// Why a trial is not recorded.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RecorderError {
    /// The trial directory.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// The configuration cannot be written as text.
    #[error(transparent)]
    Config(#[from] proact_testbed::ConfigError),
    /// The classifier cannot be stored.
    #[error("cannot write {path}: {source}")]
    Classifier {
        /// Where.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
}

/// Writes a trial as it runs.
pub struct Recorder {
    writer: TrialWriter,
    end: SimTime,
}

impl Recorder {
    /// Makes the trial directory `dir`. Nothing has run yet, so a place that cannot be written costs nothing.
    ///
    /// # Errors
    /// [`RecorderError`]; what was made is removed again.
    pub fn create(
        dir: &Path,
        config: &TrialConfig,
        model: &ArmModel,
        classifier: Option<&Classifier>,
    ) -> Result<Self, RecorderError> {
        let header = TrialHeader {
            config_toml: config.to_toml()?,
            seed: config.seed,
            versions: [("proact".to_owned(), env!("CARGO_PKG_VERSION").to_owned())].into(),
        };
        let _ = model;
        let writer = TrialWriter::create(dir, &header)?;
        if let Some(classifier) = classifier {
            let path = dir.join(CLASSIFIER_FILE);
            let text = serde_json::to_vec(classifier).map_err(io::Error::from);
            text.and_then(|text| fs::write(&path, text))
                .map_err(|source| RecorderError::Classifier { path, source })?;
        }
        Ok(Self { writer, end: SimTime(0) })
    }

    /// Writes one tick.
    ///
    /// # Errors
    /// [`RecorderError`] when the disk refuses.
    pub fn write(&mut self, step: &Step) -> Result<(), RecorderError> {
        self.end = step.time;
        if step.input != TickInput::default() {
            self.writer.write_input(step.time, &step.input)?;
        }
        if let Some(span) = &step.output.span {
            self.writer.write_digest(span)?;
        }
        for event in &step.output.events {
            self.writer.write_event(event)?;
        }
        Ok(())
    }

    /// Closes the record with the result; the directory.
    ///
    /// # Errors
    /// [`RecorderError`] when the disk refuses.
    pub fn finish(self, result: &TrialResult) -> Result<PathBuf, RecorderError> {
        Ok(self.writer.finish(self.end, result)?)
    }
}

/// A directory for a trial that was given none: `trials/D-seated-seed1`, with a number added if it is taken.
pub(crate) fn default_dir(config: &TrialConfig) -> PathBuf {
    let base = format!("{}-{}-seed{}", config.method, config.setup.name, config.seed);
    let trials = Path::new("trials");
    let taken = |name: &String| trials.join(name).exists();
    let names = std::iter::once(base.clone()).chain((2..).map(|k| format!("{base}-{k}")));
    trials.join(names.into_iter().find(|name| !taken(name)).unwrap_or(base))
}
