use crate::result_check::required_nullable;
use serde::{Deserialize, Serialize};

/// What became of an object that has a target.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    /// Rests within the radius of its target.
    OnTarget,
    /// Rests on the target side, elsewhere.
    CrossedOffTarget,
    /// Was in the hand and fell back on the start side.
    DroppedTableSide,
    /// Lies below the table top.
    DroppedFloor,
    /// Was pushed from its place but neither held nor brought across.
    MovedNotCrossed,
    /// Stands where it stood.
    NotAttempted,
}

impl Outcome {
    /// As written, such as `on_target`.
    pub fn as_str(self) -> &'static str {
        match self {
            Outcome::OnTarget => "on_target",
            Outcome::CrossedOffTarget => "crossed_off_target",
            Outcome::DroppedTableSide => "dropped_table_side",
            Outcome::DroppedFloor => "dropped_floor",
            Outcome::MovedNotCrossed => "moved_not_crossed",
            Outcome::NotAttempted => "not_attempted",
        }
    }
}

/// One line of the result.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ObjectResult {
    /// Name of the object.
    pub block: String,
    /// What became of it.
    pub outcome: Outcome,
    /// Seconds from the release of the object before (or the start) to the first contact; none if never held.
    #[serde(deserialize_with = "required_nullable")]
    pub pick_s: Option<f64>,
    /// Seconds from the last contact to the release; none if never released.
    #[serde(deserialize_with = "required_nullable")]
    pub place_s: Option<f64>,
    /// Horizontal distance of its centre from its target at the end, metres.
    pub distance_m: f64,
}
