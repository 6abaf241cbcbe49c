//! What a person did in a recorded trial, as figures.
//!
//! A [`Trace`] is a trial as it was seen, some 50 times a second, with its events: from our own records, or from a bag of the
//! original lab. From it come
//!
//! | row | what | columns |
//! |---|---|---|
//! | [`ActionPhase`] | a reach for an object, or its transport | [`OF_PHASE`] |
//! | [`Handling`] | an object in a trial | [`OF_OBJECT`] |
//! | trial | all of it | [`OF_TRIAL`] |
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
pub use gaze::{Dwell, LookedAt, looks};
pub use measure::{Measure, OF_OBJECT, OF_PHASE, OF_TRIAL};
pub use objects::{Handling, handlings};
pub use phases::{ActionPhase, PhaseKind, phases};
pub use trace::{Instant, JointRange, Trace};

/// A trial with what was found in it.
#[derive(Clone, Debug)]
pub struct Scored<'a> {
    /// The trial.
    pub trace: &'a Trace,
    /// Reaches and transports, in their order.
    pub phases: Vec<ActionPhase>,
    /// Its objects, in the order of the scene.
    pub objects: Vec<Handling>,
    /// What went wrong, in its order.
    pub faults: Vec<TrialFault>,
    /// What the gaze fell on at each instant.
    sight: Vec<Option<LookedAt>>,
}

impl<'a> Scored<'a> {
    /// Finds phases, objects and faults of `trace`.
    pub fn of(trace: &'a Trace) -> Self {
        let phases = phases(trace);
        let objects = handlings(trace, &phases);
        let faults = faults(trace, &phases, &objects);
        let sight = gaze::sight(trace, &phases);
        Self { trace, phases, objects, faults, sight }
    }
}

#[cfg(test)]
mod constructed;
