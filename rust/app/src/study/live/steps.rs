//! The steps of a session, one at a time.

use super::{
    LiveStudy, StepEnd,
    arm_activities::ArmActivity,
    state::{ConductRequest, CurrentStep, sanitize_text},
    training::{TrainingPlan, is_next},
};
use proact_bridge::{ParticipantScreen, PromptScreen, StepActivity, StudyButton, StudyRequest};
use proact_study::{
    Deviation, PlannedStep, PlannedTrial, ProtocolStep, SessionItem, StepId, StepOutcome, StudyEvent,
};
use std::{
    error::Error,
    time::{Duration, Instant},
};

/// How often it is looked what is ready.
const CHECK_PERIOD: Duration = Duration::from_millis(500);

impl LiveStudy<'_> {
    /// Does a step, from its beginning to its end or to where it is broken off.
    ///
    /// # Errors
    /// As [`LiveStudy::run`].
    pub(super) fn step(&mut self, step_id: &StepId) -> Result<(), Box<dyn Error>> {
        let Some(item) = self.state.conductor.progress().item(step_id).cloned() else { return Ok(()) };
        let condition = item.condition().map(str::to_owned);
        let end = match &item {
            SessionItem::Trial(trial) => self.trial(step_id, trial)?,
            SessionItem::Step(PlannedStep { step, .. }) => {
                self.protocol_step(step_id, step, condition.as_deref())?
            }
        };
        self.end(step_id, end)
    }

    /// Writes down how a step ended.
    fn end(&mut self, step_id: &StepId, end: StepEnd) -> Result<(), Box<dyn Error>> {
        let outcome = match &end {
            StepEnd::Done => StepOutcome::Done,
            StepEnd::Aborted => StepOutcome::Aborted,
            StepEnd::Skipped(reason) => {
                let deviation = Deviation::LeftOut;
                self.state.conductor.write(StudyEvent::Deviated {
                    step_id: step_id.clone(),
                    deviation,
                    reason: reason.clone(),
                })?;
                // What never began ends here too.
                self.state.conductor.begin(step_id)?;
                StepOutcome::Skipped
            }
            StepEnd::RedoPrevious(_) | StepEnd::Postponed | StepEnd::Interrupted => StepOutcome::Interrupted,
        };
        if self.state.conductor.progress().step(step_id).open {
            self.state.conductor.end(step_id, outcome)?;
        }
        match end {
            StepEnd::RedoPrevious(reason) => {
                let again = self.state.active_session.as_ref().and_then(|under| {
                    let progress = self.state.conductor.progress();
                    progress.last_trial(progress.session(under.participant, &under.session)?)
                });
                if let Some(step_id) = again {
                    self.state.conductor.write(StudyEvent::Repeated { step_id, reason })?;
                }
            }
            StepEnd::Postponed => {
                self.state.message = "the session can be taken up again at any time".to_owned();
                self.state.active_session = None;
            }
            _ => {}
        }
        self.state.current_step = None;
        self.state.rejected_answer = None;
        Ok(())
    }

    /// What a wish means to a step that `next` may end. Those that need more are dealt with by the step.
    pub(super) fn step_end(&mut self, conduct_request: &ConductRequest, next: bool) -> Option<StepEnd> {
        let ConductRequest::Experimenter(request) = conduct_request else { return None };
        match request {
            request if is_next(request) => next.then_some(StepEnd::Done),
            StudyRequest::Skip { reason } => self.require_reason(reason).map(StepEnd::Skipped),
            StudyRequest::Redo { reason } => {
                let reason = self.require_reason(reason)?;
                if !self.can_redo() {
                    self.state.message = "there is no trial of this session to do again".to_owned();
                    return None;
                }
                Some(StepEnd::RedoPrevious(reason))
            }
            StudyRequest::Leave {} => Some(StepEnd::Postponed),
            _ => None,
        }
    }

    /// A reason, if one was given.
    fn require_reason(&mut self, reason: &str) -> Option<String> {
        let reason = sanitize_text(reason);
        if reason.is_empty() {
            self.state.message = "this departs from the plan: a reason is needed".to_owned();
            return None;
        }
        Some(reason)
    }

    /// Whether a trial of the session is over that can be done again.
    fn can_redo(&self) -> bool {
        let progress = self.state.conductor.progress();
        let session = self
            .state
            .active_session
            .as_ref()
            .and_then(|under| progress.session(under.participant, &under.session));
        session.is_some_and(|session| progress.last_trial(session).is_some())
    }

    /// What can be asked for at a step, beside what is its own.
    fn buttons(&self, own: &[StudyButton]) -> Vec<StudyButton> {
        let mut can = own.to_vec();
        can.extend([StudyButton::Skip, StudyButton::Retrain, StudyButton::Recalibrate, StudyButton::Leave]);
        can.extend(self.can_redo().then_some(StudyButton::Redo));
        can.sort();
        can
    }

    fn set_current_step(
        &mut self,
        step_id: &StepId,
        running: bool,
        what: StepActivity,
        participant: ParticipantScreen,
        own: &[StudyButton],
    ) {
        let can = self.buttons(own);
        let since = Instant::now();
        self.state.needs_refresh = true;
        self.state.current_step = Some(CurrentStep {
            step_id: step_id.clone(),
            running,
            since,
            content: what,
            participant,
            buttons: can,
        });
    }

    fn protocol_step(
        &mut self,
        step_id: &StepId,
        step: &ProtocolStep,
        condition: Option<&str>,
    ) -> Result<StepEnd, Box<dyn Error>> {
        let next = &[StudyButton::Next];
        match step {
            ProtocolStep::Say { text, .. } => {
                let text = self.state.conductor.study.plan.texts.get(text).cloned().unwrap_or_default();
                self.state.conductor.begin(step_id)?;
                self.set_current_step(
                    step_id,
                    true,
                    StepActivity::Say { text },
                    ParticipantScreen::Listen,
                    next,
                );
                self.wait_for_next(step_id, |_| {})
            }
            ProtocolStep::Break { minutes } => {
                let planned = 60.0 * minutes;
                self.state.conductor.begin(step_id)?;
                let rest = StepActivity::Rest { remaining_secs: planned };
                self.set_current_step(
                    step_id,
                    true,
                    rest,
                    ParticipantScreen::Rest { remaining_secs: planned },
                    next,
                );
                self.wait_for_next(step_id, move |now| {
                    let left_secs = (planned - now.since.elapsed().as_secs_f64()).max(0.0);
                    now.content = StepActivity::Rest { remaining_secs: left_secs };
                    now.participant = ParticipantScreen::Rest { remaining_secs: left_secs };
                })
            }
            ProtocolStep::Form { .. } => self.form_step(step_id),
            ProtocolStep::Train { repetitions, hold_secs, consecutive_correct_runs: pass_runs, .. } => {
                self.state.conductor.begin(step_id)?;
                let prompt = PromptScreen::default();
                self.set_current_step(
                    step_id,
                    true,
                    StepActivity::Train(prompt.clone()),
                    ParticipantScreen::Train(prompt),
                    next,
                );
                let plan = TrainingPlan {
                    repetitions: *repetitions,
                    hold_secs: *hold_secs,
                    consecutive_correct_runs: *pass_runs,
                };
                self.train(step_id, plan)
            }
            ProtocolStep::CalibrateGaze { .. } => {
                self.state.conductor.begin(step_id)?;
                self.activity_step(step_id, ArmActivity::GazeCalibration, condition)
            }
            ProtocolStep::Demonstrate { .. } => {
                self.activity_step(step_id, ArmActivity::Demonstration, condition)
            }
            ProtocolStep::Practice { transfers, .. } => {
                self.activity_step(step_id, ArmActivity::Practice { transfers: *transfers }, condition)
            }
        }
    }

    /// Waits until the step is done, or departs from the plan.
    fn wait_for_next(
        &mut self,
        step_id: &StepId,
        mut refresh: impl FnMut(&mut CurrentStep),
    ) -> Result<StepEnd, Box<dyn Error>> {
        while !self.state.interrupted() {
            self.state.current_step.iter_mut().for_each(&mut refresh);
            for request in self.state.wait()? {
                if let Some(end) = self.step_end(&request, true) {
                    return Ok(end);
                }
                self.retrain_or_recalibrate(step_id, &request)?;
            }
        }
        Ok(StepEnd::Interrupted)
    }

    /// Training or calibration once more, in the middle of a session.
    fn retrain_or_recalibrate(
        &mut self,
        step_id: &StepId,
        request: &ConductRequest,
    ) -> Result<(), Box<dyn Error>> {
        let (reason, deviation) = match request {
            ConductRequest::Experimenter(StudyRequest::Retrain { reason }) => (reason, Deviation::Retrained),
            ConductRequest::Experimenter(StudyRequest::Recalibrate { reason }) => {
                (reason, Deviation::Recalibrated)
            }
            _ => return Ok(()),
        };
        let Some(reason) = self.require_reason(reason) else { return Ok(()) };
        self.state.conductor.write(StudyEvent::Deviated { step_id: step_id.clone(), deviation, reason })?;
        let before = self.state.current_step.clone();
        if let Some(now) = &mut self.state.current_step {
            (now.buttons, now.running, now.since) =
                (vec![StudyButton::Next, StudyButton::Leave], true, Instant::now());
        }
        if deviation == Deviation::Retrained {
            self.retrain(step_id)?;
        } else {
            if let Some(now) = &mut self.state.current_step {
                now.content = StepActivity::CalibrateGaze { error_deg: None };
            }
            let condition = self
                .state
                .conductor
                .progress()
                .item(step_id)
                .and_then(|step| step.condition().map(str::to_owned));
            self.run_activity(step_id, ArmActivity::GazeCalibration, condition.as_deref())?;
        }
        (self.state.current_step, self.state.needs_refresh) = (before, true);
        Ok(())
    }

    fn form_step(&mut self, step_id: &StepId) -> Result<StepEnd, Box<dyn Error>> {
        self.state.conductor.begin(step_id)?;
        let Some(form) = self.state.form(step_id) else { return Ok(StepEnd::Done) };
        let name = form.form.name.clone();
        let next = &[StudyButton::Next];
        self.set_current_step(
            step_id,
            true,
            StepActivity::Form(form.clone()),
            ParticipantScreen::Form(form),
            next,
        );
        while !self.state.interrupted() {
            for conduct_request in self.state.wait()? {
                let submits = match &conduct_request {
                    ConductRequest::SubmitForm(step) => *step == step_id.step,
                    ConductRequest::Experimenter(request) => is_next(request),
                    ConductRequest::Gesture(_) => false,
                };
                if submits {
                    let answers = self.state.conductor.progress().step(step_id).answers;
                    let form = &self.state.conductor.study.forms[&name];
                    let missing = form.missing(&answers);
                    if form.lacks_consent(&answers) {
                        self.state.message = "without consent the session cannot go on".to_owned();
                    } else if let (ConductRequest::SubmitForm(_), Some(first)) =
                        (&conduct_request, missing.first())
                    {
                        self.state.message =
                            format!("{} questions have no answer, the first is {first}", missing.len());
                    } else {
                        // Whoever conducts the study may go on with what there is; the tables say what is missing.
                        return Ok(StepEnd::Done);
                    }
                }
                match self.step_end(&conduct_request, false) {
                    Some(StepEnd::Skipped(_))
                        if self.state.conductor.study.forms[&name].asks_for_consent() =>
                    {
                        self.state.message = "without consent the session cannot go on".to_owned();
                    }
                    Some(end) => return Ok(end),
                    None => self.retrain_or_recalibrate(step_id, &conduct_request)?,
                }
            }
        }
        Ok(StepEnd::Interrupted)
    }

    /// A practice or a demonstration: it begins when it is asked for, unless it was begun already.
    fn activity_step(
        &mut self,
        step_id: &StepId,
        scene: ArmActivity,
        condition: Option<&str>,
    ) -> Result<StepEnd, Box<dyn Error>> {
        self.set_current_step(
            step_id,
            false,
            scene.screen_content(),
            ParticipantScreen::Wait,
            &[StudyButton::Next],
        );
        while !self.state.conductor.progress().step(step_id).open {
            if self.state.interrupted() {
                return Ok(StepEnd::Interrupted);
            }
            for request in self.state.wait()? {
                match self.step_end(&request, true) {
                    Some(StepEnd::Done) => drop(self.state.conductor.begin(step_id)?),
                    Some(end) => return Ok(end),
                    None => self.retrain_or_recalibrate(step_id, &request)?,
                }
            }
        }
        self.run_activity(step_id, scene, condition)
    }

    fn trial(&mut self, step_id: &StepId, trial: &PlannedTrial) -> Result<StepEnd, Box<dyn Error>> {
        let number = self.number(step_id);
        let before = self.last_trial_summary.clone();
        let what = |checks| StepActivity::Trial { checks, number, previous_result: before.clone() };
        let checks = self.checks();
        self.set_current_step(step_id, false, what(checks), ParticipantScreen::Wait, &[StudyButton::Next]);
        // The scene of this trial, with the blocks where they will stand, is built before it is asked for.
        self.preview_trial(trial)?;
        let mut checked: Option<Instant> = None;
        loop {
            if checked.is_none_or(|at| at.elapsed() > CHECK_PERIOD) {
                let checks = self.checks();
                let ready = checks.iter().all(|check| check.ready);
                let start = if ready { StudyButton::Next } else { StudyButton::StartAnyway };
                let can = self.buttons(&[start]);
                if let Some(now) = &mut self.state.current_step {
                    (now.content, now.buttons) = (what(checks), can);
                }
                checked = Some(Instant::now());
            }
            if self.state.interrupted() {
                return Ok(StepEnd::Interrupted);
            }
            for request in self.state.wait()? {
                let anyway = match &request {
                    ConductRequest::Experimenter(StudyRequest::Next {}) => None,
                    ConductRequest::Experimenter(StudyRequest::StartAnyway { reason }) => {
                        match self.require_reason(reason) {
                            Some(reason) => Some(reason),
                            None => continue,
                        }
                    }
                    _ => {
                        match self.step_end(&request, false) {
                            Some(end) => return Ok(end),
                            None => self.retrain_or_recalibrate(step_id, &request)?,
                        }
                        continue;
                    }
                };
                let checks = self.checks();
                let failed_checks: Vec<&str> =
                    checks.iter().filter(|check| !check.ready).map(|check| check.name.as_str()).collect();
                if self.equipment.source.is_some() && self.equipment.armband.is_none() {
                    self.state.message = "the gestures are not trained: a trial needs a model".to_owned();
                    continue;
                }
                if !failed_checks.is_empty() && anyway.is_none() {
                    self.state.message =
                        format!("not ready: {}; start anyway with a reason", failed_checks.join(", "));
                    continue;
                }
                if let Some(reason) = anyway.filter(|_| !failed_checks.is_empty()) {
                    let reason = format!("{reason} ({})", failed_checks.join(", "));
                    let deviation = Deviation::NotReady;
                    self.state.conductor.write(StudyEvent::Deviated {
                        step_id: step_id.clone(),
                        deviation,
                        reason,
                    })?;
                }
                self.state.conductor.write(StudyEvent::Checked { step_id: step_id.clone(), checks })?;
                return self.run_trial(step_id, trial);
            }
        }
    }

    /// Number of a trial among those of its session, and how many there are.
    fn number(&self, step_id: &StepId) -> [usize; 2] {
        let progress = self.state.conductor.progress();
        let Some(session) = progress.session(step_id.participant, &step_id.session) else { return [0, 0] };
        let trials =
            session.items.iter().enumerate().filter(|(_, step)| matches!(step, SessionItem::Trial(_)));
        let indices: Vec<usize> = trials.map(|(index, _)| index + 1).collect();
        [indices.iter().filter(|index| **index <= step_id.step).count(), indices.len()]
    }

    /// The training that the session plans first, or the paper's.
    pub(super) fn planned_training(&self) -> TrainingPlan {
        let sessions = &self.state.conductor.progress().schedule().sessions;
        let steps = sessions.iter().flat_map(|session| &session.items);
        let planned = steps.filter_map(|item| match item {
            SessionItem::Step(PlannedStep {
                step: ProtocolStep::Train { repetitions, hold_secs, consecutive_correct_runs: pass_runs, .. },
                ..
            }) => Some(TrainingPlan {
                repetitions: *repetitions,
                hold_secs: *hold_secs,
                consecutive_correct_runs: *pass_runs,
            }),
            _ => None,
        });
        planned.into_iter().next().unwrap_or_default()
    }
}
