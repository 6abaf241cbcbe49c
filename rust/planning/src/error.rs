/// Why a planning scene could not be made or asked.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PlanningError {
    /// A vector has the wrong length.
    #[error("{what} has {got} values, expected {expected}")]
    WrongLength {
        /// Such as `start`.
        what: &'static str,
        /// Values handed in.
        got: usize,
        /// Values that fit the model.
        expected: usize,
    },
    /// A value is NaN or infinite.
    #[error("{what} {index} is {value}, expected a finite number")]
    NotFinite {
        /// Such as `start`.
        what: &'static str,
        /// Which one.
        index: usize,
        /// Its value.
        value: f64,
    },
    /// The arm, a shape or a name was refused by the scene; the text says which and why.
    #[error("planning scene: {0}")]
    Scene(String),
    /// The kinematics do not belong to this arm, or refused.
    #[error("kinematics: {0}")]
    Kinematics(String),
    /// An option makes no sense.
    #[error(transparent)]
    Options(#[from] proact_testbed::ConfigError),
}

impl From<cxx::Exception> for PlanningError {
    fn from(exception: cxx::Exception) -> Self {
        Self::Scene(exception.what().to_owned())
    }
}

impl From<proact_control::ports::KinematicsError> for PlanningError {
    fn from(error: proact_control::ports::KinematicsError) -> Self {
        Self::Kinematics(error.to_string())
    }
}

/// Refuses a vector of the wrong length or with a value that is not finite: FCL and OMPL would take either.
pub(crate) fn check_vector(what: &'static str, values: &[f64], expected: usize) -> Result<(), PlanningError> {
    if values.len() != expected {
        return Err(PlanningError::WrongLength { what, got: values.len(), expected });
    }
    match values.iter().position(|value| !value.is_finite()) {
        Some(index) => Err(PlanningError::NotFinite { what, index, value: values[index] }),
        None => Ok(()),
    }
}
