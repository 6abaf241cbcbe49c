use crate::{StudyPlan, StudyPlanError};
use serde::{Deserialize, Serialize};

/// From one arrangement of a participant to the next among all in a row, whose neighbours are alike.
const STRIDE: usize = 7;

/// Where the blocks stand in each trial.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "by", rename_all = "snake_case", deny_unknown_fields)]
pub enum Arrangements {
    /// All that the task has equally often, as far as the numbers allow. With `same` each participant has the same arrangements in each
    /// condition, in another order: conditions are compared on equal blocks. Without it each condition of a participant has
    /// others, so that nobody meets one twice while there are
    /// enough.
    Balanced {
        /// See above.
        #[serde(default = "yes")]
        same_for_all_conditions: bool,
    },
    /// As written down: a row for each participant, or one for all, of as many arrangements as a condition has trials, by the
    /// names that the task has for them.
    Table {
        /// Names of arrangements.
        rows: Vec<Vec<String>>,
    },
}

fn yes() -> bool {
    true
}

impl Arrangements {
    pub(crate) fn check(&self, plan: &StudyPlan) -> Result<(), StudyPlanError> {
        let Arrangements::Table { rows } = self else { return Ok(()) };
        if rows.len() != 1 && rows.len() != plan.participants {
            let expected = format!("1, or a row for each of the {} participants", plan.participants);
            return Err(StudyPlanError::value("the number of rows of arrangements", rows.len(), expected));
        }
        let trials = plan.trials_per_condition();
        for (k, row) in rows.iter().enumerate() {
            if row.len() != trials {
                let (got, expected) =
                    (format!("{} long", row.len()), format!("{trials}, the trials of a condition"));
                return Err(StudyPlanError::Row { table: "arrangements", row: k + 1, got, expected });
            }
        }
        Ok(())
    }

    /// Refuses names that are not among `pool`, those of the task.
    pub(crate) fn check_names(&self, pool: &[String]) -> Result<(), StudyPlanError> {
        if pool.is_empty() {
            let expected = "nothing: the task has no arrangements";
            return Err(StudyPlanError::value("arrangements", "given", expected));
        }
        let Arrangements::Table { rows } = self else { return Ok(()) };
        for (k, row) in rows.iter().enumerate() {
            if let Some(unknown) = row.iter().find(|name| !pool.contains(name)) {
                return Err(StudyPlanError::Unknown {
                    location: format!("row {} of arrangements", k + 1),
                    what: "arrangement",
                    got: unknown.clone(),
                    known: format!("{} and so on, {} in all", pool[0], pool.len()),
                });
            }
        }
        Ok(())
    }

    /// That of trial `trial` of the condition that `participant` meets in place `position`; all from 0.
    pub(crate) fn of(
        &self,
        plan: &StudyPlan,
        pool: &[String],
        participant: usize,
        position: usize,
        condition: usize,
        trial: usize,
    ) -> String {
        let trials = plan.trials_per_condition().max(1);
        let spread = |index: usize| pool[index * STRIDE % pool.len()].clone();
        match self {
            // Each in another trial, in the next place and for the next participant.
            Arrangements::Balanced { same_for_all_conditions: true } => {
                spread(participant * trials + (trial + position + participant) % trials)
            }
            Arrangements::Balanced { same_for_all_conditions: false } => {
                spread((condition + participant) * trials + (trial + position) % trials)
            }
            Arrangements::Table { rows } => {
                let row = if rows.len() == 1 { &rows[0] } else { &rows[participant] };
                row[trial].clone()
            }
        }
    }
}
