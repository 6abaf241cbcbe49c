//! No joint goes much faster than it can be asked to, whatever the arm grinds on: trials of A and B, whose person steers the
//! hand into walls, the partition and blocks.
#![allow(clippy::unwrap_used)]

use proact_app::{Arm, trial};
use proact_control::MethodRegistry;
use proact_devices::EmgOrigin;
use proact_testbed::{Setup, TrialConfig};

/// The bound in contact: this many times a joint's highest speed. Gears brake from 1.5 times on (docs/dynamics.md).
const BOUND: f64 = 2.0;
/// The bound of the original's gains with real masses, which overshoot by themselves: over twenty seeds of method D a joint
/// of the wrist goes at up to 3.7 times its highest speed, in either engine, on plans that keep to the limits.
const OVERSHOOT: f64 = 4.0;
/// A base slower than this rests, m/s and rad/s; a body that carries the arm into a wall must turn its joints.
const RESTS: f64 = 0.01;
/// What it stirred up has passed after so many ticks.
const MAX_TRANSIENT_TICKS: u64 = 100;

fn config(method: &str, seed: u64) -> TrialConfig {
    TrialConfig::new(method, seed, Setup::named("seated").unwrap())
}

/// The highest speed of an arm joint while the base rests, as a share of the joint's highest; its joint and tick.
fn fastest(config: TrialConfig) -> (f64, usize, u64) {
    let arm = Arm::from_config(&config).unwrap();
    let methods = MethodRegistry::standard();
    let assembled =
        trial::simulated_trial_with_model(&methods, &arm, config, &EmgOrigin::Synthetic, None).unwrap();
    let trial::Assembly { mut trial, .. } = assembled;
    let model = proact_description::mpl_right_arm();
    let highest: Vec<f64> = model.arm.iter().map(|&joint| model.joints[joint].limits.velocity).collect();
    let (mut longest_move, mut moved_at) = ((0.0, 0, 0), 0);
    let mut base = trial.testbed().plant().state().world_from_base;
    loop {
        let step = trial.step(false).unwrap();
        let (state, now) = (trial.testbed().plant().state(), step.time.0);
        let displacement = (state.world_from_base.translation.vector - base.translation.vector).norm();
        if displacement + state.world_from_base.rotation.angle_to(&base.rotation)
            > RESTS * proact_types::TICK_SECS
        {
            moved_at = now;
        }
        base = state.world_from_base;
        if now > moved_at + MAX_TRANSIENT_TICKS {
            for (joint, (speed, highest)) in state.velocity.iter().zip(&highest).enumerate() {
                if speed.abs() / highest > longest_move.0 {
                    longest_move = (speed.abs() / highest, joint, now);
                }
            }
        }
        if step.output.finished {
            return longest_move;
        }
    }
}

fn check(seeds: std::ops::RangeInclusive<u64>) {
    let mut worst = 0.0_f64;
    for (method, seed) in
        ["A", "B"].into_iter().flat_map(|method| seeds.clone().map(move |seed| (method, seed)))
    {
        let (share, joint, at) = fastest(config(method, seed));
        worst = worst.max(share);
        assert!(
            (0.5..BOUND).contains(&share),
            "method {method}, seed {seed}: joint {joint} at {share:.2} times its highest speed at {at} ms, expected below {BOUND}"
        );
    }
    println!("at most {worst:.2} times a joint's highest speed");
}

#[test]
fn no_joint_goes_much_faster_than_it_can_be_asked_to() {
    check(2..=3);
}

#[test]
#[ignore = "minutes: lane speeds"]
fn no_joint_of_a_hundred_trials_goes_much_faster_than_it_can_be_asked_to() {
    check(1..=50);
}

#[test]
fn masses_at_the_ends_of_their_range_are_usable() {
    for (control, factor) in
        [("feed_forward", 0.3), ("feed_forward", 100.0), ("original_gains", 0.01), ("original_gains", 1.0)]
    {
        for engine in ["reduced", "ode"] {
            let set = [
                format!("physics.joint_control={control}"),
                format!("physics.mass_set.scaled={factor}"),
                format!("physics.engine={engine}"),
                "limit_secs=40".to_owned(),
            ];
            let (share, joint, at) = fastest(config("D", 1).with_overrides(&set).unwrap());
            let found = format!(
                "{control}, {factor}, {engine}: joint {joint} at {share:.2} of its highest speed at {at} ms"
            );
            println!("{found}");
            let bound = if control == "original_gains" { OVERSHOOT } else { BOUND };
            assert!((0.1..bound).contains(&share), "{found}");
        }
    }
}
