//! Studies: what a plan asks for, in which order each participant gets it, how far that is from balanced, and how far a study
//! has come: [`Progress`] is the sum of the [`StudyEvent`]s of its journal.
//!
//! Pure: a plan is text, a schedule follows from the plan alone, every random choice from its seed. Has no clock, no files, no
//! tasks and no methods: what a trial is made of is [`TrialChoice`], names that whoever runs it resolves.
//!
//! ```
//! use proact_study::{Balance, Plan, SHIPPED};
//! let mut plan = Plan::from_text(SHIPPED[0].1)?;
//! plan.arrangements = None;
//! let schedule = plan.schedule(&[])?;
//! assert_eq!((plan.name.as_str(), schedule.trials().count()), ("study1", 96));
//! // Each method is twice in each place; A and B, and C and D, never follow each other.
//! let balance = Balance::of(&plan, &schedule, &[]);
//! assert_eq!(balance.imbalances[0].factor_b, "previous condition");
//! # Ok::<(), proact_study::PlanError>(())
//! ```

#![cfg_attr(test, allow(clippy::unwrap_used))]

mod answers;
mod armsym;
mod arrangements;
mod balance;
mod error;
mod form;
mod journal;
mod order;
mod plan;
mod progress;
mod schedule;

pub use answers::Answer;
pub use armsym::{ArmSymCondition, plan_from_armsym};
pub use arrangements::Arrangements;
pub use balance::{Balance, Confounded, Imbalance, SessionMinutes};
pub use error::PlanError;
pub use form::{Form, FormError, FormItem, FormOption, FormScore, SHIPPED_FORMS, Scoring, Texts, pair_key};
pub use journal::{Deviation, ReadinessCheck, Spot, StepOutcome, StudyEvent};
pub use order::ConditionOrder;
pub use plan::{
    Condition, Plan, PlannedSession, ProtocolStep, Rest, SHIPPED, TrialChoice, USUAL_LIMIT_SECS, Within,
};
pub use progress::{Progress, ProgressError, StepState};
pub use schedule::{Happening, PlannedStep, PlannedTrial, Schedule, ScheduledSession};
