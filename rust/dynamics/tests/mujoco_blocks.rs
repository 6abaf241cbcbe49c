//! Blocks that slide, are pushed and are pinched, beside MujocoArm. Skipped without MujocoArm: `./proact peers` gets it.

#![allow(missing_docs)]
#![allow(clippy::unwrap_used)]
#![allow(clippy::disallowed_methods)] // MujocoArm reads its commands from a file

mod common;
#[path = "common/mujoco.rs"]
mod mujoco;

use common::{HEIGHT, START, TABLE, bare_table, block, far_base, grasp_base, hold_command, positions};
use mujoco::{MujocoArm, MujocoArmDrive, MujocoArmRun, MujocoArmTrace};
use proact_dynamics::{DynamicsOptions, PhysicsEngine, RigidBodyPlant};
use proact_testbed::ports::Plant;
use proact_types::{BodyState, Contact, ObjectId, PlantCommand, Pose, Vector};

/// A block at x, y that sinks into the table by the overlap that resting contacts keep.
fn resting(x: f64, y: f64) -> proact_types::Object {
    block(ObjectId::new(0), Pose::translation(x, y, TABLE + 0.5 * HEIGHT - 5e-5))
}

/// Where the first block is after each tick, and the forces on it.
struct BlockTrace {
    blocks: Vec<Vector>,
    /// Of the thumb's links, N.
    thumb: Vec<f64>,
    /// Of the other digits'.
    fingers: Vec<f64>,
}

fn ours(plant: &mut RigidBodyPlant, commands: &[PlantCommand]) -> BlockTrace {
    let model = proact_description::mpl_right_arm();
    let mut out = BlockTrace { blocks: Vec::new(), thumb: Vec::new(), fingers: Vec::new() };
    for command in commands {
        plant.step(command).unwrap();
        let state = plant.state();
        let (thumb, fingers): (Vec<&Contact>, Vec<&Contact>) =
            state.contacts.iter().partition(|contact| model.links[contact.link].name.contains("thumb"));
        out.blocks.push(state.objects[0].pose.translation.vector);
        out.thumb.push(thumb.iter().map(|contact| contact.force).sum());
        out.fingers.push(fingers.iter().map(|contact| contact.force).sum());
    }
    out
}

fn place(answer: &MujocoArmTrace, tick: usize) -> Vector {
    let [x, y, z, ..] = answer.blocks[tick][0];
    Vector::new(x, y, z)
}

/// Mean force of the thumb and of the other digits over the last `ticks` of the first `end`, N.
fn forces(answer: &MujocoArmTrace, end: usize, ticks: usize) -> (f64, f64) {
    let (mut thumb, mut fingers) = (0.0, 0.0);
    for (name, force) in answer.forces[end - ticks..end].iter().flatten() {
        *(if name.contains("thumb") { &mut thumb } else { &mut fingers }) += force / ticks as f64;
    }
    (thumb, fingers)
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// Of the way that a sliding block should go by hand: it pitches a little as it stops, and the speeds of a tick are those at
/// its end (found 0.5 %).
const SLIDE_BY_HAND: f64 = 0.02;
/// The same of MujocoArm, whose cone of friction is convex: what slides is lifted a little, and is braked by less or more as its
/// rim comes down (found 1 to 2 % along the slide).
const SLIDE_OF_MUJOCO: f64 = 0.15;

#[test]
fn a_block_slides_as_far_in_every_direction() {
    let model = proact_description::mpl_right_arm();
    let start = positions(&model, &START, "open");
    let scene = bare_table(vec![resting(0.0, 0.0)]);
    let commands = vec![hold_command(&start, far_base()); 400];
    let speed = 0.8;
    let expected = speed * speed / (2.0 * 0.4 * 9.80665);
    let mujoco = MujocoArm::find();
    for degrees in [0.0_f64, 22.5, 45.0, 100.0] {
        let along = Vector::new(degrees.to_radians().cos(), degrees.to_radians().sin(), 0.0);
        let trajectory_of = |engine| {
            let options = DynamicsOptions { engine, ..DynamicsOptions::default() };
            let mut plant = RigidBodyPlant::new(&model, &scene, &start, &far_base(), options).unwrap();
            let pose = scene.objects[0].pose;
            plant
                .place(
                    0,
                    &BodyState { pose, linear_velocity: speed * along, angular_velocity: Vector::zeros() },
                )
                .unwrap();
            ours(&mut plant, &commands).blocks[399] - pose.translation.vector
        };
        let (reduced, ode) = (trajectory_of(PhysicsEngine::Reduced), trajectory_of(PhysicsEngine::Ode));
        println!(
            "{degrees} degrees: reduced {:.1} mm, ode {:.1}, by hand {:.1}",
            1e3 * reduced.dot(&along),
            1e3 * ode.dot(&along),
            1e3 * expected
        );
        assert!((reduced - expected * along).norm() < SLIDE_BY_HAND * expected, "{reduced} m");
        let Some(mujoco) = &mujoco else { continue };
        let speeds = [speed * along];
        let drive = MujocoArmDrive::Speeds(&commands);
        let run = MujocoArmRun {
            name: "slide",
            start: &start,
            free: 1,
            base: far_base(),
            scene: &scene,
            block_speeds: &speeds,
            drive,
        };
        let theirs = place(&mujoco.run(&run), 399) - scene.objects[0].pose.translation.vector;
        println!("{degrees} degrees: MujocoArm {:.1} mm", 1e3 * theirs.dot(&along));
        assert!((reduced - theirs).norm() < SLIDE_OF_MUJOCO * expected, "{reduced} and {theirs} m");
    }
}

/// Of a block pushed over 5 cm by a finger or the thumb, metres. Pushed at one point it turns aside, and what it is beside
/// the middle grows by e in some 4 cm; MujocoArm's block bounces on the finger that pushes it, by what its friction lifts it, so
/// that its start is another (found 1.0 to 2.1 mm).
const PUSHED_BOUND: f64 = 5e-3;

/// The base that pushes goes from rest to `speed` and back to rest.
fn pushed(base: Pose, along: Vector, speed: f64, ticks: usize) -> Vec<Pose> {
    let ramp = 100.0;
    let mut at = base;
    (0..ticks)
        .map(|tick| {
            let (tick, last) = (tick as f64, ticks as f64 - 200.0);
            let share = (tick / ramp).min((last - tick) / ramp).clamp(0.0, 1.0);
            at.translation.vector += 1e-3 * speed * share * along;
            at
        })
        .collect()
}

#[test]
fn a_block_that_is_pushed_goes_where_it_goes_in_mujoco() {
    let Some(mujoco) = MujocoArm::find() else { return };
    let model = proact_description::mpl_right_arm();
    let start = positions(&model, &START, "open");
    let grasp = grasp_base(&model, &start);
    let slant = Vector::new(0.5, 0.75_f64.sqrt(), 0.0);
    for (name, along, x, ticks) in
        [("left", Vector::y(), 0.0, 1250), ("right", -Vector::y(), 0.0, 900), ("aslant", slant, 0.02, 1300)]
    {
        // The block stands between thumb and fingers.
        let base = grasp;
        let scene = bare_table(vec![resting(x, 0.0)]);
        let commands: Vec<PlantCommand> =
            pushed(base, along, 0.1, ticks).into_iter().map(|base| hold_command(&start, base)).collect();
        let path = |engine| {
            let options = DynamicsOptions { engine, ..DynamicsOptions::default() };
            let mut plant = RigidBodyPlant::new(&model, &scene, &start, &base, options).unwrap();
            ours(&mut plant, &commands).blocks
        };
        let (reduced, ode) = (path(PhysicsEngine::Reduced), path(PhysicsEngine::Ode));
        let drive = MujocoArmDrive::Speeds(&commands);
        let run = MujocoArmRun {
            name: "push",
            start: &start,
            free: 7,
            base,
            scene: &scene,
            block_speeds: &[],
            drive,
        };
        let theirs = mujoco.run(&run);
        let worst =
            |path: &[Vector]| (0..ticks).map(|t| (path[t] - place(&theirs, t)).norm()).fold(0.0, f64::max);
        let displacement = reduced[ticks - 1] - scene.objects[0].pose.translation.vector;
        println!(
            "{name}: pushed by {:.0} mm to {:.1} {:.1} mm; apart from MujocoArm on the way: reduced {:.2} mm, ode {:.2} mm",
            1e3 * displacement.norm(),
            1e3 * displacement.x,
            1e3 * displacement.y,
            1e3 * worst(&reduced),
            1e3 * worst(&ode)
        );
        assert!(displacement.norm() > 0.04, "{name}: the block moves by {displacement} m");
        assert!(worst(&reduced) < PUSHED_BOUND, "{name}: {} m apart", worst(&reduced));
    }
}

/// Of a block that closing fingers push against the thumb, metres: contacts of both give way by tenths of a millimetre
/// (found 0.17 mm).
const PINCHED_BOUND: f64 = 1e-3;
/// Of the mean forces of a pinch: the motors' torques at their limits are the same, over levers of 3 cm that end as far apart as
/// the block (found less than 1 %).
const PINCH_SHARE: f64 = 0.1;
/// Of the block when it is lifted, metres: which of two fingers bears more of it is for friction to say, and between two
/// tips it swings until a third touches it (found 5.3 mm).
const LIFTED_BOUND: f64 = 6e-3;

/// Commands that close the hand at a quarter of its speed, so that the block is moved rather than hit.
fn closing(from: &[f64], to: &[f64], base: Pose, ticks: usize) -> Vec<PlantCommand> {
    let mut command = hold_command(from, base);
    (0..ticks)
        .map(|_| {
            for (k, angle) in command.position.iter_mut().enumerate() {
                let increment = (to[k] - *angle).clamp(-5e-4, 5e-4);
                *angle += increment;
                command.velocity[k] = increment / 1e-3;
            }
            command.clone()
        })
        .collect()
}

#[test]
fn a_pinched_block_is_pressed_and_lifted_as_in_mujoco() {
    let Some(mujoco) = MujocoArm::find() else { return };
    let model = proact_description::mpl_right_arm();
    let start = positions(&model, &START, "open");
    let closed = positions(&model, &START, "closed");
    let base = grasp_base(&model, &start);
    let scene = bare_table(vec![resting(0.0, 0.0)]);
    let mut commands = closing(&start, &closed, base, 1500);
    let held = commands[1499].clone();
    commands.extend(
        pushed(base, Vector::z(), 0.05, 1200).into_iter().map(|base| hold_command(&held.position, base)),
    );
    // Joints at rest would bear any load.
    let options = DynamicsOptions { lock_idle_hand: false, ..DynamicsOptions::default() };
    let mut plant = RigidBodyPlant::new(&model, &scene, &start, &base, options).unwrap();
    let mine = ours(&mut plant, &commands);
    let drive = MujocoArmDrive::Speeds(&commands);
    let run = MujocoArmRun {
        name: "pinch",
        start: &start,
        free: start.len(),
        base,
        scene: &scene,
        block_speeds: &[],
        drive,
    };
    let theirs = mujoco.run(&run);
    let distance = |tick: usize| (mine.blocks[tick] - place(&theirs, tick)).norm();
    let (thumb, fingers) = (mean(&mine.thumb[1200..1500]), mean(&mine.fingers[1200..1500]));
    let (their_thumb, their_fingers) = forces(&theirs, 1500, 300);
    println!(
        "pinched {:.2} mm apart; thumb {thumb:.2} and {their_thumb:.2} N, fingers {fingers:.2} and {their_fingers:.2} N",
        1e3 * distance(1499)
    );
    println!(
        "lifted by {:.1} mm, {:.2} mm apart",
        1e3 * (mine.blocks[2699].z - mine.blocks[1499].z),
        1e3 * distance(2699)
    );
    assert!(distance(1499) < PINCHED_BOUND, "{} m apart", distance(1499));
    assert!(mine.blocks[2699].z - mine.blocks[1499].z > 0.03, "the block is lifted by friction");
    assert!(distance(2699) < LIFTED_BOUND, "{} m apart", distance(2699));
    assert!((thumb - their_thumb).abs() < PINCH_SHARE * their_thumb, "{thumb} and {their_thumb} N");
    assert!((fingers - their_fingers).abs() < PINCH_SHARE * their_fingers, "{fingers} and {their_fingers} N");
}
