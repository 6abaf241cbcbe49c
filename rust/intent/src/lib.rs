//! Intent: which object a person means, and which place.
//!
//! Pure: a gaze measurement and the state of the task in, a posterior out. Depends on the vocabulary alone; has no
//! clock, no files and no randomness. [`posterior`] is the paper's formula for one sample. [`IntentModel`] is the
//! interface of whatever turns a stream of samples into posteriors, so that models can be exchanged and compared:
//!
//! ```
//! use proact_intent::{Candidates, IntentModelName, IntentOptions};
//! use proact_types::{GazeSample, ObjectSet, Point, SimTime, TaskContext};
//! let mut model = "filtered".parse::<IntentModelName>()?.build(&IntentOptions::default())?;
//! let scene = Candidates {
//!     centers: [0.1, -0.1, 0.2, -0.2].map(|y| Point::new(0.6, y, -0.5)).to_vec(),
//!     pickable: vec![true; 4],
//!     context: Some(TaskContext { expected_objects: ObjectSet::first(2), selection_number: 0 }),
//!     tip: None,
//! };
//! let looking_at_red1 = GazeSample { origin: Point::origin(), direction: scene.centers[0].coords, valid: true };
//! let mut posterior = None;
//! for frame in 0..60 {
//!     posterior = model.observe(SimTime(frame * 17), &looking_at_red1, &scene);
//! }
//! assert!(posterior.expect("there are objects to pick")[0] > 0.9);
//! # Ok::<(), proact_intent::IntentError>(())
//! ```

mod external;
mod gaze_offset;
mod gaze_plane;
mod hand_motion;
mod hidden_markov;
mod memoryless;
mod model;
mod posterior;

pub use external::{
    ExternalIntentModel, IntentProcess, IntentProgram, IntentReply, IntentRequest, IntentResponse,
};
pub use gaze_offset::GazeOffset;
pub use gaze_plane::gaze_plane_intersection;
pub use model::{Candidates, IntentModel, IntentModelName};
pub use posterior::{IntentError, IntentOptions, Posterior, posterior, prior_weights};

#[cfg(test)]
fn assert_close(got: Option<Posterior>, expected: [f64; 4]) {
    let close = got.as_ref().is_some_and(|got| (0..4).all(|i| (got[i] - expected[i]).abs() < 1e-12));
    assert!(close, "{got:?}, expected {expected:?}");
}
