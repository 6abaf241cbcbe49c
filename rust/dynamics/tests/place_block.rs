//! A block put elsewhere between two steps, as a simulator's services do.

#![allow(missing_docs)]
#![allow(clippy::unwrap_used)]

mod common;

use common::{
    HEIGHT, START, TABLE, bare_table, block, far_base, hold_command, plant, plant_with, positions, run,
    standing,
};
use proact_dynamics::{DynamicsOptions, PhysicsEngine};
use proact_testbed::ports::Plant;
use proact_types::{BodyState, ObjectId, PlantCommand, Pose, Vector};

fn rest() -> PlantCommand {
    hold_command(&positions(&proact_description::mpl_right_arm(), &START, "open"), far_base())
}

fn body(x: f64, y: f64, z: f64) -> BodyState {
    BodyState {
        pose: Pose::translation(x, y, z),
        linear_velocity: Vector::zeros(),
        angular_velocity: Vector::zeros(),
    }
}

#[test]
fn a_block_is_where_it_was_put_and_what_lay_on_it_falls() {
    let low = TABLE + 0.5 * HEIGHT;
    let on_it = block(ObjectId::new(1), Pose::translation(0.1, 0.0, low + HEIGHT));
    let scene = bare_table(vec![standing(ObjectId::new(0), 0.1, 0.0), on_it]);
    for engine in [PhysicsEngine::default(), PhysicsEngine::Ode] {
        let mut plant =
            plant_with(&scene, &far_base(), DynamicsOptions { engine, ..DynamicsOptions::default() });
        run(&mut plant, &rest(), 500);
        let there = BodyState { linear_velocity: Vector::new(0.0, 0.0, -0.1), ..body(-0.2, 0.3, low + 0.02) };
        plant.place(0, &there).unwrap();
        assert_eq!(plant.state().objects[0], there, "{engine:?}: at once");
        plant.step(&rest()).unwrap();
        assert!(
            (plant.state().objects[0].linear_velocity.z + 0.1).abs() < 0.02,
            "{engine:?}: with its speed"
        );
        run(&mut plant, &rest(), 800);
        let [moved, fallen] = [0, 1].map(|k| plant.state().objects[k].pose.translation.vector);
        assert!((moved - Vector::new(-0.2, 0.3, low)).norm() < 2e-3, "{engine:?}: {moved}");
        assert!((fallen - Vector::new(0.1, 0.0, low)).norm() < 2e-3, "{engine:?}: {fallen}");
    }
}

#[test]
fn a_place_that_is_taken_or_none_is_refused_and_nothing_changes() {
    let low = TABLE + 0.5 * HEIGHT;
    let scene = bare_table(vec![standing(ObjectId::new(0), 0.1, 0.0), standing(ObjectId::new(1), 0.3, 0.0)]);
    let mut plant = plant(&scene, &far_base());
    // Both sleep.
    run(&mut plant, &rest(), 500);
    let before = (plant.snapshot().unwrap(), plant.state().clone());
    for (which, there, expected) in [
        (2, body(0.0, 0.0, 2.0), "block 2, there are 2"),
        (0, body(0.0, 0.0, low - 0.01), "10.000000 mm inside \"slab\""),
        (0, body(0.3, 0.04, low), "inside block \""),
        (0, body(f64::NAN, 0.0, 2.0), "NaN"),
        (
            0,
            BodyState { linear_velocity: Vector::new(0.0, f64::INFINITY, 0.0), ..body(0.0, 0.0, 2.0) },
            "inf",
        ),
    ] {
        let error = plant.place(which, &there).unwrap_err().to_string();
        assert!(error.contains(expected), "{expected}: {error}");
        assert_eq!((plant.snapshot().unwrap(), plant.state().clone()), before, "after {error}");
    }
    let model = proact_description::mpl_right_arm();
    plant.attach(0, model.tip).unwrap();
    let error = plant.place(0, &body(0.0, 0.0, 2.0)).unwrap_err().to_string();
    assert!(error.contains("is attached, release it first"), "{error}");
}
