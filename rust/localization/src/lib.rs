//! Where everything is: a tree of named frames, what a tracking system says, and the calibrations that put an arm on a
//! shoulder and a box on a table.
//!
//! What it does: checks tracked poses ([`StreamCheck`], [`check_window`]), finds the point that a body turns about
//! ([`fit_pivot`]), answers where one frame is in another ([`FrameTree`]), follows a body to the time of a display
//! ([`PoseFilter`]), finds where the headset's world is in the room ([`calibrate`]) and keeps it there ([`DriftCorrection`]),
//! and places the box for a person ([`place_box`]).
//! What it never does: read a clock, a file or a socket; whoever hears of a pose tells it, with its stamps.
//!
//! Pure: no clock, no files, no threads, no unseeded randomness. SI and radians. A pose `a_from_b` takes coordinates in
//! `b` to coordinates in `a`; `tracking` is the tracking system's frame in metres with z up.
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

mod base_motion;
mod clock_offset;
mod drift;
mod frame_tree;
mod hand_eye;
mod hand_eye_fit;
mod input_check;
mod manoeuvre;
mod motion_estimate;
mod noise_level;
mod observability;
mod original_filter;
mod pivot;
mod placement;
mod pose_filter;
mod shoulder;
mod stream_meter;
mod tracking;

pub use base_motion::{BaseMotion, FollowSpeeds};
pub use clock_offset::ClockOffset;
pub use drift::{DriftCorrection, DriftState};
pub use frame_tree::{At, FrameError, FrameTree, Nanos};
pub use hand_eye::{
    CalibrationError, CalibrationOptions, CalibrationVerdict, HeadsetCalibration, PosePair, TimedPose,
    calibrate, one_shot, pair_streams,
};
pub use input_check::{ExpectedPlace, PoseFault, StreamCheck, check_handedness, check_window};
pub use observability::{HeadAxis, Observability};
pub use pivot::{PivotFit, fit_pivot, fit_sphere};
pub use placement::{BoxPlacement, BraceSize, PlacementError, PlacementProfile, SeatedPerson, place_box};
pub use pose_filter::{FilterProfile, FollowState, Followed, PoseFilter, PoseFilterConfig};
pub use shoulder::{ShoulderCalibration, ShoulderOptions, ShoulderVerdict, calibrate_shoulder};
pub use stream_meter::{StreamMeter, StreamSteadiness};
pub use tracking::{BodySample, RawBodyPose, TrackingAxes, UpAxis};
