//! Flawed records behind the tables of a report: a sentence in the captions, and the column `flaw` of the CSV files.

use super::{
    AnalysisData,
    summaries::{ReportTable, participant},
};
use std::collections::BTreeSet;

/// Tables of the report that come from questionnaires alone.
const QUESTIONNAIRE_TABLES: [&str; 3] = ["ratings", "rankings", "questionnaires"];
/// Heads of columns that name methods, participants and records.
const METHOD_HEADS: [&str; 3] = ["Method", "method", "pair"];
const PARTICIPANT_HEADS: [&str; 2] = ["Participant", "participant"];
const RECORD_HEAD: &str = "record";
/// Between the two methods of a pair.
const BETWEEN_METHODS: &str = " – ";

/// The trials of a report whose records have a flaw.
pub(super) struct FlawedRecords(Vec<FlawedRecord>);

struct FlawedRecord {
    participant: String,
    condition: String,
    trial: String,
    record: String,
    /// Labels of its flaws, with commas between.
    flaw: String,
}

impl FlawedRecords {
    pub(super) fn of(collected: &AnalysisData) -> Self {
        let trials = &collected.tables["trials"];
        let rows = trials.rows.iter().map(|row| {
            let [condition, trial, record, flaw] =
                ["condition", "trial", "record", "flaw"].map(|name| trials.text(row, name));
            FlawedRecord { participant: participant(trials, row), condition, trial, record, flaw }
        });
        Self(rows.filter(|row| !row.flaw.is_empty()).collect())
    }

    /// A sentence that lists them; none where there are none.
    pub(super) fn sentence(&self) -> Option<String> {
        let name = |row: &FlawedRecord| {
            format!("{} {} trial {} ({})", row.participant, row.condition, row.trial, row.flaw)
        };
        let names: Vec<String> = self.0.iter().map(name).collect();
        (!names.is_empty())
            .then(|| format!("Records with a flaw, see data/trials.csv: {}.", names.join("; ")))
    }

    /// A table of the report as CSV, with the column `flaw`: the flaws of the records that a row is made from, with commas between.
    pub(super) fn csv(&self, table: &ReportTable) -> Result<String, Box<dyn std::error::Error>> {
        let mut writer = csv::Writer::from_writer(Vec::new());
        writer.write_record(table.headers.iter().map(String::as_str).chain(["flaw"]))?;
        for row in &table.rows {
            let flaws = self.flaws(table, row);
            writer.write_record(row.iter().map(String::as_str).chain([flaws.as_str()]))?;
        }
        Ok(String::from_utf8(writer.into_inner()?)?)
    }

    /// The flaws of a row: of its record, participant and methods where the row names them, else of all records.
    fn flaws(&self, table: &ReportTable, row: &[String]) -> String {
        if QUESTIONNAIRE_TABLES.contains(&table.name) {
            return String::new();
        }
        let is_of_row = |record: &&FlawedRecord| {
            table.headers.iter().zip(row).all(|(head, cell)| match head.as_str() {
                head if METHOD_HEADS.contains(&head) => {
                    cell.split(BETWEEN_METHODS).any(|method| method == record.condition)
                }
                head if PARTICIPANT_HEADS.contains(&head) => *cell == record.participant,
                RECORD_HEAD => *cell == record.record,
                _ => true,
            })
        };
        let labels: BTreeSet<&str> =
            self.0.iter().filter(is_of_row).flat_map(|record| record.flaw.split(',')).collect();
        labels.into_iter().collect::<Vec<_>>().join(",")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn flaws(name: &'static str, head: &[&str], row: &[&str]) -> String {
        let record = |participant: &str, condition: &str, flaw: &str| FlawedRecord {
            participant: participant.to_owned(),
            condition: condition.to_owned(),
            trial: "1".to_owned(),
            record: format!("trials/{participant}{condition}"),
            flaw: flaw.to_owned(),
        };
        let records =
            FlawedRecords(vec![record("P1", "C", "cut,bag_only"), record("P2", "D", "interrupted")]);
        let words = |words: &[&str]| words.iter().map(|word| (*word).to_owned()).collect::<Vec<_>>();
        let (title, caption) = (String::new(), String::new());
        let table = ReportTable { name, title, caption, headers: words(head), rows: vec![words(row)] };
        let text = records.csv(&table).unwrap();
        let mut reader = csv::Reader::from_reader(text.as_bytes());
        assert_eq!(reader.headers().unwrap().iter().next_back(), Some("flaw"));
        let row = reader.records().next().unwrap().unwrap();
        row.iter().next_back().unwrap().to_owned()
    }

    #[test]
    fn a_row_has_the_flaws_of_its_records() {
        assert_eq!(flaws("success", &["Method", "mean"], &["C", "1"]), "bag_only,cut");
        assert_eq!(flaws("success", &["Method", "mean"], &["A", "1"]), "");
        assert_eq!(flaws("pairs", &["Measure", "pair"], &["Score", "D – A"]), "interrupted");
        assert_eq!(flaws("friedman", &["Measure", "n"], &["Score", "3"]), "bag_only,cut,interrupted");
        assert_eq!(
            flaws("by_participant", &["Measure", "participant", "C"], &["Score", "P2", "1"]),
            "interrupted"
        );
        let trials = ["Participant", "Method", "record"];
        assert_eq!(flaws("trials", &trials, &["P1", "C", "trials/P1C"]), "bag_only,cut");
        assert_eq!(flaws("trials", &trials, &["P1", "C", "trials/another"]), "");
        assert_eq!(flaws("ratings", &["Item", "Method"], &["effort", "C"]), "", "no record is in it");
    }
}
