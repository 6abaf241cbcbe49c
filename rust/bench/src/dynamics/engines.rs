//! The two engines beside each other: a trial of each method in both, then the commands of one trial to both.

use super::trial::{PlantCall, PlantRecording, SEED, record};
use super::{BenchFigure, TickTiming, quantile};
use proact_control::MethodRegistry;
use proact_dynamics::{DynamicsOptions, PhysicsEngine};
use proact_testbed::{
    PhysicsConfig, Setup, TrialConfig,
    ports::{Plant, PlantError},
};
use proact_types::{PlantState, TICK_SECS};
use std::error::Error;

/// Fingers have pressed for this long when the grasp rule takes a block, so their forces are averaged over it, ticks.
const PRESS_TICKS: usize = 40;

fn options(engine: PhysicsEngine) -> DynamicsOptions {
    DynamicsOptions { engine, ..DynamicsOptions::default() }
}

fn record_trial(method: &str, engine: PhysicsEngine) -> Result<PlantRecording, Box<dyn Error>> {
    let physics = PhysicsConfig { engine, ..PhysicsConfig::default() };
    record(TrialConfig { physics, ..TrialConfig::new(method, SEED, Setup::named("seated")?) })
}

/// Simulated seconds in a second of one core, of the physics of a trial in its own engine.
fn real_time_factor(trial: &PlantRecording, engine: PhysicsEngine) -> Result<f64, Box<dyn Error>> {
    let mut plant = trial.plant(options(engine))?;
    let cost = TickTiming::measure(|| trial.replay_calls(&mut plant, usize::MAX))?;
    if *plant.state() != trial.final_state {
        return Err(format!("the trial repeated in the engine {engine:?} ends in another state").into());
    }
    Ok(cost.real_time_factor())
}

/// Largest distance between the places of a block in two states, metres.
fn max_block_distance_m(a: &PlantState, b: &PlantState) -> f64 {
    let object_pairs = a.objects.iter().zip(&b.objects);
    object_pairs
        .map(|(a, b)| (a.pose.translation.vector - b.pose.translation.vector).norm())
        .fold(0.0, f64::max)
}

/// What the commands of one trial do in both engines.
#[derive(Debug, Default)]
struct EngineDifference {
    /// Difference of the arm angle that differs most in a tick, rad: median, 99 % of ticks, largest.
    arm_rad: [f64; 3],
    /// Root mean square of the difference of all hand angles, rad.
    hand_rms_rad: f64,
    /// Root mean square of the arm's torques in `reduced`, and of the difference, N m.
    effort_rms_nm: [f64; 2],
    /// Mean sum of the forces of fingers on a block before it was taken, N: `reduced`, `ode`.
    finger_force_n: [f64; 2],
    /// Largest distance between the places of a block at the end, metres.
    block_distance_m: f64,
}

/// Gives the calls of `trial` to a plant of each engine.
fn compare_engines(trial: &PlantRecording) -> Result<EngineDifference, PlantError> {
    let mut plants =
        [trial.plant(options(PhysicsEngine::Reduced))?, trial.plant(options(PhysicsEngine::Ode))?];
    let arm = trial.model.arm_count();
    let hand = trial.model.moving_count() - arm;
    let mut same = EngineDifference::default();
    let mut pressed: Vec<[f64; 2]> = Vec::new();
    let mut arm_differences = Vec::new();
    let (mut squares, mut ticks, mut grasps) = ([0.0; 3], 0.0, 0.0);
    for call in &trial.calls {
        match call {
            PlantCall::Step(command) => {
                for plant in &mut plants {
                    plant.step(command)?;
                }
                let [reduced, ode] = plants.each_ref().map(Plant::state);
                let angle = |k: usize| reduced.position[k] - ode.position[k];
                arm_differences.push((0..arm).map(|k| angle(k).abs()).fold(0.0, f64::max));
                squares[0] += (arm..arm + hand).map(|k| angle(k).powi(2)).sum::<f64>();
                squares[1] += reduced.effort[..arm].iter().map(|effort| effort.powi(2)).sum::<f64>();
                squares[2] += (0..arm).map(|k| (reduced.effort[k] - ode.effort[k]).powi(2)).sum::<f64>();
                ticks += 1.0;
                pressed.push(
                    [reduced, ode].map(|state| state.contacts.iter().map(|contact| contact.force).sum()),
                );
            }
            PlantCall::Attach(block, link) => {
                let last = &pressed[pressed.len().saturating_sub(PRESS_TICKS)..];
                for (k, force) in same.finger_force_n.iter_mut().enumerate() {
                    *force += last.iter().map(|forces| forces[k]).sum::<f64>() / last.len().max(1) as f64;
                }
                grasps += 1.0;
                for plant in &mut plants {
                    plant.attach(*block, *link)?;
                }
            }
            PlantCall::Release => plants.iter_mut().for_each(Plant::release),
        }
    }
    same.arm_rad = [0.5, 0.99, 1.0].map(|share| quantile(&arm_differences, share));
    same.hand_rms_rad = (squares[0] / ticks / hand as f64).sqrt();
    same.effort_rms_nm = [squares[1], squares[2]].map(|sum| (sum / ticks / arm as f64).sqrt());
    same.finger_force_n = same.finger_force_n.map(|sum| sum / f64::max(grasps, 1.0));
    same.block_distance_m = max_block_distance_m(plants[0].state(), plants[1].state());
    Ok(same)
}

/// Times, angles, forces, and where blocks end, for the four methods.
pub(super) fn engines(figures: &mut Vec<BenchFigure>) -> Result<(), Box<dyn Error>> {
    for method in MethodRegistry::standard().names() {
        let (reduced, ode) =
            (record_trial(method, PhysicsEngine::Reduced)?, record_trial(method, PhysicsEngine::Ode)?);
        let mut add = |what: &str, unit: &str, value: f64, peer: Option<f64>, note: &str| {
            let figure = BenchFigure::without_peer(&format!("engines, {method}, {what}"), value, unit, note);
            figures.push(match peer {
                Some(peer) => figure.with_peer("engine ode", peer),
                None => figure,
            });
        };
        let note = format!("seed {SEED}, seated, each engine its own trial");
        let on_target = [&reduced, &ode].map(|trial| trial.result.score);
        add("blocks on target", "1", on_target[0], Some(on_target[1]), &note);
        let seconds = [&reduced, &ode].map(|trial| trial.result.sim_seconds);
        add("length", "s", seconds[0], Some(seconds[1]), &note);
        let speeds = [
            real_time_factor(&reduced, PhysicsEngine::Reduced)?,
            real_time_factor(&ode, PhysicsEngine::Ode)?,
        ];
        add("times real time", "x", speeds[0], Some(speeds[1]), "goal: at least 1; the physics alone");
        let between = 1e3 * max_block_distance_m(&reduced.final_state, &ode.final_state);
        add("blocks apart at the end", "mm", between, None, &note);

        let same = compare_engines(&reduced)?;
        let note = "the commands of the trial in reduced to both";
        for (which, angle) in ["median", "99 %", "largest"].into_iter().zip(same.arm_rad) {
            add(&format!("arm angles apart, {which}"), "rad", angle, None, note);
        }
        add("hand angles apart, root mean square", "rad", same.hand_rms_rad, None, note);
        let note_efforts = format!("{note}; the torques themselves {:.3} N m", same.effort_rms_nm[0]);
        add("arm torques apart, root mean square", "N m", same.effort_rms_nm[1], None, &note_efforts);
        let note_forces =
            format!("{note}; mean of the last {} s before a grasp", PRESS_TICKS as f64 * TICK_SECS);
        add("force of the fingers", "N", same.finger_force_n[0], Some(same.finger_force_n[1]), &note_forces);
        add("same commands, blocks apart at the end", "mm", 1e3 * same.block_distance_m, None, note);
    }
    Ok(())
}
