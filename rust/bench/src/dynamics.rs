//! `proact bench dynamics`: what a tick of physics costs, phase by phase and over a whole trial.

mod engines;
mod heap;
mod mujoco;
mod trial;

use crate::{BenchFigure, BenchReport, quantile, thread_cpu_secs};
use mujoco::{MuJoCo, MujocoScenario};
use nalgebra::UnitQuaternion;
use proact_arm::ArmModel;
use proact_dynamics::{DynamicsOptions, PhysicsEngine, RigidBodyPlant};
use proact_testbed::ports::{Plant, PlantError};
use proact_types::{Object, PlantCommand, Pose, Scene, SceneObject, Shape, TICK_SECS, Vector, joints, zeros};
use std::{error::Error, time::Instant};

/// Height of the table top in the phases, metres.
const TABLE_HEIGHT_M: f64 = 1.015;

/// Physics of a method-D trial: phases built by hand, then every call of a real trial repeated on a fresh plant, with
/// our settings, with every joint free, and with ODE's iterative solver at Gazebo's fifty iterations; then a trial of each
/// method in both engines. About two minutes.
///
/// # Errors
/// A trial that cannot be put together or physics that fails.
pub fn dynamics() -> Result<BenchReport, Box<dyn Error>> {
    let mut figures = Vec::new();
    let peer = MuJoCo::find();
    phases(&mut figures, peer.as_ref().ok())?;
    let recorded = trial::record_method_d()?;
    trial::trial_figures(&recorded, peer.as_ref(), &mut figures)?;
    extra_blocks(&mut figures, peer.as_ref().ok())?;
    heap::heap(&mut figures, peer.as_ref().ok())?;
    engines::engines(&mut figures)?;
    Ok(BenchReport::new("dynamics", figures))
}

/// Puts what MuJoCo needs for the same run beside our figures called `name`.
fn compare(
    name: &str,
    peer: Option<&MuJoCo>,
    run: &MujocoScenario<'_>,
    figures: &mut [BenchFigure],
) -> Result<(), Box<dyn Error>> {
    let Some(peer) = peer else { return Ok(()) };
    for cost in peer.measure(std::slice::from_ref(run))? {
        for figure in figures.iter_mut() {
            let value = if figure.name == format!("{name}, times real time") {
                cost.real_time_factor
            } else if figure.name == format!("{name}, tick, median") {
                1e6 * cost.median_tick_secs
            } else {
                continue;
            };
            (figure.peer, figure.peer_value) = (Some(peer.name.clone()), Some(value));
        }
    }
    Ok(())
}

/// The mean tick of an arm that swings far from so many blocks that lie around, microseconds.
pub(crate) fn tick_among_blocks_us(count: u32, sleep: bool) -> Result<f64, Box<dyn Error>> {
    mean_tick_us(&proact_description::mpl_right_arm(), &blocks_around(count), sleep)
}

/// So many blocks on a large table.
fn blocks_around(count: u32) -> Scene {
    let mut scene = table_with_a_block();
    scene.fixed[0].shape = Shape::Box { size: [8.0, 8.0, 0.03] };
    let block = scene.objects[0].clone();
    let index =
        |k: u32| Pose::translation(0.1 * f64::from(k % 16), 0.1 * f64::from(k / 16), TABLE_HEIGHT_M + 0.025);
    scene.objects =
        (0..count).map(|k| Object { name: format!("block{k}"), pose: index(k), ..block.clone() }).collect();
    scene
}

/// Angles at the start of a swing, the base, and what is asked for in each tick.
type Swing = (Vec<f64>, Pose, Vec<PlantCommand>);

/// A second of it, far above a scene.
fn swing_far_above(model: &ArmModel) -> Result<Swing, Box<dyn Error>> {
    let open: Vec<f64> = [model.pose("arm", "start")?, model.pose("hand", "open")?].concat();
    let base = Pose::translation(0.0, 0.0, 3.0);
    let mut commands = swing_commands(model, &open, base);
    commands.truncate(1000);
    Ok((open, base, commands))
}

fn mean_tick_us(model: &ArmModel, scene: &Scene, sleep: bool) -> Result<f64, Box<dyn Error>> {
    let (open, base, commands) = swing_far_above(model)?;
    let options = DynamicsOptions { sleep, ..DynamicsOptions::default() };
    let mut plant = RigidBodyPlant::new(model, scene, &open, &base, options)?;
    let cost = TickTiming::measure(|| run_commands(&mut plant, &commands))?;
    Ok(1e6 * cost.cpu_secs / cost.tick_secs.len() as f64)
}

/// The arm beside up to 150 blocks that lie around, asleep and awake.
fn extra_blocks(figures: &mut Vec<BenchFigure>, peer: Option<&MuJoCo>) -> Result<(), Box<dyn Error>> {
    let model = proact_description::mpl_right_arm();
    let (open, _, commands) = swing_far_above(&model)?;
    for sleep in [true, false] {
        let mut first = 0.0;
        for count in [4_u32, 50, 150] {
            let scene = blocks_around(count);
            let micros = mean_tick_us(&model, &scene, sleep)?;
            let state = if sleep { "asleep" } else { "awake" };
            let name = format!("{count} blocks {state}, tick, mean");
            figures.push(BenchFigure::without_peer(&name, micros, "us", ""));
            if count == 4 {
                first = micros;
            } else {
                let each = (micros - first) / f64::from(count - 4);
                let name = format!("each further block of {count}, {state}");
                figures.push(BenchFigure::without_peer(&name, each, "us", "of a tick"));
            }
            if let (Some(peer), false) = (peer, sleep) {
                let run = MujocoScenario {
                    model: &model,
                    scene: &scene,
                    start: &open,
                    free_joints: (0..model.arm_count()).collect(),
                    commands: commands[..200].iter().collect(),
                    events: vec![],
                };
                for cost in peer.measure(&[run])? {
                    let value = 1e6 * TICK_SECS / cost.real_time_factor;
                    let figure = figures
                        .iter_mut()
                        .find(|figure| figure.name.starts_with(&format!("{count} blocks awake")));
                    if let Some(figure) = figure {
                        (figure.peer, figure.peer_value) = (Some(peer.name.clone()), Some(value));
                    }
                }
            }
        }
    }
    Ok(())
}

/// How often the hand closes: 600 ticks alone would make the slowest six of them, whatever interrupts those, the 99 %.
const CLOSINGS: usize = 10;

/// Hand merged and moving, hand closing, every joint free with a pinch, carrying.
fn phases(figures: &mut Vec<BenchFigure>, peer: Option<&MuJoCo>) -> Result<(), Box<dyn Error>> {
    let model = proact_description::mpl_right_arm();
    let open: Vec<f64> = [model.pose("arm", "start")?, model.pose("hand", "open")?].concat();
    let closed: Vec<f64> = [model.pose("arm", "start")?, model.pose("hand", "closed")?].concat();
    let base = base_around_block(&model, &open)?;
    let scene = table_with_a_block();

    // The arm swings above the table.
    let above = Pose::translation(0.0, 0.0, 0.3) * base;
    let mut plant = RigidBodyPlant::new(&model, &scene, &open, &above, DynamicsOptions::default())?;
    let swinging = swing_commands(&model, &open, above);
    let cost = TickTiming::measure(|| run_commands(&mut plant, &swinging))?;
    summarize("hand merged and moving", &cost, 80.0, "", figures);
    let run = MujocoScenario {
        model: &model,
        scene: &scene,
        start: &open,
        free_joints: vec![],
        commands: vec![],
        events: vec![],
    };
    let (arm, all): (Vec<_>, Vec<_>) =
        ((0..model.arm_count()).collect(), (0..model.moving_count()).collect());
    compare(
        "hand merged and moving",
        peer,
        &MujocoScenario { free_joints: arm, commands: swinging.iter().collect(), ..run.clone() },
        figures,
    )?;
    let mut plant = RigidBodyPlant::new(&model, &scene, &open, &above, ode_options(true))?;
    plain_ode_speed("hand merged and moving", &mut plant, &swinging, figures)?;

    // Closing, with and without merging what stands still, then a pinch that lasts, then lifting.
    let closing = close_commands(&model, &open, &closed, base);
    let pinch = vec![hold_command(&closed, base); 2000];
    let run = MujocoScenario { free_joints: all, ..run };
    for merged in [true, false] {
        let options = DynamicsOptions { lock_idle_hand: merged, ..DynamicsOptions::default() };
        let mut plants = (0..CLOSINGS)
            .map(|_| RigidBodyPlant::new(&model, &scene, &open, &base, options))
            .collect::<Result<Vec<RigidBodyPlant>, PlantError>>()?;
        let cost = TickTiming::measure(|| {
            let ticks = plants.iter_mut().map(|plant| run_commands(plant, &closing));
            Ok::<_, PlantError>(ticks.collect::<Result<Vec<_>, _>>()?.concat())
        })?;
        let mut plant = plants.pop().ok_or("no hand closed")?;
        if plant.state().contacts.is_empty() {
            return Err("the closing hand missed the block".into());
        }
        if !merged {
            let cost = TickTiming::measure(|| run_commands(&mut plant, &pinch))?;
            summarize("27 joints free with a pinch", &cost, 8.0, "", figures);
            let both = closing.iter().chain(&pinch).collect();
            compare(
                "27 joints free with a pinch",
                peer,
                &MujocoScenario { commands: both, ..run.clone() },
                figures,
            )?;
            let mut plant = RigidBodyPlant::new(&model, &scene, &open, &base, ode_options(false))?;
            run_commands(&mut plant, &closing)?;
            plain_ode_speed("27 joints free with a pinch", &mut plant, &pinch, figures)?;
            continue;
        }
        summarize("hand closing on a block", &cost, 20.0, "", figures);
        let alone = closing.iter().collect();
        compare(
            "hand closing on a block",
            peer,
            &MujocoScenario { commands: alone, ..run.clone() },
            figures,
        )?;

        plant.attach(0, model.tip)?;
        let held = plant.state().position.clone();
        let lifting = lift_commands(&held, base);
        let cost = TickTiming::measure(|| run_commands(&mut plant, &lifting))?;
        summarize("carrying", &cost, 80.0, "", figures);
        let commands = closing.iter().chain(&lifting).collect();
        let events = vec![(closing.len(), Some(0))];
        compare("carrying", peer, &MujocoScenario { commands, events, ..run.clone() }, figures)?;

        let mut plant = RigidBodyPlant::new(&model, &scene, &open, &base, ode_options(true))?;
        plain_ode_speed("hand closing on a block", &mut plant, &closing, figures)?;
        plant.attach(0, model.tip)?;
        plain_ode_speed("carrying", &mut plant, &lifting, figures)?;
    }
    Ok(())
}

/// The engine `ode`.
fn ode_options(hold_still_hand: bool) -> DynamicsOptions {
    DynamicsOptions {
        engine: PhysicsEngine::Ode,
        lock_idle_hand: hold_still_hand,
        ..DynamicsOptions::default()
    }
}

/// The speed of `plant`, whose engine is `ode`, under the same commands.
fn plain_ode_speed(
    name: &str,
    plant: &mut RigidBodyPlant,
    commands: &[PlantCommand],
    figures: &mut Vec<BenchFigure>,
) -> Result<(), PlantError> {
    let cost = TickTiming::measure(|| run_commands(plant, commands))?;
    figures.push(BenchFigure::without_peer(&format!("{name}, engine ode"), cost.real_time_factor(), "x", ""));
    Ok(())
}

/// Four seconds in which the joints of the arm swing by 0.1 rad.
fn swing_commands(model: &ArmModel, start: &[f64], base: Pose) -> Vec<PlantCommand> {
    let at = |tick: u32| {
        let time = f64::from(tick) * TICK_SECS;
        let mut command = hold_command(start, base);
        for k in 0..model.arm_count() {
            let amplitude = if k == 4 { -0.1 } else { 0.1 };
            command.position[k] += amplitude * (1.0 - time.cos());
            command.velocity[k] = amplitude * time.sin();
        }
        command
    };
    (1..=4000).map(at).collect()
}

/// The hand closes at 2 rad/s, in 0.6 s with what stands in its way.
fn close_commands(model: &ArmModel, open: &[f64], closed: &[f64], base: Pose) -> Vec<PlantCommand> {
    let mut command = hold_command(open, base);
    let mut next = || {
        for (k, closed) in closed.iter().enumerate().skip(model.arm_count()) {
            let increment = (closed - command.position[k]).clamp(-2e-3, 2e-3);
            command.position[k] += increment;
            command.velocity[k] = increment / TICK_SECS;
        }
        command.clone()
    };
    (0..600).map(|_| next()).collect()
}

/// The base rises by 0.1 m in two seconds.
fn lift_commands(held: &[f64], base: Pose) -> Vec<PlantCommand> {
    (1..=2000)
        .map(|tick| hold_command(held, Pose::translation(0.0, 0.0, 5e-5 * f64::from(tick)) * base))
        .collect()
}

fn run_commands(plant: &mut RigidBodyPlant, commands: &[PlantCommand]) -> Result<Vec<f64>, PlantError> {
    commands.iter().map(|command| step_secs(plant, command)).collect()
}

/// A block that stands at the origin of a table.
fn table_with_a_block() -> Scene {
    let slab = SceneObject {
        name: "slab".to_owned(),
        shape: Shape::Box { size: [1.0, 1.0, 0.03] },
        pose: Pose::translation(0.0, 0.0, TABLE_HEIGHT_M - 0.015),
        friction: 0.4,
    };
    let shape = Shape::Cylinder { radius: 0.025, length: 0.05 };
    let block = Object::with_default_friction(
        "red1",
        shape,
        0.1,
        Pose::translation(0.0, 0.0, TABLE_HEIGHT_M + 0.025),
    );
    Scene { fixed: vec![slab], objects: vec![block], table_height: TABLE_HEIGHT_M, ..Scene::default() }
}

/// The base at which the hand is around the block of [`table_with_a_block`], fingers ahead and rolled as it grips.
fn base_around_block(model: &ArmModel, positions: &[f64]) -> Result<Pose, PlantError> {
    let nothing = Scene { table_height: TABLE_HEIGHT_M, ..Scene::default() };
    let probe =
        RigidBodyPlant::new(model, &nothing, positions, &Pose::identity(), DynamicsOptions::default())?;
    let rotation =
        UnitQuaternion::from_euler_angles(model.widest_grasp().roll_rad, -1.0_f64.to_radians(), 0.0);
    let block = Vector::new(0.0, 0.0, TABLE_HEIGHT_M + 0.025);
    let world_from_tip = Pose::from_parts((block - rotation * model.widest_grasp().center).into(), rotation);
    Ok(world_from_tip * probe.link_pose(model.tip)?.inverse())
}

fn hold_command(positions: &[f64], base: Pose) -> PlantCommand {
    PlantCommand { position: joints(positions), velocity: zeros(positions.len()), world_from_base: base }
}

/// What some ticks cost.
#[derive(Clone, Debug, Default)]
struct TickTiming {
    /// Seconds of each tick by the wall clock.
    tick_secs: Vec<f64>,
    /// Seconds of all together on the core.
    cpu_secs: f64,
}

impl TickTiming {
    /// Of the steps that `run` takes.
    fn measure<E>(run: impl FnOnce() -> Result<Vec<f64>, E>) -> Result<Self, E> {
        let before = thread_cpu_secs();
        let ticks = run()?;
        Ok(Self { cpu_secs: thread_cpu_secs() - before, tick_secs: ticks })
    }

    /// Simulated seconds in a second of one core.
    fn real_time_factor(&self) -> f64 {
        self.tick_secs.len() as f64 * TICK_SECS / self.cpu_secs
    }
}

/// Seconds of one step.
fn step_secs(plant: &mut RigidBodyPlant, command: &PlantCommand) -> Result<f64, PlantError> {
    let begin = Instant::now();
    plant.step(command)?;
    Ok(begin.elapsed().as_secs_f64())
}

fn summarize(name: &str, cost: &TickTiming, goal: f64, note: &str, figures: &mut Vec<BenchFigure>) {
    for (what, share) in [("median", 0.5), ("99 %", 0.99), ("99.9 %", 0.999), ("worst", 1.0)] {
        let value = quantile(&cost.tick_secs, share) * 1e6;
        figures.push(BenchFigure::without_peer(&format!("{name}, tick, {what}"), value, "us", ""));
    }
    let separator = if note.is_empty() { "" } else { "; " };
    let note = format!("goal: at least {goal}{separator}{note}");
    figures.push(BenchFigure::without_peer(
        &format!("{name}, times real time"),
        cost.real_time_factor(),
        "x",
        &note,
    ));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_phase_reports_a_speed() {
        let mut figures = Vec::new();
        phases(&mut figures, None).unwrap();
        let speeds: Vec<&BenchFigure> = figures.iter().filter(|figure| figure.unit == "x").collect();
        assert_eq!(speeds.len(), 8);
        assert!(speeds.iter().all(|figure| figure.value.is_finite() && figure.value > 0.0));
    }
}
