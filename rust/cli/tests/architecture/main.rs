//! Holds the project to its own rules: who may depend on whom, where `unsafe` may stand, under which licences the
//! dependencies come, and whether the documents still say what is so.
//!
//! The rules are checked against what `cargo metadata` and the files say. Each rule is a function from facts to a
//! list of complaints, and has a test beside it with a planted offence, so that a rule that stopped biting is
//! noticed.

// These tests read the repository itself.
#![allow(clippy::disallowed_methods)]

mod defaults;
mod dependencies;
mod documents;
mod licences;
mod open_world;
mod python_module;
mod sources;
mod workspace;
