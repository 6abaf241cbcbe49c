//! The screens of a study, from where it stands.

use super::state::{ActiveSession, CurrentStep, StudyState};
use jiff::Zoned;
use proact_bridge::{
    CurrentStepScreen, ExperimenterScreen, FormPair, FormScreen, NextSession, ParticipantRow,
    ParticipantScreen, SessionScreen, StepActivity, StepRow, StudyButton, StudyScreen,
};
use proact_study::{SessionItem, StepId, pair_key};

impl StudyState<'_> {
    pub(super) fn screen(&self) -> StudyScreen {
        let experimenter = ExperimenterScreen {
            study: self.conductor.study.plan.name.clone(),
            title: self.conductor.study.plan.title.clone(),
            trials: pair(self.conductor.progress().count(|step| matches!(step, SessionItem::Trial(_)))),
            participants: self.participants(),
            next: self.next_session(),
            session: self.active_session.as_ref().and_then(|under| self.session(under)),
            available_buttons: match (&self.active_session, &self.current_step) {
                (None, _) => vec![StudyButton::Begin],
                (Some(_), Some(now)) => now.buttons.clone(),
                (Some(_), None) => Vec::new(),
            },
            notice: self.message.clone(),
            notes: self.active_session.as_ref().map_or_else(Vec::new, |under| under.notes.clone()),
        };
        let participant = match (&self.active_session, &self.current_step) {
            (Some(_), Some(now)) => match self.form(&now.step_id) {
                Some(form) if matches!(now.content, StepActivity::Form(_)) => ParticipantScreen::Form(form),
                _ => now.participant.clone(),
            },
            _ if self.session_just_ended => ParticipantScreen::Thanks,
            _ => ParticipantScreen::Wait,
        };
        StudyScreen { experimenter, participant }
    }

    fn participants(&self) -> Vec<ParticipantRow> {
        let progress = self.conductor.progress();
        let line = |participant| {
            let (mut steps, mut trials) = ([0, 0], [0, 0]);
            for session in progress.schedule().sessions.iter().filter(|own| own.participant == participant) {
                for (step_id, item) in progress.step_ids(session).zip(&session.items) {
                    let over = usize::from(progress.step(&step_id).outcome.is_some());
                    let trial = usize::from(matches!(item, SessionItem::Trial(_)));
                    (steps[0], steps[1]) = (steps[0] + over, steps[1] + 1);
                    (trials[0], trials[1]) = (trials[0] + over * trial, trials[1] + trial);
                }
            }
            ParticipantRow {
                participant,
                id: progress.pseudonyms().get(&participant).cloned(),
                steps,
                trials,
            }
        };
        (1..=self.conductor.study.plan.participants).map(line).collect()
    }

    fn next_session(&self) -> Option<NextSession> {
        if self.active_session.is_some() {
            return None;
        }
        let progress = self.conductor.progress();
        let participant = progress.next_participant()?;
        let session = progress.next_session(participant)?;
        let today = Zoned::now().date();
        Some(NextSession {
            participant,
            id: progress.pseudonyms().get(&participant).cloned(),
            session: session.session.clone(),
            begun: progress.has_started(session),
            plan_deviation: self
                .conductor
                .schedule_deviation(participant, &session.session, today)
                .unwrap_or_default(),
        })
    }

    fn session(&self, under: &ActiveSession) -> Option<SessionScreen> {
        let progress = self.conductor.progress();
        let session = progress.session(under.participant, &under.session)?;
        let mut minutes_left = 0.0;
        let step = |(step_id, item): (StepId, &SessionItem)| {
            let state = progress.step(&step_id);
            if state.outcome.is_none() {
                minutes_left += self.minutes(item, &under.session);
            }
            StepRow {
                step: step_id.step,
                label: self.label(item),
                condition: item.condition().map(str::to_owned),
                outcome: state.outcome,
                attempts: state.attempts,
                deviations: state.deviations.into_iter().collect(),
            }
        };
        let steps = progress.step_ids(session).zip(&session.items).map(step).collect();
        Some(SessionScreen {
            participant: under.participant,
            id: self.conductor.label(under.participant),
            session: under.session.clone(),
            steps,
            current_step: self.current_step.as_ref().map(|now| self.current_step_screen(now)),
            remaining_minutes: minutes_left,
        })
    }

    /// A step in a few words, a questionnaire by its title.
    fn label(&self, item: &SessionItem) -> String {
        let form = item.form().and_then(|name| self.conductor.study.forms.get(name));
        let title = form.and_then(|form| form.title.get("en").or_else(|| form.title.values().next()));
        title.map_or_else(|| item.label(), |title| format!("questionnaire: {title}"))
    }

    /// What a step takes at most, by the plan.
    fn minutes(&self, item: &SessionItem, session: &str) -> f64 {
        let plan = &self.conductor.study.plan;
        match item {
            SessionItem::Step(planned) => planned.step.minutes(),
            SessionItem::Trial(trial) => {
                let between = plan.sessions.iter().find(|own| own.name == session);
                let between = between.map_or(0.0, |session| session.between_trials_minutes);
                plan.limit_secs(trial) / 60.0 + between
            }
        }
    }

    fn current_step_screen(&self, now: &CurrentStep) -> CurrentStepScreen {
        let what = match &now.content {
            StepActivity::Form(_) => {
                self.form(&now.step_id).map_or_else(|| now.content.clone(), StepActivity::Form)
            }
            what => what.clone(),
        };
        CurrentStepScreen {
            step: now.step_id.step,
            label: self
                .conductor
                .progress()
                .item(&now.step_id)
                .map_or_else(String::new, |item| self.label(item)),
            running: now.running,
            elapsed_secs: now.since.elapsed().as_secs_f64(),
            activity: what,
        }
    }

    /// The questionnaire at a spot, with its answers.
    pub(super) fn form(&self, step_id: &StepId) -> Option<FormScreen> {
        let progress = self.conductor.progress();
        let item = progress.item(step_id)?;
        let form = self.conductor.study.forms.get(item.form()?)?;
        let answers = progress.step(step_id).answers;
        let pairs = form.pairs().into_iter().map(|(first, second)| FormPair {
            key: pair_key(first, second),
            first: first.to_owned(),
            second: second.to_owned(),
        });
        Some(FormScreen {
            step: step_id.step,
            pairs: pairs.collect(),
            conditions: self.conductor.study.conditions(),
            about: item.condition().map(str::to_owned),
            missing: form.missing(&answers),
            answers,
            refused: self.rejected_answer.clone(),
            form: form.clone(),
        })
    }
}

fn pair((over, all): (usize, usize)) -> [usize; 2] {
    [over, all]
}
