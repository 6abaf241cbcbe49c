//! Vocabulary of ProACT: the values that stages hand to each other.
//!
//! Everything is SI and radians. Quaternions are x, y, z, w. A transform is named
//! `target_from_source`: it takes coordinates in `source` to coordinates in `target`. Twists and Jacobians
//! are linear first, then angular.
//!
//! Pure: no clock, no files, no threads, no randomness. Every type that crosses a process or lands on disk
//! derives serde's traits.
//!
//! ```
//! use proact_types::{Command, SimTime};
//! assert_eq!(Command::WristExtension.ros_name(), "wrist_extension");
//! assert_eq!(SimTime::from_secs(0.25), SimTime(250));
//! ```
#![cfg_attr(test, allow(clippy::unwrap_used))]

mod bounded;
mod command;
mod command_map;
mod display;
mod drive;
mod event;
mod feedback;
mod gesture;
mod input;
mod instruction;
mod intention;
mod method;
mod numbers;
mod plan;
pub mod renamed_keys;
mod safety;
mod scene;
mod target_dwell;
mod task;
mod time;
#[cfg(feature = "ts")]
pub mod typescript;
mod world;

pub use bounded::{LineRead, MAX_RECORDING_BYTES, MAX_TEXT_BYTES, read_bytes, read_line, read_text};
pub use command::{Command, UnknownCommand};
pub use command_map::{CommandMap, CommandMapError};
pub use display::{ControlledDof, DisplayFrame, HandState, HandView, ModeView, PlannerView, TargetView};
pub use drive::{DegreeOfFreedom, Drives, InvalidDegreeOfFreedom, MAX_DRIVES};
pub use event::{Event, EventKind, GraspFault};
pub use feedback::{ContactView, Cue, Digit, FeedbackCue, Tone, Vibration};
pub use gesture::{Gesture, InvalidGesture, MAX_GESTURES};
pub use input::{
    ChannelValues, EmgSample, ExternalAnswer, GazeSample, IntentAnswer, MAX_EMG_CHANNELS, MAX_HEARTBEATS,
    MAX_TICK_SAMPLES, MethodAnswer, ParticipantAnswer, TickInput, WindowAnswer,
};
pub use instruction::Instruction;
pub use intention::{Intention, TrunkPosture};
pub use method::{
    MAX_METHOD_NAME_BYTES, MAX_METHOD_TEXT_BYTES, MethodEvent, MethodHelp, MethodInfo, MethodNeeds,
    MethodStyle,
};
pub use numbers::{Number, format_number, shorten_numbers, to_json, to_json_pretty};
pub use plan::{
    AttachedObject, Obstacle, PlanGoal, PlanReply, PlanRequest, PlanStatus, Trajectory, TrajectoryPoint,
};
pub use safety::{Heartbeat, HeartbeatKind, InputSource, Stop, StopCause};
pub use scene::{MAX_OBJECTS, Object, ObjectId, ObjectSet, PlaceRegion, Scene, SceneObject, Shape, Target};
pub use target_dwell::TargetDwell;
pub use task::{Briefing, Destination, JointGoal, Order, TaskContext, TaskGoal};
pub use time::{SimTime, TICK_SECS};
pub use world::{BodyState, Contact, PlantCommand, PlantState};

/// Most joints that any description may have; vectors of joint values live on the stack.
pub const MAX_JOINTS: usize = 40;

/// One number per joint, in the order that the doc of its user names. Radians, rad/s or N m.
pub type JointVector = arrayvec::ArrayVec<f64, MAX_JOINTS>;

/// A rigid transform, metres. Serialised as `{"rotation": [x, y, z, w], "translation": [x, y, z]}`.
pub type Pose = nalgebra::Isometry3<f64>;
/// A point, metres.
pub type Point = nalgebra::Point3<f64>;
/// A free vector.
pub type Vector = nalgebra::Vector3<f64>;

/// A joint vector of `len` zeros.
///
/// # Panics
/// If `len` exceeds [`MAX_JOINTS`]; descriptions with more joints are refused when they are read.
pub fn zeros(len: usize) -> JointVector {
    assert!(len <= MAX_JOINTS, "{len} joints, at most {MAX_JOINTS} fit");
    std::iter::repeat_n(0.0, len).collect()
}

/// A joint vector with the values of `slice`.
///
/// # Panics
/// If the slice is longer than [`MAX_JOINTS`].
pub fn joints(slice: &[f64]) -> JointVector {
    assert!(slice.len() <= MAX_JOINTS, "{} joints, at most {MAX_JOINTS} fit", slice.len());
    slice.iter().copied().collect()
}
