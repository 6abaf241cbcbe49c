//! Control methods: from gestures, gaze and task state to commands for the arm.
//!
//! Pure: no clock, no files, no threads, no C++. What a method needs from a library it asks for: kinematics
//! through [`ports`], plans by a [`PlanCommand`] whose answer comes back in a later [`ControlInput`].

mod gaze_assisted;
mod hand;
mod method;
pub mod ports;

pub use gaze_assisted::GazeAssisted;
pub use hand::HandTracker;
pub use method::{
    ControlInput, ControlMethod, ControlOutput, HandCommand, MotionCommand, MotionState, PlanCommand,
};
