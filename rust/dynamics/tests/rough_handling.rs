//! The arm sweeps through box and blocks, and nothing explodes.

#![allow(missing_docs)]
#![allow(clippy::unwrap_used)]

mod common;

use common::{START, box_scene, hold_command, plant_with, positions, still};
use proact_dynamics::{DynamicsOptions, PhysicsEngine};
use proact_testbed::ports::Plant;

/// Numbers in [0, 1) that look random (a linear congruential generator, so that the run is the same everywhere).
struct RandomNumbers(u64);

impl RandomNumbers {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1_u64 << 53) as f64
    }
}

#[test]
fn a_minute_of_sweeping_through_box_and_blocks_stays_finite_and_slow() {
    sweep(PhysicsEngine::Reduced);
}

#[test]
fn a_minute_of_sweeping_in_the_engine_ode_stays_finite_and_slow() {
    sweep(PhysicsEngine::Ode);
}

fn sweep(engine: PhysicsEngine) {
    let model = proact_description::mpl_right_arm();
    let open = positions(&model, &START, "open");
    let closed = positions(&model, &START, "closed");
    let limits: Vec<_> = model.moving().map(|joint| model.joints[joint].limits).collect();
    let options = DynamicsOptions { engine, ..DynamicsOptions::default() };
    let mut plant = plant_with(&box_scene(), &still(), options);
    let mut numbers = RandomNumbers(1);
    let mut command = hold_command(&open, still());
    let (mut target, mut fastest, mut touched, mut lowest) = (open.clone(), 0.0_f64, 0, f64::INFINITY);
    let mut base_target = still().translation.vector;
    for tick in 0..60_000 {
        if tick % 1000 == 0 {
            // The whole range of the forearm's side of the arm, low over the table.
            let ranges =
                [(0.2, 1.2), (-0.5, 0.3), (-0.6, 0.8), (0.3, 1.8), (0.6, 1.57), (-0.2, 0.7), (-0.9, 0.9)];
            for (k, (low, high)) in ranges.iter().enumerate() {
                target[k] = low + numbers.next() * (high - low);
            }
            let hand = if numbers.next() < 0.5 { &open } else { &closed };
            target[7..].copy_from_slice(&hand[7..]);
            base_target = still().translation.vector;
            base_target.z -= 0.4 * numbers.next();
            base_target.x += 0.3 * numbers.next();
        }
        if tick % 3000 == 1500 {
            let block = (numbers.next() * 4.0) as usize;
            plant.release();
            // Only a block that is near: a far one would swing through the room.
            let tip = plant.link_pose(model.tip).unwrap().translation.vector;
            if (plant.state().objects[block].pose.translation.vector - tip).norm() < 0.2 {
                plant.attach(block, model.tip).unwrap();
            }
        }
        for k in 0..target.len() {
            let increment = (target[k] - command.position[k])
                .clamp(-1e-3 * limits[k].velocity, 1e-3 * limits[k].velocity);
            command.position[k] += increment;
            command.velocity[k] = increment * 1e3;
        }
        let offset = base_target - command.world_from_base.translation.vector;
        command.world_from_base.translation.vector += offset * (4e-4 / offset.norm().max(4e-4));
        plant.step(&command).unwrap_or_else(|error| panic!("tick {tick}: {error}"));
        let state = plant.state();
        touched += usize::from(!state.contacts.is_empty());
        for block in &state.objects {
            fastest = fastest.max(block.linear_velocity.norm());
            lowest = lowest.min(block.pose.translation.z);
        }
        for (angle, limit) in state.position.iter().zip(&limits) {
            // A base that presses the arm into the table bends joints past their stops: nothing gives way there.
            assert!(
                *angle > limit.lower - 0.06 && *angle < limit.upper + 0.06,
                "tick {tick}: {angle} of {limit:?}"
            );
        }
    }
    assert!(touched > 1000, "the arm met blocks in {touched} ticks");
    // Falling from the table to the floor gives 4.4 m/s; some fall from the lifted hand.
    assert!(fastest < 5.5, "a block flew at {fastest} m/s");
    assert!(lowest > 0.02, "a block sank into the floor to {lowest} m");
}
