//! The arm under position control.

#![allow(clippy::unwrap_used)]

mod common;

use common::{START, box_scene, plant, positions, run, stay, still};
use proact_testbed::ports::Plant;

#[test]
fn gravity_leaves_no_sag() {
    let model = proact_description::mpl_right_arm();
    let start = positions(&model, &START, "open");
    let mut plant = plant(&box_scene(), &still());
    let before = plant.link_pose(model.tip).unwrap();
    run(&mut plant, &stay(&start, still()), 1000);
    let sag = (plant.link_pose(model.tip).unwrap().translation.vector - before.translation.vector).norm();
    assert!(sag < 1e-5, "the wrist sank by {sag} m");
    for (angle, asked) in plant.state().position.iter().zip(&start) {
        assert!((angle - asked).abs() < 1e-5);
    }
}
