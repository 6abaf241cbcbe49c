//! Simulated participants, and the body that carries a participant's shoulder and eyes.
//!
//! A participant sees what the page shows and acts through gestures, gaze and trunk posture: a [`DisplayFrame`]
//! in, an [`Intention`] out. Pure, seeded, and dependent on the vocabulary alone, so that none can look behind
//! the display.
//!
//! [`DisplayFrame`]: proact_types::DisplayFrame
//! [`Intention`]: proact_types::Intention

#![cfg_attr(test, allow(clippy::unwrap_used))]

mod body;
#[cfg(test)]
mod doubles;
mod imitating;
mod jogging;
mod person;
mod reach;
mod selecting;
mod sensorimotor;
mod steering;
mod target_choice;

use proact_types::{DisplayFrame, Intention};

pub use body::{Body, OutOfRange, Trunk};
pub use imitating::ImitatingParticipant;
pub use jogging::JoggingParticipant;
pub use person::{Learning, PersonTraits, Population, PracticeHistory, TraitDistribution};
pub use selecting::SelectingParticipant;
pub use sensorimotor::ParticipantOptions;
pub use steering::SteeringParticipant;

/// Somebody who sees and acts. Deterministic for its seed.
pub trait Participant {
    /// Looks at `frame` and acts. Called once per display frame.
    fn step(&mut self, frame: &DisplayFrame) -> Intention;

    /// Why the last step gave nothing; none while it acts. Who lives in another program may fail: the arm stops then.
    fn fault(&self) -> Option<&str> {
        None
    }
}
