//! Energy and torques of the undriven and the driven arm, against laws that know nothing of ODE.

#![allow(missing_docs)]
#![allow(clippy::unwrap_used)]

mod common;

use common::{START, bare_table, grasp_base, hold_command, positions, standing, still};
use proact_arm::{ArmModel, JointKind};
use proact_dynamics::{DynamicsOptions, PhysicsEngine, RigidBodyPlant};
use proact_kinematics::Kinematics;
use proact_testbed::ports::Plant;
use proact_types::{ObjectId, Point, Scene, Vector, zeros};

/// The arm without damping, friction, stops and motors.
fn undriven(mut model: ArmModel, damping: f64) -> ArmModel {
    for joint in &mut model.joints {
        (joint.damping, joint.friction, joint.limits.effort) = (damping, 0.0, 0.0);
        (joint.limits.lower, joint.limits.upper) = (f64::NEG_INFINITY, f64::INFINITY);
    }
    model
}

fn empty_scene() -> Scene {
    Scene { fixed: Vec::new(), ..bare_table(Vec::new()) }
}

/// Kinetic energy by KDL's mass matrix and potential energy by the links' places, J.
fn energy(model: &ArmModel, kinematics: &mut Kinematics, plant: &RigidBodyPlant) -> (f64, f64) {
    let state = plant.state();
    let rest = zeros(model.moving_count());
    let momentum =
        kinematics.inverse_dynamics(&state.position, &rest, &state.velocity, &Vector::zeros()).unwrap();
    let kinetic: f64 = momentum.iter().zip(&state.velocity).map(|(p, v)| 0.5 * p * v).sum();
    let potential = (0..model.links.len())
        .filter_map(|link| {
            let inertial = model.links[link].inertial.as_ref()?;
            let center = plant.link_pose(link).unwrap() * Point::from(inertial.pose.translation.vector);
            Some(9.80665 * inertial.mass * center.z)
        })
        .sum();
    (kinetic, potential)
}

/// Lets the limp arm fall for five seconds: largest change of the energy and largest potential energy released, J.
fn free_fall(start: &[f64], options: DynamicsOptions, damping: f64) -> (f64, f64, f64) {
    let original = proact_description::mpl_right_arm();
    let mut kinematics = Kinematics::new(&original).unwrap();
    let model = undriven(original, damping);
    let mut plant = RigidBodyPlant::new(&model, &empty_scene(), start, &still(), options).unwrap();
    let command = hold_command(start, still());
    let (_, first) = energy(&model, &mut kinematics, &plant);
    let (mut low, mut high, mut released) = (0.0_f64, 0.0_f64, 0.0_f64);
    for tick in 0..5000 {
        plant.step(&command).unwrap();
        if tick % 5 != 0 {
            continue;
        }
        let (kinetic, potential) = energy(&model, &mut kinematics, &plant);
        low = low.min(kinetic + potential - first);
        high = high.max(kinetic + potential - first);
        released = released.max(first - potential);
    }
    (low, high, released)
}

/// Two places to fall from: the start of a trial, and nearly stretched out.
fn starts() -> [Vec<f64>; 2] {
    let model = proact_description::mpl_right_arm();
    [START, [1.2, -0.2, 0.3, 0.2, 0.1, 0.1, 0.1]].map(|arm| positions(&model, &arm, "open"))
}

/// The arm with its hand at rest is one of seven joints. Free fingers without stops whip round at hundreds of radians a
/// second, where the plant brakes them; they lose energy then, and must not gain any.
#[test]
fn an_undamped_arm_keeps_its_energy_within_one_percent_for_five_seconds() {
    for start in starts() {
        for (hold_still_hand, loss) in [(true, 0.01), (false, 0.6)] {
            let options = DynamicsOptions { lock_idle_hand: hold_still_hand, ..DynamicsOptions::default() };
            let (low, high, released) = free_fall(&start, options, 0.0);
            println!(
                "hand merged {hold_still_hand}: {:+.2} % to {:+.2} % of {released:.2} J",
                100.0 * low / released,
                100.0 * high / released
            );
            assert!(released > 1.0, "the arm must fall: {released} J");
            assert!(high < 0.01 * released, "gained {high} J of {released} J");
            assert!(low > -loss * released, "lost {low} J of {released} J");
        }
    }
}

/// Damping of light fingers must not shake them, which it would if it were taken from the start of the tick.
#[test]
fn with_damping_energy_never_grows() {
    for start in starts() {
        for hold_still_hand in [true, false] {
            for damping in [0.01, 1.0] {
                let options =
                    DynamicsOptions { lock_idle_hand: hold_still_hand, ..DynamicsOptions::default() };
                let (_, high, released) = free_fall(&start, options, damping);
                assert!(released > 0.02, "damping {damping}: the arm must fall: {released} J");
                assert!(high < 1e-6, "damping {damping}: gained {high} J of {released} J");
            }
        }
    }
}

/// Numbers in [0, 1) that look random.
struct RandomNumbers(u64);

impl RandomNumbers {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1_u64 << 53) as f64
    }
}

#[test]
fn accelerations_put_through_kdl_give_back_the_torques_within_one_percent() {
    let turning = proact_description::mpl_right_arm();
    accelerations_give_back_the_torques(&turning);
    // Joints of the arm and the hand that slide, by at most a hand's length.
    let mut sliding = turning;
    for joint in [sliding.arm[1], sliding.arm[3], sliding.hand[2], sliding.hand[9]] {
        let joint = &mut sliding.joints[joint];
        joint.kind = JointKind::Prismatic;
        (joint.limits.lower, joint.limits.upper, joint.limits.effort) = (-0.1, 0.1, 100.0);
    }
    accelerations_give_back_the_torques(&sliding);
}

fn accelerations_give_back_the_torques(model: &ArmModel) {
    let mut kinematics = Kinematics::new(model).unwrap();
    let mut free = model.clone();
    for joint in &mut free.joints {
        (joint.damping, joint.friction) = (0.0, 0.0);
    }
    let gravity = Vector::new(0.0, 0.0, -9.80665);
    let options = DynamicsOptions { lock_idle_hand: false, ..DynamicsOptions::default() };
    let limits: Vec<_> = model.moving().map(|joint| model.joints[joint].limits).collect();
    let mut numbers = RandomNumbers(5);
    let mut worst_share = 0.0_f64;
    for state in 0..50 {
        // Anywhere in the inner part of the limits, then driven by speeds that change at random.
        let start: Vec<f64> =
            limits.iter().map(|l| l.lower + (0.3 + 0.4 * numbers.next()) * (l.upper - l.lower)).collect();
        let mut plant = RigidBodyPlant::new(&free, &empty_scene(), &start, &still(), options).unwrap();
        let mut command = hold_command(&start, still());
        for _ in 0..60 {
            for k in 0..start.len() {
                let speed = command.velocity[k] + 0.05 * (numbers.next() - 0.5);
                command.velocity[k] = speed.clamp(-0.5, 0.5);
                command.position[k] += 1e-3 * command.velocity[k];
            }
            let before = plant.state().clone();
            plant.step(&command).unwrap();
            let after = plant.state();
            let acceleration: Vec<f64> =
                after.velocity.iter().zip(&before.velocity).map(|(b, a)| (b - a) / 1e-3).collect();
            let torques = kinematics
                .inverse_dynamics(&before.position, &before.velocity, &acceleration, &gravity)
                .unwrap();
            let largest = after.effort.iter().fold(0.0_f64, |max, effort| max.max(effort.abs()));
            for (k, (torque, effort)) in torques.iter().zip(&after.effort).enumerate() {
                // A joint without a range is one body with its parent and tells no effort.
                if limits[k].upper - limits[k].lower < 1e-9 {
                    continue;
                }
                worst_share = worst_share.max((torque - effort).abs() / largest);
                assert!(
                    (torque - effort).abs() < 0.01 * largest,
                    "state {state}, joint {k}: {effort} N m applied, {torque} N m found, largest {largest}"
                );
            }
        }
    }
    println!("worst difference {:.3} % of the largest torque", 100.0 * worst_share);
}

/// How far the joints of the arm and the hand come apart, m: a child's origin against where its parent has it.
fn joint_gap(model: &ArmModel, plant: &RigidBodyPlant) -> f64 {
    (0..model.joints.len())
        .map(|joint| {
            let description = &model.joints[joint];
            let parent = plant.link_pose(description.parent).unwrap() * description.origin;
            let child = plant.link_pose(description.child).unwrap();
            (parent.translation.vector - child.translation.vector).norm()
        })
        .fold(0.0, f64::max)
}

#[test]
fn joints_come_apart_by_less_than_a_tenth_of_a_millimetre_at_half_a_radian_a_second_with_a_block() {
    let model = proact_description::mpl_right_arm();
    let open = positions(&model, &START, "open");
    let base = grasp_base(&model, &open);
    let cases = [PhysicsEngine::Reduced, PhysicsEngine::Ode].map(|engine| [(engine, true), (engine, false)]);
    for (engine, hold_still_hand) in cases.into_iter().flatten() {
        let options =
            DynamicsOptions { engine, lock_idle_hand: hold_still_hand, ..DynamicsOptions::default() };
        let scene = bare_table(vec![standing(ObjectId(0), 0.0, 0.0)]);
        let mut plant = RigidBodyPlant::new(&model, &scene, &open, &base, options).unwrap();
        plant.attach(0, model.tip).unwrap();
        let mut worst = 0.0_f64;
        let mut command = hold_command(&open, base);
        for tick in 0..2000 {
            // Up and away from the table, all seven joints to and fro.
            command.world_from_base.translation.z += 5e-4 * f64::from(u8::from(tick < 600));
            for k in 0..7 {
                let speed = if k == 4 || tick % 800 >= 400 { -0.5 } else { 0.5 };
                command.velocity[k] = speed;
                command.position[k] += 1e-3 * speed;
            }
            plant.step(&command).unwrap();
            worst = worst.max(joint_gap(&model, &plant));
        }
        println!("{engine:?}, hand merged {hold_still_hand}: joints at most {:.2e} mm apart", 1e3 * worst);
        assert!(plant.state().attached.is_some());
        assert!(worst > 0.0 && worst < 1e-4, "joints {worst} m apart");
    }
}
