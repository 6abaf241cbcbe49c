//! The screens of a study, from where it stands.

use super::state::{Now, StudyState, UnderWay};
use jiff::Zoned;
use proact_bridge::{
    ExperimenterScreen, FormPair, FormScreen, NextSession, NowScreen, NowWhat, ParticipantLine,
    ParticipantScreen, SessionScreen, StepLine, StudyButton, StudyScreen,
};
use proact_study::{Happening, Spot, pair_key};

impl StudyState<'_> {
    pub(super) fn screen(&self) -> StudyScreen {
        let experimenter = ExperimenterScreen {
            study: self.conductor.study.plan.name.clone(),
            title: self.conductor.study.plan.title.clone(),
            trials: pair(self.conductor.progress().count(|step| matches!(step, Happening::Trial(_)))),
            participants: self.participants(),
            next: self.next_session(),
            session: self.under.as_ref().and_then(|under| self.session(under)),
            can: match (&self.under, &self.now) {
                (None, _) => vec![StudyButton::Begin],
                (Some(_), Some(now)) => now.can.clone(),
                (Some(_), None) => Vec::new(),
            },
            told: self.told.clone(),
            notes: self.under.as_ref().map_or_else(Vec::new, |under| under.notes.clone()),
        };
        let participant = match (&self.under, &self.now) {
            (Some(_), Some(now)) => match self.form(&now.spot) {
                Some(form) if matches!(now.what, NowWhat::Form(_)) => ParticipantScreen::Form(form),
                _ => now.participant.clone(),
            },
            _ if self.thanks => ParticipantScreen::Thanks,
            _ => ParticipantScreen::Wait,
        };
        StudyScreen { experimenter, participant }
    }

    fn participants(&self) -> Vec<ParticipantLine> {
        let progress = self.conductor.progress();
        let line = |participant| {
            let (mut steps, mut trials) = ([0, 0], [0, 0]);
            for session in progress.schedule().sessions.iter().filter(|own| own.participant == participant) {
                for (spot, happening) in progress.spots(session).zip(&session.happenings) {
                    let over = usize::from(progress.step(&spot).outcome.is_some());
                    let trial = usize::from(matches!(happening, Happening::Trial(_)));
                    (steps[0], steps[1]) = (steps[0] + over, steps[1] + 1);
                    (trials[0], trials[1]) = (trials[0] + over * trial, trials[1] + trial);
                }
            }
            ParticipantLine { participant, id: progress.people().get(&participant).cloned(), steps, trials }
        };
        (1..=self.conductor.study.plan.participants).map(line).collect()
    }

    fn next_session(&self) -> Option<NextSession> {
        if self.under.is_some() {
            return None;
        }
        let progress = self.conductor.progress();
        let participant = progress.next_participant()?;
        let session = progress.next_session(participant)?;
        let today = Zoned::now().date();
        Some(NextSession {
            participant,
            id: progress.people().get(&participant).cloned(),
            session: session.session.clone(),
            begun: progress.begun(session),
            departs: self.conductor.off_plan(participant, &session.session, today).unwrap_or_default(),
        })
    }

    fn session(&self, under: &UnderWay) -> Option<SessionScreen> {
        let progress = self.conductor.progress();
        let session = progress.session(under.participant, &under.session)?;
        let mut minutes_left = 0.0;
        let step = |(spot, happening): (Spot, &Happening)| {
            let state = progress.step(&spot);
            if state.outcome.is_none() {
                minutes_left += self.minutes(happening, &under.session);
            }
            StepLine {
                step: spot.step,
                label: self.label(happening),
                condition: happening.condition().map(str::to_owned),
                outcome: state.outcome,
                attempts: state.attempts,
                deviations: state.deviations.into_iter().collect(),
            }
        };
        let steps = progress.spots(session).zip(&session.happenings).map(step).collect();
        Some(SessionScreen {
            participant: under.participant,
            id: self.conductor.label(under.participant),
            session: under.session.clone(),
            steps,
            now: self.now.as_ref().map(|now| self.now_screen(now)),
            minutes_left,
        })
    }

    /// A step in a few words, a questionnaire by its title.
    fn label(&self, happening: &Happening) -> String {
        let form = happening.form().and_then(|name| self.conductor.study.forms.get(name));
        let title = form.and_then(|form| form.title.get("en").or_else(|| form.title.values().next()));
        title.map_or_else(|| happening.label(), |title| format!("questionnaire: {title}"))
    }

    /// What a step takes at most, by the plan.
    fn minutes(&self, happening: &Happening, session: &str) -> f64 {
        let plan = &self.conductor.study.plan;
        match happening {
            Happening::Step(planned) => planned.step.minutes(),
            Happening::Trial(trial) => {
                let between = plan.sessions.iter().find(|own| own.name == session);
                let between = between.map_or(0.0, |session| session.between_trials_minutes);
                plan.limit_secs(trial) / 60.0 + between
            }
        }
    }

    fn now_screen(&self, now: &Now) -> NowScreen {
        let what = match &now.what {
            NowWhat::Form(_) => self.form(&now.spot).map_or_else(|| now.what.clone(), NowWhat::Form),
            what => what.clone(),
        };
        NowScreen {
            step: now.spot.step,
            label: self
                .conductor
                .progress()
                .happening(&now.spot)
                .map_or_else(String::new, |happening| self.label(happening)),
            running: now.running,
            since_secs: now.since.elapsed().as_secs_f64(),
            what,
        }
    }

    /// The questionnaire at a spot, with its answers.
    pub(super) fn form(&self, spot: &Spot) -> Option<FormScreen> {
        let progress = self.conductor.progress();
        let happening = progress.happening(spot)?;
        let form = self.conductor.study.forms.get(happening.form()?)?;
        let answers = progress.step(spot).answers;
        let pairs = form.pairs().into_iter().map(|(first, second)| FormPair {
            key: pair_key(first, second),
            first: first.to_owned(),
            second: second.to_owned(),
        });
        Some(FormScreen {
            step: spot.step,
            pairs: pairs.collect(),
            conditions: self.conductor.study.conditions(),
            about: happening.condition().map(str::to_owned),
            missing: form.missing(&answers),
            answers,
            refused: self.refused.clone(),
            form: form.clone(),
        })
    }
}

fn pair((over, all): (usize, usize)) -> [usize; 2] {
    [over, all]
}
