//! From names that a program gives to a trial's configuration.

use proact_app::{Arm, TrialContext, trial_config};
use proact_control::MethodRegistry;
use proact_devices::{EmgOrigin, FaultPolicy};
use proact_study::TrialOptions;
use proact_testbed::TrialConfig;
use pyo3::{exceptions::PyValueError, prelude::*, types::PyDict};
use std::fmt::Display;

/// What the testbed says, as Python's error for a value that does not fit.
pub(crate) fn value_error(error: impl Display) -> PyErr {
    PyValueError::new_err(error.to_string())
}

/// What a program chooses of a trial.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct TrialKeywords {
    task: Option<String>,
    arm: Option<String>,
    method: Option<String>,
    setup: String,
    profile: Option<String>,
    seed: u64,
    limit_secs: Option<f64>,
    settings: Vec<String>,
}

impl TrialKeywords {
    /// Those of the keyword arguments that concern the trial.
    pub(crate) fn from_dict(given: &Bound<'_, PyDict>) -> PyResult<Self> {
        given.extract()
    }

    /// The arm and the configuration.
    pub(crate) fn config(self, methods: &MethodRegistry) -> PyResult<(Arm, TrialConfig)> {
        let TrialKeywords { task, arm, method, setup, profile, seed, limit_secs, settings } = self;
        let choice =
            TrialOptions { method, task, arm, profile, limit_secs, set: settings, ..TrialOptions::default() };
        let context = TrialContext {
            methods,
            default_setup: &setup,
            seed,
            arrangement: None,
            process: None,
            intent: None,
            emg: None,
        };
        trial_config(&choice, context).map_err(value_error)
    }
}

/// Where EMG comes from: `synthetic`, or a folder of recordings, whose findings are dealt with as `policy` says.
pub(crate) fn emg_origin(name: String, policy: FaultPolicy) -> EmgOrigin {
    let mut origin = if name == "synthetic" { EmgOrigin::Synthetic } else { EmgOrigin::recording(name) };
    if let EmgOrigin::Recording { faults, .. } = &mut origin {
        *faults = policy;
    }
    origin
}

/// What the keyword `accept_faults` says.
pub(crate) fn fault_policy(accept_faults: bool) -> FaultPolicy {
    if accept_faults { FaultPolicy::Accept } else { FaultPolicy::Refuse }
}
