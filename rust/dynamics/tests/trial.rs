//! The physics inside the testbed's tick: a shoulder that jumps, the settings of a trial, the time of a grasp.

#![allow(missing_docs)]
#![allow(clippy::unwrap_used)]

mod common;

use common::testbed;
use proact_testbed::{MassSet, PhysicsConfig, Setup, Testbed, TrialConfig};
use proact_types::{Command, Event, EventKind, Pose, TickInput, Vector};

fn config() -> TrialConfig {
    TrialConfig::new("A", 1, Setup::named("still").unwrap())
}

/// Ticks with a shoulder that is tracked at 100 Hz, and a key that is pressed at the start.
fn run(testbed: &mut Testbed, ticks: u64, shoulder: Pose, mut command: Option<Command>) -> Vec<Event> {
    let mut events = Vec::new();
    for _ in 0..ticks {
        let tracked = testbed.now().0.is_multiple_of(10);
        let input = TickInput {
            command: command.take(),
            shoulder: tracked.then_some(shoulder),
            ..TickInput::default()
        };
        events.extend(testbed.tick(&input, false).unwrap().events);
    }
    events
}

fn kinds(events: &[Event]) -> Vec<&EventKind> {
    events
        .iter()
        .map(|event| &event.kind)
        .filter(|kind| matches!(kind, EventKind::BaseHeld { .. } | EventKind::BaseFollows))
        .collect()
}

#[test]
fn a_shoulder_that_jumps_pauses_the_arm_until_it_is_back() {
    let mut testbed = testbed(config(), None);
    let shoulder = testbed.plant().state().world_from_base;
    let before = testbed.plant().state().position[0];
    assert!(kinds(&run(&mut testbed, 500, shoulder, Some(Command::WristExtension))).is_empty());
    let moving = testbed.plant().state().clone();
    assert!((moving.position[0] - before).abs() > 0.05, "the joint is driven");
    assert!(moving.velocity[0].abs() > 0.1);

    let mut jumped = shoulder;
    jumped.translation.vector += Vector::new(0.3, 0.0, 0.0);
    let events = run(&mut testbed, 100, jumped, None);
    let [EventKind::BaseHeld { distance }] = kinds(&events)[..] else { panic!("{events:?}") };
    assert!((distance - 0.3).abs() < 1e-6, "{distance} m");
    let held = testbed.plant().state().clone();
    assert_eq!(held.world_from_base, shoulder);
    assert!(run(&mut testbed, 300, jumped, None).iter().all(|event| event.kind != EventKind::BaseFollows));
    let still = testbed.plant().state();
    assert!(
        (still.position[0] - held.position[0]).abs() < 1e-6,
        "the joint stands still while the base waits"
    );
    for (a, b) in still.objects.iter().zip(&moving.objects) {
        assert!((a.pose.translation.vector - b.pose.translation.vector).norm() < 1e-6, "no block was kicked");
    }
    let frozen = still.position[0];

    let events = run(&mut testbed, 500, shoulder, None);
    assert_eq!(kinds(&events), [&EventKind::BaseFollows]);
    let state = testbed.plant().state();
    assert_eq!(state.world_from_base, shoulder);
    assert!((state.position[0] - frozen).abs() > 0.05, "and goes on afterwards");
}

#[test]
fn a_shoulder_that_stays_where_it_jumped_is_followed_slowly_after_a_second() {
    let mut testbed = testbed(config(), None);
    let shoulder = testbed.plant().state().world_from_base;
    let mut jumped = shoulder;
    jumped.translation.vector += Vector::new(0.0, 0.1, 0.1);
    let events = run(&mut testbed, 3000, jumped, None);
    assert!(matches!(kinds(&events)[..], [EventKind::BaseHeld { .. }, EventKind::BaseFollows]), "{events:?}");
    let state = testbed.plant().state();
    assert!((state.world_from_base.translation.vector - jumped.translation.vector).norm() < 1e-9);
    let fastest = state.velocity.iter().fold(0.0_f64, |max, speed| max.max(speed.abs()));
    assert!(fastest < 1e-3, "the arm was not kicked: {fastest} rad/s");
}

#[test]
fn a_grasp_names_block_fingers_and_place_and_ends_within_100_ms_of_opening() {
    let config = config();
    let model = proact_description::mpl_right_arm();
    let open = common::positions(&model, &common::START, "open");
    // The hand around the first block.
    let block = config.build_task(&model).unwrap().scene().objects[0].pose.translation.vector;
    let mut base = common::grasp_base(&model, &open);
    base.translation.vector += Vector::new(block.x, block.y, 0.0);
    let mut testbed = testbed(config, Some(base));
    run(&mut testbed, 100, base, None);
    assert!(!testbed.plant().state().base_held, "tracking has arrived");
    let events = run(&mut testbed, 2500, base, Some(Command::HandClose));
    let made = events.iter().find_map(|event| match &event.kind {
        EventKind::GraspMade { object, links, place } => Some((*object, links.clone(), *place, event.time)),
        _ => None,
    });
    let (id, links, place, at) = made.unwrap_or_else(|| panic!("the hand takes the block: {events:?}"));
    assert_eq!(id, proact_types::ObjectId(0));
    assert!(links.iter().any(|link| link.contains("thumb")) && links.len() >= 2, "{links:?}");
    assert!((place.coords - block).norm() < 0.01, "{place} beside {block}");
    println!("{} ms: {id:?} by {links:?}", at.0);

    run(&mut testbed, 500, base, Some(Command::NoMotion));
    let opening_at = testbed.now();
    let events = run(&mut testbed, 1000, base, Some(Command::HandClose));
    let ended = events.iter().find(|event| matches!(event.kind, EventKind::GraspEnded { .. }));
    let ended = ended.unwrap_or_else(|| panic!("the hand lets the block go: {events:?}"));
    let EventKind::GraspEnded { links: after, .. } = &ended.kind else { unreachable!("was just found") };
    assert_eq!(*after, links);
    println!("let go {} ms after opening was asked for", ended.time.0 - opening_at.0);
    assert!(ended.time.0 - opening_at.0 <= 100, "let go after {} ms", ended.time.0 - opening_at.0);
}

#[test]
fn a_trials_configuration_chooses_masses_and_controllers() {
    let after = |physics| {
        let mut testbed = testbed(TrialConfig { physics, ..config() }, None);
        let shoulder = testbed.plant().state().world_from_base;
        run(&mut testbed, 1500, shoulder, None);
        testbed.plant().state().clone()
    };
    let light = after(PhysicsConfig::default());
    let heavy = after(PhysicsConfig { mass_set: MassSet::RealLimb, ..PhysicsConfig::default() });
    let original = after(PhysicsConfig::ORIGINAL);
    assert!(
        (heavy.effort[0] / light.effort[0] - 10.0).abs() < 0.1,
        "{} and {} N m",
        light.effort[0],
        heavy.effort[0]
    );
    assert!((heavy.position[0] - light.position[0]).abs() < 1e-6, "neither sags");
    let sag = (original.position[0] - light.position[0]).abs();
    assert!((1e-3..0.1).contains(&sag), "the original's shoulder sags by {sag} rad");
}
