//! The trials of a report, for the page that replays them.

use super::{
    AnalysisData, WrittenReport,
    summaries::{participant, records},
};
use crate::{Arm, bag_playback, record_playback, with_path};
use proact_bridge::{RecordedTrial, TrialLibrary, TrialSummary};
use proact_control::MethodRegistry;
use proact_testbed::TrialConfig;
use std::path::PathBuf;

/// A report with the trials that it was made of, each recomputed when somebody looks at it.
#[derive(Debug)]
pub struct ReportLibrary {
    methods: MethodRegistry,
    trials: Vec<(TrialSummary, PathBuf)>,
    report: String,
}

impl ReportLibrary {
    /// The trials of `collected`, in the order of the links of `written`.
    ///
    /// # Errors
    /// A trial without score or length, or with an invalid seed.
    pub fn new(
        methods: &MethodRegistry,
        collected: &AnalysisData,
        written: WrittenReport,
    ) -> Result<Self, String> {
        let table = &collected.tables["trials"];
        let record = |row: &Vec<_>| table.text(row, "record");
        let number = |row: &Vec<_>, name| {
            table
                .number(row, name)
                .ok_or_else(|| format!("{}: the table of trials has no {name} of it", record(row)))
        };
        // A bag does not tell its seed.
        let seed = |row: &Vec<_>| match table.text(row, "seed").as_str() {
            "" => Ok(None),
            seed => seed
                .parse::<u64>()
                .map(Some)
                .map_err(|_| format!("{}: seed {seed:?}, expected a whole number", record(row))),
        };
        let summary = |row: &Vec<_>| -> Result<TrialSummary, String> {
            Ok(TrialSummary {
                name: format!(
                    "{} {} trial {}",
                    participant(table, row),
                    table.text(row, "condition"),
                    table.text(row, "trial")
                ),
                method: table.text(row, "method"),
                setup: table.text(row, "setup"),
                seed: seed(row)?,
                seconds: number(row, "seconds")?,
                // Counts of a task.
                score: number(row, "score")? as u32,
            })
        };
        // A study names its records from its own folder, a folder of trials from where the command ran.
        let path = |record: String| {
            let inside = collected.folder.join(&record);
            if inside.exists() { inside } else { PathBuf::from(record) }
        };
        let summaries: Vec<TrialSummary> = table.rows.iter().map(summary).collect::<Result<_, _>>()?;
        let trials = summaries.into_iter().zip(records(table).into_iter().map(path)).collect();
        Ok(Self { methods: methods.clone(), trials, report: written.served_html })
    }
}

impl TrialLibrary for ReportLibrary {
    fn list(&self) -> Vec<TrialSummary> {
        self.trials.iter().map(|(summary, _)| summary.clone()).collect()
    }

    fn trial(&self, number: usize) -> Result<RecordedTrial, String> {
        let (summary, path) = self.trials.get(number).ok_or_else(|| format!("there is no trial {number}"))?;
        let named = |error: &dyn std::fmt::Display| with_path(path, error);
        let trial = if path.is_file() {
            let arm = Arm::load(TrialConfig::DEFAULT_ARM).map_err(|error| named(&error))?;
            bag_playback::read_playback(path, &arm)
        } else {
            record_playback::recompute_playback(&self.methods, path)
        };
        let trial = trial.map_err(|error| named(&error))?;
        Ok(RecordedTrial { name: summary.name.clone(), ..trial })
    }

    fn report(&self) -> Option<String> {
        Some(self.report.clone())
    }
}
