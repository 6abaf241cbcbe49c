//! A study under way: what happened is in its journal, and what is next follows from that.

use super::{PLAN_FILE, ParticipantKind, Study};
use jiff::{Timestamp, Zoned, civil::Date};
use proact_recording::{
    RecordingError, StudyTrialId,
    journal::{Journal, JournalEntry, JournalError},
    read_result, sha256_of_bytes,
};
use proact_study::{
    Deviation, FormAnswer, PlannedTrial, ProgressError, Schedule, SessionItem, StepId, StepOutcome,
    StepState, StudyEvent, StudyPlan, StudyProgress,
};
use proact_testbed::TrialResult;
use std::path::PathBuf;

/// The study's file in its folder.
pub const STUDY_FILE: &str = "study.sqlite";
/// Where the records of its trials are, in its folder.
pub const TRIALS_FOLDER: &str = "trials";
/// A clock that is so far behind the last event was set back, milliseconds.
const CLOCK_TOLERANCE_MS: i64 = 2000;

/// Why a study does not go on.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum StudyError {
    /// The journal.
    #[error(transparent)]
    Journal(#[from] JournalError),
    /// An event that cannot be.
    #[error(transparent)]
    Progress(#[from] ProgressError),
    /// The record of a trial.
    #[error(transparent)]
    Record(#[from] RecordingError),
    /// The plan was changed where something was done already.
    #[error(
        "{}: the plan was changed after the study had begun: {what}. Put it back (`proact study export` writes the text that \
         it began with), or make another study",
        file.display()
    )]
    PlanChanged {
        /// The plan.
        file: PathBuf,
        /// What is otherwise now.
        what: String,
    },
    /// Simulated and real participants, or simulated ones of two kinds, do not go into one study.
    #[error("{} has {existing} participants, and this run is {requested}: make another study for it", folder.display())]
    MixedParticipants {
        /// The study.
        folder: PathBuf,
        /// `simulated`, `real`, or simulated of a kind.
        existing: String,
        /// `simulated`, `for real ones`, or for simulated ones of a kind.
        requested: String,
    },
    /// There is no such person, or no place for one.
    #[error("{0}")]
    Participant(String),
    /// An answer that cannot be.
    #[error(transparent)]
    Answer(#[from] proact_study::FormError),
}

/// What the journal knows of a training.
#[derive(Clone, Debug, PartialEq)]
pub struct LastTraining {
    /// The model's file in the study's folder; none where keys make the gestures.
    pub model: Option<String>,
    /// Share of windows that were recognised.
    pub accuracy: Option<f64>,
    /// Its test was passed; none without one.
    pub passed: Option<bool>,
    /// How long ago, seconds.
    pub age_secs: f64,
}

/// A study that goes on: every event is on the disk before it counts.
#[derive(Debug)]
pub struct Conductor {
    /// What is run.
    pub study: Study,
    journal: Journal,
    progress: StudyProgress,
    last_id: i64,
    last_event_time: Option<Timestamp>,
}

impl Conductor {
    /// Takes the study up where it stands, with people or with `simulated` ones of a kind. What was under way when the last
    /// program ended is interrupted: it is done again, and answers stay. Says in one sentence each what was found.
    ///
    /// # Errors
    /// [`StudyError`].
    pub fn open_or_resume(
        study: Study,
        simulated: Option<ParticipantKind>,
    ) -> Result<(Self, Vec<String>), StudyError> {
        let journal = Journal::open(&study.folder.join(STUDY_FILE))?;
        let entries = journal.entries::<StudyEvent>()?;
        let (before, progress) = replay_events(&study, &journal, &entries)?;
        if let Some(before) = before.as_ref().filter(|before| before.simulated != simulated) {
            let folder = study.folder.clone();
            let (has, requested) = match (before.simulated, simulated) {
                (None, _) => ("real".to_owned(), "simulated".to_owned()),
                (Some(_), None) => ("simulated".to_owned(), "for real ones".to_owned()),
                (Some(has), Some(requested)) => {
                    (format!("simulated ({has})"), format!("for others (--participant-kind {requested})"))
                }
            };
            return Err(StudyError::MixedParticipants { folder, existing: has, requested });
        }
        let last = entries.last();
        let last_at = last.map(|entry| written_at(&journal, entry)).transpose()?;
        let mut conductor = Self {
            journal,
            progress,
            last_id: last.map_or(0, |entry| entry.id),
            last_event_time: last_at,
            study,
        };
        let text = conductor.study.plan_text.clone();
        let plan = sha256_of_bytes(text.as_bytes());
        conductor.journal.store_text(&plan, PLAN_FILE, &text)?;
        let program = env!("CARGO_PKG_VERSION").to_owned();
        let people = simulated.map(|people| people.to_string());
        let simulated = simulated.is_some();
        // A finished rehearsal has nothing left to run: nothing happens, and its tables stay those of its journal.
        let same_plan = before.as_ref().is_some_and(|before| before.plan == plan);
        if !(simulated && same_plan && conductor.progress.finished()) {
            conductor.write(StudyEvent::RunBegan {
                simulated,
                participant_kind: people,
                program,
                plan: plan.clone(),
            })?;
        }
        let mut found = Vec::new();
        for step_id in conductor.progress.open() {
            found.push(conductor.close_interrupted(&step_id)?);
        }
        if before.is_some_and(|before| before.plan != plan) {
            found.push("the plan was changed since; what was done already is in it as it was".to_owned());
            if let Some(step_id) = conductor.next() {
                let reason = "the text of the plan is another one".to_owned();
                conductor.write(StudyEvent::Deviated {
                    step_id,
                    deviation: Deviation::PlanChanged,
                    reason,
                })?;
            }
        }
        Ok((conductor, found))
    }

    fn close_interrupted(&mut self, step_id: &StepId) -> Result<String, StudyError> {
        let state = self.progress.step(step_id);
        self.end(step_id, StepOutcome::Interrupted)?;
        let what = self.progress.item(step_id).map_or_else(String::new, SessionItem::label);
        let then = match state.record {
            Some(record) => format!("it is done again, and what there is of it stays in {record}"),
            None => "it goes on where it was".to_owned(),
        };
        Ok(format!("{what} of participant {} was interrupted; {then}", self.label(step_id.participant)))
    }

    /// How far it is.
    pub fn progress(&self) -> &StudyProgress {
        &self.progress
    }

    /// Number of the last event.
    pub fn last_id(&self) -> i64 {
        self.last_id
    }

    /// Writes an event to the disk; it then counts. Its number.
    ///
    /// # Errors
    /// An event that cannot be, a disk that refuses; after the latter this conductor is of no use any more.
    pub fn write(&mut self, event: StudyEvent) -> Result<i64, StudyError> {
        let now = Timestamp::now();
        let before = self.last_event_time.replace(now).map_or(i64::MIN, Timestamp::as_millisecond);
        let behind_ms = before.saturating_sub(now.as_millisecond());
        if behind_ms > CLOCK_TOLERANCE_MS
            && let Some(step_id) = event.step_id().cloned().or_else(|| self.next())
        {
            let reason = format!("the clock is {} s behind the event before", behind_ms / 1000);
            self.write(StudyEvent::Deviated { step_id, deviation: Deviation::ClockSet, reason })?;
        }
        self.progress.apply(&event)?;
        self.last_id = self.journal.append(&format!("{now:.3}"), &event)?;
        Ok(self.last_id)
    }

    /// The model of the last training in a session, with how long ago that was, its accuracy and whether its test was passed.
    ///
    /// # Errors
    /// The journal cannot be read.
    pub fn last_training(
        &self,
        participant: usize,
        session: &str,
    ) -> Result<Option<LastTraining>, StudyError> {
        let own = |step_id: &StepId| step_id.participant == participant && step_id.session == session;
        for entry in self.journal.entries::<StudyEvent>()?.into_iter().rev() {
            let then = written_at(&self.journal, &entry)?;
            if let StudyEvent::Trained { step_id, model, accuracy, passed } = entry.event
                && own(&step_id)
            {
                let age_secs =
                    (Timestamp::now().as_millisecond() - then.as_millisecond()).max(0) as f64 * 1e-3;
                return Ok(Some(LastTraining { model, accuracy, passed, age_secs }));
            }
        }
        Ok(None)
    }

    /// By how much the clock is behind the last event, seconds; none if it is not.
    pub fn clock_behind_secs(&self) -> Option<f64> {
        let behind_ms =
            self.last_event_time?.as_millisecond().saturating_sub(Timestamp::now().as_millisecond());
        (behind_ms > CLOCK_TOLERANCE_MS).then_some(behind_ms as f64 * 1e-3)
    }

    /// The step that is next: of the session that is under way, or of the next in the plan.
    pub fn next(&self) -> Option<StepId> {
        let session = self.progress.next_session(self.progress.next_participant()?)?;
        self.progress.next_step(session)
    }

    /// The pseudonym of a participant, or the number of a place that nobody has.
    pub fn label(&self, participant: usize) -> String {
        self.progress.pseudonyms().get(&participant).cloned().unwrap_or_else(|| participant.to_string())
    }

    /// Whose turn it is. Without a pseudonym: whose session is under way, or the next in the plan, who is enrolled as `P` and
    /// the number if nobody was yet. With one: that person, who takes the next free place if `new`.
    ///
    /// # Errors
    /// A pseudonym that nobody has, or that somebody has who should be new; a person or a study without sessions left.
    pub fn select_participant(&mut self, id: Option<&str>, new: bool) -> Result<usize, StudyError> {
        let refuse = |what: String| Err(StudyError::Participant(what));
        let Some(planned) = self.progress.next_participant() else {
            return refuse("the study is finished: every session of the plan is over".to_owned());
        };
        let participant = match (id, id.and_then(|id| self.progress.participant_number(id))) {
            (None, _) => planned,
            (Some(id), Some(_)) if new => {
                return refuse(format!("participant {id} exists already, and is not new"));
            }
            (Some(id), Some(number)) => match self.progress.next_session(number) {
                Some(_) => number,
                None => return refuse(format!("participant {id} has no session left")),
            },
            (Some(id), None) if !new => {
                let known: Vec<&str> = self.progress.pseudonyms().values().map(String::as_str).collect();
                let known = if known.is_empty() { "nobody".to_owned() } else { known.join(", ") };
                return refuse(format!(
                    "there is no participant {id}; known so far: {known}. Somebody who is new has to be called so"
                ));
            }
            (Some(_), None) => match self.progress.first_free_number() {
                Some(number) => number,
                None => {
                    return refuse("every place of the plan is taken; it says how many there are".to_owned());
                }
            },
        };
        if !self.progress.pseudonyms().contains_key(&participant) {
            let id = id.map_or_else(|| format!("P{participant:02}"), str::to_owned);
            check_pseudonym(&id)?;
            self.write(StudyEvent::Enrolled { participant, id })?;
        }
        Ok(participant)
    }

    /// The session of a participant that goes on now, on this day. A session that goes on on another day than it began, or
    /// that is on another day than planned, departs from the plan; that of a rehearsal does not.
    ///
    /// # Errors
    /// A participant without sessions left, a disk that refuses.
    pub fn begin_session(&mut self, participant: usize, rehearsal: bool) -> Result<String, StudyError> {
        let Some(session) = self.progress.next_session(participant) else {
            let id = self.label(participant);
            return Err(StudyError::Participant(format!("participant {id} has no session left")));
        };
        let (name, step_id) = (session.session.clone(), self.progress.next_step(session));
        let today = Zoned::now().date();
        let day = today.to_string();
        let before = self.progress.days(participant, &name).last().cloned();
        if before.as_ref() == Some(&day) {
            return Ok(name);
        }
        let deviation = match &before {
            Some(before) => {
                Some((Deviation::SplitOverDays, format!("begun on {before}, taken up again on {day}")))
            }
            None => {
                self.schedule_deviation(participant, &name, today).map(|reason| (Deviation::OtherDay, reason))
            }
        };
        self.write(StudyEvent::Visited { participant, session: name.clone(), day })?;
        if let (Some((deviation, reason)), Some(step_id), false) = (deviation, step_id, rehearsal) {
            self.write(StudyEvent::Deviated { step_id, deviation, reason })?;
        }
        Ok(name)
    }

    /// In words, if a session that begins on this day is not as many days after the one before as planned.
    pub fn schedule_deviation(&self, participant: usize, session: &str, today: Date) -> Option<String> {
        let sessions = &self.study.plan.sessions;
        let index = sessions.iter().position(|other| other.name == session)?;
        let [fewest, max_days] = sessions[index].days_after?;
        let before = &sessions[index.checked_sub(1)?].name;
        let day = self.progress.days(participant, before).last()?;
        let since = |last: Date| last.until(today).map(|span| i64::from(span.get_days()));
        let Ok(days) = day.parse::<Date>().and_then(since) else {
            return Some(format!(
                "the session before was on {day:?} by the journal, which is no day before {today}"
            ));
        };
        let planned = i64::from(fewest)..=i64::from(max_days);
        (!planned.contains(&days))
            .then(|| format!("{days} days after the session before, {fewest} to {max_days} were planned"))
    }

    /// Begins the next attempt at a step, unless one is under way; the folder of its record if it is a trial.
    ///
    /// # Errors
    /// A step that is over, a disk that refuses.
    pub fn begin(&mut self, step_id: &StepId) -> Result<Option<String>, StudyError> {
        let state = self.progress.step(step_id);
        if state.open {
            return Ok(state.record);
        }
        let attempt = state.attempts + 1;
        let record = match self.progress.item(step_id) {
            Some(SessionItem::Trial(trial)) => {
                let again = if attempt > 1 { format!("-attempt{attempt}") } else { String::new() };
                Some(format!("{TRIALS_FOLDER}/{}{again}", record_name(trial)))
            }
            _ => None,
        };
        self.write(StudyEvent::StepBegan { step_id: step_id.clone(), attempt, record: record.clone() })?;
        Ok(record)
    }

    /// Ends the attempt that is under way. Of a trial that counts the journal keeps the digest.
    ///
    /// # Errors
    /// A step that was not begun, a record without a result, a disk that refuses.
    pub fn end(&mut self, step_id: &StepId, outcome: StepOutcome) -> Result<i64, StudyError> {
        let StepState { attempts: attempt, record, .. } = self.progress.step(step_id);
        let digest = match (outcome, record) {
            (StepOutcome::Done | StepOutcome::Aborted, Some(record)) => {
                Some(read_result::<TrialResult>(&self.study.folder.join(record))?.digest)
            }
            _ => None,
        };
        self.write(StudyEvent::StepEnded { step_id: step_id.clone(), attempt, outcome, digest })
    }

    /// Takes an answer, once it was checked; none takes the answer back.
    ///
    /// # Errors
    /// An answer that cannot be, a step that is no form, a disk that refuses.
    pub fn answer(
        &mut self,
        step_id: &StepId,
        item: &str,
        answer: Option<FormAnswer>,
    ) -> Result<i64, StudyError> {
        let Some(form) = self.progress.item(step_id).and_then(SessionItem::form) else {
            return Err(StudyError::Participant(format!(
                "step {} of this session is no questionnaire",
                step_id.step
            )));
        };
        let form = form.to_owned();
        if let Some(answer) = &answer {
            self.study.forms[&form].check_answer(item, answer, &self.study.conditions())?;
        }
        self.write(StudyEvent::Answered { step_id: step_id.clone(), form, item: item.to_owned(), answer })
    }
}

/// When an entry was written.
fn written_at(journal: &Journal, entry: &JournalEntry<StudyEvent>) -> Result<Timestamp, StudyError> {
    Ok(entry.written_at.parse::<Timestamp>().map_err(|error| JournalError::Event {
        path: journal.path().to_owned(),
        id: entry.id,
        reason: format!(
            "it was written at {:?}, expected a time such as 2026-03-01T12:00:00Z: {error}",
            entry.written_at
        ),
    })?)
}

/// The text of the plan with this hash, which the journal keeps.
fn stored_plan_text(journal: &Journal, plan: &str) -> Result<String, StudyError> {
    let missing = || JournalError::MissingText { path: journal.path().to_owned(), hash: plan.to_owned() };
    Ok(journal.text(plan)?.ok_or_else(missing)?)
}

/// Name of a trial's folder and of its bag, after the original's.
pub fn record_name(trial: &PlannedTrial) -> String {
    let plain = |c: char| if c.is_ascii_alphanumeric() || c == '_' { c } else { '_' };
    let mode: String = trial.condition.chars().map(plain).collect();
    format!("participant{}-mode{mode}-trial{}", trial.participant, trial.trial)
}

/// Where an attempt at a trial belongs, as its record says it.
pub(super) fn study_place(trial: &PlannedTrial, attempt: usize) -> StudyTrialId {
    StudyTrialId {
        participant: trial.participant,
        session: trial.session.clone(),
        condition: trial.condition.clone(),
        trial: trial.trial,
        attempt,
    }
}

/// The runs before.
#[derive(Clone, Debug)]
struct PreviousRun {
    /// With simulated participants, and of which kind.
    simulated: Option<ParticipantKind>,
    plan: String,
}

/// What the events of a journal make of the plan as it is now.
fn replay_events(
    study: &Study,
    journal: &Journal,
    entries: &[JournalEntry<StudyEvent>],
) -> Result<(Option<PreviousRun>, StudyProgress), StudyError> {
    let mut before: Option<PreviousRun> = None;
    let mut progress = StudyProgress::new(study.schedule.clone());
    let changed = |what: String| StudyError::PlanChanged { file: study.folder.join(PLAN_FILE), what };
    for entry in entries {
        if let StudyEvent::RunBegan { simulated, participant_kind: people, plan, .. } = &entry.event
            && before.as_ref().is_none_or(|before| before.plan != *plan)
        {
            // Each event is understood by the plan that it was written under.
            let schedule = schedule_of(study, journal, plan)?.map_err(&changed)?;
            progress = progress.with_schedule(schedule).map_err(&changed)?;
            let kind = people
                .as_deref()
                .map_or(Ok(ParticipantKind::Competent), str::parse)
                .map_err(StudyError::Participant)?;
            before = Some(PreviousRun { simulated: simulated.then_some(kind), plan: plan.clone() });
        }
        progress.apply(&entry.event)?;
    }
    let progress = progress.with_schedule(study.schedule.clone()).map_err(&changed)?;
    if let Some(before) = &before {
        check_conditions_unchanged(study, journal, &before.plan, &progress)?.map_err(changed)?;
    }
    Ok((before, progress))
}

/// Whether the conditions whose trials were begun are still what they were in the plan with this hash.
fn check_conditions_unchanged(
    study: &Study,
    journal: &Journal,
    plan: &str,
    progress: &StudyProgress,
) -> Result<Result<(), String>, StudyError> {
    if plan == sha256_of_bytes(study.plan_text.as_bytes()) {
        return Ok(Ok(()));
    }
    let before = match StudyPlan::from_text(&stored_plan_text(journal, plan)?) {
        Ok(before) => before,
        Err(error) => return Ok(Err(format!("the plan that it began with cannot be read now, {error}"))),
    };
    for session in &progress.schedule().sessions {
        for (step_id, item) in progress.step_ids(session).zip(&session.items) {
            let SessionItem::Trial(trial) = item else { continue };
            if progress.step(&step_id).attempts == 0 {
                continue;
            }
            let choice = |plan: &StudyPlan| {
                let condition = plan.conditions.iter().position(|own| own.name == trial.condition);
                condition.map(|condition| plan.trial_options(condition))
            };
            if choice(&before) != choice(&study.plan) {
                return Ok(Err(format!(
                    "trials of {} were run, and are of another kind now",
                    trial.condition
                )));
            }
        }
    }
    Ok(Ok(()))
}

/// The schedule of the plan with this hash, whose text the journal keeps.
fn schedule_of(study: &Study, journal: &Journal, plan: &str) -> Result<Result<Schedule, String>, StudyError> {
    if plan == sha256_of_bytes(study.plan_text.as_bytes()) {
        return Ok(Ok(study.schedule.clone()));
    }
    let text = stored_plan_text(journal, plan)?;
    let schedule = StudyPlan::from_text(&text).and_then(|plan| plan.schedule(&study.arrangements));
    Ok(schedule.map_err(|error| format!("the plan that it began with makes no schedule now, {error}")))
}

/// How far a study is, for who only looks: its progress, its journal, and whether its participants are simulated.
#[derive(Debug)]
pub struct StudyView {
    /// How far it is.
    pub progress: StudyProgress,
    /// What happened.
    pub entries: Vec<JournalEntry<StudyEvent>>,
    /// Participants and answers are simulated.
    pub simulated: bool,
}

/// How a study is looked at.
pub(super) struct StudyViewOptions<'a> {
    /// Another pseudonym for a participant; none keeps the journal's.
    pub(super) rename: &'a dyn Fn(usize) -> Option<String>,
}

/// Looks at a study, which may be under way.
///
/// # Errors
/// As [`Conductor::open_or_resume`].
pub fn open_view(study: &Study) -> Result<StudyView, StudyError> {
    open_view_with(study, &StudyViewOptions { rename: &|_| None })
}

pub(super) fn open_view_with(study: &Study, options: &StudyViewOptions<'_>) -> Result<StudyView, StudyError> {
    let path = study.folder.join(STUDY_FILE);
    if !path.is_file() {
        let progress = StudyProgress::new(study.schedule.clone());
        return Ok(StudyView { progress, entries: Vec::new(), simulated: false });
    }
    let journal = Journal::open_read_only(&path)?;
    let mut entries = journal.entries::<StudyEvent>()?;
    for entry in &mut entries {
        if let StudyEvent::Enrolled { participant, id } = &mut entry.event
            && let Some(other) = (options.rename)(*participant)
        {
            *id = other;
        }
    }
    let (before, progress) = replay_events(study, &journal, &entries)?;
    Ok(StudyView { progress, entries, simulated: before.is_some_and(|before| before.simulated.is_some()) })
}

/// Whether a new participant can be called `id`.
///
/// # Errors
/// [`StudyError::Participant`].
pub fn check_pseudonym(id: &str) -> Result<(), StudyError> {
    let plain = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
    if !id.is_empty() && id.len() <= 32 && id.chars().all(plain) {
        return Ok(());
    }
    let excerpt: String = id.chars().take(40).collect();
    let rest = if excerpt.len() < id.len() {
        format!("... ({} characters)", id.chars().count())
    } else {
        String::new()
    };
    Err(StudyError::Participant(format!(
        "the participant is called {excerpt:?}{rest}, expected a pseudonym of 1 to 32 letters, digits, - and _"
    )))
}
