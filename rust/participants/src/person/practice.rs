use super::PersonTraits;
use proact_types::Instruction;
use serde::{Deserialize, Serialize};

/// What a person has done before a trial.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PracticeHistory {
    /// Trials with the same method, in all sessions.
    pub trials_with_method: u32,
    /// Minutes since this day's session began.
    pub minutes: f64,
    /// Minutes since the classifier was trained the last time.
    pub minutes_since_training: f64,
    /// Days with a session before this one.
    pub days_before: u32,
    /// What was asked for.
    pub instruction: Instruction,
}

/// How practice and time change a person. All assumed; the power law of practice has exponents of 0.2 to 0.6 in many tasks
/// (Newell and Rosenbloom 1981).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Learning {
    /// Thinking takes `(1 + trials)^-exponent` of the time of the first trial.
    pub practice_exponent: f64,
    /// Share of what is not known yet that a trial leaves unknown.
    pub unlearned_share_per_trial: f64,
    /// Confusions grow by this share in an hour of work, by fatigue.
    pub fatigue_per_hour: f64,
    /// ... and by this share in an hour since the classifier was trained, by drift.
    pub drift_per_hour: f64,
    /// Share of the confusions that another day leaves: the gestures become clearer.
    pub confusion_retention_per_day: f64,
    /// Share of the use of the trunk that [`Instruction::LimitBody`] leaves.
    pub trunk_share_when_limited: f64,
}

impl Learning {
    /// Who `person` is after `practice`.
    pub fn after_practice(&self, person: &PersonTraits, practice: &PracticeHistory) -> PersonTraits {
        let trials = f64::from(practice.trials_with_method);
        let by_practice = (1.0 + trials).powf(-self.practice_exponent);
        let unknown = self.unlearned_share_per_trial.powf(trials);
        let hours = practice.minutes.max(0.0) / 60.0;
        let since_training = practice.minutes_since_training.max(0.0) / 60.0;
        let worse = (1.0 + self.fatigue_per_hour * hours) * (1.0 + self.drift_per_hour * since_training);
        let days = self.confusion_retention_per_day.powi(practice.days_before.min(30) as i32);
        let body = match practice.instruction {
            Instruction::Free => 1.0,
            Instruction::LimitBody => self.trunk_share_when_limited,
        };
        PersonTraits {
            decision_time_ms: (person.decision_time_ms as f64 * by_practice) as u64,
            confusions_per_min: (person.confusions_per_min * worse * days).min(600.0),
            learned_directions: 1.0 - (1.0 - person.learned_directions) * unknown,
            speed_estimate_log_sd: person.speed_estimate_log_sd * unknown,
            anticipation: 1.0 - (1.0 - person.anticipation) * by_practice,
            early_release_probability: person.early_release_probability * unknown,
            lock_omission_probability: person.lock_omission_probability * unknown,
            trunk_share: person.trunk_share * body,
            ..*person
        }
    }
}
