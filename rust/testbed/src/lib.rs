//! The one tick that wires the stages, and what it asks of the outside.

pub mod ports;
