use crate::{TaskError, grid::GridFile, heap::HeapFile};
use proact_types::{
    MAX_OBJECTS, Object, ObjectId, PlaceRegion, Point, Pose, Scene, SceneObject, Shape, Target,
};
use serde::{Deserialize, Serialize};

/// Objects that stand closer than this at the start overlap, metres.
const MIN_GAP_M: f64 = 1e-4;
/// Nothing of a scene is further from its origin than this, metres.
const MAX_DISTANCE_M: f64 = 20.0;

/// A scene as a file has it: lengths in metres, masses in kg, in `world` (x away from the person, y left, z up), for the
/// right hand: objects start at y < 0.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneFile {
    /// Height of the table top.
    #[serde(rename = "table_height")]
    pub table_height_m: f64,
    /// Where objects may be put down.
    #[serde(rename = "put_down")]
    pub place_region: PlaceRegion,
    /// Table, walls, partition, floor.
    pub fixed: Vec<FixedFile>,
    /// Objects, each by itself.
    #[serde(default)]
    pub objects: Vec<ObjectFile>,
    /// Objects in rows and columns, after the others.
    #[serde(default)]
    pub grids: Vec<GridFile>,
    /// Objects in a heap, after those.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub heap: Option<HeapFile>,
}

/// A body that does not move.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FixedFile {
    /// Unique name.
    pub name: String,
    /// Its shape.
    pub shape: Shape,
    /// Its middle.
    #[serde(rename = "at")]
    pub position_m: [f64; 3],
    /// Coulomb friction coefficient.
    pub friction: f64,
}

/// What all objects of a kind have in common.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct KindFile {
    /// Red, green, blue, 0 to 1.
    #[serde(rename = "colour")]
    pub color: [f64; 3],
    /// Standing upright.
    pub shape: Shape,
    /// kg.
    #[serde(rename = "mass")]
    pub mass_kg: f64,
    /// Friction against table, walls and other objects.
    pub friction: f64,
    /// Friction against fingers.
    #[serde(rename = "friction_finger")]
    pub finger_friction: f64,
    /// Whether it may be pushed about and dropped.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub loose: bool,
    /// Radius of the target's disc.
    #[serde(default = "KindFile::default_radius")]
    #[serde(rename = "target_radius")]
    pub target_radius_m: f64,
}

impl KindFile {
    fn default_radius() -> f64 {
        0.05
    }
}

/// One object, standing on the table.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ObjectFile {
    /// Unique name in results.
    pub name: String,
    /// What is painted on it.
    #[serde(default)]
    pub label: String,
    /// Name on a ROS graph; that of the object where it is left out.
    #[serde(default)]
    pub ros_name: String,
    /// Where it stands: x, y.
    #[serde(rename = "at")]
    pub position_m: [f64; 2],
    /// Height of what it stands on; that of the table where it is left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[serde(rename = "stands_at")]
    pub support_height_m: Option<f64>,
    /// Where it belongs: x, y; none if it has no place of its own.
    #[serde(default)]
    #[serde(rename = "target")]
    pub target_position_m: Option<[f64; 2]>,
    /// The rest.
    #[serde(flatten)]
    pub kind: KindFile,
}

impl SceneFile {
    /// All objects: the single ones, then those of the grids, then those of the heap.
    fn all(&self) -> Vec<ObjectFile> {
        let grids = self.grids.iter().flat_map(GridFile::objects);
        let heap = self.heap.iter().flat_map(|heap| heap.objects(self.table_height_m));
        self.objects.iter().cloned().chain(grids).chain(heap).collect()
    }

    /// How many objects there are.
    pub(crate) fn object_count(&self) -> usize {
        let in_grid = |grid: &GridFile| grid.count[0].saturating_mul(grid.count[1]);
        let in_heap = self.heap.iter().map(|heap| heap.count);
        self.grids.iter().map(in_grid).chain(in_heap).fold(self.objects.len(), usize::saturating_add)
    }

    /// The scene; `left`: mirrored in y, for the left hand.
    ///
    /// # Errors
    /// [`TaskError`]: a number that is none or out of range, a name twice, objects that overlap, stand in something or
    /// nowhere, a target outside the region where things may be put down.
    pub fn scene(&self, left: bool) -> Result<Scene, TaskError> {
        let got = self.object_count();
        if got > MAX_OBJECTS {
            return Err(TaskError::Scene(format!("{got} objects, expected 1 to {MAX_OBJECTS}")));
        }
        self.heap.iter().try_for_each(HeapFile::check)?;
        let files = self.all();
        self.check_numbers(&files)?;
        let side = if left { -1.0 } else { 1.0 };
        let [low, high] = [self.place_region.min, self.place_region.max];
        let mut scene = Scene {
            fixed: self.fixed.iter().map(|body| body.to_scene_object(side)).collect(),
            objects: files.iter().map(|object| object.to_object(self.table_height_m, side)).collect(),
            targets: files
                .iter()
                .enumerate()
                .filter_map(|(k, object)| {
                    let [x, y] = object.target_position_m?;
                    let center = Point::new(x, side * y, self.table_height_m);
                    Some(Target { object: ObjectId::new(k), center, radius: object.kind.target_radius_m })
                })
                .collect(),
            place_region: if left {
                PlaceRegion { min: [low[0], -high[1]], max: [high[0], -low[1]] }
            } else {
                self.place_region
            },
            table_height: self.table_height_m,
        };
        let standing = scene.objects.len() - self.heap.as_ref().map_or(0, |heap| heap.count);
        if let Some(heap) = &self.heap {
            heap.place_objects(&mut scene.objects[standing..], self.table_height_m, left)?;
        }
        check_placement(&scene, standing)?;
        Ok(scene)
    }

    fn check_numbers(&self, objects: &[ObjectFile]) -> Result<(), TaskError> {
        let within = |what: String, got: f64, low: f64, high: f64| {
            if (low..=high).contains(&got) {
                return Ok(());
            }
            Err(TaskError::Scene(format!("{what} is {got}, expected {low} to {high}")))
        };
        within("table_height".to_owned(), self.table_height_m, 0.0, 3.0)?;
        let PlaceRegion { min, max } = self.place_region;
        for k in 0..2 {
            let what = |end| format!("put_down.{end}[{k}]");
            within(what("min"), min[k], -MAX_DISTANCE_M, MAX_DISTANCE_M)?;
            within(what("max"), max[k], min[k], MAX_DISTANCE_M)?;
        }
        for body in &self.fixed {
            let what = |what: &str| format!("{what} of {:?}", body.name);
            body.position_m
                .iter()
                .try_for_each(|at| within(what("at"), *at, -MAX_DISTANCE_M, MAX_DISTANCE_M))?;
            within(what("friction"), body.friction, 0.0, 10.0)?;
            shape_lengths(&body.shape)
                .iter()
                .try_for_each(|length| within(what("a length"), *length, 1e-4, MAX_DISTANCE_M))?;
        }
        for object in objects {
            let (what, kind) = (|what: &str| format!("{what} of {:?}", object.name), &object.kind);
            let coordinates = object.position_m.iter().chain(object.target_position_m.iter().flatten());
            coordinates
                .into_iter()
                .try_for_each(|at| within(what("at"), *at, -MAX_DISTANCE_M, MAX_DISTANCE_M))?;
            object.support_height_m.iter().try_for_each(|at| within(what("stands_at"), *at, 0.0, 3.0))?;
            kind.color.iter().try_for_each(|part| within(what("colour"), *part, 0.0, 1.0))?;
            within(what("mass"), kind.mass_kg, 1e-3, 20.0)?;
            within(what("friction"), kind.friction, 0.0, 10.0)?;
            within(what("friction_finger"), kind.finger_friction, 0.0, 10.0)?;
            within(what("target_radius"), kind.target_radius_m, 1e-3, 1.0)?;
            shape_lengths(&kind.shape)
                .iter()
                .try_for_each(|length| within(what("a length"), *length, 5e-3, 0.5))?;
        }
        let names: Vec<&str> =
            self.fixed.iter().map(|b| &*b.name).chain(objects.iter().map(|o| &*o.name)).collect();
        for (k, name) in names.iter().enumerate() {
            if name.is_empty() || name.len() > 64 || name.chars().any(char::is_control) {
                return Err(TaskError::Scene(format!(
                    "a body is called {name:?}, expected 1 to 64 printable bytes"
                )));
            }
            if names[..k].contains(name) {
                return Err(TaskError::Scene(format!(
                    "two bodies are called {name:?}, expected different names"
                )));
            }
        }
        Ok(())
    }
}

impl FixedFile {
    fn to_scene_object(&self, side: f64) -> SceneObject {
        let [x, y, z] = self.position_m;
        SceneObject {
            name: self.name.clone(),
            shape: self.shape,
            pose: Pose::translation(x, side * y, z),
            friction: self.friction,
        }
    }
}

impl ObjectFile {
    fn to_object(&self, table: f64, side: f64) -> Object {
        let ([x, y], kind) = (self.position_m, &self.kind);
        Object {
            name: self.name.clone(),
            label: self.label.clone(),
            color: kind.color,
            ros_name: if self.ros_name.is_empty() { self.name.clone() } else { self.ros_name.clone() },
            shape: kind.shape,
            mass: kind.mass_kg,
            friction: kind.friction,
            finger_friction: kind.finger_friction,
            loose: kind.loose,
            pose: Pose::translation(
                x,
                side * y,
                self.support_height_m.unwrap_or(table) + kind.shape.half_height(),
            ),
        }
    }
}

/// All lengths of a shape, metres.
fn shape_lengths(shape: &Shape) -> Vec<f64> {
    match *shape {
        Shape::Box { size } => size.to_vec(),
        Shape::Sphere { radius } => vec![radius],
        Shape::Cylinder { radius, length } | Shape::Capsule { radius, length } => vec![radius, length],
    }
}

/// Half of the room that a shape takes along each axis of `world`, upright and unturned, metres.
fn half_size(shape: &Shape) -> [f64; 3] {
    match *shape {
        Shape::Box { size } => size.map(|side| side / 2.0),
        _ => [shape.half_width(), shape.half_width(), shape.half_height()],
    }
}

/// True if the boxes around two upright bodies share room.
fn overlap(a: (&Shape, &Pose), b: (&Shape, &Pose)) -> bool {
    let round = |shape: &Shape| !matches!(shape, Shape::Box { .. });
    let (sizes, offset) = ([half_size(a.0), half_size(b.0)], a.1.translation.vector - b.1.translation.vector);
    let near = |k: usize| offset[k].abs() < sizes[0][k] + sizes[1][k] - MIN_GAP_M;
    let aside = if round(a.0) && round(b.0) {
        offset.xy().norm() < sizes[0][0] + sizes[1][0] - MIN_GAP_M
    } else {
        near(0) && near(1)
    };
    aside && near(2)
}

/// True if a fixed body is under `point`, with its top at that height.
pub(crate) fn is_supported(scene: &Scene, point: &Point) -> bool {
    scene.fixed.iter().any(|body| {
        let (size, below) = (half_size(&body.shape), body.pose.translation.vector);
        let inside = |k: usize| (point[k] - below[k]).abs() <= size[k];
        inside(0) && inside(1) && (below.z + size[2] - point.z).abs() < MIN_GAP_M
    })
}

/// The first `standing` objects stand on something and have room; those of a heap lie as physics left them. Targets are in the box.
fn check_placement(scene: &Scene, standing: usize) -> Result<(), TaskError> {
    for (k, object) in scene.objects[..standing].iter().enumerate() {
        let here = (&object.shape, &object.pose);
        let others = scene.objects[..k].iter().map(|other| (&other.name, &other.shape, &other.pose));
        let fixed = scene.fixed.iter().map(|body| (&body.name, &body.shape, &body.pose));
        if let Some((other, ..)) = others.chain(fixed).find(|(_, shape, pose)| overlap(here, (shape, pose))) {
            let name = &object.name;
            return Err(TaskError::Scene(format!(
                "{name:?} overlaps {other:?} at the start; expected room between them"
            )));
        }
        let at = object.pose.translation.vector;
        let foot = Point::new(at.x, at.y, at.z - object.shape.half_height());
        if !is_supported(scene, &foot) {
            let (name, position) = (&object.name, [at.x, at.y]);
            let height =
                if (foot.z - scene.table_height).abs() < MIN_GAP_M { "table_height" } else { "stands_at" };
            return Err(TaskError::Scene(format!(
                "{name:?} at {position:?} stands on nothing; expected a fixed body whose top is at {height}"
            )));
        }
    }
    for target in &scene.targets {
        let PlaceRegion { min, max } = scene.place_region;
        if (0..2).any(|k| target.center[k] < min[k] || target.center[k] > max[k]) {
            let (name, position) = (scene.name(target.object), [target.center.x, target.center.y]);
            return Err(TaskError::Scene(format!(
                "the target of {name:?} at {position:?} is out of the box: expected it within put_down, {min:?} to {max:?}"
            )));
        }
    }
    Ok(())
}
