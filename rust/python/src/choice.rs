//! From names that a program gives to a trial's configuration.

use proact_app::{Arm, TrialContext, trial_config};
use proact_control::MethodRegistry;
use proact_devices::EmgOrigin;
use proact_study::TrialChoice;
use proact_testbed::TrialConfig;
use pyo3::{exceptions::PyValueError, prelude::*, types::PyDict};
use std::fmt::Display;

/// What the testbed says, as Python's error for a value that does not fit.
pub(crate) fn refused(error: impl Display) -> PyErr {
    PyValueError::new_err(error.to_string())
}

/// What a program chooses of a trial.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct Choice {
    task: Option<String>,
    arm: Option<String>,
    method: Option<String>,
    setup: String,
    profile: Option<String>,
    seed: u64,
    limit_secs: Option<f64>,
    settings: Vec<String>,
}

impl Choice {
    /// Those of the keyword arguments that concern the trial.
    pub(crate) fn of(given: &Bound<'_, PyDict>) -> PyResult<Self> {
        given.extract()
    }

    /// The arm and the configuration.
    pub(crate) fn config(self, methods: &MethodRegistry) -> PyResult<(Arm, TrialConfig)> {
        let Choice { task, arm, method, setup, profile, seed, limit_secs, settings } = self;
        let choice =
            TrialChoice { method, task, arm, profile, limit_secs, set: settings, ..TrialChoice::default() };
        let context = TrialContext {
            methods,
            default_setup: &setup,
            seed,
            arrangement: None,
            process: None,
            intent: None,
            emg: None,
        };
        trial_config(&choice, context).map_err(refused)
    }
}

/// Where EMG comes from: `synthetic`, or a folder of recordings.
pub(crate) fn emg_origin(name: String) -> EmgOrigin {
    if name == "synthetic" { EmgOrigin::Synthetic } else { EmgOrigin::recording(name) }
}
