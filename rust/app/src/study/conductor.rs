//! A study under way: what happened is in its journal, and what is next follows from that.

use super::{PLAN_FILE, People, Study};
use jiff::{Timestamp, Zoned, civil::Date};
use proact_recording::{
    RecordingError, StudyPlace, hash_of,
    journal::{Entry, Journal, JournalError},
    read_result,
};
use proact_study::{
    Answer, Deviation, Happening, Plan, PlannedTrial, Progress, ProgressError, Schedule, Spot, StepOutcome,
    StepState, StudyEvent,
};
use proact_testbed::TrialResult;
use std::path::PathBuf;

/// The study's file in its folder.
pub const STUDY_FILE: &str = "study.sqlite";
/// Where the records of its trials are, in its folder.
pub const TRIALS_FOLDER: &str = "trials";
/// A clock that is so far behind the last event was set back, milliseconds.
const CLOCK_SLACK_MS: i64 = 2000;

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
    #[error("{} has {has} participants, and this run is {asked}: make another study for it", folder.display())]
    Mixed {
        /// The study.
        folder: PathBuf,
        /// `simulated`, `real`, or simulated of a kind.
        has: String,
        /// `simulated`, `for real ones`, or for simulated ones of a kind.
        asked: String,
    },
    /// There is no such person, or no place for one.
    #[error("{0}")]
    Person(String),
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
    progress: Progress,
    last_id: i64,
    last_at: Option<Timestamp>,
}

impl Conductor {
    /// Takes the study up where it stands, with people or with `simulated` ones of a kind. What was under way when the last
    /// program ended is interrupted: it is done again, and answers stay. Says in one sentence each what was found.
    ///
    /// # Errors
    /// [`StudyError`].
    pub fn take_up(study: Study, simulated: Option<People>) -> Result<(Self, Vec<String>), StudyError> {
        let journal = Journal::open(&study.folder.join(STUDY_FILE))?;
        let entries = journal.entries::<StudyEvent>()?;
        let (before, progress) = fold(&study, &journal, &entries)?;
        if let Some(before) = before.as_ref().filter(|before| before.simulated != simulated) {
            let folder = study.folder.clone();
            let (has, asked) = match (before.simulated, simulated) {
                (None, _) => ("real".to_owned(), "simulated".to_owned()),
                (Some(_), None) => ("simulated".to_owned(), "for real ones".to_owned()),
                (Some(has), Some(asked)) => {
                    (format!("simulated ({has})"), format!("for others (--people {asked})"))
                }
            };
            return Err(StudyError::Mixed { folder, has, asked });
        }
        let last = entries.last();
        let last_at = last.map(|entry| written_at(&journal, entry)).transpose()?;
        let mut conductor =
            Self { journal, progress, last_id: last.map_or(0, |entry| entry.id), last_at, study };
        let text = conductor.study.plan_text.clone();
        let plan = hash_of(text.as_bytes());
        conductor.journal.keep_text(&plan, PLAN_FILE, &text)?;
        let program = env!("CARGO_PKG_VERSION").to_owned();
        let people = simulated.map(|people| people.to_string());
        let simulated = simulated.is_some();
        conductor.write(StudyEvent::RunBegan { simulated, people, program, plan: plan.clone() })?;
        let mut found = Vec::new();
        for spot in conductor.progress.open() {
            found.push(conductor.close_interrupted(&spot)?);
        }
        if before.is_some_and(|before| before.plan != plan) {
            found.push("the plan was changed since; what was done already is in it as it was".to_owned());
            if let Some(spot) = conductor.next() {
                let reason = "the text of the plan is another one".to_owned();
                conductor.write(StudyEvent::Deviated { spot, deviation: Deviation::PlanChanged, reason })?;
            }
        }
        Ok((conductor, found))
    }

    fn close_interrupted(&mut self, spot: &Spot) -> Result<String, StudyError> {
        let state = self.progress.step(spot);
        self.end(spot, StepOutcome::Interrupted)?;
        let what = self.progress.happening(spot).map_or_else(String::new, Happening::label);
        let then = match state.record {
            Some(record) => format!("it is done again, and what there is of it stays in {record}"),
            None => "it goes on where it was".to_owned(),
        };
        Ok(format!("{what} of participant {} was interrupted; {then}", self.label(spot.participant)))
    }

    /// How far it is.
    pub fn progress(&self) -> &Progress {
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
        let before = self.last_at.replace(now).map_or(i64::MIN, Timestamp::as_millisecond);
        let behind_ms = before.saturating_sub(now.as_millisecond());
        if behind_ms > CLOCK_SLACK_MS
            && let Some(spot) = event.spot().cloned().or_else(|| self.next())
        {
            let reason = format!("the clock is {} s behind the event before", behind_ms / 1000);
            self.write(StudyEvent::Deviated { spot, deviation: Deviation::ClockSet, reason })?;
        }
        self.progress.take(&event)?;
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
        let own = |spot: &Spot| spot.participant == participant && spot.session == session;
        for entry in self.journal.entries::<StudyEvent>()?.into_iter().rev() {
            let then = written_at(&self.journal, &entry)?;
            if let StudyEvent::Trained { spot, model, accuracy, passed } = entry.event
                && own(&spot)
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
        let behind_ms = self.last_at?.as_millisecond().saturating_sub(Timestamp::now().as_millisecond());
        (behind_ms > CLOCK_SLACK_MS).then_some(behind_ms as f64 * 1e-3)
    }

    /// The step that is next: of the session that is under way, or of the next in the plan.
    pub fn next(&self) -> Option<Spot> {
        let session = self.progress.next_session(self.progress.next_participant()?)?;
        self.progress.next_step(session)
    }

    /// The pseudonym of a participant, or the number of a place that nobody has.
    pub fn label(&self, participant: usize) -> String {
        self.progress.people().get(&participant).cloned().unwrap_or_else(|| participant.to_string())
    }

    /// Whose turn it is. Without a pseudonym: whose session is under way, or the next in the plan, who is enrolled as `P` and
    /// the number if nobody was yet. With one: that person, who takes the next free place if `new`.
    ///
    /// # Errors
    /// A pseudonym that nobody has, or that somebody has who should be new; a person or a study without sessions left.
    pub fn choose(&mut self, id: Option<&str>, new: bool) -> Result<usize, StudyError> {
        let refuse = |what: String| Err(StudyError::Person(what));
        let Some(planned) = self.progress.next_participant() else {
            return refuse("the study is finished: every session of the plan is over".to_owned());
        };
        let participant = match (id, id.and_then(|id| self.progress.place(id))) {
            (None, _) => planned,
            (Some(id), Some(_)) if new => {
                return refuse(format!("participant {id} exists already, and is not new"));
            }
            (Some(id), Some(place)) => match self.progress.next_session(place) {
                Some(_) => place,
                None => return refuse(format!("participant {id} has no session left")),
            },
            (Some(id), None) if !new => {
                let known: Vec<&str> = self.progress.people().values().map(String::as_str).collect();
                let known = if known.is_empty() { "nobody".to_owned() } else { known.join(", ") };
                return refuse(format!(
                    "there is no participant {id}; known so far: {known}. Somebody who is new has to be called so"
                ));
            }
            (Some(_), None) => match self.progress.free_place() {
                Some(place) => place,
                None => {
                    return refuse("every place of the plan is taken; it says how many there are".to_owned());
                }
            },
        };
        if !self.progress.people().contains_key(&participant) {
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
            return Err(StudyError::Person(format!("participant {id} has no session left")));
        };
        let (name, spot) = (session.session.clone(), self.progress.next_step(session));
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
            None => self.off_plan(participant, &name, today).map(|reason| (Deviation::OtherDay, reason)),
        };
        self.write(StudyEvent::Visited { participant, session: name.clone(), day })?;
        if let (Some((deviation, reason)), Some(spot), false) = (deviation, spot, rehearsal) {
            self.write(StudyEvent::Deviated { spot, deviation, reason })?;
        }
        Ok(name)
    }

    /// In words, if a session that begins on this day is not as many days after the one before as planned.
    pub fn off_plan(&self, participant: usize, session: &str, today: Date) -> Option<String> {
        let sessions = &self.study.plan.sessions;
        let index = sessions.iter().position(|other| other.name == session)?;
        let [fewest, most] = sessions[index].days_after?;
        let before = &sessions[index.checked_sub(1)?].name;
        let day = self.progress.days(participant, before).last()?;
        let since = |last: Date| last.until(today).map(|span| i64::from(span.get_days()));
        let Ok(days) = day.parse::<Date>().and_then(since) else {
            return Some(format!(
                "the session before was on {day:?} by the journal, which is no day before {today}"
            ));
        };
        let planned = i64::from(fewest)..=i64::from(most);
        (!planned.contains(&days))
            .then(|| format!("{days} days after the session before, {fewest} to {most} were planned"))
    }

    /// Begins the next attempt at a step, unless one is under way; the folder of its record if it is a trial.
    ///
    /// # Errors
    /// A step that is over, a disk that refuses.
    pub fn begin(&mut self, spot: &Spot) -> Result<Option<String>, StudyError> {
        let state = self.progress.step(spot);
        if state.open {
            return Ok(state.record);
        }
        let attempt = state.attempts + 1;
        let record = match self.progress.happening(spot) {
            Some(Happening::Trial(trial)) => {
                let again = if attempt > 1 { format!("-attempt{attempt}") } else { String::new() };
                Some(format!("{TRIALS_FOLDER}/{}{again}", record_name(trial)))
            }
            _ => None,
        };
        self.write(StudyEvent::StepBegan { spot: spot.clone(), attempt, record: record.clone() })?;
        Ok(record)
    }

    /// Ends the attempt that is under way. Of a trial that counts the journal keeps the digest.
    ///
    /// # Errors
    /// A step that was not begun, a record without a result, a disk that refuses.
    pub fn end(&mut self, spot: &Spot, outcome: StepOutcome) -> Result<i64, StudyError> {
        let StepState { attempts: attempt, record, .. } = self.progress.step(spot);
        let digest = match (outcome, record) {
            (StepOutcome::Done | StepOutcome::Aborted, Some(record)) => {
                Some(read_result::<TrialResult>(&self.study.folder.join(record))?.digest)
            }
            _ => None,
        };
        self.write(StudyEvent::StepEnded { spot: spot.clone(), attempt, outcome, digest })
    }

    /// Takes an answer, once it was checked; none takes the answer back.
    ///
    /// # Errors
    /// An answer that cannot be, a step that is no form, a disk that refuses.
    pub fn answer(&mut self, spot: &Spot, item: &str, answer: Option<Answer>) -> Result<i64, StudyError> {
        let Some(form) = self.progress.happening(spot).and_then(Happening::form) else {
            return Err(StudyError::Person(format!(
                "step {} of this session is no questionnaire",
                spot.step
            )));
        };
        let form = form.to_owned();
        if let Some(answer) = &answer {
            self.study.forms[&form].check_answer(item, answer, &self.study.conditions())?;
        }
        self.write(StudyEvent::Answered { spot: spot.clone(), form, item: item.to_owned(), answer })
    }
}

/// When an entry was written.
fn written_at(journal: &Journal, entry: &Entry<StudyEvent>) -> Result<Timestamp, StudyError> {
    Ok(entry.at.parse::<Timestamp>().map_err(|error| JournalError::Event {
        path: journal.path().to_owned(),
        id: entry.id,
        reason: format!(
            "it was written at {:?}, expected a time such as 2026-03-01T12:00:00Z: {error}",
            entry.at
        ),
    })?)
}

/// The text of the plan with this hash, which the journal keeps.
fn kept_plan(journal: &Journal, plan: &str) -> Result<String, StudyError> {
    let missing = || JournalError::NoText { path: journal.path().to_owned(), hash: plan.to_owned() };
    Ok(journal.text(plan)?.ok_or_else(missing)?)
}

/// Name of a trial's folder and of its bag, after the original's.
pub fn record_name(trial: &PlannedTrial) -> String {
    let plain = |c: char| if c.is_ascii_alphanumeric() || c == '_' { c } else { '_' };
    let mode: String = trial.condition.chars().map(plain).collect();
    format!("participant{}-mode{mode}-trial{}", trial.participant, trial.trial)
}

/// Where an attempt at a trial belongs, as its record says it.
pub(super) fn study_place(trial: &PlannedTrial, attempt: usize) -> StudyPlace {
    StudyPlace {
        participant: trial.participant,
        session: trial.session.clone(),
        condition: trial.condition.clone(),
        trial: trial.trial,
        attempt,
    }
}

/// The runs before.
#[derive(Clone, Debug)]
struct Before {
    /// With simulated participants, and of which kind.
    simulated: Option<People>,
    plan: String,
}

/// What the events of a journal make of the plan as it is now.
fn fold(
    study: &Study,
    journal: &Journal,
    entries: &[Entry<StudyEvent>],
) -> Result<(Option<Before>, Progress), StudyError> {
    let mut before: Option<Before> = None;
    let mut progress = Progress::new(study.schedule.clone());
    let changed = |what: String| StudyError::PlanChanged { file: study.folder.join(PLAN_FILE), what };
    for entry in entries {
        if let StudyEvent::RunBegan { simulated, people, plan, .. } = &entry.event
            && before.as_ref().is_none_or(|before| before.plan != *plan)
        {
            // Each event is understood by the plan that it was written under.
            let schedule = schedule_of(study, journal, plan)?.map_err(&changed)?;
            progress = progress.changed_to(schedule).map_err(&changed)?;
            let kind =
                people.as_deref().map_or(Ok(People::Competent), str::parse).map_err(StudyError::Person)?;
            before = Some(Before { simulated: simulated.then_some(kind), plan: plan.clone() });
        }
        progress.take(&entry.event)?;
    }
    let progress = progress.changed_to(study.schedule.clone()).map_err(&changed)?;
    if let Some(before) = &before {
        same_conditions(study, journal, &before.plan, &progress)?.map_err(changed)?;
    }
    Ok((before, progress))
}

/// Whether the conditions whose trials were begun are still what they were in the plan with this hash.
fn same_conditions(
    study: &Study,
    journal: &Journal,
    plan: &str,
    progress: &Progress,
) -> Result<Result<(), String>, StudyError> {
    if plan == hash_of(study.plan_text.as_bytes()) {
        return Ok(Ok(()));
    }
    let before = match Plan::from_text(&kept_plan(journal, plan)?) {
        Ok(before) => before,
        Err(error) => return Ok(Err(format!("the plan that it began with is none now, {error}"))),
    };
    for session in &progress.schedule().sessions {
        for (spot, happening) in progress.spots(session).zip(&session.happenings) {
            let Happening::Trial(trial) = happening else { continue };
            if progress.step(&spot).attempts == 0 {
                continue;
            }
            let choice = |plan: &Plan| {
                let condition = plan.conditions.iter().position(|own| own.name == trial.condition);
                condition.map(|condition| plan.choice(condition))
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
    if plan == hash_of(study.plan_text.as_bytes()) {
        return Ok(Ok(study.schedule.clone()));
    }
    let text = kept_plan(journal, plan)?;
    let schedule = Plan::from_text(&text).and_then(|plan| plan.schedule(&study.arrangements));
    Ok(schedule.map_err(|error| format!("the plan that it began with makes no schedule now, {error}")))
}

/// How far a study is, for who only looks: its progress, its journal, and whether its participants are simulated.
#[derive(Debug)]
pub struct Look {
    /// How far it is.
    pub progress: Progress,
    /// What happened.
    pub entries: Vec<Entry<StudyEvent>>,
    /// Participants and answers are simulated.
    pub simulated: bool,
}

/// How a study is looked at.
pub(super) struct LookOptions<'a> {
    /// Another pseudonym for a participant; none keeps the journal's.
    pub(super) rename: &'a dyn Fn(usize) -> Option<String>,
}

/// Looks at a study, which may be under way.
///
/// # Errors
/// As [`Conductor::take_up`].
pub fn look(study: &Study) -> Result<Look, StudyError> {
    look_with(study, &LookOptions { rename: &|_| None })
}

pub(super) fn look_with(study: &Study, options: &LookOptions<'_>) -> Result<Look, StudyError> {
    let path = study.folder.join(STUDY_FILE);
    if !path.is_file() {
        let progress = Progress::new(study.schedule.clone());
        return Ok(Look { progress, entries: Vec::new(), simulated: false });
    }
    let journal = Journal::read(&path)?;
    let mut entries = journal.entries::<StudyEvent>()?;
    for entry in &mut entries {
        if let StudyEvent::Enrolled { participant, id } = &mut entry.event
            && let Some(other) = (options.rename)(*participant)
        {
            *id = other;
        }
    }
    let (before, progress) = fold(study, &journal, &entries)?;
    Ok(Look { progress, entries, simulated: before.is_some_and(|before| before.simulated.is_some()) })
}

fn check_pseudonym(id: &str) -> Result<(), StudyError> {
    let plain = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
    if !id.is_empty() && id.len() <= 32 && id.chars().all(plain) {
        return Ok(());
    }
    Err(StudyError::Person(format!(
        "the participant is called {id:?}, expected a pseudonym of 1 to 32 letters, digits, - and _"
    )))
}
