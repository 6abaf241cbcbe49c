//! The statistics of the report: each measure under all conditions.

use super::{
    Collected,
    questionnaires::{rated, scored},
    summaries::{self, ReportTable, Value, block_key, chance, conditions, on_target, printed, values},
};
use proact_analysis::statistics::{ConditionComparison, Interval, Repeated, compare};
use proact_analysis::summary::SampleSummary;
use serde::Serialize;
use std::collections::BTreeMap;

/// A measure that was compared.
#[derive(Clone, Debug, Serialize)]
pub(super) struct Compared {
    /// What was measured.
    pub(super) measure: String,
    /// People with any value.
    pub(super) people: usize,
    /// What was found.
    #[serde(flatten)]
    pub(super) comparison: ConditionComparison,
}

/// How several values of a person under a condition become one.
#[derive(Clone, Copy)]
enum Each {
    Mean,
    Median,
}

/// Everything of which there is a value a person and condition: its name, how several values become one, and the values.
fn measures(collected: &Collected) -> Vec<(String, Each, Vec<Value>)> {
    let mut measures: Vec<(String, Each, Vec<Value>)> = Vec::new();
    let mut add = |name: &str, each, found: Vec<Value>| {
        if !found.is_empty() {
            measures.push((name.to_owned(), each, found));
        }
    };
    let of = |table: &str, column: &str| {
        collected.table(table).map_or_else(Vec::new, |table| values(table, column, |_| true))
    };
    add("Score, mean of the trials", Each::Mean, of("trials", "score"));
    add("Trial, s, mean of the trials", Each::Mean, of("trials", "seconds"));
    add("Pick, s, median", Each::Median, of("objects", "pick_s"));
    add("Place, s, median", Each::Median, of("objects", "place_s"));
    if let Some(objects) = collected.table("objects") {
        let there = on_target(collected);
        let found = values(objects, "least_distance_mm", |row| there.contains(&block_key(objects, row)));
        add("Least distance of blocks on target, mm, median", Each::Median, found);
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
            add(name, Each::Mean, values(phases, column, |row| phases.words(row, "phase") == phase));
        }
    }
    add("False triggers a trial, mean", Each::Mean, of("measures", "false_triggers"));
    for ((form, item), found) in rated(collected) {
        add(&format!("{form}: {item}, mean"), Each::Mean, found);
    }
    for (name, found) in scored(collected) {
        add(&format!("{name}, mean"), Each::Mean, found);
    }
    measures
}

/// Compares the conditions in all measures.
pub(super) fn compare_all(collected: &Collected, seed: u64) -> Vec<Compared> {
    let conditions = conditions(collected);
    let compared = measures(collected).into_iter().filter_map(|(measure, each, found)| {
        let values = repeated(&conditions, &found, each)?;
        Some(Compared { measure, people: values.people(), comparison: compare(&values, seed) })
    });
    compared.collect()
}

/// Mean scores of people.
pub(super) fn repeated_scores(conditions: &[String], found: &[Value]) -> Option<Repeated> {
    repeated(conditions, found, Each::Mean)
}

/// What each person has under each condition, by person.
fn by_person(
    conditions: &[String],
    found: &[Value],
    each: Each,
) -> Vec<(summaries::Ordered, Vec<Option<f64>>)> {
    let mut people: BTreeMap<summaries::Ordered, Vec<Vec<f64>>> = BTreeMap::new();
    for value in found {
        let Some(place) = conditions.iter().position(|name| *name == value.condition) else { continue };
        let of = summaries::Ordered::of(value.participant.clone());
        people.entry(of).or_insert_with(|| vec![Vec::new(); conditions.len()])[place].push(value.value);
    }
    let one = |own: Vec<f64>| {
        let summary = SampleSummary::of(&own)?;
        Some(match each {
            Each::Mean => summary.mean,
            Each::Median => summary.median,
        })
    };
    people.into_iter().map(|(of, row)| (of, row.into_iter().map(one).collect())).collect()
}

/// All measures of each person, a row a measure and person, a column a condition.
pub(super) fn by_participant(collected: &Collected) -> Option<ReportTable> {
    let conditions = conditions(collected);
    let mut rows = Vec::new();
    for (measure, each, found) in measures(collected) {
        for (of, values) in by_person(&conditions, &found, each) {
            let numbers = values.into_iter().map(|value| between(value, None, 2));
            rows.push([measure.clone(), of.name.clone()].into_iter().chain(numbers).collect());
        }
    }
    let head = ["Measure", "participant"].map(str::to_owned).into_iter().chain(conditions).collect();
    let caption = "One value a person and method: the mean or median, as the measure says, of that person's trials, blocks or phases. \
                   These are what the tests compare."
        .to_owned();
    let title = "Each participant".to_owned();
    (!rows.is_empty()).then_some(ReportTable { name: "by_participant", title, caption, head, rows })
}

fn repeated(conditions: &[String], found: &[Value], each: Each) -> Option<Repeated> {
    let rows = by_person(conditions, found, each).into_iter().map(|(_, row)| row).collect();
    Repeated::new(conditions.to_vec(), rows).ok().filter(|_| conditions.len() > 1)
}

fn between(estimate: Option<f64>, interval: Option<Interval>, digits: usize) -> String {
    let Some(estimate) = estimate else { return "–".to_owned() };
    let estimate = printed(estimate, digits);
    interval.map_or_else(
        || estimate.clone(),
        |interval| {
            format!("{estimate} [{}, {}]", printed(interval.low, digits), printed(interval.high, digits))
        },
    )
}

/// The tests as tables.
pub(super) fn tables(compared: &[Compared]) -> Vec<ReportTable> {
    let mut any = Vec::new();
    let mut pairs = Vec::new();
    for Compared { measure, comparison, .. } in compared {
        if let Some(test) = &comparison.friedman {
            any.push(vec![
                measure.clone(),
                test.n.to_string(),
                printed(test.statistic, 2),
                test.degrees_of_freedom.to_string(),
                chance(test.p),
                test.chance.label().to_owned(),
                between(Some(test.kendalls_w), comparison.kendalls_w_interval, 2),
            ]);
        }
        for pair in &comparison.pairs {
            let ranked = pair.wilcoxon.as_ref();
            let effect = pair.effect.as_ref();
            pairs.push(vec![
                measure.clone(),
                format!("{} – {}", pair.b, pair.a),
                pair.n.to_string(),
                between(effect.map(|e| e.mean), effect.and_then(|e| e.mean_interval), 2),
                ranked.map_or_else(|| "–".to_owned(), |test| printed(test.w_plus, 1)),
                ranked.map_or_else(
                    || "–".to_owned(),
                    |test| format!("{} ({})", chance(test.p), test.chance.label()),
                ),
                pair.p_holm.map_or_else(|| "–".to_owned(), chance),
                pair.permutation.map_or_else(|| "–".to_owned(), |test| chance(test.p)),
                between(
                    effect.and_then(|e| e.rank_biserial),
                    effect.and_then(|e| e.rank_biserial_interval),
                    2,
                ),
                between(effect.and_then(|e| e.g), effect.and_then(|e| e.g_interval), 2),
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
            head: heads(&["Measure", "n", "chi square", "df", "p", "how", "W"]),
            rows: any,
        },
        ReportTable {
            name: "pairs",
            title: "Which two differ, and how much?".to_owned(),
            caption: "Differences of people: the first method less the second. W+ and p of Wilcoxon's signed ranks; p corrected by Holm \
                      over the pairs of a measure, not over measures; p of the paired permutation test of the mean; matched-pairs \
                      rank-biserial correlation and Hedges' g of the differences. Intervals: bootstrap over people, 95 %, BCa."
                .to_owned(),
            head: heads(&[
                "Measure", "pair", "n", "mean difference", "W+", "p", "p, Holm", "p, permutation", "rank-biserial", "g",
            ]),
            rows: pairs,
        },
    ];
    made.into_iter().filter(|table| !table.rows.is_empty()).collect()
}
