//! What is under way in a study, who asks for what, and what its pages show of it.

use crate::{
    TrialInputs,
    study::conductor::{Conductor, StudyError},
    usage_log::UsageLog,
};
use proact_bridge::{
    AnswerInput, ClientInput, PageServer, ParticipantScreen, RefusedAnswer, StepActivity, StudyAction,
    StudyButton, StudyRequest, StudyScreen,
};
use proact_study::{StepId, StudyEvent};
use proact_testbed::TrialResult;
use proact_types::{Command, DisplayFrame, EventKind, Gesture};
use std::{
    sync::{
        atomic::{AtomicBool, Ordering},
        mpsc::Receiver,
    },
    time::{Duration, Instant},
};

/// How often requests are looked at outside trials.
const POLL_PERIOD: Duration = Duration::from_millis(20);
/// Screens go out at least so often: times go on. While a prompt moves, more often.
const SCREEN_PERIOD: Duration = Duration::from_millis(500);
const PROMPT_PERIOD: Duration = Duration::from_millis(50);
/// Longest note or reason, characters.
const MAX_NOTE_CHARS: usize = 2000;

/// Sees each screen, and the number of the last event on the disk.
pub type ScreenObserver<'a> = Box<dyn FnMut(&StudyScreen, i64) + 'a>;

/// Whose session is under way.
#[derive(Clone, Debug)]
pub(super) struct ActiveSession {
    pub(super) participant: usize,
    pub(super) session: String,
    pub(super) notes: Vec<String>,
}

/// The step that is to be done, or is being done.
#[derive(Clone, Debug)]
pub(super) struct CurrentStep {
    pub(super) step_id: StepId,
    pub(super) running: bool,
    pub(super) since: Instant,
    pub(super) content: StepActivity,
    pub(super) participant: ParticipantScreen,
    pub(super) buttons: Vec<StudyButton>,
}

/// What a step has to decide about.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum ConductRequest {
    /// Something that whoever conducts the study asks for.
    Experimenter(StudyRequest),
    /// The questionnaire is filled in.
    SubmitForm(usize),
    /// Keys make this gesture from now on.
    Gesture(Command),
}

pub(super) struct StudyState<'a> {
    pub(super) conductor: Conductor,
    pub(super) page: &'a PageServer,
    pub(super) console: Option<Receiver<ClientInput>>,
    pub(super) screen_observer: ScreenObserver<'a>,
    pub(super) interrupted: &'a AtomicBool,
    pub(super) active_session: Option<ActiveSession>,
    pub(super) current_step: Option<CurrentStep>,
    pub(super) message: String,
    pub(super) rejected_answer: Option<RefusedAnswer>,
    /// The journal cannot be written to any more.
    pub(super) journal_error: Option<StudyError>,
    pub(super) gaze_check: Option<GazeCheckResult>,
    /// Objects that were let go in the trial or practice under way.
    pub(super) transferred_count: usize,
    last_shown_at: Instant,
    /// A session has just ended, and its participant may still sit there.
    pub(super) session_just_ended: bool,
    /// There is news to show.
    pub(super) needs_refresh: bool,
    /// The log of use; none that is kept.
    pub(super) use_log: Option<UsageLog>,
}

/// How well the gaze follows, and when that was measured.
#[derive(Clone, Copy, Debug)]
pub(super) struct GazeCheckResult {
    pub(super) at: Instant,
    pub(super) error_deg: Option<f64>,
    pub(super) calibrated: bool,
}

impl<'a> StudyState<'a> {
    pub(super) fn new(
        conductor: Conductor,
        page: &'a PageServer,
        console: Option<Receiver<ClientInput>>,
        on_screen: ScreenObserver<'a>,
        interrupted: &'a AtomicBool,
    ) -> Self {
        Self {
            conductor,
            page,
            console,
            screen_observer: on_screen,
            interrupted,
            active_session: None,
            current_step: None,
            message: String::new(),
            rejected_answer: None,
            journal_error: None,
            gaze_check: None,
            transferred_count: 0,
            last_shown_at: Instant::now(),
            session_just_ended: false,
            needs_refresh: true,
            use_log: None,
        }
    }

    pub(super) fn interrupted(&self) -> bool {
        self.interrupted.load(Ordering::Relaxed)
    }

    /// Writes an event; a journal that cannot be written to ends the run.
    pub(super) fn write(&mut self, event: StudyEvent) {
        let written = self.conductor.write(event).map(drop);
        self.handle_write_result(written);
    }

    /// What came of something that wrote to the journal; false if it was refused.
    pub(super) fn handle_write_result(&mut self, written: Result<(), StudyError>) -> bool {
        match written {
            Ok(()) => true,
            Err(StudyError::Journal(error)) => {
                self.message = error.to_string();
                self.journal_error = Some(error.into());
                false
            }
            Err(error) => {
                self.message = error.to_string();
                false
            }
        }
    }

    /// Everything that came in since the last call: notes and answers are dealt with, what is not for a trial is left out.
    fn drain_requests(&mut self) -> (Vec<ClientInput>, Vec<ConductRequest>) {
        if let Some(log) = &mut self.use_log {
            log.update_connection(Instant::now(), self.page.client_count() > 0);
        }
        let mut came = self.page.drain_inputs();
        came.extend(self.console.iter().flat_map(Receiver::try_iter));
        let (mut inputs, mut requests) = (Vec::new(), Vec::new());
        let is_request = |input: &ClientInput| {
            matches!(input, ClientInput::Conduct(_) | ClientInput::Answer(_) | ClientInput::Submit { .. })
        };
        self.needs_refresh |= came.iter().any(is_request);
        for input in came {
            match input {
                ClientInput::Conduct(StudyRequest::Note { text }) => self.note(&text),
                ClientInput::Conduct(request) => {
                    // What came of the request before is old news.
                    self.message.clear();
                    requests.push(ConductRequest::Experimenter(request));
                }
                ClientInput::Answer(given) => self.answer(given),
                ClientInput::Submit { step } => {
                    self.message.clear();
                    requests.push(ConductRequest::SubmitForm(step));
                }
                // The plan says which trial is next.
                ClientInput::Restart { .. } | ClientInput::After(_) => {}
                input => {
                    if let ClientInput::Gesture(command) = input {
                        requests.push(ConductRequest::Gesture(command));
                    }
                    inputs.push(input);
                }
            }
        }
        (inputs, requests)
    }

    fn note(&mut self, text: &str) {
        let text = sanitize_text(text);
        if text.is_empty() {
            return;
        }
        let step_id = self.current_step.as_ref().map(|now| now.step_id.clone());
        let event = StudyEvent::Noted { step_id, text: text.clone() };
        let written = self.conductor.write(event).map(drop);
        if self.handle_write_result(written) {
            self.message = "the note is kept".to_owned();
            self.active_session.iter_mut().for_each(|under| under.notes.push(text.clone()));
        }
    }

    fn answer(&mut self, AnswerInput { step, key, answer }: AnswerInput) {
        let Some(step_id) =
            self.current_step.as_ref().map(|now| now.step_id.clone()).filter(|step_id| step_id.step == step)
        else {
            self.message = format!("an answer to step {step} came too late and is not kept");
            return;
        };
        match self.conductor.answer(&step_id, &key, answer) {
            Ok(_) => self.rejected_answer = None,
            Err(error @ StudyError::Journal(_)) => drop(self.handle_write_result(Err(error))),
            Err(error) => self.rejected_answer = Some(RefusedAnswer { key, reason: error.to_string() }),
        }
    }

    /// Waits a moment; what was asked for meanwhile. Shows where the study is.
    ///
    /// # Errors
    /// The journal cannot be written to.
    pub(super) fn wait(&mut self) -> Result<Vec<ConductRequest>, StudyError> {
        let (_, requests) = self.drain_requests();
        match self.journal_error.take() {
            Some(error) => Err(error),
            None => {
                let prompts =
                    matches!(self.current_step, Some(CurrentStep { content: StepActivity::Train(_), .. }));
                let period = if prompts { PROMPT_PERIOD } else { SCREEN_PERIOD };
                if self.needs_refresh || self.last_shown_at.elapsed() >= period {
                    self.show();
                    // What these wishes lead to is news once more.
                    self.needs_refresh = !requests.is_empty();
                }
                std::thread::sleep(POLL_PERIOD);
                Ok(requests)
            }
        }
    }

    /// Shows where the study is. The server keeps to itself what is no news.
    pub(super) fn show(&mut self) {
        (self.last_shown_at, self.needs_refresh) = (Instant::now(), false);
        let screen = self.screen();
        self.page.publish_study(&screen);
        (self.screen_observer)(&screen, self.conductor.last_id());
    }
}

/// A note or a reason as it is kept: without control characters, of bounded length.
pub(super) fn sanitize_text(text: &str) -> String {
    let plain = |c: char| if c.is_control() { ' ' } else { c };
    text.trim().chars().map(plain).take(MAX_NOTE_CHARS).collect()
}

/// What comes in while a trial, a practice or a demonstration goes on.
pub(super) struct StudyTrialInputs<'s, 'a> {
    pub(super) state: &'s mut StudyState<'a>,
    /// "Next" ends it.
    pub(super) ends_on_next: bool,
    /// The participant's page is asked to calibrate the gaze as soon as the scene is there.
    pub(super) requests_gaze_calibration: bool,
    /// What is still wanted when it is over.
    pub(super) pending_request: Option<StudyRequest>,
    /// The gesture of a relaxed hand where the participant drives, for the log of use; none where a simulated one shows how.
    pub(super) rest_gesture: Option<Gesture>,
}

impl StudyTrialInputs<'_, '_> {
    fn handle_request(&mut self, conduct_request: ConductRequest, inputs: &mut Vec<ClientInput>) {
        match conduct_request {
            ConductRequest::Experimenter(StudyRequest::Next {}) if self.ends_on_next => {
                inputs.push(ClientInput::Study(StudyAction::Abort))
            }
            ConductRequest::Experimenter(request @ (StudyRequest::Skip { .. } | StudyRequest::Leave {}))
                if self.ends_on_next =>
            {
                self.pending_request = Some(request);
                inputs.push(ClientInput::Study(StudyAction::Abort));
            }
            ConductRequest::Experimenter(StudyRequest::Next {}) => {}
            ConductRequest::Experimenter(_) => {
                self.state.message = "the trial goes on: end it first".to_owned()
            }
            ConductRequest::SubmitForm(_) | ConductRequest::Gesture(_) => {}
        }
    }
}

impl TrialInputs for StudyTrialInputs<'_, '_> {
    fn drain(&mut self) -> Vec<ClientInput> {
        let (mut inputs, requests) = self.state.drain_requests();
        requests.into_iter().for_each(|conduct_request| self.handle_request(conduct_request, &mut inputs));
        if std::mem::take(&mut self.requests_gaze_calibration) {
            inputs.push(ClientInput::Study(StudyAction::CalibrateGaze));
        }
        let step_id = self.state.current_step.as_ref().map(|now| now.step_id.clone());
        for input in &inputs {
            match (input, &step_id) {
                (ClientInput::Study(StudyAction::Pause), Some(step_id)) => self.state.pause(step_id, true),
                (ClientInput::Study(StudyAction::Resume), Some(step_id)) => self.state.pause(step_id, false),
                // The participant reads a dialog: time stands still as in a pause, and is told like one.
                (ClientInput::Hold(on), Some(step_id)) => self.state.pause(step_id, *on),
                (ClientInput::GazeCheck(check), Some(step_id)) => {
                    let errors: Vec<f64> =
                        check.points.iter().filter_map(|point| point.accuracy_deg).collect();
                    let error_deg =
                        (!errors.is_empty()).then(|| errors.iter().sum::<f64>() / errors.len() as f64);
                    let calibrated = check.correction_deg.is_some();
                    self.state.gaze_check =
                        Some(GazeCheckResult { at: Instant::now(), error_deg, calibrated });
                    self.state.write(StudyEvent::GazeChecked {
                        step_id: step_id.clone(),
                        error_deg,
                        calibrated,
                    });
                }
                _ => {}
            }
        }
        // What was acknowledged is on the disk; what cannot be any more ends the trial.
        if self.state.journal_error.is_some() {
            inputs.push(ClientInput::Study(StudyAction::Abort));
        }
        if self.state.needs_refresh || self.state.last_shown_at.elapsed() > SCREEN_PERIOD {
            self.state.publish_activity_screen();
        }
        inputs
    }

    fn frame_shown(&mut self, frame: &DisplayFrame) {
        let released = |event: &&proact_types::Event| matches!(event.kind, EventKind::ObjectReleased { .. });
        self.state.transferred_count += frame.events.iter().filter(released).count();
        if let (Some(log), Some(rest)) = (&mut self.state.use_log, self.rest_gesture) {
            log.record_frame(frame, rest);
        }
    }

    fn trial_ended(&mut self, result: &TrialResult) {
        // What "Next" ends is a practice or a calibration, and no trial.
        if let (Some(log), false) = (&mut self.state.use_log, self.ends_on_next) {
            log.end_trial(result.score);
        }
    }
}

impl StudyState<'_> {
    fn pause(&mut self, step_id: &StepId, on: bool) {
        self.write(StudyEvent::Paused { step_id: step_id.clone(), paused: on });
    }

    fn publish_activity_screen(&mut self) {
        let (gaze, carried) = (self.gaze_check, self.transferred_count);
        if let Some(now) = &mut self.current_step {
            match &mut now.content {
                StepActivity::Practice { transferred: shown, .. } => *shown = carried,
                StepActivity::CalibrateGaze { error_deg } => {
                    *error_deg = gaze.filter(|gaze| gaze.at >= now.since).and_then(|gaze| gaze.error_deg);
                }
                _ => {}
            }
        }
        self.show();
    }
}
