//! The figures of the report.

use super::{
    AnalysisData,
    charts::ChartSpec,
    questionnaires::{parse_ranking, ratings_by_item, scores_by_form},
    summaries::{self, NaturalSortKey, OUTCOMES, block_key, conditions, on_target, participant},
};
use proact_analysis::{
    statistics::bootstrap_interval,
    summary::SampleSummary,
    table::{Table, TableCell},
};
use serde_json::{Value, json};
use std::collections::{BTreeMap, BTreeSet};

/// A figure, not yet drawn.
pub(super) struct Figure {
    /// Its files'.
    pub(super) name: &'static str,
    pub(super) title: &'static str,
    pub(super) caption: String,
    pub(super) spec: ChartSpec,
}

/// All figures for which there are data.
pub(super) fn figures(collected: &AnalysisData, seed: u64) -> Vec<Figure> {
    let order = conditions(collected);
    let all = [
        success(collected, &order),
        block_outcomes(collected, &order),
        over_trials(collected, &order),
        learning_curve(collected, &order, seed),
        durations(collected, &order, "pick"),
        durations(collected, &order, "place"),
        accuracy(collected, &order),
        compensation(collected, &order),
        gaze(collected, &order),
        false_triggers(collected, &order),
        gesture_to_motion(collected, &order),
        ratings(collected, &order),
        questionnaires(collected, &order),
        rankings(collected, &order),
        faults(collected, &order),
    ];
    all.into_iter().flatten().filter(|figure| !figure.spec.rows.is_empty()).collect()
}

fn strip(order: &[String], y: &str, rows: Vec<Value>) -> ChartSpec {
    ChartSpec {
        kind: "strip",
        rows,
        x: "method".into(),
        y: y.into(),
        order: order.to_vec(),
        ..ChartSpec::default()
    }
}

fn success(collected: &AnalysisData, order: &[String]) -> Option<Figure> {
    let trials = collected.table("trials")?;
    let found = summaries::values(trials, "score", |_| true);
    let rows = found.into_iter().map(|v| json!({"x": v.condition, "y": v.value})).collect();
    Some(Figure {
        name: "success",
        title: "Success by method",
        caption: "Score of each trial: a dot a trial, beside quartiles and range.".to_owned(),
        spec: strip(order, "score", rows),
    })
}

fn block_outcomes(collected: &AnalysisData, order: &[String]) -> Option<Figure> {
    let blocks = collected.table("blocks")?;
    let mut names = BTreeSet::new();
    let mut people = BTreeMap::new();
    for row in &blocks.rows {
        let outcome = blocks.text(row, "outcome");
        let Some((_, part, letter)) = OUTCOMES.iter().find(|(name, ..)| *name == outcome) else { continue };
        let trial = format!("{:>3} {}", blocks.text(row, "trial"), blocks.text(row, "block"));
        names.insert(trial.clone());
        let who = NaturalSortKey::of(participant(blocks, row));
        let cell = json!({"x": trial, "y": who.name, "facet": blocks.text(row, "condition"), "part": part, "letter": letter});
        people.entry(who).or_insert_with(Vec::new).push(cell);
    }
    // Each row once under each condition keeps the panels in their order.
    let mut rows: Vec<Value> = people.into_values().flatten().collect();
    rows.sort_by_key(|row| order.iter().position(|name| row["facet"] == **name));
    Some(Figure {
        name: "fates",
        title: "Fate of each block",
        caption: "A cell a block: a row a participant, a panel a method, trials from left to right."
            .to_owned(),
        spec: ChartSpec {
            kind: "grid",
            rows,
            x: String::new(),
            y: String::new(),
            order: names.into_iter().collect(),
            parts: OUTCOMES.iter().map(|(_, part, _)| (*part).to_owned()).collect(),
            axis_max: None,
        },
    })
}

fn lines(order: &[String], rows: Vec<Value>) -> ChartSpec {
    let (x, y) = ("trial".into(), "score".into());
    ChartSpec { kind: "lines", rows, x, y, parts: order.to_vec(), ..ChartSpec::default() }
}

fn over_trials(collected: &AnalysisData, order: &[String]) -> Option<Figure> {
    let trials = collected.table("trials")?;
    let mut rows: Vec<(NaturalSortKey, f64, Value)> = Vec::new();
    for row in &trials.rows {
        let (Some(trial), Some(score)) = (trials.number(row, "trial"), trials.number(row, "score")) else {
            continue;
        };
        let who = NaturalSortKey::of(participant(trials, row));
        let point = json!({"x": trial, "y": score, "part": trials.text(row, "condition"), "facet": who.name});
        rows.push((who, trial, point));
    }
    rows.sort_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
    let people: BTreeSet<&NaturalSortKey> = rows.iter().map(|(who, ..)| who).collect();
    // More panels than this are no figure.
    if people.len() > 12 || rows.iter().all(|(_, trial, _)| *trial == 1.0) {
        return None;
    }
    Some(Figure {
        name: "over_trials",
        title: "Success over trials, by participant",
        caption: "Score of each trial in the order of the trials of a method; a panel a participant."
            .to_owned(),
        spec: lines(order, rows.into_iter().map(|(.., point)| point).collect()),
    })
}

fn learning_curve(collected: &AnalysisData, order: &[String], seed: u64) -> Option<Figure> {
    let trials = collected.table("trials")?;
    let mut scores: BTreeMap<(String, i64), Vec<f64>> = BTreeMap::new();
    for row in &trials.rows {
        let (Some(trial), Some(score)) = (trials.number(row, "trial"), trials.number(row, "score")) else {
            continue;
        };
        scores.entry((trials.text(row, "condition"), trial as i64)).or_default().push(score);
    }
    if scores.keys().all(|(_, trial)| *trial == 1) {
        return None;
    }
    let rows = scores.into_iter().filter_map(|((condition, trial), own)| {
        let mean = SampleSummary::of(&own)?.mean;
        let of = |indices: &[usize]| Some(indices.iter().map(|index| own[*index]).sum::<f64>() / indices.len() as f64);
        let interval = bootstrap_interval(own.len(), seed, of);
        Some(json!({"x": trial, "y": mean, "part": condition, "low": interval.map(|i| i.low), "high": interval.map(|i| i.high)}))
    });
    Some(Figure {
        name: "learning",
        title: "Learning over trials",
        caption: "Mean score by the number of the trial of its method, with bootstrap intervals of the mean (95 %).".to_owned(),
        spec: lines(order, rows.collect()),
    })
}

fn durations(collected: &AnalysisData, order: &[String], action: &'static str) -> Option<Figure> {
    let objects = collected.table("objects")?;
    let (seconds, with) = (format!("{action}_s"), format!("{action}_with_method"));
    let mut counts: BTreeMap<(String, bool), usize> = BTreeMap::new();
    let mut rows = Vec::new();
    for row in &objects.rows {
        let (Some(secs), Some(used)) = (objects.number(row, &seconds), objects.number(row, &with)) else {
            continue;
        };
        let (condition, used) = (objects.text(row, "condition"), used == 1.0);
        *counts.entry((condition.clone(), used)).or_default() += 1;
        let facet = if used { "with the method" } else { "without the method" };
        rows.push(json!({"x": condition, "y": secs, "facet": facet}));
    }
    rows.sort_by_key(|row| row["facet"] == "with the method");
    let number = |name: &String, used| counts.get(&(name.clone(), used)).copied().unwrap_or(0);
    let counted: Vec<String> =
        order.iter().map(|name| format!("{name} {}/{}", number(name, false), number(name, true))).collect();
    let (name, title) = match action {
        "pick" => ("pick_durations", "Pick durations"),
        _ => ("place_durations", "Place durations"),
    };
    Some(Figure {
        name,
        title,
        caption: format!(
            "A dot an action, lower is better. Actions without/with use of the method: {}.",
            counted.join(", ")
        ),
        spec: strip(order, &format!("{action} duration, s"), rows),
    })
}

fn accuracy(collected: &AnalysisData, order: &[String]) -> Option<Figure> {
    let objects = collected.table("objects")?;
    let there = on_target(collected);
    let found =
        summaries::values(objects, "least_distance_mm", |row| there.contains(&block_key(objects, row)));
    let rows = found.into_iter().map(|v| json!({"x": v.condition, "y": v.value})).collect();
    Some(Figure {
        name: "accuracy",
        title: "Accuracy",
        caption: "Smallest distance of a block from its target over the trial, of blocks on target."
            .to_owned(),
        spec: strip(order, "least distance, mm", rows),
    })
}

fn compensation(collected: &AnalysisData, order: &[String]) -> Option<Figure> {
    let phases = collected.table("phases")?;
    let mut rows = Vec::new();
    for (phase, facet) in [("pick", "picks"), ("place", "places")] {
        let found = summaries::values(phases, "shoulder_path_m", |row| phases.text(row, "phase") == phase);
        rows.extend(found.into_iter().map(|v| json!({"x": v.condition, "y": v.value, "facet": facet})));
    }
    Some(Figure {
        name: "compensation",
        title: "Compensatory movement",
        caption: "Way of the shoulder in each pick and place, low-passed at 6 Hz.".to_owned(),
        spec: strip(order, "way of the shoulder, m", rows),
    })
}

/// Means of several columns as parts of a bar.
fn stacked_means(
    table: &Table,
    order: &[String],
    facet: &str,
    columns: &[(&str, &str)],
    wanted: impl Fn(&[TableCell]) -> bool,
) -> Vec<Value> {
    let mut rows = Vec::new();
    for condition in order {
        for (column, part) in columns {
            let own = |row: &[TableCell]| wanted(row) && table.text(row, "condition") == *condition;
            let found: Vec<f64> =
                summaries::values(table, column, own).into_iter().map(|v| v.value).collect();
            if let Some(summary) = SampleSummary::of(&found) {
                rows.push(json!({"x": condition, "value": summary.mean, "part": part, "facet": facet}));
            }
        }
    }
    rows
}

fn gaze(collected: &AnalysisData, order: &[String]) -> Option<Figure> {
    const COLUMNS: [(&str, &str); 6] = [
        ("gaze_object", "object"),
        ("gaze_target", "target"),
        ("gaze_hand", "hand"),
        ("gaze_arm", "arm"),
        ("gaze_other_objects", "other objects"),
        ("gaze_elsewhere", "elsewhere"),
    ];
    let phases = collected.table("phases")?;
    let rows = [("pick", "picks"), ("place", "places")].into_iter().flat_map(|(phase, facet)| {
        stacked_means(phases, order, facet, &COLUMNS, |row| phases.text(row, "phase") == phase)
    });
    Some(Figure {
        name: "gaze",
        title: "Where the eyes were",
        caption:
            "Mean shares of the time with a known gaze; what is missing to one were looks shorter than 80 ms."
                .to_owned(),
        spec: ChartSpec {
            kind: "bars",
            rows: rows.collect(),
            x: "method".into(),
            y: "share of the time".into(),
            order: order.to_vec(),
            parts: COLUMNS.map(|(_, part)| part.to_owned()).to_vec(),
            axis_max: Some(1.0),
        },
    })
}

/// A measure of the gestures, a dot a trial; their units differ, so that each has a figure.
fn gesture_measure_chart(
    collected: &AnalysisData,
    order: &[String],
    column: &str,
    y: &str,
) -> Option<ChartSpec> {
    let measures = collected.table("measures")?;
    let found = summaries::values(measures, column, |_| true);
    let rows = found.into_iter().map(|v| json!({"x": v.condition, "y": v.value})).collect();
    Some(strip(order, y, rows))
}

fn false_triggers(collected: &AnalysisData, order: &[String]) -> Option<Figure> {
    Some(Figure {
        name: "false_triggers",
        title: "False triggers",
        caption: "Gestures of a trial that came and went within 200 ms between two spells of one other gesture: a dot a trial, beside quartiles and range."
            .to_owned(),
        spec: gesture_measure_chart(collected, order, "false_triggers", "false triggers a trial")?,
    })
}

fn gesture_to_motion(collected: &AnalysisData, order: &[String]) -> Option<Figure> {
    Some(Figure {
        name: "gesture_to_motion",
        title: "From gesture to motion",
        caption: "Median of a trial of the time from a gesture to the motion of the arm that followed: a dot a trial, beside quartiles and range."
            .to_owned(),
        spec: gesture_measure_chart(collected, order, "gesture_to_motion_ms", "ms")?,
    })
}

fn ratings(collected: &AnalysisData, order: &[String]) -> Option<Figure> {
    let mut rows = Vec::new();
    let rated = ratings_by_item(collected);
    // Those of long instruments are in their scores.
    let forms: BTreeMap<&String, usize> = rated.keys().fold(BTreeMap::new(), |mut forms, (form, _)| {
        *forms.entry(form).or_default() += 1;
        forms
    });
    for ((form, item), found) in &rated {
        if forms.get(form).is_some_and(|items| *items <= 5) {
            let facet = item.replace('_', " ");
            rows.extend(found.iter().map(|v| json!({"x": v.condition, "y": v.value, "facet": facet})));
        }
    }
    Some(Figure {
        name: "ratings",
        title: "Ratings after each method",
        caption: "Answers on scales, a panel an item.".to_owned(),
        spec: strip(order, "rating", rows),
    })
}

fn questionnaires(collected: &AnalysisData, order: &[String]) -> Option<Figure> {
    let mut rows = Vec::new();
    for (name, found) in scores_by_form(collected) {
        rows.extend(found.iter().map(|v| json!({"x": v.condition, "y": v.value, "facet": name})));
    }
    Some(Figure {
        name: "questionnaires",
        title: "Scores of questionnaires",
        caption: "A dot a person.".to_owned(),
        spec: strip(order, "score", rows),
    })
}

fn rankings(collected: &AnalysisData, order: &[String]) -> Option<Figure> {
    let answers = collected.table("answers")?;
    let mut counts: BTreeMap<(String, String, usize), usize> = BTreeMap::new();
    for row in &answers.rows {
        let Some(ranks) = parse_ranking(&answers.text(row, "answer"), order) else { continue };
        let item = answers.text(row, "item").replace('_', " ");
        // Whoever shares the first place is first; behind two firsts comes the third.
        let mut before = 0;
        for names in ranks {
            for name in &names {
                *counts.entry((item.clone(), name.clone(), before + 1)).or_default() += 1;
            }
            before += names.len();
        }
    }
    let part = |index: usize| format!("place {index}");
    let rows = counts.into_iter().map(
        |((item, name, index), count)| json!({"x": name, "value": count, "part": part(index), "facet": item}),
    );
    Some(Figure {
        name: "rankings",
        title: "Rankings",
        caption: "How many people put a method in which place; a shared place is the better one.".to_owned(),
        spec: ChartSpec {
            kind: "bars",
            rows: rows.collect(),
            x: "method".into(),
            y: "people".into(),
            order: order.to_vec(),
            parts: (1..=order.len()).map(part).collect(),
            axis_max: None,
        },
    })
}

fn faults(collected: &AnalysisData, order: &[String]) -> Option<Figure> {
    let faults = collected.table("faults")?;
    let measures = collected.table("measures")?;
    let mut counts: BTreeMap<(String, String), usize> = BTreeMap::new();
    for row in &faults.rows {
        let part = faults.text(row, "fault").replace('_', " ");
        *counts.entry((part, faults.text(row, "condition"))).or_default() += 1;
    }
    let parts: BTreeSet<String> = counts.keys().map(|(part, _)| part.clone()).collect();
    let rows = counts.into_iter().map(|((part, condition), count)| {
        let trials = measures.rows.iter().filter(|row| measures.text(row, "condition") == condition).count();
        json!({"x": condition, "value": count as f64 / trials.max(1) as f64, "part": part})
    });
    Some(Figure {
        name: "faults",
        title: "What went wrong",
        caption: "Mean number of faults a trial, by kind.".to_owned(),
        spec: ChartSpec {
            kind: "bars",
            rows: rows.collect(),
            x: "method".into(),
            y: "faults a trial".into(),
            order: order.to_vec(),
            parts: parts.into_iter().collect(),
            axis_max: None,
        },
    })
}
