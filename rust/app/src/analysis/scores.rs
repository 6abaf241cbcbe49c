//! The tables of scores, of many trials at once.

use super::traces;
use crate::{
    Arm,
    study::tables::{
        columns::{BLOCKS, TRIAL_KEY, TRIALS},
        trials::block_rows,
    },
};
use proact_analysis::{
    scoring::{Measure, OF_OBJECT, OF_PHASE, OF_TRIAL, Scored, Trace},
    table::{Cell, Column, Table, word},
};
use proact_control::MethodRegistry;
use proact_recording::{Trial, read_result};
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

/// Key, own columns and measures of a table.
fn columns<T>(first: &[Column], measures: &[Measure<T>]) -> Vec<Column> {
    let measured = measures.iter().map(|measure| measure.column);
    TRIAL_KEY.iter().chain(first).copied().chain(measured).collect()
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
    /// Of `measures`, `objects`, `phases`, `faults`.
    pub(super) scores: [Vec<Vec<Cell>>; 4],
    /// Of `trials`, for what is no trial of a study.
    pub(super) trial: Option<Vec<Cell>>,
    /// Of `blocks`, likewise.
    pub(super) blocks: Vec<Vec<Cell>>,
    /// What is missing or wrong.
    pub(super) notes: Vec<String>,
}

/// Scores all sources, `jobs` at once, in their order. `tell` hears how many are done.
pub(super) fn score_all(
    methods: &MethodRegistry,
    sources: &[Source],
    jobs: usize,
    tell: &(dyn Fn(usize) + Sync),
) -> Vec<Rows> {
    let (next, done) = (AtomicUsize::new(0), AtomicUsize::new(0));
    let work = || {
        let mut own = Vec::new();
        loop {
            let place = next.fetch_add(1, Ordering::Relaxed);
            let Some(source) = sources.get(place) else { return own };
            let rows = rows_of(methods, source).unwrap_or_else(|error| Rows {
                notes: vec![format!("{}: {error}; it is not scored", source.path().display())],
                ..Rows::default()
            });
            own.push((place, rows));
            tell(done.fetch_add(1, Ordering::Relaxed) + 1);
        }
    };
    let mut found: Vec<(usize, Rows)> = thread::scope(|scope| {
        let workers: Vec<_> = (0..jobs.max(1)).map(|_| scope.spawn(work)).collect();
        workers.into_iter().flat_map(|worker| worker.join().unwrap_or_default()).collect()
    });
    found.sort_by_key(|(place, _)| *place);
    found.into_iter().map(|(_, rows)| rows).collect()
}

fn rows_of(methods: &MethodRegistry, source: &Source) -> Result<Rows, Box<dyn Error>> {
    match source {
        Source::Counted { key, dir } => {
            let result: TrialResult = read_result(dir)?;
            let trace = traces::of_record(methods, dir)?;
            Ok(Rows { scores: counted(scores(key, &trace), &result), ..Rows::default() })
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
    let trace = traces::of_record(methods, dir)?;
    let blocks = if result.failure().is_some() {
        Vec::new()
    } else {
        block_rows(&key, &result.beside, &result.result)
    };
    Ok(Rows { scores: counted(scores(&key, &trace), &result), blocks, trial: Some(trial), notes: Vec::new() })
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
    let traces::OfBag { trace, method, result, flaw } = traces::of_bag(path, &arm)?;
    let [participant, number] = ["participant", "trial"].map(|word| number_after(path, word));
    let key = vec![participant.into(), Cell::Missing, Cell::Missing, method.as_str().into(), number.into()];
    let trial = by_name(TRIALS, &key, |name| match name {
        "method" => method.as_str().into(),
        "task" => "modified_bbt".into(),
        "setup" => "bag".into(),
        "score" => result.score.into(),
        "score_name" => "blocks on target".into(),
        "seconds" => trace.length.as_secs().into(),
        "record" => path.display().to_string().into(),
        _ => Cell::Missing,
    });
    let lacks = "a bag of the original lab does not tell what planner and grasp rule did, what ended the trial, nor its seed";
    let mut notes = vec![format!("{}: {lacks}", path.display())];
    notes.extend(flaw.map(|flaw| format!("{}: {flaw}; it is scored as far as it goes", path.display())));
    Ok(Rows {
        scores: scores(&key, &trace),
        blocks: block_rows(&key, &result.beside, &result.result),
        trial: Some(trial),
        notes,
    })
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

/// The tables that every source has.
pub(crate) fn trials_and_blocks() -> [Table; 2] {
    [Table::new("trials", "a trial", TRIALS), Table::new("blocks", "an object in a trial", BLOCKS)]
}
