//! The arm, the box and the blocks that the tests of this crate share.

#![allow(dead_code)] // each test program uses a part

use proact_dynamics::{DynamicsOptions, OdePlant};
use proact_testbed::ports::Plant;
use proact_types::{
    ArmModel, Block, BlockId, PlantCommand, Point, Pose, Scene, SceneObject, Shape, Target, joints, zeros,
};

/// Height of the table top, metres.
pub const TABLE: f64 = 1.015;
/// Radius of a block, metres.
pub const RADIUS: f64 = 0.025;
/// Height of a block, metres.
pub const HEIGHT: f64 = 0.05;

/// A block that stands on the table at x, y.
pub fn standing(id: BlockId, x: f64, y: f64) -> Block {
    block(id, Pose::translation(x, y, TABLE + 0.5 * HEIGHT))
}

/// A block with its centre at `pose`.
pub fn block(id: BlockId, pose: Pose) -> Block {
    Block {
        id,
        shape: Shape::Cylinder { radius: RADIUS, length: HEIGHT },
        mass: 0.1,
        friction: 0.4,
        friction_finger: 0.8,
        pose,
    }
}

fn box_at(name: &str, size: [f64; 3], centre: [f64; 3]) -> SceneObject {
    SceneObject {
        name: name.to_owned(),
        shape: Shape::Box { size },
        pose: Pose::translation(centre[0], centre[1], centre[2]),
        friction: 0.4,
    }
}

/// A table without walls, and a floor.
pub fn bare_table(blocks: Vec<Block>) -> Scene {
    Scene {
        fixed: vec![
            box_at("slab", [1.0, 1.0, 0.03], [0.0, 0.0, 1.0]),
            box_at("floor", [10.0, 10.0, 0.2], [0.0, 0.0, -0.1]),
        ],
        blocks,
        targets: Vec::new(),
        table_height: TABLE,
    }
}

/// The modified box-and-blocks box with four blocks.
pub fn box_scene() -> Scene {
    let mut fixed = vec![
        box_at("slab", [0.31, 0.61, 0.03], [0.0, 0.0, 1.0]),
        box_at("partition", [0.30, 0.005, 0.152], [0.0, 0.0, 1.091]),
        box_at("left wall", [0.31, 0.005, 0.085], [0.0, 0.3025, 1.0575]),
        box_at("right wall", [0.31, 0.005, 0.085], [0.0, -0.3025, 1.0575]),
        box_at("far wall", [0.005, 0.60, 0.085], [0.1525, 0.0, 1.0575]),
        box_at("near wall", [0.005, 0.60, 0.085], [-0.1525, 0.0, 1.0575]),
        box_at("floor", [10.0, 10.0, 0.2], [0.0, 0.0, -0.1]),
    ];
    for (index, (x, y)) in [(0.13, 0.28), (0.13, -0.28), (-0.13, 0.28), (-0.13, -0.28)].iter().enumerate() {
        fixed.push(SceneObject {
            name: format!("leg {index}"),
            shape: Shape::Cylinder { radius: 0.02, length: 0.985 },
            pose: Pose::translation(*x, *y, 0.4925),
            friction: 0.4,
        });
    }
    let places = [(0.058, -0.2083), (-0.058, -0.092), (-0.058, -0.2083), (0.058, -0.092)];
    let blocks: Vec<Block> =
        BlockId::ALL.iter().zip(places).map(|(id, (x, y))| standing(*id, x, y)).collect();
    let targets = blocks
        .iter()
        .map(|b| Target {
            block: b.id,
            centre: Point::new(b.pose.translation.x, -b.pose.translation.y, TABLE),
        })
        .collect();
    Scene { fixed, blocks, targets, table_height: TABLE }
}

/// The arm's pose at the start of a trial, rad.
pub const START: [f64; 7] = [1.029, -0.161, 0.1291, 1.029, 1.57, 0.0174, 0.1006];

/// All moving joints: `arm`, and the hand in the pose called `hand`.
pub fn positions(model: &ArmModel, arm: &[f64], hand: &str) -> Vec<f64> {
    let mut all = arm.to_vec();
    all.extend_from_slice(model.pose("hand", hand).expect("the model has the hand poses"));
    all
}

/// The shoulder of the `still` set-up.
pub fn still() -> Pose {
    Pose::translation(-0.39, 0.12, 1.5)
}

/// A shoulder far above everything, so that only blocks and table matter.
pub fn away() -> Pose {
    Pose::translation(-0.39, 0.12, 5.0)
}

/// A plant with the arm in its start pose and the hand open.
pub fn plant(scene: &Scene, base: &Pose) -> OdePlant {
    let model = proact_description::mpl_right_arm();
    let start = positions(&model, &START, "open");
    OdePlant::new(&model, scene, &start, base, DynamicsOptions::default()).expect("a sound scene")
}

/// A command to stay at `positions`.
pub fn stay(positions: &[f64], base: Pose) -> PlantCommand {
    PlantCommand { position: joints(positions), velocity: zeros(positions.len()), world_from_base: base }
}

/// Steps `ticks` times under one command.
pub fn run(plant: &mut OdePlant, command: &PlantCommand, ticks: usize) {
    for tick in 0..ticks {
        plant.step(command).unwrap_or_else(|error| panic!("tick {tick}: {error}"));
    }
}
