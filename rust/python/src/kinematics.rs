//! Kinematics, dynamics, plans and collisions of an arm: the questions of `proact query`.

use crate::trial_keywords::value_error;
use proact_app::{Arm, query::QueryHandler};
use pyo3::prelude::*;

/// An arm that answers. It stays in the thread that made it, as the libraries behind it do.
#[pyclass(unsendable, module = "proact._proact")]
pub(crate) struct ArmQuery {
    handler: QueryHandler,
    arm: Arm,
}

#[pymethods]
impl ArmQuery {
    /// The arm called `name`, or the one in the folder `name`.
    #[new]
    fn new(name: &str) -> PyResult<Self> {
        let arm = Arm::load(name).map_err(value_error)?;
        let handler = QueryHandler::for_model(arm.model().as_ref().clone()).map_err(value_error)?;
        Ok(Self { handler, arm })
    }

    /// The answer to one question; both are JSON text.
    fn ask(&mut self, question: &str) -> PyResult<String> {
        self.handler.handle_line(question.as_bytes()).map(|answer| answer.to_string()).map_err(value_error)
    }

    /// Names of the arm's joints, base to tip.
    #[getter]
    fn joints(&self) -> Vec<String> {
        let model = self.arm.model();
        model.arm.iter().map(|joint| model.joints[*joint].name.clone()).collect()
    }

    /// Names of the hand's joints.
    #[getter]
    fn hand_joints(&self) -> Vec<String> {
        let model = self.arm.model();
        model.moving().skip(model.arm_count()).map(|joint| model.joints[joint].name.clone()).collect()
    }

    /// Of each of the arm's joints: lower, upper (rad), velocity (rad/s), effort (N m).
    #[getter]
    fn limits(&self) -> Vec<(f64, f64, f64, f64)> {
        let model = self.arm.model();
        let limits = model.arm.iter().map(|joint| model.joints[*joint].limits);
        limits.map(|limits| (limits.lower, limits.upper, limits.velocity, limits.effort)).collect()
    }

    /// Names of base and tip.
    #[getter]
    fn ends(&self) -> (String, String) {
        let model = self.arm.model();
        (model.links[0].name.clone(), model.links[model.tip].name.clone())
    }
}
