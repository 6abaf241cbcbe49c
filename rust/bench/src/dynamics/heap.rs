//! The heap of the task `bbt_heap`: at rest, kept awake, and with a hand that stirs in it.

use super::mujoco::{MuJoCo, MujocoScenario};
use super::trial::SEED;
use super::{TickTiming, base_around_block, hold_command, run_commands};
use crate::BenchFigure;
use proact_app::settle_heap;
use proact_dynamics::{DynamicsOptions, RigidBodyPlant};
use proact_tasks::TaskSpec;
use proact_testbed::{Setup, TrialConfig, ports::Plant};
use proact_types::{PlantCommand, Pose, Scene, Shape, TICK_SECS, Vector};
use std::error::Error;

/// The middle of the heap's compartment, y in metres.
const HEAP_CENTER_Y_M: f64 = -0.13;
/// The hand is let down from so high above its last place, metres, in a second, and then stirs for two.
const START_HEIGHT_M: f64 = 0.2;
/// How far the hand goes to either side while it stirs, metres; once a second.
const STIR_AMPLITUDE_M: f64 = 0.03;

/// Times real time of each, beside MuJoCo's in the same scenes under the same commands, and how deep cubes are in each other and in the
/// box at the end.
pub(super) fn heap(figures: &mut Vec<BenchFigure>, peer: Option<&MuJoCo>) -> Result<(), Box<dyn Error>> {
    let task = TaskSpec::named("bbt_heap", SEED)?;
    let mut config = TrialConfig::new("D", SEED, Setup::named("seated")?).with_task(task)?;
    let model = &proact_description::mpl_right_arm();
    settle_heap(&mut config, model)?;
    let scene = config.build_task(model)?.scene().clone();
    let open: Vec<f64> = [model.pose("arm", "start")?, model.pose("hand", "open")?].concat();
    let far = Pose::translation(0.0, 0.0, 4.0);
    let deep = Pose::translation(0.0, HEAP_CENTER_Y_M, 0.0) * base_around_block(model, &open)?;
    let still = vec![hold_command(&open, far); 1000];
    let stirring: Vec<PlantCommand> =
        (1..=3000).map(|tick| hold_command(&open, stirring_base(deep, tick))).collect();

    let awake = DynamicsOptions { sleep: false, ..DynamicsOptions::default() };
    let phases = [
        ("heap of 150 at rest", DynamicsOptions::default(), far, &still, 20.0),
        ("heap of 150 kept awake", awake, far, &still, 0.5),
        ("hand stirs in a heap of 150", DynamicsOptions::default(), stirring_base(deep, 0), &stirring, 1.0),
    ];
    for (name, options, base, commands, goal) in phases {
        let mut plant = RigidBodyPlant::new(model, &scene, &open, &base, options)?;
        // Till what has just been made has come to rest.
        run_commands(&mut plant, &vec![hold_command(&open, base); 1000])?;
        let cost = TickTiming::measure(|| run_commands(&mut plant, commands))?;
        let poses: Vec<Pose> = plant.state().objects.iter().map(|body| body.pose).collect();
        let start = figures.len();
        let note = format!("goal: at least {goal}");
        figures.push(BenchFigure::without_peer(
            &format!("{name}, times real time"),
            cost.real_time_factor(),
            "x",
            &note,
        ));
        for (what, share) in [("median", 0.5), ("99 %", 0.99), ("worst", 1.0)] {
            let value = 1e6 * crate::quantile(&cost.tick_secs, share);
            figures.push(BenchFigure::without_peer(&format!("{name}, tick, {what}"), value, "us", ""));
        }
        figures.push(BenchFigure::without_peer(
            &format!("{name}, deepest"),
            1e3 * max_penetration_m(&scene, &poses),
            "mm",
            "boxes in boxes",
        ));
        // What rests costs the peer as much as what is awake.
        let (Some(peer), true) = (peer, options.sleep == (base != far)) else { continue };
        let free = if base == far { vec![] } else { (0..model.moving_count()).collect() };
        let commands = commands.iter().collect();
        let run = MujocoScenario {
            model,
            scene: &scene,
            start: &open,
            free_joints: free,
            commands,
            events: vec![],
        };
        let [(cost, poses)] =
            peer.measure_with_final_poses(&[run])?.try_into().map_err(|_| "one run has one cost")?;
        for (coordinate, value) in [
            (0, cost.real_time_factor),
            (1, 1e6 * cost.median_tick_secs),
            (4, 1e3 * max_penetration_m(&scene, &poses)),
        ] {
            (figures[start + coordinate].peer, figures[start + coordinate].peer_value) =
                (Some(peer.name.clone()), Some(value));
        }
    }
    Ok(())
}

/// The base in tick `tick` of a hand that is let down and then stirs.
fn stirring_base(deep: Pose, tick: u32) -> Pose {
    let time = f64::from(tick) * TICK_SECS;
    let above = START_HEIGHT_M * (1.0 - time).max(0.0);
    let angle = std::f64::consts::TAU * (time - 1.0).max(0.0);
    Pose::translation(STIR_AMPLITUDE_M * angle.sin(), STIR_AMPLITUDE_M * (1.0 - angle.cos()), above) * deep
}

/// How deep boxes are in each other, or in boxes of the room, metres: the shortest way that parts two, over the axes that can part boxes
/// (S. Gottschalk et al., OBBTree, 1996).
fn max_penetration_m(scene: &Scene, poses: &[Pose]) -> f64 {
    let half = |shape: &Shape| match *shape {
        Shape::Box { size } => Some(Vector::from(size) / 2.0),
        _ => None,
    };
    let cubes = scene.objects.iter().zip(poses).map(|(object, pose)| (half(&object.shape), *pose));
    let walls = scene.fixed.iter().map(|body| (half(&body.shape), body.pose));
    let all: Vec<(Vector, Pose)> =
        cubes.chain(walls).filter_map(|(half, pose)| Some((half?, pose))).collect();
    let pairs = (0..poses.len()).flat_map(|k| (k + 1..all.len()).map(move |other| (k, other)));
    pairs.map(|(a, b)| penetration_depth_m(&all[a], &all[b])).fold(0.0, f64::max)
}

/// How deep two boxes, by half their sides and their poses, are in each other; below zero where they are apart.
fn penetration_depth_m((a, there): &(Vector, Pose), (b, here): &(Vector, Pose)) -> f64 {
    let difference = here.translation.vector - there.translation.vector;
    if difference.norm() > a.norm() + b.norm() {
        return -1.0;
    }
    let axes = |pose: &Pose| [Vector::x(), Vector::y(), Vector::z()].map(|axis| pose.rotation * axis);
    let (first, second) = (axes(there), axes(here));
    let crossed = first.iter().flat_map(|u| second.iter().filter_map(|v| u.cross(v).try_normalize(1e-6)));
    let reach = |half: &Vector, own: &[Vector; 3], axis: &Vector| -> f64 {
        own.iter().zip(half.iter()).map(|(side, half)| (side.dot(axis) * half).abs()).sum()
    };
    let along =
        |axis: Vector| reach(a, &first, &axis) + reach(b, &second, &axis) - difference.dot(&axis).abs();
    first.into_iter().chain(second).chain(crossed).map(along).fold(f64::INFINITY, f64::min)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proact_types::{Object, SceneObject};

    #[test]
    fn the_depth_of_cubes_in_each_other_and_in_the_room_is_found() {
        let cube = Shape::Box { size: [0.025; 3] };
        let at =
            |x: f64, z: f64| Object::with_default_friction("cube", cube, 0.01, Pose::translation(x, 0.0, z));
        let table = SceneObject {
            name: "table".to_owned(),
            shape: Shape::Box { size: [0.4, 0.8, 0.03] },
            pose: Pose::translation(0.0, 0.0, -0.015),
            friction: 0.4,
        };
        let depth = |objects: Vec<Object>| {
            let poses: Vec<Pose> = objects.iter().map(|object| object.pose).collect();
            max_penetration_m(&Scene { fixed: vec![table.clone()], objects, ..Scene::default() }, &poses)
        };
        assert_eq!(depth(vec![at(0.0, 0.0127), at(0.03, 0.0127)]), 0.0);
        assert!((depth(vec![at(0.0, 0.0125 - 5e-5), at(0.03, 0.0127)]) - 5e-5).abs() < 1e-6);
        assert!((depth(vec![at(0.0, 0.0127), at(0.024, 0.0127)]) - 1e-3).abs() < 1e-6);
    }
}
