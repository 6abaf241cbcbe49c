//! The tidy tables of a study: from its journal, and from the records of its trials.

mod armsym;
pub(crate) mod columns;
mod joint_data;
mod places;
pub(crate) mod trials;

use super::{Study, conductor::Look};
use proact_analysis::table::{Cell, Table};
use proact_control::MethodRegistry;
use proact_recording::journal::Entry;
use proact_study::{Deviation, FormItem, Happening, PlannedTrial, Spot, StepOutcome, StudyEvent};
use std::{
    collections::{BTreeMap, BTreeSet},
    error::Error,
    path::PathBuf,
};

/// All tables of a study as far as it is. `raw` adds gaze and shoulder sample by sample, which may tell who somebody is.
///
/// # Errors
/// A record that cannot be read, by its name.
pub fn tables(study: &Study, look: &Look, raw: bool) -> Result<Vec<Table>, Box<dyn Error>> {
    all_tables(&Told { study, look, times: times(&look.entries) }, raw, None)
}

/// Hands the events and joints of each trial that counts, as ArmSym writes them, to `write`.
///
/// # Errors
/// A record that cannot be read or recomputed, by its name; what `write` refuses.
pub(super) fn armsym_files(
    study: &Study,
    look: &Look,
    methods: &MethodRegistry,
    write: impl FnMut(armsym::TrialFiles) -> Result<(), Box<dyn Error>>,
) -> Result<(), Box<dyn Error>> {
    armsym::trial_files(&Told { study, look, times: times(&look.entries) }, methods, write)
}

/// The same without those records that cannot be read, and what is wrong with these.
///
/// # Errors
/// Answers that cannot be scored, a record in the folder of another, a result with a key or an outcome that is unknown.
pub(crate) fn readable_tables(
    study: &Study,
    look: &Look,
) -> Result<(Vec<Table>, Vec<String>), Box<dyn Error>> {
    let mut unread = Vec::new();
    let told = Told { study, look, times: times(&look.entries) };
    Ok((all_tables(&told, false, Some(&mut unread))?, unread))
}

/// Refuses a study of which a record is in the folder of another trial.
///
/// # Errors
/// The record by its name.
pub(super) fn check_places(study: &Study, look: &Look) -> Result<(), Box<dyn Error>> {
    places::check_all(&Told { study, look, times: Times::default() })
}

/// Every trial that counts: its key and where its record is.
pub(crate) fn counted_trials(study: &Study, look: &Look) -> Vec<(Vec<Cell>, PathBuf)> {
    let told = Told { study, look, times: times(&look.entries) };
    let record = |counted: Counted<'_>| (told.trial_key(counted.planned), study.folder.join(&counted.record));
    told.counted().into_iter().map(record).collect()
}

/// Questionnaires that were skipped, or are over and lack answers, in a sentence a person and questionnaire.
pub(crate) fn missing_answers(study: &Study, look: &Look) -> Vec<String> {
    let mut lacks: BTreeMap<(usize, &str), Vec<String>> = BTreeMap::new();
    for session in &look.progress.schedule().sessions {
        for (spot, happening) in look.progress.spots(session).zip(&session.happenings) {
            let state = look.progress.step(&spot);
            let Some(name) = happening.form() else { continue };
            let form = &study.forms[name];
            let told = match state.outcome {
                Some(StepOutcome::Done) => match form.missing(&state.answers).len() {
                    0 => continue,
                    missing => format!("{missing} of {} answers", form.keys().len()),
                },
                Some(StepOutcome::Skipped) => "all answers, skipped,".to_owned(),
                _ => continue,
            };
            let about =
                happening.condition().map_or(String::new(), |condition| format!(" about {condition}"));
            lacks.entry((spot.participant, name)).or_default().push(format!("{told}{about}"));
        }
    }
    let sentence = |((who, form), told): ((usize, &str), Vec<String>)| {
        format!("P{who}: {form} lacks {}", told.join(", "))
    };
    lacks.into_iter().map(sentence).collect()
}

fn all_tables(
    journal: &Told<'_>,
    raw: bool,
    unread: Option<&mut Vec<String>>,
) -> Result<Vec<Table>, Box<dyn Error>> {
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
struct Told<'a> {
    study: &'a Study,
    look: &'a Look,
    times: Times,
}

/// When what was begun, ended and answered, as RFC 3339.
#[derive(Default)]
struct Times {
    began: BTreeMap<(Spot, usize), String>,
    ended: BTreeMap<(Spot, usize), (String, StepOutcome)>,
    records: BTreeMap<(Spot, usize), String>,
    answered: BTreeMap<(Spot, String), String>,
}

fn times(entries: &[Entry<StudyEvent>]) -> Times {
    let mut times = Times::default();
    for Entry { at, event, .. } in entries {
        match event {
            StudyEvent::StepBegan { spot, attempt, record } => {
                times.began.insert((spot.clone(), *attempt), at.clone());
                if let Some(record) = record {
                    times.records.insert((spot.clone(), *attempt), record.clone());
                }
            }
            StudyEvent::StepEnded { spot, attempt, outcome, .. } => {
                times.ended.insert((spot.clone(), *attempt), (at.clone(), *outcome));
            }
            StudyEvent::Answered { spot, item, .. } => {
                times.answered.insert((spot.clone(), item.clone()), at.clone());
            }
            _ => {}
        }
    }
    times
}

/// A trial that counts: planned, begun and not done again.
struct Counted<'a> {
    planned: &'a PlannedTrial,
    spot: Spot,
    attempt: usize,
    record: String,
    /// That the journal has; none of older journals.
    digest: Option<String>,
}

impl Told<'_> {
    /// The pseudonym of a participant; nothing for a place that nobody has yet.
    fn id(&self, participant: usize) -> Cell {
        self.look.progress.people().get(&participant).cloned().into()
    }

    /// The trial at a spot.
    fn trial(&self, spot: &Spot) -> Option<&PlannedTrial> {
        match self.look.progress.happening(spot)? {
            Happening::Trial(trial) => Some(trial),
            Happening::Step(_) => None,
        }
    }

    /// Labels of what departs from the plan at these spots, each once.
    fn departures<'a>(&self, spots: impl Iterator<Item = &'a Spot>) -> String {
        let found: BTreeSet<Deviation> =
            spots.flat_map(|spot| self.look.progress.step(spot).deviations).collect();
        found.into_iter().map(Deviation::label).collect::<Vec<_>>().join(",")
    }

    /// Every trial of the plan whose newest attempt counts.
    fn counted(&self) -> Vec<Counted<'_>> {
        let progress = &self.look.progress;
        let mut counted = Vec::new();
        for session in &progress.schedule().sessions {
            for (spot, happening) in progress.spots(session).zip(&session.happenings) {
                let Happening::Trial(planned) = happening else { continue };
                let state = progress.step(&spot);
                let done = matches!(state.outcome, Some(StepOutcome::Done | StepOutcome::Aborted));
                if let (true, Some(record)) = (done, state.record) {
                    let (attempt, digest) = (state.attempts, state.digest);
                    counted.push(Counted { planned, spot, attempt, record, digest });
                }
            }
        }
        counted
    }

    fn participants(&self) -> Table {
        let progress = &self.look.progress;
        let mut table = Table::new("participants", "a participant of the plan", columns::PARTICIPANTS);
        for participant in 1..=self.study.plan.participants {
            let own: Vec<_> =
                progress.schedule().sessions.iter().filter(|own| own.participant == participant).collect();
            let spots: Vec<Spot> = own.iter().flat_map(|session| progress.spots(session)).collect();
            let over = own.iter().filter(|session| progress.next_step(session).is_none()).count();
            let trials = own.iter().flat_map(|own| progress.spots(own).zip(&own.happenings));
            let trials: Vec<bool> = trials
                .filter(|(_, happening)| matches!(happening, Happening::Trial(_)))
                .map(|(spot, _)| progress.step(&spot).outcome.is_some())
                .collect();
            let consent = spots.iter().find_map(|spot| {
                let form = &self.study.forms[progress.happening(spot)?.form()?];
                let item = form.items.iter().find(|item| matches!(item, FormItem::Consent { .. }))?;
                let answer = progress.step(spot).answers.get(item.key())?.to_cell();
                Some((answer, self.times.answered.get(&(spot.clone(), item.key().to_owned())).cloned()))
            });
            let (version, time) = consent.map_or((None, None), |(version, time)| (Some(version), time));
            table.push(vec![
                participant.into(),
                self.id(participant),
                self.look.simulated.into(),
                version.into(),
                time.into(),
                over.into(),
                own.len().into(),
                trials.iter().filter(|over| **over).count().into(),
                trials.len().into(),
                self.departures(spots.iter()).into(),
            ]);
        }
        table
    }

    fn sessions(&self) -> Table {
        let progress = &self.look.progress;
        let mut table = Table::new("sessions", "a session of a participant", columns::SESSIONS);
        for session in &progress.schedule().sessions {
            let spots: Vec<Spot> = progress.spots(session).collect();
            let own = |(spot, _): &(Spot, usize)| {
                spot.participant == session.participant && spot.session == session.session
            };
            let began = self.times.began.iter().filter(|(key, _)| own(key)).map(|(_, at)| at).min();
            let over = progress.next_step(session).is_none();
            let ends = self.times.ended.iter().filter(|(key, _)| own(key)).map(|(_, (at, _))| at);
            let ended = ends.max().filter(|_| over);
            let done = spots.iter().filter(|spot| progress.step(spot).outcome.is_some()).count();
            table.push(vec![
                session.participant.into(),
                self.id(session.participant),
                session.session.as_str().into(),
                began.cloned().into(),
                ended.cloned().into(),
                progress.days(session.participant, &session.session).join(",").into(),
                done.into(),
                spots.len().into(),
                self.departures(spots.iter()).into(),
            ]);
        }
        table
    }

    fn attempts(&self) -> Table {
        let mut table = Table::new("attempts", "a trial each time that it was begun", columns::ATTEMPTS);
        for (key, began) in &self.times.began {
            let (spot, attempt) = key;
            let Some(trial) = self.trial(spot) else { continue };
            let state = self.look.progress.step(spot);
            let ended = self.times.ended.get(key);
            let outcome = ended.map(|(_, outcome)| outcome_label(*outcome));
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
            ]);
            table.push(row);
        }
        table
    }

    /// What names a trial in every table: `participant`, `id`, `session`, `condition`, `trial`.
    fn trial_key(&self, trial: &PlannedTrial) -> Vec<Cell> {
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
        for Entry { at, event, .. } in &self.look.entries {
            let (spot, what, reason) = match event {
                StudyEvent::Deviated { spot, deviation, reason } => (spot, deviation.label(), reason),
                StudyEvent::Repeated { spot, reason } => (spot, Deviation::Repeated.label(), reason),
                _ => continue,
            };
            let happening = self.look.progress.happening(spot);
            table.push(vec![
                spot.participant.into(),
                self.id(spot.participant),
                spot.session.as_str().into(),
                happening.and_then(Happening::condition).into(),
                self.trial(spot).map(|trial| trial.trial).into(),
                happening.map(Happening::label).into(),
                what.into(),
                reason.as_str().into(),
                at.as_str().into(),
            ]);
        }
        table
    }

    fn checks(&self) -> Table {
        let mut table = Table::new("readiness", "a check before a trial", columns::READINESS);
        for Entry { at, event, .. } in &self.look.entries {
            let StudyEvent::Checked { spot, checks } = event else { continue };
            let Some(trial) = self.trial(spot) else { continue };
            for check in checks {
                let mut row = self.trial_key(trial);
                row.extend([
                    check.name.as_str().into(),
                    check.ready.into(),
                    check.found.as_str().into(),
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
        for Entry { id, at, event } in &self.look.entries {
            let spot = event.spot();
            let mut detail = serde_json::to_value(event)?;
            let kind = detail.as_object_mut().and_then(|object| {
                object.remove("spot");
                object.remove("kind")?.as_str().map(str::to_owned)
            });
            table.push(vec![
                (*id).into(),
                at.as_str().into(),
                spot.map(|spot| spot.participant).into(),
                spot.map(|spot| spot.session.clone()).into(),
                spot.map(|spot| spot.step).into(),
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
        let progress = &self.look.progress;
        for session in &progress.schedule().sessions {
            for (spot, happening) in progress.spots(session).zip(&session.happenings) {
                let state = progress.step(&spot);
                let (Some(name), Some(StepOutcome::Done)) = (happening.form(), state.outcome) else {
                    continue;
                };
                let form = &self.study.forms[name];
                let key = || -> Vec<Cell> {
                    vec![
                        spot.participant.into(),
                        self.id(spot.participant),
                        spot.session.as_str().into(),
                        happening.condition().into(),
                        name.into(),
                    ]
                };
                for item in form.keys() {
                    let answer = state.answers.get(&item).map(proact_study::Answer::to_cell);
                    let at = self.times.answered.get(&(spot.clone(), item.clone()));
                    let at = at.filter(|_| answer.is_some()).cloned();
                    let mut row = key();
                    row.extend([item.into(), answer.into(), at.into(), self.look.simulated.into()]);
                    answers.push(row);
                }
                for score in form.scores_of(&state.answers)? {
                    let mut row = key();
                    row.extend([
                        score.name.into(),
                        score.value.into(),
                        score.missing.join(",").into(),
                        self.look.simulated.into(),
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
