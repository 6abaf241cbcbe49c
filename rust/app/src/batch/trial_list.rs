//! Which trials a batch has, and in which order.

use super::{BatchDescription, Sweep, description::values_hash};
use crate::{
    Registry,
    method_process::read_method_file,
    study::{
        ParticipantHistory, ParticipantKind, Study, TrialJob, participant_histories, participant_overrides,
    },
    trial_choice::is_external_method_file,
};
use proact_recording::sha256_of_bytes;
use proact_study::TrialOptions;
use proact_types::Instruction;
use serde::{Deserialize, Serialize};
use std::{error::Error, path::Path};

/// Varies what people are told.
const INSTRUCTION: &str = "instruction";
/// More trials than this are most likely a slip.
const MAX_TRIALS: usize = 1_000_000;
/// From the begin of a trial of a batch without a plan to the next, minutes: the longest that the paper's trials take, and a break.
const DEFAULT_TRIAL_INTERVAL_MINUTES: f64 = 6.0;

/// A trial of a batch. All numbers count from 1, but for `index`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct BatchTrial {
    /// Its place in the batch, from 0.
    pub index: usize,
    /// The cell of the sweep, from 0.
    pub cell: usize,
    /// Whose.
    pub participant: usize,
    /// In which session, if there is a plan.
    pub session: Option<String>,
    /// Of which condition, by its place among those of the batch, from 0.
    pub condition: usize,
    /// Place of the condition in the participant's order, if there is a plan.
    pub position: Option<usize>,
    /// Among the participant's trials of the condition.
    pub trial: usize,
    /// Of every random stream of the trial.
    pub seed: u64,
    /// Where the blocks stand, by the task's name for it; by the seed if left out.
    pub arrangement: Option<String>,
    /// What the participant has done before.
    pub history: ParticipantHistory,
}

/// What a condition is called with the values of a cell.
pub(crate) fn label(condition: &str, values: &[(&str, &str)]) -> String {
    let values = values.iter().map(|(key, value)| format!(", {key}={value}"));
    values.fold(condition.to_owned(), |label, value| label + &value)
}

/// A list of trials in a stated order: cell by cell of the sweep; within a cell as a plan's schedule has them, or condition by
/// condition, person by person, trial by trial where there is no plan.
#[derive(Clone, Debug)]
pub struct Batch {
    /// What is compared: a name, and what its trials are.
    pub conditions: Vec<(String, TrialOptions)>,
    /// What is varied.
    pub sweep: Sweep,
    /// Draws the people.
    pub seed: u64,
    /// Which kind they are of.
    pub participant_kind: ParticipantKind,
    /// How many.
    pub participants: usize,
    /// The trials of the first cell.
    rows: Vec<BatchTrial>,
    /// What says which trials these are: the plan's text, or the numbers.
    source: String,
}

/// A batch without a plan: every person does so many trials by each method, always with the same seeds.
#[derive(Clone, Debug)]
pub struct MethodsBatch {
    /// Methods by name, or the files of outside ones.
    pub methods: Vec<String>,
    /// What all trials have in common.
    pub common: TrialOptions,
    /// People.
    pub participants: usize,
    /// Trials of each by each method.
    pub trials: usize,
    /// Seed of the first trial of the first person; each further one has the next.
    pub seed: u64,
}

impl Batch {
    /// The trials of a study, of which each condition gets `over` as well.
    ///
    /// # Errors
    /// Too many trials.
    pub fn of_study(
        study: &Study,
        over: &TrialOptions,
        people: ParticipantKind,
        sweep: Sweep,
    ) -> Result<Self, Box<dyn Error>> {
        let conditions = study.plan.conditions.iter().enumerate();
        let conditions = conditions
            .map(|(k, own)| (own.name.clone(), over.with_defaults_from(&study.plan.trial_options(k))));
        let mut batch = Self {
            conditions: conditions.collect(),
            sweep,
            seed: study.plan.seed,
            participant_kind: people,
            participants: study.plan.participants,
            rows: Vec::new(),
            source: format!("plan {}", sha256_of_bytes(study.plan_text.as_bytes())),
        };
        let choices: Vec<TrialOptions> = batch.conditions.iter().map(|(_, choice)| choice.clone()).collect();
        for own in study.schedule.sessions.chunk_by(|a, b| a.participant == b.participant) {
            for (condition, planned, history) in participant_histories(&study.plan, own, &choices) {
                batch.rows.push(BatchTrial {
                    index: 0,
                    cell: 0,
                    participant: planned.participant,
                    session: Some(planned.session.clone()),
                    condition,
                    position: Some(planned.position),
                    trial: planned.trial,
                    seed: planned.seed,
                    arrangement: planned.arrangement.clone(),
                    history,
                });
            }
        }
        batch.check_trial_count()
    }

    /// The trials of some methods.
    ///
    /// # Errors
    /// The file of a method that is none, a method twice, too many trials.
    pub fn of_methods(
        list: &MethodsBatch,
        people: ParticipantKind,
        sweep: Sweep,
    ) -> Result<Self, Box<dyn Error>> {
        let MethodsBatch { methods, common, participants, trials, seed } = list;
        let mut conditions: Vec<(String, TrialOptions)> = Vec::new();
        for method in methods {
            let file = is_external_method_file(method).then(|| std::path::absolute(method)).transpose()?;
            let name = match &file {
                Some(file) => read_method_file(Path::new(file))?.info().name.clone(),
                None => method.clone(),
            };
            if conditions.iter().any(|(other, _)| *other == name) {
                return Err(format!("method {name:?} is there twice, expected each once").into());
            }
            let method = file.map_or_else(|| method.clone(), |file| file.display().to_string());
            conditions.push((name, TrialOptions { method: Some(method), ..common.clone() }));
        }
        let mut rows = Vec::new();
        let all = conditions.len().saturating_mul(*participants).saturating_mul(*trials);
        if all <= MAX_TRIALS {
            for condition in 0..conditions.len() {
                for participant in 1..=*participants {
                    for trial in 1..=*trials {
                        // Each method is met as the first one: nobody has learnt by another.
                        let before = trial - 1;
                        let history = ParticipantHistory {
                            same_condition: before,
                            trials: before,
                            minutes_since_session_start: before as f64 * DEFAULT_TRIAL_INTERVAL_MINUTES,
                            session: 1,
                            instruction: common.instruction.unwrap_or_default(),
                        };
                        let number = (participant - 1) * trials + before;
                        rows.push(BatchTrial {
                            index: 0,
                            cell: 0,
                            participant,
                            session: None,
                            condition,
                            position: None,
                            trial,
                            // Files of configuration hold no number beyond this.
                            seed: seed.wrapping_add(number as u64) & (u64::MAX >> 1),
                            arrangement: None,
                            history,
                        });
                    }
                }
            }
        }
        let source = format!("{trials} trials of {participants} people by each method");
        let batch = Self {
            conditions,
            sweep,
            seed: *seed,
            participant_kind: people,
            participants: *participants,
            rows,
            source,
        };
        batch.check_trial_count()
    }

    fn check_trial_count(self) -> Result<Self, Box<dyn Error>> {
        let count = self.rows.len().saturating_mul(self.sweep.cells());
        if count == 0 || count > MAX_TRIALS {
            return Err(format!("the batch has {count} trials, expected 1 to {MAX_TRIALS}").into());
        }
        if let Some(key) = self.sweep.keys().position(|key| key == INSTRUCTION) {
            for value in self.sweep.values(key) {
                value.parse::<Instruction>()?;
            }
        }
        Ok(self)
    }

    /// How many trials there are.
    pub fn count(&self) -> usize {
        self.rows.len() * self.sweep.cells()
    }

    /// The trial in a place, from 0, below [`Batch::count_sample`].
    pub fn trial(&self, index: usize) -> BatchTrial {
        let (cell, row) = (index / self.rows.len(), index % self.rows.len());
        let mut trial = BatchTrial { index, cell, ..self.rows[row].clone() };
        let varied = self.sweep.cell(cell).into_iter().find(|(key, _)| *key == INSTRUCTION);
        if let Some((_, value)) = varied {
            trial.history.instruction = value.parse().expect("each was read when the batch was made");
        }
        trial
    }

    /// What a trial is called in tables: its condition, with the values of its cell.
    pub fn label(&self, trial: &BatchTrial) -> String {
        label(&self.conditions[trial.condition].0, &self.sweep.cell(trial.cell))
    }

    /// The trial as an order.
    pub fn trial_job(&self, trial: &BatchTrial) -> TrialJob {
        let mut choice = self.conditions[trial.condition].1.clone();
        let person =
            participant_overrides(self.participant_kind, self.seed, trial.participant, &trial.history);
        // What is asked for by name has the last word about a person.
        choice.set.splice(0..0, person);
        for (key, value) in self.sweep.cell(trial.cell) {
            let value = value.to_owned();
            match (key, value.parse()) {
                ("method", _) => choice.method = Some(value),
                ("task", _) => choice.task = Some(value),
                ("arm", _) => choice.arm = Some(value),
                ("setup", _) => choice.setup = Some(value),
                // It is in the person already.
                (INSTRUCTION, _) => {}
                ("profile", _) => choice.profile = Some(value),
                ("limit_secs", Ok(secs)) => choice.limit_secs = Some(secs),
                _ => choice.set.push(format!("{key}={value}")),
            }
        }
        TrialJob {
            options: choice,
            seed: trial.seed,
            arrangement: trial.arrangement.clone(),
            dir: None,
            bag: String::new(),
            study_place: None,
            with_scores: true,
        }
    }

    /// Makes the first trial of each condition in each cell, and says what the batch is.
    ///
    /// # Errors
    /// A name that means nothing, a value out of range; with its condition. `interrupted` by Ctrl-C.
    pub fn describe(&self, registry: &Registry, shards: usize) -> Result<BatchDescription, Box<dyn Error>> {
        let mut texts = Vec::new();
        for cell in 0..self.sweep.cells() {
            for condition in 0..self.conditions.len() {
                let first = self.rows.iter().find(|row| row.condition == condition);
                let Some(first) = first.map(|first| BatchTrial { cell, ..first.clone() }) else { continue };
                let made = self.trial_job(&first).config(registry, None);
                let (arm, config) = made.map_err(|error| format!("{}: {error}", self.label(&first)))?;
                // The arm's name does not say what is in its folder; the text of a task is in the configuration.
                texts.push(format!("{}\n{}", config.to_toml()?, arm.pinned().hash.unwrap_or_default()));
            }
        }
        Ok(BatchDescription {
            program: env!("CARGO_PKG_VERSION").to_owned(),
            source: self.source.clone(),
            conditions: self.conditions.iter().map(|(name, _)| name.clone()).collect(),
            vary: self.sweep.to_arguments(),
            participant_kind: self.participant_kind.to_string(),
            participants: self.participants,
            seed: self.seed,
            trials: self.count(),
            shards,
            config_hash: values_hash(&texts),
            note: super::SIMULATED_DISCLAIMER.to_owned(),
        })
    }
}
