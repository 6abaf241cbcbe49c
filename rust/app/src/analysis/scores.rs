//! The tables of scores, of many trials at once.

use super::traces::{self, Flaw, OfRecord};
use crate::{
    Arm,
    study::tables::{
        columns::{BLOCKS, COMPENSATION, FLAW, TRIAL_KEY, TRIALS},
        trials::block_rows,
    },
};
use proact_analysis::{
    scoring::{Measure, OF_OBJECT, OF_PHASE, OF_TRIAL, Scored, Trace},
    table::{Cell, Column, Table, word},
};
use proact_control::MethodRegistry;
use proact_recording::{RecordingError, Trial, read_result};
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

const fn own(name: &'static str, meaning: &'static str) -> Column {
    Column { name, unit: "", meaning, source: "record" }
}

/// Key, own columns and measures of a table, and the flaw of the record.
fn columns<T>(first: &[Column], measures: &[Measure<T>]) -> Vec<Column> {
    let measured = measures.iter().map(|measure| measure.column);
    TRIAL_KEY.iter().chain(first).copied().chain(measured).chain([FLAW]).collect()
}

static MEASURES: LazyLock<Vec<Column>> = LazyLock::new(|| columns(&[], OF_TRIAL));
static OBJECTS: LazyLock<Vec<Column>> = LazyLock::new(|| columns(&[own("block", "the object")], OF_OBJECT));
static PHASES: LazyLock<Vec<Column>> = LazyLock::new(|| {
    let first = [
        own("phase", "pick: from the release before, or the start, until contact; place: until the release"),
        own("block", "the object"),
        own("time", "the how manyth time that it was taken, from 1"),
        own("complete", "0 if the end of the trial cut it off"),
    ];
    columns(&first, OF_PHASE)
});
static FAULTS: LazyLock<Vec<Column>> = LazyLock::new(|| {
    let mut columns = TRIAL_KEY.to_vec();
    columns.extend([
        Column { name: "time_s", unit: "s", meaning: "since the trial's start", source: "record" },
        own("fault", "what went wrong"),
        own("block", "with which object"),
        own("detail", "more of it"),
        FLAW,
    ]);
    columns
});

/// The tables of scores, without rows.
pub(crate) fn empty() -> [Table; 4] {
    [
        Table::new("measures", "a trial", MEASURES.as_slice()),
        Table::new("objects", "an object in a trial", OBJECTS.as_slice()),
        Table::new("phases", "a pick or a place of an object", PHASES.as_slice()),
        Table::new("faults", "something that went wrong", FAULTS.as_slice()),
    ]
}

/// What is scored.
pub(super) enum Source {
    /// A trial of a study, whose other tables are there already.
    Counted {
        /// What names it.
        key: Vec<Cell>,
        /// Its record.
        dir: PathBuf,
    },
    /// A trial of its own.
    Loose {
        /// Its record.
        dir: PathBuf,
    },
    /// A bag of the original lab.
    Bag {
        /// The file.
        path: PathBuf,
    },
}

impl Source {
    fn path(&self) -> &Path {
        match self {
            Source::Counted { dir, .. } | Source::Loose { dir } => dir,
            Source::Bag { path } => path,
        }
    }
}

/// What came of one source.
#[derive(Default)]
pub(super) struct Rows {
    /// What names the trial.
    pub(super) key: Vec<Cell>,
    /// What is wrong with its record.
    pub(super) flaws: Vec<Flaw>,
    /// Of `measures`, `objects`, `phases`, `faults`.
    pub(super) scores: [Vec<Vec<Cell>>; 4],
    /// Of `trials`, for what is no trial of a study.
    pub(super) trial: Option<Vec<Cell>>,
    /// Of `blocks`, likewise.
    pub(super) blocks: Vec<Vec<Cell>>,
    /// What is missing or wrong.
    pub(super) notes: Vec<String>,
    /// Why the whole analysis is refused: the result has an unknown key or outcome.
    pub(super) refused: Option<String>,
}

impl Rows {
    /// Without rows yet, of a record with these flaws, each of which is a note.
    fn flawed(path: &Path, flaws: Vec<Flaw>) -> Self {
        let notes = flaws.iter().map(|flaw| format!("{}: {flaw}", path.display())).collect();
        Self { flaws, notes, ..Self::default() }
    }

    /// The word for the column `flaw`; none of a record without.
    pub(super) fn flaw(&self) -> Option<String> {
        let labels: Vec<&str> = self.flaws.iter().map(Flaw::label).collect();
        (!labels.is_empty()).then(|| labels.join(","))
    }
}

/// Adds `rows` to `table`. Cells that a row does not have, such as its flaw, are missing.
pub(crate) fn append(table: &mut Table, rows: impl IntoIterator<Item = Vec<Cell>>) {
    for mut row in rows {
        row.resize(table.columns.len(), Cell::Missing);
        table.push(row);
    }
}

/// Marks the rows of the trial that `key` names, in every table that has a column for it. Outside a study, whose column `mark` is of the
/// plan, the trial gets an asterisk too.
pub(crate) fn mark<'a>(tables: impl IntoIterator<Item = &'a mut Table>, key: &[Cell], flaw: &str) {
    for table in tables {
        let Some(place) = table.place(FLAW.name) else { continue };
        let [position, asterisk] = ["position", "mark"].map(|name| table.place(name));
        for row in table.rows.iter_mut().filter(|row| row.starts_with(key)) {
            row[place] = flaw.into();
            if let (Some(position), Some(asterisk)) = (position, asterisk)
                && row[position] == Cell::Missing
            {
                row[asterisk] = "*".into();
            }
        }
    }
}

/// Scores all sources, `jobs` at once, in their order: rows, or why there are none. `tell` hears how many are done.
pub(super) fn score_all(
    methods: &MethodRegistry,
    sources: &[Source],
    jobs: usize,
    tell: &(dyn Fn(usize) + Sync),
) -> Vec<Result<Rows, String>> {
    let (next, done) = (AtomicUsize::new(0), AtomicUsize::new(0));
    let work = || {
        let mut own = Vec::new();
        loop {
            let place = next.fetch_add(1, Ordering::Relaxed);
            let Some(source) = sources.get(place) else { return own };
            let rows =
                rows_of(methods, source).map_err(|error| format!("{}: {error}", source.path().display()));
            own.push((place, rows));
            tell(done.fetch_add(1, Ordering::Relaxed) + 1);
        }
    };
    let mut found: Vec<(usize, Result<Rows, String>)> = thread::scope(|scope| {
        let workers: Vec<_> = (0..jobs.max(1)).map(|_| scope.spawn(work)).collect();
        let joined = workers.into_iter().map(|worker| worker.join());
        joined.flat_map(|rows| rows.unwrap_or_else(|panic| std::panic::resume_unwind(panic))).collect()
    });
    found.sort_by_key(|(place, _)| *place);
    found.into_iter().map(|(_, rows)| rows).collect()
}

fn rows_of(methods: &MethodRegistry, source: &Source) -> Result<Rows, Box<dyn Error>> {
    // Before anything else: what is unknown is named, also where the file is not the recorded one any more.
    if let Source::Counted { dir, .. } | Source::Loose { dir } = source
        && let Err(error @ RecordingError::Damaged { .. }) = read_result::<TrialResult>(dir)
    {
        return Ok(Rows { refused: Some(error.to_string()), ..Rows::default() });
    }
    match source {
        Source::Counted { key, dir } => {
            let result: TrialResult = read_result(dir)?;
            let OfRecord { trace, flaws } = traces::of_record(methods, dir)?;
            let scores = counted(scores(key, &trace), &result);
            Ok(Rows { key: key.clone(), scores, ..Rows::flawed(dir, flaws) })
        }
        Source::Loose { dir } => loose(methods, dir),
        Source::Bag { path } => bag(path),
    }
}

/// Without a study, a seed stands for a participant: whoever has the same seed under several methods is the same simulated person.
fn loose(methods: &MethodRegistry, dir: &Path) -> Result<Rows, Box<dyn Error>> {
    let record = Trial::open(dir)?;
    if !record.finished() {
        let secs = record.end().as_secs();
        let note =
            format!("{}: interrupted at {secs:.1} s, without a result; it does not count", dir.display());
        return Ok(Rows { notes: vec![note], ..Rows::default() });
    }
    let result: TrialResult = read_result(dir)?;
    let key = vec![
        result.seed.to_string().into(),
        Cell::Missing,
        Cell::Missing,
        result.method.as_str().into(),
        // Its number is given where all are known.
        Cell::Missing,
    ];
    let trial = by_name(TRIALS, &key, |name| match name {
        "arrangement" => result.beside.get("arrangement").map(word).into(),
        "seed" => result.seed.to_string().into(),
        "method" => result.method.as_str().into(),
        "task" => result.task.as_str().into(),
        "arm" => result.arm.as_str().into(),
        "setup" => result.setup.as_str().into(),
        "ended" => word(&result.ended).into(),
        "score" => result.counted_score().into(),
        "score_name" => result.score_name.as_str().into(),
        "seconds" => result.sim_seconds.into(),
        "gesture_source" => result.gesture_source.as_str().into(),
        "unsolved_ticks" => result.unsolved_ticks.into(),
        "record" => dir.display().to_string().into(),
        "digest" => result.digest.as_str().into(),
        _ => Cell::Missing,
    });
    let OfRecord { trace, flaws } = traces::of_record(methods, dir)?;
    let blocks = if result.failure().is_some() { Vec::new() } else { block_rows(&key, &result.result)? };
    Ok(Rows {
        scores: counted(scores(&key, &trace), &result),
        blocks,
        trial: Some(trial),
        key,
        ..Rows::flawed(dir, flaws)
    })
}

/// Of a trial that failed the faults alone say something.
fn counted([measures, objects, phases, faults]: ScoredRows, result: &TrialResult) -> ScoredRows {
    match result.failure() {
        None => [measures, objects, phases, faults],
        Some(_) => [Vec::new(), Vec::new(), Vec::new(), faults],
    }
}

/// Rows of `measures`, `objects`, `phases`, `faults`.
type ScoredRows = [Vec<Vec<Cell>>; 4];

fn bag(path: &Path) -> Result<Rows, Box<dyn Error>> {
    let arm = Arm::named(proact_testbed::TrialConfig::DEFAULT_ARM)?;
    let traces::OfBag { trace, method, result, flaws } = traces::of_bag(path, &arm)?;
    let [participant, number] = ["participant", "trial"].map(|word| number_after(path, word));
    let key = vec![participant.into(), Cell::Missing, Cell::Missing, method.as_str().into(), number.into()];
    let trial = by_name(TRIALS, &key, |name| match name {
        "method" => method.as_str().into(),
        "task" => "modified_bbt".into(),
        "setup" => "bag".into(),
        "score" => result.as_ref().map(|result| result.score).into(),
        "score_name" => "blocks on target".into(),
        "seconds" => trace.length.as_secs().into(),
        "record" => path.display().to_string().into(),
        _ => Cell::Missing,
    });
    // What became of an object is known at the end alone.
    let blocks = match result {
        Some(result) => block_rows(&key, &result.result)?,
        None => {
            let row = |object| {
                by_name(BLOCKS, &key, |name| match name {
                    "block" => Cell::from(trace.scene.name(object)),
                    _ => Cell::Missing,
                })
            };
            trace.scene.ids().map(row).collect()
        }
    };
    Ok(Rows { scores: scores(&key, &trace), blocks, trial: Some(trial), key, ..Rows::flawed(path, flaws) })
}

/// The number that follows `word` in a file's name, as in `participant1-mode4-trial2`.
fn number_after(path: &Path, word: &str) -> Option<i64> {
    let name = path.file_stem()?.to_string_lossy().into_owned();
    let (_, rest) = name.split_once(word)?;
    let digits: String = rest.chars().take_while(char::is_ascii_digit).collect();
    digits.parse().ok()
}

fn by_name(columns: &[Column], key: &[Cell], of: impl Fn(&str) -> Cell) -> Vec<Cell> {
    let rest = columns.iter().skip(key.len()).map(|column| of(column.name));
    key.iter().cloned().chain(rest).collect()
}

/// Rows of `measures`, `objects`, `phases`, `faults`.
pub(super) fn scores(key: &[Cell], trace: &Trace) -> [Vec<Vec<Cell>>; 4] {
    let scored = Scored::of(trace);
    let name = |object| Cell::from(trace.scene.name(object));
    let row = |own: Vec<Cell>| key.iter().cloned().chain(own).collect::<Vec<Cell>>();
    let measured = OF_TRIAL.iter().map(|measure| (measure.of)(&scored, &()).into()).collect();
    let objects = scored.objects.iter().map(|handling| {
        let values = OF_OBJECT.iter().map(|measure| (measure.of)(&scored, handling).into());
        row(std::iter::once(name(handling.object)).chain(values).collect())
    });
    let phases = scored.phases.iter().map(|phase| {
        let first = [phase.kind.label().into(), name(phase.object), phase.time.into(), phase.ended.into()];
        let values = OF_PHASE.iter().map(|measure| (measure.of)(&scored, phase).into());
        row(first.into_iter().chain(values).collect())
    });
    let faults = scored.faults.iter().map(|fault| {
        let detail = if fault.detail.is_empty() { Cell::Missing } else { fault.detail.as_str().into() };
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
    let cell = |row: &[Cell], name| measures.cell(row, name).cloned().unwrap_or(Cell::Missing);
    let rows =
        measures.rows.iter().map(|row| COMPENSATION.iter().map(|column| cell(row, column.name)).collect());
    table.rows = rows.collect();
    table
}

/// Scores the trials of a study that count, for its export: marks the rows of flawed records in `tables`, and gives the table
/// `compensation`.
///
/// # Errors
/// A record that cannot be scored, by its name.
pub(crate) fn score_study(
    methods: &MethodRegistry,
    trials: Vec<(Vec<Cell>, PathBuf)>,
    tables: &mut [Table],
) -> Result<Table, String> {
    let sources: Vec<Source> = trials.into_iter().map(|(key, dir)| Source::Counted { key, dir }).collect();
    let jobs = thread::available_parallelism().map_or(1, usize::from);
    let mut all = Vec::new();
    let [mut measures, ..] = empty();
    for rows in score_all(methods, &sources, jobs, &|_| {}) {
        let mut rows = rows?;
        append(&mut measures, std::mem::take(&mut rows.scores[0]));
        all.push(rows);
    }
    let mut compensation = compensation(&measures);
    for rows in &all {
        if let Some(flaw) = rows.flaw() {
            mark(tables.iter_mut().chain([&mut compensation]), &rows.key, &flaw);
        }
    }
    Ok(compensation)
}

/// The tables that every source has.
pub(crate) fn trials_and_blocks() -> [Table; 2] {
    [Table::new("trials", "a trial", TRIALS), Table::new("blocks", "an object in a trial", BLOCKS)]
}
