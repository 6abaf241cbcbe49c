//! What stands where the hand would go.

use crate::reach::ArmPosture;
use proact_types::{DisplayFrame, ObjectId, Point, Pose, Scene, Shape};

/// This much air is kept about what the fingers pass, about the block that they are to take, and over the table,
/// metres.
const FINGER_CLEARANCE_M: f64 = 0.015;
const TARGET_CLEARANCE_M: f64 = 0.02;
const TABLE_CLEARANCE_M: f64 = 0.004;
/// ... and about the skin of forearm and wrist.
const FOREARM_CLEARANCE_M: f64 = 0.002;

/// What the fingers, and the block in them, must not touch.
pub(super) struct Obstacles<'a> {
    scene: &'a Scene,
    seen: &'a DisplayFrame,
    block: ObjectId,
    /// In the tip's frame.
    points: Vec<Point>,
    /// Heights of shelves, on which things stand as on the table.
    shelf_heights_m: Vec<f64>,
}

impl<'a> Obstacles<'a> {
    pub(super) fn new(
        scene: &'a Scene,
        seen: &'a DisplayFrame,
        block: ObjectId,
        mut points: Vec<Point>,
    ) -> Self {
        if let Some(held) = seen.hand.held_object {
            let tip_from_block = seen.world_from_tip.inv_mul(&seen.objects[held.index()]);
            let shape = scene.objects[held.index()].shape;
            let (wide, high) = (shape.half_width(), shape.half_height());
            let rim = |x: f64, y: f64, z: f64| tip_from_block * Point::new(x * wide, y * wide, z * high);
            for end in [-1.0, 1.0] {
                points
                    .extend([(1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)].map(|(x, y)| rim(x, y, end)));
            }
        }
        let shelves = scene.shelves().into_iter().map(|(_, height)| height).collect();
        Self { scene, seen, block, points, shelf_heights_m: shelves }
    }

    /// How far hand or forearm are in something, metres.
    pub(super) fn penetration_depth_m(&self, world_from_base: &Pose, stance: &ArmPosture) -> f64 {
        let world_from_tip = world_from_base * stance.tip;
        let hand = |max_depth: f64, point: &Point| {
            let around = |other| if other == self.block { TARGET_CLEARANCE_M } else { FINGER_CLEARANCE_M };
            max_depth.max(self.point_depth_m(
                &(world_from_tip * point),
                TABLE_CLEARANCE_M,
                FINGER_CLEARANCE_M,
                around,
            ))
        };
        let forearm = |max_depth: f64, (point, radius): &(Point, f64)| {
            let air = radius + FOREARM_CLEARANCE_M;
            max_depth.max(self.point_depth_m(&(world_from_base * point), air, air, |_| air))
        };
        let max_depth = self.points.iter().fold(0.0, hand);
        stance.forearm_spheres.iter().fold(max_depth, forearm)
    }

    /// How far `point` is in something, if so much air is to be kept over the table, about what is fixed, and about
    /// a block.
    fn point_depth_m(
        &self,
        point: &Point,
        air_table: f64,
        air: f64,
        air_block: impl Fn(ObjectId) -> f64,
    ) -> f64 {
        let table = self.scene.table_height;
        let mut max_depth = table + air_table - point.z;
        for object in &self.scene.fixed {
            let Shape::Box { size } = object.shape else { continue };
            let at = object.pose.translation.vector;
            let top = at.z + size[2] / 2.0;
            let aside = |k: usize| size[k] / 2.0 + air - (point[k] - at[k]).abs();
            if top > table + 1e-3 {
                let is_shelf = self.shelf_heights_m.iter().any(|height| (height - top).abs() < 1e-6);
                let air = if is_shelf { air_table } else { air };
                max_depth = max_depth.max((top + air - point.z).min(aside(0)).min(aside(1)));
            }
        }
        for other in self.scene.ids().filter(|&other| Some(other) != self.seen.hand.held_object) {
            let at = self.seen.objects[other.index()].translation.vector;
            let air = air_block(other);
            let distance = (point.coords - at).xy().norm();
            let shape = self.scene.objects[other.index()].shape;
            let aside = shape.half_width() + air - distance;
            max_depth = max_depth.max(aside.min(at.z + shape.half_height() + air - point.z));
        }
        max_depth
    }
}
