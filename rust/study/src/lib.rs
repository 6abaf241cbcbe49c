//! Studies: what a plan asks for, in which order each participant gets it, how far that is from balanced, and how far a study
//! has come: [`StudyProgress`] is the sum of the [`StudyEvent`]s of its journal.
//!
//! Pure: a plan is text, a schedule follows from the plan alone, every random choice from its seed. Has no clock, no files, no
//! tasks and no methods: what a trial is made of is [`TrialOptions`], names that whoever runs it resolves.
//!
//! ```
//! use proact_study::{CounterbalanceReport, StudyPlan, SHIPPED_PLANS};
//! let mut plan = StudyPlan::from_text(SHIPPED_PLANS[0].1)?;
//! plan.arrangements = None;
//! let schedule = plan.schedule(&[])?;
//! assert_eq!((plan.name.as_str(), schedule.trials().count()), ("study1", 96));
//! // Each method is twice in each place; A and B, and C and D, never follow each other.
//! let balance = CounterbalanceReport::of(&plan, &schedule, &[]);
//! assert_eq!(balance.imbalances[0].factor_b, "previous condition");
//! # Ok::<(), proact_study::StudyPlanError>(())
//! ```

#![cfg_attr(test, allow(clippy::unwrap_used))]

mod answers;
mod armsym;
mod arrangements;
mod counterbalance;
mod error;
mod form;
mod journal;
mod order;
mod plan;
mod progress;
mod schedule;

pub use answers::FormAnswer;
pub use armsym::{ArmSymCondition, plan_from_armsym};
pub use arrangements::Arrangements;
pub use counterbalance::{Confound, CounterbalanceReport, Imbalance, SessionMinutes};
pub use error::StudyPlanError;
pub use form::{
    Form, FormError, FormItem, FormOption, FormScore, SHIPPED_FORMS, Scoring, TranslatedText, pair_key,
};
pub use journal::{Deviation, ReadinessCheck, StepId, StepOutcome, StudyEvent};
pub use order::ConditionOrder;
pub use plan::{
    Condition, DEFAULT_LIMIT_SECS, InterTrialSteps, PlannedBreak, PlannedSession, ProtocolStep,
    SHIPPED_PLANS, StudyPlan, TrialOptions,
};
pub use progress::{ProgressError, StepState, StudyProgress};
pub use schedule::{PlannedStep, PlannedTrial, Schedule, ScheduledSession, SessionItem};
