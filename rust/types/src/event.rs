use crate::{BlockId, Gesture, InputSource, PlanStatus, Point, SimTime, StopCause};
use serde::{Deserialize, Serialize};

/// Something that happened at one tick.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
// A browser has an Event of its own.
#[cfg_attr(feature = "ts", ts(rename = "TrialEvent"))]
pub struct Event {
    /// When.
    pub time: SimTime,
    /// What.
    #[serde(flatten)]
    pub kind: EventKind,
}

/// What can happen.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
#[serde(tag = "event", rename_all = "snake_case")]
pub enum EventKind {
    /// The decision rule changed the gesture in force.
    GestureChanged {
        /// The new one.
        gesture: Gesture,
    },
    /// Samples of the armband were lost or unusable; the windows that they belong to are left out.
    EmgGap {
        /// Gaps in the samples.
        gaps: u64,
        /// Samples that could not be used.
        unusable_samples: u64,
        /// Windows left out.
        rejected_windows: u64,
    },
    /// A source died: arm and method stand still until it is back and a relaxed gesture was made.
    Stopped {
        /// Which source.
        source: InputSource,
        /// How it died.
        cause: StopCause,
        /// As shown.
        reason: String,
    },
    /// The sources are back and a relaxed gesture was made: gestures act again.
    Rearmed,
    /// The tracked shoulder jumped: base, arm and hand stand still until it is back or has stayed where it is.
    BaseHeld {
        /// From the base to where it was told to be, metres.
        distance: f64,
    },
    /// The base follows the shoulder again, and arm and hand go on.
    BaseFollows,
    /// The grasp rule took a block.
    GraspMade {
        /// Which block.
        block: BlockId,
        /// Links of fingers that touched it.
        links: Vec<String>,
        /// The block's centre, `world`, m.
        #[cfg_attr(feature = "ts", ts(as = "[f64; 3]"))]
        place: Point,
    },
    /// The grasp rule let a block go.
    GraspEnded {
        /// Which block.
        block: BlockId,
        /// Links of fingers that touched it when it was taken.
        links: Vec<String>,
        /// The block's centre, `world`, m.
        #[cfg_attr(feature = "ts", ts(as = "[f64; 3]"))]
        place: Point,
    },
    /// A gaze came in that is not finite or has no direction. It counts as a blink, and so do those that follow it.
    GazeUnusable,
    /// The hand took hold of a block ("contact made").
    BlockAttached {
        /// Which block.
        block: BlockId,
    },
    /// The hand let go of a block ("contact lost").
    BlockReleased {
        /// Which block.
        block: BlockId,
    },
    /// The selection of a block or a place was locked.
    Locked {
        /// The block, or none for a place.
        block: Option<BlockId>,
    },
    /// The lock was taken off.
    Unlocked,
    /// A plan was asked for.
    PlanRequested {
        /// Number of the request in this trial.
        request: u64,
    },
    /// A plan took effect or failed.
    PlanFinished {
        /// Number of the request in this trial.
        request: u64,
        /// How it ended.
        status: PlanStatus,
    },
    /// The arm stopped before the end of its trajectory.
    MotionStopped,
    /// The trajectory was followed to its end.
    MotionFinished,
    /// A block came to rest and counts.
    BlockOnTarget {
        /// Which block.
        block: BlockId,
        /// Horizontal distance from its target's centre, metres.
        distance: f64,
    },
    /// A block came to rest somewhere else.
    BlockOffTarget {
        /// Which block.
        block: BlockId,
    },
    /// The trial is over.
    TrialFinished,
}
