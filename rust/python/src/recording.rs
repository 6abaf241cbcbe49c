//! Recorded trials as numbers: recomputed from their inputs, and checked against their digests.

use crate::trial_keywords::value_error;
use numpy::{PyArray2, ToPyArray, ndarray::Array2};
use proact_app::{RecomputedRecord, Registry, ReplayOptions, recompute_record};
use proact_testbed::Testbed;
use proact_types::{Pose, TickInput};
use pyo3::{exceptions::PyValueError, prelude::*, types::PyDict};
use std::path::PathBuf;

/// Rows of numbers of one width.
#[derive(Default)]
struct RowMatrix {
    width: usize,
    values: Vec<f64>,
}

impl RowMatrix {
    /// Takes a row. All have as many numbers as the first.
    fn push(&mut self, row: impl IntoIterator<Item = f64>) {
        let before = self.values.len();
        self.values.extend(row);
        self.width = self.values.len() - before;
    }

    fn array<'py>(self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let rows = self.values.len().checked_div(self.width).unwrap_or(0);
        let array = Array2::from_shape_vec((rows, self.width), self.values);
        Ok(array.map_err(value_error)?.to_pyarray(py))
    }
}

/// What is taken down of a trial. Times are milliseconds.
#[derive(Default)]
struct SampledTrial {
    joints: Vec<String>,
    objects: Vec<String>,
    /// Time, then angle, speed, torque and asked angle of each joint.
    joint_states: RowMatrix,
    /// Time, then pose of base and tip, `world`.
    base_and_tip_poses: RowMatrix,
    /// Time, then pose, speed and turning of each object.
    object_states: RowMatrix,
    /// Time, number of the gesture in force, score, whether the arm must stand still.
    trial_states: RowMatrix,
    /// Time, origin, direction, valid.
    gaze: RowMatrix,
    /// Time, counter, channels.
    emg: RowMatrix,
}

fn pose_components(pose: &Pose) -> impl Iterator<Item = f64> {
    let (at, turn) = (pose.translation.vector, pose.rotation.coords);
    [at.x, at.y, at.z, turn.x, turn.y, turn.z, turn.w].into_iter()
}

impl SampledTrial {
    fn sample(&mut self, testbed: &Testbed, input: &TickInput, every_ms: u64, links: &mut Vec<Pose>) {
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
        self.joint_states.push([time].into_iter().chain(joints.into_iter().flatten().copied()));
        model.link_poses_into(&world.world_from_base, &world.position, links);
        self.base_and_tip_poses.push(
            [time]
                .into_iter()
                .chain(pose_components(&world.world_from_base))
                .chain(pose_components(&links[model.tip])),
        );
        let bodies = world.objects.iter().flat_map(|body| {
            pose_components(&body.pose)
                .chain(body.linear_velocity.iter().copied())
                .chain(body.angular_velocity.iter().copied())
        });
        self.object_states.push([time].into_iter().chain(bodies));
        let state = testbed.task().state();
        let (command, stopped) = (testbed.command().index() as f64, testbed.stop().is_some());
        self.trial_states.push([time, command, f64::from(state.score), f64::from(u8::from(stopped))]);
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
        let options =
            ReplayOptions { methods, allow_other_versions: other_versions, ..ReplayOptions::default() };
        let (mut taken, mut links) = (SampledTrial::default(), Vec::new());
        let traced = recompute_record(&dir, &options, |testbed, input| {
            taken.sample(testbed, input, every_ms, &mut links);
        });
        traced.map(|traced| (taken, traced)).map_err(|error| error.to_string())
    });
    let (taken, RecomputedRecord { config, events, result, recorded_digest, divergence, .. }) =
        loaded.map_err(value_error)?;
    let dict = PyDict::new(py);
    dict.set_item("joints", taken.joints)?;
    dict.set_item("objects", taken.objects)?;
    dict.set_item("states", taken.joint_states.array(py)?)?;
    dict.set_item("poses", taken.base_and_tip_poses.array(py)?)?;
    dict.set_item("bodies", taken.object_states.array(py)?)?;
    dict.set_item("course", taken.trial_states.array(py)?)?;
    dict.set_item("gaze", taken.gaze.array(py)?)?;
    dict.set_item("emg", taken.emg.array(py)?)?;
    dict.set_item("events", serde_json::to_string(&events).map_err(value_error)?)?;
    dict.set_item("result", serde_json::to_string(&result).map_err(value_error)?)?;
    dict.set_item("config", config.to_toml().map_err(value_error)?)?;
    dict.set_item("digest", recorded_digest)?;
    dict.set_item("divergence", serde_json::to_string(&divergence).map_err(value_error)?)?;
    Ok(dict)
}
