//! Objects in rows and columns, and how many they are and how far apart as an option of a trial.

use crate::{
    SceneFile, TaskError,
    scene::{KindFile, ObjectFile},
};
use proact_types::{Shape, format_number};
use serde::{Deserialize, Serialize};

/// Objects in rows (along x, the nearest first) and columns (along y, the most lateral first), numbered row by row from 1.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct GridFile {
    /// Their names begin with this, and end with the number.
    pub name: String,
    /// Rows along x, columns along y.
    pub count: [usize; 2],
    /// From one to the next along x and y.
    #[serde(rename = "pitch")]
    pub spacing_m: [f64; 2],
    /// The middle of all: x, y.
    #[serde(rename = "middle")]
    pub center_m: [f64; 2],
    /// Each has its target at its mirror image across the partition.
    #[serde(default)]
    pub mirrored_targets: bool,
    /// From one target to the next along x and y; that of the objects where it is left out. Their middle is the mirror image of
    /// that of the objects.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[serde(rename = "target_pitch")]
    pub target_spacing_m: Option<[f64; 2]>,
    /// Every second one, as the fields of a chessboard, is of this kind, with numbers of its own; then the scene has the first of
    /// each kind, the second of each, and so on.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[serde(rename = "chequered")]
    pub checkered: Option<Checkered>,
    /// The rest.
    #[serde(flatten)]
    pub kind: KindFile,
}

/// What the other half of a chequered grid has of its own.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Checkered {
    /// As [`GridFile::name`].
    pub name: String,
    /// Red, green, blue, 0 to 1.
    #[serde(rename = "colour")]
    pub color: [f64; 3],
}

impl GridFile {
    /// The objects in their order.
    pub(crate) fn objects(&self) -> Vec<ObjectFile> {
        let [rows, columns] = self.count;
        let along = |k: usize, count: usize, pitch: f64| (k as f64 - (count as f64 - 1.0) / 2.0) * pitch;
        let coordinate = |cell: usize, pitch: [f64; 2]| {
            let x = self.center_m[0] + along(cell / columns, rows, pitch[0]);
            [x, self.center_m[1] + along(cell % columns, columns, pitch[1])]
        };
        let object = |name: &str, number: usize, cell: usize, kind: &KindFile| {
            let [x, y] = coordinate(cell, self.target_spacing_m.unwrap_or(self.spacing_m));
            ObjectFile {
                name: format!("{name}{number}"),
                label: number.to_string(),
                ros_name: String::new(),
                position_m: coordinate(cell, self.spacing_m),
                support_height_m: None,
                target_position_m: self.mirrored_targets.then_some([x, -y]),
                kind: kind.clone(),
            }
        };
        let cells = 0..rows * columns;
        let Some(Checkered { name, color }) = &self.checkered else {
            return cells.map(|cell| object(&self.name, cell + 1, cell, &self.kind)).collect();
        };
        let (firsts, seconds): (Vec<usize>, Vec<usize>) =
            cells.partition(|cell| (cell / columns + cell % columns).is_multiple_of(2));
        let other = KindFile { color: *color, ..self.kind.clone() };
        let mut objects = Vec::new();
        // The first field is of the first kind, which has as many as the second, or one more.
        for (k, first) in firsts.iter().enumerate() {
            objects.push(object(&self.name, k + 1, *first, &self.kind));
            objects.extend(seconds.get(k).map(|second| object(name, k + 1, *second, &other)));
        }
        objects
    }
}

/// How many objects a task's grid has, and how far they stand apart: instead of what its text says.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GridSpec {
    /// As many objects, in the rows of the text; or rows and columns.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub count: Option<GridCount>,
    /// From one to the next, metres: along both axes, or along x and y.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub spacing_m: Option<GridSpacing>,
    /// Width of boxes, metres: their other sides change in proportion, and the mass with the volume.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub width_m: Option<f64>,
}

/// How many objects a grid has.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum GridCount {
    /// In the rows that there are.
    All(usize),
    /// Rows and columns.
    RowsColumns([usize; 2]),
}

/// How far the objects of a grid stand apart, metres.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum GridSpacing {
    /// Along both axes.
    Same(f64),
    /// Along x and y.
    Each([f64; 2]),
}

impl GridSpec {
    /// Changes the one grid of `scene`.
    ///
    /// # Errors
    /// A scene without a grid or with several; a number that fills no rows; a width of what is no box.
    pub(crate) fn apply(&self, task: &str, scene: &mut SceneFile) -> Result<(), TaskError> {
        let grids = scene.grids.len();
        let [grid] = scene.grids.as_mut_slice() else {
            return Err(TaskError::Scene(format!(
                "{grids} grids in task {task:?}, expected one for task.grid to change, as docs/tasks/cluttered.toml has"
            )));
        };
        let rows = grid.count[0];
        grid.count = match self.count {
            None => grid.count,
            Some(GridCount::RowsColumns(count)) => count,
            Some(GridCount::All(count)) if rows > 0 && count.is_multiple_of(rows) => [rows, count / rows],
            Some(GridCount::All(count)) => {
                return Err(TaskError::Scene(format!(
                    "{count} objects in {rows} rows, expected as many in each; or give rows and columns, such as [2, 3]"
                )));
            }
        };
        grid.spacing_m = match self.spacing_m {
            None => grid.spacing_m,
            Some(GridSpacing::Same(pitch)) => [pitch; 2],
            Some(GridSpacing::Each(pitch)) => pitch,
        };
        if let Some(width) = self.width_m {
            let Shape::Box { size } = &mut grid.kind.shape else {
                return Err(TaskError::Scene(format!("width {width} m of {}, which is no box", grid.name)));
            };
            if !(0.001..=10.0).contains(&width) {
                let width = format_number(width);
                return Err(TaskError::Scene(format!(
                    "width {width} m of {}, expected 0.001 to 10",
                    grid.name
                )));
            }
            let share = width / size[0];
            *size = size.map(|side| side * share);
            grid.kind.mass_kg *= share.powi(3);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use crate::{TaskError, TaskSpec};
    use proact_types::{Scene, Shape};

    fn scene(options: &str) -> Result<Scene, TaskError> {
        let text = include_str!("../../../docs/tasks/cluttered.toml").to_owned();
        let mut task = TaskSpec::from_text(text).expect("a good scene");
        task.grid = Some(toml::from_str(options).expect("a good scene"));
        Ok(task.build(false)?.scene().clone())
    }

    fn places(scene: &Scene) -> Vec<[i64; 2]> {
        let millimeters = |meters: f64| (meters * 1e3).round() as i64;
        let block_position = |k: usize| scene.objects[k].pose.translation.vector;
        (0..scene.objects.len())
            .map(|k| [millimeters(block_position(k).x), millimeters(block_position(k).y)])
            .collect()
    }

    #[test]
    fn a_chequered_grid_takes_number_and_pitch_and_alternates_its_kinds() {
        let scene = scene("count = [2, 3]\nspacing_m = [0.08, 0.06]").expect("a good scene");
        let names: Vec<&str> = scene.objects.iter().map(|object| &*object.name).collect();
        assert_eq!(names, ["red1", "blue1", "red2", "blue2", "red3", "blue3"]);
        let y = places(&scene)[0][1];
        let expected = [[-40, y], [-40, y + 60], [-40, y + 120], [40, y], [40, y + 60], [40, y + 120]];
        assert_eq!(places(&scene), expected);
        let targets: Vec<[i64; 2]> = scene
            .targets
            .iter()
            .map(|target| [target.center.x, target.center.y].map(|meters| (meters * 1e3).round() as i64))
            .collect();
        // Across the partition about the mirrored middle, with their own pitch.
        assert_eq!(targets[..2], [[-60, 205], [-60, 150]]);
        // Next to each other stand different colours.
        assert!(scene.objects.iter().step_by(2).all(|object| object.color == scene.objects[0].color));
        assert_ne!(scene.objects[0].color, scene.objects[1].color);
    }

    #[test]
    fn one_number_fills_the_rows_that_there_are_and_one_pitch_is_that_of_both_axes() {
        let scene = scene("count = 4\nspacing_m = 0.05").expect("a good scene");
        let at = places(&scene);
        assert_eq!(at.len(), 4);
        assert_eq!((at[1][0] - at[0][0], at[1][1] - at[0][1]), (0, 50));
        assert_eq!((at[3][0] - at[0][0], at[3][1] - at[0][1]), (50, 0));
    }

    #[test]
    fn a_width_scales_the_boxes_and_their_mass() {
        let [was, twice] = ["count = 4", "count = 4\nspacing_m = 0.12\nwidth_m = 0.05"].map(|options| {
            let mut task = TaskSpec::named("bbt", 1).expect("it ships");
            task.grid = Some(toml::from_str(options).expect("good options"));
            task.build(false).expect("a good scene").scene().objects[0].clone()
        });
        assert_eq!(twice.shape, Shape::Box { size: [0.05; 3] });
        assert!((twice.mass - 8.0 * was.mass).abs() < 1e-12);
        for (width, reason) in [("0.0", "0 m"), ("-0.05", "-0.05 m"), ("nan", "NaN"), ("0.1", "overlaps")] {
            let mut task = TaskSpec::named("bbt", 1).expect("it ships");
            task.grid = Some(toml::from_str(&format!("width_m = {width}")).expect("a number"));
            let error = task.build(false).err().expect("it must be refused").to_string();
            assert!(error.contains(reason), "{width}: {error}");
        }
    }

    #[test]
    fn a_grid_that_cannot_be_is_refused_with_what_is_wrong() {
        for (options, reason) in [
            ("count = 7", "7 objects in 2 rows"),
            ("count = [0, 3]", "0 objects"),
            ("spacing_m = 0.01", "overlaps"),
            ("spacing_m = 0.2", "expected"),
            ("width_m = 0.05", "no box"),
        ] {
            let error = scene(options).expect_err("must be refused").to_string();
            assert!(error.contains(reason), "{options}: {error}");
        }
        let mut task = TaskSpec::named("modified_bbt", 1).expect("a good scene");
        task.grid = Some(toml::from_str("count = 4").expect("a good scene"));
        let error = task.build(false).err().expect("a good scene").to_string();
        assert!(error.contains("0 grids"), "{error}");
    }
}
