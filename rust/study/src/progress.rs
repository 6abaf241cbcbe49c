use crate::{Answer, Deviation, Happening, Schedule, ScheduledSession, Spot, StepOutcome, StudyEvent};
use std::collections::{BTreeMap, BTreeSet};

/// Why an event cannot follow those before it.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ProgressError {
    /// The plan has no such participant, session or step.
    #[error("the plan has no step {} in session {} of participant {}", .0.step, .0.session, .0.participant)]
    NoSuchStep(Spot),
    /// A place in the plan is taken, or a pseudonym is.
    #[error("participant {participant} is {taken}, not {id}")]
    Taken {
        /// The place in the plan.
        participant: usize,
        /// Who has it.
        taken: String,
        /// Who was to have it.
        id: String,
    },
    /// A trial would count twice, or end without a beginning.
    #[error(
        "step {} of session {} of participant {}: attempt {got} cannot {what} here, {expected} was expected",
        spot.step, spot.session, spot.participant
    )]
    Attempt {
        /// Which step.
        spot: Spot,
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
    pub answers: BTreeMap<String, Answer>,
    /// What departed from the plan here.
    pub deviations: BTreeSet<Deviation>,
}

/// How far a study is: the sum of its events. Pure.
#[derive(Clone, Debug, PartialEq)]
pub struct Progress {
    schedule: Schedule,
    /// Pseudonyms by place in the plan.
    people: BTreeMap<usize, String>,
    steps: BTreeMap<Spot, StepState>,
    /// Days on which there was something, by session.
    days: BTreeMap<(usize, String), Vec<String>>,
}

impl Progress {
    /// Nothing has happened yet.
    pub fn new(schedule: Schedule) -> Self {
        Self { schedule, people: BTreeMap::new(), steps: BTreeMap::new(), days: BTreeMap::new() }
    }

    /// What is planned.
    pub fn schedule(&self) -> &Schedule {
        &self.schedule
    }

    /// Takes in the next event.
    ///
    /// # Errors
    /// [`ProgressError`]; nothing is changed then.
    pub fn take(&mut self, event: &StudyEvent) -> Result<(), ProgressError> {
        if let Some(spot) = event.spot()
            && self.happening(spot).is_none()
        {
            return Err(ProgressError::NoSuchStep(spot.clone()));
        }
        match event {
            StudyEvent::Enrolled { participant, id } => self.enrol(*participant, id)?,
            StudyEvent::Visited { participant, session, day } => {
                let days = self.days.entry((*participant, session.clone())).or_default();
                if days.last() != Some(day) {
                    days.push(day.clone());
                }
            }
            StudyEvent::StepBegan { spot, attempt, record } => {
                let state = self.steps.entry(spot.clone()).or_default();
                if state.open || state.outcome.is_some() || *attempt != state.attempts + 1 {
                    let expected = match (state.open, &state.outcome) {
                        (true, _) => format!("the end of attempt {}", state.attempts),
                        (_, Some(_)) => "a repetition with its reason".to_owned(),
                        _ => format!("attempt {}", state.attempts + 1),
                    };
                    return Err(ProgressError::Attempt {
                        spot: spot.clone(),
                        what: "begin",
                        got: *attempt,
                        expected,
                    });
                }
                (state.open, state.attempts) = (true, *attempt);
                (state.record, state.digest) = (record.clone(), None);
            }
            StudyEvent::StepEnded { spot, attempt, outcome, digest } => {
                let state = self.steps.entry(spot.clone()).or_default();
                if !state.open || *attempt != state.attempts {
                    let expected = match state.open {
                        true => format!("the end of attempt {}", state.attempts),
                        false => format!("the beginning of attempt {}", state.attempts + 1),
                    };
                    return Err(ProgressError::Attempt {
                        spot: spot.clone(),
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
            StudyEvent::Answered { spot, item, answer, .. } => {
                let answers = &mut self.steps.entry(spot.clone()).or_default().answers;
                match answer {
                    Some(answer) => answers.insert(item.clone(), answer.clone()),
                    None => answers.remove(item),
                };
            }
            StudyEvent::Repeated { spot, .. } => {
                let state = self.steps.entry(spot.clone()).or_default();
                state.outcome = None;
                state.deviations.insert(Deviation::Repeated);
            }
            StudyEvent::Deviated { spot, deviation, .. } => {
                self.steps.entry(spot.clone()).or_default().deviations.insert(*deviation);
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

    fn enrol(&mut self, participant: usize, id: &str) -> Result<(), ProgressError> {
        let planned = self.schedule.sessions.iter().any(|session| session.participant == participant);
        if !planned {
            let spot = Spot { participant, session: "1".to_owned(), step: 1 };
            return Err(ProgressError::NoSuchStep(spot));
        }
        let taken = |participant: usize, taken: String| ProgressError::Taken {
            participant,
            taken,
            id: id.to_owned(),
        };
        if let Some(other) = self.people.get(&participant) {
            return Err(taken(participant, other.clone()));
        }
        if let Some(place) = self.place(id) {
            return Err(taken(participant, format!("to be somebody new, but {id} is participant {place}")));
        }
        self.people.insert(participant, id.to_owned());
        Ok(())
    }

    /// Pseudonyms by place in the plan.
    pub fn people(&self) -> &BTreeMap<usize, String> {
        &self.people
    }

    /// The place in the plan of the person with this pseudonym.
    pub fn place(&self, id: &str) -> Option<usize> {
        self.people.iter().find(|(_, other)| *other == id).map(|(place, _)| *place)
    }

    /// The first place in the plan that nobody has.
    pub fn free_place(&self) -> Option<usize> {
        let places = self.schedule.sessions.iter().map(|session| session.participant);
        places.into_iter().find(|place| !self.people.contains_key(place))
    }

    /// What happens at a spot.
    pub fn happening(&self, spot: &Spot) -> Option<&Happening> {
        let session = self.session(spot.participant, &spot.session)?;
        session.happenings.get(spot.step.checked_sub(1)?)
    }

    /// A session of a participant.
    pub fn session(&self, participant: usize, session: &str) -> Option<&ScheduledSession> {
        self.schedule
            .sessions
            .iter()
            .find(|other| other.participant == participant && other.session == session)
    }

    /// What became of a step.
    pub fn step(&self, spot: &Spot) -> StepState {
        self.steps.get(spot).cloned().unwrap_or_default()
    }

    /// Steps that are under way.
    pub fn open(&self) -> Vec<Spot> {
        self.steps.iter().filter(|(_, state)| state.open).map(|(spot, _)| spot.clone()).collect()
    }

    /// Days on which there was something of a session, in their order.
    pub fn days(&self, participant: usize, session: &str) -> &[String] {
        self.days.get(&(participant, session.to_owned())).map_or(&[], Vec::as_slice)
    }

    /// The spots of a session, in their order.
    pub fn spots<'a>(&'a self, session: &'a ScheduledSession) -> impl Iterator<Item = Spot> + 'a {
        (1..=session.happenings.len()).map(|step| Spot {
            participant: session.participant,
            session: session.session.clone(),
            step,
        })
    }

    /// The first step of a session without an attempt that counts; none if all are over.
    pub fn next_step(&self, session: &ScheduledSession) -> Option<Spot> {
        self.spots(session).find(|spot| self.steps.get(spot).is_none_or(|state| state.outcome.is_none()))
    }

    /// The first session of a participant that is not over.
    pub fn next_session(&self, participant: usize) -> Option<&ScheduledSession> {
        let mut own = self.schedule.sessions.iter().filter(|session| session.participant == participant);
        own.find(|session| self.next_step(session).is_some())
    }

    /// Whether a session was begun.
    pub fn begun(&self, session: &ScheduledSession) -> bool {
        self.spots(session).any(|spot| self.steps.get(&spot).is_some_and(|state| state.attempts > 0))
    }

    /// Who is next: whose session was begun and is not over, else the first in the plan who has sessions left.
    pub fn next_participant(&self) -> Option<usize> {
        let mut left = self.schedule.sessions.iter().filter(|session| self.next_step(session).is_some());
        let under_way = left.clone().find(|session| self.begun(session));
        under_way.or_else(|| left.next()).map(|session| session.participant)
    }

    /// Whether all that was planned is over.
    pub fn finished(&self) -> bool {
        self.schedule.sessions.iter().all(|session| self.next_step(session).is_none())
    }

    /// Steps of a kind that are over, and all of them: `(trials over, trials)` for trials.
    pub fn count(&self, of: impl Fn(&Happening) -> bool) -> (usize, usize) {
        let (mut over, mut all) = (0, 0);
        for session in &self.schedule.sessions {
            for (spot, _) in self.spots(session).zip(&session.happenings).filter(|(_, step)| of(step)) {
                all += 1;
                over += usize::from(self.steps.get(&spot).is_some_and(|state| state.outcome.is_some()));
            }
        }
        (over, all)
    }

    /// The trial of a session that ended last, which can be done again.
    pub fn last_trial(&self, session: &ScheduledSession) -> Option<Spot> {
        let trials = self.spots(session).zip(&session.happenings);
        let over = trials.filter(|(spot, happening)| {
            matches!(happening, Happening::Trial(_))
                && self.steps.get(spot).is_some_and(|state| state.outcome.is_some())
        });
        over.last().map(|(spot, _)| spot)
    }

    /// Takes another plan for the rest of the study.
    ///
    /// # Errors
    /// The first step that was begun and that the other plan has otherwise, or not at all.
    pub fn changed_to(&self, schedule: Schedule) -> Result<Self, String> {
        let other = Self { schedule, ..self.clone() };
        for participant in self.people.keys() {
            for session in self.schedule.sessions.iter().filter(|own| own.participant == *participant) {
                let last = self.spots(session).filter(|spot| self.steps.contains_key(spot)).last();
                for spot in self.spots(session).take(last.map_or(0, |spot| spot.step)) {
                    if self.happening(&spot) != other.happening(&spot) {
                        return Err(format!(
                            "step {} of session {} of participant {} was done and is another one now",
                            spot.step, spot.session, spot.participant
                        ));
                    }
                }
            }
        }
        Ok(other)
    }
}
