//! The decorators, and what must hold for any input.
#![allow(clippy::disallowed_methods)] // proptest reads its settings from the environment.
mod common;

use common::{Rig, START_RAD, limits, model, reply};
use proact_control::ports::ArmKinematics;
use proact_control::{
    Blend, CommandLimiter, ControlInput, ControlMethod, ControlOutput, DeadManSwitch, LimiterProfile,
    MotionCommand, PlanCommand, Profile, build,
};
use proact_types::{
    Command, HandState, HandView, InputSource, ObjectId, PlanStatus, Pose, SimTime, Stop, StopCause,
    Trajectory, TrajectoryPoint, joints,
};
use proptest::prelude::*;

const ACCELERATION: f64 = 4.0;
const LIMITER: LimiterProfile = LimiterProfile { acceleration_rad_per_s2: ACCELERATION };

/// Says the same command at every step while WE is made.
struct Says(MotionCommand);

impl ControlMethod for Says {
    fn step(
        &mut self,
        _now: SimTime,
        input: &ControlInput<'_>,
        _kinematics: &mut dyn ArmKinematics,
    ) -> ControlOutput {
        let moves = input.command == Command::WristExtension;
        let motion = if moves { self.0.clone() } else { MotionCommand::Hold };
        ControlOutput { motion: Some(motion), ..ControlOutput::default() }
    }
}

fn limited(command: MotionCommand) -> Rig {
    Rig::with(Box::new(CommandLimiter::new(Says(command), &LIMITER, &model())))
}

fn velocity(speed: f64) -> MotionCommand {
    MotionCommand::Velocity(joints(&[speed; 7]))
}

#[test]
fn the_limiter_ramps_speeds_up_and_down_to_a_goal_and_lets_a_stop_pass() {
    let mut goal = START_RAD;
    goal[3] += 0.3;
    let mut rig = limited(MotionCommand::Goto(joints(&goal)));
    let mut last = 0.0;
    for output in rig.make(Command::WristExtension, 2000) {
        let speed = match output.motion {
            Some(MotionCommand::Velocity(speeds)) => speeds[3],
            _ => 0.0,
        };
        assert!(speed - last <= ACCELERATION * 0.02 + 1e-9 && speed <= 0.5, "{last} to {speed} rad/s");
        last = speed;
    }
    assert!((rig.q[3] - goal[3]).abs() < 1e-6, "{} rad", rig.q[3]);
    let mut rig = limited(velocity(0.3));
    rig.make(Command::WristExtension, 500);
    assert_eq!(rig.make(Command::NoMotion, 10)[0].motion, Some(MotionCommand::Hold));
}

#[test]
fn the_limiter_stretches_a_trajectory_that_is_too_fast_and_leaves_others_alone() {
    let follow = |turn: f64, secs: f64| {
        let mut path = reply(PlanStatus::Ok, turn).trajectory;
        path.points[1].time_secs = secs;
        let outputs = limited(MotionCommand::Follow(path.clone())).make(Command::WristExtension, 10);
        (path, outputs[0].motion.clone())
    };
    let (path, passed) = follow(0.3, 1.0);
    assert_eq!(passed, Some(MotionCommand::Follow(path)));
    let (_, Some(MotionCommand::Follow(slow))) = follow(0.3, 0.1) else {
        panic!("a slower path was expected")
    };
    let peak = (0..1000)
        .filter_map(|k| slow.sample(slow.duration_secs() * f64::from(k) * 1e-3))
        .fold(0.0_f64, |m, (_, qd)| m.max(qd[3].abs()));
    assert!((0.3..=1.0).contains(&slow.duration_secs()) && peak < 0.5 * 1.5 + 1e-9, "{peak} rad/s");
    // What is no number, or does not fit, stops the arm.
    let (mut path, _) = follow(0.3, 1.0);
    path.points[1].q[2] = f64::NAN;
    let outputs = limited(MotionCommand::Follow(path)).make(Command::WristExtension, 10);
    assert_eq!(outputs[0].motion, Some(MotionCommand::Hold));
    let outputs = limited(MotionCommand::Velocity(joints(&[0.1]))).make(Command::WristExtension, 10);
    assert_eq!(outputs[0].motion, Some(MotionCommand::Hold));
}

/// Somebody died.
fn stop(reason: &str) -> Option<Stop> {
    let (source, cause, since) = (InputSource::Armband, StopCause::Silent, SimTime(0));
    Some(Stop { source, cause, since, reason: reason.to_owned() })
}

#[test]
fn the_dead_man_holds_while_something_is_dead_and_says_what() {
    let mut rig = Rig::with(Box::new(DeadManSwitch::new(Says(velocity(0.1)))));
    assert_eq!(rig.make(Command::WristExtension, 10)[0].motion, Some(velocity(0.1)));
    rig.stop = stop("the armband is silent");
    assert_eq!(rig.run(10)[0].motion, Some(MotionCommand::Hold));
    assert_eq!(rig.refusal(), "the armband is silent");
    rig.stop = None;
    assert_eq!(rig.run(10)[0].motion, Some(velocity(0.1)));
}

#[test]
fn a_limb_is_not_followed_while_something_is_dead() {
    let mut profile = Profile::named("default").expect("ships");
    profile.level = "below_elbow".to_owned();
    let mut rig = Rig::with(build("A", &profile, &model()).expect("drives the wrist"));
    rig.limb = Some(START_RAD.iter().map(|q| q + 0.3).collect());
    assert!(matches!(rig.run(10)[0].motion, Some(MotionCommand::Velocity(_))));
    rig.stop = stop("the limb tracker is silent");
    assert_eq!(rig.run(10)[0].motion, Some(MotionCommand::Hold));
    let at = rig.q.clone();
    rig.run(500);
    assert_eq!(at, rig.q);
}

#[test]
fn defect_75_in_default_silence_of_the_armband_stops_an_arm_that_follows_a_plan() {
    let mut rig = Rig::new("D", "default");
    rig.make(Command::NoMotion, 50);
    rig.make(Command::WristExtension, 10);
    rig.plan = Some(reply(PlanStatus::Ok, 0.3));
    assert!(matches!(rig.run(10)[0].motion, Some(MotionCommand::Follow(_))));
    rig.stop = stop("the armband is silent");
    assert_eq!(rig.run(10)[0].motion, Some(MotionCommand::Hold));
}

#[test]
fn a_blend_mixes_the_speeds_and_moves_nothing_that_the_person_does_not_move() {
    let blend = Blend::new(Says(velocity(0.2)), Says(velocity(0.4)), 0.25);
    let mut rig = Rig::with(Box::new(blend));
    let Some(MotionCommand::Velocity(speeds)) = rig.make(Command::WristExtension, 10)[0].motion.clone()
    else {
        panic!("speeds were expected")
    };
    assert!(speeds.iter().all(|speed| (speed - 0.25).abs() < 1e-12), "{speeds:?}");
    assert_eq!(rig.make(Command::NoMotion, 10)[0].motion, Some(MotionCommand::Hold));
    let mut stopped = Rig::with(Box::new(Blend::new(Says(MotionCommand::Hold), Says(velocity(0.4)), 1.0)));
    assert_eq!(stopped.make(Command::WristExtension, 10)[0].motion, Some(MotionCommand::Hold));
}

/// Any number that a broken sensor or process may give.
fn number() -> impl Strategy<Value = f64> {
    prop_oneof![
        8 => -3.0..3.0_f64,
        1 => -1e6..1e6_f64,
        1 => prop_oneof![Just(f64::NAN), Just(f64::INFINITY), Just(f64::NEG_INFINITY)],
    ]
}

fn gesture() -> impl Strategy<Value = Command> {
    prop::sample::select(Command::ALL.to_vec())
}

/// Time since the point before, angles and speeds.
type RawPoint = (f64, [f64; 7], [f64; 7]);

fn plan() -> impl Strategy<Value = Option<(PlanStatus, Vec<RawPoint>)>> {
    let status = prop::sample::select(vec![
        PlanStatus::Ok,
        PlanStatus::Intermediate,
        PlanStatus::Unreachable,
        PlanStatus::Cancelled,
    ]);
    let point = (0.01..2.0_f64, prop::array::uniform7(number()), prop::array::uniform7(number()));
    prop::option::weighted(0.4, (status, prop::collection::vec(point, 0..4)))
}

fn check(output: &ControlOutput, commanded: &[f64], last: &mut Vec<f64>) -> Result<(), TestCaseError> {
    let slack = 1e-9;
    match &output.motion {
        Some(MotionCommand::Velocity(speeds)) => {
            for (k, limits) in limits().iter().enumerate() {
                prop_assert!(speeds[k].abs() <= limits.velocity + slack, "joint {k}: {} rad/s", speeds[k]);
                let next = commanded[k] + speeds[k] * 0.01;
                let outside = next > limits.upper + slack && speeds[k] > 0.0;
                let outside = outside || next < limits.lower - slack && speeds[k] < 0.0;
                prop_assert!(!outside, "joint {k} goes to {next} rad");
                // Slowing down before a limit may be sharper than speeding up.
                let faster = speeds[k].abs() - last[k].abs();
                prop_assert!(
                    faster <= ACCELERATION * 0.02 + slack,
                    "joint {k}: {} to {}",
                    last[k],
                    speeds[k]
                );
            }
            *last = speeds.to_vec();
        }
        Some(MotionCommand::Follow(path)) => {
            for point in &path.points {
                for (k, limits) in limits().iter().enumerate() {
                    prop_assert!((limits.lower..=limits.upper).contains(&point.q[k]));
                    prop_assert!(point.qd[k].abs() <= limits.velocity * 1.05 + slack);
                }
            }
            last.fill(0.0);
        }
        Some(MotionCommand::Goto(goal)) => {
            for (q, limits) in goal.iter().zip(limits()) {
                prop_assert!((limits.lower..=limits.upper).contains(q));
            }
        }
        Some(MotionCommand::Hold) => last.fill(0.0),
        None => {}
    }
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 256, ..ProptestConfig::default() })]

    #[test]
    fn no_command_is_beyond_the_limits_for_any_input(
        method in prop::sample::select(vec!["A", "B", "C", "D"]),
        start in prop::array::uniform7(0.0..=1.0_f64),
        steps in prop::collection::vec(
            (gesture(), 1..40_u64, prop::array::uniform7(prop_oneof![4 => Just(0.0), 1 => number()]), plan()),
            1..25,
        ),
    ) {
        let mut rig = Rig::new(method, "default");
        rig.q = limits().iter().zip(start).map(|(l, s)| l.lower + s * (l.upper - l.lower)).collect();
        let mut last = vec![0.0; 7];
        for (gesture, ms, lag, plan) in steps {
            rig.gesture = gesture;
            rig.lag = lag;
            rig.plan = plan.map(|(status, points)| {
                let mut time_secs = 0.0;
                let points = points.into_iter().map(|(secs, q, qd)| {
                    time_secs += secs;
                    TrajectoryPoint { time_secs: time_secs - secs, q: joints(&q), qd: joints(&qd) }
                });
                let trajectory = Trajectory { points: points.collect() };
                proact_types::PlanReply { trajectory, ..reply(status, 0.0) }
            });
            for _ in 0..ms.div_ceil(10) {
                let before = rig.q.clone();
                rig.now += 10;
                let output = rig.step();
                check(&output, &before, &mut last)?;
                rig.advance(9);
            }
        }
    }

    #[test]
    fn every_gesture_but_the_motion_gestures_stops_the_arm_within_one_step_from_every_state(
        method in prop::sample::select(vec!["A", "B", "C", "D"]),
        history in prop::collection::vec((gesture(), 1..300_u64, 0..3_u8, any::<bool>()), 1..12),
        stop in prop::sample::select(vec![Command::NoMotion, Command::HandOpen, Command::HandClose]),
    ) {
        let mut rig = Rig::new(method, "default");
        for (gesture, ms, plan, holds) in history {
            let holds = holds.then_some(ObjectId(2));
            rig.hand = HandView { state: if holds.is_some() { HandState::Closed } else { HandState::Open }, held_object: holds };
            rig.plan = match plan {
                0 => None,
                1 => Some(reply(PlanStatus::Ok, 0.4)),
                _ => Some(reply(PlanStatus::Intermediate, 0.2)),
            };
            rig.make(gesture, ms);
        }
        let output = rig.make(stop, 10);
        prop_assert!(!matches!(
            output.iter().filter_map(|o| o.motion.clone()).next_back(),
            Some(MotionCommand::Velocity(_) | MotionCommand::Follow(_) | MotionCommand::Goto(_))
        ));
        prop_assert!(!output.iter().any(|o| matches!(o.plan, Some(PlanCommand::Request(_)))));
        let at = rig.q.clone();
        rig.base = Pose::translation(0.3, 0.0, 0.0) * rig.base;
        rig.plan = Some(reply(PlanStatus::Ok, 0.4));
        rig.run(500);
        prop_assert_eq!(at, rig.q, "the arm moved after the stop");
    }
}
