//! From whatever was recorded to the same tables.

use super::{
    implausible_cells::{ImplausibleCell, find_implausible_cells, in_words},
    scores::{
        ScoreSource, SourceScores, append, clear_result_cells, compensation, empty_score_tables, mark_flaw,
        remove_trial, score_all, trials_and_blocks,
    },
    summaries::{OUTCOMES, failed_notes, participant},
};
use crate::{
    batch::{BatchFolder, DESCRIPTION, Sweep},
    study::{
        PLAN_FILE, STUDY_FILE, Study, open_view,
        tables::{self, columns, columns::TRIAL_KEY},
    },
};
use proact_analysis::table::{ColumnNames, Table, TableCell, TableColumn};
use proact_control::MethodRegistry;
use proact_recording::{HASH_MISMATCH_TEXT, MANIFEST_FILE, RecordingError, TrialRecord, verify_manifest};
use proact_testbed::TrialEnd;
use std::{
    collections::{BTreeMap, BTreeSet},
    error::Error,
    fs,
    path::{Path, PathBuf},
    thread,
};

/// Folders within folders are looked through so deep.
const MAX_FOLDER_DEPTH: usize = 4;

/// What was recorded, as tables.
#[derive(Clone, Debug)]
pub struct AnalysisData {
    /// What it is called.
    pub title: String,
    /// The folder that records are named from.
    pub folder: PathBuf,
    /// The tables by name: those of a study's export, and `measures`, `objects`, `phases`, `faults`.
    pub tables: BTreeMap<&'static str, Table>,
    /// What is missing, wrong or left out.
    pub notes: Vec<String>,
    /// Values that no arm and no person can produce.
    pub implausible_cells: Vec<ImplausibleCell>,
    /// All people are simulated, none is, or it is not known.
    pub simulated: Option<bool>,
}

impl AnalysisData {
    fn new(dir: &Path) -> Self {
        let name =
            dir.canonicalize().ok().and_then(|full| Some(full.file_name()?.to_string_lossy().into_owned()));
        let mut collected = Self {
            title: name.unwrap_or_else(|| dir.display().to_string()),
            folder: dir.to_owned(),
            tables: BTreeMap::new(),
            notes: Vec::new(),
            implausible_cells: Vec::new(),
            simulated: None,
        };
        collected.add(trials_and_blocks());
        collected.add(empty_score_tables());
        collected
    }

    fn add(&mut self, tables: impl IntoIterator<Item = Table>) {
        self.tables.extend(tables.into_iter().map(|table| (table.name, table)));
    }

    fn append(&mut self, name: &str, rows: impl IntoIterator<Item = Vec<TableCell>>) {
        if let Some(table) = self.tables.get_mut(name) {
            append(table, rows);
        }
    }

    /// The table called `name`, if there is one with rows.
    pub fn table(&self, name: &str) -> Option<&Table> {
        self.tables.get(name).filter(|table| !table.rows.is_empty())
    }
}

/// Reads what is in `dir`, scoring `jobs` trials at once. `tell` hears how many trials of how many are scored.
///
/// # Errors
/// A folder with nothing to analyse, a plan or a table that cannot be read, a result with a key or an outcome that is unknown, a
/// record in the folder of another trial. A single trial that cannot be read otherwise is a note.
pub fn collect_analysis_data(
    methods: &MethodRegistry,
    dir: &Path,
    jobs: usize,
    tell: &(dyn Fn(usize, usize) + Sync),
) -> Result<AnalysisData, Box<dyn Error>> {
    let mut collected = AnalysisData::new(dir);
    let exported = dir.join("trials.csv").is_file();
    let score = |sources: &[ScoreSource]| -> Vec<SourceScores> {
        let count = sources.len();
        let scored = score_all(methods, sources, jobs, &|done| tell(done, count));
        let unscored = |source: &ScoreSource, error| SourceScores {
            key: source.key().to_vec(),
            excluded: true,
            notes: vec![format!("{error}; the trial is left out")],
            ..SourceScores::default()
        };
        let rows = sources.iter().zip(scored);
        rows.map(|(source, rows)| rows.unwrap_or_else(|error| unscored(source, error))).collect()
    };
    let is_study = dir.join(STUDY_FILE).is_file() || dir.join(PLAN_FILE).is_file() && !exported;
    let all = if is_study {
        study(methods, dir, &mut collected, &score)?
    } else if exported {
        read_tables(dir, &mut collected)?;
        Vec::new()
    } else {
        score(&find_score_sources(dir)?)
    };
    let mut numbers: BTreeMap<String, i64> = BTreeMap::new();
    for mut rows in all {
        if let Some(reason) = rows.fatal_error {
            return Err(reason.into());
        }
        collected.notes.append(&mut rows.notes);
        if rows.excluded {
            if !rows.key.is_empty() {
                remove_trial(collected.tables.values_mut(), &rows.key);
            }
            continue;
        }
        let (flaw, false_result) = (rows.flaw(), rows.has_result_mismatch());
        let Some(trial) = &mut rows.trial else {
            append_scores(&mut collected, &mut rows.scores);
            mark_flaws(&mut collected, &rows.key, flaw, false_result);
            continue;
        };
        // A trial of its own gets its number here, among those of this participant under this condition.
        let number = if trial[4] == TableCell::Missing {
            let number = numbers.entry(format!("{} {}", trial[0], trial[3])).or_default();
            *number += 1;
            TableCell::Integer(*number)
        } else {
            trial[4].clone()
        };
        trial[4] = number.clone();
        let others = rows.scores.iter_mut().flatten().chain(&mut rows.blocks);
        others.for_each(|row| row[4] = number.clone());
        rows.key[4] = number;
        collected.append("trials", rows.trial);
        collected.append("blocks", rows.blocks);
        append_scores(&mut collected, &mut rows.scores);
        mark_flaws(&mut collected, &rows.key, flaw, false_result);
    }
    if is_study {
        collected.add([compensation(&collected.tables["measures"])]);
    }
    if collected.table("trials").is_none() {
        let notes: String = collected.notes.iter().map(|note| format!("\n  {note}")).collect();
        return Err(format!("{}: there is no finished trial to analyse{notes}", dir.display()).into());
    }
    collected.notes.extend(failed_notes(&collected.tables["trials"]));
    collected.implausible_cells = find_implausible_cells(&collected.tables);
    let notes = in_words(&collected.implausible_cells);
    collected.notes.splice(0..0, notes);
    Ok(collected)
}

fn append_scores(collected: &mut AnalysisData, scores: &mut [Vec<Vec<TableCell>>; 4]) {
    for (name, rows) in ["measures", "objects", "phases", "faults"].into_iter().zip(scores) {
        collected.append(name, std::mem::take(rows));
    }
}

fn mark_flaws(collected: &mut AnalysisData, key: &[TableCell], flaw: Option<String>, false_result: bool) {
    if let Some(flaw) = flaw {
        mark_flaw(collected.tables.values_mut(), key, &flaw);
    }
    if false_result {
        clear_result_cells(collected.tables.values_mut(), key);
    }
}

fn study(
    methods: &MethodRegistry,
    dir: &Path,
    collected: &mut AnalysisData,
    score: &dyn Fn(&[ScoreSource]) -> Vec<SourceScores>,
) -> Result<Vec<SourceScores>, Box<dyn Error>> {
    let study = Study::open(dir, methods)?;
    let view = open_view(&study)?;
    collected.title = study.plan.name.clone();
    collected.simulated = Some(view.simulated);
    let counted = tables::counted_trial_records(&study, &view);
    let planned = study.schedule.trials().count();
    if counted.len() < planned {
        let done = counted.len();
        collected.notes.push(format!("The study is not finished: {done} of {planned} planned trials count."));
    }
    collected.notes.extend(tables::missing_answers(&study, &view));
    let sources: Vec<ScoreSource> =
        counted.into_iter().map(|(key, dir)| ScoreSource::StudyTrial { key, dir }).collect();
    // Both take their time, and neither needs the other.
    let (rows, made) = thread::scope(|scope| {
        let made = scope.spawn(|| tables::readable_tables(&study, &view).map_err(|error| error.to_string()));
        (score(&sources), made.join())
    });
    let (tables, unread) = made.map_err(|_| "the tables of the study could not be made")??;
    collected.add(tables);
    collected.notes.extend(unread.into_iter().map(|error| format!("{error}; the trial is left out")));
    Ok(rows)
}

/// Trials and bags in a folder, or the one that `dir` is, by name.
fn find_score_sources(dir: &Path) -> Result<Vec<ScoreSource>, Box<dyn Error>> {
    let is_bag = |path: &Path| path.extension().is_some_and(|ending| ending == "bag") && path.is_file();
    if is_bag(dir) {
        return Ok(vec![ScoreSource::Bag { path: dir.to_owned() }]);
    }
    let mut sources = Vec::new();
    let mut folders = vec![(dir.to_owned(), 0)];
    while let Some((folder, depth)) = folders.pop() {
        if TrialRecord::exists_in(&folder) {
            sources.push(ScoreSource::StandaloneTrial { dir: folder });
            continue;
        }
        let entries = fs::read_dir(&folder).map_err(|error| format!("{}: {error}", folder.display()))?;
        for entry in entries {
            let entry = entry?;
            let path = entry.path();
            if is_bag(&path) {
                sources.push(ScoreSource::Bag { path });
            } else if entry.file_type()?.is_dir() && depth < MAX_FOLDER_DEPTH {
                folders.push((path, depth + 1));
            }
        }
    }
    sources.sort_by_key(|source| match source {
        ScoreSource::StudyTrial { dir, .. } | ScoreSource::StandaloneTrial { dir } => dir.clone(),
        ScoreSource::Bag { path } => path.clone(),
    });
    if sources.is_empty() {
        return Err(format!(
            "{} holds nothing to analyse: expected a study ({PLAN_FILE}), recorded trials, bags, or exported tables \
             (trials.csv) in it",
            dir.display()
        )
        .into());
    }
    Ok(sources)
}

/// The tables that an export can have.
const EXPORT_TABLES: &[(&str, &str, &[TableColumn])] = &[
    ("participants", "a participant of the plan", columns::PARTICIPANTS),
    ("sessions", "a session of a participant", columns::SESSIONS),
    ("trials", "a trial of the plan that counts", columns::TRIALS),
    ("attempts", "a trial each time that it was begun", columns::ATTEMPTS),
    ("blocks", "an object in a trial", columns::BLOCKS),
    ("compensation", "a trial", columns::COMPENSATION),
    ("gaze", "a phase of a trial: with an empty hand, or holding", columns::GAZE),
    ("emg_quality", "a channel of the armband in a trial", columns::EMG_QUALITY),
    ("deviations", "a departure from the plan", columns::DEVIATIONS),
    ("answers", "a question of a questionnaire", columns::ANSWERS),
    ("scores", "a score of a questionnaire", columns::SCORES),
];

/// Reads exported tables, and those of scores where an analysis wrote them beside.
fn read_tables(dir: &Path, collected: &mut AnalysisData) -> Result<(), Box<dyn Error>> {
    match verify_manifest(dir) {
        Err(RecordingError::Changed { files, .. }) if files.contains(HASH_MISMATCH_TEXT) => {
            return Err(format!(
                "{}: {files} since the export; export again, or remove {MANIFEST_FILE} if the change is yours",
                dir.display()
            )
            .into());
        }
        // A copy may lack some of the files.
        Ok(_) | Err(RecordingError::Changed { .. }) => {}
        Err(error) => return Err(error.into()),
    }
    // The tables of a batch have columns of what is varied too.
    let batch = dir.join(DESCRIPTION).is_file().then(|| BatchFolder::open(dir)).transpose()?;
    let varied = batch.map_or(Ok(Sweep::default()), |batch| Sweep::parse(&batch.description.vary))?;
    let varied: Vec<&str> = varied.keys().collect();
    let scores = empty_score_tables();
    let scored = scores.iter().map(|table| (table.name, table.row_meaning, table.columns));
    for (name, row, columns) in EXPORT_TABLES.iter().copied().chain(scored) {
        let path = dir.join(format!("{name}.csv"));
        if path.is_file() {
            let table = read_table(&path, Table::new(name, row, columns), &varied)
                .map_err(|e| format!("{}: {e}", path.display()))?;
            collected.add([table]);
        }
    }
    if collected.table("objects").is_none() {
        collected.notes.push(
            "These are tables without records: what is scored from records (compensation by phase, gaze on things, faults) is missing."
                .to_owned(),
        );
    }
    if let Some(scores) = collected.table("scores") {
        let missing_note = |row: &Vec<TableCell>| {
            let [form, condition, missing] =
                ["form", "condition", "missing"].map(|name| scores.text(row, name));
            let about = if condition.is_empty() { condition } else { format!(" about {condition}") };
            let who = participant(scores, row);
            (!missing.is_empty())
                .then(|| format!("{who}: {form}{about} lacks {}", missing.replace(',', ", ")))
        };
        let notes: BTreeSet<String> = scores.rows.iter().filter_map(missing_note).collect();
        collected.notes.extend(notes);
    }
    let trials = &collected.tables["trials"];
    let simulated: Vec<f64> = trials.rows.iter().filter_map(|row| trials.number(row, "simulated")).collect();
    collected.simulated = simulated.first().map(|_| simulated.iter().all(|value| *value == 1.0));
    Ok(())
}

/// Tables and their columns of numbers that have no unit.
const UNITLESS_NUMBER_COLUMNS: [(&str, &str); 4] =
    [("trials", "score"), ("trials", "condition_order"), ("trials", "simulated"), ("scores", "value")];
/// Tables whose columns are all measured, but for those that name what was measured.
const MEASURE_TABLES: [&str; 3] = ["measures", "objects", "phases"];

fn is_number(table: &Table, column: &TableColumn) -> bool {
    let names =
        TRIAL_KEY.iter().any(|key| key.name == column.name) || ["block", "phase"].contains(&column.name);
    !column.unit.is_empty()
        || UNITLESS_NUMBER_COLUMNS.contains(&(table.name, column.name))
        || MEASURE_TABLES.contains(&table.name) && !names
}

/// Refuses words in a column of numbers and an unknown outcome, which the report would drop.
fn check_cell(table: &Table, column: &TableColumn, cell: &TableCell) -> Result<(), String> {
    let TableCell::Text(words) = cell else { return Ok(()) };
    let outcomes = OUTCOMES.map(|(outcome, ..)| outcome);
    match (table.name, column.name) {
        ("trials", "end_reason") if serde_json::from_value::<TrialEnd>(words.as_str().into()).is_err() => {
            Err(format!(
                "end_reason {words:?} is unknown, expected task, failed, abort, restart or interrupt"
            ))
        }
        ("blocks", "outcome") if !outcomes.contains(&words.as_str()) => {
            Err(format!("outcome {words:?} is unknown, expected one of {}", outcomes.join(", ")))
        }
        _ if is_number(table, column) => {
            Err(format!("{} is {words:?}, expected a number or nothing", column.name))
        }
        _ => Ok(()),
    }
}

/// Reads a table by the names of its columns; those that it lacks are missing. It may have the columns `varied` beside them.
fn read_table(path: &Path, mut table: Table, varied: &[&str]) -> Result<Table, Box<dyn Error>> {
    let mut reader = csv::Reader::from_path(path)?;
    let heads = reader.headers()?.clone();
    let index_of = |name: &str| heads.iter().position(|head| head == name);
    let indices: Vec<Option<usize>> = table
        .columns
        .iter()
        .map(|column| index_of(column.name).or_else(|| index_of(column.written_name(ColumnNames::Legacy))))
        .collect();
    if indices.iter().all(Option::is_none) {
        let known: Vec<&str> = table.columns.iter().map(|column| column.name).collect();
        return Err(format!("none of its columns is known, expected {}", known.join(", ")).into());
    }
    let known =
        |head: &&str| table.columns.iter().any(|column| column.is_named(head)) || varied.contains(head);
    if let Some(head) = heads.iter().find(|head| !known(head)) {
        let columns: Vec<&str> = table.columns.iter().map(|column| column.name).collect();
        return Err(format!("column {head:?} is unknown, expected {}", columns.join(", ")).into());
    }
    for (number, record) in (2..).zip(reader.records()) {
        let record = record?;
        let mut row = Vec::with_capacity(indices.len());
        for (column, index) in table.columns.iter().zip(&indices) {
            let cell = index.and_then(|index| record.get(index)).map_or(TableCell::Missing, TableCell::parse);
            check_cell(&table, column, &cell).map_err(|error| format!("line {number}: {error}"))?;
            row.push(cell);
        }
        table.push(row);
    }
    Ok(table)
}
