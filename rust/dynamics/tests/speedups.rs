//! Each economy against the plain full simulation.

#![allow(missing_docs)]
#![allow(clippy::unwrap_used)]
#![allow(clippy::disallowed_methods)] // asks the kernel how much memory is used

mod common;

use common::{
    START, bare_table, box_scene, grasp_base, hold_command, move_hand, plant_with, positions, run, standing,
    still,
};
use proact_arm::ArmModel;
use proact_dynamics::{DynamicsOptions, PhysicsEngine, RigidBodyPlant, Solver};
use proact_testbed::ports::Plant;
use proact_types::{ObjectId, PlantState, Point};

/// The hand closes on a block, takes it, lifts it by 0.1 m and holds it, beside a block that rests.
fn take(options: DynamicsOptions) -> PlantState {
    let model = proact_description::mpl_right_arm();
    let open = positions(&model, &START, "open");
    let closed = positions(&model, &START, "closed");
    let mut base = grasp_base(&model, &open);
    let scene = bare_table(vec![standing(ObjectId(0), 0.0, 0.0), standing(ObjectId(1), 0.3, 0.2)]);
    let mut plant = plant_with(&scene, &base, options);
    for command in move_hand(&open, &closed, base, 350) {
        plant.step(&command).unwrap();
    }
    plant.attach(0, model.tip).unwrap();
    let held = plant.state().position.clone();
    for _ in 0..500 {
        base.translation.z += 2e-4;
        plant.step(&hold_command(&held, base)).unwrap();
    }
    run(&mut plant, &hold_command(&held, base), 200);
    plant.state().clone()
}

/// Largest difference of arm angles (rad) and of the places of the blocks (m).
fn differences(a: &PlantState, b: &PlantState) -> (f64, [f64; 2]) {
    let arm = (0..7).map(|k| (a.position[k] - b.position[k]).abs()).fold(0.0, f64::max);
    let position_of =
        |k: usize| (a.objects[k].pose.translation.vector - b.objects[k].pose.translation.vector).norm();
    (arm, [position_of(0), position_of(1)])
}

#[test]
fn taking_a_block_with_each_economy_ends_where_the_plain_full_simulation_ends() {
    let ours = DynamicsOptions::default();
    let plain = DynamicsOptions {
        engine: PhysicsEngine::Ode,
        lock_idle_hand: false,
        sleep: false,
        merge_attached: false,
        ..ours
    };
    let reference = take(plain);
    let cases = [
        (
            "joint angles",
            DynamicsOptions { engine: PhysicsEngine::Reduced, merge_attached: true, ..plain },
            1e-7,
            3e-3,
        ),
        ("carried block merged", DynamicsOptions { merge_attached: true, ..plain }, 1e-7, 1e-6),
        ("hand merged", DynamicsOptions { lock_idle_hand: true, ..plain }, 1e-7, 3e-3),
        ("blocks sleep", DynamicsOptions { sleep: true, ..plain }, 1e-7, 1e-3),
        ("all four", ours, 1e-7, 3e-3),
        (
            "iterative solver",
            DynamicsOptions { solver: Solver::Iterative { iterations: 50, seed: 1 }, ..plain },
            5e-3,
            5e-3,
        ),
    ];
    for (name, options, arm_bound, block_bound) in cases {
        let (arm, [carried, resting]) = differences(&take(options), &reference);
        println!("{name}: arm {arm:.1e} rad, carried block {carried:.1e} m, resting block {resting:.1e} m");
        assert!(arm < arm_bound, "{name}: an arm joint differs by {arm} rad");
        // Where a block ends between closing fingers hangs on little; the grasp is the same.
        assert!(carried < block_bound, "{name}: the carried block differs by {carried} m");
        assert!(resting < 1e-4, "{name}: the resting block differs by {resting} m");
    }
}

/// Bytes of this process in memory; zero where the kernel does not tell.
fn resident_bytes() -> u64 {
    let text = std::fs::read_to_string("/proc/self/statm").unwrap_or_default();
    text.split_whitespace().nth(1).and_then(|pages| pages.parse::<u64>().ok()).map_or(0, |pages| pages * 4096)
}

/// Potential energy of arm and blocks and kinetic energy of the blocks' centres, J; the arm is asked for at rest.
fn energy(model: &ArmModel, plant: &RigidBodyPlant) -> f64 {
    let links: f64 = (0..model.links.len())
        .filter_map(|link| {
            let inertial = model.links[link].inertial.as_ref()?;
            let center = plant.link_pose(link).unwrap() * Point::from(inertial.pose.translation.vector);
            Some(9.80665 * inertial.mass * center.z)
        })
        .sum();
    let blocks = plant.state().objects.iter();
    links
        + blocks
            .map(|b| 0.1 * (9.80665 * b.pose.translation.z + 0.5 * b.linear_velocity.norm_squared()))
            .sum::<f64>()
}

/// `seconds` of swinging over the box and closing and opening the hand, then where the blocks, the energy and the memory are.
fn soak(seconds: u32) {
    let model = proact_description::mpl_right_arm();
    let open = positions(&model, &START, "open");
    let closed = positions(&model, &START, "closed");
    let mut plant =
        plant_with(&box_scene(), &still(), DynamicsOptions { sleep: false, ..Default::default() });
    run(&mut plant, &hold_command(&open, still()), 1000);
    let rest = plant.state().clone();
    let (mut fastest, mut memory, mut energies) = (0.0_f64, 0, Vec::new());
    for tick in 0..seconds * 1000 {
        // Every ten seconds the same: two of moving, the hand closing in between, and eight of rest.
        let time = f64::from(tick % 10_000).min(2000.0) * 1e-3;
        let phase = std::f64::consts::PI * time;
        let mut command = hold_command(&open, still());
        for k in 0..open.len() {
            let amplitude = if k >= 7 {
                closed[k] - open[k]
            } else if k == 4 {
                -0.1
            } else {
                0.1
            };
            command.position[k] += 0.5 * amplitude * (1.0 - phase.cos());
            command.velocity[k] =
                if time < 2.0 { 0.5 * amplitude * std::f64::consts::PI * phase.sin() } else { 0.0 };
        }
        plant.step(&command).unwrap_or_else(|error| panic!("tick {tick}: {error}"));
        fastest = plant.state().velocity.iter().fold(fastest, |max, speed| max.max(speed.abs()));
        if tick % 10_000 == 9_999 {
            energies.push(energy(&model, &plant));
            // The first rounds find how much is needed.
            if tick < 30_000 {
                memory = resident_bytes();
            }
        }
    }
    let (first, max) = (energies[0], energies.iter().copied().fold(f64::MIN, f64::max));
    println!("{seconds} s: energy at rest {first:.9} J, later at most {:.1e} J more", max - first);
    assert!(max - first < 1e-6, "energy at rest grew from {first} J to {max} J");
    assert!(memory > 0 || !cfg!(target_os = "linux"), "the kernel tells how much memory is used");
    let grown = resident_bytes().saturating_sub(memory);
    println!("{seconds} s: {grown} bytes more in memory than after half a minute");
    assert!(grown < 1 << 20, "{grown} bytes leaked in {seconds} s");
    for (a, b) in plant.state().objects.iter().zip(&rest.objects) {
        let crept = (a.pose.translation.vector - b.pose.translation.vector).norm();
        assert!(crept < 1e-4, "a block crept {crept} m in {seconds} s");
    }
    for (angle, requested) in plant.state().position.iter().zip(&open) {
        assert!((angle - requested).abs() < 1e-4, "{angle} rad instead of {requested}");
    }
    assert!(fastest < 4.0, "a joint went at {fastest} rad/s");
    assert_eq!(plant.solver_warnings(), 0);
}

#[test]
fn half_a_minute_of_use_leaves_arm_and_resting_blocks_where_they_were() {
    soak(30);
}

/// Several minutes of wall time:
/// `cargo test --release -p proact-dynamics --test speedups -- --ignored`
#[test]
#[ignore = "half an hour of simulated time"]
fn half_an_hour_of_use_leaves_arm_and_resting_blocks_where_they_were() {
    soak(1800);
}
