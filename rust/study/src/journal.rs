use crate::FormAnswer;
use serde::{Deserialize, Serialize};

/// A place in a study: something that happens in a session of a participant.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StepId {
    /// Whose, from 1.
    pub participant: usize,
    /// Name of the session.
    pub session: String,
    /// What of the session, from 1.
    pub step: usize,
}

/// How something ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
#[serde(rename_all = "snake_case")]
pub enum StepOutcome {
    /// As it should.
    Done,
    /// The experimenter ended it.
    Aborted,
    /// The program ended before it did: a crash, a full disk, no power.
    Interrupted,
    /// It was left out.
    Skipped,
}

/// What departs from the plan.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
#[serde(rename_all = "snake_case")]
pub enum Deviation {
    /// Done again.
    Repeated,
    /// Left out.
    LeftOut,
    /// A session was taken up again on another day.
    SplitOverDays,
    /// A session on another day than planned.
    OtherDay,
    /// Participants in another order than planned.
    OtherOrder,
    /// Gestures were trained again within a session.
    Retrained,
    /// The gaze was calibrated again within a session.
    Recalibrated,
    /// A trial was begun although something was not ready.
    NotReady,
    /// The plan was changed after the study had begun.
    PlanChanged,
    /// The clock of the machine was set.
    ClockSet,
}

impl Deviation {
    /// As in the tables.
    pub fn label(self) -> &'static str {
        match self {
            Deviation::Repeated => "repeated",
            Deviation::LeftOut => "left_out",
            Deviation::SplitOverDays => "split_over_days",
            Deviation::OtherDay => "other_day",
            Deviation::OtherOrder => "other_order",
            Deviation::Retrained => "retrained",
            Deviation::Recalibrated => "recalibrated",
            Deviation::NotReady => "not_ready",
            Deviation::PlanChanged => "plan_changed",
            Deviation::ClockSet => "clock_set",
        }
    }
}

/// Something that happened in a study. The journal of these events is all that a study knows of itself: what is next, which
/// trial counts and every table follow from it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub enum StudyEvent {
    /// A program took the study up.
    RunBegan {
        /// Participants and answers are simulated.
        simulated: bool,
        /// The kind of simulated participants; none with people, and of journals that are older than kinds.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        #[serde(rename = "people")]
        participant_kind: Option<String>,
        /// Its version.
        program: String,
        /// Hash of the plan.
        plan: String,
    },
    /// A person takes a participant's place in the plan.
    Enrolled {
        /// The place, from 1.
        participant: usize,
        /// A pseudonym.
        id: String,
    },
    /// What follows is of this day; told once a day in each session, since a session may be split.
    Visited {
        /// Whose, from 1.
        participant: usize,
        /// Name of the session.
        session: String,
        /// Such as `2026-03-01`, where the program runs.
        day: String,
    },
    /// Something begins.
    StepBegan {
        /// What.
        #[serde(rename = "spot")]
        step_id: StepId,
        /// How often it was begun, this time included.
        attempt: usize,
        /// Folder of the record within the study's, for a trial.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        record: Option<String>,
    },
    /// Something is over.
    StepEnded {
        /// What.
        #[serde(rename = "spot")]
        step_id: StepId,
        /// Which time.
        attempt: usize,
        /// How.
        outcome: StepOutcome,
        /// Digest of the trial that was recorded; none for what is no trial, and of older journals.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        digest: Option<String>,
    },
    /// A question was answered; the newest answer counts.
    Answered {
        /// The form.
        #[serde(rename = "spot")]
        step_id: StepId,
        /// Name of the form.
        form: String,
        /// Key of the item.
        item: String,
        /// What was answered; none to take an answer back.
        answer: Option<FormAnswer>,
    },
    /// What was done so far does not count: it is done again.
    Repeated {
        /// What.
        #[serde(rename = "spot")]
        step_id: StepId,
        /// Why.
        reason: String,
    },
    /// Something departs from the plan.
    Deviated {
        /// Where.
        #[serde(rename = "spot")]
        step_id: StepId,
        /// What.
        deviation: Deviation,
        /// Why.
        reason: String,
    },
    /// What the experimenter noted.
    Noted {
        /// Where, if a session is under way.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        #[serde(rename = "spot")]
        step_id: Option<StepId>,
        /// The words.
        text: String,
    },
    /// A trial stands still, or goes on.
    Paused {
        /// Which.
        #[serde(rename = "spot")]
        step_id: StepId,
        /// It stands still.
        #[serde(rename = "on")]
        paused: bool,
    },
    /// Gestures were trained or tested.
    Trained {
        /// Where.
        #[serde(rename = "spot")]
        step_id: StepId,
        /// The model's file in the study's folder; none where keys make the gestures.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        model: Option<String>,
        /// Share of windows that were recognised, leaving one repetition out.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        accuracy: Option<f64>,
        /// The plan's test was passed; none without one.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        passed: Option<bool>,
    },
    /// It was measured how well the gaze follows known points.
    GazeChecked {
        /// Where.
        #[serde(rename = "spot")]
        step_id: StepId,
        /// Mean error, degrees; none if no gaze was valid.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        error_deg: Option<f64>,
        /// What the points agreed on was taken off.
        calibrated: bool,
    },
    /// What was found ready, or not, before a trial.
    Checked {
        /// Which trial.
        #[serde(rename = "spot")]
        step_id: StepId,
        /// The checks.
        checks: Vec<ReadinessCheck>,
    },
}

impl StudyEvent {
    /// Where it happened, if at some step.
    pub fn step_id(&self) -> Option<&StepId> {
        match self {
            StudyEvent::StepBegan { step_id, .. }
            | StudyEvent::StepEnded { step_id, .. }
            | StudyEvent::Answered { step_id, .. }
            | StudyEvent::Repeated { step_id, .. }
            | StudyEvent::Deviated { step_id, .. }
            | StudyEvent::Paused { step_id, .. }
            | StudyEvent::Trained { step_id, .. }
            | StudyEvent::GazeChecked { step_id, .. }
            | StudyEvent::Checked { step_id, .. } => Some(step_id),
            StudyEvent::Noted { step_id, .. } => step_id.as_ref(),
            StudyEvent::RunBegan { .. } | StudyEvent::Enrolled { .. } | StudyEvent::Visited { .. } => None,
        }
    }
}

/// Whether something is ready.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
#[serde(deny_unknown_fields)]
pub struct ReadinessCheck {
    /// Such as `gestures`.
    pub name: String,
    /// It is.
    pub ready: bool,
    /// What was found, for the experimenter.
    #[serde(rename = "found")]
    pub detail: String,
    /// How old that is, seconds; none where age does not matter.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub age_secs: Option<f64>,
}
