//! Objects that lie in a heap, as in the box of the box-and-blocks test, and how they lie as an option of a trial.

use crate::{
    TaskError,
    scene::{KindFile, ObjectFile},
};
use proact_types::{Object, PlaceRegion, Pose, Shape};
use serde::{Deserialize, Serialize};

/// Equal objects that lie as they fell. A text mostly leaves open how, and physics finds it for each trial ([`HeapSpec::resting_poses`]); without
/// it they fall when the trial begins, from layers in which there is room for each however it is turned.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct HeapFile {
    /// Their names begin with this, and end with the number.
    pub name: String,
    /// How many they are.
    pub count: usize,
    /// Where they lie: least and greatest x and y. Walls should stand around it.
    pub area: PlaceRegion,
    /// How they lie, as [`HeapSpec::resting_poses`].
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    #[serde(rename = "lies")]
    pub resting_poses: Vec<[f64; 7]>,
    /// Colours that alternate; that of the kind where there are none.
    #[serde(default)]
    #[serde(rename = "colours")]
    pub colors: Vec<[f64; 3]>,
    /// The rest.
    #[serde(flatten)]
    pub kind: KindFile,
}

/// How a heap lies, and how many objects it has instead of what the task's text says.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HeapSpec {
    /// As many objects.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub count: Option<usize>,
    /// Of each object, for the right hand, in `world`: x, y, z in metres and the quaternion x, y, z, w. Empty before the trial is put
    /// together, when physics lets them fall.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub resting_poses: Vec<[f64; 7]>,
}

/// What a heap has of its own, beside what all objects of a kind have in common.
pub(crate) const HEAP_KEYS: [&str; 5] = ["name", "count", "area", "colours", "lies"];

impl HeapFile {
    /// The room that one needs however it is turned, metres.
    pub(crate) fn cell_size(&self) -> f64 {
        let size = match self.kind.shape {
            Shape::Box { size } => size.map(|side| side * side).iter().sum::<f64>().sqrt(),
            Shape::Sphere { radius } => 2.0 * radius,
            Shape::Cylinder { radius, length } => 2.0 * radius.hypot(length / 2.0),
            Shape::Capsule { radius, length } => 2.0 * radius + length,
        };
        size + 1e-4
    }

    /// Middles of so many cells in layers above `height`, none nearer to another than the room that one needs; empty where the area is
    /// too small for one.
    pub(crate) fn cells(&self, height: f64, count: usize) -> Vec<[f64; 3]> {
        let (cell, PlaceRegion { min, max }) = (self.cell_size(), self.area);
        let fit = [0, 1].map(|k| ((max[k] - min[k]) / cell).floor() as usize);
        let layer = fit[0] * fit[1];
        if layer == 0 {
            return Vec::new();
        }
        let along =
            |k: usize, number: usize| min[k] + (max[k] - min[k]) * (number as f64 + 0.5) / fit[k] as f64;
        let position_of = |k: usize| {
            let (row, column) = (k % layer / fit[1], k % fit[1]);
            [along(0, row), along(1, column), height + cell * ((k / layer) as f64 + 0.5)]
        };
        (0..count).map(position_of).collect()
    }

    /// Whether an object at `pose` lies in the heap, or on it.
    pub fn contains(&self, pose: &Pose, table: f64) -> bool {
        let (at, PlaceRegion { min, max }) = (pose.translation.vector, self.area);
        (0..2).all(|k| at[k] > min[k] && at[k] < max[k]) && at.z > table
    }

    /// Places on a heap whose topmost middle is at `top`, above each other in its middle: any number of them.
    pub fn positions_on_top(&self, top: f64) -> impl Iterator<Item = [f64; 3]> + use<> {
        let (cell, middle) = (self.cell_size(), self.area.center(top));
        let position_of = move |k: usize| {
            let aside = |number: usize| (number as f64 - 0.5) * cell;
            [middle.x + aside(k % 2), middle.y + aside(k / 2 % 2), top + cell * ((k / 4) as f64 + 1.0)]
        };
        (0..).map(position_of)
    }

    /// The objects as a text has single ones, standing in their layers.
    pub(crate) fn objects(&self, table: f64) -> Vec<ObjectFile> {
        let object = |(k, [x, y, z]): (usize, [f64; 3])| ObjectFile {
            name: format!("{}{}", self.name, k + 1),
            label: String::new(),
            ros_name: String::new(),
            position_m: [x, y],
            support_height_m: Some(z - self.kind.shape.half_height()),
            target_position_m: None,
            kind: KindFile {
                color: match self.colors.len() {
                    0 => self.kind.color,
                    color_count => self.colors[k % color_count],
                },
                ..self.kind.clone()
            },
        };
        self.cells(table, self.count).into_iter().enumerate().map(object).collect()
    }

    /// Takes the options of a trial.
    pub(crate) fn apply(&mut self, choice: &HeapSpec) {
        self.count = choice.count.unwrap_or(self.count);
        if !choice.resting_poses.is_empty() {
            self.resting_poses.clone_from(&choice.resting_poses);
        }
    }

    /// # Errors
    /// An area that is none or too small, colours out of range.
    pub(crate) fn check(&self) -> Result<(), TaskError> {
        let name = &self.name;
        if self.count > 0 && self.cells(0.0, 1).is_empty() {
            let (cell, PlaceRegion { min, max }) = (self.cell_size(), self.area);
            return Err(TaskError::Scene(format!(
                "the area of heap {name:?} is {min:?} to {max:?}, expected room for one object, {cell:.4} m"
            )));
        }
        let colors = self.colors.iter().flatten();
        match colors.into_iter().find(|part| !(0.0..=1.0).contains(*part)) {
            Some(part) => {
                Err(TaskError::Scene(format!("a colour of heap {name:?} has {part}, expected 0 to 1")))
            }
            None => Ok(()),
        }
    }

    /// Lays its objects as they lie; `left`: mirrored.
    ///
    /// # Errors
    /// Another number than there are, numbers that are no pose, a place below the table or out of the area.
    pub(crate) fn place_objects(
        &self,
        objects: &mut [Object],
        table: f64,
        left: bool,
    ) -> Result<(), TaskError> {
        let lies = &self.resting_poses;
        if lies.is_empty() {
            return Ok(());
        }
        if lies.len() != self.count {
            return Err(TaskError::Rule {
                key: "heap.resting_poses",
                reason: format!("{} poses, expected one for each of {} objects", lies.len(), self.count),
            });
        }
        for (object, lies) in objects.iter_mut().zip(lies) {
            let &[x, y, z, i, j, k, w] = lies;
            let long = (i * i + j * j + k * k + w * w).sqrt();
            let PlaceRegion { min, max } = self.area;
            // Walls give way a little, and what lies on them may lean out.
            let near = |v: f64, min: f64, max: f64| v > min - self.cell_size() && v < max + self.cell_size();
            let inside = near(x, min[0], max[0]) && near(y, min[1], max[1]) && z > table && z < table + 5.0;
            if !(inside && (long - 1.0).abs() < 1e-6) {
                return Err(TaskError::Rule {
                    key: "heap.resting_poses",
                    reason: format!(
                        "{:?} lies at {lies:?}, expected x and y within {min:?} to {max:?}, z above the table, {table}, and a unit quaternion",
                        object.name
                    ),
                });
            }
            let side = if left { -1.0 } else { 1.0 };
            let turn = nalgebra::Quaternion::new(w, side * i, j, side * k);
            object.pose = Pose::from_parts(
                nalgebra::Translation3::new(x, side * y, z),
                // As it was written: normalised again it might differ in the last bit.
                nalgebra::UnitQuaternion::new_unchecked(turn),
            );
        }
        Ok(())
    }
}
