//! The arm under position control, its base, and what stops it.

#![allow(missing_docs)]
#![allow(clippy::unwrap_used)]

mod common;

use common::{START, bare_table, box_scene, hold_command, plant, plant_with, positions, run, still};
use proact_dynamics::{DynamicsOptions, MassSet, RigidBodyPlant};
use proact_testbed::{PhysicsEngine, ports::Plant};
use proact_types::{PlantCommand, PlantState, Pose, Vector};

#[test]
fn gravity_leaves_no_sag() {
    let model = proact_description::mpl_right_arm();
    let start = positions(&model, &START, "open");
    for hold_still_hand in [true, false] {
        let options = DynamicsOptions { lock_idle_hand: hold_still_hand, ..DynamicsOptions::default() };
        let mut plant = plant_with(&box_scene(), &still(), options);
        let before = plant.link_pose(model.tip).unwrap();
        run(&mut plant, &hold_command(&start, still()), 1000);
        let after = plant.link_pose(model.tip).unwrap();
        let sag = (after.translation.vector - before.translation.vector).norm();
        assert!(sag < 1e-5, "the wrist sank by {sag} m");
        for (angle, requested) in plant.state().position.iter().zip(&start) {
            assert!((angle - requested).abs() < 1e-5, "{angle} instead of {requested}");
        }
    }
}

/// The arm swings and the hand closes and opens; returns the state after each tick.
fn swing(options: DynamicsOptions) -> (f64, Vec<PlantState>) {
    let model = proact_description::mpl_right_arm();
    let open = positions(&model, &START, "open");
    let closed = positions(&model, &START, "closed");
    let mut plant = plant_with(&box_scene(), &still(), options);
    let mut worst: f64 = 0.0;
    let mut states = Vec::new();
    for tick in 1..=3000 {
        let time = f64::from(tick) * 1e-3;
        let mut command = hold_command(&open, still());
        let share = 0.5 * (1.0 - (2.0 * time).cos());
        for k in 7..open.len() {
            command.position[k] += share * (closed[k] - open[k]);
            command.velocity[k] = (2.0 * time).sin() * (closed[k] - open[k]);
        }
        for k in 0..7 {
            let amplitude = if k == 4 { -0.2 } else { 0.2 };
            command.position[k] += amplitude * (1.0 - time.cos());
            command.velocity[k] = amplitude * time.sin();
        }
        plant.step(&command).unwrap();
        for (angle, requested) in plant.state().position.iter().zip(&command.position) {
            worst = worst.max((angle - requested).abs());
        }
        states.push(plant.state().clone());
    }
    (worst, states)
}

#[test]
fn a_moving_command_is_followed_within_a_hundredth_of_a_degree() {
    let (worst, _) = swing(DynamicsOptions::default());
    assert!(worst < 1.7e-4, "{worst} rad behind");
}

/// Rigid joints are an economy: the arm moves as it does with every joint free.
#[test]
fn a_rigid_hand_changes_the_motion_of_the_arm_by_less_than_a_microradian() {
    let free = DynamicsOptions { lock_idle_hand: false, ..DynamicsOptions::default() };
    let (_, with) = swing(DynamicsOptions::default());
    let (_, without) = swing(free);
    for (a, b) in with.iter().zip(&without) {
        for k in 0..7 {
            assert!((a.position[k] - b.position[k]).abs() < 1e-6);
            assert!(
                (a.effort[k] - b.effort[k]).abs() < 0.02,
                "joint {k}: {} and {}",
                a.effort[k],
                b.effort[k]
            );
        }
    }
}

#[test]
fn the_base_goes_where_it_is_told_and_takes_the_arm_along() {
    let model = proact_description::mpl_right_arm();
    let start = positions(&model, &START, "open");
    let mut plant = plant(&box_scene(), &still());
    let base_from_tip = still().inverse() * plant.link_pose(model.tip).unwrap();
    for tick in 1..=2000 {
        let time = f64::from(tick) * 1e-3;
        let mut base = still();
        base.translation.x += 0.05 * (1.0 - (3.0 * time).cos());
        base.append_rotation_wrt_center_mut(&nalgebra::UnitQuaternion::from_scaled_axis(
            Vector::new(0.1, 0.2, 0.3) * (1.0 - (2.0 * time).cos()),
        ));
        plant.step(&hold_command(&start, base)).unwrap();
        assert_eq!(plant.state().world_from_base, base);
        let tip = plant.link_pose(model.tip).unwrap().translation.vector;
        let wanted = (base * base_from_tip).translation.vector;
        assert!((tip - wanted).norm() < 1e-4, "tick {tick}: the wrist strays {} m", (tip - wanted).norm());
    }
}

#[test]
fn the_table_stops_the_arm() {
    let model = proact_description::mpl_right_arm();
    let start = positions(&model, &START, "closed");
    let mut plant = plant_with(&bare_table(Vec::new()), &still(), DynamicsOptions::default());
    run(&mut plant, &hold_command(&positions(&model, &START, "open"), still()), 1);
    // The base sinks until the straight way of the hand would end 0.3 m under the table's top.
    let mut base = still();
    for _ in 0..3000 {
        base.translation.z -= 2.5e-4;
        plant.step(&hold_command(&start, base)).unwrap();
    }
    let tip = plant.link_pose(model.tip).unwrap().translation.z;
    assert!(tip > 1.0, "the wrist went through the table to {tip} m");
    assert!(plant.state().position.iter().all(|angle| angle.is_finite()));
}

#[test]
fn a_base_that_is_told_to_jump_stays_and_kicks_nothing() {
    let model = proact_description::mpl_right_arm();
    let start = positions(&model, &START, "open");
    let mut plant = plant(&box_scene(), &still());
    run(&mut plant, &hold_command(&start, still()), 50);
    let before = plant.state().clone();
    let tip = plant.link_pose(model.tip).unwrap();
    let away = Vector::new(0.3, 0.0, 0.0);
    let mut jumped = still();
    jumped.translation.vector += away;
    for _ in 0..200 {
        plant.step(&hold_command(&start, jumped)).unwrap();
        assert!(plant.state().base_held);
        assert_eq!(plant.state().world_from_base, still());
    }
    let moved = (plant.link_pose(model.tip).unwrap().translation.vector - tip.translation.vector).norm();
    assert!(moved < 1e-5, "the wrist moved by {moved} m");
    let fastest = plant.state().velocity.iter().fold(0.0_f64, |max, speed| max.max(speed.abs()));
    assert!(fastest < 1e-4, "a joint was kicked to {fastest} rad/s");
    for (a, b) in plant.state().objects.iter().zip(&before.objects) {
        assert!((a.pose.translation.vector - b.pose.translation.vector).norm() < 1e-6);
    }
    // A turn is a jump too; a command within reach is followed at once.
    let turned = still() * nalgebra::UnitQuaternion::from_scaled_axis(Vector::new(0.0, 0.0, 0.1));
    plant.step(&hold_command(&start, turned)).unwrap();
    assert!(plant.state().base_held);
    let mut near = still();
    near.translation.x += 1e-3;
    plant.step(&hold_command(&start, near)).unwrap();
    assert!(!plant.state().base_held);
    assert_eq!(plant.state().world_from_base, near);
}

#[test]
fn the_real_limbs_mass_set_takes_ten_times_the_torque_and_still_leaves_no_sag() {
    let model = proact_description::mpl_right_arm();
    let total: f64 =
        model.links.iter().filter_map(|link| link.inertial.as_ref()).map(|inertial| inertial.mass).sum();
    assert!((total - 0.529).abs() < 0.002, "the public model weighs {total} kg");
    let start = positions(&model, &START, "open");
    let efforts = [MassSet::Description, MassSet::RealLimb].map(|mass_set| {
        let options = DynamicsOptions { mass_set, ..DynamicsOptions::default() };
        let mut plant = plant_with(&box_scene(), &still(), options);
        let before = plant.link_pose(model.tip).unwrap();
        run(&mut plant, &hold_command(&start, still()), 1000);
        let after = plant.link_pose(model.tip).unwrap();
        let sag = (after.translation.vector - before.translation.vector).norm();
        assert!(sag < 1e-5, "{mass_set:?}: the wrist sank by {sag} m");
        plant.state().effort.clone()
    });
    let largest = efforts[0].iter().fold(0.0_f64, |max, effort| max.max(effort.abs()));
    assert!(largest > 0.1, "the arm bears itself with {largest} N m");
    for (light, heavy) in efforts[0].iter().zip(&efforts[1]) {
        assert!((heavy - 10.0 * light).abs() < 1e-3 * 10.0 * largest, "{light} N m and {heavy} N m");
    }
}

#[test]
fn a_heavy_arm_moves_as_exactly_as_a_light_one() {
    let (worst, _) = swing(DynamicsOptions { mass_set: MassSet::RealLimb, ..DynamicsOptions::default() });
    assert!(worst < 1.7e-4, "{worst} rad behind");
}

// Catches a recorded effort that no motor could give: on a stop it was up to twelve times the limit.
#[test]
fn what_stops_bear_is_apart_from_what_motors_give() {
    let model = proact_description::mpl_right_arm();
    let limits: Vec<f64> = model.moving().map(|joint| model.joints[joint].limits.effort).collect();
    for engine in [PhysicsEngine::Reduced, PhysicsEngine::Ode] {
        let start = positions(&model, &START, "open");
        let options = DynamicsOptions { engine, ..Default::default() };
        let scene = bare_table(Vec::new());
        let base = Pose::translation(-0.6, -0.18, 1.445);
        let mut plant = RigidBodyPlant::new(&model, &scene, &start, &base, options).unwrap();
        let (mut motor, mut stop) = (0.0_f64, 0.0_f64);
        for tick in 0..400 {
            // Shaken by 10 mm at 25 Hz: the wrist, which starts at its limit, is thrown against its stop.
            let away = 1e-2 * (f64::from(tick) * 0.157).sin();
            let world_from_base = Pose::translation(0.0, away, away) * base;
            plant.step(&PlantCommand { world_from_base, ..hold_command(&start, base) }).unwrap();
            let state = plant.state();
            for (k, limit) in limits.iter().enumerate() {
                motor = motor.max(state.effort[k].abs() / limit);
                stop = stop.max(state.limit_effort[k].abs() / limit);
            }
        }
        println!("{engine:?}: motors up to {motor:.3} of their limits, stops {stop:.3}");
        // ODE meets the bound of its motors within a hundredth.
        assert!(motor < 1.01, "{engine:?}: a motor gives {motor} of its limit");
        assert!(stop > 0.05 || engine == PhysicsEngine::Ode, "{engine:?}: the stop bears nothing: {stop}");
    }
}
