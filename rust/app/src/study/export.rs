//! What leaves a study: its tables as files, and the whole of it in one archive.

use super::{
    STUDY_FILE, Study, TRIALS_FOLDER,
    conductor::{StudyError, StudyViewOptions, open_view, open_view_with},
    tables::{armsym_files, check_answers, columns::TRIALS, counted_trial_records, faulty_records, tables},
};
use crate::analysis::score_study;
use proact_analysis::table::{ColumnNames, Table, TableCell};
use proact_control::MethodRegistry;
use proact_files::{OutputFile, check_output_dir_claim, claim_output_dir, make_folder, write_atomically};
use proact_recording::{
    MANIFEST_FILE,
    journal::{Journal, JournalError},
    sha256, verify_manifest, write_manifest,
};
use proact_study::{FormItem, TranslatedText};
use std::{
    collections::BTreeMap,
    error::Error,
    fs::{self, File},
    io::{self, BufReader, BufWriter, Seek, Write},
    path::{Path, PathBuf},
};
use zip::{CompressionMethod, ZipArchive, ZipWriter, write::SimpleFileOptions};

/// Where tables go, in the study's folder.
const TABLES_FOLDER: &str = "tables";
/// Events as ArmSym writes them, in the folder of the tables.
const ARMSYM_FOLDER: &str = "armsym";
/// What each column is: the first file of an export.
const CODEBOOK: &str = "codebook.csv";
/// What each question is.
const QUESTIONS: &str = "questions.csv";
const DIR_CONTENT: &str = "export";
/// All tables in one file of SQLite.
const TABLES_FILE: &str = "tables.sqlite";

/// What is exported.
#[derive(Clone, Debug, Default)]
pub struct ExportOptions {
    /// Where it goes; `tables` in the study's folder if left out.
    pub out: Option<PathBuf>,
    /// Gaze and shoulder sample by sample too, which may tell who somebody is.
    pub raw: bool,
    /// The pseudonyms of the journal stay. Without it participants are called by their places in the plan.
    pub keep_pseudonyms: bool,
    /// The events and joints of each trial as ArmSym writes them too, in the folder `armsym`.
    pub armsym: bool,
    /// Names of the columns.
    pub column_names: ColumnNames,
    /// With these methods trials are recomputed.
    pub methods: MethodRegistry,
}

/// What was written.
#[derive(Clone, Debug)]
pub struct ExportSummary {
    /// Where.
    pub folder: PathBuf,
    /// Rows of each table.
    pub rows: BTreeMap<String, usize>,
    /// The tables are in the study's own file too; they are not while another program runs it.
    pub in_study_file: bool,
}

/// Writes the tables of a study as far as it is: each as CSV, all in one SQLite file, with a codebook and hashes. Those in the
/// study's own file are made anew as well. `tell` hears how many trials of how many are computed again.
///
/// # Errors
/// A record that cannot be read, a folder that is not empty and is not an earlier export, a full disk.
pub fn export(
    study: &Study,
    options: &ExportOptions,
    tell: &(dyn Fn(usize, usize) + Sync),
) -> Result<ExportSummary, Box<dyn Error>> {
    let folder = options.out.clone().unwrap_or_else(|| study.folder.join(TABLES_FOLDER));
    check_output_dir_claim(&folder, CODEBOOK, DIR_CONTENT)?;
    let numbered = |participant: usize| (!options.keep_pseudonyms).then(|| format!("P{participant:02}"));
    let view = open_view_with(study, &StudyViewOptions { rename: &numbered })?;
    let mut made = tables(study, &view, options.raw)?;
    let compensation = score_study(&options.methods, counted_trial_records(study, &view), &mut made, tell)?;
    made.push(compensation);
    claim_export_dir(&folder)?;
    // The codebook first: by it the next export knows the folder as its own, whatever ends this one.
    let mut texts = vec![
        (CODEBOOK.to_owned(), codebook_csv(&made, options.column_names)?),
        (QUESTIONS.to_owned(), questions(study)?),
    ];
    for table in &made {
        texts.push((format!("{}.csv", table.name), table_csv(table, options.column_names)?));
    }
    texts.push((super::PLAN_FILE.to_owned(), study.plan_text.clone()));
    for (name, text) in texts {
        write_atomically(&folder.join(name), &text)?;
    }
    if options.armsym {
        armsym_files(study, &view, &options.methods, |files| {
            let own = folder.join(ARMSYM_FOLDER).join(&files.subject).join(format!("trial_{}", files.trial));
            make_folder(&own)?;
            write_atomically(&own.join("trialdata.json"), &proact_types::to_json(&files.events)?)?;
            Ok(write_atomically(&own.join("Joint_Data.csv"), &files.joints)?)
        })?;
    }
    // SQLite makes files of its own beside the one that it writes.
    let scratch = folder.join(format!(".{TABLES_FILE}"));
    remove(&scratch)?;
    Journal::write_tables(&scratch, &made, options.column_names)?;
    write_atomically(&folder.join(TABLES_FILE), fs::read(&scratch)?)?;
    remove(&scratch)?;
    write_manifest(&folder)?;
    let in_study_file = match write_tables_to_study_file(study, &made) {
        Err(StudyError::Journal(JournalError::InUse { .. } | JournalError::Missing { .. })) => false,
        done => done.map(|()| true)?,
    };
    let rows = made.iter().map(|table| (table.name.to_owned(), table.rows.len())).collect();
    Ok(ExportSummary { folder, rows, in_study_file })
}

/// The export in the study's own folder, if it is whole and of the journal and the plan as they are now, so that another one would
/// write the same.
///
/// # Errors
/// A journal that cannot be read.
pub fn current_export(study: &Study) -> Result<Option<ExportSummary>, StudyError> {
    let folder = study.folder.join(TABLES_FOLDER);
    let same_plan =
        fs::read_to_string(folder.join(super::PLAN_FILE)).is_ok_and(|text| text == study.plan_text);
    if !same_plan || !matches!(verify_manifest(&folder), Ok(true)) {
        return Ok(None);
    }
    let events = open_view(study)?.entries.len();
    Ok(count_rows(&folder).filter(|rows| rows.get("events") == Some(&events)).map(|rows| ExportSummary {
        folder,
        rows,
        in_study_file: true,
    }))
}

/// Rows of each exported table in `folder`; none if a table cannot be read or has columns of another version.
fn count_rows(folder: &Path) -> Option<BTreeMap<String, usize>> {
    let mut found = BTreeMap::new();
    for entry in fs::read_dir(folder).ok()? {
        let path = entry.ok()?.path();
        let file = path.file_name()?.to_str()?;
        let Some(name) = file.strip_suffix(".csv").filter(|_| ![CODEBOOK, QUESTIONS].contains(&file)) else {
            continue;
        };
        let mut reader = csv::Reader::from_path(&path).ok()?;
        let is_ours = |head: &csv::StringRecord| head.iter().eq(TRIALS.iter().map(|column| column.name));
        if name == "trials" && !is_ours(reader.headers().ok()?) {
            return None;
        }
        found.insert(name.to_owned(), reader.records().count());
    }
    Some(found)
}

fn write_tables_to_study_file(study: &Study, tables: &[Table]) -> Result<(), StudyError> {
    let path = study.folder.join(STUDY_FILE);
    if !path.is_file() {
        return Err(JournalError::Missing { path }.into());
    }
    Ok(Journal::open(&path)?.put_tables(tables)?)
}

/// Makes a folder, or takes one that an export wrote, of which what goes with its old state alone is removed.
fn claim_export_dir(folder: &Path) -> Result<(), Box<dyn Error>> {
    claim_output_dir(folder, CODEBOOK, DIR_CONTENT)?;
    // Without checksums until all is written again, and without samples that were not asked for this time.
    for name in [MANIFEST_FILE, "raw_gaze.csv", "raw_shoulder.csv"] {
        remove(&folder.join(name))?;
    }
    let events = folder.join(ARMSYM_FOLDER);
    match fs::remove_dir_all(&events) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => {
            Err(format!("{}: {error}", events.display()).into())
        }
        _ => Ok(()),
    }
}

/// Removes a file if it is there.
fn remove(path: &Path) -> Result<(), Box<dyn Error>> {
    match fs::remove_file(path) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => {
            Err(format!("{}: {error}", path.display()).into())
        }
        _ => Ok(()),
    }
}

/// A table as CSV.
pub(crate) fn table_csv(table: &Table, names: ColumnNames) -> Result<String, Box<dyn Error>> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    writer.write_record(table.columns.iter().map(|column| column.written_name(names)))?;
    for row in &table.rows {
        writer.write_record(row.iter().map(TableCell::to_string))?;
    }
    Ok(String::from_utf8(writer.into_inner()?)?)
}

/// What each column of each table is.
pub(crate) fn codebook_csv(tables: &[Table], names: ColumnNames) -> Result<String, Box<dyn Error>> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    writer.write_record(["table", "row", "column", "unit", "meaning", "source", "formerly"])?;
    for table in tables {
        for column in table.columns {
            writer.write_record([
                table.name,
                table.row_meaning,
                column.written_name(names),
                column.unit,
                column.meaning,
                column.source,
                column.formerly,
            ])?;
        }
    }
    Ok(String::from_utf8(writer.into_inner()?)?)
}

/// What each item of each questionnaire asks.
fn questions(study: &Study) -> Result<String, Box<dyn Error>> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    writer.write_record(["form", "item", "kind", "text", "answers", "source", "licence", "confirmed"])?;
    for form in study.forms.values() {
        for item in &form.items {
            let (kind, text, answers) = item_description(item);
            let confirmed = form.wording_verified.to_string();
            writer.write_record([
                &form.name,
                item.key(),
                kind,
                text,
                &answers,
                &form.source,
                &form.license,
                &confirmed,
            ])?;
        }
        for (first, second) in form.pairs() {
            let (key, answers) = (proact_study::pair_key(first, second), format!("{first} or {second}"));
            let text = "which of the two contributed more";
            let confirmed = form.wording_verified.to_string();
            writer.write_record([
                &form.name,
                &key,
                "pair",
                text,
                &answers,
                &form.source,
                &form.license,
                &confirmed,
            ])?;
        }
    }
    Ok(String::from_utf8(writer.into_inner()?)?)
}

/// The kind of an item, its question in English or the first language that there is, and what can be answered.
fn item_description(item: &FormItem) -> (&'static str, &str, String) {
    match item {
        FormItem::Scale { text, low, high, min, max, step, .. } => {
            let answers =
                format!("{min} ({}) to {max} ({}) by {step}", preferred_text(low), preferred_text(high));
            ("scale", preferred_text(text), answers)
        }
        FormItem::Choice { text, options, multiple: several, .. } => {
            let values: Vec<&str> = options.iter().map(|option| option.value.as_str()).collect();
            let kind = if *several { "choice of several" } else { "choice" };
            (kind, preferred_text(text), values.join(", "))
        }
        FormItem::Ranking { text, .. } => {
            ("ranking", preferred_text(text), "conditions by place, = between shared places".to_owned())
        }
        FormItem::Condition { text, .. } => ("condition", preferred_text(text), "a condition".to_owned()),
        FormItem::Consent { text, version, .. } => {
            ("consent", preferred_text(text), format!("version {version}"))
        }
        FormItem::Text { text, .. } => ("text", preferred_text(text), "free words".to_owned()),
    }
}

pub(super) fn preferred_text(texts: &TranslatedText) -> &str {
    texts.get("en").or_else(|| texts.values().next()).map_or("", String::as_str)
}

/// All files below a folder by their paths within it, `/` between parts, in the order of their names.
fn files(folder: &Path) -> io::Result<BTreeMap<String, PathBuf>> {
    let mut found = BTreeMap::new();
    let mut folders = vec![(String::new(), folder.to_owned())];
    while let Some((prefix, folder)) = folders.pop() {
        for entry in fs::read_dir(folder)? {
            let entry = entry?;
            let name = format!("{prefix}{}", entry.file_name().to_string_lossy());
            // A link may lead anywhere, also back here.
            match entry.file_type()? {
                kind if kind.is_dir() => folders.push((format!("{name}/"), entry.path())),
                kind if kind.is_file() => drop(found.insert(name, entry.path())),
                _ => {}
            }
        }
    }
    Ok(found)
}

/// What an archive does with records that are missing, cannot be read, or are in the folder of another trial.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FaultyRecordPolicy {
    /// It is not made.
    Refuse,
    /// It is made of what there is, and says what is wrong.
    Accept,
}

/// An archive that was made.
#[derive(Clone, Debug)]
pub struct ArchiveSummary {
    /// Number of files.
    pub files: usize,
    /// What is wrong with records of trials that count, a sentence each.
    pub faulty_records: Vec<String>,
}

/// Puts the whole folder of a study into the new file `out`: plan, questionnaires, journal, records, models, tables, and hashes of
/// all of it. The journal is as it was at one moment. What was written is read again and compared. `tell` hears of each file, with
/// its number and how many there are.
///
/// # Errors
/// Records that are `faulty`, by their names; a file that exists, a disk that is full, an archive that does not read back as it was
/// written.
pub fn archive(
    study: &Study,
    out: &Path,
    faulty: FaultyRecordPolicy,
    mut tell: impl FnMut(usize, usize),
) -> Result<ArchiveSummary, Box<dyn Error>> {
    let view = open_view(study)?;
    check_answers(study, &view)?;
    let faulty_records = faulty_records(study, &view);
    if faulty == FaultyRecordPolicy::Refuse && !faulty_records.is_empty() {
        return Err(format!(
            "records of the study are damaged, missing or misplaced; put them back, or archive what there is with \
             --accept-damaged:\n  {}",
            faulty_records.join("\n  ")
        )
        .into());
    }
    let mut file = OutputFile::create_new(out)?;
    let sums = write_archive_entries(study, &mut file, out, &mut tell)?;
    file.rewind()
        .map_err(Box::from)
        .and_then(|()| check(&mut file, &sums))
        .map_err(|error: Box<dyn Error>| format!("{}: {error}", out.display()))?;
    file.finish()?;
    Ok(ArchiveSummary { files: sums.len(), faulty_records })
}

/// Writes all files; their hashes by name.
fn write_archive_entries(
    study: &Study,
    file: &mut OutputFile,
    out: &Path,
    tell: &mut dyn FnMut(usize, usize),
) -> Result<BTreeMap<String, String>, Box<dyn Error>> {
    let scratch = study.folder.join(format!(".{STUDY_FILE}.archived"));
    let _ = fs::remove_file(&scratch);
    let mut found = files(&study.folder)?;
    let temporary = |name: &str| {
        name.starts_with(STUDY_FILE)
            || Path::new(name).file_name().is_some_and(|name| name.to_string_lossy().starts_with('.'))
    };
    found.retain(|name, path| !temporary(name) && fs::canonicalize(path).ok() != fs::canonicalize(out).ok());
    if study.folder.join(STUDY_FILE).is_file() {
        Journal::open_read_only(&study.folder.join(STUDY_FILE))?.copy_to(&scratch)?;
        found.insert(STUDY_FILE.to_owned(), scratch.clone());
    }
    let prefix = &study.plan.name;
    let options = |name: &str| {
        // What a bag or a log holds is compressed already, or hardly can be.
        let bag = name.starts_with(TRIALS_FOLDER) && name.ends_with(".bag");
        let method = if bag { CompressionMethod::Stored } else { CompressionMethod::Deflated };
        SimpleFileOptions::default().compression_method(method).large_file(true)
    };
    let mut zip = ZipWriter::new(BufWriter::new(file));
    let mut hashes = BTreeMap::new();
    let all = found.len() + 1;
    for (k, (name, path)) in found.iter().enumerate() {
        zip.start_file(format!("{prefix}/{name}"), options(name))?;
        let mut from = File::open(path)?;
        io::copy(&mut from, &mut zip)?;
        hashes.insert(name.clone(), sha256(File::open(path)?)?);
        tell(k + 1, all);
    }
    let _ = fs::remove_file(&scratch);
    let text: String = hashes.iter().map(|(name, hash)| format!("{hash}  {name}\n")).collect();
    zip.start_file(format!("{prefix}/{MANIFEST_FILE}"), options(MANIFEST_FILE))?;
    zip.write_all(text.as_bytes())?;
    zip.finish()?.flush()?;
    tell(all, all);
    Ok(hashes.into_iter().map(|(name, hash)| (format!("{prefix}/{name}"), hash)).collect())
}

/// Reads an archive again.
fn check(file: &mut OutputFile, hashes: &BTreeMap<String, String>) -> Result<(), Box<dyn Error>> {
    let mut zip = ZipArchive::new(BufReader::new(file))?;
    for (name, expected) in hashes {
        let got = sha256(zip.by_name(name)?)?;
        if got != *expected {
            return Err(format!("{name} does not read back as it was written").into());
        }
    }
    Ok(())
}
