use crate::{Arm, disk_sync::DiskSync, libraries};
use proact_emg::Classifier;
use proact_planning::PlanLog;
use proact_recording::{
    BAG_FILE, FLUSH_TICKS, RecordingError, StudyTrialId, TrialBag, TrialHeader, TrialWriter,
};
use proact_testbed::{TrialConfig, TrialResult, TrialStep};
use proact_types::{PlantState, SimTime};
use std::{
    fs,
    io::{self, Write},
    path::{Path, PathBuf},
};

/// Name of the trained classifier in a trial directory.
pub const CLASSIFIER_FILE: &str = "classifier.json";

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
    /// The plans' log cannot be written.
    #[error("cannot write {path}: {source}")]
    Plans {
        /// Where.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// The classifier cannot be written as text.
    #[error("the classifier cannot be recorded: {0}")]
    Classifier(#[from] serde_json::Error),
    /// The disk took what was written and did not keep it.
    #[error("the disk does not keep the record in {}: {source}", dir.display())]
    Disk {
        /// The trial directory.
        dir: PathBuf,
        /// What the system said.
        source: io::Error,
    },
}

/// What each plan took, one JSON object a line, in a trial directory. Beside the record: times differ from run to run.
pub(crate) const PLANS_FILE: &str = "plans.jsonl";

/// Ticks from one joint state in the bag to the next: 50 Hz, as the original's.
const STATE_TICKS: u64 = 20;

/// Writes a trial as it runs: logs and bag are handed to the operating system every [`FLUSH_TICKS`] ticks, and to the
/// disk once a second by a thread of its own.
pub struct Recorder {
    writer: TrialWriter,
    bag: TrialBag,
    end: SimTime,
    plans: Option<PlanFile>,
    disk: DiskSync,
}

/// The plans' log as it is written.
struct PlanFile {
    log: PlanLog,
    file: fs::File,
    path: PathBuf,
    written: usize,
}

impl PlanFile {
    fn append_new(&mut self) -> Result<(), RecorderError> {
        for effort in self.log.entries().iter().skip(self.written) {
            let line = serde_json::to_vec(effort).map_err(io::Error::from);
            line.and_then(|line| self.file.write_all(&[line.as_slice(), b"\n"].concat()))
                .map_err(|source| RecorderError::Plans { path: self.path.clone(), source })?;
            self.written += 1;
        }
        Ok(())
    }
}

impl Recorder {
    /// Makes the trial directory `dir`. Nothing has run yet, so a place that cannot be written costs nothing.
    ///
    /// # Errors
    /// [`RecorderError`]; what was made is removed again.
    pub fn create(
        dir: &Path,
        config: &TrialConfig,
        arm: &Arm,
        classifier: Option<&Classifier>,
    ) -> Result<Self, RecorderError> {
        Self::create_files(dir, (BAG_FILE, None), config, arm, classifier)
    }

    /// The same for a trial of a study, with its place there and a name for the bag, whose chunks are compressed: a study
    /// has many.
    ///
    /// # Errors
    /// As [`Recorder::create`].
    pub fn create_in_study(
        dir: &Path,
        (bag, study_trial): (&str, Option<StudyTrialId>),
        config: &TrialConfig,
        arm: &Arm,
        classifier: Option<&Classifier>,
    ) -> Result<Self, RecorderError> {
        let mut recorder = Self::create_files(dir, (bag, study_trial), config, arm, classifier)?;
        recorder.bag.enable_compression();
        Ok(recorder)
    }

    fn create_files(
        dir: &Path,
        (bag, study_trial): (&str, Option<StudyTrialId>),
        config: &TrialConfig,
        arm: &Arm,
        classifier: Option<&Classifier>,
    ) -> Result<Self, RecorderError> {
        let mut files = arm.files();
        if let Some(classifier) = classifier {
            files.insert(CLASSIFIER_FILE.to_owned(), serde_json::to_vec(classifier)?);
        }
        let header = TrialHeader {
            config_toml: config.to_toml()?,
            seed: config.seed,
            versions: libraries::versions(),
            commit: libraries::source_commit().to_owned(),
            study_trial,
            files,
        };
        let writer = TrialWriter::create(dir, &header)?;
        let task = config.build_task(arm.model())?;
        let bag = TrialBag::create(&writer.dir().join(bag), arm.model(), task.scene())?;
        let mut growing = writer.growing_files()?;
        growing.push(bag.file()?);
        Ok(Self { writer, bag, end: SimTime(0), plans: None, disk: DiskSync::start(growing) })
    }

    /// The same, with what each plan takes beside the record: iterations, time on the clock and on the processor,
    /// whether the clock ended it.
    ///
    /// # Errors
    /// [`RecorderError::Plans`] when the disk refuses.
    pub fn with_plans(mut self, log: PlanLog) -> Result<Self, RecorderError> {
        let path = self.writer.dir().join(PLANS_FILE);
        let file =
            fs::File::create(&path).map_err(|source| RecorderError::Plans { path: path.clone(), source })?;
        self.plans = Some(PlanFile { log, file, path, written: 0 });
        Ok(self)
    }

    /// Writes one tick, after which the plant was in `state`.
    ///
    /// # Errors
    /// [`RecorderError`] when the disk refuses.
    pub fn write(&mut self, step: &TrialStep, state: &PlantState) -> Result<(), RecorderError> {
        let time = step.time;
        self.end = time;
        self.disk
            .check()
            .map_err(|source| RecorderError::Disk { dir: self.writer.dir().to_owned(), source })?;
        self.writer.write_input(time, &step.input)?;
        for event in &step.output.events {
            self.writer.write_event(event)?;
            self.bag.write_event(event)?;
        }
        for cue in &step.output.cues {
            self.bag.write_cue(cue)?;
        }
        if let Some(command) = step.output.published_command {
            self.bag.write_emg(time, command)?;
        }
        if let Some(gaze) = &step.input.gaze {
            self.bag.write_gaze(time, gaze)?;
        }
        if let Some(plan) = &step.output.plan {
            self.bag.write_plan(time, plan)?;
            if let Some(plans) = &mut self.plans {
                plans.append_new()?;
            }
        }
        if time.0.is_multiple_of(STATE_TICKS) {
            self.bag.write_state(time, state)?;
        }
        if let Some(frame) = &step.frame {
            self.bag.write_frame(frame)?;
        }
        if time.0.is_multiple_of(FLUSH_TICKS) {
            self.bag.flush()?;
        }
        // Last: a digest vouches for what was written before it.
        if let Some(span) = &step.output.span_digest {
            self.writer.write_digest(span)?;
        }
        Ok(())
    }

    /// Closes the record with the result; the directory.
    ///
    /// # Errors
    /// [`RecorderError`] when the disk refuses.
    pub fn finish(mut self, result: &TrialResult) -> Result<PathBuf, RecorderError> {
        // A plan that was cancelled has no reply in the record, but it took its time.
        if let Some(plans) = &mut self.plans {
            plans.append_new()?;
        }
        self.disk.stop();
        self.bag.finish(self.end)?;
        Ok(self.writer.finish(self.end, result)?)
    }
}

/// A directory for a trial that was given none: `trials/D-seated-seed1`, with a number added if it is taken.
pub fn default_dir(config: &TrialConfig) -> PathBuf {
    let base = format!("{}-{}-seed{}", config.method_label(), config.setup.name, config.seed);
    let trials = Path::new("trials");
    let taken = |name: &String| trials.join(name).exists();
    let names = std::iter::once(base.clone()).chain((2..).map(|k| format!("{base}-{k}")));
    trials.join(names.into_iter().find(|name| !taken(name)).unwrap_or(base))
}
