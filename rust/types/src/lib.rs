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
//! use proact_types::{Gesture, SimTime};
//! assert_eq!(Gesture::WristExtension.ros_name(), "wrist_extension");
//! assert_eq!(SimTime::from_secs(0.25), SimTime(250));
//! ```
#![cfg_attr(test, allow(clippy::unwrap_used))]

mod bounded;
mod display;
mod drive;
mod event;
mod feedback;
mod gesture;
mod gesture_commands;
mod gesture_name;
mod input;
mod instruction;
mod intention;
mod method;
mod plan;
mod safety;
mod scene;
mod target_dwell;
mod task;
mod time;
#[cfg(feature = "ts")]
pub mod typescript;
mod world;

pub use bounded::{LineRead, MOST_RECORDING_BYTES, MOST_TEXT_BYTES, read_bytes, read_line, read_text};
pub use display::{DisplayFrame, HandState, HandView, ModeView, Moves, PlannerView, TargetView};
pub use drive::{BadDegreeOfFreedom, DegreeOfFreedom, Drives, MAX_DRIVES};
pub use event::{Event, EventKind, GraspFault};
pub use feedback::{ContactView, Cue, Digit, FeedbackCue, Tone, Vibration};
pub use gesture::{Gesture, UnknownGesture};
pub use gesture_commands::{GestureCommands, GestureTableError};
pub use gesture_name::{BadGestureName, GestureName, MAX_GESTURES};
pub use input::{
    ChannelValues, EmgSample, ExternalAnswer, GazeSample, IntentAnswer, MAX_EMG_CHANNELS, MAX_SIGNS,
    MAX_TICK_SAMPLES, MethodAnswer, ParticipantAnswer, TickInput, WindowAnswer,
};
pub use instruction::Instruction;
pub use intention::{Intention, TrunkPosture};
pub use method::{
    MOST_METHOD_NAME_BYTES, MOST_METHOD_TEXT_BYTES, MethodEvent, MethodHelp, MethodInfo, MethodStyle, Needs,
};
pub use plan::{
    AttachedObject, Obstacle, PlanGoal, PlanReply, PlanRequest, PlanStatus, Trajectory, TrajectoryPoint,
};
pub use safety::{InputSign, InputSource, SignKind, Stop, StopCause};
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
