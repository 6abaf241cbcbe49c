//! What stands around the arm of a question, and what its hand carries.

use super::{PoseEntry, error_text, identity_quaternion, pose};
use proact_planning::MeshObstacle;
use proact_tasks::{DEFAULT_TASK, TaskSpec};
use proact_testbed::Setup;
use proact_types::{AttachedObject, Obstacle, Pose, Shape};
use serde::Deserialize;
use serde_json::Value;

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct ShapeEntry {
    name: Option<String>,
    shape: ShapeForm,
    position: [f64; 3],
    #[serde(default = "identity_quaternion")]
    quaternion: [f64; 4],
}

#[derive(Debug, Deserialize)]
#[serde(untagged)]
enum ShapeForm {
    Mesh(MeshForm),
    Primitive(Shape),
}

#[derive(Debug, Deserialize)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
enum MeshForm {
    Mesh { vertices: Vec<[f64; 3]>, triangles: Vec<[usize; 3]> },
}

/// What a question says of the surroundings.
pub(super) struct QueryScene {
    /// In `world`.
    pub obstacles: Vec<Obstacle>,
    pub meshes: Vec<MeshObstacle>,
    pub world_from_base: Pose,
}

impl QueryScene {
    pub fn new(scene: &Value, base_pose: Option<PoseEntry>) -> Result<Self, String> {
        let mut meshes = Vec::new();
        let (obstacles, usual_base) = match scene {
            Value::String(name) => named_scene(name)?,
            Value::Array(shapes) => {
                let mut obstacles = Vec::new();
                for (index, shape) in shapes.iter().enumerate() {
                    match parse_object(index, shape)? {
                        QueryObject::Primitive(obstacle) => obstacles.push(obstacle),
                        QueryObject::Mesh(mesh) => meshes.push(mesh),
                    }
                }
                (obstacles, Pose::identity())
            }
            other => {
                return Err(format!("scene is {other}, expected box, clutter, empty or a list of shapes"));
            }
        };
        let base = base_pose.map(|base| pose(base.position, base.quaternion)).transpose()?;
        Ok(Self { obstacles, meshes, world_from_base: base.unwrap_or(usual_base) })
    }
}

fn named_scene(name: &str) -> Result<(Vec<Obstacle>, Pose), String> {
    let blocks = match name {
        "empty" => return Ok((Vec::new(), Pose::identity())),
        "box" => false,
        "clutter" => true,
        _ => {
            return Err(format!("scene is \"{name}\", expected box, clutter, empty or a list of shapes"));
        }
    };
    let mut task = TaskSpec::named(DEFAULT_TASK, 0).map_err(error_text)?;
    // The first arrangement, whatever a seed would choose.
    task.arrangement = None;
    let scene = task.build(false).map_err(error_text)?.scene().clone();
    let fixed = scene.fixed.into_iter().map(|o| Obstacle {
        name: o.name,
        shape: o.shape,
        pose: o.pose,
        loose: false,
    });
    let movable = scene.objects.into_iter().filter(|_| blocks).map(|block| Obstacle {
        name: block.name,
        shape: block.shape,
        pose: block.pose,
        loose: block.loose,
    });
    let still = Setup::named("still").map_err(error_text)?;
    Ok((fixed.chain(movable).collect(), still.body.shoulder_pose(&Default::default())))
}

enum QueryObject {
    Primitive(Obstacle),
    Mesh(MeshObstacle),
}

fn parse_object(index: usize, entry: &Value) -> Result<QueryObject, String> {
    let with_index = |error: String| format!("scene, shape {index}: {error}");
    let entry: ShapeEntry =
        serde_json::from_value(entry.clone()).map_err(|error| with_index(error.to_string()))?;
    let pose = pose(entry.position, entry.quaternion).map_err(with_index)?;
    let name = entry.name.unwrap_or_else(|| format!("shape_{index}"));
    Ok(match entry.shape {
        ShapeForm::Mesh(MeshForm::Mesh { vertices, triangles }) => {
            QueryObject::Mesh(MeshObstacle { name, vertices, triangles, pose })
        }
        ShapeForm::Primitive(shape) => QueryObject::Primitive(Obstacle { name, shape, pose, loose: false }),
    })
}

/// What the hand carries: one thing at most.
pub(super) fn parse_attached(list: &[ShapeEntry]) -> Result<Option<AttachedObject>, String> {
    match list {
        [] => Ok(None),
        [ShapeEntry { name, shape: ShapeForm::Primitive(shape), position, quaternion }] => {
            Ok(Some(AttachedObject {
                name: name.clone().unwrap_or_else(|| "carried".to_owned()),
                shape: *shape,
                tip_from_object: pose(*position, *quaternion)
                    .map_err(|error| format!("attached: {error}"))?,
                loose: false,
            }))
        }
        [_] => Err("attached is a mesh, expected a box, sphere, cylinder or capsule".to_owned()),
        more => Err(format!("attached has {} objects, the hand carries one at most", more.len())),
    }
}
