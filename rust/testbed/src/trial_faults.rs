//! Faults of a trial as a whole: parts in other processes that fail, and plans that fail in a row.

use proact_types::{EventKind, PlanReply, PlanStatus, SimTime};
use serde::{Deserialize, Serialize};
use std::fmt;

/// Answers that may be missed in a row where each answer is waited for: the wait for each is 10 s.
const MISSED_IN_BATCH: u32 = 3;
/// The same of a live trial, in which a step does not wait: 2 s of a method's steps.
const MISSED_LIVE: u32 = 200;

/// What is wrong with a trial that ran.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ResultFaultKind {
    /// A part in another process failed and was not back at the end: the trial has no score.
    ExternalPart,
    /// A method in another process commanded neither the arm nor the hand nor the planner.
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

/// Counts the answers that external parts miss in a row.
#[derive(Debug)]
pub(crate) struct MissedAnswers {
    limit: u32,
    in_a_row: [u32; 3],
    over: Option<String>,
}

impl MissedAnswers {
    /// `limit` of the configuration; `waits`: a step waits for each answer.
    pub(crate) fn new(limit: Option<u32>, waits: bool) -> Self {
        let limit = limit.unwrap_or(if waits { MISSED_IN_BATCH } else { MISSED_LIVE });
        Self { limit, in_a_row: [0; 3], over: None }
    }

    /// `part` was asked; `missed` is the reason if it has not answered.
    pub(crate) fn take(&mut self, part: ExternalPart, missed: Option<&str>) {
        let count = &mut self.in_a_row[part as usize];
        *count = if missed.is_some() { *count + 1 } else { 0 };
        if let Some(reason) = missed.filter(|_| *count >= self.limit) {
            let count = *count;
            self.over.get_or_insert_with(|| {
                format!("the {part} has missed {count} answers in a row, so the trial ended: {reason}")
            });
        }
    }

    /// Why the trial must end; none while no part has reached the limit.
    pub(crate) fn over(&self) -> Option<&str> {
        self.over.as_deref()
    }
}

/// Counts the plans that fail in a row.
#[derive(Debug)]
pub(crate) struct FailedPlans {
    limit: u32,
    in_a_row: u32,
    since: SimTime,
    /// The longest run over the limit: how many, from when on, and why the last one failed.
    longest: Option<(u32, SimTime, String)>,
}

impl FailedPlans {
    pub(crate) fn new(limit: u32) -> Self {
        Self { limit, in_a_row: 0, since: SimTime(0), longest: None }
    }

    /// A plan took effect at `now`; an event in the tick in which the limit is reached.
    pub(crate) fn take(&mut self, now: SimTime, plan: &PlanReply) -> Option<EventKind> {
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
        if count >= self.limit && self.longest.as_ref().is_none_or(|(most, ..)| *most <= count) {
            self.longest = Some((count, self.since, plan.reason.clone()));
        }
        (count == self.limit).then(|| EventKind::PlansFailed { count, reason: plan.reason.clone() })
    }

    /// The fault of the trial; none if the limit was not reached.
    pub(crate) fn fault(&self) -> Option<ResultFault> {
        let (count, since, reason) = self.longest.as_ref()?;
        let (since, reason) = (since.as_secs(), reason.trim_end_matches('.'));
        let reason = format!("{count} plans failed in a row, from {since:.1} s on; the last one: {reason}");
        Some(ResultFault { kind: ResultFaultKind::FailedPlans, reason })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plan(status: PlanStatus) -> PlanReply {
        PlanReply::without_a_way(1, status, "The arm would touch something: wrist and lid.")
    }

    #[test]
    fn failed_plans_are_a_fault_from_the_limit_on_and_a_cancelled_one_neither_counts_nor_ends_the_run() {
        use PlanStatus::{Cancelled, GoalInCollision, NoPlan, Ok, Unreachable};
        let mut plans = FailedPlans::new(3);
        let mut events = Vec::new();
        let run = [NoPlan, GoalInCollision, Ok, Unreachable, NoPlan, Cancelled, GoalInCollision, NoPlan, Ok];
        for (tick, status) in (1..).zip(run) {
            events.extend(plans.take(SimTime(1000 * tick), &plan(status)).map(|event| (tick, event)));
        }
        let reason = "The arm would touch something: wrist and lid.".to_owned();
        assert_eq!(events, [(7, EventKind::PlansFailed { count: 3, reason })]);
        let expected = "4 plans failed in a row, from 4.0 s on; the last one: The arm would touch something: wrist and lid";
        assert_eq!(plans.fault().map(|fault| fault.reason).as_deref(), Some(expected));
        assert_eq!(FailedPlans::new(10).fault(), None);
    }

    #[test]
    fn an_answer_in_between_begins_the_count_of_missed_answers_anew_and_parts_count_apart() {
        let mut missed = MissedAnswers::new(Some(2), true);
        for (part, reason) in [
            (ExternalPart::Method, Some("late")),
            (ExternalPart::IntentModel, Some("late")),
            (ExternalPart::Method, None),
            (ExternalPart::Method, Some("late")),
        ] {
            missed.take(part, reason);
            assert_eq!(missed.over(), None);
        }
        missed.take(ExternalPart::IntentModel, Some("late by 10 ms"));
        let expected = "the intent model has missed 2 answers in a row, so the trial ended: late by 10 ms";
        assert_eq!(missed.over(), Some(expected));
    }
}
