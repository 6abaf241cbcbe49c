//! Speeds of methods A and B by effort and by a velocity ramp.

mod common;

use common::{Rig, START_RAD, model};
use proact_control::{JogProfile, Profile, ProportionalSpeed, VelocityRamp, build};
use proact_types::Command::{WristExtension, WristFlexion};

/// Method A with another speed of its gestures; the joint turns slowly enough that no turn ends at its limit.
fn rig_with(change: impl FnOnce(&mut Option<ProportionalSpeed>, &mut Option<VelocityRamp>)) -> Rig {
    let mut profile = Profile::named("default").expect("embedded");
    let JogProfile::Time { proportional, ramp, .. } = &mut profile.jog else { panic!("by time") };
    change(proportional, ramp);
    profile.joint_jog.speed_rad_per_s = 0.05;
    profile.check().expect("numbers that make sense");
    let mut rig = Rig::with(build("A", &profile, &model()).expect("a known method"));
    rig.run(10);
    rig
}

#[test]
fn the_speed_is_proportional_to_the_effort_between_rest_and_full() {
    let turned = |effort| {
        let by = ProportionalSpeed { rest_effort: 0.2, full_effort: 0.8 };
        let mut rig = rig_with(|proportional, _| *proportional = Some(by));
        rig.effort = effort;
        rig.make(WristExtension, 1000);
        rig.q[0] - START_RAD[0]
    };
    let whole = turned(1.0);
    assert!((whole - 0.05).abs() < 0.002, "{whole} rad in a second");
    for (effort, share) in [(0.0, 0.0), (0.2, 0.0), (0.5, 0.5), (0.8, 1.0)] {
        let part = turned(effort) / whole;
        assert!((part - share).abs() < 0.02, "effort {effort} gives {part} of the speed, expected {share}");
    }
}

#[test]
fn a_ramp_takes_its_time_and_a_decision_of_the_other_direction_moves_little() {
    let ramp = VelocityRamp { rise_ms: 400, fall_rate_factor: 2.0 };
    let mut rig = rig_with(|_, profile_ramp| *profile_ramp = Some(ramp));
    rig.make(WristExtension, 400);
    let first = rig.q[0] - START_RAD[0];
    assert!((first / (0.05 * 0.4) - 0.5).abs() < 0.05, "half the way of the whole speed: {first} rad");
    rig.make(WristExtension, 400);
    let second = rig.q[0] - START_RAD[0] - first;
    assert!((second / (0.05 * 0.4) - 1.0).abs() < 0.02, "the whole speed: {second} rad");
    // A wrong decision of 50 ms hardly moves the joint; without a ramp it goes back by more than twice as much. The ramp goes on from where it
    // fell to.
    let before = rig.q[0];
    rig.make(WristFlexion, 50);
    let back = before - rig.q[0];
    assert!(back.abs() < 0.05 * 0.05 / 4.0, "{back} rad");
    let before = rig.q[0];
    rig.make(WristExtension, 50);
    let on = (rig.q[0] - before) / (0.05 * 0.05);
    assert!((0.5..0.9).contains(&on), "from three quarters of the speed on, one control step late: {on}");
}

#[test]
fn efforts_and_ramps_that_make_no_sense_are_refused() {
    let refusal = |proportional, ramp| {
        let mut profile = Profile::named("default").expect("embedded");
        let JogProfile::Time { proportional: p, ramp: r, .. } = &mut profile.jog else { panic!("by time") };
        (*p, *r) = (proportional, ramp);
        profile.check().expect_err("numbers that make no sense").to_string()
    };
    for (rest, full, key) in [
        (-0.1, 0.5, "rest_effort"),
        (1.0, 1.0, "rest_effort"),
        (f64::NAN, 1.0, "rest_effort"),
        (0.5, 0.5, "full_effort"),
    ] {
        let text = refusal(Some(ProportionalSpeed { rest_effort: rest, full_effort: full }), None);
        assert!(text.contains(&format!("jog.proportional.{key}")), "{text}");
    }
    for (up_ms, falls, key) in
        [(0, 2.0, "rise_ms"), (400, 0.5, "fall_rate_factor"), (400, f64::NAN, "fall_rate_factor")]
    {
        let text = refusal(None, Some(VelocityRamp { rise_ms: up_ms, fall_rate_factor: falls }));
        assert!(text.contains(&format!("jog.ramp.{key}")), "{text}");
    }
}
