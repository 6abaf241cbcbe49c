//! The modified box-and-blocks box, in `world`: x away from the person, y left, z up. The blocks start on the
//! right half (y < 0), the targets lie on the left. Dimensions: the original's `bbt_box.urdf` and block files.

use proact_types::{Block, BlockId, Point, Pose, Region, SceneObject, Shape, Target};
use serde::Serialize;

/// Height of the table top, metres.
pub const TABLE_TOP: f64 = 1.015;
/// Radius of a block, metres. (The original box-and-blocks cubes of 25 mm are enlarged: the hand hides less.)
pub const BLOCK_RADIUS: f64 = 0.025;
/// Height of a block, metres.
pub const BLOCK_HEIGHT: f64 = 0.05;
/// Mass of a block, kg.
pub const BLOCK_MASS: f64 = 0.1;
/// Friction of blocks on table and walls. The original wrote it in a tag that its loader drops.
pub const FRICTION_TABLE: f64 = 0.4;
/// Friction of blocks on fingers; assumed, no source has a number.
pub const FRICTION_FINGER: f64 = 0.8;

const X_FAR: f64 = 0.058;
const X_NEAR: f64 = -0.058;
const Y_LATERAL: f64 = 0.2083;
const Y_MEDIAL: f64 = 0.092;

/// Centre of a region on the start side (`y < 0`), on the table top; its target is the mirror image in y.
pub fn region_centre(region: Region) -> Point {
    let x = match region {
        Region::FL | Region::FM => X_FAR,
        Region::NL | Region::NM => X_NEAR,
    };
    let y = match region {
        Region::FL | Region::NL => Y_LATERAL,
        Region::FM | Region::NM => Y_MEDIAL,
    };
    Point::new(x, -y, TABLE_TOP)
}

/// The part of the table top on which a block may be put down: the left half less wall, partition and block
/// radius (`original_proact.md` 3.6).
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct PlaceRegion {
    /// Smallest x and y, metres.
    pub min: [f64; 2],
    /// Largest x and y, metres.
    pub max: [f64; 2],
}

impl PlaceRegion {
    /// The region of the original.
    pub const DEFAULT: PlaceRegion = PlaceRegion { min: [-0.125, 0.0275], max: [0.125, 0.275] };

    /// The point of the region nearest to `point`, on the table top.
    pub fn clamp(&self, point: &Point) -> Point {
        Point::new(
            point.x.clamp(self.min[0], self.max[0]),
            point.y.clamp(self.min[1], self.max[1]),
            TABLE_TOP,
        )
    }

    /// Its middle, on the table top.
    pub fn centre(&self) -> Point {
        Point::new((self.min[0] + self.max[0]) / 2.0, (self.min[1] + self.max[1]) / 2.0, TABLE_TOP)
    }
}

/// Table, walls, partition, legs and floor.
pub fn fixed_objects() -> Vec<SceneObject> {
    let cuboid = |name: &str, size: [f64; 3], centre: [f64; 3]| SceneObject {
        name: name.to_owned(),
        shape: Shape::Box { size },
        pose: Pose::translation(centre[0], centre[1], centre[2]),
        friction: FRICTION_TABLE,
    };
    let leg = |name: &str, x: f64, y: f64| SceneObject {
        name: name.to_owned(),
        shape: Shape::Cylinder { radius: 0.02, length: 0.985 },
        pose: Pose::translation(x, y, 0.4925),
        friction: FRICTION_TABLE,
    };
    vec![
        cuboid("table", [0.31, 0.61, 0.03], [0.0, 0.0, 1.0]),
        cuboid("partition", [0.30, 0.005, 0.152], [0.0, 0.0, 1.091]),
        cuboid("wall_left", [0.31, 0.005, 0.085], [0.0, 0.3025, 1.0575]),
        cuboid("wall_right", [0.31, 0.005, 0.085], [0.0, -0.3025, 1.0575]),
        cuboid("wall_far", [0.005, 0.60, 0.085], [0.1525, 0.0, 1.0575]),
        cuboid("wall_near", [0.005, 0.60, 0.085], [-0.1525, 0.0, 1.0575]),
        // Legs end below the slab; in the original they reach 15 mm into it.
        leg("leg_far_left", 0.13, 0.28),
        leg("leg_far_right", 0.13, -0.28),
        leg("leg_near_left", -0.13, 0.28),
        leg("leg_near_right", -0.13, -0.28),
        cuboid("floor", [6.0, 6.0, 0.1], [0.0, 0.0, -0.05]),
    ]
}

/// The blocks, resting in their regions.
pub fn blocks(regions: [Region; 4]) -> Vec<Block> {
    BlockId::ALL
        .into_iter()
        .map(|id| {
            let place = region_centre(regions[id.index()]);
            Block {
                id,
                shape: Shape::Cylinder { radius: BLOCK_RADIUS, length: BLOCK_HEIGHT },
                mass: BLOCK_MASS,
                friction: FRICTION_TABLE,
                friction_finger: FRICTION_FINGER,
                pose: Pose::translation(place.x, place.y, TABLE_TOP + BLOCK_HEIGHT / 2.0),
            }
        })
        .collect()
}

/// The targets: the mirror image of the pattern red 1 far-lateral, red 2 near-medial, blue 1 far-medial, blue 2
/// near-lateral, the same in every trial (colours: the original's display; numbers: ours, it shows none).
pub fn targets() -> Vec<Target> {
    let region = |id: BlockId| match id {
        BlockId::Red1 => Region::FL,
        BlockId::Red2 => Region::NM,
        BlockId::Blue1 => Region::FM,
        BlockId::Blue2 => Region::NL,
    };
    BlockId::ALL
        .into_iter()
        .map(|block| {
            let start = region_centre(region(block));
            Target { block, centre: Point::new(start.x, -start.y, start.z) }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn defect_44_a_place_outside_the_region_goes_to_its_nearest_point() {
        let region = PlaceRegion::DEFAULT;
        let inside = Point::new(0.05, 0.2, TABLE_TOP);
        assert_eq!(region.clamp(&inside), inside);
        let far = Point::new(9.0, 0.1, TABLE_TOP);
        assert_eq!(region.clamp(&far), Point::new(region.max[0], 0.1, TABLE_TOP));
        let before = Point::new(-9.0, -9.0, TABLE_TOP + 1.0);
        assert_eq!(region.clamp(&before), Point::new(region.min[0], region.min[1], TABLE_TOP));
    }
}
