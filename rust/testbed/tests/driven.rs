//! Arm and hand that somebody else's controllers drive beside the method.

mod common;

use common::{Outcome, config, stare};
use proact_control::HandCommand;
use proact_testbed::{
    Session,
    doubles::ScriptedGaze,
    stages::{Driven, DrivenJoint},
};
use proact_types::Gesture;

fn session(script: Vec<(u64, Gesture)>) -> Outcome<Session> {
    stare(config("A", 60.0), script, ScriptedGaze::default())
}

/// Asks joint 3 for a little more in each tick, and the first finger joint to stay where it is.
fn elbow(session: &Session) -> Driven {
    let position = session.testbed().targets()[3] + 1e-4;
    Driven { joints: vec![DrivenJoint { joint: 3, position, velocity: 0.1 }], ..Driven::default() }
}

fn digest_after(session: &mut Session, ticks: u64) -> Outcome<String> {
    for tick in 1..=ticks {
        session.step(tick == ticks)?;
    }
    Ok(session.testbed().digest())
}

// Catches a joint that is not driven, one that goes on by itself, and a digest that does not know of it.
#[test]
fn a_joint_goes_where_it_is_driven_and_stays_when_nobody_drives_it() -> Outcome {
    let mut driven = session(vec![])?;
    let start = driven.testbed().targets()[3];
    for _ in 0..1000 {
        driven.drive(elbow(&driven));
        let step = driven.step(false)?;
        assert!(!step.output.arm_commanded);
    }
    let left = driven.testbed().targets()[3];
    assert!((left - start - 0.1).abs() < 1e-9, "{} rad", left - start);
    let with = digest_after(&mut driven, 500)?;
    assert_eq!(driven.testbed().targets()[3], left);
    assert_ne!(with, digest_after(&mut session(vec![])?, 1500)?);
    Ok(())
}

// Catches two that drive one joint at once, and a method that has to wait for a controller.
#[test]
fn where_the_method_commands_the_method_has_the_arm() -> Outcome {
    let script = || vec![(0, Gesture::NoMotion), (2000, Gesture::WristExtension)];
    let mut alone = session(script())?;
    let mut driven = session(script())?;
    let mut commanded = None;
    for tick in 1..=4000 {
        alone.step(false)?;
        // As a controller does that lets go once the method has the arm.
        if commanded.is_none() {
            driven.drive(elbow(&driven));
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
    let [mine, theirs] = [&driven, &alone].map(|session| session.testbed().targets()[0]);
    assert!(
        (mine - theirs).abs() < 1e-9,
        "the method's joint goes as it does alone: {mine} and {theirs} rad"
    );
    Ok(())
}

// Catches a hand that forgets where it is, and a hold that does not hold.
#[test]
fn the_hand_closes_on_command_and_holds_half_way() -> Outcome {
    let mut session = session(vec![])?;
    let arm = session.testbed().model().arm_count();
    let fingers = |session: &Session| session.testbed().targets()[arm..].to_vec();
    let open = fingers(&session);
    let close = Driven { hand: Some(HandCommand::Close), ..Driven::default() };
    session.drive(close.clone());
    for _ in 0..100 {
        session.step(false)?;
    }
    assert!(!session.testbed().hand_rests());
    session.drive(Driven { hold_hand: true, ..Driven::default() });
    session.step(false)?;
    let half = fingers(&session);
    assert_ne!(half, open);
    for _ in 0..500 {
        session.step(false)?;
    }
    assert_eq!(fingers(&session), half);
    session.drive(close);
    let mut ticks = 0;
    while !session.testbed().hand_rests() || ticks < 10 {
        session.step(false)?;
        ticks += 1;
        assert!(ticks < 5000, "it never arrives");
    }
    assert_ne!(fingers(&session), half);
    Ok(())
}
