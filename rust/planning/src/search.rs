//! What bounds a search in joint space, what ends it early, what it begins with and what it gives.

use crate::bridge::ffi;
use proact_types::Pose;
use serde::{Deserialize, Serialize};

/// Ends a running search from another thread.
#[derive(Clone)]
pub struct CancelFlag(pub(crate) cxx::SharedPtr<ffi::CancelFlag>);

// SAFETY: the C++ object is nothing but one std::atomic<bool>, owned by a std::shared_ptr whose count is
// atomic too; its functions are the only way to it.
unsafe impl Send for CancelFlag {}
// SAFETY: as above; every access is an atomic load or store.
unsafe impl Sync for CancelFlag {}

impl CancelFlag {
    /// A flag that is not raised.
    pub fn new() -> Self {
        Self(ffi::new_cancel_flag())
    }

    /// Asks whoever watches the flag to stop.
    pub fn raise(&self) {
        ffi::raise_flag(&self.0);
    }

    /// Makes the flag ready for the next search.
    pub fn lower(&self) {
        ffi::lower_flag(&self.0);
    }

    /// True between [`CancelFlag::raise`] and [`CancelFlag::lower`].
    pub fn is_raised(&self) -> bool {
        self.0.is_raised()
    }
}

impl Default for CancelFlag {
    fn default() -> Self {
        Self::new()
    }
}

impl std::fmt::Debug for CancelFlag {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_tuple("CancelFlag").field(&self.is_raised()).finish()
    }
}

/// An obstacle made of triangles.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MeshObstacle {
    /// Named in collision reports.
    pub name: String,
    /// Metres, in the mesh's frame.
    pub vertices: Vec<[f64; 3]>,
    /// Three indices of vertices each.
    pub triangles: Vec<[usize; 3]>,
    /// `world_from_mesh`.
    pub pose: Pose,
}

/// Arm angles and which of them a straight motion joins: grown once among things that stay where they are, stored, and
/// begun with whatever else stands there later. Nothing in it is taken for free without a look.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Roadmap {
    /// Arm angles, rad, base to tip.
    pub milestones: Vec<Vec<f64>>,
    /// Pairs of indices of milestones.
    pub edges: Vec<[usize; 2]>,
}

/// What searches in joint space took.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct SearchStats {
    /// Iterations of the planner.
    pub iterations: u64,
    /// States looked at.
    pub state_checks: u64,
    /// Seconds on the wall clock.
    pub search_secs: f64,
    /// True if the bound on the time ended one, so that another run may end otherwise.
    pub timed_out: bool,
}

/// How a search in joint space ended.
#[derive(Clone, Debug, PartialEq)]
pub enum SearchOutcome {
    /// A free path, straight in joint space between its points.
    Solved {
        /// Arm angles from start to goal, both included.
        path: Vec<Vec<f64>>,
        /// Index of the goal that it reaches.
        goal: usize,
    },
    /// No path within the iterations.
    NoPlan,
    /// The start touches something.
    StartInCollision,
    /// Every goal touches something.
    GoalsInCollision,
    /// The flag was raised.
    Cancelled,
}

/// What a plain program on OMPL and FCL found: [`CollisionScene::search_baseline`].
#[derive(Clone, Debug, PartialEq)]
pub struct BaselineOutcome {
    /// Arm angles from start to goal; empty if none was found in time.
    pub path: Vec<Vec<f64>>,
    /// How often it began.
    pub attempts: u32,
    /// Processor time of the searches, seconds.
    pub search_secs: f64,
    /// Processor time of searches and simplification, seconds.
    pub cpu_secs: f64,
}
