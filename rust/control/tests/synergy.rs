//! The method `synergy`: a joint of the prosthesis that follows one of the person's own limb.

mod common;

use common::{Rig, START_RAD, model};
use proact_arm::ArmModel;
use proact_control::ports::{ArmKinematics, NoProcess};
use proact_control::{ControlError, MethodRegistry, Profile, Synergy, SynergyProfile, SynergyRule};
use proact_types::{Command, Vector};

const SHOULDER: usize = 0;
const ELBOW: usize = 3;
/// Of the shoulder in these tests, rad/s.
const SPEED: f64 = 0.25;

fn profile(rule: SynergyRule) -> Profile {
    let mut profile = Profile::named("default").expect("an embedded profile");
    profile.level = "above_elbow".to_owned();
    profile.synergy = Some(SynergyProfile { rule, ..SynergyProfile::default() });
    profile
}

fn rig(rule: SynergyRule, model: &ArmModel) -> Rig {
    let method = Synergy::entry().build(&profile(rule), model, NoProcess).expect("it fits the arm");
    let mut rig = Rig::with(method);
    rig.limb = Some(START_RAD.to_vec());
    rig.run(200);
    rig
}

/// The person holds `command` and moves the shoulder for `ms`; a tracker says so every 10 ms.
fn reach(rig: &mut Rig, command: Command, ms: u64, speed: f64) {
    rig.gesture = command;
    for _ in 0..ms / 10 {
        if let Some(limb) = &mut rig.limb {
            limb[SHOULDER] += speed * 0.01;
        }
        rig.run(10);
    }
}

#[test]
fn by_the_linear_rule_the_elbow_turns_in_proportion_and_only_while_the_gesture_is_held() {
    let mut rig = rig(SynergyRule::Linear { gain: -0.5 }, &model());
    let before = rig.q[ELBOW];
    reach(&mut rig, Command::NoMotion, 500, -SPEED);
    assert_eq!(rig.q[ELBOW], before, "nobody asked for it");
    reach(&mut rig, Command::WristExtension, 400, -SPEED);
    let start = (rig.q[SHOULDER], rig.q[ELBOW]);
    reach(&mut rig, Command::WristExtension, 1000, -SPEED);
    let (leader_travel, follow) = (rig.q[SHOULDER] - start.0, rig.q[ELBOW] - start.1);
    assert!((leader_travel + SPEED).abs() < 0.01, "the own joint follows the limb: {leader_travel}");
    assert!((follow + 0.5 * leader_travel).abs() < 0.01, "{follow} for {leader_travel}");
    // The limb stops, or nobody tracks it any more: so does the elbow.
    reach(&mut rig, Command::WristExtension, 1000, 0.0);
    let still = rig.q[ELBOW];
    reach(&mut rig, Command::WristExtension, 500, 0.0);
    assert!((rig.q[ELBOW] - still).abs() < 1e-6);
    rig.limb = None;
    let still = rig.q[ELBOW];
    rig.make(Command::WristExtension, 500);
    assert_eq!(rig.q[ELBOW], still);
}

#[test]
fn by_the_jacobian_the_hand_stays_on_its_line_from_the_shoulder() {
    // How far the hand leaves the line on which it began.
    let leaves = |rule| {
        let mut rig = rig(rule, &model());
        reach(&mut rig, Command::WristExtension, 300, -SPEED);
        let (begin, line) = {
            let at: Vector = rig.tip().translation.vector;
            (at, at.normalize())
        };
        let moved = rig.q[ELBOW];
        reach(&mut rig, Command::WristExtension, 1200, -SPEED);
        let displacement = rig.tip().translation.vector - begin;
        // In the plane in which the elbow moves the hand: the shoulder alone may carry it out of that.
        let q = rig.q.clone();
        let jacobian = rig.kinematics.jacobian(&q).expect("finite angles");
        let turned = Vector::new(jacobian[(0, ELBOW)], jacobian[(1, ELBOW)], jacobian[(2, ELBOW)]);
        let off = (turned - line * line.dot(&turned)).normalize();
        assert!((rig.q[ELBOW] - moved).abs() > 0.1, "the elbow turns");
        off.dot(&displacement).abs()
    };
    let (straight, linear) = (leaves(SynergyRule::Jacobian), leaves(SynergyRule::Linear { gain: 0.5 }));
    assert!(straight < 0.01, "{straight} m off the line");
    assert!(linear > 3.0 * straight, "a wrong gain leaves it: {linear} m");
}

#[test]
fn in_other_modes_the_joints_move_as_with_method_a_and_limits_hold() {
    let mut rig = rig(SynergyRule::Linear { gain: 10.0 }, &model());
    reach(&mut rig, Command::WristExtension, 3000, SPEED);
    let limits = common::limits()[ELBOW];
    assert!((limits.lower..=limits.upper).contains(&rig.q[ELBOW]));
    rig.make(Command::HandOpen, 100);
    rig.make(Command::NoMotion, 100);
    let before = rig.q.clone();
    // It begins at its upper limit.
    rig.make(Command::WristFlexion, 300);
    assert_eq!(rig.q[ELBOW], before[ELBOW]);
    assert!(rig.q[4..].iter().zip(&before[4..]).any(|(q, was)| q != was), "the next joint moves");
}

#[test]
fn what_cannot_be_is_refused_with_what_there_is() {
    let refused = |change: &dyn Fn(&mut Profile)| {
        let mut profile = profile(SynergyRule::Jacobian);
        change(&mut profile);
        let built = Synergy::entry().build(&profile, &model(), NoProcess);
        built.err().expect("it must be refused")
    };
    let set = |profile: &mut Profile, change: &dyn Fn(&mut SynergyProfile)| {
        change(profile.synergy.get_or_insert_default());
    };
    let error = refused(&|p| set(p, &|s| s.leader = Some("forearm".to_owned())));
    assert!(
        matches!(&error, ControlError::Name { got, known, .. } if got == "forearm" && known.contains("shoulder")),
        "{error}"
    );
    let error = refused(&|p| set(p, &|s| s.follower = Some("shoulder".to_owned())));
    assert!(
        matches!(&error, ControlError::Name { got, known, .. } if got == "shoulder" && known.contains("forearm")),
        "{error}"
    );
    let error = refused(&|p| set(p, &|s| s.speed_rad_per_s = f64::NAN));
    assert!(error.to_string().contains("synergy.speed_rad_per_s"), "{error}");
    let error = refused(&|p| set(p, &|s| s.rule = SynergyRule::Linear { gain: 0.0 }));
    assert!(error.to_string().contains("gain"), "{error}");
    let error = refused(&|p| p.level = "shoulder".to_owned());
    assert!(error.to_string().contains("own limb"), "{error}");
}

#[test]
fn it_is_offered_where_a_limb_is_left() {
    let methods = MethodRegistry::standard().with(Synergy::entry()).expect("a new name");
    let offered = |level: &str| {
        let mut profile = Profile::named("default").expect("an embedded profile");
        profile.level = level.to_owned();
        let fitting = methods.compatible_methods(&profile, &model());
        fitting.into_iter().map(|info| info.name).collect::<Vec<_>>()
    };
    assert_eq!(offered("shoulder"), ["A", "B", "C", "D"]);
    assert_eq!(offered("above_elbow"), ["A", "B", "C", "D", "synergy"]);
    assert_eq!(offered("below_elbow"), ["A", "B", "C", "D", "synergy"]);
}
