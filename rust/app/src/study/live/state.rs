//! What is under way in a study, who asks for what, and what its pages show of it.

use crate::{
    TrialInputs,
    study::conductor::{Conductor, StudyError},
    use_log::UseLog,
};
use proact_bridge::{
    ClientInput, GivenAnswer, NowWhat, PageServer, ParticipantScreen, RefusedAnswer, StudyAction,
    StudyButton, StudyRequest, StudyScreen,
};
use proact_study::{Spot, StudyEvent};
use proact_testbed::TrialResult;
use proact_types::{DisplayFrame, EventKind, Gesture, GestureName};
use std::{
    sync::{
        atomic::{AtomicBool, Ordering},
        mpsc::Receiver,
    },
    time::{Duration, Instant},
};

/// How often requests are looked at outside trials.
const LOOK: Duration = Duration::from_millis(20);
/// Screens go out at least so often: times go on. While a prompt moves, more often.
const SCREEN_PERIOD: Duration = Duration::from_millis(500);
const PROMPT_PERIOD: Duration = Duration::from_millis(50);
/// Longest note or reason, characters.
const MOST_WORDS: usize = 2000;

/// Sees each screen, and the number of the last event on the disk.
pub type OnScreen<'a> = Box<dyn FnMut(&StudyScreen, i64) + 'a>;

/// Whose session is under way.
#[derive(Clone, Debug)]
pub(super) struct UnderWay {
    pub(super) participant: usize,
    pub(super) session: String,
    pub(super) notes: Vec<String>,
}

/// The step that is to be done, or is being done.
#[derive(Clone, Debug)]
pub(super) struct Now {
    pub(super) spot: Spot,
    pub(super) running: bool,
    pub(super) since: Instant,
    pub(super) what: NowWhat,
    pub(super) participant: ParticipantScreen,
    pub(super) can: Vec<StudyButton>,
}

/// What a step has to decide about.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Wish {
    /// Something that whoever conducts the study asks for.
    Ask(StudyRequest),
    /// The questionnaire is filled in.
    Submit(usize),
    /// Keys make this gesture from now on.
    Gesture(Gesture),
}

pub(super) struct StudyState<'a> {
    pub(super) conductor: Conductor,
    pub(super) page: &'a PageServer,
    pub(super) console: Option<Receiver<ClientInput>>,
    pub(super) on_screen: OnScreen<'a>,
    pub(super) interrupted: &'a AtomicBool,
    pub(super) under: Option<UnderWay>,
    pub(super) now: Option<Now>,
    pub(super) told: String,
    pub(super) refused: Option<RefusedAnswer>,
    /// The journal cannot be written to any more.
    pub(super) failed: Option<StudyError>,
    pub(super) gaze: Option<GazeMeasured>,
    /// Objects that were let go in the trial or practice under way.
    pub(super) carried: usize,
    shown: Instant,
    /// A session has just ended, and its participant may still sit there.
    pub(super) thanks: bool,
    /// There is news to show.
    pub(super) news: bool,
    /// The log of use; none that is kept.
    pub(super) use_log: Option<UseLog>,
}

/// How well the gaze follows, and when that was measured.
#[derive(Clone, Copy, Debug)]
pub(super) struct GazeMeasured {
    pub(super) at: Instant,
    pub(super) error_deg: Option<f64>,
    pub(super) calibrated: bool,
}

impl<'a> StudyState<'a> {
    pub(super) fn new(
        conductor: Conductor,
        page: &'a PageServer,
        console: Option<Receiver<ClientInput>>,
        on_screen: OnScreen<'a>,
        interrupted: &'a AtomicBool,
    ) -> Self {
        Self {
            conductor,
            page,
            console,
            on_screen,
            interrupted,
            under: None,
            now: None,
            told: String::new(),
            refused: None,
            failed: None,
            gaze: None,
            carried: 0,
            shown: Instant::now(),
            thanks: false,
            news: true,
            use_log: None,
        }
    }

    pub(super) fn interrupted(&self) -> bool {
        self.interrupted.load(Ordering::Relaxed)
    }

    /// Writes an event; a journal that cannot be written to ends the run.
    pub(super) fn write(&mut self, event: StudyEvent) {
        let written = self.conductor.write(event).map(drop);
        self.keep(written);
    }

    /// What came of something that wrote to the journal; false if it was refused.
    pub(super) fn keep(&mut self, written: Result<(), StudyError>) -> bool {
        match written {
            Ok(()) => true,
            Err(StudyError::Journal(error)) => {
                self.told = error.to_string();
                self.failed = Some(error.into());
                false
            }
            Err(error) => {
                self.told = error.to_string();
                false
            }
        }
    }

    /// Everything that came in since the last call: notes and answers are dealt with, what is not for a trial is left out.
    fn take(&mut self) -> (Vec<ClientInput>, Vec<Wish>) {
        if let Some(log) = &mut self.use_log {
            log.look(Instant::now(), self.page.client_count() > 0);
        }
        let mut came = self.page.drain_inputs();
        came.extend(self.console.iter().flat_map(Receiver::try_iter));
        let (mut inputs, mut wishes) = (Vec::new(), Vec::new());
        let asks = |input: &ClientInput| {
            matches!(input, ClientInput::Conduct(_) | ClientInput::Answer(_) | ClientInput::Submit { .. })
        };
        self.news |= came.iter().any(asks);
        for input in came {
            match input {
                ClientInput::Conduct(StudyRequest::Note { text }) => self.note(&text),
                ClientInput::Conduct(request) => {
                    // What came of the request before is old news.
                    self.told.clear();
                    wishes.push(Wish::Ask(request));
                }
                ClientInput::Answer(given) => self.answer(given),
                ClientInput::Submit { step } => {
                    self.told.clear();
                    wishes.push(Wish::Submit(step));
                }
                // The plan says which trial is next.
                ClientInput::Restart { .. } | ClientInput::After(_) => {}
                input => {
                    if let ClientInput::Gesture(gesture) = input {
                        wishes.push(Wish::Gesture(gesture));
                    }
                    inputs.push(input);
                }
            }
        }
        (inputs, wishes)
    }

    fn note(&mut self, text: &str) {
        let text = clean(text);
        if text.is_empty() {
            return;
        }
        let spot = self.now.as_ref().map(|now| now.spot.clone());
        let event = StudyEvent::Noted { spot, text: text.clone() };
        let written = self.conductor.write(event).map(drop);
        if self.keep(written) {
            self.told = "the note is kept".to_owned();
            self.under.iter_mut().for_each(|under| under.notes.push(text.clone()));
        }
    }

    fn answer(&mut self, GivenAnswer { step, key, answer }: GivenAnswer) {
        let Some(spot) = self.now.as_ref().map(|now| now.spot.clone()).filter(|spot| spot.step == step)
        else {
            self.told = format!("an answer to step {step} came too late and is not kept");
            return;
        };
        match self.conductor.answer(&spot, &key, answer) {
            Ok(_) => self.refused = None,
            Err(error @ StudyError::Journal(_)) => drop(self.keep(Err(error))),
            Err(error) => self.refused = Some(RefusedAnswer { key, reason: error.to_string() }),
        }
    }

    /// Waits a moment; what was asked for meanwhile. Shows where the study is.
    ///
    /// # Errors
    /// The journal cannot be written to.
    pub(super) fn wait(&mut self) -> Result<Vec<Wish>, StudyError> {
        let (_, wishes) = self.take();
        match self.failed.take() {
            Some(error) => Err(error),
            None => {
                let prompts = matches!(self.now, Some(Now { what: NowWhat::Train(_), .. }));
                let period = if prompts { PROMPT_PERIOD } else { SCREEN_PERIOD };
                if self.news || self.shown.elapsed() >= period {
                    self.show();
                    // What these wishes lead to is news once more.
                    self.news = !wishes.is_empty();
                }
                std::thread::sleep(LOOK);
                Ok(wishes)
            }
        }
    }

    /// Shows where the study is. The server keeps to itself what is no news.
    pub(super) fn show(&mut self) {
        (self.shown, self.news) = (Instant::now(), false);
        let screen = self.screen();
        self.page.publish_study(&screen);
        (self.on_screen)(&screen, self.conductor.last_id());
    }
}

/// A note or a reason as it is kept: without control characters, of bounded length.
pub(super) fn clean(text: &str) -> String {
    let plain = |c: char| if c.is_control() { ' ' } else { c };
    text.trim().chars().map(plain).take(MOST_WORDS).collect()
}

/// What comes in while a trial, a practice or a demonstration goes on.
pub(super) struct SceneInputs<'s, 'a> {
    pub(super) state: &'s mut StudyState<'a>,
    /// "Next" ends it.
    pub(super) next_ends: bool,
    /// The participant's page is asked to calibrate the gaze as soon as the scene is there.
    pub(super) calibrates: bool,
    /// What is still wanted when it is over.
    pub(super) left: Option<StudyRequest>,
    /// The gesture of a relaxed hand where the participant drives, for the log of use; none where a simulated one shows how.
    pub(super) rest: Option<GestureName>,
}

impl SceneInputs<'_, '_> {
    fn wish(&mut self, wish: Wish, inputs: &mut Vec<ClientInput>) {
        match wish {
            Wish::Ask(StudyRequest::Next {}) if self.next_ends => {
                inputs.push(ClientInput::Study(StudyAction::Abort))
            }
            Wish::Ask(request @ (StudyRequest::Skip { .. } | StudyRequest::Leave {})) if self.next_ends => {
                self.left = Some(request);
                inputs.push(ClientInput::Study(StudyAction::Abort));
            }
            Wish::Ask(StudyRequest::Next {}) => {}
            Wish::Ask(_) => self.state.told = "the trial goes on: end it first".to_owned(),
            Wish::Submit(_) | Wish::Gesture(_) => {}
        }
    }
}

impl TrialInputs for SceneInputs<'_, '_> {
    fn drain(&mut self) -> Vec<ClientInput> {
        let (mut inputs, wishes) = self.state.take();
        wishes.into_iter().for_each(|wish| self.wish(wish, &mut inputs));
        if std::mem::take(&mut self.calibrates) {
            inputs.push(ClientInput::Study(StudyAction::CalibrateGaze));
        }
        let spot = self.state.now.as_ref().map(|now| now.spot.clone());
        for input in &inputs {
            match (input, &spot) {
                (ClientInput::Study(StudyAction::Pause), Some(spot)) => self.state.pause(spot, true),
                (ClientInput::Study(StudyAction::Resume), Some(spot)) => self.state.pause(spot, false),
                // The participant reads a dialog: time stands still as in a pause, and is told like one.
                (ClientInput::Hold(on), Some(spot)) => self.state.pause(spot, *on),
                (ClientInput::GazeCheck(check), Some(spot)) => {
                    let errors: Vec<f64> =
                        check.points.iter().filter_map(|point| point.accuracy_deg).collect();
                    let error_deg =
                        (!errors.is_empty()).then(|| errors.iter().sum::<f64>() / errors.len() as f64);
                    let calibrated = check.correction_deg.is_some();
                    self.state.gaze = Some(GazeMeasured { at: Instant::now(), error_deg, calibrated });
                    self.state.write(StudyEvent::GazeChecked { spot: spot.clone(), error_deg, calibrated });
                }
                _ => {}
            }
        }
        // What was acknowledged is on the disk; what cannot be any more ends the trial.
        if self.state.failed.is_some() {
            inputs.push(ClientInput::Study(StudyAction::Abort));
        }
        if self.state.news || self.state.shown.elapsed() > SCREEN_PERIOD {
            self.state.show_scene();
        }
        inputs
    }

    fn shown(&mut self, frame: &DisplayFrame) {
        let released = |event: &&proact_types::Event| matches!(event.kind, EventKind::ObjectReleased { .. });
        self.state.carried += frame.events.iter().filter(released).count();
        if let (Some(log), Some(rest)) = (&mut self.state.use_log, self.rest) {
            log.see(frame, rest);
        }
    }

    fn ended(&mut self, result: &TrialResult) {
        // What "Next" ends is a practice or a calibration, and no trial.
        if let (Some(log), false) = (&mut self.state.use_log, self.next_ends) {
            log.end_trial(result.score);
        }
    }
}

impl StudyState<'_> {
    fn pause(&mut self, spot: &Spot, on: bool) {
        self.write(StudyEvent::Paused { spot: spot.clone(), on });
    }

    fn show_scene(&mut self) {
        let (gaze, carried) = (self.gaze, self.carried);
        if let Some(now) = &mut self.now {
            match &mut now.what {
                NowWhat::Practise { carried: shown, .. } => *shown = carried,
                NowWhat::CalibrateGaze { error_deg } => {
                    *error_deg = gaze.filter(|gaze| gaze.at >= now.since).and_then(|gaze| gaze.error_deg);
                }
                _ => {}
            }
        }
        self.show();
    }
}
