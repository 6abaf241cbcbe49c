//! Runs of the arm in MujocoArm, which builds it from the same URDF by a program of its own
//! (`tests/side_by_side/dynamics/mujoco_arm.py`).

#![allow(dead_code)] // each test program uses a part

use proact_types::{PlantCommand, Pose, Scene, Shape, Vector};
use serde::Deserialize;
use serde_json::{Value, json};
use std::{
    collections::BTreeMap,
    io::Write as _,
    path::{Path, PathBuf},
    process::{Command, Stdio},
};

/// MujocoArm's step, seconds: ten in a tick, as near to the truth as is needed here.
const FINE: f64 = 1e-4;

/// MujocoArm, if there is one.
pub struct MujocoArm {
    python: PathBuf,
}

/// How the arm is driven.
pub enum MujocoArmDrive<'a> {
    /// Without limits, damping and motors; the base at these poses.
    Undriven(&'a [PlantCommand]),
    /// By these torques of the joints that can move, each held for a tick.
    Torques(&'a [Vec<f64>]),
    /// By motors of bounded torque, under our law of control.
    Speeds(&'a [PlantCommand]),
}

/// One run.
pub struct MujocoArmRun<'a> {
    /// Of the file of commands.
    pub name: &'a str,
    /// Moving joints, rad.
    pub start: &'a [f64],
    /// The first so many joints can move; the others are one body with their parents.
    pub free: usize,
    /// Where the base stands; commands may move it.
    pub base: Pose,
    pub scene: &'a Scene,
    /// Of the scene's objects at the start, m/s.
    pub block_speeds: &'a [Vector],
    pub drive: MujocoArmDrive<'a>,
}

/// What MujocoArm says after each tick.
#[derive(Deserialize)]
pub struct MujocoArmTrace {
    /// Of the joints that can move, rad.
    pub angles: Vec<Vec<f64>>,
    /// Of their motors, the mean over the tick, N m.
    pub efforts: Vec<Vec<f64>>,
    /// Place of each block, metres, and its turn (x, y, z, w).
    pub blocks: Vec<Vec<[f64; 7]>>,
    /// Normal force on blocks by link, the mean over the tick, N.
    pub forces: Vec<BTreeMap<String, f64>>,
}

fn pose_numbers(pose: &Pose) -> [f64; 7] {
    let (p, q) = (&pose.translation, &pose.rotation);
    [p.x, p.y, p.z, q.i, q.j, q.k, q.w]
}

fn shape_json(shape: &Shape, pose: &Pose, mass: f64) -> Value {
    let (kind, size) = match *shape {
        Shape::Box { size } => ("box", size.to_vec()),
        Shape::Cylinder { radius, length } => ("cylinder", vec![radius, length]),
        ref other => panic!("no test has a {other:?}"),
    };
    json!({ "kind": kind, "size": size, "pose": pose_numbers(pose), "mass": mass })
}

impl MujocoArm {
    /// Says why there is none.
    pub fn find() -> Option<Self> {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
        let folder = std::env::var_os("PROACT_PEERS").map_or_else(|| root.join("build/peers"), PathBuf::from);
        let python = folder.join("bin/python3");
        let has = Command::new(&python).args(["-c", "import mujoco"]).output();
        if has.is_ok_and(|output| output.status.success()) {
            return Some(Self { python });
        }
        println!("skipped: no MujocoArm in {}; ./proact peers gets it", folder.display());
        None
    }

    pub fn run(&self, run: &MujocoArmRun<'_>) -> MujocoArmTrace {
        let model = proact_description::mpl_right_arm();
        let joints: Vec<&str> = model.moving().map(|joint| model.joints[joint].name.as_str()).collect();
        let fastest: Vec<f64> = model.moving().map(|joint| model.joints[joint].limits.velocity).collect();
        let row = |position: &[f64], velocity: &[f64], base: &Pose| {
            let mut numbers = vec![0.0; 2 * joints.len()];
            numbers[..position.len()].copy_from_slice(position);
            numbers[joints.len()..][..velocity.len()].copy_from_slice(velocity);
            numbers.extend(pose_numbers(base));
            numbers
        };
        let rows: Vec<Vec<f64>> = match run.drive {
            MujocoArmDrive::Undriven(commands) => {
                commands.iter().map(|c| row(&[], &[], &c.world_from_base)).collect()
            }
            MujocoArmDrive::Torques(torques) => {
                torques.iter().map(|torques| row(torques, &[], &run.base)).collect()
            }
            MujocoArmDrive::Speeds(commands) => {
                commands.iter().map(|c| row(&c.position, &c.velocity, &c.world_from_base)).collect()
            }
        };
        let bytes: Vec<u8> = rows.iter().flatten().flat_map(|number| number.to_ne_bytes()).collect();
        let file = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("mujoco_{}.bin", run.name));
        std::fs::write(&file, bytes).unwrap();
        let sways = rows.iter().any(|numbers| numbers[numbers.len() - 7..] != pose_numbers(&run.base));
        let fixed: Vec<Value> = run.scene.fixed.iter().map(|o| shape_json(&o.shape, &o.pose, 0.0)).collect();
        let blocks: Vec<Value> =
            run.scene.objects.iter().map(|o| shape_json(&o.shape, &o.pose, o.mass)).collect();
        let speeds: Vec<[f64; 3]> = run.block_speeds.iter().map(|speed| (*speed).into()).collect();
        // Motors as stiff as ours and hard contacts are too stiff for Runge and Kutta.
        let stiff = matches!(run.drive, MujocoArmDrive::Speeds(_)) || !blocks.is_empty();
        let problem = json!([{
            "urdf": proact_description::MPL_RIGHT_ARM_URDF, "joints": joints, "positions": run.start,
            "free": joints[..run.free], "limp": matches!(run.drive, MujocoArmDrive::Undriven(_)), "base": pose_numbers(&run.base),
            "step": FINE, "integrator": if stiff { "implicitfast" } else { "RK4" },
            "drive": if matches!(run.drive, MujocoArmDrive::Speeds(_)) { "speed" } else { "torque" },
            "fastest": fastest, "commands": file, "every": 1, "tell": true, "sways": sways, "hard": !blocks.is_empty(),
            "fixed": fixed, "blocks": blocks, "block_speeds": speeds,
        }]);
        let script =
            Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/side_by_side/dynamics/mujoco_arm.py");
        let mut child = Command::new(&self.python)
            .arg(script)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .expect("it has just run");
        child.stdin.take().expect("piped").write_all(problem.to_string().as_bytes()).unwrap();
        let output = child.wait_with_output().unwrap();
        assert!(output.status.success(), "mujoco_arm.py failed; its message is above");
        let [answer]: [MujocoArmTrace; 1] = serde_json::from_slice(&output.stdout).unwrap();
        answer
    }
}
