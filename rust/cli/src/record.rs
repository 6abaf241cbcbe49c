use proact_emg::Classifier;
use proact_recording::{RecordingError, TrialBag, TrialHeader, TrialWriter};
use proact_testbed::{Step, TrialConfig, TrialResult};
use proact_types::{ArmModel, PlantState, SimTime};
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

/// Ticks from one joint state in the bag to the next: 50 Hz, as the original's.
const STATE_TICKS: u64 = 20;

/// Writes a trial as it runs.
pub struct Recorder {
    writer: TrialWriter,
    bag: TrialBag,
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
        let writer = TrialWriter::create(dir, &header)?;
        if let Some(classifier) = classifier {
            let path = dir.join(CLASSIFIER_FILE);
            let text = serde_json::to_vec(classifier).map_err(io::Error::from);
            text.and_then(|text| fs::write(&path, text))
                .map_err(|source| RecorderError::Classifier { path, source })?;
        }
        let bag = TrialBag::create(writer.dir(), model)?;
        Ok(Self { writer, bag, end: SimTime(0) })
    }

    /// Writes one tick, after which the plant was in `state`.
    ///
    /// # Errors
    /// [`RecorderError`] when the disk refuses.
    pub fn write(&mut self, step: &Step, state: &PlantState) -> Result<(), RecorderError> {
        let time = step.time;
        self.end = time;
        self.writer.write_input(time, &step.input)?;
        if let Some(span) = &step.output.span {
            self.writer.write_digest(span)?;
        }
        for event in &step.output.events {
            self.writer.write_event(event)?;
            self.bag.write_event(event)?;
        }
        if let Some(decision) = step.output.emg.filter(|decision| decision.published) {
            self.bag.write_emg(time, decision.gesture)?;
        }
        if let Some(gaze) = &step.input.gaze {
            self.bag.write_gaze(time, gaze)?;
        }
        if let Some(plan) = &step.output.plan {
            self.bag.write_plan(time, plan)?;
        }
        if time.0.is_multiple_of(STATE_TICKS) {
            self.bag.write_state(time, state)?;
        }
        if let Some(frame) = &step.frame {
            self.bag.write_frame(frame)?;
        }
        Ok(())
    }

    /// Closes the record with the result; the directory.
    ///
    /// # Errors
    /// [`RecorderError`] when the disk refuses.
    pub fn finish(self, result: &TrialResult) -> Result<PathBuf, RecorderError> {
        self.bag.finish(self.end)?;
        Ok(self.writer.finish(self.end, result)?)
    }
}

/// A directory for a trial that was given none: `trials/D-seated-seed1`, with a number added if it is taken.
pub(crate) fn default_dir(config: &TrialConfig) -> PathBuf {
    let base = format!("{}-{}-seed{}", config.method_label(), config.setup.name, config.seed);
    let trials = Path::new("trials");
    let taken = |name: &String| trials.join(name).exists();
    let names = std::iter::once(base.clone()).chain((2..).map(|k| format!("{base}-{k}")));
    trials.join(names.into_iter().find(|name| !taken(name)).unwrap_or(base))
}
