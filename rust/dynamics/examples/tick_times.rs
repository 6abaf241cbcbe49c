//! Prints how long a tick takes, by solver and phase:
//! `cargo run --release -p proact-dynamics --example tick_times`.

#![allow(clippy::disallowed_methods)] // a bench reads the clock

#[path = "../tests/common/mod.rs"]
mod common;

use common::{
    START, bare_table, box_scene, grasp_base, hold_command, move_hand, plant_with, positions, standing, still,
};
use proact_dynamics::{DynamicsOptions, RigidBodyPlant, Solver, bench_ticks};
use proact_testbed::ports::{Plant, PlantError};
use proact_types::{ObjectId, PlantCommand};
use std::time::Instant;

fn main() -> Result<(), PlantError> {
    println!("{:32} {:>8} {:>8} {:>8} {:>8}  us", "phase", "mean", "median", "99 %", "worst");
    let direct = DynamicsOptions::default();
    let free = DynamicsOptions { lock_idle_hand: false, ..direct };
    report_phases("direct, still hand rigid", direct)?;
    report_phases("direct, all joints free", free)?;
    for iterations in [20, 50] {
        let solver = Solver::Iterative { iterations, seed: 1 };
        report_phases(&format!("iterative {iterations}, rigid"), DynamicsOptions { solver, ..direct })?;
        report_phases(&format!("iterative {iterations}, free"), DynamicsOptions { solver, ..free })?;
    }
    Ok(())
}

fn report_phases(name: &str, options: DynamicsOptions) -> Result<(), PlantError> {
    let model = proact_description::mpl_right_arm();
    println!("{name}");

    // The arm swings in the box's scene, the hand open and still.
    let start = positions(&model, &START, "open");
    let mut plant = plant_with(&box_scene(), &still(), options);
    let swing = (0..4000).map(|tick| {
        let mut command = hold_command(&start, still());
        let time = f64::from(tick) * 1e-3;
        for joint in 0..7 {
            command.position[joint] += 0.1 * (1.0 - time.cos());
            command.velocity[joint] = 0.1 * time.sin();
        }
        command.position[4] = start[4] - 0.1 * (1.0 - time.cos());
        command.velocity[4] = -command.velocity[4];
        command
    });
    report("  arm moving, hand still", &mut plant, swing)?;
    let worst = (0..7).map(|k| (plant.state().position[k] - start[k]).abs()).fold(0.0, f64::max);
    println!("    complaints {}, largest way of a joint {worst:.3} rad", plant.solver_warnings());

    // The hand closes on a block and presses.
    let base = grasp_base(&model, &start);
    let closed = positions(&model, &START, "closed");
    let mut plant = plant_with(&bare_table(vec![standing(ObjectId(0), 0.0, 0.0)]), &base, options);
    let commands: Vec<PlantCommand> = move_hand(&start, &closed, base, 600);
    report("  hand closing on a block", &mut plant, commands)?;
    println!(
        "    contacts at the end {}, complaints {}",
        plant.state().contacts.len(),
        plant.solver_warnings()
    );

    // Carried: fingers hold where they are.
    plant.attach(0, model.tip)?;
    let held = plant.state().position.clone();
    let commands = (0..2000).map(|tick| {
        let mut lifted = base;
        lifted.translation.z += 0.1 * (f64::from(tick) / 2000.0);
        hold_command(&held, lifted)
    });
    report("  carrying", &mut plant, commands)
}

fn report(
    name: &str,
    plant: &mut RigidBodyPlant,
    commands: impl IntoIterator<Item = PlantCommand>,
) -> Result<(), PlantError> {
    let epoch = Instant::now();
    if let Some(times) = bench_ticks(plant, commands, || epoch.elapsed().as_secs_f64())? {
        let us = [times.mean_secs, times.median_secs, times.p99_secs, times.worst_secs].map(|t| t * 1e6);
        println!("{name:32} {:8.1} {:8.1} {:8.1} {:8.1}", us[0], us[1], us[2], us[3]);
    }
    Ok(())
}
