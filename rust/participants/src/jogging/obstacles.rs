//! What stands where the hand would go.

use super::BLOCK;
use proact_types::{BlockId, DisplayFrame, Point, Pose, Scene, Shape};

/// This much air is kept about what the fingers pass, about the block that they are to take, and over the table,
/// metres.
const AIR: f64 = 0.015;
const AIR_AROUND: f64 = 0.016;
const AIR_TABLE: f64 = 0.004;

/// What the fingers, and the block in them, must not touch.
pub(super) struct Obstacles<'a> {
    scene: &'a Scene,
    seen: &'a DisplayFrame,
    block: BlockId,
    /// In the tip's frame.
    points: Vec<Point>,
}

impl<'a> Obstacles<'a> {
    pub(super) fn new(
        scene: &'a Scene,
        seen: &'a DisplayFrame,
        block: BlockId,
        mut points: Vec<Point>,
    ) -> Self {
        if let Some(held) = seen.hand.holds {
            let tip_from_block = seen.world_from_tip.inv_mul(&seen.blocks[held.index()]);
            let rim = |x: f64, y: f64, z: f64| tip_from_block * Point::new(x * BLOCK, y * BLOCK, z * BLOCK);
            for end in [-1.0, 1.0] {
                points
                    .extend([(1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)].map(|(x, y)| rim(x, y, end)));
            }
        }
        Self { scene, seen, block, points }
    }

    /// How far the hand is in something at `world_from_tip`, metres.
    pub(super) fn depth(&self, world_from_tip: &Pose) -> f64 {
        self.points.iter().fold(0.0, |most, point| most.max(self.depth_of(&(world_from_tip * point))))
    }

    fn depth_of(&self, point: &Point) -> f64 {
        let table = self.scene.table_height;
        let mut most = table + AIR_TABLE - point.z;
        for object in &self.scene.fixed {
            let Shape::Box { size } = object.shape else { continue };
            let at = object.pose.translation.vector;
            let top = at.z + size[2] / 2.0;
            let aside = |k: usize| size[k] / 2.0 + AIR - (point[k] - at[k]).abs();
            if top > table + 1e-3 {
                most = most.max((top + AIR - point.z).min(aside(0)).min(aside(1)));
            }
        }
        for other in BlockId::ALL.into_iter().filter(|&other| Some(other) != self.seen.hand.holds) {
            let at = self.seen.blocks[other.index()].translation.vector;
            let air = if other == self.block { AIR_AROUND } else { AIR };
            let apart = (point.coords - at).xy().norm();
            most = most.max((BLOCK + air - apart).min(at.z + BLOCK + air - point.z));
        }
        most
    }
}
