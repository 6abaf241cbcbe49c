//! Every way of being refused, and what the message says; and that nothing is left half done.

use nalgebra::DMatrix;
use proact_arm::{ArmModel, Inertial};
use proact_kinematics::{ArmKinematics, Kinematics, KinematicsError, time_raw_kdl};
use proact_types::{Pose, Vector, zeros};

fn model() -> ArmModel {
    proact_description::mpl_right_arm()
}

fn arm() -> Kinematics {
    Kinematics::new(&model()).expect("the arm is usable")
}

/// The error of building an arm from a model that `change` has spoiled.
fn refusal(change: impl FnOnce(&mut ArmModel)) -> String {
    let mut model = model();
    change(&mut model);
    match Kinematics::new(&model) {
        Ok(_) => "accepted".to_owned(),
        Err(error) => error.to_string(),
    }
}

#[test]
fn the_wrong_number_of_values_is_refused_with_both_numbers() {
    let mut arm = arm();
    let chain = KinematicsError::WrongJointCount { got: 6, expected: 7 };
    assert_eq!(arm.forward(&[0.0; 6]), Err(chain.clone()));
    assert_eq!(arm.jacobian(&[0.0; 6]), Err(chain.clone()));
    assert_eq!(arm.condition(&[0.0; 6]), Err(chain.clone()));
    assert_eq!(arm.inverse(&Pose::identity(), &[0.0; 6]), Err(chain));
    assert_eq!(arm.forward(&[]), Err(KinematicsError::WrongJointCount { got: 0, expected: 7 }));
    let tree = KinematicsError::WrongJointCount { got: 7, expected: 27 };
    let all = zeros(27);
    let gravity = Vector::zeros();
    assert_eq!(arm.link_poses(&[0.0; 7]), Err(tree.clone()));
    assert_eq!(arm.inverse_dynamics(&[0.0; 7], &all, &all, &gravity), Err(tree.clone()));
    assert_eq!(arm.inverse_dynamics(&all, &[0.0; 7], &all, &gravity), Err(tree.clone()));
    assert_eq!(arm.inverse_dynamics(&all, &all, &[0.0; 7], &gravity), Err(tree));
    let error = arm.forward(&[0.0; 8]).expect_err("one too many");
    assert_eq!(error.to_string(), "got 8 joint values, the chain has 7 joints");
    let error = arm.jacobian_into(&[0.0; 7], &mut DMatrix::zeros(7, 6)).expect_err("the wrong way round");
    assert_eq!(error.to_string(), "KDL: the matrix for the Jacobian is 7 by 6, expected 6 by 7");
    let error = time_raw_kdl(&model(), &[zeros(7), zeros(3)]).expect_err("a short one");
    assert_eq!(error, KinematicsError::WrongJointCount { got: 3, expected: 7 });
}

#[test]
fn values_that_kdl_would_compute_with_silently_are_refused_by_place() {
    let mut arm = arm();
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let mut q = [0.0; 7];
        q[3] = bad;
        for answer in [
            arm.forward(&q).map(drop),
            arm.jacobian(&q).map(drop),
            arm.condition(&q).map(drop),
            arm.inverse(&Pose::identity(), &q).map(drop),
            arm.inverse(&Pose::translation(0.0, bad, 0.0), &[0.0; 7]).map(drop),
            arm.inverse_all(&Pose::translation(0.0, bad, 0.0), 3, 1).map(drop),
        ] {
            assert!(matches!(answer, Err(KinematicsError::NotFinite { .. })), "{answer:?}");
        }
        let (all, mut spoiled) = (zeros(27), zeros(27));
        spoiled[26] = bad;
        let down = Vector::new(0.0, 0.0, -9.80665);
        for answer in [
            arm.link_poses(&spoiled).map(drop),
            arm.inverse_dynamics(&spoiled, &all, &all, &down).map(drop),
            arm.inverse_dynamics(&all, &spoiled, &all, &down).map(drop),
            arm.inverse_dynamics(&all, &all, &spoiled, &down).map(drop),
            arm.inverse_dynamics(&all, &all, &all, &Vector::new(0.0, bad, 0.0)).map(drop),
        ] {
            assert!(matches!(answer, Err(KinematicsError::NotFinite { .. })), "{answer:?}");
        }
    }
    let error = arm.forward(&[0.0, f64::NAN, 0.0, 0.0, 0.0, 0.0, 0.0]).expect_err("NaN must not reach KDL");
    assert_eq!(error.to_string(), "joint angle 1 is NaN, expected a finite number");
    assert!(arm.forward(&[0.0; 7]).is_ok(), "a refusal leaves the arm usable");
}

#[test]
fn torques_beyond_the_range_of_numbers_are_an_error() {
    // They were infinite, and null in the answer of a query.
    let mut arm = Kinematics::new(&model()).expect("it is an arm");
    let (rest, mut fast) = (zeros(27), zeros(27));
    fast[0] = 1e200;
    let down = Vector::new(0.0, 0.0, -9.80665);
    let error = arm.inverse_dynamics(&rest, &fast, &rest, &down).expect_err("it overflows").to_string();
    assert!(error.contains("torque of joint 0 is beyond the range of numbers"), "{error}");
    assert!(arm.inverse_dynamics(&rest, &rest, &rest, &down).is_ok(), "a refusal leaves the arm usable");
}

#[test]
fn a_model_that_is_no_arm_is_refused_by_name() {
    let empty = |model: &mut ArmModel| {
        model.links.clear();
        model.joints.clear();
        model.arm.clear();
        model.hand.clear();
    };
    assert_eq!(refusal(empty), "KDL: the arm has no links");
    let elbow = model().joint("mpl_right_arm__elbow").expect("the arm has an elbow");
    assert_eq!(
        refusal(|m| m.joints[elbow].axis = Vector::zeros()),
        "KDL: joint \"mpl_right_arm__elbow\": the axis has no direction"
    );
    assert_eq!(
        refusal(|m| m.joints[elbow].axis.x = f64::NAN),
        "joint axis component 0 is NaN, expected a finite number"
    );
    assert_eq!(
        refusal(|m| m.joints[elbow].limits.upper = -7.0),
        format!(
            "KDL: joint \"mpl_right_arm__elbow\": lower limit {:.6} is above upper limit -7.000000",
            model().joints[elbow].limits.lower
        )
    );
    assert_eq!(
        refusal(|m| m.links[3].name = m.links[2].name.clone()),
        format!("KDL: two links are called \"{}\"", model().links[2].name)
    );
    assert!(refusal(|m| m.hand.truncate(19)).ends_with("moves but belongs to no group"));
    assert!(refusal(|m| drop(m.joints.pop())).contains("has no joint number"));
    let heavy = |m: &mut ArmModel| m.links[3].inertial.as_mut().expect("the link has mass").mass = -1.0;
    assert!(refusal(heavy).ends_with("mass -1.000000 kg is negative"));
}

#[test]
fn a_chain_that_does_not_exist_is_refused() {
    let refusal = |base: &str, tip: &str| match Kinematics::with_chain(&model(), base, tip) {
        Ok(_) => "accepted".to_owned(),
        Err(error) => error.to_string(),
    };
    let wrist = "mpl_right_arm__wristz_link";
    assert!(refusal("base_link", "hook").starts_with("KDL: link \"hook\" is not in the model"));
    assert!(refusal("floor", wrist).starts_with("KDL: link \"floor\" is not in the model"));
    assert_eq!(
        refusal(wrist, "base_link"),
        format!("KDL: the tip \"base_link\" is not below the base \"{wrist}\"")
    );
    assert_eq!(refusal(wrist, wrist), format!("KDL: the tip \"{wrist}\" is not below the base \"{wrist}\""));
}

#[test]
fn a_carried_body_without_mass_is_refused_and_the_old_one_stays() {
    let mut arm = arm();
    let at = |mass: f64| Inertial { mass, pose: Pose::translation(0.0, -0.1, 0.0), inertia: [0.0; 6] };
    let rest = zeros(27);
    let down = Vector::new(0.0, 0.0, -9.80665);
    arm.set_payload(Some(&at(0.1))).expect("a body with mass");
    let before = arm.inverse_dynamics(&rest, &rest, &rest, &down);
    for mass in [0.0, -0.1, f64::NAN] {
        assert!(arm.set_payload(Some(&at(mass))).is_err());
    }
    assert_eq!(arm.inverse_dynamics(&rest, &rest, &rest, &down), before);
    arm.set_payload(None).expect("letting go always works");
    assert_ne!(arm.inverse_dynamics(&rest, &rest, &rest, &down), before);
}

/// Solvers keep references into the chain and the tree: whoever is dropped first must not matter.
#[test]
fn arms_may_be_dropped_in_any_order_and_in_another_thread() {
    let (mut first, mut second) = (arm(), arm());
    let rest = zeros(27);
    let torque = first.inverse_dynamics(&rest, &rest, &rest, &Vector::new(0.0, 0.0, -9.80665));
    drop(first);
    let mut moved = second.forward(&[0.1; 7]);
    let third = Kinematics::new(&model()).expect("the arm is usable");
    assert_eq!(second.inverse_dynamics(&rest, &rest, &rest, &Vector::new(0.0, 0.0, -9.80665)), torque);
    std::thread::scope(|scope| {
        scope.spawn(|| {
            let mut inside = third;
            moved = inside.forward(&[0.1; 7]);
        });
    });
    assert_eq!(second.forward(&[0.1; 7]), moved);
}
