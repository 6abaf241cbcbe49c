//! The undriven and the driven arm beside MuJoCo, which builds the same arm from the same URDF by a program of its own.
//! Skipped without MuJoCo: `./proact peers` gets it.

#![allow(missing_docs)]
#![allow(clippy::unwrap_used)]
#![allow(clippy::disallowed_methods)] // MuJoCo reads its commands from a file

mod common;

use common::{START, bare_table, plant_at, positions, stay, still};
use proact_arm::ArmModel;
use proact_dynamics::{DynamicsOptions, Engine, OdePlant};
use proact_testbed::ports::Plant;
use proact_types::{PlantCommand, Scene};
use serde_json::{Value, json};
use std::{
    f64::consts::{PI, TAU},
    io::Write as _,
    path::{Path, PathBuf},
    process::{Command, Stdio},
};

/// MuJoCo's step, seconds: ten in a tick, as near to the truth as is needed here.
const FINE: f64 = 1e-4;

/// The Python that has MuJoCo, if there is one.
fn python() -> Option<PathBuf> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let folder = std::env::var_os("PROACT_PEERS").map_or_else(|| root.join("build/peers"), PathBuf::from);
    let python = folder.join("bin/python3");
    let has = Command::new(&python).args(["-c", "import mujoco"]).output();
    if has.is_ok_and(|output| output.status.success()) {
        return Some(python);
    }
    println!("skipped: no MuJoCo in {}; ./proact peers gets it", folder.display());
    None
}

/// How MuJoCo's arm is driven.
enum Drive<'a> {
    /// Without limits, damping and motors.
    Limp { ticks: usize },
    /// By these torques, each held for a tick.
    Torques(&'a [Vec<f64>]),
    /// By motors of bounded torque, under our law of control.
    Speeds(&'a [PlantCommand]),
}

/// Joint angles of MuJoCo's arm after every tick.
fn mujoco(python: &Path, name: &str, start: &[f64], drive: &Drive<'_>) -> Vec<Vec<f64>> {
    let model = proact_description::mpl_right_arm();
    let joints: Vec<&str> = model.moving().map(|joint| model.joints[joint].name.as_str()).collect();
    let fastest: Vec<f64> = model.moving().map(|joint| model.joints[joint].limits.velocity).collect();
    let base = [-0.39, 0.12, 1.5, 0.0, 0.0, 0.0, 1.0];
    let row = |position: &[f64], velocity: &[f64]| {
        let mut numbers = vec![0.0; 2 * joints.len()];
        numbers[..position.len()].copy_from_slice(position);
        numbers[joints.len()..][..velocity.len()].copy_from_slice(velocity);
        numbers.extend(base);
        numbers
    };
    let rows: Vec<Vec<f64>> = match drive {
        Drive::Limp { ticks } => vec![row(&[], &[]); *ticks],
        Drive::Torques(torques) => torques.iter().map(|torques| row(torques, &[])).collect(),
        Drive::Speeds(commands) => commands.iter().map(|c| row(&c.position, &c.velocity)).collect(),
    };
    let bytes: Vec<u8> = rows.iter().flatten().flat_map(|number| number.to_ne_bytes()).collect();
    let file = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("mujoco_{name}.bin"));
    std::fs::write(&file, bytes).unwrap();
    let speeds = matches!(drive, Drive::Speeds(_));
    let problem = json!([{
        "urdf": proact_description::MPL_RIGHT_ARM_URDF, "joints": joints, "positions": start, "free": joints[..7],
        "limp": matches!(drive, Drive::Limp { .. }), "base": base, "step": FINE,
        // Motors as stiff as ours are too stiff for Runge and Kutta.
        "integrator": if speeds { "implicitfast" } else { "RK4" }, "drive": if speeds { "speed" } else { "torque" },
        "fastest": fastest, "commands": file, "every": 1,
    }]);
    let script =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/side_by_side/dynamics/mujoco_arm.py");
    let mut child = Command::new(python)
        .arg(script)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .expect("it has just run");
    child.stdin.take().expect("piped").write_all(problem.to_string().as_bytes()).unwrap();
    let output = child.wait_with_output().unwrap();
    assert!(output.status.success(), "mujoco_arm.py failed; its message is above");
    let answer: Value = serde_json::from_slice(&output.stdout).unwrap();
    serde_json::from_value(answer[0]["angles"].clone()).unwrap()
}

/// Largest difference of an arm joint up to a tick, whole turns apart, rad.
fn difference(ours: &[Vec<f64>], theirs: &[Vec<f64>], ticks: usize) -> f64 {
    let apart = |a: f64, b: f64| ((a - b + PI).rem_euclid(TAU) - PI).abs();
    let rows = ours.iter().zip(theirs).take(ticks);
    rows.flat_map(|(a, b)| (0..7).map(move |k| apart(a[k], b[k]))).fold(0.0, f64::max)
}

fn nothing() -> Scene {
    Scene { fixed: Vec::new(), ..bare_table(Vec::new()) }
}

fn limp(mut model: ArmModel) -> ArmModel {
    for joint in &mut model.joints {
        (joint.damping, joint.friction, joint.limits.effort) = (0.0, 0.0, 0.0);
        (joint.limits.lower, joint.limits.upper) = (f64::NEG_INFINITY, f64::INFINITY);
    }
    model
}

/// Angles of the limp arm, hand merged, for a second.
fn fall(start: &[f64], engine: Engine) -> Vec<Vec<f64>> {
    let model = limp(proact_description::mpl_right_arm());
    let options = DynamicsOptions { engine, ..DynamicsOptions::default() };
    let mut plant = OdePlant::new(&model, &nothing(), start, &still(), options).unwrap();
    let command = stay(start, still());
    (0..1000)
        .map(|_| {
            plant.step(&command).unwrap();
            plant.state().position.to_vec()
        })
        .collect()
}

/// Half a second of falling, in which joints turn by up to two radians; found 3e-4 rad.
const UNDRIVEN_BOUND: f64 = 1e-3;
/// A tenth of a second under given torques, rad.
const TORQUES_BOUND: f64 = 1e-3;
/// Two seconds under the same law of control, rad.
const CONTROLLED_BOUND: f64 = 1e-3;

#[test]
fn an_undriven_arm_falls_as_in_mujoco() {
    let Some(python) = python() else { return };
    let model = proact_description::mpl_right_arm();
    for (name, arm) in [("start", START), ("stretched", [1.2, -0.2, 0.3, 0.2, 0.1, 0.1, 0.1])] {
        let start = positions(&model, &arm, "open");
        let theirs = mujoco(&python, name, &start, &Drive::Limp { ticks: 1000 });
        let reduced = fall(&start, Engine::Reduced);
        let ode = fall(&start, Engine::Ode);
        for ticks in [250, 500, 1000] {
            println!(
                "{name}, {ticks} ms: reduced {:.1e} rad, ode {:.1e} rad",
                difference(&reduced, &theirs, ticks),
                difference(&ode, &theirs, ticks)
            );
        }
        // Seven limp joints are chaotic: what differs at first grows tenfold in a few tenths of a second.
        assert!(difference(&reduced, &theirs, 500) < UNDRIVEN_BOUND);
    }
}

#[test]
fn a_driven_arm_moves_as_in_mujoco() {
    let Some(python) = python() else { return };
    let model = proact_description::mpl_right_arm();
    let start = positions(&model, &START, "open");
    let commands: Vec<PlantCommand> = (1..=2000)
        .map(|tick| {
            let time = f64::from(tick) * 1e-3;
            let mut command = stay(&start, still());
            for k in 0..7 {
                let way = if k == 4 { -0.1 } else { 0.1 };
                command.position[k] += way * (1.0 - (2.0 * time).cos());
                command.velocity[k] = 2.0 * way * (2.0 * time).sin();
            }
            command
        })
        .collect();
    let mut plant = plant_at(&model, &nothing(), &start, &still()).unwrap();
    let (mut ours, mut torques) = (Vec::new(), Vec::new());
    for command in &commands {
        plant.step(command).unwrap();
        ours.push(plant.state().position.to_vec());
        torques.push(plant.state().effort[..7].to_vec());
    }
    let moved = ours.iter().map(|angles| (angles[0] - start[0]).abs()).fold(0.0, f64::max);
    assert!(moved > 0.15, "the arm moves: {moved} rad");

    // Torques alone hold no arm that stands against gravity, so that differences grow here as well.
    let theirs = mujoco(&python, "torques", &start, &Drive::Torques(&torques));
    for ticks in [100, 300, 1000] {
        println!("the same torques, {ticks} ms: {:.1e} rad", difference(&ours, &theirs, ticks));
    }
    assert!(difference(&ours, &theirs, 100) < TORQUES_BOUND);

    let theirs = mujoco(&python, "control", &start, &Drive::Speeds(&commands));
    let worst = difference(&ours, &theirs, 2000);
    println!("the same control, 2 s: {worst:.1e} rad");
    assert!(worst < CONTROLLED_BOUND, "{worst} rad apart");
}
