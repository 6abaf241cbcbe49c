//! Environments: a trial step by step.

use crate::trial_keywords::{TrialKeywords, emg_origin, fault_policy, value_error};
use nix::time::{ClockId, clock_gettime};
use numpy::{PyArray1, PyReadonlyArray1, PyReadwriteArray1};
use proact_app::{
    Registry,
    agent::{self, ActionKind, AgentOptions, AgentStep},
};
use proact_camera::{CameraView, Renderer};
use pyo3::{exceptions::PyValueError, prelude::*, types::PyDict};
use std::time::Duration;

/// Widest angle of the camera between the upper and the lower edge, rad.
const VERTICAL_FOV_RAD: f64 = 60.0 * std::f64::consts::PI / 180.0;
/// Longest side of a picture, pixels.
const MAX_PIXELS: u32 = 2048;

/// Of this thread; zero where the system does not tell.
fn thread_cpu_time() -> Duration {
    clock_gettime(ClockId::CLOCK_THREAD_CPUTIME_ID).map_or(Duration::ZERO, Duration::from)
}

/// A trial that a program drives. It stays in the thread that made it, as the physics does.
#[pyclass(name = "AgentTrial", unsendable, module = "proact._proact")]
pub(crate) struct PyAgentTrial {
    trial: agent::AgentEnvironment,
    renderer: Option<Renderer>,
    /// Of the last step, without what the border costs.
    step_secs: f64,
}

#[pymethods]
impl PyAgentTrial {
    #[new]
    #[pyo3(signature = (choice, *, action, observation, reward, period_ms, emg=None, gaze_error_deg=1.5, record=None, accept_faults=false))]
    #[expect(clippy::too_many_arguments, reason = "they are keywords of Python")]
    fn new(
        choice: &Bound<'_, PyDict>,
        action: &str,
        observation: &str,
        reward: &str,
        period_ms: u64,
        emg: Option<String>,
        gaze_error_deg: f64,
        record: Option<std::path::PathBuf>,
        accept_faults: bool,
    ) -> PyResult<Self> {
        let methods = Registry::standard().methods;
        let (arm, config) = TrialKeywords::from_dict(choice)?.config(&methods)?;
        let options = AgentOptions {
            action: action.parse().map_err(value_error)?,
            observation: observation.parse().map_err(value_error)?,
            reward: reward.parse().map_err(value_error)?,
            period_ms,
            emg: emg.map(|name| emg_origin(name, fault_policy(accept_faults))),
            gaze_error_deg,
            record,
        };
        let trial = agent::AgentEnvironment::new(&methods, &arm, config, &options).map_err(value_error)?;
        Ok(Self { trial, renderer: None, step_secs: 0.0 })
    }

    /// Holds `action` (float64) for one period and writes the observation into `out` (float64, one number a name):
    /// (reward, terminated, truncated).
    fn step(
        &mut self,
        action: PyReadonlyArray1<'_, f64>,
        mut out: PyReadwriteArray1<'_, f64>,
    ) -> PyResult<(f64, bool, bool)> {
        let began = thread_cpu_time();
        let AgentStep { reward, terminated, truncated } =
            self.trial.step(action.as_slice()?).map_err(value_error)?;
        self.write_observation(out.as_slice_mut()?)?;
        self.step_secs = thread_cpu_time().saturating_sub(began).as_secs_f64();
        Ok((reward, terminated, truncated))
    }

    /// Writes the observation into `out`.
    fn observe(&self, mut out: PyReadwriteArray1<'_, f64>) -> PyResult<()> {
        self.write_observation(out.as_slice_mut()?)
    }

    /// Names of the observed numbers, in their order.
    #[getter]
    fn observation_names(&self) -> Vec<String> {
        self.trial.observation_names().to_vec()
    }

    /// For each number of an action that is a choice, the names of the choices; none if actions are numbers.
    #[getter]
    fn action_choices(&self) -> Option<Vec<Vec<String>>> {
        match self.trial.action_kind() {
            ActionKind::Discrete(choices) => Some(choices.clone()),
            ActionKind::Continuous(_) => None,
        }
    }

    /// Names of the numbers of an action; none if they are choices.
    #[getter]
    fn action_names(&self) -> Option<Vec<String>> {
        match self.trial.action_kind() {
            ActionKind::Discrete(_) => None,
            ActionKind::Continuous(names) => Some(names.clone()),
        }
    }

    /// Digest of the trial up to its last full span of 100 ms, or to its end.
    #[getter]
    fn digest(&self) -> String {
        self.trial.running_trial().testbed().digest()
    }

    /// Simulated seconds.
    #[getter]
    fn time_secs(&self) -> f64 {
        self.trial.running_trial().testbed().now().as_secs()
    }

    /// What the last step and its observation took within the testbed, seconds of this thread's processor time.
    #[getter]
    fn step_secs(&self) -> f64 {
        self.step_secs
    }

    /// What the task counted so far.
    #[getter]
    fn score(&self) -> u32 {
        self.trial.running_trial().testbed().task().state().score
    }

    /// What happened in the last step, JSON text.
    fn events(&self) -> PyResult<String> {
        serde_json::to_string(self.trial.events()).map_err(value_error)
    }

    /// The newest displayed instant, JSON text.
    fn frame(&self) -> PyResult<String> {
        serde_json::to_string(self.trial.frame()).map_err(value_error)
    }

    /// The result as of now, JSON text.
    fn result(&self) -> PyResult<String> {
        serde_json::to_string(&self.trial.result()).map_err(value_error)
    }

    /// The configuration, TOML text.
    fn config(&self) -> PyResult<String> {
        self.trial.running_trial().testbed().config().to_toml().map_err(value_error)
    }

    /// Ends the trial if it has not ended, and closes its record; the result, JSON text.
    fn close(&mut self) -> PyResult<String> {
        serde_json::to_string(&self.trial.close().map_err(value_error)?).map_err(value_error)
    }

    /// What a camera sees now: uint8, `3 * width * height`, rows from the top. `overhead` hangs it above the table.
    fn picture<'py>(
        &mut self,
        py: Python<'py>,
        width: u32,
        height: u32,
        overhead: bool,
    ) -> PyResult<Bound<'py, PyArray1<u8>>> {
        if !(1..=MAX_PIXELS).contains(&width) || !(1..=MAX_PIXELS).contains(&height) {
            return Err(PyValueError::new_err(format!(
                "the picture would have {width} x {height} pixels, expected 1 to {MAX_PIXELS} along each side"
            )));
        }
        let testbed = self.trial.running_trial().testbed();
        let renderer =
            self.renderer.get_or_insert_with(|| Renderer::new(testbed.model(), testbed.task().scene()));
        let view = if overhead { CameraView::Overhead } else { CameraView::Head };
        let camera = renderer.camera(view, self.trial.frame(), [width, height], VERTICAL_FOV_RAD);
        Ok(PyArray1::from_vec(py, renderer.render(self.trial.frame(), &camera).rgb))
    }
}

impl PyAgentTrial {
    fn write_observation(&self, out: &mut [f64]) -> PyResult<()> {
        let expected = self.trial.observation_names().len();
        if out.len() != expected {
            return Err(PyValueError::new_err(format!(
                "out has {} numbers, the observation has {expected}",
                out.len()
            )));
        }
        self.trial.write_observation(out);
        Ok(())
    }
}
