//! Why there is no full plan.

use crate::PlanningError;
use proact_types::PlanStatus;

/// Why there is no full plan.
#[derive(Clone, Debug)]
pub(crate) struct PlanFailure {
    pub status: PlanStatus,
    pub reason: String,
}

impl PlanFailure {
    pub fn new(status: PlanStatus, reason: impl Into<String>) -> Self {
        Self { status, reason: reason.into() }
    }

    pub fn timed_out() -> Self {
        Self::new(PlanStatus::NoPlan, "No way to the goal was found in time.")
    }

    /// The reply's words for a cancel.
    pub fn cancelled() -> Self {
        Self::new(PlanStatus::Cancelled, "The request was cancelled.")
    }
}

impl From<PlanningError> for PlanFailure {
    fn from(error: PlanningError) -> Self {
        Self::new(PlanStatus::Invalid, error.to_string())
    }
}
