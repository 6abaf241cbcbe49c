//! Who simulated participants are: the one place that turns a person and what that person has done before into values of a trial's
//! configuration.

use proact_participants::{Population, PracticeHistory};
use proact_study::{
    DEFAULT_LIMIT_SECS, PlannedTrial, ScheduledSession, SessionItem, StudyPlan, TrialOptions,
};
use proact_types::Instruction;
use serde::{Deserialize, Serialize};
use std::{collections::BTreeMap, fmt, str::FromStr};

/// Which kind of simulated participant.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ParticipantKind {
    /// One who sees late and blinks, and otherwise does what is best: the participant of `proact demo`.
    #[default]
    Competent,
    /// One with delays, errors and habits, drawn from [`Population::standard`].
    Person,
}

impl ParticipantKind {
    /// Names of all kinds.
    pub const NAMES: [&str; 2] = ["competent", "person"];
}

impl FromStr for ParticipantKind {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        match name {
            "competent" => Ok(Self::Competent),
            "person" => Ok(Self::Person),
            _ => Err(format!("there are no people called {name:?}, expected {}", Self::NAMES.join(" or "))),
        }
    }
}

impl fmt::Display for ParticipantKind {
    fn fmt(&self, to: &mut fmt::Formatter<'_>) -> fmt::Result {
        to.write_str(match self {
            Self::Competent => "competent",
            Self::Person => "person",
        })
    }
}

/// What a person has done before a trial, and was told.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ParticipantHistory {
    /// Trials under the same condition.
    pub same_condition: usize,
    /// Trials in all.
    pub trials: usize,
    /// Since the session began, minutes, by the plan.
    #[serde(rename = "minutes")]
    pub minutes_since_session_start: f64,
    /// Number of the session, from 1.
    pub session: usize,
    /// What to do with the body.
    #[serde(default)]
    pub instruction: Instruction,
}

/// The trials of one participant's `sessions` in their order: the place of its condition among `choices`, and what the participant has
/// done before, were all to take as long as planned.
pub(crate) fn participant_histories<'a>(
    plan: &StudyPlan,
    sessions: &'a [ScheduledSession],
    choices: &[TrialOptions],
) -> Vec<(usize, &'a PlannedTrial, ParticipantHistory)> {
    let mut found: Vec<(usize, &PlannedTrial, ParticipantHistory)> = Vec::new();
    let mut before: BTreeMap<usize, usize> = BTreeMap::new();
    for session in sessions {
        let number = plan.sessions.iter().position(|own| own.name == session.session).unwrap_or(0);
        let between = plan.sessions[number].between_trials_minutes;
        let mut minutes = 0.0;
        for item in &session.items {
            let planned = match item {
                SessionItem::Step(planned) => {
                    minutes += planned.step.minutes();
                    continue;
                }
                SessionItem::Trial(planned) => planned,
            };
            let condition = plan.conditions.iter().position(|own| own.name == planned.condition);
            // A schedule names conditions of its plan alone.
            let condition = condition.unwrap_or(0);
            let same = before.entry(condition).or_default();
            let history = ParticipantHistory {
                same_condition: *same,
                trials: found.len(),
                minutes_since_session_start: minutes,
                session: number + 1,
                instruction: choices[condition].instruction.unwrap_or_default(),
            };
            *same += 1;
            minutes += choices[condition].limit_secs.unwrap_or(DEFAULT_LIMIT_SECS) / 60.0 + between;
            found.push((condition, planned, history));
        }
    }
    found
}

/// Values of the configuration of a trial of person `index` (from 1) among those that `master_seed` draws, as `--set` takes them.
pub fn participant_overrides(
    people: ParticipantKind,
    master_seed: u64,
    index: usize,
    history: &ParticipantHistory,
) -> Vec<String> {
    match people {
        // They differ by the seed of the trial alone.
        ParticipantKind::Competent => Vec::new(),
        ParticipantKind::Person => population_overrides(&Population::standard(), master_seed, index, history),
    }
}

/// The same for the people of a `population`.
pub fn population_overrides(
    population: &Population,
    master_seed: u64,
    index: usize,
    history: &ParticipantHistory,
) -> Vec<String> {
    let practice = PracticeHistory {
        trials_with_method: history.same_condition as u32,
        minutes: history.minutes_since_session_start,
        // The classifier is trained at the beginning of a session.
        minutes_since_training: history.minutes_since_session_start,
        days_before: history.session.saturating_sub(1) as u32,
        instruction: history.instruction,
    };
    let options = population.person(master_seed, index as u32, &practice);
    let table = toml::Value::try_from(options).expect("numbers in tables are TOML");
    vec![format!("participant={table}")]
}

#[cfg(test)]
mod tests {
    use super::*;
    use proact_testbed::{Setup, TrialConfig};

    #[test]
    fn a_person_is_the_same_in_each_trial_but_for_what_was_learnt() {
        let trial = TrialConfig::new("A", 1, Setup::named("seated").unwrap());
        let person = |index, same_condition| {
            let history = ParticipantHistory { same_condition, session: 1, ..ParticipantHistory::default() };
            let values = participant_overrides(ParticipantKind::Person, 4, index, &history);
            trial.with_overrides(&values).unwrap().participant.unwrap()
        };
        assert_eq!(person(1, 0), person(1, 0));
        assert_ne!(person(1, 0), person(2, 0));
        assert_eq!(person(1, 0).reaction_ms, person(1, 2).reaction_ms);
        assert!(person(1, 2).person.decision_time_ms < person(1, 0).person.decision_time_ms);
        let mean_score = |instruction| {
            let history = ParticipantHistory { instruction, session: 1, ..ParticipantHistory::default() };
            let values = participant_overrides(ParticipantKind::Person, 4, 1, &history);
            trial.with_overrides(&values).unwrap().participant.unwrap().person.trunk_share
        };
        assert!(mean_score(Instruction::LimitBody) < mean_score(Instruction::Free));
        assert!(
            participant_overrides(ParticipantKind::Competent, 4, 1, &ParticipantHistory::default())
                .is_empty()
        );
        assert!(
            ParticipantKind::NAMES
                .iter()
                .all(|name| name.parse::<ParticipantKind>().unwrap().to_string() == *name)
        );
    }
}
