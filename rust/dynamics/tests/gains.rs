//! The original's joint controllers: gains without feed-forward.

#![allow(missing_docs)]
#![allow(clippy::unwrap_used)]

mod common;

use common::{
    START, bare_table, box_scene, grasp_base, hold_command, move_hand, plant_with, positions, run, standing,
    still,
};
use proact_dynamics::{DynamicsOptions, JointControl, PhysicsEngine, RigidBodyPlant};
use proact_testbed::{GraspAction, OriginalGraspRule, ports::Plant};
use proact_types::ObjectId;

/// How far the hand stands to its thumb's side, metres.
const SHIFT: f64 = 0.004;

const ENGINES: [PhysicsEngine; 2] = [PhysicsEngine::Reduced, PhysicsEngine::Ode];

fn gains(engine: PhysicsEngine) -> DynamicsOptions {
    DynamicsOptions { engine, control: JointControl::OriginalGains, ..DynamicsOptions::default() }
}

#[test]
fn the_arm_sags_until_its_gains_bear_its_weight() {
    let model = proact_description::mpl_right_arm();
    let start = positions(&model, &START, "open");
    // What bears the arm without a sag.
    let mut exact = plant_with(&box_scene(), &still(), DynamicsOptions::default());
    run(&mut exact, &hold_command(&start, still()), 500);
    let weight = exact.state().effort.clone();
    for engine in ENGINES {
        let mut plant = plant_with(&box_scene(), &still(), gains(engine));
        run(&mut plant, &hold_command(&start, still()), 4000);
        let state = plant.state();
        let mut deepest = 0.0_f64;
        for k in 0..7 {
            let (sag, effort) = (start[k] - state.position[k], state.effort[k]);
            assert!((effort - 100.0 * sag).abs() < 2e-3, "{engine:?}, joint {k}: {effort} N m at {sag} rad");
            assert!(
                (effort - weight[k]).abs() < 0.05,
                "{engine:?}, joint {k}: {effort} N m of {}",
                weight[k]
            );
            deepest = deepest.max(sag.abs());
        }
        println!("{engine:?}: a joint sags by {deepest:.4} rad");
        assert!(deepest > 5e-3, "{engine:?}: an arm without feed-forward sags: {deepest} rad");
    }
}

#[test]
fn a_command_that_leaps_is_followed_at_half_a_radian_a_second() {
    let model = proact_description::mpl_right_arm();
    let start = positions(&model, &START, "open");
    for engine in ENGINES {
        let mut plant = plant_with(&box_scene(), &still(), gains(engine));
        run(&mut plant, &hold_command(&start, still()), 2000);
        let before = plant.state().position[0];
        let mut leap = start.clone();
        leap[0] += 0.4;
        run(&mut plant, &hold_command(&leap, still()), 400);
        let travel = plant.state().position[0] - before;
        assert!((travel - 0.2).abs() < 0.02, "{engine:?}: {travel} rad in 0.4 s");
        run(&mut plant, &hold_command(&leap, still()), 2000);
        let travel = plant.state().position[0] - before;
        assert!((travel - 0.4).abs() < 0.02, "{engine:?}: {travel} rad in the end");
    }
}

#[test]
fn the_original_rule_takes_a_block_with_the_original_gains_and_lets_it_go() {
    for engine in ENGINES {
        grasp_and_release(engine);
    }
}

fn grasp_and_release(engine: PhysicsEngine) {
    let model = proact_description::mpl_right_arm();
    let open = positions(&model, &START, "open");
    let closed = positions(&model, &START, "closed");
    let mut base = grasp_base(&model, &open);
    // Such fingers are too weak to push the block against the thumb: it must be between them.
    base.translation.y -= SHIFT;
    let scene = bare_table(vec![standing(ObjectId(0), 0.0, 0.0)]);
    let mut plant = plant_with(&scene, &base, gains(engine));
    let mut rule = OriginalGraspRule::new(proact_testbed::OriginalGrasp::DEFAULT, &model);
    let mut act = |plant: &mut RigidBodyPlant| {
        let action = rule.step(&model, plant.state());
        match action {
            Some(GraspAction::Attach(block)) => plant.attach(block, model.tip).unwrap(),
            Some(GraspAction::Release) => plant.release(),
            None => {}
        }
        action
    };
    let mut taken = None;
    for (tick, command) in move_hand(&open, &closed, base, 8000).iter().enumerate() {
        plant.step(command).unwrap();
        if act(&mut plant) == Some(GraspAction::Attach(0)) {
            taken = Some(tick);
            break;
        }
    }
    let taken = taken.expect("the original rule takes the block");
    println!("{engine:?}: taken after {taken} ms");
    assert!(taken > 1250, "five checks at 4 Hz");
    for _ in 0..2000 {
        plant.step(&hold_command(&closed, base)).unwrap();
        assert_eq!(act(&mut plant), None, "a closed hand holds");
    }
    let released = move_hand(&closed, &open, base, 6000).iter().position(|command| {
        plant.step(command).unwrap();
        act(&mut plant) == Some(GraspAction::Release)
    });
    let released = released.expect("an open hand lets go");
    println!("{engine:?}: let go after {released} ms");
    assert!((750..3000).contains(&released), "{released} ms");
    assert!(plant.state().attached.is_none());
}

#[test]
fn an_arm_without_a_row_in_the_originals_table_is_refused_and_so_is_what_an_engine_cannot_do() {
    let mut model = proact_description::mpl_right_arm();
    let start = positions(&model, &START, "open");
    let first = model.arm[0];
    model.joints[first].name = "joint_1".to_owned();
    let refused = RigidBodyPlant::new(&model, &box_scene(), &start, &still(), gains(PhysicsEngine::Reduced));
    let text = refused.err().expect("is refused").to_string();
    assert!(text.contains("\"joint_1\" has no gains"), "{text}");
    let carried = DynamicsOptions { merge_attached: false, ..DynamicsOptions::default() };
    let model = proact_description::mpl_right_arm();
    let refused = RigidBodyPlant::new(&model, &box_scene(), &start, &still(), carried);
    assert!(refused.err().expect("is refused").to_string().contains("needs the engine ode"));
}
