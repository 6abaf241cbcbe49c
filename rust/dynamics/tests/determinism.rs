//! The same commands give the same bits, also beside another plant in another thread.

#![allow(missing_docs)]
#![allow(clippy::unwrap_used)]
#![allow(clippy::disallowed_methods)] // a neighbour needs a thread

mod common;

use common::{
    HEIGHT, START, TABLE, bare_table, block, grasp_base, move_hand, plant_with, positions, standing,
};
use proact_dynamics::{DynamicsOptions, PhysicsEngine, Solver};
use proact_testbed::ports::Plant;
use proact_types::{ObjectId, PlantState, Pose};
use std::sync::atomic::{AtomicBool, Ordering};

/// The hand closes on a block, takes it, lifts it and lets it go, beside a tumbling block.
fn run_script(options: DynamicsOptions, ticks: usize) -> Vec<u64> {
    let model = proact_description::mpl_right_arm();
    let open = positions(&model, &START, "open");
    let closed = positions(&model, &START, "closed");
    let mut base = grasp_base(&model, &open);
    let tumbling = Pose::new([0.3, 0.2, TABLE + 3.0 * HEIGHT].into(), [0.5, 0.3, 0.0].into());
    let scene = bare_table(vec![standing(ObjectId(0), 0.0, 0.0), block(ObjectId(1), tumbling)]);
    let mut plant = plant_with(&scene, &base, options);
    let mut digest = Vec::new();
    for (tick, mut command) in move_hand(&open, &closed, base, ticks).into_iter().enumerate() {
        match tick {
            300 => plant.attach(0, model.tip).unwrap(),
            301..=450 => base.translation.z += 2e-4,
            500 => plant.release(),
            _ => {}
        }
        command.world_from_base = base;
        plant.step(&command).unwrap();
        bits(plant.state(), &mut digest);
    }
    digest
}

fn bits(state: &PlantState, out: &mut Vec<u64>) {
    let mut add = |values: &[f64]| out.extend(values.iter().map(|value| value.to_bits()));
    add(&state.position);
    add(&state.velocity);
    add(&state.effort);
    for block in &state.objects {
        add(block.pose.translation.vector.as_slice());
        add(block.pose.rotation.coords.as_slice());
        add(block.linear_velocity.as_slice());
        add(block.angular_velocity.as_slice());
    }
    for contact in &state.contacts {
        add(contact.point.coords.as_slice());
        add(&[contact.force]);
    }
}

#[test]
fn a_run_is_the_same_bit_for_bit_alone_and_beside_another_plant() {
    for (engine, solver) in [
        (PhysicsEngine::Reduced, Solver::Direct),
        (PhysicsEngine::Ode, Solver::Direct),
        (PhysicsEngine::Ode, Solver::Iterative { iterations: 30, seed: 7 }),
    ] {
        let options = DynamicsOptions { engine, solver, ..DynamicsOptions::default() };
        let alone = run_script(options, 700);
        assert!(alone == run_script(options, 700), "{engine:?}, {solver:?}: a second run differs");
        let stop = AtomicBool::new(false);
        std::thread::scope(|scope| {
            scope.spawn(|| {
                while !stop.load(Ordering::Relaxed) {
                    run_script(options, 100);
                }
            });
            let beside: Vec<bool> = (0..3).map(|_| run_script(options, 700) == alone).collect();
            stop.store(true, Ordering::Relaxed);
            assert_eq!(beside, [true; 3], "{engine:?}, {solver:?}: a run beside another plant differs");
        });
    }
}

#[test]
fn another_seed_of_the_iterative_solver_gives_another_run() {
    let with = |seed| DynamicsOptions {
        engine: PhysicsEngine::Ode,
        solver: Solver::Iterative { iterations: 30, seed },
        ..DynamicsOptions::default()
    };
    assert!(run_script(with(1), 300) != run_script(with(2), 300));
}
