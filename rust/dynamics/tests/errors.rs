//! What is refused, with what words, and that nothing is harmed by it.

#![allow(missing_docs)]
#![allow(clippy::unwrap_used)]

mod common;

use common::{START, bare_table, box_scene, hold_command, plant, plant_at, positions, standing, still};
use proact_arm::ArmModel;
use proact_dynamics::{DynamicsOptions, MassSet, RigidBodyPlant, Solver};
use proact_testbed::ports::{Plant, PlantError};
use proact_types::{ObjectId, Scene};

fn arm() -> (ArmModel, Vec<f64>) {
    let model = proact_description::mpl_right_arm();
    let start = positions(&model, &START, "open");
    (model, start)
}

fn refusal(model: &ArmModel, scene: &Scene, start: &[f64]) -> String {
    match plant_at(model, scene, start, &still()) {
        Ok(_) => panic!("was accepted"),
        Err(error) => error.to_string(),
    }
}

#[test]
fn a_link_without_mass_that_moves_is_refused_by_name() {
    let (mut model, start) = arm();
    let wrist = model.tip;
    model.links[wrist].inertial.as_mut().unwrap().mass = 0.0;
    let message = refusal(&model, &box_scene(), &start);
    assert_eq!(message, "link \"mpl_right_arm__wristz_link\": mass is 0 kg, expected above 0");
    model.links[wrist].inertial = None;
    assert!(refusal(&model, &box_scene(), &start).contains("is moved by a joint but its mass is 0 kg"));
}

#[test]
fn an_inertia_that_is_not_positive_is_refused() {
    let (mut model, start) = arm();
    let wrist = model.tip;
    model.links[wrist].inertial.as_mut().unwrap().inertia[3] = f64::NAN;
    assert!(refusal(&model, &box_scene(), &start).contains("inertia has a value that is not finite"));
    model.links[wrist].inertial.as_mut().unwrap().inertia = [0.0; 6];
    assert!(refusal(&model, &box_scene(), &start).contains("not positive definite"));
}

#[test]
fn start_angles_are_checked() {
    let (model, mut start) = arm();
    assert_eq!(
        refusal(&model, &box_scene(), &start[1..]),
        "initial position has 26 values, the plant has 27 moving joints"
    );
    assert!(refusal(&model, &box_scene(), &[]).contains("has 0 values"));
    start[2] = f64::NAN;
    assert_eq!(refusal(&model, &box_scene(), &start), "initial position 2 is NaN, expected a finite number");
    start[2] = 2.0;
    assert!(refusal(&model, &box_scene(), &start).contains("starts at 2 rad, its limits are -0.697 to 1.57"));
}

#[test]
fn a_block_inside_the_table_or_another_block_is_refused() {
    let (model, start) = arm();
    let mut scene = bare_table(vec![standing(ObjectId(0), 0.0, 0.0)]);
    scene.objects[0].pose.translation.z -= 0.01;
    assert!(refusal(&model, &scene, &start).contains("block \"red1\" is 10.0"));
    let scene = bare_table(vec![standing(ObjectId(0), 0.0, 0.0), standing(ObjectId(2), 0.03, 0.0)]);
    assert!(refusal(&model, &scene, &start).contains("inside block \"blue1\""));
    let mut scene = bare_table(vec![standing(ObjectId(0), 0.0, 0.0)]);
    scene.objects[0].mass = f64::INFINITY;
    assert!(refusal(&model, &scene, &start).contains("mass is inf kg"));
}

#[test]
fn settings_are_checked() {
    let (model, start) = arm();
    let refused = |options| match RigidBodyPlant::new(&model, &box_scene(), &start, &still(), options) {
        Ok(_) => panic!("was accepted"),
        Err(error) => error.to_string(),
    };
    let options = DynamicsOptions::default();
    let solver = Solver::Iterative { iterations: 0, seed: 1 };
    assert!(refused(DynamicsOptions { solver, ..options }).contains("0 solver iterations"));
    for factor in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let mass_set = MassSet::Scaled(factor);
        assert!(refused(DynamicsOptions { mass_set, ..options }).contains("expected above 0"));
    }
    assert!(refused(DynamicsOptions { position_gain: 2000.0, ..options }).contains("overshoots"));
    assert!(refused(DynamicsOptions { position_gain: f64::NAN, ..options }).contains("position gain is nan"));
}

#[test]
fn bad_commands_are_refused_and_leave_the_state_as_it_was() {
    let (_, start) = arm();
    let mut plant = plant(&box_scene(), &still());
    let good = hold_command(&start, still());
    plant.step(&good).unwrap();
    let before = plant.state().clone();

    let mut command = good.clone();
    command.position.pop();
    let error = plant.step(&command).unwrap_err();
    assert_eq!(error, PlantError::WrongLength { what: "position", got: 26, expected: 27 });
    let mut command = good.clone();
    command.velocity[3] = f64::INFINITY;
    let error = plant.step(&command).unwrap_err();
    assert_eq!(error, PlantError::NotFinite { what: "velocity", index: 3, value: f64::INFINITY });
    let mut command = good.clone();
    command.world_from_base.translation.y = f64::NAN;
    assert!(plant.step(&command).unwrap_err().to_string().starts_with("base pose value 1 is NaN"));

    assert_eq!(*plant.state(), before);
    plant.step(&good).unwrap();
}

#[test]
fn attachments_are_checked() {
    let (model, start) = arm();
    let mut plant = plant(&box_scene(), &still());
    plant.release();
    assert!(plant.attach(4, model.tip).unwrap_err().to_string().contains("block 4, there are 4"));
    assert!(plant.attach(0, 99).unwrap_err().to_string().contains("link 99, there are 29"));
    assert!(plant.state().attached.is_none(), "a refused attachment must leave nothing behind");
    plant.attach(0, model.tip).unwrap();
    let error = plant.attach(1, model.tip).unwrap_err().to_string();
    assert_eq!(error, "ODE: block \"red1\" is attached already, release it first");
    assert_eq!(plant.state().attached.unwrap().0, 0);
    plant.release();
    plant.attach(1, model.tip).unwrap();
    plant.step(&hold_command(&start, still())).unwrap();
    assert_eq!(plant.state().attached.unwrap().0, 1);
}
