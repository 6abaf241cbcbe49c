//! A study with people: each step of a session as it is due, conducted from the experimenter's page and the terminal alike.
//!
//! Every event and answer is on the disk before a page shows it. What is under way when the program ends is interrupted, and the
//! next run finds it so.

mod arm_activities;
mod readiness;
mod screen;
mod state;
mod steps;
mod training;

use super::conductor::{Conductor, StudyError};
use crate::{
    Calibrations, LiveArmband, Registry, UserDevices, emg_model_file::read_model, usage_log::UsageLog,
};
pub use arm_activities::initial_page_content;
use proact_bridge::{ClientInput, PageServer, StudyRequest, TrialStatus};
use proact_devices::{SampleSource, SourceName};
use proact_intent::GazeOffset;
use proact_study::{Deviation, StepOutcome, StudyEvent};
use proact_testbed::RunningTrial;
use readiness::DeviceLiveness;
pub use state::ScreenObserver;
use state::{ActiveSession, ConductRequest, StudyState};
use std::{
    error::Error,
    sync::{atomic::AtomicBool, mpsc::Receiver},
    time::{Duration, Instant},
};
use training::TrainingOutcome;

/// Opens what a person has connected, for the first session of a trial.
pub type OpenUserDevices<'a> = Box<dyn FnMut(&RunningTrial) -> Result<UserDevices, Box<dyn Error>> + 'a>;

/// What a participant wears and is tracked by.
pub struct StudyEquipment<'a> {
    /// Where muscles come from; keys of the page if left out.
    pub source: Option<SourceName>,
    /// The armband with its model, once there is one.
    pub armband: Option<LiveArmband>,
    /// Eye tracker, limb, feedback.
    pub user_devices: Option<UserDevices>,
    /// Where the person sits, as it was calibrated.
    pub calibrations: Calibrations,
    /// Opens them.
    pub open_user_devices: OpenUserDevices<'a>,
    /// The log of use; none that is kept.
    pub use_log: Option<UsageLog>,
}

/// A study with people.
pub struct LiveStudy<'a> {
    registry: &'a Registry,
    state: StudyState<'a>,
    equipment: StudyEquipment<'a>,
    gaze_offset: GazeOffset,
    training: Option<TrainingOutcome>,
    /// For whom the armband's model was trained here; none for a model that was given.
    armband_participant: Option<usize>,
    /// A source that nobody wears a model of.
    idle_source: Option<Box<dyn SampleSource>>,
    device_liveness: DeviceLiveness,
    /// How the last trial went, in words.
    last_trial_summary: String,
}

/// How a step came to its end.
#[derive(Clone, Debug, PartialEq)]
enum StepEnd {
    /// As it should.
    Done,
    /// It was ended by the experimenter.
    Aborted,
    /// It is left out, for this reason.
    Skipped(String),
    /// A trial before it is done again, for this reason.
    RedoPrevious(String),
    /// The session goes on another time.
    Postponed,
    /// The program ends.
    Interrupted,
}

impl<'a> LiveStudy<'a> {
    /// Takes `conductor` on from where it stands. `console` brings what is asked for at the terminal, which `on_screen` shows what
    /// pages are shown.
    pub fn new(
        registry: &'a Registry,
        conductor: Conductor,
        page: &'a PageServer,
        mut equipment: StudyEquipment<'a>,
        console: Option<Receiver<ClientInput>>,
        on_screen: ScreenObserver<'a>,
        interrupted: &'a AtomicBool,
    ) -> Self {
        let mut state = StudyState::new(conductor, page, console, on_screen, interrupted);
        state.use_log = equipment.use_log.take();
        Self {
            registry,
            state,
            equipment,
            gaze_offset: GazeOffset::default(),
            training: None,
            armband_participant: None,
            idle_source: None,
            device_liveness: DeviceLiveness::default(),
            last_trial_summary: String::new(),
        }
    }

    /// Says something to whoever conducts the study.
    pub fn set_message(&mut self, words: String) {
        self.state.message = words;
    }

    /// Conducts sessions until the study is finished, which it returns, or the program is asked to end.
    ///
    /// # Errors
    /// A journal or record that cannot be written, a device that fails. Nothing that was shown as done is lost.
    pub fn run(mut self) -> Result<bool, Box<dyn Error>> {
        let ended = self.run_sessions();
        // What is under way counts as interrupted; a journal that refused to be written is told of, not this.
        for step_id in self.state.conductor.progress().open() {
            if self.state.conductor.end(&step_id, StepOutcome::Interrupted).is_err() {
                break;
            }
        }
        self.state.active_session = None;
        self.state.show();
        ended?;
        Ok(self.state.conductor.progress().finished())
    }

    fn run_sessions(&mut self) -> Result<(), Box<dyn Error>> {
        // Pages learn what was asked of the gaze so far, before anything is.
        self.state.page.set_status(&TrialStatus::default());
        // What is connected is opened, and there is a scene to see, before anybody sits down.
        let first = self.state.conductor.study.schedule.trials().next().cloned();
        first.map_or(Ok(()), |trial| self.preview_trial(&trial))?;
        while !self.state.interrupted() {
            if self.state.active_session.is_none() {
                if self.state.conductor.progress().finished() {
                    return Ok(self.wait_after_last_session()?);
                }
                self.wait_for_session()?;
                continue;
            }
            match self.next_step() {
                Some(step_id) => self.step(&step_id)?,
                None => self.end_session()?,
            }
        }
        Ok(())
    }

    fn next_step(&self) -> Option<proact_study::StepId> {
        let under = self.state.active_session.as_ref()?;
        let progress = self.state.conductor.progress();
        progress.next_step(progress.session(under.participant, &under.session)?)
    }

    /// Waits until a session is to begin.
    fn wait_for_session(&mut self) -> Result<(), StudyError> {
        self.state.current_step = None;
        while self.state.active_session.is_none() && !self.state.interrupted() {
            for request in self.state.wait()? {
                if let ConductRequest::Experimenter(StudyRequest::Begin { id, new }) = request {
                    self.begin(id.as_deref().map(str::trim).filter(|id| !id.is_empty()), new)?;
                }
            }
        }
        Ok(())
    }

    fn begin(&mut self, id: Option<&str>, new: bool) -> Result<(), StudyError> {
        let planned = self.state.conductor.progress().next_participant();
        let participant = match self.state.conductor.select_participant(id, new) {
            Ok(participant) => participant,
            Err(error @ StudyError::Journal(_)) => return Err(error),
            Err(error) => {
                self.state.message = error.to_string();
                return Ok(());
            }
        };
        let session = self.state.conductor.begin_session(participant, false)?;
        self.state.message.clear();
        self.state.session_just_ended = false;
        self.state.active_session = Some(ActiveSession { participant, session, notes: Vec::new() });
        // Whoever sat here before has other muscles and other eyes.
        (self.training, self.state.gaze_check, self.gaze_offset) = (None, None, GazeOffset::default());
        self.last_trial_summary.clear();
        if self.armband_participant.is_some_and(|other| other != participant) {
            self.armband_participant = None;
            self.idle_source = self.equipment.armband.take().and_then(LiveArmband::into_source);
        }
        self.remember_training(participant);
        if let (Some(step_id), true) = (self.next_step(), planned != Some(participant)) {
            // By the place in the plan: a reason is exported, a pseudonym is not.
            let expected = planned.map_or_else(String::new, |planned| planned.to_string());
            let reason = format!("the plan has participant {expected} next");
            self.state.conductor.write(StudyEvent::Deviated {
                step_id,
                deviation: Deviation::OtherOrder,
                reason,
            })?;
        }
        Ok(())
    }

    /// What was trained in this session before the program ended is still good: the person has the same muscles.
    fn remember_training(&mut self, participant: usize) {
        let Some(session) = self.state.active_session.as_ref().map(|under| under.session.clone()) else {
            return;
        };
        let Ok(Some(last)) = self.state.conductor.last_training(participant, &session) else { return };
        let Some(at) = Instant::now().checked_sub(Duration::from_secs_f64(last.age_secs)) else { return };
        if let (Some(_), Some(model)) = (&self.equipment.source, &last.model) {
            let path = self.state.conductor.study.folder.join(model);
            let opened = self.source().and_then(|source| {
                let model = read_model(&path, source.info())?;
                Ok(LiveArmband::start(source, model))
            });
            match opened {
                Ok(armband) => {
                    (self.equipment.armband, self.armband_participant) = (Some(armband), Some(participant))
                }
                // It is trained again then: the check before a trial says so.
                Err(error) => {
                    self.state.message = format!("the last model cannot be used: {error}");
                    return;
                }
            }
        }
        let (accuracy, passed, model) = (last.accuracy, last.passed, last.model);
        self.training = Some(TrainingOutcome { at, accuracy, passed, model });
    }

    /// All steps are over: thanks, until the next session is asked for.
    fn end_session(&mut self) -> Result<(), StudyError> {
        let id =
            self.state.active_session.as_ref().map(|under| self.state.conductor.label(under.participant));
        self.state.message = format!("the session of {} is over", id.unwrap_or_default());
        self.state.active_session = None;
        self.state.current_step = None;
        self.state.session_just_ended = true;
        self.state.show();
        Ok(())
    }

    /// The study is finished. Whoever was last still reads the page, which stays until the program is asked to end; a study that was
    /// finished before has nobody there.
    fn wait_after_last_session(&mut self) -> Result<(), StudyError> {
        if self.state.session_just_ended {
            self.state.message =
                "the study is finished: end the program to have its tables written".to_owned();
        }
        while self.state.session_just_ended && !self.state.interrupted() {
            self.state.wait()?;
        }
        Ok(())
    }
}
