//! The lines of all shards, put in order: one file of JSON lines, and the tables of an analysis.

use super::{
    BatchError, BatchFolder, ScoreTally, Shard, Sweep,
    folder::{TrialLine, read_line, scan},
    run::MACHINE_DEPENDENT_KEYS,
    trial_list::label,
};
use crate::{
    analysis::{tables_of_scores, trials_and_blocks},
    study::{TrialScores, tables::trials::block_rows},
};
use proact_analysis::table::{Table, TableCell};
use proact_files::OutputFile;
use proact_testbed::TrialResult;
use serde_json::{Value, json};
use std::{
    collections::BTreeMap,
    error::Error,
    fs::File,
    io::{BufWriter, Write},
    path::PathBuf,
};

/// All trials, one a line.
const TRIALS_FILE: &str = "trials.jsonl";

/// What was put together.
#[derive(Debug)]
pub struct MergedBatch {
    /// All trials as JSON lines.
    pub lines: PathBuf,
    /// Tables as CSV, by name.
    pub tables: BTreeMap<String, PathBuf>,
    /// Scores by condition and cell.
    pub tally: ScoreTally,
    /// Score of each trial, in their order.
    pub scores: Vec<f64>,
    /// Digest of each trial, in their order.
    pub digests: Vec<String>,
}

/// Puts the trials of the batch in `folder` in order. None if some are missing, unless `all` have to be there.
///
/// # Errors
/// [`BatchError::Incomplete`] if trials are missing; a disk that refuses.
pub fn merge_shards(folder: &BatchFolder, all: bool) -> Result<Option<MergedBatch>, Box<dyn Error>> {
    // Of several shards that end at once, one puts them together, and the next finds the same.
    let _lock = BatchFolder::lock_dir(&folder.dir)?;
    let shards = folder.description.shards;
    let trials = folder.description.trials;
    // Where the line of each trial is.
    let mut sources: Vec<Option<(u64, usize)>> = vec![None; trials];
    let shard = |index: usize| Shard { number: index % shards + 1, count: shards };
    for number in 1..=shards {
        let shard = Shard { number, count: shards };
        let path = folder.shard_path(shard);
        if path.is_file() {
            scan(&path, |index, start, length| sources[index] = Some((start, length)), trials, shard)?;
        }
    }
    let missing: Vec<usize> = (0..trials).filter(|index| sources[*index].is_none()).collect();
    if !missing.is_empty() {
        if !all {
            return Ok(None);
        }
        let mut of: Vec<usize> = missing.iter().map(|index| shard(*index).number).collect();
        of.sort_unstable();
        of.dedup();
        let names: Vec<String> = of.iter().take(20).map(|number| format!("{number}/{shards}")).collect();
        let more = if of.len() > names.len() { " and others" } else { "" };
        let (dir, missing, shards) = (folder.dir.clone(), missing.len(), names.join(", ") + more);
        return Err(BatchError::Incomplete { dir, missing, trials, shards }.into());
    }
    let mut files: BTreeMap<usize, File> = BTreeMap::new();
    let mut out = MergeOutput::begin(folder)?;
    for (index, source) in sources.iter().enumerate() {
        let Some((start, length)) = *source else { continue };
        let shard = shard(index);
        let path = folder.shard_path(shard);
        if !files.contains_key(&shard.number) {
            // So many files a program may have open.
            if files.len() >= 256 {
                files.clear();
            }
            files.insert(shard.number, File::open(&path)?);
        }
        let Some(file) = files.get_mut(&shard.number) else { continue };
        out.push(read_line(file, &path, start, length)?)?;
    }
    Ok(Some(out.finish()?))
}

/// A table that is being written.
struct TableFile {
    writer: csv::Writer<BufWriter<OutputFile>>,
    columns: usize,
}

struct MergeOutput {
    lines: BufWriter<OutputFile>,
    tables: BTreeMap<&'static str, TableFile>,
    conditions: Vec<String>,
    sweep: Sweep,
    merged: MergedBatch,
}

impl MergeOutput {
    fn begin(folder: &BatchFolder) -> Result<Self, Box<dyn Error>> {
        let sweep = Sweep::parse(&folder.description.vary)?;
        let lines = folder.dir.join(TRIALS_FILE);
        let mut tables = BTreeMap::new();
        let mut paths = BTreeMap::new();
        let empty: Vec<Table> = trials_and_blocks().into_iter().chain(tables_of_scores()).collect();
        for Table { name, columns, .. } in &empty {
            let path = folder.dir.join(format!("{name}.csv"));
            let mut writer = csv::Writer::from_writer(BufWriter::new(OutputFile::create(&path)?));
            writer.write_record(columns.iter().map(|column| column.name).chain(sweep.keys()))?;
            tables.insert(*name, TableFile { writer, columns: columns.len() });
            paths.insert((*name).to_owned(), path);
        }
        let file = OutputFile::create(&lines)?;
        let merged = MergedBatch {
            tables: paths,
            lines,
            tally: ScoreTally::default(),
            scores: Vec::new(),
            digests: Vec::new(),
        };
        let conditions = folder.description.conditions.clone();
        Ok(Self { lines: BufWriter::new(file), tables, conditions, sweep, merged })
    }

    fn push(&mut self, line: TrialLine) -> Result<(), Box<dyn Error>> {
        let TrialLine { trial, mut result, scores, .. } = line;
        for (key, value) in MACHINE_DEPENDENT_KEYS.into_iter().zip([json!(0.0), json!(0.0), json!(null)]) {
            result.insert(key.to_owned(), value);
        }
        let result: TrialResult = serde_json::from_value(Value::Object(result))?;
        let values = self.sweep.cell(trial.cell);
        let condition =
            self.conditions.get(trial.condition).ok_or("a trial of a condition that the batch has not")?;
        let label = label(condition, &values);
        let key: Vec<TableCell> = vec![
            trial.participant.into(),
            TableCell::Missing,
            trial.session.clone().into(),
            label.as_str().into(),
            trial.trial.into(),
        ];
        let arrangement =
            result.legacy_fields.get("arrangement").map(proact_analysis::table::serialized_name);
        let mut write = |name: &str,
                         row: &mut dyn Iterator<Item = TableCell>|
         -> Result<(), Box<dyn Error>> {
            let Some(table) = self.tables.get_mut(name) else { return Ok(()) };
            // A trial that was computed here has no flaw, which is the last cell.
            let cells = row
                .chain(std::iter::once(TableCell::Missing))
                .take(table.columns)
                .map(|cell| cell.to_string());
            table.writer.write_record(cells.chain(values.iter().map(|(_, value)| (*value).to_owned())))?;
            Ok(())
        };
        let of_trial = |name: &str| -> TableCell {
            match name {
                "position" => trial.position.into(),
                "arrangement" => arrangement.clone().into(),
                "seed" => trial.seed.to_string().into(),
                "method" => result.method.as_str().into(),
                "task" => result.task.as_str().into(),
                "arm" => result.arm.as_str().into(),
                "setup" => result.setup.as_str().into(),
                "ended" => proact_analysis::table::serialized_name(&result.ended).into(),
                "score" => result.counted_score().into(),
                "score_name" => result.score_name.as_str().into(),
                "seconds" => result.sim_seconds.into(),
                "gesture_source" => result.gesture_source.as_str().into(),
                "unsolved_ticks" => result.unsolved_ticks.into(),
                "digest" => result.digest.as_str().into(),
                "simulated" => true.into(),
                _ => TableCell::Missing,
            }
        };
        let own = trials_and_blocks();
        let own = own.iter().find(|table| table.name == "trials").map_or(&[][..], |table| table.columns);
        let rest = own.iter().skip(key.len()).map(|column| of_trial(column.name));
        write("trials", &mut key.iter().cloned().chain(rest))?;
        // Of a trial that failed the faults alone say something.
        let scores = match result.failure() {
            None => {
                for row in block_rows(&key, &result.result)? {
                    write("blocks", &mut row.into_iter())?;
                }
                scores
            }
            Some(_) => TrialScores { faults: scores.faults, ..TrialScores::default() },
        };
        let TrialScores { measures, objects, phases, faults } = scores;
        for (name, rows) in
            [("measures", measures), ("objects", objects), ("phases", phases), ("faults", faults)]
        {
            for row in rows {
                write(name, &mut key.iter().cloned().chain(row))?;
            }
        }
        let line = json!({
            "trial": trial.index + 1, "participant": trial.participant, "session": trial.session,
            "condition": condition, "position": trial.position, "number": trial.trial,
            "values": values.iter().map(|(key, value)| ((*key).to_owned(), json!(value))).collect::<serde_json::Map<_, _>>(),
            "seed": trial.seed, "method": result.method, "task": result.task, "arm": result.arm, "setup": result.setup,
            "arrangement": arrangement, "score": result.counted_score(), "score_name": result.score_name, "seconds": result.sim_seconds,
            "ended": result.ended, "failure": result.failure(), "gesture_source": result.gesture_source, "unsolved_ticks": result.unsolved_ticks,
            "result": result.result, "outcomes": result.legacy_fields.get("outcomes"), "digest": result.digest, "simulated": true,
        });
        writeln!(self.lines, "{}", proact_types::to_json(&line)?)?;
        self.merged.tally.take(&label, trial.index, &result);
        self.merged.scores.push(result.score);
        self.merged.digests.push(result.digest.clone());
        Ok(())
    }

    fn finish(self) -> Result<MergedBatch, Box<dyn Error>> {
        let Self { lines, tables, merged, .. } = self;
        lines.into_inner()?.finish()?;
        for table in tables.into_values() {
            table.writer.into_inner().map_err(|error| error.to_string())?.into_inner()?.finish()?;
        }
        Ok(merged)
    }
}
