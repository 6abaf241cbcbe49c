//! A saved state goes on as the original did.

#![allow(missing_docs)]
#![allow(clippy::unwrap_used)]

mod common;

use common::{
    START, bare_table, box_scene, grasp_base, hold_command, move_hand, plant, plant_at, plant_with,
    positions, standing, still,
};
use proact_dynamics::{DynamicsOptions, JointControl, PhysicsEngine, RigidBodyPlant, Snapshot, Solver};
use proact_testbed::ports::Plant;
use proact_types::{ObjectId, PlantCommand, PlantState};

/// Steps through `commands`; the states.
fn states(plant: &mut RigidBodyPlant, commands: &[PlantCommand]) -> Vec<PlantState> {
    commands
        .iter()
        .map(|command| {
            plant.step(command).unwrap();
            plant.state().clone()
        })
        .collect()
}

/// Saves `plant`, runs it, restores and runs again, and restores into a plant that has just been made; all three
/// must agree to the last bit. The snapshot goes through JSON on the way.
fn check(plant: &mut RigidBodyPlant, fresh: &mut RigidBodyPlant, commands: &[PlantCommand]) {
    let saved = plant.snapshot().unwrap();
    let saved_state = plant.state().clone();
    let read: Snapshot = serde_json::from_str(&serde_json::to_string(&saved).unwrap()).unwrap();
    assert_eq!(read, saved);
    let first = states(plant, commands);
    assert_ne!(*first.last().unwrap(), saved_state, "something must happen");
    for (name, plant) in [("same", plant), ("fresh", fresh)] {
        plant.restore(&read).unwrap();
        assert_eq!(*plant.state(), saved_state, "{name} plant, the state shown after restoring");
        let again = states(plant, commands);
        for (tick, (a, b)) in first.iter().zip(&again).enumerate() {
            assert_eq!(a, b, "{name} plant, tick {tick}");
        }
    }
}

/// The arm swings; with `hand`, fingers move too.
fn swing(from: &[f64], ticks: std::ops::Range<u32>, hand: bool) -> Vec<PlantCommand> {
    ticks
        .map(|tick| {
            let time = f64::from(tick) * 1e-3;
            let mut command = hold_command(from, still());
            for k in 0..if hand { from.len() } else { 7 } {
                let amplitude = if k == 4 { -0.2 } else { 0.2 };
                command.position[k] += amplitude * (1.0 - time.cos());
                command.velocity[k] = amplitude * time.sin();
            }
            command.world_from_base.translation.y += 0.02 * time.sin();
            command
        })
        .collect()
}

#[test]
fn a_restored_run_without_contact_agrees_for_a_thousand_ticks_bit_for_bit() {
    let model = proact_description::mpl_right_arm();
    let start = positions(&model, &START, "open");
    for (engine, hand) in [
        (PhysicsEngine::Reduced, false),
        (PhysicsEngine::Reduced, true),
        (PhysicsEngine::Ode, false),
        (PhysicsEngine::Ode, true),
    ] {
        for control in [JointControl::FeedForward, JointControl::OriginalGains] {
            let options = DynamicsOptions { engine, control, ..DynamicsOptions::default() };
            let [mut plant, mut fresh] = [0; 2].map(|_| plant_with(&box_scene(), &still(), options));
            states(&mut plant, &swing(&start, 1..700, hand));
            check(&mut plant, &mut fresh, &swing(&start, 700..1700, hand));
        }
    }
}

#[test]
fn a_restored_pinch_and_carry_agrees_for_hundreds_of_ticks_bit_for_bit() {
    let model = proact_description::mpl_right_arm();
    let open = positions(&model, &START, "open");
    let closed = positions(&model, &START, "closed");
    let base = grasp_base(&model, &open);
    let scene = bare_table(vec![standing(ObjectId(0), 0.0, 0.0), standing(ObjectId(1), 0.3, 0.2)]);
    for (engine, solver) in [
        (PhysicsEngine::Reduced, Solver::Direct),
        (PhysicsEngine::Ode, Solver::Direct),
        (PhysicsEngine::Ode, Solver::Iterative { iterations: 30, seed: 3 }),
    ] {
        let options = DynamicsOptions { engine, solver, ..DynamicsOptions::default() };
        let mut plant = plant_with(&scene, &base, options);
        let mut fresh = plant_with(&scene, &base, options);
        let mut commands = move_hand(&open, &closed, base, 900);
        // An arm on a base at rest comes to rest itself, to the last bit.
        for (tick, command) in commands.iter_mut().enumerate().skip(400) {
            command.world_from_base.translation.z += 1e-5 * (tick - 400) as f64;
        }
        states(&mut plant, &commands[..400]);
        assert!(plant.state().contacts.len() >= 2, "there must be a pinch");
        check(&mut plant, &mut fresh, &commands[400..500]);

        plant.attach(0, model.tip).unwrap();
        states(&mut plant, &commands[500..600]);
        check(&mut plant, &mut fresh, &commands[600..700]);
        assert_eq!(fresh.state().attached.unwrap().0, 0);
        plant.release();
        fresh.release();
        check(&mut plant, &mut fresh, &commands[700..900]);
    }
}

#[test]
fn another_plants_snapshot_and_a_damaged_one_are_refused_and_change_nothing() {
    let model = proact_description::mpl_right_arm();
    let start = positions(&model, &START, "open");
    let mut plant = plant(&box_scene(), &still());
    states(&mut plant, &swing(&start, 1..50, true));
    let before = plant.state().clone();
    let other = plant_at(&model, &bare_table(Vec::new()), &start, &still()).unwrap().snapshot().unwrap();
    let refused = plant.restore(&other).unwrap_err().to_string();
    assert!(refused.contains("another arm, scene or options"), "{refused}");

    let text = serde_json::to_value(plant.snapshot().unwrap()).unwrap();
    let damaged = |change: &dyn Fn(&mut Vec<serde_json::Value>)| {
        let mut damaged = text.clone();
        change(damaged["numbers"].as_array_mut().unwrap());
        serde_json::from_value::<Snapshot>(damaged).unwrap()
    };
    let cases: [(&str, Snapshot); 4] = [
        ("it ends after", damaged(&|numbers| drop(numbers.pop()))),
        ("expected", damaged(&|numbers| numbers.push(1.0.into()))),
        ("snapshot: 28 links, this world has 29", damaged(&|numbers| numbers[0] = 28.into())),
        ("it ends after 0", damaged(&|numbers| numbers.clear())),
    ];
    for (expected, snapshot) in &cases {
        let refused = plant.restore(snapshot).unwrap_err().to_string();
        assert!(refused.contains(expected), "{refused}");
    }
    assert_eq!(*plant.state(), before);
    let mut twin = common::plant(&box_scene(), &still());
    states(&mut twin, &swing(&start, 1..50, true));
    let next = swing(&start, 50..60, true);
    assert_eq!(states(&mut plant, &next), states(&mut twin, &next), "refusals must leave no trace");
}
