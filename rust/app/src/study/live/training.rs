//! Gestures are trained and tested within a session: with an armband a model is made, with keys the sequence alone is tested.

use super::{
    LiveStudy, StepEnd,
    state::{Now, Wish},
};
use crate::LiveArmband;
use proact_bridge::{NowWhat, ParticipantScreen, PromptScreen, StudyRequest};
use proact_devices::{EmgPacket, RecordingFolder, SampleSource, SourceEvent, SourceOptions};
use proact_emg::{
    Calibration, CalibrationConfig, CalibrationEvent, EmgConfig, EmgModel, EmgPipeline, Phase, QualityConfig,
    SequenceConfig, SequenceTest, WindowLength, ZeroLevel,
};
use proact_files::write_whole;
use proact_study::{Spot, StudyEvent};
use proact_types::{Gesture, GestureName, SimTime};
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
const PATIENCE: Duration = Duration::from_millis(10);
/// The experimenter ends a test that is not passed, not a number of attempts.
const ATTEMPTS: usize = 1000;

/// What came of a training.
#[derive(Clone, Debug)]
pub(super) struct Trained {
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
    pub(super) pass_runs: Option<usize>,
}

impl Default for TrainingPlan {
    /// The paper's: two repetitions of 3 s.
    fn default() -> Self {
        Self { repetitions: 2, hold_secs: 3.0, pass_runs: None }
    }
}

impl LiveStudy<'_> {
    /// Trains, then tests, until it is passed or the experimenter is content. What came of it is in the journal.
    ///
    /// # Errors
    /// A source that fails, a disk that refuses.
    pub(super) fn train(&mut self, spot: &Spot, plan: TrainingPlan) -> Result<StepEnd, Box<dyn Error>> {
        let mut trained = Trained { at: Instant::now(), accuracy: None, passed: None, model: None };
        if self.equipment.source.is_some() {
            match self.record(spot, plan, &mut trained)? {
                StepEnd::Done => {}
                other => return Ok(other),
            }
        }
        let end = self.test(plan, &mut trained)?;
        if end == StepEnd::Done {
            trained.at = Instant::now();
            let Trained { model, accuracy, passed, .. } = trained.clone();
            self.state.write(StudyEvent::Trained { spot: spot.clone(), model, accuracy, passed });
            self.trained = Some(trained);
        }
        Ok(end)
    }

    fn prompt(&mut self, prompt: PromptScreen) {
        if let Some(now) = &mut self.state.now {
            (now.what, now.participant) = (NowWhat::Train(prompt.clone()), ParticipantScreen::Train(prompt));
        }
    }

    /// Records the repetitions and makes a model of them.
    fn record(
        &mut self,
        spot: &Spot,
        plan: TrainingPlan,
        trained: &mut Trained,
    ) -> Result<StepEnd, Box<dyn Error>> {
        let mut source = self.source()?;
        let config = calibration(&*source, plan)?;
        let mut session = Calibration::new(config.clone())?;
        let name = self.free_model_name(spot);
        let folder = self.state.conductor.study.folder.clone();
        let recordings = folder.join(format!("{MODELS_FOLDER}/{name}.recordings"));
        let kept =
            RecordingFolder::create(&recordings, config.emg.rate_hz, &config.gestures, config.emg.rest, &[])?;
        let (begin, mut now) = (Instant::now(), SimTime(0));
        let mut packet = EmgPacket::default();
        let mut said = String::new();
        loop {
            // Everything that is there: a source that is read more slowly than it sends looks like one that loses samples.
            let mut patience = PATIENCE;
            loop {
                let event = source.poll(patience, &mut packet)?;
                now = now.max(SimTime(match event {
                    SourceEvent::Packet => packet.received.as_millis() as u64,
                    _ => begin.elapsed().as_millis() as u64,
                }));
                let more = matches!(event, SourceEvent::Packet);
                match event {
                    SourceEvent::Ended => return Err("the EMG source ended before the training did".into()),
                    SourceEvent::Lost { reason } => said = format!("The armband is lost: {reason}"),
                    SourceEvent::Restored => said.clear(),
                    SourceEvent::Packet => {}
                    SourceEvent::Nothing => packet.samples.clear(),
                }
                for event in session.step(now, &packet.samples)? {
                    match event {
                        CalibrationEvent::Prompted(prompt) => source.prompt(prompt.gesture),
                        CalibrationEvent::Kept(_) => {
                            kept.keep_newest(&session)?;
                            said.clear();
                        }
                        CalibrationEvent::Refused(..) => said = "That one was not kept: once more".to_owned(),
                        _ => {}
                    }
                }
                packet.samples.clear();
                patience = Duration::ZERO;
                if !more || session.phase() == Phase::Reviewing {
                    break;
                }
            }
            self.prompt(prompt_of(session.phase(), &said, config.emg.rest));
            // What came in while the source was waited for; the source paces this.
            for wish in self.state.wait()? {
                if let Some(end) = self.step_end(&wish, false) {
                    self.idle_source = Some(source);
                    return Ok(end);
                }
            }
            if self.state.interrupted() {
                self.idle_source = Some(source);
                return Ok(StepEnd::Interrupted);
            }
            if session.phase() == Phase::Reviewing {
                if session.rounds() >= plan.repetitions.max(config.least_rounds) {
                    break;
                }
                session.proceed();
            }
        }
        source.prompt(config.emg.rest);
        let model = session.finish()?;
        trained.accuracy = session.report().map(|report| report.accuracy);
        let file = format!("{MODELS_FOLDER}/{name}.json");
        write_whole(&folder.join(&file), &model.to_json()?)?;
        trained.model = Some(file);
        self.equipment.armband = Some(LiveArmband::start(source, model));
        self.fitted = Some(spot.participant);
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

    fn free_model_name(&self, spot: &Spot) -> String {
        let folder = self.state.conductor.study.folder.join(MODELS_FOLDER);
        // By the place in the plan, as records are: names of files are exported, pseudonyms are not.
        let base = format!("participant{}-session{}", spot.participant, spot.session);
        let name = |k: usize| if k == 1 { base.clone() } else { format!("{base}-{k}") };
        let taken = |name: &String| {
            folder.join(format!("{name}.json")).exists() || folder.join(format!("{name}.recordings")).exists()
        };
        (1..).map(name).find(|name| !taken(name)).unwrap_or(base)
    }

    /// All gestures in the prescribed sequence, until they were made as often as planned without a mistake.
    fn test(&mut self, plan: TrainingPlan, trained: &mut Trained) -> Result<StepEnd, Box<dyn Error>> {
        let model = self.equipment.armband.as_ref().map(|armband| armband.model().clone());
        let (gestures, rest) = match &model {
            Some(model) => (model.classifier.gestures().to_vec(), model.config.rest),
            None => (Gesture::ALL.map(GestureName::from).to_vec(), GestureName::default()),
        };
        let config = SequenceConfig {
            in_a_row: plan.pass_runs.unwrap_or(ATTEMPTS),
            attempts: ATTEMPTS,
            ..SequenceConfig::of(&gestures, rest)
        };
        let mut test = SequenceTest::new(config)?;
        let mut pipeline = model.as_ref().map(pipeline).transpose()?;
        let (begin, mut in_force) = (Instant::now(), rest);
        let mut asked = None;
        loop {
            let now = SimTime(begin.elapsed().as_millis() as u64);
            if let (Some(pipeline), Some(armband)) = (&mut pipeline, &self.equipment.armband) {
                let samples = armband.wait(Duration::from_millis(5));
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
            trained.passed = plan.pass_runs.map(|_| passed);
            let gesture = test.prompt().filter(|_| !passed && !relaxes).unwrap_or(rest);
            if asked.replace(gesture) != Some(gesture)
                && let Some(armband) = &self.equipment.armband
            {
                armband.prompt(gesture);
            }
            let text = match (passed, relaxes) {
                (true, _) => "Done. Relax.",
                (false, true) => "The signal was lost for a moment. Relax.",
                (false, false) => "Make this gesture and hold it",
            };
            let share = plan.pass_runs.map_or(0.0, |runs| test.report().in_a_row as f64 / runs as f64);
            self.prompt(PromptScreen {
                gesture,
                text: text.to_owned(),
                share: share.min(1.0),
                recording: false,
                recognised: Some(in_force),
                in_a_row: test.report().in_a_row,
                wanted: plan.pass_runs,
                passed,
                keys: model.is_none(),
            });
            for wish in self.state.wait()? {
                if let (Wish::Gesture(gesture), None) = (&wish, &model) {
                    in_force = GestureName::from(*gesture);
                }
                if let Some(end) = self.step_end(&wish, true) {
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
    pub(super) fn retrain(&mut self, spot: &Spot) -> Result<(), Box<dyn Error>> {
        let before: Option<Now> = self.state.now.clone();
        let plan = self.planned_training();
        let end = self.train(spot, plan)?;
        if end != StepEnd::Done {
            self.state.told = "the training was not finished".to_owned();
        }
        (self.state.now, self.state.news) = (before, true);
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
    let rails = info.rails.map(|(low, high)| [low - info.zero, high - info.zero]);
    let config = CalibrationConfig {
        emg,
        repetition_secs: plan.hold_secs,
        most_rounds: plan.repetitions.max(CalibrationConfig::default().most_rounds),
        zero: ZeroLevel::RestMedian,
        nominal_zero: info.zero,
        quality: QualityConfig { rails, ..QualityConfig::default() },
        ..CalibrationConfig::default()
    };
    config.check()?;
    Ok(config)
}

fn pipeline(model: &EmgModel) -> Result<EmgPipeline, Box<dyn Error>> {
    Ok(EmgPipeline::new(&model.config, model.classifier.clone())?.with_centring(&model.centring)?)
}

fn prompt_of(phase: Phase, said: &str, rest: GestureName) -> PromptScreen {
    let (gesture, share, recording, text) = match phase {
        Phase::Blocked { prompt } => (prompt.gesture, 0.0, false, "Waiting for a good signal".to_owned()),
        Phase::Preparing { prompt, left_secs } => {
            (prompt.gesture, 0.0, false, format!("Make it now: recording in {left_secs:.0} s"))
        }
        Phase::Recording { prompt, share } => (prompt.gesture, share, true, "Hold".to_owned()),
        Phase::Reviewing | Phase::Finished => (rest, 1.0, false, "Relax".to_owned()),
    };
    let text = if said.is_empty() { text } else { format!("{text}. {said}") };
    PromptScreen { gesture, text, share, recording, ..PromptScreen::default() }
}

/// Whether this request ends a training.
pub(super) fn is_next(request: &StudyRequest) -> bool {
    matches!(request, StudyRequest::Next {})
}
