//! Methods A and B, default and original. Numbers in names are those of the original's list of defects.
mod common;

use Command::{HandClose, HandOpen, NoMotion, WristExtension, WristFlexion};
use common::{Rig, START_RAD, limits, model};
use proact_control::ports::ArmKinematics;
use proact_control::{
    ControlError, DampedProfile, HandCommand, InverseProfile, JogProfile, JogSteps, MotionCommand, Profile,
    build,
};
use proact_types::{Command, HandState, ObjectId, PlannerView, zeros};

fn mode(rig: &Rig) -> String {
    rig.shown.mode.clone().expect("A and B have modes").name
}

/// Moves on by `count` modes.
fn cycle(rig: &mut Rig, count: usize) {
    for _ in 0..count {
        rig.make(HandOpen, 100);
        rig.make(NoMotion, 100);
    }
}

fn refusal(rig: &Rig) -> String {
    match rig.shown.planner.clone() {
        PlannerView::Failed { reason, .. } => reason,
        other => panic!("a refusal was expected, not {other:?}"),
    }
}

fn hands(outputs: &[proact_control::ControlOutput]) -> Vec<HandCommand> {
    outputs.iter().filter_map(|output| output.hand).collect()
}

#[test]
fn joints_come_in_the_papers_order_with_their_names_and_directions() {
    let mut rig = Rig::new("A", "default");
    rig.run(10);
    let mut names = Vec::new();
    for number in 0..7 {
        let view = rig.shown.mode.clone().expect("A has modes");
        assert_eq!(common::number(view.controlled_dof), number);
        names.push(format!("{}: {} / {}", view.name, view.directions[0], view.directions[1]));
        cycle(&mut rig, 1);
    }
    assert_eq!(
        names,
        [
            "shoulder flexion/extension: flexion / extension",
            "shoulder adduction/abduction: abduction / adduction",
            "shoulder internal/external rotation: external rotation / internal rotation",
            "elbow flexion/extension: flexion / extension",
            "wrist pronation/supination: pronation / supination",
            "wrist ulnar/radial deviation: ulnar deviation / radial deviation",
            "wrist flexion/extension: extension / flexion",
        ]
    );
    assert_eq!(mode(&rig), "shoulder flexion/extension", "the cycle wraps");
}

#[test]
fn wrist_extension_moves_each_joint_by_the_originals_sign() {
    for (joint, sign) in [1.0, -1.0, -1.0, 1.0, 1.0, 1.0, -1.0].into_iter().enumerate() {
        let mut rig = Rig::new("A", "default");
        cycle(&mut rig, joint);
        // Wrist pronation starts at its upper limit, so this one goes the other way.
        let (command, sign) = if joint == 4 { (WristFlexion, -sign) } else { (WristExtension, sign) };
        rig.make(command, 300);
        let moved: Vec<f64> = rig.q.iter().zip(&START_RAD).map(|(q, start)| q - start).collect();
        assert!(moved[joint] * sign > 0.05, "joint {joint} moved by {}", moved[joint]);
        assert!(moved.iter().enumerate().all(|(k, by)| k == joint || *by == 0.0));
    }
}

#[test]
fn defect_13_the_hand_toggles_by_its_true_state_in_default_and_by_belief_in_original() {
    let mut rig = Rig::new("A", "default");
    assert_eq!(hands(&rig.make(NoMotion, 50)), []);
    assert_eq!(hands(&rig.make(HandClose, 500)), [HandCommand::Close], "one toggle for each hold");
    rig.make(NoMotion, 50);
    rig.hand.state = HandState::Open;
    assert_eq!(hands(&rig.make(HandClose, 50)), [HandCommand::Close], "the hand opened by itself");

    let mut rig = Rig::new("A", "original");
    assert_eq!(hands(&rig.make(NoMotion, 50)), [HandCommand::Close], "it starts closed");
    assert_eq!(hands(&rig.make(HandClose, 100)), [HandCommand::Close], "and believes the hand open");
    rig.make(NoMotion, 100);
    assert_eq!(hands(&rig.make(HandClose, 100)), [HandCommand::Open]);
}

#[test]
fn defect_14_before_the_first_goal_the_condition_rule_holds_the_arm_where_it_is() {
    let mut rig = Rig::new("B", "original");
    rig.q[3] = 0.5; // Condition number 34.
    let outputs = rig.make(WristExtension, 60);
    let goal = outputs.iter().find_map(|output| match &output.motion {
        Some(MotionCommand::Goto(goal)) => Some(goal.clone()),
        _ => None,
    });
    let mut here = START_RAD;
    here[3] = 0.5;
    assert_eq!(goal.expect("the last goal is sent again").as_slice(), here, "not the zeros of the original");
    assert!(refusal(&rig).contains("almost stretched out"));
}

#[test]
fn defect_15_near_a_singularity_motion_into_it_slows_to_a_stop_and_motion_out_of_it_is_free() {
    let mut rig = Rig::new("B", "default");
    let top = 0.5 + 1e-9;
    let outputs = rig.make(WristExtension, 8000);
    for output in &outputs {
        if let Some(MotionCommand::Velocity(speeds)) = &output.motion {
            assert!(speeds.iter().all(|speed| speed.abs() <= top), "{speeds:?}");
        }
    }
    assert!(rig.q[3] > 0.2, "the elbow stays bent: {} rad", rig.q[3]);
    let far = rig.tip().translation.x;
    rig.make(NoMotion, 50);
    rig.make(WristFlexion, 1000);
    let back = far - rig.tip().translation.x;
    assert!(back > 0.03, "out of it at full speed, within the joints' speeds: {back} m");
}

#[test]
fn defect_15_joints_at_their_limits_are_left_out_and_the_rest_keep_the_direction() {
    // Pronation starts at its limit; many directions would need more of it.
    for axis in 0..3 {
        for command in [WristExtension, WristFlexion] {
            let mut rig = Rig::new("B", "default");
            cycle(&mut rig, axis);
            let before = rig.tip();
            rig.make(command, 500);
            let after = rig.tip();
            let moved = after.translation.vector - before.translation.vector;
            let across = (0..3).filter(|&k| k != axis).map(|k| moved[k].abs()).fold(0.0, f64::max);
            assert!(moved[axis].abs() > 0.015, "axis {axis} {command}: {moved:?}");
            assert!(across < 0.001, "axis {axis} {command}: {moved:?}");
            assert!(after.rotation.angle_to(&before.rotation) < 0.02);
        }
    }
}

#[test]
fn defect_16_commanded_angles_do_not_run_away_from_an_arm_that_is_stuck() {
    let mut rig = Rig::new("B", "default");
    cycle(&mut rig, 2);
    let stuck = rig.q.clone();
    rig.gesture = WristFlexion;
    for _ in 0..300 {
        rig.lag = std::array::from_fn(|k| rig.q[k] - stuck[k]);
        rig.run(10);
    }
    let drift = rig.q.iter().zip(&stuck).fold(0.0_f64, |m, (q, at)| m.max((q - at).abs()));
    assert!((0.04..0.06).contains(&drift), "{drift} rad");
    assert!(refusal(&rig).contains("does not follow"));
    rig.make(NoMotion, 50);
    rig.make(WristExtension, 100);
    let less = rig.q.iter().zip(&stuck).fold(0.0_f64, |m, (q, at)| m.max((q - at).abs()));
    assert!(less < drift - 0.005, "the other way is free: {less} rad");
}

#[test]
fn a_joint_that_something_stops_is_pressed_no_harder_while_the_gesture_lasts_and_held_when_it_ends() {
    for method in ["A", "B"] {
        let mut rig = Rig::new(method, "default");
        let stuck = rig.q.clone();
        rig.gesture = WristExtension;
        for _ in 0..100 {
            rig.lag = std::array::from_fn(|k| rig.q[k] - stuck[k]);
            rig.run(10);
        }
        let ahead = rig.q.iter().zip(&stuck).fold(0.0_f64, |m, (q, at)| m.max((q - at).abs()));
        assert!((0.04..0.06).contains(&ahead), "{method}: {ahead} rad ahead");
        assert!(refusal(&rig).contains("something is in its way"));
        // An arm that holds gives up what it does not reach: it would press by fits and starts.
        assert_eq!(*rig.command(), MotionCommand::Velocity(zeros(7)), "{method}");
        rig.make(NoMotion, 20);
        assert_eq!(*rig.command(), MotionCommand::Hold, "{method}");
    }
}

#[test]
fn a_rotation_that_the_limits_turn_into_a_translation_is_refused() {
    let mut rig = Rig::new("B", "default");
    cycle(&mut rig, 5);
    for command in [WristExtension, WristFlexion] {
        for _ in 0..8 {
            let before = rig.tip();
            rig.make(command, 500);
            let after = rig.tip();
            let carried = (after.translation.vector - before.translation.vector).norm();
            let turned = after.rotation.angle_to(&before.rotation);
            assert!(carried <= 0.3 * 1.05 * turned + 1e-3, "{carried} m for {turned} rad");
            rig.make(NoMotion, 50);
        }
    }
}

#[test]
fn defect_17_distance_in_a_second_does_not_depend_on_the_rate_of_decisions() {
    for method in ["A", "B"] {
        let distance = |message_ms: u64| {
            let mut rig = Rig::new(method, "default");
            rig.message_ms = Some(message_ms);
            rig.q = proact_types::joints(&[0.2, -0.5, 0.3, 1.4, 0.3, 0.2, 0.1]);
            let before = rig.tip().translation.vector;
            rig.make(WristExtension, 1000);
            (rig.tip().translation.vector - before).norm()
        };
        // 5, 20 and 50 a second, and a rate that does not meet the control steps.
        let all = [200, 50, 20, 7].map(distance);
        for other in &all {
            // A message between control steps starts the motion up to one step earlier: 10 ms in 1 s.
            assert!((other / all[0] - 1.0).abs() < 0.01, "method {method}: {all:?} m");
        }
    }
    let mut rig = Rig::new("B", "default");
    cycle(&mut rig, 2);
    let before = rig.tip().translation.z;
    rig.make(WristExtension, 1100);
    let moved = rig.tip().translation.z - before;
    assert!((moved - 0.08 * 1.08).abs() < 0.004, "0.08 m/s, {moved} m");

    // The original's depends on it.
    let mut rig = Rig::new("A", "original");
    rig.message_ms = Some(200);
    rig.make(NoMotion, 200);
    rig.make(WristExtension, 1000);
    rig.make(NoMotion, 100);
    assert!((rig.q[0] - START_RAD[0] - 5.0 * 0.02).abs() < 0.011, "{} rad", rig.q[0] - START_RAD[0]);
}

#[test]
fn a_joint_stops_at_its_limit_and_the_reason_is_shown() {
    let mut rig = Rig::new("A", "default");
    rig.make(WristExtension, 5000);
    assert_eq!(rig.q[0], limits()[0].upper);
    assert_eq!(refusal(&rig), "shoulder flexion/extension: the joint is at its limit");
}

#[test]
fn defect_38_an_open_hand_straight_after_a_fist_is_not_a_change_of_mode() {
    for method in ["A", "B"] {
        let mut rig = Rig::new(method, "default");
        rig.run(10);
        let first = mode(&rig);
        rig.make(HandClose, 200);
        rig.make(HandOpen, 100);
        rig.make(NoMotion, 100);
        assert_eq!(mode(&rig), first, "{method}: a fist that relaxes passes through an open hand");
        rig.make(HandClose, 200);
        rig.make(HandOpen, 400);
        assert_ne!(mode(&rig), first, "{method}: one that lasts is meant");
    }
}

#[test]
fn original_hand_open_counts_on_the_second_message_and_in_b_one_more_after_a_fist() {
    let messages = |method: &str, before: Command| {
        let mut rig = Rig::new(method, "original");
        rig.run(50);
        let first = mode(&rig);
        rig.make(before, 100);
        (1..=5).find(|_| {
            rig.make(HandOpen, 50);
            mode(&rig) != first
        })
    };
    assert_eq!(messages("A", NoMotion), Some(2));
    assert_eq!(messages("A", HandClose), Some(2));
    assert_eq!(messages("B", NoMotion), Some(2));
    assert_eq!(messages("B", HandClose), Some(3));
}

#[test]
fn defect_39_a_held_open_hand_goes_back_and_the_display_counts_down() {
    let mut rig = Rig::new("A", "default");
    rig.make(HandOpen, 10);
    assert_eq!(rig.shown.mode.clone().map(|m| common::number(m.controlled_dof)), Some(1), "at once");
    rig.run(500);
    let view = rig.shown.mode.clone().expect("A has modes");
    assert!((view.next_in_secs.expect("HO is held") - 0.5).abs() < 0.011, "{view:?}");
    rig.run(510);
    assert_eq!(
        rig.shown.mode.clone().map(|m| common::number(m.controlled_dof)),
        Some(6),
        "one back from where it began"
    );
    rig.run(1000);
    assert_eq!(rig.shown.mode.clone().map(|m| common::number(m.controlled_dof)), Some(5));
    rig.make(NoMotion, 10);
    assert_eq!(rig.shown.mode.clone().and_then(|m| m.next_in_secs), None);
}

#[test]
fn a_gesture_that_ends_stops_the_arm_within_the_step() {
    for method in ["A", "B"] {
        for command in [NoMotion, HandOpen, HandClose] {
            let mut rig = Rig::new(method, "default");
            rig.make(WristExtension, 300);
            let before = rig.q.clone();
            let outputs = rig.make(command, 10);
            assert_eq!(outputs[0].motion, Some(MotionCommand::Hold), "{method} {command}");
            rig.run(200);
            let after = rig.q.iter().zip(&before).fold(0.0_f64, |m, (a, b)| m.max((a - b).abs()));
            assert!(after < 0.5 * 0.01 + 1e-9, "at most the step in which it came: {after} rad");
        }
    }
}

#[test]
fn original_goals_start_at_the_measured_angle_and_go_on_from_the_last_goal() {
    let mut rig = Rig::new("A", "original");
    rig.lag[0] = 0.005;
    let outputs = rig.make(WristExtension, 150);
    let goals: Vec<f64> = outputs
        .iter()
        .filter_map(|output| match &output.motion {
            Some(MotionCommand::Goto(goal)) => Some(goal[0]),
            _ => None,
        })
        .collect();
    let first = START_RAD[0] - 0.005;
    let expected = [first + 0.02, first + 0.04, first + 0.06];
    assert!(goals.iter().zip(&expected).all(|(a, b)| (a - b).abs() < 1e-12), "{goals:?}");
    assert_eq!(goals.len(), 3);
}

#[test]
fn original_steps_of_b_are_4_mm_and_the_elbow_rule_starts_at_25() {
    let mut rig = Rig::new("B", "original");
    let before = rig.tip().translation.x;
    rig.make(WristFlexion, 110);
    rig.run(40);
    let moved = before - rig.tip().translation.x;
    assert!((0.004..0.013).contains(&moved), "two or three messages: {moved} m");
    let mut rig = Rig::new("B", "original");
    let mut before = rig.q.clone();
    rig.gesture = WristExtension;
    while rig.now < 20_000 && !(rig.now > 100 && matches!(rig.shown.planner, PlannerView::Failed { .. })) {
        before = rig.q.clone();
        rig.run(50);
    }
    let condition = |rig: &mut Rig, q: &[f64]| {
        let values = rig.kinematics.jacobian(q).expect("finite").svd(false, false).singular_values;
        values.max() / values.min()
    };
    let after = rig.q.clone();
    let (then, now) = (condition(&mut rig, &before), condition(&mut rig, &after));
    assert!(then < 26.0 && now > 24.5, "condition {then} before and {now} after the rule");
}

#[test]
fn keys_make_steps_in_the_original_too() {
    let mut rig = Rig::new("A", "original");
    rig.message_ms = None;
    rig.make(WristExtension, 1000);
    assert!((rig.q[0] - START_RAD[0] - 0.4).abs() < 0.03, "0.4 rad/s: {}", rig.q[0] - START_RAD[0]);
}

#[test]
fn a_tap_is_a_small_step_and_a_long_hold_is_fast_where_the_profile_says_so() {
    let turned = |steps, millis| {
        let mut profile = Profile::named("default").expect("embedded");
        let JogProfile::Time { speed_steps, .. } = &mut profile.jog else { panic!("by time") };
        *speed_steps = steps;
        // Slow enough that no turn ends at the joint's limit.
        profile.joint_jog.speed_rad_per_s = 0.05;
        profile.check().expect("steps that make sense");
        let mut rig = Rig::with(build("A", &profile, &model()).expect("a known method"));
        rig.run(10);
        rig.make(WristExtension, millis);
        rig.q[0] - START_RAD[0]
    };
    let keys = Some(JogSteps::KEYS);
    assert!(
        turned(keys, 150) < 0.6 * turned(None, 150),
        "{} and {} rad",
        turned(keys, 150),
        turned(None, 150)
    );
    let fast = turned(keys, 3000) - turned(keys, 2000);
    let even = turned(None, 3000) - turned(None, 2000);
    assert!((fast / even - 2.0).abs() < 0.1, "{fast} and {even} rad in a second");
}

#[test]
fn steps_that_make_no_sense_are_refused_with_what_was_expected() {
    let refusal = |steps| {
        let mut profile = Profile::named("default").expect("embedded");
        let JogProfile::Time { speed_steps, .. } = &mut profile.jog else { panic!("by time") };
        *speed_steps = Some(steps);
        profile.check().expect_err("steps that make no sense").to_string()
    };
    let keys = JogSteps::KEYS;
    for slow in [0.0, -0.4, 1.1, f64::NAN] {
        let text = refusal(JogSteps { slow_factor: slow, ..keys });
        assert!(text.contains("jog.speed_steps.slow_factor") && text.contains("0.001 to 1"), "{text}");
    }
    for fast in [0.9, 4.1, f64::INFINITY] {
        let text = refusal(JogSteps { fast_factor: fast, ..keys });
        assert!(text.contains("jog.speed_steps.fast_factor") && text.contains("1 to 4"), "{text}");
    }
    let text = refusal(JogSteps { fast_after_ms: 100, ..keys });
    assert!(text.contains("jog.speed_steps.fast_after_ms") && text.contains("100"), "{text}");
}

#[test]
fn opening_a_hand_that_holds_a_block_can_be_asked_for_twice() {
    let mut profile = Profile::named("default").expect("embedded");
    let JogProfile::Time {
        reverse_cycle_after_ms: back_after_ms, open_after_close_ms, confirm_open_ms, ..
    } = &mut profile.jog
    else {
        panic!("by time")
    };
    (*back_after_ms, *open_after_close_ms, *confirm_open_ms) = (0, 0, 2000);
    let mut rig = Rig::with(build("A", &profile, &model()).expect("a known method"));
    rig.hand = proact_types::HandView { state: HandState::Closed, held_object: Some(ObjectId(3)) };
    assert_eq!(hands(&rig.make(HandClose, 100)), []);
    assert!(refusal(&rig).starts_with("HC again within"), "{}", refusal(&rig));
    rig.make(NoMotion, 100);
    assert_eq!(hands(&rig.make(HandClose, 100)), [HandCommand::Open]);
}

#[test]
fn the_condition_limit_is_a_parameter() {
    let reach = |limit: f64| {
        let mut profile = Profile::named("default").expect("embedded");
        let InverseProfile::Damped(damped) = profile.end_effector_jog.inverse else { panic!("damped") };
        profile.end_effector_jog.inverse = InverseProfile::Damped(DampedProfile {
            condition_slowdown: limit * 0.8,
            condition_limit: limit,
            ..damped
        });
        let mut rig = Rig::with(build("B", &profile, &model()).expect("a known method"));
        rig.make(WristExtension, 8000);
        rig.q[3]
    };
    let (tight, wide) = (reach(9.0), reach(25.0));
    assert!(tight > wide + 0.1, "elbow {tight} and {wide} rad");
}

#[test]
fn joints_cycled_through_are_a_parameter_and_unknown_ones_are_refused_by_name() {
    let mut profile = Profile::named("default").expect("embedded");
    profile.joint_jog.cycle = vec!["forearm".to_owned(), "mpl_right_arm__shoulder".to_owned()];
    let mut rig = Rig::with(build("A", &profile, &model()).expect("known joints"));
    rig.run(10);
    assert_eq!(mode(&rig), "elbow flexion/extension");
    cycle(&mut rig, 1);
    assert_eq!(mode(&rig), "shoulder flexion/extension");
    cycle(&mut rig, 1);
    assert_eq!(mode(&rig), "elbow flexion/extension");
    profile.joint_jog.cycle = vec!["knee".to_owned()];
    let error = build("A", &profile, &model()).err().expect("there is no knee");
    assert!(matches!(&error, ControlError::Name { kind: "joint", got, .. } if got == "knee"));
    assert!(error.to_string().contains("mpl_right_arm__forearm"), "{error}");
}

/// The levels of limb loss: the joints that a method drives, and the rest on the tracked limb.
fn level(name: &str, method: &str, driven: &[usize]) {
    let mut profile = Profile::named("default").expect("embedded");
    profile.level = name.to_owned();
    let mut rig = Rig::with(build(method, &profile, &model()).expect("a known level"));
    let limb: Vec<f64> = START_RAD.iter().map(|q| q - 0.1).collect();
    rig.limb = Some(limb.clone());
    rig.gesture = WristFlexion;
    if method == "A" {
        let names: Vec<u8> = (0..driven.len())
            .map(|_| {
                cycle(&mut rig, 1);
                common::number(rig.shown.mode.clone().expect("A has modes").controlled_dof)
            })
            .collect();
        assert!(names.iter().all(|number| driven.contains(&usize::from(*number))), "{names:?}");
    }
    rig.make(NoMotion, 1000);
    let at_rest = rig.q.clone();
    for (joint, goal) in limb.iter().enumerate() {
        let expected = if driven.contains(&joint) { START_RAD[joint] } else { *goal };
        assert!((at_rest[joint] - expected).abs() < 1e-6, "{name} {method}: joint {joint}");
    }
    // The wrist alone turns the hand and hardly moves it.
    cycle(&mut rig, if method == "B" && driven.len() < 4 { 5 } else { 2 });
    rig.make(WristFlexion, 500);
    let moved: Vec<f64> = rig.q.iter().zip(&at_rest).map(|(a, b)| (a - b).abs()).collect();
    let planner = rig.shown.planner.clone();
    assert!(driven.iter().any(|&joint| moved[joint] > 0.02), "{name} {method}: {moved:?} {planner:?}");
    for joint in (0..7).filter(|joint| !driven.contains(joint)) {
        assert!(moved[joint] < 1e-6, "{name} {method}: {moved:?}");
    }
    assert_eq!(rig.make(NoMotion, 10)[0].motion, Some(MotionCommand::Hold));
}

#[test]
fn with_loss_at_the_shoulder_the_method_drives_all_seven_joints() {
    level("shoulder", "A", &[0, 1, 2, 3, 4, 5, 6]);
    level("shoulder", "B", &[0, 1, 2, 3, 4, 5, 6]);
}

#[test]
fn with_loss_above_the_elbow_the_shoulder_follows_the_limb() {
    level("above_elbow", "A", &[3, 4, 5, 6]);
    level("above_elbow", "B", &[3, 4, 5, 6]);
}

#[test]
fn with_loss_below_the_elbow_shoulder_and_elbow_follow_the_limb() {
    level("below_elbow", "A", &[4, 5, 6]);
    level("below_elbow", "B", &[4, 5, 6]);
}

#[test]
fn c_and_d_of_the_original_for_part_of_an_arm_are_refused_with_a_way_out() {
    let mut profile = Profile::named("default").expect("embedded");
    profile.level = "below_elbow".to_owned();
    assert!(build("D", &profile, &model()).is_ok());
    let mut profile = Profile::named("original").expect("embedded");
    profile.level = "below_elbow".to_owned();
    let error = build("D", &profile, &model()).err().expect("whole poses of the hand");
    assert!(error.to_string().contains("choose level = \"shoulder\""), "{error}");
    profile.level = "knee".to_owned();
    let error = build("A", &profile, &model()).err().expect("no such level");
    assert!(error.to_string().contains("above_elbow, below_elbow, shoulder"), "{error}");
}

#[test]
fn defect_36_numbers_of_joints_and_axes_do_not_collide_and_every_axis_is_handled() {
    let numbers = |method: &str| {
        let mut rig = Rig::new(method, "default");
        let mut numbers = Vec::new();
        for _ in 0..14 {
            rig.make(Command::HandOpen, 50);
            rig.make(Command::NoMotion, 50);
            numbers.push(common::number(rig.shown.mode.clone().expect("A and B have modes").controlled_dof));
        }
        numbers.sort_unstable();
        numbers.dedup();
        numbers
    };
    assert_eq!(numbers("A"), [0, 1, 2, 3, 4, 5, 6]);
    assert_eq!(numbers("B"), [7, 8, 9, 10, 11, 12]);
}
