//! The two engines beside each other: a trial of each method in both, then the commands of one trial to both.

use super::trial::{Call, Recorded, SEED, record};
use super::{BenchFigure, Cost, quantile};
use proact_control::MethodRegistry;
use proact_dynamics::{DynamicsOptions, Engine};
use proact_testbed::{
    PhysicsConfig, Setup, TrialConfig,
    ports::{Plant, PlantError},
};
use proact_types::{PlantState, TICK_SECS};
use std::error::Error;

/// Fingers have pressed for this long when the grasp rule takes a block, so their forces are averaged over it, ticks.
const PRESSING: usize = 40;

fn options(engine: Engine) -> DynamicsOptions {
    DynamicsOptions { engine, ..DynamicsOptions::default() }
}

fn trial(method: &str, engine: Engine) -> Result<Recorded, Box<dyn Error>> {
    let physics = PhysicsConfig { engine, ..PhysicsConfig::default() };
    record(TrialConfig { physics, ..TrialConfig::new(method, SEED, Setup::named("seated")?) })
}

/// Simulated seconds in a second of one core, of the physics of a trial in its own engine.
fn speed(trial: &Recorded, engine: Engine) -> Result<f64, Box<dyn Error>> {
    let mut plant = trial.plant(options(engine))?;
    let cost = Cost::of(|| trial.repeat(&mut plant, usize::MAX))?;
    if *plant.state() != trial.last {
        return Err(format!("the trial repeated in the engine {engine:?} ends in another state").into());
    }
    Ok(cost.speed())
}

/// Largest distance between the places of a block in two states, metres.
fn blocks_apart(a: &PlantState, b: &PlantState) -> f64 {
    let places = a.objects.iter().zip(&b.objects);
    places.map(|(a, b)| (a.pose.translation.vector - b.pose.translation.vector).norm()).fold(0.0, f64::max)
}

/// What the commands of one trial do in both engines.
#[derive(Debug, Default)]
struct Same {
    /// Difference of the arm angle that differs most in a tick, rad: median, 99 % of ticks, largest.
    arm: [f64; 3],
    /// Root mean square of the difference of all hand angles, rad.
    hand: f64,
    /// Root mean square of the arm's torques in `reduced`, and of the difference, N m.
    efforts: [f64; 2],
    /// Mean sum of the forces of fingers on a block before it was taken, N: `reduced`, `ode`.
    forces: [f64; 2],
    /// Largest distance between the places of a block at the end, metres.
    blocks: f64,
}

/// Gives the calls of `trial` to a plant of each engine.
fn same_commands(trial: &Recorded) -> Result<Same, PlantError> {
    let mut plants = [trial.plant(options(Engine::Reduced))?, trial.plant(options(Engine::Ode))?];
    let arm = trial.model.arm_count();
    let hand = trial.model.moving_count() - arm;
    let mut same = Same::default();
    let mut pressed: Vec<[f64; 2]> = Vec::new();
    let mut arm_apart = Vec::new();
    let (mut squares, mut ticks, mut grasps) = ([0.0; 3], 0.0, 0.0);
    for call in &trial.calls {
        match call {
            Call::Step(command) => {
                for plant in &mut plants {
                    plant.step(command)?;
                }
                let [reduced, ode] = plants.each_ref().map(Plant::state);
                let angle = |k: usize| reduced.position[k] - ode.position[k];
                arm_apart.push((0..arm).map(|k| angle(k).abs()).fold(0.0, f64::max));
                squares[0] += (arm..arm + hand).map(|k| angle(k).powi(2)).sum::<f64>();
                squares[1] += reduced.effort[..arm].iter().map(|effort| effort.powi(2)).sum::<f64>();
                squares[2] += (0..arm).map(|k| (reduced.effort[k] - ode.effort[k]).powi(2)).sum::<f64>();
                ticks += 1.0;
                pressed.push(
                    [reduced, ode].map(|state| state.contacts.iter().map(|contact| contact.force).sum()),
                );
            }
            Call::Attach(block, link) => {
                let last = &pressed[pressed.len().saturating_sub(PRESSING)..];
                for (k, force) in same.forces.iter_mut().enumerate() {
                    *force += last.iter().map(|forces| forces[k]).sum::<f64>() / last.len().max(1) as f64;
                }
                grasps += 1.0;
                for plant in &mut plants {
                    plant.attach(*block, *link)?;
                }
            }
            Call::Release => plants.iter_mut().for_each(Plant::release),
        }
    }
    same.arm = [0.5, 0.99, 1.0].map(|share| quantile(&arm_apart, share));
    same.hand = (squares[0] / ticks / hand as f64).sqrt();
    same.efforts = [squares[1], squares[2]].map(|sum| (sum / ticks / arm as f64).sqrt());
    same.forces = same.forces.map(|sum| sum / f64::max(grasps, 1.0));
    same.blocks = blocks_apart(plants[0].state(), plants[1].state());
    Ok(same)
}

/// Times, angles, forces, and where blocks end, for the four methods.
pub(super) fn engines(figures: &mut Vec<BenchFigure>) -> Result<(), Box<dyn Error>> {
    for method in MethodRegistry::standard().names() {
        let (reduced, ode) = (trial(method, Engine::Reduced)?, trial(method, Engine::Ode)?);
        let mut add = |what: &str, unit: &str, value: f64, peer: Option<f64>, note: &str| {
            let figure = BenchFigure::alone(&format!("engines, {method}, {what}"), value, unit, note);
            figures.push(match peer {
                Some(peer) => figure.beside("engine ode", peer),
                None => figure,
            });
        };
        let note = format!("seed {SEED}, seated, each engine its own trial");
        let on_target = [&reduced, &ode].map(|trial| trial.result.score);
        add("blocks on target", "1", on_target[0], Some(on_target[1]), &note);
        let seconds = [&reduced, &ode].map(|trial| trial.result.sim_seconds);
        add("length", "s", seconds[0], Some(seconds[1]), &note);
        let speeds = [speed(&reduced, Engine::Reduced)?, speed(&ode, Engine::Ode)?];
        add("times real time", "x", speeds[0], Some(speeds[1]), "goal: at least 1; the physics alone");
        let between = 1e3 * blocks_apart(&reduced.last, &ode.last);
        add("blocks apart at the end", "mm", between, None, &note);

        let same = same_commands(&reduced)?;
        let note = "the commands of the trial in reduced to both";
        for (which, angle) in ["median", "99 %", "largest"].into_iter().zip(same.arm) {
            add(&format!("arm angles apart, {which}"), "rad", angle, None, note);
        }
        add("hand angles apart, root mean square", "rad", same.hand, None, note);
        let note_efforts = format!("{note}; the torques themselves {:.3} N m", same.efforts[0]);
        add("arm torques apart, root mean square", "N m", same.efforts[1], None, &note_efforts);
        let note_forces =
            format!("{note}; mean of the last {} s before a grasp", PRESSING as f64 * TICK_SECS);
        add("force of the fingers", "N", same.forces[0], Some(same.forces[1]), &note_forces);
        add("same commands, blocks apart at the end", "mm", 1e3 * same.blocks, None, note);
    }
    Ok(())
}
