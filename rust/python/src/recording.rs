//! Recorded trials as numbers: recomputed from their inputs, and checked against their digests.

use crate::choice::refused;
use numpy::{PyArray2, ToPyArray, ndarray::Array2};
use proact_app::{Registry, ReplayOptions, Retraced, retrace};
use proact_testbed::Testbed;
use proact_types::{Pose, TickInput};
use pyo3::{exceptions::PyValueError, prelude::*, types::PyDict};
use std::path::PathBuf;

/// Rows of numbers of one width.
#[derive(Default)]
struct Rows {
    width: usize,
    values: Vec<f64>,
}

impl Rows {
    /// Takes a row. All have as many numbers as the first.
    fn push(&mut self, row: impl IntoIterator<Item = f64>) {
        let before = self.values.len();
        self.values.extend(row);
        self.width = self.values.len() - before;
    }

    fn array<'py>(self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let rows = self.values.len().checked_div(self.width).unwrap_or(0);
        let array = Array2::from_shape_vec((rows, self.width), self.values);
        Ok(array.map_err(refused)?.to_pyarray(py))
    }
}

/// What is taken down of a trial. Times are milliseconds.
#[derive(Default)]
struct Taken {
    joints: Vec<String>,
    objects: Vec<String>,
    /// Time, then angle, speed, torque and asked angle of each joint.
    states: Rows,
    /// Time, then pose of base and tip, `world`.
    poses: Rows,
    /// Time, then pose, speed and turning of each object.
    bodies: Rows,
    /// Time, number of the gesture in force, score, whether the arm must stand still.
    course: Rows,
    /// Time, origin, direction, valid.
    gaze: Rows,
    /// Time, counter, channels.
    emg: Rows,
}

fn seven(pose: &Pose) -> impl Iterator<Item = f64> {
    let (at, turn) = (pose.translation.vector, pose.rotation.coords);
    [at.x, at.y, at.z, turn.x, turn.y, turn.z, turn.w].into_iter()
}

impl Taken {
    fn take(&mut self, testbed: &Testbed, input: &TickInput, every_ms: u64, links: &mut Vec<Pose>) {
        let (now, model, world) = (testbed.now(), testbed.model(), testbed.plant().state());
        let time = now.0 as f64;
        if self.joints.is_empty() {
            let scene = testbed.task().scene();
            self.joints = model.moving().map(|joint| model.joints[joint].name.clone()).collect();
            self.objects = scene.ids().map(|object| scene.name(object)).collect();
        }
        if let Some(gaze) = &input.gaze {
            let ray = gaze.origin.coords.iter().chain(gaze.direction.iter()).copied();
            self.gaze.push([time].into_iter().chain(ray).chain([f64::from(u8::from(gaze.valid))]));
        }
        for sample in &input.emg {
            self.emg.push([time, sample.counter as f64].into_iter().chain(sample.channels.iter().copied()));
        }
        if !now.0.is_multiple_of(every_ms) {
            return;
        }
        let target = testbed.targets();
        let joints = [&world.position, &world.velocity, &world.effort, target];
        self.states.push([time].into_iter().chain(joints.into_iter().flatten().copied()));
        model.place_links(&world.world_from_base, &world.position, links);
        self.poses
            .push([time].into_iter().chain(seven(&world.world_from_base)).chain(seven(&links[model.tip])));
        let bodies = world.objects.iter().flat_map(|body| {
            seven(&body.pose).chain(body.linear.iter().copied()).chain(body.angular.iter().copied())
        });
        self.bodies.push([time].into_iter().chain(bodies));
        let state = testbed.task().state();
        let (gesture, stopped) = (testbed.gesture().index() as f64, testbed.stop().is_some());
        self.course.push([time, gesture, f64::from(state.score), f64::from(u8::from(stopped))]);
    }
}

/// The trial recorded in `dir`, each `every_ms`: arrays whose first column is the time in ms, names, and JSON texts.
#[pyfunction]
pub(crate) fn load(
    py: Python<'_>,
    dir: PathBuf,
    every_ms: u64,
    other_versions: bool,
) -> PyResult<Bound<'_, PyDict>> {
    if !(1..=1000).contains(&every_ms) {
        return Err(PyValueError::new_err(format!("every_ms is {every_ms}, expected 1 to 1000")));
    }
    let loaded = py.detach(move || {
        let methods = Registry::standard().methods;
        let options = ReplayOptions { methods, other_versions, ..ReplayOptions::default() };
        let (mut taken, mut links) = (Taken::default(), Vec::new());
        let traced = retrace(&dir, &options, |testbed, input| {
            taken.take(testbed, input, every_ms, &mut links);
        });
        traced.map(|traced| (taken, traced)).map_err(|error| error.to_string())
    });
    let (taken, Retraced { config, events, result, recorded, divergence, .. }) = loaded.map_err(refused)?;
    let told = PyDict::new(py);
    told.set_item("joints", taken.joints)?;
    told.set_item("objects", taken.objects)?;
    told.set_item("states", taken.states.array(py)?)?;
    told.set_item("poses", taken.poses.array(py)?)?;
    told.set_item("bodies", taken.bodies.array(py)?)?;
    told.set_item("course", taken.course.array(py)?)?;
    told.set_item("gaze", taken.gaze.array(py)?)?;
    told.set_item("emg", taken.emg.array(py)?)?;
    told.set_item("events", serde_json::to_string(&events).map_err(refused)?)?;
    told.set_item("result", serde_json::to_string(&result).map_err(refused)?)?;
    told.set_item("config", config.to_toml().map_err(refused)?)?;
    told.set_item("digest", recorded)?;
    told.set_item("divergence", serde_json::to_string(&divergence).map_err(refused)?)?;
    Ok(told)
}
