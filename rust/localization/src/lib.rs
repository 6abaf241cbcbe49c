//! Where everything is: a tree of named frames, what a tracking system says, and the calibrations that put an arm on a
//! shoulder and a box on a table.
//!
//! What it does: checks tracked poses ([`PoseStreamCheck`], [`check_height`]), finds the point that a body turns about
//! ([`fit_pivot`]), answers where one frame is in another ([`FrameTree`]), follows a body to the time of a display
//! ([`PoseFilter`]), finds where the headset's world is in the room ([`calibrate_headset`]) and keeps it there ([`DriftCorrection`]),
//! and places the box for a person ([`place_box`]).
//! What it never does: read a clock, a file or a socket; whoever hears of a pose tells it, with its stamps.
//!
//! Pure: no clock, no files, no threads, no unseeded randomness. SI and radians. A pose `a_from_b` takes coordinates in
//! `b` to coordinates in `a`; `tracking` is the tracking system's frame in metres with z up.
//!
//! ```
//! use proact_localization::{TransformTime, FrameTree};
//! use proact_types::Pose;
//! let mut frames = FrameTree::default();
//! frames.set_static_transform("world", "table", Pose::translation(0.0, 0.0, 1.015))?;
//! frames.set_transform("table", "headset", 0, Pose::translation(-0.6, 0.0, 0.5))?;
//! frames.set_transform("table", "headset", 20_000_000, Pose::translation(-0.6, 0.02, 0.5))?;
//! let world_from_headset = frames.lookup_transform("world", "headset", TransformTime::Time(10_000_000))?;
//! assert!((world_from_headset.translation.vector - nalgebra::vector![-0.6, 0.01, 1.515]).norm() < 1e-12);
//! # Ok::<(), proact_localization::FrameError>(())
//! ```

#![cfg_attr(test, allow(clippy::unwrap_used))]

mod clock_offset;
mod drift;
mod frame_tree;
mod hand_eye;
mod hand_eye_fit;
mod imm_filter;
mod input_check;
mod motion_estimate;
mod noise_level;
mod observability;
mod original_filter;
mod pivot;
mod placement;
mod pose_filter;
mod shoulder_calibration;
mod shoulder_filter;
mod stream_timing;
mod tracking;

pub use clock_offset::ClockOffset;
pub use drift::{DriftCorrection, DriftState};
pub use frame_tree::{FrameError, FrameTree, Nanos, TransformTime};
pub use hand_eye::{
    HeadsetCalibration, HeadsetCalibrationError, HeadsetCalibrationOptions, HeadsetCalibrationVerdict,
    PosePair, TimedPose, calibrate_headset, calibrate_headset_from_one_pair, pair_streams,
};
pub use input_check::{ExpectedHeight, PoseFault, PoseStreamCheck, check_handedness, check_height};
pub use observability::{HeadAxis, Observability};
pub use pivot::{PivotFit, fit_pivot, fit_sphere};
pub use placement::{BoxPlacement, BraceSize, PlacementError, PlacementProfile, SeatedPerson, place_box};
pub use pose_filter::{FilterProfile, FilteredPose, PoseFilter, PoseFilterConfig, PoseFilterState};
pub use shoulder_calibration::{ShoulderCalibration, ShoulderOptions, ShoulderVerdict, calibrate_shoulder};
pub use shoulder_filter::{FollowSpeedLimits, ShoulderFilter};
pub use stream_timing::{StreamMeter, StreamTiming};
pub use tracking::{BodySample, RawBodyPose, TrackingAxes, UpAxis};
