use crate::{ObjectSet, Point};
use serde::{Deserialize, Serialize};

/// What a person is told before a trial. It is all that a simulated participant knows of the task.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
#[serde(deny_unknown_fields)]
pub struct Briefing {
    /// As shown at the top of the page.
    pub title: String,
    /// What is said, as plain sentences.
    pub text: String,
    /// Which object comes next.
    pub order: Order,
    /// Where an object goes.
    pub destination: Destination,
    /// What the score counts, such as `blocks on target`.
    pub score_name: String,
    /// The highest score there is; none where it is open.
    #[serde(rename = "most")]
    pub max_score: Option<u32>,
    /// Seconds at the start in which nothing counts.
    pub practice_secs: f64,
    /// Seconds after which the trial ends, practice included.
    pub limit_secs: f64,
}

/// Which object a person is asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
#[serde(rename_all = "snake_case")]
pub enum Order {
    /// The one that the display names as the next.
    Prescribed,
    /// Whichever the person likes.
    Any,
}

/// Where a person is asked to put an object.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
#[serde(rename_all = "snake_case")]
pub enum Destination {
    /// On its own target.
    OwnTarget,
    /// Anywhere across the partition.
    Across,
    /// Where the display shows it: the place changes from one move to the next.
    #[serde(rename = "shown")]
    Displayed,
}

/// What the task asks for now, where that changes in the course of a trial.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
#[serde(tag = "type", rename_all = "snake_case")]
pub enum TaskGoal {
    /// The next object is to come to rest on this disc.
    Disc {
        /// Middle of the disc on the surface, in `world`.
        #[cfg_attr(feature = "ts", ts(as = "[f64; 3]"))]
        #[serde(rename = "centre")]
        center: Point,
        /// Radius within which the object's middle counts, metres.
        radius: f64,
    },
    /// The centre of the hand's grasp is to stay in this ball.
    Ball {
        /// Middle of the ball, in `world`.
        #[cfg_attr(feature = "ts", ts(as = "[f64; 3]"))]
        #[serde(rename = "centre")]
        center: Point,
        /// Radius, metres.
        radius: f64,
    },
    /// These joints of the arm are to stay at these angles.
    Posture {
        /// The joints that count; all others are free.
        joints: Vec<JointGoal>,
    },
}

/// Where a joint is asked to be.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
pub struct JointGoal {
    /// Its place in the arm, from 0 at the base.
    pub joint: u8,
    /// rad.
    pub angle: f64,
    /// It may be off by this much, rad.
    pub tolerance: f64,
}

/// What the task says about what a person will take next, before any gaze.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct TaskContext {
    /// Objects that it asks for now.
    #[serde(rename = "due")]
    pub expected_objects: ObjectSet,
    /// Changes with what the person has done: a new number begins a new selection.
    #[serde(rename = "number")]
    pub selection_number: u32,
}
