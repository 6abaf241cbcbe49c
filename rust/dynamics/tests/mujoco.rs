//! The arm beside MujocoArm, which builds the same arm from the same URDF by a program of its own: undriven, driven, on a base
//! that moves, with free fingers, and under given torques. Skipped without MujocoArm: `./proact peers` gets it.

#![allow(missing_docs)]
#![allow(clippy::unwrap_used)]
#![allow(clippy::disallowed_methods)] // MujocoArm reads its commands from a file

mod common;
#[path = "common/mujoco.rs"]
mod mujoco;

use common::{START, bare_table, hold_command, plant_at, positions, still};
use mujoco::{MujocoArm, MujocoArmDrive, MujocoArmRun, MujocoArmTrace};
use nalgebra::UnitQuaternion;
use proact_arm::ArmModel;
use proact_dynamics::{DynamicsOptions, PhysicsEngine, RigidBodyPlant};
use proact_testbed::ports::Plant;
use proact_types::{PlantCommand, Pose, Scene};
use std::f64::consts::{PI, TAU};

/// Half a second of falling, in which joints turn by up to two radians; rad. Seven limp joints are chaotic: what two
/// integrators differ by grows tenfold in a few tenths of a second (found 3e-4; 2e-3 after a second).
const UNDRIVEN_BOUND: f64 = 1e-3;
/// The same on a base that sways, whose commanded places are followed in steps of a tick (found 4e-4).
const UNDRIVEN_SWAY_BOUND: f64 = 3e-3;
/// Two seconds under the same law of control, rad: MujocoArm's motors are at their limit 0.01 rad/s beside the asked speed, ours
/// at 1e-7, and the law corrects a speed's error within 5 ms; 0.01 / 200 is what that can leave (found 1e-5).
const CONTROLLED_BOUND: f64 = 5e-5;
/// Torques apart, as a share of theirs, root mean squares of all joints: the accelerations of the two differ by one in a
/// thousand, since ours change in steps of a tick (found 3e-5).
const EFFORT_SHARE: f64 = 1e-3;
/// Five seconds under given torques, rad, of an arm that hangs, so that gravity calls it back; what a tick's mean torque
/// differs from its course adds up in the forearm's turn, the lightest (found 3e-4).
const TORQUES_BOUND: f64 = 1e-3;

/// Largest difference of a joint up to a tick, whole turns apart, rad.
fn difference(ours: &[Vec<f64>], theirs: &[Vec<f64>], ticks: usize) -> f64 {
    let angle_distance = |a: f64, b: f64| ((a - b + PI).rem_euclid(TAU) - PI).abs();
    let rows = ours.iter().zip(theirs).take(ticks);
    rows.flat_map(|(a, b)| a.iter().zip(b).map(move |(a, b)| angle_distance(*a, *b))).fold(0.0, f64::max)
}

/// Root mean square of the differences over that of `theirs`. The first 50 ms are left out, in which MujocoArm's motors, which
/// start without a load, sink into it.
fn share(ours: &[Vec<f64>], theirs: &[Vec<f64>]) -> f64 {
    let (mut max_difference, mut all) = (0.0, 0.0);
    for (a, b) in ours.iter().zip(theirs).skip(50) {
        for (a, b) in a.iter().zip(b) {
            max_difference += (a - b).powi(2);
            all += b.powi(2);
        }
    }
    (max_difference / all).sqrt()
}

fn empty_scene() -> Scene {
    Scene { fixed: Vec::new(), ..bare_table(Vec::new()) }
}

/// A shoulder that sways by 5 cm and 0.1 rad, from rest.
fn swaying(seconds: f64) -> Pose {
    let fraction = 0.5 * (1.0 - (TAU * seconds).cos());
    let still = still();
    let turn = UnitQuaternion::from_euler_angles(0.1 * fraction, -0.05 * fraction, 0.08 * fraction);
    let shift = nalgebra::Translation3::new(0.05 * fraction, -0.04 * fraction, 0.03 * fraction);
    Pose::from_parts(shift * still.translation, turn * still.rotation)
}

fn undriven(mut model: ArmModel) -> ArmModel {
    for joint in &mut model.joints {
        (joint.damping, joint.friction, joint.limits.effort) = (0.0, 0.0, 0.0);
        (joint.limits.lower, joint.limits.upper) = (f64::NEG_INFINITY, f64::INFINITY);
    }
    model
}

/// Angles and torques of the first `free` joints after each command.
struct PlantTrace {
    angles: Vec<Vec<f64>>,
    efforts: Vec<Vec<f64>>,
}

fn ours(plant: &mut RigidBodyPlant, commands: &[PlantCommand], free: usize) -> PlantTrace {
    let (mut angles, mut efforts) = (Vec::new(), Vec::new());
    for command in commands {
        plant.step(command).unwrap();
        angles.push(plant.state().position[..free].to_vec());
        efforts.push(plant.state().effort[..free].to_vec());
    }
    PlantTrace { angles, efforts }
}

fn theirs(
    mujoco: &MujocoArm,
    name: &str,
    start: &[f64],
    free: usize,
    drive: MujocoArmDrive<'_>,
) -> MujocoArmTrace {
    mujoco.run(&MujocoArmRun {
        name,
        start,
        free,
        base: still(),
        scene: &empty_scene(),
        block_speeds: &[],
        drive,
    })
}

/// The limp arm, hand merged.
fn free_fall(start: &[f64], commands: &[PlantCommand], engine: PhysicsEngine) -> Vec<Vec<f64>> {
    let model = undriven(proact_description::mpl_right_arm());
    let options = DynamicsOptions { engine, ..DynamicsOptions::default() };
    let mut plant = RigidBodyPlant::new(&model, &empty_scene(), start, &still(), options).unwrap();
    ours(&mut plant, commands, 7).angles
}

#[test]
fn an_undriven_arm_falls_as_in_mujoco() {
    let Some(mujoco) = MujocoArm::find() else { return };
    let model = proact_description::mpl_right_arm();
    for (name, arm) in [("start", START), ("stretched", [1.2, -0.2, 0.3, 0.2, 0.1, 0.1, 0.1])] {
        let start = positions(&model, &arm, "open");
        for (sways, bound) in [(false, UNDRIVEN_BOUND), (true, UNDRIVEN_SWAY_BOUND)] {
            let base = |tick| if sways { swaying(f64::from(tick) * 1e-3) } else { still() };
            let commands: Vec<PlantCommand> =
                (1..=1000).map(|tick| hold_command(&start, base(tick))).collect();
            let theirs = theirs(&mujoco, "fall", &start, 7, MujocoArmDrive::Undriven(&commands)).angles;
            let reduced = free_fall(&start, &commands, PhysicsEngine::Reduced);
            let ode = free_fall(&start, &commands, PhysicsEngine::Ode);
            for ticks in [250, 500, 1000] {
                println!(
                    "{name}, base sways {sways}, {ticks} ms: reduced {:.1e} rad, ode {:.1e} rad",
                    difference(&reduced, &theirs, ticks),
                    difference(&ode, &theirs, ticks)
                );
            }
            assert!(difference(&reduced, &theirs, 500) < bound);
        }
    }
}

/// Commands by which joint k goes to and fro by `way(k)`, at 2 rad/s of phase, on `base`.
fn oscillate(
    start: &[f64],
    ticks: u32,
    amplitude: impl Fn(usize) -> f64,
    base: impl Fn(f64) -> Pose,
) -> Vec<PlantCommand> {
    let command = |tick| {
        let time = f64::from(tick) * 1e-3;
        let mut command = hold_command(start, base(time));
        for k in 0..start.len() {
            command.position[k] += amplitude(k) * (1.0 - (2.0 * time).cos());
            command.velocity[k] = 2.0 * amplitude(k) * (2.0 * time).sin();
        }
        command
    };
    (1..=ticks).map(command).collect()
}

fn joint_amplitude(k: usize) -> f64 {
    match k {
        4 => -0.1,
        0..7 => 0.1,
        _ => 0.0,
    }
}

#[test]
fn a_driven_arm_moves_with_the_torques_that_it_has_in_mujoco() {
    let Some(mujoco) = MujocoArm::find() else { return };
    let model = proact_description::mpl_right_arm();
    let start = positions(&model, &START, "open");
    for sways in [false, true] {
        let commands =
            oscillate(&start, 2000, joint_amplitude, |time| if sways { swaying(time) } else { still() });
        let mut plant = plant_at(&model, &empty_scene(), &start, &still()).unwrap();
        let mine = ours(&mut plant, &commands, 7);
        let moved = mine.angles.iter().map(|angles| (angles[0] - start[0]).abs()).fold(0.0, f64::max);
        assert!(moved > 0.15, "the arm moves: {moved} rad");
        let theirs = theirs(&mujoco, "control", &start, 7, MujocoArmDrive::Speeds(&commands));
        let max_difference = difference(&mine.angles, &theirs.angles, 2000);
        let efforts = share(&mine.efforts, &theirs.efforts);
        println!("base sways {sways}, 2 s: {max_difference:.1e} rad, torques {efforts:.1e} of theirs apart");
        assert!(max_difference < CONTROLLED_BOUND, "{max_difference} rad apart");
        assert!(efforts < EFFORT_SHARE, "torques {efforts} of theirs apart");
    }
}

#[test]
fn free_fingers_move_as_in_mujoco() {
    let Some(mujoco) = MujocoArm::find() else { return };
    let model = proact_description::mpl_right_arm();
    let start = positions(&model, &START, "open");
    let closed = positions(&model, &START, "closed");
    let amplitude = |k: usize| 0.4 * (closed[k] - start[k]);
    let commands = oscillate(&start, 2000, amplitude, |_| still());
    // Joints at rest share a body otherwise, and tell no torques.
    let options = DynamicsOptions { lock_idle_hand: false, ..DynamicsOptions::default() };
    let mut plant = RigidBodyPlant::new(&model, &empty_scene(), &start, &still(), options).unwrap();
    let mut mine = ours(&mut plant, &commands, start.len());
    let moved = (0..start.len()).map(|k| (mine.angles[1500][k] - start[k]).abs()).fold(0.0, f64::max);
    assert!(moved > 0.5, "the fingers move: {moved} rad");
    // Joints without a range are none there.
    let moves: Vec<usize> = model
        .moving()
        .enumerate()
        .filter(|&(_, joint)| model.joints[joint].limits.upper > model.joints[joint].limits.lower)
        .map(|(k, _)| k)
        .collect();
    for rows in [&mut mine.angles, &mut mine.efforts] {
        for row in rows.iter_mut() {
            *row = moves.iter().map(|&k| row[k]).collect();
        }
    }
    let theirs = theirs(&mujoco, "fingers", &start, start.len(), MujocoArmDrive::Speeds(&commands));
    let max_difference = difference(&mine.angles, &theirs.angles, 2000);
    let only = |rows: &[Vec<f64>]| -> Vec<Vec<f64>> { rows.iter().map(|row| row[7..].to_vec()).collect() };
    let efforts = share(&only(&mine.efforts), &only(&theirs.efforts));
    println!(
        "{} joints, 2 s: {max_difference:.1e} rad, torques of fingers {efforts:.1e} of theirs apart",
        moves.len()
    );
    assert!(max_difference < CONTROLLED_BOUND, "{max_difference} rad apart");
    assert!(efforts < EFFORT_SHARE, "torques {efforts} of theirs apart");
}

#[test]
fn a_hanging_arm_under_given_torques_goes_where_it_goes_in_mujoco() {
    let Some(mujoco) = MujocoArm::find() else { return };
    let model = proact_description::mpl_right_arm();
    // Torques alone hold no arm that stands against gravity; one that hangs comes back.
    let start = positions(&model, &[-0.3, -0.2, 0.0, 0.2, 0.0, 0.0, 0.0], "open");
    let commands = oscillate(&start, 5000, joint_amplitude, |_| still());
    let mut plant = plant_at(&model, &empty_scene(), &start, &still()).unwrap();
    let mine = ours(&mut plant, &commands, 7);
    let theirs = theirs(&mujoco, "torques", &start, 7, MujocoArmDrive::Torques(&mine.efforts));
    for ticks in [100, 1000, 5000] {
        println!("the same torques, {ticks} ms: {:.1e} rad", difference(&mine.angles, &theirs.angles, ticks));
    }
    let moved = mine.angles.iter().map(|angles| (angles[0] - start[0]).abs()).fold(0.0, f64::max);
    assert!(moved > 0.15, "the arm moves: {moved} rad");
    assert!(difference(&mine.angles, &theirs.angles, 5000) < TORQUES_BOUND);
}
