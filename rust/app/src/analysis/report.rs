//! The report, written.

use super::{
    AnalysisData,
    charts::Charts,
    comparisons::{self, compare_all},
    figures::figures,
    flawed_records::FlawedRecords,
    html::{self, ReplayLinks, ReportHeader, ReportSection},
    leader_board::{leader_board, leader_table},
    mixed_models,
    summaries::{self, ReportTable},
};
use crate::study::{codebook_csv, table_csv};
use proact_analysis::table::ColumnNames;
use proact_files::{WriteError, check_output_dir_claim, claim_output_dir, make_folder, write_atomically};
use proact_recording::TrialRecord;
use std::{
    collections::BTreeMap,
    error::Error,
    fs, io,
    path::{Path, PathBuf},
};

/// The page: a folder with it is one that an analysis wrote.
const REPORT_FILE: &str = "report.html";
const DIR_CONTENT: &str = "report";
const UNFINISHED_NOTICE: &str =
    "<!doctype html><title>report</title><p>This report was not finished. Run proact analyze again.</p>\n";
const STATISTICS: &str = "statistics.json";
/// What is in it: observations, tables of the report, figures.
const FOLDERS: [&str; 3] = ["data", "tables", "figures"];
const REPORT_EXTENSIONS: [&str; 4] = ["csv", "tex", "svg", "png"];

/// Where a report goes and what it draws from.
#[derive(Clone, Debug)]
pub struct ReportOptions {
    /// The folder.
    pub out: PathBuf,
    /// Of bootstraps and drawn permutations.
    pub seed: u64,
    /// Whether methods are put in order first, as of a comparison of them.
    pub leader_board: bool,
}

/// Where the report on `dir` goes if nobody says: the folder `analysis` in it; beside a trial, whose record is closed, and beside a bag.
pub fn report_folder(dir: &Path) -> PathBuf {
    if dir.is_dir() && !TrialRecord::exists_in(dir) {
        return dir.join("analysis");
    }
    let name = dir.file_stem().unwrap_or_default().to_string_lossy();
    dir.with_file_name(format!("{name}-analysis"))
}

/// What was written.
#[derive(Clone, Debug)]
pub struct WrittenReport {
    /// The page.
    pub page: PathBuf,
    /// Tables as CSV, by name: those of observations and those of the report.
    pub tables: BTreeMap<String, PathBuf>,
    /// Figures as SVG, by name; a PNG is beside each.
    pub figures: BTreeMap<String, PathBuf>,
    /// What is missing, wrong or left out.
    pub notes: Vec<String>,
    /// The page with links to replays, for a server that has them.
    pub served_html: String,
}

/// Writes the report on what was collected. `tell` hears how many figures of how many are drawn.
///
/// # Errors
/// A folder that is not empty and is not an earlier report, a full disk, a figure that cannot be drawn. Of the report nothing is left
/// then that looks whole, nor of an earlier one.
pub fn report(
    collected: &AnalysisData,
    options: &ReportOptions,
    tell: impl FnMut(usize, usize),
) -> Result<WrittenReport, Box<dyn Error>> {
    let out = &options.out;
    // An empty folder alone can be removed so; an earlier report that could not be claimed stays.
    claim_report_dir(out).inspect_err(|_| drop(fs::remove_dir(out)))?;
    write_report(collected, options, tell).inspect_err(|_| remove_unfinished_report(out))
}

fn write_report(
    collected: &AnalysisData,
    options: &ReportOptions,
    mut tell: impl FnMut(usize, usize),
) -> Result<WrittenReport, Box<dyn Error>> {
    let out = &options.out;
    let compared = compare_all(collected, options.seed);
    let mut tables = Vec::new();
    if options.leader_board {
        tables.push(leader_table(&leader_board(collected, options.seed)));
    }
    tables.extend(summaries::tables(collected));
    tables.extend(comparisons::by_participant(collected));
    tables.extend(comparisons::tables(&compared));
    let flawed = FlawedRecords::of(collected);
    if let Some(flawed) = flawed.sentence() {
        tables
            .iter_mut()
            .for_each(|table| table.caption = format!("{} {flawed}", table.caption).trim_start().to_owned());
    }
    let mut report = WrittenReport {
        page: out.join(REPORT_FILE),
        tables: BTreeMap::new(),
        figures: BTreeMap::new(),
        notes: Vec::new(),
        served_html: String::new(),
    };
    let folder = |name: &str| -> Result<PathBuf, Box<dyn Error>> {
        let folder = out.join(name);
        make_folder(&folder)?;
        Ok(folder)
    };

    let [observed, printed, drawn] = FOLDERS.map(folder);
    let (observed, printed, drawn) = (observed?, printed?, drawn?);
    let all: Vec<_> = collected.tables.values().cloned().collect();
    for table in &all {
        let path = observed.join(format!("{}.csv", table.name));
        write_atomically(&path, &table_csv(table, ColumnNames::Present)?)?;
        report.tables.insert(table.name.to_owned(), path);
    }
    write_atomically(&observed.join("codebook.csv"), &codebook_csv(&all, ColumnNames::Present)?)?;
    // R reads the tables of observations, and writes one of its own.
    let mut notes = collected.notes.clone();
    match mixed_models::fit_mixed_models(out)? {
        Ok(table) => tables.extend(table),
        Err(why) => notes.push(why),
    }
    for table in &tables {
        let path = printed.join(format!("{}.csv", table.name));
        write_atomically(&path, &flawed.csv(table)?)?;
        write_atomically(&path.with_extension("tex"), html::latex(table))?;
        report.tables.insert(format!("report_{}", table.name), path);
    }
    write_atomically(&out.join(STATISTICS), &proact_types::to_json_pretty(&compared)?)?;

    let charts = Charts::new()?;
    let planned = figures(collected, options.seed);
    let mut pictures = Vec::new();
    for (k, figure) in planned.iter().enumerate() {
        tell(k, planned.len());
        let svg = charts.draw(&figure.spec).map_err(|error| format!("{}: {error}", figure.name))?;
        let (file, png) = charts.svg_and_png(&svg).map_err(|error| format!("{}: {error}", figure.name))?;
        let path = drawn.join(format!("{}.svg", figure.name));
        write_atomically(&path, &file)?;
        write_atomically(&path.with_extension("png"), png)?;
        report.figures.insert(figure.name.to_owned(), path);
        pictures.push((figure.name, svg));
    }
    let page = |replays| page(collected, &notes, &compared, &tables, &planned, &pictures, replays);
    write_atomically(&report.page, page(ReplayLinks::Command))?;
    report.served_html = page(ReplayLinks::Served(&summaries::records(&collected.tables["trials"])));
    report.notes = notes;
    Ok(report)
}

fn page(
    collected: &AnalysisData,
    notes: &[String],
    compared: &[comparisons::MeasureComparison],
    tables: &[ReportTable],
    planned: &[super::figures::Figure],
    pictures: &[(&str, String)],
    replays: ReplayLinks<'_>,
) -> String {
    // Where a figure and a table are of one thing, the figure comes first.
    const FIGURES_BEFORE: &[(&str, &[&str])] = &[
        ("success", &["success", "over_trials", "learning"]),
        ("outcomes", &["fates"]),
        ("durations", &["pick_durations", "place_durations"]),
        ("accuracy", &["accuracy"]),
        ("compensation", &["compensation"]),
        ("gaze_shares", &["gaze"]),
        ("emg", &["false_triggers", "gesture_to_motion"]),
        ("faults", &["faults"]),
        ("ratings", &["ratings"]),
        ("rankings", &["rankings"]),
        ("questionnaires", &["questionnaires"]),
    ];
    let figure = |name: &str| {
        let figure = planned.iter().find(|figure| figure.name == name)?;
        let (_, svg) = pictures.iter().find(|(other, _)| *other == name)?;
        Some(ReportSection::Figure(figure.name, figure.title, &figure.caption, svg))
    };
    // The list of all trials is the last thing that is read.
    let mut parts = Vec::new();
    let (last, first): (Vec<&ReportTable>, Vec<&ReportTable>) =
        tables.iter().partition(|table| table.name == "trials");
    for table in first.into_iter().chain(last) {
        let before =
            FIGURES_BEFORE.iter().find(|(name, _)| *name == table.name).map_or(&[][..], |(_, names)| names);
        parts.extend(before.iter().filter_map(|name| figure(name)));
        parts.push(ReportSection::Table(table));
    }
    let people = collected.tables["trials"].rows.iter().map(|row| row[0].to_string());
    let people = people.collect::<std::collections::BTreeSet<_>>().len();
    let trials = collected.tables["trials"].rows.len();
    let presumed: Vec<(String, Vec<String>)> = compared
        .iter()
        .filter(|compared| !compared.comparison.notes.is_empty())
        .map(|compared| (compared.measure.clone(), compared.comparison.notes.clone()))
        .collect();
    let count =
        |number: usize, one: &str| if number == 1 { format!("1 {one}") } else { format!("{number} {one}s") };
    html::page(
        &ReportHeader {
            title: &collected.title,
            data_description: format!(
                "{} of {}, {}.",
                count(trials, "trial"),
                count(people, "participant"),
                count(summaries::conditions(collected).len(), "method")
            ),
            simulated: collected.simulated == Some(true),
            notes,
            assumptions: &presumed,
            replays,
        },
        &parts,
    )
}

pub(super) fn report_table_csv(table: &ReportTable) -> Result<String, Box<dyn Error>> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    writer.write_record(&table.headers)?;
    for row in &table.rows {
        writer.write_record(row)?;
    }
    Ok(String::from_utf8(writer.into_inner()?)?)
}

/// Refuses a folder that [`report`] would not take, before anything is scored.
///
/// # Errors
/// As [`report`].
pub fn check_report_folder(folder: &Path) -> Result<(), WriteError> {
    check_output_dir_claim(folder, REPORT_FILE, DIR_CONTENT)
}

/// Makes the folder, or takes one that an analysis wrote.
fn claim_report_dir(folder: &Path) -> Result<(), Box<dyn Error>> {
    claim_output_dir(folder, REPORT_FILE, DIR_CONTENT)?;
    let page = folder.join(REPORT_FILE);
    let failed = |error: io::Error| format!("{}: {error}", folder.display());
    // Until all is written, and known as ours by it if this is killed.
    write_atomically(&page, UNFINISHED_NOTICE)?;
    // What an earlier report had and this one has not would be taken for its own.
    for name in FOLDERS {
        let Ok(entries) = fs::read_dir(folder.join(name)) else { continue };
        for entry in entries {
            let path = entry.map_err(failed)?.path();
            if is_report_file(&path) {
                fs::remove_file(&path).map_err(|error| format!("{}: {error}", path.display()))?;
            }
        }
    }
    Ok(())
}

/// Whether a file in one of the folders is one that a report writes.
fn is_report_file(path: &Path) -> bool {
    path.extension().is_some_and(|ending| REPORT_EXTENSIONS.iter().any(|own| ending == *own))
}

/// Takes back a report that cannot be written to its end: its files, and the folders if nothing else is in them. Beside files of
/// others the page stays that says that it was not finished, by which the next report takes the folder.
fn remove_unfinished_report(folder: &Path) {
    // The error that ended the report is the one to tell.
    for name in FOLDERS.map(|name| folder.join(name)) {
        let entries = fs::read_dir(&name).into_iter().flatten().flatten().map(|entry| entry.path());
        entries.filter(|path| is_report_file(path)).for_each(|path| drop(fs::remove_file(path)));
        let _ = fs::remove_dir(name);
    }
    for name in [STATISTICS, mixed_models::SCRIPT_FILE] {
        let _ = fs::remove_file(folder.join(name));
    }
    if fs::read_dir(folder).is_ok_and(|entries| entries.count() == 1) {
        let _ = fs::remove_file(folder.join(REPORT_FILE));
        let _ = fs::remove_dir(folder);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_report_that_was_killed_says_that_it_is_not_finished_and_can_be_made_again() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("report");
        claim_report_dir(&out).unwrap();
        // What a kill from here on leaves.
        assert_eq!(fs::read_to_string(out.join(REPORT_FILE)).unwrap(), UNFINISHED_NOTICE);
        assert!(UNFINISHED_NOTICE.contains("not finished"));
        fs::create_dir(out.join(FOLDERS[1])).unwrap();
        let stale = out.join(FOLDERS[1]).join("friedman.csv");
        fs::write(&stale, "of a report that was killed").unwrap();
        claim_report_dir(&out).unwrap();
        assert!(!stale.exists());
    }
}
