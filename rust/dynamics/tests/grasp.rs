//! The hand closes on a block, lifts it and lets it go.

#![allow(missing_docs)]
#![allow(clippy::unwrap_used)]

mod common;

use common::{
    HEIGHT, START, TABLE, bare_table, close_until_held, grasp_base, hold_command, move_hand, plant_at,
    positions, run, standing,
};
use proact_arm::ArmModel;
use proact_dynamics::RigidBodyPlant;
use proact_testbed::ports::Plant;
use proact_types::{ObjectId, PlantCommand, Pose};

/// The hand around a block that stands at the origin, open.
fn hand_around_a_block(model: &ArmModel) -> (RigidBodyPlant, Pose) {
    let open = positions(model, &START, "open");
    let base = grasp_base(model, &open);
    let scene = bare_table(vec![standing(ObjectId(0), 0.0, 0.0)]);
    (plant_at(model, &scene, &open, &base).unwrap(), base)
}

/// Moves the base by `meters` upwards within `ticks`, the joints staying at `joints`.
fn lift(plant: &mut RigidBodyPlant, joints: &[f64], base: &mut Pose, meters: f64, ticks: u32) {
    for _ in 0..ticks {
        base.translation.z += meters / f64::from(ticks);
        plant.step(&hold_command(joints, *base)).unwrap();
    }
}

#[test]
fn thumb_and_a_finger_oppose_each_other_on_a_block_without_kicking_it() {
    let model = proact_description::mpl_right_arm();
    let (mut plant, base) = hand_around_a_block(&model);
    let holding = close_until_held(&mut plant, &model, &base, 800).unwrap().expect("the block is held");
    assert!(holding.degrees > 120.0, "{holding:?}");
    let block = plant.state().objects[0];
    assert!(block.pose.translation.vector.xy().norm() < 0.006, "{:?}", block.pose.translation);
    assert!((block.pose.translation.z - TABLE - 0.5 * HEIGHT).abs() < 1e-3);
    assert_eq!(plant.solver_warnings(), 0);
    for contact in &plant.state().contacts {
        assert!((contact.normal.norm() - 1.0).abs() < 1e-9);
        let into_block = block.pose.translation.vector - contact.point.coords;
        assert!(contact.normal.dot(&into_block) > 0.0, "normals point from the link into the block");
    }
}

#[test]
fn an_attached_block_is_lifted_and_falls_back_when_released() {
    let model = proact_description::mpl_right_arm();
    let (mut plant, mut base) = hand_around_a_block(&model);
    close_until_held(&mut plant, &model, &base, 800).unwrap().expect("the block is held");
    let before = plant.state().objects[0];
    plant.attach(0, model.tip).unwrap();
    let (block, tip_from_block) = plant.state().attached.expect("attached");
    assert_eq!(block, 0);
    let world_from_tip = plant.link_pose(model.tip).unwrap();
    let error = (world_from_tip * tip_from_block).translation.vector - before.pose.translation.vector;
    assert!(error.norm() < 1e-6, "the attachment is where the block was, off by {} m", error.norm());

    let grip = plant.state().position.to_vec();
    plant.step(&hold_command(&grip, base)).unwrap();
    let jerk = plant.state().objects[0].pose.translation.vector - before.pose.translation.vector;
    assert!(jerk.norm() < 1e-4, "attaching moved the block by {} m", jerk.norm());
    lift(&mut plant, &grip, &mut base, 0.1, 500);
    let lifted = plant.state().objects[0].pose.translation.z - before.pose.translation.z;
    assert!((lifted - 0.1).abs() < 1e-3, "lifted by {lifted} m");
    assert!(plant.state().contacts.is_empty(), "a carried block touches no link");

    run(&mut plant, &hold_command(&grip, base), 100);
    let still = plant.state().objects[0];
    assert!(still.linear_velocity.norm() < 1e-6);
    plant.release();
    assert!(plant.state().attached.is_none());
    let open = positions(&model, &START, "open");
    let commands = move_hand(&grip, &open, base, 1500);
    plant.step(&commands[0]).unwrap();
    let speed = plant.state().objects[0].linear_velocity.norm();
    assert!(
        speed < 0.011,
        "fingers that overlap a released block must not throw it, it flies at {speed} m/s"
    );
    for command in &commands[1..] {
        plant.step(command).unwrap();
    }
    let fallen = plant.state().objects[0];
    assert!(fallen.pose.translation.z < TABLE + 0.03, "the block lies on the table: {:?}", fallen.pose);
    assert!(fallen.pose.translation.vector.xy().norm() < 0.05, "near where it was let go: {:?}", fallen.pose);
}

#[test]
fn a_carried_block_loads_the_arm() {
    let model = proact_description::mpl_right_arm();
    let open = positions(&model, &START, "open");
    let base = grasp_base(&model, &open);
    let shoulder = |with_block: bool| {
        let scene = bare_table(vec![standing(ObjectId(0), 0.0, 0.0)]);
        let mut plant = plant_at(&model, &scene, &open, &base).unwrap();
        if with_block {
            plant.attach(0, model.tip).unwrap();
        }
        let mut base = base;
        lift(&mut plant, &open, &mut base, 0.1, 500);
        run(&mut plant, &hold_command(&open, base), 200);
        plant.state().effort[0]
    };
    let extra = shoulder(true) - shoulder(false);
    // 0.1 kg at some 0.5 m ahead of the shoulder.
    assert!(extra.abs() > 0.2 && extra.abs() < 0.7, "{extra} N m");
}

#[test]
fn a_finger_pushes_a_block_that_sleeps() {
    let model = proact_description::mpl_right_arm();
    let (mut plant, mut base) = hand_around_a_block(&model);
    let open = positions(&model, &START, "open");
    run(&mut plant, &hold_command(&open, base), 600);
    let start = plant.state().objects[0];
    assert_eq!(start.linear_velocity.norm(), 0.0, "a resting block sleeps");
    for _ in 0..1000 {
        base.translation.y += 8e-5;
        plant.step(&PlantCommand { world_from_base: base, ..hold_command(&open, base) }).unwrap();
    }
    let pushed = plant.state().objects[0].pose.translation.y - start.pose.translation.y;
    assert!(pushed > 0.02, "the hand swept the block by {pushed} m");
}
