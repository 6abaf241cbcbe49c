//! The tidy tables of a study: from its journal, and from the records of its trials.

mod armsym;
pub(crate) mod columns;
mod joint_data;
mod misplaced_record;
pub(crate) mod trials;

pub(crate) use misplaced_record::MisplacedRecord;

use super::{STUDY_FILE, Study, conductor::StudyView};
use crate::analysis::Flaw;
use proact_analysis::table::{Table, TableCell};
use proact_control::MethodRegistry;
use proact_recording::journal::JournalEntry;
use proact_study::{Deviation, FormItem, PlannedTrial, SessionItem, StepId, StepOutcome, StudyEvent};
use std::{
    collections::{BTreeMap, BTreeSet},
    error::Error,
    path::PathBuf,
};

/// All tables of a study as far as it is. `raw` adds gaze and shoulder sample by sample, which may tell who somebody is.
///
/// # Errors
/// A record that cannot be read, by its name.
pub fn tables(study: &Study, view: &StudyView, raw: bool) -> Result<Vec<Table>, Box<dyn Error>> {
    all_tables(&StudyTables { study, view, times: times(&view.entries) }, raw, None)
}

/// Hands the events and joints of each trial that counts, as ArmSym writes them, to `write`.
///
/// # Errors
/// A record that cannot be read or recomputed, by its name; what `write` refuses.
pub(super) fn armsym_files(
    study: &Study,
    view: &StudyView,
    methods: &MethodRegistry,
    write: impl FnMut(armsym::ArmSymTrialFiles) -> Result<(), Box<dyn Error>>,
) -> Result<(), Box<dyn Error>> {
    armsym::trial_files(&StudyTables { study, view, times: times(&view.entries) }, methods, write)
}

/// The same without those records that cannot be read, and what is wrong with these.
///
/// # Errors
/// Answers that cannot be scored, a record in the folder of another, a result with a key or an outcome that is unknown.
pub(crate) fn readable_tables(
    study: &Study,
    view: &StudyView,
) -> Result<(Vec<Table>, Vec<String>), Box<dyn Error>> {
    let mut unread = Vec::new();
    let tables = StudyTables { study, view, times: times(&view.entries) };
    Ok((all_tables(&tables, false, Some(&mut unread))?, unread))
}

/// Refuses a journal with an answer to a question that no questionnaire of the study has: it would be missing from every score.
///
/// # Errors
/// The questionnaire or the question by its name.
pub(super) fn check_answers(study: &Study, view: &StudyView) -> Result<(), String> {
    for JournalEntry { event, .. } in &view.entries {
        let StudyEvent::Answered { step_id, form, item, .. } = event else { continue };
        let participant = step_id.participant;
        let Some(known) = study.forms.get(form) else {
            return Err(format!(
                "{STUDY_FILE}: an answer of P{participant} is to the questionnaire {form:?}, which the study does not have"
            ));
        };
        let keys = known.keys();
        if !keys.iter().any(|key| key == item) {
            return Err(format!(
                "{STUDY_FILE}: an answer of P{participant} is to {item:?}, which the questionnaire {form} does not ask"
            ));
        }
    }
    Ok(())
}

/// What is wrong with the records of the trials that count, a sentence each: missing, unreadable, or in the folder of another trial.
pub(super) fn faulty_records(study: &Study, view: &StudyView) -> Vec<String> {
    misplaced_record::faulty_records(&StudyTables { study, view, times: EventTimes::default() })
}

/// Every trial that counts: its key and where its record is.
pub(crate) fn counted_trial_records(study: &Study, view: &StudyView) -> Vec<(Vec<TableCell>, PathBuf)> {
    let tables = StudyTables { study, view, times: times(&view.entries) };
    let record =
        |counted: CountedTrial<'_>| (tables.trial_key(counted.planned), study.folder.join(&counted.record));
    tables.counted_trials().into_iter().map(record).collect()
}

/// Questionnaires that were skipped, or are over and lack answers, in a sentence a person and questionnaire.
pub(crate) fn missing_answers(study: &Study, view: &StudyView) -> Vec<String> {
    let mut gaps_by_form: BTreeMap<(usize, &str), Vec<String>> = BTreeMap::new();
    for session in &view.progress.schedule().sessions {
        for (step_id, item) in view.progress.step_ids(session).zip(&session.items) {
            let state = view.progress.step(&step_id);
            let Some(name) = item.form() else { continue };
            let form = &study.forms[name];
            let state_text = match state.outcome {
                Some(StepOutcome::Done) => match form.missing(&state.answers).len() {
                    0 => continue,
                    missing => format!("{missing} of {} answers", form.keys().len()),
                },
                Some(StepOutcome::Skipped) => "all answers, skipped,".to_owned(),
                _ => continue,
            };
            let about = item.condition().map_or(String::new(), |condition| format!(" about {condition}"));
            gaps_by_form.entry((step_id.participant, name)).or_default().push(format!("{state_text}{about}"));
        }
    }
    let sentence = |((who, form), gaps): ((usize, &str), Vec<String>)| {
        format!("P{who}: {form} lacks {}", gaps.join(", "))
    };
    gaps_by_form.into_iter().map(sentence).collect()
}

fn all_tables(
    journal: &StudyTables<'_>,
    raw: bool,
    unread: Option<&mut Vec<String>>,
) -> Result<Vec<Table>, Box<dyn Error>> {
    check_answers(journal.study, journal.view)?;
    let mut tables = vec![
        journal.participants(),
        journal.sessions(),
        journal.attempts(),
        journal.deviations(),
        journal.checks(),
        journal.events()?,
    ];
    tables.extend(journal.questionnaires()?);
    tables.extend(trials::tables(journal, raw, unread)?);
    Ok(tables)
}

/// What the journal tells, with the plan beside it.
struct StudyTables<'a> {
    study: &'a Study,
    view: &'a StudyView,
    times: EventTimes,
}

/// When what was begun, ended and answered, as RFC 3339.
#[derive(Default)]
struct EventTimes {
    began: BTreeMap<(StepId, usize), String>,
    ended: BTreeMap<(StepId, usize), (String, StepOutcome)>,
    records: BTreeMap<(StepId, usize), String>,
    answered: BTreeMap<(StepId, String), String>,
}

fn times(entries: &[JournalEntry<StudyEvent>]) -> EventTimes {
    let mut times = EventTimes::default();
    for JournalEntry { written_at: at, event, .. } in entries {
        match event {
            StudyEvent::StepBegan { step_id, attempt, record } => {
                times.began.insert((step_id.clone(), *attempt), at.clone());
                if let Some(record) = record {
                    times.records.insert((step_id.clone(), *attempt), record.clone());
                }
            }
            StudyEvent::StepEnded { step_id, attempt, outcome, .. } => {
                times.ended.insert((step_id.clone(), *attempt), (at.clone(), *outcome));
            }
            StudyEvent::Answered { step_id, item, .. } => {
                times.answered.insert((step_id.clone(), item.clone()), at.clone());
            }
            _ => {}
        }
    }
    times
}

/// A trial that counts: planned, begun and not done again.
struct CountedTrial<'a> {
    planned: &'a PlannedTrial,
    step_id: StepId,
    attempt: usize,
    record: String,
    /// That the journal has; none of older journals.
    digest: Option<String>,
}

impl StudyTables<'_> {
    /// The pseudonym of a participant; nothing for a place that nobody has yet.
    fn id(&self, participant: usize) -> TableCell {
        self.view.progress.pseudonyms().get(&participant).cloned().into()
    }

    /// The trial at a spot.
    fn trial(&self, step_id: &StepId) -> Option<&PlannedTrial> {
        match self.view.progress.item(step_id)? {
            SessionItem::Trial(trial) => Some(trial),
            SessionItem::Step(_) => None,
        }
    }

    /// Labels of what departs from the plan at these spots, each once.
    fn deviation_labels<'a>(&self, step_ids: impl Iterator<Item = &'a StepId>) -> String {
        let found: BTreeSet<Deviation> =
            step_ids.flat_map(|step_id| self.view.progress.step(step_id).deviations).collect();
        found.into_iter().map(Deviation::label).collect::<Vec<_>>().join(",")
    }

    /// Every trial of the plan whose newest attempt counts.
    fn counted_trials(&self) -> Vec<CountedTrial<'_>> {
        let progress = &self.view.progress;
        let mut counted = Vec::new();
        for session in &progress.schedule().sessions {
            for (step_id, item) in progress.step_ids(session).zip(&session.items) {
                let SessionItem::Trial(planned) = item else { continue };
                let state = progress.step(&step_id);
                let done = matches!(state.outcome, Some(StepOutcome::Done | StepOutcome::Aborted));
                if let (true, Some(record)) = (done, state.record) {
                    let (attempt, digest) = (state.attempts, state.digest);
                    counted.push(CountedTrial { planned, step_id, attempt, record, digest });
                }
            }
        }
        counted
    }

    fn participants(&self) -> Table {
        let progress = &self.view.progress;
        let mut table = Table::new("participants", "a participant of the plan", columns::PARTICIPANTS);
        for participant in 1..=self.study.plan.participants {
            let own: Vec<_> =
                progress.schedule().sessions.iter().filter(|own| own.participant == participant).collect();
            let step_ids: Vec<StepId> = own.iter().flat_map(|session| progress.step_ids(session)).collect();
            let over = own.iter().filter(|session| progress.next_step(session).is_none()).count();
            let trials = own.iter().flat_map(|own| progress.step_ids(own).zip(&own.items));
            let trials: Vec<bool> = trials
                .filter(|(_, session_item)| matches!(session_item, SessionItem::Trial(_)))
                .map(|(step_id, _)| progress.step(&step_id).outcome.is_some())
                .collect();
            let consent = step_ids.iter().find_map(|step_id| {
                let form = &self.study.forms[progress.item(step_id)?.form()?];
                let item = form.items.iter().find(|item| matches!(item, FormItem::Consent { .. }))?;
                let answer = progress.step(step_id).answers.get(item.key())?.to_cell();
                Some((answer, self.times.answered.get(&(step_id.clone(), item.key().to_owned())).cloned()))
            });
            let (version, time) = consent.map_or((None, None), |(version, time)| (Some(version), time));
            table.push(vec![
                participant.into(),
                self.id(participant),
                self.view.simulated.into(),
                version.into(),
                time.into(),
                over.into(),
                own.len().into(),
                trials.iter().filter(|over| **over).count().into(),
                trials.len().into(),
                self.deviation_labels(step_ids.iter()).into(),
            ]);
        }
        table
    }

    fn sessions(&self) -> Table {
        let progress = &self.view.progress;
        let mut table = Table::new("sessions", "a session of a participant", columns::SESSIONS);
        for session in &progress.schedule().sessions {
            let step_ids: Vec<StepId> = progress.step_ids(session).collect();
            let own = |(step_id, _): &(StepId, usize)| {
                step_id.participant == session.participant && step_id.session == session.session
            };
            let began = self.times.began.iter().filter(|(key, _)| own(key)).map(|(_, at)| at).min();
            let over = progress.next_step(session).is_none();
            let ends = self.times.ended.iter().filter(|(key, _)| own(key)).map(|(_, (at, _))| at);
            let ended = ends.max().filter(|_| over);
            let done = step_ids.iter().filter(|step_id| progress.step(step_id).outcome.is_some()).count();
            table.push(vec![
                session.participant.into(),
                self.id(session.participant),
                session.session.as_str().into(),
                began.cloned().into(),
                ended.cloned().into(),
                progress.days(session.participant, &session.session).join(",").into(),
                done.into(),
                step_ids.len().into(),
                self.deviation_labels(step_ids.iter()).into(),
            ]);
        }
        table
    }

    fn attempts(&self) -> Table {
        let mut table = Table::new("attempts", "a trial each time that it was begun", columns::ATTEMPTS);
        for (key, began) in &self.times.began {
            let (step_id, attempt) = key;
            let Some(trial) = self.trial(step_id) else { continue };
            let state = self.view.progress.step(step_id);
            let ended = self.times.ended.get(key);
            let outcome = ended.map(|(_, outcome)| outcome_label(*outcome));
            let broken_off = matches!(ended, Some((_, StepOutcome::Aborted | StepOutcome::Interrupted)));
            let counts = *attempt == state.attempts && state.outcome.is_some();
            let record = self.times.records.get(key).cloned();
            let mut row = self.trial_key(trial);
            row.extend([
                (*attempt).into(),
                began.as_str().into(),
                ended.map(|(at, _)| at.clone()).into(),
                outcome.into(),
                counts.into(),
                record.into(),
                broken_off.then(|| Flaw::Interrupted.label()).into(),
            ]);
            table.push(row);
        }
        table
    }

    /// What names a trial in every table: `participant`, `id`, `session`, `condition`, `trial`.
    fn trial_key(&self, trial: &PlannedTrial) -> Vec<TableCell> {
        vec![
            trial.participant.into(),
            self.id(trial.participant),
            trial.session.as_str().into(),
            trial.condition.as_str().into(),
            trial.trial.into(),
        ]
    }

    fn deviations(&self) -> Table {
        let mut table = Table::new("deviations", "a departure from the plan", columns::DEVIATIONS);
        for JournalEntry { written_at: at, event, .. } in &self.view.entries {
            let (step_id, what, reason) = match event {
                StudyEvent::Deviated { step_id, deviation, reason } => (step_id, deviation.label(), reason),
                StudyEvent::Repeated { step_id, reason } => (step_id, Deviation::Repeated.label(), reason),
                _ => continue,
            };
            let item = self.view.progress.item(step_id);
            table.push(vec![
                step_id.participant.into(),
                self.id(step_id.participant),
                step_id.session.as_str().into(),
                item.and_then(SessionItem::condition).into(),
                self.trial(step_id).map(|trial| trial.trial).into(),
                item.map(SessionItem::label).into(),
                what.into(),
                reason.as_str().into(),
                at.as_str().into(),
            ]);
        }
        table
    }

    fn checks(&self) -> Table {
        let mut table = Table::new("readiness", "a check before a trial", columns::READINESS);
        for JournalEntry { written_at: at, event, .. } in &self.view.entries {
            let StudyEvent::Checked { step_id, checks } = event else { continue };
            let Some(trial) = self.trial(step_id) else { continue };
            for check in checks {
                let mut row = self.trial_key(trial);
                row.extend([
                    check.name.as_str().into(),
                    check.ready.into(),
                    check.detail.as_str().into(),
                    check.age_secs.into(),
                    at.as_str().into(),
                ]);
                table.push(row);
            }
        }
        table
    }

    fn events(&self) -> Result<Table, serde_json::Error> {
        let mut table = Table::new("events", "something that happened in the study", columns::EVENTS);
        for JournalEntry { id, written_at: at, event } in &self.view.entries {
            let step_id = event.step_id();
            let mut detail = serde_json::to_value(event)?;
            let kind = detail.as_object_mut().and_then(|object| {
                object.remove("spot");
                object.remove("kind")?.as_str().map(str::to_owned)
            });
            table.push(vec![
                (*id).into(),
                at.as_str().into(),
                step_id.map(|step_id| step_id.participant).into(),
                step_id.map(|step_id| step_id.session.clone()).into(),
                step_id.map(|step_id| step_id.step).into(),
                kind.into(),
                detail.to_string().into(),
            ]);
        }
        Ok(table)
    }

    /// Answers and scores, of every questionnaire that is over.
    fn questionnaires(&self) -> Result<[Table; 2], Box<dyn Error>> {
        let mut answers = Table::new("answers", "a question of a questionnaire", columns::ANSWERS);
        let mut scores = Table::new("scores", "a score of a questionnaire", columns::SCORES);
        let progress = &self.view.progress;
        for session in &progress.schedule().sessions {
            for (step_id, session_item) in progress.step_ids(session).zip(&session.items) {
                let state = progress.step(&step_id);
                let (Some(name), Some(StepOutcome::Done)) = (session_item.form(), state.outcome) else {
                    continue;
                };
                let form = &self.study.forms[name];
                let key = || -> Vec<TableCell> {
                    vec![
                        step_id.participant.into(),
                        self.id(step_id.participant),
                        step_id.session.as_str().into(),
                        session_item.condition().into(),
                        name.into(),
                    ]
                };
                for item in form.keys() {
                    let answer = state.answers.get(&item).map(proact_study::FormAnswer::to_cell);
                    let at = self.times.answered.get(&(step_id.clone(), item.clone()));
                    let at = at.filter(|_| answer.is_some()).cloned();
                    let mut row = key();
                    row.extend([item.into(), answer.into(), at.into(), self.view.simulated.into()]);
                    answers.push(row);
                }
                for score in form.scores_of(&state.answers)? {
                    let mut row = key();
                    row.extend([
                        score.name.into(),
                        score.value.into(),
                        score.missing.join(",").into(),
                        self.view.simulated.into(),
                    ]);
                    scores.push(row);
                }
            }
        }
        Ok([answers, scores])
    }
}

fn outcome_label(outcome: StepOutcome) -> &'static str {
    match outcome {
        StepOutcome::Done => "done",
        StepOutcome::Aborted => "aborted",
        StepOutcome::Interrupted => "interrupted",
        StepOutcome::Skipped => "skipped",
    }
}
