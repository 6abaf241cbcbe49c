//! A hand that opens beside a wall does not press on it.
#![allow(clippy::unwrap_used)]

use proact_app::{Arm, trial};
use proact_control::MethodRegistry;
use proact_devices::EmgOrigin;
use proact_testbed::{Setup, TrialConfig};
use proact_types::TICK_SECS;

/// From this share of its limit on, an effort counts as at the limit.
const AT_LIMIT: f64 = 0.95;
/// A joint may be there while the arm starts or stops, s.
const MAX_TRANSIENT_SECS: f64 = 0.2;

#[test]
fn no_joint_of_the_arm_stays_at_its_effort_limit_while_blocks_are_let_go() {
    let max_secs: f64 = [1, 2, 3].into_iter().map(longest_at_limit).fold(0.0, f64::max);
    assert!(
        max_secs < MAX_TRANSIENT_SECS,
        "{max_secs:.2} s at the limit of its effort, expected below {MAX_TRANSIENT_SECS}"
    );
}

/// The longest time that a joint of the arm is at its limit without a break, s: a trial of D whose first block goes to a corner
/// of the box.
fn longest_at_limit(seed: u64) -> f64 {
    let config = TrialConfig::new("D", seed, Setup::named("seated").unwrap());
    let config =
        config.with_overrides(&["task.arrangement=[\"NL\",\"NM\",\"FM\",\"FL\"]".to_owned()]).unwrap();
    let arm = Arm::from_config(&config).unwrap();
    let methods = MethodRegistry::standard();
    let assembled =
        trial::simulated_trial_with_model(&methods, &arm, config, &EmgOrigin::Synthetic, None).unwrap();
    let trial::Assembly { mut trial, .. } = assembled;
    let model = proact_description::mpl_right_arm();
    let highest: Vec<f64> = model.arm.iter().map(|&joint| model.joints[joint].limits.effort).collect();
    let mut ticks = vec![0_u32; highest.len()];
    let mut longest_hold = (0, 0, 0);
    loop {
        let step = trial.step(false).unwrap();
        let state = trial.testbed().plant().state();
        for (joint, highest) in highest.iter().enumerate() {
            let at_limit = state.effort[joint].abs() >= AT_LIMIT * highest;
            ticks[joint] = if at_limit { ticks[joint] + 1 } else { 0 };
            longest_hold = longest_hold.max((ticks[joint], joint, step.time.0));
        }
        if step.output.finished {
            println!(
                "seed {seed}: {} ticks, joint {}, at {} ms",
                longest_hold.0, longest_hold.1, longest_hold.2
            );
            return f64::from(longest_hold.0) * TICK_SECS;
        }
    }
}
