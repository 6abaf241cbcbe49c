//! What is wrong, or doubtful, about a description.

use crate::size_limits::MAX_FINDINGS;
use serde::Serialize;
use std::{
    fmt,
    path::{Path, PathBuf},
};

/// How bad a finding is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Severity {
    /// The description cannot be used.
    Error,
    /// It can be used, but probably not as meant.
    Warning,
    /// Worth knowing.
    Note,
}

impl fmt::Display for Severity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Severity::Error => "error",
            Severity::Warning => "warning",
            Severity::Note => "note",
        })
    }
}

/// One thing found in a description.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Finding {
    /// How bad it is.
    pub severity: Severity,
    /// Where: such as `joint "elbow"`.
    #[serde(rename = "place")]
    pub location: String,
    /// Line of that element in the file, where it is known.
    pub line: Option<u32>,
    /// What is wrong, one clause.
    pub problem: String,
    /// What the file says.
    pub got: String,
    /// What would be right.
    pub expected: String,
    /// What to do, one sentence.
    pub remedy: String,
}

impl Finding {
    /// What keeps a trial from running with an arm that can be read.
    pub fn about_trial(
        problem: impl Into<String>,
        got: impl Into<String>,
        remedy: impl Into<String>,
    ) -> Self {
        Self {
            severity: Severity::Error,
            location: "trial".to_owned(),
            line: None,
            problem: problem.into(),
            got: got.into(),
            expected: "an arm with which a trial runs".to_owned(),
            remedy: remedy.into(),
        }
    }
}

impl Finding {
    /// The finding as a line of text; `file` is where its line is, if that is to be named.
    pub(crate) fn write_to(&self, f: &mut fmt::Formatter<'_>, file: Option<&Path>) -> fmt::Result {
        write!(f, "{}: {}", self.severity, self.location)?;
        match (self.line, file) {
            (Some(line), Some(file)) => write!(f, " ({}:{line})", file.display())?,
            (Some(line), None) => write!(f, " (line {line})")?,
            (None, Some(file)) if self.location == "URDF" => write!(f, " ({})", file.display())?,
            (None, _) => {}
        }
        write!(f, ": {}: got {}, expected {}. {}", self.problem, self.got, self.expected, self.remedy)
    }
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.write_to(f, None)
    }
}

/// Why a description was not read, changed or written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum DescriptionError {
    /// The file cannot be read.
    #[error("cannot read the description {}: {source}. Give a readable file", path.display())]
    Read {
        /// Which file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// The description is not usable; every error is listed.
    #[error("{}", error_list(findings))]
    Invalid {
        /// All findings, the errors among them.
        findings: Vec<Finding>,
    },
    /// One link does not hang on another.
    #[error(
        "link \"{tip}\" does not hang on link \"{base}\". Name a base that the tip's chain of joints passes"
    )]
    NoChain {
        /// The link asked for as base.
        base: String,
        /// The link asked for as tip.
        tip: String,
    },
    /// urdfdom refuses, or knows no such part.
    #[error("urdfdom: {reason}")]
    Library {
        /// What it says.
        reason: String,
    },
    /// What the folder's settings say does not fit the arm.
    #[error("{file}: {problem}")]
    Settings {
        /// The file.
        file: &'static str,
        /// What was got, and what was expected.
        problem: String,
    },
    /// A name that is looked up does not exist.
    #[error(transparent)]
    Unknown(#[from] proact_arm::ArmModelError),
}

fn error_list(findings: &[Finding]) -> String {
    let errors: Vec<String> =
        findings.iter().filter(|f| f.severity == Severity::Error).map(Finding::to_string).collect();
    errors.join("\n")
}

/// Collects findings while a description is read.
#[derive(Default)]
pub(crate) struct Findings(pub(crate) Vec<Finding>);

impl Findings {
    /// Notes an error; the description will be refused when all of it has been looked at.
    pub(crate) fn error(
        &mut self,
        location: impl Into<String>,
        problem: impl Into<String>,
        got: impl fmt::Display,
        expected: impl Into<String>,
        remedy: impl Into<String>,
    ) {
        self.add(Severity::Error, location, problem, got, expected, remedy);
    }

    /// Notes something doubtful.
    pub(crate) fn warning(
        &mut self,
        location: impl Into<String>,
        problem: impl Into<String>,
        got: impl fmt::Display,
        expected: impl Into<String>,
        remedy: impl Into<String>,
    ) {
        self.add(Severity::Warning, location, problem, got, expected, remedy);
    }

    /// Notes something of either kind.
    pub(crate) fn add(
        &mut self,
        severity: Severity,
        location: impl Into<String>,
        problem: impl Into<String>,
        got: impl fmt::Display,
        expected: impl Into<String>,
        remedy: impl Into<String>,
    ) {
        // An error must not get lost behind warnings: it decides.
        if self.is_full() && (severity != Severity::Error || self.has_error()) {
            return;
        }
        self.0.push(Finding {
            severity,
            location: location.into(),
            line: None,
            problem: problem.into(),
            got: got.to_string(),
            expected: expected.into(),
            remedy: remedy.into(),
        });
    }

    /// True if no more findings are kept, so that a reader may as well stop.
    pub(crate) fn is_full(&self) -> bool {
        self.0.len() >= MAX_FINDINGS
    }

    /// True if an error was noted.
    pub(crate) fn has_error(&self) -> bool {
        self.0.iter().any(|f| f.severity == Severity::Error)
    }
}

/// `link "name"`, the place of a finding.
pub(crate) fn link_location(name: &str) -> String {
    format!("link \"{name}\"")
}

/// `joint "name"`, the place of a finding.
pub(crate) fn joint_location(name: &str) -> String {
    format!("joint \"{name}\"")
}

/// Text of a list for messages; says so when it is empty.
pub(crate) fn join_names<'a>(names: impl IntoIterator<Item = &'a str>) -> String {
    let names: Vec<&str> = names.into_iter().collect();
    if names.is_empty() { "none".to_owned() } else { names.join(", ") }
}
