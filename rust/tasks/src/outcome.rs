use proact_types::BlockId;
use serde::{Deserialize, Serialize};

/// A block counts when it rests with its centre within this horizontal distance of its target, metres.
pub const TARGET_RADIUS: f64 = 0.05;

/// What became of a block.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    /// Rests within [`TARGET_RADIUS`] of its target.
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

/// One line of the result.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct BlockResult {
    /// Which block.
    #[serde(with = "block_name")]
    pub block: BlockId,
    /// What became of it.
    pub outcome: Outcome,
    /// Seconds from the release of the block before (or the start) to the first contact; none if never held.
    pub pick_s: Option<f64>,
    /// Seconds from the last contact to the release; none if never released.
    pub place_s: Option<f64>,
    /// Horizontal distance of its centre from its target at the end, metres.
    pub distance_m: f64,
}

mod block_name {
    use proact_types::BlockId;
    use serde::{Deserialize, Deserializer, Serializer, de::Error};

    pub fn serialize<S: Serializer>(block: &BlockId, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(block.name())
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<BlockId, D::Error> {
        let name = String::deserialize(deserializer)?;
        BlockId::ALL
            .into_iter()
            .find(|b| b.name() == name)
            .ok_or_else(|| D::Error::custom(format!("block {name:?}; expected red1, red2, blue1 or blue2")))
    }
}
