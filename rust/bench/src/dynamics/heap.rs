//! The heap of the task `bbt_heap`: at rest, kept awake, and with a hand that stirs in it.

use super::mujoco::{MuJoCo, Run};
use super::trial::SEED;
use super::{Cost, around_the_block, play, stay};
use crate::BenchFigure;
use crate::planning::parry_pose;
use parry3d_f64::math::{Pose as ParryPose, Vector as ParryVector};
use parry3d_f64::query::contact;
use parry3d_f64::shape::Cuboid;
use proact_app::settle_heap;
use proact_dynamics::{DynamicsOptions, OdePlant};
use proact_tasks::TaskChoice;
use proact_testbed::{Setup, TrialConfig, ports::Plant};
use proact_types::{PlantCommand, Pose, Scene, Shape, TICK_SECS};
use std::error::Error;

/// The middle of the heap's compartment, y in metres.
const MIDDLE: f64 = -0.13;
/// The hand is let down from so high above its last place, metres, in a second, and then stirs for two.
const ABOVE: f64 = 0.12;
/// How far the hand goes to either side while it stirs, metres; once a second.
const STIRS: f64 = 0.03;

/// Times real time of each, beside MuJoCo's in the same scenes under the same commands, and how deep cubes are in each other and in the
/// box at the end, by Parry for both.
pub(super) fn heap(figures: &mut Vec<BenchFigure>, peer: Option<&MuJoCo>) -> Result<(), Box<dyn Error>> {
    let task = TaskChoice::named("bbt_heap", SEED)?;
    let mut config = TrialConfig::new("D", SEED, Setup::named("seated")?).with_task(task)?;
    let model = &proact_description::mpl_right_arm();
    settle_heap(&mut config, model)?;
    let scene = config.build_task(model)?.scene().clone();
    let open: Vec<f64> = [model.pose("arm", "start")?, model.pose("hand", "open")?].concat();
    let far = Pose::translation(0.0, 0.0, 4.0);
    let deep = Pose::translation(0.0, MIDDLE, 0.0) * around_the_block(model, &open)?;
    let still = vec![stay(&open, far); 1000];
    let stirring: Vec<PlantCommand> = (1..=3000).map(|tick| stay(&open, stirred(deep, tick))).collect();

    let awake = DynamicsOptions { sleep: false, ..DynamicsOptions::default() };
    let phases = [
        ("heap of 150 at rest", DynamicsOptions::default(), far, &still, 20.0),
        ("heap of 150 kept awake", awake, far, &still, 0.5),
        ("hand stirs in a heap of 150", DynamicsOptions::default(), stirred(deep, 0), &stirring, 1.0),
    ];
    for (name, options, base, commands, goal) in phases {
        let mut plant = OdePlant::new(model, &scene, &open, &base, options)?;
        // Till what has just been made has come to rest.
        play(&mut plant, &vec![stay(&open, base); 1000])?;
        let cost = Cost::of(|| play(&mut plant, commands))?;
        let poses: Vec<Pose> = plant.state().objects.iter().map(|body| body.pose).collect();
        let start = figures.len();
        let note = format!("goal: at least {goal}");
        figures.push(BenchFigure::alone(&format!("{name}, times real time"), cost.speed(), "x", &note));
        for (what, share) in [("median", 0.5), ("99 %", 0.99), ("worst", 1.0)] {
            let value = 1e6 * crate::quantile(&cost.ticks, share);
            figures.push(BenchFigure::alone(&format!("{name}, tick, {what}"), value, "us", ""));
        }
        figures.push(BenchFigure::alone(
            &format!("{name}, deepest"),
            1e3 * deepest(&scene, &poses),
            "mm",
            "by Parry",
        ));
        // What rests costs the peer as much as what is awake.
        let (Some(peer), true) = (peer, options.sleep == (base != far)) else { continue };
        let free = if base == far { vec![] } else { (0..model.moving_count()).collect() };
        let commands = commands.iter().collect();
        let run = Run { model, scene: &scene, start: &open, free, commands, events: vec![] };
        let [(cost, poses)] = peer.measure_ends(&[run])?.try_into().map_err(|_| "one run has one cost")?;
        for (place, value) in
            [(0, cost.speed), (1, 1e6 * cost.median_tick), (4, 1e3 * deepest(&scene, &poses))]
        {
            (figures[start + place].peer, figures[start + place].peer_value) =
                (Some(peer.name.clone()), Some(value));
        }
    }
    Ok(())
}

/// The base in tick `tick` of a hand that is let down and then stirs.
fn stirred(deep: Pose, tick: u32) -> Pose {
    let time = f64::from(tick) * TICK_SECS;
    let above = ABOVE * (1.0 - time).max(0.0);
    let angle = std::f64::consts::TAU * (time - 1.0).max(0.0);
    Pose::translation(STIRS * angle.sin(), STIRS * (1.0 - angle.cos()), above) * deep
}

/// How deep boxes are in each other, or in boxes of the room, metres.
fn deepest(scene: &Scene, poses: &[Pose]) -> f64 {
    let cuboid = |shape: &Shape| match *shape {
        Shape::Box { size: [x, y, z] } => Some(Cuboid::new(ParryVector::new(0.5 * x, 0.5 * y, 0.5 * z))),
        _ => None,
    };
    let cubes = scene.objects.iter().zip(poses).map(|(object, pose)| (cuboid(&object.shape), *pose));
    let room = scene.fixed.iter().map(|body| (cuboid(&body.shape), body.pose));
    let all: Vec<(Cuboid, ParryPose)> =
        cubes.chain(room).filter_map(|(shape, pose)| Some((shape?, parry_pose(&pose)))).collect();
    let mut deepest: f64 = 0.0;
    for (k, (a, at)) in all.iter().enumerate().take(poses.len()) {
        for (b, there) in &all[k + 1..] {
            if let Ok(Some(touch)) = contact(at, a, there, b, 0.0) {
                deepest = deepest.max(-touch.dist);
            }
        }
    }
    deepest
}
