//! The same commands to both engines: what agrees, and how far.

#![allow(missing_docs)]
#![allow(clippy::unwrap_used)]

mod common;

use common::{
    RADIUS, START, bare_table, box_scene, grasp_base, hold_command, move_hand, plant_with, positions,
    standing, still,
};
use proact_dynamics::{DynamicsOptions, PhysicsEngine, RigidBodyPlant};
use proact_testbed::ports::Plant;
use proact_types::{ObjectId, PlantCommand, PlantState, Pose};

/// A plant with its hand open, once in each engine.
fn both_engines(scene: &proact_types::Scene, base: &Pose) -> [RigidBodyPlant; 2] {
    [PhysicsEngine::Reduced, PhysicsEngine::Ode]
        .map(|engine| plant_with(scene, base, DynamicsOptions { engine, ..DynamicsOptions::default() }))
}

/// Steps both and gives their states.
fn step<'a>(plants: &'a mut [RigidBodyPlant; 2], command: &PlantCommand) -> [&'a PlantState; 2] {
    for plant in plants.iter_mut() {
        plant.step(command).unwrap();
    }
    [plants[0].state(), plants[1].state()]
}

/// Largest difference of two rows of numbers.
fn max_difference(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

/// Arm and hand follow the same motors in both; what is left is ODE's first order, a tick behind in places; rad.
const FREE_ANGLES: f64 = 1e-4;
/// Of the arm's torques, N m; they reach 1.5.
const FREE_EFFORTS: f64 = 0.02;

/// A wrist that turns by more than a whole turn, as many industrial arms do.
#[test]
fn a_joint_with_limits_beyond_half_a_turn_goes_from_end_to_end_in_both_engines() {
    const END: f64 = 6.2;
    const TICKS: usize = 32_000;
    let mut model = proact_description::mpl_right_arm();
    let wrist = model.arm[4];
    (model.joints[wrist].limits.lower, model.joints[wrist].limits.upper) = (-END, END);
    for engine in [PhysicsEngine::Reduced, PhysicsEngine::Ode] {
        let options = DynamicsOptions { engine, ..DynamicsOptions::default() };
        let mut start = positions(&model, &START, "open");
        start[4] = -END;
        let mut plant =
            RigidBodyPlant::new(&model, &bare_table(Vec::new()), &start, &still(), options).unwrap();
        let speed = 2.0 * END / TICKS as f64;
        let mut command = hold_command(&start, still());
        command.velocity[4] = speed * 1e3;
        let mut off = 0.0_f64;
        for _ in 0..TICKS {
            command.position[4] += speed;
            plant.step(&command).unwrap();
            off = off.max((plant.state().position[4] - command.position[4]).abs());
        }
        assert!(off < 0.02, "{engine:?}: {off} rad behind");
        command.velocity[4] = 0.0;
        // The end stops it, and not half a turn.
        command.position[4] = END + 0.5;
        for _ in 0..1000 {
            plant.step(&command).unwrap();
        }
        let at = plant.state().position[4];
        assert!((at - END).abs() < 0.01, "{engine:?}: {at}");
    }
}

#[test]
fn an_arm_that_touches_nothing_moves_alike_in_both_engines() {
    let model = proact_description::mpl_right_arm();
    let open = positions(&model, &START, "open");
    let closed = positions(&model, &START, "closed");
    let mut plants = both_engines(&box_scene(), &still());
    let (mut angles, mut efforts, mut largest, mut tips) = (0.0_f64, 0.0_f64, 0.0_f64, 0.0_f64);
    for tick in 1..=3000 {
        let time = f64::from(tick) * 1e-3;
        let mut command = hold_command(&open, still());
        for k in 0..open.len() {
            let amplitude = if k < 7 { if k == 4 { -0.2 } else { 0.2 } } else { 0.5 * (closed[k] - open[k]) };
            command.position[k] += amplitude * (1.0 - time.cos());
            command.velocity[k] = amplitude * time.sin();
        }
        command.world_from_base.translation.y += 0.05 * (1.0 - (2.0 * time).cos());
        let [reduced, ode] = step(&mut plants, &command);
        angles = angles.max(max_difference(&reduced.position, &ode.position));
        efforts = efforts.max(max_difference(&reduced.effort[..7], &ode.effort[..7]));
        largest = reduced.effort[..7].iter().fold(largest, |max, effort| max.max(effort.abs()));
        let [a, b] = [0, 1].map(|k| plants[k].link_pose(model.tip).unwrap().translation.vector);
        tips = tips.max((a - b).norm());
    }
    println!("angles {angles:.1e} rad, wrist {tips:.1e} m, efforts {efforts:.1e} of {largest:.2} N m apart");
    assert!(angles < FREE_ANGLES, "{angles} rad apart");
    assert!(efforts < FREE_EFFORTS, "{efforts} N m apart");
    assert!(tips < 1e-4, "{tips} m apart");
    assert!(angles > 0.0, "two engines, not one");
}

/// What a block feels between closing fingers.
#[derive(Debug, Default)]
struct Pinch {
    /// Mean sum of the forces of the thumb's links, N.
    thumb: f64,
    /// Of the other digits'.
    fingers: f64,
}

/// Share of the thumb's mean force by which the engines may differ: contacts of stiff fingers flicker, in each in its own
/// way.
const THUMB_SHARE: f64 = 0.3;
/// The same of all fingers: where they slip along the block aslant, ODE's friction is up to 1.41 times Coulomb's, and they
/// wedge it the harder.
const FINGERS_SHARE: f64 = 1.0;
/// In `reduced` a block between thumb and fingers rests, so that they balance; some of it is friction of the table.
const BALANCE: f64 = 0.1;

#[test]
fn a_closing_hand_presses_and_moves_a_block_alike_in_both_engines() {
    let model = proact_description::mpl_right_arm();
    let open = positions(&model, &START, "open");
    let closed = positions(&model, &START, "closed");
    let base = grasp_base(&model, &open);
    let mut plants = both_engines(&bare_table(vec![standing(ObjectId(0), 0.0, 0.0)]), &base);
    let (mut pinches, mut count) = ([Pinch::default(), Pinch::default()], 0.0);
    for (tick, command) in move_hand(&open, &closed, base, 1200).iter().enumerate() {
        let states = step(&mut plants, command);
        if tick < 700 {
            continue;
        }
        count += 1.0;
        for (pinch, state) in pinches.iter_mut().zip(states) {
            for contact in &state.contacts {
                let thumb = model.links[contact.link].name.contains("thumb");
                *(if thumb { &mut pinch.thumb } else { &mut pinch.fingers }) += contact.force;
            }
        }
    }
    for pinch in &mut pinches {
        pinch.thumb /= count;
        pinch.fingers /= count;
    }
    let [a, b] = [0, 1].map(|k| plants[k].state().objects[0].pose.translation.vector);
    let [reduced, ode] = &pinches;
    println!("{reduced:?} and {ode:?} N, blocks {:.1e} m apart", (a - b).norm());
    for (mine, theirs, share) in
        [(reduced.thumb, ode.thumb, THUMB_SHARE), (reduced.fingers, ode.fingers, FINGERS_SHARE)]
    {
        assert!(mine > 0.1, "{reduced:?}: the hand presses");
        assert!((mine - theirs).abs() < share * mine, "{reduced:?} and {ode:?}");
    }
    assert!((reduced.thumb - reduced.fingers).abs() < BALANCE * reduced.thumb, "{reduced:?}: not in balance");
    assert!((a - b).norm() < 3e-3, "blocks {} m apart", (a - b).norm());
}

#[test]
fn a_block_that_is_carried_and_put_down_ends_in_the_same_place_in_both_engines() {
    let model = proact_description::mpl_right_arm();
    let open = positions(&model, &START, "open");
    let closed = positions(&model, &START, "closed");
    let start = grasp_base(&model, &open);
    let mut plants = both_engines(&bare_table(vec![standing(ObjectId(0), 0.0, 0.0)]), &start);
    for command in move_hand(&open, &closed, start, 400) {
        step(&mut plants, &command);
    }
    for plant in &mut plants {
        plant.attach(0, model.tip).unwrap();
    }
    // Up, aside and down again by the base, within two seconds each.
    let held = plants[0].state().position.clone();
    let mut base = start;
    for tick in 0..6000 {
        let amplitude =
            0.5 * std::f64::consts::PI * (f64::from(tick % 2000) * 1e-3 * 0.5 * std::f64::consts::PI).sin();
        match tick / 2000 {
            0 => base.translation.z += 5e-5 * amplitude,
            1 => base.translation.y += 1e-4 * amplitude,
            _ => base.translation.z -= 4.9e-5 * amplitude,
        }
        step(&mut plants, &hold_command(&held, base));
    }
    for plant in &mut plants {
        plant.release();
    }
    for command in move_hand(&held, &open, base, 1500) {
        step(&mut plants, &command);
    }
    let [a, b] = [0, 1].map(|k| plants[k].state().objects[0]);
    let moved = (a.pose.translation.vector - start.translation.vector).norm();
    let between = (a.pose.translation.vector - b.pose.translation.vector).norm();
    println!("put down at {:?} and {:?}", a.pose.translation.vector, b.pose.translation.vector);
    assert!(a.pose.translation.y > 0.15 && moved > 0.0, "the block was carried: {:?}", a.pose);
    assert!(between < 0.2 * RADIUS, "{between} m apart");
    assert!(a.linear_velocity.norm() < 1e-3 && b.linear_velocity.norm() < 1e-3, "both lie still");
}

#[test]
fn a_block_that_is_pushed_slowly_moves_alike_in_both_engines_though_it_slept() {
    let model = proact_description::mpl_right_arm();
    let open = positions(&model, &START, "open");
    let mut base = grasp_base(&model, &open);
    let mut plants = both_engines(&bare_table(vec![standing(ObjectId(0), 0.0, 0.0)]), &base);
    for _ in 0..600 {
        step(&mut plants, &hold_command(&open, base));
    }
    for _ in 0..3000 {
        if plants.iter().all(|plant| !plant.state().contacts.is_empty()) {
            break;
        }
        base.translation.y += 2e-5;
        step(&mut plants, &hold_command(&open, base));
    }
    let start = plants.each_ref().map(|plant| plant.state().objects[0].pose.translation.y);
    // Half a millimetre a second is below the speed at which a block that nothing touches falls asleep.
    for _ in 0..20_000 {
        base.translation.y += 5e-7;
        step(&mut plants, &hold_command(&open, base));
    }
    let end = plants.each_ref().map(|plant| plant.state().objects[0].pose.translation.y);
    println!("{start:?} m to {end:?} m");
    for (start, end) in start.iter().zip(end) {
        assert!(end - start > 8e-3, "swept by {} m", end - start);
    }
    assert!((end[0] - end[1]).abs() < 1e-3, "{end:?}");
}
