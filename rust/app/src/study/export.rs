//! What leaves a study: its tables as files, and the whole of it in one archive.

use super::{
    STUDY_FILE, Study, TRIALS_FOLDER,
    conductor::{LookOptions, StudyError, look, look_with},
    tables::{armsym_files, check_places, tables},
};
use crate::{claim_folder, write_whole};
use proact_analysis::table::{Cell, Table};
use proact_control::MethodRegistry;
use proact_recording::{
    MANIFEST_FILE,
    journal::{Journal, JournalError},
    seal, sha256,
};
use proact_study::{FormItem, Texts};
use std::{
    collections::BTreeMap,
    error::Error,
    fs::{self, File},
    io::{self, Write},
    path::{Path, PathBuf},
};
use zip::{CompressionMethod, ZipArchive, ZipWriter, write::SimpleFileOptions};

/// Where tables go, in the study's folder.
const TABLES_FOLDER: &str = "tables";
/// Events as ArmSym writes them, in the folder of the tables.
const ARMSYM_FOLDER: &str = "armsym";
/// What each column is: the first file of an export.
const CODEBOOK: &str = "codebook.csv";

/// What is exported.
#[derive(Clone, Debug, Default)]
pub struct ExportOptions {
    /// Where it goes; `tables` in the study's folder if left out.
    pub out: Option<PathBuf>,
    /// Gaze and shoulder sample by sample too, which may tell who somebody is.
    pub raw: bool,
    /// The pseudonyms of the journal stay. Without it participants are called by their places in the plan.
    pub keep_ids: bool,
    /// The events and joints of each trial as ArmSym writes them too, in the folder `armsym`: with these methods trials are
    /// recomputed for it.
    pub armsym: Option<MethodRegistry>,
}

/// What was written.
#[derive(Clone, Debug)]
pub struct Exported {
    /// Where.
    pub folder: PathBuf,
    /// Rows of each table.
    pub rows: BTreeMap<String, usize>,
    /// The tables are in the study's own file too; they are not while another program runs it.
    pub in_study_file: bool,
}

/// Writes the tables of a study as far as it is: each as CSV, all in one SQLite file, with a codebook and hashes. Those in the
/// study's own file are made anew as well.
///
/// # Errors
/// A record that cannot be read, a folder that is not empty and is none of ours, a full disk.
pub fn export(study: &Study, options: &ExportOptions) -> Result<Exported, Box<dyn Error>> {
    let numbered = |participant: usize| (!options.keep_ids).then(|| format!("P{participant:02}"));
    let look = look_with(study, &LookOptions { rename: &numbered })?;
    let made = tables(study, &look, options.raw)?;
    let folder = options.out.clone().unwrap_or_else(|| study.folder.join(TABLES_FOLDER));
    claim(&folder)?;
    // The codebook first: by it the next export knows the folder as its own, whatever ends this one.
    let mut texts =
        vec![(CODEBOOK.to_owned(), codebook_csv(&made)?), ("questions.csv".to_owned(), questions(study)?)];
    for table in &made {
        texts.push((format!("{}.csv", table.name), table_csv(table)?));
    }
    texts.push((super::PLAN_FILE.to_owned(), study.plan_text.clone()));
    for (name, text) in texts {
        write_whole(&folder.join(name), &text)?;
    }
    if let Some(methods) = &options.armsym {
        armsym_files(study, &look, methods, |files| {
            let own = folder.join(ARMSYM_FOLDER).join(&files.subject).join(format!("trial_{}", files.trial));
            fs::create_dir_all(&own).map_err(|error| format!("{}: {error}", own.display()))?;
            write_whole(&own.join("trialdata.json"), &serde_json::to_string(&files.events)?)?;
            Ok(write_whole(&own.join("Joint_Data.csv"), &files.joints)?)
        })?;
    }
    let (tables_file, partial) = (folder.join("tables.sqlite"), folder.join("tables.sqlite.partial"));
    remove(&partial)?;
    Journal::write_tables(&partial, &made)?;
    fs::rename(&partial, &tables_file).map_err(|error| format!("{}: {error}", tables_file.display()))?;
    seal(&folder)?;
    let in_study_file = match put_into_study(study, &made) {
        Err(StudyError::Journal(JournalError::InUse { .. } | JournalError::Missing { .. })) => false,
        done => done.map(|()| true)?,
    };
    let rows = made.iter().map(|table| (table.name.to_owned(), table.rows.len())).collect();
    Ok(Exported { folder, rows, in_study_file })
}

fn put_into_study(study: &Study, tables: &[Table]) -> Result<(), StudyError> {
    let path = study.folder.join(STUDY_FILE);
    if !path.is_file() {
        return Err(JournalError::Missing { path }.into());
    }
    Ok(Journal::open(&path)?.put_tables(tables)?)
}

/// Makes a folder, or takes one that an export wrote, of which what goes with its old state alone is removed.
fn claim(folder: &Path) -> Result<(), Box<dyn Error>> {
    claim_folder(folder, CODEBOOK, "export")?;
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
pub(crate) fn table_csv(table: &Table) -> Result<String, Box<dyn Error>> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    writer.write_record(table.columns.iter().map(|column| column.name))?;
    for row in &table.rows {
        writer.write_record(row.iter().map(Cell::to_string))?;
    }
    Ok(String::from_utf8(writer.into_inner()?)?)
}

/// What each column of each table is.
pub(crate) fn codebook_csv(tables: &[Table]) -> Result<String, Box<dyn Error>> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    writer.write_record(["table", "row", "column", "unit", "meaning", "source"])?;
    for table in tables {
        for column in table.columns {
            writer.write_record([
                table.name,
                table.row,
                column.name,
                column.unit,
                column.meaning,
                column.source,
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
            let (kind, text, answers) = asked(item);
            let confirmed = form.confirmed.to_string();
            writer.write_record([
                &form.name,
                item.key(),
                kind,
                text,
                &answers,
                &form.source,
                &form.licence,
                &confirmed,
            ])?;
        }
        for (first, second) in form.pairs() {
            let (key, answers) = (proact_study::pair_key(first, second), format!("{first} or {second}"));
            let text = "which of the two contributed more";
            let confirmed = form.confirmed.to_string();
            writer.write_record([
                &form.name,
                &key,
                "pair",
                text,
                &answers,
                &form.source,
                &form.licence,
                &confirmed,
            ])?;
        }
    }
    Ok(String::from_utf8(writer.into_inner()?)?)
}

/// The kind of an item, its question in English or the first language that there is, and what can be answered.
fn asked(item: &FormItem) -> (&'static str, &str, String) {
    match item {
        FormItem::Scale { text, low, high, least, most, step, .. } => {
            let answers = format!("{least} ({}) to {most} ({}) by {step}", told(low), told(high));
            ("scale", told(text), answers)
        }
        FormItem::Choice { text, options, several, .. } => {
            let values: Vec<&str> = options.iter().map(|option| option.value.as_str()).collect();
            let kind = if *several { "choice of several" } else { "choice" };
            (kind, told(text), values.join(", "))
        }
        FormItem::Ranking { text, .. } => {
            ("ranking", told(text), "conditions by place, = between shared places".to_owned())
        }
        FormItem::Condition { text, .. } => ("condition", told(text), "a condition".to_owned()),
        FormItem::Consent { text, version, .. } => ("consent", told(text), format!("version {version}")),
        FormItem::Text { text, .. } => ("text", told(text), "free words".to_owned()),
    }
}

pub(super) fn told(texts: &Texts) -> &str {
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

/// Puts the whole folder of a study into the new file `out`: plan, questionnaires, journal, records, models, tables, and hashes of
/// all of it. The journal is as it was at one moment. What was written is read again and compared. `tell` hears of each file, with
/// its number and how many there are.
///
/// # Errors
/// A record in the folder of another trial, a file that exists, a disk that is full, an archive that does not read back as it was
/// written.
pub fn archive(
    study: &Study,
    out: &Path,
    mut tell: impl FnMut(usize, usize),
) -> Result<usize, Box<dyn Error>> {
    let failed = |error: &dyn std::fmt::Display| format!("{}: {error}", out.display());
    check_places(study, &look(study)?)?;
    let file = File::options().write(true).create_new(true).open(out).map_err(|error| failed(&error))?;
    let written = fill(study, file, out, &mut tell);
    match written.and_then(|sums| check(out, &sums).map(|()| sums.len())) {
        Ok(count) => Ok(count),
        Err(error) => {
            // Half an archive is worse than none.
            let _ = fs::remove_file(out);
            Err(failed(&error).into())
        }
    }
}

/// Writes all files; their hashes by name.
fn fill(
    study: &Study,
    file: File,
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
        Journal::read(&study.folder.join(STUDY_FILE))?.copy_to(&scratch)?;
        found.insert(STUDY_FILE.to_owned(), scratch.clone());
    }
    let prefix = &study.plan.name;
    let options = |name: &str| {
        // What a bag or a log holds is compressed already, or hardly can be.
        let bag = name.starts_with(TRIALS_FOLDER) && name.ends_with(".bag");
        let method = if bag { CompressionMethod::Stored } else { CompressionMethod::Deflated };
        SimpleFileOptions::default().compression_method(method).large_file(true)
    };
    let mut zip = ZipWriter::new(file);
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
    zip.finish()?.sync_all()?;
    tell(all, all);
    Ok(hashes.into_iter().map(|(name, hash)| (format!("{prefix}/{name}"), hash)).collect())
}

/// Reads an archive again.
fn check(out: &Path, hashes: &BTreeMap<String, String>) -> Result<(), Box<dyn Error>> {
    let mut zip = ZipArchive::new(File::open(out)?)?;
    for (name, expected) in hashes {
        let got = sha256(zip.by_name(name)?)?;
        if got != *expected {
            return Err(format!("{name} does not read back as it was written").into());
        }
    }
    Ok(())
}
