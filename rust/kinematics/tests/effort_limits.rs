//! The effort limits that the URDF stores, and how they are found.

use proact_kinematics::{EffortOptions, effort_limits};

/// What a stored value may differ by from one computed anew.
const SHARE: f64 = 0.05;

#[test]
fn the_effort_limits_in_the_urdf_are_those_computed() {
    let model = proact_description::mpl_right_arm();
    let limits = effort_limits(&model, &EffortOptions::default()).expect("the arm is usable");
    for (limit, joint) in limits.iter().zip(model.moving()) {
        let stored = model.joints[joint].limits.effort;
        assert!(
            (stored / limit.effort - 1.0).abs() < SHARE,
            "{}: stored {stored} N m, computed {:.5} N m",
            limit.joint,
            limit.effort
        );
    }
}

/// Climbing from samples finds a local maximum only; that other samples and many more of them change nothing is
/// what makes the numbers believable.
#[test]
fn the_largest_torques_do_not_hang_on_the_samples() {
    let model = proact_description::mpl_right_arm();
    let few = effort_limits(&model, &EffortOptions::default()).expect("the arm is usable");
    let more = EffortOptions { samples: 8000, seed: 2, ..EffortOptions::default() };
    let more = effort_limits(&model, &more).expect("the arm is usable");
    for (few, more) in few.iter().zip(&more) {
        assert!((few.static_torque / more.static_torque - 1.0).abs() < 0.01, "{few:?} and {more:?}");
    }
}

#[test]
fn a_heavier_block_asks_more_of_every_arm_joint_and_of_every_grip() {
    let model = proact_description::mpl_right_arm();
    let light = effort_limits(&model, &EffortOptions::default()).expect("the arm is usable");
    let heavy = EffortOptions { payload_kg: 0.2, ..EffortOptions::default() };
    let heavy = effort_limits(&model, &heavy).expect("the arm is usable");
    for (light, heavy) in light.iter().zip(&heavy) {
        assert!(heavy.effort > light.effort, "{light:?} and {heavy:?}");
    }
    for (arm, finger) in light[..7].iter().map(|joint| (joint, &light[7])) {
        assert!(arm.grip_torque == 0.0 && finger.grip_torque > 0.0);
    }
}
