//! Everything that can be said about a description, for a person or a machine to read.

use crate::{Finding, Severity, examine};
use serde::Serialize;
use std::{fmt, path::Path};

/// What [`check`] found.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DescriptionReport {
    /// True if there is no error: the description can be used.
    pub usable: bool,
    /// What it describes, if it could be read.
    pub summary: Option<DescriptionSummary>,
    /// Errors, then warnings, then notes, each kind in the order of reading.
    pub findings: Vec<Finding>,
}

/// What a usable description describes.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DescriptionSummary {
    /// Name of the robot.
    pub robot: String,
    /// Number of links.
    pub links: usize,
    /// Names of the arm's joints, base to tip.
    pub arm: Vec<String>,
    /// Names of the hand's joints.
    pub hand: Vec<String>,
    /// Link at the base.
    pub base: String,
    /// Link at which the arm ends.
    pub tip: String,
    /// Sum of all masses, kg.
    pub mass_kg: f64,
    /// Names of poses, as `group/name`.
    pub poses: Vec<String>,
}

/// Reads a description and reports all that is wrong, doubtful or noteworthy; without SRDF text the groups are
/// found as in [`crate::parse_urdf`].
pub fn check(urdf: &str, srdf: Option<&str>) -> DescriptionReport {
    let (model, findings) = examine(urdf, srdf);
    let summary = model.map(|model| {
        let names = |joints: &[usize]| joints.iter().map(|&j| model.joints[j].name.clone()).collect();
        DescriptionSummary {
            robot: model.name.clone(),
            links: model.links.len(),
            arm: names(&model.arm),
            hand: names(&model.hand),
            base: model.links[0].name.clone(),
            tip: model.links[model.tip].name.clone(),
            mass_kg: model.links.iter().filter_map(|l| l.inertial).map(|i| i.mass).sum(),
            poses: model.poses.iter().map(|p| format!("{}/{}", p.group, p.name)).collect(),
        }
    });
    DescriptionReport { usable: summary.is_some(), summary, findings }
}

impl DescriptionReport {
    /// Of a description that cannot be used.
    pub fn refused(findings: Vec<Finding>) -> Self {
        Self { usable: false, summary: None, findings }
    }

    /// How many findings are of this kind.
    pub fn count(&self, severity: Severity) -> usize {
        self.findings.iter().filter(|f| f.severity == severity).count()
    }
}

/// A report with the file that its lines are of.
struct ReportOfFile<'a> {
    report: &'a DescriptionReport,
    file: &'a Path,
}

impl fmt::Display for ReportOfFile<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.report.write_to(f, Some(self.file))
    }
}

impl fmt::Display for DescriptionReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.write_to(f, None)
    }
}

impl DescriptionReport {
    /// The report as text, with `file` before each line number.
    pub fn of_file<'a>(&'a self, file: &'a Path) -> impl fmt::Display + 'a {
        ReportOfFile { report: self, file }
    }

    fn write_to(&self, f: &mut fmt::Formatter<'_>, file: Option<&Path>) -> fmt::Result {
        if let Some(s) = &self.summary {
            writeln!(
                f,
                "{}: {} links, {:.3} kg, {} arm joints from {} to {}, {} hand joints",
                s.robot,
                s.links,
                s.mass_kg,
                s.arm.len(),
                s.base,
                s.tip,
                s.hand.len()
            )?;
        }
        for finding in &self.findings {
            finding.write_to(f, file)?;
            writeln!(f)?;
        }
        write!(
            f,
            "{}: {} errors, {} warnings, {} notes",
            if self.usable { "usable" } else { "not usable" },
            self.count(Severity::Error),
            self.count(Severity::Warning),
            self.count(Severity::Note)
        )
    }
}
