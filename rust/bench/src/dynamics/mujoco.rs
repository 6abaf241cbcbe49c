//! The same scenes and commands in MuJoCo, for `proact bench dynamics`.
//!
//! MuJoCo's program is `tests/side_by_side/dynamics/mujoco_arm.py`, run by the Python that `PROACT_PEERS` names; its core
//! time is that of its step alone, without the Python around it.

use proact_arm::ArmModel;
use proact_types::{PlantCommand, Pose, Scene, Shape};
use serde_json::{Value, json};
use std::{
    io::Write as _,
    path::{Path, PathBuf},
    process::{Command, Stdio},
};

const PROGRAM: &str = include_str!("../../../../tests/side_by_side/dynamics/mujoco_arm.py");

/// One run: a scene, where the arm starts, and the commands.
#[derive(Clone)]
pub(super) struct MujocoScenario<'a> {
    pub(super) model: &'a ArmModel,
    pub(super) scene: &'a Scene,
    /// Moving joints, rad.
    pub(super) start: &'a [f64],
    /// Indices of the joints that can move; the others are one body with their parents.
    pub(super) free_joints: Vec<usize>,
    pub(super) commands: Vec<&'a PlantCommand>,
    /// Tick, and the block that is attached to the tip; none: it is let go.
    pub(super) events: Vec<(usize, Option<usize>)>,
}

/// What a run cost.
#[derive(Clone, Copy, Debug)]
pub(super) struct MujocoTiming {
    /// Simulated seconds in a second of one core.
    pub(super) real_time_factor: f64,
    /// Seconds.
    pub(super) median_tick_secs: f64,
}

/// MuJoCo, if it is there.
pub(super) struct MuJoCo {
    python: PathBuf,
    /// Such as `MujocoArm 3.17.0`.
    pub(super) name: String,
}

impl MuJoCo {
    /// Or why it is not there.
    pub(super) fn find() -> Result<Self, String> {
        let folder = std::env::var_os("PROACT_PEERS")
            .ok_or("MuJoCo not measured: ./proact peers gets it, PROACT_PEERS names its environment")?;
        let python = Path::new(&folder).join("bin/python3");
        let output = Command::new(&python).args(["-c", "import mujoco; print(mujoco.__version__)"]).output();
        match output {
            Ok(output) if output.status.success() => {
                let version = String::from_utf8_lossy(&output.stdout).trim().to_owned();
                Ok(Self { python, name: format!("MuJoCo {version}") })
            }
            _ => Err(format!("MuJoCo not measured: {} has none, ./proact peers gets it", python.display())),
        }
    }

    /// Runs one after the other.
    pub(super) fn measure(&self, runs: &[MujocoScenario<'_>]) -> Result<Vec<MujocoTiming>, String> {
        Ok(self.measure_with_final_poses(runs)?.into_iter().map(|(cost, _)| cost).collect())
    }

    /// [`MujocoArm::send_measurement`], with the poses of the blocks after each run.
    pub(super) fn measure_with_final_poses(
        &self,
        runs: &[MujocoScenario<'_>],
    ) -> Result<Vec<(MujocoTiming, Vec<Pose>)>, String> {
        let folder = std::env::temp_dir().join(format!("proact-bench-{}", std::process::id()));
        std::fs::create_dir_all(&folder).map_err(|error| error.to_string())?;
        let costs = self.run(runs, &folder);
        std::fs::remove_dir_all(&folder).map_err(|error| error.to_string())?;
        costs
    }

    fn run(
        &self,
        runs: &[MujocoScenario<'_>],
        folder: &Path,
    ) -> Result<Vec<(MujocoTiming, Vec<Pose>)>, String> {
        let mut problems = Vec::new();
        for (index, run) in runs.iter().enumerate() {
            let file = folder.join(format!("commands{index}.bin"));
            std::fs::write(&file, command_bytes(run)).map_err(|error| error.to_string())?;
            problems.push(scene_description(run, &file));
        }
        let mut child = Command::new(&self.python)
            .args(["-c", PROGRAM])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .map_err(|error| error.to_string())?;
        let text = Value::from(problems).to_string();
        if let Some(mut stdin) = child.stdin.take() {
            stdin.write_all(text.as_bytes()).map_err(|error| error.to_string())?;
        }
        let output = child.wait_with_output().map_err(|error| error.to_string())?;
        if !output.status.success() {
            let text = String::from_utf8_lossy(&output.stderr);
            return Err(format!("MuJoCo failed: {}", text.lines().last().unwrap_or("no message")));
        }
        let answers: Vec<Value> =
            serde_json::from_slice(&output.stdout).map_err(|error| error.to_string())?;
        let cost = |(run, answer): (&MujocoScenario<'_>, &Value)| {
            let secs = run.commands.len() as f64 * proact_types::TICK_SECS;
            let cost = MujocoTiming {
                real_time_factor: secs / answer["core_secs"].as_f64()?,
                median_tick_secs: answer["median_secs"].as_f64()?,
            };
            let ends: Vec<[f64; 7]> = serde_json::from_value(answer["end"].clone()).ok()?;
            Some((cost, ends.into_iter().map(pose_from_array).collect()))
        };
        runs.iter()
            .zip(&answers)
            .map(cost)
            .collect::<Option<_>>()
            .ok_or_else(|| "MuJoCo gave no times".to_owned())
    }
}

/// Commands as rows of positions, velocities and the base's pose.
fn command_bytes(run: &MujocoScenario<'_>) -> Vec<u8> {
    let row = |command: &&PlantCommand| {
        let mut numbers = [command.position.as_slice(), command.velocity.as_slice()].concat();
        numbers.extend(pose_to_array(&command.world_from_base));
        numbers
    };
    run.commands.iter().flat_map(row).flat_map(f64::to_ne_bytes).collect()
}

fn scene_description(run: &MujocoScenario<'_>, commands: &Path) -> Value {
    let model = run.model;
    let names: Vec<&str> = model.moving().map(|joint| model.joints[joint].name.as_str()).collect();
    let fastest: Vec<f64> = model.moving().map(|joint| model.joints[joint].limits.velocity).collect();
    let free: Vec<&str> = run.free_joints.iter().map(|&index| names[index]).collect();
    let fixed: Vec<Value> =
        run.scene.fixed.iter().map(|object| shape_description(&object.shape, &object.pose, 0.0)).collect();
    let blocks: Vec<Value> = run
        .scene
        .objects
        .iter()
        .map(|block| shape_description(&block.shape, &block.pose, block.mass))
        .collect();
    let events: Vec<Value> = run
        .events
        .iter()
        .map(|(tick, block)| {
            block.map_or_else(|| json!([tick, "release"]), |block| json!([tick, "attach", block]))
        })
        .collect();
    let base = run
        .commands
        .first()
        .map_or([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], |c| pose_to_array(&c.world_from_base));
    json!({
        "urdf": proact_description::MPL_RIGHT_ARM_URDF, "joints": names, "positions": run.start, "free": free,
        "limp": false, "base": base, "step": 1e-3, "integrator": "implicitfast", "drive": "speed",
        "fastest": fastest, "fixed": fixed, "blocks": blocks, "tip": model.links[model.tip].name,
        "commands": commands, "events": events, "every": 1_000_000_000,
    })
}

/// Of position and quaternion x, y, z, w.
fn pose_from_array([x, y, z, i, j, k, w]: [f64; 7]) -> Pose {
    let turn = nalgebra::Quaternion::new(w, i, j, k);
    Pose::from_parts(nalgebra::Translation3::new(x, y, z), nalgebra::UnitQuaternion::from_quaternion(turn))
}

fn pose_to_array(pose: &Pose) -> [f64; 7] {
    let (p, q) = (&pose.translation, &pose.rotation);
    [p.x, p.y, p.z, q.i, q.j, q.k, q.w]
}

fn shape_description(shape: &Shape, pose: &Pose, mass: f64) -> Value {
    let (kind, size) = match *shape {
        Shape::Box { size } => ("box", size.to_vec()),
        Shape::Sphere { radius } => ("sphere", vec![radius]),
        Shape::Cylinder { radius, length } => ("cylinder", vec![radius, length]),
        Shape::Capsule { radius, length } => ("capsule", vec![radius, length]),
    };
    json!({ "kind": kind, "size": size, "pose": pose_to_array(pose), "mass": mass })
}
