//! The tables of the report.

use super::{
    AnalysisData,
    questionnaires::{questionnaires, rankings, ratings},
};
use proact_analysis::{
    summary::SampleSummary,
    table::{Table, TableCell, serialized_name},
};
use proact_testbed::TrialEnd;
use proact_types::Number;
use std::collections::{BTreeMap, BTreeSet};

/// A table of the report: words, as they are printed.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct ReportTable {
    /// Its file's.
    pub(super) name: &'static str,
    pub(super) title: String,
    /// What the columns are, and what is to be known.
    pub(super) caption: String,
    pub(super) headers: Vec<String>,
    pub(super) rows: Vec<Vec<String>>,
}

/// A value of a person under a condition.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct ParticipantValue {
    pub(super) participant: String,
    pub(super) condition: String,
    pub(super) value: f64,
}

/// Who a row is of: `P3`, or its own words.
pub(super) fn participant(table: &Table, row: &[TableCell]) -> String {
    match table.cell(row, "participant") {
        Some(TableCell::Integer(number)) => format!("P{number}"),
        Some(other) => other.to_string(),
        None => "?".to_owned(),
    }
}

/// The records of the trials, in the order of the table: a record's place in it is the number under which it is replayed.
pub(super) fn records(trials: &Table) -> Vec<String> {
    trials.rows.iter().map(|row| trials.text(row, "record")).collect()
}

/// The numbers of a column, with whose they are.
pub(super) fn values(
    table: &Table,
    column: &str,
    wanted: impl Fn(&[TableCell]) -> bool,
) -> Vec<ParticipantValue> {
    let rows = table.rows.iter().filter(|row| wanted(row));
    rows.filter_map(|row| {
        let value = table.number(row, column)?;
        Some(ParticipantValue {
            participant: participant(table, row),
            condition: table.text(row, "condition"),
            value,
        })
    })
    .collect()
}

/// The conditions of the trials, by name. One whose trials all failed has no numbers to compare.
pub(super) fn conditions(collected: &AnalysisData) -> Vec<String> {
    let trials = &collected.tables["trials"];
    let counted = trials.rows.iter().filter(|row| !has_failed(trials, row));
    let names: BTreeSet<String> = counted.map(|row| trials.text(row, "condition")).collect();
    names.into_iter().collect()
}

/// Whether a row of the trials is of one that failed.
fn has_failed(trials: &Table, row: &[TableCell]) -> bool {
    trials.text(row, "end_reason") == serialized_name(&TrialEnd::Failed)
}

/// A note about the trials of each condition that failed.
pub(super) fn failed_notes(trials: &Table) -> Vec<String> {
    let mut counts: BTreeMap<String, (usize, usize)> = BTreeMap::new();
    for row in &trials.rows {
        let (failed, all) = counts.entry(trials.text(row, "condition")).or_default();
        *failed += usize::from(has_failed(trials, row));
        *all += 1;
    }
    let note = |(condition, (failed, all)): (String, (usize, usize))| {
        (failed > 0).then(|| {
            format!(
                "{condition}: {failed} of {all} trials failed and have no score; the table faults says why"
            )
        })
    };
    counts.into_iter().filter_map(note).collect()
}

/// A number as papers print it.
pub(super) fn format_number(value: f64, digits: usize) -> String {
    // Half away from zero, as people round: 2.125 is stored exactly and printed by Rust as 2.12.
    let scale = 10_f64.powi(digits as i32);
    format!("{:.digits$}", Number((value * scale).round() / scale))
}

/// A chance as papers print it.
pub(super) fn format_p_value(p: f64) -> String {
    if p < 0.001 { "< 0.001".to_owned() } else { format_number(p, 3) }
}

fn format_optional(value: Option<f64>, digits: usize) -> String {
    value.map_or_else(|| "–".to_owned(), |value| format_number(value, digits))
}

/// Mean, sd, smallest, largest, middle and number, a row a condition.
pub(super) fn summary_rows(
    conditions: &[String],
    values: &[ParticipantValue],
    digits: usize,
) -> Vec<Vec<String>> {
    let row = |condition: &String| {
        let own: Vec<f64> = values.iter().filter(|v| v.condition == *condition).map(|v| v.value).collect();
        let summary = SampleSummary::of(&own);
        let number = |of: fn(&SampleSummary) -> f64| format_optional(summary.as_ref().map(of), digits);
        vec![
            condition.clone(),
            number(|s| s.mean),
            format_optional(summary.and_then(|s| s.sd), digits),
            number(|s| s.min),
            number(|s| s.max),
            number(|s| s.median),
            own.len().to_string(),
        ]
    };
    conditions.iter().map(row).collect()
}

pub(super) const SUMMARY_HEADERS: [&str; 7] = ["Method", "mean", "sd", "min", "max", "median", "n"];

fn to_strings(words: &[&str]) -> Vec<String> {
    words.iter().map(|word| (*word).to_owned()).collect()
}

/// All tables for which there are data.
pub(super) fn tables(collected: &AnalysisData) -> Vec<ReportTable> {
    let conditions = conditions(collected);
    let made = [
        success(collected, &conditions),
        sequence(collected),
        outcomes(collected, &conditions),
        durations(collected, &conditions),
        accuracy(collected, &conditions),
        phase_means_table(collected, &conditions, COMPENSATION),
        phase_means_table(collected, &conditions, GAZE),
        faults(collected, &conditions),
        emg(collected, &conditions),
        ratings(collected, &conditions),
        rankings(collected, &conditions),
        questionnaires(collected, &conditions),
        trials(collected),
    ];
    made.into_iter().flatten().collect()
}

fn success(collected: &AnalysisData, conditions: &[String]) -> Option<ReportTable> {
    let trials = collected.table("trials")?;
    let names: BTreeSet<String> = trials.rows.iter().map(|row| trials.text(row, "score_name")).collect();
    let name = names.into_iter().filter(|name| !name.is_empty()).collect::<Vec<_>>().join(", ");
    let values = values(trials, "score", |_| true);
    (!values.is_empty()).then(|| ReportTable {
        name: "success",
        title: "Success by method".to_owned(),
        caption: format!(
            "Score of a trial{}, over all trials of a method. sd by n - 1.",
            in_parentheses(&name)
        ),
        headers: to_strings(&SUMMARY_HEADERS),
        rows: summary_rows(conditions, &values, 2),
    })
}

fn in_parentheses(name: &str) -> String {
    if name.is_empty() { String::new() } else { format!(" ({name})") }
}

/// Who did what in which order, with asterisks and what they stand for.
fn sequence(collected: &AnalysisData) -> Option<ReportTable> {
    let trials = collected.table("trials")?;
    let mut outcomes_by_position: BTreeMap<(NaturalSortKey, i64), (String, bool)> = BTreeMap::new();
    for row in &trials.rows {
        let Some(position) = trials.number(row, "condition_order") else { continue };
        let of = (NaturalSortKey::of(participant(trials, row)), position as i64);
        let entry = outcomes_by_position.entry(of).or_insert_with(|| (trials.text(row, "condition"), false));
        entry.1 |= trials.text(row, "mark") == "*";
    }
    let last = outcomes_by_position.keys().map(|(_, position)| *position).max()?;
    let people: BTreeSet<NaturalSortKey> = outcomes_by_position.keys().map(|(who, _)| who.clone()).collect();
    let rows = people.iter().map(|who| {
        let cell = |position| {
            let found = outcomes_by_position.get(&(who.clone(), position));
            found.map_or_else(
                || "–".to_owned(),
                |(name, mark)| if *mark { format!("{name}*") } else { name.clone() },
            )
        };
        std::iter::once(who.name.clone()).chain((1..=last).map(cell)).collect()
    });
    Some(ReportTable {
        name: "sequence",
        title: "Sequence of methods".to_owned(),
        caption: deviation_notes(collected),
        headers: std::iter::once("Participant".to_owned())
            .chain((1..=last).map(|position| position.to_string()))
            .collect(),
        rows: rows.collect(),
    })
}

fn deviation_notes(collected: &AnalysisData) -> String {
    let Some(table) = collected.table("deviations") else { return String::new() };
    let descriptions: Vec<String> = table
        .rows
        .iter()
        .map(|row| {
            let [condition, what, why] =
                ["condition", "deviation", "reason"].map(|name| table.text(row, name));
            let what = what.replace('_', " ");
            let why = if why.is_empty() { String::new() } else { format!(" ({why})") };
            format!("{} {condition}: {what}{why}", participant(table, row))
        })
        .collect();
    format!("Trials marked * diverged from the plan. {}.", descriptions.join("; "))
}

/// A name with numbers in it, ordered by them: P2 before P10.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct NaturalSortKey {
    number: u64,
    pub(super) name: String,
}

impl NaturalSortKey {
    pub(super) fn of(name: String) -> Self {
        let digits: String = name.chars().filter(char::is_ascii_digit).collect();
        Self { number: digits.parse().unwrap_or(u64::MAX), name }
    }
}

/// What can become of a block, best first, with the letter that a figure has for it.
pub(super) const OUTCOMES: [(&str, &str, &str); 6] = [
    ("on_target", "on target", "T"),
    ("crossed_off_target", "crossed, off target", "X"),
    ("dropped_table_side", "dropped, start side", "S"),
    ("dropped_floor", "dropped, floor", "F"),
    ("moved_not_crossed", "moved, not crossed", "M"),
    ("not_attempted", "not attempted", "N"),
];

fn outcomes(collected: &AnalysisData, conditions: &[String]) -> Option<ReportTable> {
    let blocks = collected.table("blocks")?;
    let row = |condition: &String| {
        let own: Vec<String> = blocks
            .rows
            .iter()
            .filter(|row| blocks.text(row, "condition") == *condition)
            .map(|row| blocks.text(row, "outcome"))
            .collect();
        let count = |outcome: &str| own.iter().filter(|other| *other == outcome).count();
        let scored_count = own.iter().filter(|outcome| !outcome.is_empty()).count();
        let share = (scored_count > 0).then(|| 100.0 * count(OUTCOMES[0].0) as f64 / scored_count as f64);
        let counts = OUTCOMES.iter().map(|(outcome, ..)| count(outcome).to_string());
        let known: usize = OUTCOMES.iter().map(|(outcome, ..)| count(outcome)).sum();
        std::iter::once(condition.clone())
            .chain(counts)
            .chain([(own.len() - known).to_string(), own.len().to_string(), format_optional(share, 1)])
            .collect()
    };
    Some(ReportTable {
        name: "outcomes",
        title: "Fate of the blocks".to_owned(),
        caption: "Blocks by what became of them; other is for outcomes of other tasks and missing ones. The share is of blocks with an outcome."
            .to_owned(),
        headers: std::iter::once("Method")
            .chain(OUTCOMES.iter().map(|(_, name, _)| *name))
            .chain(["other", "all", "on target, %"])
            .map(str::to_owned)
            .collect(),
        rows: conditions.iter().map(row).collect(),
    })
}

fn durations(collected: &AnalysisData, conditions: &[String]) -> Option<ReportTable> {
    let objects = collected.table("objects")?;
    let mut rows = Vec::new();
    for (title, column, with) in
        [("pick", "pick_s", "pick_with_method"), ("place", "place_s", "place_with_method")]
    {
        for (used, flag) in [("with", 1.0), ("without", 0.0)] {
            let found = values(objects, column, |row| objects.number(row, with) == Some(flag));
            for mut row in summary_rows(conditions, &found, 1) {
                row.insert(1, title.to_owned());
                row.insert(2, used.to_owned());
                rows.push(row);
            }
        }
    }
    Some(ReportTable {
        name: "durations",
        title: "Pick and place durations".to_owned(),
        caption: "Seconds. Pick: from the release of the block before, or the start, until first contact, of blocks that crossed in the \
                  end. Place: from grasping to release, where the block crossed and was above its target region. Without the method: no \
                  joint of the arm went further than 0.05 rad."
            .to_owned(),
        headers: to_strings(&["Method", "action", "method used", "mean", "sd", "min", "max", "median", "n"]),
        rows,
    })
}

/// Blocks that ended on target, by trial and name.
pub(super) fn on_target(collected: &AnalysisData) -> BTreeSet<[String; 5]> {
    let Some(blocks) = collected.table("blocks") else { return BTreeSet::new() };
    let there = blocks.rows.iter().filter(|row| blocks.text(row, "outcome") == OUTCOMES[0].0);
    there.map(|row| block_key(blocks, row)).collect()
}

pub(super) fn block_key(table: &Table, row: &[TableCell]) -> [String; 5] {
    ["participant", "session", "condition", "trial", "block"].map(|name| table.text(row, name))
}

fn accuracy(collected: &AnalysisData, conditions: &[String]) -> Option<ReportTable> {
    let objects = collected.table("objects")?;
    let there = on_target(collected);
    let found = values(objects, "least_distance_mm", |row| there.contains(&block_key(objects, row)));
    (!found.is_empty()).then(|| ReportTable {
        name: "accuracy",
        title: "Accuracy".to_owned(),
        caption:
            "Smallest horizontal distance of a block from its target over the trial, mm, of blocks on target."
                .to_owned(),
        headers: to_strings(&SUMMARY_HEADERS),
        rows: summary_rows(conditions, &found, 1),
    })
}

/// Columns of a table of means by phase: name, title, caption, and of each column heading, name and digits.
type PhaseMeansTable =
    (&'static str, &'static str, &'static str, &'static [(&'static str, &'static str, usize)]);

const COMPENSATION: PhaseMeansTable = (
    "compensation",
    "Compensatory movement",
    "Means over the phases of a kind. Sums at 10 Hz are the paper's and depend on the step; ways are low-passed at 6 Hz. Share of the \
     shoulder: of the hand's straight way.",
    &[
        ("translation, sum at 10 Hz, m", "shoulder_sum10_m", 3),
        ("rotation, sum at 10 Hz, deg", "shoulder_turn_sum10_deg", 1),
        ("way, m", "shoulder_path_m", 3),
        ("range, mm", "shoulder_displacement_mm", 0),
        ("turn, deg", "shoulder_turn_deg", 1),
        ("trunk's turn, deg", "trunk_turn_deg", 1),
        ("share of the shoulder", "base_share", 2),
    ],
);
const GAZE: PhaseMeansTable = (
    "gaze_shares",
    "Gaze",
    "Means over the phases of a kind: shares of the time with a known gaze in looks of at least 80 ms within two degrees, and the eye's lead. The mode display has no place in the scene, and no share.",
    &[
        ("object", "gaze_object", 2),
        ("other objects", "gaze_other_objects", 2),
        ("target", "gaze_target", 2),
        ("hand", "gaze_hand", 2),
        ("arm", "gaze_arm", 2),
        ("elsewhere", "gaze_elsewhere", 2),
        ("arrival, ms", "eye_arrival_ms", 0),
        ("leaving, ms", "eye_leaving_ms", 0),
        ("switches", "eye_switches", 1),
    ],
);

fn phase_means_table(
    collected: &AnalysisData,
    conditions: &[String],
    means: PhaseMeansTable,
) -> Option<ReportTable> {
    let (name, title, caption, columns) = means;
    let table = collected.table("phases")?;
    let mut rows = Vec::new();
    let mut any = false;
    for condition in conditions {
        for phase in ["pick", "place"] {
            let is_own = |row: &[TableCell]| {
                table.text(row, "phase") == phase && table.text(row, "condition") == *condition
            };
            let count = table.rows.iter().filter(|row| is_own(row)).count();
            let mut row = vec![condition.clone(), phase.to_owned(), count.to_string()];
            for (_, column, digits) in columns {
                let found: Vec<f64> = values(table, column, is_own).into_iter().map(|v| v.value).collect();
                any |= !found.is_empty();
                row.push(format_optional(SampleSummary::of(&found).map(|summary| summary.mean), *digits));
            }
            rows.push(row);
        }
    }
    let heads = ["Method", "phase", "n"].into_iter().chain(columns.iter().map(|(head, ..)| *head));
    any.then(|| ReportTable {
        name,
        title: title.to_owned(),
        caption: caption.to_owned(),
        headers: heads.map(str::to_owned).collect(),
        rows,
    })
}

fn trials_of(collected: &AnalysisData, condition: &str) -> usize {
    let Some(measures) = collected.table("measures") else { return 0 };
    measures.rows.iter().filter(|row| measures.text(row, "condition") == condition).count()
}

fn faults(collected: &AnalysisData, conditions: &[String]) -> Option<ReportTable> {
    let faults = &collected.tables["faults"];
    collected.table("measures")?;
    let kinds: BTreeSet<String> = faults.rows.iter().map(|row| faults.text(row, "fault")).collect();
    let row = |kind: String| {
        let mut row = vec![kind.replace('_', " ")];
        for condition in conditions {
            let own = |row: &&Vec<TableCell>| {
                faults.text(row, "fault") == kind && faults.text(row, "condition") == *condition
            };
            let count = faults.rows.iter().filter(own).count();
            let trials = trials_of(collected, condition);
            let each = (trials > 0).then(|| count as f64 / trials as f64);
            row.push(format!("{count} ({})", format_optional(each, 2)));
        }
        row
    };
    Some(ReportTable {
        name: "faults",
        title: "What went wrong".to_owned(),
        caption:
            "Number of faults, and how many a trial, found from the record. docs/analysis.md defines each."
                .to_owned(),
        headers: std::iter::once("Fault".to_owned()).chain(conditions.iter().cloned()).collect(),
        rows: kinds.into_iter().map(row).collect(),
    })
}

fn emg(collected: &AnalysisData, conditions: &[String]) -> Option<ReportTable> {
    const COLUMNS: [(&str, &str, usize); 5] = [
        ("decisions a second", "decisions_per_s", 1),
        ("gesture changes", "gesture_changes", 1),
        ("false triggers", "false_triggers", 2),
        ("their time, ms", "false_trigger_ms", 0),
        ("gesture to motion, ms", "gesture_to_motion_ms", 0),
    ];
    let measures = collected.table("measures")?;
    let row = |condition: &String| {
        let mean = |column| {
            let own = values(measures, column, |row| measures.text(row, "condition") == *condition);
            SampleSummary::of(&own.iter().map(|v| v.value).collect::<Vec<_>>()).map(|summary| summary.mean)
        };
        let means = COLUMNS.iter().map(|(_, column, digits)| format_optional(mean(column), *digits));
        std::iter::once(condition.clone()).chain(means).collect()
    };
    Some(ReportTable {
        name: "emg",
        title: "Gestures".to_owned(),
        caption: "Means over trials. A false trigger is a gesture that came and went within 200 ms between two spells of one other gesture."
            .to_owned(),
        headers: std::iter::once("Method").chain(COLUMNS.map(|(head, ..)| head)).map(str::to_owned).collect(),
        rows: conditions.iter().map(row).collect(),
    })
}

fn trials(collected: &AnalysisData) -> Option<ReportTable> {
    let trials = collected.table("trials")?;
    let row = |row: &Vec<TableCell>| {
        let text = |name| trials.text(row, name);
        vec![
            participant(trials, row),
            text("condition"),
            text("trial"),
            [text("mark"), text("flaw")]
                .into_iter()
                .filter(|word| !word.is_empty())
                .collect::<Vec<_>>()
                .join(" "),
            trials.number(row, "score").map_or_else(|| "–".to_owned(), |score| format_number(score, 0)),
            format_optional(trials.number(row, "seconds"), 1),
            text("record"),
        ]
    };
    let mut rows: Vec<Vec<String>> = trials.rows.iter().map(row).collect();
    rows.sort_by_cached_key(|row| {
        (NaturalSortKey::of(row[0].clone()), row[1].clone(), NaturalSortKey::of(row[2].clone()))
    });
    Some(ReportTable {
        name: "trials",
        title: "All trials".to_owned(),
        caption: "A record is watched with: proact replay RECORD --page. With proact analyze DIR --page each record here is a link to its replay."
            .to_owned(),
        headers: to_strings(&["Participant", "Method", "trial", "mark", "score", "seconds", "record"]),
        rows,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_rounded_as_people_round_them() {
        assert_eq!(format_number(2.125, 2), "2.13");
        assert_eq!(format_number(2.208_333, 2), "2.21");
        assert_eq!(format_number(-0.001, 2), "0.00");
        assert_eq!(format_number(-1.5, 1), "-1.5");
    }

    #[test]
    fn people_stand_in_the_order_of_their_numbers() {
        let mut people = ["P10", "P2", "nobody", "P1"].map(|name| NaturalSortKey::of(name.to_owned()));
        people.sort();
        assert_eq!(people.map(|who| who.name), ["P1", "P2", "P10", "nobody"]);
    }
}
