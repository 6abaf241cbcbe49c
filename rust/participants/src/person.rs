//! What makes a simulated participant a person: errors, delays and habits, each with a number and a source.
//!
//! All parts are neutral by default: the participant then makes no errors but those of [`ParticipantOptions`]. Each draws
//! from a random stream of its own, so that none changes what another does.
//!
//! [`ParticipantOptions`]: crate::ParticipantOptions

mod confusion_model;
mod decision_timer;
mod gaze_model;
mod perception;
mod population;
mod practice;
mod skill;
mod traits;

pub(crate) use confusion_model::ConfusionModel;
pub(crate) use decision_timer::DecisionTimer;
pub(crate) use gaze_model::GazeModel;
pub(crate) use perception::Perception;
pub(crate) use skill::MotorSkill;

pub use population::{Population, TraitDistribution};
pub use practice::{Learning, PracticeHistory};
pub use traits::PersonTraits;

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

/// The random stream called `name` of a trial's `seed`.
pub(crate) fn stream(seed: u64, name: &str) -> ChaCha8Rng {
    let folded = name.bytes().fold(0xcbf2_9ce4_8422_2325_u64, |hash, byte| {
        (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3)
    });
    ChaCha8Rng::seed_from_u64(seed ^ folded)
}
