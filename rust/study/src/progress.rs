use crate::{
    Deviation, FormAnswer, Schedule, ScheduledSession, SessionItem, StepId, StepOutcome, StudyEvent,
};
use std::collections::{BTreeMap, BTreeSet};

/// Why an event cannot follow those before it.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ProgressError {
    /// The plan has no such participant, session or step.
    #[error("the plan has no step {} in session {} of participant {}", .0.step, .0.session, .0.participant)]
    NoSuchStep(StepId),
    /// A place in the plan is taken, or a pseudonym is.
    #[error("participant {participant} is {existing_id}, not {id}")]
    AlreadyTaken {
        /// The place in the plan.
        participant: usize,
        /// Who has it.
        existing_id: String,
        /// Who was to have it.
        id: String,
    },
    /// A trial would count twice, or end without a beginning.
    #[error(
        "step {} of session {} of participant {}: attempt {got} cannot {what} here, {expected} was expected",
        step_id.step, step_id.session, step_id.participant
    )]
    Attempt {
        /// Which step.
        step_id: StepId,
        /// `begin` or `end`.
        what: &'static str,
        /// Which attempt.
        got: usize,
        /// In words.
        expected: String,
    },
}

/// What became of a step.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StepState {
    /// How often it was begun.
    pub attempts: usize,
    /// It is under way.
    pub open: bool,
    /// How the attempt that counts ended; none while none counts.
    pub outcome: Option<StepOutcome>,
    /// Folder of the record of the last attempt.
    pub record: Option<String>,
    /// Digest of the trial in it, once it is over; none of older journals.
    pub digest: Option<String>,
    /// Answers so far, by item.
    pub answers: BTreeMap<String, FormAnswer>,
    /// What departed from the plan here.
    pub deviations: BTreeSet<Deviation>,
}

/// How far a study is: the sum of its events. Pure.
#[derive(Clone, Debug, PartialEq)]
pub struct StudyProgress {
    schedule: Schedule,
    /// Pseudonyms by place in the plan.
    pseudonyms: BTreeMap<usize, String>,
    steps: BTreeMap<StepId, StepState>,
    /// Days on which there was something, by session.
    days: BTreeMap<(usize, String), Vec<String>>,
}

impl StudyProgress {
    /// Nothing has happened yet.
    pub fn new(schedule: Schedule) -> Self {
        Self { schedule, pseudonyms: BTreeMap::new(), steps: BTreeMap::new(), days: BTreeMap::new() }
    }

    /// What is planned.
    pub fn schedule(&self) -> &Schedule {
        &self.schedule
    }

    /// Takes in the next event.
    ///
    /// # Errors
    /// [`ProgressError`]; nothing is changed then.
    pub fn apply(&mut self, event: &StudyEvent) -> Result<(), ProgressError> {
        if let Some(step_id) = event.step_id()
            && self.item(step_id).is_none()
        {
            return Err(ProgressError::NoSuchStep(step_id.clone()));
        }
        match event {
            StudyEvent::Enrolled { participant, id } => self.enroll(*participant, id)?,
            StudyEvent::Visited { participant, session, day } => {
                let days = self.days.entry((*participant, session.clone())).or_default();
                if days.last() != Some(day) {
                    days.push(day.clone());
                }
            }
            StudyEvent::StepBegan { step_id, attempt, record } => {
                let state = self.steps.entry(step_id.clone()).or_default();
                if state.open || state.outcome.is_some() || *attempt != state.attempts + 1 {
                    let expected = match (state.open, &state.outcome) {
                        (true, _) => format!("the end of attempt {}", state.attempts),
                        (_, Some(_)) => "a repetition with its reason".to_owned(),
                        _ => format!("attempt {}", state.attempts + 1),
                    };
                    return Err(ProgressError::Attempt {
                        step_id: step_id.clone(),
                        what: "begin",
                        got: *attempt,
                        expected,
                    });
                }
                (state.open, state.attempts) = (true, *attempt);
                (state.record, state.digest) = (record.clone(), None);
            }
            StudyEvent::StepEnded { step_id, attempt, outcome, digest } => {
                let state = self.steps.entry(step_id.clone()).or_default();
                if !state.open || *attempt != state.attempts {
                    let expected = match state.open {
                        true => format!("the end of attempt {}", state.attempts),
                        false => format!("the beginning of attempt {}", state.attempts + 1),
                    };
                    return Err(ProgressError::Attempt {
                        step_id: step_id.clone(),
                        what: "end",
                        got: *attempt,
                        expected,
                    });
                }
                state.open = false;
                state.digest.clone_from(digest);
                // What was interrupted does not count.
                state.outcome = Some(*outcome).filter(|outcome| *outcome != StepOutcome::Interrupted);
            }
            StudyEvent::Answered { step_id, item, answer, .. } => {
                let answers = &mut self.steps.entry(step_id.clone()).or_default().answers;
                match answer {
                    Some(answer) => answers.insert(item.clone(), answer.clone()),
                    None => answers.remove(item),
                };
            }
            StudyEvent::Repeated { step_id, .. } => {
                let state = self.steps.entry(step_id.clone()).or_default();
                state.outcome = None;
                state.deviations.insert(Deviation::Repeated);
            }
            StudyEvent::Deviated { step_id, deviation, .. } => {
                self.steps.entry(step_id.clone()).or_default().deviations.insert(*deviation);
            }
            StudyEvent::RunBegan { .. }
            | StudyEvent::Noted { .. }
            | StudyEvent::Paused { .. }
            | StudyEvent::Trained { .. }
            | StudyEvent::GazeChecked { .. }
            | StudyEvent::Checked { .. } => {}
        }
        Ok(())
    }

    fn enroll(&mut self, participant: usize, id: &str) -> Result<(), ProgressError> {
        let planned = self.schedule.sessions.iter().any(|session| session.participant == participant);
        if !planned {
            let step_id = StepId { participant, session: "1".to_owned(), step: 1 };
            return Err(ProgressError::NoSuchStep(step_id));
        }
        let taken = |participant: usize, taken: String| ProgressError::AlreadyTaken {
            participant,
            existing_id: taken,
            id: id.to_owned(),
        };
        if let Some(other) = self.pseudonyms.get(&participant) {
            return Err(taken(participant, other.clone()));
        }
        if let Some(number) = self.participant_number(id) {
            return Err(taken(participant, format!("to be somebody new, but {id} is participant {number}")));
        }
        self.pseudonyms.insert(participant, id.to_owned());
        Ok(())
    }

    /// Pseudonyms by place in the plan.
    pub fn pseudonyms(&self) -> &BTreeMap<usize, String> {
        &self.pseudonyms
    }

    /// The place in the plan of the person with this pseudonym.
    pub fn participant_number(&self, id: &str) -> Option<usize> {
        self.pseudonyms.iter().find(|(_, other)| *other == id).map(|(number, _)| *number)
    }

    /// The first place in the plan that nobody has.
    pub fn first_free_number(&self) -> Option<usize> {
        let participants = self.schedule.sessions.iter().map(|session| session.participant);
        participants.into_iter().find(|number| !self.pseudonyms.contains_key(number))
    }

    /// What happens at a spot.
    pub fn item(&self, step_id: &StepId) -> Option<&SessionItem> {
        let session = self.session(step_id.participant, &step_id.session)?;
        session.items.get(step_id.step.checked_sub(1)?)
    }

    /// A session of a participant.
    pub fn session(&self, participant: usize, session: &str) -> Option<&ScheduledSession> {
        self.schedule
            .sessions
            .iter()
            .find(|other| other.participant == participant && other.session == session)
    }

    /// What became of a step.
    pub fn step(&self, step_id: &StepId) -> StepState {
        self.steps.get(step_id).cloned().unwrap_or_default()
    }

    /// Steps that are under way.
    pub fn open(&self) -> Vec<StepId> {
        self.steps.iter().filter(|(_, state)| state.open).map(|(step_id, _)| step_id.clone()).collect()
    }

    /// Days on which there was something of a session, in their order.
    pub fn days(&self, participant: usize, session: &str) -> &[String] {
        self.days.get(&(participant, session.to_owned())).map_or(&[], Vec::as_slice)
    }

    /// The spots of a session, in their order.
    pub fn step_ids<'a>(&'a self, session: &'a ScheduledSession) -> impl Iterator<Item = StepId> + 'a {
        (1..=session.items.len()).map(|step| StepId {
            participant: session.participant,
            session: session.session.clone(),
            step,
        })
    }

    /// The first step of a session without an attempt that counts; none if all are over.
    pub fn next_step(&self, session: &ScheduledSession) -> Option<StepId> {
        self.step_ids(session)
            .find(|step_id| self.steps.get(step_id).is_none_or(|state| state.outcome.is_none()))
    }

    /// The first session of a participant that is not over.
    pub fn next_session(&self, participant: usize) -> Option<&ScheduledSession> {
        let mut own = self.schedule.sessions.iter().filter(|session| session.participant == participant);
        own.find(|session| self.next_step(session).is_some())
    }

    /// Whether a session was begun.
    pub fn has_started(&self, session: &ScheduledSession) -> bool {
        self.step_ids(session).any(|step_id| self.steps.get(&step_id).is_some_and(|state| state.attempts > 0))
    }

    /// Who is next: whose session was begun and is not over, else the first in the plan who has sessions left.
    pub fn next_participant(&self) -> Option<usize> {
        let mut left = self.schedule.sessions.iter().filter(|session| self.next_step(session).is_some());
        let under_way = left.clone().find(|session| self.has_started(session));
        under_way.or_else(|| left.next()).map(|session| session.participant)
    }

    /// Whether all that was planned is over.
    pub fn finished(&self) -> bool {
        self.schedule.sessions.iter().all(|session| self.next_step(session).is_none())
    }

    /// Steps of a kind that are over, and all of them: `(trials over, trials)` for trials.
    pub fn count(&self, of: impl Fn(&SessionItem) -> bool) -> (usize, usize) {
        let (mut over, mut all) = (0, 0);
        for session in &self.schedule.sessions {
            for (step_id, _) in self.step_ids(session).zip(&session.items).filter(|(_, step)| of(step)) {
                all += 1;
                over += usize::from(self.steps.get(&step_id).is_some_and(|state| state.outcome.is_some()));
            }
        }
        (over, all)
    }

    /// The trial of a session that ended last, which can be done again.
    pub fn last_trial(&self, session: &ScheduledSession) -> Option<StepId> {
        let trials = self.step_ids(session).zip(&session.items);
        let over = trials.filter(|(step_id, item)| {
            matches!(item, SessionItem::Trial(_))
                && self.steps.get(step_id).is_some_and(|state| state.outcome.is_some())
        });
        over.last().map(|(step_id, _)| step_id)
    }

    /// Takes another plan for the rest of the study.
    ///
    /// # Errors
    /// The first step that was begun and that the other plan has otherwise, or not at all.
    pub fn with_schedule(&self, schedule: Schedule) -> Result<Self, String> {
        let other = Self { schedule, ..self.clone() };
        for participant in self.pseudonyms.keys() {
            for session in self.schedule.sessions.iter().filter(|own| own.participant == *participant) {
                let last = self.step_ids(session).filter(|step_id| self.steps.contains_key(step_id)).last();
                for step_id in self.step_ids(session).take(last.map_or(0, |step_id| step_id.step)) {
                    if self.item(&step_id) != other.item(&step_id) {
                        return Err(format!(
                            "step {} of session {} of participant {} was done and is another one now",
                            step_id.step, step_id.session, step_id.participant
                        ));
                    }
                }
            }
        }
        Ok(other)
    }
}
