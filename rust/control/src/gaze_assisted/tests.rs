use super::*;
use crate::ports::{IkOutcome, KinematicsError};
use Command::{HandClose, HandOpen, NoMotion, WristExtension, WristFlexion};
use proact_types::{HandView, Trajectory, TrajectoryPoint, joints};

const PLACE: Point = Point::new(0.05, 0.2, 1.015);

/// Methods C and D leave kinematics to the planner.
struct NoKinematics;

impl ArmKinematics for NoKinematics {
    fn joint_count(&self) -> usize {
        7
    }
    fn forward(&mut self, _q: &[f64]) -> Result<Pose, KinematicsError> {
        panic!("not asked")
    }
    fn jacobian(&mut self, _q: &[f64]) -> Result<nalgebra::DMatrix<f64>, KinematicsError> {
        panic!("not asked")
    }
    fn inverse(&mut self, _target: &Pose, _seed: &[f64]) -> Result<IkOutcome, KinematicsError> {
        panic!("not asked")
    }
}

/// A world around the method that a test can push about.
struct Bench {
    method: GazeAssisted,
    shown: MethodDisplay,
    highlight: Option<ObjectId>,
    hand: HandView,
    base: Pose,
    motion: MotionState,
    targets: Vec<proact_types::Target>,
    objects: [Point; 4],
    time: u64,
}

impl Bench {
    fn new() -> Self {
        let mut bench = Self {
            method: GazeAssisted::new(LockOnceProfile::default()),
            shown: MethodDisplay::default(),
            highlight: Some(ObjectId(0)),
            hand: HandView { state: HandState::Open, held_object: None },
            base: Pose::identity(),
            motion: MotionState::Holding,
            targets: Vec::new(),
            objects: [0.0, 0.1, 0.2, 0.3].map(|x| Point::new(x, -0.1, 1.04)),
            time: 0,
        };
        bench.step(NoMotion, None);
        bench.step(NoMotion, None);
        bench
    }

    fn step(&mut self, command: Command, plan: Option<&PlanReply>) -> ControlOutput {
        self.time += 10;
        let input = ControlInput {
            command,
            recognized_gesture: command.into(),
            effort: 1.0,
            drives: &[],
            published_command: None,
            measured: &[0.0; 7],
            commanded: &[0.0; 7],
            highlight: self.highlight,
            objects: &self.objects,
            posterior: &[],
            place_point: PLACE,
            hand: self.hand,
            world_from_base: self.base,
            plan,
            motion: self.motion,
            joint_states: &crate::JointStates::default(),
            targets: &self.targets,
            limb: None,
            stop: None,
            emg_age_ms: None,
            gaze_age_ms: None,
            tracking_age_ms: None,
        };
        let output = self.method.step(SimTime(self.time), &input, &mut NoKinematics);
        self.shown = output.display.clone();
        output
    }

    /// Holds WE until the arm follows a plan.
    fn start_motion(&mut self) {
        assert!(matches!(self.step(WristExtension, None).plan, Some(PlanCommand::Request(_))));
        let output = self.step(WristExtension, Some(&reply(PlanStatus::Ok, 2.0)));
        assert!(matches!(output.motion, Some(MotionCommand::Follow(_))));
        self.motion = MotionState::Following(0.1);
    }
}

fn reply(status: PlanStatus, secs: f64) -> PlanReply {
    let point = |t: f64| TrajectoryPoint { time_secs: t, q: joints(&[t; 7]), qd: joints(&[0.0; 7]) };
    PlanReply {
        id: 1,
        status,
        trajectory: Trajectory { points: vec![point(0.0), point(secs)] },
        reason: String::new(),
        clearance_m: None,
    }
}

#[test]
fn every_gesture_but_wrist_extension_stops_a_motion_within_the_step() {
    for command in [NoMotion, HandClose, HandOpen, WristFlexion] {
        let mut bench = Bench::new();
        bench.start_motion();
        assert_eq!(bench.step(command, None).motion, Some(MotionCommand::Hold), "{command}");
        assert_eq!(bench.shown.planner, PlannerView::Idle);
    }
}

#[test]
fn every_gesture_but_wrist_extension_cancels_a_plan_and_a_late_plan_moves_nothing() {
    for command in [NoMotion, HandClose, HandOpen, WristFlexion] {
        let mut bench = Bench::new();
        bench.step(WristExtension, None);
        assert_eq!(bench.step(command, None).plan, Some(PlanCommand::Cancel), "{command}");
        assert_eq!(bench.step(command, Some(&reply(PlanStatus::Ok, 2.0))).motion, None);
    }
}

#[test]
fn one_wrist_flexion_locks_what_is_highlighted_however_long_it_is_held() {
    let mut bench = Bench::new();
    let output = bench.step(WristFlexion, None);
    assert_eq!(output.events, [MethodEvent::Locked { object: Some(ObjectId(0)) }]);
    bench.highlight = Some(ObjectId(3));
    assert!(bench.step(WristFlexion, None).events.is_empty());
    bench.step(NoMotion, None);
    assert_eq!(bench.shown.target.object, Some(ObjectId(0)));
    let Some(PlanCommand::Request(PlanGoal::Pick { object: block, .. })) =
        bench.step(WristExtension, None).plan
    else {
        panic!("a pick was expected")
    };
    assert_eq!(block, ObjectId(0), "the locked block, not the highlighted one");
}

#[test]
fn a_second_wrist_flexion_takes_the_lock_off() {
    let mut bench = Bench::new();
    bench.step(WristFlexion, None);
    bench.step(NoMotion, None);
    assert_eq!(bench.step(WristFlexion, None).events, [MethodEvent::Unlocked]);
    assert!(!bench.shown.target.locked);
}

#[test]
fn without_a_lock_wrist_extension_acts_on_the_highlight() {
    let mut bench = Bench::new();
    bench.highlight = Some(ObjectId(2));
    let Some(PlanCommand::Request(PlanGoal::Pick { object: block, center })) =
        bench.step(WristExtension, None).plan
    else {
        panic!("a pick was expected")
    };
    assert_eq!((block, center.x), (ObjectId(2), 0.2));
}

#[test]
fn a_lock_ends_with_its_phase_and_the_next_lock_is_the_place() {
    let mut bench = Bench::new();
    bench.step(WristFlexion, None);
    bench.step(HandClose, None);
    bench.hand = HandView { state: HandState::Closed, held_object: Some(ObjectId(0)) };
    assert_eq!(bench.step(HandClose, None).events, [MethodEvent::Unlocked]);
    assert_eq!(bench.step(WristFlexion, None).events, [MethodEvent::Locked { object: None }]);
    let plan = bench.step(WristExtension, None).plan;
    assert_eq!(plan, Some(PlanCommand::Request(PlanGoal::Place { point: PLACE })));
}

#[test]
fn wrist_extension_held_keeps_the_existing_plan_and_a_new_one_replans() {
    let mut bench = Bench::new();
    bench.start_motion();
    for _ in 0..5 {
        assert_eq!(bench.step(WristExtension, None).plan, None);
    }
    bench.step(NoMotion, None);
    bench.motion = MotionState::Holding;
    assert!(matches!(bench.step(WristExtension, None).plan, Some(PlanCommand::Request(_))));
}

#[test]
fn wrist_extension_held_goes_on_from_an_intermediate_goal_until_no_progress_is_left() {
    let mut bench = Bench::new();
    bench.step(WristExtension, None);
    bench.step(WristExtension, Some(&reply(PlanStatus::Intermediate, 2.0)));
    bench.motion = MotionState::Finished;
    bench.step(WristExtension, None);
    assert!(matches!(bench.step(WristExtension, None).plan, Some(PlanCommand::Request(_))));
    bench.step(WristExtension, Some(&reply(PlanStatus::Intermediate, 0.1)));
    assert_eq!(bench.shown.planner, PlannerView::Arrived { intermediate: true });
    assert_eq!(
        bench.step(WristExtension, None).plan,
        None,
        "a plan that leads nowhere is not asked for again"
    );
}

#[test]
fn a_base_that_moved_stops_the_motion_and_is_replanned_once_it_stands_still() {
    let mut bench = Bench::new();
    bench.start_motion();
    bench.base = Pose::translation(0.006, 0.0, 0.0);
    assert_eq!(bench.step(WristExtension, None).motion, Some(MotionCommand::Hold));
    bench.base = Pose::translation(0.012, 0.0, 0.0);
    assert_eq!(bench.step(WristExtension, None).plan, None, "the base still moves");
    assert!(matches!(bench.step(WristExtension, None).plan, Some(PlanCommand::Request(_))));
}

#[test]
fn a_block_taken_away_mid_plan_stops_the_motion_and_is_planned_for_where_it_is() {
    for gone in [Point::new(0.0, -0.1, 0.03), Point::new(f64::NAN, -0.1, 1.04)] {
        let mut bench = Bench::new();
        bench.start_motion();
        bench.objects[0].x += 0.04;
        assert_eq!(bench.step(WristExtension, None).motion, None, "nudged by less than its diameter");
        bench.objects[0] = gone;
        assert_eq!(bench.step(WristExtension, None).motion, Some(MotionCommand::Hold));
        assert!(matches!(bench.step(WristExtension, None).plan, Some(PlanCommand::Request(_))));
    }
}

#[test]
fn a_plan_to_where_the_block_was_is_not_followed() {
    let mut bench = Bench::new();
    bench.step(WristExtension, None);
    bench.objects[0].z = 0.03;
    let output = bench.step(WristExtension, Some(&reply(PlanStatus::Ok, 2.0)));
    assert_eq!((output.motion, output.plan), (None, Some(PlanCommand::Cancel)));
}

#[test]
fn a_failed_plan_says_why_and_is_tried_again_only_after_the_base_moved() {
    let mut bench = Bench::new();
    bench.step(WristExtension, None);
    let mut failed = reply(PlanStatus::Unreachable, 0.0);
    failed.reason = "0.1 m too far".to_owned();
    bench.step(WristExtension, Some(&failed));
    assert!(matches!(
        bench.shown.planner.clone(),
        PlannerView::Failed { status: PlanStatus::Unreachable, .. }
    ));
    assert_eq!(bench.step(WristExtension, None).plan, None);
    bench.base = Pose::translation(0.1, 0.0, 0.0);
    bench.step(WristExtension, None);
    assert!(matches!(bench.step(WristExtension, None).plan, Some(PlanCommand::Request(_))));
}

#[test]
fn a_closed_empty_hand_is_refused_with_the_reason() {
    let mut bench = Bench::new();
    bench.hand.state = HandState::Closed;
    assert_eq!(bench.step(WristExtension, None).plan, None);
    let PlannerView::Failed { reason, .. } = bench.shown.planner.clone() else { panic!("refused") };
    assert!(reason.contains("HO"), "{reason}");
}

#[test]
fn the_place_marker_is_there_from_the_start() {
    assert_eq!(Bench::new().shown.target.place, Some(PLACE));
}

/// A bench whose hand holds a block, with other rules.
fn carrying(change: impl Fn(&mut LockOnceProfile)) -> Bench {
    let mut bench = Bench::new();
    let mut rules = LockOnceProfile::default();
    change(&mut rules);
    bench.method = GazeAssisted::new(rules);
    bench.hand = HandView { state: HandState::Closed, held_object: Some(ObjectId(0)) };
    bench.step(NoMotion, None);
    bench
}

#[test]
fn the_default_numbers_are_those_of_the_default_profile() {
    let profile = crate::Profile::named("default").expect("it is embedded");
    assert_eq!(profile.gaze_assisted, crate::GazeAssistedProfile::LockOnce(LockOnceProfile::default()));
}

/// Defect 45 of the original: targets on display are not used.
#[test]
fn a_place_snaps_to_a_free_target_near_it_and_to_no_other() {
    let mut bench = carrying(|rules| rules.snap_radius_m = 0.04);
    let target = |x: f64| proact_types::Target {
        object: ObjectId(0),
        center: Point::new(x, 0.2, 1.015),
        radius: 0.05,
    };
    bench.targets = vec![target(0.08), target(0.3)];
    bench.step(NoMotion, None);
    assert_eq!(bench.shown.target.place, Some(target(0.08).center));
    bench.targets = vec![target(0.1)];
    bench.step(NoMotion, None);
    assert_eq!(bench.shown.target.place, Some(PLACE), "further than 4 cm");
    let mut off = carrying(|_| ());
    off.targets = vec![target(0.051)];
    off.step(NoMotion, None);
    assert_eq!(off.shown.target.place, Some(PLACE), "snapping is an option");
}

#[test]
fn with_double_confirmation_a_held_block_is_let_go_by_the_second_open_within_its_time() {
    let mut bench = carrying(|rules| rules.confirm_open_ms = 2000);
    assert_eq!(bench.step(HandOpen, None).hand, None);
    let PlannerView::Failed { reason, .. } = bench.shown.planner.clone() else {
        panic!("the display must say so")
    };
    assert!(reason.contains("HO again within 2.0 s"), "{reason}");
    (0..300).for_each(|_| assert_eq!(bench.step(HandOpen, None).hand, None, "held, not repeated"));
    bench.step(NoMotion, None);
    assert_eq!(bench.step(HandOpen, None).hand, None, "after 3 s it counts as the first again");
    bench.step(NoMotion, None);
    assert_eq!(bench.step(HandOpen, None).hand, Some(HandCommand::Open));
}
