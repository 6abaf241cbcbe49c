/// Why a plan is refused.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum StudyPlanError {
    /// Not TOML, a key that there is not, a value of another type.
    #[error("the plan is unreadable: {0}")]
    Text(String),
    /// A condition of ArmSym that is not JSON, lacks a field, or has one that there is not or of another kind.
    #[error("the condition is unreadable: {0}")]
    Json(String),
    /// A value out of range.
    #[error("{key} is {got}, expected {expected}")]
    Value {
        /// Such as `participants`.
        key: String,
        /// As given.
        got: String,
        /// In words.
        expected: String,
    },
    /// A name that nothing has.
    #[error("{location} names {got:?}, but there is no such {what}; there is {known}")]
    Unknown {
        /// Where it stands.
        location: String,
        /// Such as `condition`.
        what: &'static str,
        /// As given.
        got: String,
        /// Those there are.
        known: String,
    },
    /// A name that two things have.
    #[error("two {what}s are called {name:?}")]
    Duplicate {
        /// Such as `condition`.
        what: &'static str,
        /// The name.
        name: String,
    },
    /// A row of a table does not hold what it should.
    #[error("row {row} of {table} is {got}, expected {expected}")]
    Row {
        /// `order` or `arrangements`.
        table: &'static str,
        /// From 1.
        row: usize,
        /// As given.
        got: String,
        /// In words.
        expected: String,
    },
    /// No order of the conditions keeps what is asked.
    #[error("no order of {conditions} keeps the constraints {constraints}")]
    Impossible {
        /// Their names.
        conditions: String,
        /// As given.
        constraints: String,
    },
}

impl StudyPlanError {
    pub(crate) fn value(key: impl Into<String>, got: impl ToString, expected: impl Into<String>) -> Self {
        Self::Value { key: key.into(), got: got.to_string(), expected: expected.into() }
    }
}
