//! The steps of a session, one at a time.

use super::{
    LiveStudy, StepEnd,
    scenes::Scene,
    state::{Now, Wish, clean},
    training::{TrainingPlan, is_next},
};
use proact_bridge::{NowWhat, ParticipantScreen, PromptScreen, StudyButton, StudyRequest};
use proact_study::{
    Deviation, Happening, PlannedStep, PlannedTrial, ProtocolStep, Spot, StepOutcome, StudyEvent,
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
    pub(super) fn step(&mut self, spot: &Spot) -> Result<(), Box<dyn Error>> {
        let Some(happening) = self.state.conductor.progress().happening(spot).cloned() else { return Ok(()) };
        let condition = happening.condition().map(str::to_owned);
        let end = match &happening {
            Happening::Trial(trial) => self.trial(spot, trial)?,
            Happening::Step(PlannedStep { step, .. }) => {
                self.protocol_step(spot, step, condition.as_deref())?
            }
        };
        self.end(spot, end)
    }

    /// Writes down how a step ended.
    fn end(&mut self, spot: &Spot, end: StepEnd) -> Result<(), Box<dyn Error>> {
        let outcome = match &end {
            StepEnd::Done => StepOutcome::Done,
            StepEnd::Aborted => StepOutcome::Aborted,
            StepEnd::Skipped(reason) => {
                let deviation = Deviation::LeftOut;
                self.state.conductor.write(StudyEvent::Deviated {
                    spot: spot.clone(),
                    deviation,
                    reason: reason.clone(),
                })?;
                // What never began ends here too.
                self.state.conductor.begin(spot)?;
                StepOutcome::Skipped
            }
            StepEnd::Redone(_) | StepEnd::Left | StepEnd::Interrupted => StepOutcome::Interrupted,
        };
        if self.state.conductor.progress().step(spot).open {
            self.state.conductor.end(spot, outcome)?;
        }
        match end {
            StepEnd::Redone(reason) => {
                let again = self.state.under.as_ref().and_then(|under| {
                    let progress = self.state.conductor.progress();
                    progress.last_trial(progress.session(under.participant, &under.session)?)
                });
                if let Some(spot) = again {
                    self.state.conductor.write(StudyEvent::Repeated { spot, reason })?;
                }
            }
            StepEnd::Left => {
                self.state.told = "the session can be taken up again at any time".to_owned();
                self.state.under = None;
            }
            _ => {}
        }
        self.state.now = None;
        self.state.refused = None;
        Ok(())
    }

    /// What a wish means to a step that `next` may end. Those that need more are dealt with by the step.
    pub(super) fn step_end(&mut self, wish: &Wish, next: bool) -> Option<StepEnd> {
        let Wish::Ask(request) = wish else { return None };
        match request {
            request if is_next(request) => next.then_some(StepEnd::Done),
            StudyRequest::Skip { reason } => self.reasoned(reason).map(StepEnd::Skipped),
            StudyRequest::Redo { reason } => {
                let reason = self.reasoned(reason)?;
                if !self.may_redo() {
                    self.state.told = "there is no trial of this session to do again".to_owned();
                    return None;
                }
                Some(StepEnd::Redone(reason))
            }
            StudyRequest::Leave {} => Some(StepEnd::Left),
            _ => None,
        }
    }

    /// A reason, if one was given.
    fn reasoned(&mut self, reason: &str) -> Option<String> {
        let reason = clean(reason);
        if reason.is_empty() {
            self.state.told = "this departs from the plan: a reason is needed".to_owned();
            return None;
        }
        Some(reason)
    }

    /// Whether a trial of the session is over that can be done again.
    fn may_redo(&self) -> bool {
        let progress = self.state.conductor.progress();
        let session =
            self.state.under.as_ref().and_then(|under| progress.session(under.participant, &under.session));
        session.is_some_and(|session| progress.last_trial(session).is_some())
    }

    /// What can be asked for at a step, beside what is its own.
    fn buttons(&self, own: &[StudyButton]) -> Vec<StudyButton> {
        let mut can = own.to_vec();
        can.extend([StudyButton::Skip, StudyButton::Retrain, StudyButton::Recalibrate, StudyButton::Leave]);
        can.extend(self.may_redo().then_some(StudyButton::Redo));
        can.sort();
        can
    }

    fn now(
        &mut self,
        spot: &Spot,
        running: bool,
        what: NowWhat,
        participant: ParticipantScreen,
        own: &[StudyButton],
    ) {
        let can = self.buttons(own);
        let since = Instant::now();
        self.state.news = true;
        self.state.now = Some(Now { spot: spot.clone(), running, since, what, participant, can });
    }

    fn protocol_step(
        &mut self,
        spot: &Spot,
        step: &ProtocolStep,
        condition: Option<&str>,
    ) -> Result<StepEnd, Box<dyn Error>> {
        let next = &[StudyButton::Next];
        match step {
            ProtocolStep::Say { text, .. } => {
                let text = self.state.conductor.study.plan.texts.get(text).cloned().unwrap_or_default();
                self.state.conductor.begin(spot)?;
                self.now(spot, true, NowWhat::Say { text }, ParticipantScreen::Listen, next);
                self.until_next(spot, |_| {})
            }
            ProtocolStep::Rest { minutes } => {
                let planned = 60.0 * minutes;
                self.state.conductor.begin(spot)?;
                let rest = NowWhat::Rest { left_secs: planned };
                self.now(spot, true, rest, ParticipantScreen::Rest { left_secs: planned }, next);
                self.until_next(spot, move |now| {
                    let left_secs = (planned - now.since.elapsed().as_secs_f64()).max(0.0);
                    now.what = NowWhat::Rest { left_secs };
                    now.participant = ParticipantScreen::Rest { left_secs };
                })
            }
            ProtocolStep::Form { .. } => self.form_step(spot),
            ProtocolStep::Train { repetitions, hold_secs, pass_runs, .. } => {
                self.state.conductor.begin(spot)?;
                let prompt = PromptScreen::default();
                self.now(spot, true, NowWhat::Train(prompt.clone()), ParticipantScreen::Train(prompt), next);
                let plan =
                    TrainingPlan { repetitions: *repetitions, hold_secs: *hold_secs, pass_runs: *pass_runs };
                self.train(spot, plan)
            }
            ProtocolStep::CalibrateGaze { .. } => {
                self.state.conductor.begin(spot)?;
                self.scene_step(spot, Scene::Gaze, condition)
            }
            ProtocolStep::Demonstrate { .. } => self.scene_step(spot, Scene::Demonstration, condition),
            ProtocolStep::Practise { transfers, .. } => {
                self.scene_step(spot, Scene::Practice { transfers: *transfers }, condition)
            }
        }
    }

    /// Waits until the step is done, or departs from the plan.
    fn until_next(
        &mut self,
        spot: &Spot,
        mut refresh: impl FnMut(&mut Now),
    ) -> Result<StepEnd, Box<dyn Error>> {
        while !self.state.interrupted() {
            self.state.now.iter_mut().for_each(&mut refresh);
            for wish in self.state.wait()? {
                if let Some(end) = self.step_end(&wish, true) {
                    return Ok(end);
                }
                self.beside(spot, &wish)?;
            }
        }
        Ok(StepEnd::Interrupted)
    }

    /// Training or calibration once more, in the middle of a session.
    fn beside(&mut self, spot: &Spot, wish: &Wish) -> Result<(), Box<dyn Error>> {
        let (reason, deviation) = match wish {
            Wish::Ask(StudyRequest::Retrain { reason }) => (reason, Deviation::Retrained),
            Wish::Ask(StudyRequest::Recalibrate { reason }) => (reason, Deviation::Recalibrated),
            _ => return Ok(()),
        };
        let Some(reason) = self.reasoned(reason) else { return Ok(()) };
        self.state.conductor.write(StudyEvent::Deviated { spot: spot.clone(), deviation, reason })?;
        let before = self.state.now.clone();
        if let Some(now) = &mut self.state.now {
            (now.can, now.running, now.since) =
                (vec![StudyButton::Next, StudyButton::Leave], true, Instant::now());
        }
        if deviation == Deviation::Retrained {
            self.retrain(spot)?;
        } else {
            if let Some(now) = &mut self.state.now {
                now.what = NowWhat::CalibrateGaze { error_deg: None };
            }
            let condition = self
                .state
                .conductor
                .progress()
                .happening(spot)
                .and_then(|step| step.condition().map(str::to_owned));
            self.run_scene(spot, Scene::Gaze, condition.as_deref())?;
        }
        (self.state.now, self.state.news) = (before, true);
        Ok(())
    }

    fn form_step(&mut self, spot: &Spot) -> Result<StepEnd, Box<dyn Error>> {
        self.state.conductor.begin(spot)?;
        let Some(form) = self.state.form(spot) else { return Ok(StepEnd::Done) };
        let name = form.form.name.clone();
        let next = &[StudyButton::Next];
        self.now(spot, true, NowWhat::Form(form.clone()), ParticipantScreen::Form(form), next);
        while !self.state.interrupted() {
            for wish in self.state.wait()? {
                let submits = match &wish {
                    Wish::Submit(step) => *step == spot.step,
                    Wish::Ask(request) => is_next(request),
                    Wish::Gesture(_) => false,
                };
                if submits {
                    let answers = self.state.conductor.progress().step(spot).answers;
                    let form = &self.state.conductor.study.forms[&name];
                    let missing = form.missing(&answers);
                    if form.lacks_consent(&answers) {
                        self.state.told = "without consent the session cannot go on".to_owned();
                    } else if let (Wish::Submit(_), Some(first)) = (&wish, missing.first()) {
                        self.state.told =
                            format!("{} questions have no answer, the first is {first}", missing.len());
                    } else {
                        // Whoever conducts the study may go on with what there is; the tables say what is missing.
                        return Ok(StepEnd::Done);
                    }
                }
                match self.step_end(&wish, false) {
                    Some(StepEnd::Skipped(_))
                        if self.state.conductor.study.forms[&name].asks_for_consent() =>
                    {
                        self.state.told = "without consent the session cannot go on".to_owned();
                    }
                    Some(end) => return Ok(end),
                    None => self.beside(spot, &wish)?,
                }
            }
        }
        Ok(StepEnd::Interrupted)
    }

    /// A practice or a demonstration: it begins when it is asked for, unless it was begun already.
    fn scene_step(
        &mut self,
        spot: &Spot,
        scene: Scene,
        condition: Option<&str>,
    ) -> Result<StepEnd, Box<dyn Error>> {
        self.now(spot, false, scene.what(), ParticipantScreen::Wait, &[StudyButton::Next]);
        while !self.state.conductor.progress().step(spot).open {
            if self.state.interrupted() {
                return Ok(StepEnd::Interrupted);
            }
            for wish in self.state.wait()? {
                match self.step_end(&wish, true) {
                    Some(StepEnd::Done) => drop(self.state.conductor.begin(spot)?),
                    Some(end) => return Ok(end),
                    None => self.beside(spot, &wish)?,
                }
            }
        }
        self.run_scene(spot, scene, condition)
    }

    fn trial(&mut self, spot: &Spot, trial: &PlannedTrial) -> Result<StepEnd, Box<dyn Error>> {
        let number = self.number(spot);
        let before = self.before.clone();
        let what = |checks| NowWhat::Trial { checks, number, before: before.clone() };
        let checks = self.checks();
        self.now(spot, false, what(checks), ParticipantScreen::Wait, &[StudyButton::Next]);
        // The scene of this trial, with the blocks where they will stand, is built before it is asked for.
        self.prepare(trial)?;
        let mut checked: Option<Instant> = None;
        loop {
            if checked.is_none_or(|at| at.elapsed() > CHECK_PERIOD) {
                let checks = self.checks();
                let ready = checks.iter().all(|check| check.ready);
                let start = if ready { StudyButton::Next } else { StudyButton::StartAnyway };
                let can = self.buttons(&[start]);
                if let Some(now) = &mut self.state.now {
                    (now.what, now.can) = (what(checks), can);
                }
                checked = Some(Instant::now());
            }
            if self.state.interrupted() {
                return Ok(StepEnd::Interrupted);
            }
            for wish in self.state.wait()? {
                let anyway = match &wish {
                    Wish::Ask(StudyRequest::Next {}) => None,
                    Wish::Ask(StudyRequest::StartAnyway { reason }) => match self.reasoned(reason) {
                        Some(reason) => Some(reason),
                        None => continue,
                    },
                    _ => {
                        match self.step_end(&wish, false) {
                            Some(end) => return Ok(end),
                            None => self.beside(spot, &wish)?,
                        }
                        continue;
                    }
                };
                let checks = self.checks();
                let lacking: Vec<&str> =
                    checks.iter().filter(|check| !check.ready).map(|check| check.name.as_str()).collect();
                if self.equipment.source.is_some() && self.equipment.armband.is_none() {
                    self.state.told = "the gestures are not trained: a trial needs a model".to_owned();
                    continue;
                }
                if !lacking.is_empty() && anyway.is_none() {
                    self.state.told =
                        format!("not ready: {}; start anyway with a reason", lacking.join(", "));
                    continue;
                }
                if let Some(reason) = anyway.filter(|_| !lacking.is_empty()) {
                    let reason = format!("{reason} ({})", lacking.join(", "));
                    let deviation = Deviation::NotReady;
                    self.state.conductor.write(StudyEvent::Deviated {
                        spot: spot.clone(),
                        deviation,
                        reason,
                    })?;
                }
                self.state.conductor.write(StudyEvent::Checked { spot: spot.clone(), checks })?;
                return self.run_trial(spot, trial);
            }
        }
    }

    /// Number of a trial among those of its session, and how many there are.
    fn number(&self, spot: &Spot) -> [usize; 2] {
        let progress = self.state.conductor.progress();
        let Some(session) = progress.session(spot.participant, &spot.session) else { return [0, 0] };
        let trials =
            session.happenings.iter().enumerate().filter(|(_, step)| matches!(step, Happening::Trial(_)));
        let indices: Vec<usize> = trials.map(|(index, _)| index + 1).collect();
        [indices.iter().filter(|index| **index <= spot.step).count(), indices.len()]
    }

    /// The training that the session plans first, or the paper's.
    pub(super) fn planned_training(&self) -> TrainingPlan {
        let sessions = &self.state.conductor.progress().schedule().sessions;
        let steps = sessions.iter().flat_map(|session| &session.happenings);
        let planned = steps.filter_map(|happening| match happening {
            Happening::Step(PlannedStep {
                step: ProtocolStep::Train { repetitions, hold_secs, pass_runs, .. },
                ..
            }) => {
                Some(TrainingPlan { repetitions: *repetitions, hold_secs: *hold_secs, pass_runs: *pass_runs })
            }
            _ => None,
        });
        planned.into_iter().next().unwrap_or_default()
    }
}
