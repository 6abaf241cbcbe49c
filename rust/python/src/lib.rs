//! The native part of the Python module `proact`: numbers and JSON text across the border, shapes checked on this side, names and
//! types made friendly on the other (`python/proact`).
//!
//! Errors of the testbed become `ValueError` with its own words.
#![allow(clippy::disallowed_methods)] // As in `app`: here are the clock and the threads.

mod agent;
mod emg;
mod kinematics;
mod recording;
mod trial;
mod trial_keywords;
mod worker;

use pyo3::prelude::*;

/// `proact._proact`.
#[pymodule]
fn _proact(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add_class::<agent::PyAgentTrial>()?;
    module.add_class::<kinematics::ArmQuery>()?;
    module.add_function(wrap_pyfunction!(recording::load, module)?)?;
    module.add_function(wrap_pyfunction!(trial::run_trial, module)?)?;
    module.add_function(wrap_pyfunction!(trial::replay, module)?)?;
    module.add_function(wrap_pyfunction!(emg::training_windows, module)?)?;
    module.add_function(wrap_pyfunction!(emg::external_model, module)?)?;
    Ok(())
}
