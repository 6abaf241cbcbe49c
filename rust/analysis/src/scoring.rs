//! What a person did in a recorded trial, as figures.
//!
//! A [`Trace`] is a trial as it was seen, some 50 times a second, with its events: from our own records, or from a bag of the
//! original lab. From it come
//!
//! | row | what | columns |
//! |---|---|---|
//! | [`ActionPhase`] | a reach for an object, or its transport | [`PHASE_MEASURES`] |
//! | [`ObjectTransfer`] | an object in a trial | [`OBJECT_MEASURES`] |
//! | trial | all of it | [`TRIAL_MEASURES`] |
//! | [`TrialFault`] | something that went wrong | kind, object, detail |
//!
//! Each column is one function with its definition and source beside it. One that a record cannot answer is none, never zero.
//!
//! **Speeds and lengths of ways** are of positions that were low-passed at 6 Hz (a Gaussian of 22 ms), so that they do not hang
//! on the step; those named `sum10` are the paper's own, which do.

mod emg;
mod faults;
mod gaze;
mod joints;
mod measure;
mod motion;
mod objects;
mod phases;
mod shoulder;
mod trace;

pub use faults::{FaultKind, TrialFault, faults};
pub use gaze::{Dwell, FixationTarget, find_dwells};
pub use measure::{Measure, OBJECT_MEASURES, PHASE_MEASURES, TRIAL_MEASURES};
pub use objects::{ObjectTransfer, find_object_transfers};
pub use phases::{ActionPhase, PhaseKind, phases};
pub use trace::{JointRange, Trace, TracePoint};

/// A trial with what was found in it.
#[derive(Clone, Debug)]
pub struct ScoredTrial<'a> {
    /// The trial.
    pub trace: &'a Trace,
    /// Reaches and transports, in their order.
    pub phases: Vec<ActionPhase>,
    /// Its objects, in the order of the scene.
    pub objects: Vec<ObjectTransfer>,
    /// What went wrong, in its order.
    pub faults: Vec<TrialFault>,
    /// What the gaze fell on at each instant.
    fixation_targets: Vec<Option<FixationTarget>>,
}

impl<'a> ScoredTrial<'a> {
    /// Finds phases, objects and faults of `trace`.
    pub fn of(trace: &'a Trace) -> Self {
        let phases = phases(trace);
        let objects = find_object_transfers(trace, &phases);
        let faults = faults(trace, &phases, &objects);
        let sight = gaze::find_fixation_targets(trace, &phases);
        Self { trace, phases, objects, faults, fixation_targets: sight }
    }
}

#[cfg(test)]
mod tests;
