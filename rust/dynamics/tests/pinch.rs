//! The pinch that is stored with the hand takes a cube of 25 mm from a table, among neighbours, and carries it.

#![allow(missing_docs)]
#![allow(clippy::unwrap_used)]

mod common;

use common::{
    START, TABLE, bare_table, base_that_puts_tip_at, hold_command, move_hand, plant_at, positions, run,
};
use nalgebra::{Rotation3, UnitQuaternion};
use proact_arm::{ArmModel, Grasp, find_pinch, upright_axis};
use proact_control::HandCommand;
use proact_dynamics::RigidBodyPlant;
use proact_testbed::{GraspAction, GraspDetector, PhysicsConfig, ports::Plant};
use proact_types::{HandState, Object, Pose, Shape, Vector};

const SIDE: f64 = 0.025;

fn cube(name: &str, x: f64, y: f64, yaw: f64) -> Object {
    let pose = Pose::translation(x, y, TABLE + 0.5 * SIDE) * Pose::rotation(Vector::z() * yaw);
    Object::with_default_friction(name, Shape::Box { size: [SIDE; 3] }, 0.01, pose)
}

/// `world_from_tip` in which `grasp` is around an object at the origin of the table, its closing direction along x but for
/// `yaw`, off by `shift`.
fn tip_around(grasp: &Grasp, yaw: f64, shift: Vector) -> Pose {
    let up = upright_axis(grasp.roll_rad, 0.0);
    let closing = grasp.closing_direction.unwrap();
    let ahead = (closing - up * up.dot(&closing)).normalize();
    // Rows are the world's axes in the tip's frame.
    let axes =
        nalgebra::Matrix3::from_rows(&[ahead.transpose(), up.cross(&ahead).transpose(), up.transpose()]);
    let turn = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes));
    let turn = UnitQuaternion::from_axis_angle(&Vector::z_axis(), yaw) * turn;
    let at = Vector::new(0.0, 0.0, TABLE + 0.5 * SIDE) + shift - turn * grasp.center;
    Pose::from_parts(at.into(), turn)
}

/// Closes the hand of `model` around the first of `blocks`; the plant and the tick in which the rule took a block.
fn close(
    model: &ArmModel,
    blocks: Vec<Object>,
    yaw: f64,
    shift: Vector,
) -> (RigidBodyPlant, Pose, Option<(usize, usize)>) {
    let grasp = model.grasp_for(SIDE);
    let open = positions(model, &START, &grasp.open_pose);
    let closed = positions(model, &START, &grasp.closed_pose);
    let base = base_that_puts_tip_at(model, &open, &tip_around(grasp, yaw, shift));
    let mut plant = plant_at(model, &bare_table(blocks), &open, &base).unwrap();
    let mut rule = GraspDetector::new(&PhysicsConfig::default(), model);
    for (tick, command) in move_hand(&open, &closed, base, 1200).iter().enumerate() {
        plant.step(command).unwrap();
        let taken = rule.step(model, plant.state(), HandState::Closing, HandCommand::Close);
        if let Some(GraspAction::Attach(block)) = taken {
            return (plant, base, Some((block, tick)));
        }
    }
    (plant, base, None)
}

#[test]
fn the_stored_pinch_is_what_the_program_finds() {
    let model = proact_description::mpl_right_arm();
    let grasp = model.grasp_for(SIDE);
    assert!(grasp.fits_width(SIDE), "{grasp:?}");
    let found = find_pinch(&model, SIDE, 0.8).unwrap();
    assert_eq!(found.grasp, *grasp);
    for pose in [&found.open, &found.closed] {
        assert_eq!(model.pose("hand", &pose.name).unwrap(), pose.angles);
    }
    assert!(
        found.contact_angle_rad < found.cone_half_angle_rad && found.table_clearance_m > 0.002,
        "{found:?}"
    );
}

#[test]
fn a_cube_is_held_where_the_hand_is_turned_or_off_by_some_millimetres() {
    let model = proact_description::mpl_right_arm();
    let shifts =
        [[0.0; 3], [4.0, 0.0, 0.0], [-4.0, 0.0, 0.0], [0.0, 4.0, 0.0], [0.0, -4.0, 0.0], [0.0, 0.0, 3.0]];
    for yaw in [0.0, 0.2, -0.2] {
        for shift in shifts {
            let shift = Vector::from(shift) * 1e-3;
            let (_, _, taken) = close(&model, vec![cube("cube1", 0.0, 0.0, 0.0)], yaw, shift);
            assert!(taken.is_some(), "turned by {yaw} rad, off by {shift:?} m");
        }
    }
}

#[test]
fn the_closed_hand_of_blocks_does_not_hold_a_cube() {
    let mut model = proact_description::mpl_right_arm();
    let pinch = model.grasp_for(SIDE).clone();
    // Around the cube as the pinch is, but with the hand poses of wide objects.
    model.grasps = vec![Grasp { open_pose: "open".into(), closed_pose: "closed".into(), ..pinch }];
    let (_, _, taken) = close(&model, vec![cube("cube1", 0.0, 0.0, 0.0)], 0.0, Vector::zeros());
    assert_eq!(taken, None);
}

#[test]
fn a_cube_among_neighbours_is_lifted_and_they_stay() {
    let model = proact_description::mpl_right_arm();
    let pitch = 0.06;
    let blocks = vec![
        cube("cube1", 0.0, 0.0, 0.0),
        cube("cube2", 0.0, pitch, 0.0),
        cube("cube3", 0.0, -pitch, 0.0),
        cube("cube4", pitch, pitch, 0.0),
    ];
    let before: Vec<Pose> = blocks.iter().map(|block| block.pose).collect();
    let (mut plant, mut base, taken) = close(&model, blocks, 0.0, Vector::zeros());
    assert_eq!(taken.unwrap().0, 0);
    plant.attach(0, model.tip).unwrap();
    let grip = plant.state().position.to_vec();
    for _ in 0..500 {
        base.translation.z += 2e-4;
        plant.step(&hold_command(&grip, base)).unwrap();
    }
    let height = plant.state().objects[0].pose.translation.z - before[0].translation.z;
    assert!((height - 0.1).abs() < 0.005, "lifted by {height} m");
    for (block, before) in plant.state().objects.iter().zip(&before).skip(1) {
        let moved = (block.pose.translation.vector - before.translation.vector).norm();
        assert!(moved < 1e-3, "a neighbour moved by {moved} m");
    }
    plant.release();
    let open = positions(&model, &START, &model.grasp_for(SIDE).open_pose);
    for command in move_hand(&grip, &open, base, 300) {
        plant.step(&command).unwrap();
    }
    run(&mut plant, &hold_command(&open, base), 600);
    assert!(plant.state().objects[0].pose.translation.z < TABLE + 0.02, "it falls when the hand opens");
}
