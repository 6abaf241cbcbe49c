//! Where everything is: a tree of named frames, some of which move.
//!
//! Pure: depends on the vocabulary alone; has no clock, no files and no randomness. A pose `a_from_b` takes coordinates in
//! `b` to coordinates in `a`.
//!
//! ```
//! use proact_localization::{At, FrameTree};
//! use proact_types::Pose;
//! let mut frames = FrameTree::default();
//! frames.fix("world", "table", Pose::translation(0.0, 0.0, 1.015))?;
//! frames.put("table", "headset", 0, Pose::translation(-0.6, 0.0, 0.5))?;
//! frames.put("table", "headset", 20_000_000, Pose::translation(-0.6, 0.02, 0.5))?;
//! let world_from_headset = frames.look_up("world", "headset", At::Time(10_000_000))?;
//! assert!((world_from_headset.translation.vector - nalgebra::vector![-0.6, 0.01, 1.515]).norm() < 1e-12);
//! # Ok::<(), proact_localization::FrameError>(())
//! ```

#![cfg_attr(test, allow(clippy::unwrap_used))]

mod frame_tree;

pub use frame_tree::{At, FrameError, FrameTree, Nanos};
