//! The statistics of the report: each measure under all conditions.

use super::{
    AnalysisData,
    questionnaires::{ratings_by_item, scores_by_form},
    summaries::{
        self, ParticipantValue, ReportTable, block_key, conditions, format_number, format_p_value, on_target,
        values,
    },
};
use proact_analysis::{
    statistics::{ConditionComparison, ConfidenceInterval, RepeatedMeasures, compare_conditions},
    summary::SampleSummary,
    table::{Table, TableCell},
};
use serde::Serialize;
use std::collections::BTreeMap;

/// A measure that was compared.
#[derive(Clone, Debug, Serialize)]
pub(super) struct MeasureComparison {
    /// What was measured.
    pub(super) measure: String,
    /// People with any value.
    #[serde(rename = "people")]
    pub(super) participants: usize,
    /// What was found.
    #[serde(flatten)]
    pub(super) comparison: ConditionComparison,
}

/// How several values of a person under a condition become one.
#[derive(Clone, Copy)]
enum Aggregation {
    Mean,
    Median,
}

/// Everything of which there is a value a person and condition: its name, how several values become one, and the values.
fn measures(collected: &AnalysisData) -> Vec<(String, Aggregation, Vec<ParticipantValue>)> {
    let mut measures: Vec<(String, Aggregation, Vec<ParticipantValue>)> = Vec::new();
    let mut add = |name: &str, each, found: Vec<ParticipantValue>| {
        if !found.is_empty() {
            measures.push((name.to_owned(), each, found));
        }
    };
    let of = |table: &str, column: &str| {
        collected.table(table).map_or_else(Vec::new, |table| values(table, column, |_| true))
    };
    add("Score, mean of the trials", Aggregation::Mean, of("trials", "score"));
    // Only whole trials show how long a trial takes and how often something happens in it.
    let of_whole = |table: &str, column: &str| {
        let is_whole = |table: &Table, row: &[TableCell]| {
            !table.text(row, "flaw").split(',').any(|flaw| ["cut", "interrupted"].contains(&flaw))
        };
        collected
            .table(table)
            .map_or_else(Vec::new, |table| values(table, column, |row| is_whole(table, row)))
    };
    add("Trial, s, mean of the trials", Aggregation::Mean, of_whole("trials", "seconds"));
    add("Pick, s, median", Aggregation::Median, of("objects", "pick_s"));
    add("Place, s, median", Aggregation::Median, of("objects", "place_s"));
    if let Some(objects) = collected.table("objects") {
        let there = on_target(collected);
        let found = values(objects, "least_distance_mm", |row| there.contains(&block_key(objects, row)));
        add("Least distance of blocks on target, mm, median", Aggregation::Median, found);
    }
    if let Some(phases) = collected.table("phases") {
        for (phase, column, name) in [
            ("pick", "shoulder_path_m", "Way of the shoulder in picks, m, mean"),
            ("place", "shoulder_path_m", "Way of the shoulder in places, m, mean"),
            ("pick", "shoulder_turn_deg", "Turn of the shoulder in picks, deg, mean"),
            ("place", "shoulder_turn_deg", "Turn of the shoulder in places, deg, mean"),
            ("pick", "gaze_hand", "Gaze on the hand in picks, share, mean"),
            ("place", "gaze_target", "Gaze on the target in places, share, mean"),
        ] {
            add(name, Aggregation::Mean, values(phases, column, |row| phases.text(row, "phase") == phase));
        }
    }
    add("False triggers a trial, mean", Aggregation::Mean, of_whole("measures", "false_triggers"));
    for ((form, item), found) in ratings_by_item(collected) {
        add(&format!("{form}: {item}, mean"), Aggregation::Mean, found);
    }
    for (name, found) in scores_by_form(collected) {
        add(&format!("{name}, mean"), Aggregation::Mean, found);
    }
    measures
}

/// Compares the conditions in all measures.
pub(super) fn compare_all(collected: &AnalysisData, seed: u64) -> Vec<MeasureComparison> {
    let conditions = conditions(collected);
    let compared = measures(collected).into_iter().filter_map(|(measure, each, found)| {
        let values = repeated_measures(&conditions, &found, each)?;
        Some(MeasureComparison {
            measure,
            participants: values.participant_count(),
            comparison: compare_conditions(&values, seed),
        })
    });
    compared.collect()
}

/// Mean scores of people.
pub(super) fn mean_scores_by_participant(
    conditions: &[String],
    found: &[ParticipantValue],
) -> Option<RepeatedMeasures> {
    repeated_measures(conditions, found, Aggregation::Mean)
}

/// What each person has under each condition, by person.
fn values_by_participant(
    conditions: &[String],
    found: &[ParticipantValue],
    each: Aggregation,
) -> Vec<(summaries::NaturalSortKey, Vec<Option<f64>>)> {
    let mut people: BTreeMap<summaries::NaturalSortKey, Vec<Vec<f64>>> = BTreeMap::new();
    for value in found {
        let Some(index) = conditions.iter().position(|name| *name == value.condition) else { continue };
        let of = summaries::NaturalSortKey::of(value.participant.clone());
        people.entry(of).or_insert_with(|| vec![Vec::new(); conditions.len()])[index].push(value.value);
    }
    let one = |own: Vec<f64>| {
        let summary = SampleSummary::of(&own)?;
        Some(match each {
            Aggregation::Mean => summary.mean,
            Aggregation::Median => summary.median,
        })
    };
    people.into_iter().map(|(of, row)| (of, row.into_iter().map(one).collect())).collect()
}

/// All measures of each person, a row a measure and person, a column a condition.
pub(super) fn by_participant(collected: &AnalysisData) -> Option<ReportTable> {
    let conditions = conditions(collected);
    let mut rows = Vec::new();
    for (measure, each, found) in measures(collected) {
        for (of, values) in values_by_participant(&conditions, &found, each) {
            let numbers = values.into_iter().map(|value| format_estimate_with_interval(value, None, 2));
            rows.push([measure.clone(), of.name.clone()].into_iter().chain(numbers).collect());
        }
    }
    let head = ["Measure", "participant"].map(str::to_owned).into_iter().chain(conditions).collect();
    let caption = "One value a person and method: the mean or median, as the measure says, of that person's trials, blocks or phases. \
                   These are what the tests compare."
        .to_owned();
    let title = "Each participant".to_owned();
    (!rows.is_empty()).then_some(ReportTable { name: "by_participant", title, caption, headers: head, rows })
}

fn repeated_measures(
    conditions: &[String],
    found: &[ParticipantValue],
    each: Aggregation,
) -> Option<RepeatedMeasures> {
    let rows = values_by_participant(conditions, found, each).into_iter().map(|(_, row)| row).collect();
    RepeatedMeasures::new(conditions.to_vec(), rows).ok().filter(|_| conditions.len() > 1)
}

fn format_estimate_with_interval(
    estimate: Option<f64>,
    interval: Option<ConfidenceInterval>,
    digits: usize,
) -> String {
    let Some(estimate) = estimate else { return "–".to_owned() };
    let estimate = format_number(estimate, digits);
    interval.map_or_else(
        || estimate.clone(),
        |interval| {
            format!(
                "{estimate} [{}, {}]",
                format_number(interval.low, digits),
                format_number(interval.high, digits)
            )
        },
    )
}

/// The tests as tables.
pub(super) fn tables(compared: &[MeasureComparison]) -> Vec<ReportTable> {
    let mut any = Vec::new();
    let mut pairs = Vec::new();
    for MeasureComparison { measure, comparison, .. } in compared {
        if let Some(test) = &comparison.friedman {
            any.push(vec![
                measure.clone(),
                test.n.to_string(),
                format_number(test.statistic, 2),
                test.degrees_of_freedom.to_string(),
                format_p_value(test.p),
                test.p_method.label().to_owned(),
                format_estimate_with_interval(Some(test.kendalls_w), comparison.kendalls_w_interval, 2),
            ]);
        }
        for pair in &comparison.pairs {
            let ranked = pair.wilcoxon.as_ref();
            let effect = pair.effect.as_ref();
            pairs.push(vec![
                measure.clone(),
                format!("{} – {}", pair.b, pair.a),
                pair.n.to_string(),
                format_estimate_with_interval(
                    effect.map(|e| e.mean),
                    effect.and_then(|e| e.mean_interval),
                    2,
                ),
                ranked.map_or_else(|| "–".to_owned(), |test| format_number(test.w_plus, 1)),
                ranked.map_or_else(
                    || "–".to_owned(),
                    |test| format!("{} ({})", format_p_value(test.p), test.p_method.label()),
                ),
                pair.p_holm.map_or_else(|| "–".to_owned(), format_p_value),
                pair.permutation.map_or_else(|| "–".to_owned(), |test| format_p_value(test.p)),
                format_estimate_with_interval(
                    effect.and_then(|e| e.rank_biserial),
                    effect.and_then(|e| e.rank_biserial_interval),
                    2,
                ),
                format_estimate_with_interval(
                    effect.and_then(|e| e.hedges_g),
                    effect.and_then(|e| e.hedges_g_interval),
                    2,
                ),
            ]);
        }
    }
    let heads = |names: &[&str]| names.iter().map(|name| (*name).to_owned()).collect();
    let made = [
        ReportTable {
            name: "friedman",
            title: "Does any method differ?".to_owned(),
            caption: "Friedman's test over people, with Kendall's W and its bootstrap interval (95 %, BCa). p is exact where it says so."
                .to_owned(),
            headers: heads(&["Measure", "n", "chi square", "df", "p", "how", "W"]),
            rows: any,
        },
        ReportTable {
            name: "pairs",
            title: "Which two differ, and how much?".to_owned(),
            caption: "Differences of people: the first method less the second. W+ and p of Wilcoxon's signed ranks; p corrected by Holm \
                      over the pairs of a measure, not over measures; p of the paired permutation test of the mean; matched-pairs \
                      rank-biserial correlation and Hedges' g of the differences. Intervals: bootstrap over people, 95 %, BCa."
                .to_owned(),
            headers: heads(&[
                "Measure", "pair", "n", "mean difference", "W+", "p", "p, Holm", "p, permutation", "rank-biserial", "g",
            ]),
            rows: pairs,
        },
    ];
    made.into_iter().filter(|table| !table.rows.is_empty()).collect()
}
