//! The tables of scores, of many trials at once.

use super::traces::{self, Flaw, RecordTrace};
use crate::{
    Arm,
    record_keys::{check_keys, is_fatal_for_analysis, with_path},
    replay::read_trial,
    study::tables::{
        columns::{BLOCKS, COMPENSATION, FLAW, TRIAL_KEY, TRIALS},
        trials::{block_rows, counted_block_rows},
    },
};
use proact_analysis::{
    scoring::{Measure, OBJECT_MEASURES, PHASE_MEASURES, ScoredTrial, TRIAL_MEASURES, Trace},
    table::{Table, TableCell, TableColumn, serialized_name},
};
use proact_control::MethodRegistry;
use proact_recording::{TrialRecord, read_result};
use proact_testbed::TrialResult;
use std::{
    error::Error,
    path::{Path, PathBuf},
    sync::{
        LazyLock,
        atomic::{AtomicUsize, Ordering},
    },
    thread,
};

const fn record_column(name: &'static str, meaning: &'static str) -> TableColumn {
    TableColumn { name, unit: "", meaning, source: "record", formerly: "" }
}

/// Key, own columns and measures of a table, and the flaw of the record.
fn columns<T>(first: &[TableColumn], measures: &[Measure<T>]) -> Vec<TableColumn> {
    let measured = measures.iter().map(|measure| measure.column);
    TRIAL_KEY.iter().chain(first).copied().chain(measured).chain([FLAW]).collect()
}

static MEASURES: LazyLock<Vec<TableColumn>> = LazyLock::new(|| columns(&[], TRIAL_MEASURES));
static OBJECTS: LazyLock<Vec<TableColumn>> =
    LazyLock::new(|| columns(&[record_column("block", "the object")], OBJECT_MEASURES));
static PHASES: LazyLock<Vec<TableColumn>> = LazyLock::new(|| {
    let first = [
        record_column(
            "phase",
            "pick: from the release before, or the start, until contact; place: until the release",
        ),
        record_column("block", "the object"),
        record_column("time", "which attempt at this object, from 1"),
        record_column("complete", "0 if the end of the trial cut it off"),
    ];
    columns(&first, PHASE_MEASURES)
});
static FAULTS: LazyLock<Vec<TableColumn>> = LazyLock::new(|| {
    let mut columns = TRIAL_KEY.to_vec();
    columns.extend([
        TableColumn {
            name: "time_s",
            unit: "s",
            meaning: "since the trial's start",
            source: "record",
            formerly: "",
        },
        record_column("fault", "what went wrong"),
        record_column("block", "with which object"),
        record_column("detail", "more of it"),
        FLAW,
    ]);
    columns
});

/// The tables of scores, without rows.
pub(crate) fn empty_score_tables() -> [Table; 4] {
    [
        Table::new("measures", "a trial", MEASURES.as_slice()),
        Table::new("objects", "an object in a trial", OBJECTS.as_slice()),
        Table::new("phases", "a pick or a place of an object", PHASES.as_slice()),
        Table::new("faults", "something that went wrong", FAULTS.as_slice()),
    ]
}

/// What is scored.
pub(super) enum ScoreSource {
    /// A trial of a study, whose other tables are there already.
    StudyTrial {
        /// What names it.
        key: Vec<TableCell>,
        /// Its record.
        dir: PathBuf,
    },
    /// A trial of its own.
    StandaloneTrial {
        /// Its record.
        dir: PathBuf,
    },
    /// A bag of the original lab.
    Bag {
        /// The file.
        path: PathBuf,
    },
}

impl ScoreSource {
    fn path(&self) -> &Path {
        match self {
            ScoreSource::StudyTrial { dir, .. } | ScoreSource::StandaloneTrial { dir } => dir,
            ScoreSource::Bag { path } => path,
        }
    }

    /// What names the trial in tables that are there already; empty if there are none.
    pub(super) fn key(&self) -> &[TableCell] {
        match self {
            ScoreSource::StudyTrial { key, .. } => key,
            ScoreSource::StandaloneTrial { .. } | ScoreSource::Bag { .. } => &[],
        }
    }
}

/// What came of one source.
#[derive(Default)]
pub(super) struct SourceScores {
    /// What names the trial.
    pub(super) key: Vec<TableCell>,
    /// What is wrong with its record.
    pub(super) flaws: Vec<Flaw>,
    /// Of `measures`, `objects`, `phases`, `faults`.
    pub(super) scores: [Vec<Vec<TableCell>>; 4],
    /// Of `trials`, for what is no trial of a study.
    pub(super) trial: Option<Vec<TableCell>>,
    /// Of `blocks`, likewise.
    pub(super) blocks: Vec<Vec<TableCell>>,
    /// The record cannot be scored: the trial that `key` names is in no table.
    pub(super) excluded: bool,
    /// What is missing or wrong.
    pub(super) notes: Vec<String>,
    /// Why the whole analysis is refused: a file of the record has an unknown key or value.
    pub(super) fatal_error: Option<String>,
}

impl SourceScores {
    /// Without rows yet, of a record with these flaws, each of which is a note.
    fn with_flaws(path: &Path, flaws: Vec<Flaw>) -> Self {
        let notes = flaws.iter().map(|flaw| format!("{}: {flaw}", path.display())).collect();
        Self { flaws, notes, ..Self::default() }
    }

    /// Whether the recorded result is not that of the trial, so that nothing of it may be in a table.
    pub(super) fn has_result_mismatch(&self) -> bool {
        self.flaws.iter().any(|flaw| matches!(flaw, Flaw::ResultMismatch(_)))
    }

    /// The word for the column `flaw`; none of a record without.
    pub(super) fn flaw(&self) -> Option<String> {
        let labels: Vec<&str> = self.flaws.iter().map(Flaw::label).collect();
        (!labels.is_empty()).then(|| labels.join(","))
    }
}

/// Adds `rows` to `table`. Cells that a row does not have, such as its flaw, are missing.
pub(crate) fn append(table: &mut Table, rows: impl IntoIterator<Item = Vec<TableCell>>) {
    for mut row in rows {
        row.resize(table.columns.len(), TableCell::Missing);
        table.push(row);
    }
}

/// Marks the rows of the trial that `key` names, in every table that has a column for it; of its attempts the one that counts. Outside a
/// study, whose column `mark` is of the plan, the trial gets an asterisk too.
pub(crate) fn mark_flaw<'a>(tables: impl IntoIterator<Item = &'a mut Table>, key: &[TableCell], flaw: &str) {
    for table in tables {
        let Some(index) = table.column_index(FLAW.name) else { continue };
        let [position, asterisk, counts] =
            ["condition_order", "mark", "counts"].map(|name| table.column_index(name));
        let is_of_record =
            |row: &Vec<TableCell>| counts.is_none_or(|counts| row[counts] == TableCell::from(true));
        for row in table.rows.iter_mut().filter(|row| row.starts_with(key) && is_of_record(row)) {
            row[index] = flaw.into();
            if let (Some(position), Some(asterisk)) = (position, asterisk)
                && row[position] == TableCell::Missing
            {
                row[asterisk] = "*".into();
            }
        }
    }
}

/// Columns of `trials` and `blocks` that are read from the result of a record.
const RESULT_COLUMNS: [(&str, &[&str]); 2] = [
    ("trials", &["score", "seconds", "unsolved_ticks"]),
    ("blocks", &["outcome", "pick_s", "place_s", "error_mm"]),
];

/// Leaves out what the recorded result says of the trial that `key` names.
pub(crate) fn clear_result_cells<'a>(tables: impl IntoIterator<Item = &'a mut Table>, key: &[TableCell]) {
    for table in tables {
        let Some((_, columns)) = RESULT_COLUMNS.iter().find(|(name, _)| *name == table.name) else {
            continue;
        };
        let indices: Vec<usize> = columns.iter().filter_map(|name| table.column_index(name)).collect();
        for row in table.rows.iter_mut().filter(|row| row.starts_with(key)) {
            indices.iter().for_each(|index| row[*index] = TableCell::Missing);
        }
    }
}

/// Leaves a trial out of all tables of what records hold.
pub(super) fn remove_trial<'a>(tables: impl IntoIterator<Item = &'a mut Table>, key: &[TableCell]) {
    for table in
        tables.into_iter().filter(|table| table.name != "attempts" && table.column_index(FLAW.name).is_some())
    {
        table.rows.retain(|row| !row.starts_with(key));
    }
}

/// Scores all sources, `jobs` at once, in their order: rows, or why there are none. `tell` hears how many are done.
pub(super) fn score_all(
    methods: &MethodRegistry,
    sources: &[ScoreSource],
    jobs: usize,
    tell: &(dyn Fn(usize) + Sync),
) -> Vec<Result<SourceScores, String>> {
    let (next, done) = (AtomicUsize::new(0), AtomicUsize::new(0));
    let work = || {
        let mut own = Vec::new();
        loop {
            let index = next.fetch_add(1, Ordering::Relaxed);
            let Some(source) = sources.get(index) else { return own };
            let rows = score_source(methods, source).or_else(|error| {
                let text = with_path(source.path(), &error);
                match is_fatal_for_analysis(&*error) {
                    true => Ok(SourceScores { fatal_error: Some(text), ..SourceScores::default() }),
                    false => Err(text),
                }
            });
            own.push((index, rows));
            tell(done.fetch_add(1, Ordering::Relaxed) + 1);
        }
    };
    let mut found: Vec<(usize, Result<SourceScores, String>)> = thread::scope(|scope| {
        let workers: Vec<_> = (0..jobs.max(1)).map(|_| scope.spawn(work)).collect();
        let joined = workers.into_iter().map(|worker| worker.join());
        joined.flat_map(|rows| rows.unwrap_or_else(|panic| std::panic::resume_unwind(panic))).collect()
    });
    found.sort_by_key(|(index, _)| *index);
    found.into_iter().map(|(_, rows)| rows).collect()
}

fn score_source(methods: &MethodRegistry, source: &ScoreSource) -> Result<SourceScores, Box<dyn Error>> {
    if let ScoreSource::StandaloneTrial { dir } = source {
        check_keys(dir)?;
    }
    match source {
        ScoreSource::StudyTrial { key, dir } => {
            let (_, result) = read_trial(dir)?;
            let RecordTrace { trace, flaws } = traces::trace_from_record(methods, dir)?;
            let scores = drop_scores_of_failed_trial(score_rows(key, &trace), &result);
            Ok(SourceScores { key: key.clone(), scores, ..SourceScores::with_flaws(dir, flaws) })
        }
        ScoreSource::StandaloneTrial { dir } => score_standalone_trial(methods, dir),
        ScoreSource::Bag { path } => score_bag(path),
    }
}

/// Without a study, a seed stands for a participant: whoever has the same seed under several methods is the same simulated person.
fn score_standalone_trial(methods: &MethodRegistry, dir: &Path) -> Result<SourceScores, Box<dyn Error>> {
    let record = TrialRecord::open(dir)?;
    if !record.is_finished() {
        let secs = record.end().as_secs();
        let note =
            format!("{}: interrupted at {secs:.1} s, without a result; it does not count", dir.display());
        return Ok(SourceScores { notes: vec![note], ..SourceScores::default() });
    }
    let result: TrialResult = read_result(dir)?;
    let key = vec![
        result.seed.to_string().into(),
        TableCell::Missing,
        TableCell::Missing,
        result.method.as_str().into(),
        // Its number is given where all are known.
        TableCell::Missing,
    ];
    let trial = row_by_column_name(TRIALS, &key, |name| match name {
        "arrangement" => result.legacy_fields.get("arrangement").map(serialized_name).into(),
        "seed" => result.seed.to_string().into(),
        "method" => result.method.as_str().into(),
        "task" => result.task.as_str().into(),
        "arm" => result.arm.as_str().into(),
        "setup" => result.setup.as_str().into(),
        "end_reason" => serialized_name(&result.ended).into(),
        "score" => result.counted_score().into(),
        "score_name" => result.score_name.as_str().into(),
        "seconds" => result.sim_seconds.into(),
        "gesture_source" => result.gesture_source.as_str().into(),
        "unsolved_ticks" => result.unsolved_ticks.into(),
        "record" => dir.display().to_string().into(),
        "digest" => result.digest.as_str().into(),
        _ => TableCell::Missing,
    });
    let RecordTrace { trace, flaws } = traces::trace_from_record(methods, dir)?;
    let blocks = counted_block_rows(&key, &result)?;
    Ok(SourceScores {
        scores: drop_scores_of_failed_trial(score_rows(&key, &trace), &result),
        blocks,
        trial: Some(trial),
        key,
        ..SourceScores::with_flaws(dir, flaws)
    })
}

/// Of a trial that failed the faults alone say something.
fn drop_scores_of_failed_trial(
    [measures, objects, phases, faults]: ScoreTableRows,
    result: &TrialResult,
) -> ScoreTableRows {
    match result.failure() {
        None => [measures, objects, phases, faults],
        Some(_) => [Vec::new(), Vec::new(), Vec::new(), faults],
    }
}

/// Rows of `measures`, `objects`, `phases`, `faults`.
type ScoreTableRows = [Vec<Vec<TableCell>>; 4];

fn score_bag(path: &Path) -> Result<SourceScores, Box<dyn Error>> {
    let arm = Arm::load(proact_testbed::TrialConfig::DEFAULT_ARM)?;
    let traces::BagTrace { trace, method, result, flaws } = traces::trace_from_bag(path, &arm)?;
    let [participant, number] = ["participant", "trial"].map(|word| number_after(path, word));
    let key = vec![
        participant.into(),
        TableCell::Missing,
        TableCell::Missing,
        method.as_str().into(),
        number.into(),
    ];
    let trial = row_by_column_name(TRIALS, &key, |name| match name {
        "method" => method.as_str().into(),
        "task" => "modified_bbt".into(),
        "setup" => "bag".into(),
        "score" => result.as_ref().map(|result| result.score).into(),
        "score_name" => "blocks on target".into(),
        "seconds" => trace.duration.as_secs().into(),
        "record" => path.display().to_string().into(),
        _ => TableCell::Missing,
    });
    // What became of an object is known at the end alone.
    let blocks = match result {
        Some(result) => block_rows(&key, &result.result)?,
        None => {
            let row = |object| {
                row_by_column_name(BLOCKS, &key, |name| match name {
                    "block" => TableCell::from(trace.scene.name(object)),
                    _ => TableCell::Missing,
                })
            };
            trace.scene.ids().map(row).collect()
        }
    };
    let scores = score_rows(&key, &trace);
    let blocks = with_event_times(blocks, &scores[1], key.len());
    Ok(SourceScores { scores, blocks, trial: Some(trial), key, ..SourceScores::with_flaws(path, flaws) })
}

/// Rows of `blocks` with the times of the rows of `objects`, which know an event by its message: the task knows it by the instant
/// after. `key` cells come first in both.
fn with_event_times(
    mut blocks: Vec<Vec<TableCell>>,
    objects: &[Vec<TableCell>],
    key: usize,
) -> Vec<Vec<TableCell>> {
    for name in ["pick_s", "place_s"] {
        let of_block = BLOCKS.iter().position(|column| column.name == name);
        let of_object = OBJECTS.iter().position(|column| column.name == name);
        let (Some(index), Some(from)) = (of_block, of_object) else { continue };
        for row in &mut blocks {
            let object = objects.iter().find(|object| object.get(key) == row.get(key));
            let time = object.and_then(|object| object.get(from)).filter(|time| **time != TableCell::Missing);
            if let (Some(cell), Some(time)) =
                (row.get_mut(index).filter(|cell| **cell != TableCell::Missing), time)
            {
                *cell = time.clone();
            }
        }
    }
    blocks
}

/// The number that follows `word` in a file's name, as in `participant1-mode4-trial2`.
fn number_after(path: &Path, word: &str) -> Option<i64> {
    let name = path.file_stem()?.to_string_lossy().into_owned();
    let (_, rest) = name.split_once(word)?;
    let digits: String = rest.chars().take_while(char::is_ascii_digit).collect();
    digits.parse().ok()
}

fn row_by_column_name(
    columns: &[TableColumn],
    key: &[TableCell],
    of: impl Fn(&str) -> TableCell,
) -> Vec<TableCell> {
    let rest = columns.iter().skip(key.len()).map(|column| of(column.name));
    key.iter().cloned().chain(rest).collect()
}

/// Rows of `measures`, `objects`, `phases`, `faults`.
pub(super) fn score_rows(key: &[TableCell], trace: &Trace) -> [Vec<Vec<TableCell>>; 4] {
    let scored = ScoredTrial::of(trace);
    let name = |object| TableCell::from(trace.scene.name(object));
    let row = |own: Vec<TableCell>| key.iter().cloned().chain(own).collect::<Vec<TableCell>>();
    let measured = TRIAL_MEASURES.iter().map(|measure| (measure.compute)(&scored, &()).into()).collect();
    let objects = scored.objects.iter().map(|transfer| {
        let values = OBJECT_MEASURES.iter().map(|measure| (measure.compute)(&scored, transfer).into());
        row(std::iter::once(name(transfer.object)).chain(values).collect())
    });
    let phases = scored.phases.iter().map(|phase| {
        let first =
            [phase.kind.label().into(), name(phase.object), phase.attempt.into(), phase.complete.into()];
        let values = PHASE_MEASURES.iter().map(|measure| (measure.compute)(&scored, phase).into());
        row(first.into_iter().chain(values).collect())
    });
    let faults = scored.faults.iter().map(|fault| {
        let detail = if fault.detail.is_empty() { TableCell::Missing } else { fault.detail.as_str().into() };
        row(vec![
            fault.time.as_secs().into(),
            fault.kind.label().into(),
            fault.object.map(name).into(),
            detail,
        ])
    });
    [vec![row(measured)], objects.collect(), phases.collect(), faults.collect()]
}

/// The table `compensation` of a study: what `measures` has of shoulder and trunk.
pub(super) fn compensation(measures: &Table) -> Table {
    let mut table = Table::new("compensation", "a trial", COMPENSATION);
    let cell = |row: &[TableCell], name| measures.cell(row, name).cloned().unwrap_or(TableCell::Missing);
    let rows =
        measures.rows.iter().map(|row| COMPENSATION.iter().map(|column| cell(row, column.name)).collect());
    table.rows = rows.collect();
    table
}

/// Scores the trials of a study that count, for its export: marks the rows of flawed records in `tables`, and gives the table
/// `compensation`. `tell` hears how many trials of how many are scored.
///
/// # Errors
/// A record that cannot be scored, by its name.
pub(crate) fn score_study(
    methods: &MethodRegistry,
    trials: Vec<(Vec<TableCell>, PathBuf)>,
    tables: &mut [Table],
    tell: &(dyn Fn(usize, usize) + Sync),
) -> Result<Table, String> {
    let count = trials.len();
    let sources: Vec<ScoreSource> =
        trials.into_iter().map(|(key, dir)| ScoreSource::StudyTrial { key, dir }).collect();
    let jobs = thread::available_parallelism().map_or(1, usize::from);
    let mut all = Vec::new();
    let [mut measures, ..] = empty_score_tables();
    for rows in score_all(methods, &sources, jobs, &|done| tell(done, count)) {
        let mut rows = rows?;
        if let Some(reason) = rows.fatal_error.take() {
            return Err(reason);
        }
        append(&mut measures, std::mem::take(&mut rows.scores[0]));
        all.push(rows);
    }
    let mut compensation = compensation(&measures);
    for rows in &all {
        if let Some(flaw) = rows.flaw() {
            mark_flaw(tables.iter_mut().chain([&mut compensation]), &rows.key, &flaw);
        }
        if rows.has_result_mismatch() {
            clear_result_cells(&mut *tables, &rows.key);
        }
    }
    Ok(compensation)
}

/// The tables that every source has.
pub(crate) fn trials_and_blocks() -> [Table; 2] {
    [Table::new("trials", "a trial", TRIALS), Table::new("blocks", "an object in a trial", BLOCKS)]
}
