//! Faults of a trial as a whole: parts in other processes that fail, and plans that fail in a row.

use crate::TrialConfig;
use proact_types::{EventKind, PlanReply, PlanStatus, SimTime};
use serde::{Deserialize, Serialize};
use std::fmt;

/// Answers that may be missed in a row where each answer is waited for: the wait for each is 10 s.
const MAX_MISSED_IN_BATCH: u32 = 3;
/// The same of a live trial, in which a step does not wait: 2 s of a method's steps.
const MAX_MISSED_LIVE: u32 = 200;
/// Answers that may be missed in a whole trial where each answer is waited for: 200 s of waiting. A part that was late in every
/// third step, and so never three times in a row, made a trial of 30 s wait for hours.
const MAX_MISSED_PER_BATCH_TRIAL: u32 = 20;

/// What is wrong with a trial that ran.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ResultFaultKind {
    /// A part in another process failed and was not back at the end: the trial has no score.
    ExternalPart,
    /// A part in another process did nothing in the whole trial: a method commanded neither the arm nor the hand nor the planner, an
    /// intent model gave no posterior, a process that decodes gave no decision in time.
    NeverActed,
    /// As many plans failed in a row as the configuration allows.
    FailedPlans,
}

/// A fault of a trial, told at its end.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ResultFault {
    /// Its kind.
    pub kind: ResultFaultKind,
    /// One sentence without a full stop.
    pub reason: String,
}

/// A part of a trial that may be another process and is asked line by line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum ExternalPart {
    Method,
    Decoder,
    IntentModel,
}

impl fmt::Display for ExternalPart {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Method => "method",
            Self::Decoder => "process that decodes EMG",
            Self::IntentModel => "intent model",
        })
    }
}

/// Counts the answers that external parts miss: in a row, and in the whole trial.
#[derive(Debug)]
pub(crate) struct MissedAnswers {
    limit: u32,
    /// None: no limit.
    trial_limit: Option<u32>,
    in_a_row: [u32; 3],
    in_trial: [u32; 3],
    end_reason: Option<String>,
}

impl MissedAnswers {
    /// The limits of `config`, or those of a trial that waits for each answer, or of one that does not.
    pub(crate) fn new(config: &TrialConfig) -> Self {
        let waits = config.wait_for_plans;
        let limit =
            config.missed_answers_limit.unwrap_or(if waits { MAX_MISSED_IN_BATCH } else { MAX_MISSED_LIVE });
        let in_batch = waits.then_some(MAX_MISSED_PER_BATCH_TRIAL);
        let trial_limit = config.missed_answers_in_trial_limit.or(in_batch);
        Self { limit, trial_limit, in_a_row: [0; 3], in_trial: [0; 3], end_reason: None }
    }

    /// `part` was asked; `missed` is the reason if it has not answered.
    pub(crate) fn record(&mut self, part: ExternalPart, missed: Option<&str>) {
        let (in_a_row, in_trial) = (&mut self.in_a_row[part as usize], &mut self.in_trial[part as usize]);
        let Some(reason) = missed else {
            *in_a_row = 0;
            return;
        };
        *in_a_row = in_a_row.saturating_add(1);
        *in_trial = in_trial.saturating_add(1);
        let count = if *in_a_row >= self.limit {
            format!("{in_a_row} answers in a row")
        } else if self.trial_limit.is_some_and(|limit| *in_trial >= limit) {
            format!("{in_trial} answers in this trial")
        } else {
            return;
        };
        self.end_reason
            .get_or_insert_with(|| format!("the {part} has missed {count}, so the trial ended: {reason}"));
    }

    /// Why the trial must end; none while no part has reached the limit.
    pub(crate) fn end_reason(&self) -> Option<&str> {
        self.end_reason.as_deref()
    }
}

/// Whether an intent model and a process that decodes have said anything of use.
#[derive(Debug, Default)]
pub(crate) struct UsefulAnswers {
    /// How often each part was asked.
    asked_count: [u32; 3],
    /// Whether one of its answers could be used.
    has_useful_answer: [bool; 3],
}

impl UsefulAnswers {
    /// `part` was asked; `is_useful`: its answer can be used, and says something.
    pub(crate) fn record(&mut self, part: ExternalPart, is_useful: bool) {
        self.asked_count[part as usize] += 1;
        self.has_useful_answer[part as usize] |= is_useful;
    }

    /// Those parts that were asked and never said anything of use.
    pub(crate) fn faults(&self) -> impl Iterator<Item = ResultFault> + '_ {
        let parts = [
            (ExternalPart::IntentModel, "gave no posterior with anything above zero", "gazes"),
            (ExternalPart::Decoder, "gave no decision in time", "windows"),
        ];
        let silent = parts.into_iter().filter(|(part, ..)| {
            self.asked_count[*part as usize] > 0 && !self.has_useful_answer[*part as usize]
        });
        silent.map(|(part, what, of)| ResultFault {
            kind: ResultFaultKind::NeverActed,
            reason: format!(
                "the {part} {what} in the whole trial ({} {of})",
                self.asked_count[part as usize]
            ),
        })
    }
}

/// Counts the plans that fail in a row.
#[derive(Debug)]
pub(crate) struct FailedPlans {
    limit: u32,
    in_a_row: u32,
    since: SimTime,
    /// The longest run over the limit: how many, from when on, and why the last one failed.
    longest_run: Option<(u32, SimTime, String)>,
}

impl FailedPlans {
    pub(crate) fn new(limit: u32) -> Self {
        Self { limit, in_a_row: 0, since: SimTime(0), longest_run: None }
    }

    /// A plan took effect at `now`; an event in the tick in which the limit is reached.
    pub(crate) fn record(&mut self, now: SimTime, plan: &PlanReply) -> Option<EventKind> {
        match plan.status {
            PlanStatus::Cancelled => return None,
            PlanStatus::Ok | PlanStatus::Intermediate => {
                self.in_a_row = 0;
                return None;
            }
            _ => {}
        }
        if self.in_a_row == 0 {
            self.since = now;
        }
        self.in_a_row += 1;
        let count = self.in_a_row;
        if count >= self.limit && self.longest_run.as_ref().is_none_or(|(max_count, ..)| *max_count <= count)
        {
            self.longest_run = Some((count, self.since, plan.reason.clone()));
        }
        (count == self.limit).then(|| EventKind::PlansFailed { count, reason: plan.reason.clone() })
    }

    /// The fault of the trial; none if the limit was not reached.
    pub(crate) fn fault(&self) -> Option<ResultFault> {
        let (count, since, reason) = self.longest_run.as_ref()?;
        let (since, reason) = (since.as_secs(), reason.trim_end_matches('.'));
        let reason = format!("{count} plans failed in a row, from {since:.1} s on; the last one: {reason}");
        Some(ResultFault { kind: ResultFaultKind::FailedPlans, reason })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Setup;

    /// The limits of a trial that waits for each answer.
    fn missed_answers(in_a_row: Option<u32>, in_trial: Option<u32>) -> MissedAnswers {
        let config = TrialConfig::new("A", 1, Setup::named("still").expect("it ships with the crate"));
        MissedAnswers::new(&TrialConfig {
            missed_answers_limit: in_a_row,
            missed_answers_in_trial_limit: in_trial,
            ..config
        })
    }

    fn plan(status: PlanStatus) -> PlanReply {
        PlanReply::without_plan(1, status, "The arm would touch something: wrist and lid.")
    }

    #[test]
    fn failed_plans_are_a_fault_from_the_limit_on_and_a_cancelled_one_neither_counts_nor_ends_the_run() {
        use PlanStatus::{Cancelled, GoalInCollision, NoPlan, Ok, Unreachable};
        let mut plans = FailedPlans::new(3);
        let mut events = Vec::new();
        let run = [NoPlan, GoalInCollision, Ok, Unreachable, NoPlan, Cancelled, GoalInCollision, NoPlan, Ok];
        for (tick, status) in (1..).zip(run) {
            events.extend(plans.record(SimTime(1000 * tick), &plan(status)).map(|event| (tick, event)));
        }
        let reason = "The arm would touch something: wrist and lid.".to_owned();
        assert_eq!(events, [(7, EventKind::PlansFailed { count: 3, reason })]);
        let expected = "4 plans failed in a row, from 4.0 s on; the last one: The arm would touch something: wrist and lid";
        assert_eq!(plans.fault().map(|fault| fault.reason).as_deref(), Some(expected));
        assert_eq!(FailedPlans::new(10).fault(), None);
    }

    #[test]
    fn an_answer_in_between_begins_the_count_of_missed_answers_anew_and_parts_count_apart() {
        let mut missed = missed_answers(Some(2), None);
        for (part, reason) in [
            (ExternalPart::Method, Some("late")),
            (ExternalPart::IntentModel, Some("late")),
            (ExternalPart::Method, None),
            (ExternalPart::Method, Some("late")),
        ] {
            missed.record(part, reason);
            assert_eq!(missed.end_reason(), None);
        }
        missed.record(ExternalPart::IntentModel, Some("late by 10 ms"));
        let expected = "the intent model has missed 2 answers in a row, so the trial ended: late by 10 ms";
        assert_eq!(missed.end_reason(), Some(expected));
    }
    /// A method that was late in two of three steps was waited for, 10 s at a time, to the end of the trial.
    #[test]
    fn answers_missed_now_and_then_end_a_trial_that_waits_for_each_and_parts_count_apart() {
        let late_in_two_of_three = |missed: &mut MissedAnswers, steps: u32| {
            (0..steps).find(|step| {
                missed.record(ExternalPart::Decoder, None);
                missed.record(ExternalPart::Method, (step % 3 != 2).then_some("late by 10 s"));
                missed.end_reason().is_some()
            })
        };
        let mut missed = missed_answers(None, None);
        assert_eq!(late_in_two_of_three(&mut missed, 3000), Some(28), "the twentieth");
        let expected = "the method has missed 20 answers in this trial, so the trial ended: late by 10 s";
        assert_eq!(missed.end_reason(), Some(expected));
        assert_eq!(late_in_two_of_three(&mut missed_answers(None, Some(4)), 3000), Some(4));
        let mut live = TrialConfig::new("A", 1, Setup::named("still").expect("it ships with the crate"));
        live.wait_for_plans = false;
        assert_eq!(late_in_two_of_three(&mut MissedAnswers::new(&live), 3000), None);
    }
}
