//! Control methods: from gestures, gaze and task state to commands for the arm.
//!
//! Pure: no clock, no files, no threads, no C++. What a method needs from a library it asks through [`ports`].

pub mod ports;
