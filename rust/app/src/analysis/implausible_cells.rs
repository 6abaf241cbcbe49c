//! Impossible values in the tables of a report: faults of the report, with record, phase, value and limit.

use super::summaries::participant;
use proact_analysis::{plausibility::find_implausible_values, table::Table};
use serde::Serialize;
use std::collections::BTreeMap;

/// Most faults among the notes; the JSON has all of them.
const MAX_NOTES: usize = 20;

/// A value in a table that no arm and no person can produce.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ImplausibleCell {
    /// The table.
    pub table: &'static str,
    /// The record; empty if the tables do not have it.
    pub record: String,
    /// Whose it is, such as `P3`.
    pub participant: String,
    /// The condition.
    pub condition: String,
    /// The trial.
    pub trial: String,
    /// Which phase, such as `pick of red1, time 1`; `trial` for a value of the whole trial.
    pub phase: String,
    /// The column; with `/seconds` behind it, divided by that column.
    pub quantity: String,
    /// The value.
    pub value: f64,
    /// The largest possible value.
    pub limit: f64,
    /// Of both.
    pub unit: &'static str,
}

/// The faults of the tables, in their order.
pub(super) fn find_implausible_cells(tables: &BTreeMap<&'static str, Table>) -> Vec<ImplausibleCell> {
    let trials = tables.get("trials");
    // A table that came without its trials names no record.
    let record = |key: &[proact_analysis::table::TableCell]| {
        let found =
            trials.and_then(|trials| Some((trials, trials.rows.iter().find(|row| row.starts_with(key))?)));
        found.map_or_else(String::new, |(trials, row)| trials.text(row, "record"))
    };
    let of_table = |table: &Table| {
        let faults = find_implausible_values(table).into_iter().map(|found| {
            let row = &table.rows[found.row];
            let words = |name| table.text(row, name);
            let phase = match table.column_index("phase") {
                Some(_) => format!("{} of {}, time {}", words("phase"), words("block"), words("time")),
                None => "trial".to_owned(),
            };
            ImplausibleCell {
                table: table.name,
                record: record(&row[..5]),
                participant: participant(table, row),
                condition: words("condition"),
                trial: words("trial"),
                phase,
                quantity: found.quantity,
                value: found.value,
                limit: found.limit,
                unit: found.unit,
            }
        });
        faults.collect::<Vec<_>>()
    };
    tables.values().flat_map(of_table).collect()
}

/// The faults in words, for the notes of the report.
pub(super) fn in_words(faults: &[ImplausibleCell]) -> Vec<String> {
    let one = |fault: &ImplausibleCell| {
        let ImplausibleCell {
            table,
            record,
            participant,
            condition,
            trial,
            phase,
            quantity,
            value,
            limit,
            unit,
        } = fault;
        let record = if record.is_empty() { String::new() } else { format!("{record}, ") };
        format!(
            "Fault of this report: {record}{participant} {condition} trial {trial}, {phase}: {quantity} in {table} is {value:.3} {unit}, \
             and no arm or person exceeds {limit} {unit}. Do not use the figures of this trial"
        )
    };
    let mut notes: Vec<String> = faults.iter().take(MAX_NOTES).map(one).collect();
    if faults.len() > MAX_NOTES {
        notes.push(format!(
            "Faults of this report: {} more, in the JSON of proact analyze",
            faults.len() - MAX_NOTES
        ));
    }
    notes
}
