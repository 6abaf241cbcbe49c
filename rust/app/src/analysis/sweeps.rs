//! What came of varied values: a tidy table, a curve of one key, heat maps of two.

use super::{
    charts::{ChartSpec, Charts},
    html::{self, ReportHeader, ReportSection},
    summaries::{ReportTable, format_number},
};
use crate::batch::{BatchFolder, ConditionSummary, MergedBatch, SIMULATED_DISCLAIMER, Sweep};
use proact_analysis::summary::SampleSummary;
use proact_files::{make_folder, write_atomically};
use serde_json::json;
use std::{collections::BTreeMap, error::Error, path::PathBuf};

/// More heat maps than this are not looked at; the table has all.
const MAX_HEAT_MAPS: usize = 24;

/// Where the report on a sweep is.
#[derive(Clone, Debug)]
pub struct SweepReport {
    /// The page.
    pub page: PathBuf,
    /// Figures as SVG, by name; a PNG is beside each.
    pub figures: BTreeMap<String, PathBuf>,
    /// The table, a row a cell and condition.
    pub table: PathBuf,
}

/// Writes the report on a sweep into its folder; none if nothing was varied.
///
/// # Errors
/// A disk that refuses, a figure that cannot be drawn.
pub fn sweep_report(
    folder: &BatchFolder,
    merged: &MergedBatch,
) -> Result<Option<SweepReport>, Box<dyn Error>> {
    let sweep = Sweep::parse(&folder.description.vary)?;
    let keys: Vec<&str> = sweep.keys().collect();
    if keys.is_empty() {
        return Ok(None);
    }
    let found: BTreeMap<String, ConditionSummary> =
        merged.tally.clone().summaries().into_iter().map(|own| (own.condition.clone(), own)).collect();
    let mut table = ReportTable {
        name: "sweep",
        title: "Scores by cell".to_owned(),
        caption: format!("A row a cell and method. {SIMULATED_DISCLAIMER}"),
        headers: keys
            .iter()
            .copied()
            .chain(["method", "trials", "mean", "sd", "min", "median", "max", "score_name"])
            .map(str::to_owned)
            .collect(),
        rows: Vec::new(),
    };
    let mut points = Vec::new();
    for cell in 0..sweep.cells() {
        let values = sweep.cell(cell);
        for condition in &folder.description.conditions {
            let Some(ConditionSummary { scores, score_name, .. }) =
                found.get(&crate::batch::label(condition, &values))
            else {
                continue;
            };
            let number = |of: fn(&SampleSummary) -> f64| scores.as_ref().map(of);
            let numbers = [
                number(|scores| scores.mean),
                scores.and_then(|scores| scores.sd),
                number(|scores| scores.min),
                number(|scores| scores.median),
                number(|scores| scores.max),
            ];
            let row = values
                .iter()
                .map(|(_, value)| (*value).to_owned())
                .chain([condition.clone(), scores.map_or(0, |scores| scores.count).to_string()]);
            let row =
                row.chain(numbers.map(|number| number.map_or_else(String::new, |number| number.to_string())));
            table.rows.push(row.chain([score_name.clone()]).collect());
            // A cell whose trials all failed is left open.
            points.extend(scores.map(|scores| {
                let values: Vec<String> = values.iter().map(|(_, value)| (*value).to_owned()).collect();
                (values, condition.clone(), scores.mean)
            }));
        }
    }
    let figures = figures(&sweep, &keys, &points);
    let out = folder.dir.join("sweep");
    make_folder(&out)?;
    let path = folder.dir.join("sweep.csv");
    write_atomically(&path, &super::report::report_table_csv(&table)?)?;
    let mut report = SweepReport { page: out.join("report.html"), figures: BTreeMap::new(), table: path };
    let charts = Charts::new()?;
    let mut drawn = Vec::new();
    for (name, title, spec) in &figures {
        let svg = charts.draw(spec)?;
        let (file, png) = charts.svg_and_png(&svg)?;
        let path = out.join(format!("{name}.svg"));
        write_atomically(&path, &file)?;
        write_atomically(&path.with_extension("png"), png)?;
        report.figures.insert(name.clone(), path);
        drawn.push((name, title, svg));
    }
    // Read by people on the page; the file keeps every digit.
    let mut shown = table.clone();
    for cell in shown.rows.iter_mut().flat_map(|row| row[keys.len() + 2..keys.len() + 7].iter_mut()) {
        *cell = cell.parse().map_or_else(|_| "–".to_owned(), |number| format_number(number, 2));
    }
    let caption = "Mean score of the trials of a cell, by method.";
    let mut parts: Vec<ReportSection<'_>> =
        drawn.iter().map(|(name, title, svg)| ReportSection::Figure(name, title, caption, svg)).collect();
    parts.push(ReportSection::Table(&shown));
    let about = format!("{} trials, {} cells of {}.", merged.scores.len(), sweep.cells(), keys.join(" and "));
    let head = ReportHeader {
        title: "Sweep",
        data_description: about,
        simulated: true,
        notes: &[],
        assumptions: &[],
        replays: html::ReplayLinks::Command,
    };
    write_atomically(&report.page, html::page(&head, &parts))?;
    Ok(Some(report))
}

type SweepPoint = (Vec<String>, String, f64);

/// Name, title and figure: one key as a strip of cells by method, two as a heat map with a panel a method, and of more a heat map of
/// the first two for all values of the others.
fn figures(sweep: &Sweep, keys: &[&str], points: &[SweepPoint]) -> Vec<(String, String, ChartSpec)> {
    let mut rest: Vec<Vec<String>> =
        points.iter().map(|(values, ..)| values.iter().skip(2).cloned().collect()).collect();
    rest.dedup();
    let mut seen: Vec<Vec<String>> = Vec::new();
    rest.into_iter().for_each(|own| {
        if !seen.contains(&own) {
            seen.push(own)
        }
    });
    let map = |(k, others): (usize, &Vec<String>)| {
        let own = points.iter().filter(|(values, ..)| values.iter().skip(2).eq(others.iter()));
        let cell = |(values, condition, mean): &SweepPoint| {
            let y = values.get(1).unwrap_or(condition);
            let mut cell =
                json!({ "x": values[0], "y": y, "value": mean, "letter": format_number(*mean, 1) });
            if let (true, Some(cell)) = (keys.len() > 1, cell.as_object_mut()) {
                cell.insert("facet".into(), json!(condition));
            }
            cell
        };
        let max_mean = points.iter().map(|(.., mean)| *mean).fold(0.0, f64::max);
        let title: String =
            keys.iter().skip(2).zip(others).map(|(key, value)| format!(", {key} = {value}")).collect();
        let spec = ChartSpec {
            kind: "heat",
            rows: own.map(cell).collect(),
            x: keys[0].to_owned(),
            y: keys.get(1).map_or_else(|| "method".to_owned(), |key| (*key).to_owned()),
            order: sweep.values(0).to_vec(),
            parts: Vec::new(),
            axis_max: Some(if max_mean > 0.0 { max_mean } else { 1.0 }),
        };
        (format!("heat_map_{}", k + 1), format!("Mean score{title}"), spec)
    };
    seen.iter().take(MAX_HEAT_MAPS).enumerate().map(map).collect()
}
