//! How far a plan has got, and what it took.

use proact_types::PlanStatus;
use serde::{Deserialize, Serialize};
use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering};

/// What a planner is doing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PlanStage {
    /// Nothing.
    Idle,
    /// Finding the way off what the hand is around or on.
    Departure,
    /// Finding arm angles for the goal.
    ApproachSearch,
    /// Connecting the two.
    PathSearch,
    /// Smoothing and timing the path.
    Smoothing,
}

impl PlanStage {
    const ALL: [PlanStage; 5] =
        [Self::Idle, Self::Departure, Self::ApproachSearch, Self::PathSearch, Self::Smoothing];
}

/// A stage that one thread sets and others read.
#[derive(Clone, Debug, Default)]
pub(crate) struct SharedPlanStage(Arc<AtomicU8>);

impl SharedPlanStage {
    pub fn set(&self, stage: PlanStage) {
        self.0.store(stage as u8, Ordering::Relaxed);
    }

    pub fn get(&self) -> PlanStage {
        PlanStage::ALL[usize::from(self.0.load(Ordering::Relaxed)).min(PlanStage::ALL.len() - 1)]
    }
}

/// What one plan took: iterations, by which it is bounded in batches, beside the time, by which it is bounded live.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlanStats {
    /// Which request it answers.
    pub request: u64,
    /// How it ended.
    pub status: PlanStatus,
    /// Why there is no full plan, as in its reply: of a start or goal in collision it names both links, or the link and the
    /// obstacle. Empty otherwise.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub reason: String,
    /// Free space that the plan keeps away from its ends, metres, as in its reply.
    #[serde(rename = "clearance")]
    pub clearance_m: Option<f64>,
    /// Iterations of the planner, over all its searches.
    pub iterations: u64,
    /// States that these searches looked at.
    pub state_checks: u64,
    /// Seconds on the wall clock, from request to reply.
    pub wall_secs: f64,
    /// Seconds of processor time: what is left when other processes are out of the way.
    pub cpu_secs: f64,
    /// True if the clock ended it: the same request may then be answered otherwise another time.
    pub timed_out: bool,
}

impl Default for PlanStats {
    /// That of no request at all.
    fn default() -> Self {
        let status = PlanStatus::Invalid;
        Self {
            request: 0,
            status,
            reason: String::new(),
            clearance_m: None,
            iterations: 0,
            state_checks: 0,
            wall_secs: 0.0,
            cpu_secs: 0.0,
            timed_out: false,
        }
    }
}

/// Processor time of the calling thread, seconds since some moment.
pub fn thread_cpu_secs() -> f64 {
    crate::bridge::ffi::thread_cpu_secs()
}
