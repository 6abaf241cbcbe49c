//! `proact query`: kinematics, dynamics, plans and collisions of an arm, one JSON object a line in, one out.
//!
//! | `op` | keys | answer |
//! |---|---|---|
//! | `fk` | `q` | `position`, `quaternion` |
//! | `jacobian` | `q` | `jacobian`: 6 rows, linear first |
//! | `condition` | `q` | `condition` (null when infinite), `sigma`: 6 singular values |
//! | `inverse_dynamics` | `q`, `qd`, `qdd`, `hand` | `tau` of the arm joints, hand's mass included |
//! | `ik` | `position`, `quaternion`, `seed` | `status`: `ok` or `unreachable`, `q` or null |
//! | `plan` | `start`, `goal_q` or `goal_pose`, `scene`, `base_pose`, `hand`, `attached`, `seed`, `planner`, `parameters`, `roadmap` | `status`, `path`, `times`, `reason`, `clearance`, `words`, `iterations`, `wall_secs` |
//! | `roadmap` | `milestones` (how many), `scene`, `base_pose`, `hand`, `seed` | `milestones`, `edges` |
//! | `collision` | `q`, `scene`, `base_pose`, `hand` | `collision`, `pairs` |
//!
//! SI units, radians, quaternions x, y, z, w. Poses of the tip, `goal_pose` too, are in the base link; gravity is
//! 9.80665 m/s^2 along -z of the base link. `q` has one angle for each arm joint, `hand` one for each hand joint in
//! the order of its group: without it the hand is open as the arm's SRDF says if the arm was named with `--arm`, and at zero otherwise. The `seed` of `ik` is either the angles from which the search starts or a whole number
//! that picks some; without it the search starts in the middle of the limits.
//!
//! `scene` is `empty`, `box` (table, walls, partition), `clutter` (the same with four blocks) or a list of
//! `{"name", "shape": {"type": "box", "size": [x, y, z]}, "position", "quaternion"}`, with the shapes of
//! [`proact_types::FeatureShape`] or `{"type": "mesh", "vertices": [[x, y, z], ..], "triangles": [[0, 1, 2], ..]}`, placed in `world`. `base_pose` is `world_from_base` as `{"position", "quaternion"}`; without it the
//! shoulder is where the set-up `still` has it for `box` and `clutter`, and at the origin otherwise.
//!
//! `planner` is a name of OMPL's (`RRTConnect` if left out), `parameters` an object of its parameters. `attached` is a
//! list of at most one shape in the tip's frame: what the hand carries. `roadmap` names a file that holds an answer to the
//! question of that name: `PRM` begins with it. `words` say in at most five how it ended.
//!
//! A line that cannot be answered gives `{"error": ".."}`; the stream goes on.

mod scene;

use crate::{Arm, ArmError};
use nalgebra::{Quaternion, Translation3, UnitQuaternion, Vector3};
use proact_arm::{ArmModel, OPEN_POSE};
use proact_description::{DescriptionError, ImportOptions, MeshFolders};
use proact_kinematics::{ArmKinematics, IkOutcome, Kinematics, KinematicsError};
use proact_planning::{ArmPlanner, PlannerName, PlannerOptions, Roadmap, status_label};
use proact_types::{
    JointVector, LineRead, PlanGoal, PlanRequest, Pose, Vector, joints, read_bytes, read_line, zeros,
};
use scene::{QueryScene, ShapeEntry, parse_attached};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::io::{BufRead, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Gravity in the base link, m/s^2.
const GRAVITY: Vector = Vector::new(0.0, 0.0, -9.80665);
/// Most milestones of a roadmap: beyond it each plan would spend its time on taking the roadmap in.
const MAX_MILESTONES: usize = 100_000;
/// Longest question, bytes: a mesh of some ten thousand triangles.
const MAX_LINE_BYTES: usize = 4 << 20;
/// Longest file of a roadmap, bytes: twice what the most milestones take.
const MAX_ROADMAP_BYTES: usize = 256 << 20;
/// A quaternion whose length is further from one than this is a mistake rather than rounding.
const QUATERNION_TOLERANCE: f64 = 1e-3;

/// Which arm is asked about. Everything left out: the MPL right arm, `base_link` to its wrist.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct QueryOptions {
    /// An arm as trials take it: its folder, or the name of one that ships with the program.
    pub arm: Option<String>,
    /// A URDF file alone; one that is not complete is completed as an import does.
    pub urdf: Option<PathBuf>,
    /// First link of the chain; the model's root if left out.
    pub base: Option<String>,
    /// Last link of the chain; the end of the model's arm if left out.
    pub tip: Option<String>,
}

/// Why no line could be answered, or none any more.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum QueryError {
    /// The arm's folder.
    #[error(transparent)]
    Arm(#[from] ArmError),
    /// The description is not usable, or has no such link.
    #[error(transparent)]
    Description(#[from] DescriptionError),
    /// The arm is not one that the kinematics takes.
    #[error(transparent)]
    Kinematics(#[from] KinematicsError),
    /// The input ended with an error, or nobody reads the output.
    #[error("reading questions or writing answers: {0}")]
    Stream(#[from] std::io::Error),
}

/// The arm of a URDF file: as it is, or completed as an import does, without a gripper that it does not have.
fn load_or_import(file: &Path) -> Result<ArmModel, QueryError> {
    let text = proact_description::read_text(file)?;
    if let Ok(model) = proact_description::parse_urdf(&text) {
        return Ok(model);
    }
    let meshes = MeshFolders::with_ros_packages(file, &[]);
    let options = ImportOptions { meshes: Some(&meshes), without_gripper: true, ..ImportOptions::default() };
    let imported = proact_description::import(&text, &options);
    imported
        .map(|imported| imported.model)
        .map_err(|source| ArmError::Description { path: file.to_owned(), source }.into())
}

/// Answers every line of `input` on a line of `output`, until the input ends. Empty lines are passed over.
///
/// # Errors
/// [`QueryError`] if the arm cannot be used or a stream breaks. Bad lines are answered, not returned.
pub fn run(options: QueryOptions, mut input: impl BufRead, mut output: impl Write) -> Result<(), QueryError> {
    let mut handler = QueryHandler::new(&options)?;
    let mut line = Vec::new();
    // Bytes, not text: a line that is not UTF-8 is one more bad line.
    loop {
        let answer = match read_line(&mut input, MAX_LINE_BYTES, &mut line)? {
            LineRead::End => break,
            LineRead::Complete if line.trim_ascii().is_empty() => None,
            LineRead::Complete => Some(handler.handle_line(&line)),
            LineRead::TooLong => {
                input.skip_until(b'\n')?;
                Some(Err(format!("the line has more than {MAX_LINE_BYTES} bytes, expected at most that")))
            }
        };
        if let Some(answer) = answer {
            let answer = answer.unwrap_or_else(|error| json!({ "error": error }));
            writeln!(output, "{}", proact_types::to_json(&answer).map_err(std::io::Error::from)?)?;
            // Whoever asks may wait for the answer before asking on.
            output.flush()?;
        }
    }
    Ok(())
}

#[derive(Debug, Deserialize)]
#[serde(tag = "op", rename_all = "snake_case", deny_unknown_fields)]
enum Query {
    Fk { q: Vec<f64> },
    Jacobian { q: Vec<f64> },
    Condition { q: Vec<f64> },
    InverseDynamics { q: Vec<f64>, qd: Vec<f64>, qdd: Vec<f64>, hand: Option<Vec<f64>> },
    Ik { position: [f64; 3], quaternion: [f64; 4], seed: Option<Value> },
    Plan(PlanQuery),
    Roadmap(RoadmapQuery),
    Collision { q: Vec<f64>, scene: Value, base_pose: Option<PoseEntry>, hand: Option<Vec<f64>> },
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct RoadmapQuery {
    milestones: usize,
    scene: Value,
    base_pose: Option<PoseEntry>,
    hand: Option<Vec<f64>>,
    #[serde(default)]
    seed: u64,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct PlanQuery {
    start: Vec<f64>,
    goal_q: Option<Vec<f64>>,
    goal_pose: Option<PoseEntry>,
    scene: Value,
    base_pose: Option<PoseEntry>,
    #[serde(default)]
    seed: u64,
    /// OMPL's name; the default planner if left out.
    planner: Option<String>,
    /// Its parameters by OMPL's names.
    #[serde(default)]
    parameters: std::collections::BTreeMap<String, Value>,
    /// File with what PRM begins with.
    roadmap: Option<PathBuf>,
    hand: Option<Vec<f64>>,
    /// What the hand carries, in the tip's frame: a list, of one thing at most.
    #[serde(default)]
    attached: Vec<ShapeEntry>,
}

#[derive(Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
struct PoseEntry {
    position: [f64; 3],
    #[serde(default = "identity_quaternion")]
    quaternion: [f64; 4],
}

fn identity_quaternion() -> [f64; 4] {
    [0.0, 0.0, 0.0, 1.0]
}

/// Who answers: the arm, and a planner from the first question that needs one.
pub struct QueryHandler {
    model: Arc<ArmModel>,
    kinematics: Kinematics,
    planner: Option<ArmPlanner>,
    /// Positions of the hand's joints where a question has none.
    default_hand: Vec<f64>,
}

impl QueryHandler {
    fn new(options: &QueryOptions) -> Result<Self, QueryError> {
        let mut model = match (&options.arm, &options.urdf) {
            (Some(arm), _) => (**Arm::load(arm)?.model()).clone(),
            (None, Some(file)) => load_or_import(file)?,
            (None, None) => proact_description::mpl_right_arm(),
        };
        if options.base.is_some() || options.tip.is_some() {
            let base = options.base.as_ref().unwrap_or(&model.links[0].name);
            let tip = options.tip.as_ref().unwrap_or(&model.links[model.tip].name);
            model = proact_description::select_chain(&model, base, tip)?;
        }
        let open = model.pose("hand", OPEN_POSE).map(<[f64]>::to_vec);
        let mut handler = Self::for_model(model)?;
        if let (Some(_), Ok(open)) = (&options.arm, open) {
            handler.default_hand = open;
        }
        Ok(handler)
    }

    /// Who answers for the arm `model`.
    ///
    /// # Errors
    /// An arm that the kinematics does not take.
    pub fn for_model(model: ArmModel) -> Result<Self, QueryError> {
        let kinematics = Kinematics::new(&model)?;
        let default_hand = vec![0.0; model.hand.len()];
        Ok(Self { model: Arc::new(model), kinematics, planner: None, default_hand })
    }

    /// The answer to a question, one JSON object.
    ///
    /// # Errors
    /// What is wrong with the question, as the stream of answers has it under `error`.
    pub fn handle_line(&mut self, line: &[u8]) -> Result<Value, String> {
        let object: serde_json::Map<String, Value> = serde_json::from_slice(line).map_err(|error| {
            format!(
                "{error}; expected one JSON object such as {{\"op\": \"fk\", \"q\": [0, 0, 0, 0, 0, 0, 0]}}"
            )
        })?;
        match serde_json::from_value(Value::Object(object)).map_err(error_text)? {
            Query::Fk { q } => {
                let pose = self.kinematics.forward(&q).map_err(error_text)?;
                Ok(json!(PoseEntry {
                    position: pose.translation.vector.into(),
                    quaternion: pose.rotation.coords.into(),
                }))
            }
            Query::Jacobian { q } => {
                let jacobian = self.kinematics.jacobian(&q).map_err(error_text)?;
                let rows: Vec<Vec<f64>> =
                    jacobian.row_iter().map(|row| row.iter().copied().collect()).collect();
                Ok(json!({ "jacobian": rows }))
            }
            Query::Condition { q } => {
                let (condition, sigma) = self.kinematics.condition(&q).map_err(error_text)?;
                Ok(json!({ "condition": condition, "sigma": sigma }))
            }
            Query::InverseDynamics { q, qd, qdd, hand } => self.inverse_dynamics(&q, &qd, &qdd, hand),
            Query::Ik { position, quaternion, seed } => {
                let target = pose(position, quaternion)?;
                let start = self.ik_seed(seed)?;
                Ok(match self.kinematics.inverse(&target, &start).map_err(error_text)? {
                    IkOutcome::Solved(q) => json!({ "status": "ok", "q": q.as_slice() }),
                    IkOutcome::NotFound => json!({ "status": "unreachable", "q": null }),
                })
            }
            Query::Plan(question) => self.plan(question),
            Query::Roadmap(RoadmapQuery { milestones, scene, base_pose, hand, seed }) => {
                if !(1..=MAX_MILESTONES).contains(&milestones) {
                    return Err(format!("milestones is {milestones}, expected 1 to {MAX_MILESTONES}"));
                }
                let scene = QueryScene::new(&scene, base_pose)?;
                let hand = self.hand_angles(hand)?;
                let planner = self.planner()?;
                planner.set_meshes(scene.meshes).map_err(error_text)?;
                let (obstacles, base) = (&scene.obstacles, &scene.world_from_base);
                let grown = planner.grow_roadmap(milestones, &hand, obstacles, base, seed);
                grown.map(|roadmap| json!(roadmap)).map_err(error_text)
            }
            Query::Collision { q, scene, base_pose, hand } => {
                let scene = QueryScene::new(&scene, base_pose)?;
                let hand = self.hand_angles(hand)?;
                let planner = self.planner()?;
                planner.set_meshes(scene.meshes).map_err(error_text)?;
                let pairs = planner
                    .collisions(&q, &hand, &scene.obstacles, None, &scene.world_from_base)
                    .map_err(error_text)?;
                Ok(json!({ "collision": !pairs.is_empty(), "pairs": pairs }))
            }
        }
    }

    fn inverse_dynamics(
        &mut self,
        q: &[f64],
        qd: &[f64],
        qdd: &[f64],
        hand: Option<Vec<f64>>,
    ) -> Result<Value, String> {
        let arm = self.model.arm_count();
        let hand = self.hand_angles(hand)?;
        let rest = zeros(hand.len());
        let whole = |what, values: &[f64], hand: &[f64]| {
            expect_length(what, values, arm).map(|()| [values, hand].concat())
        };
        let q = whole("q", q, &hand)?;
        let (qd, qdd) = (whole("qd", qd, &rest)?, whole("qdd", qdd, &rest)?);
        let tau = self.kinematics.inverse_dynamics(&q, &qd, &qdd, &GRAVITY).map_err(error_text)?;
        Ok(json!({ "tau": &tau[..arm] }))
    }

    fn hand_angles(&self, hand: Option<Vec<f64>>) -> Result<Vec<f64>, String> {
        let expected = self.model.moving_count() - self.model.arm_count();
        let hand = hand.unwrap_or_else(|| self.default_hand.clone());
        expect_length("hand", &hand, expected).map(|()| hand)
    }

    /// Angles given, angles picked by a number, or the middle of the limits.
    fn ik_seed(&self, seed: Option<Value>) -> Result<Vec<f64>, String> {
        let number = match seed {
            None | Some(Value::Null) => None,
            Some(Value::Array(angles)) => {
                return serde_json::from_value(Value::Array(angles))
                    .map_err(|error| format!("seed: {error}"));
            }
            Some(other) => Some(other.as_u64().ok_or_else(|| {
                format!("seed is {other}, expected a list of angles or a whole number from 0")
            })?),
        };
        let share = |k: usize| number.map_or(0.5, |number| low_discrepancy(number, k));
        let limits = self.model.arm.iter().map(|&joint| &self.model.joints[joint].limits);
        Ok(limits.enumerate().map(|(k, l)| l.lower + share(k) * (l.upper - l.lower)).collect())
    }

    fn plan(&mut self, question: PlanQuery) -> Result<Value, String> {
        let scene = QueryScene::new(&question.scene, question.base_pose)?;
        let world_from_base = scene.world_from_base;
        let goal = match (question.goal_q, question.goal_pose) {
            (Some(q), None) => PlanGoal::Joints { q: joint_vector("goal_q", &q)? },
            (None, Some(goal)) => {
                PlanGoal::TipPose { pose: world_from_base * pose(goal.position, goal.quaternion)? }
            }
            _ => return Err("expected one of goal_q and goal_pose".to_owned()),
        };
        let request = PlanRequest {
            id: 1,
            world_from_base,
            start: joint_vector("start", &question.start)?,
            hand: joint_vector("hand", &self.hand_angles(question.hand)?)?,
            goal,
            picked_object: None,
            obstacles: scene.obstacles,
            held_joints: Vec::new(),
            attached: parse_attached(&question.attached)?,
            seed: question.seed,
        };
        let mut own = match question.planner {
            None if question.parameters.is_empty() && question.roadmap.is_none() => None,
            name => {
                let planner =
                    name.map_or(Ok(PlannerName::default()), |name| name.parse()).map_err(error_text)?;
                let parameter = |(name, value): (String, Value)| match value {
                    Value::String(value) => (name, value),
                    other => (name, other.to_string()),
                };
                let roadmap = question.roadmap.as_deref().map(read_roadmap).transpose()?;
                if roadmap.is_some() && planner != PlannerName::Prm {
                    return Err(format!("{planner} cannot begin with a roadmap, expected the planner PRM"));
                }
                let parameters = question.parameters.into_iter().map(parameter).collect();
                let mut own =
                    self.new_planner(PlannerOptions { name: planner, parameters, ..Default::default() })?;
                own.set_roadmap(roadmap.as_ref()).map_err(error_text)?;
                Some(own)
            }
        };
        let planner = match &mut own {
            Some(planner) => planner,
            None => self.planner()?,
        };
        planner.set_meshes(scene.meshes).map_err(error_text)?;
        let reply = planner.solve(&request);
        let effort = planner.stats().clone();
        let path: Vec<&[f64]> = reply.trajectory.points.iter().map(|point| point.q.as_slice()).collect();
        let times: Vec<f64> = reply.trajectory.points.iter().map(|point| point.time_secs).collect();
        Ok(json!({
            "status": reply.status,
            "path": path,
            "times": times,
            "reason": reply.reason,
            "clearance": reply.clearance_m,
            "words": status_label(reply.status),
            "iterations": effort.iterations,
            "wall_secs": effort.wall_secs,
        }))
    }

    fn planner(&mut self) -> Result<&mut ArmPlanner, String> {
        let planner = match self.planner.take() {
            Some(planner) => planner,
            None => self.new_planner(PlannerOptions::default())?,
        };
        Ok(self.planner.insert(planner))
    }

    fn new_planner(&self, options: PlannerOptions) -> Result<ArmPlanner, String> {
        let kinematics = Box::new(Kinematics::new(&self.model).map_err(error_text)?);
        ArmPlanner::new(self.model.clone(), kinematics, options).map_err(error_text)
    }
}

fn read_roadmap(path: &Path) -> Result<Roadmap, String> {
    let bytes = std::fs::File::open(path)
        .and_then(|file| read_bytes(file, MAX_ROADMAP_BYTES))
        .map_err(|error| format!("roadmap {}: {error}", path.display()))?;
    serde_json::from_slice(&bytes).map_err(|error| {
        format!("roadmap {}: {error}; expected an answer to {{\"op\": \"roadmap\"}}", path.display())
    })
}

fn error_text(error: impl std::fmt::Display) -> String {
    error.to_string()
}

fn expect_length(what: &str, values: &[f64], expected: usize) -> Result<(), String> {
    if values.len() == expected {
        Ok(())
    } else {
        Err(format!("{what} has {} values, expected {expected}", values.len()))
    }
}

fn joint_vector(what: &str, values: &[f64]) -> Result<JointVector, String> {
    // Too few are the planner's to refuse; more than fit must not get that far.
    expect_length(what, values, values.len().min(proact_types::MAX_JOINTS)).map(|()| joints(values))
}

fn pose(position: [f64; 3], quaternion: [f64; 4]) -> Result<Pose, String> {
    let [x, y, z, w] = quaternion;
    let quaternion = Quaternion::new(w, x, y, z);
    let length = quaternion.norm();
    if (length - 1.0).abs() > QUATERNION_TOLERANCE {
        return Err(format!(
            "the quaternion [{x}, {y}, {z}, {w}] (x, y, z, w) has length {length}, expected 1"
        ));
    }
    let translation = Translation3::from(Vector3::from(position));
    Ok(Pose::from_parts(translation, UnitQuaternion::from_quaternion(quaternion)))
}

/// A number in [0, 1) for `seed` and coordinate `k`: the fractional part of multiples of square roots of primes,
/// which fills the cube evenly (Kronecker sequence; Niederreiter 1978). For choosing starts, not for statistics.
pub fn low_discrepancy(seed: u64, k: usize) -> f64 {
    const PRIMES: [f64; 10] = [2.0, 3.0, 5.0, 7.0, 11.0, 13.0, 17.0, 19.0, 23.0, 29.0];
    // Beyond 2^32 the product would have no fractional digits left; such seeds repeat.
    let number = (seed % (1 << 32)) as f64 + 1.0 + (k / PRIMES.len()) as f64;
    (number * PRIMES[k % PRIMES.len()].sqrt()).fract()
}

#[cfg(test)]
mod tests;
