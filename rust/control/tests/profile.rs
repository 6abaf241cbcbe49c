//! Profiles: what is read, what is refused, and what the original's gaze rules keep.
mod common;

use Command::{HandClose, HandOpen, NoMotion, WristExtension, WristFlexion};
use common::{Rig, model, reply};
use proact_control::{ControlError, HandCommand, JointSubset, MotionCommand, Profile, build};
use proact_types::{Command, HandState, HandView, MethodEvent, ObjectId, PlanStatus, PlannerView, Point};

#[test]
fn profiles_survive_being_written_and_read_again() {
    for name in ["default", "original"] {
        let profile = Profile::named(name).expect("embedded");
        assert_eq!(profile.name, name);
        let text = profile.to_toml().expect("plain data");
        assert_eq!(Profile::from_toml(&text), Ok(profile));
    }
}

#[test]
fn unknown_names_keys_and_numbers_out_of_range_are_refused_by_name() {
    let error = Profile::named("best").expect_err("there is no such profile");
    assert!(error.to_string().contains("default, original"), "{error}");
    let default = Profile::named("default").expect("embedded");
    let error = build("E", &default, &model()).err().expect("there is no method E");
    assert_eq!(error.to_string(), "method \"E\" is unknown; expected one of A, B, C, D");
    let text = default.to_toml().expect("plain data");
    for (from, to, expected) in [
        ("step_rad", "step_deg", "step_deg"),
        ("kind = \"damped\"", "kind = \"magic\"", "magic"),
        ("tracking_error_limit_rad", "drift_limit", "drift_limit"),
        ("emg_timeout_ms", "emg_secs", "emg_secs"),
        ("we_sign = -1", "we_sign = 2", "we_sign = 2"),
        ("acceleration_rad_per_s2 = 4.0", "acceleration_rad_per_s2 = nan", "acceleration_rad_per_s2 = NaN"),
        ("max_damping = 0.05", "max_damping = -1.0", "inverse.max_damping = -1"),
        ("command_timeout_ms = 200", "command_timeout_ms = 0", "dead_man.command_timeout_ms = 0"),
        ("max_delay_ms = 250", "max_delay_ms = 60001", "dead_man.max_delay_ms = 60001"),
    ] {
        assert!(text.contains(from), "{from} is in the profile");
        let error = Profile::from_toml(&text.replacen(from, to, 1)).err();
        let error = error.unwrap_or_else(|| panic!("{to} was taken")).to_string();
        assert!(error.contains(expected), "{to} gave {error}");
    }
    assert!(matches!(Profile::from_toml(""), Err(ControlError::Text(_))));
    // Which levels there are is the arm's to say.
    let knee = Profile { level: "knee".to_owned(), ..default };
    let error = JointSubset::new(&knee, &model()).expect_err("no such level").to_string();
    assert!(error.contains("knee") && error.contains("shoulder"), "{error}");
}

fn events(rig: &mut Rig, command: Command) -> Vec<MethodEvent> {
    rig.make(command, 50).into_iter().flat_map(|output| output.events).collect()
}

#[test]
fn original_locks_are_toggles_that_outlive_the_block_and_the_place_lock_starts_on() {
    let mut rig = Rig::new("D", "original");
    rig.run(10);
    assert_eq!(rig.shown.target.place, Some(Point::origin()));
    assert_eq!(events(&mut rig, WristFlexion), [MethodEvent::Locked { object: Some(ObjectId(0)) }]);
    rig.hand = HandView { state: HandState::Closed, held_object: Some(ObjectId(0)) };
    rig.make(NoMotion, 50);
    assert!(rig.shown.target.locked, "the place is locked before it was chosen");
    assert_eq!(events(&mut rig, WristFlexion), [MethodEvent::Unlocked]);
    rig.make(NoMotion, 50);
    assert_eq!(events(&mut rig, WristFlexion), [MethodEvent::Locked { object: None }]);
    assert_eq!(rig.shown.target.place, Some(rig.place));
    rig.hand.held_object = None;
    rig.highlight = Some(ObjectId(2));
    rig.make(NoMotion, 50);
    assert_eq!(rig.shown.target.object, Some(ObjectId(0)), "the lock of the first block is still on");
}

#[test]
fn original_stops_for_no_motion_only_and_a_late_plan_moves_nothing() {
    for command in [HandClose, HandOpen, WristFlexion] {
        let mut rig = Rig::new("C", "original");
        rig.make(WristExtension, 10);
        rig.plan = Some(reply(PlanStatus::Ok, 0.4));
        rig.run(100);
        rig.make(command, 100);
        assert!(matches!(rig.shown.planner, PlannerView::Executing { .. }), "{command}");
        assert_eq!(rig.make(NoMotion, 10)[0].motion, Some(MotionCommand::Hold));
        rig.plan = Some(reply(PlanStatus::Ok, 0.4));
        assert_eq!(rig.run(10)[0].motion, None);
    }
}

#[test]
fn original_goes_to_what_was_locked_last_and_says_when_its_two_links_do_not_reach() {
    let mut rig = Rig::new("C", "original");
    rig.highlight = Some(ObjectId(3));
    rig.make(WristExtension, 10);
    let red = rig.shown.planner.clone();
    assert_eq!(red, PlannerView::Planning);
    let mut far = Rig::new("C", "original");
    far.base.translation.x -= 2.0;
    assert_eq!(far.make(WristExtension, 10)[0].plan, None);
    assert!(matches!(far.shown.planner, PlannerView::Failed { status: PlanStatus::Unreachable, .. }));
}

#[test]
fn original_losing_a_block_opens_the_hand_and_the_next_fist_closes_it() {
    let mut rig = Rig::new("D", "original");
    rig.make(HandClose, 50);
    rig.hand = HandView { state: HandState::Closed, held_object: Some(ObjectId(0)) };
    rig.make(NoMotion, 50);
    rig.hand.held_object = None;
    assert_eq!(rig.run(10)[0].hand, Some(HandCommand::Open));
    assert_eq!(rig.make(HandClose, 10)[0].hand, Some(HandCommand::Close));
}
