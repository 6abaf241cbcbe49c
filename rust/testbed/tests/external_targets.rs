//! Arm and hand that somebody else's controllers drive beside the method.

mod common;

use common::{Outcome, config, stare};
use proact_control::HandCommand;
use proact_testbed::{
    RunningTrial,
    doubles::ScriptedGaze,
    stages::{ExternalJointTarget, ExternalTargets},
};
use proact_types::Command;

fn running_trial(script: Vec<(u64, Command)>) -> Outcome<RunningTrial> {
    stare(config("A", 60.0), script, ScriptedGaze::default())
}

/// Asks joint 3 for a little more in each tick, and the first finger joint to stay where it is.
fn elbow(trial: &RunningTrial) -> ExternalTargets {
    let position = trial.testbed().targets()[3] + 1e-4;
    ExternalTargets {
        joints: vec![ExternalJointTarget { joint: 3, position, velocity: 0.1 }],
        ..ExternalTargets::default()
    }
}

fn digest_after(trial: &mut RunningTrial, ticks: u64) -> Outcome<String> {
    for tick in 1..=ticks {
        trial.step(tick == ticks)?;
    }
    Ok(trial.testbed().digest())
}

// Catches a joint that is not driven, one that goes on by itself, and a digest that does not know of it.
#[test]
fn a_joint_goes_where_it_is_driven_and_stays_when_nobody_drives_it() -> Outcome {
    let mut driven = running_trial(vec![])?;
    let start = driven.testbed().targets()[3];
    for _ in 0..1000 {
        driven.set_external_targets(elbow(&driven));
        let step = driven.step(false)?;
        assert!(!step.output.arm_commanded);
    }
    let left = driven.testbed().targets()[3];
    assert!((left - start - 0.1).abs() < 1e-9, "{} rad", left - start);
    let with = digest_after(&mut driven, 500)?;
    assert_eq!(driven.testbed().targets()[3], left);
    assert_ne!(with, digest_after(&mut running_trial(vec![])?, 1500)?);
    Ok(())
}

// Catches two that drive one joint at once, and a method that has to wait for a controller.
#[test]
fn where_the_method_commands_the_method_has_the_arm() -> Outcome {
    let script = || vec![(0, Command::NoMotion), (2000, Command::WristExtension)];
    let mut alone = running_trial(script())?;
    let mut driven = running_trial(script())?;
    let mut commanded = None;
    for tick in 1..=4000 {
        alone.step(false)?;
        // As a controller does that lets go once the method has the arm.
        if commanded.is_none() {
            driven.set_external_targets(elbow(&driven));
        }
        let before = driven.testbed().targets()[3];
        let step = driven.step(false)?;
        if step.output.arm_commanded && commanded.is_none() && tick > 100 {
            commanded = Some(tick);
            assert_eq!(driven.testbed().targets()[3], before, "in this tick already");
        }
    }
    let at = commanded.ok_or("the method never commands")?;
    assert!((2000..2300).contains(&at), "at {at} ms");
    let [mine, theirs] = [&driven, &alone].map(|trial| trial.testbed().targets()[0]);
    assert!(
        (mine - theirs).abs() < 1e-9,
        "the method's joint goes as it does alone: {mine} and {theirs} rad"
    );
    Ok(())
}

// Catches a hand that forgets where it is, and a hold that does not hold.
#[test]
fn the_hand_closes_on_command_and_holds_half_way() -> Outcome {
    let mut trial = running_trial(vec![])?;
    let arm = trial.testbed().model().arm_count();
    let fingers = |trial: &RunningTrial| trial.testbed().targets()[arm..].to_vec();
    let open = fingers(&trial);
    let close = ExternalTargets { hand: Some(HandCommand::Close), ..ExternalTargets::default() };
    trial.set_external_targets(close.clone());
    for _ in 0..100 {
        trial.step(false)?;
    }
    assert!(!trial.testbed().is_hand_settled());
    trial.set_external_targets(ExternalTargets { hold_hand: true, ..ExternalTargets::default() });
    trial.step(false)?;
    let half = fingers(&trial);
    assert_ne!(half, open);
    for _ in 0..500 {
        trial.step(false)?;
    }
    assert_eq!(fingers(&trial), half);
    trial.set_external_targets(close);
    let mut ticks = 0;
    while !trial.testbed().is_hand_settled() || ticks < 10 {
        trial.step(false)?;
        ticks += 1;
        assert!(ticks < 5000, "it never arrives");
    }
    assert_ne!(fingers(&trial), half);
    Ok(())
}
