//! Intent: which block a person means, and which place.
//!
//! Pure: a gaze measurement and the state of the task in, a posterior out. Depends on the vocabulary alone.

mod place;
mod posterior;

pub use place::table_hit;
pub use posterior::{IntentError, IntentOptions, Posterior, TaskPrior, posterior};
