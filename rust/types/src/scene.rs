use crate::{Point, Pose};
use serde::{Deserialize, Serialize};

/// A convex shape, metres, centred in its own frame; axes along z.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
#[serde(tag = "type", rename_all = "snake_case")]
pub enum Shape {
    /// Full side lengths.
    Box {
        /// Along x, y, z.
        size: [f64; 3],
    },
    /// A ball.
    Sphere {
        /// Radius.
        radius: f64,
    },
    /// Axis along z.
    Cylinder {
        /// Radius.
        radius: f64,
        /// Full length along z, flat ends.
        length: f64,
    },
    /// Axis along z.
    Capsule {
        /// Radius of the tube and of the round ends.
        radius: f64,
        /// Length of the tube without the round ends.
        length: f64,
    },
}

/// Colours of the blocks.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum BlockColour {
    /// First of the two colours in the prescribed order.
    Red,
    /// Second.
    Blue,
}

/// The four blocks, in the order that all arrays over blocks have: red 1, red 2, blue 1, blue 2.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
#[serde(rename_all = "snake_case")]
pub enum BlockId {
    /// Red, number 1.
    Red1,
    /// Red, number 2.
    Red2,
    /// Blue, number 1.
    Blue1,
    /// Blue, number 2.
    Blue2,
}

impl BlockId {
    /// All four in array order.
    pub const ALL: [BlockId; 4] = [BlockId::Red1, BlockId::Red2, BlockId::Blue1, BlockId::Blue2];
    /// The order in which the task asks for them.
    pub const PRESCRIBED_ORDER: [BlockId; 4] = [BlockId::Red1, BlockId::Blue1, BlockId::Red2, BlockId::Blue2];

    /// Position in [`BlockId::ALL`].
    pub fn index(self) -> usize {
        self as usize
    }

    /// Its colour.
    pub fn colour(self) -> BlockColour {
        match self {
            BlockId::Red1 | BlockId::Red2 => BlockColour::Red,
            BlockId::Blue1 | BlockId::Blue2 => BlockColour::Blue,
        }
    }

    /// The number painted on it.
    pub fn number(self) -> u8 {
        match self {
            BlockId::Red1 | BlockId::Blue1 => 1,
            BlockId::Red2 | BlockId::Blue2 => 2,
        }
    }

    /// Name in results: `red1`, `red2`, `blue1`, `blue2`.
    pub fn name(self) -> &'static str {
        ["red1", "red2", "blue1", "blue2"][self.index()]
    }

    /// Name of the original's model and tf frame: `redcylinder1` and so on.
    pub fn ros_name(self) -> &'static str {
        ["redcylinder1", "redcylinder2", "bluecylinder1", "bluecylinder2"][self.index()]
    }
}

/// The four places on each side of the box: near or far from the person, medial or lateral.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub enum Region {
    /// Far, lateral.
    FL,
    /// Far, medial.
    FM,
    /// Near, lateral.
    NL,
    /// Near, medial.
    NM,
}

impl Region {
    /// All four.
    pub const ALL: [Region; 4] = [Region::FL, Region::FM, Region::NL, Region::NM];
}

/// An immovable body of the scene, such as a wall of the box.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
pub struct SceneObject {
    /// Unique name.
    pub name: String,
    /// Its shape.
    pub shape: Shape,
    /// `world_from_object`.
    #[cfg_attr(feature = "ts", ts(as = "crate::typescript::Pose"))]
    pub pose: Pose,
    /// Coulomb friction coefficient against blocks.
    pub friction: f64,
}

/// A movable block.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
pub struct Block {
    /// Which one.
    pub id: BlockId,
    /// Its shape; the origin is the centre of mass.
    pub shape: Shape,
    /// Mass, kg, spread evenly.
    pub mass: f64,
    /// Friction against table, walls and other blocks.
    pub friction: f64,
    /// Friction against fingers.
    pub friction_finger: f64,
    /// `world_from_block` at the start: resting.
    #[cfg_attr(feature = "ts", ts(as = "crate::typescript::Pose"))]
    pub pose: Pose,
}

/// Where a block has to go.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
pub struct Target {
    /// The block that belongs here.
    pub block: BlockId,
    /// Centre of the disc on the table top, in `world`.
    #[cfg_attr(feature = "ts", ts(as = "[f64; 3]"))]
    pub centre: Point,
}

/// Everything in the room except the arm.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
pub struct Scene {
    /// Table, walls, partition, legs, floor.
    pub fixed: Vec<SceneObject>,
    /// Blocks in [`BlockId::ALL`] order.
    pub blocks: Vec<Block>,
    /// Targets in [`BlockId::ALL`] order.
    pub targets: Vec<Target>,
    /// Height of the table top, metres in `world`.
    pub table_height: f64,
}
