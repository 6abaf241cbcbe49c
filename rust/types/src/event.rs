use crate::{Command, InputSource, ObjectId, PlanStatus, Point, SimTime, StopCause};
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

/// Why a hand that closed holds nothing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
#[serde(rename_all = "snake_case")]
pub enum GraspFault {
    /// The hand has no grasp for an object of this width.
    NoGrasp,
    /// Nothing was between the digits.
    Nothing,
    /// The digits closed without touching the object.
    NotTouched,
    /// One digit alone touched it.
    OneDigit,
    /// Two digits or more touch it, but none presses against another one, or too weakly.
    NotOpposing,
    /// Two digits or more touched it, and it slipped out.
    Slipped,
}

/// What can happen.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
#[serde(tag = "event", rename_all = "snake_case", deny_unknown_fields)]
pub enum EventKind {
    /// The decision rule changed the gesture in force.
    GestureChanged {
        /// The new one.
        gesture: Command,
    },
    /// Samples of the armband were lost or unusable; the windows that they belong to are left out.
    EmgGap {
        /// Gaps in the samples.
        #[cfg_attr(feature = "ts", ts(type = "number"))]
        gaps: u64,
        /// Samples that could not be used.
        #[cfg_attr(feature = "ts", ts(type = "number"))]
        unusable_samples: u64,
        /// Windows left out.
        #[cfg_attr(feature = "ts", ts(type = "number"))]
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
    /// From this tick on, until a tick that is not like it, the solver met the laws of contact inexactly.
    ContactsUnsolved,
    /// The grasp rule took an object.
    GraspMade {
        /// Which object.
        object: ObjectId,
        /// Links of fingers that touched it.
        links: Vec<String>,
        /// The object's centre, `world`, m.
        #[cfg_attr(feature = "ts", ts(as = "[f64; 3]"))]
        place: Point,
    },
    /// The grasp rule let an object go.
    GraspEnded {
        /// Which object.
        object: ObjectId,
        /// Links of fingers that touched it when it was taken.
        links: Vec<String>,
        /// The object's centre, `world`, m.
        #[cfg_attr(feature = "ts", ts(as = "[f64; 3]"))]
        place: Point,
    },
    /// The hand closed and holds nothing.
    GraspFailed {
        /// The object that it closed on; none if nothing was near.
        object: Option<ObjectId>,
        /// Why.
        reason: GraspFault,
    },
    /// A gaze came in that is not finite or has no direction. It counts as a blink, and so do those that follow it.
    GazeUnusable,
    /// The hand took hold of an object ("contact made").
    ObjectAttached {
        /// Which object.
        object: ObjectId,
    },
    /// The hand let go of an object ("contact lost").
    ObjectReleased {
        /// Which object.
        object: ObjectId,
    },
    /// The selection of an object or a place was locked.
    Locked {
        /// The object, or none for a place.
        object: Option<ObjectId>,
    },
    /// The lock was taken off.
    Unlocked,
    /// A plan was asked for.
    PlanRequested {
        /// Number of the request in this trial.
        #[cfg_attr(feature = "ts", ts(type = "number"))]
        request: u64,
    },
    /// A plan took effect or failed.
    PlanFinished {
        /// Number of the request in this trial.
        #[cfg_attr(feature = "ts", ts(type = "number"))]
        request: u64,
        /// How it ended.
        status: PlanStatus,
        /// One sentence when there is no full plan. Of a start or goal in collision it names both
        /// links, or the link and the obstacle.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        #[cfg_attr(feature = "ts", ts(optional))]
        reason: Option<String>,
    },
    /// As many plans failed in a row as the configuration allows (`failed_plans_limit`).
    PlansFailed {
        /// How many.
        count: u32,
        /// Why the last one failed.
        reason: String,
    },
    /// The control method says something of its own.
    MethodNote {
        /// What it says.
        text: String,
    },
    /// The arm stopped before the end of its trajectory.
    MotionStopped,
    /// The trajectory was followed to its end.
    MotionFinished,
    /// An object came to rest and counts.
    ObjectOnTarget {
        /// Which object.
        object: ObjectId,
        /// Horizontal distance from its target's centre, metres.
        distance: f64,
    },
    /// An object came to rest somewhere else.
    ObjectOffTarget {
        /// Which object.
        object: ObjectId,
    },
    /// An object was carried across the partition and counts.
    ObjectCrossed {
        /// Which object.
        object: ObjectId,
    },
    /// Few objects were left to take: those that were across fall back to where they began.
    ObjectsRefilled {
        /// How many.
        count: u32,
    },
    /// The hand or the joints stayed where they were asked to be.
    GoalReached {
        /// Which goal of the trial, from 1.
        number: u32,
    },
    /// They were not there in time.
    GoalMissed {
        /// Which goal of the trial, from 1.
        number: u32,
    },
    /// Practice is over: from now on it counts.
    PracticeFinished,
    /// The trial is over.
    TrialFinished,
}

#[cfg(test)]
mod tests {
    use super::*;

    // Catches a renamed key whose value came back as none.
    #[test]
    fn an_event_with_a_renamed_key_is_refused_with_its_name() {
        let events = [
            EventKind::GraspFailed { object: None, reason: GraspFault::Slipped },
            EventKind::Locked { object: Some(ObjectId(2)) },
            EventKind::MotionFinished,
        ];
        for kind in events {
            let event = Event { time: SimTime(7), kind };
            let text = serde_json::to_string(&event).unwrap();
            assert_eq!(serde_json::from_str::<Event>(&text).unwrap(), event);
            if text.contains("object") {
                let error = serde_json::from_str::<Event>(&text.replace("object", "objekt")).unwrap_err();
                assert!(error.to_string().contains("objekt"), "{error}");
            }
            let other = text.replacen("\"event\":\"", "\"event\":\"other_", 1);
            let error = serde_json::from_str::<Event>(&other).unwrap_err();
            assert!(error.to_string().contains("unknown variant"), "{error}");
        }
    }
}
