//! A trial whose figures are worked out by hand.

use super::*;
use proact_types::{
    Command, Event, EventKind, GazeSample, GraspFault, Object, ObjectId, PlaceRegion, PlanStatus, Point,
    Pose, Scene, Shape, SimTime, Target, TaskGoal, Vector,
};

const STEP_MS: u64 = 20;
const A: ObjectId = ObjectId(0);
const B: ObjectId = ObjectId(1);

fn block(name: &str, x: f64) -> Object {
    Object::with_default_friction(
        name,
        Shape::Box { size: [0.05; 3] },
        0.1,
        Pose::translation(x, -0.2, 1.025),
    )
}

/// Two blocks at y = -0.2 on a table one metre high, their targets at y = 0.2.
fn scene() -> Scene {
    let target = |object, x| Target { object, center: Point::new(x, 0.2, 1.0), radius: 0.05 };
    Scene {
        objects: vec![block("a", 0.0), block("b", 0.3)],
        targets: vec![target(A, 0.0), target(B, 0.3)],
        place_region: PlaceRegion { min: [-0.2, 0.05], max: [0.4, 0.3] },
        table_height: 1.0,
        ..Scene::default()
    }
}

fn event(millis: u64, kind: EventKind) -> Event {
    Event { time: SimTime(millis), kind }
}

/// A share of the way, 0 to 1, that goes on evenly from `from` to `to`.
fn part(now: u64, from: u64, to: u64) -> f64 {
    (now.saturating_sub(from) as f64 / (to - from) as f64).min(1.0)
}

/// Ten seconds: the joint carries the hand to `a` in the first two seconds; it is taken at 2 s and carried to 1 cm beside its target by
/// the shoulder alone until 4 s, where it is let go on the table. It is taken to b by the joint until 6 s; b is taken and let go
/// 10 cm above the table at 7 s, still on its side; at 8 s something pushes a out of its region.
fn trace() -> Trace {
    let scene = scene();
    let instants = (0..=10_000)
        .step_by(STEP_MS as usize)
        .map(|now| {
            let moved = 0.4 * part(now, 2000, 4000);
            let angle = 0.5 * part(now, 0, 2000) + 1.0 * part(now, 4000, 6000);
            let base = Pose::translation(0.0, moved, 1.4);
            let hand = Point::new(0.3 * part(now, 4000, 6000), moved - 0.5 + 0.3 * part(now, 0, 2000), 1.1);
            let a =
                Vector::new(0.01 * part(now, 2000, 4000) + 0.2 * part(now, 8000, 8500), moved - 0.2, 1.025);
            let lifted = if (6000..=7000).contains(&now) { 0.1 * part(now, 6000, 7000) } else { 0.0 };
            let gaze_target = match now {
                // At a, from half a second on; from 2.5 s on at its target; later at nothing.
                500..2500 => a,
                2500..5000 => Vector::new(0.0, 0.2, 1.0),
                _ => Vector::new(0.0, 0.0, 9.0),
            };
            let eye = Point::new(-0.6, 0.0, 1.7);
            let gaze = GazeSample { origin: eye, direction: gaze_target - eye.coords, valid: now >= 200 };
            TracePoint {
                time: SimTime(now),
                world_from_base: base,
                world_from_tip: base,
                grasp_center: hand,
                joint_positions: vec![0.0, angle],
                joint_origins: vec![],
                objects: vec![Pose::translation(a.x, a.y, a.z), Pose::translation(0.3, -0.2, 1.025 + lifted)],
                gaze: Some(gaze),
                gesture: Command::NoMotion,
                next: Some(if now < 4000 { A } else { B }),
                goal: None,
                // Opens to 10 cm until 1 s, closes to 5 cm until 2 s.
                aperture_m: Some(0.06 + 0.04 * part(now, 0, 1000) - 0.05 * part(now, 1000, 2000)),
            }
        })
        .collect();
    let events = vec![
        event(0, EventKind::GestureChanged { gesture: Command::WristExtension }),
        event(900, EventKind::GestureChanged { gesture: Command::HandOpen }),
        event(1000, EventKind::GestureChanged { gesture: Command::WristExtension }),
        event(1800, EventKind::GraspFailed { object: Some(A), reason: GraspFault::OneDigit }),
        event(2000, EventKind::ObjectAttached { object: A }),
        event(4000, EventKind::ObjectReleased { object: A }),
        event(4100, EventKind::PlanFinished { request: 1, status: PlanStatus::NoPlan, reason: None }),
        event(4200, EventKind::PlanFinished { request: 2, status: PlanStatus::Cancelled, reason: None }),
        event(6000, EventKind::ObjectAttached { object: B }),
        event(7000, EventKind::ObjectReleased { object: B }),
    ];
    // From 4 s on the trunk leans ahead, by 0.1 rad and 5 cm in all.
    let trunk = (0..=100)
        .map(|k| {
            let (time, share) = (SimTime(100 * k), (k as f64 - 40.0).max(0.0) / 60.0);
            let pose = Pose::translation(0.05 * share, 0.0, 1.2) * Pose::rotation(Vector::y() * 0.1 * share);
            (time, pose)
        })
        .collect();
    let decisions = Some(200);
    Trace {
        scene,
        duration: SimTime(10_000),
        points: instants,
        events,
        decisions,
        trunk,
        has_all_events: true,
        ..Trace::default()
    }
}

fn value<T>(measures: &[Measure<T>], name: &str, scored: &ScoredTrial<'_>, row: &T) -> Option<f64> {
    let measure = measures.iter().find(|measure| measure.column.name == name).unwrap();
    (measure.compute)(scored, row)
}

#[track_caller]
fn near(found: Option<f64>, expected: f64, tolerance: f64) {
    let found = found.expect("there is one");
    assert!((found - expected).abs() <= tolerance, "{found}, expected {expected}");
}

#[test]
fn picks_and_places_are_the_papers() {
    let trace = trace();
    let scored = ScoredTrial::of(&trace);
    let reported: Vec<_> = scored
        .phases
        .iter()
        .map(|p| (p.kind, p.object, p.from.0, p.to.0, p.crossed, p.entered_target))
        .collect();
    assert_eq!(
        reported,
        [
            (PhaseKind::Pick, A, 0, 2000, None, None),
            (PhaseKind::Place, A, 2000, 4000, Some(true), Some(true)),
            (PhaseKind::Pick, B, 4000, 6000, None, None),
            (PhaseKind::Place, B, 6000, 7000, Some(false), Some(false)),
        ]
    );
    let [a, b] = &scored.objects[..] else { panic!() };
    for (name, of_a, of_b) in [
        ("grasps", Some(1.0), Some(1.0)),
        ("crossed", Some(1.0), Some(0.0)),
        ("pick_s", Some(2.0), None),
        ("pick_with_method", Some(1.0), None),
        ("place_s", Some(2.0), None),
        // The shoulder alone carried it.
        ("place_with_method", Some(0.0), None),
        ("disturbed", Some(1.0), Some(0.0)),
    ] {
        let found = [a, b].map(|row| value(OBJECT_MEASURES, name, &scored, row));
        assert_eq!(found, [of_a, of_b], "{name}");
    }
    near(value(OBJECT_MEASURES, "least_distance_mm", &scored, a), 10.0, 1e-9);
    near(value(OBJECT_MEASURES, "least_distance_mm", &scored, b), 400.0, 1e-9);
}

#[test]
fn faults_are_found_by_themselves() {
    let trace = trace();
    let scored = ScoredTrial::of(&trace);
    let reported: Vec<_> = scored.faults.iter().map(|f| (f.kind, f.object, f.detail.as_str())).collect();
    assert_eq!(
        reported,
        [
            (FaultKind::FalseTrigger, None, "100 ms"),
            (FaultKind::GraspFailed, Some(A), "one_digit"),
            (FaultKind::PlanFailed, None, "no_plan"),
            (FaultKind::Dropped, Some(B), "0.100 m"),
            (FaultKind::Disturbed, Some(A), ""),
        ]
    );
    // From 1 cm beside its middle it is outside, by 5 mm more, after 4.5 of 20 cm in half a second.
    let disturbed = scored.faults[4].time.0;
    assert!((8100..=8140).contains(&disturbed), "{disturbed}");
    for (name, expected) in [
        ("grasps", 2.0),
        ("attempts", 3.0),
        ("failed_grasps", 1.0),
        ("wrong_objects", 0.0),
        ("drops", 1.0),
        ("plan_failures", 1.0),
        ("false_triggers", 1.0),
        ("false_trigger_ms", 100.0),
        ("gesture_changes", 3.0),
        ("decisions_per_s", 20.0),
        ("stops", 0.0),
    ] {
        assert_eq!(value(TRIAL_MEASURES, name, &scored, &()), Some(expected), "{name}");
    }
    // The joint goes 0.25 rad a second: 0.002 rad are passed with the first step.
    assert_eq!(value(TRIAL_MEASURES, "gesture_to_motion_ms", &scored, &()), Some(20.0));
}

#[test]
fn what_the_body_did_and_what_the_joints() {
    let trace = trace();
    let scored = ScoredTrial::of(&trace);
    let [pick, place, ..] = &scored.phases[..] else { panic!() };
    let of = |name, phase| value(PHASE_MEASURES, name, &scored, phase);
    // 0.4 m in 2 s, in 20 steps; the low pass takes the same from both ends, some 2 times 3.5 mm.
    near(of("shoulder_sum10_m", place), 0.4, 1e-9);
    near(of("shoulder_path_m", place), 0.4, 0.01);
    near(of("shoulder_displacement_mm", place), 400.0, 10.0);
    near(of("shoulder_turn_sum10_deg", place), 0.0, 1e-5);
    near(of("trunk_turn_deg", place), 0.0, 1e-9);
    near(value(TRIAL_MEASURES, "trunk_turn_deg", &scored, &()), 0.1_f64.to_degrees(), 1e-6);
    near(value(TRIAL_MEASURES, "trunk_displacement_mm", &scored, &()), 50.0, 1e-6);
    let unseen = Trace { trunk: Vec::new(), ..trace.clone() };
    assert_eq!(value(TRIAL_MEASURES, "trunk_turn_deg", &ScoredTrial::of(&unseen), &()), None);
    near(of("base_share", place), 1.0, 1e-9);
    near(of("base_share", pick), 0.0, 1e-9);
    near(of("shoulder_path_m", pick), 0.0, 1e-9);
    near(of("joint2_rad", pick), 0.5, 0.004);
    near(of("joint1_rad", pick), 0.0, 0.0);
    assert_eq!(of("joint3_rad", pick), None, "this arm has two joints");
    near(of("hand_path_m", pick), 0.3, 0.01);
    near(of("path_efficiency", pick), 1.0, 1e-9);
    near(of("peak_speed_m_per_s", place), 0.2, 1e-3);
    assert_eq!(of("movement_units", place), Some(1.0));
    // Evenly to the end: what is left of a fall of the speed is at the ends alone, where the low pass makes it.
    assert!(of("peak_deceleration_time", place).unwrap() > 0.9);
    near(of("peak_aperture_mm", pick), 100.0, 1e-9);
    near(of("peak_aperture_time", pick), 0.49, 0.011);
}

#[test]
fn numbers_of_the_task_are_its_measures_and_places_that_change_are_those_of_their_time() {
    let mut trace = trace();
    trace.task_metrics =
        [("throughput_bits_per_s", 1.5), ("moved", 2.0)].map(|(k, v)| (k.to_owned(), v)).into();
    let near_side = Point::new(0.0, -0.2, 1.0);
    for instant in &mut trace.points {
        let center = if instant.time.0 < 4500 { Point::new(0.0, 0.2, 1.0) } else { near_side };
        (instant.next, instant.goal) = (Some(A), Some(TaskGoal::Disc { center, radius: 0.05 }));
    }
    let scored = ScoredTrial::of(&trace);
    assert_eq!(value(TRIAL_MEASURES, "throughput_bits_per_s", &scored, &()), Some(1.5));
    assert_eq!(value(TRIAL_MEASURES, "moves_done", &scored, &()), Some(2.0));
    assert_eq!(value(TRIAL_MEASURES, "completion_rate", &scored, &()), None);
    let [_, place, ..] = &scored.phases[..] else { panic!() };
    assert_eq!((place.crossed, place.entered_target), (None, Some(true)));
    // It was left where it was asked to be; that it is asked for elsewhere later does not disturb it.
    assert_eq!(value(OBJECT_MEASURES, "disturbed", &scored, &scored.objects[0]), None);
}

#[test]
fn eyes_are_followed_to_what_they_look_at() {
    let trace = trace();
    let scored = ScoredTrial::of(&trace);
    let [pick, place, ..] = &scored.phases[..] else { panic!() };
    let of = |name, phase| value(PHASE_MEASURES, name, &scored, phase);
    // Known from 0.2 s on; at a from 0.5 s on.
    near(of("gaze_object", pick), 1.5 / 1.8, 1e-9);
    near(of("gaze_target", pick), 0.0, 0.0);
    near(of("gaze_elsewhere", pick), 0.3 / 1.8, 1e-9);
    near(of("eye_arrival_ms", pick), 1500.0, 0.0);
    near(of("eye_leaving_ms", pick), 500.0, 0.0);
    // The object itself comes to lie in the gaze at its target before it is let go.
    near(of("eye_arrival_ms", place), 1500.0, 0.0);
    assert_eq!(of("eye_switches", pick), Some(0.0));
    assert!(of("eye_switches", place).unwrap() >= 1.0);
}

#[test]
fn humps_of_the_speed_are_counted_and_a_way_does_not_hang_on_the_step() {
    let there_and_back = |step: usize| {
        let instants: Vec<TracePoint> = (0..=4000)
            .step_by(step)
            .map(|now| {
                let x = 0.1 * (1.0 - (f64::from(now) * 1e-3 * std::f64::consts::PI).cos());
                let mut instant = trace().points[0].clone();
                instant.time = SimTime(now as u64);
                instant.grasp_center = Point::new(x, 0.0, 1.0);
                instant
            })
            .collect();
        motion::PathMetrics::of(&instants, |instant| instant.grasp_center).unwrap()
    };
    let metrics = there_and_back(20);
    assert_eq!(metrics.movement_unit_count(), 4, "twice there and back");
    assert!((metrics.length() - 0.8).abs() < 0.01, "{}", metrics.length());
    assert!((there_and_back(33).length() - metrics.length()).abs() < 0.002);
    let [speed, _] = metrics.peak_speed_and_time().unwrap();
    assert!((speed - 0.1 * std::f64::consts::PI).abs() < 0.005, "{speed}");
}

#[test]
fn what_a_record_does_not_tell_is_none_and_never_zero() {
    let mut trace = trace();
    trace.has_all_events = false;
    trace.decisions = None;
    trace.points.iter_mut().for_each(|instant| instant.gaze = None);
    let scored = ScoredTrial::of(&trace);
    for name in ["attempts", "failed_grasps", "plan_failures", "stops", "decisions_per_s", "gaze_known"] {
        assert_eq!(value(TRIAL_MEASURES, name, &scored, &()), None, "{name}");
    }
    for name in ["gaze_object", "eye_arrival_ms", "eye_switches"] {
        assert_eq!(value(PHASE_MEASURES, name, &scored, &scored.phases[0]), None, "{name}");
    }
    let empty = Trace::default();
    let scored = ScoredTrial::of(&empty);
    assert!(scored.phases.is_empty() && scored.faults.is_empty());
    TRIAL_MEASURES.iter().for_each(|measure| _ = (measure.compute)(&scored, &()));
}

#[test]
fn columns_have_names_of_their_own() {
    fn check<T>(measures: &[Measure<T>]) {
        let names: std::collections::BTreeSet<_> =
            measures.iter().map(|measure| measure.column.name).collect();
        assert_eq!(names.len(), measures.len());
        assert!(measures.iter().all(|m| !m.column.meaning.is_empty() && !m.column.source.is_empty()));
    }
    check(PHASE_MEASURES);
    check(OBJECT_MEASURES);
    check(TRIAL_MEASURES);
}
