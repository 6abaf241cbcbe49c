//! Gestures are trained and tested within a session: with an armband a model is made, with keys the sequence alone is tested.

use super::{
    LiveStudy, StepEnd,
    state::{ConductRequest, CurrentStep},
};
use crate::LiveArmband;
use proact_bridge::{ParticipantScreen, PromptScreen, StepActivity, StudyRequest};
use proact_devices::{EmgPacket, RecordingFolder, SampleSource, SourceEvent, SourceOptions};
use proact_emg::{
    Calibration, CalibrationConfig, CalibrationEvent, CalibrationPhase, DcOffsetSource, EmgConfig, EmgModel,
    EmgPipeline, QualityConfig, SequenceConfig, SequenceTest, WindowLength,
};
use proact_files::write_atomically;
use proact_study::{StepId, StudyEvent};
use proact_types::{Command, Gesture, SimTime};
use std::{
    error::Error,
    time::{Duration, Instant},
};

/// Where models and their recordings are, in a study's folder.
const MODELS_FOLDER: &str = "models";
/// The windows of the paper, milliseconds.
const WINDOW_MS: f64 = 100.0;
const INCREMENT_MS: f64 = 50.0;
/// How long samples are waited for at a time.
const POLL_TIMEOUT: Duration = Duration::from_millis(10);
/// The experimenter ends a test that is not passed, not a number of attempts.
const MAX_TEST_ATTEMPTS: usize = 1000;

/// What came of a training.
#[derive(Clone, Debug)]
pub(super) struct TrainingOutcome {
    pub(super) at: Instant,
    pub(super) accuracy: Option<f64>,
    pub(super) passed: Option<bool>,
    /// Its file in the study's folder.
    pub(super) model: Option<String>,
}

/// How the gestures are trained.
#[derive(Clone, Copy, Debug)]
pub(super) struct TrainingPlan {
    pub(super) repetitions: usize,
    pub(super) hold_secs: f64,
    pub(super) consecutive_correct_runs: Option<usize>,
}

impl Default for TrainingPlan {
    /// The paper's: two repetitions of 3 s.
    fn default() -> Self {
        Self { repetitions: 2, hold_secs: 3.0, consecutive_correct_runs: None }
    }
}

impl LiveStudy<'_> {
    /// Trains, then tests, until it is passed or the experimenter is content. What came of it is in the journal.
    ///
    /// # Errors
    /// A source that fails, a disk that refuses.
    pub(super) fn train(&mut self, step_id: &StepId, plan: TrainingPlan) -> Result<StepEnd, Box<dyn Error>> {
        let mut trained = TrainingOutcome { at: Instant::now(), accuracy: None, passed: None, model: None };
        if self.equipment.source.is_some() {
            match self.record(step_id, plan, &mut trained)? {
                StepEnd::Done => {}
                other => return Ok(other),
            }
        }
        let end = self.test(plan, &mut trained)?;
        if end == StepEnd::Done {
            trained.at = Instant::now();
            let TrainingOutcome { model, accuracy, passed, .. } = trained.clone();
            self.state.write(StudyEvent::Trained { step_id: step_id.clone(), model, accuracy, passed });
            self.training = Some(trained);
        }
        Ok(end)
    }

    fn prompt(&mut self, prompt: PromptScreen) {
        if let Some(now) = &mut self.state.current_step {
            (now.content, now.participant) =
                (StepActivity::Train(prompt.clone()), ParticipantScreen::Train(prompt));
        }
    }

    /// Records the repetitions and makes a model of them.
    fn record(
        &mut self,
        step_id: &StepId,
        plan: TrainingPlan,
        trained: &mut TrainingOutcome,
    ) -> Result<StepEnd, Box<dyn Error>> {
        let mut source = self.source()?;
        let config = calibration(&*source, plan)?;
        let mut calibration_run = Calibration::new(config.clone())?;
        let name = self.free_model_name(step_id);
        let folder = self.state.conductor.study.folder.clone();
        let recordings = folder.join(format!("{MODELS_FOLDER}/{name}.recordings"));
        let kept =
            RecordingFolder::create(&recordings, config.emg.rate_hz, &config.gestures, config.emg.rest, &[])?;
        let (begin, mut now) = (Instant::now(), SimTime(0));
        let mut packet = EmgPacket::default();
        let mut source_notice = String::new();
        loop {
            // Everything that is there: a source that is read more slowly than it sends looks like one that loses samples.
            let mut timeout = POLL_TIMEOUT;
            loop {
                let event = source.poll(timeout, &mut packet)?;
                now = now.max(SimTime(match event {
                    SourceEvent::Packet => packet.received.as_millis() as u64,
                    _ => begin.elapsed().as_millis() as u64,
                }));
                let more = matches!(event, SourceEvent::Packet);
                match event {
                    SourceEvent::Ended => return Err("the EMG source ended before the training did".into()),
                    SourceEvent::Lost { reason } => source_notice = format!("The armband is lost: {reason}"),
                    SourceEvent::Restored => source_notice.clear(),
                    SourceEvent::Packet => {}
                    SourceEvent::Nothing => packet.samples.clear(),
                }
                for event in calibration_run.step(now, &packet.samples)? {
                    match event {
                        CalibrationEvent::Prompted(prompt) => source.prompt(prompt.gesture),
                        CalibrationEvent::RepetitionAccepted(_) => {
                            kept.write_newest(&calibration_run)?;
                            source_notice.clear();
                        }
                        CalibrationEvent::RepetitionRejected(..) => {
                            source_notice = "That one was not kept: once more".to_owned()
                        }
                        _ => {}
                    }
                }
                packet.samples.clear();
                timeout = Duration::ZERO;
                if !more || calibration_run.phase() == CalibrationPhase::Reviewing {
                    break;
                }
            }
            self.prompt(training_prompt(calibration_run.phase(), &source_notice, config.emg.rest));
            // What came in while the source was waited for; the source paces this.
            for request in self.state.wait()? {
                if let Some(end) = self.step_end(&request, false) {
                    self.idle_source = Some(source);
                    return Ok(end);
                }
            }
            if self.state.interrupted() {
                self.idle_source = Some(source);
                return Ok(StepEnd::Interrupted);
            }
            if calibration_run.phase() == CalibrationPhase::Reviewing {
                if calibration_run.rounds() >= plan.repetitions.max(config.min_rounds) {
                    break;
                }
                calibration_run.start_next_round();
            }
        }
        source.prompt(config.emg.rest);
        let model = calibration_run.finish()?;
        trained.accuracy = calibration_run.report().map(|report| report.accuracy);
        let file = format!("{MODELS_FOLDER}/{name}.json");
        write_atomically(&folder.join(&file), &model.to_json()?)?;
        trained.model = Some(file);
        self.equipment.armband = Some(LiveArmband::start(source, model));
        self.armband_participant = Some(step_id.participant);
        Ok(StepEnd::Done)
    }

    /// The source of muscles: that of the armband in use, or a new one.
    pub(super) fn source(&mut self) -> Result<Box<dyn SampleSource>, Box<dyn Error>> {
        if let Some(source) = self.idle_source.take() {
            return Ok(source);
        }
        if let Some(source) = self.equipment.armband.take().and_then(LiveArmband::into_source) {
            return Ok(source);
        }
        let name = self.equipment.source.as_ref().ok_or("gestures come from keys")?;
        Ok(self.registry.sources.open(name, &SourceOptions::default())?)
    }

    fn free_model_name(&self, step_id: &StepId) -> String {
        let folder = self.state.conductor.study.folder.join(MODELS_FOLDER);
        // By the place in the plan, as records are: names of files are exported, pseudonyms are not.
        let base = format!("participant{}-session{}", step_id.participant, step_id.session);
        let name = |k: usize| if k == 1 { base.clone() } else { format!("{base}-{k}") };
        let taken = |name: &String| {
            folder.join(format!("{name}.json")).exists() || folder.join(format!("{name}.recordings")).exists()
        };
        (1..).map(name).find(|name| !taken(name)).unwrap_or(base)
    }

    /// All gestures in the prescribed sequence, until they were made as often as planned without a mistake.
    fn test(&mut self, plan: TrainingPlan, trained: &mut TrainingOutcome) -> Result<StepEnd, Box<dyn Error>> {
        let model = self.equipment.armband.as_ref().map(|armband| armband.model().clone());
        let (gestures, rest) = match &model {
            Some(model) => (model.classifier.gestures().to_vec(), model.config.rest),
            None => (Command::ALL.map(Gesture::from).to_vec(), Gesture::default()),
        };
        let config = SequenceConfig {
            required_consecutive: plan.consecutive_correct_runs.unwrap_or(MAX_TEST_ATTEMPTS),
            attempts: MAX_TEST_ATTEMPTS,
            ..SequenceConfig::for_gestures(&gestures, rest)
        };
        let mut test = SequenceTest::new(config)?;
        let mut pipeline = model.as_ref().map(pipeline).transpose()?;
        let (begin, mut in_force) = (Instant::now(), rest);
        let mut last_gesture = None;
        loop {
            let now = SimTime(begin.elapsed().as_millis() as u64);
            if let (Some(pipeline), Some(armband)) = (&mut pipeline, &self.equipment.armband) {
                let samples = armband.wait_for_samples(Duration::from_millis(5));
                if let Some(output) = pipeline.step(now, &samples) {
                    in_force = output.gesture;
                }
            }
            // After a signal that failed nothing moves until the hand was relaxed, in a trial too: it is asked for.
            let relaxes = pipeline.as_ref().is_some_and(EmgPipeline::is_disarmed);
            if !test.report().passed && !relaxes {
                test.step(now, in_force);
            }
            let passed = test.report().passed;
            trained.passed = plan.consecutive_correct_runs.map(|_| passed);
            let gesture = test.prompt().filter(|_| !passed && !relaxes).unwrap_or(rest);
            if last_gesture.replace(gesture) != Some(gesture)
                && let Some(armband) = &self.equipment.armband
            {
                armband.prompt(gesture);
            }
            let text = match (passed, relaxes) {
                (true, _) => "Done. Relax.",
                (false, true) => "The signal was lost for a moment. Relax.",
                (false, false) => "Make this gesture and hold it",
            };
            let share = plan
                .consecutive_correct_runs
                .map_or(0.0, |runs| test.report().consecutive_correct as f64 / runs as f64);
            self.prompt(PromptScreen {
                gesture,
                text: text.to_owned(),
                progress: share.min(1.0),
                recording: false,
                recognized: Some(in_force),
                consecutive_sequences: test.report().consecutive_correct,
                required_sequences: plan.consecutive_correct_runs,
                passed,
                uses_keyboard: model.is_none(),
            });
            for request in self.state.wait()? {
                if let (ConductRequest::Gesture(command), None) = (&request, &model) {
                    in_force = Gesture::from(*command);
                }
                if let Some(end) = self.step_end(&request, true) {
                    return Ok(end);
                }
            }
            if self.state.interrupted() {
                return Ok(StepEnd::Interrupted);
            }
        }
    }

    /// Trains once more in the middle of a session, and goes on with the step that was under way.
    ///
    /// # Errors
    /// As [`LiveStudy::train`].
    pub(super) fn retrain(&mut self, step_id: &StepId) -> Result<(), Box<dyn Error>> {
        let before: Option<CurrentStep> = self.state.current_step.clone();
        let plan = self.planned_training();
        let end = self.train(step_id, plan)?;
        if end != StepEnd::Done {
            self.state.message = "the training was not finished".to_owned();
        }
        (self.state.current_step, self.state.needs_refresh) = (before, true);
        Ok(())
    }
}

/// How the stream of a source is calibrated.
fn calibration(source: &dyn SampleSource, plan: TrainingPlan) -> Result<CalibrationConfig, Box<dyn Error>> {
    let info = source.info();
    let emg = EmgConfig {
        rate_hz: info.rate_hz,
        channels: info.channels,
        window: WindowLength::Millis(WINDOW_MS),
        increment: WindowLength::Millis(INCREMENT_MS),
        ..EmgConfig::default()
    };
    let rails = info.rails.map(|(low, high)| [low - info.zero_code, high - info.zero_code]);
    let config = CalibrationConfig {
        emg,
        repetition_secs: plan.hold_secs,
        max_rounds: plan.repetitions.max(CalibrationConfig::default().max_rounds),
        dc_offset: DcOffsetSource::RestMedian,
        nominal_dc_offset: info.zero_code,
        quality: QualityConfig { rails, ..QualityConfig::default() },
        ..CalibrationConfig::default()
    };
    config.check()?;
    Ok(config)
}

fn pipeline(model: &EmgModel) -> Result<EmgPipeline, Box<dyn Error>> {
    Ok(EmgPipeline::new(&model.config, model.classifier.clone())?.with_dc_offset(&model.dc_offset)?)
}

fn training_prompt(phase: CalibrationPhase, source_notice: &str, rest: Gesture) -> PromptScreen {
    let (gesture, share, recording, text) = match phase {
        CalibrationPhase::Blocked { prompt } => {
            (prompt.gesture, 0.0, false, "Waiting for a good signal".to_owned())
        }
        CalibrationPhase::Preparing { prompt, remaining_secs: left_secs } => {
            (prompt.gesture, 0.0, false, format!("Make it now: recording in {left_secs:.0} s"))
        }
        CalibrationPhase::Recording { prompt, share } => (prompt.gesture, share, true, "Hold".to_owned()),
        CalibrationPhase::Reviewing | CalibrationPhase::Finished => (rest, 1.0, false, "Relax".to_owned()),
    };
    let text = if source_notice.is_empty() { text } else { format!("{text}. {source_notice}") };
    PromptScreen { gesture, text, progress: share, recording, ..PromptScreen::default() }
}

/// Whether this request ends a training.
pub(super) fn is_next(request: &StudyRequest) -> bool {
    matches!(request, StudyRequest::Next {})
}
