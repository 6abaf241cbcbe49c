use crate::{Gesture, InputSign, JointVector, PlanReply, Point, Pose, Vector};
use arrayvec::ArrayVec;
use serde::{Deserialize, Serialize};

/// Most EMG channels of any armband or amplifier that a stream may have.
pub const MAX_EMG_CHANNELS: usize = 16;

/// One sample of all EMG channels.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct EmgSample {
    /// The device's sample counter: a step of more than one is a gap.
    pub counter: u64,
    /// One value per channel, in the device's counts (or volts: LDA does not care, thresholds do).
    pub channels: ArrayVec<f64, MAX_EMG_CHANNELS>,
}

/// One gaze measurement.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
pub struct GazeSample {
    /// The eye, in `world`.
    #[cfg_attr(feature = "ts", ts(as = "[f64; 3]"))]
    pub origin: Point,
    /// Where it looks, in `world`; any length above zero.
    #[cfg_attr(feature = "ts", ts(as = "[f64; 3]"))]
    pub direction: Vector,
    /// False while the tracker has lost the eye or the person blinks.
    pub valid: bool,
}

/// What a method in another process answered to one control step: its line, or why there is none.
pub type MethodAnswer = Result<String, String>;

/// Most signs that one tick can hold: one of each kind that a source may give at once.
pub const MAX_SIGNS: usize = 8;

/// Everything that enters the testbed from outside in one tick. The sequence of these, with the configuration
/// and the seeds, is the trial.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TickInput {
    /// EMG samples that arrived in this tick, oldest first.
    pub emg: ArrayVec<EmgSample, 8>,
    /// A gesture given directly (keys, buttons), in force until the next one. Overrides the classifier.
    pub gesture: Option<Gesture>,
    /// New gaze measurement.
    pub gaze: Option<GazeSample>,
    /// New tracked shoulder pose: `world_from_shoulder`, the place and attitude of the arm's `base_link`.
    pub shoulder: Option<Pose>,
    /// New tracked angles of the person's own limb, in the joints of the arm, rad. Those of joints that the
    /// prosthesis has do not matter.
    pub limb: Option<JointVector>,
    /// What was heard of live sources, for the decision whether they are alive. Simulated ones give none.
    pub signs: ArrayVec<InputSign, MAX_SIGNS>,
    /// Plans that took effect in this tick. Filled by the tick itself when it records, and by a replay.
    pub plan: Option<PlanReply>,
    /// What a method in another process answered in this tick. Filled as `plan` is.
    pub method: Option<MethodAnswer>,
}
